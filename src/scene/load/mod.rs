//! Loaders: text or bytes in, a [`Scene`] or a located error out.
//!
//! [`load`] picks the loader by the file's extension: Mitsuba 3 XML ([`mitsuba`]), Wavefront OBJ with MTL, or PLY.
//! A bare mesh gets a neutral sky and a camera that frames it. Input is hostile: whatever the bytes are, a loader
//! returns in time and memory proportional to the files' size.
//!
//! Loaders do not judge what the renderer makes of a scene: integrators stay text, and nothing is derived.

mod edit;
mod error;
pub(crate) mod exr;
mod image;
mod judge;
mod mesh;
pub mod mitsuba;
mod mtl;
mod obj;
mod ply;
mod polygon;
mod serialized;
mod smooth;

pub use edit::{EditError, Origins};
pub use error::{LoadError, Location, Position, Severity, Warning};
pub use mesh::RawMesh;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec2, DVec3, UVec2, Vec3};

use super::{
    Aabb, Camera, Emitter, FilmSettings, Filter, FovAxis, Image, Input, IntegratorSettings, Lens, Material,
    MaterialId, PixelRect, Rgb, Scene, Shape, Texture,
};

/// How to load.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct LoadOptions {
    /// Values of `$name` parameters in Mitsuba XML; they override the file's `<default>`s.
    pub defines: Vec<(String, String)>,
    /// Replace what is not supported and warn, instead of refusing the scene.
    pub lenient: bool,
    /// Meshes that are in memory already: where a Mitsuba scene names one of these as the file of a shape, no file is read.
    pub meshes: Vec<(String, Arc<RawMesh>)>,
}

/// A scene and what there is to say about its loading.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// Notes and warnings in the order of their discovery.
    pub warnings: Vec<Warning>,
    /// Every file that was read, the scene file first, without repetition.
    pub files: Vec<PathBuf>,
    /// What edits need to know.
    pub origins: Origins,
}

/// Loads a scene file, or a mesh as a scene.
///
/// # Errors
/// An extension other than `.xml`, `.obj` and `.ply`; a file that cannot be read; anything in it that is invalid, or,
/// unless [`LoadOptions::lenient`] is set, not supported.
pub fn load(path: &Path, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let mut log = Log { lenient: options.lenient, ..Log::default() };
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let (scene, origins) = match extension.as_str() {
        "xml" => mitsuba::load(&mitsuba::Text::File(path), options, &mut log)?,
        "obj" => (obj::load_scene(path, &mut log)?, Origins::default()),
        "ply" => (ply::load_scene(path, &mut log)?, Origins::of_bare_mesh()),
        _ => {
            let found = if extension.is_empty() {
                "a file without an extension".to_owned()
            } else {
                format!("a file of type .{extension}")
            };
            let expected = "a Mitsuba scene (.xml) or a mesh (.obj, .ply)";
            return Err(LoadError::new(Location::file(path), found, expected));
        }
    };
    judge::shapes(path, &scene.shapes, &mut log);
    Ok(Loaded { scene, warnings: log.warnings, files: log.files, origins })
}

/// Loads a Mitsuba scene from a text; files that it names are looked for in `directory`.
///
/// # Errors
/// As of [`load`].
pub fn load_text(text: &str, directory: &Path, options: &LoadOptions) -> Result<Loaded, LoadError> {
    let mut log = Log { lenient: options.lenient, ..Log::default() };
    let (scene, origins) = mitsuba::load(&mitsuba::Text::Memory(text, directory), options, &mut log)?;
    judge::shapes(directory, &scene.shapes, &mut log);
    Ok(Loaded { scene, warnings: log.warnings, files: log.files, origins })
}

/// Loads an image file (PNG, JPEG, OpenEXR, Radiance HDR, TGA or BMP) without its alpha channel, as textures are loaded.
///
/// # Errors
/// A file that cannot be read, or is not a valid image of these formats.
pub fn load_image(path: &Path) -> Result<(Image, Vec<Warning>), LoadError> {
    let mut log = Log::default();
    let image = image::read(path, None, image::Content::Color, &mut log)?;
    Ok((image, log.warnings))
}

/// What loading leaves behind besides the scene.
#[derive(Debug, Default)]
struct Log {
    lenient: bool,
    warnings: Vec<Warning>,
    files: Vec<PathBuf>,
}

impl Log {
    fn push(&mut self, severity: Severity, location: Location, message: impl Into<String>) {
        self.warnings.push(Warning { severity, location, message: message.into() });
    }

    /// Says what was chosen where the file leaves it open.
    fn note(&mut self, location: Location, message: impl Into<String>) {
        self.push(Severity::Note, location, message);
    }

    /// Says what has no effect.
    fn warn(&mut self, location: Location, message: impl Into<String>) {
        self.push(Severity::Warning, location, message);
    }

    /// Something valid that is not supported: an error, or when lenient a warning that names the substitute.
    fn unsupported(&mut self, error: LoadError, substitute: &str) -> Result<(), LoadError> {
        if !self.lenient {
            return Err(error);
        }
        self.push(Severity::Replaced, error.location, format!("{}; {substitute}", error.found));
        Ok(())
    }

    /// Takes over what a loader of one file, perhaps on another thread, had to say.
    fn absorb(&mut self, other: Self) {
        self.warnings.extend(other.warnings);
        for file in other.files {
            self.record(&file);
        }
    }

    fn record(&mut self, file: &Path) {
        if !self.files.iter().any(|f| f == file) {
            self.files.push(file.to_path_buf());
        }
    }

