//! What every ray-query backend must do; that closed meshes are closed is in `extremes`. The tests are generic over [`Backend`]; `suite!` makes them a backend's own.
//!
//! The reference for triangles is Moeller and Trumbore's test in f64 over all triangles, which shares neither arithmetic nor
//! hierarchy with any backend.

use glam::{DVec3, Vec3};
use helmholtz::query::{Hit, Ray, RayQuery};
use helmholtz::scene::{AnalyticShape, Geometry, Shape};
use helmholtz::selftest::solids::Solid;

use crate::support::{Rng, analytic, icosphere, mesh, placed};

/// How a backend is made for shapes.
pub(crate) trait Backend {
    type Query<'s>: RayQuery;
    fn build(shapes: &[Shape]) -> Self::Query<'_>;
}

/// Runs all tests of this file on a backend.
macro_rules! suite {
    ($backend:ty) => {
        $crate::query::suite!(
            $backend:
            triangles_agree_with_brute_force,
            spheres_agree_with_the_quadratic,
            occlusion_agrees_with_intersection,
            range_is_open_at_both_ends,
            rays_in_the_planes_of_a_grid_hit,
            distant_small_meshes_are_hit,
            coincident_triangles_give_one_of_them,
            nothing_to_hit,
            degenerate_triangles_are_not_hit,
            rays_that_are_not_finite_hit_nothing,
            spawned_rays_leave_their_triangle,
            spawned_segments_see_their_target
        );
    };
    ($backend:ty: $($name:ident),*) => {
        $(
            #[test]
            fn $name() {
                $crate::query::$name::<$backend>();
            }
        )*
    };
}
pub(crate) use suite;

/// Scale and offset of a scene of unit size.
pub(crate) const PLACES: [(f64, DVec3); 6] = [
    (1.0, DVec3::ZERO),
    (1e-6, DVec3::ZERO),
    (1e6, DVec3::ZERO),
    (1.0, DVec3::new(7e3, -5e3, 4e3)),
    (1e-6, DVec3::new(-5e-3, 7e-3, 4e-3)),
    // Where Embree's own `verify` tests watertightness.
    (100.0, DVec3::new(148_376.0, 1234.0, -223_423.0)),
];

/// A ray in the place of one in a scene of unit size.
pub(crate) fn ray_in((scale, offset): (f64, DVec3), o: DVec3, d: DVec3) -> Ray {
    Ray::new((o * scale + offset).as_vec3(), d.normalize().as_vec3())
}

/// What the reference says of one triangle.
pub(crate) struct Reference {
    pub(crate) t: f64,
    /// Least barycentric coordinate: positive inside, negative outside.
    pub(crate) inside: f64,
    /// |cosine| between ray and normal.
    pub(crate) cosine: f64,
}

pub(crate) fn reference(ray: &Ray, [a, b, c]: [DVec3; 3]) -> Option<Reference> {
    let (o, d) = (ray.o.as_dvec3(), ray.d.as_dvec3());
    let (e1, e2) = (b - a, c - a);
    let h = d.cross(e2);
    let det = e1.dot(h);
    let (s, q) = (o - a, (o - a).cross(e1));
    let (u, v) = (s.dot(h) / det, d.dot(q) / det);
    let cosine = det.abs() / (e1.cross(e2).length() * d.length());
    let t = e2.dot(q) / det;
    (det != 0.0).then(|| Reference { t, inside: u.min(v).min(1.0 - u - v), cosine })
}

fn corners(shapes: &[Shape], shape: u32, primitive: u32) -> [DVec3; 3] {
    let Geometry::Mesh(mesh) = &shapes[shape as usize].geometry else { panic!("shape {shape} is no mesh") };
    mesh.corners(primitive).map(Vec3::as_dvec3)
}

