//! Rectangles.

use std::f64::consts::PI;

use glam::{DVec3, Vec2, Vec3, dvec3, vec3};
use helmholtz::sampling::spherical::SphericalRectangle;

use super::{
    ONE_MINUS_EPSILON, SAMPLES, assert_chi_squared, assert_close, assert_form_factor, locate, partition, rim,
    seen_rectangle, uniform,
};

#[derive(Clone, Copy)]
struct Rectangle {
    name: &'static str,
    corner: Vec3,
    ex: Vec3,
    ey: Vec3,
    p: Vec3,
}

impl Rectangle {
    fn seen(&self) -> SphericalRectangle {
        seen_rectangle(self.corner, self.ex, self.ey, self.p)
            .unwrap_or_else(|| panic!("{}: refused", self.name))
    }

    fn point(&self, s: f64, t: f64) -> DVec3 {
        self.corner.as_dvec3() - self.p.as_dvec3() + s * self.ex.as_dvec3() + t * self.ey.as_dvec3()
    }

    /// Of the part [s0, s1] x [t0, t1]: the sum of four arctangents, one per corner.
    fn solid_angle(&self, [s0, s1]: [f64; 2], [t0, t1]: [f64; 2]) -> f64 {
        let (x, y) = (self.ex.as_dvec3().normalize(), self.ey.as_dvec3().normalize());
        let z = self.point(0.0, 0.0).dot(x.cross(y)).abs();
        let term = |s, t| {
            let q = self.point(s, t);
            (q.dot(x) * q.dot(y)).atan2(z * q.length())
        };
        term(s1, t1) - term(s0, t1) - term(s1, t0) + term(s0, t0)
    }
}

fn rectangles() -> Vec<Rectangle> {
    let r = |name, corner, ex, ey, p| Rectangle { name, corner, ex, ey, p };
    let unit = |name, p| r(name, vec3(-1.0, -1.0, 0.0), vec3(2.0, 0.0, 0.0), vec3(0.0, 2.0, 0.0), p);
    let tilt = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.3, -1.1, 2.0);
    vec![
        unit("facing", vec3(0.0, 0.0, 1.0)),
        unit("behind", vec3(0.3, 0.2, -1.5)),
        unit("far", vec3(40.0, 30.0, 100.0)),
        unit("near the middle", vec3(0.2, -0.3, 1e-3)),
        unit("very near the middle", vec3(0.2, -0.3, 1e-4)),
        unit("near an edge", vec3(1.0, 0.1, 0.01)),
        unit("near a corner", vec3(-1.001, -1.001, 0.001)),
        unit("grazing", vec3(3.0, 0.4, 1e-3)),
        unit("grazing across the diagonal", vec3(-4.0, 4.0, 2e-4)),
        r("needle", vec3(-10.0, 0.1, 1.0), vec3(20.0, 0.0, 0.0), vec3(0.0, 1e-3, 0.0), Vec3::ZERO),
        r("upright needle", vec3(0.1, -10.0, 1.0), vec3(1e-3, 0.0, 0.0), vec3(0.0, 20.0, 0.0), Vec3::ZERO),
        r("huge", vec3(-1e5, -2e5, 3.0), vec3(3e5, 0.0, 0.0), vec3(0.0, 3e5, 0.0), vec3(0.0, 0.0, -7.0)),
        r(
            "scaled down",
            vec3(1e-6, 0.0, 2e-6),
            vec3(1e-6, 0.0, 0.0),
            vec3(0.0, 3e-6, 0.0),
            vec3(0.0, 0.0, 1e-6),
        ),
        r(
            "tilted",
            tilt * vec3(0.5, -2.0, 1.0),
            tilt * vec3(0.0, 3.0, 0.0),
            tilt * vec3(0.0, 0.0, 0.7),
            vec3(0.2, 0.1, 0.0),
        ),
        r(
            "ceiling lamp of the Cornell box",
            vec3(-0.23, 0.99, 0.2),
            vec3(0.46, 0.0, 0.0),
            vec3(0.0, 0.0, -0.38),
            vec3(-0.99, 0.98, 0.5),
        ),
    ]
}

#[test]
fn rectangle_solid_angle_is_the_closed_form() {
    let cube_face = seen_rectangle(vec3(-1.0, -1.0, 1.0), 2.0 * Vec3::X, 2.0 * Vec3::Y, Vec3::ZERO).unwrap();
    assert_close(cube_face.solid_angle(), 4.0 * PI / 6.0, 1e-6, "cube face from the centre");
    for r in rectangles() {
        // The reference itself cancels: four terms of order 1.
        let expected = r.solid_angle([0.0, 1.0], [0.0, 1.0]);
        assert_close(r.seen().solid_angle(), expected, 2e-7 + 1e-15 / expected, r.name);
    }
}

