//! `helmholtz render`: a scene becomes an image.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use glam::UVec2;
use serde_json::json;

use super::integrator::Wanted;
use super::output::Outputs;
use super::parse;
use super::progress::Bar;
use super::{CliError, EXIT_DONE, EXIT_FAULTS, EXIT_INTERRUPTED, debug_pixel};
use crate::film::state::{RenderIdentity, load_state, save_state};
use crate::film::{Aov, AovSet, Film, output};
use crate::integrators::photon_map::Lookup;
use crate::integrators::photon_map::store::{PhotonReader, PhotonStore, PhotonWriter};
use crate::integrators::{Integrator, Strategy};
use crate::query::{AnyQuery, Backend, RayQuery};
use crate::render::{Control, Progress, Stop, Target, render_with_store};
use crate::scene::load::{LoadOptions, Loaded, load};
use crate::scene::{PixelRect, Scene};
use crate::spec::{Spec, duration, key_value, size, spec};
use crate::strategies::{self, OddCount, StrategyImages};
use crate::study::converge::{ErrorEstimate, Outcome, render_to_error};
use crate::transport::World;

/// Greatest path length for --strategies: each strategy has two films.
const MAX_STRATEGY_DEPTH: u32 = 10;

/// Render a scene or a mesh to OpenEXR and PNG
///
/// SCENE is a Mitsuba scene (.xml) or a mesh (.obj, .ply). A mesh without lights gets a neutral sky, one
/// without a camera a view of all of it.
///
/// The image depends on the scene, the integrator, the seed and the passes, and on nothing else: it is the same
/// to the last bit for any number of threads, and whether it was rendered at once, resumed or merged.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  helmholtz render scenes/cornell-box.xml
  helmholtz render room.xml --time 5m -o room.exr
  helmholtz render room.xml --integrator path:max_depth=4 --spp 256
  helmholtz render room.xml --error 0.01 --time 1h
  helmholtz render room.xml --integrator bdpt:max_depth=8 --time 10m
  helmholtz render room.xml --integrator bdpt:max_depth=5 --size 256x256 --strategies pyramid
  helmholtz render room.xml --integrator sppm:photons=500000 --time 10m
  helmholtz render room.xml --integrator photonmapper:mode=caustic,lookup=radius --time 10m
  helmholtz render room.xml --integrator vpl:count=1000,visibility=shadowmap --spp 16
  helmholtz render room.xml --backend obvhs --size 640x360
  helmholtz render room.xml --passes 0..64 --save-state a.state    (on one machine)
  helmholtz render room.xml --passes 64..128 --save-state b.state  (on another)
  helmholtz merge a.state b.state -o room.exr")]
