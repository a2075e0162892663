//! Boundaries between dielectrics, smooth and rough (Walter et al. 2007, "Microfacet models for refraction through rough
//! surfaces"). Both see `wo` with `wo.z` > 0; `eta` is the index on the other side over that on `wo`'s side.

use glam::{Vec2, Vec3};

use super::conductor::{reflection_half_vector, reflection_pdf};
use super::fresnel::{dielectric_transmittance, fresnel_dielectric};
use super::microfacet::Microfacets;
use super::{BsdfSample, TransportMode, reflect};
use crate::scene::Rgb;

/// A boundary as seen from one side: relative index and factors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Boundary {
    pub(super) eta: f32,
    pub(super) reflection: Rgb,
    pub(super) transmission: Rgb,
}

impl Boundary {
    /// The same boundary as seen from the other side.
    #[inline]
    pub(super) fn turned_over(self) -> Self {
        Self { eta: 1.0 / self.eta, ..self }
    }

    /// Radiance is squeezed into the smaller cone of the denser side, and so changes by the squared index; power does not.
    #[inline]
    fn transmission_scale(&self, mode: TransportMode) -> f32 {
        match mode {
            TransportMode::Radiance => 1.0 / (self.eta * self.eta),
            TransportMode::Importance => 1.0,
        }
    }

    /// Reflection (if `u` falls below the Fresnel reflectance) or refraction of a smooth boundary.
    #[inline(never)]
    pub(super) fn sample_smooth(&self, wo: Vec3, u: f32, mode: TransportMode) -> BsdfSample {
        let fresnel = fresnel_dielectric(wo.z, wo.x * wo.x + wo.y * wo.y, self.eta);
        if u < fresnel.reflectance {
            let wi = Vec3::new(-wo.x, -wo.y, wo.z);
            BsdfSample { wi, weight: self.reflection, pdf: fresnel.reflectance, is_delta: true, eta: 1.0 }
        } else {
            let wi = Vec3::new(-wo.x / self.eta, -wo.y / self.eta, -fresnel.cos_t);
            let weight = self.transmission * self.transmission_scale(mode);
            BsdfSample { wi, weight, pdf: 1.0 - fresnel.reflectance, is_delta: true, eta: self.eta }
        }
    }

    /// Fraction that a thin sheet reflects, with all reflections inside: `R + T R T + T R^3 T + ... = 2R / (1 + R)`.
    #[inline]
    fn thin_reflectance(&self, wo: Vec3) -> f32 {
        let r = fresnel_dielectric(wo.z, wo.x * wo.x + wo.y * wo.y, self.eta).reflectance;
        2.0 * r / (1.0 + r)
    }

    /// Reflection or passage of a sheet between two such boundaries.
    #[inline]
    pub(super) fn sample_thin(&self, wo: Vec3, u: f32) -> BsdfSample {
        let reflectance = self.thin_reflectance(wo);
        let (wi, weight, pdf) = if u < reflectance {
            (Vec3::new(-wo.x, -wo.y, wo.z), self.reflection, reflectance)
        } else {
            (-wo, self.transmission, 1.0 - reflectance)
        };
        BsdfSample { wi, weight, pdf, is_delta: true, eta: 1.0 }
    }

    /// Power reflected and transmitted by a sheet.
    #[inline]
    pub(super) fn thin_albedo(&self, wo: Vec3) -> Rgb {
        let reflectance = self.thin_reflectance(wo);
        self.reflection * reflectance + self.transmission * (1.0 - reflectance)
    }

    /// Power reflected and transmitted by a smooth boundary.
    #[inline]
    pub(super) fn albedo(&self, wo: Vec3) -> Rgb {
        let reflectance = fresnel_dielectric(wo.z, wo.x * wo.x + wo.y * wo.y, self.eta).reflectance;
        self.reflection * reflectance + self.transmission * (1.0 - reflectance)
    }
}

/// Microfacets of a dielectric boundary.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RoughDielectric {
    pub(super) facets: Microfacets,
    pub(super) boundary: Boundary,
}

/// A microfacet that refracts `wo` into `wi`.
struct Refraction {
    m: Vec3,
    /// `|wo . m|` and `|wi . m|`.
    cos_o: f32,
    cos_i: f32,
}

impl RoughDielectric {
    /// Roughness of a mirror lobe as wide as what is refracted, at normal incidence; at most that of the boundary. A facet that turns by an angle turns what it reflects by 2 of them, and what it refracts by
    /// `|eta - 1|` of them at most, on the side where the index is less.
    pub(super) fn refracted_alpha(&self) -> f32 {
        let eta = self.boundary.eta;
        self.facets.mean_alpha() * (0.5 * (eta.max(1.0 / eta) - 1.0)).min(1.0)
    }

