//! Instances on every backend: against brute force in f64, against copies, and what only they can get wrong.

use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec2, Vec3};
use helmholtz::query::reference::{Crossing, TEST_ERROR, crossings};
use helmholtz::query::{Hit, Ray, RayQuery};
use helmholtz::scene::{
    AnalyticKind, AnalyticShape, Geometry, Group, Instance, InstanceError, Rgb, Shape, TriangleMesh,
};

use crate::backends::{BackendTest, on_each_backend};
use crate::query::{PLACES, ray_in, soup};
use crate::support::{Rng, analytic, icosphere, mesh, placed, shape};

fn group(shapes: Vec<Shape>) -> Arc<Group> {
    Arc::new(Group::new(shapes).expect("a proper group"))
}

fn instance(group: &Arc<Group>, map: DAffine3) -> Shape {
    shape(Geometry::Instance(Instance::new(Arc::clone(group), map).expect("a proper map")))
}

fn map(scale: [f64; 3], turn: f64, translation: DVec3) -> DAffine3 {
    let q = DQuat::from_axis_angle(DVec3::new(0.3, 1.0, -0.2).normalize(), turn);
    DAffine3::from_scale_rotation_translation(DVec3::from(scale), q, translation)
}

/// Rotation, even and uneven scale, reflection, shear, and a map that all but flattens.
fn maps() -> Vec<DAffine3> {
    let shear = DMat3::from_cols(DVec3::X, DVec3::new(0.6, 1.0, 0.0), DVec3::new(0.2, -0.4, 0.8));
    vec![
        map([1.0, 1.0, 1.0], 0.7, DVec3::new(0.2, -0.3, 0.1)),
        map([0.4, 0.4, 0.4], 2.0, DVec3::new(-0.9, 0.4, 0.3)),
        map([-0.5, 0.5, 0.5], -1.0, DVec3::new(0.5, 0.8, -0.6)),
        map([1.2, 0.15, 0.4], 0.4, DVec3::new(0.1, 0.2, -0.8)),
        map([0.9, -0.8, 2e-3], 1.9, DVec3::new(-0.2, -0.5, 0.4)),
        DAffine3::from_mat3_translation(shear * 0.5, DVec3::new(0.6, -0.7, 0.5)),
    ]
}

/// A map followed by the scale and offset of a place.
fn moved(map: &DAffine3, (scale, offset): (f64, DVec3)) -> DAffine3 {
    DAffine3::from_scale_rotation_translation(DVec3::splat(scale), DQuat::IDENTITY, offset) * *map
}

/// Checks one answer; primitives that rounding may or may not hide are not counted on. Returns whether a hit was certain.
fn check(shapes: &[Shape], ray: &Ray, hit: Option<Hit>, scale: f64) -> bool {
    let size = scale.max(f64::from(ray.o.abs().max_element()));
    let tolerance = |c: &Crossing| (TEST_ERROR * size + c.error) / c.cosine;
    let all = crossings(shapes, &ray.into(), f64::INFINITY);
    let certain = all
        .iter()
        .filter(|c| c.t > tolerance(c) && c.inside > 1.0 && c.cosine > 0.01)
        .map(|c| c.t + tolerance(c))
        .fold(f64::INFINITY, f64::min);
    let Some(hit) = hit else {
        assert!(certain.is_infinite(), "missed a primitive at {certain}: {ray:?}");
        return false;
    };
    let t = f64::from(hit.t);
    assert!(t <= certain, "{hit:?} lies behind a primitive at {certain}: {ray:?}");
    let own = all
        .iter()
        .filter(|c| (c.shape, c.primitive) == (hit.shape, hit.primitive))
        .min_by(|a, b| (a.t - t).abs().total_cmp(&(b.t - t).abs()));
    let own = own.unwrap_or_else(|| panic!("{hit:?} is not met by {ray:?}"));
    assert!(own.inside > -1.0, "{hit:?} is {} outside: {ray:?}", own.inside);
    assert!((own.t - t).abs() <= tolerance(own), "{hit:?} should be at {}: {ray:?}", own.t);
    let point = hit.surface(shapes, ray);
    let off = (point.p.as_dvec3() - ray.o.as_dvec3() - ray.d.as_dvec3() * t).length();
    assert!(off <= 2.0 * tolerance(own) + own.slide, "{point:?} is off {ray:?} by {off}");
    assert_eq!((point.shape, point.primitive), (hit.shape, hit.primitive));
    certain.is_finite()
}

