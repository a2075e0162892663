//! No contribution is infinite, no number or negative, and the backends agree on every ray: on every scene that there is, with every integrator. And what should not be is noticed.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{UVec2, Vec3};
use helmholtz::film::{AovSet, Film};
use helmholtz::integrators::{Integrator, Strategy};
use helmholtz::query::{AnyQuery, Backend};
use helmholtz::render::{Control, Stop, Target, render};
use helmholtz::scene::load::{LoadOptions, load};
use helmholtz::scene::{Emitter, PixelRect, Rgb, Scene};
use helmholtz::strategies::{OddCount, odd_contributions};
use helmholtz::transport::World;

use crate::scene_builder::{Build, diffuse, empty, quad};

/// An integrator: its name, and parameters as text.
type Algorithm = (&'static str, &'static [(&'static str, &'static str)]);

const INTEGRATORS: [Algorithm; 7] = [
    ("path", &[("max_depth", "8")]),
    ("ptracer", &[("max_depth", "8")]),
    ("bdpt", &[("max_depth", "8")]),
    ("photonmapper", &[("max_depth", "8"), ("photons", "1000"), ("k", "10")]),
    ("sppm", &[("max_depth", "8"), ("photons", "1000")]),
    ("vpl", &[("max_depth", "5"), ("count", "10")]),
    ("vpl", &[("max_depth", "5"), ("count", "10"), ("visibility", "shadowmap"), ("resolution", "8")]),
];

/// What [`INTEGRATORS`] do not come by.
const VARIANTS_OF_INTEGRATORS: [Algorithm; 8] = [
    ("path", &[("max_depth", "30"), ("rr_depth", "2"), ("hide_emitters", "true")]),
    ("ptracer", &[("max_depth", "30"), ("rr_depth", "2"), ("connect", "hit")]),
    ("bdpt", &[("max_depth", "12"), ("rr_depth", "2"), ("exponent", "1")]),
    ("photonmapper", &[("photons", "1000"), ("mode", "caustic"), ("lookup", "radius"), ("filter", "cone")]),
    ("photonmapper", &[("photons", "1000"), ("k", "10"), ("final_gather", "4"), ("direct", "nee")]),
    ("sppm", &[("photons", "1000"), ("filter", "gaussian"), ("direct", "photons")]),
    ("vpl", &[("count", "50"), ("samples", "3"), ("direct", "vpl")]),
    ("vpl", &[("count", "10"), ("visibility", "none"), ("compensate", "false")]),
];

/// What of `tests/scenes` is included by others and does not load by itself.
const OWN_PARTS: &[&str] = &["include/materials.xml"];
/// The same of Mitsuba's test suite; and two files in the dialects of other renderers, which are there in Mitsuba 3's words too.
const OTHERS_PARTS: &[&str] = &[
    "fragments/single_sphere.xml",
    "fragments/sphere_grid.xml",
    "sms-ring/ring_notebook_normalmapped.xml",
    "torus/obj/torus.xml",
];

fn target((name, parameters): Algorithm) -> Target {
    let owned: Vec<_> = parameters.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    Target { integrator: Integrator::new(name, &owned).expect("known"), seed: 11 }
}

/// What a scene is rendered by: size of the film and passes.
#[derive(Clone, Copy)]
struct Effort {
    size: UVec2,
    passes: u32,
    integrators: &'static [Algorithm],
}

/// For the ordinary tests.
const QUICK: Effort = Effort { size: UVec2::new(16, 12), passes: 1, integrators: &INTEGRATORS };
/// For those that are asked for by name.
const THOROUGH: Effort = Effort { size: UVec2::new(48, 36), passes: 4, integrators: &INTEGRATORS };
/// Other ways through the same integrators.
const VARIANTS: Effort = Effort { integrators: &VARIANTS_OF_INTEGRATORS, ..QUICK };

fn check(name: &str, scene: &mut Scene, effort: Effort) {
    let Effort { size, passes, integrators } = effort;
    scene.film.size = size;
    scene.film.crop = PixelRect { min: UVec2::ZERO, size };
    let scene = &*scene;
    let query = Backend::Crosscheck.build(&scene.shapes).expect("built");
    let world = World::new(scene);
    for &integrator in integrators {
        let target = target(integrator);
        let mut film =
            Film::new(&scene.film, AovSet::default(), world.lights.radiance_unit()).expect("a film");
        let stop = Stop { passes: 0..passes, time: None };
        render(&world, &query, &target, &mut film, &stop, |_| Control::Continue).expect("rendered");
        assert!(film.dropped().is_none(), "{name}, {integrator:?}: {:?}", film.dropped());
        // Each contribution by itself, which in a sum another might outweigh.
        let odd = odd_contributions(&world, &query, &target, passes).expect("rendered");
        assert!(odd.is_empty(), "{name}, {integrator:?}: {odd:?}");
    }
    let AnyQuery::Crosscheck(crosscheck) = &query else { panic!("no crosscheck") };
    let found = crosscheck.findings();
    assert!(found.is_clean(), "{name}: {:#?}, {} not judged", found.faults, found.not_judged);
    assert!(found.closest > 0, "{name}");
}

