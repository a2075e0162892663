//! A vertex of a path on a surface: the surface point, its BSDF, and where the path came from.

use glam::Vec3;

use super::bsdf::{Bsdf, Frame, Materials, TransportMode};
use super::mis::Turn;
use crate::query::{Hit, Ray};
use crate::scene::{Rgb, SurfacePoint};

/// A surface vertex. Immutable once made.
#[derive(Debug, Clone, Copy)]
pub struct SurfaceVertex<'s> {
    /// Where.
    pub point: SurfacePoint,
    /// Shading frame.
    pub frame: Frame,
    /// What it is made of there.
    pub bsdf: Bsdf<'s>,
    /// Unit direction towards the vertex before, world space.
    pub wo: Vec3,
    /// The same in the shading frame.
    wo_local: Vec3,
}

/// A continuation of a path drawn from a vertex's BSDF.
#[derive(Debug, Clone, Copy)]
pub struct Scatter {
    /// Unit direction in which the path goes on, world space.
    pub wi: Vec3,
    /// BSDF times cosine over density: the factor on the throughput.
    pub weight: Rgb,
    /// Density of `wi` per solid angle, or the probability of the delta lobe that was chosen.
    pub pdf_w: f32,
    /// Whether a delta lobe was chosen.
    pub is_delta: bool,
    /// Index of refraction of the side that `wi` goes to, over that of the side it came from.
    pub eta: f32,
}

/// A vertex's answer to a direction that something else chose.
#[derive(Debug, Clone, Copy)]
pub struct Evaluation {
    /// BSDF times cosine, as of [`SurfaceVertex::eval`].
    pub f: Rgb,
    /// Density per solid angle of that direction, as of [`SurfaceVertex::pdf_w`].
    pub pdf_w: f32,
    /// Density per solid angle of the way back, as of [`SurfaceVertex::pdf_rev_w`].
    pub pdf_rev_w: f32,
}

impl<'s> SurfaceVertex<'s> {
    /// The vertex where `ray` hits a surface.
    #[inline(always)]
    pub fn new(materials: &'s Materials<'s>, hit: &Hit, ray: &Ray) -> Self {
        let scene = materials.scene();
        let point = hit.surface(&scene.shapes, ray);
        let material = scene.shapes[hit.shape as usize].part(hit.primitive).0.material;
        let bsdf = Bsdf::new(materials, material, &point, point.ns.dot(ray.d) < 0.0);
        let tangent = if bsdf.is_anisotropic() { point.dp_du(&scene.shapes) } else { None };
        let frame = match tangent {
            None => Frame::from_z(point.ns),
            Some(tangent) => Frame::from_z_and_tangent(point.ns, tangent),
        };
        Self { point, frame, bsdf, wo: -ray.d, wo_local: frame.to_local(-ray.d) }
    }

    /// Whether `wi` is on the same side of the geometric and of the shading surface. Where it is not, light would
    /// leak through the surface; such directions scatter nothing (Veach 1997, section 5.3).
    #[inline(always)]
    fn sides_agree(&self, w: Vec3, local: Vec3) -> bool {
        self.point.ng.dot(w) * local.z > 0.0
    }

    /// BSDF times cosine for the path that goes on in direction `wi`, world space. When importance is carried by light's own direction
    /// of travel ([`TransportMode::Importance`]), the cosine is corrected for shading normals (Veach 1997, eq. 5.19).
    #[inline(always)]
    pub fn eval(&self, wi: Vec3, mode: TransportMode) -> Rgb {
        let wi_local = self.frame.to_local(wi);
        if !self.sides_agree(wi, wi_local) || !self.sides_agree(self.wo, self.wo_local) {
            return Rgb::ZERO;
        }
        let cos = wi_local.z.abs() * self.correction(wi, wi_local, mode);
        self.bsdf.eval(self.wo_local, wi_local, mode) * cos
    }

    /// The BSDF alone, without the cosine, for radiance from direction `wi`.
    #[inline]
    pub fn bsdf_value(&self, wi: Vec3) -> Rgb {
        let wi_local = self.frame.to_local(wi);
        if !self.sides_agree(wi, wi_local) || !self.sides_agree(self.wo, self.wo_local) {
            return Rgb::ZERO;
        }
        self.bsdf.eval(self.wo_local, wi_local, TransportMode::Radiance)
    }

