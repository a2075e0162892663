//! A scene as plain data: what the file says, and nothing that rendering derives from it.
//!
//! Everything here can be built by hand, by a loader or through the C ABI, and is read by every
//! module above. Acceleration structures, light distributions and BSDFs prepared for evaluation are not here:
//! they are derived, and belong to [`crate::query`] and [`crate::transport`].

mod analytic;
mod camera;
mod emitter;
pub mod findings;
mod image;
mod instance;
pub mod load;
mod material;
mod mesh;
pub mod requirements;
mod shape;
mod surface;
pub mod texture;

pub use analytic::{AnalyticKind, AnalyticShape};
pub use camera::{Camera, FovAxis, Lens};
pub use emitter::{Emitter, EnvironmentMap, Spot};
pub use image::{Image, Texels};
use instance::map_materials;
pub use instance::{Group, Instance, InstanceError};
pub use material::{Material, MaterialId, Microfacet, Perturbation, Principled};
pub use mesh::{MeshAttribute, MeshError, TriangleMesh};
pub use shape::{Aabb, Geometry, Shape};
pub use surface::SurfacePoint;
pub use texture::{Bitmap, Input, Place, TexelFilter, Texture, TextureId, Textures, Wrap};

use glam::{DAffine3, DVec2, UVec2, Vec3};

/// A colour: linear RGB with Rec. 709 primaries, the working space of Mitsuba's `rgb` variants.
/// Radiance is in W/(m^2 sr) by convention; the renderer only relies on linearity.
pub type Rgb = Vec3;

/// Relative luminance Y of a linear Rec. 709 colour.
#[inline]
pub fn luminance(c: Rgb) -> f32 {
    c.dot(Vec3::new(0.212_671, 0.715_160, 0.072_169))
}

/// Reconstruction filters with the parameters and defaults of Mitsuba's `rfilter` plugins.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Filter {
    /// 1 within half a pixel.
    Box,
    /// Linear ramp of the given radius in pixels.
    Tent {
        /// Half-width in pixels.
        radius: f32,
    },
    /// Gaussian, cut at four standard deviations and shifted to reach 0 there.
    Gaussian {
        /// Standard deviation in pixels; Mitsuba's default is 0.5.
        stddev: f32,
    },
    /// Mitchell and Netravali's cubic of radius 2.
    Mitchell {
        /// The parameter B, by default 1/3.
        b: f32,
        /// The parameter C, by default 1/3.
        c: f32,
    },
    /// Sinc windowed by a wider sinc.
    Lanczos {
        /// Number of lobes, which is the radius in pixels; Mitsuba's default is 3.
        lobes: u32,
    },
}

/// A rectangle of pixels on the film, `min` inclusive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PixelRect {
    /// First pixel.
    pub min: UVec2,
    /// Width and height in pixels.
    pub size: UVec2,
}

/// Which film the scene file asks for.
#[derive(Debug, Clone, PartialEq)]
pub struct FilmSettings {
    /// Width and height of the full film in pixels.
    pub size: UVec2,
    /// The part that is rendered; the full film by default.
    pub crop: PixelRect,
    /// Reconstruction filter.
    pub filter: Filter,
    /// Write half floats to EXR (Mitsuba's default `component_format`) instead of 32-bit ones.
    pub half_float: bool,
}

/// The integrator that a scene file names, with its parameters as text, not yet interpreted:
/// which integrators exist is known above the scene.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct IntegratorSettings {
    /// Plugin name; `None` where the file has no integrator.
    pub name: Option<String>,
    /// Parameters in file order.
    pub parameters: Vec<(String, String)>,
    /// Where the file names it, for messages.
    pub location: Option<load::Location>,
}

/// A scene as its file describes it.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Surfaces; the index of a shape is its identity in hits, AOVs and messages.
    pub shapes: Vec<Shape>,
    /// Materials, shared by shapes.
    pub materials: Vec<Material>,
    /// Textures, shared by materials; one that is made of others comes after them.
    pub textures: Vec<Texture>,
    /// Lights that are not surfaces.
    pub emitters: Vec<Emitter>,
    /// The sensor.
    pub camera: Camera,
    /// The film.
    pub film: FilmSettings,
    /// The integrator named by the file.
    pub integrator: IntegratorSettings,
    /// Samples per pixel that the file's sampler asks for (Mitsuba's default is 4).
    pub sample_count: u32,
}

impl Scene {
    /// Nothing but a camera: a pinhole at the origin that looks along +z, with this angle of view (in degrees, across the width) and a film of this size with a box
    /// filter. What is in the scene is put into it.
    pub fn empty(size: UVec2, fov: f64) -> Self {
        let camera = Camera {
            to_world: DAffine3::IDENTITY,
            fov,
            fov_axis: FovAxis::X,
            lens: Lens::Pinhole,
            near_clip: 0.0,
            far_clip: f64::INFINITY,
            principal_point: DVec2::ZERO,
        };
        let crop = PixelRect { min: UVec2::ZERO, size };
        Self {
            shapes: Vec::new(),
            materials: Vec::new(),
            textures: Vec::new(),
            emitters: Vec::new(),
            camera,
            film: FilmSettings { size, crop, filter: Filter::Box, half_float: false },
            integrator: IntegratorSettings::default(),
            sample_count: 1,
        }
    }
}
