//! The `emitter` plugins.

use std::sync::Arc;

use glam::{DVec3, Vec3};

use super::super::LoadError;
use super::super::image::{self, Content};
use super::Builder;
use super::plugin::{Kind, Parameter, Plugin};
use super::properties::Properties;
use super::sensors::is_similarity;
use crate::scene::{Emitter, EnvironmentMap, Input, Rgb, Spot, TriangleMesh};

pub(super) type Build = fn(&Properties, &mut Builder) -> Result<Light, LoadError>;

/// A light on its own, or the emission of the shape that it is part of.
pub(super) enum Light {
    Area { radiance: Input<Rgb> },
    Free(Emitter),
}

pub(super) const PLUGINS: &[Plugin<Build>] = &[
    Plugin::new(
        "area",
        "makes the shape around it emit",
        &[&[Parameter::new("radiance", Kind::TexturedEmission, "1", "emitted radiance")], SAMPLING],
        |p, b| Ok(Light::Area { radiance: b.color_input(p, "radiance")? }),
    ),
    Plugin::new(
        "point",
        "emits the same in all directions from a point",
        &[
            &[
                Parameter::new("intensity", Kind::Emission, "1", "radiant intensity"),
                Parameter::optional("position", Kind::Vector, "by default the origin"),
                Parameter::optional("to_world", Kind::Transform, "takes the origin to the position"),
            ],
            SAMPLING,
        ],
        point,
    ),
    Plugin::new(
        "constant",
        "the same radiance from everywhere around",
        &[&[Parameter::new("radiance", Kind::Emission, "1", "radiance of the environment")], SAMPLING],
        |p, _| Ok(Light::Free(Emitter::Constant { radiance: p.color("radiance")? })),
    ),
    Plugin::new(
        "spot",
        "a point that emits into a cone around +z of its space",
        &[
            &[
                Parameter::new("intensity", Kind::Emission, "1", "radiant intensity within the beam"),
                Parameter::new(
                    "cutoff_angle",
                    Kind::Float,
                    "20",
                    "degrees from the axis to where there is no light",
                ),
                Parameter::optional(
                    "beam_width",
                    Kind::Float,
                    "degrees from the axis to where the light begins to fall off, by default 3/4 of cutoff_angle",
                ),
                Parameter::optional("to_world", Kind::Transform, "the light's space to world space"),
            ],
            SAMPLING,
        ],
        spot,
    ),
    Plugin::new(
        "directional",
        "parallel light from infinitely far away, along +z of its space",
        &[
            &[
                Parameter::new("irradiance", Kind::Emission, "1", "on a surface that faces the light"),
                Parameter::optional("direction", Kind::Vector, "in which the light travels"),
                Parameter::optional("to_world", Kind::Transform, "turns +z to the direction"),
            ],
            SAMPLING,
        ],
        directional,
    ),
    Plugin::new(
        "envmap",
        "radiance by direction from an image of latitude and longitude",
        &[
            &[
                Parameter::required("filename", Kind::String, "beside the scene, or in a <path>"),
                Parameter::new("scale", Kind::Float, "1", "factor on the image's radiance"),
                Parameter::optional("to_world", Kind::Transform, "the image's space (+y up) to world space"),
                Parameter::new("mis_compensation", Kind::Boolean, "false", "without effect"),
                Parameter::optional(
                    "sampling_columns",
                    Kind::Integer,
                    "ours: columns of the map by whose luminance light is sampled, by default all",
                ),
            ],
            SAMPLING,
        ],
        envmap,
    ),
];

/// Chooses among lights for Mitsuba; here power does.
const SAMPLING: &[Parameter] = &[Parameter::optional("sampling_weight", Kind::Float, "without effect")];

fn point(p: &Properties, _: &mut Builder) -> Result<Light, LoadError> {
    p.exclusive("position", "to_world")?;
    let position = position(p, p.optional_vector("position").unwrap_or(p.transform("to_world").translation))?;
    Ok(Light::Free(Emitter::Point { position, intensity: p.color("intensity")? }))
}

