//! Rendering to a target error: the passes that it makes, and that its estimate is honest.

use glam::{UVec2, Vec3};
use helmholtz::film::{AovSet, Film};
use helmholtz::query::RayQuery;
use helmholtz::render::{Control, Stop, Target, render};
use helmholtz::scene::{PixelRect, Rgb, Scene};
use helmholtz::study::converge::{GROUPS, Groups, render_to_error};
use helmholtz::transport::World;

use crate::backends::{BackendTest, on_first_backend};
use crate::integrators::agreement::integrator;
use crate::scene_builder::{Build, diffuse, empty, quad, sphere};

/// Balls over a floor under a small lamp, 24x24: soft shadows and indirect light.
fn scene() -> Scene {
    let mut scene = empty()
        .shape(quad(Vec3::new(-3.0, -1.0, 2.0), Vec3::Z * 6.0, Vec3::X * 6.0), diffuse(0.7), None)
        .shape(sphere(Vec3::new(-0.7, -0.3, 4.0), 0.6), diffuse(0.5), None)
        .shape(sphere(Vec3::new(0.8, -0.5, 3.5), 0.4), diffuse(0.8), None)
        .shape(sphere(Vec3::new(0.5, 2.0, 4.0), 0.3), diffuse(0.0), Some(Rgb::splat(20.0)));
    let size = UVec2::splat(24);
    (scene.film.size, scene.film.crop) = (size, PixelRect { min: UVec2::ZERO, size });
    scene
}

const TARGET: f64 = 0.01;
const SEEDS: u64 = 60;

struct Honest(Scene);

impl BackendTest for Honest {
    fn run<Q: RayQuery>(&self, _: &str, query: &Q) {
        let world = World::new(&self.0);
        let new =
            || Film::new(&self.0.film, AovSet::default(), world.lights.radiance_unit()).expect("a film");
        let channels = |film: &Film| {
            let image = film.develop();
            ["R", "G", "B"].map(|name| image.floats(name).expect("a channel").to_vec()).concat()
        };
        let path = integrator("path", "max_depth=4");
        let mut reference = new();
        let target = Target { integrator: path, seed: 12_345 };
        let stop = Stop { passes: 0..4096, time: None };
        render(&world, query, &target, &mut reference, &stop, |_| Control::Continue).expect("rendered");
        let reference = channels(&reference);
        let (mut below, mut ratios) = (0, Vec::new());
        for seed in 0..SEEDS {
            let target = Target { integrator: path, seed };
            let outcome =
                render_to_error(&world, query, &target, &new(), (TARGET, None), |_, _| Control::Continue)
                    .expect("rendered");
            let estimate = outcome.estimate.expect("an estimate");
            assert!(outcome.is_reached && estimate.rel_mse < estimate.upper && estimate.upper < TARGET);
            let error = |(i, r): (f32, f32)| {
                let (i, r) = (f64::from(i), f64::from(r));
                (i - r).powi(2) / (r * r + 0.01)
            };
            let film = outcome.groups.merge().expect("one film");
            let image = channels(&film);
            let sum: f64 = image.iter().copied().zip(reference.iter().copied()).map(error).sum();
            let found = sum / image.len() as f64;
            below += u64::from(found < TARGET);
            ratios.push(estimate.rel_mse / found);
            if seed == 0 {
                // The passes are those of any render, of as many epochs of the sampler.
                let each = film.passes().len() / GROUPS;
                let mut again = new();
                for group in 0..GROUPS {
                    let passes = group << 16..(group << 16) + each;
                    assert_eq!(Groups::pass(&path, group, 0), passes.start);
                    let stop = Stop { passes, time: None };
                    render(&world, query, &target, &mut again, &stop, |_| Control::Continue)
                        .expect("rendered");
                }
                assert_eq!(channels(&again), image);
                assert_eq!(outcome.progress.passes, each * GROUPS);
            }
        }
        let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
        println!("below the target in {below} of {SEEDS}; estimate over true error {mean}");
        // Were it 95 %, fewer than 51 of 60 would be once in 800; the mean of 60 ratios errs by some 2 %, and the median in the denominator and stopping when lucky lean it a little.
        assert!(below >= 51, "only {below} of {SEEDS}");
        assert!((0.8..1.25).contains(&mean), "the estimate is {mean} times the error");
    }
}

#[test]
fn a_target_error_is_met() {
    let scene = scene();
    on_first_backend(&scene.shapes, &Honest(scene.clone()));
}

/// Where a parameter follows the pass index, groups take turns; each pass is in one group.
#[test]
fn groups_of_sppm_take_turns() {
    let sppm = integrator("sppm", "");
    let mut passes: Vec<_> = (0..5)
        .flat_map(|n| (0..GROUPS).map(move |g| (g, n)))
        .map(|(g, n)| Groups::pass(&sppm, g, n))
        .collect();
    passes.sort_unstable();
    assert_eq!(passes, (0..5 * GROUPS).collect::<Vec<_>>());
    assert_eq!(Groups::pass(&integrator("photonmapper", ""), 3, 2), (3 << 16) + 2);
}
