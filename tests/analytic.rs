//! Integrators against closed forms, on every backend.
//!
//! Each case draws samples along one camera ray from independent streams, so that their mean has a standard error, and asks for
//! the mean to be within 4.4 of it: a false-alarm rate of 1e-5 a case, 1e-3 for the whole file. Where the variance is 0 the
//! rounding of some 20 operations is allowed.

use glam::Vec3;
use helmholtz::integrators::backward::Backward;
use helmholtz::integrators::{PathLength, Unobserved};
use helmholtz::query::{Ray, RayQuery};
use helmholtz::sampling::Sampler;
use helmholtz::scene::{Emitter, Geometry, Material, Microfacet, Rgb, Scene};
use helmholtz::transport::World;

use crate::backends::{BackendTest, on_each_backend};
use crate::scene_builder::{Build, diffuse, empty, hollow_sphere, quad, sphere};

const STREAMS: u64 = 256;
const SAMPLES: u32 = 256;

/// Mean of the green channel over streams, and its standard error.
fn estimate<Q: RayQuery>(scene: &Scene, query: &Q, path: Backward, ray: Ray) -> (f64, f64) {
    let world = World::new(scene);
    let means: Vec<f64> = (0..STREAMS)
        .map(|stream| {
            let sum: f64 = (0..SAMPLES)
                .map(|i| {
                    let sampler = Sampler::new(1, stream, i);
                    f64::from(path.radiance(&world, query, ray, &sampler, &mut Unobserved).0.y)
                })
                .sum();
            sum / f64::from(SAMPLES)
        })
        .collect();
    let n = STREAMS as f64;
    let mean = means.iter().sum::<f64>() / n;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

fn check(name: &str, scene: &Scene, path: Backward, ray: Ray, expected: f64) {
    let rounding = 20.0 * f64::from(f32::EPSILON) * expected;
    let within = |mean: f64, error: f64| (mean - expected).abs() <= 4.4 * error + rounding;
    on_each_backend(&scene.shapes, &Case { name, scene, path, ray, within });
}

struct Case<'a, F> {
    name: &'a str,
    scene: &'a Scene,
    path: Backward,
    ray: Ray,
    /// Whether a mean with its standard error is right.
    within: F,
}

impl<F: Fn(f64, f64) -> bool> BackendTest for Case<'_, F> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let (mean, error) = estimate(self.scene, query, self.path, self.ray);
        assert!((self.within)(mean, error), "{} on {backend}: {mean} +- {error}", self.name);
    }
}

fn unlimited() -> Backward {
    Backward::default()
}

fn up_to(depth: u32) -> Backward {
    Backward { length: PathLength { max_depth: Some(depth), ..PathLength::default() }, ..Backward::default() }
}

fn forward() -> Ray {
    Ray::new(Vec3::ZERO, Vec3::new(0.1, -0.05, 1.0).normalize())
}

/// A convex body that absorbs nothing is invisible in a uniform environment.
#[test]
fn white_furnace_diffuse() {
    let scene = empty()
        .shape(sphere(Vec3::Z * 5.0, 2.0), diffuse(1.0), None)
        .emitter(Emitter::Constant { radiance: Rgb::splat(0.7) });
    check("white furnace, diffuse", &scene, unlimited(), forward(), 0.7);
}

/// A grey one has the environment's radiance times its albedo.
#[test]
fn grey_furnace_diffuse() {
    let scene = empty()
        .shape(sphere(Vec3::Z * 5.0, 2.0), diffuse(0.25), None)
        .emitter(Emitter::Constant { radiance: Rgb::splat(1.0) });
    check("grey furnace, diffuse", &scene, unlimited(), forward(), 0.25);
}