/// A position within what ray queries accept.
fn position(p: &Properties, position: DVec3) -> Result<Vec3, LoadError> {
    let position = position.as_vec3();
    if position.abs().cmplt(Vec3::splat(TriangleMesh::COORDINATE_LIMIT)).all() {
        return Ok(position);
    }
    let name = if p.has("position") { "position" } else { "to_world" };
    let expected = format!("coordinates below {:e}", TriangleMesh::COORDINATE_LIMIT);
    Err(p.error(name, format!("a {} light at {position}", p.object.plugin), expected))
}

fn spot(p: &Properties, _: &mut Builder) -> Result<Light, LoadError> {
    let to_world = p.transform("to_world");
    if !is_similarity(&to_world) {
        let found = "`to_world` of the spot light shears or scales unevenly";
        return Err(p.error("to_world", found, "rotation, translation and even scale"));
    }
    let cutoff = p.positive("cutoff_angle")?;
    let beam_width = p.optional_float("beam_width").unwrap_or(0.75 * cutoff);
    if cutoff > 180.0 {
        return Err(p.bad_value("cutoff_angle", "an angle above 0 and at most 180 degrees"));
    }
    if !(0.0..=cutoff).contains(&beam_width) {
        return Err(p.bad_value("beam_width", "an angle from 0 to cutoff_angle"));
    }
    Ok(Light::Free(Emitter::Spot(Spot {
        position: position(p, to_world.translation)?,
        axis: to_world.matrix3.z_axis.normalize().as_vec3(),
        intensity: p.color("intensity")?,
        cutoff: cutoff.to_radians(),
        beam_width: beam_width.to_radians(),
    })))
}

fn directional(p: &Properties, _: &mut Builder) -> Result<Light, LoadError> {
    p.exclusive("direction", "to_world")?;
    let direction = p.optional_vector("direction").unwrap_or(p.transform("to_world").matrix3.z_axis);
    let Some(direction) = direction.try_normalize() else {
        let name = if p.has("direction") { "direction" } else { "to_world" };
        return Err(p.error(name, "a directional light without direction", "a vector other than zero"));
    };
    let irradiance = p.color("irradiance")?;
    Ok(Light::Free(Emitter::Directional { direction: direction.as_vec3(), irradiance }))
}

fn envmap(p: &Properties, builder: &mut Builder) -> Result<Light, LoadError> {
    let path = p.document.resolve_path(p.string("filename")?, p.object.at);
    let to_world = p.transform("to_world");
    if !is_similarity(&to_world) {
        let found = "`to_world` of the environment shears or scales unevenly";
        return Err(p.error("to_world", found, "a rotation, perhaps with a reflection"));
    }
    let scale = p.float("scale")?;
    if !(scale >= 0.0 && (scale as f32).is_finite()) {
        return Err(p.bad_value("scale", "a number of 0 or more"));
    }
    p.boolean("mis_compensation")?;
    let image = Arc::new(image::read(&path, Some(&p.locate("filename")), Content::Color, builder.log)?);
    let size = image.size();
    let map = EnvironmentMap::new(image, scale as f32, to_world.matrix3).ok_or_else(|| {
        let found = format!("an environment of {} x {} texels, scaled by {scale}", size.x, size.y);
        p.error("filename", found, "at least 2 x 3 texels, and radiance within single precision")
    })?;
    if !p.has("sampling_columns") {
        return Ok(Light::Free(Emitter::Map(map)));
    }
    let expected = "a whole number from 2 on";
    match p.integer("sampling_columns", expected)? {
        0 | 1 => Err(p.bad_value("sampling_columns", expected)),
        columns => Ok(Light::Free(Emitter::Map(map.with_sampling_columns(columns)))),
    }
}
