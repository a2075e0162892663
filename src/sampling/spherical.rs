//! Area lights seen from a point: uniform sampling of the solid angle of a rectangle, a triangle or a sphere.
//!
//! A direction drawn uniformly from the solid angle that a light subtends has the constant density 1 / solid angle, so
//! that the estimate of direct light keeps only what BSDF, cosine and visibility do to it. A point drawn uniformly by
//! area has the density d^2 / (A cos), which varies without bound where a light is near or grazing.
//!
//! Each shape is built from the light and the point that it is seen from, and the outcome (`None` included) is a function of
//! these alone. So a direction that was found otherwise, by a BSDF say, has the density `1 / solid_angle()` of the same
//! shape built again, wherever it meets the light. `None` means: sample by area. It is returned for what
//! has no extent, for what is not finite, and for the extremes at which rounding would bend the density:
//! - p in the plane of a rectangle or triangle, or so near it or so far out that fewer than 24 bits of the
//!   solid angle would be right;
//! - p so near a rectangle or triangle, 2^-16 of its size or less, that rounding the result to f32 would turn the
//!   direction by more than a few thousandths;
//! - p on a sphere, to within the rounding of its coordinates.
//!
//! The light's plane divides what it lights from what it does not; solid angles here are the same from both sides.

use glam::{DVec2, DVec3, Vec2, Vec3};
use std::f32::consts::{PI, TAU};

use super::warp::square_to_sphere;

/// Nearer than this, relative to the size of the light, a rectangle or triangle is sampled by area: a coordinate on the light is
/// rounded to 2^-24 of its size, which seen from this near is an angle of 2^-8.
const MIN_RELATIVE_DISTANCE: f64 = 1.0 / 65536.0;

/// The least solid angle, sr, of a triangle or sphere that is sampled: the square of its reciprocal, which the power heuristic
/// needs, is still within f32.
const MIN_SOLID_ANGLE: f32 = 1e-15;

/// A rectangle in the world: what [`SphericalRectangle`] needs of it that does not depend on the point it is seen from.
#[derive(Debug, Clone, Copy)]
pub struct PlacedRectangle {
    corner: DVec3,
    /// Unit vectors along the edges, and their cross product.
    axes: [DVec3; 3],
    /// Lengths of the edges.
    size: [f64; 2],
}

impl PlacedRectangle {
    /// The rectangle of the points `corner + s ex + t ey`, 0 <= s, t <= 1. The edges `ex` and `ey` must be
    /// perpendicular to within rounding.
    pub fn new(corner: Vec3, ex: Vec3, ey: Vec3) -> Self {
        let (ex, ey) = (ex.as_dvec3(), ey.as_dvec3());
        let size = [ex.length(), ey.length()];
        let (axis_x, axis_y) = (ex / size[0], ey / size[1]);
        Self { corner: corner.as_dvec3(), axes: [axis_x, axis_y, axis_x.cross(axis_y)], size }
    }
}

/// A rectangle seen from a point, as a part of the sphere of directions
/// (Ureña, Fajardo, King 2013, "An area-preserving parametrization for spherical rectangles").
///
/// It is computed in f64. The map's closed form takes differences of angles that are only as large as the solid angle.
#[derive(Debug, Clone, Copy)]
pub struct SphericalRectangle {
    /// Extent in the frame of the rectangle around p; its plane is at distance `z` > 0.
    x: [f64; 2],
    y: [f64; 2],
    z: f64,
    solid_angle: f64,
    /// Cosine and sine of the sum of the two interior angles at x[0].
    left_angles: [f64; 2],
    /// sqrt(y[0]^2 + z^2): how far the line through the lower edge passes from p.
    lower_distance: f64,
    /// z components of the unit normals of the planes through p and the lower and the upper edge.
    edge_normals_z: [f64; 2],
}

