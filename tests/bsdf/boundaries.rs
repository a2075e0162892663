//! Mirrors, smooth refraction, what passes straight on, both sides of a surface, and reciprocity.

use glam::Vec3;
use helmholtz::sampling::warp::square_to_sphere;
use helmholtz::scene::{Material, MaterialId, Microfacet, Rgb};
use helmholtz::transport::bsdf::TransportMode::{Importance, Radiance};
use helmholtz::transport::bsdf::fresnel;

use super::super::statistics::Random;
use super::{
    Bsdf, MODES, broad_materials, diffuse, flip, masked, perturbed, perturbed_materials, prepare,
    rough_glass, smooth_glass, two_sided, views, white_metal,
};

/// The reverse density asks a boundary from the side that it was not prepared for.
#[test]
fn a_boundary_answers_from_both_sides() {
    let mut random = Random::new(77);
    for material in
        [rough_glass(Microfacet::Ggx, [0.3, 0.5], 1.5), rough_glass(Microfacet::Beckmann, [0.2, 0.2], 0.7)]
    {
        let Bsdf { above, below } = prepare(&[material]);
        for _ in 0..1000 {
            let [wo, wi] = [(); 2].map(|()| square_to_sphere(random.uniform_2d()));
            for mode in MODES {
                let values = [above, below].map(|b| b.eval(wo, wi, mode).extend(b.pdf(wo, wi, mode)));
                // The index is inverted twice; 1e-4 is what the lobes make of that rounding.
                assert!(
                    (values[0] - values[1]).abs().max_element() <= 1e-4 * values[0].max_element(),
                    "{wo} {wi}"
                );
            }
        }
    }
}

#[test]
fn mirrors_and_smooth_boundaries_keep_all_energy() {
    let mirror = prepare(&[Material::Conductor {
        eta: Rgb::ZERO.into(),
        k: Rgb::ONE.into(),
        specular_reflectance: Rgb::ONE.into(),
    }]);
    for wo in views() {
        let s = mirror.sample(wo, [0.5; 3], Radiance).expect("a mirror reflects");
        assert_eq!((s.weight, s.wi, s.pdf, s.eta), (Rgb::ONE, Vec3::new(-wo.x, -wo.y, wo.z), 1.0, 1.0));
        assert!(s.is_delta && mirror.is_delta());
        assert!(mirror.sample(flip(wo), [0.5; 3], Radiance).is_none(), "one-sided");
        for eta in [1.5_f32, 1.0 / 1.5, 3.0, 1.0 + 1e-6] {
            let glass = smooth_glass(eta);
            for (wo, eta) in [(wo, eta), (flip(wo), 1.0 / eta)] {
                let transmitted = glass.sample(wo, [1.0 - 1e-7, 0.5, 0.5], Importance).expect("scatters");
                let reflected = glass.sample(wo, [0.0; 3], Importance).expect("scatters");
                let power = |s: helmholtz::transport::bsdf::BsdfSample| s.pdf * s.weight.x;
                let total = if transmitted.wi.z * wo.z < 0.0 {
                    power(transmitted) + power(reflected)
                } else {
                    power(reflected)
                };
                assert!((total - 1.0).abs() < 1e-6, "eta {eta} from {wo}: {total}");
                let radiance = glass.sample(wo, [1.0 - 1e-7, 0.5, 0.5], Radiance).expect("scatters");
                assert!((radiance.weight.x * radiance.eta * radiance.eta - 1.0).abs() < 1e-6);
                assert!(
                    (radiance.eta / if radiance.wi.z * wo.z < 0.0 { eta } else { 1.0 } - 1.0).abs() < 1e-6
                );
            }
        }
    }
}

