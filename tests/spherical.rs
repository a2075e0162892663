//! Solid-angle sampling: densities against closed forms, samples against densities, and the extremes.
//!
//! Chi-squared tests compare with the solid angles of cells of the light, computed in f64 by a formula that the library
//! does not use for that shape. Each rejects a right sampler with a chance of 2.9e-7; there are fewer
//! than 100 of them, so all together raise a false alarm with a chance below 3e-5.

use glam::{DVec3, Vec2, Vec3, dvec3, vec2, vec3};
use helmholtz::sampling::sampler::mix;
use helmholtz::sampling::spherical::{PlacedRectangle, SphereCone, SphericalRectangle, SphericalTriangle};
use std::f64::consts::{PI, TAU};

use crate::statistics::chi_squared;

/// Largest f32 below 1.
const ONE_MINUS_EPSILON: f32 = 1.0 - f32::EPSILON / 2.0;

/// The rectangle `corner + s ex + t ey` seen from `p`.
fn seen_rectangle(corner: Vec3, ex: Vec3, ey: Vec3, p: Vec3) -> Option<SphericalRectangle> {
    SphericalRectangle::new(&PlacedRectangle::new(corner, ex, ey), p)
}

const SAMPLES: u64 = 40_000;

/// The i-th of a sequence of independent uniform points.
fn uniform(i: u64) -> Vec2 {
    let bits = mix(i.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ 0x5851_f42d_4c95_7f2d);
    vec2((bits >> 40) as f32, (bits & 0xff_ffff) as f32) / 16_777_216.0
}

fn assert_chi_squared(counts: &[u64], expected: &[f64], what: &str) {
    assert!(expected.iter().filter(|&&e| e >= 10.0).count() >= 16, "{what}: too few cells");
    let p = chi_squared(counts, expected);
    assert!(p > 2.9e-7, "{what}: p-value {p}");
}

fn assert_close(found: f32, expected: f64, relative: f64, what: &str) {
    let error = (f64::from(found) / expected - 1.0).abs();
    assert!(error < relative, "{what}: {found:e} instead of {expected:e}, relative error {error:e}");
}

/// Spherical excess by L'Huilier's theorem: from sides, where the library uses van Oosterom and Strackee's from corners.
fn solid_angle_lhuilier([a, b, c]: [DVec3; 3]) -> f64 {
    let angle = |a: DVec3, b: DVec3| {
        2.0 * (a.normalize() - b.normalize()).length().atan2((a.normalize() + b.normalize()).length())
    };
    let (x, y, z) = (angle(b, c), angle(c, a), angle(a, b));
    let s = 0.5 * (x + y + z);
    let product = (0.5 * s).tan() * (0.5 * (s - x)).tan() * (0.5 * (s - y)).tan() * (0.5 * (s - z)).tan();
    4.0 * product.max(0.0).sqrt().atan()
}

/// The formula of van Oosterom and Strackee 1983 in plain f64.
fn solid_angle_van_oosterom([a, b, c]: [DVec3; 3]) -> f64 {
    let (ra, rb, rc) = (a.length(), b.length(), c.length());
    let denominator = ra * rb * rc + a.dot(b) * rc + b.dot(c) * ra + c.dot(a) * rb;
    2.0 * a.dot((b - a).cross(c - a)).abs().atan2(denominator)
}

/// Cosine-weighted solid angle of a polygon above the horizon (Lambert 1760): the irradiance by unit radiance.
fn lambert_irradiance(corners: &[DVec3], normal: DVec3) -> f64 {
    let edges = (0..corners.len()).map(|i| {
        let (a, b) = (corners[i].normalize(), corners[(i + 1) % corners.len()].normalize());
        let cross = a.cross(b);
        cross.length().atan2(a.dot(b)) * cross.normalize().dot(normal)
    });
    0.5 * edges.sum::<f64>().abs()
}

/// Points of a regular grid in the middle of its cells. Of 256 x 256, the midpoint rule is wrong by less than 1e-4 for a cosine
/// over nearly a hemisphere.
fn grid(n: u32) -> impl Iterator<Item = Vec2> {
    (0..n * n).map(move |i| (vec2((i % n) as f32, (i / n) as f32) + 0.5) / n as f32)
}