/// Random triangles in two meshes: most of them small, some slivers.
pub(crate) fn soup(rng: &mut Rng, place: (f64, DVec3)) -> Vec<Shape> {
    let mut positions = Vec::new();
    for i in 0..400 {
        let center = rng.cube();
        let size = if i % 10 == 0 { 1.0 } else { 0.2 };
        let (e1, e2) = (rng.direction() * size, rng.direction() * size * if i % 7 == 0 { 1e-3 } else { 1.0 });
        positions.extend([center, center + e1, center + e2]);
    }
    let triangles = |n: u32| (0..n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect::<Vec<_>>();
    let half = positions.len() / 2;
    vec![
        mesh(placed(&positions[..half], place.0, place.1), triangles(200)),
        mesh(placed(&positions[half..], place.0, place.1), triangles(200)),
    ]
}

/// Checks one answer; a triangle within `EDGE` of its border or nearly edge-on may or may not be hit. Returns whether a hit was certain.
fn check_against_brute_force(shapes: &[Shape], ray: &Ray, hit: Option<Hit>, scale: f64) -> bool {
    const EDGE: f64 = 1e-4;
    let size = scale.max(f64::from(ray.o.abs().max_element()));
    let tolerance = |r: &Reference| 1e-5 * size / r.cosine;
    let mut certain = f64::INFINITY;
    for (shape, index) in shapes.iter().zip(0..) {
        for primitive in 0..shape.geometry.primitive_count() {
            let Some(r) = reference(ray, corners(shapes, index, primitive)) else { continue };
            // At the place with the coarsest coordinates the ray's own rounding matters in proportion.
            let edge = EDGE.max(1e-6 * size / scale);
            if r.t > tolerance(&r) && r.inside > edge && r.cosine > 0.01 {
                certain = certain.min(r.t + tolerance(&r));
            }
        }
    }
    let Some(hit) = hit else {
        assert!(certain.is_infinite(), "missed a triangle at {certain}: {ray:?}");
        return false;
    };
    let t = f64::from(hit.t);
    assert!(t <= certain, "{hit:?} lies behind a triangle at {certain}: {ray:?}");
    let corners = corners(shapes, hit.shape, hit.primitive);
    let r = reference(ray, corners).expect("a hit triangle is not edge-on");
    assert!(r.inside > -0.01 && (r.t - t).abs() <= tolerance(&r), "{hit:?} should be at {}: {ray:?}", r.t);
    let [a, b, c] = corners;
    let on_triangle = a + (b - a) * f64::from(hit.u) + (c - a) * f64::from(hit.v);
    let on_ray = ray.o.as_dvec3() + ray.d.as_dvec3() * t;
    assert!((on_triangle - on_ray).length() <= tolerance(&r), "u and v of {hit:?} are off: {ray:?}");
    certain.is_finite()
}

pub(crate) fn triangles_agree_with_brute_force<B: Backend>() {
    let mut rng = Rng(1);
    for place in PLACES {
        let shapes = soup(&mut rng, place);
        let query = B::build(&shapes);
        let certain = (0..1500)
            .filter(|_| {
                let ray = ray_in(place, rng.cube() * 1.5, rng.direction());
                check_against_brute_force(&shapes, &ray, query.intersect(&ray), place.0)
            })
            .count();
        assert!(certain > 300, "only {certain} rays surely hit something");
    }
}

pub(crate) fn spheres_agree_with_the_quadratic<B: Backend>() {
    let mut rng = Rng(2);
    let spheres: Vec<(DVec3, f64)> = (0..60).map(|_| (rng.cube(), 0.02 + 0.2 * rng.unit())).collect();
    let shapes: Vec<Shape> =
        spheres.iter().map(|&(c, r)| analytic(AnalyticShape::sphere(c, r).expect("a sphere"))).collect();
    let query = B::build(&shapes);
    let mut hits = 0;
    for _ in 0..3000 {
        let ray = Ray::new(rng.cube().as_vec3(), rng.direction().as_vec3());
        let (o, d) = (ray.o.as_dvec3(), ray.d.as_dvec3());
        let mut nearest: Option<(f64, u32)> = None;
        let mut grazing = false;
        for (&(center, radius), i) in spheres.iter().zip(0..) {
            let (b, c) = ((o - center).dot(d), (o - center).length_squared() - radius * radius);
            let discriminant = b * b - d.length_squared() * c;
            grazing |= discriminant.abs() < 1e-5;
            if discriminant > 0.0 {
                let roots = [-b - discriminant.sqrt(), -b + discriminant.sqrt()];
                if let Some(t) = roots.map(|t| t / d.length_squared()).into_iter().find(|&t| t > 0.0) {
                    nearest = if nearest.is_none_or(|n| t < n.0) { Some((t, i)) } else { nearest };
                }
            }
        }
        if grazing {
            continue;
        }
        match (nearest, query.intersect(&ray)) {
            (Some((t, i)), Some(hit)) => {
                assert!(
                    (t - f64::from(hit.t)).abs() < 1e-6 * t.max(1e-2) && i == hit.shape,
                    "{hit:?}, not {i} at {t}"
                );
                assert_eq!((hit.primitive, hit.u, hit.v), (0, 0.0, 0.0));
                hits += 1;
            }
            (None, None) => {}
            (expected, found) => panic!("{found:?}, not {expected:?}: {ray:?}"),
        }
    }
    assert!(hits > 700, "only {hits} hits");
}

pub(crate) fn occlusion_agrees_with_intersection<B: Backend>() {
    let mut rng = Rng(3);
    for place in PLACES {
        let mut shapes = soup(&mut rng, place);
        let center = (rng.cube() * 0.5) * place.0 + place.1;
        shapes.push(analytic(AnalyticShape::sphere(center, 0.3 * place.0).expect("a sphere")));
        let query = B::build(&shapes);
        for _ in 0..1500 {
            let mut ray = ray_in(place, rng.cube() * 1.5, rng.direction());
            ray.t_min = (rng.unit() * place.0) as f32;
            ray.t_max = ray.t_min + (rng.unit() * place.0) as f32;
            let hit = query.intersect(&ray);
            assert_eq!(hit.is_some(), query.occluded(&ray), "{ray:?}: {hit:?}");
            assert!(
                hit.is_none_or(|hit| ray.t_min < hit.t && hit.t < ray.t_max),
                "{hit:?} is out of range of {ray:?}"
            );
        }
    }
}

/// The square [0,1]^2 at z = 0 as two triangles.
fn square() -> Shape {
    mesh(vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y], vec![[0, 1, 2], [0, 2, 3]])
}

