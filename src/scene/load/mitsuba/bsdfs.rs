//! The `bsdf` plugins.

use super::super::LoadError;
use super::Builder;
use super::properties::{Kind, Parameter, Plugin, Properties};
use super::xml::{Category, ObjectId, Span, one_of};
use crate::scene::{Material, MaterialId, Microfacet, Rgb};

pub(super) type Build = fn(&Properties, &mut Builder) -> Result<Material, LoadError>;

pub(super) const PLUGINS: &[Plugin<Build>] = &[
    Plugin::new(
        "diffuse",
        "Lambertian reflection",
        &[&[Parameter::new("reflectance", Kind::Reflectance, "0.5", "albedo")]],
        |p, _| Ok(Material::Diffuse { reflectance: p.color("reflectance")? }),
    ),
    Plugin::new(
        "twosided",
        "makes one or two one-sided BSDFs visible from both sides",
        &[&[Parameter::object(Category::Bsdf, "the front, and, if there is a second, the back")]],
        two_sided,
    ),
    Plugin::new("conductor", "smooth metal", &[CONDUCTOR], |p, b| {
        let (eta, k) = conductor_ior(p, b)?;
        Ok(Material::Conductor { eta, k, specular_reflectance: p.color("specular_reflectance")? })
    }),
    Plugin::new("roughconductor", "rough metal", &[CONDUCTOR, MICROFACET], |p, b| {
        let (eta, k) = conductor_ior(p, b)?;
        let (distribution, alpha) = microfacet(p, b)?;
        let specular_reflectance = p.color("specular_reflectance")?;
        Ok(Material::RoughConductor { distribution, alpha, eta, k, specular_reflectance })
    }),
    Plugin::new("dielectric", "smooth boundary between dielectrics", &[DIELECTRIC], |p, _| {
        Ok(Material::Dielectric {
            eta: relative_ior(p)?,
            specular_reflectance: p.color("specular_reflectance")?,
            specular_transmittance: p.color("specular_transmittance")?,
        })
    }),
    Plugin::new(
        "roughdielectric",
        "rough boundary between dielectrics",
        &[DIELECTRIC, MICROFACET],
        |p, b| {
            let (distribution, alpha) = microfacet(p, b)?;
            let eta = relative_ior(p)?;
            if eta == 1.0 {
                return Err(p.error(
                    "int_ior",
                    "equal indices of refraction inside and outside",
                    "two that differ",
                ));
            }
            Ok(Material::RoughDielectric {
                distribution,
                alpha,
                eta,
                specular_reflectance: p.color("specular_reflectance")?,
                specular_transmittance: p.color("specular_transmittance")?,
            })
        },
    ),
];

const CONDUCTOR: &[Parameter] = &[
    Parameter::new(
        "material",
        Kind::String,
        "none",
        "only `none`, a perfect mirror; other metals by eta and k",
    ),
    Parameter::new("eta", Kind::Unbounded, "0", "real part of the index of refraction"),
    Parameter::new("k", Kind::Unbounded, "1", "imaginary part of the index of refraction"),
    Parameter::new("specular_reflectance", Kind::Reflectance, "1", "factor on the reflection"),
];

const DIELECTRIC: &[Parameter] = &[
    Parameter::new("int_ior", Kind::FloatOrString, "bk7", "index of refraction inside, or a material's name"),
    Parameter::new(
        "ext_ior",
        Kind::FloatOrString,
        "air",
        "index of refraction outside, or a material's name",
    ),
    Parameter::new("specular_reflectance", Kind::Reflectance, "1", "factor on the reflection"),
    Parameter::new("specular_transmittance", Kind::Reflectance, "1", "factor on the transmission"),
];

const MICROFACET: &[Parameter] = &[
    Parameter::new("distribution", Kind::String, "beckmann", "of microfacet normals: beckmann or ggx"),
    Parameter::new("alpha", Kind::Float, "0.1", "roughness"),
    Parameter::optional("alpha_u", Kind::Float, "roughness along the tangent, with alpha_v"),
    Parameter::optional("alpha_v", Kind::Float, "roughness across the tangent, with alpha_u"),
    Parameter::new("sample_visible", Kind::Boolean, "true", "sample visible normals; only true"),
];

fn two_sided(p: &Properties, builder: &mut Builder) -> Result<Material, LoadError> {
    let mut sides = Vec::new();
    for (object, at) in p.objects(Category::Bsdf) {
        if sides.len() == 2 {
            return Err(p.document.error(at, "a third BSDF in `twosided`", "one or two"));
        }
        sides.push(one_sided(p, object, at, builder)?);
    }
    match sides[..] {
        [both] => Ok(Material::TwoSided { front: both, back: both }),
        [front, back] => Ok(Material::TwoSided { front, back }),
        _ => Err(p.error("", "`twosided` without a BSDF", "one or two")),
    }
}

