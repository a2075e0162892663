//! Running a study: what it measures is what plain renders make, what is finished is not made again, and bias is told from noise. Budgets are milliseconds, but nothing here
//! depends on how much is rendered in them.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use glam::{DMat3, UVec2, Vec3};
use helmholtz::film::output::write_exr;
use helmholtz::film::{AovSet, Channel, Film, Image, Pixels};
use helmholtz::integrators::{Integrator, PathLength};
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::{Backend, BuildQuality, RayQuery};
use helmholtz::render::{Control, Stop, Target, render};
use helmholtz::scene::{Emitter, EnvironmentMap, PixelRect, Rgb, Scene};
use helmholtz::spec::spec;
use helmholtz::study::StudyError;
use helmholtz::study::bias::{noise, squared_bias};
use helmholtz::study::converge::{Groups, render_to_error};
use helmholtz::study::flip;
use helmholtz::study::metrics::compare;
use helmholtz::study::picture::{Picture, seed_of};
use helmholtz::study::plan::{Plan, Planner};
use helmholtz::study::reference::{SEED, Source};
use helmholtz::study::results::{Results, Run};
use helmholtz::study::run::{Backends, Event, Outcome, Settings, run};
use helmholtz::transport::World;
use tempfile::TempDir;

use crate::scene_builder::{Build, diffuse, empty, image, quad, sphere};
use crate::support::Rng;

const OBVHS: Backend = Backend::Obvhs(BuildQuality::Medium);
const LENGTH: PathLength = PathLength { max_depth: Some(4), rr_depth: 5 };

/// A lamp over a corner, 16x16.
fn scene() -> Scene {
    let mut scene = empty()
        .shape(quad(Vec3::new(-3.0, -1.0, 2.0), Vec3::Z * 6.0, Vec3::X * 6.0), diffuse(0.7), None)
        .shape(quad(Vec3::new(-3.0, -1.0, 6.0), Vec3::Y * 4.0, Vec3::X * 6.0), diffuse(0.5), None)
        .shape(sphere(Vec3::new(0.5, 2.0, 4.0), 0.3), diffuse(0.0), Some(Rgb::splat(20.0)));
    let size = UVec2::splat(16);
    (scene.film.size, scene.film.crop) = (size, PixelRect { min: UVec2::ZERO, size });
    scene
}

struct Trial {
    scene: Scene,
    folder: TempDir,
    settings: Settings,
    plan: Plan,
}

/// What a study said.
#[derive(Debug, Default, PartialEq)]
struct Heard {
    /// Passes of the reference.
    reference: usize,
    /// Names and seeds of the runs that were rendered, and of those that were kept.
    rendered: Vec<(String, u64)>,
    kept: Vec<(String, u64)>,
    broken: Vec<PathBuf>,
    failed: Vec<(String, String)>,
}

impl Trial {
    fn new(integrators: &[&str]) -> Self {
        let scene = scene();
        let mut planner = Planner::new(LENGTH, OBVHS);
        for text in integrators {
            planner.integrator(&spec(text).expect("a spec")).expect("an integrator");
        }
        let query = ObvhsQuery::new(&scene.shapes, BuildQuality::Medium);
        let plan = planner.resolve(&scene, &query).expect("a plan");
        let folder = tempfile::tempdir().expect("a folder");
        let settings = Settings {
            scene: "corner".to_owned(),
            fingerprint: "1234".to_owned(),
            load: Duration::from_millis(3),
            length: LENGTH,
            backend: OBVHS,
            budgets: [1, 5, 20].map(Duration::from_millis).to_vec(),
            seeds: vec![1, 2],
            reference: Source::Rendered(Duration::from_millis(50)),
            folder: folder.path().join("study"),
        };
        Self { scene, folder, settings, plan }
    }

