//! A diffuse base under a dielectric coat, smooth or rough. Sees `wo` with `wo.z` > 0.
//!
//! Light enters through the coat, is scattered by the base, is reflected back by the coat any number of times and leaves: a
//! geometric series in the coat's internal reflectance. A rough coat loses, as all rough surfaces here, what would bounce on
//! between its facets, on the way in, on the way out and inside.

use glam::{Vec2, Vec3};
use rayon::prelude::*;
use std::f32::consts::FRAC_1_PI;

use super::conductor::{reflection_half_vector, reflection_pdf};
use super::fresnel::fresnel_dielectric;
use super::microfacet::Microfacets;
use super::{BsdfSample, reflect};
use crate::sampling::warp::{cosine_hemisphere_pdf, square_to_cosine_hemisphere};
use crate::scene::{Microfacet, Rgb};

/// Entries of the table of transmittances, at even distances of the cosine.
const TABLE: usize = 64;
/// Microfacet normals along each of two axes, for each entry.
const NORMALS: u32 = 48;

/// What depends on the coat alone.
#[derive(Debug, Clone)]
pub(super) struct Coat {
    eta: f32,
    /// Fraction of diffuse light from below that the coat reflects.
    internal_reflectance: f32,
    rough: Option<RoughCoat>,
}

#[derive(Clone)]
struct RoughCoat {
    facets: Microfacets,
    /// Fraction that is not reflected, by the cosine of the direction from outside.
    transmittance: Vec<f32>,
}

impl std::fmt::Debug for RoughCoat {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RoughCoat").field("facets", &self.facets).finish_non_exhaustive()
    }
}

impl Coat {
    pub(super) fn new(roughness: Option<(Microfacet, f32)>, eta: f32) -> Self {
        let Some((distribution, alpha)) = roughness else {
            let reflectance =
                |eta: f32| diffuse_average(|cos| f64::from(1.0 - transmittance(cos, eta)), 4096);
            // From inside a denser coat by reciprocity, because the reflectance itself has a kink at the critical angle.
            let internal = if eta > 1.0 {
                1.0 - (1.0 - reflectance(eta)) / f64::from(eta * eta)
            } else {
                reflectance(1.0 / eta)
            };
            return Self { eta, internal_reflectance: internal as f32, rough: None };
        };
        let facets = Microfacets::new(distribution, [alpha; 2], 0.0);
        let cos = |i: usize| (i as f32 / (TABLE - 1) as f32).max(1e-6);
        // A scene may have hundreds of coats, each of which takes milliseconds.
        let table =
            |of: &(dyn Fn(usize) -> f32 + Sync)| (0..TABLE).into_par_iter().map(of).collect::<Vec<_>>();
        let transmittance = table(&|i| single_scattering(&facets, cos(i), eta).transmitted);
        // Mitsuba's rule: the sum of all 64 entries over their number, which is short of the integral by about 1/64.
        let reflected = table(&|i| single_scattering(&facets, cos(i), 1.0 / eta).reflected * cos(i));
        let internal = 2.0 * reflected.into_iter().map(f64::from).sum::<f64>() / TABLE as f64;
        let rough = Some(RoughCoat { facets, transmittance });
        Self { eta, internal_reflectance: internal as f32, rough }
    }

    /// Fraction of the light from outside that gets to the base.
    #[inline]
    fn transmittance(&self, cos: f32) -> f32 {
        let Some(rough) = &self.rough else { return transmittance(cos, self.eta) };
        let x = cos.clamp(0.0, 1.0) * (TABLE - 1) as f32;
        let i = (x as usize).min(TABLE - 2);
        let (a, b) = (rough.transmittance[i], rough.transmittance[i + 1]);
        a + (b - a) * (x - i as f32)
    }
}

/// Of a smooth boundary.
#[inline]
fn transmittance(cos: f32, eta: f32) -> f32 {
    1.0 - fresnel_dielectric(cos, (1.0 - cos * cos).max(0.0), eta).reflectance
}

/// The mean of a function of the cosine over directions, weighted by the cosine; by midpoints.
fn diffuse_average(f: impl Fn(f32) -> f64, steps: u32) -> f64 {
    let n = f64::from(steps);
    // Even in the squared cosine, which takes the weight away.
    (0..steps).map(|i| f(((f64::from(i) + 0.5) / n).sqrt() as f32)).sum::<f64>() / n
}

/// What microfacets reflect and transmit in one bounce, as fractions of what arrives.
struct SingleScattering {
    reflected: f32,
    transmitted: f32,
}

