//! The same XML through Mitsuba 3 (`scalar_rgb`) and through us, compared by blocks of 8x8 pixels.
//!
//! Both sides render [`RUNS`] independent images, which gives each block's mean a standard error with 15 degrees of freedom. Of the
//! difference in units of its error, 9.5 is exceeded with a chance below 1.0e-7 (Student's t at the fewer degrees of
//! freedom), so that 10 000 comparisons raise a false alarm with a chance below 1e-3. Blocks cannot see a bias that is everywhere
//! the same and small; the mean over the image can: it may differ by 6 errors, chance 2.4e-5 a scene.
//!
//! A scene below `tests/scenes/same` is that of the same name in words or files that Mitsuba 3 does not read, and is compared with its image.
//!
//! Needs Mitsuba in `.venv`, as `.ci/run` installs it; without it the test says that it is skipped.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use helmholtz::integrators::Integrator;
use helmholtz::query::RayQuery;
use helmholtz::scene::Scene;
use helmholtz::scene::load::{LoadOptions, load};
use helmholtz::transport::World;

use crate::backends::{BackendTest, on_each_backend};
use crate::images::{Estimate, estimate, render_runs};

const RUNS: usize = 16;
const BLOCK_LIMIT: f64 = 9.5;
const IMAGE_LIMIT: f64 = 6.0;

fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

/// What `mitsuba_reference.py` wrote for a scene: every run's image.
fn reference(stem: &str, out: &Path) -> (Estimate, usize) {
    let text = fs::read_to_string(out.join(format!("{stem}.json"))).expect("the description of a reference");
    let json: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let number = |key: &str| json[key].as_u64().expect("a number") as usize;
    let (width, height) = (number("width"), number("height"));
    let bytes = fs::read(out.join(format!("{stem}.f32"))).expect("the reference");
    let floats: Vec<f32> =
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    let pixels: Vec<[f32; 3]> = floats.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
    assert_eq!(pixels.len(), RUNS * width * height);
    let images: Vec<_> = pixels.chunks_exact(width * height).map(<[_]>::to_vec).collect();
    (estimate(&images, width), width)
}

struct Case<'a> {
    name: &'a str,
    scene: &'a Scene,
    reference: &'a Estimate,
    width: usize,
}

impl BackendTest for Case<'_> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let world = World::new(self.scene);
        let settings = &self.scene.integrator;
        let name = settings.name.as_deref().expect("the scenes name their integrator");
        let integrator = Integrator::new(name, &settings.parameters).expect("a known integrator");
        let images =
            render_runs(self.scene, &world, query, integrator, 0..RUNS as u64, self.scene.sample_count);
        let ours = estimate(&images, self.width);
        let what = format!("{} on {backend} against Mitsuba", self.name);
        let failures = ours.differences(self.reference, &what, IMAGE_LIMIT, BLOCK_LIMIT);
        let shown = failures.len().min(8);
        assert!(failures.is_empty(), "{} differences:\n{}", failures.len(), failures[..shown].join("\n"));
    }
}

#[test]
fn scenes_agree_with_mitsuba() {
    let python = project(".venv/bin/python");
    if !python.exists() {
        eprintln!("skipped: no Mitsuba in .venv; .ci/run installs it");
        return;
    }
    let mut scenes: Vec<PathBuf> = fs::read_dir(project("tests/scenes"))
        .expect("tests/scenes")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|e| e == "xml"))
        .collect();
    scenes.sort();
    assert!(scenes.len() >= 12, "scenes are missing");
    // While developing: only scenes whose names contain one of these words.
    if let Ok(words) = std::env::var("MITSUBA_SCENES") {
        let name = |path: &PathBuf| path.file_stem().map(|s| s.to_string_lossy().into_owned());
        scenes.retain(|path| name(path).is_some_and(|name| words.split(',').any(|w| name.contains(w))));
    }
    let out = Path::new(env!("CARGO_TARGET_TMPDIR")).join("mitsuba");
    let status = Command::new(python)
        .arg(project("tests/mitsuba_reference.py"))
        .args(&scenes)
        .arg("--out")
        .arg(&out)
        .args(["--runs", &RUNS.to_string()])
        .status()
        .expect("Python runs");
    assert!(status.success(), "Mitsuba failed");
    let mut failures = Vec::new();
    for path in &scenes {
        let stem = path.file_stem().and_then(|s| s.to_str()).expect("a name");
        let (reference, width) = reference(stem, &out);
        // Below `same`: the same scene in words or files that Mitsuba 3 does not read.
        let same = path.with_file_name("same").join(format!("{stem}.xml"));
        for path in [Some(path), Some(&same).filter(|p| p.exists())].into_iter().flatten() {
            let scene = load(path, &LoadOptions::default()).unwrap_or_else(|error| panic!("{error}")).scene;
            let case = Case { name: stem, scene: &scene, reference: &reference, width };
            // All scenes are compared before the test fails.
            let run = std::panic::AssertUnwindSafe(|| on_each_backend(&scene.shapes, &case));
            if std::panic::catch_unwind(run).is_err() {
                failures.push(path.display().to_string());
            }
        }
    }
    assert!(failures.is_empty(), "these differ from Mitsuba: {}", failures.join(", "));
}
