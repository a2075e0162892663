//! Images of single strategies: weighted they add up to the image, unweighted each is the image of its path length.

use std::collections::BTreeMap;

use glam::{DAffine3, DVec3, Vec3};
use helmholtz::film::{AovSet, Film, Image};
use helmholtz::integrators::{Integrator, Strategy};
use helmholtz::query::RayQuery;
use helmholtz::render::{Control, Stop, Target, render};
use helmholtz::scene::{Emitter, Lens, Material, Microfacet, Rgb, Scene};
use helmholtz::strategies::{StrategyImages, contact_sheet, layers};
use helmholtz::transport::World;

use super::agreement::integrator;
use crate::backends::{BackendTest, on_first_backend};
use crate::scene_builder::{Build, diffuse, empty, quad};
use crate::statistics::{FALSE_ALARM_RATE, Family, Moments, z_test_two};

/// A floor, a wall and a lamp that do not touch, so that no two vertices can be near each other and connections have a finite variance; through
/// a lens, so that there are strategies of all kinds, and a large one, because some find it by chance.
fn scene() -> Scene {
    let rough = Material::RoughConductor {
        distribution: Microfacet::Ggx,
        alpha: [0.5.into(); 2],
        eta: Rgb::splat(0.2).into(),
        k: Rgb::splat(3.0).into(),
        specular_reflectance: Rgb::ONE.into(),
    };
    let two_sided = Material::Diffuse { reflectance: Rgb::new(0.8, 0.6, 0.4).into() };
    let mut scene = empty()
        .shape(quad(Vec3::new(-1.5, -1.0, 3.0), Vec3::Z * 2.0, Vec3::X * 3.0), two_sided, None)
        .shape(quad(Vec3::new(-1.5, -0.5, 5.8), Vec3::Y * 2.0, Vec3::X * 3.0), rough, None)
        .shape(
            quad(Vec3::new(-0.7, 1.3, 3.4), Vec3::X * 1.4, Vec3::Z * 1.4),
            diffuse(0.0),
            Some(Rgb::new(4.0, 5.0, 6.0)),
        );
    scene.camera.lens = Lens::Thin { aperture_radius: 1.0, focus_distance: 4.5 };
    scene.camera.fov = 50.0;
    scene
}

/// The same scene, seen from below the lamp by parallel rays, which nothing hits.
fn orthographic() -> Scene {
    let mut scene = scene();
    scene.camera.lens = Lens::Orthographic;
    scene.camera.to_world =
        DAffine3::from_rotation_x(-0.25) * DAffine3::from_scale(DVec3::new(1.6, 1.6, 1.0));
    scene
}

/// Glossy floor and rough glass under a sky, through a lens.
fn sky() -> Scene {
    let mut scene = scene();
    let pane = Material::RoughDielectric {
        distribution: Microfacet::Ggx,
        alpha: [0.5.into(); 2],
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    scene.shapes.pop();
    let scene = scene.shape(quad(Vec3::new(-0.8, 0.4, 3.6), Vec3::X * 1.6, Vec3::Z * 1.4), pane, None);
    scene.emitter(Emitter::Constant { radiance: Rgb::new(0.4, 0.5, 0.6) })
}

struct Unweighted<'a> {
    name: &'a str,
    scene: &'a Scene,
    passes: u32,
}

fn mean(image: &Image) -> f64 {
    let values = image.floats("G").expect("green");
    values.iter().map(|&v| f64::from(v)).sum::<f64>() / values.len() as f64
}

fn strategy_images<Q: RayQuery>(
    world: &World,
    query: &Q,
    integrator: Integrator,
    seed: u64,
    passes: u32,
) -> Vec<(Strategy, [Image; 2])> {
    let mut images = StrategyImages::new(world);
    for pass in 0..passes {
        images.add_pass(world, query, &Target { integrator, seed }, pass).expect("memory");
    }
    images.develop()
}

