//! Groups of shapes and their instances: surfaces that are held once and stand in many places.
//!
//! An instance costs its two maps; the shapes, and what a backend builds over them, are the group's. Groups do not
//! nest and do not emit, as in Mitsuba.

use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec3};
use thiserror::Error;

use super::mesh::next_revision;
use super::{Aabb, Geometry, MaterialId, Shape, TriangleMesh};

/// Why a group or an instance was refused.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum InstanceError {
    /// A group in a group.
    #[error("`{name}`, an instance, is part of a shape group")]
    Nested {
        /// The part's name.
        name: String,
    },
    /// Lights are sampled where they stand, and a group stands nowhere.
    #[error("`{name}`, which emits, is part of a shape group")]
    Emits {
        /// The part's name.
        name: String,
    },
    /// More primitives than 32 bits can name.
    #[error("a shape group of more than 2^31 - 1 primitives")]
    TooLarge,
    /// The map has no usable inverse.
    #[error(
        "a map that is singular, not finite, or scales by more than {:e} or less than its inverse",
        Instance::SCALE_LIMIT
    )]
    Singular,
    /// The instance reaches too far.
    #[error("an instance that reaches beyond {limit:e}", limit = TriangleMesh::COORDINATE_LIMIT)]
    OutOfRange,
}

/// Shapes in a space of their own.
#[derive(Debug)]
pub struct Group {
    shapes: Vec<Shape>,
    /// For each shape, how many primitives those before it have.
    first_primitives: Vec<u32>,
    primitive_count: u32,
    bounds: Aabb,
    revision: u64,
}

impl Group {
    /// Takes the shapes.
    ///
    /// # Errors
    /// If one is an instance or emits, or if there are too many primitives.
    pub fn new(shapes: Vec<Shape>) -> Result<Self, InstanceError> {
        let mut first_primitives = Vec::with_capacity(shapes.len());
        let mut primitive_count = 0_u32;
        let mut bounds = Aabb::EMPTY;
        for shape in &shapes {
            if matches!(shape.geometry, Geometry::Instance(_)) {
                return Err(InstanceError::Nested { name: shape.name.clone() });
            }
            if shape.emission.is_some() {
                return Err(InstanceError::Emits { name: shape.name.clone() });
            }
            first_primitives.push(primitive_count);
            let count = primitive_count.checked_add(shape.geometry.primitive_count());
            primitive_count = count.filter(|&n| n < i32::MAX as u32).ok_or(InstanceError::TooLarge)?;
            bounds = bounds.union(shape.geometry.bounds());
        }
        Ok(Self { shapes, first_primitives, primitive_count, bounds, revision: next_revision() })
    }

    /// A number that stands for the surfaces: no other group has it, and they never change.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// The shapes, in the group's space.
    pub fn shapes(&self) -> &[Shape] {
        &self.shapes
    }

    /// Number of primitives of all shapes.
    pub fn primitive_count(&self) -> u32 {
        self.primitive_count
    }

    /// The number of a shape's first primitive when those of all shapes are counted through.
    #[inline]
    pub fn first_primitive(&self, shape: u32) -> u32 {
        self.first_primitives[shape as usize]
    }

    /// The shape that a primitive belongs to, and which primitive of that shape it is. Undoes [`first_primitive`](Self::first_primitive).
    #[inline]
    pub fn part(&self, primitive: u32) -> (u32, u32) {
        let shape = self.first_primitives.partition_point(|&first| first <= primitive) - 1;
        (shape as u32, primitive - self.first_primitives[shape])
    }

    /// Bounds in the group's space.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }
}