/// Meshes and a sphere in a group, the group's instances, and shapes of their own between them.
fn scene(rng: &mut Rng, place: (f64, DVec3)) -> Vec<Shape> {
    let ball = || AnalyticShape::sphere(DVec3::new(0.3, 0.2, -0.4), 0.35).expect("a sphere");
    let mut parts = soup(rng, (0.7, DVec3::ZERO));
    parts.insert(1, analytic(ball()));
    parts.insert(0, mesh(Vec::new(), Vec::new()));
    let other = group(vec![analytic(ball())]);
    let parts = group(parts);
    let mut shapes: Vec<Shape> = maps().iter().map(|map| instance(&parts, moved(map, place))).collect();
    shapes.insert(2, soup(rng, place).remove(0));
    shapes.push(instance(&other, moved(&maps()[3], place)));
    let free = AnalyticShape::sphere(DVec3::new(-0.5, 0.4, 0.6) * place.0 + place.1, 0.2 * place.0);
    shapes.push(analytic(free.expect("a sphere")));
    shapes
}

struct BruteForce<'a> {
    shapes: &'a [Shape],
    place: (f64, DVec3),
}

impl BackendTest for BruteForce<'_> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let mut rng = Rng(21);
        let mut certain = 0;
        for _ in 0..600 {
            let ray = ray_in(self.place, rng.cube() * 1.5, rng.direction());
            let hit = query.intersect(&ray);
            certain += u32::from(check(self.shapes, &ray, hit, self.place.0));
            assert_eq!(hit.is_some(), query.occluded(&ray), "{backend}: {ray:?}");
            if let Some(hit) = hit {
                let before = Ray { t_max: hit.t, ..ray };
                assert!(!query.occluded(&before), "{backend}: something is before {hit:?}: {before:?}");
                let behind = Ray { t_min: hit.t * (1.0 - 1e-5), ..ray };
                assert!(query.occluded(&behind), "{backend}: {hit:?} is not found from just before it");
            }
        }
        assert!(certain > 200, "{backend}: only {certain} rays surely hit something");
    }
}

#[test]
fn instances_agree_with_brute_force() {
    let mut rng = Rng(20);
    for place in PLACES {
        let shapes = scene(&mut rng, place);
        on_each_backend(&shapes, &BruteForce { shapes: &shapes, place });
    }
}

/// A smooth, textured mesh: an icosphere with a normal and texture coordinates per vertex.
fn smooth(flip: bool) -> TriangleMesh {
    let (positions, triangles) = icosphere(2);
    let positions = placed(&positions, 0.5, DVec3::ZERO);
    let normals = positions.iter().map(|p| p.normalize()).collect();
    let uvs = positions.iter().map(|p| Vec2::new(p.x + 0.3 * p.z, p.y - 0.2 * p.x)).collect();
    TriangleMesh::new(positions, triangles, normals, uvs, flip).expect("a valid mesh")
}

/// The mesh moved by a map, vertex by vertex.
fn copy(mesh: &TriangleMesh, map: &DAffine3) -> TriangleMesh {
    let positions = mesh.positions().iter().map(|p| map.transform_point3(p.as_dvec3()).as_vec3()).collect();
    let turn = map.matrix3.inverse().transpose();
    let normals = mesh.normals().iter().map(|n| (turn * n.as_dvec3()).normalize().as_vec3()).collect();
    // A reflection turns triangles over; without normals of their own that is made good by the flag.
    let flip = mesh.flip_normals() != (mesh.normals().is_empty() && map.matrix3.determinant() < 0.0);
    TriangleMesh::new(positions, mesh.triangles().to_vec(), normals, mesh.uvs().to_vec(), flip)
        .expect("a mesh")
}

struct LikeCopies<'a> {
    instances: &'a [Shape],
    copies: &'a [Shape],
}

impl BackendTest for LikeCopies<'_> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        on_each_backend(self.copies, &Against { test: self, query, backend });
    }
}

struct Against<'a, Q> {
    test: &'a LikeCopies<'a>,
    query: &'a Q,
    backend: &'a str,
}

