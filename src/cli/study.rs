//! `helmholtz study`: which integrator, with which settings, for this scene, at this budget?

use std::num::NonZeroU32;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use clap::Args;
use glam::UVec2;
use serde_json::json;

use super::common::{Reading, Threads};
use super::progress::Bar;
use super::render::{fingerprint, resize, stop_on_ctrl_c};
use super::table::table;
use super::{CliError, EXIT_DONE, EXIT_INTERRUPTED};
use crate::integrators::{Integrator, PathLength};
use crate::query::{Backend, with_query};
use crate::render::Control;
use crate::scene::Scene;
use crate::scene::load::{Loaded, load};
use crate::scene::requirements::Requirements;
use crate::spec::{Spec, duration, size, spec};
use crate::study::config::Config;
use crate::study::plan::{Plan, Planner};
use crate::study::reference::Source;
use crate::study::report;
use crate::study::run::{Backends, Event, Outcome, Settings, run as run_study};

/// Budgets unless said otherwise, in seconds.
const BUDGETS: [u64; 5] = [1, 2, 4, 8, 16];

/// Seeds unless said otherwise: the fewest that tell an error from its spread.
const SEEDS: NonZeroU32 = NonZeroU32::new(3).unwrap();

/// A reference has as many times the greatest budget unless said otherwise.
const REFERENCE_TIMES: u32 = 4;

/// Find out which integrator, with which settings, has the least error for this scene at which budget
///
/// Renders the scene in many ways for a ladder of time budgets, with several seeds, and compares each with a reference. By default these are all integrators that have
/// something to do in the scene; --integrator, --sweep and --config say others, and may be combined. Where none of them says how long paths may get, they are as long as the
/// scene's own integrator has them.
///
/// Budgets count time to render, on all threads: use a machine that has nothing else to do. What is finished is kept in the study's folder: the same command goes
/// on where a study was interrupted or killed.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  helmholtz study scenes/ring.xml
  helmholtz study scenes/ring.xml --budget 1s,10s,1m --seeds 5
  helmholtz study room.xml --sweep photonmapper:radius=0.001..0.1x7 --integrator auto
  helmholtz study room.xml --sweep 'path:rr_depth=2|5|100' --sweep 'embree:robust=true|false'
  helmholtz study room.xml --config study.toml --reference truth.exr -o room.study

