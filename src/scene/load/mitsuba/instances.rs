//! `shapegroup` and `instance`: shapes that stand in several places and are held once.

use std::collections::HashMap;
use std::sync::Arc;

use glam::DAffine3;

use super::plugin::{Description, Kind, Parameter};
use super::properties::Properties;
use super::xml::{Category, Document, ObjectId, Span};
use super::{Builder, LoadError};
use crate::scene::{Geometry, Group, Instance, InstanceError, Shape};

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
        help: "a shape group in one of its places",
        parameters: &[&[
            Parameter::optional("to_world", Kind::Transform, "the group's space to world space"),
            Parameter::object(Category::Shape, "the shape group, usually by <ref>"),
        ]],
    },
];

/// A shape group that is to be put somewhere.
pub(super) struct PlannedInstance {
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
        self.instances.push(PlannedInstance { name, group, to_world, at: object.at });
        Ok(())
    }
}

/// Adds all instances to the shapes. Of groups without surfaces there is nothing to add.
pub(super) fn place(
    document: &Document,
    instances: Vec<PlannedInstance>,
    groups: Vec<(ObjectId, Vec<Shape>)>,
    shapes: &mut Vec<Shape>,
) -> Result<(), LoadError> {
    let refuse =
        |at, e: InstanceError| document.error(at, e.to_string(), "less, or a transform that can be inverted");
    let mut ready = HashMap::new();
    for (id, members) in groups {
        let group = Group::new(members).map_err(|e| refuse(document.object(id).at, e))?;
        ready.insert(id, Arc::new(group));
    }
    for PlannedInstance { name, group, to_world, at } in instances {
        let Some(group) = ready.get(&group).filter(|group| group.primitive_count() > 0) else { continue };
        let material = group.shapes()[0].material;
        let instance = Instance::new(Arc::clone(group), to_world).map_err(|e| refuse(at, e))?;
        shapes.push(Shape { name, geometry: Geometry::Instance(instance), material, emission: None });
    }
    Ok(())
}