impl SphericalRectangle {
    /// The least solid angle, sr, that is sampled. Rounding moves a sample by about 2^-53 / solid angle of the rectangle's
    /// width, times 4 for the operations involved; it stays below the 2^-24 of an f32 result.
    const MIN_SOLID_ANGLE: f64 = 4.0 / (1 << 29) as f64;

    /// The rectangle seen from `p`. `None` where it has to be sampled by area.
    #[inline]
    pub fn new(rectangle: &PlacedRectangle, p: Vec3) -> Option<Self> {
        let PlacedRectangle { corner, axes: [axis_x, axis_y, normal], size: [width, height] } = *rectangle;
        let to_corner = corner - p.as_dvec3();
        let x0 = to_corner.dot(axis_x);
        let y0 = to_corner.dot(axis_y);
        let z = to_corner.dot(normal).abs();
        let (x, y) = ([x0, x0 + width], [y0, y0 + height]);

        let outside = |[low, high]: [f64; 2]| low.max(-high).max(0.0);
        let distance_squared = outside(x).powi(2) + outside(y).powi(2) + z * z;
        let nearest = MIN_RELATIVE_DISTANCE * width.max(height);
        // Written so that NaN fails.
        if !(z > 0.0 && distance_squared > nearest * nearest) {
            return None;
        }

        let corner_distance = |x: f64, y: f64| (x * x + y * y + z * z).sqrt();
        let r00 = corner_distance(x[0], y[0]);
        let r10 = corner_distance(x[1], y[0]);
        let r01 = corner_distance(x[0], y[1]);
        let r11 = corner_distance(x[1], y[1]);

        // Two triangles after van Oosterom and Strackee 1983: half their solid angles are the arguments of
        // diagonal_k + i * volume, so their sum is that of the product. Nothing cancels when the rectangle is small.
        let volume = z * width * height;
        let dot = |i: usize, j: usize, k: usize, l: usize| x[i] * x[k] + y[j] * y[l] + z * z;
        let diagonal = r00 * r11 + dot(0, 0, 1, 1);
        let right = r10 * diagonal + dot(0, 0, 1, 0) * r11 + dot(1, 0, 1, 1) * r00;
        let left = r01 * diagonal + dot(0, 0, 0, 1) * r11 + dot(0, 1, 1, 1) * r00;
        let solid_angle = 2.0 * (volume * (right + left)).atan2(right * left - volume * volume);
        if !(solid_angle >= Self::MIN_SOLID_ANGLE && solid_angle.is_finite()) {
            return None;
        }

        let lower_distance = (y[0] * y[0] + z * z).sqrt();
        let upper_distance = (y[1] * y[1] + z * z).sqrt();
        // Products of the cosines and sines of the two interior angles, which the paper calls g2 and g3.
        let scale = 1.0 / ((x[0] * x[0] + z * z) * lower_distance * upper_distance);
        let cos = -(x[0] * x[0] * y[0] * y[1] + z * z * r00 * r01) * scale;
        let sin = z * x[0] * (y[1] * r00 - y[0] * r01) * scale;
        Some(Self {
            x,
            y,
            z,
            solid_angle,
            left_angles: [cos, sin],
            lower_distance,
            edge_normals_z: [-y[0] / lower_distance, y[1] / upper_distance],
        })
    }

    /// Solid angle in steradians, in (0, 2 pi). The density of [`sample`](Self::sample) is its reciprocal.
    #[inline]
    pub fn solid_angle(&self) -> f32 {
        self.solid_angle as f32
    }

