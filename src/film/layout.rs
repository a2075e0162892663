//! Which sums a film keeps for each pixel, and how one pass is added to them.

use super::aov::{Aov, AovRecord, AovSet};
use super::exact::{ExactSum, Quantum, power_of_two};
use super::reconstruct::Weighted;

/// Fixed point of what does not scale with the scene's radiance: filter weights, AOVs.
pub(super) const WEIGHT: Quantum = Quantum::from_log2(-60);

/// Fixed point of counts.
pub(super) const COUNT: Quantum = Quantum::from_log2(0);

/// Fixed points and limits that follow from the radiance unit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Scale {
    /// Binary logarithm of the radiance unit.
    pub(super) unit_log2: i32,
}

impl Scale {
    /// The scale of a radiance unit; see [`Film::new`](super::Film::new).
    pub(super) fn new(radiance_unit: f32) -> Self {
        // The exponent's bits rather than a logarithm, which may differ between machines.
        let exponent = (radiance_unit.to_bits() >> 23) as i32 - 127;
        let usable = radiance_unit.is_normal() && radiance_unit > 0.0;
        Self { unit_log2: if usable { exponent } else { 0 } }
    }

    /// Of radiance, and of radiance times filter weight.
    pub(super) fn radiance(self) -> Quantum {
        Quantum::from_log2(self.unit_log2 - 64)
    }

    /// Of squared radiance.
    pub(super) fn squared(self) -> Quantum {
        Quantum::from_log2(2 * self.unit_log2 - 56)
    }

    /// The greatest radiance that is not dropped. A sum holds 2^23 of these.
    pub(super) fn limit(self) -> f32 {
        power_of_two(self.unit_log2 + 40).min(f64::from(f32::MAX)) as f32
    }
}

/// Where in the sums of a pixel each quantity is. The first three are the sums of f L.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Layout {
    /// Sum of f. The box filter has none: there it is the number of passes.
    pub(super) weight: Option<usize>,
    /// For the variance: sums of (f L)^2, then, unless the filter is the box, of f L f (three each), and of f^2.
    pub(super) moments: Option<usize>,
    /// Number of samples that were kept.
    pub(super) kept: Option<usize>,
    /// Number of samples that hit something, followed by the sums of `averaged`.
    pub(super) hits: Option<usize>,
    /// Indices into [`AVERAGED`].
    pub(super) averaged: Vec<usize>,
    /// Sums per pixel.
    pub(super) stride: usize,
}

impl Layout {
    pub(super) fn new(is_box: bool, aovs: AovSet) -> Self {
        let mut stride = 3;
        let mut take = |wanted: bool, count: usize| {
            let at = stride;
            stride += if wanted { count } else { 0 };
            wanted.then_some(at)
        };
        let averaged = aovs.averaged();
        let weight = take(!is_box, 1);
        let moments = take(aovs.contains(Aov::Variance), if is_box { 3 } else { 7 });
        let kept = take(aovs.contains(Aov::SampleCount), 1);
        let hits = take(!averaged.is_empty(), 1 + averaged.len());
        Self { weight, moments, kept, hits, averaged, stride }
    }

    /// Adds the weighted sums of one pass to those of a pixel. Returns the number of sums that left their range.
    #[inline]
    pub(super) fn add(&self, sums: &mut [ExactSum], pass: Weighted, scale: Scale) -> u64 {
        let mut overflows = 0;
        for (sum, &a) in sums.iter_mut().zip(&pass[..3]) {
            overflows += u64::from(sum.add_f64(f64::from(a), scale.radiance()));
        }
        if let Some(weight) = self.weight {
            overflows += u64::from(sums[weight].add_f64(f64::from(pass[3]), WEIGHT));
        }
        if let Some(moments) = self.moments {
            self.add_moments(&mut sums[moments..], pass, scale);
        }
        overflows
    }

    /// Overflow here is not an event of its own: it makes the variance infinite.
    fn add_moments(&self, moments: &mut [ExactSum], pass: Weighted, scale: Scale) {
        let [r, g, b, f] = pass.map(f64::from);
        for (channel, a) in [r, g, b].into_iter().enumerate() {
            let _ = moments[channel].add_f64(a * a, scale.squared());
            if self.weight.is_some() {
                let _ = moments[3 + channel].add_f64(a * f, scale.radiance());
            }
        }
        if self.weight.is_some() {
            let _ = moments[6].add_f64(f * f, WEIGHT);
        }
    }

    /// Adds what AOVs need of the pixel's own sample.
    pub(super) fn add_record(
        &self,
        sums: &mut [ExactSum],
        kept: bool,
        record: Option<&AovRecord>,
    ) -> AovOutcome {
        let mut outcome = AovOutcome::default();
        if let Some(at) = self.kept {
            outcome.overflows += u64::from(sums[at].add(i128::from(kept)));
        }
        let (Some(hits), Some(record)) = (self.hits, record) else { return outcome };
        if !record.is_hit() {
            return outcome;
        }
        let values = record.values();
        if !self.averaged.iter().all(|&i| values[i].is_finite()) {
            outcome.dropped = 1;
            return outcome;
        }
        outcome.overflows += u64::from(sums[hits].add(1));
        for (sum, &i) in sums[hits + 1..].iter_mut().zip(&self.averaged) {
            outcome.overflows += u64::from(sum.add_f64(f64::from(values[i]), WEIGHT));
        }
        outcome
    }
}

/// What became of the AOVs of some pixels.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct AovOutcome {
    pub(super) dropped: u64,
    pub(super) overflows: u64,
}
