//! Rays against spheres, disks and cylinders, for every backend.
//!
//! The ray is taken to the space of the unit shape in f64. Its direction is not made unit length there, so that distances
//! stay those of the world.

use glam::DVec3;

use super::Ray;
use crate::scene::{AnalyticKind, AnalyticShape};

/// Distance to the nearest intersection with `t_min < t < t_max`, where t is compared after it is rounded to f32.
#[inline]
pub fn intersect(shape: &AnalyticShape, ray: &Ray) -> Option<f32> {
    let to_object = shape.to_object();
    // The difference first: it loses nothing, however far from the origin the shape stands.
    let o = to_object.matrix3 * (ray.o.as_dvec3() - shape.to_world().translation);
    let d = to_object.matrix3 * ray.d.as_dvec3();
    let nearest = |roots: [f64; 2], on_shape: fn(DVec3) -> bool| {
        roots.into_iter().find_map(|t| {
            let rounded = t as f32;
            (rounded > ray.t_min && rounded < ray.t_max && on_shape(o + d * t)).then_some(rounded)
        })
    };
    match shape.kind() {
        AnalyticKind::Sphere => nearest(unit_distance_roots(o, d)?, |_| true),
        AnalyticKind::Disk => nearest([-o.z / d.z, f64::NAN], |p| p.x * p.x + p.y * p.y <= 1.0),
        AnalyticKind::Cylinder => {
            nearest(unit_distance_roots(o.with_z(0.0), d.with_z(0.0))?, |p| (0.0..=1.0).contains(&p.z))
        }
    }
}

/// Where |o + t d| = 1, the lesser t first; none if the line passes farther than 1 from the origin or d is 0.
///
/// The discriminant comes from the point of the line nearest to the centre, and the roots from each other, so that nothing
/// cancels for small, distant or grazed spheres (Haines et al. 2019, "Precision improvements for ray/sphere
/// intersection", Ray Tracing Gems ch. 7).
#[inline]
fn unit_distance_roots(o: DVec3, d: DVec3) -> Option<[f64; 2]> {
    let a = d.length_squared();
    let b = -o.dot(d);
    let nearest = o + d * (b / a);
    let discriminant = a * (1.0 - nearest.length_squared());
    if discriminant.is_nan() || discriminant < 0.0 {
        return None;
    }
    let q = b + discriminant.sqrt().copysign(b);
    let r = o.length();
    // |o|^2 - 1 without squaring first: near the surface its sign decides which side the ray starts on.
    let (t0, t1) = ((r - 1.0) * (r + 1.0) / q, q / a);
    // q is 0 only for a ray that starts on the surface and grazes it: t0 is NaN then, and t1 is the touch itself.
    Some(if t0 <= t1 { [t0, t1] } else { [t1, t0] })
}
