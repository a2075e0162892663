//! Roughness, index and reflectance at their ends.

use glam::{DVec3, Vec3};

use super::images::{add, diffuse, empty, image, images, integrator, mean_and_error, sphere};
use super::solids::Rng;
use super::{Bench, Finding, Group, SelftestError, Task};
use crate::query::{Ray, RayQuery};
use crate::scene::{Emitter, Material, Microfacet, Rgb, Scene};
use crate::transport::World;
use crate::transport::bsdf::TransportMode;
use crate::transport::vertex::SurfaceVertex;
use crate::transport::walk::Walk;

fn mirror() -> Material {
    Material::Conductor { eta: Rgb::ZERO.into(), k: Rgb::ONE.into(), specular_reflectance: Rgb::ONE.into() }
}

fn white_metal(alpha: f32) -> Material {
    Material::RoughConductor {
        distribution: Microfacet::Ggx,
        alpha: [alpha.into(), alpha.into()],
        eta: Rgb::ZERO.into(),
        k: Rgb::ONE.into(),
        specular_reflectance: Rgb::ONE.into(),
    }
}

fn glass(eta: f32) -> Material {
    Material::Dielectric {
        eta,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    }
}

fn rough_glass(alpha: f32, eta: f32) -> Material {
    Material::RoughDielectric {
        distribution: Microfacet::Ggx,
        alpha: [alpha.into(), alpha.into()],
        eta,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    }
}

/// A ball that fills the view, under a sky of radiance 1.
fn ball(material: Material) -> Result<Scene, SelftestError> {
    let mut scene = empty(8);
    scene.camera.fov = 20.0;
    add(&mut scene, sphere(DVec3::Z * 5.0, 2.0, false)?, material, None);
    scene.emitters.push(Emitter::Constant { radiance: Rgb::ONE });
    Ok(scene)
}

/// White balls vanish in a white sky, and keep doing so at the ends of roughness and index; black ones are black; and white is white after 1e5 bounces.
pub(super) fn check(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let mut findings = furnaces(bench)?;
    findings.extend(long_walks(bench)?);
    findings.extend(white_rooms(bench)?);
    Ok(findings)
}

/// The radiance of a ball in the white furnace: 1, less what rough surfaces lose.
///
/// Microfacets tilted by more than 45 degrees have the share alpha^2 of a GGX surface, and masking costs as much again: 10 alpha^2 for each of at most two surfaces that a path meets before it is mostly
/// gone. Beside this 5.5 errors of 64 images (below 1e-6 by chance), and 1e-4 for the rounding of up to some 250 reflections in glass of index 1000. Reflectance 0 has the limit 0.
fn furnaces(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let mut cases: Vec<(String, Material, f64, f64)> = vec![
        ("diffuse, reflectance 0".into(), diffuse(0.0), 0.0, 0.0),
        ("diffuse, reflectance 1".into(), diffuse(1.0), 1.0, 0.0),
        ("mirror".into(), mirror(), 1.0, 0.0),
    ];
    for alpha in [1e-5, 1e-4, 1e-3, 1e-2] {
        let loss = 10.0 * f64::from(alpha).powi(2);
        cases.push((format!("white metal, alpha {alpha:e}"), white_metal(alpha), 1.0, loss));
    }
    for excess in [1e-7, 1e-3, 0.5, 9.0, 999.0] {
        cases.push((format!("glass of index 1 + {excess:e}"), glass(1.0 + excess), 1.0, 0.0));
    }
    for (alpha, excess) in [(1e-5, 1e-7), (1e-5, 0.5), (1e-3, 1e-4), (1e-3, 0.5)] {
        let loss = 20.0 * f64::from(alpha).powi(2);
        let name = format!("rough glass, alpha {alpha:e}, index 1 + {excess:e}");
        cases.push((name, rough_glass(alpha, 1.0 + excess), 1.0, loss));
    }
    let mut findings = Vec::new();
    for (name, material, expected, loss) in cases {
        let scene = ball(material)?;
        for label in ["path", "bdpt"] {
            // No roulette: in glass of index 1000 light goes to and fro 250 times.
            let algorithm = integrator(label, &[("rr_depth", "4000")])?;
            let (mean, error) = mean_and_error(&images(bench, &scene, algorithm, 0..64, 4)?);
            let limit = if expected == 0.0 { 0.0 } else { loss + 5.5 * error + 1e-4 };
            // An error above this would hide a percent.
            let measured = if error > 0.002 { f64::NAN } else { (mean - expected).abs() };
            let check = format!("white furnace, {name}: error of radiance");
            findings.push(Finding {
                integrator: label,
                ..bench.finding(Group::Materials, check, measured, limit)
            });
        }
    }
    Ok(findings)
}