    /// Runs the study; `stop_after` so many passes of runs.
    fn try_run(&self, stop_after: usize) -> (Result<Option<Outcome>, StudyError>, Heard) {
        let mut heard = Heard::default();
        let mut passes = 0;
        let mut backends = Backends::new(&self.scene.shapes);
        let result = run(&self.scene, &self.settings, &self.plan, &mut backends, &mut |event| {
            match event {
                Event::Reference { .. } => heard.reference += 1,
                Event::Rendering { .. } => passes += 1,
                Event::Compared(_) => {}
                Event::Finished { name, run, is_new } => {
                    let list = if *is_new { &mut heard.rendered } else { &mut heard.kept };
                    list.push(((*name).to_owned(), run.seed));
                }
                Event::Broken { file, .. } => heard.broken.push(file.to_path_buf()),
                Event::Failed { name, why } => heard.failed.push(((*name).to_owned(), (*why).to_owned())),
            }
            if passes >= stop_after { Control::Stop } else { Control::Continue }
        });
        (result, heard)
    }

    fn run(&self) -> (Results, Heard) {
        let (result, heard) = self.try_run(usize::MAX);
        (result.expect("a study").expect("not interrupted").results, heard)
    }

    /// The folders of the runs of an integrator with a seed.
    fn cell(&self, integrator: &str, seed: u64) -> PathBuf {
        let start = format!("{integrator}-{seed}-");
        let entries = fs::read_dir(self.settings.folder.join("cells")).expect("cells");
        let mut found = entries
            .map(|e| e.expect("an entry").path())
            .filter(|path| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&start)));
        let cell = found.next().expect("a cell");
        assert!(found.next().is_none());
        cell
    }
}

fn pairs(names: &[(&str, u64)]) -> Vec<(String, u64)> {
    names.iter().map(|(name, seed)| ((*name).to_owned(), *seed)).collect()
}

fn film(scene: &Scene, world: &World) -> Film {
    Film::new(&scene.film, AovSet::default(), world.lights.radiance_unit()).expect("a film")
}

fn rendered<Q: RayQuery>(
    scene: &Scene,
    query: &Q,
    integrator: Integrator,
    seed: u64,
    passes: u32,
) -> Picture {
    let world = World::new(scene);
    let mut film = film(scene, &world);
    let stop = Stop { passes: 0..passes, time: None };
    render(&world, query, &Target { integrator, seed }, &mut film, &stop, |_| Control::Continue)
        .expect("rendered");
    Picture::of(&film.develop())
}

/// Each state that was measured is, to the bit, what a render of its passes makes, and errors are those against the reference that is kept.
#[test]
fn what_is_measured_is_what_is_rendered() {
    let trial = Trial::new(&["path", "ptracer", "bdpt", "sppm:photons=500", "vpl:count=10"]);
    let (results, heard) = trial.run();
    let names: Vec<_> = trial.plan.configurations.iter().map(|c| c.name.as_str()).collect();
    // Seed by seed, so that what is there early is about all.
    let expected: Vec<_> =
        [1, 2].iter().flat_map(|&seed| names.iter().map(move |&name| (name, seed))).collect();
    assert_eq!(heard.rendered, pairs(&expected));
    assert!(heard.kept.is_empty() && heard.broken.is_empty() && heard.failed.is_empty(), "{heard:?}");

    let reference = Picture::read(&trial.settings.folder.join("reference.exr")).expect("a reference");
    assert!(reference.variance.is_some());
    assert_eq!(seed_of(&trial.settings.folder.join("reference.exr")), Some(SEED));
    assert!(results.reference.rel_mse.is_some_and(|e| e > 0.0));
    assert!(results.reference.seconds.is_some_and(|s| s >= 0.05));
    assert!(heard.reference.is_multiple_of(8), "{} passes of the reference", heard.reference);
    assert_eq!((results.scene.as_str(), results.size, results.load), ("corner", [16, 16], 0.003));
    assert_eq!((results.budgets.as_slice(), results.configurations.len()), (&[0.001, 0.005, 0.02][..], 5));

    let query = ObvhsQuery::new(&trial.scene.shapes, BuildQuality::Medium);
    for (planned, measured) in trial.plan.configurations.iter().zip(&results.configurations) {
        assert_eq!((&measured.name, &measured.bias), (&planned.name, &planned.bias));
        assert_eq!(measured.integrator, planned.integrator.describe());
        assert_eq!((measured.backend.as_str(), &measured.failure), ("obvhs:quality=medium", &None));
        assert_eq!(measured.squared_bias.len(), 3);
        let kind = measured.integrator.split(':').next().expect("a name");
        let mut all: Vec<Vec<Picture>> = vec![Vec::new(); 3];
        for (run, seed) in measured.runs.iter().zip([1, 2]) {
            let Run { points, first_image, query_bytes, build, .. } = run;
            assert!(run.seed == seed && points.len() == 3 && *query_bytes > 0 && *build > 0.0);
            assert!(*first_image > 0.0 && *first_image <= points[0].seconds);
            for ((point, budget), all) in points.iter().zip(&results.budgets).zip(&mut all) {
                assert!(point.seconds >= *budget && point.passes >= 1 && point.rays > 0);
                let image = rendered(&trial.scene, &query, planned.integrator, seed, point.passes);
                let kept = trial.cell(kind, seed).join(format!("{}.exr", point.passes));
                assert_eq!(Picture::read(&kept).expect("an image").pixels, image.pixels, "{}", planned.name);
                assert_eq!(seed_of(&kept), Some(seed));
                let errors = compare(&reference, &image).expect("one size");
                let found = (point.mse, point.rel_mse, point.rel_mse_trimmed);
                assert_eq!(found, (errors.mse, errors.rel_mse, errors.rel_mse_trimmed));
                assert_eq!(point.flip, flip::ldr(&reference, &image));
                all.push(image);
            }
            // The first budget that a pass uses up is measured at its end.
            assert!(points.windows(2).all(|p| p[0].passes <= p[1].passes && p[0].rays <= p[1].rays));
        }
        for (images, bias) in all.iter().zip(&measured.squared_bias) {
            assert_eq!(squared_bias(images, &reference), Some(*bias));
        }
    }
}

