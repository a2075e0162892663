//! The third opinion: where lines meet shapes, by brute force in f64. For tests, and for `ab`, which asks it who is wrong where
//! two backends disagree; far too slow for anything else.
//!
//! It shares nothing with the backends: no hierarchy, no f32, another triangle test (Moeller and Trumbore 1997, "Fast, minimum storage
//! ray/triangle intersection"). To f64 the coordinates of an f32 scene are exact, so that its answers are the truth to within 1e-14.
//!
//! What a backend may be blamed for is another question, since it computes in f32. [`Opinion`] answers it without
//! error analysis of anybody's arithmetic: a surface is *surely* met if every ray within rounding of the given one meets something
//! there, and can be met if it comes within rounding of the given one. So a ray through an edge within a closed mesh is sure to hit, whichever
//! triangle; one along a silhouette is not.

use glam::{DAffine3, DVec3};

use super::{Hit, Ray};
use crate::scene::{AnalyticKind, AnalyticShape, Geometry, Shape, TriangleMesh};

/// What rounding to f32 does to a test, relative to the largest distance within it: 2^-24 for each of a score of operations.
pub const TEST_ERROR: f64 = 1.2e-6;

/// A straight line `o + t d`, with a direction of any length but 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Origin.
    pub o: DVec3,
    /// Direction.
    pub d: DVec3,
}

impl From<&Ray> for Line {
    fn from(ray: &Ray) -> Self {
        Self { o: ray.o.as_dvec3(), d: ray.d.as_dvec3() }
    }
}

/// Where a line meets the surface of a primitive, or all but meets it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Crossing {
    /// Index of the shape.
    pub shape: u32,
    /// Index of the primitive, as in [`Hit`].
    pub primitive: u32,
    /// Distance along the line in units of its direction; may be negative.
    pub t: f64,
    /// |cosine| between line and normal, in the world or in the space of the instance's group, whichever is less.
    pub cosine: f64,
    /// How far from the primitive's border the line passes, across the line, in units of what rounding does to a test; positive inside. Outside the
    /// tip of a sliver it says less than the distance is.
    pub inside: f64,
    /// How far rounding moves the line in the world: the unit of `inside` there.
    pub error: f64,
    /// How far rounded barycentrics move the point within the primitive: more than `error` by the aspect of a sliver, whose short edge
    /// is rounded. 0 for analytic shapes.
    pub slide: f64,
    /// By what angle rounding tilts the primitive. 0 for analytic shapes.
    pub tilt: f64,
}

impl Crossing {
    /// How far off a distance may be that f32 gives.
    pub fn tolerance(&self) -> f64 {
        2.0 * self.error / self.cosine
    }

    /// Whether rounding leaves the angle between line and primitive more or less as it is.
    fn is_firm(&self) -> bool {
        self.cosine > 4.0 * self.tilt + TEST_ERROR
    }
}

/// Every crossing of a line with a primitive of the shapes, those included that pass it by less than `margin` (at least 0) of their own error. In
/// the order of the primitives.
pub fn crossings(shapes: &[Shape], line: &Line, margin: f64) -> Vec<Crossing> {
    let mut found = Vec::new();
    let mut keep = |crossing: Crossing| {
        if crossing.inside >= -margin {
            found.push(crossing);
        }
    };
    for (whole, shape) in shapes.iter().zip(0..) {
        let (parts, space) = Space::of(whole, line);
        let mut first = 0;
        for part in parts {
            match &part.geometry {
                Geometry::Mesh(mesh) => {
                    for triangle in 0..mesh.triangles().len() as u32 {
                        cross_triangle(mesh, triangle, &space, (shape, first + triangle), &mut keep);
                    }
                }
                Geometry::Analytic(surface) => cross_analytic(surface, &space, (shape, first), &mut keep),
                // Groups do not nest.
                Geometry::Instance(_) => {}
            }
            first += part.geometry.primitive_count();
        }
    }
    found
}

/// The nearest crossing with `t_min < t < t_max` whose border belongs to the primitive: what an exact closest-hit query answers.
pub fn nearest(shapes: &[Shape], ray: &Ray) -> Option<Crossing> {
    let (t_min, t_max) = (f64::from(ray.t_min), f64::from(ray.t_max));
    let is_hit = |c: &Crossing| c.inside >= 0.0 && t_min < c.t && c.t < t_max;
    let mut all = crossings(shapes, &ray.into(), 0.0);
    all.retain(is_hit);
    all.into_iter().min_by(|a, b| a.t.total_cmp(&b.t))
}