pub(crate) fn range_is_open_at_both_ends<B: Backend>() {
    let ball = analytic(AnalyticShape::sphere(DVec3::new(10.5, 0.25, -1.0), 1.0).expect("a sphere"));
    let shapes = [square(), ball];
    let query = B::build(&shapes);
    for x in [0.5, 10.5] {
        // Distance 1 exactly: every step of the arithmetic is on dyadic numbers.
        let ray = Ray::new(Vec3::new(x, 0.25, 1.0), Vec3::NEG_Z);
        let found = |t_min: f32, t_max: f32| {
            let ray = Ray { t_min, t_max, ..ray };
            let hit = query.intersect(&ray);
            assert_eq!(hit.is_some(), query.occluded(&ray));
            hit.filter(|hit| hit.t < 1.5).map(|hit| hit.t)
        };
        assert_eq!(found(0.0, f32::INFINITY), Some(1.0));
        assert_eq!(found(0.0, 1.0), None, "a hit at t_max counts");
        assert_eq!(found(0.0, 1f32.next_up()), Some(1.0));
        assert_eq!(found(1.0, f32::INFINITY), None, "a hit at t_min counts");
        assert_eq!(found(1f32.next_down(), f32::INFINITY), Some(1.0));
        assert_eq!(found(1f32.next_down(), 1f32.next_up()), Some(1.0));
        assert_eq!(found(2.0, 1.0), None);
    }
}