    /// Coordinates (s, t) in [0, 1]^2 on the rectangle, such that directions are uniform over its solid angle. `u` in [0, 1)^2.
    #[inline]
    pub fn sample(&self, u: Vec2) -> Vec2 {
        // The width at which the part to the left holds a share u.x of the solid angle: the paper's a_u, c_u and x_u.
        let [cos_left, sin_left] = self.left_angles;
        let (sin_part, cos_part) = (f64::from(u.x) * self.solid_angle).sin_cos();
        let cos = cos_part * cos_left + sin_part * sin_left;
        let sin = sin_part * cos_left - cos_part * sin_left;
        let [lower, upper] = self.edge_normals_z;
        // Sine of the angle along the lower edge, from the foot of its perpendicular.
        let q = self.z * sin / (self.lower_distance * (lower * cos - upper));
        let x = clamped(self.lower_distance * q / (1.0 - q * q).max(0.0).sqrt(), self.x);

        // On the line at x, equal solid angles are equal steps of the sine of the elevation.
        let d_squared = x * x + self.z * self.z;
        let [low, high] = self.y.map(|y| y / (d_squared + y * y).sqrt());
        let elevation = low + f64::from(u.y) * (high - low);
        let y = clamped(elevation * (d_squared / (1.0 - elevation * elevation).max(0.0)).sqrt(), self.y);

        let share = |v: f64, [low, high]: [f64; 2]| ((v - low) / (high - low)) as f32;
        Vec2::new(share(x, self.x), share(y, self.y))
    }
}

/// `v` moved into the range; NaN, which 0/0 at the very rim may give, becomes its lower end.
#[inline]
fn clamped(v: f64, [low, high]: [f64; 2]) -> f64 {
    v.max(low).min(high)
}

/// A triangle seen from a point, as a part of the sphere of directions.
///
/// The map is Arvo's (1995, "Stratified sampling of spherical triangles") in half angles, as Peters (2021, "BRDF importance
/// sampling for polygonal lights") has it: no difference of angles is taken, so it is as good for a speck as for
/// half of the sphere. Angles are f32. Their errors turn samples by some 1e-7; the algebra is in f64, because near
/// the triangle's plane arcs come close to pi, where 1 + cosine cancels.
#[derive(Debug, Clone, Copy)]
pub struct SphericalTriangle {
    /// Reciprocal distances of the corners from p.
    nearness: [f64; 3],
    /// Cosines of the angles between the directions of two corners.
    cos_01: f64,
    cos_12: f64,
    cos_02: f64,
    /// Half the solid angle, and the length of the vector (denominator, numerator) whose angle it is.
    half_solid_angle: f32,
    norm: f64,
}

impl SphericalTriangle {
    /// A triangle whose triple product is less than this share of the product of its factors' lengths is sampled by area:
    /// the rounding of f64, some 2^-52 of that product, would show in f32.
    const MIN_RELATIVE_VOLUME: f64 = 1.0 / (1 << 28) as f64;
    /// 1 + cosine of the angle that an edge subtends from 2^-16 of its length above its middle, 2 (2 * 2^-16)^2.
    const MIN_ONE_PLUS_COS: f64 = 8.0 * MIN_RELATIVE_DISTANCE * MIN_RELATIVE_DISTANCE;
    /// How much less than half of the sphere may be left. From a height h above an equilateral triangle with edges L,
    /// 2 pi less the solid angle is about 18 h / L at the least.
    const MIN_REST: f64 = 18.0 * MIN_RELATIVE_DISTANCE;

    /// The triangle seen from `p`; `None` where it has to be sampled by area.
    #[inline]
    pub fn new(corners: [Vec3; 3], p: Vec3) -> Option<Self> {
        let [a, b, c] = corners.map(Vec3::as_dvec3);
        let to_corners = [a, b, c].map(|q| q - p.as_dvec3());
        let (e1, e2) = (b - a, c - a);
        // Edges are exact as to the input, and so is this product to within f64: directions would cancel in it.
        let volume = to_corners[0].dot(e1.cross(e2)).abs();
        let factors = e1.length_squared() * e2.length_squared() * to_corners[0].length_squared();
        // False for NaN as well.
        let enough = volume * volume > Self::MIN_RELATIVE_VOLUME * Self::MIN_RELATIVE_VOLUME * factors;
        if !enough {
            return None;
        }
        let inverse = to_corners.map(|q| 1.0 / q.length());
        let [d0, d1, d2] = [0, 1, 2].map(|i: usize| -> DVec3 { to_corners[i] * inverse[i] });
        let (cos_01, cos_12, cos_02) = (d0.dot(d1), d1.dot(d2), d0.dot(d2));
        // tan(solid angle / 2) after van Oosterom and Strackee 1983, "The solid angle of a plane triangle".
        let numerator = volume * inverse[0] * inverse[1] * inverse[2];
        let denominator = 1.0 + cos_01 + cos_12 + cos_02;
        let half_solid_angle = (numerator as f32).atan2(denominator as f32);
        let near_edge = cos_01.min(cos_12).min(cos_02) < Self::MIN_ONE_PLUS_COS - 1.0;
        let near_face = denominator < 0.0 && numerator < -0.5 * Self::MIN_REST * denominator;
        if near_edge || near_face || 2.0 * half_solid_angle < MIN_SOLID_ANGLE {
            return None;
        }
        Some(Self {
            nearness: inverse,
            cos_01,
            cos_12,
            cos_02,
            half_solid_angle,
            norm: (numerator * numerator + denominator * denominator).sqrt(),
        })
    }