/// Gives all shapes, and those of all groups, other materials. A group that is also held elsewhere keeps its own.
pub(super) fn map_materials(shapes: &mut [Shape], map: impl Fn(MaterialId) -> MaterialId) {
    let nothing = Arc::new(Group {
        shapes: Vec::new(),
        first_primitives: Vec::new(),
        primitive_count: 0,
        bounds: Aabb::EMPTY,
        revision: next_revision(),
    });
    // Instances let go of their groups, each of which is then held once, here, and can be written to.
    let mut groups: Vec<(Arc<Group>, Vec<usize>)> = Vec::new();
    let mut known = std::collections::HashMap::new();
    for (index, shape) in shapes.iter_mut().enumerate() {
        shape.material = map(shape.material);
        let Geometry::Instance(instance) = &mut shape.geometry else { continue };
        let group = std::mem::replace(&mut instance.group, Arc::clone(&nothing));
        let slot = *known.entry(Arc::as_ptr(&group)).or_insert_with(|| {
            groups.push((group, Vec::new()));
            groups.len() - 1
        });
        groups[slot].1.push(index);
    }
    for (mut group, instances) in groups {
        if let Some(group) = Arc::get_mut(&mut group) {
            for part in &mut group.shapes {
                part.material = map(part.material);
            }
        }
        for index in instances {
            if let Geometry::Instance(instance) = &mut shapes[index].geometry {
                instance.group = Arc::clone(&group);
            }
        }
    }
}

/// A group put somewhere by an affine map.
#[derive(Debug, Clone)]
pub struct Instance {
    group: Arc<Group>,
    to_world: DAffine3,
    to_group: DAffine3,
}

impl Instance {
    /// Greatest length of an image of a unit vector under the map or its inverse: rays are followed in the group's space in f32, where
    /// the components of directions must not get near the denormals.
    pub const SCALE_LIMIT: f64 = 1e12;

    /// Puts the group somewhere. The map may reflect, shear and scale unevenly.
    ///
    /// # Errors
    /// If the map has no usable inverse, or moves the group out of range.
    pub fn new(group: Arc<Group>, to_world: DAffine3) -> Result<Self, InstanceError> {
        let to_group = to_world.inverse();
        for map in [&to_world, &to_group] {
            let m = map.matrix3;
            let longest = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
            // Written so that NaN fails, which `max` would drop.
            if !(map.is_finite() && longest <= Self::SCALE_LIMIT) {
                return Err(InstanceError::Singular);
            }
        }
        let this = Self { group, to_world, to_group };
        let bounds = this.bounds();
        let in_range =
            bounds.min.abs().max(bounds.max.abs()).cmplt(Vec3::splat(TriangleMesh::COORDINATE_LIMIT)).all();
        if in_range || bounds.is_empty() { Ok(this) } else { Err(InstanceError::OutOfRange) }
    }

    /// What stands there.
    #[inline]
    pub fn group(&self) -> &Arc<Group> {
        &self.group
    }

    /// The group's space to world space.
    pub fn to_world(&self) -> &DAffine3 {
        &self.to_world
    }

    /// World space to the group's space.
    pub fn to_group(&self) -> &DAffine3 {
        &self.to_group
    }

    /// A ray's origin and direction in the group's space. The direction keeps the length that the map gives it, so that distances along
    /// the ray stay those of the world. Every backend follows this very ray.
    #[inline]
    pub fn ray_to_group(&self, o: Vec3, d: Vec3) -> (Vec3, Vec3) {
        let m = &self.to_group.matrix3;
        // The difference first: it loses nothing, however far from the origin the instance stands.
        let o = m * (o.as_dvec3() - self.to_world.translation);
        (o.as_vec3(), (m * d.as_dvec3()).as_vec3())
    }

    /// World bounds, those of the group's box rounded outwards; empty for a group without primitives.
    pub fn bounds(&self) -> Aabb {
        let Aabb { min, max } = self.group.bounds();
        if self.group.bounds().is_empty() {
            return Aabb::EMPTY;
        }
        let (min, max) = (min.as_dvec3(), max.as_dvec3());
        let center = self.to_world.transform_point3((min + max) * 0.5);
        let half = (max - min) * 0.5;
        let m = &self.to_world.matrix3;
        let reach: DVec3 = m.x_axis.abs() * half.x + m.y_axis.abs() * half.y + m.z_axis.abs() * half.z;
        let down = |x: f64| (x as f32).next_down();
        let up = |x: f64| (x as f32).next_up();
        Aabb {
            min: Vec3::from((center - reach).to_array().map(down)),
            max: Vec3::from((center + reach).to_array().map(up)),
        }
    }
}
