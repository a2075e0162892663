//! The driver: runs passes of an integrator on all threads of the current rayon pool, adds them to a film, and knows
//! when to stop. It does not open files and does not print.

use std::borrow::BorrowMut;
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use glam::{IVec2, Vec2};
use rayon::prelude::*;

use crate::film::{AovRecord, Film, FilmError, PassSamples, Sample, Splat};
use crate::integrators::TooManyStored;
use crate::integrators::photon_map::store::{PhotonFileError, PhotonStore};
use crate::integrators::photon_map::{PhotonMapper, Show};
use crate::integrators::{Integrator, Pass, PathObserver, Scratch, Strategy, Unobserved};
use crate::query::{Ray, RayQuery};
use crate::sampling::Sampler;
use crate::scene::Rgb;
use crate::transport::World;
use crate::transport::bsdf::TransportMode;
use crate::transport::vertex::SurfaceVertex;
use crate::transport::walk::Walk;

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
    /// Photons or virtual point lights stored by this call.
    pub photons: u64,
    /// Virtual point lights for whose shadow map there was no room; they are looked at by rays.
    pub without_map: u64,
    /// Time since this call began.
    pub elapsed: Duration,
}

impl Progress {
    /// Adds what another call has done, at a time since the first began.
    pub(crate) fn add(&mut self, other: &Self, elapsed: Duration) {
        self.passes += other.passes;
        self.rays += other.rays;
        self.photons += other.photons;
        self.without_map += other.without_map;
        self.elapsed = elapsed;
    }
}

/// Whether a render goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Control {
    /// Go on.
    Continue,
    /// Stop; the film holds whole passes only.
    Stop,
}

/// Why a render ended before its time.
#[derive(Debug, thiserror::Error)]
pub enum RenderError {
    /// The film has no memory for a pass.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// A pass has too many photons or virtual lights.
    #[error(transparent)]
    TooManyStored(#[from] TooManyStored),
    /// The file that photons come from or go to fails.
    #[error(transparent)]
    PhotonFile(#[from] PhotonFileError),
}

/// Dimension set of film position and lens point.
const CAMERA_SET: u32 = 0;

/// Renders passes into the film until `stop` or `progress` says so, which is called after each.
///
/// # Errors
/// If the film has no memory for a pass, or the pass would need too much of it.
pub fn render<Q: RayQuery>(
    world: &World,
    query: &Q,
    target: &Target,
    film: &mut Film,
    stop: &Stop,
    progress: impl FnMut(&Progress) -> Control,
) -> Result<Progress, RenderError> {
    render_with_store(world, query, target, film, stop, &mut PhotonStore::Traced, progress)
}

/// [`render`], with photons that a file keeps.
///
/// # Errors
/// As of [`render`], and if the file does not have a pass or cannot be read or written.
pub fn render_with_store<Q: RayQuery>(
    world: &World,
    query: &Q,
    target: &Target,
    film: &mut Film,
    stop: &Stop,
    store: &mut PhotonStore,
    progress: impl FnMut(&Progress) -> Control,
) -> Result<Progress, RenderError> {
    render_passes(world, query, target, &Mutex::new(film), stop, store, progress)
}

/// [`render`] into a film that others may look at between passes: it is locked only while a pass is added.
///
/// # Errors
/// As of [`render`].
pub fn render_shared<Q: RayQuery>(
    world: &World,
    query: &Q,
    target: &Target,
    film: &Mutex<Film>,
    stop: &Stop,
    progress: impl FnMut(&Progress) -> Control,
) -> Result<Progress, RenderError> {
    render_passes(world, query, target, film, stop, &mut PhotonStore::Traced, progress)
}

fn render_passes<Q: RayQuery, F: BorrowMut<Film>>(
    world: &World,
    query: &Q,
    target: &Target,
    film: &Mutex<F>,
    stop: &Stop,
    store: &mut PhotonStore,
    mut progress: impl FnMut(&Progress) -> Control,
) -> Result<Progress, RenderError> {
    // Who looked at the film and panicked did not change it.
    let lock = || -> MutexGuard<F> { film.lock().unwrap_or_else(PoisonError::into_inner) };
    let start = Instant::now();
    let mut done = Progress::default();
    let (mut samples, aovs) = {
        let film = lock();
        let film: &Film = (*film).borrow();
        (film.new_pass(), film.aovs())
    };
    let mut pool = Pool::default();
    for index in stop.passes.clone() {
        if (*lock()).borrow().passes().contains(index) {
            continue;
        }
        if stop.time.is_some_and(|limit| done.passes > 0 && start.elapsed() >= limit) {
            break;
        }
        let (integrator, seed, area) = (target.integrator, target.seed, samples.area());
        let pass = match store {
            PhotonStore::Traced | PhotonStore::Saved(_) => {
                Pass::new(world, query, integrator, seed, index, area)?
            }
            PhotonStore::Loaded(file) => {
                Pass::with_photons(world, query, integrator, seed, index, area, file.read(index)?)
            }
        };
        if let PhotonStore::Saved(file) = store {
            file.add(index, &pass.photons.map)?;
        }
        // Rays from the camera are then sent only if an AOV asks what they see.
        let only_splats = integrator.only_splats();
        let with_samples = !only_splats || aovs.needs_records();
        if with_samples {
            sample_pixels(&pass, integrator, &mut samples, &pool);
        }
        if only_splats {
            trace_light_paths(&pass, integrator, &pool);
        }
        let rays = pool.gather() + pass.photons.rays + pass.vpls.rays;
        (*lock()).borrow_mut().add_pass(index, with_samples.then_some(&samples), &pool.splats)?;
        done.passes += 1;
        done.rays += rays;
        done.photons += (pass.photons.map.photons().len() + pass.vpls.len()) as u64;
        done.without_map += pass.vpls.without_map;
        done.elapsed = start.elapsed();
        if progress(&done) == Control::Stop {
            break;
        }
    }
    Ok(done)
}

/// Memory for each thread that works on a pass, kept from pass to pass.
#[derive(Default)]
struct Pool<'w> {
    workspaces: Mutex<Vec<Workspace<'w>>>,
    /// Splats of the last pass, in the order of their tasks.
    splats: Vec<Splat>,
}

/// A thread's memory, with an account of which task made which splats.
#[derive(Default)]
struct Workspace<'w> {
    scratch: Scratch<'w>,
    /// Tasks that made splats, and where these end.
    tasks: Vec<(usize, usize)>,
}