    /// A file that another one names at `from`, opened to be read in part; and its length.
    fn open(&mut self, path: &Path, from: &Location) -> Result<(fs::File, u64), LoadError> {
        let refuse = |why: String| {
            LoadError::new(from.clone(), format!("file {}: {why}", path.display()), "a readable file")
        };
        let metadata = fs::metadata(path).map_err(|e| refuse(format!("cannot be opened ({e})")))?;
        if !metadata.is_file() {
            return Err(refuse("is not a regular file".to_owned()));
        }
        let file = fs::File::open(path).map_err(|e| refuse(format!("cannot be opened ({e})")))?;
        self.record(path);
        Ok((file, metadata.len()))
    }

    /// The bytes of a file. `from` is where the file was named, if in another file.
    fn read(&mut self, path: &Path, from: Option<&Location>) -> Result<Vec<u8>, LoadError> {
        let refuse = |why: String| {
            let location = from.cloned().unwrap_or_else(|| Location::file(path));
            let found = from.map_or(why.clone(), |_| format!("file {}: {why}", path.display()));
            LoadError::new(location, found, "a readable file")
        };
        let metadata = fs::metadata(path).map_err(|e| refuse(format!("cannot be opened ({e})")))?;
        // Devices and pipes have no end.
        if !metadata.is_file() {
            return Err(refuse("is not a regular file".to_owned()));
        }
        let bytes = fs::read(path).map_err(|e| refuse(format!("cannot be read ({e})")))?;
        self.record(path);
        Ok(bytes)
    }
}

/// Mitsuba's film unless the file says otherwise.
fn default_film() -> FilmSettings {
    let size = UVec2::new(768, 576);
    let crop = PixelRect { min: UVec2::ZERO, size };
    FilmSettings { size, crop, filter: Filter::Gaussian { stddev: 0.5 }, half_float: true }
}

/// Samples per pixel of Mitsuba's samplers unless the file says otherwise.
const DEFAULT_SAMPLE_COUNT: u32 = 4;

/// Field of view, in degrees across the shorter side, of the camera made for scenes that have none.
const FRAMING_FOV: f64 = 40.0;

/// A camera in front (+z) of `bounds` and slightly above, y up, that sees all of it.
fn framing_camera(bounds: Aabb) -> Camera {
    let (center, radius) = bounds.bounding_sphere();
    let (center, radius) = (center.as_dvec3(), f64::from(if radius > 0.0 { radius } else { 1.0 }));
    let direction = -DVec3::new(0.6, 0.45, 1.0).normalize();
    let axes = look_along(DVec3::ZERO, direction, DVec3::Y).matrix3;
    // Of each corner of the box, how far in front of it the camera must stand for the corner to lie within the view.
    let tan = (FRAMING_FOV / 2.0).to_radians().tan();
    let (min, max) = (bounds.min.as_dvec3(), bounds.max.as_dvec3());
    let corner = |i: u32| DVec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), max, min);
    let needed = |corner: DVec3| {
        let q = axes.transpose() * (corner - center);
        q.x.abs().max(q.y.abs()) / tan - q.z
    };
    // 5 % more leaves a margin. A point, or nothing, has no corners to go by.
    let distance =
        (0..8).map(|i| needed(corner(i))).fold(radius, |far, d| if d > far { d } else { far }) * 1.05;
    Camera {
        to_world: look_along(center - direction * distance, direction, DVec3::Y),
        fov: FRAMING_FOV,
        fov_axis: FovAxis::Smaller,
        lens: Lens::Pinhole,
        near_clip: distance * 1e-4,
        far_clip: distance + 4.0 * radius,
        principal_point: DVec2::ZERO,
    }
}

/// Camera space to world space for a camera at `origin` looking in the unit direction `direction`: +z forward, +x left.
fn look_along(origin: DVec3, direction: DVec3, up: DVec3) -> DAffine3 {
    let left = up.cross(direction).normalize();
    DAffine3::from_mat3_translation(DMat3::from_cols(left, direction.cross(left), direction), origin)
}

/// Bounds of all shapes.
fn bounds_of(shapes: &[Shape]) -> Aabb {
    shapes.iter().fold(Aabb::EMPTY, |b, s| b.union(s.geometry.bounds()))
}

/// The scene of a bare mesh: what the file lacks is chosen and noted.
fn mesh_scene(
    path: &Path,
    shapes: Vec<Shape>,
    materials: Vec<Material>,
    textures: Vec<Texture>,
    log: &mut Log,
) -> Scene {
    let camera = framing_camera(bounds_of(&shapes));
    let mut chosen = vec!["a camera that frames the mesh"];
    let mut emitters = Vec::new();
    if shapes.iter().all(|s| s.emission.is_none()) {
        emitters.push(Emitter::Constant { radiance: Rgb::ONE });
        chosen.insert(0, "a constant white sky of radiance 1");
    }
    log.note(Location::file(path), format!("a mesh, not a scene: using {}", chosen.join(" and ")));
    Scene {
        shapes,
        materials,
        textures,
        emitters,
        camera,
        film: default_film(),
        integrator: IntegratorSettings::default(),
        sample_count: DEFAULT_SAMPLE_COUNT,
    }
}

/// Adds a two-sided version of a reflecting material: the winding of meshes as people have them says little about
/// which side is out.
fn push_two_sided(materials: &mut Vec<Material>, material: Material) -> MaterialId {
    let inner = push(materials, material);
    push(materials, Material::TwoSided { front: inner, back: inner })
}

fn push(materials: &mut Vec<Material>, material: Material) -> MaterialId {
    materials.push(material);
    MaterialId(materials.len() as u32 - 1)
}

/// Of lamps that name no material.
const BLACK: Material = Material::Diffuse { reflectance: Input::Constant(Vec3::ZERO) };

/// Mitsuba's default material.
const GREY: Material = Material::Diffuse { reflectance: Input::Constant(Vec3::splat(0.5)) };
