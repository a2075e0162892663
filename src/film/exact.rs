//! Sums that are the same in any order: fixed-point accumulators of 128 bits.
//!
//! A floating-point sum depends on the order of its terms, so an image summed in f64 depends on the number of threads
//! and on where it was interrupted. Here each term is rounded once, by itself, to a multiple of a *quantum*, and
//! integers add exactly. (Compare the long accumulator of Kulisch and Miranker 1986; 128 bits suffice because the
//! caller knows the scale of what is summed.)

/// The unit of a fixed-point sum: a power of two.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quantum {
    log2: i32,
}

impl Quantum {
    /// The quantum 2^`log2`.
    ///
    /// # Panics
    /// Unless `log2` is in -1000 to 900, where conversions stay within normal f64.
    pub const fn from_log2(log2: i32) -> Self {
        assert!(-1000 <= log2 && log2 <= 900, "quantum out of the range of f64");
        Self { log2 }
    }

    /// The quantum as a number.
    #[inline]
    fn value(self) -> f64 {
        power_of_two(self.log2)
    }

    /// One over the quantum: a factor that changes no digit of a number.
    #[inline]
    pub fn per_unit(self) -> f64 {
        power_of_two(-self.log2)
    }

    /// `x` in quanta, to nearest, ties to even. What does not fit (2^126 quanta or more, infinities, NaN) becomes the
    /// greatest or least value, which [`ExactSum`] takes for infinite.
    #[inline]
    pub fn round(self, x: f64) -> i128 {
        let y = x * self.per_unit();
        if y.abs() < ExactSum::SMALL {
            return i128::from(y.round_ties_even() as i64);
        }
        self.round_large(x)
    }

    /// [`round`](Self::round) for any number.
    #[inline]
    fn round_large(self, x: f64) -> i128 {
        const SIGNIFICAND_BITS: i32 = 52;
        const EXPONENT_MASK: i32 = 0x7ff;
        let bits = x.to_bits();
        let exponent = (bits >> SIGNIFICAND_BITS) as i32 & EXPONENT_MASK;
        // Subnormals have the exponent of the smallest normals but no hidden bit.
        let hidden = u64::from(exponent != 0) << SIGNIFICAND_BITS;
        let significand = bits & ((1 << SIGNIFICAND_BITS) - 1) | hidden;
        // x = significand * 2^shift quanta.
        let shift = exponent.max(1) - 1075 - self.log2;
        let magnitude = match shift {
            0..74 => i128::from(significand) << shift,
            -53..0 => {
                // Half a quantum is added, a trifle less if the integer part is even.
                let odd = significand >> -shift & 1;
                i128::from((significand + (1 << (-shift - 1)) - 1 + odd) >> -shift)
            }
            74.. if significand != 0 => return saturated(x),
            // Zero, or below half a quantum because significand < 2^53.
            _ => 0,
        };
        // Two's complement by the sign mask: signs of radiance are predictable, those of filter weights are not.
        let sign = i128::from((bits as i64) >> 63);
        (magnitude ^ sign) - sign
    }
}

/// 2^`exponent` for exponents of normal f64.
#[inline]
pub(super) fn power_of_two(exponent: i32) -> f64 {
    f64::from_bits(((exponent + 1023) as u64) << 52)
}

/// Whether a sum is below 2^126 in magnitude (or is -2^126, which does no harm).
#[inline]
fn in_range(sum: i128) -> bool {
    sum >> 126 == sum >> 127
}

#[cold]
fn saturated(x: f64) -> i128 {
    if x.is_sign_negative() { i128::MIN } else { i128::MAX }
}

/// A sum of multiples of a [`Quantum`], exact as long as it stays below 2^126 quanta in magnitude.
///
/// The quantum is not stored: a film has millions of sums and few quanta. Beyond the range a sum is infinite and stays so.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct ExactSum(i128);

impl ExactSum {
    /// Adds a number of quanta as made by [`Quantum::round`]. Whether the sum became infinite by it.
    #[inline]
    #[must_use]
    pub fn add(&mut self, quanta: i128) -> bool {
        // What is in range cannot wrap around. An infinite sum is 2^126 away from the range, so no term brings it back.
        let sum = self.0.wrapping_add(quanta);
        if in_range(sum) & in_range(quanta) {
            self.0 = sum;
            return false;
        }
        self.overflow(quanta)
    }

    /// Quanta that an `i64` holds.
    const SMALL: f64 = 4e18;