pub(crate) fn rays_in_the_planes_of_a_grid_hit<B: Backend>() {
    // Rays along the axes that run exactly in the planes of a cube's grid, with zeros of both signs.
    let n = 16;
    let Solid { positions, triangles } = Solid::gridded_cube(n);
    let shapes = [mesh(placed(&positions, 1.0, DVec3::ZERO), triangles)];
    let query = B::build(&shapes);
    let inner = (1..n).map(|i| i as f32 / n as f32 * 2.0 - 1.0).collect::<Vec<_>>();
    for zero in [0.0, -0.0] {
        for axis in 0..3 {
            for sign in [1.0, -1.0] {
                let mut d = Vec3::splat(zero);
                d[axis] = sign;
                for &x in &inner {
                    for &y in &inner {
                        let mut o = Vec3::new(x, y, 0.0);
                        o = [Vec3::new(0.0, x, y), Vec3::new(x, 0.0, y), o][axis];
                        let ray = Ray::new(o, d);
                        let hit = query.intersect(&ray).unwrap_or_else(|| panic!("{ray:?} escaped"));
                        assert_eq!(hit.t, 1.0);
                    }
                }
            }
        }
    }
}

pub(crate) fn distant_small_meshes_are_hit<B: Backend>() {
    // Rays from 1e4 radii away, parallel to an axis up to components of 1e-30: traversal may not round them away.
    let (positions, triangles) = icosphere(3);
    let mut rng = Rng(7);
    for scale in [1e-6, 1.0, 1e6] {
        let shapes = [mesh(placed(&positions, scale, DVec3::ZERO), triangles.clone())];
        let query = B::build(&shapes);
        for _ in 0..300 {
            let axis = (rng.bits() % 3) as usize;
            let mut o = (rng.direction() * 0.5 * scale).as_vec3();
            let mut d = (rng.cube() * 1e-30).as_vec3();
            (o[axis], d[axis]) = ((1e4 * scale) as f32, -1.0);
            let ray = Ray::new(o, d);
            assert!(query.intersect(&ray).is_some(), "{ray:?} missed");
            assert!(query.occluded(&ray));
        }
    }
}

pub(crate) fn coincident_triangles_give_one_of_them<B: Backend>() {
    let shapes = [square(), square()];
    let query = B::build(&shapes);
    let ray = Ray::new(Vec3::new(0.5, 0.25, 3.0), Vec3::NEG_Z);
    let hit = query.intersect(&ray).expect("two squares are there");
    assert_eq!((hit.t, hit.primitive), (3.0, 0));
    // On the diagonal four triangles tie.
    let ray = Ray::new(Vec3::new(0.5, 0.5, 3.0), Vec3::NEG_Z);
    assert_eq!(query.intersect(&ray).expect("four triangles are there").t, 3.0);
}

pub(crate) fn nothing_to_hit<B: Backend>() {
    for shapes in [vec![], vec![mesh(vec![], vec![])], vec![mesh(vec![Vec3::ONE], vec![])]] {
        let query = B::build(&shapes);
        let ray = Ray::new(Vec3::ZERO, Vec3::X);
        assert_eq!(query.intersect(&ray), None);
        assert!(!query.occluded(&ray));
        assert!(query.bounds().is_empty());
    }
}

pub(crate) fn degenerate_triangles_are_not_hit<B: Backend>() {
    let positions = vec![Vec3::ZERO, Vec3::X, Vec3::X * 2.0, Vec3::Y, Vec3::Z];
    // Points, segments, and one that has an area.
    let degenerate = vec![[0, 0, 0], [1, 1, 0], [0, 1, 2], [2, 0, 2], [4, 4, 4]];
    let flat = [mesh(positions.clone(), degenerate.clone())];
    let mixed = [mesh(positions, [degenerate, vec![[0, 1, 3]]].concat())];
    let mut rng = Rng(8);
    for (shapes, hits) in [(&flat, false), (&mixed, true)] {
        let query = B::build(shapes);
        for i in 0..500 {
            // A third of the rays is aimed exactly at the degenerate ones.
            let target = match i % 3 {
                0 => DVec3::X * rng.unit() * 2.0,
                1 => DVec3::ZERO,
                _ => DVec3::new(0.25, 0.25, 0.0),
            };
            let o = rng.direction() * 5.0;
            let ray = Ray::new(o.as_vec3(), (target - o).normalize().as_vec3());
            let hit = query.intersect(&ray);
            assert!(
                hit.is_none_or(|hit| hits && hit.primitive == 5 && hit.t.is_finite()),
                "{ray:?}: {hit:?}"
            );
            assert!(i % 3 != 2 || hit.is_some() == hits || ray.d.z.abs() < 0.01, "{ray:?}: {hit:?}");
        }
    }
}

