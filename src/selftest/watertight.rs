//! Watertightness: rays from inside closed meshes, aimed at vertices, at edges and anywhere.

use glam::DVec3;
use rayon::prelude::*;

use super::solids::{Rng, Solid, between, shape};
use super::{Bench, Finding, Group, SelftestError, Task};
#[cfg(feature = "embree")]
use crate::query::{Backend, embree::EmbreeSettings};
use crate::query::{Ray, RayQuery};
use crate::scene::{Geometry, TriangleMesh};

/// Scale and offset of a mesh of unit size. The last is where Embree's own `verify` looks.
const PLACES: [(f64, DVec3); 4] = [
    (1.0, DVec3::ZERO),
    (1e-6, DVec3::ZERO),
    (1e6, DVec3::ZERO),
    (100.0, DVec3::new(148_376.0, 1234.0, -223_423.0)),
];

/// Rays that one task makes.
const RAYS_PER_TASK: u64 = 4096;

/// Rays that were found to leave a closed mesh, or of which only one kind of query said so.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Escapes {
    /// Rays of each kind.
    pub rays: u64,
    /// Of those aimed exactly at a vertex.
    pub at_vertices: u64,
    /// Of those aimed at a point of an edge: its middle or any other.
    pub at_edges: u64,
    /// Of those in a random direction.
    pub anywhere: u64,
}

impl Escapes {
    fn add(self, other: Self) -> Self {
        Self {
            rays: self.rays + other.rays,
            at_vertices: self.at_vertices + other.at_vertices,
            at_edges: self.at_edges + other.at_edges,
            anywhere: self.anywhere + other.anywhere,
        }
    }

    /// A number of rays, in millionths of all of their kind.
    fn millionths(&self, escaped: u64) -> f64 {
        1e6 * escaped as f64 / self.rays as f64
    }
}

/// Sends `rays` rays of each kind from near `center`, at most a tenth of `size` away, against a mesh that is star-shaped around it.
pub fn escapes<Q: RayQuery>(
    query: &Q,
    mesh: &TriangleMesh,
    center: DVec3,
    size: f64,
    rays: u64,
    seed: u64,
) -> Escapes {
    let task = |number: u64| {
        let mut rng = Rng(seed ^ number << 32);
        let mut found = Escapes::default();
        for _ in 0..RAYS_PER_TASK.min(rays - number * RAYS_PER_TASK) {
            let o = (center + rng.cube() * 0.1 * size).as_vec3();
            let escapes = |d: DVec3| {
                let ray = Ray::new(o, d.normalize().as_vec3());
                u64::from(query.intersect(&ray).is_none() || !query.occluded(&ray))
            };
            let corners = mesh.corners(rng.index(mesh.triangles().len()) as u32);
            let along = if rng.bits().is_multiple_of(2) { 0.5 } else { rng.unit() };
            // Not rounded to f32, which far from the origin would move points of an edge onto its vertices.
            let towards = |target: DVec3| target - o.as_dvec3();
            found.rays += 1;
            found.at_vertices += escapes(towards(corners[0].as_dvec3()));
            found.at_edges += escapes(towards(between(corners, along, 0.0)));
            found.anywhere += escapes(rng.direction());
        }
        found
    };
    (0..rays.div_ceil(RAYS_PER_TASK)).into_par_iter().map(task).reduce(Escapes::default, Escapes::add)
}

struct Inside<'a> {
    mesh: &'a TriangleMesh,
    place: (f64, DVec3),
    rays: u64,
}

impl Task for Inside<'_> {
    type Output = Escapes;

    fn run<Q: RayQuery>(&self, query: &Q) -> Escapes {
        escapes(query, self.mesh, self.place.1, self.place.0, self.rays, 1)
    }
}

/// The backend without what its default settings give up speed for; it lets rays through, and how many is reported.
#[cfg(feature = "embree")]
fn without_robustness(bench: &Bench) -> Option<Bench> {
    let Backend::Embree(settings) = bench.backend else { return None };
    let backend = Backend::Embree(EmbreeSettings { robust: false, ..settings });
    Some(Bench { name: "embree:robust=false", backend, ..*bench })
}

/// There is none.
#[cfg(not(feature = "embree"))]
fn without_robustness(_: &Bench) -> Option<Bench> {
    None
}

/// Escaped rays of a solid in several places.
fn total(bench: &Bench, solid: &Solid, places: &[(f64, DVec3)], rays: u64) -> Result<Escapes, SelftestError> {
    let mut all = Escapes::default();
    for &place in places {
        let shapes = [shape(solid.placed(place.0, place.1)?)];
        let Geometry::Mesh(mesh) = &shapes[0].geometry else { continue };
        all = all.add(bench.on(&shapes, &Inside { mesh, place, rays })?);
    }
    Ok(all)
}

/// No ray leaves, so the limit is 0: both backends promise that a ray between two triangles with a common edge hits one of them.
///
/// Rays at *vertices* are Embree's exception (its issues 174 and 181), which grows with the fineness of the mesh; the limit is twice the 1.2 % that the README
/// names, and holds what would be a regression. Coordinates in the denormals are beyond Embree altogether: see
/// [`least_extent`].
pub(super) fn check(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let group = Group::Watertightness;
    let solids = [
        ("fine sphere", Solid::icosphere(5)),
        ("cube of squares", Solid::gridded_cube(32)),
        ("spindle of slivers", Solid::double_cone(600, 0.3, 1.0)),
        ("lens of slivers", Solid::double_cone(600, 1.0, 0.3)),
    ];
    let rays = bench.rays(20_000);
    let mut findings = Vec::new();
    for (name, solid) in &solids {
        let found = total(bench, solid, &PLACES, rays)?;
        let vertex_limit = if bench.name == "obvhs" { 0.0 } else { 24_000.0 };
        for (target, escaped, limit) in [
            ("at edges", found.at_edges, 0.0),
            ("anywhere", found.anywhere, 0.0),
            ("at vertices", found.at_vertices, vertex_limit),
        ] {
            let check = format!("{name}: rays {target} that escape, per million");
            findings.push(bench.finding(group, check, found.millionths(escaped), limit));
        }
        if let Some(fast) = without_robustness(bench) {
            let found = total(&fast, solid, &PLACES, rays)?;
            let check = format!("{name}: rays at edges that escape, per million");
            findings.push(fast.finding(group, check, found.millionths(found.at_edges), None));
        }
    }
    findings.push(least_extent(bench)?);
    Ok(findings)
}

/// The least size at which a sphere of 512 triangles holds all rays, to the power of ten above; reported. `obvhs` computes in f64 and must hold it down
/// into the denormals, where 1e-41 still has 7000 steps.
fn least_extent(bench: &Bench) -> Result<Finding, SelftestError> {
    let solid = Solid::icosphere(3);
    let mut least = f64::INFINITY;
    for exponent in (-41..=0).rev() {
        let scale = 10f64.powi(exponent);
        let found = total(bench, &solid, &[(scale, DVec3::ZERO)], 1000)?;
        if found.at_edges + found.anywhere > 0 {
            break;
        }
        least = scale;
    }
    let limit = if bench.name == "obvhs" { 1e-41 } else { 1e-9 };
    Ok(bench.finding(Group::Watertightness, "least radius of a closed sphere", least, limit * 1.001))
}
