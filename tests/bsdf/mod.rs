//! BSDFs: sampling against density, values against Mitsuba's, energy, reciprocity, and the extremes.
//! The materials that the tests share are here.

mod boundaries;
mod sampling;
mod values;

use glam::{Vec2, Vec3};
use helmholtz::scene::{
    Input, Material, MaterialId, Microfacet, Perturbation, Principled, Rgb, Scene, SurfacePoint,
};
use helmholtz::transport::bsdf::{self, BsdfSample, Materials, TransportMode};

use super::scene_builder;
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