    #[inline(never)]
    pub(super) fn sample(&self, wo: Vec3, u: f32, u_normal: Vec2, mode: TransportMode) -> Option<BsdfSample> {
        let m = self.facets.sample_visible(wo, u_normal);
        let cos_o = wo.dot(m);
        if cos_o <= 0.0 {
            return None;
        }
        let tangential = wo - cos_o * m;
        let eta = self.boundary.eta;
        let fresnel = fresnel_dielectric(cos_o, tangential.length_squared(), eta);
        // As in the conductor, what leaves on the wrong side has met another facet and is lost.
        if u < fresnel.reflectance {
            let wi = reflect(wo, m, cos_o);
            let weight = self.boundary.reflection * self.facets.masking(wi);
            let pdf = fresnel.reflectance * reflection_pdf(&self.facets, wo, m);
            (wi.z > 0.0).then_some(BsdfSample { wi, weight, pdf, is_delta: false, eta: 1.0 })
        } else {
            // A small eta magnifies the rounding of the tangential part.
            let wi = (-tangential / eta - fresnel.cos_t * m).normalize();
            let weight = self.boundary.transmission
                * (self.boundary.transmission_scale(mode) * self.facets.masking(wi));
            let pdf = self.refraction_pdf(
                wo,
                &Refraction { m, cos_o, cos_i: fresnel.cos_t },
                1.0 - fresnel.reflectance,
            );
            (wi.z < 0.0 && pdf > 0.0).then_some(BsdfSample { wi, weight, pdf, is_delta: false, eta })
        }
    }

    #[inline(never)]
    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Rgb {
        let masking = self.facets.masking_over_cos(wo) * self.facets.masking_over_cos(wi);
        if wi.z > 0.0 {
            let Some(m) = reflection_half_vector(wo, wi) else { return Rgb::ZERO };
            self.boundary.reflection * (self.reflectance(wo, m) * self.facets.d(m) * masking / 4.0)
        } else {
            let Some(r) = self.refraction(wo, wi) else { return Rgb::ZERO };
            let transmittance = dielectric_transmittance(r.cos_o, r.cos_i, self.boundary.eta);
            let f = transmittance * self.facets.d(r.m) * masking * r.cos_o * self.refraction_jacobian(&r);
            self.boundary.transmission * (f * self.boundary.transmission_scale(mode))
        }
    }

    #[inline(never)]
    pub(super) fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        if wi.z > 0.0 {
            let Some(m) = reflection_half_vector(wo, wi) else { return 0.0 };
            self.reflectance(wo, m) * reflection_pdf(&self.facets, wo, m)
        } else {
            let Some(r) = self.refraction(wo, wi) else { return 0.0 };
            self.refraction_pdf(wo, &r, dielectric_transmittance(r.cos_o, r.cos_i, self.boundary.eta))
        }
    }

    #[inline]
    fn reflectance(&self, wo: Vec3, m: Vec3) -> f32 {
        let cos = wo.dot(m);
        fresnel_dielectric(cos, (wo - cos * m).length_squared(), self.boundary.eta).reflectance
    }

    /// The microfacet that refracts `wo` (above) into `wi` (below), if one on the upper side does.
    #[inline]
    fn refraction(&self, wo: Vec3, wi: Vec3) -> Option<Refraction> {
        // Snell's law: the tangential parts of wo and eta wi cancel. The sum points into the denser medium.
        let sum = wo + self.boundary.eta * wi;
        let m = if self.boundary.eta > 1.0 { -sum } else { sum }.try_normalize()?;
        let (cos_o, cos_i) = (wo.dot(m), -wi.dot(m));
        (m.z > 0.0 && cos_o > 0.0 && cos_i > 0.0).then_some(Refraction { m, cos_o, cos_i })
    }

    /// Solid angle of normals per solid angle of `wi`: `eta^2 cos_i / (cos_o - eta cos_i)^2` (Walter et al., eq. 17).
    #[inline]
    fn refraction_jacobian(&self, r: &Refraction) -> f32 {
        // By Snell's law (cos_o - eta cos_i)(cos_o + eta cos_i) = 1 - eta^2, and here nothing cancels.
        let eta = self.boundary.eta;
        let ratio = eta * (r.cos_o + eta * r.cos_i) / ((eta - 1.0) * (eta + 1.0));
        ratio * ratio * r.cos_i
    }

    #[inline]
    fn refraction_pdf(&self, wo: Vec3, r: &Refraction, transmittance: f32) -> f32 {
        transmittance * self.facets.pdf_visible(wo, r.m, r.cos_o) * self.refraction_jacobian(r)
    }
}