#[test]
fn what_is_finished_is_kept() {
    let mut trial = Trial::new(&["path", "bdpt"]);
    let (first, _) = trial.run();
    let note = trial.cell("path", 1).join("note.txt");
    fs::write(&note, "mine").expect("written");
    fs::write(trial.settings.folder.join("note.txt"), "mine").expect("written");
    let all = [("path", 1), ("bdpt", 1), ("path", 2), ("bdpt", 2)];

    // Nothing is rendered, and the numbers are the same.
    let (again, heard) = trial.run();
    assert_eq!(again, first);
    assert_eq!(heard, Heard { kept: pairs(&all), ..Heard::default() });

    // What is missing or broken is made again, and nothing else.
    let json = trial.cell("bdpt", 1).join("run.json");
    fs::remove_file(&json).expect("removed");
    let remade = |trial: &Trial| {
        let (_, heard) = trial.run();
        assert_eq!((heard.reference, heard.rendered.len() + heard.kept.len()), (0, 4));
        (heard.rendered, heard.broken)
    };
    assert_eq!(remade(&trial), (pairs(&[("bdpt", 1)]), vec![]));
    let whole = fs::read(&json).expect("made again");
    for broken in [&b"{"[..], &[0xff; 40], &whole[..whole.len() / 2], b"{}"] {
        fs::write(&json, broken).expect("written");
        assert_eq!(remade(&trial), (pairs(&[("bdpt", 1)]), vec![json.clone()]));
    }
    // Of another run, and with a point too few.
    let text = String::from_utf8(fs::read(&json).expect("there")).expect("text");
    fs::write(&json, text.replacen("\"seed\": 1", "\"seed\": 2", 1)).expect("written");
    assert_eq!(remade(&trial).1, vec![json.clone()]);
    let mut value: serde_json::Value =
        serde_json::from_slice(&fs::read(&json).expect("there")).expect("JSON");
    value["run"]["points"].as_array_mut().expect("points").pop();
    fs::write(&json, value.to_string()).expect("written");
    assert_eq!(remade(&trial).1, vec![json]);
    let last = again.configurations[0].runs[1].points[2].passes;
    let image = trial.cell("path", 2).join(format!("{last}.exr"));
    let bytes = fs::read(&image).expect("an image");
    fs::write(&image, &bytes[..bytes.len() / 2]).expect("written");
    assert_eq!(remade(&trial), (pairs(&[("path", 2)]), vec![image]));

    // A broken reference is made again. It may have as many passes as before and be the same; then the runs are kept.
    let reference = trial.settings.folder.join("reference.exr");
    fs::write(&reference, b"nothing").expect("written");
    let (_, heard) = trial.run();
    assert_eq!((heard.broken, heard.rendered.len() + heard.kept.len()), (vec![reference], 4));
    assert!(heard.reference > 0);

    // Another reference makes all anew.
    let other = trial.settings.folder.join("other.pfm");
    let [width, height] = first.size;
    let header = format!("PF\n{width} {height}\n-1.0\n").into_bytes();
    let pixels = (0..3 * width * height).flat_map(|_| 0.5_f32.to_le_bytes());
    fs::write(&other, header.into_iter().chain(pixels).collect::<Vec<_>>()).expect("written");
    let rendered = std::mem::replace(&mut trial.settings.reference, Source::File(other));
    assert_eq!(trial.run().1.rendered.len(), 4);
    trial.settings.reference = rendered;
    assert_eq!(trial.run().1, Heard { kept: pairs(&all), ..Heard::default() });

    // So do other budgets, threads apart, and the old ones are still there.
    let budgets = std::mem::replace(&mut trial.settings.budgets, vec![Duration::from_millis(2)]);
    assert_eq!(trial.run().1.rendered.len(), 4);
    trial.settings.budgets = budgets;
    assert_eq!(trial.run().1, Heard { kept: pairs(&all), ..Heard::default() });
    trial.settings.fingerprint = "5678".to_owned();
    let (_, heard) = trial.run();
    assert!(heard.rendered.len() == 4 && heard.reference > 0);
    assert_eq!(fs::read(&note).expect("still there"), b"mine");
    assert!(trial.settings.folder.join("note.txt").exists());
}