/// Both crossings of a sphere or cylinder, or the one of anything else, by the name of the primitive.
fn crossings_of(
    shapes: &[Shape],
    (shape, primitive): (u32, u32),
    line: &Line,
    keep: &mut impl FnMut(Crossing),
) {
    let Some(whole) = shapes.get(shape as usize) else { return };
    if primitive >= whole.geometry.primitive_count() {
        return;
    }
    let (_, space) = Space::of(whole, line);
    let (part, within) = whole.part(primitive);
    match &part.geometry {
        Geometry::Mesh(mesh) => cross_triangle(mesh, within, &space, (shape, primitive), keep),
        Geometry::Analytic(surface) => cross_analytic(surface, &space, (shape, primitive), keep),
        Geometry::Instance(_) => {}
    }
}

/// The space in which a shape's primitives are tested: the world's or a group's.
struct Space<'a> {
    line: Line,
    to_world: Option<&'a DAffine3>,
    /// How much rounding grows on its way to the world.
    growth: f64,
    /// Size of the coordinates that are rounded to take the ray there.
    offset: f64,
}

impl<'a> Space<'a> {
    /// What a shape is made of, and the line in its space.
    fn of(whole: &'a Shape, line: &Line) -> (&'a [Shape], Self) {
        let Geometry::Instance(instance) = &whole.geometry else {
            return (
                std::slice::from_ref(whole),
                Self { line: *line, to_world: None, growth: 1.0, offset: 0.0 },
            );
        };
        let map = instance.to_group();
        // The difference first, as in the map of rays.
        let o = map.matrix3 * (line.o - instance.to_world().translation);
        let line = Line { o, d: map.matrix3 * line.d };
        let to_world = instance.to_world();
        (
            instance.group().shapes(),
            Self { line, to_world: Some(to_world), growth: growth(to_world), offset: o.length() },
        )
    }

    /// |cosine| between the line and a primitive of this normal, here or in the world, whichever is less.
    fn cosine(&self, normal: DVec3) -> f64 {
        let Line { d, .. } = self.line;
        let here = normal.dot(d).abs() / (normal.length() * d.length());
        let Some(map) = self.to_world else { return here };
        let there = (map.matrix3.inverse().transpose() * normal, map.matrix3 * d);
        here.min(there.0.dot(there.1).abs() / (there.0.length() * there.1.length()))
    }
}

/// Greatest length of an axis' image.
fn growth(map: &DAffine3) -> f64 {
    let m = &map.matrix3;
    m.x_axis.length().max(m.y_axis.length()).max(m.z_axis.length())
}

#[inline]
fn cross_triangle(
    mesh: &TriangleMesh,
    triangle: u32,
    space: &Space,
    (shape, primitive): (u32, u32),
    keep: &mut impl FnMut(Crossing),
) {
    let Line { o, d } = space.line;
    let [a, b, c] = mesh.corners(triangle).map(|corner| corner.as_dvec3() - o);
    let (e1, e2) = (b - a, c - a);
    // Most triangles are farther from the line than their edges and any rounding reach. (x + y)^2 is at most 2 x^2 + 2 y^2.
    let reach = e1.length_squared().max(e2.length_squared());
    let rounding = a.length_squared() + reach + space.offset * space.offset;
    if a.cross(d).length_squared() > (2.0 * reach + 1e-9 * rounding) * d.length_squared() {
        return;
    }
    let h = d.cross(e2);
    let det = e1.dot(h);
    let n = e1.cross(e2);
    if det == 0.0 || n == DVec3::ZERO {
        return;
    }
    let q = e1.cross(a);
    let (u, v) = (-a.dot(h) / det, d.dot(q) / det);
    let longest = e1.length().max(e2.length()).max((c - b).length());
    let altitude = n.length() / longest;
    let cosine = space.cosine(n);
    let error = TEST_ERROR * (a.length().max(b.length()).max(c.length()) + space.offset);
    let steepness = n.dot(d).abs() / (n.length() * d.length());
    keep(Crossing {
        shape,
        primitive,
        t: e2.dot(q) / det,
        cosine,
        inside: u.min(v).min(1.0 - u - v) * altitude * steepness / error,
        error: error * space.growth,
        slide: error * space.growth * longest / altitude,
        tilt: error / altitude,
    });
}

