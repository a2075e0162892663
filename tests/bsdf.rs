//! BSDFs: sampling against density, values against Mitsuba's, energy, reciprocity, and the extremes.

use glam::{DVec3, Vec2, Vec3};
use helmholtz::sampling::warp::square_to_sphere;
use helmholtz::scene::{
    Input, Material, MaterialId, Microfacet, Perturbation, Principled, Rgb, Scene, SurfacePoint,
};
use helmholtz::transport::bsdf::microfacet::Microfacets;
use helmholtz::transport::bsdf::{self, BsdfSample, Frame, Materials, TransportMode, fresnel};
use std::f32::consts::FRAC_1_PI;

use super::scene_builder;
use super::statistics::{
    FALSE_ALARM_RATE, Family, Moments, Random, SphereChart, chi_squared_on_sphere, z_test,
};
use TransportMode::{Importance, Radiance};

const MODES: [TransportMode; 2] = [Radiance, Importance];
const SAMPLES: u64 = 1 << 16;

fn point() -> SurfacePoint {
    SurfacePoint {
        p: Vec3::ZERO,
        p_err: 0.0,
        ng: Vec3::Z,
        ns: Vec3::Z,
        uv: Vec2::ZERO,
        shape: 0,
        primitive: 0,
    }
}

/// A material prepared for both sides, each of which answers for directions `wo` on it.
#[derive(Debug, Clone, Copy)]
struct Bsdf {
    above: bsdf::Bsdf<'static>,
    below: bsdf::Bsdf<'static>,
}

impl Bsdf {
    fn new(materials: &[Material], id: MaterialId) -> Self {
        // BSDFs refer to their scene; these are kept until the tests end.
        let scene = Scene { materials: materials.to_vec(), ..scene_builder::empty() };
        let materials = Box::leak(Box::new(Materials::new(Box::leak(Box::new(scene)))));
        let side = |is_above| bsdf::Bsdf::new(materials, id, &point(), is_above);
        Self { above: side(true), below: side(false) }
    }

    fn of(&self, wo: Vec3) -> &bsdf::Bsdf<'static> {
        if wo.z >= 0.0 { &self.above } else { &self.below }
    }

    fn sample(&self, wo: Vec3, u: [f32; 3], mode: TransportMode) -> Option<BsdfSample> {
        self.of(wo).sample(wo, u, mode)
    }

    fn eval(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> Rgb {
        self.of(wo).eval(wo, wi, mode)
    }

    fn pdf(&self, wo: Vec3, wi: Vec3, mode: TransportMode) -> f32 {
        self.of(wo).pdf(wo, wi, mode)
    }

    fn albedo(&self, wo: Vec3) -> Rgb {
        self.of(wo).albedo(wo)
    }

    fn is_delta(&self) -> bool {
        self.above.is_delta() && self.below.is_delta()
    }
}

fn prepare(materials: &[Material]) -> Bsdf {
    Bsdf::new(materials, MaterialId(materials.len() as u32 - 1))
}

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

fn diffuse(r: f32, g: f32, b: f32) -> Material {
    Material::Diffuse { reflectance: Rgb::new(r, g, b).into() }
}

/// Reflects everything: an index of 0 + 1i is what Mitsuba calls the material "none".
fn white_metal(distribution: Microfacet, alpha: [f32; 2]) -> Material {
    Material::RoughConductor {
        distribution,
        alpha: alpha.map(Input::Constant),
        eta: Rgb::ZERO.into(),
        k: Rgb::ONE.into(),
        specular_reflectance: Rgb::ONE.into(),
    }
}

fn gold(distribution: Microfacet, alpha: [f32; 2], specular_reflectance: Rgb) -> Material {
    let (eta, k) = (Rgb::new(0.143, 0.375, 1.442), Rgb::new(3.983, 2.386, 1.603));
    Material::RoughConductor {
        distribution,
        alpha: alpha.map(Input::Constant),
        eta: eta.into(),
        k: k.into(),
        specular_reflectance: specular_reflectance.into(),
    }
}

