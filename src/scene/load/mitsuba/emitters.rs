//! The `emitter` plugins.

use glam::Vec3;

use super::super::LoadError;
use super::properties::{Kind, Parameter, Plugin, Properties};
use crate::scene::{Emitter, Rgb, TriangleMesh};

pub(super) type Build = fn(&Properties) -> Result<Light, LoadError>;

/// A light on its own, or the emission of the shape that it is part of.
pub(super) enum Light {
    Area { radiance: Rgb },
    Free(Emitter),
}

pub(super) const PLUGINS: &[Plugin<Build>] = &[
    Plugin::new(
        "area",
        "makes the shape around it emit",
        &[&[Parameter::new("radiance", Kind::Emission, "1", "emitted radiance")]],
        |p| Ok(Light::Area { radiance: p.color("radiance")? }),
    ),
    Plugin::new(
        "point",
        "emits the same in all directions from a point",
        &[&[
            Parameter::new("intensity", Kind::Emission, "1", "radiant intensity"),
            Parameter::optional("position", Kind::Vector, "by default the origin"),
            Parameter::optional("to_world", Kind::Transform, "takes the origin to the position"),
        ]],
        point,
    ),
    Plugin::new(
        "constant",
        "the same radiance from everywhere around",
        &[&[Parameter::new("radiance", Kind::Emission, "1", "radiance of the environment")]],
        |p| Ok(Light::Free(Emitter::Constant { radiance: p.color("radiance")? })),
    ),
];

fn point(p: &Properties) -> Result<Light, LoadError> {
    p.exclusive("position", "to_world")?;
    let position = p.optional_vector("position").unwrap_or(p.transform("to_world").translation).as_vec3();
    if !position.abs().cmplt(Vec3::splat(TriangleMesh::COORDINATE_LIMIT)).all() {
        let expected = format!("coordinates below {:e}", TriangleMesh::COORDINATE_LIMIT);
        return Err(p.error("position", format!("a point light at {position}"), expected));
    }
    Ok(Light::Free(Emitter::Point { position, intensity: p.color("intensity")? }))
}
