//! Runs a study: renders each configuration with each seed up to the greatest budget, and compares the state at each budget with the reference.
//!
//! One run serves all budgets: whenever one is used up, at the end of a pass, the film is developed and compared while the clock stands still. So what a ladder of budgets
//! measures is what separate renders would have made, at the cost of the last. All threads work on one run at a time, and nothing else happens meanwhile.
//!
//! What is finished is kept ([`cells`](super::cells)), so that a study that was interrupted or killed goes on where it was. Nothing is printed here.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::bias::squared_bias;
use super::cells::{Identity, Kept, ReferenceIdentity, Store};
use super::metrics::{CompareError, compare};
use super::picture::Picture;
use super::plan::{Plan, Planned};
use super::reference::{self, Reference, SEED, Source};
use super::report::Pictures;
use super::results::{self, Configuration, Point, Results, Run};
use super::{StudyError, flip};
use crate::film::output::{OutputError, write_exr};
use crate::film::{AovSet, Film};
use crate::integrators::PathLength;
use crate::query::{AnyQuery, Backend, BackendError, RayQuery, with_query};
use crate::render::{Control, Progress, RenderError, Stop, Target, render_shared};
use crate::scene::{Scene, Shape};
use crate::transport::World;

/// What all runs of a study have in common.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Name of the scene.
    pub scene: String,
    /// Fingerprint of the scene's files and definitions.
    pub fingerprint: String,
    /// Time that it took to load the scene.
    pub load: Duration,
    /// Paths of the reference are as long.
    pub length: PathLength,
    /// What traces the reference's rays.
    pub backend: Backend,
    /// Budgets of rendering, ascending, all above 0.
    pub budgets: Vec<Duration>,
    /// Seeds, different from each other and from the reference's.
    pub seeds: Vec<u64>,
    /// What images are compared with.
    pub reference: Source,
    /// Where all is kept.
    pub folder: PathBuf,
}

/// What happens in a study.
#[derive(Debug)]
pub enum Event<'a> {
    /// A pass of the reference was made.
    Reference {
        /// How far it is.
        progress: &'a Progress,
        /// Time that it has, in seconds.
        seconds: f64,
    },
    /// The reference is there.
    Compared(&'a results::Reference),
    /// A pass was made.
    Rendering {
        /// The configuration.
        name: &'a str,
        /// The seed.
        seed: u64,
        /// How far it is; of its time, comparisons are a part.
        progress: &'a Progress,
    },
    /// A run is finished, or was before.
    Finished {
        /// The configuration.
        name: &'a str,
        /// What was measured.
        run: &'a Run,
        /// Whether it was rendered just now.
        is_new: bool,
    },
    /// What is kept in the study's folder cannot be used, and is made again.
    Broken {
        /// The file.
        file: &'a Path,
        /// What is wrong with it.
        why: &'a str,
    },
    /// A configuration cannot be rendered. The study goes on without it.
    Failed {
        /// The configuration.
        name: &'a str,
        /// Why.
        why: &'a str,
    },
}

/// Is told what happens, and says whether to go on after each pass; it is not asked elsewhere.
pub type Observer<'a> = dyn FnMut(&Event) -> Control + 'a;

/// Backends over the shapes of a scene. The last one is kept, so that runs on one backend build it once.
pub struct Backends<'s> {
    shapes: &'s [Shape],
    last: Option<(Backend, AnyQuery<'s>, Duration)>,
}

impl<'s> Backends<'s> {
    /// None is built yet.
    pub fn new(shapes: &'s [Shape]) -> Self {
        Self { shapes, last: None }
    }

    /// A backend, and the time that it took to build it.
    ///
    /// # Errors
    /// If it cannot be built.
    pub fn get(&mut self, backend: Backend) -> Result<(&AnyQuery<'s>, Duration), BackendError> {
        if self.last.as_ref().is_none_or(|(last, ..)| *last != backend) {
            // First the old one goes, then the new one takes its memory.
            self.last = None;
            let start = Instant::now();
            let query = backend.build(self.shapes)?;
            self.last = Some((backend, query, start.elapsed()));
        }
        let Some((_, query, build)) = &self.last else { unreachable!("it was built just now") };
        Ok((query, *build))
    }
}

/// What a study has measured, and its images.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// Measurements; configurations that were left out of the plan are among them, after the others.
    pub results: Results,
    /// The reference, and of configurations, by their index in the results, the image of the first seed at the greatest budget.
    pub pictures: Pictures,
}

