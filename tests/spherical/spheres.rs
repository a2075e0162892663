//! Spheres.

use std::f64::consts::{PI, TAU};

use glam::{Vec3, vec3};
use helmholtz::sampling::spherical::SphereCone;

use super::{SAMPLES, assert_chi_squared, assert_close, grid, uniform};

fn spheres() -> Vec<(&'static str, Vec3, f32, Vec3)> {
    vec![
        ("at 2 radii", Vec3::ZERO, 1.0, vec3(0.0, 0.0, 2.0)),
        ("oblique", vec3(1.0, 2.0, 3.0), 0.7, vec3(-1.0, 2.5, 2.0)),
        ("close", Vec3::ZERO, 1.0, vec3(0.6006, 0.8008, 0.0)),
        ("very close", Vec3::ZERO, 100.0, vec3(0.0, -100.01, 0.0)),
        ("planet", vec3(0.0, -6.4e6, 0.0), 6.4e6, vec3(0.0, 1000.0, 0.0)),
        ("far", Vec3::ZERO, 1.0, vec3(3e5, -4e5, 1e5)),
        ("speck", vec3(0.0, 0.0, 1e1), 1e-6, Vec3::ZERO),
        ("grain", vec3(1e-4, 0.0, 0.0), 1e-4, vec3(0.0, 3e-4, 0.0)),
    ]
}

/// The direction from p to the point with outward normal n, as (angle measure in [0, 1), azimuth in [0, 1)) within the cone.
fn in_cone((center, radius, p): (Vec3, f32, Vec3), n: Vec3) -> (f64, f64) {
    let to_center = center.as_dvec3() - p.as_dvec3();
    let (d2, r) = (to_center.length_squared(), f64::from(radius));
    let axis = to_center.normalize();
    let q = to_center + r * n.as_dvec3();
    let (tangent, bitangent) = axis.any_orthonormal_pair();
    let one_minus_cos = |sin2: f64, cos: f64| sin2 / (1.0 + cos);
    let (x, y, cos) = (q.dot(tangent) / q.length(), q.dot(bitangent) / q.length(), q.dot(axis) / q.length());
    let full = one_minus_cos(r * r / d2, ((d2 - r * r) / d2).sqrt());
    (one_minus_cos(x * x + y * y, cos) / full, y.atan2(x).rem_euclid(TAU) / TAU)
}

#[test]
fn sphere_solid_angle_is_the_closed_form() {
    for (name, center, radius, p) in spheres() {
        let d = (center.as_dvec3() - p.as_dvec3()).length();
        let half_angle = (f64::from(radius) / d).asin();
        // 1 - cos = 2 sin^2 of half the angle, an expression the library does not use.
        let expected = 4.0 * PI * (0.5 * half_angle).sin().powi(2);
        // Near the surface the angle is the arc sine of almost 1, which is ill-conditioned in f64 as well.
        assert_close(SphereCone::new(center, radius, p).unwrap().solid_angle(), expected, 5e-7, name);
    }
    let inside = SphereCone::new(Vec3::ZERO, 2.0, Vec3::ONE).unwrap();
    assert_close(inside.solid_angle(), 4.0 * PI, 1e-7, "inside");
}

#[test]
fn sphere_samples_are_uniform_in_the_cone() {
    const RINGS: usize = 8;
    for (name, center, radius, p) in spheres() {
        let cone = SphereCone::new(center, radius, p).unwrap();
        let mut counts = [0; RINGS * RINGS];
        for i in 0..SAMPLES {
            let n = cone.sample(uniform(i));
            assert!((n.length() - 1.0).abs() < 1e-6, "{name}: {n} is no unit vector");
            // The point must be on the side of p, or on the silhouette but for rounding.
            let facing = n.as_dvec3().dot(p.as_dvec3() - center.as_dvec3()) / f64::from(radius);
            assert!(facing > 1.0 - 1e-6, "{name}: {n} is not seen from p, {facing}");
            let (ring, sector) = in_cone((center, radius, p), n);
            assert!(ring < 1.0 + 1e-3, "{name}: {n} is outside the cone, {ring}");
            counts[((ring * RINGS as f64) as usize).min(RINGS - 1) * RINGS
                + (sector * RINGS as f64) as usize] += 1;
        }
        let expected = [SAMPLES as f64 / (RINGS * RINGS) as f64; RINGS * RINGS];
        assert_chi_squared(&counts, &expected, name);
    }
}

#[test]
fn sphere_samples_from_inside_are_uniform_directions() {
    const BANDS: usize = 8;
    for (name, center, radius, p) in [
        ("centre", Vec3::ZERO, 1.0, Vec3::ZERO),
        ("off centre", vec3(1.0, 2.0, 3.0), 4.0, vec3(2.0, 4.0, 1.0)),
        ("near the surface", Vec3::ZERO, 1e3, vec3(0.0, 999.9, 0.0)),
    ] {
        let seen = SphereCone::new(center, radius, p).unwrap();
        let mut counts = [0; BANDS * BANDS];
        for i in 0..SAMPLES {
            let n = seen.sample(uniform(i)).as_dvec3();
            let direction = (center.as_dvec3() + f64::from(radius) * n - p.as_dvec3()).normalize();
            let band = (0.5 * (direction.y + 1.0) * BANDS as f64) as usize;
            let sector = (direction.z.atan2(direction.x).rem_euclid(TAU) / TAU * BANDS as f64) as usize;
            counts[band.min(BANDS - 1) * BANDS + sector.min(BANDS - 1)] += 1;
        }
        assert_chi_squared(&counts, &[SAMPLES as f64 / (BANDS * BANDS) as f64; BANDS * BANDS], name);
    }
}

#[test]
fn sphere_estimates_its_form_factor() {
    for (name, center, radius, p) in spheres() {
        let cone = SphereCone::new(center, radius, p).unwrap();
        let to_center = center.as_dvec3() - p.as_dvec3();
        let axis = to_center.normalize();
        let mean: f64 = grid(128)
            .map(|u| {
                (to_center + f64::from(radius) * cone.sample(u).as_dvec3().normalize()).normalize().dot(axis)
            })
            .sum::<f64>()
            / 16384.0;
        // A surface that faces a sphere receives pi (r/d)^2 from unit radiance.
        let expected = PI * f64::from(radius).powi(2) / to_center.length_squared();
        assert_close((mean * f64::from(cone.solid_angle())) as f32, expected, 1e-5, name);
    }
}

#[test]
fn spheres_of_doubtful_side_are_left_to_area_sampling() {
    let refused =
        |what: &str, center, radius, p| assert!(SphereCone::new(center, radius, p).is_none(), "{what}");
    refused("on it", Vec3::ZERO, 1.0, Vec3::X);
    refused("an ulp outside", Vec3::ZERO, 1.0, vec3(1.0_f32.next_up(), 0.0, 0.0));
    refused("an ulp inside", Vec3::ZERO, 1.0, vec3(1.0_f32.next_down(), 0.0, 0.0));
    refused("smaller than the grid of floats around it", vec3(1e6, 0.0, 0.0), 1e-3, vec3(1e6, 0.0, 0.0));
    refused("no radius", Vec3::ZERO, 0.0, Vec3::X);
    refused("no number", Vec3::ZERO, f32::NAN, Vec3::X);
    refused("too far", Vec3::ZERO, 1e-10, vec3(1e8, 0.0, 0.0));
    refused("p not finite", Vec3::ZERO, 1.0, vec3(f32::INFINITY, 0.0, 0.0));
}
