//! How BSDFs of the table come to be where that takes more than a line: checks of what they are made of, indices of refraction, and translations.

use super::super::Builder;
use super::super::conductors::CONDUCTORS;
use super::super::properties::Properties;
use super::super::xml::{Category, ObjectId, Span, one_of};
use crate::scene::load::LoadError;
use crate::scene::{Input, Material, MaterialId, Microfacet, Perturbation, Principled, Rgb};

/// All nested BSDFs.
pub(super) fn bsdfs(p: &Properties, builder: &mut Builder) -> Result<Vec<MaterialId>, LoadError> {
    p.objects(Category::Bsdf).map(|(object, at)| builder.material(object, at)).collect()
}

/// The nested BSDF.
pub(super) fn only_bsdf(p: &Properties, builder: &mut Builder) -> Result<MaterialId, LoadError> {
    match bsdfs(p, builder)?[..] {
        [only] => Ok(only),
        ref parts => Err(p.error("", format!("`{}` of {} BSDFs", p.object.plugin, parts.len()), "one")),
    }
}

pub(super) fn two_sided(p: &Properties, builder: &mut Builder) -> Result<Material, LoadError> {
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
    match &builder.materials[id.0 as usize] {
        Material::TwoSided { front, .. } => Ok(*front),
        material if material.transmits(&builder.materials) => {
            Err(p.document.error(at, "a BSDF with transmission in `twosided`", "one that only reflects"))
        }
        _ => Ok(id),
    }
}

pub(super) fn conductor_ior(
    p: &Properties,
    builder: &mut Builder,
) -> Result<(Input<Rgb>, Input<Rgb>), LoadError> {
    let name = p.string("material")?;
    if name == "none" {
        return Ok((builder.color_input(p, "eta")?, builder.color_input(p, "k")?));
    }
    p.exclusive("material", "eta")?;
    p.exclusive("material", "k")?;
    if let Some(&(_, eta, k)) = CONDUCTORS.iter().find(|(n, ..)| *n == name) {
        return Ok((Rgb::from(eta).into(), Rgb::from(k).into()));
    }
    let names: Vec<_> = ["none"].into_iter().chain(CONDUCTORS.iter().map(|(n, ..)| *n)).collect();
    let error = p.bad_value("material", format!("{}; or the metal by eta and k", one_of(&names)));
    builder.log.unsupported(error, "a perfect mirror is used")?;
    Ok((Rgb::ZERO.into(), Rgb::ONE.into()))
}

pub(super) fn distribution(p: &Properties, builder: &mut Builder) -> Result<Microfacet, LoadError> {
    if !p.boolean("sample_visible")? {
        let error = p.bad_value("sample_visible", "`true`; it only changes the noise");
        builder.log.unsupported(error, "`true` is used")?;
    }
    p.choice("distribution", &[("beckmann", Microfacet::Beckmann), ("ggx", Microfacet::Ggx)])
}

pub(super) fn alphas(p: &Properties, builder: &mut Builder) -> Result<[Input<f32>; 2], LoadError> {
    let given = |name| Ok::<_, LoadError>(p.has(name) || p.texture(name)?.is_some());
    let [both, u, v] = [given("alpha")?, given("alpha_u")?, given("alpha_v")?];
    let names = match (both, u, v) {
        (_, false, false) => ["alpha", "alpha"],
        (false, true, true) => ["alpha_u", "alpha_v"],
        (true, ..) => return Err(p.error("alpha", "both `alpha` and alpha_u or alpha_v", "one of them")),
        (false, true, false) | (false, false, true) => {
            let missing = if u { "alpha_v" } else { "alpha_u" };
            let found = format!("one of alpha_u and alpha_v without `{missing}`");
            return Err(p.error("", found, "both or neither"));
        }
    };
    let mut alpha = |name| match p.texture(name)? {
        Some(_) => builder.float_input(p, name),
        None => roughness(p, name).map(Input::Constant),
    };
    Ok([alpha(names[0])?, alpha(names[1])?])
}

pub(super) fn roughness(p: &Properties, name: &str) -> Result<f32, LoadError> {
    let alpha = p.positive(name)?;
    if alpha > 1.0 { Err(p.bad_value(name, "a roughness above 0 and at most 1")) } else { Ok(alpha as f32) }
}

pub(super) fn plastic(
    p: &Properties,
    builder: &mut Builder,
    roughness: Option<(Microfacet, f32)>,
) -> Result<Material, LoadError> {
    Ok(Material::Plastic {
        roughness,
        eta: differing_ior(p)?,
        diffuse_reflectance: builder.color_input(p, "diffuse_reflectance")?,
        specular_reflectance: builder.color_input(p, "specular_reflectance")?,
        nonlinear: p.boolean("nonlinear")?,
    })
}

pub(super) fn principled(p: &Properties, builder: &mut Builder) -> Result<Material, LoadError> {
    p.exclusive("eta", "specular")?;
    let eta = match p.optional_float("eta") {
        Some(eta) if eta > 0.0 && (eta as f32).is_finite() => eta,
        Some(_) => return Err(p.bad_value("eta", "a number above 0")),
        // The index whose reflectance at normal incidence is 0.08 times the parameter.
        None => 2.0 / (1.0 - (0.08 * fraction(p, "specular", p.float("specular")?)?).sqrt()) - 1.0,
    };
    for name in
        ["main_specular_sampling_rate", "clearcoat_sampling_rate", "diffuse_reflectance_sampling_rate"]
    {
        p.ignore(name);
    }
    let mut input = |name| {
        let input = builder.float_input(p, name)?;
        if let Input::Constant(x) = input {
            fraction(p, name, f64::from(x))?;
        }
        Ok::<_, LoadError>(input)
    };
    Ok(Material::Principled(Box::new(Principled {
        roughness: input("roughness")?,
        anisotropic: input("anisotropic")?,
        metallic: input("metallic")?,
        spec_trans: input("spec_trans")?,
        spec_tint: input("spec_tint")?,
        sheen: input("sheen")?,
        sheen_tint: input("sheen_tint")?,
        flatness: input("flatness")?,
        clearcoat: input("clearcoat")?,
        clearcoat_gloss: input("clearcoat_gloss")?,
        base_color: builder.color_input(p, "base_color")?,
        eta: eta as f32,
    })))
}