/// Refraction there and back returns to the same direction; its angles obey Snell's law.
#[test]
fn smooth_refraction_is_reversible() {
    let mut random = Random::new(5);
    for _ in 0..10_000 {
        let wo = random.direction();
        let eta = random.log_uniform(1.001, 10.0);
        let glass = smooth_glass(eta);
        let Some(there) = glass.sample(wo, [1.0 - 1e-7, 0.0, 0.0], Radiance).filter(|s| s.wi.z * wo.z < 0.0)
        else {
            continue;
        };
        let (sin_o, sin_i) = (wo.truncate().length(), there.wi.truncate().length());
        assert!((sin_o - there.eta * sin_i).abs() < 1e-6 * there.eta.max(1.0));
        let back = glass.sample(there.wi, [1.0 - 1e-7, 0.0, 0.0], Radiance).expect("scatters");
        // Grazing angles are only as good as the cosine, which is a square root there.
        let tolerance = 1e-6 * eta / wo.z.abs().min(there.wi.z.abs());
        if back.wi.z * there.wi.z < 0.0 {
            assert!((back.wi - wo).length() < tolerance, "eta {eta}: {wo} to {} to {}", there.wi, back.wi);
            assert!((there.weight.x * back.weight.x - 1.0).abs() < 1e-5, "radiance there and back");
        }
    }
}

#[test]
fn index_one_passes_straight_through() {
    let rough = prepare(&[rough_glass(Microfacet::Ggx, [0.5, 0.5], 1.0)]);
    for view in views() {
        for wo in [view, flip(view)] {
            for bsdf in [smooth_glass(1.0), rough] {
                let s = bsdf.sample(wo, [0.0, 0.3, 0.7], Radiance).expect("scatters");
                assert_eq!((s.wi, s.weight, s.pdf, s.is_delta, s.eta), (-wo, Rgb::ONE, 1.0, true, 1.0));
            }
        }
    }
}

/// Reciprocity (Veach 1997, eq. 5.14): `f(wi -> wo) / n_o^2` is symmetric; and importance is the adjoint of radiance.
#[test]
fn reciprocity_and_adjoint() {
    let mut random = Random::new(6);
    let mut compared = 0;
    for (name, bsdf) in broad_materials() {
        // The relative index on the lower side, found from a sample; 1 for what does not transmit.
        let eta = (0..100)
            .filter_map(|_| bsdf.sample(Vec3::Z, random.uniform_3d(), Radiance))
            .find(|s| s.eta != 1.0);
        let index = |w: Vec3| if w.z > 0.0 { 1.0 } else { eta.map_or(1.0, |s| s.eta) };
        for _ in 0..2000 {
            let (wo, wi) = (random.direction(), random.direction());
            let forth = bsdf.eval(wo, wi, Radiance).x / (index(wo) * index(wo));
            let back = bsdf.eval(wi, wo, Radiance).x / (index(wi) * index(wi));
            assert!((forth - back).abs() <= 2e-3 * forth, "{name}: {wo} {wi}: {forth} against {back}");
            let adjoint = bsdf.eval(wi, wo, Importance).x / (index(wo) * index(wo));
            assert!((forth - adjoint).abs() <= 2e-3 * forth, "{name}: {wo} {wi}: {forth}, adjoint {adjoint}");
            if wo.z * wi.z > 0.0 {
                assert_eq!(bsdf.eval(wo, wi, Radiance), bsdf.eval(wo, wi, Importance));
            }
            compared += u32::from(forth > 0.0);
        }
    }
    assert!(compared > 10_000, "{compared}");
}

/// With perturbed normals only the adjoint is left of reciprocity; cosines to the surface's normal are the caller's.
#[test]
fn perturbed_normals_have_an_adjoint() {
    let mut random = Random::new(13);
    let mut compared = 0;
    for (name, bsdf) in perturbed_materials() {
        for _ in 0..2000 {
            let (wo, wi) = (random.direction(), random.direction());
            let radiance = bsdf.eval(wo, wi, Radiance).x * wi.z.abs();
            let importance = bsdf.eval(wi, wo, Importance).x * wi.z.abs();
            let difference = (radiance - importance).abs();
            assert!(difference <= 2e-3 * radiance, "{name}: {wo} {wi}: {radiance} {importance}");
            compared += u32::from(radiance > 0.0);
        }
    }
    assert!(compared > 2000, "{compared}");
}