A configuration file has any of these keys:
  budgets = [\"1s\", \"4s\", \"16s\"]
  seeds = 5
  size = \"256x256\"
  reference = \"truth.exr\"      # beside this file
  [[configuration]]            # as many as you like
  name = \"no roulette\"
  integrator = \"path:rr_depth=1000\"
  backend = \"obvhs\"
  sampling_columns = 256       # of the environment map")]
pub(super) struct StudyArgs {
    /// Mitsuba scene (.xml) or mesh (.obj, .ply)
    scene: PathBuf,
    /// Budgets of rendering: 500ms, 30s, 5m, ... [default: 1s,2s,4s,8s,16s]
    #[arg(long, value_name = "TIME,...", value_delimiter = ',', value_parser = duration)]
    budget: Vec<Duration>,
    /// Read configurations and more from a file; see below. Options of the command line come first
    #[arg(long, value_name = "FILE.toml")]
    config: Option<PathBuf>,
    /// Integrators or backends that differ in one value: key=A..BxN, N values with both ends, at equal factors where both are above 0, whole between whole ends; or
    /// key=A|B|C. Backends, and envmap:sampling_columns, have the integrator that auto chooses. May be repeated
    #[arg(long, value_name = "NAME:KEY=VALUES,...")]
    sweep: Vec<String>,
    /// An integrator, as in `render --integrator`. May be repeated
    #[arg(long, value_name = "NAME:KEY=VALUE,...", value_parser = spec)]
    integrator: Vec<Spec>,
    /// Ray queries by, as in `render --backend`, where a configuration does not say
    #[arg(long, value_name = "NAME:KEY=VALUE,...", value_parser = spec)]
    backend: Option<Spec>,
    /// Renders of each configuration, with seeds 1, 2, ... [default: 3]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(NonZeroU32))]
    seeds: Option<NonZeroU32>,
    /// Image to compare with, OpenEXR or PFM; with a layer `variance` (`render --aov variance`) its own noise is known [default: rendered]
    #[arg(long, value_name = "FILE")]
    reference: Option<PathBuf>,
    /// Time to render a reference for, by the better of path and bdpt [default: 4 times the greatest budget]
    #[arg(long, value_name = "TIME", value_parser = duration, conflicts_with = "reference")]
    reference_time: Option<Duration>,
    /// Film size in pixels instead of the scene's
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    size: Option<UVec2>,
    #[command(flatten)]
    reading: Reading,
    #[command(flatten)]
    threads: Threads,
    /// Folder for results and all that is kept [default: the scene's name with .study, here]
    #[arg(short, long, value_name = "FOLDER")]
    output: Option<PathBuf>,
    /// No progress and no messages but errors
    #[arg(long)]
    quiet: bool,
    /// Print the results as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &StudyArgs) -> Result<u8, CliError> {
    args.threads.start()?;
    let config = args.config.as_deref().map(Config::read).transpose()?.unwrap_or_default();
    let start = Instant::now();
    let Loaded { mut scene, warnings, files, .. } = load(&args.scene, &args.reading.options())?;
    for warning in &warnings {
        args.say(&warning.to_string());
    }
    if let Some(size) = args.size.or(config.size) {
        resize(&mut scene, size);
    }
    let settings = args.settings(&config, &scene, &files, start.elapsed())?;
    let planner = args.planner(&config, &scene, &settings)?;
    let mut backends = Backends::new(&scene.shapes);
    let (query, _) = backends.get(settings.backend)?;
    let plan = with_query!(query, query => planner.resolve(&scene, query))?;
    args.announce(&plan, &settings);
    let interrupted = stop_on_ctrl_c()?;
    let mut told = Told { args, bar: None, interrupted: &interrupted, greatest: settings.greatest() };
    let outcome = run_study(&scene, &settings, &plan, &mut backends, &mut |event| told.hear(event))?;
    let Some(Outcome { results, pictures }) = outcome else {
        args.say("interrupted; the same command goes on with what is finished");
        return Ok(EXIT_INTERRUPTED);
    };
    let summary = report::write(&settings.folder, &results, &pictures)?;
    if args.json {
        println!("{:#}", json!({ "results": results, "summary": summary }));
    } else {
        print!("{}", table(&report::table(&results, &summary), ""));
        println!("\n{}\n", report::KEY);
        for finding in report::findings(&results, &summary) {
            println!("{finding}");
        }
    }
    args.say(&format!("wrote {}", settings.folder.join("report.html").display()));
    Ok(EXIT_DONE)
}

impl StudyArgs {
    fn say(&self, line: &str) {
        if !self.quiet {
            eprintln!("{line}");
        }
    }

    fn settings(
        &self,
        config: &Config,
        scene: &Scene,
        files: &[PathBuf],
        load: Duration,
    ) -> Result<Settings, CliError> {
        let given = if self.budget.is_empty() { &config.budgets } else { &self.budget };
        let mut budgets =
            if given.is_empty() { BUDGETS.map(Duration::from_secs).to_vec() } else { given.clone() };
        budgets.sort_unstable();
        budgets.dedup();
        let greatest = budgets.last().copied().unwrap_or_default();
        let file = self.reference.clone().or_else(|| config.reference.clone());
        let time = self.reference_time.unwrap_or_else(|| greatest.saturating_mul(REFERENCE_TIMES));
        let reference = match (file, self.reference_time) {
            (Some(file), None) => Source::File(file),
            _ => Source::Rendered(time),
        };
        let seeds = self.seeds.or(config.seeds).unwrap_or(SEEDS);
        let backend = self.backend.as_ref().map(|s| Backend::new(&s.name, &s.parameters)).transpose()?;
        let stem = self.scene.file_stem().unwrap_or_default().to_string_lossy();
        let folder = self.output.clone().unwrap_or_else(|| PathBuf::from(format!("{stem}.study")));
        Ok(Settings {
            scene: stem.into_owned(),
            fingerprint: fingerprint(files, &self.reading.define)?,
            load,
            length: self.length(scene)?,
            backend: backend.unwrap_or_default(),
            budgets,
            seeds: (1..=u64::from(seeds.get())).collect(),
            reference,
            folder,
        })
    }

    /// How long the scene's own integrator lets paths get.
    fn length(&self, scene: &Scene) -> Result<PathLength, CliError> {
        let settings = &scene.integrator;
        let Some(name) = &settings.name else { return Ok(PathLength::default()) };
        match Integrator::new(name, &settings.parameters) {
            Ok(integrator) => Ok(integrator.length()),
            Err(error) => {
                let at = settings.location.as_ref().map(|l| format!("{l}: ")).unwrap_or_default();
                if !self.reading.lenient {
                    return Err(format!("{at}{error}; --lenient takes paths of any length").into());
                }
                self.say(&format!("warning: {at}{error}; paths may have any length"));
                Ok(PathLength::default())
            }
        }
    }

    /// What is asked for.
    fn planner(&self, config: &Config, scene: &Scene, settings: &Settings) -> Result<Planner, CliError> {
        let mut planner = Planner::new(settings.length, settings.backend);
        config.plan(&mut planner)?;
        for integrator in &self.integrator {
            planner.integrator(integrator)?;
        }
        for sweep in &self.sweep {
            planner.sweep(sweep)?;
        }
        if planner.is_empty() {
            planner.defaults(&Requirements::of(scene))?;
        }
        Ok(planner)
    }

    /// Says what is about to be rendered, what is not, and how long it takes at most.
    fn announce(&self, plan: &Plan, settings: &Settings) {
        for left_out in &plan.left_out {
            self.say(&format!("{} is left out: {}", left_out.name, left_out.why));
        }
        for planned in &plan.configurations {
            if let Some(why) = &planned.choice {
                self.say(&format!("{} takes {why}", planned.name));
            }
        }
        let seeds = settings.seeds.len();
        let runs = plan.distinct() * seeds;
        let reference = match settings.reference {
            Source::Rendered(time) => time,
            Source::File(_) => Duration::ZERO,
        };
        let seconds = runs as f64 * settings.greatest().as_secs_f64() + reference.as_secs_f64();
        self.say(&format!(
            "{} configurations, {seeds} seeds: {runs} runs of {:.1} s and {:.1} s for the reference, {:.1} min in all, less what is in {} already",
            plan.configurations.len(),
            settings.greatest().as_secs_f64(),
            reference.as_secs_f64(),
            seconds / 60.0,
            settings.folder.display(),
        ));
    }
}

/// Tells a person what happens.
struct Told<'a> {
    args: &'a StudyArgs,
    /// Of the run at work.
    bar: Option<Bar>,
    interrupted: &'a AtomicBool,
    greatest: Duration,
}

