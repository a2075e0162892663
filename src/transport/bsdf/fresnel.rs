//! Fresnel's equations for unpolarised light, in forms that do not cancel.
//!
//! The textbook forms subtract nearly equal numbers when the indices of both sides are close, when one is far
//! greater than the other, and at grazing incidence. The forms here keep their relative accuracy there, because
//! they take cosine and sine of the incident angle apart and use identities in which the difference `eta^2 - 1` is a factor.

use crate::scene::Rgb;

/// How light that arrives at a boundary between dielectrics splits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DielectricFresnel {
    /// Fraction of the power that is reflected, 0..1. The rest is transmitted.
    pub reflectance: f32,
    /// Cosine of the refracted direction to the normal, not negative; 0 on total reflection.
    pub cos_t: f32,
}

/// Fresnel reflectance and refraction angle of a dielectric boundary.
///
/// `cos` and `sin2` are the cosine (not negative) and squared sine of the incident direction; `eta` > 0 is
/// the index of refraction of the far side over that of the incident side.
#[inline]
pub fn fresnel_dielectric(cos: f32, sin2: f32, eta: f32) -> DielectricFresnel {
    if eta == 1.0 {
        return DielectricFresnel { reflectance: 0.0, cos_t: cos };
    }
    let cos2 = cos * cos;
    let difference = (eta - 1.0) * (eta + 1.0);
    // (eta cos_t)^2 by Snell's law, from whichever of cosine and sine is small and therefore exact.
    let g2 = if cos2 < sin2 { difference + cos2 } else { eta * eta - sin2 };
    if g2 <= 0.0 || cos <= 0.0 {
        return DielectricFresnel { reflectance: 1.0, cos_t: g2.max(0.0).sqrt() / eta };
    }
    let g = g2.sqrt();
    // (cos - g) / (cos + g) and (eta^2 cos - g) / (eta^2 cos + g), multiplied by their conjugates.
    let r_s = difference / ((cos + g) * (cos + g));
    let p = eta * eta * cos + g;
    let r_p = difference * (eta * eta * cos2 - sin2) / (p * p);
    DielectricFresnel { reflectance: (0.5 * (r_s * r_s + r_p * r_p)).min(1.0), cos_t: g / eta }
}

/// Fraction transmitted from the cosines of both sides, which are related by Snell's law. Symmetric: the same for the way back
/// with `1 / eta`. As accurate near total reflection, where it goes to 0, as the cosines are.
#[inline]
pub fn dielectric_transmittance(cos: f32, cos_t: f32, eta: f32) -> f32 {
    let s = cos + eta * cos_t;
    let p = eta * cos + cos_t;
    // Quotients first: products of grazing cosines could underflow.
    (2.0 * eta * ((cos / s) * (cos_t / s) + (cos / p) * (cos_t / p))).min(1.0)
}

/// Fresnel reflectance of a conductor of complex index `eta + i k`, relative to the incident side, per channel.
/// Exact (Lagarde 2013, "Memo on Fresnel equations"); `cos` in 0..1.
#[inline]
pub fn fresnel_conductor(cos: f32, eta: Rgb, k: Rgb) -> Rgb {
    let cos2 = cos * cos;
    let sin2 = (1.0 - cos2).max(0.0);
    let channel = |eta: f32, k: f32| {
        // (a + i b)^2 = (eta + i k)^2 - sin^2
        let real = (eta - k) * (eta + k) - sin2;
        let imaginary = 2.0 * eta * k;
        let norm = (real * real + imaginary * imaginary).sqrt();
        let a2 = if real > 0.0 { 0.5 * (norm + real) } else { 0.5 * imaginary * imaginary / (norm - real) };
        // Only an index of exactly 1 at grazing incidence makes both 0; nothing reflects there.
        let a2 = if a2.is_nan() { 0.0 } else { a2 };
        let a_cos = 2.0 * cos * a2.sqrt();
        let r_s = ratio(norm + cos2 - a_cos, norm + cos2 + a_cos);
        let (c, s) = (cos2 * norm + sin2 * sin2, a_cos * sin2);
        0.5 * r_s * (1.0 + ratio(c - s, c + s))
    };
    Rgb::new(channel(eta.x, k.x), channel(eta.y, k.y), channel(eta.z, k.z))
}

/// A quotient in 0..1 of which both parts may vanish.
#[inline]
fn ratio(numerator: f32, denominator: f32) -> f32 {
    if denominator > 0.0 { (numerator / denominator).max(0.0) } else { 0.0 }
}