/// From a direction of the given cosine, by an even grid of visible normals.
fn single_scattering(facets: &Microfacets, cos: f32, eta: f32) -> SingleScattering {
    let wo = Vec3::new((1.0 - cos * cos).max(0.0).sqrt(), 0.0, cos);
    let at = |i: u32| (i as f32 + 0.5) / NORMALS as f32;
    let (mut reflected, mut transmitted) = (0.0, 0.0);
    for i in 0..NORMALS {
        for j in 0..NORMALS {
            let m = facets.sample_visible(wo, Vec2::new(at(i), at(j)));
            let cos_om = wo.dot(m).min(1.0);
            if cos_om <= 0.0 {
                continue;
            }
            let tangential = wo - cos_om * m;
            let fresnel = fresnel_dielectric(cos_om, tangential.length_squared(), eta);
            let (up, down) = (reflect(wo, m, cos_om), -tangential / eta - fresnel.cos_t * m);
            if up.z > 0.0 {
                reflected += f64::from(fresnel.reflectance * facets.masking(up));
            }
            if down.z < 0.0 {
                transmitted += f64::from((1.0 - fresnel.reflectance) * facets.masking(down));
            }
        }
    }
    let n = f64::from(NORMALS * NORMALS);
    SingleScattering { reflected: (reflected / n) as f32, transmitted: (transmitted / n) as f32 }
}

/// A coated base at a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Plastic<'s> {
    coat: &'s Coat,
    specular: Rgb,
    /// Albedo of the base with all reflections below the coat, and the change of solid angle.
    base: Rgb,
    /// Preference for the specular lobe in sampling, 0..1.
    specular_weight: f32,
}

impl<'s> Plastic<'s> {
    #[inline(never)]
    pub(super) fn new(coat: &'s Coat, diffuse: Rgb, specular: Rgb, nonlinear: bool) -> Self {
        let internal = coat.internal_reflectance;
        let lost = if nonlinear { diffuse * internal } else { Rgb::splat(internal) };
        let base = diffuse / ((Rgb::ONE - lost) * (coat.eta * coat.eta));
        let (s, d) = (specular.element_sum(), diffuse.element_sum());
        let specular_weight = if s + d > 0.0 { s / (s + d) } else { 0.5 };
        Self { coat, specular, base, specular_weight }
    }

    #[inline(never)]
    pub(super) fn sample(&self, wo: Vec3, u: f32, u_direction: Vec2) -> Option<BsdfSample> {
        let specular = self.specular_probability(wo.z);
        if u >= specular {
            let wi = square_to_cosine_hemisphere(u_direction);
            return self.continuous(wo, wi);
        }
        let Some(rough) = &self.coat.rough else {
            let wi = Vec3::new(-wo.x, -wo.y, wo.z);
            let weight = self.specular * ((1.0 - self.coat.transmittance(wo.z)) / specular);
            return Some(BsdfSample { wi, weight, pdf: specular, is_delta: true, eta: 1.0 });
        };
        let m = rough.facets.sample_visible(wo, u_direction);
        let cos_om = wo.dot(m);
        if cos_om <= 0.0 {
            return None;
        }
        self.continuous(wo, reflect(wo, m, cos_om))
    }

    #[inline]
    fn continuous(&self, wo: Vec3, wi: Vec3) -> Option<BsdfSample> {
        let pdf = self.pdf(wo, wi);
        let weight = self.eval(wo, wi) * (wi.z / pdf);
        (wi.z > 0.0 && pdf > 0.0).then_some(BsdfSample { wi, weight, pdf, is_delta: false, eta: 1.0 })
    }

    #[inline(never)]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3) -> Rgb {
        if wi.z <= 0.0 {
            return Rgb::ZERO;
        }
        let diffuse = self.base * (FRAC_1_PI * self.coat.transmittance(wo.z) * self.coat.transmittance(wi.z));
        let (Some(rough), Some(m)) = (&self.coat.rough, reflection_half_vector(wo, wi)) else {
            return diffuse;
        };
        let masking = rough.facets.masking_over_cos(wo) * rough.facets.masking_over_cos(wi);
        let reflectance = 1.0 - transmittance(wo.dot(m).clamp(0.0, 1.0), self.coat.eta);
        diffuse + self.specular * (reflectance * rough.facets.d(m) * masking / 4.0)
    }

    #[inline(never)]
    pub(super) fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wi.z <= 0.0 {
            return 0.0;
        }
        let specular = self.specular_probability(wo.z);
        let diffuse = (1.0 - specular) * cosine_hemisphere_pdf(wi.z);
        match (&self.coat.rough, reflection_half_vector(wo, wi)) {
            (Some(rough), Some(m)) => diffuse + specular * reflection_pdf(&rough.facets, wo, m),
            _ => diffuse,
        }
    }

    /// Probability with which the specular lobe is sampled.
    #[inline]
    fn specular_probability(&self, cos: f32) -> f32 {
        let transmittance = self.coat.transmittance(cos);
        let specular = (1.0 - transmittance) * self.specular_weight;
        let diffuse = transmittance * (1.0 - self.specular_weight);
        if specular + diffuse > 0.0 { specular / (specular + diffuse) } else { 0.0 }
    }

    /// Power reflected by a smooth coat, and by the base with what leaves through it.
    #[inline]
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        let transmittance = self.coat.transmittance(wo.z);
        // The mean transmittance outwards, by reciprocity, as seen from outside.
        let outwards = (1.0 - self.coat.internal_reflectance) * self.coat.eta * self.coat.eta;
        self.specular * (1.0 - transmittance) + self.base * (transmittance * outwards.min(1.0))
    }
}