pub(super) struct RenderArgs {
    /// Mitsuba scene (.xml) or mesh (.obj, .ply)
    scene: PathBuf,
    /// Image to write: NAME.exr (and NAME.png beside it) or NAME.png [default: the scene's name, here]
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Samples per pixel; one pass makes one [default: what the scene says, without limit if only --time is given]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    spp: Option<u32>,
    /// Begin no pass after this time: 30s, 5m, 2h, 500ms
    #[arg(long, value_name = "TIME", value_parser = duration)]
    time: Option<Duration>,
    /// Stop as soon as the relMSE of the image, estimated from the spread of eight independent groups of passes, is below this with 95 % confidence; --time
    /// stops it earlier. Bias is not covered
    #[arg(long, value_name = "RELMSE", value_parser = parse::positive,
        conflicts_with_all = ["spp", "passes", "resume", "save_photons", "load_photons", "strategies", "debug_pixel"])]
    error: Option<f64>,
    /// Render only these passes: FIRST..END, END not included
    #[arg(long, value_name = "RANGE", value_parser = parse::passes, conflicts_with = "spp")]
    passes: Option<Range<u32>>,
    /// Seed of the random numbers: images with different seeds are independent
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Threads [default: one per core]; does not change the image
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    threads: Option<u32>,
    /// Film size in pixels instead of the scene's; a crop window of the scene is dropped
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    size: Option<UVec2>,
    /// Part of the film to render
    #[arg(long, value_name = "X,Y,WIDTHxHEIGHT", value_parser = parse::crop)]
    crop: Option<PixelRect>,
    /// Ray queries by: embree (settings robust=true|false, quality=low|medium|high, compact=true|false),
    /// obvhs (setting quality=low|medium|high) or crosscheck (the default, compared query by query with the other; exit code 4 for a fault)
    #[arg(long, value_name = "NAME:KEY=VALUE,...", value_parser = spec)]
    backend: Option<Spec>,
    /// Algorithm instead of the scene's, which is auto where it names none: auto, whichever of the next ones has the least error at equal cost in a short trial (max_depth, rr_depth); path, paths from the camera (max_depth, rr_depth, hide_emitters); ptracer, paths from the lights
    /// (max_depth, rr_depth, connect=nee|hit|both); bdpt, both and their connections (max_depth, rr_depth, exponent=1|2); photonmapper, photons from
    /// the lights gathered around what the camera sees (max_depth, rr_depth, photons, lookup=knn|radius, k, radius, filter=constant|cone|gaussian,
    /// direct=photons|nee, mode=full|caustic, final_gather, show=radiance|photons); sppm, the same with a radius that shrinks from pass to pass (alpha, and no lookup or k); vpl,
    /// virtual point lights left by paths from the lights (max_depth, rr_depth, count, visibility=none|rays|shadowmap, resolution, bias, clamp, compensate=true|false,
    /// direct=nee|vpl, roughness, samples=all|N)
    #[arg(long, value_name = "NAME:KEY=VALUE,...", value_parser = spec)]
    integrator: Option<Spec>,
    /// Replace $NAME in the scene file
    #[arg(short = 'D', value_name = "NAME=VALUE", value_parser = key_value)]
    define: Vec<(String, String)>,
    /// Replace what is not supported in a scene file, with a warning that says by what
    #[arg(long)]
    lenient: bool,
    /// More layers for the EXR: depth, position, geometric_normal, shading_normal, albedo, uv, shape_id, primitive_id, sample_count, variance
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', value_parser = aov)]
    aov: Vec<Aov>,
    /// Go on from a state file; its passes are not rendered again
    #[arg(long, value_name = "FILE")]
    resume: Option<PathBuf>,
    /// Save a state file at the end, to be resumed or merged
    #[arg(long, value_name = "FILE")]
    save_state: Option<PathBuf>,
    /// Write the photons of all passes that are rendered to a file, 32 bytes each and some more for their tree
    #[arg(long, value_name = "FILE", conflicts_with_all = ["strategies", "debug_pixel"])]
    save_photons: Option<PathBuf>,
    /// Take photons from such a file instead of tracing them; radius, lookup, filter, film and backend may be others than those that they were saved with
    #[arg(long, value_name = "FILE", conflicts_with_all = ["save_photons", "strategies", "debug_pixel"])]
    load_photons: Option<PathBuf>,
    /// Print the paths of a pixel, vertex by vertex, instead of rendering; --passes says which (pass 0 by default)
    #[arg(long, value_name = "X,Y", value_parser = parse::pixel)]
    debug_pixel: Option<UVec2>,
    /// Write what each strategy (s, t) contributes instead of the image: DIR/strategies.exr with layers weighted.sStT and unweighted.sStT, and
    /// the contact sheets weighted.png and unweighted.png, path lengths from the top, s from the left. For paths of at most 10 segments
    #[arg(long, value_name = "DIR", conflicts_with_all = ["resume", "save_state", "debug_pixel", "aov", "output"])]
    strategies: Option<PathBuf>,
    /// No progress and no messages but errors
    #[arg(long)]
    quiet: bool,
    /// Print statistics as JSON on standard output
    #[arg(long)]
    json: bool,
}

