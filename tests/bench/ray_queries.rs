//! Measures what `vendor-notes/obvhs.md` reports: build time, bytes per triangle and rays per second of the `obvhs` backend, beside the
//! traversals that `obvhs` itself brings, with the same triangle test.
//!
//! `cargo bench --no-default-features --bench ray_queries -- [triangles in thousands]`

use glam::{DVec3, Vec3, Vec3A};
use helmholtz::query::BuildQuality;
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::triangle::WatertightRay;
use helmholtz::query::{Ray, RayQuery};
use helmholtz::sampling::sampler::mix;
use helmholtz::scene::{Geometry, MaterialId, Shape, TriangleMesh};
use obvhs::cwbvh::builder::build_cwbvh;
use obvhs::ray::{Ray as TheirRay, RayHit};
use obvhs::{BvhBuildParams, aabb::Aabb, bvh2::builder::build_bvh2};
use std::time::{Duration, Instant};

const RAYS: u64 = 1 << 20;
const ROUNDS: usize = 16;

/// A bumpy sphere of about 2 n^2 triangles.
fn bumpy_sphere(n: u32) -> TriangleMesh {
    let mut positions = Vec::new();
    for i in 0..=n {
        for j in 0..n {
            let theta = f64::from(i) / f64::from(n) * std::f64::consts::PI;
            let phi = f64::from(j) / f64::from(n) * std::f64::consts::TAU;
            let r = 1.0
                + 0.1 * (20.0 * theta).sin() * (30.0 * phi).sin()
                + 0.01 * (300.0 * theta).sin() * (400.0 * phi).sin();
            positions.push(
                (DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()) * r).as_vec3(),
            );
        }
    }
    let quads = (0..n).flat_map(|i| (0..n).map(move |j| (i * n + j, i * n + (j + 1) % n)));
    let triangles = quads.flat_map(|(a, b)| [[a, b, b + n], [a, b + n, a + n]]).collect();
    TriangleMesh::new(positions, triangles, Vec::new(), Vec::new(), false).expect("a valid mesh")
}

/// Incoherent rays: from points in and around the sphere in all directions.
fn rays() -> Vec<Ray> {
    let uniform = |k: u64| (mix(k) >> 11) as f64 * 2f64.powi(-52) - 1.0;
    let vector = |k: u64| DVec3::new(uniform(k), uniform(k + 1), uniform(k + 2));
    (0..RAYS)
        .map(|i| Ray::new((vector(6 * i) * 1.2).as_vec3(), vector(6 * i + 3).normalize().as_vec3()))
        .collect()
}

/// A traversal under test: whether a ray hits something.
type Query<'a> = Box<dyn Fn(&Ray) -> bool + 'a>;

/// Times short rounds of all in turn and reports the best of each, so that other work on the machine weighs on none of them.
fn compare(queries: &[(String, Query)], rays: &[Ray]) {
    let mut best = vec![f64::INFINITY; queries.len()];
    let mut hits = vec![0; queries.len()];
    for round in rays.chunks(rays.len() / ROUNDS) {
        for (i, (_, query)) in queries.iter().enumerate() {
            let start = Instant::now();
            hits[i] += round.iter().filter(|ray| query(ray)).count();
            best[i] = best[i].min(start.elapsed().as_secs_f64() / round.len() as f64);
        }
    }
    for (i, (name, _)) in queries.iter().enumerate() {
        println!("{name:<44} {:6.3} M rays/s on one thread, {} hits", 1e-6 / best[i], hits[i]);
    }
}

fn timed<T>(name: &str, build: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let built = build();
    println!("{name}: built in {:.2} s", start.elapsed().as_secs_f64());
    built
}

fn main() {
    let thousands = std::env::args().find_map(|a| a.parse::<f64>().ok()).unwrap_or(1000.0);
    let mesh = bumpy_sphere((thousands * 500.0).sqrt() as u32);
    let count = mesh.triangles().len();
    let corners: Vec<[Vec3; 3]> = (0..count as u32).map(|i| mesh.corners(i)).collect();
    let shapes = [Shape {
        name: String::new(),
        geometry: Geometry::Mesh(mesh),
        material: MaterialId(0),
        emission: None,
    }];
    let rays = rays();
    println!("{count} triangles, {RAYS} incoherent rays");

    let ours = [BuildQuality::Low, BuildQuality::Medium, BuildQuality::High].map(|quality| {
        let query = timed(&format!("ours, {quality:?}"), || ObvhsQuery::new(&shapes, quality));
        println!("  {:.1} bytes per triangle", query.memory() as f64 / count as f64);
        (quality, query)
    });
    let boxes: Vec<Aabb> = corners.iter().map(|c| Aabb::from_points(&c.map(Vec3A::from))).collect();
    let parameters = BvhBuildParams::medium_build();
    let bvh2 = timed("obvhs Bvh2", || build_bvh2(&boxes, parameters, &mut Duration::default()));
    let cwbvh = timed("obvhs CwBvh", || build_cwbvh(&boxes, parameters, &mut Duration::default()));
    let ordered = |indices: &[u32]| indices.iter().map(|&i| corners[i as usize]).collect::<Vec<_>>();
    let (bvh2_corners, cwbvh_corners) = (ordered(&bvh2.primitive_indices), ordered(&cwbvh.primitive_indices));
    let their_ray = |ray: &Ray| TheirRay::new(ray.o.into(), ray.d.into(), ray.t_min, ray.t_max);
    let distance = |prepared: &WatertightRay, corners, t_max| {
        prepared.intersect(corners, t_max).map_or(f32::INFINITY, |hit| hit.t)
    };

    let mut queries: Vec<(String, Query)> = Vec::new();
    for (quality, query) in &ours {
        queries
            .push((format!("ours, {quality:?}, intersect"), Box::new(|ray| query.intersect(ray).is_some())));
        queries.push((format!("ours, {quality:?}, occluded"), Box::new(|ray| query.occluded(ray))));
    }
    queries.push((
        "Bvh2::ray_traverse, our triangle test".to_owned(),
        Box::new(|ray| {
            let prepared = WatertightRay::new(ray);
            bvh2.ray_traverse(their_ray(ray), &mut RayHit::none(), |r, i| {
                distance(&prepared, &bvh2_corners[i], r.tmax)
            })
        }),
    ));
    queries.push((
        "CwBvh::ray_traverse, our triangle test".to_owned(),
        Box::new(|ray| {
            let prepared = WatertightRay::new(ray);
            cwbvh.ray_traverse(their_ray(ray), &mut RayHit::none(), |r, i| {
                distance(&prepared, &cwbvh_corners[i], r.tmax)
            })
        }),
    ));
    compare(&queries, &rays);
}
