//! Hierarchies that are detached from their shapes, and attached again after these have changed, answer as new ones do.

use glam::{DAffine3, DVec3, Vec3};
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::{BuildQuality, Hit, Ray, RayQuery, Update};
use helmholtz::scene::{AnalyticShape, Geometry, Group, Instance, Shape, TriangleMesh};
use std::sync::Arc;

use crate::support::{Rng, analytic, icosphere, mesh, placed, shape};

/// A deformed sphere beside a sphere, an instance and a mesh that stays.
fn scene() -> Vec<Shape> {
    let (positions, triangles) = icosphere(4);
    let ball = mesh(placed(&positions, 0.5, DVec3::X), triangles.clone());
    let group =
        Arc::new(Group::new(vec![mesh(placed(&positions, 0.3, DVec3::ZERO), triangles.clone())]).unwrap());
    let to_world = DAffine3::from_translation(DVec3::new(0.0, -1.2, 0.0));
    vec![
        mesh(wave(&positions, 0.0), triangles),
        analytic(AnalyticShape::sphere(DVec3::new(-1.0, 0.0, 0.0), 0.4).unwrap()),
        shape(Geometry::Instance(Instance::new(group, to_world).unwrap())),
        ball,
    ]
}

fn wave(positions: &[DVec3], phase: f64) -> Vec<Vec3> {
    let moved = |p: &DVec3| (*p * (1.0 + 0.3 * (5.0 * p.x + phase).sin()) + DVec3::Y * phase).as_vec3();
    positions.iter().map(moved).collect()
}

/// Gives the first mesh other positions.
fn deform(shapes: &mut [Shape], phase: f64) {
    let (positions, triangles) = icosphere(4);
    let new = TriangleMesh::new(wave(&positions, phase), triangles, vec![], vec![], false).unwrap();
    let empty = TriangleMesh::new(vec![], vec![], vec![], vec![], false).unwrap();
    let Geometry::Mesh(old) = &mut shapes[0].geometry else { unreachable!() };
    let old = std::mem::replace(old, empty);
    shapes[0].geometry = Geometry::Mesh(new.in_place_of(old));
}

fn rays() -> Vec<Ray> {
    let mut rng = Rng(7);
    // Most of them towards the shapes.
    let mut ray = || {
        let (from, to) = (rng.cube() * 2.5, rng.cube());
        Ray::new(from.as_vec3(), (to - from).normalize().as_vec3())
    };
    (0..40_000).map(|_| ray()).collect()
}

/// Both must report the same hit, bit for bit, but for ties: another triangle at the same distance to within its rounding.
fn assert_same(a: &impl RayQuery, b: &impl RayQuery, what: &str) {
    let (mut ties, mut hits) = (0, 0);
    for ray in rays() {
        let (x, y): (Option<Hit>, Option<Hit>) = (a.intersect(&ray), b.intersect(&ray));
        hits += u32::from(x.is_some());
        assert_eq!(a.occluded(&ray), b.occluded(&ray), "{what}: {ray:?}");
        if x != y {
            let (Some(x), Some(y)) = (x, y) else { panic!("{what}: {ray:?} hits {x:?} and {y:?}") };
            assert!((x.t - y.t).abs() <= 1e-6 * x.t.max(1.0), "{what}: {ray:?} hits {x:?} and {y:?}");
            ties += 1;
        }
    }
    assert!(hits > 10_000, "{what}: {hits} hits are too few to tell");
    // Random rays meet an edge to within an ulp about once in 1e6.
    assert!(ties <= 2, "{what}: {ties} ties");
    assert_eq!(a.bounds(), b.bounds(), "{what}");
}

/// Two meshes and a group of 8 * 4^4 triangles each, a sphere, and an instance.
const PRIMITIVES: u64 = 3 * 2048 + 2;

/// Primitives that are built again when meshes are deformed.
fn built_by(update: Update) -> u64 {
    match update {
        Update::Rebuild => PRIMITIVES,
        Update::Refit => 0,
    }
}