fn cross_analytic(
    surface: &AnalyticShape,
    space: &Space,
    (shape, primitive): (u32, u32),
    keep: &mut impl FnMut(Crossing),
) {
    let unit = surface.to_object();
    let o = unit.matrix3 * (space.line.o - surface.to_world().translation);
    let d = unit.matrix3 * space.line.d;
    // Backends follow the line in f64, but the ray that brings them there and the distance are f32.
    let error = TEST_ERROR * (o.length() + 1.0);
    for (t, normal, inside) in unit_crossings(surface.kind(), o, d) {
        let steepness = normal.dot(d).abs() / (normal.length() * d.length());
        let cosine = space.cosine(unit.matrix3.transpose() * normal).min(steepness);
        let error_here = error * growth(surface.to_world()) * space.growth;
        let crossing = Crossing {
            shape,
            primitive,
            t,
            // Where it touches, the two crossings run together.
            cosine: cosine.max(error.sqrt()),
            inside: inside / error,
            error: error_here,
            slide: 0.0,
            tilt: 0.0,
        };
        if t.is_finite() {
            keep(crossing);
        }
    }
}

/// Distance, normal and how far inside, of each crossing of a line with a unit shape or the surface that it is cut from.
fn unit_crossings(kind: AnalyticKind, o: DVec3, d: DVec3) -> impl Iterator<Item = (f64, DVec3, f64)> {
    let round = |o: DVec3, d: DVec3| {
        let (a, b) = (d.length_squared(), o.dot(d));
        let pass2 = (o - d * (b / a)).length_squared();
        let half = (a * (1.0 - pass2).max(0.0)).sqrt();
        ([(-b - half) / a, (-b + half) / a], 1.0 - pass2.sqrt())
    };
    let two = match kind {
        AnalyticKind::Sphere => {
            let (ts, inside) = round(o, d);
            ts.map(|t| (t, o + d * t, inside))
        }
        AnalyticKind::Cylinder => {
            let (ts, inside) = round(o.with_z(0.0), d.with_z(0.0));
            ts.map(|t| {
                let p = o + d * t;
                let n = p.with_z(0.0);
                let cosine = n.dot(d).abs() / (n.length() * d.length());
                (t, n, inside.min(p.z.min(1.0 - p.z) * cosine))
            })
        }
        AnalyticKind::Disk => {
            let t = -o.z / d.z;
            let p = o + d * t;
            let inside = (1.0 - p.with_z(0.0).length()) * d.z.abs() / d.length();
            // Seen edge-on it is not met: the distance is not finite.
            [(t, DVec3::Z, inside), (f64::NAN, DVec3::Z, inside)]
        }
    };
    two.into_iter()
}

/// What is wrong with an answer to a ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Fault {
    /// Nothing was found, but there surely is a surface.
    Missed {
        /// Where, along the ray.
        at: f64,
    },
    /// There surely is a surface before the hit.
    Behind {
        /// Where, along the ray.
        at: f64,
    },
    /// The ray does not come near the primitive that was named, or the interval ends before it.
    NotMet,
    /// The primitive is met at another distance.
    Distance {
        /// The right one.
        at: f64,
    },
    /// Something was found to be in the way, but nothing is.
    Imagined,
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Missed { at } => write!(f, "misses the surface at {at}"),
            Self::Behind { at } => write!(f, "hits something behind the surface at {at}"),
            Self::NotMet => f.write_str("hits a primitive that the ray does not meet"),
            Self::Distance { at } => write!(f, "is wrong about the distance, which is {at}"),
            Self::Imagined => f.write_str("sees something where nothing is"),
        }
    }
}

/// Crossings that pass a primitive by no more than this many of their errors are candidates, since displaced rays may meet it.
const MARGIN: f64 = 4.0;

/// Axes and diagonals of the plane across a ray.
const DISPLACEMENTS: [[f64; 2]; 8] = {
    const H: f64 = std::f64::consts::FRAC_1_SQRT_2;
    [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0], [H, H], [H, -H], [-H, H], [-H, -H]]
};

/// What can be held about a ray: whether an answer is one that f32 may give.
pub struct Opinion<'s> {
    shapes: &'s [Shape],
    ray: Ray,
    candidates: Vec<Crossing>,
}

impl<'s> Opinion<'s> {
    /// Meets the ray with all primitives of all shapes.
    pub fn new(shapes: &'s [Shape], ray: &Ray) -> Self {
        Self { shapes, ray: *ray, candidates: crossings(shapes, &ray.into(), MARGIN) }
    }