fn aov(name: &str) -> Result<Aov, String> {
    let names = || Aov::ALL.map(Aov::name).join(", ");
    Aov::from_name(name).ok_or_else(|| format!("no such AOV; there are: {}", names()))
}

pub(super) fn run(args: &RenderArgs) -> Result<u8, CliError> {
    let outputs = Outputs::new(args.output.as_deref(), &args.scene)?;
    if let Some(threads) = args.threads {
        rayon::ThreadPoolBuilder::new().num_threads(threads as usize).build_global()?;
    }
    let start = Instant::now();
    let options =
        LoadOptions { defines: args.define.clone(), lenient: args.lenient, ..LoadOptions::default() };
    let Loaded { mut scene, warnings, files, .. } = load(&args.scene, &options)?;
    if !args.quiet {
        for warning in &warnings {
            eprintln!("{warning}");
        }
    }
    args.edit(&mut scene)?;
    let wanted = Wanted::new(args.integrator.as_ref(), &scene.integrator, args.lenient)?;
    let load_time = start.elapsed();
    let start = Instant::now();
    let setup = Setup { args, scene: &scene, files: &files, outputs, wanted, load_time, start };
    match args.backend()? {
        #[cfg(feature = "embree")]
        Backend::Embree(settings) => {
            setup.run(&crate::query::embree::EmbreeQuery::new(&scene.shapes, settings)?)
        }
        Backend::Obvhs(quality) => setup.run(&crate::query::obvhs::ObvhsQuery::new(&scene.shapes, quality)),
        backend @ Backend::Crosscheck => {
            let query = backend.build(&scene.shapes)?;
            let code = setup.run(&query)?;
            Ok(if report_crosscheck(&query, args.quiet) { code } else { EXIT_FAULTS })
        }
    }
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
    fn run<Q: RayQuery>(self, query: &Q) -> Result<u8, CliError> {
        let Self { args, scene, files, outputs, wanted, load_time, start } = self;
        let build_time = start.elapsed();
        let (integrator, remark) = wanted.resolve(scene, query)?;
        let target = Target { integrator, seed: args.seed };
        let job = Job { args, scene, files, outputs, target, load_time, build_time };
        job.say(remark.as_slice());
        job.run(query)
    }
}

/// Prints what a crosscheck found; whether it is without fault. Other backends are.
fn report_crosscheck(query: &AnyQuery, quiet: bool) -> bool {
    let AnyQuery::Crosscheck(crosscheck) = query else { return true };
    let (findings, names) = (crosscheck.findings(), crosscheck.names());
    if !quiet {
        eprintln!(
            "compared {} closest hits and {} occlusions by {} and {}: {} ties, {} faults, {} disputes not judged",
            findings.closest,
            findings.occlusion,
            names[0],
            names[1],
            findings.ties,
            findings.faults.len(),
            findings.not_judged
        );
    }
    for judged in &findings.faults {
        eprintln!("# {}\n{}", judged.blame(names.each_ref().map(String::as_str)), judged.dispute);
    }
    findings.is_clean()
}

/// Changes the size of the film; a crop window is dropped.
pub(super) fn resize(scene: &mut Scene, size: UVec2) {
    scene.film.size = size;
    scene.film.crop = PixelRect { min: UVec2::ZERO, size };
}

impl RenderArgs {
    /// Applies the arguments that change the scene.
    fn edit(&self, scene: &mut Scene) -> Result<(), CliError> {
        if let Some(size) = self.size {
            resize(scene, size);
        }
        if let Some(crop) = self.crop {
            let end = crop.min.checked_add(crop.size);
            if !end.is_some_and(|end| end.cmple(scene.film.size).all()) {
                return Err(format!(
                    "--crop reaches beyond the film of {}x{}",
                    scene.film.size.x, scene.film.size.y
                )
                .into());
            }
            scene.film.crop = crop;
        }
        Ok(())
    }