/// Two names for one thing are rendered once.
#[test]
fn what_is_the_same_is_rendered_once() {
    let trial = Trial::new(&["path", "path:rr_depth=5"]);
    let (results, heard) = trial.run();
    assert_eq!(heard.rendered, pairs(&[("path", 1), ("path", 2)]));
    assert_eq!(heard.kept, pairs(&[("path:rr_depth=5", 1), ("path:rr_depth=5", 2)]));
    assert_eq!(results.configurations[0].runs, results.configurations[1].runs);
}

#[test]
fn an_interrupted_study_goes_on() {
    let mut trial = Trial::new(&["path", "bdpt"]);
    // One pass uses up this, so that runs are passes.
    trial.settings.budgets = vec![Duration::from_nanos(1)];
    let (result, heard) = trial.try_run(3);
    assert!(result.expect("no error").is_none());
    // The run that the last pass finished is kept.
    assert_eq!(heard.rendered, pairs(&[("path", 1), ("bdpt", 1), ("path", 2)]));
    let (_, heard) = trial.run();
    assert_eq!(heard.kept, pairs(&[("path", 1), ("bdpt", 1), ("path", 2)]));
    assert_eq!((heard.reference, heard.rendered), (0, pairs(&[("bdpt", 2)])));
    // In the middle of a run nothing of it is kept.
    trial.settings.budgets = vec![Duration::from_hours(1)];
    let (result, heard) = trial.try_run(2);
    assert!(result.expect("no error").is_none() && heard.rendered.is_empty());
    // Nor of a reference.
    trial.settings.reference = Source::Rendered(Duration::from_hours(1));
    let (result, heard) = trial.try_run(0);
    assert!(result.expect("no error").is_none() && heard.reference == 1);
}

fn exr(path: &Path, size: u32, value: f32, seed: Option<&str>) {
    let size = UVec2::splat(size);
    let plane = |name: &'static str| Channel {
        name: name.into(),
        pixels: Pixels::Float(vec![value; (size.x * size.y) as usize]),
    };
    let channels = ["R", "G", "B"].map(plane).to_vec();
    let image = Image { film_size: size, crop: PixelRect { min: UVec2::ZERO, size }, channels };
    let metadata: Vec<_> = seed.map(|seed| ("seed".to_owned(), seed.to_owned())).into_iter().collect();
    write_exr(path, &image, false, &metadata).expect("written");
}

