//! The parts: shadow maps, the tree of lights, placing against connecting; and what holds for all images: threads, extremes, scale, parameters.

use glam::{UVec2, Vec3};
use helmholtz::film::{AovSet, Film};
use helmholtz::integrators::vpl::{LightTree, Receiver, TreeLight};
use helmholtz::integrators::{Integrator, IntegratorError};
use helmholtz::query::{Ray, RayQuery};
use helmholtz::render::{Control, Stop, Target, render};
use helmholtz::scene::{Material, PixelRect, Rgb, Scene};
use helmholtz::transport::World;
use helmholtz::transport::bsdf::TransportMode;
use helmholtz::transport::vertex::SurfaceVertex;

use super::super::forward::lit_corner;
use super::super::image_by_threads;
use super::super::photons::caustic;
use super::{mean_of, obvhs, parse, plates};
use crate::scene_builder::{Build, diffuse, empty, quad, sphere};
use crate::statistics::{Moments, Random};

/// Radius of the ball in [`shadowed`], as the lights see it.
const BALL_ANGLE: f64 = 0.2;

/// A floor that is lit by virtual lights alone, all of them on a patch, and in the shadow of a ball.
fn shadowed() -> Scene {
    let patch = quad(Vec3::new(1.5, -0.5, 1.0), Vec3::X, Vec3::Y);
    let lamp = quad(Vec3::new(3.0, -0.2, 1.5), Vec3::Y * 0.4, Vec3::X * 0.4);
    let mut scene = empty()
        .shape(quad(Vec3::new(-9.0, -9.0, 4.0), Vec3::Y * 18.0, Vec3::X * 18.0), diffuse(0.7), None)
        .shape(patch, diffuse(0.7), None)
        .shape(sphere(Vec3::new(1.0, 0.0, 2.7), 0.4), diffuse(0.6), None)
        .shape(lamp, diffuse(0.0), Some(Rgb::splat(5.0)));
    let size = UVec2::splat(32);
    (scene.film.size, scene.film.crop) = (size, PixelRect { min: UVec2::ZERO, size });
    scene
}

/// Shadows by maps come near those by rays, the nearer the finer the maps; without any it is brighter.
///
/// A map can only be wrong where a light sees the edge of the ball within half the diagonal of a texel. That is a band of `4 delta / r` times the shadow's own area, for a disc of
/// angular radius r and a half width delta, which is `1 / sqrt(2)` texels of at most 4 / resolution radians.
#[test]
fn shadow_maps_come_near_rays() {
    let scene = shadowed();
    let query = obvhs(&scene);
    let world = World::new(&scene);
    let image = |visibility: &str| {
        let text = format!("vpl:max_depth=3,count=2000,compensate=false,clamp=inf,{visibility}");
        let target = Target { integrator: parse(&text), seed: 1 };
        let mut film =
            Film::new(&scene.film, AovSet::default(), world.lights.radiance_unit()).expect("a film");
        let stop = Stop { passes: 0..1, time: None };
        render(&world, &query, &target, &mut film, &stop, |_| Control::Continue).expect("rendered");
        film.develop().floats("G").expect("green").to_vec()
    };
    let rays = image("visibility=rays");
    let mean = |image: &[f32]| f64::from(image.iter().sum::<f32>()) / image.len() as f64;
    let error = |other: &[f32]| {
        let absolute: f32 = rays.iter().zip(other).map(|(a, b)| (a - b).abs()).sum();
        f64::from(absolute) / rays.len() as f64 / mean(&rays)
    };
    let none = image("visibility=none");
    assert!(none.iter().zip(&rays).all(|(none, rays)| none >= rays), "shadows cannot make brighter");
    let all = error(&none);
    assert!(all > 0.02, "nothing casts shadows: {all}");
    let [coarse, fine] = [64, 256].map(|n| {
        let error = error(&image(&format!("visibility=shadowmap,resolution={n}")));
        let limit = 4.0 * (0.5_f64.sqrt() * 4.0 / f64::from(n)) / BALL_ANGLE * all;
        println!("relative error at {n}: {error}, limit {limit}; {all} without shadows");
        assert!(error < limit, "at {n}: {error}, limit {limit}; {all} without shadows");
        error
    });
    // In proportion to the texel, of which one is a quarter of the other.
    assert!(fine < 0.5 * coarse, "{coarse} {fine}");
}

