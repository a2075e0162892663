//! Virtual point lights: against the path tracer, class of path by class, against closed forms, and the parts against brute force.

use std::f64::consts::PI;

use glam::{IVec2, UVec2, Vec2, Vec3};
use helmholtz::film::{AovSet, Film, SampledArea};
use helmholtz::integrators::vpl::{LightTree, Receiver, TreeLight};
use helmholtz::integrators::{Integrator, IntegratorError, Pass, PathObserver, Scratch, Strategy};
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::{BuildQuality, Ray, RayQuery};
use helmholtz::render::{Control, Stop, Target, render, sample_pixel};
use helmholtz::scene::{Emitter, Material, PixelRect, Rgb, Scene};
use helmholtz::transport::World;
use helmholtz::transport::bsdf::TransportMode;
use helmholtz::transport::vertex::SurfaceVertex;
use helmholtz::transport::walk::Walk;

use super::agreement::integrator;
use super::forward::{UNDER_POINT, lit_corner, means, mirror, point_over_floor};
use super::photons::{caustic, glass};
use crate::backends::{BackendTest, on_each_backend, on_first_backend};
use crate::scene_builder::{Build, diffuse, empty, quad, sphere};
use crate::statistics::{FALSE_ALARM_RATE, Family, Moments, Random, z_test_two};

/// Two plates that face each other, with a lamp, a small ball that casts shadows and nothing that touches: geometry terms are
/// bounded, so that the plain sum has a finite variance.
fn plates() -> Scene {
    empty()
        .shape(quad(Vec3::new(-3.0, -2.0, 3.0), Vec3::Z * 5.0, Vec3::X * 6.0), diffuse(0.7), None)
        .shape(quad(Vec3::new(-3.0, 2.0, 3.0), Vec3::X * 6.0, Vec3::Z * 5.0), diffuse(0.5), None)
        .shape(sphere(Vec3::new(0.3, -0.5, 5.0), 0.5), diffuse(0.6), None)
        .shape(quad(Vec3::new(-0.5, 1.2, 4.5), Vec3::X, Vec3::Z), diffuse(0.0), Some(Rgb::splat(5.0)))
}

/// The same with few pixels: what is noisy are the lights, which all pixels share.
fn few_pixels(mut scene: Scene) -> Scene {
    let size = UVec2::splat(4);
    (scene.film.size, scene.film.crop) = (size, PixelRect { min: UVec2::ZERO, size });
    scene
}

/// Mean images of two integrators are equal by a z-test.
struct Same<'a> {
    scene: &'a Scene,
    tested: &'a str,
    reference: &'a str,
    passes: [u32; 2],
}

/// Cases in this file that are judged by [`Same`], about; the rate is shared between them.
const CASES: f64 = 20.0;

fn parse(text: &str) -> Integrator {
    let (name, parameters) = text.split_once(':').expect("a colon");
    integrator(name, parameters)
}

impl BackendTest for Same<'_> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let tested = means(self.scene, query, parse(self.tested), 0, self.passes[0]);
        let reference = means(self.scene, query, parse(self.reference), 1000, self.passes[1]);
        let told = format!("{} on {backend}: {tested:?}, {reference:?}", self.tested);
        println!("{told}");
        let error = tested.standard_error().hypot(reference.standard_error());
        assert!(error < 0.013 * reference.mean(), "too noisy: {told}");
        let mut family = Family::default();
        family.record(told, z_test_two(&tested, &reference));
        family.assert_accepted(FALSE_ALARM_RATE / CASES);
    }
}

fn same(scene: &Scene, tested: &str, reference: &str, passes: [u32; 2]) {
    on_first_backend(&scene.shapes, &Same { scene, tested, reference, passes });
}

fn obvhs(scene: &Scene) -> ObvhsQuery<'_> {
    ObvhsQuery::new(&scene.shapes, BuildQuality::Medium)
}

fn mean_of(scene: &Scene, tested: &str, passes: u32) -> Moments {
    means(scene, &obvhs(scene), parse(tested), 0, passes)
}

/// Direct light alone, from the lights themselves and from virtual ones, against the closed form; the latter has no noise for a point light.
#[test]
fn a_point_light_over_a_floor() {
    let scene = point_over_floor();
    for parameters in ["direct=nee", "direct=vpl,count=7", "direct=vpl,count=7,samples=3,visibility=none"] {
        let tested = mean_of(&scene, &format!("vpl:max_depth=2,{parameters}"), 1);
        let error = (tested.mean() / UNDER_POINT - 1.0).abs();
        assert!(error < 1e-4, "{parameters}: {} instead of {UNDER_POINT}", tested.mean());
    }
}