impl<'w> Pool<'w> {
    /// Lends memory to the task of that number.
    fn lend<R>(&self, number: usize, task: impl FnOnce(&mut Scratch<'w>) -> R) -> R {
        // A task that panicked ends the render anyway.
        let lock = || self.workspaces.lock().unwrap_or_else(PoisonError::into_inner);
        let mut workspace = lock().pop().unwrap_or_default();
        let before = workspace.scratch.splats.len();
        let result = task(&mut workspace.scratch);
        let after = workspace.scratch.splats.len();
        if after > before {
            workspace.tasks.push((number, after));
        }
        lock().push(workspace);
        result
    }

    /// Brings the splats of all threads into an order that does not depend on threads. Returns the number of rays traced since the last time.
    fn gather(&mut self) -> u64 {
        let Self { workspaces, splats } = self;
        let workspaces = workspaces.get_mut().unwrap_or_else(PoisonError::into_inner);
        splats.clear();
        let mut parts = Vec::new();
        for Workspace { scratch, tasks } in &*workspaces {
            let mut start = 0;
            for &(number, end) in tasks {
                parts.push((number, &scratch.splats[start..end]));
                start = end;
            }
        }
        parts.sort_unstable_by_key(|(number, _)| *number);
        for (_, part) in parts {
            splats.extend_from_slice(part);
        }
        let clear = |Workspace { scratch, tasks }: &mut Workspace| {
            scratch.splats.clear();
            tasks.clear();
            std::mem::take(&mut scratch.rays)
        };
        workspaces.iter_mut().map(clear).sum()
    }
}

fn sample_pixels<'w, Q: RayQuery>(
    pass: &Pass<'w, '_, Q>,
    integrator: Integrator,
    samples: &mut PassSamples,
    pool: &Pool<'w>,
) {
    samples.par_bands_mut().enumerate().for_each(|(number, mut band)| {
        pool.lend(number, |scratch| {
            band.for_each(|pixel, sample, record| {
                *sample = match record {
                    Some(record) => sample_pixel(pass, integrator, pixel, scratch, &mut FirstHit(record)),
                    None => sample_pixel(pass, integrator, pixel, scratch, &mut Unobserved),
                };
            });
        });
    });
}

/// Light paths that one task traces: enough to make the pool's lock cheap.
const LIGHT_PATHS_PER_TASK: u64 = 256;

fn trace_light_paths<'w, Q: RayQuery>(pass: &Pass<'w, '_, Q>, integrator: Integrator, pool: &Pool<'w>) {
    let count = light_path_count(pass, integrator);
    (0..count.div_ceil(LIGHT_PATHS_PER_TASK)).into_par_iter().for_each(|task| {
        pool.lend(task as usize, |scratch| {
            let first = task * LIGHT_PATHS_PER_TASK;
            for slot in first..(first + LIGHT_PATHS_PER_TASK).min(count) {
                trace_light_path(pass, integrator, slot, scratch, &mut Unobserved);
            }
        });
    });
}

