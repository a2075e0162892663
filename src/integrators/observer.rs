//! Watching paths being made: for AOVs, for `--debug-pixel` and for the images of single strategies.

use std::fmt;

use glam::Vec2;

use crate::scene::Rgb;
use crate::transport::vertex::SurfaceVertex;
use crate::transport::walk::Walk;

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
    /// The walk's ray was traced and met `vertex`, or left the scene. Its mode tells eye subpaths (radiance) from light subpaths (importance);
    /// its throughput is that up to there; `depth` counts segments from 1.
    fn segment(&mut self, walk: &Walk, depth: u32, vertex: Option<&SurfaceVertex>);

    /// `value` times `mis_weight` reaches the film: at a position in pixels, or as a part of the pixel's own sample.
    fn contribution(&mut self, strategy: Strategy, film: Option<Vec2>, value: Rgb, mis_weight: f32);
}

/// Watches nothing.
#[derive(Debug, Clone, Copy)]
pub struct Unobserved;

impl PathObserver for Unobserved {
    #[inline]
    fn segment(&mut self, _: &Walk, _: u32, _: Option<&SurfaceVertex>) {}

    #[inline]
    fn contribution(&mut self, _: Strategy, _: Option<Vec2>, _: Rgb, _: f32) {}
}
