//! Spheres, disks and cylinders: unit shapes under an affine map, kept in f64.
//!
//! The map is held in f64, and rays are tested against the unit shape in f64, so that a sphere is as accurate seen
//! from inside as from outside and for any radius. Intersection itself is in [`crate::query::analytic`].

use glam::{DAffine3, DMat3, DVec3, Vec3};

use super::Aabb;

/// Which unit shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AnalyticKind {
    /// x^2 + y^2 + z^2 = 1, normal outwards.
    Sphere,
    /// x^2 + y^2 <= 1 at z = 0, normal +z.
    Disk,
    /// x^2 + y^2 = 1 for 0 <= z <= 1, open at both ends, normal outwards.
    Cylinder,
}

/// A unit shape placed in the world.
#[derive(Debug, Clone, PartialEq)]
pub struct AnalyticShape {
    kind: AnalyticKind,
    to_world: DAffine3,
    to_object: DAffine3,
    flip_normals: bool,
}

impl AnalyticShape {
    /// Places a unit shape. `None` if the map is singular or not finite, or if it shears: the images of the
    /// axes must be orthogonal, and of equal length for a sphere; for a cylinder x and y must be of equal length.
    pub fn new(kind: AnalyticKind, to_world: DAffine3, flip_normals: bool) -> Option<Self> {
        let [x, y, z] = [to_world.x_axis, to_world.y_axis, to_world.z_axis].map(|v: DVec3| v);
        let lengths = DVec3::new(x.length(), y.length(), z.length());
        let volume = to_world.matrix3.determinant().abs();
        // Orthogonal axes have the product of their lengths as volume; 1e-6 is a shear that f32 input makes by rounding.
        let orthogonal = volume > lengths.element_product() * (1.0 - 1e-6);
        let equal = |a: f64, b: f64| (a - b).abs() <= 1e-5 * a.max(b);
        let even = match kind {
            AnalyticKind::Sphere => equal(lengths.x, lengths.y) && equal(lengths.y, lengths.z),
            AnalyticKind::Cylinder => equal(lengths.x, lengths.y),
            AnalyticKind::Disk => true,
        };
        let to_object = to_world.inverse();
        if !(lengths.min_element() > 0.0
            && orthogonal
            && even
            && to_world.is_finite()
            && to_object.is_finite())
        {
            return None;
        }
        Some(Self { kind, to_world, to_object, flip_normals })
    }

    /// A sphere.
    pub fn sphere(center: DVec3, radius: f64) -> Option<Self> {
        Self::new(
            AnalyticKind::Sphere,
            DAffine3::from_mat3_translation(DMat3::from_diagonal(DVec3::splat(radius)), center),
            false,
        )
    }

    /// Which unit shape.
    pub fn kind(&self) -> AnalyticKind {
        self.kind
    }

    /// Unit space to world space.
    pub fn to_world(&self) -> &DAffine3 {
        &self.to_world
    }

    /// World space to unit space.
    pub fn to_object(&self) -> &DAffine3 {
        &self.to_object
    }

    /// Whether the normal is turned over.
    pub fn flip_normals(&self) -> bool {
        self.flip_normals
    }

    /// World area.
    pub fn area(&self) -> f64 {
        use std::f64::consts::PI;
        let m = self.to_world.matrix3;
        let (x, y, z) = (m.x_axis.length(), m.y_axis.length(), m.z_axis.length());
        match self.kind {
            AnalyticKind::Sphere => 4.0 * PI * x * x,
            AnalyticKind::Disk => PI * x * y,
            AnalyticKind::Cylinder => 2.0 * PI * x * z,
        }
    }

    /// World bounds, rounded outwards.
    pub fn bounds(&self) -> Aabb {
        let m = self.to_world.matrix3;
        // The extent of a unit disc's image along an axis is the length of that row.
        let disc = DVec3::new(
            m.x_axis.x.hypot(m.y_axis.x),
            m.x_axis.y.hypot(m.y_axis.y),
            m.x_axis.z.hypot(m.y_axis.z),
        );
        let o = self.to_world.translation;
        let (min, max) = match self.kind {
            AnalyticKind::Sphere => {
                let r = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
                (o - r, o + r)
            }
            AnalyticKind::Disk => (o - disc, o + disc),
            AnalyticKind::Cylinder => {
                let top = o + m.z_axis;
                (o.min(top) - disc, o.max(top) + disc)
            }
        };
        let down = |x: f64| (x as f32).next_down();
        let up = |x: f64| (x as f32).next_up();
        Aabb {
            min: Vec3::new(down(min.x), down(min.y), down(min.z)),
            max: Vec3::new(up(max.x), up(max.y), up(max.z)),
        }
    }
}
