//! Metals: the mirror and Cook and Torrance's rough reflector. Both see `wo` with `wo.z` > 0.

use glam::{Vec2, Vec3};

use super::fresnel::fresnel_conductor;
use super::microfacet::Microfacets;
use super::{BsdfSample, reflect};
use crate::scene::Rgb;

/// Reflectance of a metal: complex index of refraction and a factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Metal {
    pub(super) eta: Rgb,
    pub(super) k: Rgb,
    pub(super) tint: Rgb,
}

impl Metal {
    #[inline]
    pub(super) fn reflectance(&self, cos: f32) -> Rgb {
        self.tint * fresnel_conductor(cos, self.eta, self.k)
    }

    /// Reflection of a smooth surface.
    #[inline(never)]
    pub(super) fn sample_mirror(&self, wo: Vec3) -> BsdfSample {
        let wi = Vec3::new(-wo.x, -wo.y, wo.z);
        BsdfSample { wi, weight: self.reflectance(wo.z), pdf: 1.0, is_delta: true, eta: 1.0 }
    }
}

/// Microfacets of metal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RoughConductor {
    pub(super) facets: Microfacets,
    pub(super) metal: Metal,
}

impl RoughConductor {
    #[inline(never)]
    pub(super) fn sample(&self, wo: Vec3, u: Vec2) -> Option<BsdfSample> {
        let m = self.facets.sample_visible(wo, u);
        let cos_om = wo.dot(m);
        let wi = reflect(wo, m, cos_om);
        if wi.z <= 0.0 || cos_om <= 0.0 {
            return None; // The light would have to bounce again between facets; single scattering loses it.
        }
        let pdf = reflection_pdf(&self.facets, wo, m);
        let weight = self.metal.reflectance(cos_om) * self.facets.masking(wi);
        Some(BsdfSample { wi, weight, pdf, is_delta: false, eta: 1.0 })
    }

    #[inline(never)]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        let Some(m) = reflection_half_vector(wo, wi) else { return Rgb::ZERO };
        let f = self.facets.d(m) * self.facets.masking_over_cos(wo) * self.facets.masking_over_cos(wi) / 4.0;
        self.metal.reflectance(wo.dot(m).min(1.0)) * f
    }

    #[inline(never)]
    pub(super) fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        reflection_half_vector(wo, wi).map_or(0.0, |m| reflection_pdf(&self.facets, wo, m))
    }
}

/// The microfacet normal that reflects `wo` into `wi`, both on the normal's side.
#[inline]
pub(super) fn reflection_half_vector(wo: Vec3, wi: Vec3) -> Option<Vec3> {
    if wi.z > 0.0 { (wo + wi).try_normalize() } else { None }
}

/// Density of the reflection at a visible normal `m`: `D(m) G1(wo) (wo . m) / cos(wo)` over the Jacobian `4 (wo . m)`.
#[inline]
pub(super) fn reflection_pdf(facets: &Microfacets, wo: Vec3, m: Vec3) -> f32 {
    facets.d(m) * facets.masking_over_cos(wo) / 4.0
}