fn rough_glass(distribution: Microfacet, alpha: [f32; 2], eta: f32) -> Material {
    let (specular_reflectance, specular_transmittance) = (Rgb::ONE.into(), Rgb::ONE.into());
    let alpha = alpha.map(Input::Constant);
    Material::RoughDielectric { distribution, alpha, eta, specular_reflectance, specular_transmittance }
}

fn smooth_glass(eta: f32) -> Bsdf {
    let (specular_reflectance, specular_transmittance) = (Rgb::ONE.into(), Rgb::ONE.into());
    prepare(&[Material::Dielectric { eta, specular_reflectance, specular_transmittance }])
}

fn two_sided(front: Material, back: Material) -> Bsdf {
    prepare(&[front, back, Material::TwoSided { front: MaterialId(0), back: MaterialId(1) }])
}

fn plastic(
    roughness: Option<(Microfacet, f32)>,
    eta: f32,
    diffuse: [f32; 3],
    specular: f32,
    nonlinear: bool,
) -> Material {
    Material::Plastic {
        roughness,
        eta,
        diffuse_reflectance: Rgb::from(diffuse).into(),
        specular_reflectance: Rgb::splat(specular).into(),
        nonlinear,
    }
}

fn rgb(r: f32, g: f32, b: f32) -> Input<Rgb> {
    Rgb::new(r, g, b).into()
}

fn principled(set: impl Fn(&mut Principled)) -> Material {
    let zero = Input::Constant(0.0);
    let mut parameters = Principled {
        base_color: Rgb::splat(0.5).into(),
        roughness: 0.5.into(),
        anisotropic: zero,
        metallic: zero,
        spec_trans: zero,
        spec_tint: zero,
        sheen: zero,
        sheen_tint: zero,
        flatness: zero,
        clearcoat: zero,
        clearcoat_gloss: zero,
        eta: 1.5,
    };
    set(&mut parameters);
    Material::Principled(Box::new(parameters))
}

fn blend(weight: f32, first: Material, second: Material) -> Bsdf {
    let both = Material::Blend { weight: weight.into(), first: MaterialId(0), second: MaterialId(1) };
    prepare(&[first, second, both])
}

fn masked(opacity: f32, material: Material) -> Bsdf {
    prepare(&[material, Material::Mask { opacity: opacity.into(), material: MaterialId(0) }])
}

/// A normal given as a normal map gives it.
fn perturbed(
    normal: Vec3,
    flip_invalid_normals: bool,
    use_shadowing_function: bool,
    material: Material,
) -> Bsdf {
    let by = Perturbation::Normal(normal.into());
    let material_id = MaterialId(0);
    prepare(&[
        material,
        Material::Perturbed { by, flip_invalid_normals, use_shadowing_function, material: material_id },
    ])
}

fn flip(w: Vec3) -> Vec3 {
    Vec3::new(w.x, w.y, -w.z)
}

/// A sample that is not of a delta lobe.
fn continuous(sample: Option<BsdfSample>) -> Option<BsdfSample> {
    sample.filter(|s| !s.is_delta)
}

/// From straight above, obliquely, at 3 degrees and at 0.06 degrees above the surface.
fn views() -> [Vec3; 4] {
    let at = |z: f32, phi: f32| ((1.0 - z * z).sqrt() * Vec2::from_angle(phi)).extend(z);
    [Vec3::Z, at(0.64, 0.5), at(0.05, 3.6), at(1e-3, 5.0)]
}