/// Corners of the unit square, and points just inside it.
fn rim() -> impl Iterator<Item = Vec2> {
    let values = [0.0, f32::MIN_POSITIVE, 1e-7, 0.5, ONE_MINUS_EPSILON];
    values.into_iter().flat_map(move |x| values.map(|y| vec2(x, y)))
}

// ---- rectangles ----

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

/// A partition of a rectangle or triangle that splits a cell in four as long as it holds a 64th of the whole.
enum Cell<P> {
    Leaf(usize),
    Split(Box<[(P, Cell<P>); 4]>),
}

const LEAF_SHARE: f64 = 1.0 / 64.0;
const MAX_DEPTH: u32 = 24;

fn partition<P: Copy>(
    part: P,
    depth: u32,
    split: &impl Fn(P) -> [P; 4],
    share: &impl Fn(P) -> f64,
    leaves: &mut Vec<f64>,
) -> Cell<P> {
    let mass = share(part);
    if mass < LEAF_SHARE || depth == MAX_DEPTH {
        leaves.push(mass * SAMPLES as f64);
        return Cell::Leaf(leaves.len() - 1);
    }
    Cell::Split(Box::new(split(part).map(|child| (child, partition(child, depth + 1, split, share, leaves)))))
}

/// `depth_in` says how far a sample is inside a part; rounded samples may be a little outside of all.
fn locate<P: Copy>(cell: &Cell<P>, depth_in: &impl Fn(P) -> f64) -> usize {
    match cell {
        Cell::Leaf(index) => *index,
        Cell::Split(children) => {
            let deepest = (0..4).max_by(|&i, &j| depth_in(children[i].0).total_cmp(&depth_in(children[j].0)));
            locate(&children[deepest.unwrap_or(0)].1, depth_in)
        }
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
        let mean: f64 = grid(256)
            .map(|u| {
                let st = seen.sample(u).as_dvec2();
                r.point(st.x, st.y).normalize().dot(normal)
            })
            .sum::<f64>()
            / 65536.0;
        let corners = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)].map(|(s, t)| r.point(s, t));
        assert_close(
            mean as f32 * seen.solid_angle(),
            lambert_irradiance(&corners, normal),
            1e-4,
            "irradiance",
        );
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

// ---- triangles ----

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
        let mean: f64 = grid(256)
            .map(|u| {
                let b = seen.sample(u).as_dvec2();
                t.point([b.x, b.y]).normalize().dot(normal)
            })
            .sum::<f64>()
            / 65536.0;
        let corners = t.corners.map(Vec3::as_dvec3);
        assert_close(
            mean as f32 * seen.solid_angle(),
            lambert_irradiance(&corners, normal),
            1e-4,
            "irradiance",
        );
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

// ---- spheres ----

fn spheres() -> Vec<(&'static str, Vec3, f32, Vec3)> {
    vec![
        ("at 2 radii", Vec3::ZERO, 1.0, vec3(0.0, 0.0, 2.0)),
        ("oblique", vec3(1.0, 2.0, 3.0), 0.7, vec3(-1.0, 2.5, 2.0)),
        ("close", Vec3::ZERO, 1.0, vec3(0.6006, 0.8008, 0.0)),
        ("very close", Vec3::ZERO, 100.0, vec3(0.0, -100.01, 0.0)),
        ("planet", vec3(0.0, -6.4e6, 0.0), 6.4e6, vec3(0.0, 1000.0, 0.0)),
        ("far", Vec3::ZERO, 1.0, vec3(3e5, -4e5, 1e5)),
        ("speck", vec3(0.0, 0.0, 1e1), 1e-6, Vec3::ZERO),
        ("grain", vec3(1e-4, 0.0, 0.0), 1e-4, vec3(0.0, 3e-4, 0.0)),
    ]
}

