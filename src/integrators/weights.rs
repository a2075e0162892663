//! The weight of each kind of strategy: where the sums that both subpaths carry ([`Heuristic`]) begin and end.
//!
//! All functions called `..._others` return the sum, over the strategies other than the one named, of their densities relative to its own, raised; the
//! weight is then `1 / (1 + sum)`. They are functions of an explicit path, and do not know how it came about.

use glam::Vec3;

use crate::query::Ray;
use crate::scene::SurfacePoint;
use crate::transport::World;
use crate::transport::camera::{CameraConnection, LensHit};
use crate::transport::lights::{LeSample, LiSample, LightId};
use crate::transport::mis::{Flight, Heuristic, Partials};
use crate::transport::vertex::{Evaluation, SurfaceVertex};

/// The strategies that exist, and how many samples each has.
#[derive(Clone, Copy)]
pub struct Weights<'a, 's> {
    /// Lights and camera.
    pub world: &'a World<'s>,
    /// How densities become weights.
    pub heuristic: Heuristic,
    /// Light paths of a pass: each strategy with `t` below 2 has that many samples for a pixel, the others have one.
    pub light_paths: f64,
    /// Whether there are strategies with `t` above 1.
    pub has_eye_paths: bool,
    /// Whether there are strategies with `t = 1`.
    pub connects_lens: bool,
    /// Whether there are strategies with `t = 0`; not for a pinhole.
    pub hits_lens: bool,
}

impl Weights<'_, '_> {
    /// The sums where a camera ray sets out.
    #[inline]
    pub fn leave_camera(&self, ray: &Ray) -> Flight {
        let (h, camera) = (self.heuristic, &self.world.camera);
        let pdf = f64::from(camera.pdf_we_w(ray.o, ray.d)) / self.light_paths;
        let d_vc = if self.hits_lens {
            let cos = f64::from(camera.forward().dot(ray.d));
            h.raise(cos * f64::from(camera.lens_area()) / pdf)
        } else {
            0.0
        };
        Flight { d_vcm: h.raise(1.0 / pdf), d_vc }
    }

    /// The sums at the first point that a light path reaches: a surface, or the lens itself. `cos` is the absolute cosine there.
    #[inline]
    pub fn first_light_vertex(&self, start: &LeSample, at: Vec3, cos: f32, is_lens: bool) -> Partials {
        let (h, lights) = (self.heuristic, &self.world.lights);
        // The lens connects to the start as the light path made it, a surface to a point sampled for itself.
        let pdf_li = match &start.point {
            Some(point) if is_lens => start.pdf_position * point.p.distance_squared(at) / start.cos,
            _ => lights.pdf_li_of_start(start, at),
        };
        let ng = start.point.map(|p| p.ng);
        let ratio = lights.le_over_li(start.light, ng, start.ray.d, at, pdf_li);
        let cos = f64::from(cos);
        let d_vc = if lights.is_delta(start.light) {
            0.0
        } else {
            let pdf_start = f64::from(start.pdf_position) * f64::from(start.pdf_direction_w);
            h.raise(f64::from(start.cos) / (pdf_start * cos))
        };
        Partials { d_vcm: h.raise(1.0 / (ratio * cos)), d_vc }
    }

    /// For strategy (0, t): an eye path whose end is at `point` of a light; the vertex before is at `from`, and is the lens if `is_first`.
    #[inline]
    pub fn light_hit_others(
        &self,
        end: &Partials,
        (light, point): (LightId, &SurfacePoint),
        wo: Vec3,
        from: Vec3,
        is_first: bool,
    ) -> f64 {
        let (h, lights) = (self.heuristic, &self.world.lights);
        let (pdf_position, pdf_direction_w) = lights.pdf_le(light, Some(point.ng), wo);
        let pdf_position = f64::from(pdf_position);
        // What is seen directly, strategy (1, 1) finds from the start of a light path.
        let pdf_connect = if is_first {
            pdf_position
        } else {
            let pdf_w = f64::from(lights.pdf_li(light, from, point, -wo));
            pdf_w * f64::from(point.ng.dot(wo).abs()) / f64::from(from.distance_squared(point.p))
        };
        h.raise(pdf_connect) * end.d_vcm + h.raise(pdf_position * f64::from(pdf_direction_w)) * end.d_vc
    }

    /// For strategy (0, t): an eye path that left the scene in direction `d`.
    #[inline]
    pub fn environment_hit_others(&self, flight: Flight, light: LightId, d: Vec3) -> f64 {
        let (h, lights) = (self.heuristic, &self.world.lights);
        let end = h.arrive(flight, 1.0, 1.0);
        let (pdf_position, pdf_direction_w) = lights.pdf_le(light, None, -d);
        h.raise(f64::from(lights.pdf_environment(d))) * end.d_vcm
            + h.raise(f64::from(pdf_position) * f64::from(pdf_direction_w)) * end.d_vc
    }