impl<P: RayQuery> BackendTest for Against<'_, P> {
    fn run<Q: RayQuery>(&self, other: &str, copies: &Q) {
        let mut rng = Rng(22);
        let (mut hits, mut borders) = (0, 0);
        for _ in 0..8000 {
            let ray = Ray::new((rng.cube() * 1.5).as_vec3(), rng.direction().as_vec3());
            let (Some(a), Some(b)) = (self.query.intersect(&ray), copies.intersect(&ray)) else { continue };
            if (a.shape, a.primitive) != (b.shape, b.primitive) {
                borders += 1;
                continue;
            }
            let (p, q) = (a.surface(self.test.instances, &ray), b.surface(self.test.copies, &ray));
            let what = format!("{} and {other}: {p:?} and {q:?}", self.backend);
            assert!(p.p.distance(q.p) < 1e-4 / ray.d.dot(q.ng).abs(), "{what}");
            assert!(p.ng.distance(q.ng) < 1e-4 && (p.ng.length() - 1.0).abs() < 1e-6, "{what}");
            assert!(p.ns.dot(p.ng) > 0.0, "{what}");
            // Interpolation and an uneven map do not commute: the normal is interpolated in the group.
            if p.shape < 3 {
                assert!(p.ns.distance(q.ns) < 1e-3, "{what}");
            }
            assert!(p.uv.distance(q.uv) < 1e-3, "{what}");
            let (d, e) = (p.dp_duv(self.test.instances), q.dp_duv(self.test.copies));
            let close = |(x, y): (Vec3, Vec3)| x.distance(y) < 1e-3 * y.length();
            let same = d.zip(e).is_some_and(|(d, e)| d.into_iter().zip(e).all(close));
            assert!(same, "{what}: derivatives {d:?} and {e:?}");
            hits += 1;
        }
        assert!(hits > 500 && borders < hits / 50, "{hits} hits, {borders} different");
    }
}

#[test]
fn instances_look_like_copies() {
    for flip in [false, true] {
        let mesh = smooth(flip);
        let parts = group(vec![shape(Geometry::Mesh(mesh.clone()))]);
        // The one that is all but flat is left out: its copy is itself far off.
        let maps: Vec<DAffine3> =
            maps().into_iter().enumerate().filter(|(i, _)| *i != 4).map(|(_, m)| m).collect();
        let instances: Vec<Shape> = maps.iter().map(|m| instance(&parts, *m)).collect();
        let copies: Vec<Shape> = maps.iter().map(|m| shape(Geometry::Mesh(copy(&mesh, m)))).collect();
        on_each_backend(&instances, &LikeCopies { instances: &instances, copies: &copies });
    }
}

struct Ellipsoid<'a>(&'a [Shape], DVec3);
impl BackendTest for Ellipsoid<'_> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let mut rng = Rng(23);
        for _ in 0..1000 {
            let ray = Ray::new((rng.cube() * 0.2).as_vec3(), rng.direction().as_vec3());
            let hit = query.intersect(&ray).expect("it is closed");
            let point = hit.surface(self.0, &ray);
            let p = point.p.as_dvec3();
            assert!(((p / self.1).length_squared() - 1.0).abs() < 1e-5, "{backend}: {point:?}");
            let gradient = (p / (self.1 * self.1)).normalize().as_vec3();
            assert!(point.ng.distance(gradient) < 1e-5, "{backend}: {point:?}");
        }
    }
}

/// A sphere under a map without shear is an ellipsoid: its normal is the gradient of the ellipsoid's own equation.
#[test]
fn spheres_are_stretched_to_ellipsoids() {
    let radii = DVec3::new(2.0, 0.5, 1.0);
    let parts = group(vec![analytic(AnalyticShape::sphere(DVec3::ZERO, 1.0).expect("a sphere"))]);
    let shapes = [instance(&parts, DAffine3::from_scale(radii))];
    on_each_backend(&shapes, &Ellipsoid(&shapes, radii));
}

struct Spawned<'a> {
    shapes: &'a [Shape],
    place: (f64, DVec3),
}