/// The direction from p to the point with outward normal n, as (angle measure in [0, 1), azimuth in [0, 1)) within the cone.
fn in_cone((center, radius, p): (Vec3, f32, Vec3), n: Vec3) -> (f64, f64) {
    let to_center = center.as_dvec3() - p.as_dvec3();
    let (d2, r) = (to_center.length_squared(), f64::from(radius));
    let axis = to_center.normalize();
    let q = to_center + r * n.as_dvec3();
    let (tangent, bitangent) = axis.any_orthonormal_pair();
    let one_minus_cos = |sin2: f64, cos: f64| sin2 / (1.0 + cos);
    let (x, y, cos) = (q.dot(tangent) / q.length(), q.dot(bitangent) / q.length(), q.dot(axis) / q.length());
    let full = one_minus_cos(r * r / d2, ((d2 - r * r) / d2).sqrt());
    (one_minus_cos(x * x + y * y, cos) / full, y.atan2(x).rem_euclid(TAU) / TAU)
}

#[test]
fn sphere_solid_angle_is_the_closed_form() {
    for (name, center, radius, p) in spheres() {
        let d = (center.as_dvec3() - p.as_dvec3()).length();
        let half_angle = (f64::from(radius) / d).asin();
        // 1 - cos = 2 sin^2 of half the angle, an expression the library does not use.
        let expected = 4.0 * PI * (0.5 * half_angle).sin().powi(2);
        // Near the surface the angle is the arc sine of almost 1, which is ill-conditioned in f64 as well.
        assert_close(SphereCone::new(center, radius, p).unwrap().solid_angle(), expected, 5e-7, name);
    }
    let inside = SphereCone::new(Vec3::ZERO, 2.0, Vec3::ONE).unwrap();
    assert_close(inside.solid_angle(), 4.0 * PI, 1e-7, "inside");
}

#[test]
fn sphere_samples_are_uniform_in_the_cone() {
    const RINGS: usize = 8;
    for (name, center, radius, p) in spheres() {
        let cone = SphereCone::new(center, radius, p).unwrap();
        let mut counts = [0; RINGS * RINGS];
        for i in 0..SAMPLES {
            let n = cone.sample(uniform(i));
            assert!((n.length() - 1.0).abs() < 1e-6, "{name}: {n} is no unit vector");
            // The point must be on the side of p, or on the silhouette but for rounding.
            let facing = n.as_dvec3().dot(p.as_dvec3() - center.as_dvec3()) / f64::from(radius);
            assert!(facing > 1.0 - 1e-6, "{name}: {n} is not seen from p, {facing}");
            let (ring, sector) = in_cone((center, radius, p), n);
            assert!(ring < 1.0 + 1e-3, "{name}: {n} is outside the cone, {ring}");
            counts[((ring * RINGS as f64) as usize).min(RINGS - 1) * RINGS
                + (sector * RINGS as f64) as usize] += 1;
        }
        let expected = [SAMPLES as f64 / (RINGS * RINGS) as f64; RINGS * RINGS];
        assert_chi_squared(&counts, &expected, name);
    }
}

#[test]
fn sphere_samples_from_inside_are_uniform_directions() {
    const BANDS: usize = 8;
    for (name, center, radius, p) in [
        ("centre", Vec3::ZERO, 1.0, Vec3::ZERO),
        ("off centre", vec3(1.0, 2.0, 3.0), 4.0, vec3(2.0, 4.0, 1.0)),
        ("near the surface", Vec3::ZERO, 1e3, vec3(0.0, 999.9, 0.0)),
    ] {
        let seen = SphereCone::new(center, radius, p).unwrap();
        let mut counts = [0; BANDS * BANDS];
        for i in 0..SAMPLES {
            let n = seen.sample(uniform(i)).as_dvec3();
            let direction = (center.as_dvec3() + f64::from(radius) * n - p.as_dvec3()).normalize();
            let band = (0.5 * (direction.y + 1.0) * BANDS as f64) as usize;
            let sector = (direction.z.atan2(direction.x).rem_euclid(TAU) / TAU * BANDS as f64) as usize;
            counts[band.min(BANDS - 1) * BANDS + sector.min(BANDS - 1)] += 1;
        }
        assert_chi_squared(&counts, &[SAMPLES as f64 / (BANDS * BANDS) as f64; BANDS * BANDS], name);
    }
}