#[test]
fn settings_that_make_no_sense_are_refused() {
    let mut trial = Trial::new(&["path"]);
    let path = trial.folder.path().join("truth.exr");
    let refused = |trial: &Trial, why: &str| {
        let (result, heard) = trial.try_run(usize::MAX);
        let error = result.expect_err(why).to_string();
        assert!(error.contains(why), "{error}");
        assert_eq!(heard, Heard::default());
    };
    trial.settings.seeds = vec![1, SEED];
    refused(&trial, "the reference was rendered with seed");
    trial.settings.seeds = vec![1, 1];
    refused(&trial, "all different");
    trial.settings.seeds = Vec::new();
    refused(&trial, "at least one");
    trial.settings.seeds = vec![1, 2];
    for budgets in [&[][..], &[0], &[2, 2], &[2, 1]] {
        trial.settings.budgets = budgets.iter().map(|&ms| Duration::from_millis(ms)).collect();
        refused(&trial, "each greater");
    }
    trial.settings.budgets = vec![Duration::from_millis(1)];
    trial.settings.reference = Source::File(path.clone());
    refused(&trial, "truth.exr");
    exr(&path, 15, 0.5, None);
    refused(&trial, "15 x 15 pixels, but the images are 16 x 16");
    exr(&path, 16, 0.5, Some("2"));
    refused(&trial, "rendered with seed 2");
    let png = trial.folder.path().join("truth.png");
    fs::write(
        &png,
        helmholtz::film::output::encode_png(&Image {
            film_size: UVec2::splat(16),
            crop: PixelRect { min: UVec2::ZERO, size: UVec2::splat(16) },
            channels: Vec::new(),
        })
        .expect("a PNG"),
    )
    .expect("written");
    trial.settings.reference = Source::File(png);
    refused(&trial, "integers");
    // Other seeds, and ones that are not known, are fine.
    trial.settings.reference = Source::File(path.clone());
    for seed in [Some("3"), None, Some("many")] {
        exr(&path, 16, 0.5, seed);
        let (results, heard) = trial.run();
        assert_eq!((heard.reference, heard.rendered.len()), (0, 2));
        assert_eq!((results.reference.rel_mse, results.reference.seconds), (None, None));
        assert!(results.reference.origin.contains("truth.exr"));
    }
    // A study of images that cannot be compared has failures, not errors.
    exr(&path, 16, f32::NAN, None);
    let (results, heard) = trial.run();
    assert_eq!(heard.failed.len(), 1);
    let [measured] = results.configurations.as_slice() else { panic!("one") };
    assert!(measured.failure.as_deref().is_some_and(|why| why.contains("no pixel that is finite")));
    assert!(measured.runs.is_empty() && measured.squared_bias.is_empty());
}

/// What one backend cannot build is told, and the others are rendered.
#[cfg(feature = "embree")]
#[test]
fn a_configuration_that_fails_does_not_end_the_study() {
    let mut trial = Trial::new(&["path"]);
    // Beyond Embree's coordinates.
    trial.scene = trial.scene.shape(sphere(Vec3::X * 1e19, 1.0), diffuse(0.5), None);
    let mut planner = Planner::new(LENGTH, OBVHS);
    let path = spec("path").expect("a spec");
    planner.add("a".to_owned(), &path, Some(&spec("embree").expect("a spec")), None).expect("new");
    planner.add("b".to_owned(), &path, None, None).expect("new");
    let query = ObvhsQuery::new(&trial.scene.shapes, BuildQuality::Medium);
    trial.plan = planner.resolve(&trial.scene, &query).expect("a plan");
    let (results, heard) = trial.run();
    assert_eq!(heard.rendered, pairs(&[("b", 1), ("b", 2)]));
    let [(name, why)] = heard.failed.as_slice() else { panic!("one fails: {heard:?}") };
    assert!(name == "a" && why.contains("reaches beyond"), "{why}");
    let failed = &results.configurations[0];
    assert_eq!((failed.failure.as_deref(), failed.runs.len()), (Some(why.as_str()), 0));
    assert_eq!(results.configurations[1].runs.len(), 2);
}