fn fraction(p: &Properties, name: &str, x: f64) -> Result<f64, LoadError> {
    if (0.0..=1.0).contains(&x) { Ok(x) } else { Err(p.bad_value(name, "a number from 0 to 1")) }
}

/// A bump or normal map around a BSDF.
pub(super) fn perturbed(
    p: &Properties,
    builder: &mut Builder,
    by: Perturbation,
) -> Result<Material, LoadError> {
    let material = only_bsdf(p, builder)?;
    if is_perturbed(material, &builder.materials) {
        let found = format!("`{}` around another bump or normal map", p.object.plugin);
        return Err(p.error("", found, "a BSDF whose normal is not perturbed"));
    }
    let (flip_invalid_normals, use_shadowing_function) =
        (p.boolean("flip_invalid_normals")?, p.boolean("use_shadowing_function")?);
    Ok(Material::Perturbed { by, flip_invalid_normals, use_shadowing_function, material })
}

fn is_perturbed(id: MaterialId, materials: &[Material]) -> bool {
    match materials[id.0 as usize] {
        Material::Perturbed { .. } => true,
        Material::Mask { material, .. } => is_perturbed(material, materials),
        Material::TwoSided { front: a, back: b } | Material::Blend { first: a, second: b, .. } => {
            is_perturbed(a, materials) || is_perturbed(b, materials)
        }
        _ => false,
    }
}

/// Diffuse and glossy parts side by side, such that each has its albedo.
pub(super) fn phong(p: &Properties, builder: &mut Builder) -> Result<Material, LoadError> {
    if p.texture("specular_reflectance")?.is_some() {
        return Err(p.error(
            "specular_reflectance",
            "a textured `specular_reflectance` of `phong`",
            "a colour",
        ));
    }
    let exponent = p.float("exponent")?;
    if !(0.0..1e8).contains(&exponent) {
        return Err(p.bad_value("exponent", "a number from 0 to 1e8"));
    }
    let (diffuse, specular) =
        (builder.color_input(p, "diffuse_reflectance")?, p.color("specular_reflectance")?);
    let weight = specular.max_element().min(0.999);
    let scale = 1.0 / (1.0 - weight);
    let reflectance = match diffuse {
        Input::Constant(color) => Input::Constant((color * scale).min(Rgb::ONE)),
        Input::Texture(texture) => {
            let scaled = crate::scene::Texture::Scale { texture, factor: Rgb::splat(scale) };
            builder.textures.push(scaled);
            Input::Texture(crate::scene::TextureId(builder.textures.len() as u32 - 1))
        }
    };
    let first = builder.push_material(Material::Diffuse { reflectance }, p.object.at)?;
    if weight == 0.0 {
        return Ok(Material::Diffuse { reflectance });
    }
    let glossy = Material::RoughConductor {
        distribution: Microfacet::Ggx,
        alpha: [Input::Constant((2.0 / (exponent + 2.0)).sqrt() as f32); 2],
        eta: Rgb::ZERO.into(),
        k: Rgb::ONE.into(),
        specular_reflectance: (specular / weight).min(Rgb::ONE).into(),
    };
    let second = builder.push_material(glossy, p.object.at)?;
    Ok(Material::Blend { weight: weight.into(), first, second })
}

/// `sum w_i f_i` as blends of what came before with the next; black for what the weights lack of 1.
pub(super) fn mixture(p: &Properties, builder: &mut Builder) -> Result<Material, LoadError> {
    let text = p.string("weights")?;
    let words = text.split(|c: char| c == ',' || c.is_whitespace()).filter(|w| !w.is_empty());
    let weights: Option<Vec<f32>> =
        words.map(|w| w.parse().ok().filter(|x| (0.0..=1.0).contains(x))).collect();
    let parts = bsdfs(p, builder)?;
    let weights = weights
        .filter(|w| w.len() == parts.len() && !w.is_empty() && w.iter().sum::<f32>() <= 1.0 + 1e-4)
        .ok_or_else(|| p.bad_value("weights", format!("{} numbers that add up to 1 or less", parts.len())))?;
    let mut mixed = crate::scene::load::BLACK;
    let mut total = (1.0 - weights.iter().sum::<f32>()).max(0.0);
    for (&second, &weight) in parts.iter().zip(&weights) {
        total += weight;
        let first = builder.push_material(mixed, p.object.at)?;
        // A new id after that of `second`: materials refer to earlier ones only.
        mixed = Material::Blend {
            weight: (if total > 0.0 { weight / total } else { 0.0 }).into(),
            first,
            second,
        };
    }
    Ok(mixed)
}

/// An index of refraction other than 1.
pub(super) fn differing_ior(p: &Properties) -> Result<f32, LoadError> {
    let eta = relative_ior(p)?;
    if eta == 1.0 {
        return Err(p.error("int_ior", "equal indices of refraction inside and outside", "two that differ"));
    }
    Ok(eta)
}

/// Index of the inside over that of the outside.
pub(super) fn relative_ior(p: &Properties) -> Result<f32, LoadError> {
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
