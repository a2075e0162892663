//! Materials as the scene file states them; [`crate::transport`] turns them into BSDFs.

use super::{Input, Rgb, TextureId};

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
///
/// Reflectances and transmittances are in 0..1; what a texture has beyond that is clamped. A material made of others may
/// only refer to those before it in [`Scene::materials`](super::Scene::materials), which bounds the depth; others are black.
#[derive(Debug, Clone, PartialEq)]
pub enum Material {
    /// Lambertian reflection on the front side.
    Diffuse {
        /// Albedo, 0..1.
        reflectance: Input<Rgb>,
    },
    /// Smooth metal.
    Conductor {
        /// Real part of the index of refraction relative to the outside.
        eta: Input<Rgb>,
        /// Imaginary part (absorption), positive.
        k: Input<Rgb>,
        /// Factor on the reflection, 1 for physical metals.
        specular_reflectance: Input<Rgb>,
    },
    /// Rough metal (Cook-Torrance).
    RoughConductor {
        /// Normal distribution.
        distribution: Microfacet,
        /// Roughness along and across the tangent.
        alpha: [Input<f32>; 2],
        /// Real part of the index of refraction.
        eta: Input<Rgb>,
        /// Imaginary part.
        k: Input<Rgb>,
        /// Factor on the reflection.
        specular_reflectance: Input<Rgb>,
    },
    /// Smooth boundary between two dielectrics.
    Dielectric {
        /// Index of refraction of the inside over that of the outside.
        eta: f32,
        /// Factor on the reflection.
        specular_reflectance: Input<Rgb>,
        /// Factor on the transmission.
        specular_transmittance: Input<Rgb>,
    },
    /// Rough boundary between two dielectrics (Walter et al. 2007).
    RoughDielectric {
        /// Normal distribution.
        distribution: Microfacet,
        /// Roughness along and across the tangent.
        alpha: [Input<f32>; 2],
        /// Index of refraction of the inside over that of the outside.
        eta: f32,
        /// Factor on the reflection.
        specular_reflectance: Input<Rgb>,
        /// Factor on the transmission.
        specular_transmittance: Input<Rgb>,
    },
    /// A sheet so thin that light leaves it in the direction in which it came, with all reflections inside.
    ThinDielectric {
        /// Index of refraction of the sheet over that of its surroundings.
        eta: f32,
        /// Factor on the reflection.
        specular_reflectance: Input<Rgb>,
        /// Factor on the transmission.
        specular_transmittance: Input<Rgb>,
    },
    /// A diffuse base under a dielectric coat.
    Plastic {
        /// Normal distribution and roughness of the coat; `None` for a smooth one.
        roughness: Option<(Microfacet, f32)>,
        /// Index of refraction of the coat over that of the outside.
        eta: f32,
        /// Albedo of the base.
        diffuse_reflectance: Input<Rgb>,
        /// Factor on the reflection of the coat.
        specular_reflectance: Input<Rgb>,
        /// The base's colour also saturates by reflections between base and coat.
        nonlinear: bool,
    },
    /// Disney's model (Burley 2012 and 2015).
    Principled(Box<Principled>),
    /// Nothing: light passes.
    Null,
    /// Opaque materials seen from both sides.
    TwoSided {
        /// Used on the side the normal points to.
        front: MaterialId,
        /// Used on the other side, with the frame turned over.
        back: MaterialId,
    },
    /// A material with holes.
    Mask {
        /// Fraction of the surface that is there.
        opacity: Input<f32>,
        /// Its material.
        material: MaterialId,
    },
    /// Two materials side by side, too fine to be told apart.
    Blend {
        /// Fraction of the second.
        weight: Input<f32>,
        /// The first.
        first: MaterialId,
        /// The second.
        second: MaterialId,
    },
    /// A material on a surface whose shading normal is perturbed.
    Perturbed {
        /// By what.
        by: Perturbation,
        /// Normals that turn away from the viewer are mirrored at the surface's (Schuessler et al. 2017).
        flip_invalid_normals: bool,
        /// Darken towards the terminator (Estevez et al. 2019).
        use_shadowing_function: bool,
        /// The material, itself not perturbed.
        material: MaterialId,
    },
}

impl Material {
    /// The materials that this one is made of.
    pub(super) fn parts_mut(&mut self) -> [Option<&mut MaterialId>; 2] {
        match self {
            Self::TwoSided { front: a, back: b } | Self::Blend { first: a, second: b, .. } => {
                [Some(a), Some(b)]
            }
            Self::Mask { material, .. } | Self::Perturbed { material, .. } => [Some(material), None],
            _ => [None, None],
        }
    }

    /// Whether light passes to the other side, given the materials that it may be made of.
    pub fn transmits(&self, materials: &[Self]) -> bool {
        let nested = |id: MaterialId| {
            let before = materials.get(..=id.0 as usize).and_then(<[Self]>::split_last);
            before.is_some_and(|(material, before)| material.transmits(before))
        };
        match self {
            Self::Diffuse { .. }
            | Self::Conductor { .. }
            | Self::RoughConductor { .. }
            | Self::Plastic { .. }
            | Self::TwoSided { .. } => false,
            Self::Dielectric { .. }
            | Self::RoughDielectric { .. }
            | Self::ThinDielectric { .. }
            | Self::Null
            | Self::Mask { .. } => true,
            Self::Principled(p) => p.spec_trans != Input::Constant(0.0),
            Self::Blend { first, second, .. } => nested(*first) || nested(*second),
            Self::Perturbed { material, .. } => nested(*material),
        }
    }
}

/// What perturbs a shading normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Perturbation {
    /// Heights along the normal, in world units.
    Bump {
        /// The heights.
        texture: TextureId,
        /// Factor on them.
        scale: f32,
    },
    /// Normals in the local frame, each coordinate -1..1 stored as 0..1.
    Normal(Input<Rgb>),
}

/// Parameters of [`Material::Principled`], all in 0..1 but the index of refraction.
#[derive(Debug, Clone, PartialEq)]
pub struct Principled {
    /// Colour of the base.
    pub base_color: Input<Rgb>,
    /// Square root of the roughness of the main specular lobe.
    pub roughness: Input<f32>,
    /// How much rougher along than across the tangent.
    pub anisotropic: Input<f32>,
    /// From dielectric to metal.
    pub metallic: Input<f32>,
    /// From opaque to transparent.
    pub spec_trans: Input<f32>,
    /// Tint of the dielectric reflection by the base colour.
    pub spec_tint: Input<f32>,
    /// Amount of reflection at grazing angles as of cloth.
    pub sheen: Input<f32>,
    /// Its tint by the base colour.
    pub sheen_tint: Input<f32>,
    /// From diffuse to an imitation of subsurface scattering.
    pub flatness: Input<f32>,
    /// Amount of a second, white specular lobe.
    pub clearcoat: Input<f32>,
    /// Its smoothness.
    pub clearcoat_gloss: Input<f32>,
    /// Index of refraction of the inside over that of the outside.
    pub eta: f32,
}