impl BackendTest for Spawned<'_> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let mut rng = Rng(24);
        let mut spawned = 0;
        for _ in 0..4000 {
            let first = ray_in(self.place, rng.cube() * 1.5, rng.direction());
            let Some(hit) = query.intersect(&first) else { continue };
            let point = hit.surface(self.shapes, &first);
            // Half of the directions graze.
            let tilt = if rng.bits().is_multiple_of(2) { 1.0 } else { 1e-3 };
            let side = rng.unit() - 0.5;
            let n = point.ng.as_dvec3();
            let away = rng.direction().cross(n) + n * side * tilt;
            let ray = Ray::spawn(&point, away.normalize().as_vec3());
            let again = query.intersect(&ray);
            let (part, _) = self.shapes[hit.shape as usize].part(hit.primitive);
            let own = again.filter(|again| (again.shape, again.primitive) == (hit.shape, hit.primitive));
            match part.geometry {
                Geometry::Mesh(_) => {
                    assert!(
                        own.is_none(),
                        "{backend}: {ray:?} from {point:?} hits its own triangle: {own:?}"
                    );
                }
                // From inside, the far side is hit: not where the ray began.
                Geometry::Analytic(_) | Geometry::Instance(_) => assert!(
                    own.is_none_or(|own| ray.d.dot(point.ng) < 0.0 && own.t > point.p_err),
                    "{backend}: {ray:?} from {point:?} hits {own:?}"
                ),
            }
            // The error bound is one: a thousandth of the scene at the very most, where coordinates are coarsest.
            let size = self.place.0 + self.place.1.abs().max_element();
            assert!(f64::from(point.p_err) < 2e-5 * size, "{backend}: {point:?}");
            spawned += 1;
        }
        assert!(spawned > 1000, "{backend}: {spawned}");
    }
}

#[test]
fn spawned_rays_leave_their_instance() {
    let mut rng = Rng(25);
    for place in PLACES {
        let shapes = scene(&mut rng, place);
        on_each_backend(&shapes, &Spawned { shapes: &shapes, place });
    }
}

struct Inside<'a> {
    shapes: &'a [Shape],
    /// From the unit sphere to what the instance makes of it.
    map: DAffine3,
    targets: &'a [DVec3],
}

impl BackendTest for Inside<'_> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let mut rng = Rng(26);
        let mut outwards = |target: DVec3| {
            let o = self.map.transform_point3(rng.cube() * 0.1).as_vec3();
            let d = (self.map.transform_point3(target) - o.as_dvec3()).normalize().as_vec3();
            let ray = Ray::new(o, d);
            let hit = query.intersect(&ray).unwrap_or_else(|| panic!("{backend}: {ray:?} escaped"));
            assert!(query.occluded(&ray), "{backend}: {ray:?} is occluded but not found so");
            hit.surface(self.shapes, &ray)
        };
        // Inside a convex closed surface all points see each other.
        let mut previous = outwards(DVec3::X);
        for &target in self.targets {
            let point = outwards(target);
            let line = (point.p.as_dvec3() - previous.p.as_dvec3()).normalize();
            // Where both lie in nearly one plane, neither side is inside.
            if [previous, point].iter().all(|end| line.dot(end.ng.as_dvec3()).abs() > 0.05) {
                let ray = Ray::spawn_between(&previous, &point).expect("the points differ");
                assert!(
                    !query.occluded(&ray),
                    "{backend}: {previous:?} does not see {point:?} along {ray:?}"
                );
            }
            previous = point;
        }
    }
}

/// No ray leaves a closed surface through the edges of its triangles.
#[test]
fn closed_instances_are_watertight() {
    let (positions, triangles) = icosphere(3);
    let edges = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| positions[i as usize]);
        [a.lerp(b, 0.5), b.lerp(c, 0.25), c.lerp(a, 0.8)]
    };
    let targets: Vec<DVec3> = triangles.iter().flat_map(edges).collect();
    let globe = mesh(placed(&positions, 1.0, DVec3::ZERO), triangles.clone());
    let ball = AnalyticShape::new(AnalyticKind::Sphere, DAffine3::IDENTITY, false).expect("a sphere");
    for part in [globe, analytic(ball)] {
        let parts = group(vec![part]);
        for place in PLACES {
            for map in maps() {
                let map = moved(&map, place);
                let m = map.matrix3.inverse();
                let thinness = m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length());
                // Where the flat one is hardly thicker than the steps between coordinates, there is no inside.
                if 1.0 / thinness < 1e-5 * place.1.abs().max_element() {
                    continue;
                }
                let shapes = [instance(&parts, map)];
                on_each_backend(&shapes, &Inside { shapes: &shapes, map, targets: &targets });
            }
        }
    }
}

