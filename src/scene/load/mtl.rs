//! MTL material libraries of OBJ files, and what becomes of their materials.
//!
//! MTL describes looks for a fixed-function pipeline, not physical materials, so the translation is a choice:
//! 1. `Ke` above 0 or `map_Ke`: an area light of that radiance, `map_Ke` times `Ke` unless that is 0, whatever the surface reflects.
//! 2. `d` below 1 (or `Tr` above 0) with an `Ni` other than 1 and without `map_d`: a smooth dielectric of that index.
//! 3. Else `Ks` above 0 with `Kd` 0: a metal that reflects `Ks`; smooth if `illum` is 3 or 5 (the ray-traced models) or
//!    `Ns` is 1000, the format's highest; else GGX with alpha = sqrt(2 / (Ns + 2)) (Walter et al. 2007, section 5.2).
//! 4. Else: diffuse with `Kd`; `Ks` is not used.
//!
//! 5. On top of these: `map_d` (alpha, or grey of an image without) times `d`, or `d` below 1 alone, makes holes; `bump` perturbs the
//!    normal by heights in world units.
//!
//! Reflecting materials are two-sided. `map_Kd` is multiplied by `Kd` as the format says, unless that is 0; `map_Ks` colours
//! metals. Of the options of maps, `-s`, `-o`, `-clamp` and `-bm` count. Other maps are not read.

use std::collections::HashSet;
use std::fmt::Write;
use std::io::Cursor;
use std::path::{Path, PathBuf};

use glam::{Affine2, Mat2, Vec2, Vec3};

use super::image::{Content, Images};
use super::{Location, Log, push};
use crate::scene::{
    Bitmap, Input, Material, MaterialId, Microfacet, Perturbation, Rgb, TexelFilter, Texture, TextureId, Wrap,
};

