//! The `bsdf` plugins: the table. What it takes more than a line to build is in `build`.

mod build;

use super::super::LoadError;
use super::Builder;
use super::plugin::{Kind, Parameter, Plugin};
use super::properties::Properties;
use super::xml::Category;
use crate::scene::{Material, Perturbation};
use build::{
    alphas, bsdfs, conductor_ior, differing_ior, distribution, mixture, only_bsdf, perturbed, phong, plastic,
    principled, relative_ior, roughness, two_sided,
};

pub(super) type Build = fn(&Properties, &mut Builder) -> Result<Material, LoadError>;

pub(super) const PLUGINS: &[Plugin<Build>] = &[
    Plugin::new(
        "diffuse",
        "Lambertian reflection",
        &[&[Parameter::new("reflectance", Kind::Reflectance, "0.5", "albedo")]],
        |p, b| Ok(Material::Diffuse { reflectance: b.color_input(p, "reflectance")? }),
    ),
    Plugin::new(
        "twosided",
        "makes one or two one-sided BSDFs visible from both sides",
        &[&[Parameter::object(Category::Bsdf, "the front, and, if there is a second, the back")]],
        two_sided,
    ),
    Plugin::new("conductor", "smooth metal", &[CONDUCTOR], |p, b| {
        let (eta, k) = conductor_ior(p, b)?;
        Ok(Material::Conductor { eta, k, specular_reflectance: b.color_input(p, "specular_reflectance")? })
    }),
    Plugin::new("roughconductor", "rough metal", &[CONDUCTOR, DISTRIBUTION, ALPHAS], |p, b| {
        let (eta, k) = conductor_ior(p, b)?;
        let (distribution, alpha) = (distribution(p, b)?, alphas(p, b)?);
        let specular_reflectance = b.color_input(p, "specular_reflectance")?;
        Ok(Material::RoughConductor { distribution, alpha, eta, k, specular_reflectance })
    }),
    Plugin::new("dielectric", "smooth boundary between dielectrics", &[DIELECTRIC, SPECULAR], |p, b| {
        Ok(Material::Dielectric {
            eta: relative_ior(p)?,
            specular_reflectance: b.color_input(p, "specular_reflectance")?,
            specular_transmittance: b.color_input(p, "specular_transmittance")?,
        })
    }),
    Plugin::new(
        "roughdielectric",
        "rough boundary between dielectrics",
        &[DIELECTRIC, SPECULAR, DISTRIBUTION, ALPHAS],
        |p, b| {
            Ok(Material::RoughDielectric {
                distribution: distribution(p, b)?,
                alpha: alphas(p, b)?,
                eta: differing_ior(p)?,
                specular_reflectance: b.color_input(p, "specular_reflectance")?,
                specular_transmittance: b.color_input(p, "specular_transmittance")?,
            })
        },
    ),
    Plugin::new(
        "thindielectric",
        "sheet of a dielectric, such as a pane",
        &[DIELECTRIC, SPECULAR],
        |p, b| {
            Ok(Material::ThinDielectric {
                eta: relative_ior(p)?,
                specular_reflectance: b.color_input(p, "specular_reflectance")?,
                specular_transmittance: b.color_input(p, "specular_transmittance")?,
            })
        },
    ),
    Plugin::new("plastic", "diffuse base under a smooth coat", &[PLASTIC], |p, b| plastic(p, b, None)),
    Plugin::new(
        "roughplastic",
        "diffuse base under a rough coat",
        &[PLASTIC, DISTRIBUTION, ALPHA],
        |p, b| {
            let roughness = (distribution(p, b)?, roughness(p, "alpha")?);
            plastic(p, b, Some(roughness))
        },
    ),
    Plugin::new("principled", "Disney's model", &[PRINCIPLED], principled),
    Plugin::new("null", "nothing: light passes", &[], |_, _| Ok(Material::Null)),
    Plugin::new(
        "mask",
        "a BSDF with holes",
        &[&[
            Parameter::new("opacity", Kind::Reflectance, "0.5", "fraction that is there"),
            Parameter::object(Category::Bsdf, "what is there"),
        ]],
        |p, b| Ok(Material::Mask { opacity: b.fraction_input(p, "opacity")?, material: only_bsdf(p, b)? }),
    ),
    Plugin::new(
        "blendbsdf",
        "two BSDFs, mixed",
        &[&[
            Parameter::required("weight", Kind::Reflectance, "fraction of the second"),
            Parameter::object(Category::Bsdf, "the first and the second"),
        ]],
        |p, b| {
            let parts = bsdfs(p, b)?;
            let [first, second] = parts[..] else {
                return Err(p.error("", format!("`blendbsdf` of {} BSDFs", parts.len()), "two"));
            };
            Ok(Material::Blend { weight: b.fraction_input(p, "weight")?, first, second })
        },
    ),
    Plugin::new(
        "bumpmap",
        "a BSDF with its normal perturbed by heights",
        &[
            &[
                Parameter::object(Category::Texture, "the heights, in world units; set `raw`"),
                Parameter::new("scale", Kind::Float, "1", "factor on the heights"),
            ],
            PERTURBED,
        ],
        |p, b| {
            let Some(texture) = p.optional_object(Category::Texture)? else {
                return Err(p.error("", "`bumpmap` without a texture", "one"));
            };
            let texture = b.texture(texture, p.object.at)?;
            perturbed(p, b, Perturbation::Bump { texture, scale: p.float("scale")? as f32 })
        },
    ),
    Plugin::new(
        "normalmap",
        "a BSDF with its normal replaced",
        &[
            &[Parameter::required(
                "normalmap",
                Kind::Unbounded,
                "normals in the local frame, each coordinate from -1..1 to 0..1; set `raw`",
            )],
            PERTURBED,
        ],
        |p, b| {
            let normals = b.color_input(p, "normalmap")?;
            perturbed(p, b, Perturbation::Normal(normals))
        },
    ),
    Plugin::new(
        "phong",
        "Mitsuba 0.6; becomes a blend of diffuse and of rough metal with GGX roughness sqrt(2 / (exponent + 2))",
        &[&[
            Parameter::new("diffuse_reflectance", Kind::Reflectance, "0.5", "albedo of the diffuse part"),
            Parameter::new(
                "specular_reflectance",
                Kind::Reflectance,
                "0.2",
                "albedo of the glossy part; no texture",
            ),
            Parameter::new("exponent", Kind::Float, "30", "of the cosine of the glossy part"),
        ]],
        phong,
    ),
    Plugin::new(
        "mixturebsdf",
        "Mitsuba 0.6; becomes a chain of blends",
        &[&[
            Parameter::required("weights", Kind::String, "one per BSDF, adding up to 1 or less"),
            Parameter::object(Category::Bsdf, "what is mixed"),
        ]],
        mixture,
    ),
];

