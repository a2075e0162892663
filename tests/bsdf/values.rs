//! Values against Mitsuba's, the parts of microfacet models against their definitions, and the extremes.

use std::f32::consts::FRAC_1_PI;

use glam::{DVec3, Vec3};
use helmholtz::scene::{Microfacet, Rgb};
use helmholtz::transport::bsdf::TransportMode::{Importance, Radiance};
use helmholtz::transport::bsdf::microfacet::Microfacets;
use helmholtz::transport::bsdf::{Frame, fresnel};

use super::super::statistics::{FALSE_ALARM_RATE, Family, Random, SphereChart, chi_squared_on_sphere};
use super::{
    MODES, SAMPLES, diffuse, gold, mitsuba_material, prepare, rough_glass, smooth_glass, views, white_metal,
};

#[test]
fn values_and_densities_are_those_of_mitsuba() {
    let direction = |theta: f64, phi: f64| {
        let ((sin, cos), (sin_phi, cos_phi)) = (theta.to_radians().sin_cos(), phi.to_radians().sin_cos());
        DVec3::new(sin * cos_phi, sin * sin_phi, cos).as_vec3()
    };
    let rows = include_str!("../data/mitsuba_bsdf.txt").lines().filter(|line| !line.starts_with('#'));
    let mut compared = 0;
    for row in rows {
        let words: Vec<&str> = row.split_whitespace().collect();
        let numbers: Vec<f64> = words[2..].iter().map(|w| w.parse().expect("a number")).collect();
        let mode = if words[1] == "Radiance" { Radiance } else { Importance };
        // Mitsuba has no adjoint of perturbed normals.
        if words[0].starts_with("normalmap") && mode == Importance {
            continue;
        }
        let bsdf = mitsuba_material(words[0]);
        let (wo, wi) = (direction(numbers[0], numbers[1]), direction(numbers[2], numbers[3]));
        let value = bsdf.eval(wo, wi, mode) * wi.z.abs();
        // Mitsuba's masking of Beckmann is a fit, off by up to 0.35 % per direction.
        let tolerance = match words[0] {
            name if name.starts_with("beckmann") => 7e-3,
            // Tables of numerical integrals there and here.
            "ggx_plastic" => 5e-3,
            // Mitsuba has a polynomial for the mean internal reflectance, good to 5e-4.
            "plastic" | "plastic_nonlinear" => 2e-3,
            _ => 2e-4,
        };
        let ours = [value.x, value.y, value.z, bsdf.pdf(wo, wi, mode)].map(f64::from);
        for (ours, theirs) in ours.iter().zip(&numbers[4..]) {
            assert!((ours - theirs).abs() <= tolerance * theirs, "{row}: {ours:?}");
        }
        compared += 1;
    }
    assert_eq!(compared, 13 * 2 * 5 + 2 * 5 + 5 * 2 * 8);
}

/// What defines distribution and masking: the facets' projected areas add up to the surface's, straight down (Walter et al. 2007, eq. 4) and
/// seen from anywhere (Heitz 2014, eq. 14).
#[test]
fn projected_area_of_microfacets_is_that_of_the_surface() {
    for distribution in [Microfacet::Ggx, Microfacet::Beckmann] {
        for alpha in [[1e-5, 1e-5], [1e-3, 1e-3], [0.1, 0.1], [0.1, 0.5], [1.0, 1.0]] {
            let facets = Microfacets::new(distribution, alpha, 0.0);
            let chart = SphereChart::new(Vec3::Z, f64::from(alpha[0]));
            let below = chart.integral(|m| f64::from(facets.d(m) * m.z.max(0.0)));
            assert!((below - 1.0).abs() < 1e-3, "{facets:?}: {below}");
            for wo in views() {
                let visible = chart.integral(|m| f64::from(facets.pdf_visible(wo, m, wo.dot(m))));
                assert!((visible - 1.0).abs() < 1e-3, "{facets:?} from {wo}: {visible}");
            }
        }
    }
}