/// The library or libraries that a `mtllib` line names, except those that were `read` before: a small file could name a large one without
/// end. What is missing or malformed is a warning.
pub(super) fn load(
    obj: &Path,
    names: &str,
    read: &mut HashSet<PathBuf>,
    log: &mut Log,
) -> tobj::MTLLoadResult {
    let mut text = String::new();
    for path in find(obj, names) {
        if !read.insert(path.canonicalize().unwrap_or_else(|_| path.clone())) {
            continue;
        }
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

/// What materials are translated into, and from where textures come.
pub(super) struct Translator<'a> {
    obj: &'a Path,
    images: Images,
    pub(super) materials: Vec<Material>,
    pub(super) textures: Vec<Texture>,
}

/// An image that a material names, and the options that count.
struct Map {
    path: PathBuf,
    to_uv: Affine2,
    wrap: Wrap,
    bump_scale: f32,
}

impl<'a> Translator<'a> {
    pub(super) fn new(obj: &'a Path) -> Self {
        Self { obj, images: Images::default(), materials: Vec::new(), textures: Vec::new() }
    }

    /// The material and the emission that stand for an MTL material.
    pub(super) fn translate(
        &mut self,
        material: &tobj::Material,
        log: &mut Log,
    ) -> (MaterialId, Option<Input<Rgb>>) {
        let warn = |log: &mut Log, message: &str| {
            log.warn(Location::file(self.obj), format!("material `{}`: {message}", material.name));
        };
        for map in unread_maps(material) {
            warn(log, &format!("`{map}` is not read"));
        }
        let albedo = |c: Option<[f32; 3]>| c.map(|c| Vec3::from(c).clamp(Vec3::ZERO, Vec3::ONE));
        let diffuse = albedo(material.diffuse);
        let specular = albedo(material.specular).unwrap_or(Vec3::ZERO);
        let radiance = material.emissive.map(|c| Vec3::from(c).max(Vec3::ZERO)).filter(|c| *c != Vec3::ZERO);
        let emission_map = material.unknown_param.get("map_Ke").map(String::as_str);
        let emission = match self.map(material, emission_map, Content::Color, false, log) {
            Some((texture, _)) => Some(self.scaled(Some(texture), radiance.unwrap_or(Vec3::ONE))),
            None => radiance.map(Input::Constant),
        };
        let transparency = material.unknown_param.get("Tr").and_then(|t| t.parse::<f32>().ok());
        let opacity = material.dissolve.unwrap_or(1.0 - transparency.unwrap_or(0.0)).clamp(0.0, 1.0);
        let ior = material.optical_density.filter(|&n| n > 0.0 && n != 1.0);
        let holes = self.map(material, material.dissolve_texture.as_deref(), Content::Alpha, true, log);
        if let (true, Some(eta), None) = (opacity < 1.0, ior, &holes) {
            let glass = Material::Dielectric {
                eta,
                specular_reflectance: Rgb::ONE.into(),
                specular_transmittance: Rgb::ONE.into(),
            };
            return (push(&mut self.materials, glass), emission);
        }
        let diffuse_map = self.map(material, material.diffuse_texture.as_deref(), Content::Color, false, log);
        let is_metal =
            specular != Vec3::ZERO && diffuse_map.is_none() && diffuse.is_none_or(|d| d == Vec3::ZERO);
        let reflector = if is_metal {
            let map = self.map(material, material.specular_texture.as_deref(), Content::Color, false, log);
            metal(material, self.scaled(map.map(|(texture, _)| texture), specular))
        } else {
            let kd = diffuse.filter(|d| diffuse_map.is_none() || *d != Vec3::ZERO);
            let otherwise = if diffuse_map.is_some() { Vec3::ONE } else { Vec3::splat(0.5) };
            let map = diffuse_map.map(|(texture, _)| texture);
            Material::Diffuse { reflectance: self.scaled(map, kd.unwrap_or(otherwise)) }
        };
        let mut id = push(&mut self.materials, reflector);
        let heights = self.map(material, material.normal_texture.as_deref(), Content::Color, true, log);
        if let Some((texture, scale)) = heights {
            let by = Perturbation::Bump { texture, scale };
            let (flip_invalid_normals, use_shadowing_function) = (true, true);
            let bumpy =
                Material::Perturbed { by, flip_invalid_normals, use_shadowing_function, material: id };
            id = push(&mut self.materials, bumpy);
        }
        id = push(&mut self.materials, Material::TwoSided { front: id, back: id });
        let opacity = match holes {
            Some((texture, _)) if opacity < 1.0 => {
                let factor = Rgb::splat(opacity);
                Some(Input::Texture(self.push_texture(Texture::Scale { texture, factor })))
            }
            Some((texture, _)) => Some(Input::Texture(texture)),
            None => (opacity < 1.0).then_some(Input::Constant(opacity)),
        };
        if let Some(opacity) = opacity {
            id = push(&mut self.materials, Material::Mask { opacity, material: id });
        }
        (id, emission)
    }

    /// The texture of a map, and its `-bm`. An image that cannot be read is a warning.
    fn map(
        &mut self,
        material: &tobj::Material,
        text: Option<&str>,
        content: Content,
        raw: bool,
        log: &mut Log,
    ) -> Option<(TextureId, f32)> {
        let map = parse_map(text?);
        let path = self.find(&map.path, log);
        let image = self.images.get(&path, None, content, log).map_err(|e| {
            let message = format!("material `{}`: {e}; it is left out", material.name);
            log.warn(Location::file(self.obj), message);
        });
        let image = image.ok()?;
        let bitmap = Bitmap { image, raw, filter: TexelFilter::Bilinear, wrap: map.wrap, to_uv: map.to_uv };
        Some((self.push_texture(Texture::Bitmap(bitmap)), map.bump_scale))
    }

    /// Where an image is: as it is named, or by its file name alone, beside the OBJ or a library.
    fn find(&self, name: &Path, log: &Log) -> PathBuf {
        let libraries = log.files.iter().filter(|f| f.extension().is_some_and(|e| e == "mtl"));
        let folders = || [self.obj].into_iter().chain(libraries.clone().map(PathBuf::as_path));
        let beside = |name: &Path| folders().map(|f| f.with_file_name("").join(name)).find(|p| p.is_file());
        let alone = || name.file_name().and_then(|n| beside(Path::new(n)));
        beside(name).or_else(alone).unwrap_or_else(|| self.obj.with_file_name("").join(name))
    }

    /// A texture times a colour, or the colour alone.
    fn scaled(&mut self, texture: Option<TextureId>, factor: Rgb) -> Input<Rgb> {
        match texture {
            None => Input::Constant(factor),
            Some(texture) if factor == Rgb::ONE => Input::Texture(texture),
            Some(texture) => Input::Texture(self.push_texture(Texture::Scale { texture, factor })),
        }
    }

    fn push_texture(&mut self, texture: Texture) -> TextureId {
        self.textures.push(texture);
        TextureId(self.textures.len() as u32 - 1)
    }
}

/// Options and file name of a map. The name is what follows the last option and its values, and may hold spaces.
fn parse_map(text: &str) -> Map {
    let (mut scale, mut offset) = (Vec2::ONE, Vec2::ZERO);
    let (mut wrap, mut bump_scale) = (Wrap::Repeat, 1.0);
    let mut rest = text.trim();
    while let Some(option) = rest.split_whitespace().next().filter(|w| w.starts_with('-')) {
        // Of `-s`, `-o`, `-t` and `-mm` only the first number is needed.
        let (least, most) = match option {
            "-s" | "-o" | "-t" => (1, 3),
            "-mm" => (1, 2),
            "-bm" | "-boost" | "-texres" | "-clamp" | "-blendu" | "-blendv" | "-cc" | "-imfchan"
            | "-type" => (1, 1),
            // A name that begins with a dash.
            _ => break,
        };
        let mut after = rest[option.len()..].trim_start();
        let mut numbers = Vec::new();
        for i in 0..most {
            let word = after.split_whitespace().next().unwrap_or_default();
            let number = word.parse::<f32>().ok().filter(|x| x.is_finite());
            if i >= least && number.is_none() {
                break;
            }
            numbers.push(number.unwrap_or(0.0));
            match (option, word) {
                ("-clamp", "on") => wrap = Wrap::Clamp,
                ("-bm", _) => bump_scale = number.unwrap_or(1.0),
                _ => {}
            }
            after = after[word.len()..].trim_start();
        }
        let pair = |missing: f32| Vec2::new(numbers[0], numbers.get(1).copied().unwrap_or(missing));
        match option {
            "-s" => scale = pair(1.0),
            "-o" => offset = pair(0.0),
            _ => {}
        }
        rest = after;
    }
    // In the file v runs upwards, but rows of images run from the top.
    let to_uv = Affine2 {
        matrix2: Mat2::from_diagonal(scale),
        translation: Vec2::new(offset.x, 1.0 - scale.y - offset.y),
    };
    Map { path: PathBuf::from(rest.replace('\\', "/")), to_uv, wrap, bump_scale }
}

/// A metal that reflects `specular` at every angle.
fn metal(material: &tobj::Material, specular_reflectance: Input<Rgb>) -> Material {
    // A perfect mirror, as Mitsuba's conductor `none`.
    let (eta, k) = (Rgb::ZERO.into(), Rgb::ONE.into());
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

/// The maps that say something that is not translated.
fn unread_maps(m: &tobj::Material) -> Vec<&str> {
    let mut maps: Vec<&str> = m
        .unknown_param
        .keys()
        .map(String::as_str)
        .filter(|k| (k.starts_with("map_") && *k != "map_Ke") || *k == "norm")
        .collect();
    maps.extend(m.shininess_texture.as_ref().map(|_| "map_Ns"));
    maps.sort_unstable();
    maps
}