    /// For strategy (1, t): a light sampled for an eye vertex.
    #[inline]
    pub fn light_sampled_others(
        &self,
        (vertex, end): (&SurfaceVertex, &Partials),
        light: &LiSample,
        scattered: &Evaluation,
    ) -> f64 {
        let h = self.heuristic;
        let ratio =
            self.world.lights.le_over_li(light.light, light.ng, -light.wi, vertex.point.p, light.pdf_w);
        let eye = h.shorter(end, ratio * f64::from(vertex.cos(light.wi)), f64::from(scattered.pdf_rev_w));
        if light.is_delta { eye } else { eye + h.raise(f64::from(scattered.pdf_w) / f64::from(light.pdf_w)) }
    }

    /// For strategies with `s` and `t` of at least 2: an eye vertex and a light vertex, the latter seen in direction `d`.
    #[inline]
    pub fn connected_others(
        &self,
        (eye, eye_end, eye_side): (&SurfaceVertex, &Partials, &Evaluation),
        (light, light_end, light_side): (&SurfaceVertex, &Partials, &Evaluation),
        d: Vec3,
        distance_squared: f32,
    ) -> f64 {
        let h = self.heuristic;
        let pdf_area = |pdf_w: f32, cos: f32| f64::from(pdf_w) * f64::from(cos) / f64::from(distance_squared);
        h.shorter(light_end, pdf_area(eye_side.pdf_w, light.cos(d)), f64::from(light_side.pdf_rev_w))
            + h.shorter(eye_end, pdf_area(light_side.pdf_w, eye.cos(d)), f64::from(eye_side.pdf_rev_w))
    }

    /// For strategy (s, 1), `s` of at least 2: a lens point sampled for a light vertex.
    #[inline]
    pub fn lens_sampled_others(
        &self,
        (vertex, end): (&SurfaceVertex, &Partials),
        connection: &CameraConnection,
        scattered: &Evaluation,
    ) -> f64 {
        let distance_squared = connection.p.distance_squared(vertex.point.p);
        let mut others = self.hit_over_connect(connection, scattered.pdf_w, distance_squared);
        if self.has_eye_paths {
            let pdf = self.camera_pdf(connection, distance_squared) * f64::from(vertex.cos(connection.d));
            others += self.heuristic.shorter(end, pdf / self.light_paths, f64::from(scattered.pdf_rev_w));
        }
        others
    }

    /// For strategy (1, 1): the start of a light path, in whose direction from the lens the connection goes.
    #[inline]
    pub fn start_seen_others(&self, start: &LeSample, connection: &CameraConnection) -> f64 {
        let lights = &self.world.lights;
        let ng = start.point.map(|p| p.ng);
        let (pdf_position, pdf_direction_w) = lights.pdf_le(start.light, ng, -connection.d);
        let (hit, pdf_camera, pdf_start) = if let Some(point) = &start.point {
            let distance_squared = connection.p.distance_squared(point.p);
            let hit = self.hit_over_connect(connection, pdf_direction_w, distance_squared);
            let cos = f64::from(point.ng.dot(connection.d).abs());
            (hit, self.camera_pdf(connection, distance_squared) * cos, start.pdf_position)
        } else {
            let pdf_start = lights.pdf_li_of_start(start, connection.p);
            let pdf_disc = pdf_position * pdf_direction_w / pdf_start;
            let hit = self.hit_over_connect(connection, pdf_disc, 1.0);
            (hit, self.camera_pdf(connection, 1.0), pdf_start)
        };
        if self.has_eye_paths {
            hit + self.heuristic.raise(pdf_camera / (f64::from(pdf_start) * self.light_paths))
        } else {
            hit
        }
    }

    /// For strategy (s, 0): a light path that met the lens. `end` holds the sums there.
    #[inline]
    pub fn lens_hit_others(&self, end: &Partials, lens: &LensHit) -> f64 {
        let h = self.heuristic;
        let area = f64::from(self.world.camera.lens_area());
        let mut others = 0.0;
        if self.connects_lens {
            others += h.raise(1.0 / area) * end.d_vcm;
        }
        if self.has_eye_paths {
            // Of direction and lens point together: importance times cosine.
            let pdf = f64::from(lens.importance) * f64::from(lens.cos);
            others += h.raise(pdf / self.light_paths) * end.d_vc;
        }
        others
    }

    /// Density per area across the ray with which camera rays of one pixel meet what a lens point was connected to.
    #[inline]
    pub fn camera_pdf(&self, connection: &CameraConnection, distance_squared: f32) -> f64 {
        let area = f64::from(self.world.camera.lens_area());
        f64::from(connection.importance) * f64::from(connection.cos) * area / f64::from(distance_squared)
    }

    /// Density of strategy `t = 0` over that of `t = 1`, raised, for a path that leaves towards the lens with density `pdf_w`.
    #[inline]
    fn hit_over_connect(&self, connection: &CameraConnection, pdf_w: f32, distance_squared: f32) -> f64 {
        if !self.hits_lens {
            return 0.0;
        }
        let area = f64::from(self.world.camera.lens_area());
        let pdf = f64::from(pdf_w) * f64::from(connection.cos) / f64::from(distance_squared);
        self.heuristic.raise(pdf * area)
    }
}