    /// Factor on power that arrives from `wo`, to be used with [`bsdf_value`](Self::bsdf_value). The surface catches flux by the cosine with its geometric
    /// normal and scatters it by that with its shading normal; the factor is the quotient of both.
    #[inline]
    pub fn incidence_correction(&self) -> f32 {
        if self.point.ng == self.point.ns {
            1.0
        } else {
            (self.wo_local.z / self.wo.dot(self.point.ng)).abs()
        }
    }

    /// Density per solid angle with which [`scatter`](Self::scatter) draws `wi`; without delta lobes.
    #[inline(always)]
    pub fn pdf_w(&self, wi: Vec3, mode: TransportMode) -> f32 {
        self.bsdf.pdf(self.wo_local, self.frame.to_local(wi), mode)
    }

    /// Density per solid angle with which a path that comes from `wi` and carries the other quantity would have gone on to `wo`; without
    /// delta lobes.
    #[inline]
    pub fn pdf_rev_w(&self, wi: Vec3, mode: TransportMode) -> f32 {
        self.bsdf.pdf(self.frame.to_local(wi), self.wo_local, mode.other())
    }

    /// [`eval`](Self::eval) with the densities both ways; `None` where nothing is scattered.
    #[inline]
    pub fn evaluate(&self, wi: Vec3, mode: TransportMode) -> Option<Evaluation> {
        let wi_local = self.frame.to_local(wi);
        if !self.sides_agree(wi, wi_local) || !self.sides_agree(self.wo, self.wo_local) {
            return None;
        }
        let f = self.bsdf.eval(self.wo_local, wi_local, mode);
        if f == Rgb::ZERO {
            return None;
        }
        Some(Evaluation {
            f: f * (wi_local.z.abs() * self.correction(wi, wi_local, mode)),
            pdf_w: self.bsdf.pdf(self.wo_local, wi_local, mode),
            pdf_rev_w: self.bsdf.pdf(wi_local, self.wo_local, mode.other()),
        })
    }

    /// What weights need to know of a scattering event. `cos_in` is [`cos`](Self::cos) of `wo`.
    #[inline]
    pub fn turn(&self, cos_in: f32, scatter: &Scatter, mode: TransportMode) -> Turn {
        let Scatter { wi, pdf_w, is_delta, eta, .. } = *scatter;
        let pdf_rev_w = if is_delta { 0.0 } else { self.pdf_rev_w(wi, mode) };
        Turn { cos_in, cos_out: self.cos(wi), pdf_w, pdf_rev_w, is_delta, eta }
    }

    /// Absolute cosine between a direction and the geometric normal.
    #[inline]
    pub fn cos(&self, w: Vec3) -> f32 {
        self.point.ng.dot(w).abs()
    }

    /// Draws a direction in which the path goes on. `None` where it ends.
    #[inline(always)]
    pub fn scatter(&self, u: [f32; 3], mode: TransportMode) -> Option<Scatter> {
        if !self.sides_agree(self.wo, self.wo_local) {
            return None;
        }
        let sample = self.bsdf.sample(self.wo_local, u, mode)?;
        let wi = self.frame.to_world(sample.wi);
        if !self.sides_agree(wi, sample.wi) {
            return None;
        }
        let weight = sample.weight * self.correction(wi, sample.wi, mode);
        Some(Scatter { wi, weight, pdf_w: sample.pdf, is_delta: sample.is_delta, eta: sample.eta })
    }

    /// Fraction of the light that is scattered; see [`Bsdf::albedo`].
    pub fn albedo(&self) -> Rgb {
        self.bsdf.albedo(self.wo_local)
    }

    /// What the adjoint of a BSDF with a shading normal has over the BSDF itself; 1 for radiance and on flat surfaces.
    #[inline(always)]
    fn correction(&self, wi: Vec3, wi_local: Vec3, mode: TransportMode) -> f32 {
        if mode == TransportMode::Radiance || self.point.ng == self.point.ns {
            return 1.0;
        }
        let (wo_ng, wi_ng) = (self.wo.dot(self.point.ng), wi.dot(self.point.ng));
        ((self.wo_local.z * wi_ng) / (wo_ng * wi_local.z)).abs()
    }
}
