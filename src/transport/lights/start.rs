//! The start of a light path as a light of its own: what points see of it. For virtual point lights that stand for the lights themselves.

use super::area::AreaPdf;
use super::li::point_li;
use super::{LeSample, LiSample, Light, Lights};
use crate::query::Ray;
use crate::scene::{Rgb, SurfacePoint};

impl Lights<'_> {
    /// What `from` sees of the start of a light path, as if [`sample_li`](Self::sample_li) had drawn it with the density that the path had:
    /// `radiance / pdf_w` has the mean that light sampling has. `None` where the start sends nothing this way.
    pub fn li_of_start(&self, start: &LeSample, from: &SurfacePoint) -> Option<LiSample> {
        let (light, choice) = (start.light, self.choice_pdf(start.light));
        let distant = |wi, pdf_w| {
            let (radiance, shadow_ray) = (start.radiance, Ray::spawn(from, wi));
            LiSample { light, wi, radiance, pdf_w, is_delta: true, ng: None, shadow_ray }
        };
        match self.all[light.0 as usize] {
            Light::Point { position, intensity } => point_li(light, from, position, choice, |_| intensity),
            Light::Spot(spot) => {
                let spot = &self.spots[spot as usize];
                point_li(light, from, spot.position, choice, |d| spot.intensity(d))
            }
            Light::Directional { .. } => Some(distant(-start.ray.d, choice)),
            Light::Environment => Some(distant(-start.ray.d, choice * start.pdf_direction_w)),
            Light::Triangle { .. } | Light::Rectangle(_) | Light::Analytic { .. } => {
                let point = start.point.as_ref()?;
                let shadow_ray = Ray::spawn_between(from, point)?;
                let wi = shadow_ray.d;
                let radiance = self.le(point, -wi);
                let pdf_w = AreaPdf::Area(start.pdf_position).per_solid_angle(from.p, point, wi);
                let is_seen = radiance != Rgb::ZERO && pdf_w > 0.0;
                is_seen.then_some(LiSample {
                    light,
                    wi,
                    radiance,
                    pdf_w,
                    is_delta: true,
                    ng: Some(point.ng),
                    shadow_ray,
                })
            }
        }
    }
}
