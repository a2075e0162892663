//! The scene's materials with what is derived from each of them once.

use rayon::prelude::*;

use super::plastic::Coat;
use crate::scene::{Material, MaterialId, Microfacet, Scene};

/// What can be said of a material without looking at a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Traits {
    /// Light gets to the other side.
    pub(super) transmits: bool,
    /// All lobes are delta lobes.
    pub(super) is_delta: bool,
}

impl Traits {
    /// Of what is not there.
    const BLACK: Self = Self { transmits: false, is_delta: true };
}

/// What a coat is made from: roughness, and index of refraction.
type CoatKind = (Option<(Microfacet, f32)>, f32);

/// The materials of a scene, ready to become BSDFs at points of surfaces.
pub struct Materials<'s> {
    pub(super) scene: &'s Scene,
    traits: Vec<Traits>,
    /// Of all plastics; those of the same kind share one.
    coats: Vec<Coat>,
    /// For each material, which coat it has.
    coat_of: Vec<Option<usize>>,
}

impl<'s> Materials<'s> {
    /// Derives what materials need: the coats of plastics are integrated numerically.
    pub fn new(scene: &'s Scene) -> Self {
        let mut traits: Vec<Traits> = Vec::with_capacity(scene.materials.len());
        for (i, material) in scene.materials.iter().enumerate() {
            let transmits = material.transmits(&scene.materials[..i]);
            let is_delta = is_delta(material, &traits);
            traits.push(Traits { transmits, is_delta });
        }
        let mut kinds: Vec<CoatKind> = Vec::new();
        let coat_of = scene.materials.iter().map(|material| {
            let Material::Plastic { roughness, eta, .. } = *material else { return None };
            let kind = (roughness, eta);
            let known = kinds.iter().position(|&known| known == kind);
            Some(known.unwrap_or_else(|| {
                kinds.push(kind);
                kinds.len() - 1
            }))
        });
        let coat_of = coat_of.collect();
        let coats = kinds.par_iter().map(|&(roughness, eta)| Coat::new(roughness, eta)).collect();
        Self { scene, traits, coats, coat_of }
    }

    /// The scene that they belong to.
    pub fn scene(&self) -> &'s Scene {
        self.scene
    }

    #[inline]
    pub(super) fn get(&self, id: MaterialId) -> Option<&'s Material> {
        self.scene.materials.get(id.0 as usize)
    }

    #[inline]
    pub(super) fn traits(&self, id: MaterialId) -> Traits {
        self.traits.get(id.0 as usize).copied().unwrap_or(Traits::BLACK)
    }

    #[inline]
    pub(super) fn coat(&self, id: MaterialId) -> Option<&Coat> {
        self.coats.get((*self.coat_of.get(id.0 as usize)?)?)
    }
}

fn is_delta(material: &Material, before: &[Traits]) -> bool {
    let nested = |id: MaterialId| before.get(id.0 as usize).is_none_or(|t| t.is_delta);
    match *material {
        Material::Conductor { .. }
        | Material::Dielectric { .. }
        | Material::ThinDielectric { .. }
        | Material::Null => true,
        Material::Diffuse { .. }
        | Material::RoughConductor { .. }
        | Material::RoughDielectric { .. }
        | Material::Plastic { .. }
        | Material::Principled(_) => false,
        Material::TwoSided { front: a, back: b } | Material::Blend { first: a, second: b, .. } => {
            nested(a) && nested(b)
        }
        Material::Mask { material, .. } | Material::Perturbed { material, .. } => nested(material),
    }
}
