//! Self-intersection: rays that leave a surface must not meet it again, and must meet one close by.

use glam::{DQuat, DVec3, Vec3};
use rayon::prelude::*;

use super::solids::{Rng, quad, shape};
use super::{Bench, Finding, Group, SelftestError, Task};
use crate::query::{Ray, RayQuery};
use crate::scene::{Geometry, Shape, SurfacePoint};

/// Rays that one task makes.
const RAYS_PER_TASK: u64 = 1024;

/// Least angle between a spawned ray and its surface.
const LEAST_ANGLE: f64 = 1e-6;

/// A point of a shape's triangle as a hit by a camera ray gives it.
fn point_on(shapes: &[Shape], index: u32, rng: &mut Rng) -> SurfacePoint {
    let Geometry::Mesh(mesh) = &shapes[index as usize].geometry else {
        unreachable!("these checks are made of meshes")
    };
    let triangle = rng.index(mesh.triangles().len()) as u32;
    let (u, v) = (rng.unit(), rng.unit());
    let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
    SurfacePoint::on_triangle(mesh, index, triangle, u as f32, v as f32)
}

/// A direction at an angle to the surface that is uniform in the logarithm from [`LEAST_ANGLE`] to a right angle, on the side of `sign`.
fn grazing(n: Vec3, sign: f64, rng: &mut Rng) -> Vec3 {
    let n = n.as_dvec3().normalize();
    let tangent = rng.direction().cross(n).normalize();
    let sin = rng.log_uniform(LEAST_ANGLE, 1.0);
    (tangent * (1.0 - sin * sin).sqrt() + n * sin * sign).normalize().as_vec3()
}

/// Of `rays` rays spawned on random points of all shapes, those that hit the shape they start on. All shapes must be flat.
pub fn own_hits<Q: RayQuery>(query: &Q, shapes: &[Shape], rays: u64, seed: u64) -> u64 {
    let task = |number: u64| {
        let mut rng = Rng(seed ^ number << 32);
        let hits_itself = |_: &u64| {
            let point = point_on(shapes, rng.index(shapes.len()) as u32, &mut rng);
            let sign = if rng.bits().is_multiple_of(2) { 1.0 } else { -1.0 };
            let ray = Ray::spawn(&point, grazing(point.ng, sign, &mut rng));
            query.intersect(&ray).is_some_and(|hit| hit.shape == point.shape)
        };
        (0..RAYS_PER_TASK.min(rays - number * RAYS_PER_TASK)).filter(hits_itself).count() as u64
    };
    (0..rays.div_ceil(RAYS_PER_TASK)).into_par_iter().map(task).sum()
}

/// Of `rays` segments each between two sheets that face each other (shapes 0, below, and 1) and through them, those whose visibility is wrong: an inner
/// segment that is blocked, or one from below the lower or above the upper sheet to the other that is not.
pub fn sandwich_leaks<Q: RayQuery>(query: &Q, shapes: &[Shape], rays: u64, seed: u64) -> u64 {
    let task = |number: u64| {
        let mut rng = Rng(seed ^ number << 32);
        let wrong = |_: u64| {
            let (a, b) = (point_on(shapes, 0, &mut rng), point_on(shapes, 1, &mut rng));
            let is_inner_blocked = Ray::spawn_between(&a, &b).is_none_or(|ray| query.occluded(&ray));
            // Away from the gap, at any angle, nothing is there; into it, the other sheet is, since the gap is much narrower than the sheets.
            let outwards = Ray::spawn(&a, grazing(a.ng, -1.0, &mut rng));
            let inwards = Ray::spawn(&a, (b.p.as_dvec3() - a.p.as_dvec3()).normalize().as_vec3());
            let passes = query.intersect(&inwards).is_none_or(|hit| hit.shape != 1);
            u64::from(is_inner_blocked) + u64::from(query.occluded(&outwards)) + u64::from(passes)
        };
        (0..RAYS_PER_TASK.min(rays - number * RAYS_PER_TASK)).map(wrong).sum::<u64>()
    };
    (0..rays.div_ceil(RAYS_PER_TASK)).into_par_iter().map(task).sum()
}

/// Of `rays` rays that rise from a floor (shape 0) at up to 45 degrees beneath the middle of a square that hovers `height` over it (shape 1), those that miss it because they start too
/// high or elsewhere. `turn` is that of both; the square is at the origin and much wider than it is high.
pub fn missed_contacts<Q: RayQuery>(
    query: &Q,
    shapes: &[Shape],
    (height, turn): (f64, DQuat),
    rays: u64,
    seed: u64,
) -> u64 {
    let task = |number: u64| {
        let mut rng = Rng(seed ^ number << 32);
        let misses = |_: &u64| {
            let o = turn * (DVec3::new(rng.unit(), rng.unit(), 0.5) * height);
            let down = Ray::new(o.as_vec3(), (turn * DVec3::NEG_Z).as_vec3());
            let Some(hit) = query.intersect(&down).filter(|hit| hit.shape == 0) else { return true };
            let up = turn * (DVec3::Z + rng.direction() * 0.7);
            let ray = Ray::spawn(&hit.surface(shapes, &down), up.normalize().as_vec3());
            query.intersect(&ray).is_none_or(|hit| hit.shape != 1)
        };
        (0..RAYS_PER_TASK.min(rays - number * RAYS_PER_TASK)).filter(misses).count() as u64
    };
    (0..rays.div_ceil(RAYS_PER_TASK)).into_par_iter().map(task).sum()
}