/// Runs a study. `None` if the observer stopped it; then what is finished is kept.
///
/// # Errors
/// If the settings make no sense, there is no reference, or files cannot be read or written. That a configuration cannot be rendered is no error but a result.
pub fn run<'s>(
    scene: &'s Scene,
    settings: &Settings,
    plan: &Plan,
    backends: &mut Backends<'s>,
    observe: &mut Observer,
) -> Result<Option<Outcome>, StudyError> {
    settings.check()?;
    let store = Store::open(&settings.folder)?;
    let world = World::new(scene);
    let Some(reference) = settings.reference(&store, &world, backends, observe)? else { return Ok(None) };
    settings.check_seed(reference.seed)?;
    observe(&Event::Compared(&reference.described));
    let study = Study { settings, store, world: &world, reference };
    let Some(measured) = study.run_all(plan, backends, observe)? else { return Ok(None) };
    study.outcome(plan, measured).map(Some)
}

impl Settings {
    fn check(&self) -> Result<(), StudyError> {
        let rises = self.budgets.windows(2).all(|pair| pair[0] < pair[1]);
        if !rises || self.budgets.first().is_none_or(Duration::is_zero) {
            return Err(StudyError::Budgets);
        }
        let is_twice = |(i, seed): (usize, &u64)| self.seeds[..i].contains(seed);
        if self.seeds.is_empty() || self.seeds.iter().enumerate().any(is_twice) {
            return Err(StudyError::Seeds);
        }
        if matches!(self.reference, Source::Rendered(_)) { self.check_seed(Some(SEED)) } else { Ok(()) }
    }

    fn check_seed(&self, of_reference: Option<u64>) -> Result<(), StudyError> {
        match of_reference.filter(|seed| self.seeds.contains(seed)) {
            Some(seed) => Err(StudyError::SeedOfReference(seed)),
            None => Ok(()),
        }
    }

    /// The greatest budget.
    pub fn greatest(&self) -> Duration {
        self.budgets.last().copied().unwrap_or_default()
    }

    fn seconds(&self) -> Vec<f64> {
        self.budgets.iter().map(Duration::as_secs_f64).collect()
    }

    /// Reads or renders the reference, if it is not kept. `None` if it was interrupted.
    fn reference<'s>(
        &self,
        store: &Store,
        world: &World<'s>,
        backends: &mut Backends<'s>,
        observe: &mut Observer,
    ) -> Result<Option<Reference>, StudyError> {
        let size = world.scene.film.crop.size.to_array();
        let time = match &self.reference {
            Source::File(path) => return Reference::read(path, size).map(Some),
            Source::Rendered(time) => time,
        };
        let identity = ReferenceIdentity {
            scene: self.fingerprint.clone(),
            max_depth: self.length.max_depth,
            backend: self.backend.describe(),
            size,
            seconds: time.as_secs_f64(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        };
        if let Some(kept) = reference::kept(store, &identity, observe)? {
            return Ok(Some(kept));
        }
        let (query, _) = backends.get(self.backend)?;
        let length = self.length;
        with_query!(query, query => reference::rendered(store, identity, world, query, length, observe))
    }
}

/// What was measured of a configuration: its runs with their identities, or why there are none.
type Measured = Result<Vec<(Identity, Run)>, String>;

/// How a run ended.
enum End {
    Finished {
        run: Run,
        /// Whether the observer stopped the study in its last pass.
        is_last: bool,
    },
    /// It cannot be rendered.
    Failed(String),
    Interrupted,
}

struct Study<'a, 's> {
    settings: &'a Settings,
    store: Store,
    world: &'a World<'s>,
    reference: Reference,
}