#[test]
fn sphere_estimates_its_form_factor() {
    for (name, center, radius, p) in spheres() {
        let cone = SphereCone::new(center, radius, p).unwrap();
        let to_center = center.as_dvec3() - p.as_dvec3();
        let axis = to_center.normalize();
        let mean: f64 = grid(128)
            .map(|u| {
                (to_center + f64::from(radius) * cone.sample(u).as_dvec3().normalize()).normalize().dot(axis)
            })
            .sum::<f64>()
            / 16384.0;
        // A surface that faces a sphere receives pi (r/d)^2 from unit radiance.
        let expected = PI * f64::from(radius).powi(2) / to_center.length_squared();
        assert_close((mean * f64::from(cone.solid_angle())) as f32, expected, 1e-5, name);
    }
}

#[test]
fn spheres_of_doubtful_side_are_left_to_area_sampling() {
    let refused =
        |what: &str, center, radius, p| assert!(SphereCone::new(center, radius, p).is_none(), "{what}");
    refused("on it", Vec3::ZERO, 1.0, Vec3::X);
    refused("an ulp outside", Vec3::ZERO, 1.0, vec3(1.0_f32.next_up(), 0.0, 0.0));
    refused("an ulp inside", Vec3::ZERO, 1.0, vec3(1.0_f32.next_down(), 0.0, 0.0));
    refused("smaller than the grid of floats around it", vec3(1e6, 0.0, 0.0), 1e-3, vec3(1e6, 0.0, 0.0));
    refused("no radius", Vec3::ZERO, 0.0, Vec3::X);
    refused("no number", Vec3::ZERO, f32::NAN, Vec3::X);
    refused("too far", Vec3::ZERO, 1e-10, vec3(1e8, 0.0, 0.0));
    refused("p not finite", Vec3::ZERO, 1.0, vec3(f32::INFINITY, 0.0, 0.0));
}

// ---- all ----

#[test]
fn nothing_is_ever_nan() {
    // Coordinates of every magnitude, with many ties and zeros among them.
    let extreme = |i: u64| {
        let bits = mix(i);
        let magnitude = 10_f32.powi((bits % 37) as i32 - 18);
        match bits >> 60 {
            0 => 0.0,
            1 => 1.0,
            2 => -1.0,
            k if k < 9 => magnitude * ((bits >> 32) & 7) as f32,
            _ => -magnitude,
        }
    };
    let point = |i: u64| vec3(extreme(3 * i), extreme(3 * i + 1), extreme(3 * i + 2));
    let mut built = [0; 3];
    for i in 0..200_000_u64 {
        let [a, b, c, p] = [0, 1, 2, 3].map(|k| point(4 * i + k));
        let u = uniform(i);
        // Perpendicular edges of any ratio, in an axis-aligned plane.
        let (ex, ey) = (vec3(b.x, 0.0, 0.0), vec3(0.0, c.y, 0.0));
        if let Some(r) = seen_rectangle(a, ex, ey, p) {
            let st = r.sample(u);
            assert!(
                r.solid_angle() > 0.0 && r.solid_angle() < TAU as f32 + 1e-6,
                "{a} {ex} {ey} {p}: {}",
                r.solid_angle()
            );
            assert!(st.cmpge(Vec2::ZERO).all() && st.cmple(Vec2::ONE).all(), "{a} {ex} {ey} {p} {u}: {st}");
            built[0] += 1;
        }
        if let Some(t) = SphericalTriangle::new([a, b, c], p) {
            let v = t.sample(u);
            assert!(
                t.solid_angle() > 0.0 && t.solid_angle() < TAU as f32 + 1e-6,
                "{a} {b} {c} {p}: {}",
                t.solid_angle()
            );
            assert!(v.x >= 0.0 && v.y >= 0.0 && v.x + v.y <= 1.0, "{a} {b} {c} {p} {u}: {v}");
            built[1] += 1;
        }
        if let Some(s) = SphereCone::new(a, b.x.abs(), p) {
            let n = s.sample(u);
            assert!(
                s.solid_angle() > 0.0 && s.solid_angle() <= 4.0 * PI as f32,
                "{a} {b} {p}: {}",
                s.solid_angle()
            );
            assert!((n.length() - 1.0).abs() < 1e-5, "{a} {} {p} {u}: {n}", b.x.abs());
            built[2] += 1;
        }
    }
    assert!(built.iter().all(|&n| n > 5000), "too few of the shapes were sampled: {built:?}");
}
