//! Materials as the scene file states them; [`crate::transport`] turns them into BSDFs.

use super::Rgb;

/// Index into [`Scene::materials`](super::Scene::materials).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct MaterialId(pub u32);

/// Distribution of microfacet normals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Microfacet {
    /// Trowbridge-Reitz (GGX).
    Ggx,
    /// Beckmann.
    Beckmann,
}

/// A material. Names and meaning follow Mitsuba's BSDF plugins.
#[derive(Debug, Clone, PartialEq)]
pub enum Material {
    /// Lambertian reflection on the front side.
    Diffuse {
        /// Albedo, 0..1.
        reflectance: Rgb,
    },
    /// Smooth metal.
    Conductor {
        /// Real part of the index of refraction relative to the outside.
        eta: Rgb,
        /// Imaginary part (absorption), positive.
        k: Rgb,
        /// Factor on the reflection, 1 for physical metals.
        specular_reflectance: Rgb,
    },
    /// Rough metal (Cook-Torrance).
    RoughConductor {
        /// Normal distribution.
        distribution: Microfacet,
        /// Roughness along and across the tangent.
        alpha: [f32; 2],
        /// Real part of the index of refraction.
        eta: Rgb,
        /// Imaginary part.
        k: Rgb,
        /// Factor on the reflection.
        specular_reflectance: Rgb,
    },
    /// Smooth boundary between two dielectrics.
    Dielectric {
        /// Index of refraction of the inside over that of the outside.
        eta: f32,
        /// Factor on the reflection.
        specular_reflectance: Rgb,
        /// Factor on the transmission.
        specular_transmittance: Rgb,
    },
    /// Rough boundary between two dielectrics (Walter et al. 2007).
    RoughDielectric {
        /// Normal distribution.
        distribution: Microfacet,
        /// Roughness along and across the tangent.
        alpha: [f32; 2],
        /// Index of refraction of the inside over that of the outside.
        eta: f32,
        /// Factor on the reflection.
        specular_reflectance: Rgb,
        /// Factor on the transmission.
        specular_transmittance: Rgb,
    },
    /// Opaque materials seen from both sides.
    TwoSided {
        /// Used on the side the normal points to.
        front: MaterialId,
        /// Used on the other side, with the frame turned over.
        back: MaterialId,
    },
}
