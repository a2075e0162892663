//! Ray tests for spheres, disks and cylinders in f64, shared by all backends.

use crate::query::Ray;
use crate::scene::{AnalyticKind, AnalyticShape};

/// Distance to the nearest point of the shape with `t_min < t < t_max`.
#[inline]
pub fn intersect(shape: &AnalyticShape, ray: &Ray) -> Option<f32> {
    let o = shape.to_object().transform_point3(ray.o.as_dvec3());
    let d = shape.to_object().transform_vector3(ray.d.as_dvec3());
    let in_range = |t: f64| Some(t as f32).filter(|&t| ray.t_min < t && t < ray.t_max);
    match shape.kind() {
        AnalyticKind::Sphere => {
            let a = d.length_squared();
            let middle = -o.dot(d) / a;
            let half = ((1.0 - (o + middle * d).length_squared()) / a).sqrt();
            in_range(middle - half).or_else(|| in_range(middle + half))
        }
        AnalyticKind::Disk => {
            let t = -o.z / d.z;
            let p = o + t * d;
            in_range(t).filter(|_| p.x * p.x + p.y * p.y <= 1.0)
        }
        AnalyticKind::Cylinder => {
            let (o2, d2) = (o.truncate(), d.truncate());
            let a = d2.length_squared();
            let middle = -o2.dot(d2) / a;
            let half = ((1.0 - (o2 + middle * d2).length_squared()) / a).sqrt();
            let on_side = |t: f64| in_range(t).filter(|_| (0.0..=1.0).contains(&(o.z + t * d.z)));
            on_side(middle - half).or_else(|| on_side(middle + half))
        }
    }
}