/// The same light by two ways of sampling it: both are rendered, kept apart, and do what they say.
#[test]
fn ways_to_sample_the_environment_are_configurations() {
    let mut trial = Trial::new(&[]);
    let texels = (0..64 * 32).map(|i| if i == 64 * 8 + 20 { [900.0; 3] } else { [0.1; 3] }).collect();
    let map = EnvironmentMap::new(image(UVec2::new(64, 32), texels), 1.0, DMat3::IDENTITY).expect("a map");
    trial.scene = trial.scene.emitter(Emitter::Map(map));
    let mut planner = Planner::new(LENGTH, OBVHS);
    let path = spec("path").expect("a spec");
    planner.add("all".to_owned(), &path, None, None).expect("new");
    planner.add("two".to_owned(), &path, None, Some(2)).expect("new");
    let query = ObvhsQuery::new(&trial.scene.shapes, BuildQuality::Medium);
    trial.plan = planner.resolve(&trial.scene, &query).expect("a plan");
    let (results, heard) = trial.run();
    assert_eq!(heard.rendered, pairs(&[("all", 1), ("two", 1), ("all", 2), ("two", 2)]));
    assert_eq!(
        results.configurations.iter().map(|c| c.sampling_columns).collect::<Vec<_>>(),
        [None, Some(2)]
    );
    // One texel of 2048 makes most light: with two columns it is hardly found.
    let variance = |i: usize| {
        let last = |run: &Run| run.points.last().map_or(f64::NAN, |p| p.rel_mse * f64::from(p.passes));
        results.configurations[i].runs.iter().map(last).sum::<f64>()
    };
    assert!(variance(1) > 4.0 * variance(0), "{} {}", variance(1), variance(0));
    assert!(trial.run().1.rendered.is_empty());
}

fn grey(values: &[f32]) -> Picture {
    let pixels = values.iter().map(|&v| Vec3::splat(v)).collect();
    Picture { size: UVec2::new(values.len() as u32, 1), pixels, variance: None, is_display: false }
}

/// By hand: means 1.5 and 3 of two images, whose variances of the mean are 0.25 and 1, against 1 and 2 with variances 0.01 and 0.02.
#[test]
fn squared_bias_by_hand() {
    let images = [grey(&[1.0, 2.0, f32::NAN]), grey(&[2.0, 4.0, 1.0])];
    let mut reference = grey(&[1.0, 2.0, 1.0]);
    let close = |found: Option<f64>, expected: f64| {
        let found = found.expect("an estimate");
        assert!((found - expected).abs() < 1e-9, "{found}, expected {expected}");
    };
    close(squared_bias(&images, &reference), f64::midpoint((0.25 - 0.25) / 1.01, (1.0 - 1.0) / 4.01));
    let images = [grey(&[1.0, 3.0, f32::NAN]), grey(&[2.0, 4.0, 1.0])];
    close(squared_bias(&images, &reference), f64::midpoint(0.0, (2.25 - 0.25) / 4.01));
    reference.variance = Some([0.01, 0.02, f32::INFINITY].map(Vec3::splat).to_vec());
    let expected = f64::midpoint(-f64::from(0.01_f32) / 1.01, (2.0 - f64::from(0.02_f32)) / 4.01);
    close(squared_bias(&images, &reference), expected);
    close(noise(&reference), f64::midpoint(f64::from(0.01_f32) / 1.01, f64::from(0.02_f32) / 4.01));
    assert_eq!(noise(&images[0]), None);
    assert_eq!(squared_bias(&images[..1], &reference), None);
    assert_eq!(squared_bias(&[grey(&[f32::NAN]), grey(&[1.0])], &grey(&[1.0])), None);
}

