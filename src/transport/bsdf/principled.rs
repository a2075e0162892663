//! Disney's "principled" model (Burley 2012, "Physically based shading at Disney"; Burley 2015, "Extending the Disney BRDF to a BSDF
//! with integrated subsurface scattering") in Mitsuba's reading of it. Sees `wo` with `wo.z` > 0.
//!
//! A mixture of a diffuse lobe with retro-reflection and sheen, a GGX lobe that reflects and refracts, and a clearcoat. It is made
//! for looks: sheen and the diffuse lobe at grazing angles may reflect more than arrives.

use glam::{Vec2, Vec3};
use std::f32::consts::FRAC_1_PI;

use super::conductor::{reflection_half_vector, reflection_pdf};
use super::dielectric::{Boundary, RoughDielectric};
use super::fresnel::fresnel_dielectric;
use super::microfacet::Microfacets;
use super::{BsdfSample, TransportMode, reflect};
use crate::sampling::warp::{cosine_hemisphere_pdf, square_to_cosine_hemisphere};
use crate::scene::{Input, Microfacet, Place, Principled, Rgb, Textures, luminance};

/// Least roughness of the main lobe.
const MIN_ALPHA: f32 = 1e-3;
/// Roughness of the clearcoat's masking.
const CLEARCOAT_MASKING: f32 = 0.25;

/// All parameters at a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct PrincipledLobe {
    base: Rgb,
    roughness: f32,
    flatness: f32,
    metallic: f32,
    spec_tint: f32,
    sheen: f32,
    sheen_tint: f32,
    clearcoat: f32,
    clearcoat_alpha: f32,
    /// Weights of the opaque dielectric and of the transparent one.
    brdf: f32,
    bsdf: f32,
    /// The boundary that transmits; its reflection is that of the inside.
    rough: RoughDielectric,
    is_above: bool,
}

impl PrincipledLobe {
    pub(super) fn new(p: &Principled, textures: Textures, place: Place, is_above: bool) -> Self {
        let at = |input: Input<f32>| input.at(textures, place).clamp(0.0, 1.0);
        let base = p.base_color.at(textures, place).clamp(Rgb::ZERO, Rgb::ONE);
        let (roughness, metallic, spec_trans) = (at(p.roughness), at(p.metallic), at(p.spec_trans));
        let aspect = (1.0 - 0.9 * at(p.anisotropic)).sqrt();
        let alpha = [roughness * roughness / aspect, roughness * roughness * aspect];
        let facets = Microfacets::new(Microfacet::Ggx, alpha, MIN_ALPHA);
        let bsdf = (1.0 - metallic) * spec_trans;
        // Without a change of index nothing would be refracted.
        let eta = if p.eta == 1.0 && bsdf > 0.0 { 1.001 } else { p.eta };
        let boundary =
            Boundary { eta, reflection: Rgb::splat(bsdf), transmission: base.map(f32::sqrt) * bsdf };
        let boundary = if is_above { boundary } else { boundary.turned_over() };
        Self {
            base,
            roughness,
            flatness: at(p.flatness),
            metallic,
            spec_tint: at(p.spec_tint),
            sheen: at(p.sheen),
            sheen_tint: at(p.sheen_tint),
            clearcoat: at(p.clearcoat),
            clearcoat_alpha: 0.1 + (0.001 - 0.1) * at(p.clearcoat_gloss),
            brdf: (1.0 - metallic) * (1.0 - spec_trans),
            bsdf,
            rough: RoughDielectric { facets, boundary },
            is_above,
        }
    }

    /// Unnormalised probabilities of the diffuse lobe and the clearcoat; that of the main lobe is 1.
    fn other_probabilities(&self) -> (f32, f32) {
        if self.is_above { (self.brdf, 0.25 * self.clearcoat) } else { (0.0, 0.0) }
    }

    /// Of the main lobe, the part that is transmitted where the dielectric transmits `t`.
    fn transmission(&self, t: f32) -> f32 {
        if self.is_above { self.bsdf * t } else { t }
    }