/// Maps of lights on a surface that transmits show both of its sides: rough glass between a lamp and the room.
#[test]
fn maps_have_two_sides_where_light_goes_through() {
    let frosted = Material::RoughDielectric {
        distribution: helmholtz::scene::Microfacet::Ggx,
        alpha: [0.5.into(); 2],
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    let scene = plates().shape(quad(Vec3::new(-3.0, 0.8, 3.0), Vec3::X * 6.0, Vec3::Z * 5.0), frosted, None);
    let of = |visibility: &str| {
        let text = format!("vpl:max_depth=4,count=100,compensate=false,clamp=10,roughness=0,{visibility}");
        let (image, _) = image(&scene, &text, 2);
        image.iter().sum::<f32>() / image.len() as f32
    };
    let [rays, maps] = [of("visibility=rays"), of("visibility=shadowmap,resolution=64")];
    println!("{rays} by rays, {maps} by maps");
    assert!((maps / rays - 1.0).abs() < 0.01, "{rays} {maps}");
}

fn cloud(count: usize, random: &mut Random) -> Vec<TreeLight> {
    // On the walls of a box, as virtual lights are, with some in the same place and some dark.
    let light = |i: usize| {
        let (axis, side) = (i % 3, if i.is_multiple_of(2) { 1.0 } else { -1.0 });
        let mut position = 2.0 * Vec3::from(random.uniform_3d()) - 1.0;
        position[axis] = -side;
        let mut normal = Vec3::ZERO;
        normal[axis] = side;
        if i.is_multiple_of(7) {
            position = Vec3::new(0.1, 0.2, -1.0);
        }
        let power = if i % 11 == 5 { 0.0 } else { random.uniform() };
        TreeLight { position, normal, power }
    };
    (0..count).map(light).collect()
}

/// Estimates by the tree have the full sum as their expectation: over an even grid of the one random number their mean is the sum, up to the grid's width.
/// And they follow what lights contribute: a draw's standard deviation is well below that of an even choice.
#[test]
fn the_tree_draws_without_bias() {
    let mut random = Random::new(4);
    let mut gain = Moments::default();
    for count in [1, 2, 3, 5, 64, 301] {
        let lights = cloud(count, &mut random);
        let tree = LightTree::new(&lights, 1e-4).expect("lights that shine");
        for _ in 0..8 {
            let p = 1.8 * Vec3::from(random.uniform_3d()) - 0.9;
            let to = Receiver { p, normal: random.direction() };
            let lit = |light: &TreeLight| {
                let line = light.position - p;
                let d = line.normalize();
                let cosines = to.normal.dot(d).max(0.0) * light.normal.dot(-d).max(0.0);
                f64::from(light.power * cosines / line.length_squared())
            };
            let sum: f64 = lights.iter().map(lit).sum();
            let grid = 1 << 16;
            let (mut mean, mut square) = (0.0, 0.0);
            let mut probabilities = vec![None; count];
            for i in 0..grid {
                let u = (f64::from(i) + 0.5) / f64::from(grid);
                let (light, probability) = tree.sample(&to, u).expect("a light");
                let known = *probabilities[light as usize].get_or_insert(probability);
                assert!((known / probability - 1.0).abs() < 1e-4, "of one light two probabilities");
                let estimate = lit(&lights[light as usize]) / f64::from(probability);
                mean += estimate / f64::from(grid);
                square += estimate * estimate / f64::from(grid);
            }
            // Each of the count boundaries between lights may be off by a cell, by at most what its neighbours' estimates are.
            assert!((mean - sum).abs() <= 5e-3 * sum + 1e-9, "{count} lights: {mean} instead of {sum}");
            if count == 301 {
                let even = lights.iter().map(|l| lit(l).powi(2)).sum::<f64>() * count as f64;
                gain.push((square - mean * mean) / (even - sum * sum));
            }
        }
    }
    println!("variance of a draw by the tree over that of an even one: {}", gain.mean());
    assert!(gain.mean() < 0.5, "{}", gain.mean());
    assert!(LightTree::new(&[], 1.0).is_none());
    let dark = TreeLight { position: Vec3::ZERO, normal: Vec3::Z, power: 0.0 };
    assert!(LightTree::new(&[dark; 3], 1.0).is_none());
}

/// Flux when placing, importance when connecting: with shading normals and in glass, what a vertex scatters of flux that arrives from `a` towards `b` is
/// what it scatters of radiance from `b` towards `a`. `f*(a, b) |cos_g b| ... |cos_g a| = f(b, a) ...` (Veach 1997, section 5.3).
#[test]
fn placing_and_connecting_are_adjoint() {
    let mut random = Random::new(9);
    let frosted = Material::RoughDielectric {
        distribution: helmholtz::scene::Microfacet::Ggx,
        alpha: [0.4.into(); 2],
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    for material in [diffuse(0.7), frosted] {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let normals = vec![Vec3::new(0.5, 0.2, 1.0).normalize(); 3];
        let mesh =
            helmholtz::scene::TriangleMesh::new(positions, vec![[0, 1, 2]], normals, Vec::new(), false);
        let geometry = helmholtz::scene::Geometry::Mesh(mesh.expect("a mesh"));
        let scene = empty().shape(geometry, material, None);
        let (world, query) = (World::new(&scene), obvhs(&scene));
        let vertex = |from: Vec3| {
            let target = Vec3::new(0.25, 0.25, 0.0);
            let ray = Ray::new(target + 3.0 * from, -from);
            SurfaceVertex::new(&world.materials, &query.intersect(&ray).expect("hit"), &ray)
        };
        let mut compared = 0;
        for _ in 0..400 {
            let (a, b) = (random.direction(), random.direction());
            let (at_a, at_b) = (vertex(a), vertex(b));
            let placed = at_a.eval(b, TransportMode::Importance).y * at_a.cos(a);
            let seen = at_b.eval(a, TransportMode::Radiance).y * at_b.cos(b);
            let error = (placed - seen).abs();
            assert!(error <= 2e-3 * placed.max(seen) + 1e-6, "{a} {b}: {placed} {seen}");
            compared += usize::from(placed > 1e-3);
        }
        assert!(compared > 40, "{compared} pairs scatter");
    }
}

/// Image and number of lights stored.
fn image(scene: &Scene, text: &str, threads: usize) -> (Vec<f32>, u64) {
    image_by_threads(scene, parse(text), threads)
}

/// The same to the last bit for any number of threads.
#[test]
fn images_do_not_depend_on_threads() {
    for parameters in ["visibility=rays", "visibility=shadowmap,resolution=16", "samples=3,direct=vpl"] {
        let text = format!("vpl:count=600,max_depth=5,{parameters}");
        let one = image(&caustic(), &text, 1);
        assert!(one.0.iter().any(|&v| v > 0.0));
        for threads in [2, 5] {
            assert_eq!(one, image(&caustic(), &text, threads), "{text}");
        }
    }
}

/// Where there is nothing to see the image is black, no light is stored, and nothing is dropped.
#[test]
fn scenes_without_light_are_black() {
    for (what, scene) in &super::super::photons::dark_scenes() {
        for parameters in
            ["clamp=0", "clamp=inf", "visibility=shadowmap,resolution=1", "samples=2", "direct=vpl"]
        {
            let (image, lights) = image(scene, &format!("vpl:count=100,{parameters}"), 2);
            assert!(lights == 0 || parameters == "direct=vpl", "{what}: {parameters}: {lights} lights");
            assert!(image.iter().all(|&v| v == 0.0), "{what}, {parameters}: {image:?}");
        }
    }
}

/// One light, one texel, limits of the path length: nothing is dropped and nothing is not a number.
#[test]
fn extremes_are_finite() {
    for parameters in [
        "count=1",
        "count=1,samples=1000",
        "count=50,clamp=0,compensate=false",
        "count=50,clamp=1e-30",
        "count=50,clamp=3e38,compensate=true",
        "count=50,clamp=inf,compensate=true,visibility=shadowmap,resolution=1,bias=1e30",
        "count=50,visibility=shadowmap,resolution=2,bias=0",
        "count=50,max_depth=0",
        "count=50,max_depth=2,direct=vpl",
    ] {
        let (image, _) = image(&caustic(), &format!("vpl:{parameters}"), 2);
        assert!(image.iter().all(|v| v.is_finite()), "{parameters}");
        assert_eq!(image.iter().all(|&v| v == 0.0), parameters.contains("max_depth=0"), "{parameters}");
    }
}

/// Scenes of any size have the same image: the clamp is in units of the scene.
#[test]
fn scale_does_not_matter() {
    let of = |scale: f64, parameters: &str| {
        let scene = crate::scene_builder::scaled(lit_corner(), scale);
        mean_of(&scene, &format!("vpl:max_depth=4,count=50,{parameters}"), 1).mean()
    };
    for parameters in [
        "clamp=5,compensate=false",
        "clamp=5,compensate=false,visibility=shadowmap,resolution=16",
        "clamp=5,samples=4",
    ] {
        let one = of(1.0, parameters);
        for scale in [1e-6, 1e6] {
            let other = of(scale, parameters);
            assert!((other / one - 1.0).abs() < 2e-3, "{parameters}: {one}, at scale {scale} {other}");
        }
    }
}

#[test]
fn bad_parameters_are_refused() {
    let new = |parameters: &[(&str, &str)]| {
        let owned: Vec<_> = parameters.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
        Integrator::new("vpl", &owned)
    };
    for (parameter, value) in [
        ("count", "0"),
        ("count", "-1"),
        ("count", "4000000000"),
        ("count", "many"),
        ("clamp", "NaN"),
        ("clamp", "-1"),
        ("clamp", "-inf"),
        ("compensate", "maybe"),
        ("visibility", "shadow"),
        ("direct", "photons"),
        ("samples", "0"),
        ("samples", "2000000000"),
        ("resolution", "0"),
        ("resolution", "100000"),
        ("resolution", "64"),
        ("bias", "NaN"),
        ("bias", "inf"),
        ("bias", "1"),
        ("roughness", "-0.1"),
        ("roughness", "1.5"),
        ("roughness", "NaN"),
        ("max_depth", "-2"),
    ] {
        let error = new(&[(parameter, value)]).expect_err(value);
        assert!(matches!(error, IntegratorError::BadValue { .. }), "{error}");
        assert!(error.to_string().contains(parameter) && error.to_string().contains(value), "{error}");
    }
    assert!(matches!(new(&[("radius", "1")]), Err(IntegratorError::UnknownParameter { .. })));
    for text in [
        "vpl:",
        "vpl:count=7,clamp=inf,compensate=false,direct=vpl,samples=9,max_depth=3,rr_depth=2",
        "vpl:visibility=shadowmap,resolution=32,bias=0.5",
        "vpl:visibility=none,clamp=0.25,samples=all,roughness=0.5",
    ] {
        let made = parse(text);
        assert_eq!(parse(&made.describe()), made, "{text}");
    }
}