/// Images of known bias and noise, and a reference with noise: the estimate is the bias. Of 200 trials the mean is normal: 5 standard errors are exceeded once in 10^6.
#[test]
fn noise_is_taken_from_bias() {
    let mut random = Rng(7);
    // Uniform noise of that half width has a third of its square as variance.
    let mut noisy = |value: f32, width: f32| value + width * (2.0 * random.unit() as f32 - 1.0);
    let truth: Vec<f32> = (0..50).map(|i| 0.2 + 0.03 * i as f32).collect();
    for (bias, seeds) in [(0.0, 2), (0.0, 3), (0.05, 3)] {
        let estimates: Vec<f64> = (0..200)
            .map(|_| {
                let mut image = |bias: f32, width| {
                    grey(&truth.iter().map(|&t| noisy(t + bias, width)).collect::<Vec<_>>())
                };
                let images: Vec<_> = (0..seeds).map(|_| image(bias, 0.1)).collect();
                let mut reference = image(0.0, 0.02);
                reference.variance = Some(vec![Vec3::splat(0.02 * 0.02 / 3.0); truth.len()]);
                squared_bias(&images, &reference).expect("an estimate")
            })
            .collect();
        let (mean, error) = crate::images::mean_and_error(estimates.iter().copied());
        let relative = |t: &f32| f64::from(bias * bias) / (f64::from(t * t) + 0.01);
        let expected = truth.iter().map(relative).sum::<f64>() / truth.len() as f64;
        assert!((mean - expected).abs() < 5.0 * error, "{mean} +- {error}, expected {expected}");
        // The noise of the mean, were it not taken away, would be seen: it is more than twice the limit.
        let noise = |t: &f32| 0.01 / 3.0 / seeds as f64 / (f64::from(t * t) + 0.01);
        assert!(truth.iter().map(noise).sum::<f64>() / truth.len() as f64 > 10.0 * error);
    }
}

/// Bias of integrators: `path` has none; what virtual lights lose to their clamp is what a long render of them lacks. Means of nine estimates: 6 standard errors are exceeded by Student's t with 8
/// degrees of freedom once in 3000, and the seeds are fixed.
#[test]
fn bias_of_integrators_is_found() {
    let scene = scene();
    let query = ObvhsQuery::new(&scene.shapes, BuildQuality::Medium);
    let world = World::new(&scene);
    let named = |text: &str| {
        let text = spec(text).expect("a spec");
        Integrator::new(&text.name, &text.parameters).expect("an integrator")
    };
    let path = named("path:max_depth=4");
    let clamped = named("vpl:max_depth=4,count=20,clamp=1,compensate=false");
    let mut rounds = 0;
    let target = Target { integrator: path, seed: SEED };
    let outcome = render_to_error(&world, &query, &target, &film(&scene, &world), (0.0, None), |_, _| {
        rounds += 1;
        if rounds == 8 * 512 { Control::Stop } else { Control::Continue }
    })
    .expect("rendered");
    let reference = with_variance(outcome.groups);
    let estimates = |integrator, passes| {
        let of = |first: u64| {
            let images: Vec<_> =
                (first..first + 3).map(|seed| rendered(&scene, &query, integrator, seed, passes)).collect();
            squared_bias(&images, &reference).expect("an estimate")
        };
        crate::images::mean_and_error((0..9).map(|i| of(1 + 3 * i)).collect::<Vec<_>>().into_iter())
    };
    let (mean, error) = estimates(path, 16);
    let one = compare(&reference, &rendered(&scene, &query, path, 1, 16)).expect("one size").rel_mse;
    assert!(mean.abs() < 6.0 * error && error < 0.02 * one, "{mean} +- {error}; relMSE {one}");
    let long: Vec<_> = (100..102).map(|seed| rendered(&scene, &query, clamped, seed, 2048)).collect();
    let known = squared_bias(&long, &reference).expect("an estimate");
    let (mean, error) = estimates(clamped, 64);
    assert!((mean - known).abs() < 6.0 * error && error < 0.1 * known, "{mean} +- {error}, but {known}");
    assert!(known > 10.0 * noise(&reference).expect("a variance"), "{known}");
}

fn with_variance(groups: Groups) -> Picture {
    let planes = groups.variance().expect("whole rounds");
    let variance =
        (0..planes[0].len()).map(|i| Vec3::new(planes[0][i], planes[1][i], planes[2][i])).collect();
    let image = groups.merge().expect("one film").develop();
    Picture { variance: Some(variance), ..Picture::of(&image) }
}
