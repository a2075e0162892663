//! Discrete distributions: the alias table.

/// Draws indices with given probabilities in constant time (Walker 1977, Vose 1991).
#[derive(Debug, Clone)]
pub struct AliasTable {
    bins: Vec<Bin>,
    pdf: Vec<f32>,
}

#[derive(Debug, Clone, Copy)]
struct Bin {
    threshold: f32,
    alias: u32,
}

impl AliasTable {
    /// A table for weights that need not be normalised. `None` if no weight is positive or one is negative, NaN or infinite.
    pub fn new(weights: &[f64]) -> Option<Self> {
        // Scaled by the greatest first: the sum of weights near f64's limit would overflow.
        let greatest = weights.iter().copied().fold(0.0, f64::max);
        let valid = weights.iter().all(|&w| w >= 0.0 && w.is_finite());
        if !valid || greatest <= 0.0 {
            return None;
        }
        let n = weights.len();
        let total: f64 = weights.iter().map(|w| w / greatest).sum();
        let pdf: Vec<f64> = weights.iter().map(|w| w / greatest / total).collect();
        let mut bins = vec![Bin { threshold: 1.0, alias: 0 }; n];
        let mut scaled: Vec<f64> = pdf.iter().map(|p| p * n as f64).collect();
        let (mut small, mut large): (Vec<usize>, Vec<usize>) = (0..n).partition(|&i| scaled[i] < 1.0);
        while let (Some(&s), Some(&l)) = (small.last(), large.last()) {
            small.pop();
            bins[s] = Bin { threshold: scaled[s] as f32, alias: l as u32 };
            scaled[l] -= 1.0 - scaled[s];
            if scaled[l] < 1.0 {
                large.pop();
                small.push(l);
            }
        }
        // Bins left over are full but for rounding. One of weight 0 must not become full by it.
        for i in small {
            if pdf[i] == 0.0 {
                let heaviest = (0..n).max_by(|&a, &b| pdf[a].total_cmp(&pdf[b])).unwrap_or(0);
                bins[i] = Bin { threshold: 0.0, alias: heaviest as u32 };
            }
        }
        Some(Self { bins, pdf: pdf.iter().map(|&p| p as f32).collect() })
    }

    /// Draws an index with `u` in [0, 1). Probabilities are right to about the step between two values that `u` may have, times the number of indices.
    #[inline]
    pub fn sample(&self, u: f64) -> usize {
        if self.bins.len() == 1 {
            return 0;
        }
        let scaled = u * self.bins.len() as f64;
        let i = (scaled as usize).min(self.bins.len() - 1);
        let bin = self.bins[i];
        if scaled - (i as f64) < f64::from(bin.threshold) { i } else { bin.alias as usize }
    }

    /// Probability of an index.
    #[inline]
    pub fn pdf(&self, index: usize) -> f32 {
        self.pdf[index]
    }

    /// Number of indices.
    pub fn len(&self) -> usize {
        self.bins.len()
    }

    /// Whether there are no indices; never, by construction.
    pub fn is_empty(&self) -> bool {
        self.bins.is_empty()
    }
}
