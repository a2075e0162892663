//! Solid-angle sampling: densities against closed forms, samples against densities, and the extremes.
//!
//! Chi-squared tests compare with the solid angles of cells of the light, computed in f64 by a formula that the library
//! does not use for that shape. Each rejects a right sampler with a chance of 2.9e-7; there are fewer
//! than 100 of them, so all together raise a false alarm with a chance below 3e-5.
//!
//! Helpers are here, and the test that all shapes share.

mod rectangles;
mod spheres;
mod triangles;

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec2, Vec3, vec2, vec3};
use helmholtz::sampling::sampler::mix;
use helmholtz::sampling::spherical::{PlacedRectangle, SphereCone, SphericalRectangle, SphericalTriangle};

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

/// Directions that are uniform over a solid angle give a receiver with that normal the irradiance of a polygon.
fn assert_form_factor(sample: impl Fn(Vec2) -> DVec3, solid_angle: f32, corners: &[DVec3], normal: DVec3) {
    let mean = grid(256).map(|u| sample(u).normalize().dot(normal)).sum::<f64>() / 65536.0;
    assert_close(mean as f32 * solid_angle, lambert_irradiance(corners, normal), 1e-4, "irradiance");
}

/// Corners of the unit square, and points just inside it.
fn rim() -> impl Iterator<Item = Vec2> {
    let values = [0.0, f32::MIN_POSITIVE, 1e-7, 0.5, ONE_MINUS_EPSILON];
    values.into_iter().flat_map(move |x| values.map(|y| vec2(x, y)))
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
