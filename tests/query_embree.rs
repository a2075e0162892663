//! Embree against exact answers: brute force and quadratics in f64.

use glam::{DVec3, Vec3};
use helmholtz::query::BuildQuality;
use helmholtz::query::embree::{EmbreeError, EmbreeQuery, EmbreeSettings};
use helmholtz::query::{Hit, Ray, RayQuery};
use helmholtz::sampling::sampler::mix;
use helmholtz::scene::{AnalyticShape, Geometry, MaterialId, Shape, TriangleMesh};

/// A stream of random numbers; queries have no dimensions that a `Sampler` would be needed for.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 += 1;
        (mix(self.0) >> 40) as f32 / (1 << 24) as f32
    }

    fn cube(&mut self) -> Vec3 {
        Vec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    fn direction(&mut self) -> Vec3 {
        loop {
            let v = self.cube();
            if (0.01..1.0).contains(&v.length_squared()) {
                return v.normalize();
            }
        }
    }

    fn index(&mut self, len: usize) -> usize {
        ((self.unit() * len as f32) as usize).min(len - 1)
    }
}

fn shape(geometry: Geometry) -> Shape {
    Shape { name: "s".into(), geometry, material: MaterialId(0), emission: None }
}

fn mesh(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Shape {
    shape(Geometry::Mesh(TriangleMesh::new(positions, triangles, vec![], vec![], false).unwrap()))
}

fn sphere(center: DVec3, radius: f64) -> Shape {
    shape(Geometry::Analytic(AnalyticShape::sphere(center, radius).unwrap()))
}

/// Unconnected triangles in a cube.
fn soup(random: &mut Random, count: u32, size: f32) -> Shape {
    let positions = (0..count).flat_map(|_| {
        let center = random.cube();
        [(); 3].map(|()| center + size * random.cube())
    });
    let positions = positions.collect();
    mesh(positions, (0..count).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect())
}

/// A closed mesh around the origin: `n` rings and `n` meridians with thin triangles at the poles.
fn globe(n: u32, scale: f32, offset: Vec3) -> (Vec<Vec3>, Vec<[u32; 3]>) {
    let mut positions = vec![Vec3::Z];
    for (i, j) in (1..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let (sin_theta, cos_theta) = (i as f32 / n as f32 * std::f32::consts::PI).sin_cos();
        let (sin_phi, cos_phi) = (j as f32 / n as f32 * std::f32::consts::TAU).sin_cos();
        positions.push(Vec3::new(sin_theta * cos_phi, sin_theta * sin_phi, cos_theta));
    }
    positions.push(-Vec3::Z);
    let south = positions.len() as u32 - 1;
    let at = |i: u32, j: u32| 1 + (i - 1) * n + j % n;
    let mut triangles = Vec::new();
    for j in 0..n {
        triangles.extend([[0, at(1, j), at(1, j + 1)], [south, at(n - 1, j + 1), at(n - 1, j)]]);
        for i in 1..n - 1 {
            triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
        }
    }
    (positions.iter().map(|p| p * scale + offset).collect(), triangles)
}

fn query(shapes: &[Shape]) -> EmbreeQuery<'_> {
    EmbreeQuery::new(shapes, EmbreeSettings::default()).unwrap()
}

/// Distance and least barycentric coordinate, in f64, of the point where the ray meets the triangle's plane.
fn plane_hit(ray: &Ray, corners: [Vec3; 3]) -> (f64, f64) {
    let [a, b, c] = corners.map(Vec3::as_dvec3);
    let (o, d) = (ray.o.as_dvec3(), ray.d.as_dvec3());
    let (e1, e2) = (b - a, c - a);
    let n = e1.cross(e2);
    let t = (a - o).dot(n) / d.dot(n);
    let q = o + t * d - a;
    let u = q.cross(e2).dot(n) / n.length_squared();
    let v = e1.cross(q).dot(n) / n.length_squared();
    (t, u.min(v).min(1.0 - u - v))
}

#[test]
fn names_library_and_version() {
    assert!(query(&[]).name().starts_with("embree 4."));
}