impl Told<'_> {
    fn hear(&mut self, event: &Event) -> Control {
        let quiet = self.args.quiet;
        match event {
            Event::Reference { progress, seconds } => {
                let time = Duration::from_secs_f64(*seconds);
                self.bar.get_or_insert_with(|| Bar::new(None, Some(time), quiet)).update(progress, false);
            }
            Event::Rendering { progress, .. } => {
                let time = self.greatest;
                self.bar.get_or_insert_with(|| Bar::new(None, Some(time), quiet)).update(progress, false);
            }
            Event::Compared(reference) => {
                let error = reference.rel_mse.map_or_else(
                    || "of which nothing tells how good it is".to_owned(),
                    |e| format!("whose own relMSE is about {e:.2e}"),
                );
                self.say(&format!("the reference is {}, {error}", reference.origin));
            }
            Event::Finished { name, run, is_new } => {
                let kept = if *is_new { "" } else { " (kept)" };
                if let Some(last) = run.points.last() {
                    self.say(&format!(
                        "{name}, seed {}: relMSE {:.3e} after {} passes, {:.1} s{kept}",
                        run.seed, last.rel_mse, last.passes, last.seconds
                    ));
                }
            }
            Event::Broken { file, why } => {
                self.say(&format!("warning: {}: {why}; it is made again", file.display()));
            }
            Event::Failed { name, why } => self.say(&format!("warning: {name} cannot be rendered: {why}")),
        }
        if self.interrupted.load(Ordering::Relaxed) { Control::Stop } else { Control::Continue }
    }

    /// A line, after what there is of a bar.
    fn say(&mut self, line: &str) {
        if let Some(bar) = self.bar.take() {
            bar.finish();
        }
        self.args.say(line);
    }
}
