//! What is told of a finished render: on standard error, as JSON, and in the image's metadata.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::time::Duration;

use serde_json::{Value, json};

use super::super::EXIT_FAULTS;
use super::super::ab::{counts, faults};
use super::{Job, RenderArgs};
use crate::film::Film;
use crate::integrators::photon_map::Lookup;
use crate::integrators::{Integrator, Strategy};
use crate::query::AnyQuery;
use crate::render::Progress;
use crate::strategies::OddCount;
use crate::study::converge::ErrorEstimate;

/// A finished render, to be told about.
pub(super) struct Report<'a> {
    pub(super) job: &'a Job<'a>,
    pub(super) film: &'a Film,
    pub(super) progress: Progress,
    /// Of a render to a target error.
    pub(super) estimate: Option<ErrorEstimate>,
    pub(super) build_time: Duration,
    pub(super) backend: String,
    /// What should not be, of the passes that there are examples of.
    pub(super) odd: BTreeMap<Strategy, OddCount>,
}

impl Report<'_> {
    fn rays_per_second(&self) -> f64 {
        self.progress.rays as f64 / self.progress.elapsed.as_secs_f64().max(1e-9)
    }

    pub(super) fn summary(&self) -> String {
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
    pub(super) fn accuracy(&self) -> Vec<String> {
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
    pub(super) fn print_dropped(&self) {
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
    pub(super) fn photon_warnings(&self) -> Vec<String> {
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
    pub(super) fn metadata(&self) -> Vec<(String, String)> {
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

    pub(super) fn statistics(&self) -> Value {
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
    for (name, value) in &args.reading.define {
        let _ = write!(command, " -D {name}={value}");
    }
    if let Some(size) = args.size {
        let _ = write!(command, " --size {}x{}", size.x, size.y);
    }
    if let Some(backend) = &args.backend {
        let _ = write!(command, " --backend {backend}");
    }
    if args.reading.lenient {
        command.push_str(" --lenient");
    }
    command
}

/// What is left to say when a render has ended.
pub(super) struct Ended {
    /// Exit code.
    pub(super) code: u8,
    /// For --json; of what is not an image there are none.
    pub(super) statistics: Option<Value>,
}

impl Ended {
    pub(super) fn without_statistics(code: u8) -> Self {
        Self { code, statistics: None }
    }

    /// Prints what a crosscheck found, and adds it to the statistics. A fault decides the exit code.
    pub(super) fn add_crosscheck(&mut self, query: &AnyQuery, quiet: bool) {
        let AnyQuery::Crosscheck(crosscheck) = query else { return };
        let (findings, names) = (crosscheck.findings(), crosscheck.names());
        let names = names.each_ref().map(String::as_str);
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
            eprintln!("# {}\n{}", judged.blame(names), judged.dispute);
        }
        if let Some(statistics) = &mut self.statistics {
            let mut found = counts(&findings);
            found["backends"] = json!(names);
            found["faults"] = faults(&findings.faults, names);
            statistics["crosscheck"] = found;
        }
        if !findings.is_clean() {
            self.code = EXIT_FAULTS;
        }
    }
}
