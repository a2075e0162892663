//! Watching paths being made: for AOVs, for `--debug-pixel` and for the images of single strategies.

use std::fmt;

use glam::Vec2;

use crate::query::Ray;
use crate::scene::Rgb;
use crate::transport::bsdf::TransportMode;
use crate::transport::vertex::SurfaceVertex;

/// How a path was made: `s` of its vertices from the light, `t` from the camera, the lens and the point on the light included. The
/// path has `s + t - 1` segments.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Strategy {
    /// Vertices of the light subpath.
    pub s: u32,
    /// Vertices of the eye subpath.
    pub t: u32,
}

impl fmt::Display for Strategy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let what = match self {
            Self { s: 0, .. } => "hits a light",
            Self { t: 0, .. } => "hits the lens",
            Self { t: 1, .. } => "samples the lens",
            Self { s: 1, .. } => "samples a light",
            _ => "connects the subpaths",
        };
        write!(f, "{what} (s = {}, t = {})", self.s, self.t)
    }
}

/// Is told of each step of a path. Integrators are generic over it, so that not watching costs nothing.
pub trait PathObserver {
    /// `ray` was traced and met `vertex` after `t`, or left the scene. `mode` tells eye subpaths (radiance) from light subpaths (importance);
    /// `beta` is the throughput up to there; `depth` counts segments from 1.
    fn segment(
        &mut self,
        mode: TransportMode,
        depth: u32,
        ray: &Ray,
        hit: Option<(&SurfaceVertex, f32)>,
        beta: Rgb,
    );

    /// `value` times `mis_weight` reaches the film: at a position in pixels, or as a part of the pixel's own sample.
    fn contribution(&mut self, strategy: Strategy, film: Option<Vec2>, value: Rgb, mis_weight: f32);
}

/// Watches nothing.
#[derive(Debug, Clone, Copy)]
pub struct Unobserved;

impl PathObserver for Unobserved {
    #[inline]
    fn segment(&mut self, _: TransportMode, _: u32, _: &Ray, _: Option<(&SurfaceVertex, f32)>, _: Rgb) {}

    #[inline]
    fn contribution(&mut self, _: Strategy, _: Option<Vec2>, _: Rgb, _: f32) {}
}