/// One indirect bounce in a closed form: a point light over a small patch, whose flux lights a floor, `L = rho_floor / pi * rho_patch / pi * flux * G`. Over the
/// patch, 0.1 wide at distance 1, irradiance and G fall off by less than 0.5 %.
#[test]
fn one_bounce_is_the_product_of_both_ends() {
    let (patch, width) = (Vec3::new(0.0, 0.0, 2.0), 0.1_f32);
    let corner = patch - Vec3::new(0.5 * width, 0.5 * width, 0.0);
    let light = Vec3::new(0.0, 0.0, 3.0);
    let scene = {
        let mut scene = empty()
            .shape(quad(Vec3::new(-9.0, -9.0, 4.0), Vec3::Y * 18.0, Vec3::X * 18.0), diffuse(0.6), None)
            .shape(quad(corner, Vec3::X * width, Vec3::Y * width), diffuse(0.5), None)
            .emitter(Emitter::Point { position: light, intensity: Rgb::splat(1e6) });
        // Beside the patch's own shadow.
        scene.camera.to_world.translation = glam::DVec3::new(1.0, 0.0, 0.0);
        scene.camera.fov = 0.02;
        scene
    };
    // The patch has irradiance I / 1^2 on its upper side, which looks at the light and the floor.
    let (area, d2) = (f64::from(width).powi(2), 1.0 + 4.0);
    let g = (4.0 / d2) / d2;
    let indirect = 0.6 / PI * (0.5 / PI) * 1e6 * area * g;
    let direct = 0.6 / PI * 1e6 * (1.0 / 2.0_f64.sqrt()) / 2.0;
    let query = obvhs(&scene);
    // The floor's own direct light, with the same samples, is taken away.
    let tested = means(&scene, &query, parse("vpl:max_depth=3,count=100000,clamp=inf,visibility=none"), 0, 2);
    let without = means(&scene, &query, parse("vpl:max_depth=2"), 0, 2);
    assert!((without.mean() / direct - 1.0).abs() < 1e-4, "{} {direct}", without.mean());
    let found = tested.mean() - without.mean();
    println!("{found} +- {} expected {indirect}", tested.standard_error());
    assert!(tested.standard_error() < 0.02 * indirect);
    // 5 standard errors of 32 runs: 2e-5.
    assert!(
        (found - indirect).abs() < 5.0 * tested.standard_error() + 0.008 * indirect,
        "{found} {indirect}"
    );
}

/// Without a clamp where the variance is finite; all lights, some by the tree, direct light by virtual lights.
#[test]
fn plain_sums_agree_with_the_path_tracer() {
    let scene = few_pixels(plates());
    for parameters in [
        "count=30",
        "count=60,samples=3",
        "count=30,direct=vpl",
        "count=60,samples=4,direct=vpl",
        "count=30,direct=vpl,clamp=1,compensate=true",
    ] {
        let clamp = if parameters.contains("clamp") { "" } else { ",clamp=inf,compensate=false" };
        let tested = format!("vpl:max_depth=4,{parameters}{clamp}");
        same(&scene, &tested, "path:max_depth=4", [300, 160]);
    }
}

/// A corner whose floor is a rough metal, of narrow lobes or of wide ones.
fn metal_corner(alpha: f32) -> Scene {
    let mut scene = lit_corner();
    scene.materials[0] = Material::RoughConductor {
        distribution: helmholtz::scene::Microfacet::Ggx,
        alpha: [alpha.into(); 2],
        eta: Rgb::ZERO.into(),
        k: Rgb::ONE.into(),
        specular_reflectance: Rgb::splat(0.8).into(),
    };
    scene
}

