//! Radiance, area and number of lights at their ends.

use glam::{DVec3, Vec3};

use super::images::{
    AT_UNIT_SIZE, FURNACE_RADIANCE, INTEGRATORS, add, brighter, diffuse, empty, image, images, integrator,
    mean_and_error, room,
};
use super::solids::{Rng, Solid, quad};
use super::{Bench, Effort, Finding, Group, SelftestError};
use crate::sampling::discrete::AliasTable;
use crate::scene::{Geometry, Rgb, Scene, SurfacePoint, TriangleMesh};
use crate::transport::World;

const GROUP: Group = Group::Lights;

/// Images are linear in emission over 40 decades; lights may be tiny, huge and many.
pub(super) fn check(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let mut findings = emission(bench)?;
    findings.extend(tiny_lamp(bench)?);
    findings.extend(huge_lamp(bench)?);
    findings.extend(many_triangles(bench)?);
    findings.extend(choice(bench)?);
    Ok(findings)
}

/// The room with emission times a factor. Times a power of two no digit changes, and not a bit of the image may, but for its exponent. Times 1e20
/// each value is rounded once more, and nothing else changes: 1e-6 of the mean.
fn emission(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let unit = room(16)?;
    let mut findings = Vec::new();
    for &(label, parameters) in &INTEGRATORS {
        let algorithm = integrator(label, parameters)?;
        let reference = image(bench, &unit, algorithm, 8)?;
        for (text, factor) in
            [("2^-66", 2f32.powi(-66)), ("2^66", 2f32.powi(66)), ("1e-20", 1e-20), ("1e20", 1e20)]
        {
            let found = image(bench, &brighter(unit.clone(), factor), algorithm, 8)?;
            let is_exact = text.starts_with('2');
            let (measured, limit, what) = if is_exact {
                (found.share_that_differs(&reference, factor), 0.0, "share of values that change a bit")
            } else {
                let ratio = found.mean() / (reference.mean() * f64::from(factor));
                ((ratio - 1.0).abs(), 1e-6, "relative error of the mean")
            };
            let check = format!("emission x {text}: {what}");
            findings.push(Finding { integrator: label, ..bench.finding(GROUP, check, measured, limit) });
        }
    }
    Ok(findings)
}

/// A room without delta surfaces, lit by a square lamp of a given side and always the same power.
fn lamp_room(side: f64) -> Result<Scene, SelftestError> {
    let mut scene = room(16)?;
    scene.shapes.drain(1..4);
    scene.emitters.clear();
    let lamp = quad(DVec3::new(0.125, 0.5, -0.125), DVec3::X * side, DVec3::Z * side)?;
    let radiance = (1.0 / (side * side)) as f32;
    add(&mut scene, Geometry::Mesh(lamp), diffuse(0.0), Some(Rgb::splat(radiance)));
    Ok(scene)
}

/// A lamp of area 2^-40, about 1e-12, and one of 2^-30 of the same power make the same image: seen from half a unit, they differ by the square of their size over that distance,
/// 4e-9. The limit of 2e-3 is for the few paths that turn out otherwise, as for scale. (Powers of two, because vertices must be where they are said to be: at 0.1 the
/// last digit is a hundredth of the lamp.)
fn tiny_lamp(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let (small, tiny) = (lamp_room(2f64.powi(-15))?, lamp_room(2f64.powi(-20))?);
    let mut findings = Vec::new();
    for &(label, parameters) in &AT_UNIT_SIZE {
        let algorithm = integrator(label, parameters)?;
        let (a, b) =
            (image(bench, &small, algorithm, 16)?.mean(), image(bench, &tiny, algorithm, 16)?.mean());
        let check = "lamp of area 1e-12 beside one of 1e-9: relative difference of the mean";
        let finding = bench.finding(GROUP, check, (b / a - 1.0).abs(), 2e-3);
        findings.push(Finding { integrator: label, ..finding });
    }
    Ok(findings)
}

/// A floor of 4 m^2 under a lamp of 1e12 m^2, 1 m above it: as good as half a sky, so that radiance is albedo times emission, less 1e-12. By 5.5 errors of 64 images. Only what starts at the
/// camera: of light paths one in 1e11 would meet the floor.
fn huge_lamp(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let mut scene = empty(8);
    let floor = quad(DVec3::new(-1.0, -1.0, 0.9), DVec3::Y * 2.0, DVec3::X * 2.0)?;
    let lamp = quad(DVec3::new(-5e5, -5e5, -0.1), DVec3::X * 1e6, DVec3::Y * 1e6)?;
    add(&mut scene, Geometry::Mesh(floor), diffuse(0.5), None);
    add(&mut scene, Geometry::Mesh(lamp), diffuse(0.0), Some(Rgb::splat(2.0)));
    let mut findings = Vec::new();
    for label in ["path", "bdpt"] {
        let (mean, error) = mean_and_error(&images(bench, &scene, integrator(label, &[])?, 0..64, 2)?);
        let measured = if error > 0.002 { f64::NAN } else { (mean - 1.0).abs() };
        let check = "floor under a lamp of area 1e12: relative error of its radiance";
        let finding = bench.finding(GROUP, check, measured, 5.5 * error + 1e-5);
        findings.push(Finding { integrator: label, ..finding });
    }
    Ok(findings)
}

