//! Weights of multiple importance sampling (Veach 1997, chapter 9).

/// The power heuristic with exponent 2 for a sample drawn with density `pdf` that another technique would
/// have drawn with density `other`, one sample each. Computed from the ratio, so that it neither overflows nor
/// becomes NaN for densities near the limits of f32.
#[inline]
pub fn power_heuristic(pdf: f32, other: f32) -> f32 {
    let ratio = other / pdf;
    1.0 / (1.0 + ratio * ratio)
}

#[cfg(test)]
mod tests {
    use super::power_heuristic;

    #[test]
    fn weights_sum_to_one_at_the_extremes() {
        for (a, b) in [(1.0, 1.0), (1e-30, 1e30), (3e38, 3e38), (1e-38, 1e-38), (0.3, 0.7), (1e20, 1e-3)] {
            let sum = power_heuristic(a, b) + power_heuristic(b, a);
            assert!((sum - 1.0).abs() < 1e-6, "{a} {b}: {sum}");
        }
        assert_eq!(power_heuristic(2.0, 0.0), 1.0);
        assert!((power_heuristic(1.0, 2.0) - 0.2).abs() < 1e-7);
    }
}