    pub(super) fn sample(
        &self,
        wo: Vec3,
        u: f32,
        u_direction: Vec2,
        mode: TransportMode,
    ) -> Option<BsdfSample> {
        if !self.is_above && self.bsdf == 0.0 {
            return None;
        }
        let (diffuse, clearcoat) = self.other_probabilities();
        let u = u * (1.0 + diffuse + clearcoat);
        let mut eta = 1.0;
        let wi = if u < diffuse {
            square_to_cosine_hemisphere(u_direction)
        } else if u < diffuse + clearcoat {
            let m = sample_gtr1(self.clearcoat_alpha, u_direction);
            reflect(wo, m, wo.dot(m))
        } else {
            let u = (u - diffuse - clearcoat).min(1.0 - f32::EPSILON);
            let m = self.rough.facets.sample_visible(wo, u_direction);
            let cos = wo.dot(m);
            if cos <= 0.0 {
                return None;
            }
            let tangential = wo - cos * m;
            let fresnel = fresnel_dielectric(cos, tangential.length_squared(), self.rough.boundary.eta);
            if u < self.transmission(1.0 - fresnel.reflectance) {
                eta = self.rough.boundary.eta;
                (-tangential / eta - fresnel.cos_t * m).normalize()
            } else {
                reflect(wo, m, cos)
            }
        };
        if (wi.z < 0.0) != (eta != 1.0) {
            return None;
        }
        let pdf = self.pdf(wo, wi);
        let weight = self.eval(wo, wi, mode) * (wi.z.abs() / pdf);
        (pdf > 0.0).then_some(BsdfSample { wi, weight, pdf, is_delta: false, eta })
    }

    pub(super) fn pdf(&self, wo: Vec3, wi: Vec3) -> f32 {
        if !self.is_above && self.bsdf == 0.0 {
            return 0.0;
        }
        let (diffuse, clearcoat) = self.other_probabilities();
        let total = 1.0 + diffuse + clearcoat;
        if wi.z < 0.0 {
            return self.transmission(self.rough.pdf(wo, wi)) / total;
        }
        let Some(m) = reflection_half_vector(wo, wi) else { return 0.0 };
        let cos = wo.dot(m);
        let transmitted = self.transmission(1.0 - self.dielectric(wo, m));
        let main = (1.0 - transmitted) * reflection_pdf(&self.rough.facets, wo, m);
        let coat = clearcoat * gtr1(self.clearcoat_alpha, m.z) * m.z / (4.0 * cos);
        (main + diffuse * cosine_hemisphere_pdf(wi.z) + coat) / total
    }

