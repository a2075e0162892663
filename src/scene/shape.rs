//! Shapes: a geometry with a material and, perhaps, emission; and bounding boxes.

use glam::Vec3;

use super::{AnalyticShape, Input, Instance, MaterialId, Rgb, TriangleMesh};

/// The surface of a shape. This is the backend-neutral description that every ray-query backend is built from.
#[derive(Debug, Clone)]
pub enum Geometry {
    /// Triangles.
    Mesh(TriangleMesh),
    /// A sphere, disk or cylinder.
    Analytic(AnalyticShape),
    /// A group of shapes that is held once, in one of its places.
    Instance(Instance),
}

impl Geometry {
    /// Number of primitives: triangles of a mesh, 1 for an analytic shape, all of the group for an instance.
    pub fn primitive_count(&self) -> u32 {
        match self {
            Self::Mesh(m) => m.triangles().len() as u32,
            Self::Analytic(_) => 1,
            Self::Instance(i) => i.group().primitive_count(),
        }
    }

    /// World bounds; empty where there are no primitives.
    pub fn bounds(&self) -> Aabb {
        match self {
            Self::Mesh(m) => m.bounds(),
            Self::Analytic(a) => a.bounds(),
            Self::Instance(i) => i.bounds(),
        }
    }
}

/// A surface in the scene.
#[derive(Debug, Clone)]
pub struct Shape {
    /// The file's `id`, or a name made from its plugin and position in the file.
    pub name: String,
    /// The surface.
    pub geometry: Geometry,
    /// What it is made of. The parts of an instance have materials of their own, and this one says nothing.
    pub material: MaterialId,
    /// Radiance emitted from the side that the normal points to (Mitsuba's `area` emitter); below 0 in a texture counts as 0.
    /// Instances emit nothing.
    pub emission: Option<Input<Rgb>>,
}

impl Shape {
    /// The shape with the geometry and material of a primitive: this one, or for an instance a part of its group. Also which primitive of that
    /// shape it is.
    #[inline(always)]
    pub fn part(&self, primitive: u32) -> (&Self, u32) {
        match &self.geometry {
            Geometry::Instance(instance) => {
                let (part, within) = instance.group().part(primitive);
                (&instance.group().shapes()[part as usize], within)
            }
            Geometry::Mesh(_) | Geometry::Analytic(_) => (self, primitive),
        }
    }
}

/// An axis-aligned box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aabb {
    /// Least corner.
    pub min: Vec3,
    /// Greatest corner.
    pub max: Vec3,
}

impl Aabb {
    /// Contains nothing; the neutral element of [`union`](Self::union).
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// Whether the box contains no point.
    pub fn is_empty(&self) -> bool {
        !self.min.cmple(self.max).all()
    }

    /// The least box around `self` and the point `p`.
    #[must_use]
    pub fn extend(self, p: Vec3) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    /// The least box around both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Centre and radius of the sphere through the corners; radius 0 for an empty box.
    pub fn bounding_sphere(&self) -> (Vec3, f32) {
        if self.is_empty() {
            return (Vec3::ZERO, 0.0);
        }
        // Halves first: the sum of two extreme coordinates could overflow.
        let center = self.min * 0.5 + self.max * 0.5;
        (center, (self.max - center).length())
    }
}