#[test]
fn rectangle_solid_angle_has_no_cancellation_when_small() {
    for distance in [10.0_f32, 100.0, 1000.0] {
        // To first order the solid angle is A cos / d^2; the next term is (size / d)^2 of it.
        let p = distance * vec3(0.6, 0.0, 0.8);
        let size = 2e-4 * distance;
        let r = seen_rectangle(Vec3::ZERO, size * Vec3::X, size * Vec3::Y, p).unwrap();
        let to_middle = p.as_dvec3() - f64::from(size) * dvec3(0.5, 0.5, 0.0);
        let expected = f64::from(size).powi(2) * to_middle.z / to_middle.length().powi(3);
        assert_close(r.solid_angle(), expected, 2e-7, "small rectangle");
    }
}

#[test]
fn rectangle_samples_are_uniform_in_solid_angle() {
    type Part = [[f64; 2]; 2];
    let split = |[[s0, s1], [t0, t1]]: Part| {
        let (s, t) = (0.5 * (s0 + s1), 0.5 * (t0 + t1));
        [[[s0, s], [t0, t]], [[s, s1], [t0, t]], [[s0, s], [t, t1]], [[s, s1], [t, t1]]]
    };
    for r in rectangles() {
        let seen = r.seen();
        let whole = r.solid_angle([0.0, 1.0], [0.0, 1.0]);
        let mut expected = Vec::new();
        let cells = partition(
            [[0.0, 1.0], [0.0, 1.0]],
            0,
            &split,
            &|[s, t]: Part| r.solid_angle(s, t) / whole,
            &mut expected,
        );
        let mut counts = vec![0; expected.len()];
        for i in 0..SAMPLES {
            let st = seen.sample(uniform(i)).as_dvec2();
            let depth = |v: f64, [low, high]: [f64; 2]| (v - low).min(high - v);
            counts[locate(&cells, &|[s, t]: Part| depth(st.x, s).min(depth(st.y, t)))] += 1;
        }
        assert_chi_squared(&counts, &expected, r.name);
    }
}

#[test]
fn rectangle_samples_stay_on_it() {
    for r in rectangles() {
        let seen = r.seen();
        for u in rim() {
            let st = seen.sample(u);
            assert!(st.cmpge(Vec2::ZERO).all() && st.cmple(Vec2::ONE).all(), "{}: {u} gives {st}", r.name);
        }
        // Where the last 2^-24 of the solid angle is far out on the light, the last sample is short of its corner.
        let (first, last) = (seen.sample(Vec2::ZERO), seen.sample(Vec2::splat(ONE_MINUS_EPSILON)));
        assert!(first.max_element() < 1e-6 && last.min_element() > 0.9, "{}: from {first} to {last}", r.name);
    }
}

#[test]
fn rectangle_estimates_its_form_factor() {
    let normal = dvec3(0.1, -0.2, 1.0).normalize();
    for distance in [0.02, 0.3, 5.0] {
        let r = Rectangle {
            name: "above",
            corner: vec3(-0.7, -0.2, distance),
            ex: 1.1 * Vec3::X,
            ey: 0.9 * Vec3::Y,
            p: Vec3::ZERO,
        };
        // Tilt the receiver less than would push the far corner under the horizon.
        let normal = if distance < 0.1 { DVec3::Z } else { normal };
        let seen = r.seen();
        let sample = |u| {
            let st = seen.sample(u).as_dvec2();
            r.point(st.x, st.y)
        };
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(s, t)| r.point(s, t));
        assert_form_factor(sample, seen.solid_angle(), &corners, normal);
    }
}

#[test]
fn degenerate_rectangles_are_left_to_area_sampling() {
    let (x, y) = (Vec3::X, Vec3::Y);
    let refused = |what: &str, corner, ex, ey, p| {
        assert!(seen_rectangle(corner, ex, ey, p).is_none(), "{what}");
    };
    refused("in its plane", Vec3::ZERO, x, y, vec3(3.0, 4.0, 0.0));
    refused("on it", Vec3::ZERO, x, y, vec3(0.5, 0.5, 0.0));
    refused("all but on it", Vec3::ZERO, x, y, vec3(0.5, 0.5, 1e-6));
    refused("no width", Vec3::ZERO, Vec3::ZERO, y, Vec3::Z);
    refused("a point", Vec3::ZERO, Vec3::ZERO, Vec3::ZERO, Vec3::Z);
    refused("tiny", Vec3::ZERO, 1e-5 * x, 1e-5 * y, Vec3::Z);
    refused("p not finite", Vec3::ZERO, x, y, vec3(0.0, f32::INFINITY, 1.0));
    refused("p not a number", Vec3::ZERO, x, y, Vec3::NAN);
}
