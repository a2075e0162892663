//! Faults put in on purpose, which the checks must find.

use glam::{DQuat, DVec3, Vec3};
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::{BuildQuality, Hit, Ray, RayQuery};
use helmholtz::scene::{Aabb, Geometry, Shape};
use helmholtz::selftest::solids::{Solid, quad, shape};
use helmholtz::selftest::{Finding, Group, escapes, own_hits, sandwich_leaks};

fn query(shapes: &[Shape]) -> ObvhsQuery<'_> {
    ObvhsQuery::new(shapes, BuildQuality::default())
}

/// Answers for rays that are moved first.
struct Moved<Q, F>(Q, F);

impl<Q: RayQuery, F: Fn(Ray) -> Ray + Sync> RayQuery for Moved<Q, F> {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.0.intersect(&self.1(*ray))
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.0.occluded(&self.1(*ray))
    }

    fn bounds(&self) -> Aabb {
        self.0.bounds()
    }

    fn memory(&self) -> usize {
        self.0.memory()
    }

    fn name(&self) -> String {
        self.0.name()
    }
}

/// One triangle of 512 is missing: of 20,000 rays anywhere some 40 escape, of 60,000 none with a chance of e^-40.
#[test]
fn a_hole_is_found() {
    let mut solid = Solid::icosphere(3);
    let whole = [shape(solid.placed(1.0, DVec3::ZERO).expect("in range"))];
    solid.triangles.pop();
    let holed = [shape(solid.placed(1.0, DVec3::ZERO).expect("in range"))];
    let count = |shapes: &[Shape]| {
        let Geometry::Mesh(mesh) = &shapes[0].geometry else { panic!("a mesh") };
        escapes(&query(shapes), mesh, DVec3::ZERO, 1.0, 20_000, 1)
    };
    let (whole, holed) = (count(&whole), count(&holed));
    assert_eq!((whole.rays, whole.at_vertices, whole.at_edges, whole.anywhere), (20_000, 0, 0, 0));
    assert!(holed.anywhere > 5 && holed.anywhere < 200, "{holed:?}");
}

/// Two triangles that almost share an edge leave a crack of 1e-6: only rays at the edge find it.
#[test]
fn a_crack_is_found() {
    let mut solid = Solid::icosphere(1);
    // A vertex of its own for one triangle, pulled back by a trifle.
    let [a, _, _] = solid.triangles[0];
    let torn = solid.positions.len() as u32;
    solid.positions.push(solid.positions[a as usize] * (1.0 - 1e-3));
    solid.triangles[0][0] = torn;
    let shapes = [shape(solid.placed(1.0, DVec3::ZERO).expect("in range"))];
    let Geometry::Mesh(mesh) = &shapes[0].geometry else { panic!("a mesh") };
    let found = escapes(&query(&shapes), mesh, DVec3::ZERO, 1.0, 20_000, 1);
    assert!(found.at_edges > 0, "{found:?}");
}

/// Rays that start a little below the surface hit it: acne.
#[test]
fn acne_is_found() {
    let sheet = quad(DVec3::new(-0.5, -0.5, 0.0), DVec3::X, DVec3::Y).expect("in range");
    let shapes = [shape(sheet)];
    assert_eq!(own_hits(&query(&shapes), &shapes, 4096, 2), 0);
    let sunk = Moved(query(&shapes), |ray: Ray| Ray { o: ray.o - 1e-7 * Vec3::Z, ..ray });
    // All rays on the upper side that rise by less than their way to the border: half of the rays, for most angles.
    assert!(own_hits(&sunk, &shapes, 4096, 2) > 500);
}

/// An absolute epsilon lets rays pass a sheet that is nearer than that: of two random points of the sheets, some 3 % are.
#[test]
fn leaks_are_found() {
    let turn = DQuat::from_euler(glam::EulerRot::XYZ, 0.7, -1.1, 2.3);
    let (ex, ey, gap) = (turn * DVec3::X, turn * DVec3::Y, turn * DVec3::Z * 1e-5);
    let sheets =
        [quad(DVec3::ZERO, ex, ey).expect("in range"), quad(gap, ey, ex).expect("in range")].map(shape);
    assert_eq!(sandwich_leaks(&query(&sheets), &sheets, 4096, 3), 0);
    let blind = Moved(query(&sheets), |ray: Ray| Ray { t_min: 0.1, ..ray });
    assert!(sandwich_leaks(&blind, &sheets, 4096, 3) > 40);
    // Nearer to each other than the error bound: the bound itself makes rays start behind the other sheet.
    let near = [quad(DVec3::ZERO, ex, ey).expect("in range"), quad(gap * 1e-4, ey, ex).expect("in range")]
        .map(shape);
    assert!(sandwich_leaks(&query(&near), &near, 4096, 3) > 0);
}

/// A measurement that is no number has failed; one without a limit cannot.
#[test]
fn nan_is_a_failure() {
    let finding = |measured: f64, limit: Option<f64>| Finding {
        group: Group::Sums,
        check: String::new(),
        backend: "",
        integrator: "",
        measured,
        limit,
    };
    assert!(finding(0.0, Some(0.0)).is_passed() && finding(f64::NAN, None).is_passed());
    assert!(!finding(f64::NAN, Some(1.0)).is_passed() && !finding(1.1, Some(1.0)).is_passed());
}
