//! `helmholtz render`: a scene becomes an image. The arguments are in `args`, what is told at the end in `report`.

mod args;
mod report;

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use glam::UVec2;

use super::integrator::Wanted;
use super::output::Outputs;
use super::progress::Bar;
use super::{CliError, EXIT_DONE, EXIT_INTERRUPTED, debug_pixel};
use crate::film::state::{RenderIdentity, load_state, save_state};
use crate::film::{AovSet, Film, output};
use crate::integrators::photon_map::store::{PhotonReader, PhotonStore, PhotonWriter};
use crate::integrators::{Integrator, Strategy};
use crate::query::{Backend, RayQuery};
use crate::render::{Control, Progress, Stop, Target, render_with_store};
use crate::scene::Scene;
use crate::scene::load::{Loaded, load};
use crate::strategies::{self, OddCount, StrategyImages};
use crate::study::converge::{Outcome, render_to_error};
use crate::transport::World;
pub(super) use args::{RenderArgs, resize};
use report::{Ended, Report};

/// Greatest path length for --strategies: each strategy has two films.
const MAX_STRATEGY_DEPTH: u32 = 10;

pub(super) fn run(args: &RenderArgs) -> Result<u8, CliError> {
    let outputs = Outputs::new(args.output.as_deref(), &args.scene)?;
    args.threads.start()?;
    let start = Instant::now();
    let Loaded { mut scene, warnings, files, .. } = load(&args.scene, &args.reading.options())?;
    if !args.quiet {
        for warning in &warnings {
            eprintln!("{warning}");
        }
    }
    args.edit(&mut scene)?;
    let wanted = Wanted::new(args.integrator.as_ref(), &scene.integrator, args.reading.lenient)?;
    let load_time = start.elapsed();
    let start = Instant::now();
    let setup = Setup { args, scene: &scene, files: &files, outputs, wanted, load_time, start };
    let ended = match args.backend()? {
        #[cfg(feature = "embree")]
        Backend::Embree(settings) => {
            setup.run(&crate::query::embree::EmbreeQuery::new(&scene.shapes, settings)?)?
        }
        Backend::Obvhs(quality) => {
            setup.run(&crate::query::obvhs::ObvhsQuery::new(&scene.shapes, quality))?
        }
        backend @ Backend::Crosscheck => {
            let query = backend.build(&scene.shapes)?;
            let mut ended = setup.run(&query)?;
            ended.add_crosscheck(&query, args.quiet);
            ended
        }
    };
    if let (true, Some(statistics)) = (args.json, &ended.statistics) {
        println!("{statistics:#}");
    }
    Ok(ended.code)
}

/// A render whose backend is about to be chosen, and with it perhaps the integrator.
struct Setup<'a> {
    args: &'a RenderArgs,
    scene: &'a Scene,
    files: &'a [PathBuf],
    outputs: Outputs,
    wanted: Wanted,
    load_time: Duration,
    start: Instant,
}

impl Setup<'_> {
    fn run<Q: RayQuery>(self, query: &Q) -> Result<Ended, CliError> {
        let Self { args, scene, files, outputs, wanted, load_time, start } = self;
        let build_time = start.elapsed();
        let (integrator, remark) = wanted.resolve(scene, query)?;
        let target = Target { integrator, seed: args.seed };
        let job = Job { args, scene, files, outputs, target, load_time, build_time };
        job.say(remark.as_slice());
        job.run(query)
    }
}

/// A render.
struct Job<'a> {
    args: &'a RenderArgs,
    scene: &'a Scene,
    files: &'a [PathBuf],
    outputs: Outputs,
    target: Target,
    load_time: Duration,
    /// Of the backend.
    build_time: Duration,
}

