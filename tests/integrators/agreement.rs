//! All integrators have the same expectation, on scenes of `tests/scenes` as they are, by blocks of pixels. The kinds of lights, cameras and
//! materials that these miss are in [`super::kinds`].
//!
//! What `path` cannot find (delta light through delta surfaces) is in none of these scenes. False-alarm rates are those of [`crate::images`],
//! for at most 500 block values and 3 image values a scene: below 2e-4 for each scene and integrator.

use std::path::Path;

use glam::UVec2;
use helmholtz::integrators::Integrator;
use helmholtz::query::RayQuery;
use helmholtz::scene::load::{LoadOptions, load};
use helmholtz::scene::{Filter, PixelRect, Scene};
use helmholtz::transport::World;

use crate::backends::{BackendTest, on_first_backend};
use crate::images::{RUNS, estimate, render_runs};

/// Parameters from text such as `max_depth=3,exponent=1`.
pub(crate) fn integrator(name: &str, parameters: &str) -> Integrator {
    let parse = |p: &str| p.split_once('=').map(|(k, v)| (k.to_owned(), v.to_owned())).expect("key=value");
    let parameters: Vec<_> = parameters.split(',').filter(|p| !p.is_empty()).map(parse).collect();
    Integrator::new(name, &parameters).expect("a known integrator")
}

/// An integrator against another on a scene.
pub(super) struct Versus<'a> {
    pub(super) name: &'a str,
    pub(super) scene: &'a Scene,
    pub(super) tested: Integrator,
    pub(super) reference: Integrator,
    pub(super) passes: [u32; 2],
    /// Images of each.
    pub(super) runs: u64,
    /// How many errors means over the image and over blocks may be apart.
    pub(super) limits: [f64; 2],
    /// Error of the mean over the image, relative to it, above which the test is void.
    pub(super) greatest_error: f64,
}

/// Limits for [`RUNS`] images.
pub(super) const LIMITS: [f64; 2] = [6.0, 9.5];

impl BackendTest for Versus<'_> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let world = World::new(self.scene);
        let render = |integrator, first: u64, passes| {
            let images = render_runs(self.scene, &world, query, integrator, first..first + self.runs, passes);
            estimate(&images, self.scene.film.crop.size.x as usize)
        };
        let tested = render(self.tested, 100, self.passes[0]);
        let reference = render(self.reference, 500, self.passes[1]);
        let what = format!("{} on {backend}: {}", self.name, self.tested.describe());
        for (estimate, integrator) in [(&tested, self.tested), (&reference, self.reference)] {
            let noisy = estimate.image.iter().find(|(mean, error)| *error > self.greatest_error * mean);
            assert!(
                noisy.is_none(),
                "{} by {}: too noisy to tell, {noisy:?}",
                self.name,
                integrator.describe()
            );
        }
        let failures = tested.differences(&reference, &what, self.limits[0], self.limits[1]);
        let shown = failures.len().min(8);
        assert!(failures.is_empty(), "{} differences:\n{}", failures.len(), failures[..shown].join("\n"));
    }
}

pub(super) fn scene(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scenes").join(name).with_extension("xml");
    load(&path, &LoadOptions::default()).unwrap_or_else(|error| panic!("{error}")).scene
}

/// The scene's own limits of path length, for another integrator.
fn lengths(scene: &Scene) -> String {
    let of = |name: &str, value: &str| format!("{name}={value},");
    scene.integrator.parameters.iter().map(|(name, value)| of(name, value)).collect()
}

pub(super) fn compare(name: &str, tested: &[(&str, &str)], keep_filter: bool) {
    let mut scene = scene(name);
    if !keep_filter {
        // No weights of samples then, whose ratio is biased in few passes.
        scene.film.filter = Filter::Box;
    }
    let lengths = lengths(&scene);
    for (integrator_name, parameters) in tested {
        let versus = Versus {
            name,
            scene: &scene,
            tested: integrator(integrator_name, &(lengths.clone() + parameters)),
            reference: integrator("path", &lengths),
            passes: [8, 24],
            runs: RUNS as u64,
            limits: LIMITS,
            greatest_error: 0.05,
        };
        on_first_backend(&scene.shapes, &versus);
    }
}

const BDPT: (&str, &str) = ("bdpt", "");
const BALANCE: (&str, &str) = ("bdpt", "exponent=1");
const FORWARD: (&str, &str) = ("ptracer", "");

macro_rules! agreements {
    ($($test:ident: $scene:literal, $tested:expr, $keep_filter:literal;)*) => {
        $(#[test] fn $test() { compare($scene, $tested, $keep_filter); })*
    };
}

agreements! {
    area_cube: "area-cube", &[BDPT, FORWARD], false;
    area_disk_cylinder: "area-disk-cylinder", &[BDPT, BALANCE, FORWARD], false;
    area_mesh: "area-mesh", &[BDPT, FORWARD], true;
    area_rectangle: "area-rectangle", &[BDPT, BALANCE, FORWARD], true;
    area_textured: "area-textured", &[BDPT, FORWARD], false;
    mesh_attribute: "mesh-attribute", &[BDPT, FORWARD], false;
    area_sphere: "area-sphere", &[BDPT, FORWARD], false;
    conductor: "conductor", &[BDPT], false;
    dielectric: "dielectric", &[BDPT], false;
    long_paths: "long-paths", &[BDPT, FORWARD], false;
    point: "point", &[BDPT, FORWARD], false;
    references: "references", &[BDPT, FORWARD], false;
    roughconductor: "roughconductor", &[BDPT, FORWARD], false;
    roughdielectric: "roughdielectric", &[BDPT, BALANCE, FORWARD], false;
    thinlens: "thinlens", &[BDPT, BALANCE, FORWARD, ("ptracer", "connect=nee")], true;
    transforms: "transforms", &[BDPT, FORWARD], false;
}

/// The gallery's scenes in which `path` converges, made small.
#[test]
fn gallery() {
    for name in ["cornell-box", "hidden-lamps", "lens", "open-world"] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name).with_extension("xml");
        let mut scene = load(&path, &LoadOptions::default()).unwrap_or_else(|error| panic!("{error}")).scene;
        let size = UVec2::splat(32);
        (scene.film.size, scene.film.crop) = (size, PixelRect { min: UVec2::ZERO, size });
        scene.film.filter = Filter::Box;
        let versus = Versus {
            name,
            scene: &scene,
            tested: integrator("bdpt", "max_depth=6"),
            reference: integrator("path", "max_depth=6"),
            passes: [8, 64],
            runs: RUNS as u64,
            limits: LIMITS,
            greatest_error: 0.05,
        };
        on_first_backend(&scene.shapes, &versus);
    }
}
