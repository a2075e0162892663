//! What forward path tracing can see, what it cannot, and that splats are counted right.

use std::f64::consts::PI;

use glam::{DAffine3, DVec3, UVec2, Vec3};
use helmholtz::integrators::Integrator;
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::{BuildQuality, RayQuery};
use helmholtz::scene::{Emitter, Filter, Lens, Material, Microfacet, PixelRect, Rgb, Scene, Spot};
use helmholtz::transport::World;

use super::agreement::integrator;
use crate::backends::{BackendTest, on_first_backend};
use crate::images::render_runs;
use crate::scene_builder::{Build, diffuse, empty, hollow_sphere, quad, scaled, sphere};
use crate::statistics::{FALSE_ALARM_RATE, Family, Moments, z_test, z_test_two};

/// What the mean of the green channel over all pixels should be.
enum Expected {
    Exactly(f64),
    /// As another integrator has it.
    As(Integrator),
    Positive,
}

struct Case<'a> {
    name: &'a str,
    scene: &'a Scene,
    tested: Integrator,
    expected: Expected,
    passes: u32,
}

pub(super) fn means<Q: RayQuery>(
    scene: &Scene,
    query: &Q,
    integrator: Integrator,
    first: u64,
    passes: u32,
) -> Moments {
    let world = World::new(scene);
    let images = render_runs(scene, &world, query, integrator, first..first + 32, passes);
    let mean =
        |image: &Vec<[f32; 3]>| image.iter().map(|p| f64::from(p[1])).sum::<f64>() / image.len() as f64;
    images.iter().map(mean).collect()
}

impl BackendTest for Case<'_> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let tested = means(self.scene, query, self.tested, 0, self.passes);
        let (name, mean) = (self.name, tested.mean());
        let mut family = Family::default();
        match self.expected {
            Expected::Exactly(0.0) => return assert_eq!(mean, 0.0, "{name} on {backend}"),
            Expected::Positive => {
                return assert!(mean > 5.0 * tested.standard_error() && mean > 0.0, "{name}: {tested:?}");
            }
            Expected::Exactly(expected) => {
                assert!(tested.standard_error() < 0.01 * expected, "{name} is too noisy: {tested:?}");
                family.record(format!("{name} on {backend}: {mean}, {expected}"), z_test(&tested, expected));
            }
            Expected::As(reference) => {
                let reference = means(self.scene, query, reference, 1000, self.passes);
                assert!(tested.standard_error() < 0.05 * mean, "{name} is too noisy: {tested:?}");
                let p = z_test_two(&tested, &reference);
                family.record(format!("{name} on {backend}: {mean}, {}", reference.mean()), p);
            }
        }
        // Some twenty such families are in this file.
        family.assert_accepted(0.05 * FALSE_ALARM_RATE);
    }
}

fn check(name: &str, scene: &Scene, (tested, parameters): (&str, &str), expected: Expected, passes: u32) {
    let tested = integrator(tested, parameters);
    on_first_backend(&scene.shapes, &Case { name, scene, tested, expected, passes });
}

/// A point light over a large diffuse floor, seen from above.
pub(super) fn point_over_floor() -> Scene {
    let floor = quad(Vec3::new(-20.0, -20.0, 4.0), Vec3::Y * 40.0, Vec3::X * 40.0);
    let mut scene = empty()
        .shape(floor, diffuse(0.6), None)
        .emitter(Emitter::Point { position: Vec3::new(0.0, 0.0, 2.0), intensity: Rgb::splat(3.0) });
    // One pixel, so small that the light on it is even.
    scene.camera.fov = 0.02;
    scene
}

/// Radiance of a diffuse floor under a point light: albedo / pi * I / d^2.
pub(super) const UNDER_POINT: f64 = 0.6 / PI * 3.0 / 4.0;

/// All three ways against the closed form; by light paths alone too few would hit so small a view.
#[test]
fn a_point_light_over_a_floor() {
    check("path", &point_over_floor(), ("path", "max_depth=2"), Expected::Exactly(UNDER_POINT), 8);
    check("bdpt", &point_over_floor(), ("bdpt", "max_depth=2"), Expected::Exactly(UNDER_POINT), 8);
    let mut wide = point_over_floor();
    wide.camera.fov = 60.0;
    for name in ["ptracer", "bdpt"] {
        let expected = Expected::As(integrator("path", "max_depth=2"));
        check("wide view", &wide, (name, "max_depth=2"), expected, 64);
    }
}