    /// Solid angle in steradians, in (0, 2 pi). The density of [`sample`](Self::sample) is its reciprocal.
    #[inline]
    pub fn solid_angle(&self) -> f32 {
        2.0 * self.half_solid_angle
    }

    /// Barycentric coordinates of the second and third corner, such that directions are uniform over the solid angle.
    /// `u` in [0, 1)^2.
    #[inline]
    pub fn sample(&self, u: Vec2) -> Vec2 {
        // The direction e on the edge from d0 to d2 for which (d0, d1, e) holds a share u.x of the solid angle. Let
        // h = (y + z) d0 + y d2 be the bisector of d0 and e. Then the tangent of half the partial solid angle is
        // det(d0, d1, h) / ((d0 + d1) . h), linear in y and z; with det(d0, d1, d2) and the denominator
        // written as norm times sine and cosine of half the full angle, y and z become sines.
        let y = (1.0 + self.cos_01) * f64::from((u.x * self.half_solid_angle).sin());
        let z = self.norm * f64::from(((1.0 - u.x) * self.half_solid_angle).sin());
        // e is d0 mirrored at h: e = (e0 d0 + e2 d2) / |h|^2.
        let e0 = z * (z + 2.0 * y);
        let e2 = 2.0 * y * (z + y * (1.0 + self.cos_02));
        let h_squared = z * z + 2.0 * y * (y + z) * (1.0 + self.cos_02);

        // On the arc from d1 to e, equal solid angles are equal steps of the cosine of the angle from d1.
        let cos = ((e0 * self.cos_01 + e2 * self.cos_12) / h_squared).clamp(-1.0, 1.0);
        let part = f64::from(u.y) * (1.0 - cos);
        let towards_e = (f64::from(u.y) * (2.0 - part) / (1.0 + cos)).sqrt();
        let towards_1 = (1.0 - part - cos * towards_e).max(0.0);

        // A weight on a corner's direction is, divided by its distance, a weight on the corner.
        let weights =
            DVec3::from(self.nearness) * DVec3::new(towards_e * e0, towards_1 * h_squared, towards_e * e2);
        let v = (DVec2::new(weights.y, weights.z) / weights.element_sum()).as_vec2();
        // The two may round to a sum above 1.
        Vec2::new(v.x, v.y.min(1.0 - v.x))
    }
}

/// A sphere seen from a point: the cone of directions that meet it, or all directions from inside.
///
/// From outside the point nearest to p on each line is sampled. Accurate from any distance:
/// 1 - cos and all lengths are computed from sin^2 = (r/d)^2 and cos^2 = (d^2 - r^2) / d^2 without cancellation.
#[derive(Debug, Clone, Copy)]
pub enum SphereCone {
    /// p is outside.
    Outside {
        /// Unit vector from the centre to p.
        axis: Vec3,
        /// Sine of the cone's half angle.
        sin_max: f32,
        /// Square of its cosine.
        cos2_max: f32,
        /// One less its cosine.
        one_minus_cos_max: f32,
    },
    /// p is inside.
    Inside {
        /// From the centre to p, in radii.
        offset: Vec3,
        /// One less the square of its length.
        rest: f32,
    },
}