impl BackendTest for Unweighted<'_> {
    fn run<Q: RayQuery>(&self, _: &str, query: &Q) {
        let world = World::new(self.scene);
        // Nothing hits a pinhole.
        let least_t = u32::from(world.camera.is_delta());
        let bdpt = integrator("bdpt", "max_depth=3,rr_depth=2");
        let mut means: BTreeMap<Strategy, Moments> = BTreeMap::new();
        for seed in 0..64 {
            let images = strategy_images(&world, query, bdpt, seed, self.passes);
            for (length, s) in (1..=3).flat_map(|length| (0..=length + 1).map(move |s| (length, s))) {
                let strategy = Strategy { s, t: length + 1 - s };
                // A strategy that has not contributed has no image.
                let found = images.iter().find(|(other, _)| *other == strategy);
                let value = found.map_or(0.0, |(_, [_, unweighted])| mean(unweighted));
                means.entry(strategy).or_default().push(value);
            }
        }
        let mut family = Family::default();
        for length in 1..=3 {
            // Next-event estimation is the best known; direct light is that of (0, 2).
            let reference = means[&Strategy { s: u32::from(length > 1), t: length + u32::from(length == 1) }];
            assert!(
                reference.standard_error() < 0.02 * reference.mean(),
                "{}: ({length}) is too noisy: {reference:?}",
                self.name
            );
            for s in 0..=length + 1 - least_t {
                let t = length + 1 - s;
                let tested = means[&Strategy { s, t }];
                let [error, greatest] = [&tested, &reference].map(|m| m.standard_error() / reference.mean());
                println!("{}: ({s}, {t}) {error:.3} of {greatest:.3}", self.name);
                assert!(
                    tested.standard_error() < 0.1 * reference.mean(),
                    "{}: ({s}, {t}) is too noisy: {tested:?}",
                    self.name
                );
                family.record(format!("{}: ({s}, {t})", self.name), z_test_two(&tested, &reference));
            }
        }
        family.assert_accepted(FALSE_ALARM_RATE);
    }
}

fn check_unweighted(name: &str, scene: &Scene, passes: u32) {
    on_first_backend(&scene.shapes, &Unweighted { name, scene, passes });
}

#[test]
fn unweighted_strategies_have_the_same_expectation() {
    check_unweighted("lens", &scene(), 128);
}

#[test]
fn unweighted_strategies_have_the_same_expectation_by_parallel_rays() {
    check_unweighted("orthographic", &orthographic(), 48);
}

#[test]
fn unweighted_strategies_have_the_same_expectation_under_a_sky() {
    check_unweighted("sky", &sky(), 320);
}

struct Sums<'a>(&'a Scene);

impl BackendTest for Sums<'_> {
    fn run<Q: RayQuery>(&self, _: &str, query: &Q) {
        let world = World::new(self.0);
        for (name, parameters) in
            [("bdpt", "max_depth=4"), ("ptracer", "max_depth=4"), ("path", "max_depth=4")]
        {
            let integrator = integrator(name, parameters);
            let images = strategy_images(&world, query, integrator, 3, 8);
            let mut film =
                Film::new(&self.0.film, AovSet::default(), world.lights.radiance_unit()).expect("a film");
            let stop = Stop { passes: 0..8, time: None };
            let target = Target { integrator, seed: 3 };
            render(&world, query, &target, &mut film, &stop, |_| Control::Continue).expect("rendered");
            let image = film.develop();
            let expected = image.floats("R").expect("red");
            assert!(expected.iter().any(|&v| v > 0.01), "{name}: the image is black");
            for (i, &expected) in expected.iter().enumerate() {
                let sum: f32 = images.iter().map(|(_, [w, _])| w.floats("R").expect("red")[i]).sum();
                assert!(
                    (sum - expected).abs() <= 1e-5 * expected.abs().max(0.1),
                    "{name}: {sum}, {expected}"
                );
            }
            let layers = layers(&images).expect("layers");
            assert_eq!(layers.channels.len(), images.len() * 6);
            assert!(layers.floats("unweighted.s1t2.G").is_some() || name == "ptracer");
            let sheet = contact_sheet(&images, 0).expect("a sheet");
            let columns = images.iter().map(|(strategy, _)| strategy.s + 1).max().expect("strategies");
            assert_eq!(sheet.crop.size, glam::UVec2::new(9 * columns, 9 * 4));
        }
    }
}

#[test]
fn weighted_strategies_add_up_to_the_image() {
    let scene = scene();
    on_first_backend(&scene.shapes, &Sums(&scene));
}
