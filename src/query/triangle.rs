//! The watertight ray-triangle test (Woop, Benthin and Wald 2013, "Watertight ray/triangle intersection").
//!
//! The triangle is translated to the ray's origin and sheared so that the ray runs along +z; what is left is a 2D
//! question: in which triangle does the origin lie? Two triangles that share an edge compute the same edge function
//! but for its sign, and rounding never turns a sign over, so no ray passes between them.
//!
//! The paper computes in f32 and repeats in f64 where an edge function is 0. Here all of it is f64. In scalar code that
//! costs about the same, and it buys three things: the translation of f32 corners is exact, so that bounding boxes need no
//! slack in proportion to the size of the scene; denormal coordinates neither vanish nor overflow in triple products;
//! and `t` is right to the last bit of f32.

use glam::{DVec3, Vec3};

use super::Ray;

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TriangleHit {
    /// Distance along the ray.
    pub t: f32,
    /// Barycentric coordinate of the second corner.
    pub u: f32,
    /// Barycentric coordinate of the third corner.
    pub v: f32,
}

/// A ray prepared for many triangles.
#[derive(Debug, Clone, Copy)]
pub struct WatertightRay {
    origin: DVec3,
    /// The axis along which the direction is longest.
    axis: usize,
    /// Shear of the two other axes, in cyclic order after `axis`, per unit of `axis`.
    shear: [f64; 2],
    /// Distance per unit of `axis`.
    scale: f64,
    t_min: f32,
}

impl WatertightRay {
    /// Prepares the ray. A direction of zero or NaN gives a ray that hits nothing.
    #[inline]
    pub fn new(ray: &Ray) -> Self {
        let d = ray.d.as_dvec3();
        let a = d.abs();
        let axis = if a.x > a.y && a.x > a.z {
            0
        } else if a.y > a.z {
            1
        } else {
            2
        };
        let (x, y, z) = cyclic(axis, d);
        Self { origin: ray.o.as_dvec3(), axis, shear: [x / z, y / z], scale: 1.0 / z, t_min: ray.t_min }
    }

    /// The intersection with `t_min < t < t_max`, seen from either side. Edges and corners belong to the triangle;
    /// a triangle without area, or seen exactly edge-on, is never hit.
    #[inline]
    pub fn intersect(&self, corners: &[Vec3; 3], t_max: f32) -> Option<TriangleHit> {
        // The axis is the same for all triangles that a ray meets, so this branch is predicted.
        match self.axis {
            0 => self.intersect_along::<0>(corners, t_max),
            1 => self.intersect_along::<1>(corners, t_max),
            _ => self.intersect_along::<2>(corners, t_max),
        }
    }

    #[inline]
    fn intersect_along<const AXIS: usize>(&self, corners: &[Vec3; 3], t_max: f32) -> Option<TriangleHit> {
        let [(ax, ay, az), (bx, by, bz), (cx, cy, cz)] = corners.map(|corner| {
            let (x, y, z) = cyclic(AXIS, corner.as_dvec3() - self.origin);
            (x - self.shear[0] * z, y - self.shear[1] * z, z)
        });
        // Each is twice the signed area opposite to a corner. Swapping the ends of an edge negates it exactly.
        let a = cx * by - cy * bx;
        let b = ax * cy - ay * cx;
        let c = bx * ay - by * ax;
        if (a < 0.0 || b < 0.0 || c < 0.0) && (a > 0.0 || b > 0.0 || c > 0.0) {
            return None;
        }
        let det = a + b + c;
        if det == 0.0 {
            return None;
        }
        let t = ((a * az + b * bz + c * cz) / det * self.scale) as f32;
        // NaN, which only a ray without direction gives, fails.
        (t > self.t_min && t < t_max).then(|| TriangleHit { t, u: (b / det) as f32, v: (c / det) as f32 })
    }
}

/// The coordinates in cyclic order, `axis` last.
#[inline]
fn cyclic(axis: usize, v: DVec3) -> (f64, f64, f64) {
    match axis {
        0 => (v.y, v.z, v.x),
        1 => (v.z, v.x, v.y),
        _ => (v.x, v.y, v.z),
    }
}