impl Job<'_> {
    fn run<Q: RayQuery>(self, query: &Q) -> Result<Ended, CliError> {
        let start = Instant::now();
        let world = World::new(self.scene);
        let build_time = self.build_time + start.elapsed();
        if let Some(pixel) = self.args.debug_pixel {
            return self.debug_pixel(&world, query, pixel).map(Ended::without_statistics);
        }
        if let Some(folder) = &self.args.strategies {
            return self.strategies(&world, query, folder).map(Ended::without_statistics);
        }
        if let Some(warning) = self.target.integrator.warning(&world) {
            self.say(&[format!("warning: {warning}")]);
        }
        let identity = self.identity()?;
        let mut film = self.film(&world, &identity)?;
        let interrupted = stop_on_ctrl_c()?;
        let mut store = self.photon_store(&identity)?;
        let (progress, estimate) = match self.args.error {
            None => (self.render(&world, query, &mut film, &mut store, &interrupted)?, None),
            Some(target) => {
                let outcome = self.render_to_error(&world, query, &film, target, &interrupted)?;
                film = outcome.groups.merge()?;
                (outcome.progress, outcome.estimate)
            }
        };
        let odd = self.odd_contributions(&world, query, &film)?;
        let backend = query.name();
        let report = Report { job: &self, film: &film, progress, estimate, build_time, backend, odd };

        report.print_dropped();
        self.say(&report.photon_warnings());
        self.say(&self.outputs.write(&film, &report.metadata())?);
        if let (PhotonStore::Saved(file), Some(path)) = (store, &self.args.save_photons) {
            let passes = file.finish()?;
            self.say(&[format!("wrote {}: the photons of {passes} passes", path.display())]);
        }
        let was_interrupted = interrupted.load(Ordering::Relaxed);
        if let Some(path) = self.state_path(was_interrupted) {
            save_state(&path, &identity, &film)?;
            self.say(&[format!("wrote {}; go on with the same command and --resume {0}", path.display())]);
        }
        self.say(&[report.summary()]);
        self.say(&report.accuracy());
        let code = if was_interrupted { EXIT_INTERRUPTED } else { EXIT_DONE };
        Ok(Ended { code, statistics: Some(report.statistics()) })
    }

    fn debug_pixel<Q: RayQuery>(&self, world: &World, query: &Q, pixel: UVec2) -> Result<u8, CliError> {
        if !pixel.cmplt(self.scene.film.size).all() {
            return Err(format!("--debug-pixel {},{} is not on the film", pixel.x, pixel.y).into());
        }
        let passes = self.args.passes.clone().unwrap_or(0..1);
        let area = Film::new(&self.scene.film, AovSet::default(), 1.0)?.sampled_area();
        print!("{}", debug_pixel::describe(world, query, &self.target, area, pixel, passes)?);
        Ok(EXIT_DONE)
    }

    fn strategies<Q: RayQuery>(&self, world: &World, query: &Q, folder: &Path) -> Result<u8, CliError> {
        if matches!(self.target.integrator, Integrator::PhotonMap(_) | Integrator::VirtualLights(_)) {
            return Err(
                "--strategies shows path, ptracer or bdpt: what photons and virtual lights make is no strategy of theirs"
                    .into(),
            );
        }
        if self.target.integrator.length().max_depth.is_none_or(|depth| depth > MAX_STRATEGY_DEPTH) {
            return Err(format!(
                "--strategies needs an integrator with max_depth of at most {MAX_STRATEGY_DEPTH}"
            )
            .into());
        }
        std::fs::create_dir_all(folder).map_err(|error| format!("{}: {error}", folder.display()))?;
        let interrupted = stop_on_ctrl_c()?;
        let start = Instant::now();
        let mut strategies = StrategyImages::new(world);
        for pass in self.args.pass_range(self.scene) {
            let is_late = self.args.time.is_some_and(|limit| start.elapsed() >= limit);
            if interrupted.load(Ordering::Relaxed) || (is_late && !strategies.is_empty()) {
                break;
            }
            strategies.add_pass(world, query, &self.target, pass)?;
        }
        let images = strategies.develop();
        let metadata = [("integrator".to_owned(), self.target.integrator.describe())];
        let image =
            strategies::layers(&images).ok_or("nothing reaches the film: there is no image to write")?;
        let path = folder.join("strategies.exr");
        output::write_exr(&path, &image, false, &metadata)?;
        self.say(&[format!("wrote {}", path.display())]);
        for (which, name) in ["weighted.png", "unweighted.png"].into_iter().enumerate() {
            if let Some(sheet) = strategies::contact_sheet(&images, which) {
                output::write_png(&folder.join(name), &sheet)?;
                self.say(&[format!("wrote {}", folder.join(name).display())]);
            }
        }
        Ok(if interrupted.load(Ordering::Relaxed) { EXIT_INTERRUPTED } else { EXIT_DONE })
    }

    fn say(&self, lines: &[String]) {
        if !self.args.quiet {
            for line in lines {
                eprintln!("{line}");
            }
        }
    }

    /// What must be the same for passes to be added up.
    fn identity(&self) -> Result<RenderIdentity, CliError> {
        Ok(RenderIdentity {
            scene: fingerprint(self.files, &self.args.reading.define)?,
            integrator: self.target.integrator.describe(),
            seed: self.target.seed,
        })
    }

    /// Where photons come from and go to, by --save-photons and --load-photons.
    fn photon_store(&self, identity: &RenderIdentity) -> Result<PhotonStore, CliError> {
        let Some(path) = self.args.save_photons.as_ref().or(self.args.load_photons.as_ref()) else {
            return Ok(PhotonStore::Traced);
        };
        let Integrator::PhotonMap(mapper) = self.target.integrator else {
            return Err("--save-photons and --load-photons go with photonmapper or sppm".into());
        };
        let photons = RenderIdentity { integrator: mapper.describe_photons(), ..identity.clone() };
        if self.args.save_photons.is_some() {
            return Ok(PhotonStore::Saved(Box::new(PhotonWriter::create(path, &photons)?)));
        }
        let file = PhotonReader::open(path, &photons)?;
        file.check(self.passes(Some(&file)))?;
        Ok(PhotonStore::Loaded(Box::new(file)))
    }

    /// The passes to render. A render whose end is a time also ends with its photons.
    fn passes(&self, photons: Option<&PhotonReader>) -> Range<u32> {
        let range = self.args.pass_range(self.scene);
        let end = photons.map_or(u32::MAX, |file| file.passes().end);
        if range.end == u32::MAX { range.start..end } else { range }
    }

    /// An empty film, or the one to be resumed.
    fn film(&self, world: &World, identity: &RenderIdentity) -> Result<Film, CliError> {
        let aovs: AovSet = self.args.aov.iter().copied().collect();
        let mut film = Film::new(&self.scene.film, aovs, world.lights.radiance_unit())?;
        if let Some(path) = &self.args.resume {
            let (saved_identity, saved) = load_state(path)?;
            let mismatch = |error| format!("{} cannot be resumed: {error}", path.display());
            identity.check_same(&saved_identity).map_err(mismatch)?;
            film.merge(&saved).map_err(|error| format!("{} cannot be resumed: {error}", path.display()))?;
        }
        Ok(film)
    }

    fn render<Q: RayQuery>(
        &self,
        world: &World,
        query: &Q,
        film: &mut Film,
        store: &mut PhotonStore,
        interrupted: &AtomicBool,
    ) -> Result<Progress, CliError> {
        let photons = if let PhotonStore::Loaded(file) = &*store { Some(&**file) } else { None };
        let stop = Stop { passes: self.passes(photons), time: self.args.time };
        let count = (stop.passes.end != u32::MAX).then_some(stop.passes.len() as u64);
        let bar = Bar::new(count, stop.time, self.args.quiet);
        let progress = render_with_store(world, query, &self.target, film, &stop, store, |progress| {
            bar.update(progress, count.is_some());
            if interrupted.load(Ordering::Relaxed) { Control::Stop } else { Control::Continue }
        })?;
        bar.finish();
        Ok(progress)
    }

    fn render_to_error<Q: RayQuery>(
        &self,
        world: &World,
        query: &Q,
        empty: &Film,
        target: f64,
        interrupted: &AtomicBool,
    ) -> Result<Outcome, CliError> {
        let bar = Bar::new(None, self.args.time, self.args.quiet);
        let limits = (target, self.args.time);
        let outcome = render_to_error(world, query, &self.target, empty, limits, |progress, _| {
            bar.update(progress, false);
            if interrupted.load(Ordering::Relaxed) { Control::Stop } else { Control::Continue }
        })?;
        bar.finish();
        Ok(outcome)
    }

    /// For each strategy, what is not finite or negative in the passes that [`Dropped`](crate::film::Dropped) has examples of. They are traced again, so that
    /// nothing needs to be counted while all is well.
    fn odd_contributions<Q: RayQuery>(
        &self,
        world: &World,
        query: &Q,
        film: &Film,
    ) -> Result<BTreeMap<Strategy, OddCount>, CliError> {
        let mut all: BTreeMap<Strategy, OddCount> = BTreeMap::new();
        for pass in film.dropped().example_passes() {
            for (strategy, count) in strategies::odd_contributions(world, query, &self.target, pass)? {
                let sum = all.entry(strategy).or_default();
                sum.non_finite += count.non_finite;
                sum.negative += count.negative;
            }
        }
        Ok(all)
    }

    /// Where to save the film: where asked to, and beside the image after an interruption.
    fn state_path(&self, interrupted: bool) -> Option<PathBuf> {
        self.args.save_state.clone().or_else(|| interrupted.then(|| self.outputs.state()))
    }
}

/// A number that changes with any byte of the files that a scene was read from, and with the definitions.
pub(super) fn fingerprint(files: &[PathBuf], defines: &[(String, String)]) -> Result<String, CliError> {
    let mut hash = crc32fast::Hasher::new();
    let mut length = 0;
    for file in files {
        let bytes = std::fs::read(file).map_err(|error| format!("{}: {error}", file.display()))?;
        hash.update(&bytes);
        length += bytes.len();
    }
    for (name, value) in defines {
        hash.update(format!("{name}={value};").as_bytes());
    }
    Ok(format!("{:08x}-{length}", hash.finalize()))
}

/// The first Ctrl-C asks to stop after the pass; the second ends the process at once.
pub(super) fn stop_on_ctrl_c() -> Result<Arc<AtomicBool>, CliError> {
    let interrupted = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&interrupted);
    ctrlc::set_handler(move || {
        if flag.swap(true, Ordering::Relaxed) {
            std::process::exit(EXIT_INTERRUPTED.into());
        }
        eprintln!("\nfinishing this pass; Ctrl-C again stops at once and loses it");
    })?;
    Ok(interrupted)
}