/// What the clamp takes is a good part of the light here, and compensation brings exactly that back: in a corner, behind a mirror, with mixed surfaces, with
/// lobes narrow and wide, and when all has to be compensated. (With caustics: [`exactly_the_class_lsdse_is_missed`].)
#[test]
fn compensation_makes_it_unbiased() {
    let mut coated = lit_corner();
    coated.materials[0] = Material::Plastic {
        eta: 1.5,
        roughness: None,
        diffuse_reflectance: Rgb::new(0.5, 0.6, 0.4).into(),
        specular_reflectance: Rgb::ONE.into(),
        nonlinear: true,
    };
    let cases = [
        (lit_corner(), "max_depth=4", "count=20,clamp=3"),
        (lit_corner(), "max_depth=4", "count=20,clamp=3,direct=vpl"),
        (lit_corner(), "max_depth=4", "count=100,clamp=3,samples=2"),
        (lit_corner(), "max_depth=4", "count=1,clamp=0"),
        (metal_corner(0.1), "max_depth=4", "count=20,clamp=3"),
        (metal_corner(0.1), "max_depth=4", "count=20,clamp=3,direct=vpl"),
        (metal_corner(0.4), "max_depth=4", "count=20,clamp=3"),
        (coated, "max_depth=4", "count=20,clamp=3"),
        (mirror(), "max_depth=5,rr_depth=2", "count=20,clamp=3"),
    ];
    for (scene, depth, parameters) in &cases {
        let scene = few_pixels(scene.clone());
        same(&scene, &format!("vpl:{depth},{parameters}"), &format!("path:{depth}"), [64, 192]);
    }
    // Without compensation the same judgement finds it, beyond doubt.
    let tested = |parameters| mean_of(&cases[0].0, parameters, 16);
    let three = tested("path:max_depth=3");
    let lost = tested("vpl:max_depth=4,count=20,clamp=3,compensate=false");
    let all = tested("path:max_depth=4");
    assert!(
        z_test_two(&lost, &all) < 1e-9 && lost.mean() < all.mean(),
        "the clamp takes nothing: {lost:?} {all:?}"
    );
    // And a limit of the path length that is off by one.
    assert!(z_test_two(&three, &all) < 1e-9 && three.mean() < all.mean(), "{three:?} {all:?}");
}

/// Sums up what a path tracer finds, apart for paths of class L(S|D)*SDS*E.
#[derive(Default)]
struct Classes {
    /// Whether each vertex so far is specular.
    specular: Vec<bool>,
    covered: f64,
    missed: f64,
}

impl PathObserver for Classes {
    fn segment(&mut self, _: &Walk, depth: u32, vertex: Option<&SurfaceVertex>) {
        if depth == 1 {
            self.specular.clear();
        }
        self.specular.extend(vertex.map(|v| v.bsdf.is_delta()));
    }

    fn contribution(&mut self, strategy: Strategy, _: Option<Vec2>, value: Rgb, mis_weight: f32) {
        // Of a light that was hit, the vertex on it scatters nothing.
        let scattering = strategy.t as usize - 1 - usize::from(strategy.s == 0);
        let events = &self.specular[..scattering];
        let first = events.iter().position(|&is_specular| !is_specular);
        let is_missed = first.is_some_and(|first| events.get(first + 1) == Some(&true));
        let sum = if is_missed { &mut self.missed } else { &mut self.covered };
        *sum += f64::from((value * mis_weight).y);
    }
}

/// Plates, a glass ball, and a mirror with a lamp of its own that shines at it alone: all classes of paths, each a good part of the light, with a finite variance.
fn specular_plates() -> Scene {
    let metal = Material::Conductor {
        eta: Rgb::ZERO.into(),
        k: Rgb::ONE.into(),
        specular_reflectance: Rgb::splat(0.9).into(),
    };
    let mut scene = plates();
    scene.materials[2] = glass();
    let lamp = quad(Vec3::new(-1.5, 0.9, 6.5), Vec3::X * 3.0, Vec3::Y * 0.8);
    scene.shape(lamp, diffuse(0.0), Some(Rgb::splat(20.0))).shape(
        quad(Vec3::new(-3.0, -1.8, 9.0), Vec3::Y * 3.6, Vec3::X * 6.0),
        metal,
        None,
    )
}

