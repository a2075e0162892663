//! Distributions of microfacet normals, their Smith masking, and sampling of the normals that a direction sees.
//!
//! Local coordinates: z is the macroscopic normal. All directions here are on its side, except where refraction is named.
//! What would divide by a grazing cosine is kept as one quotient, [`Microfacets::masking_over_cos`], which stays finite.

use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, FRAC_2_SQRT_PI, TAU};

use crate::scene::Microfacet;

/// Least roughness: below it the lobe is so narrow that f32 directions cannot resolve its shape.
/// A surface of this roughness looks like a mirror (Mitsuba stops at 1e-4).
pub const MIN_ALPHA: f32 = 1e-5;

/// `1 / sqrt(pi)`.
const FRAC_1_SQRT_PI: f32 = 0.5 * FRAC_2_SQRT_PI;

/// A distribution of microfacet normals with its roughness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Microfacets {
    alpha: [f32; 2],
    distribution: Microfacet,
}

impl Microfacets {
    /// Prepares a distribution; roughness below `min_alpha` (itself at least [`MIN_ALPHA`]) becomes `min_alpha`.
    #[inline]
    pub fn new(distribution: Microfacet, alpha: [f32; 2], min_alpha: f32) -> Self {
        let floor = min_alpha.max(MIN_ALPHA);
        Self { alpha: alpha.map(|a| a.max(floor)), distribution }
    }

    /// The isotropic roughness that has the same peak.
    #[inline]
    pub fn mean_alpha(&self) -> f32 {
        (self.alpha[0] * self.alpha[1]).sqrt()
    }

    /// Whether the roughness depends on the direction along the surface.
    #[inline]
    pub fn is_anisotropic(&self) -> bool {
        self.alpha[0] != self.alpha[1]
    }

    /// Density `D(m)` of microfacet area per solid angle and macroscopic area.
    #[inline]
    pub fn d(&self, m: Vec3) -> f32 {
        if m.z <= 0.0 {
            return 0.0;
        }
        let [ax, ay] = self.alpha;
        let (x, y) = (m.x / ax, m.y / ay);
        let stretched2 = x * x + y * y;
        match self.distribution {
            Microfacet::Ggx => {
                let q = stretched2 + m.z * m.z;
                FRAC_1_PI / (ax * ay * q * q)
            }
            Microfacet::Beckmann => {
                let z2 = m.z * m.z;
                let e = (-stretched2 / z2).exp();
                // z^4 may underflow, but the exponential has done so long before.
                if e > 0.0 { FRAC_1_PI * e / (ax * ay * z2 * z2) } else { 0.0 }
            }
        }
    }

    /// Smith's masking function `G1(w)` divided by `cos(w)`, for `w.z` of either sign (by symmetry).
    /// Finite at grazing incidence. Beckmann's is exact; Mitsuba uses a rational fit that is off by up to 0.35 %.
    #[inline]
    pub fn masking_over_cos(&self, w: Vec3) -> f32 {
        let cos = w.z.abs();
        let (x, y) = (self.alpha[0] * w.x, self.alpha[1] * w.y);
        let slope2 = x * x + y * y;
        match self.distribution {
            Microfacet::Ggx => 2.0 / (cos + (cos * cos + slope2).sqrt()),
            Microfacet::Beckmann => {
                let slope = slope2.sqrt();
                // With a = cos / slope, G1 = 2 / (1 + erf(a) + exp(-a^2) / (a sqrt(pi))).
                if cos > 5.0 * slope {
                    return 1.0 / cos; // 1 - G1 < 1e-12
                }
                let a = cos / slope;
                let excess = (-a * a).exp() * (FRAC_1_SQRT_PI - a * erfcx(f64::from(a)) as f32);
                2.0 / (2.0 * cos + slope * excess)
            }
        }
    }

    /// Smith's masking function `G1(w)`, 0..1: the fraction of the microfacets facing `w` that is visible from there.
    #[inline]
    pub fn masking(&self, w: Vec3) -> f32 {
        (self.masking_over_cos(w) * w.z.abs()).min(1.0)
    }

    /// Density per solid angle of [`sample_visible`](Self::sample_visible), given `cos_om = wo . m`.
    #[inline]
    pub fn pdf_visible(&self, wo: Vec3, m: Vec3, cos_om: f32) -> f32 {
        self.d(m) * self.masking_over_cos(wo) * cos_om.max(0.0)
    }

    /// Draws a microfacet normal as seen from `wo` (`wo.z` > 0), with `u` in the unit square.
    #[inline]
    pub fn sample_visible(&self, wo: Vec3, u: Vec2) -> Vec3 {
        let [ax, ay] = self.alpha;
        // Stretching space by the roughness reduces all cases to roughness 1.
        let stretched = Vec3::new(ax * wo.x, ay * wo.y, wo.z).normalize();
        let m = match self.distribution {
            Microfacet::Ggx => sample_hemisphere_caps(stretched, u),
            Microfacet::Beckmann => sample_visible_beckmann(stretched, u),
        };
        Vec3::new(ax * m.x, ay * m.y, m.z).normalize()
    }
}