struct Contacts<'a>(&'a [Shape], (f64, DQuat), u64);

impl Task for Contacts<'_> {
    type Output = u64;

    fn run<Q: RayQuery>(&self, query: &Q) -> u64 {
        missed_contacts(query, self.0, self.1, self.2, 5)
    }
}

struct OwnHits<'a>(&'a [Shape], u64);

impl Task for OwnHits<'_> {
    type Output = u64;

    fn run<Q: RayQuery>(&self, query: &Q) -> u64 {
        own_hits(query, self.0, self.1, 2)
    }
}

struct Leaks<'a>(&'a [Shape], u64);

impl Task for Leaks<'_> {
    type Output = u64;

    fn run<Q: RayQuery>(&self, query: &Q) -> u64 {
        sandwich_leaks(query, self.0, self.1, 3)
    }
}

/// A square of side `size` around `center`, turned.
fn square(center: DVec3, size: f64, turn: DQuat) -> Result<Shape, SelftestError> {
    let (ex, ey) = (turn * DVec3::X * size, turn * DVec3::Y * size);
    Ok(shape(quad(center - (ex + ey) * 0.5, ex, ey)?))
}

/// Two sheets of side `size` with a gap between them, turned.
fn sandwich(size: f64, gap: f64, center: DVec3, turn: DQuat) -> Result<[Shape; 2], SelftestError> {
    let half = turn * DVec3::Z * (gap * 0.5);
    let (ex, ey) = (turn * DVec3::X * size, turn * DVec3::Y * size);
    let corner = center - (ex + ey) * 0.5;
    // The upper one faces down.
    Ok([shape(quad(corner - half, ex, ey)?), shape(quad(corner + half, ey, ex)?)])
}

/// As laid out along the axes, and turned by odd angles.
fn turns() -> [(&'static str, DQuat); 2] {
    [("", DQuat::IDENTITY), (", turned", DQuat::from_euler(glam::EulerRot::XYZ, 0.7, -1.1, 2.3))]
}

/// Neither acne nor leaks: the limit is 0, since the offset of spawned rays is an error bound and not a guess.
///
/// The least gap that holds is reported, as a share of the sheets' size; that of turned sheets must be below the 1e-5 of the list of extremes. How near to a huge
/// turned surface a small thing may lie is the same number.
pub(super) fn check(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let group = Group::SelfIntersection;
    let rays = bench.rays(50_000);
    let mut findings = Vec::new();
    for (which, turn) in turns() {
        for (name, size) in [("1e6", 1e6), ("1", 1.0), ("1e-6", 1e-6)] {
            let shapes = [square(DVec3::new(0.3, -0.2, 0.5) * size, size, turn)?];
            let hits = bench.on(&shapes, &OwnHits(&shapes, rays))?;
            let check = format!("square of {name}{which}: grazing rays that hit it again");
            findings.push(bench.finding(group, check, hits as f64, 0.0));
            let shapes = sandwich(size, 1e-5 * size, DVec3::new(0.3, -0.2, 0.5) * size, turn)?;
            let leaks = bench.on(&shapes, &Leaks(&shapes, rays / 4))?;
            let check = format!("two sheets of {name}{which}, 1e-5 of that apart: wrong visibility");
            findings.push(bench.finding(group, check, leaks as f64, 0.0));
        }
        let mut shapes = vec![square(DVec3::ZERO, 1e6, turn)?];
        let mut rng = Rng(4);
        for _ in 0..100 {
            let above = turn * DVec3::new(rng.unit(), rng.unit(), 10.0 + rng.unit());
            shapes.push(square(above, 1e-6, DQuat::from_rotation_z(rng.unit()) * turn)?);
        }
        let hits = bench.on(&shapes, &OwnHits(&shapes, rays))?;
        let check = format!("squares of 1e-6 over one of 1e6{which}: grazing rays that hit their own");
        findings.push(bench.finding(group, check, hits as f64, 0.0));
        // A floor along the axes is exact; the error bound of one that is turned is a few millionths of its size.
        let (name, height) = if which.is_empty() { ("1e-9", 1e-3) } else { ("1e-5", 10.0) };
        let shapes = [square(DVec3::ZERO, 1e6, turn)?, square(turn * DVec3::Z * height, 1e3, turn)?];
        let missed = bench.on(&shapes, &Contacts(&shapes, (height, turn), rays))?;
        let check = format!("square over a floor of 1e6{which}, {name} of that above it: rays that miss it");
        findings.push(bench.finding(group, check, missed as f64, 0.0));
        findings.push(least_gap(bench, turn, which)?);
    }
    Ok(findings)
}

/// The least gap between two sheets of unit size that holds, to the power of two above.
fn least_gap(bench: &Bench, turn: DQuat, which: &str) -> Result<Finding, SelftestError> {
    let mut least = f64::INFINITY;
    for exponent in 10..40 {
        let gap = 0.5f64.powi(exponent);
        let shapes = sandwich(1.0, gap, DVec3::new(0.3, -0.2, 0.5), turn)?;
        if bench.on(&shapes, &Leaks(&shapes, 4096))? > 0 {
            break;
        }
        least = gap;
    }
    let check = format!("least gap between sheets of size 1{which}");
    Ok(bench.finding(Group::SelfIntersection, check, least, 1e-5))
}
