//! Scenes of Mitsuba 0.4 to 0.6 in the words of Mitsuba 3.
//!
//! Names change as Mitsuba's own upgrade changes them (camelCase to underscores, `lookAt`, `uoffset` and the like), and beyond it by the tables here:
//! plugins that are gone but have an equal, and parameters that no longer have an effect.

use glam::{DAffine3, DVec3};

use super::super::{Location, Log};
use super::values::Value;
use super::xml::{Category, Object, Property};

/// `toWorld` becomes `to_world`, `intIOR` `int_ior`: an underscore between a small and a capital letter, and the capitals after it made small.
pub(super) fn underscored(name: &str) -> String {
    let mut out = String::with_capacity(name.len() + 4);
    let mut lowering = false;
    let mut last_is_small = false;
    for c in name.chars() {
        if c.is_ascii_uppercase() && last_is_small {
            out.push('_');
            lowering = true;
        }
        lowering &= c.is_ascii_uppercase();
        last_is_small = c.is_ascii_lowercase();
        out.push(if lowering { c.to_ascii_lowercase() } else { c });
    }
    out
}

/// Plugins of 0.x that another one of Mitsuba 3 stands for.
const PLUGINS: &[(Category, &str, &str)] = &[
    (Category::Film, "ldrfilm", "hdrfilm"),
    (Category::Film, "tiledhdrfilm", "hdrfilm"),
    (Category::Sampler, "sobol", "ldsampler"),
    (Category::Sampler, "halton", "ldsampler"),
    (Category::Sampler, "hammersley", "ldsampler"),
    (Category::Rfilter, "catmullrom", "mitchell"),
];

/// Parameters under another name.
const PARAMETERS: &[(Category, &str, &str, &str)] =
    &[(Category::Bsdf, "diffuse", "diffuse_reflectance", "reflectance")];

/// Values of textual parameters that something simpler stands for: there is no filtering over the size of a pixel, which samples replace.
const VALUES: &[(Category, &str, &str, &str)] = &[
    (Category::Texture, "filter_type", "trilinear", "bilinear"),
    (Category::Texture, "filter_type", "ewa", "bilinear"),
];

/// Parameters that have no effect here, whatever their value, or only if they have the value given.
const WITHOUT_EFFECT: &[(Category, &str, Option<&str>)] = &[
    (Category::Film, "attach_log", None),
    (Category::Film, "banner", None),
    (Category::Film, "exposure", None),
    (Category::Film, "gamma", None),
    (Category::Film, "has_variance", None),
    (Category::Film, "high_quality_edges", None),
    (Category::Film, "key", None),
    (Category::Film, "burn", None),
    (Category::Film, "tonemap_method", None),
    (Category::Sampler, "dimension", None),
    (Category::Sampler, "scramble", None),
    (Category::Texture, "max_anisotropy", None),
    (Category::Texture, "cache", None),
    (Category::Emitter, "cache", None),
    (Category::Emitter, "gamma", None),
    (Category::Bsdf, "ext_eta", Some("1")),
    (Category::Bsdf, "ext_eta", Some("1.0")),
    (Category::Bsdf, "ext_eta", Some("air")),
    (Category::Integrator, "strict_normals", None),
];

/// Makes an object of a 0.x scene, whose names are [`underscored`] already, one of Mitsuba 3.
pub(super) fn object(object: &mut Object, locate: impl Fn(&Property) -> Location, log: &mut Log) {
    let category = object.category;
    if let Some((.., new)) = PLUGINS.iter().find(|(c, old, _)| *c == category && *old == object.plugin) {
        if category == Category::Rfilter {
            // Catmull and Rom's spline is that of Mitchell and Netravali with these parameters.
            for (name, value) in [("B", 0.0), ("C", 0.5)] {
                let (name, value, text) = (name.to_owned(), Value::Float(value), value.to_string());
                object.properties.push(Property { name, value, text, at: object.at });
            }
        }
        (*new).clone_into(&mut object.plugin);
    }
    for property in &mut object.properties {
        let renamed = PARAMETERS
            .iter()
            .find(|(c, plugin, old, _)| *c == category && *plugin == object.plugin && *old == property.name);
        if let Some((.., new)) = renamed {
            (*new).clone_into(&mut property.name);
        }
    }
    for property in &mut object.properties {
        let simpler = VALUES
            .iter()
            .find(|(c, name, old, _)| *c == category && *name == property.name && *old == property.text);
        if let Some((_, name, old, new)) = simpler {
            log.note(locate(property), format!("`{name}` {old} of Mitsuba 0.x becomes {new}"));
            property.value = Value::String((*new).to_owned());
            (*new).clone_into(&mut property.text);
        }
    }
    object.properties.retain(|property| {
        let is_idle = WITHOUT_EFFECT.iter().any(|(c, name, value)| {
            *c == category && *name == property.name && value.is_none_or(|v| v == property.text)
        });
        if is_idle {
            log.note(locate(property), format!("`{}` of Mitsuba 0.x has no effect", property.name));
        }
        !is_idle
    });
    texture_transform(object);
    texture_gamma(object);
}

/// `gamma` of a texture: 1 says that texels are linear; 2.2 is the encoding that 8-bit images have anyway, and -1 left the choice to them.
fn texture_gamma(object: &mut Object) {
    if object.category != Category::Texture {
        return;
    }
    for property in &mut object.properties {
        let number = match property.value {
            Value::Float(x) => x,
            Value::Integer(i) => i as f64,
            _ => continue,
        };
        if property.name == "gamma" && [1.0, 2.2, -1.0].contains(&number) {
            "raw".clone_into(&mut property.name);
            property.value = Value::Boolean(number == 1.0);
            property.text = (number == 1.0).to_string();
        }
    }
}

/// `uoffset`, `voffset`, `uscale` and `vscale` become `to_uv`.
fn texture_transform(object: &mut Object) {
    let (mut offset, mut scale) = (DVec3::ZERO, DVec3::ONE);
    let mut at = None;
    object.properties.retain(|property| {
        let number = match property.value {
            Value::Float(x) => x,
            Value::Integer(i) => i as f64,
            _ => return true,
        };
        match property.name.as_str() {
            "uoffset" => offset.x = number,
            "voffset" => offset.y = number,
            "uscale" => scale.x = number,
            "vscale" => scale.y = number,
            _ => return true,
        }
        at = Some(property.at);
        false
    });
    if let Some(at) = at {
        // As in Mitsuba, first the offset and then the scale.
        let value = Value::Transform(DAffine3::from_scale(scale) * DAffine3::from_translation(offset));
        object.properties.push(Property { name: "to_uv".to_owned(), value, text: String::new(), at });
    }
}

#[cfg(test)]
mod tests {
    use super::underscored;

    #[test]
    fn names_are_those_of_mitsuba_3() {
        for (old, new) in [
            ("toWorld", "to_world"),
            ("intIOR", "int_ior"),
            ("fovAxis", "fov_axis"),
            ("maxDepth", "max_depth"),
            ("diffuseReflectance", "diffuse_reflectance"),
            ("alpha", "alpha"),
            ("alphaU", "alpha_u"),
            ("flipTexCoords", "flip_tex_coords"),
            ("B", "B"),
            ("principalPointOffsetX", "principal_point_offset_x"),
            ("already_fine", "already_fine"),
            ("", ""),
        ] {
            assert_eq!(underscored(old), new);
        }
    }
}
