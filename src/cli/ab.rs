//! `helmholtz ab`: two backends on one scene.

use std::path::{Path, PathBuf};

use clap::Args;
use glam::UVec2;
use serde_json::{Value, json};

use super::common::{Reading, Threads};
use super::integrator::Wanted;
use super::render::resize;
use super::table::table;
use super::{CliError, EXIT_DONE, EXIT_FAULTS};
use crate::film::output::write_atomically;
use crate::query::crosscheck::{Answers, Dispute, Findings, Judged, parse_query};
use crate::query::reference::nearest;
use crate::query::{Backend, RayQuery};
use crate::render::Target;
use crate::scene::Shape;
use crate::scene::load::{Loaded, load};
use crate::spec::{Spec, size, spec};
use crate::study::ab::{self, Effort, KINDS, Report};
use crate::transport::World;

/// Compare two ray-query backends on the rays of an integrator
///
/// Renders the scene with both by the same seed, then asks both for the rays that the integrator traces: primary (from the camera), bounce (all other
/// closest hits) and shadow rays. Answers that differ are told apart into ties, which are right to f32 both (shared edges, silhouettes, ends of
/// intervals), and faults, which brute force in f64 decides. Each fault is printed with its ray in hexadecimal floats, to be asked again by --replay.
///
/// Times mean something on an idle machine only. Exit code 4 if a fault was found or disputes were too many to judge all.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  helmholtz ab scenes/cornell-box.xml
  helmholtz ab room.xml --rays 100000000 --integrator bdpt -o report.html
  helmholtz ab room.xml --a embree --b embree:robust=false > faults.txt
  helmholtz ab room.xml --replay faults.txt")]
pub(super) struct AbArgs {
    /// Mitsuba scene (.xml) or mesh (.obj, .ply)
    scene: PathBuf,
    /// The first backend, with settings as in `render --backend` [default: the default backend]
    #[arg(long, value_name = "NAME:KEY=VALUE,...", value_parser = spec)]
    a: Option<Spec>,
    /// The second
    #[arg(long, value_name = "NAME:KEY=VALUE,...", value_parser = spec, default_value = "obvhs")]
    b: Spec,
    /// Passes of the images
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..), default_value_t = 4)]
    spp: u32,
    /// Rays to compare, at least: passes go on until there are so many
    #[arg(long, value_name = "N", default_value_t = 2_000_000)]
    rays: u64,
    /// Ask the rays of a file instead: lines `closest` or `occluded`, origin, direction, least and greatest distance
    #[arg(long, value_name = "FILE", conflicts_with_all = ["output", "json"])]
    replay: Option<PathBuf>,
    /// Algorithm instead of the scene's, as in `render --integrator`
    #[arg(long, value_name = "NAME:KEY=VALUE,...", value_parser = spec)]
    integrator: Option<Spec>,
    /// Seed of the random numbers
    #[arg(long, default_value_t = 0)]
    seed: u64,
    #[command(flatten)]
    threads: Threads,
    /// Film size in pixels instead of the scene's
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    size: Option<UVec2>,
    #[command(flatten)]
    reading: Reading,
    /// Write a report with images to one HTML file
    #[arg(short, long, value_name = "FILE.html")]
    output: Option<PathBuf>,
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

pub(super) fn run(args: &AbArgs) -> Result<u8, CliError> {
    let first =
        args.a.as_ref().map_or_else(|| Ok(Backend::default()), |s| Backend::new(&s.name, &s.parameters))?;
    let backends = [first, Backend::new(&args.b.name, &args.b.parameters)?];
    args.threads.start()?;
    let Loaded { mut scene, warnings, .. } = load(&args.scene, &args.reading.options())?;
    for warning in &warnings {
        eprintln!("{warning}");
    }
    if let Some(file) = &args.replay {
        return replay(&scene.shapes, backends, file);
    }
    if let Some(size) = args.size {
        resize(&mut scene, size);
    }
    let wanted = Wanted::new(args.integrator.as_ref(), &scene.integrator, args.reading.lenient)?;
    let (integrator, remark) = wanted.resolve(&scene, &backends[0].build(&scene.shapes)?)?;
    if let Some(remark) = remark {
        eprintln!("{remark}");
    }
    let target = Target { integrator, seed: args.seed };
    let effort = Effort { passes: args.spp, rays: args.rays };
    let report = ab::run(&World::new(&scene), backends, &target, effort)?;
    if let Some(path) = &args.output {
        let title =
            format!("{}: {} and {}", args.scene.display(), report.sides[0].name, report.sides[1].name);
        let page = report.html(&title).map_err(|error| format!("{}: {error}", path.display()))?;
        write_atomically(path, |file| std::io::Write::write_all(file, page.as_bytes()))?;
        eprintln!("wrote {}", path.display());
    }
    if args.json {
        println!("{:#}", statistics(args, &report, &integrator.describe()));
    } else {
        // The tables as comments, so that all of it can be replayed.
        for rows in [report.costs(), report.agreement()] {
            print!("{}", table(&rows, "# "));
        }
        println!("# {}", report.difference());
        if report.not_recorded > 0 {
            println!(
                "# {} rays were not compared, for want of room: a pass has too many",
                report.not_recorded
            );
        }
        print!("{}", report.fault_list());
    }
    Ok(if report.is_clean() { EXIT_DONE } else { EXIT_FAULTS })
}

