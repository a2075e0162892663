//! MTL material libraries of OBJ files, and what becomes of their materials.
//!
//! MTL describes looks for a fixed-function pipeline, not physical materials, so the translation is a choice:
//! 1. `Ke` above 0: an area light of that radiance, whatever the surface reflects.
//! 2. `d` below 1 (or `Tr` above 0) with an `Ni` other than 1: a smooth dielectric of that index.
//! 3. Else `Ks` above 0 with `Kd` 0: a metal that reflects `Ks`; smooth if `illum` is 3 or 5 (the ray-traced models) or
//!    `Ns` is 1000, the format's highest; else GGX with alpha = sqrt(2 / (Ns + 2)) (Walter et al. 2007, section 5.2).
//! 4. Else: diffuse with `Kd`; `Ks` is not used.
//!
//! Reflecting materials are two-sided. Textures are not read.

use std::fmt::Write;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use glam::Vec3;

use super::{Location, Log, push, push_two_sided};
use crate::scene::{Material, MaterialId, Microfacet, Rgb};

/// The library or libraries that a `mtllib` line names. What is missing or malformed is a warning.
pub(super) fn load(obj: &Path, names: &Path, log: &mut Log) -> tobj::MTLLoadResult {
    let mut text = String::new();
    for path in find(obj, &names.to_string_lossy()) {
        match log.read(&path, None) {
            Ok(bytes) => sound_lines(&path, &String::from_utf8_lossy(&bytes), &mut text, log),
            Err(e) => log.warn(
                Location::file(obj),
                format!(
                    "material library {}; its materials become grey",
                    e.to_string().trim_end_matches("; expected a readable file")
                ),
            ),
        }
    }
    tobj::load_mtl_buf(&mut Cursor::new(text))
}

/// The paths of `mtllib`'s argument: one file, possibly with spaces in its name, or several.
fn find(obj: &Path, names: &str) -> Vec<PathBuf> {
    let beside = |name: &str| obj.with_file_name("").join(name.replace('\\', "/"));
    let whole = beside(names);
    if whole.is_file() { vec![whole] } else { names.split_whitespace().map(beside).collect() }
}

/// Copies the lines that `tobj` can read. It gives up the whole library for one malformed line, and panics for a colour
/// with less than three numbers.
fn sound_lines(path: &Path, text: &str, sound: &mut String, log: &mut Log) {
    for (index, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let mut words = line.split_whitespace();
        let Some(keyword) = words.next() else { continue };
        let rest = line.trim()[keyword.len()..].trim();
        let numbers: Option<Vec<f32>> =
            words.map(|w| w.parse().ok().filter(|x: &f32| x.is_finite())).collect();
        let numbers = numbers.unwrap_or_default();
        let accepted = match keyword {
            "newmtl" => !rest.is_empty(),
            "Ka" | "Kd" | "Ks" | "Ke" => numbers.len() == 1 || numbers.len() >= 3,
            "Ns" | "Ni" | "d" | "Tr" => !numbers.is_empty(),
            "illum" => rest.split_whitespace().next().is_some_and(|w| w.parse::<u8>().is_ok()),
            _ => !rest.is_empty() || !(keyword.starts_with("map_") || keyword == "bump"),
        };
        if !accepted {
            log.warn(Location::line(path, index + 1), format!("malformed `{keyword}` is ignored"));
        } else if let ([grey], "Ka" | "Kd" | "Ks" | "Ke") = (&numbers[..], keyword) {
            // "Kd r" means r = g = b.
            let _ = writeln!(sound, "{keyword} {grey} {grey} {grey}");
        } else {
            let _ = writeln!(sound, "{keyword} {rest}");
        }
    }
}

/// The material and the emission that stand for an MTL material.
pub(super) fn translate(
    material: &tobj::Material,
    obj: &Path,
    materials: &mut Vec<Material>,
    log: &mut Log,
) -> (MaterialId, Option<Rgb>) {
    let name = &material.name;
    let mut warn = |message: &str| log.warn(Location::file(obj), format!("material `{name}`: {message}"));
    if has_texture(material) {
        warn("textures (map_*, bump) are not read yet; its colours are used alone");
    }
    let albedo = |c: Option<[f32; 3]>| c.map(|c| Vec3::from(c).clamp(Vec3::ZERO, Vec3::ONE));
    let diffuse = albedo(material.diffuse);
    let specular = albedo(material.specular).unwrap_or(Vec3::ZERO);
    let emission = material.emissive.map(|c| Vec3::from(c).max(Vec3::ZERO)).filter(|c| *c != Vec3::ZERO);
    let transparency = material.unknown_param.get("Tr").and_then(|t| t.parse::<f32>().ok());
    let opacity = material.dissolve.unwrap_or(1.0 - transparency.unwrap_or(0.0));
    let ior = material.optical_density.filter(|&n| n > 0.0 && n != 1.0);
    if let (true, Some(eta)) = (opacity < 1.0, ior) {
        let glass = Material::Dielectric {
            eta,
            specular_reflectance: Rgb::ONE.into(),
            specular_transmittance: Rgb::ONE.into(),
        };
        return (push(materials, glass), emission);
    }
    if opacity < 1.0 {
        warn("`d` without an index of refraction is not read yet; it becomes opaque");
    }
    let reflector = if specular != Vec3::ZERO && diffuse.is_none_or(|d| d == Vec3::ZERO) {
        metal(material, specular)
    } else {
        Material::Diffuse { reflectance: diffuse.unwrap_or(Vec3::splat(0.5)).into() }
    };
    (push_two_sided(materials, reflector), emission)
}

/// A metal that reflects `specular` at every angle.
fn metal(material: &tobj::Material, specular_reflectance: Rgb) -> Material {
    // A perfect mirror, as Mitsuba's conductor `none`.
    let (eta, k) = (Rgb::ZERO.into(), Rgb::ONE.into());
    let specular_reflectance = specular_reflectance.into();
    let exponent = material.shininess.unwrap_or(0.0).max(0.0);
    if exponent >= 1000.0 || matches!(material.illumination_model, Some(3 | 5)) {
        return Material::Conductor { eta, k, specular_reflectance };
    }
    let alpha = (2.0 / (exponent + 2.0)).sqrt();
    Material::RoughConductor {
        distribution: Microfacet::Ggx,
        alpha: [alpha.into(); 2],
        eta,
        k,
        specular_reflectance,
    }
}

fn has_texture(m: &tobj::Material) -> bool {
    let known = [
        &m.diffuse_texture,
        &m.specular_texture,
        &m.normal_texture,
        &m.shininess_texture,
        &m.dissolve_texture,
    ];
    known.iter().any(|t| t.is_some()) || m.unknown_param.keys().any(|k| k.starts_with("map_"))
}