/// A BSDF without transmission. One that is two-sided already counts with its front, as in Mitsuba.
fn one_sided(
    p: &Properties,
    object: ObjectId,
    at: Span,
    builder: &mut Builder,
) -> Result<MaterialId, LoadError> {
    let id = builder.material(object, at)?;
    match builder.materials[id.0 as usize] {
        Material::TwoSided { front, .. } => Ok(front),
        Material::Dielectric { .. } | Material::RoughDielectric { .. } => {
            Err(p.document.error(at, "a BSDF with transmission in `twosided`", "one that only reflects"))
        }
        _ => Ok(id),
    }
}

fn conductor_ior(p: &Properties, builder: &mut Builder) -> Result<(Rgb, Rgb), LoadError> {
    if p.string("material")? != "none" {
        let error = p.bad_value("material", "`none`, or the metal by eta and k");
        builder.log.unsupported(error, "a perfect mirror is used")?;
    }
    Ok((p.color("eta")?, p.color("k")?))
}

fn microfacet(p: &Properties, builder: &mut Builder) -> Result<(Microfacet, [f32; 2]), LoadError> {
    let distribution =
        p.choice("distribution", &[("beckmann", Microfacet::Beckmann), ("ggx", Microfacet::Ggx)])?;
    if !p.boolean("sample_visible")? {
        let error = p.bad_value("sample_visible", "`true`; it only changes the noise");
        builder.log.unsupported(error, "`true` is used")?;
    }
    p.exclusive("alpha", "alpha_u")?;
    p.exclusive("alpha", "alpha_v")?;
    let names =
        if p.has("alpha_u") || p.has("alpha_v") { ["alpha_u", "alpha_v"] } else { ["alpha", "alpha"] };
    if let Some(missing) = names.iter().find(|n| **n != "alpha" && !p.has(n)) {
        return Err(p.error(
            "",
            format!("one of alpha_u and alpha_v without `{missing}`"),
            "both or neither",
        ));
    }
    Ok((distribution, [roughness(p, names[0])?, roughness(p, names[1])?]))
}

fn roughness(p: &Properties, name: &str) -> Result<f32, LoadError> {
    let alpha = p.positive(name)?;
    if alpha > 1.0 { Err(p.bad_value(name, "a roughness above 0 and at most 1")) } else { Ok(alpha as f32) }
}

/// Index of the inside over that of the outside.
fn relative_ior(p: &Properties) -> Result<f32, LoadError> {
    let ratio = (ior(p, "int_ior")? / ior(p, "ext_ior")?) as f32;
    if ratio > 0.0 && ratio.is_finite() {
        Ok(ratio)
    } else {
        Err(p.bad_value("int_ior", "an index whose ratio to ext_ior is in the range of single precision"))
    }
}

fn ior(p: &Properties, name: &str) -> Result<f64, LoadError> {
    match p.float_or_string(name)? {
        Ok(x) if x > 0.0 => Ok(x),
        Ok(_) => Err(p.bad_value(name, "a number above 0")),
        Err(text) => {
            IOR.iter().find(|(n, _)| *n == text.to_lowercase()).map(|(_, ior)| *ior).ok_or_else(|| {
                let names: Vec<_> = IOR.iter().map(|(n, _)| *n).collect();
                p.bad_value(name, format!("a number, or {}", one_of(&names)))
            })
        }
    }
}

/// Indices of refraction at 589.3 nm, by the names of Mitsuba's documentation.
const IOR: &[(&str, f64)] = &[
    ("vacuum", 1.0),
    ("helium", 1.000_036),
    ("hydrogen", 1.000_132),
    ("air", 1.000_277),
    ("carbon dioxide", 1.000_45),
    ("water", 1.333),
    ("acetone", 1.36),
    ("ethanol", 1.361),
    ("carbon tetrachloride", 1.461),
    ("glycerol", 1.4729),
    ("benzene", 1.501),
    ("silicone oil", 1.520_45),
    ("bromine", 1.661),
    ("water ice", 1.31),
    ("fused quartz", 1.458),
    ("pyrex", 1.47),
    ("acrylic glass", 1.49),
    ("polypropylene", 1.49),
    ("bk7", 1.5046),
    ("sodium chloride", 1.544),
    ("amber", 1.55),
    ("pet", 1.575),
    ("diamond", 2.419),
];