/// Materials whose lobes are broad enough for cells over the whole sphere.
fn broad_materials() -> Vec<(String, Bsdf)> {
    let mut all = vec![
        ("diffuse".into(), prepare(&[diffuse(0.2, 0.5, 0.8)])),
        ("two-sided".into(), two_sided(diffuse(0.2, 0.5, 0.8), white_metal(Microfacet::Ggx, [0.3, 0.6]))),
    ];
    for distribution in [Microfacet::Ggx, Microfacet::Beckmann] {
        for alpha in [[0.1, 0.1], [0.5, 0.5], [1.0, 1.0], [0.08, 0.4]] {
            all.push((
                format!("{distribution:?} metal {alpha:?}"),
                prepare(&[white_metal(distribution, alpha)]),
            ));
        }
        for (alpha, eta) in [
            ([0.15, 0.15], 1.5),
            ([0.5, 0.5], 1.5),
            ([1.0, 1.0], 1.1),
            ([0.2, 0.6], 1.33),
            ([0.3, 0.3], 0.6),
            ([0.4, 0.2], 3.0),
        ] {
            let name = format!("{distribution:?} glass {alpha:?} eta {eta}");
            all.push((name, prepare(&[rough_glass(distribution, alpha, eta)])));
        }
    }
    for (roughness, eta, nonlinear) in [
        (None, 1.5, false),
        (Some((Microfacet::Ggx, 0.2)), 1.9, true),
        (Some((Microfacet::Beckmann, 0.5)), 1.5, false),
        (Some((Microfacet::Ggx, 0.4)), 0.7, false),
    ] {
        let name = format!("plastic {roughness:?} eta {eta}");
        all.push((name, prepare(&[plastic(roughness, eta, [0.9, 0.5, 0.2], 1.0, nonlinear)])));
    }
    for name in
        ["principled_plain", "principled_metal", "principled_cloth", "principled_glass", "blend", "mask"]
    {
        all.push((name.into(), mitsuba_material(name)));
    }
    let glass = || rough_glass(Microfacet::Ggx, [0.4, 0.3], 1.5);
    all.push(("blend of glass".into(), blend(0.6, diffuse(0.2, 0.5, 0.8), glass())));
    all
}

/// Materials whose normal is perturbed, more and less: not reciprocal, and not bound to keep energy in mode `Importance`.
fn perturbed_materials() -> Vec<(String, Bsdf)> {
    let mut all = Vec::new();
    for normal in [Vec3::new(0.6, 0.45, 0.95), Vec3::new(0.95, 0.4, 0.6)] {
        for (flips, shadows) in [(true, true), (true, false), (false, false)] {
            let name = |what: &str| format!("{what} with normal {normal}, {flips} {shadows}");
            let glass = rough_glass(Microfacet::Ggx, [0.4, 0.3], 1.5);
            all.push((name("diffuse"), perturbed(normal, flips, shadows, diffuse(0.2, 0.5, 0.8))));
            all.push((name("glass"), perturbed(normal, flips, shadows, glass)));
        }
    }
    all
}

/// Every broad material from every view from which it is not black.
fn broad_cases() -> Vec<(String, Bsdf, Vec3)> {
    let mut cases = Vec::new();
    for (name, bsdf) in broad_materials().into_iter().chain(perturbed_materials()) {
        for view in views() {
            for wo in [view, flip(view)] {
                if bsdf.albedo(wo) != Rgb::ZERO {
                    cases.push((format!("{name} from {wo}"), bsdf, wo));
                }
            }
        }
    }
    cases
}

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