impl<'s> Study<'_, 's> {
    fn identity(&self, planned: &Planned, seed: u64) -> Identity {
        Identity {
            scene: self.settings.fingerprint.clone(),
            integrator: planned.integrator.describe(),
            backend: planned.backend.describe(),
            sampling_columns: planned.sampling_columns,
            seed,
            budgets: self.settings.seconds(),
            size: self.reference.picture.size.to_array(),
            threads: rayon::current_num_threads(),
            reference: self.reference.checksum.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
        }
    }

    /// All runs: backend by backend, so that each is built once, then seed by seed, so that what is there early is about all configurations.
    fn run_all(
        &self,
        plan: &Plan,
        backends: &mut Backends<'s>,
        observe: &mut Observer,
    ) -> Result<Option<Vec<Measured>>, StudyError> {
        let planned = &plan.configurations;
        let mut measured: Vec<Measured> = vec![Ok(Vec::new()); planned.len()];
        let mut distinct: Vec<Backend> = Vec::new();
        for Planned { backend, .. } in planned {
            if !distinct.contains(backend) {
                distinct.push(*backend);
            }
        }
        for backend in distinct {
            for &seed in &self.settings.seeds {
                for (planned, measured) in planned.iter().zip(&mut measured) {
                    let Ok(runs) = measured else { continue };
                    if planned.backend != backend {
                        continue;
                    }
                    let identity = self.identity(planned, seed);
                    match self.run(planned, &identity, backends, observe)? {
                        End::Finished { is_last: true, .. } | End::Interrupted => return Ok(None),
                        End::Finished { run, .. } => runs.push((identity, run)),
                        End::Failed(why) => {
                            observe(&Event::Failed { name: &planned.name, why: &why });
                            *measured = Err(why);
                        }
                    }
                }
            }
        }
        Ok(Some(measured))
    }

    /// The run of that identity: the one that is kept, or a new one.
    fn run(
        &self,
        planned: &Planned,
        identity: &Identity,
        backends: &mut Backends<'s>,
        observe: &mut Observer,
    ) -> Result<End, StudyError> {
        let name = planned.name.as_str();
        match self.store.run(identity) {
            Kept::Whole(run) => {
                observe(&Event::Finished { name, run: &run, is_new: false });
                return Ok(End::Finished { run, is_last: false });
            }
            Kept::Broken { file, why } => {
                observe(&Event::Broken { file: &file, why: &why });
            }
            Kept::None => {}
        }
        let (query, build) = match backends.get(planned.backend) {
            Ok(built) => built,
            Err(error) => return Ok(End::Failed(error.to_string())),
        };
        self.store.begin(identity)?;
        let end = with_query!(query, query => self.render(planned, identity, query, build, observe))?;
        if let End::Finished { run, .. } = &end {
            self.store.keep_run(identity, run)?;
            observe(&Event::Finished { name, run, is_new: true });
        }
        Ok(end)
    }

    fn render<Q: RayQuery>(
        &self,
        planned: &Planned,
        identity: &Identity,
        query: &Q,
        build: Duration,
        observe: &mut Observer,
    ) -> Result<End, StudyError> {
        let own = planned.sampling_columns.map(|n| World::with_sampling_columns(self.world.scene, n));
        let (world, seed) = (own.as_ref().unwrap_or(self.world), identity.seed);
        let film = Film::new(&world.scene.film, AovSet::default(), world.lights.radiance_unit())?;
        let film = Mutex::new(film);
        let target = Target { integrator: planned.integrator, seed };
        let stop = Stop { passes: 0..u32::MAX, time: None };
        let mut ladder = Ladder::new(self, identity);
        let mut is_interrupted = false;
        let rendered = render_shared(world, query, &target, &film, &stop, |progress| {
            let event = Event::Rendering { name: &planned.name, seed, progress };
            is_interrupted = observe(&event) == Control::Stop;
            let is_done = ladder.climb(progress, &film);
            if is_done || is_interrupted { Control::Stop } else { Control::Continue }
        });
        let Ladder { points, first_image, end, .. } = ladder;
        match (rendered, end) {
            (Err(RenderError::Film(error)), _) => Err(error.into()),
            (Err(error), _) => Ok(End::Failed(error.to_string())),
            (_, Err(SnapshotError::Output(error))) => Err(error.into()),
            (_, Err(SnapshotError::Compare(error))) => Ok(End::Failed(format!("the image {error}"))),
            _ if points.len() < self.settings.budgets.len() => Ok(End::Interrupted),
            _ => {
                let (build, query_bytes) = (build.as_secs_f64(), query.memory() as u64);
                let run = Run { seed, build, first_image, query_bytes, points };
                Ok(End::Finished { run, is_last: is_interrupted })
            }
        }
    }

    fn outcome(self, plan: &Plan, measured: Vec<Measured>) -> Result<Outcome, StudyError> {
        let (mut configurations, mut images) = (Vec::new(), Vec::new());
        for (planned, measured) in plan.configurations.iter().zip(measured) {
            let (runs, failure) = match measured {
                Ok(runs) => (runs, None),
                Err(why) => (Vec::new(), Some(why)),
            };
            if let Some((identity, run)) = runs.first()
                && let Some(last) = run.points.last()
            {
                images.push((configurations.len(), Picture::read(&self.store.image(identity, last.passes))?));
            }
            configurations.push(Configuration {
                name: planned.name.clone(),
                integrator: planned.integrator.describe(),
                backend: planned.backend.describe(),
                sampling_columns: planned.sampling_columns,
                bias: planned.bias.clone(),
                squared_bias: self.squared_bias(&runs)?,
                runs: runs.into_iter().map(|(_, run)| run).collect(),
                failure,
            });
        }
        configurations.extend(plan.left_out.iter().map(|left_out| Configuration {
            name: left_out.name.clone(),
            integrator: left_out.integrator.to_string(),
            backend: self.settings.backend.describe(),
            sampling_columns: None,
            bias: None,
            runs: Vec::new(),
            squared_bias: Vec::new(),
            failure: Some(left_out.why.clone()),
        }));
        let results = Results {
            scene: self.settings.scene.clone(),
            size: self.reference.picture.size.to_array(),
            threads: rayon::current_num_threads(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            load: self.settings.load.as_secs_f64(),
            budgets: self.settings.seconds(),
            reference: self.reference.described,
            configurations,
        };
        Ok(Outcome { results, pictures: Pictures { reference: self.reference.picture, images } })
    }

    /// The squared bias at each budget, from the images that are kept.
    fn squared_bias(&self, runs: &[(Identity, Run)]) -> Result<Vec<f64>, StudyError> {
        if runs.len() < 2 {
            return Ok(Vec::new());
        }
        let mut all = Vec::new();
        for budget in 0..self.settings.budgets.len() {
            let image = |(identity, run): &(Identity, Run)| {
                Picture::read(&self.store.image(identity, run.points[budget].passes))
            };
            let images = runs.iter().map(image).collect::<Result<Vec<_>, _>>()?;
            // Each was compared with the reference, so that some pixel is finite in all but odd cases.
            all.push(squared_bias(&images, &self.reference.picture).unwrap_or(0.0));
        }
        Ok(all)
    }
}