/// A mirror fills the view; in it are a lit floor and a lamp. The lecture: "if the eye sees a mirror, it will be black".
pub(super) fn mirror() -> Scene {
    let metal = Material::Conductor {
        eta: Rgb::ZERO.into(),
        k: Rgb::ONE.into(),
        specular_reflectance: Rgb::ONE.into(),
    };
    empty()
        .shape(quad(Vec3::new(-9.0, -9.0, 5.0), Vec3::Y * 18.0, Vec3::X * 18.0), metal, None)
        .shape(quad(Vec3::new(-9.0, -9.0, -3.0), Vec3::X * 18.0, Vec3::Y * 18.0), diffuse(0.7), None)
        .shape(
            quad(Vec3::new(-1.0, 2.0, -1.0), Vec3::Y * 2.0, Vec3::X * 2.0),
            diffuse(0.0),
            Some(Rgb::splat(5.0)),
        )
}

pub(super) fn with_lens(mut scene: Scene, aperture_radius: f64) -> Scene {
    scene.camera.lens = Lens::Thin { aperture_radius, focus_distance: 6.0 };
    scene
}

#[test]
fn a_mirror_seen_directly_is_black_by_connections() {
    check("mirror, pinhole", &mirror(), ("ptracer", "max_depth=4"), Expected::Exactly(0.0), 4);
    let scene = with_lens(mirror(), 0.7);
    check("mirror, nee", &scene, ("ptracer", "max_depth=4,connect=nee"), Expected::Exactly(0.0), 4);
    let path = || Expected::As(integrator("path", "max_depth=4"));
    check("mirror, hit", &scene, ("ptracer", "max_depth=4,connect=hit"), path(), 2048);
    check("mirror, both", &scene, ("ptracer", "max_depth=4"), path(), 2048);
    check("mirror, bdpt", &mirror(), ("bdpt", "max_depth=4"), path(), 64);
}