pub(crate) fn rays_that_are_not_finite_hit_nothing<B: Backend>() {
    let (positions, triangles) = icosphere(2);
    let ball = analytic(AnalyticShape::sphere(DVec3::ZERO, 2.0).expect("a sphere"));
    let shapes = [mesh(placed(&positions, 1.0, DVec3::ZERO), triangles), ball];
    let query = B::build(&shapes);
    let good = Ray::new(Vec3::ZERO, Vec3::X);
    assert!(query.occluded(&good));
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for i in 0..3 {
            let (mut o, mut d) = (good, good);
            (o.o[i], d.d[i]) = (bad, bad);
            for ray in [o, d] {
                assert_eq!(query.intersect(&ray), None, "{ray:?}");
                assert!(!query.occluded(&ray), "{ray:?}");
            }
        }
    }
    for ray in
        [Ray { t_min: f32::NAN, ..good }, Ray { t_max: f32::NAN, ..good }, Ray { d: Vec3::ZERO, ..good }]
    {
        assert_eq!(query.intersect(&ray), None, "{ray:?}");
        assert!(!query.occluded(&ray), "{ray:?}");
    }
}

pub(crate) fn spawned_rays_leave_their_triangle<B: Backend>() {
    let mut rng = Rng(9);
    for place in PLACES {
        let shapes = soup(&mut rng, place);
        let query = B::build(&shapes);
        for _ in 0..3000 {
            let first = ray_in(place, rng.cube() * 1.5, rng.direction());
            let Some(hit) = query.intersect(&first) else { continue };
            let point = hit.surface(&shapes, &first);
            // Half of the directions graze.
            let tilt = if rng.bits().is_multiple_of(2) { 1.0 } else { 1e-3 };
            let away =
                rng.direction().cross(point.ng.as_dvec3()) + point.ng.as_dvec3() * (rng.unit() - 0.5) * tilt;
            let ray = Ray::spawn(&point, away.normalize().as_vec3());
            let again = query.intersect(&ray);
            assert!(
                again.is_none_or(|again| (again.shape, again.primitive) != (hit.shape, hit.primitive)),
                "{ray:?} from {point:?} hits its own triangle: {again:?}"
            );
        }
    }
}

pub(crate) fn spawned_segments_see_their_target<B: Backend>() {
    // Inside a convex closed mesh all points see each other, also those on neighbouring triangles.
    let (positions, triangles) = icosphere(3);
    let mut rng = Rng(10);
    for place in PLACES {
        let shapes = [mesh(placed(&positions, place.0, place.1), triangles.clone())];
        let query = B::build(&shapes);
        let mut point = || {
            let ray = ray_in(place, DVec3::ZERO, rng.direction());
            query.intersect(&ray).expect("the sphere is closed").surface(&shapes, &ray)
        };
        for _ in 0..2000 {
            let (a, b) = (point(), point());
            // Where one pair of triangles is coplanar after rounding, both ends lie in one plane: neither side is inside.
            let inwards = (b.p.as_dvec3() - a.p.as_dvec3()).normalize();
            if [a, b].iter().any(|end| inwards.dot(end.ng.as_dvec3()).abs() < 0.05) {
                continue;
            }
            let ray = Ray::spawn_between(&a, &b).expect("the points differ");
            assert!((ray.d.length() - 1.0).abs() < 2e-7);
            assert!(!query.occluded(&ray), "{a:?} does not see {b:?} along {ray:?}");
            let behind = Ray { t_max: f32::INFINITY, ..ray };
            assert!(query.occluded(&behind), "{behind:?} passes its target");
            assert_eq!(Ray::spawn_between(&a, &a), None);
            let center = place.1.as_vec3();
            let ray = Ray::spawn_to_point(&a, center).expect("the centre is not on the sphere");
            assert!(!query.occluded(&ray), "{a:?} does not see the centre along {ray:?}");
        }
    }
}