/// Puts the corners of a triangle in another order: the same surface, but not the same triangles.
fn turn_a_triangle(shapes: &mut [Shape]) {
    let Geometry::Mesh(mesh) = &shapes[0].geometry else { unreachable!() };
    let mut triangles = mesh.triangles().to_vec();
    triangles[17].rotate_left(1);
    let new = TriangleMesh::new(mesh.positions().to_vec(), triangles, vec![], vec![], false).unwrap();
    let empty = Geometry::Mesh(TriangleMesh::new(vec![], vec![], vec![], vec![], false).unwrap());
    let Geometry::Mesh(old) = std::mem::replace(&mut shapes[0].geometry, empty) else { unreachable!() };
    shapes[0].geometry = Geometry::Mesh(new.in_place_of(old));
}

#[test]
fn obvhs_after_a_deformation() {
    for update in [Update::Rebuild, Update::Refit] {
        let mut shapes = scene();
        let mut detached = ObvhsQuery::new(&shapes, BuildQuality::Medium).detach();
        for phase in [0.3, 0.9] {
            deform(&mut shapes, phase);
            let query = detached.attach(&shapes, BuildQuality::Medium, update);
            assert_same(&query, &ObvhsQuery::new(&shapes, BuildQuality::Medium), "obvhs, deformed");
            assert_eq!(query.built_primitives(), built_by(update));
            detached = query.detach();
        }
        shapes[3].material = helmholtz::scene::MaterialId(3);
        let query = detached.attach(&shapes, BuildQuality::Medium, update);
        assert_eq!(query.built_primitives(), 0, "another material");
        detached = query.detach();
        turn_a_triangle(&mut shapes);
        let query = detached.attach(&shapes, BuildQuality::Medium, update);
        assert_same(&query, &ObvhsQuery::new(&shapes, BuildQuality::Medium), "obvhs, another topology");
        assert_eq!(query.built_primitives(), PRIMITIVES);
        detached = query.detach();
        // The last of the shapes goes, and with it the primitives that the tree names.
        shapes.pop();
        let query = detached.attach(&shapes, BuildQuality::Medium, update);
        assert_same(&query, &ObvhsQuery::new(&shapes, BuildQuality::Medium), "obvhs, a shape less");
        assert_eq!(query.built_primitives(), PRIMITIVES - 2048);
    }
}

#[cfg(feature = "embree")]
#[test]
fn embree_after_a_deformation() {
    use helmholtz::query::embree::{EmbreeQuery, EmbreeSettings};

    fn new(shapes: &[Shape], settings: EmbreeSettings) -> EmbreeQuery<'_> {
        EmbreeQuery::new(shapes, settings).unwrap()
    }

    for compact in [false, true] {
        let settings = EmbreeSettings { compact, ..EmbreeSettings::default() };
        for update in [Update::Rebuild, Update::Refit] {
            let mut shapes = scene();
            let mut detached = EmbreeQuery::with_update(&shapes, settings, update).unwrap().detach();
            for phase in [0.3, 0.9] {
                deform(&mut shapes, phase);
                let query = detached.attach(&shapes, settings, update).unwrap();
                assert_same(
                    &query,
                    &new(&shapes, settings),
                    &format!("embree, compact {compact}, {update:?}"),
                );
                assert_eq!(query.built_primitives(), built_by(update));
                detached = query.detach();
            }
            shapes[3].material = helmholtz::scene::MaterialId(3);
            let query = detached.attach(&shapes, settings, update).unwrap();
            assert_same(&query, &new(&shapes, settings), "embree, another material");
            assert_eq!(query.built_primitives(), 0, "another material");
            detached = query.detach();
            turn_a_triangle(&mut shapes);
            let query = detached.attach(&shapes, settings, update).unwrap();
            assert_same(&query, &new(&shapes, settings), "embree, another topology");
            assert_eq!(query.built_primitives(), PRIMITIVES);
            detached = query.detach();
            shapes.pop();
            let query = detached.attach(&shapes, settings, update).unwrap();
            assert_same(&query, &new(&shapes, settings), "embree, a shape less");
            assert_eq!(query.built_primitives(), PRIMITIVES - 2048);
            // Nothing of it may be looked at while it is detached: the shapes are gone.
            let detached = query.detach();
            drop(shapes);
            drop(detached);
        }
    }
}