#[test]
fn closest_hits_agree_with_brute_force() {
    let mut random = Random(1 << 40);
    // The empty mesh in the middle must not shift the indices of shapes.
    let shapes = [
        soup(&mut random, 100, 0.2),
        mesh(vec![], vec![]),
        soup(&mut random, 100, 0.2),
        soup(&mut random, 50, 0.6),
    ];
    for robust in [true, false] {
        let query = EmbreeQuery::new(&shapes, EmbreeSettings { robust, ..Default::default() }).unwrap();
        let mut hits = 0;
        for _ in 0..20_000 {
            let ray = Ray::new(1.5 * random.cube(), random.direction());
            let hit = query.intersect(&ray);
            let nearest = hit.map_or(f64::INFINITY, |hit| f64::from(hit.t));
            for (index, shape) in shapes.iter().enumerate() {
                let Geometry::Mesh(mesh) = &shape.geometry else { unreachable!() };
                for triangle in 0..mesh.triangles().len() as u32 {
                    let corners = mesh.corners(triangle);
                    let (t, margin) = plane_hit(&ray, corners);
                    // Nothing that is hit beyond doubt is nearer than what was reported.
                    assert!(!(t > 1e-4 && t < nearest - 1e-4 && margin > 1e-4), "{ray:?} {hit:?} {t}");
                    // What was reported is hit, or missed by a rounding error, at the distance and the point reported.
                    if let Some(hit) = hit.filter(|h| (h.shape, h.primitive) == (index as u32, triangle)) {
                        let [a, b, c] = corners;
                        let p = a * (1.0 - hit.u - hit.v) + b * hit.u + c * hit.v;
                        assert!(
                            margin > -1e-4 && p.distance(ray.o + ray.d * hit.t) < 1e-4,
                            "{ray:?} {hit:?}"
                        );
                        assert!((t - nearest).abs() < 1e-4, "{ray:?} {hit:?} {t}");
                        hits += 1;
                    }
                }
            }
        }
        assert!((5_000..20_000).contains(&hits), "{hits} hits do not test much");
    }
}

#[test]
fn intervals_are_open_and_occlusion_agrees_with_the_closest_hit() {
    let mut random = Random(2 << 40);
    let shapes = [soup(&mut random, 500, 0.3), sphere(DVec3::new(0.2, 0.1, 0.0), 0.3)];
    let query = query(&shapes);
    let mut on_sphere = 0;
    for _ in 0..50_000 {
        let ray = Ray::new(random.cube(), random.direction());
        let bounded = Ray { t_min: random.unit() * 0.5, t_max: random.unit() * 3.0, ..ray };
        assert_eq!(query.occluded(&bounded), query.intersect(&bounded).is_some(), "{bounded:?}");
        let Some(hit) = query.intersect(&ray) else {
            assert!(!query.occluded(&ray));
            continue;
        };
        on_sphere += u32::from(hit.shape == 1);
        let up_to = Ray { t_max: hit.t, ..ray };
        assert_eq!((query.intersect(&up_to), query.occluded(&up_to)), (None, false), "{ray:?} {hit:?}");
        let beyond = Ray { t_min: hit.t, ..ray };
        assert!(query.intersect(&beyond).is_none_or(|next| next.t > hit.t), "{ray:?} {hit:?}");
        let around = Ray { t_min: hit.t.next_down(), t_max: hit.t.next_up(), ..ray };
        assert_eq!((query.intersect(&around), query.occluded(&around)), (Some(hit), true), "{ray:?} {hit:?}");
    }
    assert!(on_sphere > 1000);
}

#[test]
fn nothing_is_hit_where_there_is_nothing() {
    for shapes in [vec![], vec![mesh(vec![], vec![])], vec![mesh(vec![Vec3::ONE], vec![])]] {
        let query = query(&shapes);
        let ray = Ray::new(Vec3::ZERO, Vec3::X);
        assert_eq!((query.intersect(&ray), query.occluded(&ray)), (None, false));
        assert!(query.bounds().is_empty());
    }
}

#[test]
fn rays_that_are_no_rays_hit_nothing() {
    let (positions, triangles) = globe(20, 1.0, Vec3::ZERO);
    let shapes = [mesh(positions, triangles), sphere(DVec3::ZERO, 2.0)];
    let query = query(&shapes);
    assert!(query.occluded(&Ray::new(Vec3::ZERO, Vec3::X)));
    let nothing =
        |ray: Ray| assert_eq!((query.intersect(&ray), query.occluded(&ray)), (None, false), "{ray:?}");
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            let broken = Vec3::select(axis.cmpgt(Vec3::ZERO), Vec3::splat(bad), Vec3::splat(0.1));
            nothing(Ray::new(broken, Vec3::X));
            nothing(Ray::new(Vec3::ZERO, broken));
        }
    }
    let ray = Ray::new(Vec3::ZERO, Vec3::X);
    for t_max in [f32::NAN, f32::NEG_INFINITY, -1.0, 0.0, f32::MIN_POSITIVE] {
        nothing(Ray { t_max, ..ray });
    }
    for t_min in [f32::INFINITY, f32::MAX, 2.5] {
        nothing(Ray { t_min, ..ray });
    }
    nothing(Ray { t_min: 0.7, t_max: 0.6, ..ray });
    // From far away these miss or hit by rounding; they must come back, and with a distance that is one.
    let mut random = Random(3 << 40);
    for exponent in [10, 18, 19, 30, 38] {
        for _ in 0..1000 {
            let away = random.direction();
            let ray = Ray::new(away * 10_f32.powi(exponent), -away);
            assert!(query.intersect(&ray).is_none_or(|hit| hit.t.is_finite() && hit.t > 0.0));
            nothing(Ray { d: away, ..ray });
        }
    }
}

