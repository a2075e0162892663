//! Triangles.

use std::f64::consts::PI;

use glam::{DVec3, Vec2, Vec3, dvec3, vec3};
use helmholtz::sampling::spherical::SphericalTriangle;

use super::{
    ONE_MINUS_EPSILON, SAMPLES, assert_chi_squared, assert_close, assert_form_factor, locate, partition, rim,
    solid_angle_lhuilier, solid_angle_van_oosterom, uniform,
};

#[derive(Clone, Copy)]
struct Triangle {
    name: &'static str,
    corners: [Vec3; 3],
    p: Vec3,
}

/// A part of a triangle by the barycentric coordinates (of the second and third corner) of its corners.
type TrianglePart = [[f64; 2]; 3];
const WHOLE_TRIANGLE: TrianglePart = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]];

impl Triangle {
    fn seen(&self) -> SphericalTriangle {
        SphericalTriangle::new(self.corners, self.p).unwrap_or_else(|| panic!("{}: refused", self.name))
    }

    fn point(&self, [u, v]: [f64; 2]) -> DVec3 {
        let [a, b, c] = self.corners.map(Vec3::as_dvec3);
        a - self.p.as_dvec3() + u * (b - a) + v * (c - a)
    }

    fn solid_angle(&self, part: TrianglePart) -> f64 {
        solid_angle_van_oosterom(part.map(|q| self.point(q)))
    }
}

fn triangles() -> Vec<Triangle> {
    let t = |name, corners, p| Triangle { name, corners, p };
    let unit = |name, p| t(name, [vec3(-1.0, -1.0, 0.0), vec3(1.0, -1.0, 0.0), vec3(0.0, 1.0, 0.0)], p);
    vec![
        t("octant", [Vec3::X, Vec3::Y, Vec3::Z], Vec3::ZERO),
        unit("facing", vec3(0.0, 0.0, 1.0)),
        unit("behind", vec3(0.3, 0.2, -1.5)),
        unit("far", vec3(400.0, 300.0, 1000.0)),
        unit("very far", vec3(4e5, 3e5, 1e6)),
        unit("near the middle", vec3(0.1, -0.3, 1e-3)),
        unit("near an edge", vec3(0.1, -1.0, 0.01)),
        unit("near another edge", vec3(0.5, 0.0, 0.003)),
        unit("near a corner", vec3(1.001, -1.001, 0.001)),
        unit("grazing", vec3(3.0, 0.4, 1e-3)),
        unit("grazing from behind", vec3(-4.0, 4.0, -2e-4)),
        t("needle", [vec3(-10.0, 0.1, 1.0), vec3(10.0, 0.1, 1.0), vec3(0.0, 0.1001, 1.0)], Vec3::ZERO),
        t(
            "sliver from its tip",
            [vec3(0.0, 0.0, 0.1), vec3(100.0, 0.0, 1.0), vec3(100.0, 0.01, 1.0)],
            Vec3::ZERO,
        ),
        t("huge", [vec3(-1e5, -2e5, 3.0), vec3(3e5, 0.0, 3.0), vec3(0.0, 3e5, 3.0)], vec3(0.0, 0.0, -7.0)),
        t(
            "scaled down",
            [vec3(1e-6, 0.0, 2e-6), vec3(2e-6, 0.0, 2e-6), vec3(0.0, 3e-6, 0.0)],
            vec3(0.0, 0.0, 1e-6),
        ),
        t(
            "far from the origin",
            [vec3(5e3, 5e3, 2.0), vec3(5003.0, 5001.0, 3.0), vec3(5001.0, 5004.0, 2.0)],
            vec3(5001.0, 5001.0, 0.5),
        ),
    ]
}

#[test]
fn triangle_solid_angle_is_the_closed_form() {
    let octant = SphericalTriangle::new([Vec3::X, Vec3::Y, Vec3::Z], Vec3::ZERO).unwrap();
    assert_close(octant.solid_angle(), PI / 2.0, 2e-7, "octant");
    for t in triangles() {
        assert_close(t.seen().solid_angle(), t.solid_angle(WHOLE_TRIANGLE), 5e-7, t.name);
        // L'Huilier's differences of sides cancel in a needle, and half sides near pi/2 blow up.
        let (tolerance, sides) = (1e-6, t.corners.map(|q| q.as_dvec3() - t.p.as_dvec3()));
        if ["octant", "facing", "behind", "near a corner", "scaled down", "far from the origin"]
            .contains(&t.name)
        {
            assert_close(t.seen().solid_angle(), solid_angle_lhuilier(sides), tolerance, t.name);
        }
    }
}

