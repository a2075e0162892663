//! The subpath walk: a path extended vertex by vertex, from the camera or from a light.

use super::bsdf::TransportMode;
use super::vertex::{Scatter, SurfaceVertex};
use crate::query::Ray;
use crate::scene::Rgb;

/// The growing end of a subpath.
#[derive(Debug, Clone, Copy)]
pub struct Walk {
    /// What flows along the path.
    pub mode: TransportMode,
    /// The segment that is traced next.
    pub ray: Ray,
    /// Throughput: product of weights over densities so far.
    pub beta: Rgb,
    /// Density per solid angle with which `ray` was drawn at the vertex it leaves.
    pub pdf_w: f32,
    /// Whether `ray` comes from a delta lobe, or from a start that no other technique can make.
    pub is_delta: bool,
    /// Product of squared relative indices along the path: radiance is scaled by its inverse inside a dense medium, which is
    /// no loss and must not make Russian roulette end the path.
    pub eta_scale: f32,
}

impl Walk {
    /// Greatest survival probability of Russian roulette, as Mitsuba has it: a path in a scene that absorbs nothing still ends.
    pub const MAX_SURVIVAL: f32 = 0.95;

    /// A walk that starts with `ray` and throughput `beta`.
    #[inline]
    pub fn new(mode: TransportMode, ray: Ray, beta: Rgb) -> Self {
        Self { mode, ray, beta, pdf_w: 1.0, is_delta: true, eta_scale: 1.0 }
    }

    /// Goes on from a vertex in a direction drawn from its BSDF, which is returned. `None` where the path is absorbed.
    #[inline(always)]
    pub fn scatter(&mut self, vertex: &SurfaceVertex, u: [f32; 3]) -> Option<Scatter> {
        let scatter = vertex.scatter(u, self.mode)?;
        self.beta *= scatter.weight;
        self.pdf_w = scatter.pdf_w;
        self.is_delta = scatter.is_delta;
        if self.mode == TransportMode::Radiance {
            self.eta_scale *= scatter.eta * scatter.eta;
        }
        self.ray = Ray::spawn(&vertex.point, scatter.wi);
        (self.beta != Rgb::ZERO).then_some(scatter)
    }

    /// Russian roulette: ends the path with a probability that keeps its throughput near 1. `false` where it ends.
    /// `most` is the greatest probability to go on: [`MAX_SURVIVAL`](Self::MAX_SURVIVAL) but for a few first events.
    #[inline(always)]
    pub fn survives(&mut self, u: f32, most: f32) -> bool {
        let survival = (self.beta.max_element() * self.eta_scale).min(most);
        if u >= survival {
            return false;
        }
        self.beta /= survival;
        true
    }
}
