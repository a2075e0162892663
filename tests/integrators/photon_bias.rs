//! The photon map where its images must be more than right in the mean: block by block beside `bdpt`, in how fast bias goes away, and what raw photons look like.

use glam::{UVec2, UVec3, Vec3};
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::{BuildQuality, RayQuery};
use helmholtz::scene::{Emitter, PixelRect, Rgb, Scene};

use super::agreement::{LIMITS, Versus, integrator};
use super::forward::{UNDER_POINT, means, point_over_floor, with_lens};
use super::photons::caustic;
use crate::backends::on_first_backend;
use crate::scene_builder::{Build, diffuse, empty, mesh, quad};
use crate::statistics::{FALSE_ALARM_RATE, Family, z_test, z_test_two};

fn query(scene: &Scene) -> impl RayQuery {
    ObvhsQuery::new(&scene.shapes, BuildQuality::Medium)
}

/// Caustics of photons and the rest of paths are `bdpt`'s image, block by block of 8x8 pixels: 16 blocks of some 0.9 units, whose edges a disc of radius
/// 0.03 blurs by less than 1 % of their caustics. 48 block values and 3 of the image for each: false alarms below 1e-4 by the limits of
/// [`crate::images`].
#[test]
fn caustics_are_those_of_bdpt_in_each_block() {
    let mut scene = caustic();
    let size = UVec2::splat(32);
    (scene.film.size, scene.film.crop) = (size, PixelRect { min: UVec2::ZERO, size });
    for (name, radius) in [("photonmapper", "lookup=radius,radius=0.03"), ("sppm", "radius=0.05")] {
        let parameters = format!("max_depth=7,photons=10000,mode=caustic,{radius}");
        let versus = Versus {
            name: "caustic",
            scene: &scene,
            tested: integrator(name, &parameters),
            reference: integrator("bdpt", "max_depth=7"),
            passes: [16, 16],
            runs: crate::images::RUNS as u64,
            limits: LIMITS,
            greatest_error: 0.05,
        };
        on_first_backend(&scene.shapes, &versus);
    }
}

/// Relative to the foot of a point light at height h, the mean irradiance of a plane over a disc of radius r around it, `x = r^2 / h^2`: irradiance falls
/// off as the cosine cubed, `(1 + x)^(-3/2)`, whose mean is `2 (1 - (1 + x)^(-1/2)) / x`.
fn blurred(x: f64) -> f64 {
    2.0 * (1.0 - (1.0 + x).powf(-0.5)) / x
}

/// With the radii of Knaus and Zwicker, `r_(i+1)^2 = r_i^2 (i + alpha) / (i + 1)`, the image after N passes is the mean over their discs: 0.84, 0.90 and 0.96 of
/// the truth here.
#[test]
fn bias_shrinks_as_predicted() {
    let scene = point_over_floor();
    let (alpha, height_squared) = (0.5, 4.0);
    let mut family = Family::default();
    for passes in [1, 8, 64] {
        let mut radius_squared = 1.0;
        let mut predicted = 0.0;
        for i in 1..=passes {
            predicted += UNDER_POINT * blurred(radius_squared / height_squared) / f64::from(passes);
            radius_squared *= (f64::from(i) + alpha) / (f64::from(i) + 1.0);
        }
        let sppm = integrator("sppm", &format!("max_depth=2,photons=2000,radius=1,alpha={alpha}"));
        let found = means(&scene, &query(&scene), sppm, 0, passes);
        let told = format!("{passes} passes: {} +- {}, {predicted}", found.mean(), found.standard_error());
        println!("{told}");
        assert!(found.standard_error() < 0.01 * predicted, "too noisy: {told}");
        family.record(told, z_test(&found, predicted));
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// Raw photons, averaged, are irradiance over pi: what `path` makes of a white diffuse floor. With a pinhole and with a lens.
#[test]
fn raw_photons_show_irradiance() {
    let mut scene = point_over_floor();
    scene.camera.fov = 60.0;
    let mut family = Family::default();
    for scene in [scene.clone(), with_lens(scene, 0.3)] {
        let query = query(&scene);
        let shown = integrator("photonmapper", "max_depth=2,photons=20000,show=photons");
        let shown = means(&scene, &query, shown, 0, 2);
        let mut white = scene.clone();
        white.materials[0] = diffuse(1.0);
        let path = means(&white, &query, integrator("path", "max_depth=2"), 1000, 16);
        let told = format!("{} +- {}, {}", shown.mean(), shown.standard_error(), path.mean());
        println!("{told}");
        assert!(shown.standard_error() < 0.01 * path.mean(), "too noisy: {told}");
        family.record(told, z_test_two(&shown, &path));
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// Photons on the far side of a surface, or behind another, are not seen.
#[test]
fn raw_photons_are_hidden_by_surfaces() {
    let floor = || quad(Vec3::new(-5.0, -5.0, 6.0), Vec3::Y * 10.0, Vec3::X * 10.0);
    let light = |z| Emitter::Point { position: Vec3::Z * z, intensity: Rgb::ONE };
    let wall = quad(Vec3::new(-5.0, -5.0, 4.0), Vec3::Y * 10.0, Vec3::X * 10.0);
    let lit = empty().shape(floor(), diffuse(0.8), None).emitter(light(5.0));
    let behind = lit.clone().shape(wall, diffuse(0.8), None);
    let far_side = empty().shape(floor(), diffuse(0.8), None).emitter(light(8.0));
    for (scene, is_seen) in [(&lit, true), (&behind, false), (&far_side, false)] {
        let shown = integrator("photonmapper", "photons=2000,max_depth=2,show=photons");
        assert_eq!(means(scene, &query(scene), shown, 0, 1).mean() > 0.0, is_seen);
    }
}

/// Triangles without area, slivers among them, on which no photon should count twice or make a NaN: the image is that of the floor without them.
#[test]
fn degenerate_triangles_do_no_harm() {
    let mut family = Family::default();
    let corners = [
        Vec3::new(-20.0, -20.0, 4.0),
        Vec3::new(-20.0, 20.0, 4.0),
        Vec3::new(20.0, 20.0, 4.0),
        Vec3::new(20.0, -20.0, 4.0),
    ];
    let needle = [Vec3::new(0.0, 0.0, 4.0), Vec3::new(1.0, 1e-38, 4.0), Vec3::new(2.0, 0.0, 4.0)];
    let positions: Vec<Vec3> = corners.into_iter().chain(needle).collect();
    let triangles = [
        UVec3::new(0, 1, 2),
        UVec3::new(0, 2, 3),
        UVec3::new(4, 4, 4),
        UVec3::new(4, 5, 6),
        UVec3::new(4, 6, 4),
    ];
    let mut scene = empty()
        .shape(mesh(positions, &triangles), diffuse(0.6), None)
        .emitter(Emitter::Point { position: Vec3::Z * 2.0, intensity: Rgb::splat(3.0) });
    scene.camera.fov = 0.02;
    for parameters in ["lookup=radius,radius=0.1", "lookup=knn,k=5000,radius=0.1"] {
        let parameters = format!("max_depth=2,photons=100000,{parameters}");
        let found = means(&scene, &query(&scene), integrator("photonmapper", &parameters), 0, 1);
        let predicted = UNDER_POINT * blurred(0.01 / 4.0);
        let told = format!("{parameters}: {} +- {}, {predicted}", found.mean(), found.standard_error());
        assert!(found.standard_error() < 0.01 * predicted, "too noisy: {told}");
        println!("{told}");
        family.record(told, z_test(&found, predicted));
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}