/// Asks both backends each query of a file and says what came of it.
fn replay(shapes: &[Shape], backends: [Backend; 2], file: &Path) -> Result<u8, CliError> {
    let text = std::fs::read_to_string(file).map_err(|error| format!("{}: {error}", file.display()))?;
    let mut queries = Vec::new();
    for (number, line) in
        text.lines().enumerate().filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
    {
        let query =
            parse_query(line).map_err(|error| format!("{}:{}: {error}", file.display(), number + 1))?;
        queries.push(query);
    }
    let [a, b] = backends;
    let pair = [a.build(shapes)?, b.build(shapes)?];
    let names = pair.each_ref().map(RayQuery::name);
    let mut is_clean = true;
    for (is_occlusion, ray) in queries {
        let answers = if is_occlusion {
            Answers::Occlusion(pair.each_ref().map(|query| query.occluded(&ray)))
        } else {
            Answers::Closest(pair.each_ref().map(|query| query.intersect(&ray)))
        };
        let dispute = Dispute { ray, answers };
        let judged = Judged { dispute, faults: dispute.judge(shapes) };
        println!("{dispute}");
        match answers {
            Answers::Closest(hits) => {
                for (name, hit) in names.iter().zip(hits) {
                    println!(
                        "#   {name}: {}",
                        hit.map_or("nothing".to_owned(), |h| describe(h.shape, h.primitive, f64::from(h.t)))
                    );
                }
            }
            Answers::Occlusion(occluded) => {
                for (name, occluded) in names.iter().zip(occluded) {
                    println!("#   {name}: {}", if occluded { "occluded" } else { "free" });
                }
            }
        }
        let truth = nearest(shapes, &ray);
        println!("#   f64: {}", truth.map_or("nothing".to_owned(), |c| describe(c.shape, c.primitive, c.t)));
        let verdict = match judged.faults {
            [None, None] => "both are right to f32".to_owned(),
            _ => judged.blame(names.each_ref().map(String::as_str)),
        };
        println!("#   {verdict}");
        is_clean &= judged.faults == [None, None];
    }
    Ok(if is_clean { EXIT_DONE } else { EXIT_FAULTS })
}

fn describe(shape: u32, primitive: u32, t: f64) -> String {
    format!("shape {shape}, primitive {primitive}, at {t}")
}

fn statistics(args: &AbArgs, report: &Report, integrator: &str) -> Value {
    let side = |i: usize| {
        let side = &report.sides[i];
        let rates: serde_json::Map<_, _> = KINDS
            .iter()
            .enumerate()
            .map(|(k, kind)| ((*kind).to_owned(), json!(report.rays_per_second(i, k))))
            .collect();
        json!({
            "name": side.name,
            "build_seconds": side.build.as_secs_f64(),
            "bytes": side.bytes,
            "bytes_per_primitive": side.bytes as f64 / report.primitives.max(1) as f64,
            "rays_per_second": rates,
            "render_seconds": side.rendering.as_secs_f64(),
        })
    };
    let rays: serde_json::Map<_, _> =
        KINDS.iter().zip(&report.findings).map(|(kind, found)| ((*kind).to_owned(), counts(found))).collect();
    let difference = &report.difference;
    let names = report.sides.each_ref().map(|side| side.name.as_str());
    json!({
        "scene": args.scene,
        "integrator": integrator,
        "seed": args.seed,
        "threads": rayon::current_num_threads(),
        "primitives": report.primitives,
        "passes": report.passes,
        "backends": [side(0), side(1)],
        "rays": rays,
        "rays_not_recorded": report.not_recorded,
        "difference": {
            "pixels": difference.pixels,
            "rmse": difference.errors.map(|e| e.rmse()),
            "relmse": difference.errors.map(|e| e.rel_mse),
            "flip_ldr": difference.flip_ldr,
            "flip_hdr": difference.flip_hdr,
        },
        "faults": faults(report.faults(), names),
    })
}

/// How often two backends agreed, as JSON.
pub(super) fn counts(found: &Findings) -> Value {
    json!({
        "compared": found.closest + found.occlusion,
        "same_by_ulps": found.same,
        "ties": found.ties,
        "faults": found.faults.len(),
        "not_judged": found.not_judged,
    })
}

/// Faults of backends of these names as JSON: each query as --replay reads it, with what is wrong.
pub(super) fn faults<'f>(faults: impl IntoIterator<Item = &'f Judged>, names: [&str; 2]) -> Value {
    let fault =
        |judged: &Judged| json!({ "query": judged.dispute.to_string(), "fault": judged.blame(names) });
    faults.into_iter().map(fault).collect()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::query::reference::Fault;
    use crate::query::{Hit, Ray};

    #[test]
    fn faults_are_told_in_json_with_queries_that_can_be_asked_again() {
        let ray = Ray { t_max: 3.5, ..Ray::new(Vec3::new(0.1, -2.0, 1e-30), Vec3::Y) };
        let hit = Hit { shape: 1, primitive: 2, u: 0.25, v: 0.5, t: 2.0 };
        let closest = Dispute { ray, answers: Answers::Closest([None, Some(hit)]) };
        let occlusion = Dispute { ray, answers: Answers::Occlusion([true, false]) };
        let (missed, imagined) = (Fault::Missed { at: 2.0 }, Fault::Imagined);
        let judged = [
            Judged { dispute: closest, faults: [Some(missed), None] },
            Judged { dispute: occlusion, faults: [Some(imagined), Some(missed)] },
        ];
        let value = faults(&judged, ["one", "two"]);
        assert_eq!(value[0]["fault"], format!("one {missed}"));
        assert_eq!(value[1]["fault"], format!("one {imagined}; two {missed}"));
        assert_eq!(value.as_array().map(Vec::len), Some(2));
        for (i, is_occlusion) in [(0, false), (1, true)] {
            assert_eq!(parse_query(value[i]["query"].as_str().unwrap()), Ok((is_occlusion, ray)));
        }
    }
}