#[test]
fn triangle_solid_angle_has_no_cancellation_when_small() {
    for distance in [1e3_f32, 1e5, 1e7] {
        let p = distance * vec3(0.6, 0.0, 0.8);
        let t = SphericalTriangle::new([Vec3::ZERO, Vec3::X, Vec3::Y], p).unwrap();
        let to_middle = p.as_dvec3() - dvec3(1.0, 1.0, 0.0) / 3.0;
        assert_close(t.solid_angle(), 0.5 * to_middle.z / to_middle.length().powi(3), 1e-6, "small triangle");
    }
}

#[test]
fn triangle_samples_are_uniform_in_solid_angle() {
    let split = |[a, b, c]: TrianglePart| {
        let middle = |p: [f64; 2], q: [f64; 2]| [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])];
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        [[a, ab, ca], [ab, b, bc], [ca, bc, c], [bc, ca, ab]]
    };
    for t in triangles() {
        let seen = t.seen();
        let whole = t.solid_angle(WHOLE_TRIANGLE);
        let mut expected = Vec::new();
        let cells = partition(WHOLE_TRIANGLE, 0, &split, &|part| t.solid_angle(part) / whole, &mut expected);
        let mut counts = vec![0; expected.len()];
        for i in 0..SAMPLES {
            let b = seen.sample(uniform(i)).as_dvec2();
            let depth_in = |[p, q, r]: TrianglePart| {
                let (e, f) = ([q[0] - p[0], q[1] - p[1]], [r[0] - p[0], r[1] - p[1]]);
                let (x, y, area) = (b.x - p[0], b.y - p[1], e[0] * f[1] - e[1] * f[0]);
                let (u, v) = ((x * f[1] - y * f[0]) / area, (e[0] * y - e[1] * x) / area);
                u.min(v).min(1.0 - u - v)
            };
            counts[locate(&cells, &depth_in)] += 1;
        }
        assert_chi_squared(&counts, &expected, t.name);
    }
}

#[test]
fn triangle_samples_stay_on_it() {
    for t in triangles() {
        let seen = t.seen();
        for u in rim() {
            let b = seen.sample(u);
            assert!(b.x >= 0.0 && b.y >= 0.0 && b.x + b.y <= 1.0, "{}: {u} gives {b}", t.name);
        }
        // As for rectangles.
        let (first, last) = (seen.sample(Vec2::ZERO), seen.sample(Vec2::splat(ONE_MINUS_EPSILON)));
        assert!(
            first.distance(Vec2::X) < 1e-6 && last.distance(Vec2::Y) < 0.1,
            "{}: from {first} to {last}",
            t.name
        );
    }
}

#[test]
fn triangle_estimates_its_form_factor() {
    let normal = dvec3(0.1, -0.2, 1.0).normalize();
    for distance in [0.02, 0.3, 5.0, 300.0] {
        let t = Triangle {
            name: "above",
            corners: [vec3(-0.7, -0.2, distance), vec3(0.4, -0.3, distance), vec3(0.1, 0.8, distance)],
            p: Vec3::ZERO,
        };
        let normal = if distance < 0.1 { DVec3::Z } else { normal };
        let seen = t.seen();
        let sample = |u| {
            let b = seen.sample(u).as_dvec2();
            t.point([b.x, b.y])
        };
        assert_form_factor(sample, seen.solid_angle(), &t.corners.map(Vec3::as_dvec3), normal);
    }
}

#[test]
fn degenerate_triangles_are_left_to_area_sampling() {
    let unit = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let refused = |what: &str, corners, p| assert!(SphericalTriangle::new(corners, p).is_none(), "{what}");
    refused("in its plane", unit, vec3(3.0, 4.0, 0.0));
    refused("on it", unit, vec3(0.25, 0.25, 0.0));
    refused("all but on it", unit, vec3(0.25, 0.25, 1e-6));
    refused("on an edge", unit, vec3(0.5, 0.0, 0.0));
    refused("all but on an edge", unit, vec3(0.5, -1e-6, 1e-6));
    refused("at a corner", unit, Vec3::X);
    refused("a line", [Vec3::ZERO, Vec3::X, 2.0 * Vec3::X], Vec3::Z);
    refused("a point", [Vec3::ONE; 3], Vec3::ZERO);
    refused("p not finite", unit, vec3(0.0, f32::NEG_INFINITY, 1.0));
    refused("p not a number", unit, Vec3::NAN);
}
