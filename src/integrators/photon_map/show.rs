//! Photons as dots: `show=photons`.

use std::f32::consts::FRAC_1_PI;

use glam::Vec2;

use super::super::pass::{Pass, Scratch};
use super::PhotonMapper;
use crate::film::Splat;
use crate::query::{Ray, RayQuery};

/// Dimension set of the lens point, beyond those of the photon's path.
const LENS_SET: u32 = 1 << 20;

/// What lies nearer to a photon than this, in distances from the camera, does not hide it. A photon knows where it lies, but not how
/// exactly.
const HIDING: f32 = 1e-4;

impl PhotonMapper {
    /// Splats the photon of an index if the camera sees the side of the surface that it came to: what a white diffuse surface would scatter of it.
    pub fn show_photon<Q: RayQuery>(&self, pass: &Pass<Q>, index: usize, scratch: &mut Scratch) {
        let Some(photon) = pass.photons.map.photons().get(index) else { return };
        let camera = &pass.world.camera;
        let [x, y, ..] = pass.light_sampler(index as u64, u64::from(self.photons)).block(LENS_SET);
        let Some(connection) = camera.sample_wi(photon.position, Vec2::new(x, y)) else { return };
        let ng = photon.ng();
        let cos = -connection.d.dot(ng);
        if cos * photon.wi().dot(ng) <= 0.0 || !pass.is_sampled(connection.film) {
            return;
        }
        let distance = connection.p.distance(photon.position);
        let t_max = distance * (1.0 - HIDING);
        scratch.rays += 1;
        if pass.query.occluded(&Ray {
            t_min: connection.t_min,
            t_max,
            ..Ray::new(connection.p, connection.d)
        }) {
            return;
        }
        // Density per area across the ray of the camera rays of a pixel.
        let seen = connection.importance * connection.cos * camera.lens_area() / (distance * distance);
        let radiance = photon.power * (FRAC_1_PI * cos.abs() * seen);
        scratch.splats.push(Splat { position: connection.film, radiance });
    }
}