#[test]
fn closed_meshes_are_watertight_from_inside() {
    let mut random = Random(4 << 40);
    // The far place is that of Embree's own test of this.
    for (scale, offset) in [(1.0, Vec3::ZERO), (1000.0, Vec3::new(148_376.0, 1234.0, -223_423.0))] {
        let (positions, triangles) = globe(100, scale, offset);
        let shapes = [mesh(positions.clone(), triangles.clone())];
        let query = query(&shapes);
        let (rays, mut through_vertices) = (100_000, 0);
        for _ in 0..rays {
            let o = offset + 0.5 * scale * random.unit() * random.direction();
            let [a, b, _] = triangles[random.index(triangles.len())].map(|i| positions[i as usize]);
            let hits = |target: Vec3| query.occluded(&Ray::new(o, (target - o).normalize()));
            assert!(hits(o + random.direction()), "anywhere, from {o}");
            assert!(hits(a.lerp(b, 0.5)), "middle of the edge {a} {b} from {o}");
            assert!(hits(a.lerp(b, random.unit())), "on the edge {a} {b} from {o}");
            through_vertices += u32::from(!hits(a));
        }
        // A known limit (Embree's issues 174 and 181): the signs of the edge tests around a vertex may all come out
        // wrong. One ray in 80 at worst was seen, of those aimed at a vertex to the last bit.
        assert!(through_vertices < rays / 40, "{through_vertices} of {rays} rays slipped through a vertex");
    }
}

#[test]
fn spheres_of_any_size_are_exact_from_both_sides() {
    let mut random = Random(5 << 40);
    for radius in [1e-4, 1e-2, 1.0, 1e2, 1e4] {
        for center in [DVec3::ZERO, DVec3::new(3.0, -7.0, 11.0) * radius] {
            let shapes = [sphere(center, radius)];
            let query = query(&shapes);
            for distance in [0.0, 0.5, 0.999, 1.001, 2.0, 100.0] {
                for _ in 0..500 {
                    let target = center + radius * random.direction().as_dvec3();
                    let o = (center + radius * distance * random.direction().as_dvec3()).as_vec3();
                    let ray = Ray::new(o, (target - o.as_dvec3()).normalize().as_vec3());
                    // Solved for the ray as rounded, by the foot of the perpendicular from the centre.
                    let (o, d) = (ray.o.as_dvec3() - center, ray.d.as_dvec3());
                    let foot = -o.dot(d) / d.length_squared();
                    let depth = 1.0 - (o + foot * d).length_squared() / (radius * radius);
                    if depth < 0.0 {
                        // The rounding of the direction alone made the ray miss.
                        assert!(depth > -1e-2 && query.intersect(&ray).is_none(), "radius {radius}: {ray:?}");
                        continue;
                    }
                    let half = radius * depth.sqrt() / d.length();
                    let exact = if o.length() < radius { foot + half } else { foot - half };
                    let t = query.intersect(&ray).map(|hit| f64::from(hit.t));
                    let error = t.map(|t| (t - exact).abs() / exact);
                    // Half an ulp is the rounding of t itself; near the surface the roots cancel in f64.
                    assert!(error.is_some_and(|e| e < 1e-7), "radius {radius}: {ray:?} {t:?} {exact}");
                    assert!(query.occluded(&ray));
                }
            }
        }
    }
}

#[test]
fn grazed_slivers_are_hit_within_their_own_extent() {
    let mut random = Random(6 << 40);
    let (mut hits, mut rays) = (0, 0);
    for _ in 0..300 {
        let (start, along) = (100.0 * random.direction(), 10.0 * random.direction());
        let across = 10_f32.powf(-4.0 * random.unit()) * random.direction();
        let corners = [start, start + along, start + 0.5 * along + across];
        let shapes = [mesh(corners.to_vec(), vec![[0, 1, 2]])];
        let query = query(&shapes);
        for _ in 0..1000 {
            let target = start + random.unit() * along + 0.5 * random.unit() * across;
            let tilt = 10_f32.powf(-1.0 - 5.0 * random.unit());
            let d = (along / 10.0 + tilt * random.direction()).normalize();
            let ray = Ray::new(target - 500.0 * random.unit() * d, d);
            rays += 1;
            if let Some(hit) = query.intersect(&ray) {
                let reach = corners.map(|c| (c.as_dvec3() - ray.o.as_dvec3()).dot(d.as_dvec3()));
                let [near, far] = [
                    reach.iter().copied().fold(f64::MAX, f64::min),
                    reach.iter().copied().fold(0.0, f64::max),
                ];
                let t = f64::from(hit.distance(&shapes, &ray));
                // Corners are up to 700 away and told apart to about 1e-4 of that.
                assert!(near - 0.02 < t && t < far + 0.02, "{ray:?} {hit:?} outside {near}..{far}");
                hits += 1;
            }
        }
    }
    assert!(hits > rays / 10, "{hits} hits do not test much");
}