impl SphereCone {
    /// The sphere seen from `p`; `None` where it has to be sampled by area: if it has no radius or is farther than
    /// some 10^7 radii, or if `p` is on it but for rounding, so that it is not certain which side p is on.
    #[inline]
    pub fn new(center: Vec3, radius: f32, p: Vec3) -> Option<Self> {
        let offset = p.as_dvec3() - center.as_dvec3();
        let r = f64::from(radius);
        let d2 = offset.length_squared();
        let rest = d2 - r * r;
        // Both p and the centre are known to half an ulp, and p has been moved along its normal by a few.
        let rounding =
            8.0 * f64::from(f32::EPSILON) * f64::from(p.abs().max(center.abs()).max_element() + radius);
        let band = rounding * (2.0 * r + rounding);
        // Written so that NaN fails.
        if !(rest.abs() > band && radius > 0.0 && d2 < f64::INFINITY) {
            return None;
        }
        if rest < 0.0 {
            return Some(Self::Inside { offset: (offset / r).as_vec3(), rest: (-rest / (r * r)) as f32 });
        }
        let sin2 = r * r / d2;
        let cos2 = rest / d2;
        let one_minus_cos_max = (sin2 / (1.0 + cos2.sqrt())) as f32;
        if TAU * one_minus_cos_max < MIN_SOLID_ANGLE {
            return None;
        }
        Some(Self::Outside {
            axis: (offset / d2.sqrt()).as_vec3(),
            sin_max: sin2.sqrt() as f32,
            cos2_max: cos2 as f32,
            one_minus_cos_max,
        })
    }

    /// Solid angle in steradians, in (0, 2 pi) from outside and 4 pi from inside. The density of [`sample`](Self::sample) is its reciprocal.
    #[inline]
    pub fn solid_angle(&self) -> f32 {
        match self {
            Self::Outside { one_minus_cos_max, .. } => TAU * one_minus_cos_max,
            Self::Inside { .. } => 4.0 * PI,
        }
    }

    /// The outward normal `n` of the sampled point `center + radius n`, such that directions from p are uniform over the
    /// solid angle. `u` in [0, 1)^2. `n` has unit length in f32; very near the sphere, normalise it in f64 before use.
    #[inline]
    pub fn sample(&self, u: Vec2) -> Vec3 {
        match *self {
            Self::Outside { axis, sin_max, cos2_max, one_minus_cos_max } => {
                let one_minus_cos = u.x * one_minus_cos_max;
                let cos = 1.0 - one_minus_cos;
                // Sine and cosine of the angle of incidence: sin / sin_max and the rest of it, both written in products.
                let full = 2.0 - one_minus_cos_max;
                let sin_incidence = (u.x * (2.0 - one_minus_cos) / full).sqrt();
                let cos_incidence = ((1.0 - u.x) * (full - one_minus_cos) / full).max(0.0).sqrt();
                // The angle at the centre is that of incidence less that at p; its sine, a difference, times its conjugate.
                let sin_center = sin_incidence * cos2_max / (cos + sin_max * cos_incidence);
                let cos_center = cos * cos_incidence + sin_max * sin_incidence * sin_incidence;
                let (sin_phi, cos_phi) = (TAU * u.y).sin_cos();
                let (tangent, bitangent) = axis.any_orthonormal_pair();
                sin_center * (cos_phi * tangent + sin_phi * bitangent) + cos_center * axis
            }
            Self::Inside { offset, rest } => {
                let direction = square_to_sphere(u);
                let along = offset.dot(direction);
                let root = (along * along + rest).sqrt();
                // The positive root of t^2 + 2 t along - rest = 0, whichever way does not cancel.
                let t = if along > 0.0 { rest / (along + root) } else { root - along };
                (offset + t * direction).normalize()
            }
        }
    }
}
