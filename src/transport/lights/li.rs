//! Light from a point's view: directions to lights, and their densities.

use glam::{Vec2, Vec3};

use super::area::{AreaPdf, point_on_analytic, sphere_cone, triangle_seen_from};
use super::{LeSample, Light, LightId, Lights};
use crate::query::Ray;
use crate::sampling::warp::square_to_triangle;
use crate::scene::{Rgb, SurfacePoint};

/// A direction towards a light, drawn for a point.
#[derive(Debug, Clone, Copy)]
pub struct LiSample {
    /// Which light.
    pub light: LightId,
    /// Unit direction to the light.
    pub wi: Vec3,
    /// Radiance arriving if nothing is between; for a point or spot light, intensity over squared distance;
    /// for a directional light, irradiance.
    pub radiance: Rgb,
    /// Density per solid angle, the choice of the light included; for a delta light the probability of that choice alone.
    pub pdf_w: f32,
    /// Whether no other technique can find this direction.
    pub is_delta: bool,
    /// Normal of the light where it was hit, if it is a surface.
    pub ng: Option<Vec3>,
    /// Tells by [`occluded`](crate::query::RayQuery::occluded) whether anything is between.
    pub shadow_ray: Ray,
}

impl Lights<'_> {
    /// Draws a direction from a surface point to a light: `choice` chooses the light, `uv` the place on it.
    /// `None` where the chosen light sends nothing this way.
    #[inline(always)]
    pub fn sample_li(&self, from: &SurfacePoint, choice: f64, uv: Vec2) -> Option<LiSample> {
        let (id, light, choice) = self.choose(choice)?;
        match light {
            Light::Point { position, intensity } => point_li(id, from, position, choice, |_| intensity),
            Light::Spot(spot) => {
                let spot = &self.spots[spot as usize];
                point_li(id, from, spot.position, choice, |d| spot.intensity(d))
            }
            Light::Directional { direction, irradiance } => {
                let wi = -direction;
                let shadow_ray = Ray::spawn(from, wi);
                Some(LiSample {
                    light: id,
                    wi,
                    radiance: irradiance,
                    pdf_w: choice,
                    is_delta: true,
                    ng: None,
                    shadow_ray,
                })
            }
            Light::Environment => {
                let (_, environment) = self.environment.as_ref()?;
                let wi = environment.sample(uv);
                let (radiance, pdf_w) = (environment.le(wi), choice * environment.pdf_w(wi));
                let shadow_ray = Ray::spawn(from, wi);
                (pdf_w > 0.0).then_some(LiSample {
                    light: id,
                    wi,
                    radiance,
                    pdf_w,
                    is_delta: false,
                    ng: None,
                    shadow_ray,
                })
            }
            Light::Triangle { .. } | Light::Rectangle(_) | Light::Analytic { .. } => {
                let (point, pdf) = self.sample_area_light(id, light, from.p, uv)?;
                let shadow_ray = Ray::spawn_between(from, &point)?;
                let wi = shadow_ray.d;
                let radiance = self.le(&point, -wi);
                let pdf_w = choice * pdf.per_solid_angle(from.p, &point, wi);
                (radiance != Rgb::ZERO && pdf_w > 0.0).then_some(LiSample {
                    light: id,
                    wi,
                    radiance,
                    pdf_w,
                    is_delta: false,
                    ng: Some(point.ng),
                    shadow_ray,
                })
            }
        }
    }

    #[inline(always)]
    fn sample_area_light(
        &self,
        id: LightId,
        light: Light,
        from: Vec3,
        u: Vec2,
    ) -> Option<(SurfacePoint, AreaPdf)> {
        let by_area = AreaPdf::Area(self.inverse_areas[id.0 as usize]);
        if let Light::Rectangle(r) = light {
            let rectangle = &self.rectangles[r as usize];
            if !rectangle.is_near(from) {
                return Some((rectangle.point(u), by_area));
            }
        }
        self.sample_near_or_curved(light, by_area, from, u)
    }

    /// What is worth a call: all but rectangles that are far.
    #[inline(never)]
    fn sample_near_or_curved(
        &self,
        light: Light,
        by_area: AreaPdf,
        from: Vec3,
        u: Vec2,
    ) -> Option<(SurfacePoint, AreaPdf)> {
        match light {
            Light::Triangle { shape, triangle } => {
                let mesh = self.mesh(shape)?;
                let (b, pdf) = match triangle_seen_from(mesh.corners(triangle), from) {
                    Some(spherical) => {
                        (spherical.sample(u), AreaPdf::SolidAngle(1.0 / spherical.solid_angle()))
                    }
                    None => (square_to_triangle(u), by_area),
                };
                Some((SurfacePoint::on_triangle(mesh, shape, triangle, b.x, b.y), pdf))
            }
            Light::Rectangle(r) => {
                let rectangle = &self.rectangles[r as usize];
                let (st, pdf) = match rectangle.seen_from(from) {
                    Some(spherical) => {
                        (spherical.sample(u), AreaPdf::SolidAngle(1.0 / spherical.solid_angle()))
                    }
                    None => (u, by_area),
                };
                Some((rectangle.point(st), pdf))
            }
            Light::Analytic { shape } => {
                let analytic = self.analytic(shape)?;
                if let Some(cone) = sphere_cone(analytic, from) {
                    let near = analytic.to_object().transform_vector3(cone.sample(u).as_dvec3());
                    let point = SurfacePoint::on_analytic(analytic, shape, near);
                    return Some((point, AreaPdf::SolidAngle(1.0 / cone.solid_angle())));
                }
                Some((point_on_analytic(analytic, shape, u), by_area))
            }
            Light::Point { .. } | Light::Spot(_) | Light::Directional { .. } | Light::Environment => None,
        }
    }

    /// Density per solid angle with which [`sample_li`](Self::sample_li) draws, for the point `from`, the emissive point `on`
    /// seen in direction `wi`; the choice of the light included.
    #[inline]
    pub fn pdf_li(&self, light: LightId, from: Vec3, on: &SurfacePoint, wi: Vec3) -> f32 {
        let choice = self.choice_pdf(light);
        let inverse_area = self.inverse_areas[light.0 as usize];
        let solid_angle = match self.all[light.0 as usize] {
            Light::Triangle { shape, triangle } => self
                .mesh(shape)
                .and_then(|mesh| triangle_seen_from(mesh.corners(triangle), from))
                .map(|spherical| spherical.solid_angle()),
            Light::Rectangle(r) => {
                let r = &self.rectangles[r as usize];
                r.seen_from(from).map(|spherical| spherical.solid_angle())
            }
            Light::Analytic { shape } => {
                self.analytic(shape).and_then(|a| sphere_cone(a, from)).map(|cone| cone.solid_angle())
            }
            Light::Point { .. } | Light::Spot(_) | Light::Directional { .. } | Light::Environment => {
                return 0.0;
            }
        };
        let pdf = match solid_angle {
            Some(solid_angle) => AreaPdf::SolidAngle(1.0 / solid_angle),
            None => AreaPdf::Area(inverse_area),
        };
        choice * pdf.per_solid_angle(from, on, wi)
    }

    /// Density per solid angle with which [`sample_li`](Self::sample_li) draws the direction `d` to the environment.
    #[inline]
    pub fn pdf_environment(&self, d: Vec3) -> f32 {
        self.environment
            .as_ref()
            .map_or(0.0, |(light, environment)| self.choice_pdf(*light) * environment.pdf_w(d))
    }

    /// Density per solid angle with which [`sample_li`](Self::sample_li) would have found, from the point `at`, the start of a light path
    /// that leads there; the probability of the light alone if it is a delta.
    #[inline]
    pub fn pdf_li_of_start(&self, start: &LeSample, at: Vec3) -> f32 {
        match (self.all[start.light.0 as usize], &start.point) {
            (Light::Point { .. } | Light::Spot(_) | Light::Directional { .. }, _) => {
                self.choice_pdf(start.light)
            }
            (Light::Environment, _) => self.pdf_environment(-start.ray.d),
            (_, Some(point)) => self.pdf_li(start.light, at, point, -start.ray.d),
            (_, None) => 0.0,
        }
    }
}

/// Light from a point of no size, with the `intensity` that it has in a direction away from it. `None` where that is none.
#[inline]
pub(super) fn point_li(
    light: LightId,
    from: &SurfacePoint,
    position: Vec3,
    choice: f32,
    intensity: impl Fn(Vec3) -> Rgb,
) -> Option<LiSample> {
    let shadow_ray = Ray::spawn_to_point(from, position)?;
    let to = position - from.p;
    let radiance = intensity(-shadow_ray.d) / to.length_squared();
    (radiance != Rgb::ZERO).then_some(LiSample {
        light,
        wi: shadow_ray.d,
        radiance,
        pdf_w: choice,
        is_delta: true,
        ng: None,
        shadow_ray,
    })
}
