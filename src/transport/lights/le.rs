//! Starts of light paths, and their densities.

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::{Light, LightId, Lights};
use crate::query::Ray;
use crate::sampling::warp::{
    UNIFORM_SPHERE_PDF, cosine_hemisphere_pdf, square_to_cosine_hemisphere, square_to_disc, square_to_sphere,
};
use crate::scene::{Rgb, SurfacePoint};
use crate::transport::bsdf::Frame;

/// The start of a light path.
#[derive(Debug, Clone, Copy)]
pub struct LeSample {
    /// Which light.
    pub light: LightId,
    /// The path's first ray.
    pub ray: Ray,
    /// Where it starts, for area lights.
    pub point: Option<SurfacePoint>,
    /// Emitted radiance in that direction; intensity for a point or spot light, irradiance for a directional light.
    pub radiance: Rgb,
    /// Cosine between ray and normal; 1 where there is no surface.
    pub cos: f32,
    /// Density of the position per area (of the light, or of the disc that distant light comes through), the choice of the light
    /// included. For a point or spot light the probability of the choice alone.
    pub pdf_position: f32,
    /// Density of the direction per solid angle; 1 for a directional light.
    pub pdf_direction_w: f32,
}

impl LeSample {
    /// What is emitted over its density: the power that the path carries.
    #[inline]
    pub fn power(&self) -> Rgb {
        // One division at a time: the product of both densities may leave the range of f32 sooner.
        self.radiance * (self.cos / self.pdf_direction_w) / self.pdf_position
    }
}

impl Lights<'_> {
    /// Starts a light path: `choice` chooses the light by power, then `position` and `direction` place and aim the ray.
    #[inline]
    pub fn sample_le(&self, choice: f64, position: Vec2, direction: Vec2) -> Option<LeSample> {
        let (id, light, choice) = self.choose(choice)?;
        match light {
            Light::Point { position: p, intensity } => Some(LeSample {
                light: id,
                ray: Ray::new(p, square_to_sphere(direction)),
                point: None,
                radiance: intensity,
                cos: 1.0,
                pdf_position: choice,
                pdf_direction_w: UNIFORM_SPHERE_PDF,
            }),
            Light::Spot(spot) => {
                let spot = &self.spots[spot as usize];
                let d = spot.sample(direction);
                Some(LeSample {
                    light: id,
                    ray: Ray::new(spot.position, d),
                    point: None,
                    radiance: spot.intensity(d),
                    cos: 1.0,
                    pdf_position: choice,
                    pdf_direction_w: spot.pdf_w(d),
                })
            }
            Light::Directional { direction: d, irradiance } => Some(LeSample {
                light: id,
                ray: self.distant_ray(d, position),
                point: None,
                radiance: irradiance,
                cos: 1.0,
                pdf_position: choice * self.distant_position_pdf(),
                pdf_direction_w: 1.0,
            }),
            Light::Environment => {
                let (_, environment) = self.environment.as_ref()?;
                let towards = environment.sample(direction);
                let pdf_direction_w = environment.pdf_w(towards);
                (pdf_direction_w > 0.0).then_some(LeSample {
                    light: id,
                    ray: self.distant_ray(-towards, position),
                    point: None,
                    radiance: environment.le(towards),
                    cos: 1.0,
                    pdf_position: choice * self.distant_position_pdf(),
                    pdf_direction_w,
                })
            }
            Light::Triangle { .. } | Light::Rectangle(_) | Light::Analytic { .. } => {
                let point = self.sample_area_light_uniformly(light, position)?;
                let local = square_to_cosine_hemisphere(direction);
                let d = Frame::from_z(point.ng).to_world(local);
                let radiance = self.le(&point, d);
                (radiance != Rgb::ZERO).then(|| LeSample {
                    light: id,
                    ray: Ray::spawn(&point, d),
                    point: Some(point),
                    radiance,
                    cos: local.z,
                    pdf_position: choice * self.inverse_areas[id.0 as usize],
                    pdf_direction_w: cosine_hemisphere_pdf(local.z),
                })
            }
        }
    }

    /// A ray in direction `d` through the bounding sphere, from outside it.
    #[inline]
    fn distant_ray(&self, d: Vec3, position: Vec2) -> Ray {
        let disc = square_to_disc(position) * self.bounds.radius;
        let o = self.bounds.center + Frame::from_z(d).to_world(disc.extend(-self.bounds.radius));
        Ray::new(o, d)
    }

    /// Density per area across its direction with which distant light is placed.
    #[inline]
    fn distant_position_pdf(&self) -> f32 {
        FRAC_1_PI / (self.bounds.radius * self.bounds.radius)
    }

    /// The densities of [`sample_le`](Self::sample_le), position then direction, for a path that leaves `light` in direction `d`.
    /// `ng` is the normal where it leaves an area light.
    #[inline]
    pub fn pdf_le(&self, light: LightId, ng: Option<Vec3>, d: Vec3) -> (f32, f32) {
        let choice = self.choice_pdf(light);
        let inverse_area = self.inverse_areas[light.0 as usize];
        match (self.all[light.0 as usize], ng) {
            (Light::Point { .. }, _) => (choice, UNIFORM_SPHERE_PDF),
            (Light::Spot(spot), _) => (choice, self.spots[spot as usize].pdf_w(d)),
            (Light::Directional { .. }, _) => (choice * self.distant_position_pdf(), 1.0),
            (Light::Environment, _) => {
                let pdf_w = self.environment.as_ref().map_or(0.0, |(_, environment)| environment.pdf_w(-d));
                (choice * self.distant_position_pdf(), pdf_w)
            }
            (_, Some(ng)) => (choice * inverse_area, cosine_hemisphere_pdf(ng.dot(d))),
            (_, None) => (0.0, 0.0),
        }
    }

    /// How much denser light paths that start at `light` in direction `d` are at the point `at` than places on the light that are sampled from
    /// there with density `pdf_li`: the quotient of both densities of this segment, per area across `d` at `at`.
    /// `ng` is the normal where the path leaves an area light.
    #[inline]
    pub fn le_over_li(&self, light: LightId, ng: Option<Vec3>, d: Vec3, at: Vec3, pdf_li: f32) -> f64 {
        let (pdf_position, pdf_direction_w) = self.pdf_le(light, ng, d);
        // Area per solid angle seen from `at` over area per solid angle seen from the light; the squared distance cancels unless
        // there is no area.
        let spread = match self.all[light.0 as usize] {
            Light::Point { position, .. } => at.distance_squared(position),
            Light::Spot(spot) => at.distance_squared(self.spots[spot as usize].position),
            Light::Directional { .. } | Light::Environment => 1.0,
            Light::Triangle { .. } | Light::Rectangle(_) | Light::Analytic { .. } => {
                ng.map_or(1.0, |ng| ng.dot(d).abs())
            }
        };
        f64::from(pdf_position) * f64::from(pdf_direction_w) / (f64::from(pdf_li) * f64::from(spread))
    }
}