/// The materials of `data/mitsuba_bsdf.py`.
fn mitsuba_material(name: &str) -> Bsdf {
    let glass =
        |distribution, alpha: [f32; 2], eta, specular_reflectance: Rgb, specular_transmittance: Rgb| {
            Material::RoughDielectric {
                distribution,
                alpha: alpha.map(Input::Constant),
                eta,
                specular_reflectance: specular_reflectance.into(),
                specular_transmittance: specular_transmittance.into(),
            }
        };
    let (tint, other_tint) = (Rgb::new(0.9, 0.8, 0.7), Rgb::new(0.3, 0.6, 0.9));
    prepare(&[match name {
        "diffuse" => diffuse(0.2, 0.5, 0.8),
        "ggx_gold" => gold(Microfacet::Ggx, [0.3, 0.3], Rgb::ONE),
        "ggx_gold_anisotropic" => gold(Microfacet::Ggx, [0.05, 0.4], tint),
        "beckmann_gold" => gold(Microfacet::Beckmann, [0.2, 0.2], Rgb::ONE),
        "ggx_glass" => glass(Microfacet::Ggx, [0.2, 0.2], 1.5, Rgb::ONE, Rgb::ONE),
        "ggx_water_anisotropic" => glass(Microfacet::Ggx, [0.1, 0.5], 1.33, tint, other_tint),
        "ggx_bubble" => glass(Microfacet::Ggx, [0.4, 0.4], 1.0 / 1.8, Rgb::ONE, Rgb::ONE),
        "plastic" => plastic(None, 1.9, [0.9, 0.3, 0.1], 1.0, false),
        "plastic_nonlinear" => plastic(None, 1.5, [0.9, 0.3, 0.1], 0.5, true),
        "ggx_plastic" => plastic(Some((Microfacet::Ggx, 0.3)), 1.9, [0.9, 0.3, 0.1], 1.0, true),
        "beckmann_plastic" => plastic(Some((Microfacet::Beckmann, 0.1)), 1.5, [0.2, 0.3, 0.8], 1.0, false),
        "principled_plain" => principled(|p| (p.roughness, p.base_color) = (0.6.into(), rgb(0.8, 0.3, 0.1))),
        "principled_metal" => principled(|p| {
            (p.base_color, p.metallic, p.roughness) = (rgb(0.9, 0.6, 0.2), 0.8.into(), 0.5.into());
            (p.anisotropic, p.spec_tint, p.eta) = (0.7.into(), 0.5.into(), 1.6);
        }),
        "principled_cloth" => principled(|p| {
            (p.base_color, p.sheen, p.sheen_tint) = (rgb(0.2, 0.3, 0.8), 0.8.into(), 0.6.into());
            (p.flatness, p.clearcoat, p.clearcoat_gloss) = (0.5.into(), 0.9.into(), 0.2.into());
            (p.roughness, p.eta) = (0.8.into(), 1.4);
        }),
        "principled_glass" => principled(|p| {
            (p.base_color, p.spec_trans, p.metallic) = (rgb(0.9, 0.5, 0.3), 0.8.into(), 0.3.into());
            (p.spec_tint, p.roughness, p.eta) = (0.7.into(), 0.6.into(), 1.3);
        }),
        "blend" => {
            let gold = gold(Microfacet::Ggx, [0.3, 0.3], Rgb::ONE);
            return blend(0.3, diffuse(0.2, 0.5, 0.8), gold);
        }
        "mask" => return masked(0.7, diffuse(0.2, 0.5, 0.8)),
        "normalmap" => {
            return perturbed(Vec3::new(0.7, 0.4, 0.9), true, true, diffuse(0.2, 0.5, 0.8));
        }
        "normalmap_steep" => {
            let gold = gold(Microfacet::Ggx, [0.5, 0.5], Rgb::ONE);
            return perturbed(Vec3::new(0.95, 0.4, 0.6), true, false, gold);
        }
        "beckmann_glass" => glass(Microfacet::Beckmann, [0.3, 0.3], 1.5, Rgb::ONE, Rgb::ONE),
        other => panic!("unknown material {other}"),
    }])
}

#[test]
fn values_and_densities_are_those_of_mitsuba() {
    let direction = |theta: f64, phi: f64| {
        let ((sin, cos), (sin_phi, cos_phi)) = (theta.to_radians().sin_cos(), phi.to_radians().sin_cos());
        DVec3::new(sin * cos_phi, sin * sin_phi, cos).as_vec3()
    };
    let rows = include_str!("data/mitsuba_bsdf.txt").lines().filter(|line| !line.starts_with('#'));
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