/// Smooth glass and mirrors keep all energy, through any number of internal reflections.
#[test]
fn white_furnace_specular() {
    let glass = Material::Dielectric {
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    let mirror = Material::Conductor {
        eta: Rgb::ZERO.into(),
        k: Rgb::ONE.into(),
        specular_reflectance: Rgb::ONE.into(),
    };
    for (name, material) in [("glass", glass), ("mirror", mirror)] {
        let scene = empty()
            .shape(sphere(Vec3::Z * 5.0, 2.0), material, None)
            .emitter(Emitter::Constant { radiance: Rgb::splat(1.0) });
        check(name, &scene, unlimited(), forward(), 1.0);
    }
}

/// A nearly smooth microfacet surface loses next to nothing: microfacets tilted by more than 45 degrees, which send light into the
/// surface, have the share alpha^2 in GGX, and masking costs as much again; 10 alpha^2 allows for both, several times.
#[test]
fn white_furnace_rough() {
    let alpha = 3e-3_f32;
    let conductor = Material::RoughConductor {
        distribution: Microfacet::Ggx,
        alpha: [alpha.into(); 2],
        eta: Rgb::ZERO.into(),
        k: Rgb::ONE.into(),
        specular_reflectance: Rgb::ONE.into(),
    };
    let dielectric = Material::RoughDielectric {
        distribution: Microfacet::Beckmann,
        alpha: [alpha.into(); 2],
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    for (name, material) in [("rough conductor", conductor), ("rough dielectric", dielectric)] {
        let scene = empty()
            .shape(sphere(Vec3::Z * 5.0, 2.0), material, None)
            .emitter(Emitter::Constant { radiance: Rgb::splat(1.0) });
        let ray = Ray::new(Vec3::ZERO, Vec3::new(0.05, 0.02, 1.0).normalize());
        let loss = 10.0 * f64::from(alpha * alpha);
        let within = |mean: f64, error: f64| {
            let noise = 4.4 * error + 1e-5;
            mean >= 1.0 - loss - noise && mean <= 1.0 + noise
        };
        on_each_backend(&scene.shapes, &Case { name, scene: &scene, path: unlimited(), ray, within });
    }
}

/// Inside a closed sphere that glows and reflects, every path is a geometric series: Le / (1 - albedo), or its partial sum.
#[test]
fn glowing_sphere_from_inside() {
    let scene =
        empty().shape(hollow_sphere(Vec3::new(0.3, 0.1, -0.2), 3.0), diffuse(0.6), Some(Rgb::splat(1.5)));
    check("glowing sphere", &scene, unlimited(), forward(), 1.5 / 0.4);
    let three_terms = 1.5 * (1.0 + 0.6 + 0.36);
    check("glowing sphere, depth 3", &scene, up_to(3), forward(), three_terms);
}

/// A point light in the middle of a sphere lights all of it with I / r^2, and interreflection multiplies by 1 / (1 - albedo).
#[test]
fn point_light_inside_a_sphere() {
    let (intensity, radius, albedo) = (2.0_f64, 3.0, 0.5_f64);
    let scene = empty()
        .shape(hollow_sphere(Vec3::ZERO, radius), diffuse(albedo as f32), None)
        .emitter(Emitter::Point { position: Vec3::ZERO, intensity: Rgb::splat(intensity as f32) });
    let direct = albedo / std::f64::consts::PI * intensity / (radius * radius);
    // The camera must not sit on the light.
    let ray = Ray::new(Vec3::new(0.5, 0.2, 0.0), Vec3::Z);
    check("point light, direct", &scene, up_to(2), ray, direct);
    check("point light, all", &scene, unlimited(), ray, direct / (1.0 - albedo));
}

/// Irradiance at the foot of a corner of a parallel rectangle with sides a and b at height h
/// (Howell, "A catalog of radiation heat transfer configuration factors", B-4).
fn corner_form_factor(a: f64, b: f64, h: f64) -> f64 {
    let (x, y) = (a / h, b / h);
    let (rx, ry) = ((1.0 + x * x).sqrt(), (1.0 + y * y).sqrt());
    (x / rx * (y / rx).atan() + y / ry * (x / ry).atan()) / std::f64::consts::TAU
}

fn quad_over_floor(albedo: f32, emission: f32, half: f32, height: f32) -> Scene {
    let floor = quad(Vec3::new(-50.0, 0.0, -50.0), Vec3::Z * 100.0, Vec3::X * 100.0);
    // Facing down.
    let light = quad(Vec3::new(-half, height, -half), Vec3::X * 2.0 * half, Vec3::Z * 2.0 * half);
    empty().shape(floor, diffuse(albedo), None).shape(light, diffuse(0.0), Some(Rgb::splat(emission)))
}

/// Direct light from a rectangle, near, far and at a tiny solid angle, where sampling goes over from solid angle to area.
#[test]
fn quad_light() {
    for (half, height) in [(1.0, 1.0), (1.0, 0.05), (0.5, 20.0), (1e-3, 10.0)] {
        let scene = quad_over_floor(0.5, 3.0, half, height);
        let factor = 4.0 * corner_form_factor(f64::from(half), f64::from(half), f64::from(height));
        // From the side, so that the camera ray passes under the light.
        let origin = Vec3::new(30.0, 0.04, 0.0);
        let ray = Ray::new(origin, (Vec3::ZERO - origin).normalize());
        check(&format!("quad light {half} at {height}"), &scene, up_to(2), ray, 0.5 * 3.0 * factor);
    }
}

/// Direct light from a sphere at distance d: irradiance pi Le (r/d)^2 facing it, whatever the radius.
#[test]
fn sphere_light() {
    for (radius, distance) in [(1.0_f32, 2.0_f32), (1e-3, 5.0), (1.9, 2.0)] {
        let floor = quad(Vec3::new(-50.0, 0.0, -50.0), Vec3::Z * 100.0, Vec3::X * 100.0);
        let scene = empty().shape(floor, diffuse(0.8), None).shape(
            sphere(Vec3::Y * distance, radius),
            diffuse(0.0),
            Some(Rgb::splat(2.0)),
        );
        let expected = 0.8 * 2.0 * f64::from(radius / distance).powi(2);
        let origin = Vec3::new(30.0, 0.02, 0.0);
        let ray = Ray::new(origin, (Vec3::ZERO - origin).normalize());
        check(&format!("sphere light {radius} at {distance}"), &scene, up_to(2), ray, expected);
    }
}

/// A lamp seen directly, from its front and from behind.
#[test]
fn emission_is_one_sided() {
    let towards: Geometry = quad(Vec3::new(-1.0, -1.0, 4.0), Vec3::Y * 2.0, Vec3::X * 2.0);
    let away: Geometry = quad(Vec3::new(-1.0, -1.0, 4.0), Vec3::X * 2.0, Vec3::Y * 2.0);
    for (geometry, expected) in [(towards, 5.0), (away, 0.0)] {
        let scene = empty().shape(geometry, diffuse(0.0), Some(Rgb::splat(5.0)));
        check("one-sided emission", &scene, up_to(1), forward(), expected);
    }
}
