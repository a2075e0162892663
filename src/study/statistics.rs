//! The statistics of studies: Student's t, means of logarithms with their confidence, straight lines.
//!
//! A handful of seeds is all that a study has, so that the quantile is Student's and not the normal one: with three seeds that is more than twice as far.

use std::f64::consts::FRAC_PI_2;

use serde::{Deserialize, Serialize};

/// How sure intervals are.
pub const CONFIDENCE: f64 = 0.95;

/// A mean of positive values that spread by factors: the geometric one, which of log-normal values is the median.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct LogMean {
    /// The geometric mean.
    pub mean: f64,
    /// Where the geometric mean of infinitely many values is with 95 % confidence; `None` for a single value.
    pub interval: Option<[f64; 2]>,
}

impl LogMean {
    /// Of values that are positive and finite; `None` if one is not, or there is none.
    pub fn of(values: &[f64]) -> Option<Self> {
        if values.is_empty() || !values.iter().all(|v| v.is_finite() && *v > 0.0) {
            return None;
        }
        let logs: Vec<f64> = values.iter().map(|v| v.ln()).collect();
        let (mean, error) = mean_and_error(&logs);
        let interval = error.map(|error| {
            let reach = student_t(values.len() as u32 - 1, CONFIDENCE) * error;
            [(mean - reach).exp(), (mean + reach).exp()]
        });
        Some(Self { mean: mean.exp(), interval })
    }
}

/// The mean of values, and its standard error if there are two at least. The mean of none is NaN.
pub fn mean_and_error(values: &[f64]) -> (f64, Option<f64>) {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
    (mean, (values.len() > 1).then(|| (squares / (n * (n - 1.0))).sqrt()))
}

/// The middle value, or the mean of the two in the middle; `None` of none.
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    let upper = *values.get(middle)?;
    Some(if values.len() % 2 == 1 { upper } else { 0.5 * (values[middle - 1] + upper) })
}

/// Slope of the straight line through points that has the least squared distance along y; `None` if no two differ in x.
pub fn slope(points: &[[f64; 2]]) -> Option<f64> {
    let n = points.len() as f64;
    let mean = |c: usize| points.iter().map(|p| p[c]).sum::<f64>() / n;
    let (x, y) = (mean(0), mean(1));
    let squares: f64 = points.iter().map(|p| (p[0] - x) * (p[0] - x)).sum();
    let products: f64 = points.iter().map(|p| (p[0] - x) * (p[1] - y)).sum();
    (squares > 0.0).then(|| products / squares)
}

/// The t that a variable of Student's distribution exceeds in absolute value with probability 1 - `confidence`. At least one degree of freedom, `confidence` in (0, 1).
pub fn student_t(degrees: u32, confidence: f64) -> f64 {
    // In the angle whose tangent is t / sqrt(degrees), probabilities run smoothly from 0 to 1.
    let (mut below, mut above) = (0.0, FRAC_PI_2);
    for _ in 0..60 {
        let middle = 0.5 * (below + above);
        let side = if probability_within(middle, degrees) < confidence { &mut below } else { &mut above };
        *side = middle;
    }
    (0.5 * (below + above)).tan() * f64::from(degrees).sqrt()
}

/// The probability of `|t| <= tan(angle) sqrt(degrees)` (Abramowitz and Stegun, 26.7.3 and 26.7.4).
fn probability_within(angle: f64, degrees: u32) -> f64 {
    let (sin, cos) = angle.sin_cos();
    // 1 + 1/2 cos^2 + 1/2 3/4 cos^4 + ..., for odd degrees of freedom cos + 2/3 cos^3 + ...; up to cos to the degrees - 2.
    let is_odd = degrees % 2 == 1;
    let (mut term, mut sum) = (if is_odd { cos } else { 1.0 }, 0.0);
    for power in (u32::from(is_odd)..degrees.saturating_sub(1)).step_by(2) {
        sum += term;
        let k = f64::from(power);
        term *= (k + 1.0) / (k + 2.0) * cos * cos;
    }
    if is_odd { (angle + sin * sum) / FRAC_PI_2 } else { sin * sum }
}

#[cfg(test)]
mod tests {
    use super::{median, probability_within, slope, student_t};

    /// The table of two-sided 95 % that textbooks print (Abramowitz and Stegun, table 26.10), and some of other confidence.
    #[test]
    fn quantiles_are_those_of_the_tables() {
        let table = [
            12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160,
            2.145, 2.131, 2.120, 2.110, 2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052,
            2.048, 2.045, 2.042,
        ];
        let check = |degrees: u32, confidence: f64, expected: f64| {
            let found = student_t(degrees, confidence);
            assert!(
                (found - expected).abs() <= 0.000_501,
                "{degrees}, {confidence}: {found}, not {expected}"
            );
        };
        for (i, expected) in table.into_iter().enumerate() {
            check(i as u32 + 1, 0.95, expected);
        }
        for (degrees, confidence, expected) in [
            (40, 0.95, 2.021),
            (60, 0.95, 2.000),
            (120, 0.95, 1.980),
            (100_000, 0.95, 1.960),
            (1, 0.99, 63.657),
            (5, 0.99, 4.032),
            (10, 0.90, 1.812),
        ] {
            check(degrees, confidence, expected);
        }
        // With one and two degrees of freedom the quantile has a closed form.
        for p in [0.1, 0.5, 0.95, 0.999] {
            let cauchy = (std::f64::consts::FRAC_PI_2 * p).tan();
            assert!((student_t(1, p) / cauchy - 1.0).abs() < 1e-9);
            let two = p * (2.0 / (1.0 - p * p)).sqrt();
            assert!((student_t(2, p) / two - 1.0).abs() < 1e-9);
        }
        assert_eq!(probability_within(0.0, 7), 0.0);
    }

    #[test]
    fn lines_and_medians() {
        let line = |x: f64| [x, 3.0 - 0.75 * x];
        assert!((slope(&[0.0, 1.0, 5.0].map(line)).expect("a slope") + 0.75).abs() < 1e-12);
        // By hand: from the mean (1, 2), products 1 + 0 + 3 over squares 1 + 0 + 1.
        assert_eq!(slope(&[[0.0, 1.0], [1.0, 0.0], [2.0, 5.0]]), Some(2.0));
        assert_eq!((slope(&[[1.0, 1.0], [1.0, 2.0]]), slope(&[])), (None, None));
        assert_eq!(
            (median([3.0, 1.0, 2.0]), median([4.0, 1.0, 3.0, 2.0]), median([])),
            (Some(2.0), Some(2.5), None)
        );
    }
}
