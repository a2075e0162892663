//! Samples against densities, weights against values, and energy.

use std::f32::consts::FRAC_1_PI;

use glam::Vec3;
use helmholtz::scene::{Material, Microfacet, Rgb};
use helmholtz::transport::bsdf::TransportMode::{Importance, Radiance};

use super::super::statistics::{
    FALSE_ALARM_RATE, Family, Moments, Random, SphereChart, chi_squared_on_sphere, z_test,
};
use super::{
    Bsdf, MODES, SAMPLES, blend, broad_cases, continuous, diffuse, prepare, rough_glass, smooth_glass, views,
    white_metal,
};

#[test]
fn samples_follow_the_density_which_integrates_to_the_acceptance() {
    let mut family = Family::default();
    let mut random = Random::new(1);
    for (name, bsdf, wo) in broad_cases() {
        // Light paths choose between two perturbed normals, and only there the modes differ in density.
        let mode = if name.contains("normal") { Importance } else { Radiance };
        let sample = || continuous(bsdf.sample(wo, random.uniform_3d(), mode)).map(|s| s.wi);
        let density = |wi| f64::from(bsdf.pdf(wo, wi, mode));
        let test = chi_squared_on_sphere(&SphereChart::equal_area(Vec3::Z), SAMPLES, sample, density);
        assert!(test.integral < 1.0 + 1e-3, "{name}: {test:?}");
        if name == "diffuse" {
            assert!(test.integral > 1.0 - 1e-4, "{name}: {test:?}");
        }
        family.record(name, test.p_value);
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// Lobes down to the narrowest, each in cells that shrink towards its axis; only the hemisphere of the lobe is looked at.
#[test]
fn narrow_lobes_follow_their_density() {
    let mut family = Family::default();
    let mut random = Random::new(2);
    let mut test = |name: String, bsdf: Bsdf, wo: Vec3, axis: Vec3, width: f64| {
        let same_side = |wi: &Vec3| wi.z * axis.z > 0.0;
        let sample = || bsdf.sample(wo, random.uniform_3d(), Radiance).map(|s| s.wi).filter(same_side);
        let density = |wi| if same_side(&wi) { f64::from(bsdf.pdf(wo, wi, Radiance)) } else { 0.0 };
        let outcome = chi_squared_on_sphere(&SphereChart::new(axis, width), SAMPLES, sample, density);
        family.record(format!("{name} from {wo}"), outcome.p_value);
    };
    let [_, oblique, grazing, _] = views();
    for distribution in [Microfacet::Ggx, Microfacet::Beckmann] {
        for alpha in [1e-2, 1e-3, 1e-4, 1e-5] {
            let metal = prepare(&[white_metal(distribution, [alpha, alpha])]);
            // At 3 degrees the lobe of 1e-5 is as wide across as an f32 is precise; no cell can be smaller than that.
            for wo in if alpha > 1e-5 { vec![oblique, grazing] } else { vec![oblique] } {
                let mirrored = Vec3::new(-wo.x, -wo.y, wo.z);
                test(format!("{distribution:?} metal {alpha}"), metal, wo, mirrored, f64::from(alpha));
            }
        }
        for (alpha, eta) in
            [(1e-3_f32, 1.5_f32), (1e-4, 1.5), (0.1, 1.001), (0.5, 1.0001), (1e-3, 0.7), (0.01, 100.0)]
        {
            let glass = prepare(&[rough_glass(distribution, [alpha, alpha], eta)]);
            let delta = smooth_glass(eta)
                .sample(oblique, [0.999, 0.5, 0.5], Radiance)
                .expect("a smooth boundary scatters");
            let width = f64::from(alpha * (1.0 / eta - 1.0).abs());
            test(format!("{distribution:?} glass {alpha} eta {eta}"), glass, oblique, delta.wi, width);
            test(
                format!("{distribution:?} glass {alpha} eta {eta} inside"),
                glass,
                delta.wi,
                oblique,
                width * f64::from(eta),
            );
        }
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

#[test]
fn weight_is_value_times_cosine_over_density() {
    let mut random = Random::new(3);
    for (name, bsdf, wo) in broad_cases() {
        for mode in MODES {
            for _ in 0..2000 {
                let Some(s) = continuous(bsdf.sample(wo, random.uniform_3d(), mode)) else { continue };
                let pdf = bsdf.pdf(wo, s.wi, mode);
                let value = bsdf.eval(wo, s.wi, mode) * s.wi.z.abs();
                // Half vectors rebuilt from rounded directions are off by some 1e-7 of roughness 0.08 and more.
                assert!((s.pdf / pdf - 1.0).abs() < 2e-3, "{name} {mode:?}: {s:?} but pdf {pdf}");
                let error = (s.weight * pdf - value).abs().max_element();
                assert!(
                    error <= 2e-3 * value.max_element(),
                    "{name} {mode:?}: {s:?} but f cos {value}, pdf {pdf}"
                );
                assert!(!bsdf.is_delta());
                assert!((s.wi.length() - 1.0).abs() < 1e-5, "{name}: {s:?}");
            }
        }
    }
}

/// The mean weight is the albedo, by quadrature of `f cos`; power never grows (importance: no change by the index).
#[test]
fn energy_is_conserved_and_weights_integrate_the_value() {
    let mut family = Family::default();
    let mut random = Random::new(4);
    for (name, bsdf, wo) in broad_cases() {
        let chart = SphereChart::equal_area(Vec3::Z);
        let albedo = chart.integral(|wi| f64::from(bsdf.eval(wo, wi, Importance).x * wi.z.abs()));
        // Disney's model and the adjoint of perturbed normals do not promise it.
        if !name.contains("normal") && !name.contains("principled") {
            assert!(albedo < 1.0 + 1e-3, "{name}: albedo {albedo}");
        }
        let weight = |u| continuous(bsdf.sample(wo, u, Importance)).map_or(0.0, |s| f64::from(s.weight.x));
        let weights: Moments = (0..SAMPLES / 2).map(|_| weight(random.uniform_3d())).collect();
        // The quadrature is good to 1e-4; means of near-constant weights would tell.
        let p = if (weights.mean() - albedo).abs() < 2e-4 { 1.0 } else { z_test(&weights, albedo) };
        family.record(format!("{name}: albedo {albedo}, mean weight {}", weights.mean()), p);
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// What single scattering loses, as the module's documentation states it. At roughness 1 from straight above the albedo is analytic:
/// normals have density cos / pi, so that with t = cos^2 it is the integral of G1(2 theta) = 2 - 1 / t from 1/2 to 1.
#[test]
fn white_metal_loses_little_when_smooth_and_most_when_rough() {
    let albedo = |alpha: f32, wo: Vec3| {
        let bsdf = prepare(&[white_metal(Microfacet::Ggx, [alpha, alpha])]);
        SphereChart::equal_area(Vec3::Z).integral(|wi| f64::from(bsdf.eval(wo, wi, Radiance).x * wi.z.abs()))
    };
    let [normal, oblique, ..] = views();
    assert!((albedo(1.0, normal) - (1.0 - 2.0_f64.ln())).abs() < 1e-4);
    assert!((0.97..0.99).contains(&albedo(0.1, normal)) && (0.97..0.99).contains(&albedo(0.1, oblique)));
}

/// The probability of a delta lobe is not mixed with the density of the other, which is what Mitsuba does (vendor-notes/loaders.md).
#[test]
fn a_blend_leaves_a_delta_lobe_its_fraction() {
    let metal = || Material::Conductor {
        eta: Rgb::new(0.143, 0.375, 1.442).into(),
        k: Rgb::new(3.983, 2.386, 1.603).into(),
        specular_reflectance: Rgb::ONE.into(),
    };
    let near = |a: Rgb, b: Rgb| (a - b).abs().max_element() < 1e-5;
    let base = Rgb::new(0.2, 0.5, 0.8);
    let blend = blend(0.3, diffuse(base.x, base.y, base.z), metal());
    for wo in views() {
        let alone = prepare(&[metal()]).sample(wo, [0.5; 3], Radiance).expect("a mirror reflects");
        let mut deltas = 0;
        for i in 0..1000 {
            let u = (i as f32 + 0.5) / 1000.0;
            let s = blend.sample(wo, [u, 0.3, 0.6], Radiance).expect("both reflect");
            deltas += u32::from(s.is_delta);
            let (weight, pdf) =
                if s.is_delta { (alone.weight, 0.3) } else { (base, 0.7 * FRAC_1_PI * s.wi.z) };
            assert!(near(s.weight, weight) && (s.pdf - pdf).abs() < 1e-5, "{s:?} from {wo}");
        }
        assert_eq!(deltas, 300);
    }
}