/// All scenes below a folder. Those named do not load by themselves; all others must.
fn check_all(
    folder: &Path,
    effort: Effort,
    extension: &str,
    parts: &[&str],
    is_wanted: fn(&Path) -> bool,
) -> usize {
    let mut pending = vec![folder.to_owned()];
    let mut files: Vec<PathBuf> = Vec::new();
    while let Some(folder) = pending.pop() {
        for entry in std::fs::read_dir(&folder).expect("a folder").flatten() {
            let path = entry.path();
            if path.is_dir() {
                pending.push(path);
            } else if path.extension().is_some_and(|e| e == extension) && is_wanted(&path) {
                files.push(path);
            }
        }
    }
    files.sort();
    let options = LoadOptions { lenient: true, ..LoadOptions::default() };
    let mut checked = 0;
    for path in files {
        let is_part = parts.iter().any(|part| path.ends_with(part));
        match load(&path, &options) {
            Ok(mut loaded) if !is_part => {
                check(&path.display().to_string(), &mut loaded.scene, effort);
                checked += 1;
            }
            Err(_) if is_part => {}
            Ok(_) => panic!("{} loads after all", path.display()),
            Err(error) => panic!("{error}"),
        }
    }
    checked
}

fn is_large(path: &Path) -> bool {
    path.components().any(|c| ["country-kitchen", "staircase2", "sponza"].iter().any(|n| c.as_os_str() == *n))
}

fn testdata() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/testdata")
}

/// Those of this repository.
fn check_own(effort: Effort) {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    assert!(check_all(&here.join("scenes"), effort, "xml", &[], |_| true) >= 7);
    assert!(check_all(&here.join("tests/scenes"), effort, "xml", OWN_PARTS, |_| true) >= 37);
}

/// Those of others, but for the large ones.
fn check_third_party(effort: Effort) {
    for (folder, count) in [("scenes", 11), ("mitsuba-suite", 9)] {
        let folder = testdata().join(folder);
        if folder.exists() {
            let checked = check_all(&folder, effort, "xml", OTHERS_PARTS, |path| !is_large(path));
            assert!(checked >= count, "{checked} of {count} in {}", folder.display());
        }
    }
}

#[test]
fn scenes_have_no_odd_contributions_and_no_faults() {
    check_own(QUICK);
}

#[test]
fn third_party_scenes_have_no_odd_contributions_and_no_faults() {
    check_third_party(QUICK);
}

/// `cargo test --release contributions -- --ignored`: all scenes with more pixels and passes, and by other ways through the integrators.
#[test]
#[ignore = "takes many minutes"]
fn all_scenes_have_no_odd_contributions_and_no_faults() {
    for effort in [THOROUGH, VARIANTS] {
        check_own(effort);
        check_third_party(effort);
        let folder = testdata().join("scenes");
        assert!(check_all(&folder, effort, "xml", &[], is_large) >= 6);
        assert!(check_all(&testdata().join("meshes"), effort, "obj", &[], |_| true) >= 10);
    }
}

/// Lights of which one colour is negative, in scenes where only one strategy can find them: then all of its contributions are odd, and nobody else's. (What
/// is not finite cannot be had from a scene: reflectances beyond 1 are cut.)
#[test]
fn odd_contributions_are_counted_for_each_strategy() {
    let run = |scene: &Scene| {
        let query = Backend::Crosscheck.build(&scene.shapes).expect("built");
        let world = World::new(scene);
        let target = target(("path", &[("max_depth", "4"), ("rr_depth", "50")]));
        let mut film = Film::new(&scene.film, AovSet::default(), 1.0).expect("a film");
        let stop = Stop { passes: 0..1, time: None };
        render(&world, &query, &target, &mut film, &stop, |_| Control::Continue).expect("rendered");
        let dropped = film.dropped();
        assert_eq!((dropped.samples, dropped.negative, dropped.example_passes()), (0, 64, vec![0]));
        odd_contributions(&world, &query, &target, 0).expect("rendered")
    };
    // 8x8 pixels, of which each has one sample.
    let all = OddCount { non_finite: 0, negative: 64 };
    let tint = Rgb::new(1.0, -0.1, 1.0);
    // The sky and nothing else: every camera ray leaves the scene.
    let odd = run(&empty().emitter(Emitter::Constant { radiance: tint }));
    assert_eq!(odd, BTreeMap::from([(Strategy { s: 0, t: 2 }, all)]));
    // A lamp without extent before a wall that fills the view: from there light is sampled once, and no ray meets another wall.
    let wall = quad(Vec3::new(-5.0, -5.0, 2.0), Vec3::Y * 10.0, Vec3::X * 10.0);
    let lamp = Emitter::Point { position: Vec3::ZERO, intensity: tint };
    let odd = run(&empty().shape(wall, diffuse(0.5), None).emitter(lamp));
    assert_eq!(odd, BTreeMap::from([(Strategy { s: 1, t: 2 }, all)]));
}
