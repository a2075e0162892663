//! The scene's materials with what is derived from each of them once.

use rayon::prelude::*;

use super::plastic::Coat;
use crate::scene::{Material, MaterialId, Scene};

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

/// The materials of a scene, ready to become BSDFs at points of surfaces.
pub struct Materials<'s> {
    pub(super) scene: &'s Scene,
    traits: Vec<Traits>,
    /// One per material up to the last that has one.
    coats: Vec<Option<Coat>>,
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
        let coated = scene.materials.iter().rposition(|m| matches!(m, Material::Plastic { .. }));
        let coats =
            scene.materials[..coated.map_or(0, |i| i + 1)].par_iter().map(|material| match *material {
                Material::Plastic { roughness, eta, .. } => Some(Coat::new(roughness, eta)),
                _ => None,
            });
        Self { scene, traits, coats: coats.collect() }
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
        self.coats.get(id.0 as usize)?.as_ref()
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