    /// Meets the ray with these primitives only, given by shape and primitive.
    pub fn of_primitives(shapes: &'s [Shape], ray: &Ray, primitives: &[(u32, u32)]) -> Self {
        let mut candidates = Vec::new();
        for &primitive in primitives {
            crossings_of(shapes, primitive, &ray.into(), &mut |c| candidates.push(c));
        }
        candidates.retain(|c| c.inside >= -MARGIN);
        Self { shapes, ray: *ray, candidates }
    }

    /// Whether every ray within rounding of this one meets something within the interval and before `limit`; then where this one does.
    pub fn surely_met(&self, limit: f64) -> Option<f64> {
        let (first, last) = (f64::from(self.ray.t_min), limit.min(f64::from(self.ray.t_max)));
        let is_in = |c: &Crossing| c.is_firm() && c.t - c.tolerance() > first && c.t + c.tolerance() < last;
        let radius = self.candidates.iter().filter(|c| is_in(c)).map(|c| c.error).fold(0.0, f64::max);
        let nearest = |line: &Line| {
            let mut nearest = f64::INFINITY;
            let mut previous = None;
            for c in &self.candidates {
                // Both crossings of a sphere name the same primitive.
                if previous.replace((c.shape, c.primitive)) != Some((c.shape, c.primitive)) {
                    crossings_of(self.shapes, (c.shape, c.primitive), line, &mut |c| {
                        if c.inside >= 0.0 && is_in(&c) {
                            nearest = nearest.min(c.t);
                        }
                    });
                }
            }
            (nearest < f64::INFINITY).then_some(nearest)
        };
        let line = Line::from(&self.ray);
        let at = nearest(&line)?;
        let (x, y) = line.d.normalize().any_orthonormal_pair();
        let displaced = |[a, b]: [f64; 2]| Line { o: line.o + (x * a + y * b) * radius, ..line };
        DISPLACEMENTS.iter().all(|&by| nearest(&displaced(by)).is_some()).then_some(at)
    }

    /// The candidate that a hit names, at the distance nearest to the hit's.
    pub fn named(&self, hit: &Hit) -> Option<&Crossing> {
        let off = |c: &Crossing| (c.t - f64::from(hit.t)).abs();
        let own = self.candidates.iter().filter(|c| (c.shape, c.primitive) == (hit.shape, hit.primitive));
        own.filter(|c| c.inside >= -1.0 || !c.is_firm()).min_by(|a, b| off(a).total_cmp(&off(b)))
    }

    /// What is wrong with a hit by itself, whatever lies before it.
    pub fn judge_hit(&self, hit: &Hit) -> Option<Fault> {
        let Some(own) = self.named(hit) else { return Some(Fault::NotMet) };
        let (first, last) = (f64::from(self.ray.t_min), f64::from(self.ray.t_max));
        if own.t + own.tolerance() < first || own.t - own.tolerance() > last {
            return Some(Fault::NotMet);
        }
        let t = f64::from(hit.distance(self.shapes, &self.ray));
        let is_right = (own.t - t).abs() <= own.tolerance() || !own.is_firm();
        (!is_right).then_some(Fault::Distance { at: own.t })
    }

    /// What is wrong with the answer to a closest-hit query.
    pub fn judge_closest(&self, answer: Option<&Hit>) -> Option<Fault> {
        let Some(hit) = answer else {
            return self.surely_met(f64::INFINITY).map(|at| Fault::Missed { at });
        };
        let fault = self.judge_hit(hit);
        if fault == Some(Fault::NotMet) {
            return fault;
        }
        let own = self.named(hit)?;
        self.surely_met(own.t - own.tolerance()).map(|at| Fault::Behind { at }).or(fault)
    }

    /// What is wrong with the answer to an occlusion query.
    pub fn judge_occlusion(&self, occluded: bool) -> Option<Fault> {
        if !occluded {
            return self.surely_met(f64::INFINITY).map(|at| Fault::Missed { at });
        }
        let (first, last) = (f64::from(self.ray.t_min), f64::from(self.ray.t_max));
        let can_be = |c: &Crossing| {
            let is_met = c.inside >= -1.0 || !c.is_firm();
            is_met && c.t + c.tolerance() > first && c.t - c.tolerance() < last
        };
        (!self.candidates.iter().any(can_be)).then_some(Fault::Imagined)
    }
}