const CONDUCTOR: &[Parameter] = &[
    Parameter::new(
        "material",
        Kind::String,
        "none",
        "a metal by name (Au, Cu, Al, ...); `none` is a perfect mirror",
    ),
    Parameter::new("eta", Kind::Unbounded, "0", "real part of the index of refraction"),
    Parameter::new("k", Kind::Unbounded, "1", "imaginary part of the index of refraction"),
    Parameter::new("specular_reflectance", Kind::Reflectance, "1", "factor on the reflection"),
];

const DIELECTRIC: &[Parameter] = &[
    Parameter::new("int_ior", Kind::FloatOrString, "bk7", "index of refraction inside, or a material's name"),
    EXT_IOR,
];

const EXT_IOR: Parameter = Parameter::new(
    "ext_ior",
    Kind::FloatOrString,
    "air",
    "index of refraction outside, or a material's name",
);

const SPECULAR: &[Parameter] = &[
    Parameter::new("specular_reflectance", Kind::Reflectance, "1", "factor on the reflection"),
    Parameter::new("specular_transmittance", Kind::Reflectance, "1", "factor on the transmission"),
];

const PLASTIC: &[Parameter] = &[
    Parameter::new("diffuse_reflectance", Kind::Reflectance, "0.5", "albedo of the base"),
    Parameter::new("specular_reflectance", Kind::Reflectance, "1", "factor on the coat's reflection"),
    Parameter::new(
        "int_ior",
        Kind::FloatOrString,
        "polypropylene",
        "index of refraction of the coat, or a material's name",
    ),
    EXT_IOR,
    Parameter::new("nonlinear", Kind::Boolean, "false", "the base's colour saturates by inner reflections"),
];

