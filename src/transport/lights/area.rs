//! What the techniques of area lights share: points on them by area, the measures of their densities, and the part of the sphere of
//! directions that they are seen under.

use std::f32::consts::PI;

use glam::{DVec3, Vec2, Vec3};

use super::{Light, Lights};
use crate::sampling::spherical::{SphereCone, SphericalTriangle};
use crate::sampling::warp::{square_to_disc, square_to_sphere, square_to_triangle};
use crate::scene::{AnalyticKind, AnalyticShape, SurfacePoint};

/// A flat light farther away than this many times its diameter is sampled by area: the density per solid angle then varies by
/// so little over it that the estimate hardly becomes noisier, and a sample is cheaper.
/// Figures are in `vendor-notes/measurements.md`.
pub(super) const FAR: f32 = 1.0;

impl Lights<'_> {
    /// A point on an area light, uniform by area.
    pub(super) fn sample_area_light_uniformly(&self, light: Light, u: Vec2) -> Option<SurfacePoint> {
        match light {
            Light::Triangle { shape, triangle } => {
                let b = square_to_triangle(u);
                Some(SurfacePoint::on_triangle(self.mesh(shape)?, shape, triangle, b.x, b.y))
            }
            Light::Rectangle(r) => {
                let rectangle = &self.rectangles[r as usize];
                Some(rectangle.point(u))
            }
            Light::Analytic { shape } => Some(point_on_analytic(self.analytic(shape)?, shape, u)),
            Light::Point { .. } | Light::Spot(_) | Light::Directional { .. } | Light::Environment => None,
        }
    }
}

/// The density of a point on an area light, in the measure it was drawn in.
#[derive(Debug, Clone, Copy)]
pub(super) enum AreaPdf {
    Area(f32),
    SolidAngle(f32),
}

impl AreaPdf {
    #[inline]
    pub(super) fn per_solid_angle(self, from: Vec3, on: &SurfacePoint, wi: Vec3) -> f32 {
        match self {
            Self::SolidAngle(pdf) => pdf,
            Self::Area(pdf) => {
                let (cos, distance) = (on.ng.dot(wi).abs(), from.distance(on.p));
                // Grouped so that a tiny area times a huge squared distance stays in range.
                if cos > 0.0 { pdf * distance * distance / cos } else { 0.0 }
            }
        }
    }
}

/// The triangle as a part of the sphere of directions; `None` where it is to be sampled by area.
#[inline]
pub(super) fn triangle_seen_from(corners: [Vec3; 3], p: Vec3) -> Option<SphericalTriangle> {
    let [a, b, c] = corners;
    let diameter_squared = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    let is_near = a.distance_squared(p) < FAR * FAR * diameter_squared;
    is_near.then(|| SphericalTriangle::new(corners, p)).flatten()
}

/// The directions to a sphere.
#[inline]
pub(super) fn sphere_cone(analytic: &AnalyticShape, from: Vec3) -> Option<SphereCone> {
    if analytic.kind() != AnalyticKind::Sphere {
        return None;
    }
    let radius = analytic.to_world().matrix3.x_axis.length();
    SphereCone::new(analytic.to_world().translation.as_vec3(), radius as f32, from)
}

/// Uniform by area.
pub(super) fn point_on_analytic(analytic: &AnalyticShape, shape: u32, u: Vec2) -> SurfacePoint {
    let near: DVec3 = match analytic.kind() {
        AnalyticKind::Sphere => square_to_sphere(u).as_dvec3(),
        AnalyticKind::Disk => square_to_disc(u).extend(0.0).as_dvec3(),
        AnalyticKind::Cylinder => {
            let (sin, cos) = (2.0 * PI * u.x).sin_cos();
            Vec3::new(cos, sin, u.y).as_dvec3()
        }
    };
    SurfacePoint::on_analytic(analytic, shape, near)
}