#[test]
fn memory_grows_with_the_scene() {
    let mut random = Random(7 << 40);
    let [small, large] = [1_000, 50_000].map(|count| {
        let shapes = [soup(&mut random, count, 0.1)];
        query(&shapes).memory()
    });
    // A triangle costs at least the 12 bytes that name it.
    assert!(small > 12_000 && large > 10 * small, "{small} {large}");
}

#[test]
fn hits_do_not_depend_on_threads() {
    let mut random = Random(8 << 40);
    let (positions, triangles) = globe(120, 1.0, Vec3::ZERO);
    let shapes = [mesh(positions.clone(), triangles), soup(&mut random, 20_000, 0.05), sphere(DVec3::X, 0.5)];
    // Half of them towards vertices and edges, where several triangles tie.
    let rays: Vec<Ray> = (0..20_000)
        .map(|i| {
            let o = 2.0 * random.cube();
            let target = positions[random.index(positions.len())];
            Ray::new(o, if i % 2 == 0 { (target - o).normalize() } else { random.direction() })
        })
        .collect();
    let bits =
        |hit: Option<Hit>| hit.map(|h| (h.shape, h.primitive, h.u.to_bits(), h.v.to_bits(), h.t.to_bits()));
    let built_with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| EmbreeQuery::new(&shapes, EmbreeSettings::default()).unwrap())
    };
    let reference: Vec<_> = {
        let query = built_with(1);
        rays.iter().map(|ray| bits(query.intersect(ray))).collect()
    };
    assert!(reference.iter().flatten().count() > 5_000);
    for threads in [2, 5] {
        let query = built_with(threads);
        std::thread::scope(|scope| {
            let workers: Vec<_> = (0..8)
                .map(|_| {
                    scope.spawn(|| rays.iter().map(|ray| bits(query.intersect(ray))).collect::<Vec<_>>())
                })
                .collect();
            for worker in workers {
                assert!(worker.join().unwrap() == reference, "built with {threads} threads");
            }
        });
    }
}

#[test]
fn every_setting_finds_the_same_triangles() {
    let mut random = Random(9 << 40);
    let shapes = [soup(&mut random, 2_000, 0.1)];
    let reference = query(&shapes);
    for quality in [BuildQuality::Low, BuildQuality::Medium, BuildQuality::High] {
        for (robust, compact) in [(true, false), (true, true), (false, false), (false, true)] {
            let query = EmbreeQuery::new(&shapes, EmbreeSettings { robust, quality, compact }).unwrap();
            let differ = (0..5_000)
                .filter(|_| {
                    let ray = Ray::new(random.cube(), random.direction());
                    let triangle = |hit: Option<Hit>| hit.map(|h| h.primitive);
                    triangle(query.intersect(&ray)) != triangle(reference.intersect(&ray))
                })
                .count();
            // Only rays through an edge may differ: about 1e-7 of an edge's length in 0.1, times the edges near a ray.
            assert!(differ <= 2, "{differ} rays differ at {quality:?}, robust {robust}, compact {compact}");
        }
    }
}

#[test]
fn shapes_beyond_embrees_coordinates_are_refused() {
    let shapes = [sphere(DVec3::ZERO, 1.0), sphere(DVec3::X * 1e19, 1.0)];
    let error = EmbreeQuery::new(&shapes, EmbreeSettings::default()).err();
    assert_eq!(error, Some(EmbreeError::OutOfRange { name: "s".into() }));
}

struct Embree;

impl crate::query::Backend for Embree {
    type Query<'s> = EmbreeQuery<'s>;

    fn build(shapes: &[Shape]) -> EmbreeQuery<'_> {
        EmbreeQuery::new(shapes, EmbreeSettings::default()).expect("Embree")
    }
}

// Without those tests of the suite that ask for more than Embree gives: exact distances (its reciprocals are rounded), and no
// escape at exact vertices, of which the tests above bound the share.
crate::query::suite!(
    Embree: triangles_agree_with_brute_force,
    spheres_agree_with_the_quadratic,
    occlusion_agrees_with_intersection,
    distant_small_meshes_are_hit,
    nothing_to_hit,
    degenerate_triangles_are_not_hit,
    rays_that_are_not_finite_hit_nothing,
    spawned_rays_leave_their_triangle,
    spawned_segments_see_their_target
);