/// A camera behind a pane of glass, which is what a lens in front of it is.
#[test]
fn a_camera_behind_glass_sees_only_by_being_hit() {
    let glass = Material::Dielectric {
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    let wall = quad(Vec3::new(-3.0, -3.0, 3.5), Vec3::Y * 6.0, Vec3::X * 6.0);
    let scene = empty().shape(sphere(Vec3::ZERO, 1.5), glass, None).shape(
        wall,
        diffuse(0.7),
        Some(Rgb::new(1.0, 2.0, 3.0)),
    );
    let scene = with_lens(scene, 0.7);
    check("glass, nee", &scene, ("ptracer", "max_depth=5,connect=nee"), Expected::Exactly(0.0), 4);
    let path = || Expected::As(integrator("path", "max_depth=5"));
    check("glass, both", &scene, ("ptracer", "max_depth=5"), path(), 2048);
    check("glass, bdpt", &scene, ("bdpt", "max_depth=5"), path(), 512);
}

/// LS+DE from a point light: light through a glass ball onto a floor. `path` cannot make such a path.
#[test]
fn caustics_of_a_point_light_appear() {
    let glass = Material::Dielectric {
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    let floor = quad(Vec3::new(-5.0, -5.0, 6.0), Vec3::Y * 10.0, Vec3::X * 10.0);
    let scene = empty()
        .shape(floor, diffuse(0.8), None)
        // All light goes through the ball, that is around the light.
        .shape(sphere(Vec3::new(0.0, 2.5, 4.0), 0.8), glass, None)
        .emitter(Emitter::Point { position: Vec3::new(0.0, 2.5, 4.1), intensity: Rgb::splat(5.0) });
    check("caustic, path", &scene, ("path", "max_depth=6"), Expected::Exactly(0.0), 4);
    check("caustic, ptracer", &scene, ("ptracer", "max_depth=6"), Expected::Positive, 64);
    let ptracer = Expected::As(integrator("ptracer", "max_depth=4,rr_depth=9"));
    check("caustic, bdpt", &scene, ("bdpt", "max_depth=4,rr_depth=9"), ptracer, 512);
}

/// A lamp in a corner and what it lights, in colour and off centre, for crops and sizes.
pub(super) fn lit_corner() -> Scene {
    let lamp = quad(Vec3::new(-1.0, 1.5, 3.0), Vec3::X * 2.0, Vec3::Z * 1.0);
    empty()
        .shape(quad(Vec3::new(-3.0, -1.0, 2.0), Vec3::Z * 4.0, Vec3::X * 6.0), diffuse(0.7), None)
        .shape(quad(Vec3::new(-3.0, -1.0, 6.0), Vec3::Y * 4.0, Vec3::X * 6.0), diffuse(0.4), None)
        .shape(lamp, diffuse(0.0), Some(Rgb::splat(5.0)))
}

/// Splats know nothing of crop windows and sizes: the mean over a window is the same, whatever part of the film is rendered with it.
#[test]
fn crops_and_sizes_do_not_change_brightness() {
    for (name, size, crop) in [
        ("crop", UVec2::new(24, 18), PixelRect { min: UVec2::new(5, 11), size: UVec2::new(11, 6) }),
        ("corner", UVec2::new(24, 18), PixelRect { min: UVec2::new(20, 15), size: UVec2::new(4, 3) }),
        ("large", UVec2::splat(64), PixelRect { min: UVec2::ZERO, size: UVec2::splat(64) }),
        ("wide", UVec2::new(70, 3), PixelRect { min: UVec2::ZERO, size: UVec2::new(70, 3) }),
    ] {
        let mut scene = lit_corner();
        (scene.film.size, scene.film.crop) = (size, crop);
        // One that reaches over the borders.
        scene.film.filter = Filter::Gaussian { stddev: 0.5 };
        let passes = 20_000 / (crop.size.x * crop.size.y);
        for tested in ["ptracer", "bdpt"] {
            check(
                name,
                &scene,
                (tested, "max_depth=3"),
                Expected::As(integrator("path", "max_depth=3")),
                passes,
            );
        }
    }
}

/// What is far away is as bright as what is near: the same square of a floor, from 4 and from 400. (Number 9 of [`super`].)
#[test]
fn brightness_does_not_depend_on_distance() {
    let mut near = point_over_floor();
    near.camera.fov = 60.0;
    let mut far = near.clone();
    far.camera.to_world = DAffine3::from_translation(DVec3::new(0.0, 0.0, -396.0));
    far.camera.fov = 2.0 * (30f64.to_radians().tan() * 4.0 / 400.0).atan().to_degrees();
    let query = ObvhsQuery::new(&near.shapes, BuildQuality::default());
    let expected = means(&near, &query, integrator("path", "max_depth=2"), 1000, 64);
    let mut through_lens = far.clone();
    through_lens.camera.lens = Lens::Thin { aperture_radius: 0.2, focus_distance: 400.0 };
    for (name, scene) in [("far", far), ("far, through a lens", through_lens)] {
        for tested in ["bdpt", "ptracer"] {
            let expected = Expected::Exactly(expected.mean());
            check(name, &scene, (tested, "max_depth=2"), expected, 64);
        }
    }
}

/// A pane close to the lens covers half of it: lens points that are blocked count as samples. (Number 4 of [`super`].)
#[test]
fn a_lens_half_covered() {
    let pane = quad(Vec3::new(0.0, -2.0, 0.3), Vec3::Y * 4.0, Vec3::X * 2.0);
    let scene = with_lens(lit_corner().shape(pane, diffuse(0.0), None), 0.3);
    for (tested, parameters) in
        [("bdpt", "max_depth=3"), ("ptracer", "max_depth=3,connect=nee"), ("ptracer", "max_depth=3")]
    {
        let expected = Expected::As(integrator("path", "max_depth=3"));
        check("half covered", &scene, (tested, parameters), expected, 256);
    }
}

/// The light of a lamp in a narrow slit between two walls, where connections are between vertices that nearly coincide: it is neither lost nor
/// so noisy that the comparison would refuse it. (Number 5 of [`super`].)
#[test]
fn vertices_that_nearly_coincide_are_no_fireflies() {
    const GAP: f32 = 1e-3;
    let back = quad(Vec3::new(-1.0, -1.0, 4.0), Vec3::Y * 2.0, Vec3::X * 2.0);
    let front = quad(Vec3::new(0.0, -1.0, 4.0 - GAP), Vec3::X, Vec3::Y * 2.0);
    let lamp = quad(Vec3::new(-1.0, -1.0, 3.0), Vec3::X * 0.8, Vec3::Y * 2.0);
    let walls = empty().shape(back, diffuse(0.9), None).shape(front, diffuse(0.9), None);
    let mut scene = walls.shape(lamp, diffuse(0.5), Some(Rgb::splat(3.0)));
    // The wall behind and the slit's mouth.
    scene.camera.to_world = DAffine3::from_translation(DVec3::new(-0.05, 0.0, 3.5));
    check("slit", &scene, ("bdpt", "max_depth=6"), Expected::As(integrator("path", "max_depth=6")), 256);
}

/// Paths that leave a lamp start beside it: nothing of its light is lost on itself. (Number 6 of [`super`].)
#[test]
fn light_paths_do_not_hit_their_own_lamp() {
    // A closed white sphere that emits 1 inwards and reflects half: radiance is the sum of 1, 1/2 and 1/4.
    for radius in [1e-3, 1.0, 1e3] {
        let scene = empty().shape(hollow_sphere(Vec3::ZERO, radius), diffuse(0.5), Some(Rgb::ONE));
        for tested in ["bdpt", "ptracer"] {
            check("sphere", &scene, (tested, "max_depth=3"), Expected::Exactly(1.75), 64);
        }
    }
}

/// Radiance does not depend on the unit of length. (Fails where distances are compared with constants, or squares leave the range of f32; number 10
/// of [`super`].)
#[test]
fn images_survive_scale() {
    let glass = Material::Dielectric {
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    let scene = lit_corner().shape(sphere(Vec3::new(0.5, -0.2, 4.0), 0.6), glass, None);
    for exponent in [-6, 0, 6] {
        let scene = with_lens(scaled(scene.clone(), 10f64.powi(exponent)), 0.2);
        let name = format!("scale 1e{exponent}");
        // Caustics are noisy by camera paths only.
        check(
            &name,
            &scene,
            ("bdpt", "max_depth=5"),
            Expected::As(integrator("bdpt", "max_depth=5,exponent=1")),
            128,
        );
    }
    let rough = Material::RoughDielectric {
        distribution: Microfacet::Ggx,
        alpha: [0.3.into(); 2],
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    let mut glossy = lit_corner().shape(sphere(Vec3::new(0.3, -0.1, 4.0), 0.8), rough, None);
    glossy = glossy.emitter(Emitter::Constant { radiance: Rgb::splat(0.5) });
    let spot = Spot {
        position: Vec3::new(-0.5, 1.4, 3.0),
        axis: Vec3::new(0.2, -0.8, 0.5).normalize(),
        intensity: Rgb::splat(4.0),
        cutoff: 1.0,
        beam_width: 0.5,
    };
    let mut parallel = lit_corner().emitter(Emitter::Spot(spot));
    parallel.camera.lens = Lens::Orthographic;
    for (name, scene) in [
        ("glass, lens", with_lens(scene.clone(), 0.2)),
        ("rough glass under a sky, lens", with_lens(glossy, 0.2)),
        ("spot, orthographic", parallel),
    ] {
        let mean = |exponent: i32| {
            let scene = scaled(scene.clone(), 10f64.powi(exponent));
            let query = ObvhsQuery::new(&scene.shapes, BuildQuality::default());
            means(&scene, &query, integrator("bdpt", "max_depth=5"), 0, 128)
        };
        let unit = mean(0);
        for exponent in [-6, 6] {
            let scaled = mean(exponent);
            let difference = (scaled.mean() / unit.mean() - 1.0).abs();
            assert!(difference < 2e-3, "{name}, 1e{exponent}: {scaled:?}, {unit:?}");
        }
    }
}

/// Brightness is linear in emission, also where squares of it would leave f32.
#[test]
fn images_are_linear_in_emission() {
    let mean = |factor: f32| {
        let mut scene = lit_corner();
        scene.shapes[2].emission = Some(Rgb::splat(5.0 * factor).into());
        let query = ObvhsQuery::new(&scene.shapes, BuildQuality::default());
        means(&scene, &query, integrator("bdpt", "max_depth=3"), 0, 4).mean() / f64::from(factor)
    };
    let unit = mean(1.0);
    for factor in [1e-20, 1e20] {
        assert!((mean(factor) / unit - 1.0).abs() < 1e-5, "{factor}");
    }
}

/// A furnace without shapes, and one whose shapes do not absorb, look the same.
#[test]
fn the_environment_stays_as_shapes_come_and_go() {
    let sky = |scene: Scene| scene.emitter(Emitter::Constant { radiance: Rgb::splat(0.5) });
    let ball = || empty().shape(sphere(Vec3::Z * 5.0, 2.0), diffuse(1.0), None);
    for tested in ["bdpt", "ptracer"] {
        for (name, scene) in [("empty", sky(empty())), ("white ball", sky(ball()))] {
            check(name, &scene, (tested, ""), Expected::Exactly(0.5), 256);
            check(name, &with_lens(scene, 0.5), (tested, ""), Expected::Exactly(0.5), 256);
        }
    }
}

/// Lamps seen directly: small ones by connections of their own points, from one side only, near and far.
#[test]
fn lamps_are_seen_directly() {
    for (name, corner, size, flip) in [
        ("small", Vec3::new(0.05, 0.1, 5.0), 0.2, false),
        ("filling the view", Vec3::new(-6.0, -6.0, 5.0), 12.0, false),
        ("from behind", Vec3::new(-1.0, -1.0, 5.0), 2.0, true),
    ] {
        let (ex, ey) = if flip { (Vec3::X, Vec3::Y) } else { (Vec3::Y, Vec3::X) };
        let scene =
            empty().shape(quad(corner, ex * size, ey * size), diffuse(0.0), Some(Rgb::new(1.0, 2.0, 3.0)));
        for scene in [scene.clone(), with_lens(scene, 0.3)] {
            for tested in ["bdpt", "ptracer"] {
                let expected = if flip {
                    Expected::Exactly(0.0)
                } else {
                    Expected::As(integrator("path", "max_depth=1"))
                };
                check(name, &scene, (tested, "max_depth=1"), expected, 128);
            }
        }
    }
}