const DISTRIBUTION: &[Parameter] = &[
    Parameter::new("distribution", Kind::String, "beckmann", "of microfacet normals: beckmann or ggx"),
    Parameter::new("sample_visible", Kind::Boolean, "true", "sample visible normals; only true"),
];

const ALPHA: &[Parameter] = &[Parameter::new("alpha", Kind::Float, "0.1", "roughness")];

const ALPHAS: &[Parameter] = &[
    Parameter::new("alpha", Kind::FloatOrTexture, "0.1", "roughness"),
    Parameter::optional("alpha_u", Kind::FloatOrTexture, "roughness along the tangent, with alpha_v"),
    Parameter::optional("alpha_v", Kind::FloatOrTexture, "roughness across the tangent, with alpha_u"),
];

const PRINCIPLED: &[Parameter] = &[
    Parameter::new("base_color", Kind::Reflectance, "0.5", "colour of the base"),
    Parameter::new("roughness", Kind::FloatOrTexture, "0.5", "square root of the main lobe's roughness"),
    Parameter::new(
        "anisotropic",
        Kind::FloatOrTexture,
        "0",
        "how much rougher along than across the tangent",
    ),
    Parameter::new("metallic", Kind::FloatOrTexture, "0", "from dielectric to metal"),
    Parameter::new("spec_trans", Kind::FloatOrTexture, "0", "from opaque to transparent"),
    Parameter::optional("eta", Kind::Float, "index of refraction inside over outside, instead of specular"),
    Parameter::new(
        "specular",
        Kind::Float,
        "0.5",
        "reflection at normal incidence, as an index of refraction",
    ),
    Parameter::new(
        "spec_tint",
        Kind::FloatOrTexture,
        "0",
        "tint of the dielectric reflection by the base colour",
    ),
    Parameter::new("sheen", Kind::FloatOrTexture, "0", "reflection at grazing angles as of cloth"),
    Parameter::new("sheen_tint", Kind::FloatOrTexture, "0", "tint of the sheen by the base colour"),
    Parameter::new(
        "flatness",
        Kind::FloatOrTexture,
        "0",
        "from diffuse to an imitation of subsurface scattering",
    ),
    Parameter::new("clearcoat", Kind::FloatOrTexture, "0", "amount of a second, white lobe"),
    Parameter::new("clearcoat_gloss", Kind::FloatOrTexture, "0", "its smoothness"),
    Parameter::new(
        "main_specular_sampling_rate",
        Kind::Float,
        "1",
        "no effect: it would only change the noise",
    ),
    Parameter::new("clearcoat_sampling_rate", Kind::Float, "1", "no effect: it would only change the noise"),
    Parameter::new(
        "diffuse_reflectance_sampling_rate",
        Kind::Float,
        "1",
        "no effect: it would only change the noise",
    ),
];

const PERTURBED: &[Parameter] = &[
    Parameter::new(
        "flip_invalid_normals",
        Kind::Boolean,
        "true",
        "mirror normals that turn away from the viewer (Schuessler et al. 2017)",
    ),
    Parameter::new(
        "use_shadowing_function",
        Kind::Boolean,
        "true",
        "darken towards the terminator (Estevez et al. 2019)",
    ),
    Parameter::object(Category::Bsdf, "what the surface is made of"),
];
