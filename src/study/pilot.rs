//! Short renders of a few pixels: how much light each class of paths carries, and how noisy an integrator is for its cost.
//!
//! A pilot depends on scene, integrator and constants only, not on time or threads: cost is counted in rays. Its film is small, so that each
//! pixel sees a part of the scene that is larger than those of the real film; noise within the pixel is a little overestimated, for all integrators alike.
//!
//! Noise is the spread between *groups* of passes that have seeds of their own: groups are independent, as passes of one Sobol' sequence are not, and have the
//! benefit of its even spread.

use glam::{IVec2, UVec2, Vec2};
use rayon::prelude::*;

use crate::film::SampledArea;
use crate::integrators::{Integrator, Pass, PathObserver, Scratch, Strategy, TooManyStored};
use crate::query::RayQuery;
use crate::render::{sample_pixel, trace_light_path};
use crate::scene::requirements::{Events, PathClass};
use crate::scene::{Rgb, luminance};
use crate::transport::World;
use crate::transport::bsdf::TransportMode;
use crate::transport::vertex::SurfaceVertex;
use crate::transport::walk::Walk;

/// Groups of passes; their spread has one degree of freedom less.
pub const GROUPS: u32 = 8;

/// Pixels of a pilot's film, about.
const PIXELS: f32 = 1024.0;

/// Seed of the first group: pilots have random numbers that renders by default have not.
const SEED: u64 = 0x7069_6c6f_7400;

/// A mean and its standard error.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Estimate {
    /// The mean.
    pub mean: f64,
    /// Its standard error, from [`GROUPS`] groups.
    pub error: f64,
}

impl Estimate {
    fn of(groups: impl Iterator<Item = f64> + Clone) -> Self {
        let n = f64::from(GROUPS);
        let mean = groups.clone().sum::<f64>() / n;
        let spread = groups.map(|v| (v - mean) * (v - mean)).sum::<f64>() / (n - 1.0);
        Self { mean, error: (spread / n).sqrt() }
    }

    /// By how many standard errors of their difference it is greater than another.
    pub fn exceeds_by(&self, other: &Self) -> f64 {
        let difference = self.mean - other.mean;
        if difference == 0.0 { 0.0 } else { difference / self.error.hypot(other.error) }
    }
}

/// What a pilot has found.
#[derive(Debug, Clone)]
pub struct Pilot {
    /// Luminance of each pixel.
    pub pixels: Vec<Estimate>,
    /// Mean luminance of the image.
    pub total: Estimate,
    /// Mean luminance by class, in the order of [`PathClass::ALL`], of what is made of connected paths; light by photons and virtual lights is not among them.
    pub classes: [Estimate; PathClass::ALL.len()],
    /// Rays per pixel and pass.
    pub rays: f64,
    /// Rays of a pass that all its pixels share, however many those are: of photons and virtual lights.
    pub shared_rays: f64,
    /// Passes of all groups together.
    pub passes: u32,
}

impl Pilot {
    /// The film of pilots for a scene's film: of the same shape, with about a thousand pixels.
    pub fn film_size(film: UVec2) -> UVec2 {
        let film = film.as_vec2();
        let scale = (PIXELS / (film.x * film.y)).sqrt().min(1.0);
        (film * scale).round().as_uvec2().clamp(UVec2::ONE, UVec2::splat(PIXELS as u32))
    }

    /// Renders `passes` passes for each group. The world is that of a film of the given size.
    ///
    /// # Errors
    /// If a pass has too many photons.
    pub fn run<Q: RayQuery>(
        world: &World,
        query: &Q,
        integrator: Integrator,
        size: UVec2,
        passes: u32,
    ) -> Result<Self, TooManyStored> {
        let groups: Vec<Group> = (0..GROUPS)
            .into_par_iter()
            .map(|group| Group::run(world, query, integrator, size, SEED + u64::from(group), passes))
            .collect::<Result<_, _>>()?;
        let count = (size.x * size.y) as usize;
        let of = |value: &dyn Fn(&Group) -> f64| {
            Estimate::of(groups.iter().map(value).collect::<Vec<_>>().into_iter())
        };
        let samples = f64::from(passes) * count as f64;
        Ok(Self {
            pixels: (0..count).map(|i| of(&|g| g.pixels[i] / f64::from(passes))).collect(),
            total: of(&|g| g.pixels.iter().sum::<f64>() / samples),
            classes: std::array::from_fn(|c| of(&|g| g.classes[c] / samples)),
            rays: groups.iter().map(|g| g.rays as f64).sum::<f64>() / (samples * f64::from(GROUPS)),
            shared_rays: groups.iter().map(|g| g.shared_rays as f64).sum::<f64>()
                / f64::from(passes * GROUPS),
            passes: passes * GROUPS,
        })
    }