#[test]
fn visible_normals_follow_their_density() {
    let mut random = Random::new(8);
    let mut family = Family::default();
    for distribution in [Microfacet::Ggx, Microfacet::Beckmann] {
        for alpha in [[1e-5, 1e-5], [0.01, 0.01], [0.1, 0.5], [1.0, 1.0], [3.0, 2.0]] {
            let facets = Microfacets::new(distribution, alpha, 0.0);
            let chart = SphereChart::new(Vec3::Z, f64::from(alpha[0]));
            let extreme = Vec3::new(0.6, 0.8, 1e-6);
            for wo in views().into_iter().chain([extreme]) {
                let sample = || Some(facets.sample_visible(wo, random.uniform_2d()));
                let density = |m: Vec3| f64::from(facets.pdf_visible(wo, m, wo.dot(m)));
                let test = chi_squared_on_sphere(&chart, SAMPLES, sample, density);
                family.record(format!("{facets:?} from {wo}"), test.p_value);
            }
        }
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// The textbook's form in f64, which has digits to lose.
#[test]
fn dielectric_fresnel_is_accurate_at_the_extremes() {
    let mut random = Random::new(9);
    for i in 0..200_000 {
        let excess = random.log_uniform(2e-7, 1e3);
        let eta = if i % 2 == 0 { 1.0 + excess } else { 1.0 / (1.0 + excess) };
        let cos = match i % 3 {
            0 => random.uniform().max(1e-6),
            1 => random.log_uniform(1e-6, 1.0),
            _ => (1.0 - random.log_uniform(1e-7, 1.0)).max(1e-6),
        };
        let (c, n) = (f64::from(cos), f64::from(eta));
        let sin2 = (1.0 - c) * (1.0 + c);
        let g2 = n * n - sin2;
        let cos_t = g2.max(0.0).sqrt() / n;
        let (s, p) = ((c - n * cos_t) / (c + n * cos_t), (n * c - cos_t) / (n * c + cos_t));
        let expected = if g2 <= 0.0 { 1.0 } else { 0.5 * (s * s + p * p) };
        // Near the critical angle the reflectance is a square root of what is left of cancelling terms.
        let tolerance = 4e-6 * (1.0 + c.min(n) / g2.abs().sqrt());
        let ours = fresnel::fresnel_dielectric(cos, sin2 as f32, eta);
        assert!(
            (f64::from(ours.reflectance) / expected - 1.0).abs() < tolerance,
            "eta {eta} cos {cos}: {ours:?}, {expected:e}"
        );
        assert!(
            (f64::from(ours.cos_t) - cos_t).abs() <= tolerance * cos_t.max(1e-3 * tolerance / n),
            "{ours:?} {cos_t}"
        );
        if g2 > 0.0 {
            let transmitted = fresnel::dielectric_transmittance(cos, cos_t as f32, eta);
            assert!(
                (f64::from(transmitted) - (1.0 - expected)).abs() < 4e-6,
                "eta {eta} cos {cos}: {transmitted}"
            );
        }
    }
    assert_eq!(fresnel::fresnel_dielectric(0.0, 1.0, 1.5).reflectance, 1.0);
    assert_eq!(fresnel::fresnel_dielectric(0.0, 1.0, 0.5).reflectance, 1.0);
}

/// Square root of a complex number (real, imaginary) with non-negative imaginary part.
fn complex_sqrt((re, im): (f64, f64)) -> (f64, f64) {
    let (r, phi) = (re.hypot(im).sqrt(), im.atan2(re) / 2.0);
    (r * phi.cos(), r * phi.sin())
}

#[test]
fn conductor_fresnel_is_that_of_complex_arithmetic() {
    let mut random = Random::new(10);
    for _ in 0..100_000 {
        let (eta, k) = (random.log_uniform(0.01, 10.0), random.log_uniform(1e-4, 10.0));
        let cos = random.log_uniform(1e-5, 1.0).min(1.0);
        let (n, k64, c) = (f64::from(eta), f64::from(k), f64::from(cos));
        let n2 = (n * n - k64 * k64, 2.0 * n * k64);
        let root = complex_sqrt((n2.0 - (1.0 - c * c), n2.1));
        // |a - root|^2 / |a + root|^2 for a = cos and a = n^2 cos.
        let ratio = |a: (f64, f64)| {
            ((a.0 - root.0).powi(2) + (a.1 - root.1).powi(2))
                / ((a.0 + root.0).powi(2) + (a.1 + root.1).powi(2))
        };
        let expected = 0.5 * (ratio((c, 0.0)) + ratio((n2.0 * c, n2.1 * c)));
        let ours = f64::from(fresnel::fresnel_conductor(cos, Rgb::splat(eta), Rgb::splat(k)).y);
        assert!((ours - expected).abs() < 5e-6, "eta {eta} k {k} cos {cos}: {ours} against {expected}");
    }
    for cos in [0.0, 1e-30, 1.0] {
        for (eta, k) in [(0.0, 1.0), (1.0, 0.0), (1.5, 0.0), (1e5, 1e5)] {
            let f = fresnel::fresnel_conductor(cos, Rgb::splat(eta), Rgb::splat(k)).x;
            assert!((0.0..=1.0).contains(&f), "eta {eta} k {k} cos {cos}: {f}");
        }
    }
}

/// Roughness, index, angles and random numbers at their ends: nothing but finite numbers, and no gain of energy.
#[test]
fn extremes_stay_finite() {
    let mut random = Random::new(11);
    let awkward = |random: &mut Random| {
        let d = random.direction();
        match random.next_u64() % 8 {
            0 => (d * Vec3::new(1.0, 1.0, 0.0)).normalize(),
            1 => d.truncate().normalize().extend(random.log_uniform(1e-30, 1e-3)),
            2 => d.truncate().normalize().extend(-random.log_uniform(1e-30, 1e-3)),
            3 => (d * Vec3::new(1e-5, 1e-6, 1.0)).normalize(),
            4 => [Vec3::Z, Vec3::NEG_Z, Vec3::X, Vec3::ZERO, Vec3::NAN, -Vec3::ZERO]
                [(random.next_u64() % 6) as usize],
            _ => d,
        }
    };
    let edge = |random: &mut Random| match random.next_u64() % 4 {
        0 => 0.0,
        1 => 1.0 - f32::EPSILON / 2.0,
        _ => random.uniform(),
    };
    for _ in 0..200_000 {
        let distribution = if random.uniform() < 0.5 { Microfacet::Ggx } else { Microfacet::Beckmann };
        let alpha = [random.log_uniform(1e-6, 1.0), random.log_uniform(1e-6, 1.0)];
        let excess = 1.0 + random.log_uniform(1e-7, 1e3);
        let eta = if random.uniform() < 0.5 { excess } else { 1.0 / excess };
        let bsdf = match random.next_u64() % 4 {
            0 => prepare(&[white_metal(distribution, alpha)]),
            1 => prepare(&[gold(distribution, [alpha[0]; 2], Rgb::ONE)]),
            2 => smooth_glass(eta),
            _ => prepare(&[rough_glass(distribution, alpha, eta)]),
        };
        let (wo, wi) = (awkward(&mut random), awkward(&mut random));
        let context = || format!("{bsdf:?} {wo} {wi}");
        for mode in MODES {
            let (value, pdf) = (bsdf.eval(wo, wi, mode), bsdf.pdf(wo, wi, mode));
            assert!(value.is_finite() && value.min_element() >= 0.0, "{} eval {value}", context());
            assert!(pdf.is_finite() && pdf >= 0.0, "{} pdf {pdf}", context());
            let Some(s) = bsdf.sample(wo, [edge(&mut random), edge(&mut random), edge(&mut random)], mode)
            else {
                continue;
            };
            assert!((s.wi.length() - 1.0).abs() < 1e-5, "{} {s:?}", context());
            assert!(s.pdf.is_finite() && s.pdf > 0.0 && s.weight.min_element() >= 0.0, "{} {s:?}", context());
            let gain = if mode == Radiance { 1.0 / (s.eta * s.eta) } else { 1.0 };
            assert!(s.weight.max_element() <= gain * (1.0 + 1e-5), "{} {s:?}", context());
        }
        let albedo = bsdf.albedo(wo);
        assert!(
            albedo.min_element() >= 0.0 && albedo.max_element() <= 1.0 + 1e-6,
            "{} albedo {albedo}",
            context()
        );
    }
}

#[test]
fn diffuse_value_is_albedo_over_pi() {
    let bsdf = prepare(&[diffuse(0.2, 0.5, 0.8)]);
    let f = bsdf.eval(views()[1], views()[2], Radiance);
    assert!((f - Rgb::new(0.2, 0.5, 0.8) * FRAC_1_PI).length() < 1e-7);
    assert_eq!(bsdf.albedo(Vec3::Z), Rgb::new(0.2, 0.5, 0.8));
}

#[test]
fn frames_are_orthonormal_and_right_handed() {
    let mut random = Random::new(12);
    let poles = [Vec3::Z, Vec3::NEG_Z, Vec3::new(1e-20, 0.0, -1.0), Vec3::new(1e-4, 0.0, -1.0).normalize()];
    for n in poles.into_iter().chain((0..10_000).map(|_| random.direction())) {
        let frame = Frame::from_z(n);
        assert!((frame.x.cross(frame.y) - n).length() < 1e-6, "{frame:?}");
        assert!((frame.x.length() - 1.0).abs() < 1e-6 && frame.x.dot(frame.y).abs() < 1e-6, "{frame:?}");
        let w = Vec3::new(0.48, -0.6, 0.64);
        assert!((frame.to_local(frame.to_world(w)) - w).length() < 1e-6, "{frame:?}");
    }
}