/// Light paths of a pass that [`trace_light_path`] knows.
pub fn light_path_count<Q>(pass: &Pass<Q>, integrator: Integrator) -> u64 {
    match integrator {
        Integrator::PhotonMap(PhotonMapper { show: Show::Photons, .. }) => {
            pass.photons.map.photons().len() as u64
        }
        Integrator::PhotonMap(_) | Integrator::Backward(_) => 0,
        _ => pass.light_paths(),
    }
}

/// The ray that the sample of a pixel begins with, where in the pixel it belongs, and the random numbers of the whole sample.
#[inline]
pub fn camera_ray<Q>(pass: &Pass<Q>, pixel: IVec2) -> (Ray, Vec2, Sampler) {
    let sampler = pass.pixel_sampler(pixel);
    let [x, y, lens_u, lens_v] = sampler.block(CAMERA_SET);
    let jitter = Vec2::new(x, y);
    let ray = pass.world.camera.spawn_ray(pixel.as_vec2() + jitter, Vec2::new(lens_u, lens_v));
    (ray, jitter, sampler)
}

/// The sample of one pixel in one pass: a function of its arguments alone. Splats that come with it go to `scratch`, which also counts the rays.
#[inline]
pub fn sample_pixel<'w, Q: RayQuery, O: PathObserver>(
    pass: &Pass<'w, '_, Q>,
    integrator: Integrator,
    pixel: IVec2,
    scratch: &mut Scratch<'w>,
    observer: &mut O,
) -> Sample {
    let Pass { world, query, .. } = *pass;
    let (ray, jitter, sampler) = camera_ray(pass, pixel);
    let radiance = match integrator {
        Integrator::Backward(backward) => {
            let (radiance, rays) = backward.radiance(world, query, ray, &sampler, observer);
            scratch.rays += u64::from(rays);
            radiance
        }
        Integrator::Forward(_) | Integrator::PhotonMap(PhotonMapper { show: Show::Photons, .. }) => {
            scratch.rays += 1;
            let vertex = query.intersect(&ray).map(|hit| SurfaceVertex::new(&world.materials, &hit, &ray));
            observer.segment(&Walk::new(TransportMode::Radiance, ray, Rgb::ONE), 1, vertex.as_ref());
            Rgb::ZERO
        }
        Integrator::Bidirectional(bidirectional) => {
            bidirectional.sample(pass, pixel, ray, &sampler, scratch, observer)
        }
        Integrator::PhotonMap(mapper) => mapper.sample(pass, ray, &sampler, scratch, observer),
        Integrator::VirtualLights(vpl) => vpl.sample(pass, ray, &sampler, scratch, observer),
    };
    Sample { jitter, radiance }
}

/// One light path of a pass: a function of its arguments alone. Its splats go to `scratch`. Integrators without light paths do nothing.
#[inline]
pub fn trace_light_path<'w, Q: RayQuery, O: PathObserver>(
    pass: &Pass<'w, '_, Q>,
    integrator: Integrator,
    slot: u64,
    scratch: &mut Scratch<'w>,
    observer: &mut O,
) {
    match integrator {
        Integrator::Backward(_) | Integrator::VirtualLights(_) => {}
        Integrator::PhotonMap(mapper) => mapper.show_photon(pass, slot as usize, scratch),
        Integrator::Forward(forward) => forward.trace_light_path(pass, slot, scratch, observer),
        Integrator::Bidirectional(bidirectional) => {
            bidirectional.trace_light_path(pass, slot, scratch, observer);
        }
    }
}

/// Fills an AOV record with the first surface that an eye path meets.
struct FirstHit<'r>(&'r mut AovRecord);

impl PathObserver for FirstHit<'_> {
    fn segment(&mut self, walk: &Walk, depth: u32, vertex: Option<&SurfaceVertex>) {
        if walk.mode != TransportMode::Radiance || depth != 1 {
            return;
        }
        *self.0 = match vertex {
            Some(vertex) => AovRecord {
                shape: vertex.point.shape,
                primitive: vertex.point.primitive,
                depth: vertex.point.p.distance(walk.ray.o),
                position: vertex.point.p,
                ng: vertex.point.ng,
                ns: vertex.point.ns,
                albedo: vertex.albedo(),
                uv: vertex.point.uv,
            },
            None => AovRecord::MISS,
        };
    }

    fn contribution(&mut self, _: Strategy, _: Option<Vec2>, _: Rgb, _: f32) {}
}