/// Holes and panes: what passes goes straight on and is not changed; all light is accounted for.
#[test]
fn what_passes_goes_straight_on() {
    let sheet = Material::ThinDielectric {
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    let mut random = Random::new(14);
    for view in views() {
        for wo in [view, flip(view)] {
            let r = fresnel::fresnel_dielectric(wo.z.abs(), 1.0 - wo.z * wo.z, 1.5).reflectance;
            for (bsdf, passing) in [
                (prepare(&[Material::Null]), 1.0),
                (masked(0.3, diffuse(0.2, 0.5, 0.8)), 0.7),
                (prepare(std::slice::from_ref(&sheet)), 1.0 - 2.0 * r / (1.0 + r)),
                (masked(0.5, sheet.clone()), 0.5),
                (perturbed(Vec3::new(0.7, 0.4, 0.9), true, false, Material::Null), 1.0),
            ] {
                let (mut passed, mut n) = (0.0, 0);
                for _ in 0..20_000 {
                    n += 1;
                    let Some(s) = bsdf.sample(wo, random.uniform_3d(), Radiance) else { continue };
                    // From the first of two lobes that pass straight on.
                    if s.is_delta && s.wi.z * wo.z < 0.0 && (s.pdf - passing).abs() < 1e-3 {
                        assert!((s.wi + wo).length() < 1e-6 && (s.weight - 1.0).length() < 1e-6, "{s:?}");
                        assert_eq!(s.eta, 1.0);
                        passed += 1.0;
                    }
                }
                // 5 standard deviations: a chance of 6e-7 for each of 40.
                let deviation = (passing * (1.0 - passing) / n as f32).sqrt();
                assert!(
                    (passed / n as f32 - passing).abs() <= 5.0 * deviation + 1e-6,
                    "{bsdf:?} {wo} {passed}"
                );
                assert_eq!(bsdf.eval(wo, -wo, Radiance), Rgb::ZERO);
            }
        }
    }
}

#[test]
fn two_sided_shows_the_front_of_each_material_and_one_sided_is_black_behind() {
    let (front, back) = (diffuse(0.2, 0.5, 0.8), white_metal(Microfacet::Ggx, [0.3, 0.6]));
    let (both, alone) =
        (two_sided(front.clone(), back.clone()), [prepare(std::slice::from_ref(&front)), prepare(&[back])]);
    let mut random = Random::new(7);
    for _ in 0..1000 {
        let (wo, wi) = (random.direction(), random.direction());
        let expected = if wo.z > 0.0 {
            alone[0].eval(wo, wi, Radiance)
        } else {
            alone[1].eval(flip(wo), flip(wi), Radiance)
        };
        assert_eq!(both.eval(wo, wi, Radiance), expected);
        if wo.z < 0.0 {
            assert_eq!((alone[0].eval(wo, wi, Radiance), alone[0].pdf(wo, wi, Radiance)), (Rgb::ZERO, 0.0));
            assert!(alone[0].sample(wo, [0.5; 3], Radiance).is_none());
        }
        if wo.z * wi.z < 0.0 {
            assert_eq!((both.eval(wo, wi, Radiance), both.pdf(wo, wi, Radiance)), (Rgb::ZERO, 0.0));
        }
    }
    // What a loader refuses, built by hand.
    let itself = [Material::TwoSided { front: MaterialId(0), back: MaterialId(9) }];
    let transparent = two_sided(rough_glass(Microfacet::Ggx, [0.5, 0.5], 1.5), front);
    for bsdf in [prepare(&itself), transparent, Bsdf::new(&[], MaterialId(0))] {
        assert!(bsdf.sample(Vec3::Z, [0.5; 3], Radiance).is_none());
        assert_eq!(bsdf.eval(Vec3::Z, Vec3::Z, Radiance), Rgb::ZERO);
    }
}