    pub(super) fn eval(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Rgb {
        if wi.z < 0.0 || !self.is_above {
            return self.rough.eval(wo, wi, mode);
        }
        let Some(m) = reflection_half_vector(wo, wi) else { return Rgb::ZERO };
        let cos = wo.dot(m);
        let facets = &self.rough.facets;
        let mut f = Rgb::ZERO;
        let reflectance = self.dielectric(wo, m);
        // An index of 1 switches the lobe off, whatever else colours it.
        if reflectance > 0.0 {
            let masking = facets.masking_over_cos(wo) * facets.masking_over_cos(wi);
            f += self.main_fresnel(reflectance, cos) * (facets.d(m) * masking / 4.0);
        }
        if self.clearcoat > 0.0 {
            let masking = Microfacets::new(Microfacet::Ggx, [CLEARCOAT_MASKING; 2], 0.0);
            let g = masking.masking(wo) * masking.masking(wi);
            let fresnel = self.schlick(Rgb::splat(0.04), cos).x;
            f += 0.25 * self.clearcoat * fresnel * gtr1(self.clearcoat_alpha, m.z) * g;
        }
        if self.brdf > 0.0 {
            f += self.base * (self.brdf * FRAC_1_PI * self.diffuse(wo.z, wi.z, cos));
            let tint = Rgb::ONE.lerp(self.tint(), self.sheen_tint);
            f += tint * (self.sheen * (1.0 - self.metallic) * schlick_weight(cos));
        }
        f
    }

    /// Reflectance of the dielectric boundary at a microfacet.
    fn dielectric(&self, wo: Vec3, m: Vec3) -> f32 {
        let cos = wo.dot(m);
        fresnel_dielectric(cos, (wo - cos * m).length_squared(), self.rough.boundary.eta).reflectance
    }

    /// Metal, tinted and true dielectric together.
    fn main_fresnel(&self, dielectric: f32, cos: f32) -> Rgb {
        let eta = self.rough.boundary.eta;
        let r0 = ((eta - 1.0) / (eta + 1.0)).powi(2);
        let (metal, tinted) = (self.metallic, (1.0 - self.metallic) * self.spec_tint);
        let plain = (1.0 - self.metallic) * (1.0 - self.spec_tint);
        self.schlick(self.base, cos) * metal
            + self.schlick(self.tint() * r0, cos) * tinted
            + Rgb::splat(plain * dielectric)
    }

    /// Schlick's approximation; from the denser side with the refracted angle.
    fn schlick(&self, r0: Rgb, cos: f32) -> Rgb {
        let eta = self.rough.boundary.eta;
        let cos =
            if eta > 1.0 { cos } else { fresnel_dielectric(cos, (1.0 - cos * cos).max(0.0), eta).cos_t };
        let weight = schlick_weight(cos);
        r0 + (Rgb::ONE - r0) * weight
    }

    /// The hue of the base colour: luminance 1.
    fn tint(&self) -> Rgb {
        let y = luminance(self.base);
        if y > 0.0 { self.base / y } else { Rgb::ONE }
    }

    /// Diffuse reflection with retro-reflection, or flattened (Hanrahan and Krueger), times pi.
    fn diffuse(&self, cos_o: f32, cos_i: f32, cos_d: f32) -> f32 {
        let (f_o, f_i) = (schlick_weight(cos_o), schlick_weight(cos_i));
        let retro = 2.0 * self.roughness * cos_d * cos_d;
        let plain = (1.0 - 0.5 * f_o) * (1.0 - 0.5 * f_i) + retro * (f_o + f_i + f_o * f_i * (retro - 1.0));
        if self.flatness == 0.0 {
            return plain;
        }
        let ss90 = 0.5 * retro;
        let ss = (1.0 + (ss90 - 1.0) * f_o) * (1.0 + (ss90 - 1.0) * f_i);
        let flat = 1.25 * (ss * (1.0 / (cos_o + cos_i) - 0.5) + 0.5);
        plain + (flat - plain) * self.flatness
    }

    /// Whether there is no diffuse lobe, and the main one is narrow; a clearcoat always is. The same seen from either side.
    pub(super) fn is_narrow(&self, alpha: f32) -> bool {
        let main =
            if self.bsdf > 0.0 { self.rough.refracted_alpha() } else { self.rough.facets.mean_alpha() };
        self.brdf == 0.0 && main < alpha
    }

    /// For the albedo AOV: the base colour.
    pub(super) fn albedo(&self) -> Rgb {
        self.base
    }
}

/// `(1 - cos)^5`.
fn schlick_weight(cos: f32) -> f32 {
    (1.0 - cos).clamp(0.0, 1.0).powi(5)
}

/// The clearcoat's distribution of normals, GTR with exponent 1 (Burley 2012, appendix B).
fn gtr1(alpha: f32, cos: f32) -> f32 {
    let a2 = alpha * alpha;
    (a2 - 1.0) * FRAC_1_PI / (a2.ln() * (1.0 + (a2 - 1.0) * cos * cos))
}

/// A normal with density `gtr1 * cos`.
fn sample_gtr1(alpha: f32, u: Vec2) -> Vec3 {
    let a2 = alpha * alpha;
    let cos2 = ((1.0 - a2.powf(1.0 - u.y)) / (1.0 - a2)).clamp(0.0, 1.0);
    let (sin_phi, cos_phi) = (std::f32::consts::TAU * u.x).sin_cos();
    let sin = (1.0 - cos2).sqrt();
    Vec3::new(sin * cos_phi, sin * sin_phi, cos2.sqrt())
}
