//! Maps from the unit square to discs, hemispheres, spheres and triangles, and their densities.

use glam::{Vec2, Vec3};
use std::f32::consts::{FRAC_1_PI, FRAC_PI_4, PI, TAU};

/// Uniform on the unit disc (Shirley and Chiu 1997, concentric squares).
#[inline]
pub fn square_to_disc(u: Vec2) -> Vec2 {
    let o = 2.0 * u - Vec2::ONE;
    if o == Vec2::ZERO {
        return Vec2::ZERO;
    }
    if o.x.abs() > o.y.abs() {
        let (sin, cos) = sin_cos_octant(FRAC_PI_4 * (o.y / o.x));
        o.x * Vec2::new(cos, sin)
    } else {
        let (sin, cos) = sin_cos_octant(FRAC_PI_4 * (o.x / o.y));
        o.y * Vec2::new(sin, cos)
    }
}

/// Sine and cosine of an angle in [-pi/4, pi/4] to 1e-7, by Taylor's series up to the ninth power. Other than the system's, whose
/// last bit depends on the processor, it is the same everywhere; and it is inlined.
#[inline]
fn sin_cos_octant(x: f32) -> (f32, f32) {
    let x2 = x * x;
    let sin =
        x * (1.0 + x2 * (-1.0 / 6.0 + x2 * (1.0 / 120.0 + x2 * (-1.0 / 5040.0 + x2 * (1.0 / 362_880.0)))));
    let cos = 1.0 + x2 * (-0.5 + x2 * (1.0 / 24.0 + x2 * (-1.0 / 720.0 + x2 * (1.0 / 40_320.0))));
    (sin, cos)
}

/// Cosine-weighted on the hemisphere around +z.
#[inline]
pub fn square_to_cosine_hemisphere(u: Vec2) -> Vec3 {
    let d = square_to_disc(u);
    // The rim has z = 0; a tiny positive value keeps sample and density on the same side.
    let z = (1.0 - d.length_squared()).max(1e-12).sqrt();
    d.extend(z)
}

/// Density of [`square_to_cosine_hemisphere`] per solid angle for a direction at cosine `cos_theta`.
#[inline]
pub fn cosine_hemisphere_pdf(cos_theta: f32) -> f32 {
    cos_theta.max(0.0) * FRAC_1_PI
}

/// Uniform on the unit sphere; density 1 / (4 pi).
#[inline]
pub fn square_to_sphere(u: Vec2) -> Vec3 {
    let z = 1.0 - 2.0 * u.x;
    let r = (4.0 * u.x * (1.0 - u.x)).max(0.0).sqrt();
    let (sin, cos) = (TAU * u.y).sin_cos();
    Vec3::new(r * cos, r * sin, z)
}

/// Density of [`square_to_sphere`].
pub const UNIFORM_SPHERE_PDF: f32 = 1.0 / (4.0 * PI);

/// Uniform barycentric coordinates (of second and third corner) on a triangle
/// (Heitz 2019, "A low-distortion map between triangle and square").
#[inline]
pub fn square_to_triangle(u: Vec2) -> Vec2 {
    if u.y > u.x {
        let x = u.x * 0.5;
        Vec2::new(x, u.y - x)
    } else {
        let y = u.y * 0.5;
        Vec2::new(u.x - y, y)
    }
}