    fn backend(&self) -> Result<Backend, CliError> {
        Ok(match &self.backend {
            Some(spec) => Backend::new(&spec.name, &spec.parameters)?,
            None => Backend::default(),
        })
    }

    /// The passes to render: from --passes, --spp or the scene; all there are if --time alone says when to stop.
    fn pass_range(&self, scene: &Scene) -> Range<u32> {
        match (&self.passes, self.spp, self.time) {
            (Some(range), _, _) => range.clone(),
            (None, Some(spp), _) => 0..spp,
            (None, None, Some(_)) => 0..u32::MAX,
            (None, None, None) => 0..scene.sample_count,
        }
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
    fn run<Q: RayQuery>(self, query: &Q) -> Result<u8, CliError> {
        let start = Instant::now();
        let world = World::new(self.scene);
        let build_time = self.build_time + start.elapsed();
        if let Some(pixel) = self.args.debug_pixel {
            return self.debug_pixel(&world, query, pixel);
        }
        if let Some(folder) = &self.args.strategies {
            return self.strategies(&world, query, folder);
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
        if self.args.json {
            println!("{:#}", report.statistics());
        }
        Ok(if was_interrupted { EXIT_INTERRUPTED } else { EXIT_DONE })
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
            scene: fingerprint(self.files, &self.args.define)?,
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

/// A finished render, to be told about.
struct Report<'a> {
    job: &'a Job<'a>,
    film: &'a Film,
    progress: Progress,
    /// Of a render to a target error.
    estimate: Option<ErrorEstimate>,
    build_time: Duration,
    backend: String,
    /// What should not be, of the passes that there are examples of.
    odd: BTreeMap<Strategy, OddCount>,
}

impl Report<'_> {
    fn rays_per_second(&self) -> f64 {
        self.progress.rays as f64 / self.progress.elapsed.as_secs_f64().max(1e-9)
    }

    fn summary(&self) -> String {
        format!(
            "{} samples per pixel, {:.1} s ({:.2} M rays/s, {} threads, {}); loading took {:.2} s, building {:.2} s",
            self.film.passes().len(),
            self.progress.elapsed.as_secs_f64(),
            self.rays_per_second() / 1e6,
            rayon::current_num_threads(),
            self.backend,
            self.job.load_time.as_secs_f64(),
            self.build_time.as_secs_f64(),
        )
    }

    /// What is known of the error, if it was asked for.
    fn accuracy(&self) -> Vec<String> {
        let Some(target) = self.job.args.error else { return Vec::new() };
        let mut lines = vec![match self.estimate {
            None => "no estimate of the error: fewer than 8 passes were rendered".to_owned(),
            Some(ErrorEstimate { rel_mse, upper }) => {
                let verdict =
                    if upper < target { "the target is reached" } else { "the target is NOT reached" };
                format!("relMSE is about {rel_mse:.3e}, with 95 % confidence below {upper:.3e}: {verdict}")
            }
        }];
        if let Some(bias) = self.job.target.integrator.bias() {
            lines.push(format!("the estimate does not cover bias: {bias}"));
        }
        lines
    }

    /// Says how many contributions were left out, and how to look at the first of them.
    fn print_dropped(&self) {
        let dropped = self.film.dropped();
        if dropped.is_none() {
            return;
        }
        eprintln!(
            "warning: dropped {} samples and {} splats that were not finite, {} AOV records; {} sums overflowed; {} samples and splats are negative",
            dropped.samples, dropped.splats, dropped.records, dropped.overflows, dropped.negative
        );
        for (strategy, OddCount { non_finite, negative }) in &self.odd {
            eprintln!(
                "  {non_finite} contributions that are not finite and {negative} that are negative by a path that {strategy}, in passes {:?}",
                dropped.example_passes()
            );
        }
        for at in &dropped.examples {
            eprintln!(
                "  reproduce one: {} --seed {} --integrator {} --passes {}..{} --debug-pixel {},{}",
                reproduction(self.job.args),
                self.job.target.seed,
                self.job.target.integrator.describe(),
                at.pass,
                at.pass + 1,
                at.x,
                at.y,
            );
        }
    }

    /// What is odd about the photons or virtual lights that were stored.
    fn photon_warnings(&self) -> Vec<String> {
        let Progress { passes, photons, without_map, .. } = self.progress;
        let mapper = match self.job.target.integrator {
            _ if passes == 0 => return Vec::new(),
            Integrator::PhotonMap(mapper) => mapper,
            Integrator::VirtualLights(_) if photons == 0 => {
                return vec![
                    "warning: no virtual point light was stored: no light reaches a surface that is rough enough, or paths may not be as long"
                        .to_owned(),
                ];
            }
            Integrator::VirtualLights(_) if without_map > 0 => {
                return vec![format!(
                    "warning: no memory for the shadow maps of {without_map} of {photons} virtual lights: rays are used"
                )];
            }
            _ => return Vec::new(),
        };
        if photons == 0 {
            return vec![
                "warning: no photon was stored: no light reaches a surface that is looked up".to_owned(),
            ];
        }
        match mapper.lookup {
            Lookup::Nearest { k, .. } if u64::from(k) * u64::from(passes) >= photons => {
                vec![format!(
                    "warning: k={k}, but a pass stored {} photons: all are taken",
                    photons / u64::from(passes)
                )]
            }
            _ => Vec::new(),
        }
    }

    /// Attributes of the EXR file.
    fn metadata(&self) -> Vec<(String, String)> {
        let passes = self.film.passes().ranges().iter().map(|r| format!("{}..{}", r.start, r.end));
        let pairs = [
            ("scene", self.job.args.scene.display().to_string()),
            ("integrator", self.job.target.integrator.describe()),
            ("seed", self.job.target.seed.to_string()),
            ("passes", passes.collect::<Vec<_>>().join(",")),
            ("backend", self.backend.clone()),
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
            ("render_seconds", format!("{:.3}", self.progress.elapsed.as_secs_f64())),
        ];
        pairs.into_iter().map(|(name, value)| (name.to_owned(), value)).collect()
    }

    fn statistics(&self) -> serde_json::Value {
        let mut dropped = json!(self.film.dropped());
        let of_strategy = |(Strategy { s, t }, odd): (&Strategy, &OddCount)| json!({ "s": s, "t": t, "non_finite": odd.non_finite, "negative": odd.negative });
        dropped["strategies"] = self.odd.iter().map(of_strategy).collect();
        json!({
            "scene": self.job.args.scene,
            "integrator": self.job.target.integrator.describe(),
            "seed": self.job.target.seed,
            "backend": self.backend,
            "threads": rayon::current_num_threads(),
            "size": self.film.settings().crop.size.to_array(),
            "passes": self.film.passes().len(),
            "passes_rendered": self.progress.passes,
            "rays": self.progress.rays,
            "photons": self.progress.photons,
            "rays_per_second": self.rays_per_second(),
            "load_seconds": self.job.load_time.as_secs_f64(),
            "build_seconds": self.build_time.as_secs_f64(),
            "render_seconds": self.progress.elapsed.as_secs_f64(),
            "dropped": dropped,
            "relmse_estimate": self.estimate.map(|e| e.rel_mse),
            "relmse_upper": self.estimate.map(|e| e.upper),
            "bias": self.job.target.integrator.bias(),
        })
    }
}

/// The part of the command line that says which scene is rendered, and with which backend.
fn reproduction(args: &RenderArgs) -> String {
    let mut command = format!("helmholtz render {}", args.scene.display());
    // Writing to a String cannot fail.
    for (name, value) in &args.define {
        let _ = write!(command, " -D {name}={value}");
    }
    if let Some(size) = args.size {
        let _ = write!(command, " --size {}x{}", size.x, size.y);
    }
    if let Some(backend) = &args.backend {
        let _ = write!(command, " --backend {backend}");
    }
    if args.lenient {
        command.push_str(" --lenient");
    }
    command
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