/// "Did we account for all light transport?" All but one class, and that with compensation: each to within a z-test.
#[test]
fn exactly_the_class_lsdse_is_missed() {
    let scene = specular_plates();
    let (world, query) = (World::new(&scene), obvhs(&scene));
    let depth = "max_depth=6";
    let (mut covered, mut missed) = (Moments::default(), Moments::default());
    let area = SampledArea { min: IVec2::ZERO, size: UVec2::splat(8) };
    let target = parse(&format!("path:{depth}"));
    for run in 0..64 {
        let mut classes = Classes::default();
        let passes = 128;
        for index in 0..passes {
            let pass = Pass::new(&world, &query, target, 5000 + run, index, area).expect("a pass");
            for i in 0..64 {
                let pixel = IVec2::new(i % 8, i / 8);
                sample_pixel(&pass, target, pixel, &mut Scratch::default(), &mut classes);
            }
        }
        let samples = f64::from(64 * passes);
        covered.push(classes.covered / samples);
        missed.push(classes.missed / samples);
    }
    println!("covered {covered:?}, missed {missed:?}");
    let mut family = Family::default();
    let parameters = format!("vpl:{depth},count=20,clamp=inf,compensate=false");
    let plain = means(&scene, &query, parse(&parameters), 0, 256);
    let error = plain.standard_error().hypot(covered.standard_error());
    assert!(error < 0.02 * covered.mean(), "too noisy: {plain:?} {covered:?}");
    // Twice the 4 errors that the judgement below allows: the class would be seen among the rest.
    assert!(missed.mean() > 8.0 * error, "nothing is missed: {missed:?} {plain:?} {covered:?}");
    family.record(format!("{plain:?} {covered:?}"), z_test_two(&plain, &covered));
    family.assert_accepted(FALSE_ALARM_RATE / CASES);
    same(&scene, &format!("vpl:{depth},count=20,compensate=true"), &format!("path:{depth}"), [128, 128]);
}

/// A pass over a diffuse plate: the image of virtual lights changes from pixel to pixel as smoothly as their cosines do, that of paths jumps.
#[test]
fn a_pass_has_no_noise() {
    let mut scene = plates();
    let size = UVec2::splat(32);
    (scene.film.size, scene.film.crop) = (size, PixelRect { min: UVec2::ZERO, size });
    // Nothing but the upper plate, and light from the lower.
    scene.shapes.remove(2);
    scene.camera.to_world.translation = glam::DVec3::new(0.0, 0.0, 7.0);
    scene.camera.to_world.matrix3 = glam::DMat3::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    scene.camera.fov = 25.0;
    let (world, query) = (World::new(&scene), obvhs(&scene));
    let roughness = |text: &str| {
        let target = Target { integrator: parse(text), seed: 3 };
        let mut film =
            Film::new(&scene.film, AovSet::default(), world.lights.radiance_unit()).expect("a film");
        let stop = Stop { passes: 0..1, time: None };
        render(&world, &query, &target, &mut film, &stop, |_| Control::Continue).expect("rendered");
        let image = film.develop();
        let g = image.floats("G").expect("green");
        let mean = g.iter().sum::<f32>() / g.len() as f32;
        assert!(mean > 0.0, "{text} is black");
        let jumps = (0..32).flat_map(|y| (1..31).map(move |x| (y * 32) + x));
        jumps.map(|i| (g[i - 1] - 2.0 * g[i] + g[i + 1]).abs()).sum::<f32>() / (960.0 * mean)
    };
    // Direct light has noise of its own; the upper plate gets none of it, as the lamp shines down.
    let vpl = roughness("vpl:max_depth=4,count=20,compensate=false");
    let path = roughness("path:max_depth=4");
    println!("mean second difference: {vpl} of virtual lights, {path} of paths");
    assert!(vpl < 0.05 && path > 0.3, "{vpl} {path}");
}

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
    let query = obvhs(scene);
    let world = World::new(scene);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| {
        let mut film =
            Film::new(&scene.film, AovSet::default(), world.lights.radiance_unit()).expect("a film");
        let stop = Stop { passes: 3..5, time: None };
        let target = Target { integrator: parse(text), seed: 7 };
        let done =
            render(&world, &query, &target, &mut film, &stop, |_| Control::Continue).expect("rendered");
        assert!(film.dropped().is_none(), "{:?}", film.dropped());
        (film.develop().floats("G").expect("a colour").to_vec(), done.photons)
    })
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
    for (what, scene) in &super::photons::dark_scenes() {
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

/// On scenes of all kinds of lights and surfaces, by blocks of pixels; false alarms as in [`agreement`](super::agreement).
#[test]
fn scenes_agree_by_blocks() {
    for name in ["area-mesh", "roughdielectric", "point", "transforms"] {
        super::agreement::compare(name, &[("vpl", "count=30,samples=4")], false);
    }
}

/// Both backends.
#[test]
fn backends_agree_with_the_path_tracer() {
    let scene = few_pixels(plates());
    let case = Same {
        scene: &scene,
        tested: "vpl:max_depth=4,count=30,visibility=rays",
        reference: "path:max_depth=4",
        passes: [300, 160],
    };
    on_each_backend(&scene.shapes, &case);
}