/// Visible normals of GGX with roughness 1, not normalised (Dupuy and Benyoub 2023, "Sampling visible GGX normals with
/// spherical caps"): reflections off a hemisphere of mirrors fill the spherical cap above `-wo.z`.
#[inline]
fn sample_hemisphere_caps(wo: Vec3, u: Vec2) -> Vec3 {
    let (sin, cos) = (TAU * u.x).sin_cos();
    // Height over the cap's bottom; the point's own z would cancel in 1 - z^2, so that 1 - z and 1 + z are kept apart.
    let height = (1.0 - u.y) * (1.0 + wo.z);
    let one_minus_z = u.y * (1.0 + wo.z);
    let one_plus_z = height + (wo.x * wo.x + wo.y * wo.y) / (1.0 + wo.z);
    let r = (one_minus_z * one_plus_z).sqrt();
    Vec3::new(r * cos + wo.x, r * sin + wo.y, height)
}

/// Visible normals of Beckmann with roughness 1, not normalised (Heitz and d'Eon 2014, "Importance sampling microfacet-based BSDFs
/// using the distribution of visible normals"): the slope towards `wo` by inversion, the one across is Gaussian.
#[inline]
fn sample_visible_beckmann(wo: Vec3, u: Vec2) -> Vec3 {
    let sin = wo.x.hypot(wo.y);
    let (cos_phi, sin_phi) = if sin > 0.0 { (wo.x / sin, wo.y / sin) } else { (1.0, 0.0) };
    let along = invert_visible_slope(f64::from(wo.z), f64::from(sin), f64::from(u.x)) as f32;
    // A Gaussian is what is visible from straight above; its left half is the quicker one to invert.
    let (tail, sign) = if u.y < 0.5 { (u.y, 1.0) } else { (1.0 - u.y, -1.0) };
    let across = sign * invert_visible_slope(1.0, 0.0, f64::from(tail)) as f32;
    Vec3::new(sin_phi * across - cos_phi * along, -cos_phi * across - sin_phi * along, 1.0)
}

/// The slope `x` below which lies the fraction `u` of the projected area of a Beckmann surface of roughness 1, seen along
/// the slope's axis from a direction of the given sine and cosine.
///
/// The area below x is `A(x) = cos erfc(-x) / 2 + sin exp(-x^2) / (2 sqrt(pi))` up to `x = cos / sin`, where facets turn away.
/// Its logarithm is concave and the starting point lies left of the root, so that Newton's method on the logarithm
/// goes to the root from the left without ever overshooting; 4 steps on average.
fn invert_visible_slope(cos: f64, sin: f64, u: f64) -> f64 {
    const STEPS: u32 = 16;
    // Each step's error is about the square of the step before, so that after one this short the root is found to f32's precision.
    const LAST_STEP: f64 = 1e-3;
    const SQRT_PI: f64 = 2.0 / std::f64::consts::FRAC_2_SQRT_PI;
    let sin = sin.max(1e-30);
    // Twice the area and its relative slope, with the factor exp(-x^2) split off on the left where it would underflow.
    let log_area = |x: f64| {
        let e = (-x * x).exp();
        let slope = 2.0 * (cos - x * sin) / SQRT_PI;
        if x < 0.0 {
            let scaled = cos * erfcx(-x) + sin / SQRT_PI;
            (scaled.ln() - x * x, slope / scaled)
        } else {
            let area = cos * (2.0 - e * erfcx(x)) + e * sin / SQRT_PI;
            (area.ln(), slope * e / area)
        }
    };
    // Beyond 5 in either direction lies less than a random number can tell from 0.
    let end = (cos / sin).min(5.0);
    let log_u = u.max(1e-11).ln();
    let target = log_u + log_area(end).0;
    let mut x = -(-log_u).max(0.0).sqrt();
    for _ in 0..STEPS {
        let (value, slope) = log_area(x);
        // The slope vanishes where facets turn away, which is then the root.
        let step = if slope > 0.0 { (target - value) / slope } else { 0.0 };
        x = (x + step).min(end);
        if step < LAST_STEP {
            break;
        }
    }
    x
}

/// The scaled complementary error function `exp(x^2) erfc(x)` for `x >= 0`; relative error below 2e-8.
///
/// A polynomial in `t = 2 / (2 + x)`, fitted at Chebyshev points to `erfcx(x) / t`, which is smooth up to `x = infinity`.
#[inline]
fn erfcx(x: f64) -> f64 {
    const COEFFICIENTS: [f64; 11] = [
        0.282_094_795_064_4,
        0.282_093_776_789_4,
        0.246_883_879_833_5,
        0.175_324_075_381_1,
        0.093_414_748_520_3,
        -0.059_050_910_105_9,
        0.131_850_040_438_7,
        -0.454_563_718_556_9,
        0.493_385_742_191_7,
        -0.234_605_490_784_4,
        0.043_173_065_958,
    ];
    let t = 2.0 / (2.0 + x);
    t * COEFFICIENTS.iter().rev().fold(0.0, |sum, c| sum * t + c)
}