struct Memory(std::cell::RefCell<Vec<usize>>);
impl BackendTest for Memory {
    fn run<Q: RayQuery>(&self, _: &str, query: &Q) {
        self.0.borrow_mut().push(query.memory());
    }
}

struct Grid;
impl BackendTest for Grid {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let mut rng = Rng(27);
        for _ in 0..1000 {
            let (x, y) = ((rng.unit() * 100.0).floor(), (rng.unit() * 100.0).floor());
            let ray = Ray::new(DVec3::new(x, y, 5.0).as_vec3(), DVec3::NEG_Z.as_vec3());
            let hit = query.intersect(&ray).expect("there is a ball");
            assert_eq!(f64::from(hit.shape), y * 100.0 + x, "{backend}");
            assert!((hit.t - 4.6).abs() < 1e-3, "{backend}: {hit:?}");
        }
    }
}

#[test]
fn ten_thousand_instances_cost_little_more_than_one() {
    let (positions, triangles) = icosphere(6);
    assert!(triangles.len() > 10_000);
    let parts = group(vec![mesh(placed(&positions, 0.4, DVec3::ZERO), triangles)]);
    let grid: Vec<Shape> = (0..10_000)
        .map(|i| {
            let at = DVec3::new(f64::from(i % 100), f64::from(i / 100), 0.0);
            instance(&parts, map([1.0, 1.0, -1.0], f64::from(i), at))
        })
        .collect();
    assert!(size_of::<Shape>() <= 272, "{}", size_of::<Shape>());
    let [one, many] = [&grid[..1], &grid[..]].map(|shapes| {
        let memory = Memory(std::cell::RefCell::default());
        on_each_backend(shapes, &memory);
        memory.0.into_inner()
    });
    for (one, many) in one.into_iter().zip(many) {
        println!("memory: {one} bytes for one instance, {} more for each of 10000", (many - one) / 10_000);
        // The hierarchy over boxes and a record for each; a copy would take more than 400 000.
        assert!(one > 500_000 && many - one < 10_000 * 256, "{one} and {many}");
    }
    on_each_backend(&grid, &Grid);
}

struct Nothing;
impl BackendTest for Nothing {
    fn run<Q: RayQuery>(&self, _: &str, query: &Q) {
        assert!(query.bounds().is_empty());
        assert_eq!(query.intersect(&Ray::new(Vec3::ZERO, Vec3::X)), None);
    }
}

#[test]
fn what_cannot_be_an_instance_is_refused() {
    let parts = group(vec![analytic(AnalyticShape::sphere(DVec3::ZERO, 1.0).expect("a sphere"))]);
    let place = |scale: DVec3, at: f64| {
        let map = DAffine3::from_scale_rotation_translation(scale, DQuat::IDENTITY, DVec3::splat(at));
        Instance::new(Arc::clone(&parts), map).err()
    };
    assert_eq!(place(DVec3::new(1.0, 0.0, 1.0), 0.0), Some(InstanceError::Singular));
    assert_eq!(place(DVec3::new(1.0, f64::NAN, 1.0), 0.0), Some(InstanceError::Singular));
    assert_eq!(place(DVec3::splat(1e13), 0.0), Some(InstanceError::Singular));
    assert_eq!(place(DVec3::splat(1e-13), 0.0), Some(InstanceError::Singular));
    assert_eq!(place(DVec3::ONE, 1e19), Some(InstanceError::OutOfRange));
    assert_eq!(place(DVec3::splat(1e11), 0.0), None);
    let nested = Group::new(vec![instance(&parts, DAffine3::IDENTITY)]).err();
    assert!(matches!(nested, Some(InstanceError::Nested { .. })));
    let lamp = Shape { emission: Some(Rgb::ONE.into()), ..mesh(Vec::new(), Vec::new()) };
    assert!(matches!(Group::new(vec![lamp]).err(), Some(InstanceError::Emits { .. })));
    // A group without primitives is nowhere.
    let nothing = [instance(&group(vec![mesh(Vec::new(), Vec::new())]), DAffine3::IDENTITY)];
    on_each_backend(&nothing, &Nothing);
}