/// The inside of a sphere of many emissive triangles, each a light: the closed form of [`furnace`](super::images::furnace), by the same limit.
fn many_triangles(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let levels = if bench.effort == Effort::Quick { 6 } else { 9 };
    let sphere = Solid::icosphere(levels).placed(1.0, DVec3::ZERO)?;
    let (positions, triangles) = (sphere.positions().to_vec(), sphere.triangles().to_vec());
    let count = triangles.len();
    let inside = TriangleMesh::new(positions, triangles, Vec::new(), Vec::new(), true)?;
    let mut scene = empty(16);
    add(&mut scene, Geometry::Mesh(inside), diffuse(0.5), Some(Rgb::splat(0.5)));
    let mut findings = Vec::new();
    for (label, passes) in [("path", 1), ("ptracer", 16), ("bdpt", 1)] {
        let (mean, error) = mean_and_error(&images(bench, &scene, integrator(label, &[])?, 0..64, passes)?);
        let measured = if error > 0.004 { f64::NAN } else { (mean / FURNACE_RADIANCE - 1.0).abs() };
        let check = format!("glowing sphere of {count} lights: relative error of its radiance");
        let finding = bench.finding(GROUP, check, measured, 5.5 * error + 1e-5);
        findings.push(Finding { integrator: label, ..finding });
    }
    Ok(findings)
}

/// A million emissive triangles with areas over 12 decades: the density of a point on a light, over that of a uniform point on all of them, must be 1. The probability of a
/// light and its area are each rounded once to f32 and multiplied: 4 half ulps.
///
/// Lights are chosen by a number of 32 bits, so that of a million of them one with less than 1/4295 of the mean power may never be. All of
/// these together have less than that part of all power.
fn choice(bench: &Bench) -> Result<[Finding; 2], SelftestError> {
    let count = 1_000_000;
    let mut rng = Rng(6);
    let (mut positions, mut triangles) = (Vec::with_capacity(3 * count), Vec::with_capacity(count));
    for i in 0..count as u32 {
        // Exact in f32, so that the area below is that of the mesh: sides are 2^-20 to 1, their products 2^-40 to 1.
        let [a, b] = [(); 2].map(|()| 0.5f32.powi((rng.unit() * 21.0) as i32));
        positions.extend([Vec3::ZERO, Vec3::X * a, Vec3::Y * b]);
        triangles.push([3 * i, 3 * i + 1, 3 * i + 2]);
    }
    let areas: Vec<f64> = positions.chunks(3).map(|t| 0.5 * f64::from(t[1].x) * f64::from(t[2].y)).collect();
    let total: f64 = areas.iter().sum();
    let mesh = TriangleMesh::new(positions, triangles, Vec::new(), Vec::new(), false)?;
    let mut scene = empty(1);
    add(&mut scene, Geometry::Mesh(mesh), diffuse(0.0), Some(Rgb::ONE));
    let world = World::new(&scene);
    let Geometry::Mesh(mesh) = &scene.shapes[0].geometry else { return Err(SelftestError::Shape) };
    let mut worst = 0.0_f64;
    for triangle in 0..count as u32 {
        let point = SurfacePoint::on_triangle(mesh, 0, triangle, 0.25, 0.25);
        let density = world
            .lights
            .light_at(&point)
            .map_or(f64::NAN, |light| f64::from(world.lights.pdf_le(light, Some(point.ng), Vec3::Z).0));
        let error = (density * total - 1.0).abs();
        worst = if error <= worst { worst } else { error };
    }
    let check = "1e6 lights of 12 decades of power: relative error of a density";
    let density = bench.finding(GROUP, check, worst, 4.0 * f64::from(f32::EPSILON / 2.0));
    let never = match AliasTable::new(&areas) {
        None => f64::NAN,
        Some(table) => {
            let mut is_chosen = vec![false; count];
            // The first number that falls into each bin: what is not chosen by that is below its own part of its bin.
            for i in 0..count {
                let first = ((i << 32) as f64 / count as f64).ceil();
                is_chosen[table.sample(first / 4_294_967_296.0)] = true;
            }
            areas.iter().zip(is_chosen).filter(|(_, chosen)| !chosen).map(|(area, _)| area).sum::<f64>()
                / total
        }
    };
    let check = "1e6 lights of 12 decades of power: share of power of those that are never chosen";
    Ok([density, bench.finding(GROUP, check, never, 1.0 / 4295.0)])
}