    /// Adds a number, [rounded](Quantum::round) to quanta. Whether the sum became infinite by it.
    #[inline]
    #[must_use]
    pub fn add_f64(&mut self, x: f64, quantum: Quantum) -> bool {
        let y = x * quantum.per_unit();
        if y.abs() < Self::SMALL {
            // Nearly always; as in `round`, but without the checks that only large numbers need.
            let quanta = i128::from(y.round_ties_even() as i64);
            let sum = self.0.wrapping_add(quanta);
            if in_range(sum) {
                self.0 = sum;
                return false;
            }
        }
        self.add(quantum.round(x))
    }

    /// Makes the sum infinite unless it is already.
    #[cold]
    fn overflow(&mut self, quanta: i128) -> bool {
        if self.is_infinite() {
            return false;
        }
        self.0 = if quanta > 0 { i128::MAX } else { i128::MIN };
        true
    }

    /// Whether the sum has left its range.
    #[inline]
    pub fn is_infinite(self) -> bool {
        !in_range(self.0)
    }

    /// The sum in quanta.
    #[inline]
    pub fn quanta(self) -> i128 {
        self.0
    }

    /// The sum as a number, to nearest; infinite if it has left its range.
    #[inline]
    pub fn value(self, quantum: Quantum) -> f64 {
        match self.0 {
            i128::MAX => f64::INFINITY,
            i128::MIN => f64::NEG_INFINITY,
            sum => sum as f64 * quantum.value(),
        }
    }

    /// The sum as bytes, little-endian, and back.
    pub(super) fn to_le_bytes(self) -> [u8; 16] {
        self.0.to_le_bytes()
    }

    /// Inverse of [`to_le_bytes`](Self::to_le_bytes).
    pub(super) fn from_le_bytes(bytes: [u8; 16]) -> Self {
        Self(i128::from_le_bytes(bytes))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: Quantum = Quantum::from_log2(0);

    #[test]
    fn rounds_to_nearest_ties_to_even() {
        for (x, quanta) in [
            (0.0, 0),
            (-0.0, 0),
            (0.5, 0),
            (1.5, 2),
            (2.5, 2),
            (-1.5, -2),
            (-2.5, -2),
            (0.500_000_1, 1),
            (0.499_999_9, 0),
            (0.25, 0),
            (1e-300, 0),
            (f64::from_bits(1), 0),
            (9_007_199_254_740_993.0, 9_007_199_254_740_992),
            (4_503_599_627_370_495.5, 4_503_599_627_370_496),
        ] {
            assert_eq!(UNIT.round(x), quanta, "{x}");
        }
    }

    #[test]
    fn agrees_with_the_language_on_integers_and_halves() {
        // Over all exponents, `as i128` (which truncates) of a value rounded by the standard library is the reference.
        let mut bits = 0x1234_5678_9abc_def0_u64;
        for _ in 0..100_000 {
            bits = bits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            let exponent = 1023 - 60 + (bits >> 32) % 186;
            let x = f64::from_bits(bits & 0x800f_ffff_ffff_ffff | exponent << 52);
            assert_eq!(UNIT.round(x), x.round_ties_even() as i128, "{x:e}");
        }
    }

    #[test]
    fn quanta_scale() {
        let fine = Quantum::from_log2(-64);
        assert_eq!(fine.round(1.0), 1 << 64);
        assert_eq!(fine.round(-3.0 * 2f64.powi(-65)), -2);
        let mut sum = ExactSum::default();
        assert!(!sum.add(fine.round(0.1)));
        assert_eq!(sum.value(fine), 0.1);
    }

    #[test]
    fn what_does_not_fit_is_infinite_and_stays_so() {
        for x in [2f64.powi(126), f64::INFINITY, f64::MAX] {
            assert_eq!(UNIT.round(x), i128::MAX);
            assert_eq!(UNIT.round(-x), i128::MIN);
        }
        assert_eq!(UNIT.round(2f64.powi(125)), 1 << 125);
        for sign in [1, -1] {
            for last in [sign << 125, UNIT.round(sign as f64 * f64::INFINITY)] {
                let mut sum = ExactSum::default();
                assert!(!sum.add(sign * ((1 << 125) + 1)));
                assert!(sum.add(last));
                for more in [last, -last, sign, -sign, 0] {
                    assert!(!sum.add(more), "reported once");
                    assert_eq!(sum.value(UNIT), sign as f64 * f64::INFINITY);
                }
            }
        }
    }
}
