//! Virtual point lights: against the path tracer, class of path by class, against closed forms, and the parts against brute force.
//! The former is here.

mod parts;

use std::f64::consts::PI;

use glam::{IVec2, UVec2, Vec2, Vec3};
use helmholtz::film::{AovSet, Film, SampledArea};
use helmholtz::integrators::{Integrator, Pass, PathObserver, Scratch, Strategy};
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::{BuildQuality, RayQuery};
use helmholtz::render::{Control, Stop, Target, render, sample_pixel};
use helmholtz::scene::{Emitter, Material, PixelRect, Rgb, Scene};
use helmholtz::transport::World;
use helmholtz::transport::vertex::SurfaceVertex;
use helmholtz::transport::walk::Walk;

use super::agreement::integrator;
use super::forward::{UNDER_POINT, lit_corner, means, mirror, point_over_floor};
use super::photons::glass;
use crate::backends::{BackendTest, on_each_backend, on_first_backend};
use crate::scene_builder::{Build, diffuse, empty, quad, sphere};
use crate::statistics::{FALSE_ALARM_RATE, Family, Moments, z_test_two};

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