    /// Mean over pixels of the variance that one pass would have, relative to the squared luminance in `reference`. As in relMSE, dark pixels are
    /// compared with a constant: half the mean, which for images of mean 0.2 is relMSE's 0.1.
    pub fn relative_variance(&self, reference: &[f64]) -> f64 {
        let mean = reference.iter().sum::<f64>() / reference.len() as f64;
        let relative =
            |(pixel, r): (&Estimate, &f64)| pixel.error * pixel.error / (r * r + 0.25 * mean * mean);
        let sum: f64 = self.pixels.iter().zip(reference).map(relative).sum();
        if mean > 0.0 { sum * f64::from(self.passes) / reference.len() as f64 } else { 0.0 }
    }
}

/// Sums over the passes of a group.
struct Group {
    pixels: Vec<f64>,
    classes: [f64; PathClass::ALL.len()],
    rays: u64,
    shared_rays: u64,
}

impl Group {
    fn run<Q: RayQuery>(
        world: &World,
        query: &Q,
        integrator: Integrator,
        size: UVec2,
        seed: u64,
        passes: u32,
    ) -> Result<Self, TooManyStored> {
        let area = SampledArea { min: IVec2::ZERO, size };
        let mut pixels = vec![0.0; (size.x * size.y) as usize];
        let mut add = |x: u32, y: u32, radiance: Rgb| {
            let value = f64::from(luminance(radiance));
            if value.is_finite() {
                pixels[(y * size.x + x) as usize] += value;
            }
        };
        let (mut classes, mut rays, mut shared_rays) = (Classes::default(), 0, 0);
        for index in 0..passes {
            let pass = Pass::new(world, query, integrator, seed, index, area)?;
            let mut scratch = Scratch::default();
            for (x, y) in (0..size.y).flat_map(|y| (0..size.x).map(move |x| (x, y))) {
                let pixel = UVec2::new(x, y).as_ivec2();
                if integrator.only_splats() {
                    trace_light_path(&pass, integrator, pass.slot(pixel), &mut scratch, &mut classes);
                } else {
                    add(x, y, sample_pixel(&pass, integrator, pixel, &mut scratch, &mut classes).radiance);
                }
                for splat in scratch.splats.drain(..) {
                    let at = splat.position.as_uvec2().min(size - 1);
                    add(at.x, at.y, splat.radiance);
                }
            }
            rays += scratch.rays;
            shared_rays += pass.photons.rays + pass.vpls.rays;
        }
        Ok(Self { pixels, classes: classes.sums, rays, shared_rays })
    }
}

/// Sums contributions up by class.
#[derive(Default)]
struct Classes {
    /// Of the present subpaths, the events up to each vertex.
    from_eye: Vec<Events>,
    from_light: Vec<Events>,
    sums: [f64; PathClass::ALL.len()],
}

impl PathObserver for Classes {
    fn segment(&mut self, walk: &Walk, depth: u32, _: Option<&SurfaceVertex>) {
        let events = match walk.mode {
            TransportMode::Radiance => &mut self.from_eye,
            TransportMode::Importance => &mut self.from_light,
        };
        // What a ray left by is known once it is traced. The first leaves the camera or the light.
        events.truncate(depth as usize - 1);
        let before = events.last().copied();
        events.push(before.map_or_else(Events::default, |before| before.then(walk.is_delta)));
    }

    fn contribution(&mut self, strategy: Strategy, _: Option<Vec2>, value: Rgb, mis_weight: f32) {
        // Segment number n, counted from 0, knows the events at the first n surfaces of its subpath. A vertex that is connected is no delta event.
        let walked = |events: &[Events], vertices: u32| match vertices {
            0 | 1 => Events::default(),
            n => events.get(n as usize - 2).copied().unwrap_or_default(),
        };
        let connected =
            |events: Events, vertices: u32| if vertices < 2 { events } else { events.then(false) };
        let Strategy { s, t } = strategy;
        let (eye, light) = (walked(&self.from_eye, t), walked(&self.from_light, s));
        let class = match (s, t) {
            (0, _) => PathClass::of(Events::default(), eye),
            (_, 0) => PathClass::of(light, Events::default()),
            _ => PathClass::of(connected(light, s), connected(eye, t)),
        };
        let value = f64::from(luminance(value * mis_weight));
        if value.is_finite() {
            self.sums[class as usize] += value;
        }
    }
}