/// Why the state of a run was not measured.
#[derive(Debug)]
enum SnapshotError {
    Compare(CompareError),
    Output(OutputError),
}

/// The budgets of a run, used up one by one.
struct Ladder<'a> {
    study: &'a Study<'a, 'a>,
    identity: &'a Identity,
    /// Time that was spent on measuring, not on rendering.
    paused: Duration,
    first_image: f64,
    points: Vec<Point>,
    end: Result<(), SnapshotError>,
}

impl<'a> Ladder<'a> {
    fn new(study: &'a Study<'a, 'a>, identity: &'a Identity) -> Self {
        let (paused, points) = Default::default();
        Self { study, identity, paused, first_image: 0.0, points, end: Ok(()) }
    }

    /// Measures the state at the end of a pass if a budget is used up. Whether the last is, or the state cannot be measured.
    fn climb(&mut self, progress: &Progress, film: &Mutex<Film>) -> bool {
        let budgets = &self.study.settings.budgets;
        let spent = progress.elapsed.saturating_sub(self.paused);
        if progress.passes == 1 {
            self.first_image = spent.as_secs_f64();
        }
        if budgets[self.points.len()] > spent {
            return false;
        }
        let start = Instant::now();
        match self.measure(progress, spent, film) {
            // A pass may use up several.
            Ok(point) => {
                let used_up = budgets.iter().filter(|&&budget| budget <= spent).count();
                self.points.resize(used_up, point);
            }
            Err(error) => self.end = Err(error),
        }
        self.paused += start.elapsed();
        self.points.len() == budgets.len() || self.end.is_err()
    }

    fn measure(
        &self,
        progress: &Progress,
        spent: Duration,
        film: &Mutex<Film>,
    ) -> Result<Point, SnapshotError> {
        // Who panicked while the film was locked did not change it.
        let image = film.lock().unwrap_or_else(PoisonError::into_inner).develop();
        let Study { store, reference, .. } = self.study;
        let picture = Picture::of(&image);
        let errors = compare(&reference.picture, &picture).map_err(SnapshotError::Compare)?;
        let path = store.image(self.identity, progress.passes);
        let metadata = [
            ("integrator", self.identity.integrator.clone()),
            ("seed", self.identity.seed.to_string()),
            ("passes", format!("0..{}", progress.passes)),
        ];
        let metadata = metadata.map(|(name, value)| (name.to_owned(), value));
        write_exr(&path, &image, false, &metadata).map_err(SnapshotError::Output)?;
        Ok(Point {
            seconds: spent.as_secs_f64(),
            passes: progress.passes,
            rays: progress.rays,
            mse: errors.mse,
            rel_mse: errors.rel_mse,
            rel_mse_trimmed: errors.rel_mse_trimmed,
            flip: flip::ldr(&reference.picture, &picture),
        })
    }
}
