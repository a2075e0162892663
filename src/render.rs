//! The driver: runs passes of an integrator on all threads of the current rayon pool, adds them to a film, and knows
//! when to stop. It does not open files and does not print.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use glam::{IVec2, Vec2};
use rayon::prelude::*;

use crate::film::{AovRecord, Film, FilmError, Sample};
use crate::integrators::{Integrator, PathObserver, Technique, Unobserved};
use crate::query::{Ray, RayQuery};
use crate::sampling::Sampler;
use crate::scene::Rgb;
use crate::transport::World;
use crate::transport::vertex::SurfaceVertex;

/// What is rendered, apart from the scene: all that a pass is a function of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// The algorithm.
    pub integrator: Integrator,
    /// Images with different seeds are independent.
    pub seed: u64,
}

/// How long to go on.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stop {
    /// Passes to render; those that the film holds already are left out.
    pub passes: Range<u32>,
    /// No pass begins later than this.
    pub time: Option<Duration>,
}

/// How far a render is.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Progress {
    /// Passes rendered by this call.
    pub passes: u32,
    /// Rays traced by this call, closest-hit and occlusion.
    pub rays: u64,
    /// Time since this call began.
    pub elapsed: Duration,
}

/// Whether a render goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Control {
    /// Go on.
    Continue,
    /// Stop; the film holds whole passes only.
    Stop,
}

/// One camera sample.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelSample {
    /// Where in the pixel, and the radiance along its path.
    pub sample: Sample,
    /// Rays traced.
    pub rays: u32,
}

/// Dimension set of film position and lens point.
const CAMERA_SET: u32 = 0;

/// Renders passes into the film until `stop` or `progress` says so, which is called after each.
///
/// # Errors
/// If the film has no memory for a pass.
pub fn render<Q: RayQuery>(
    world: &World,
    query: &Q,
    target: &Target,
    film: &mut Film,
    stop: &Stop,
    mut progress: impl FnMut(&Progress) -> Control,
) -> Result<Progress, FilmError> {
    let start = Instant::now();
    let mut done = Progress::default();
    let mut samples = film.new_pass();
    for pass in stop.passes.clone() {
        if film.passes().contains(pass) {
            continue;
        }
        if stop.time.is_some_and(|limit| done.passes > 0 && start.elapsed() >= limit) {
            break;
        }
        let rays = AtomicU64::new(0);
        samples.par_bands_mut().for_each(|mut band| {
            let mut band_rays = 0;
            band.for_each(|pixel, sample, record| {
                let made = match record {
                    Some(record) => {
                        let mut first = FirstHit(record);
                        sample_pixel(world, query, target, pixel, pass, &mut first)
                    }
                    None => sample_pixel(world, query, target, pixel, pass, &mut Unobserved),
                };
                *sample = made.sample;
                band_rays += u64::from(made.rays);
            });
            rays.fetch_add(band_rays, Ordering::Relaxed);
        });
        film.add_pass(pass, Some(&samples), &[])?;
        done.passes += 1;
        done.rays += rays.into_inner();
        done.elapsed = start.elapsed();
        if progress(&done) == Control::Stop {
            break;
        }
    }
    Ok(done)
}

/// The sample of one pixel in one pass: a function of its arguments alone.
#[inline]
pub fn sample_pixel<Q: RayQuery, O: PathObserver>(
    world: &World,
    query: &Q,
    target: &Target,
    pixel: IVec2,
    pass: u32,
    observer: &mut O,
) -> PixelSample {
    // Pixels beyond the film's border have negative coordinates; the bits tell them apart all the same.
    let stream = u64::from(pixel.y as u32) << 32 | u64::from(pixel.x as u32);
    let sampler = Sampler::new(target.seed, stream, pass);
    let [x, y, lens_u, lens_v] = sampler.block(CAMERA_SET);
    let jitter = Vec2::new(x, y);
    let ray = world.camera.spawn_ray(pixel.as_vec2() + jitter, Vec2::new(lens_u, lens_v));
    let (radiance, rays) = match target.integrator {
        Integrator::Backward(backward) => backward.radiance(world, query, ray, &sampler, observer),
    };
    PixelSample { sample: Sample { jitter, radiance }, rays }
}

/// Fills an AOV record with the first surface that a path meets.
struct FirstHit<'r>(&'r mut AovRecord);

impl PathObserver for FirstHit<'_> {
    fn segment(&mut self, depth: u32, ray: &Ray, vertex: Option<&SurfaceVertex>, _: Rgb) {
        if depth != 1 {
            return;
        }
        *self.0 = match vertex {
            Some(vertex) => AovRecord {
                shape: vertex.point.shape,
                primitive: vertex.point.primitive,
                depth: vertex.point.p.distance(ray.o),
                position: vertex.point.p,
                ng: vertex.point.ng,
                ns: vertex.point.ns,
                albedo: vertex.albedo(),
                uv: vertex.point.uv,
            },
            None => AovRecord::MISS,
        };
    }

    fn contribution(&mut self, _: Technique, _: Rgb, _: f32) {}
}
