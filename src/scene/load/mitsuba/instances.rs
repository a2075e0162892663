//! `shapegroup` and `instance`: shapes that stand in several places.
//!
//! Each instance becomes a copy of the group's shapes, moved by its transform. That gives the image that Mitsuba makes, at the price of the
//! memory of the copies, which is bounded.

use std::collections::HashMap;

use glam::DAffine3;

use super::properties::{Description, Kind, Parameter, Properties};
use super::xml::{Category, Document, ObjectId, Span};
use super::{Builder, LoadError};
use crate::scene::{Geometry, Shape};

pub(super) const GROUP: &str = "shapegroup";
pub(super) const INSTANCE: &str = "instance";

pub(super) const DESCRIPTIONS: &[Description] = &[
    Description {
        name: GROUP,
        help: "shapes that are seen through instances only",
        parameters: &[&[Parameter::object(Category::Shape, "any number of shapes that emit nothing")]],
    },
    Description {
        name: INSTANCE,
        help: "a copy of a shape group",
        parameters: &[&[
            Parameter::optional("to_world", Kind::Transform, "the group's space to world space"),
            Parameter::object(Category::Shape, "the shape group, usually by <ref>"),
        ]],
    },
];

/// Primitives of all instances together.
const MAX_PRIMITIVES: u64 = 1 << 25;

/// A shape group that is to be put somewhere.
pub(super) struct Instance {
    name: String,
    group: ObjectId,
    to_world: DAffine3,
    at: Span,
}

impl Builder<'_> {
    /// Plans the shapes of a group, once.
    pub(super) fn group(&mut self, id: ObjectId) -> Result<(), LoadError> {
        if self.groups.iter().any(|(known, _)| *known == id) {
            return Ok(());
        }
        let object = self.document.object(id);
        let properties = Properties::new(self.document, object, DESCRIPTIONS[0], self.log)?;
        let members: Vec<_> = properties.objects(Category::Shape).collect();
        properties.finish()?;
        let mut shapes = Vec::with_capacity(members.len());
        for (member, at) in members {
            let plugin = &self.document.object(member).plugin;
            if [GROUP, INSTANCE].contains(&plugin.as_str()) {
                return self.error(at, format!("shape `{plugin}` in a shape group"), "shapes of their own");
            }
            let Some(shape) = self.planned_shape(member)? else { continue };
            if shape.emission.is_some() {
                return self.error(
                    at,
                    "a shape that emits in a shape group",
                    "lights outside of shape groups",
                );
            }
            shapes.push(shape);
        }
        self.groups.push((id, shapes));
        Ok(())
    }

    pub(super) fn instance(&mut self, id: ObjectId) -> Result<(), LoadError> {
        let object = self.document.object(id);
        let properties = Properties::new(self.document, object, DESCRIPTIONS[1], self.log)?;
        let group = properties.optional_object(Category::Shape)?;
        let group = group.filter(|group| self.document.object(*group).plugin == GROUP);
        let Some(group) = group else {
            return self.error(object.at, "an instance without a shape group", "a <ref> to a `shapegroup`");
        };
        let to_world = properties.transform("to_world");
        properties.finish()?;
        self.group(group)?;
        let name = object.id.clone().unwrap_or_else(|| format!("{INSTANCE}-{}", self.instances.len()));
        self.instances.push(Instance { name, group, to_world, at: object.at });
        Ok(())
    }
}

/// Adds the shapes of all instances.
pub(super) fn expand(
    document: &Document,
    instances: &[Instance],
    groups: &HashMap<ObjectId, Vec<Shape>>,
    shapes: &mut Vec<Shape>,
) -> Result<(), LoadError> {
    let mut primitives = 0_u64;
    for instance in instances {
        for shape in groups.get(&instance.group).into_iter().flatten() {
            primitives += u64::from(shape.geometry.primitive_count());
            if primitives > MAX_PRIMITIVES {
                let found = format!("instances of more than {MAX_PRIMITIVES} primitives in all");
                return Err(document.error(instance.at, found, "fewer: each instance is a copy"));
            }
            let refuse = |found: String, expected: &str| document.error(instance.at, found, expected);
            let geometry = match &shape.geometry {
                Geometry::Mesh(mesh) => mesh
                    .transformed(&instance.to_world)
                    .map(Geometry::Mesh)
                    .map_err(|e| refuse(e.to_string(), "a smaller transform"))?,
                Geometry::Analytic(analytic) => {
                    let moved = analytic.transformed(&instance.to_world).map(Geometry::Analytic);
                    moved.ok_or_else(|| {
                        let found = format!("`to_world` of the instance distorts `{}`", shape.name);
                        refuse(found, "rotation, translation and even scale, or a mesh")
                    })?
                }
            };
            let name = format!("{}.{}", instance.name, shape.name);
            shapes.push(Shape { name, geometry, material: shape.material, emission: None });
        }
    }
    Ok(())
}
