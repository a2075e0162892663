//! Watching paths being made: for AOVs and for `--debug-pixel`.

use crate::query::Ray;
use crate::scene::Rgb;
use crate::transport::vertex::SurfaceVertex;

/// How a contribution came about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Technique {
    /// The path hit a light.
    HitLight,
    /// The path left the scene to the environment.
    HitEnvironment,
    /// A light was sampled from the path's end (next-event estimation).
    SampledLight,
}

/// Is told of each step of a path. Integrators are generic over it, so that not watching costs nothing.
pub trait PathObserver {
    /// `ray` was traced and met `vertex`, or left the scene. `beta` is the throughput up to there; `depth` counts segments from 1.
    fn segment(&mut self, depth: u32, ray: &Ray, vertex: Option<&SurfaceVertex>, beta: Rgb);

    /// Radiance `value`, weighted by `mis_weight` already, reaches the film.
    fn contribution(&mut self, technique: Technique, value: Rgb, mis_weight: f32);
}

/// Watches nothing.
#[derive(Debug, Clone, Copy)]
pub struct Unobserved;

impl PathObserver for Unobserved {
    #[inline]
    fn segment(&mut self, _: u32, _: &Ray, _: Option<&SurfaceVertex>, _: Rgb) {}

    #[inline]
    fn contribution(&mut self, _: Technique, _: Rgb, _: f32) {}
}