/// Bounces of a long walk.
const BOUNCES: u32 = 100_000;

/// A path that is never ended, in a closed room that absorbs nothing.
struct LongWalk<'a>(&'a Scene);

impl Task for LongWalk<'_> {
    /// What is left of the throughput, 0 if the path ended.
    type Output = f64;

    fn run<Q: RayQuery>(&self, query: &Q) -> f64 {
        let world = World::new(self.0);
        let mut rng = Rng(5);
        let ray = Ray::new(Vec3::new(0.1, 0.2, -0.3), rng.direction().as_vec3());
        let mut walk = Walk::new(TransportMode::Radiance, ray, Rgb::ONE);
        for _ in 0..BOUNCES {
            let Some(hit) = query.intersect(&walk.ray) else { return 0.0 };
            let vertex = SurfaceVertex::new(&world.materials, &hit, &walk.ray);
            let u = [(); 3].map(|()| rng.unit() as f32).map(|u| u.min(1.0 - f32::EPSILON / 2.0));
            if walk.scatter(&vertex, u).is_none() {
                return 0.0;
            }
        }
        f64::from(walk.beta.y) * f64::from(walk.eta_scale)
    }
}

/// What 1e5 bounces add or take, which may be 1e-3: a part in 1e8 per bounce, so weights must be exactly 1 or err evenly.
fn long_walks(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let mut findings = Vec::new();
    for (name, material) in [("matt", diffuse(1.0)), ("mirror", mirror())] {
        let mut scene = empty(1);
        add(&mut scene, sphere(DVec3::ZERO, 3.0, true)?, material, None);
        // Index 1.5 both ways, so that radiance is scaled by its square and back.
        add(&mut scene, sphere(DVec3::new(1.0, 0.5, 1.2), 0.8, false)?, glass(1.5), None);
        let kept = bench.on(&scene.shapes, &LongWalk(&scene))?;
        let check = format!("{BOUNCES} bounces between white {name} walls and glass: energy not kept");
        findings.push(bench.finding(Group::Materials, check, (kept - 1.0).abs(), 1e-3));
    }
    Ok(findings)
}

/// A closed white room with a lamp has no finite radiance; its render must end all the same, and drop nothing.
fn white_rooms(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let mut scene = empty(8);
    add(&mut scene, sphere(DVec3::ZERO, 3.0, true)?, diffuse(1.0), None);
    scene.emitters.push(Emitter::Point { position: Vec3::new(0.5, 1.0, 0.0), intensity: Rgb::ONE });
    let mut findings = Vec::new();
    for label in ["path", "ptracer", "bdpt", "photonmapper", "sppm", "vpl"] {
        let parameters: &[_] = match label {
            "photonmapper" | "sppm" => &[("photons", "1000")],
            "vpl" => &[("count", "20"), ("samples", "4")],
            _ => &[],
        };
        let rendered = image(bench, &scene, integrator(label, parameters)?, 4)?;
        let bad = if rendered.dropped { f64::INFINITY } else { 0.0 };
        let check = "closed white room: samples dropped";
        let finding = bench.finding(Group::Materials, check, bad, 0.0);
        findings.push(Finding { integrator: label, ..finding });
    }
    Ok(findings)
}
