//! Paths from the light: how they start, walk, and reach the film. Shared by the forward and the bidirectional integrator.
//!
//! A light path with `s` vertices reaches the film by connecting its end to a point on the lens (strategy `t = 1`), or by hitting the lens
//! by chance (`t = 0`), which a pinhole does not allow. A point light or a directional one is not seen directly, neither way: it
//! would be a dot of no size.

use glam::{Vec2, Vec3};

use super::observer::{PathObserver, Strategy};
use super::parameters::PathLength;
use super::pass::{Pass, Scratch};
use crate::film::Splat;
use crate::query::{Hit, Ray, RayQuery};
use crate::sampling::Sampler;
use crate::scene::Rgb;
use crate::transport::bsdf::TransportMode;
use crate::transport::camera::CameraConnection;
use crate::transport::lights::LeSample;
use crate::transport::mis::{Flight, Heuristic, Partials};
use crate::transport::vertex::SurfaceVertex;
use crate::transport::walk::Walk;

/// A vertex of a light path that eye subpaths can be connected to.
#[derive(Debug, Clone, Copy)]
pub(super) struct LightVertex<'w> {
    pub(super) vertex: SurfaceVertex<'w>,
    /// Power that arrives over the density of the path.
    pub(super) beta: Rgb,
    pub(super) partials: Partials,
    /// Vertices of the light path up to this one.
    pub(super) s: u32,
}

/// Which light paths are made and what else could have made them.
#[derive(Debug, Clone, Copy)]
pub(super) struct LightPaths {
    /// How long they get.
    pub(super) length: PathLength,
    /// Connect to the lens.
    pub(super) connect: bool,
    /// Hit the lens.
    pub(super) hit: bool,
    /// Whether eye subpaths make paths too: then weights count them in, and vertices are kept for them.
    pub(super) with_eye_paths: bool,
    pub(super) heuristic: Heuristic,
}

/// Sets of the sampler: two for the start, then two for each vertex.
const POSITION_SET: u32 = 0;
const DIRECTION_SET: u32 = 1;
const SCATTER_SET: u32 = 0;
const LENS_SET: u32 = 1;
const SETS_PER_VERTEX: u32 = 2;

/// What is the same all along a light path.
struct Tracer<'a, 'w, 's, Q, O> {
    paths: LightPaths,
    pass: &'a Pass<'w, 's, Q>,
    start: LeSample,
    /// Over the number of light paths.
    power: Rgb,
    light_paths: f64,
    scratch: &'a mut Scratch<'w>,
    observer: &'a mut O,
}

impl LightPaths {
    /// Traces the light path of a slot. Its splats and, if there are eye paths, its vertices go to `scratch`.
    pub(super) fn trace<'w, Q: RayQuery, O: PathObserver>(
        self,
        pass: &Pass<'w, '_, Q>,
        slot: u64,
        scratch: &mut Scratch<'w>,
        observer: &mut O,
    ) {
        scratch.light_vertices.clear();
        let sampler = pass.light_sampler(slot);
        let [choice, x, y, _] = sampler.block(POSITION_SET);
        let [u, v, lens_u, lens_v] = sampler.block(DIRECTION_SET);
        let Some(start) = pass.world.lights.sample_le(choice, Vec2::new(x, y), Vec2::new(u, v)) else {
            return;
        };
        // One division at a time: the product of both densities may leave the range of f32 sooner.
        let power = start.radiance * (start.cos / start.pdf_direction_w) / start.pdf_position;
        let light_paths = pass.light_paths() as f64;
        let hit = self.hit && !pass.world.camera.is_delta();
        let paths = Self { hit, ..self };
        let mut tracer = Tracer { paths, pass, start, power, light_paths, scratch, observer };
        if paths.connect && self.length.limit() >= 1 {
            tracer.connect_start(Vec2::new(lens_u, lens_v));
        }
        tracer.walk(&sampler);
    }
}

impl<Q: RayQuery, O: PathObserver> Tracer<'_, '_, '_, Q, O> {
    /// The walk through the scene. `depth` segments lead to the vertex, which is the path's vertex `s = depth + 1`.
    fn walk(&mut self, sampler: &Sampler) {
        let h = self.paths.heuristic;
        let max_depth = self.paths.length.limit();
        // The last segment of a path is left to the connection, unless the lens can be hit.
        let last = if self.paths.hit { max_depth } else { max_depth.saturating_sub(1) };
        let mut walk = Walk::new(TransportMode::Importance, self.start.ray, Rgb::ONE);
        let mut flight = Flight::default();
        let mut from = self.start.ray.o;
        for depth in 1..=last {
            self.scratch.rays += 1;
            let hit = self.pass.query.intersect(&walk.ray);
            if self.paths.hit {
                self.hit_lens(&walk, hit, flight, depth);
            }
            let Some(hit) = hit else {
                self.observer.segment(walk.mode, depth, &walk.ray, None, walk.beta);
                break;
            };
            let vertex = SurfaceVertex::new(&self.pass.world.materials, &hit, &walk.ray);
            self.observer.segment(walk.mode, depth, &walk.ray, Some((&vertex, hit.t)), walk.beta);
            if depth == max_depth {
                break;
            }
            let cos_in = vertex.cos(vertex.wo);
            let partials = if depth == 1 {
                self.first_partials(vertex.point.p, cos_in, false)
            } else {
                h.arrive(flight, from.distance_squared(vertex.point.p), cos_in)
            };
            let beta = self.power * walk.beta;
            if !vertex.bsdf.is_delta() {
                let end = LightVertex { vertex, beta, partials, s: depth + 1 };
                if self.paths.connect {
                    self.connect(&end, sampler);
                }
                if self.paths.with_eye_paths {
                    self.scratch.light_vertices.push(end);
                }
            }
            if depth == last {
                break;
            }
            let [lobe, u, v, roulette] = sampler.block(SETS_PER_VERTEX * depth + SCATTER_SET);
            let Some(scatter) = walk.scatter(&vertex, [lobe, u, v]) else { break };
            if depth >= self.paths.length.rr_depth && !walk.survives(roulette) {
                break;
            }
            flight = h.leave(&partials, &vertex.turn(cos_in, &scatter, walk.mode));
            from = vertex.point.p;
        }
    }

    /// The sums at the first point that a light path reaches: a surface, or the lens.
    fn first_partials(&self, at: Vec3, cos: f32, is_lens: bool) -> Partials {
        let (h, start, lights) = (self.paths.heuristic, &self.start, &self.pass.world.lights);
        let ng = start.point.map(|p| p.ng);
        // The lens connects to the start as the light path made it, a surface to a point sampled for itself.
        let pdf_li = match &start.point {
            Some(point) if is_lens => start.pdf_position * point.p.distance_squared(at) / start.cos,
            _ => lights.pdf_li_of_start(start, at),
        };
        let ratio = lights.le_over_li(start.light, ng, start.ray.d, at, pdf_li);
        let d_vc = if lights.is_delta(start.light) {
            0.0
        } else {
            let pdf_start = f64::from(start.pdf_position) * f64::from(start.pdf_direction_w);
            h.raise(f64::from(start.cos) / pdf_start)
        };
        let cos = f64::from(cos);
        Partials { d_vcm: h.raise(1.0 / (ratio * cos)), d_vc: d_vc / h.raise(cos) }
    }

    /// Strategy (1, 1): the light's own point, seen from the lens.
    fn connect_start(&mut self, u: Vec2) {
        let (world, start) = (self.pass.world, self.start);
        if world.lights.is_delta(start.light) {
            return;
        }
        // Density of the start, per area or, in the environment, per solid angle; and all that turns one per area across into it.
        let (connection, shadow_ray, cos, distance_squared, pdf, radiance) = if let Some(point) = &start.point
        {
            let Some(connection) = world.camera.sample_wi(point.p, u) else { return };
            let Some(ray) = Ray::spawn_to_point(point, connection.p) else { return };
            let radiance = world.lights.le(point, -connection.d);
            let cos = point.ng.dot(connection.d).abs();
            let ray = connection.shorten(ray);
            (connection, ray, cos, connection.p.distance_squared(point.p), start.pdf_position, radiance)
        } else {
            let Some((connection, ray)) = world.camera.sample_distant(-start.ray.d, u) else { return };
            let pdf = world.lights.pdf_li_of_start(&start, connection.p);
            (connection, ray, 1.0, 1.0, pdf, start.radiance)
        };
        let pdf_camera = self.camera_pdf(&connection, distance_squared) * f64::from(cos);
        let value = radiance * (pdf_camera / f64::from(pdf) / self.light_paths) as f32;
        if value == Rgb::ZERO || !self.pass.is_sampled(connection.film) {
            return;
        }
        let (_, pdf_direction_w) = world.lights.pdf_le(start.light, start.point.map(|p| p.ng), -connection.d);
        let mut others = 0.0;
        if self.paths.with_eye_paths {
            others += self.paths.heuristic.raise(pdf_camera / (f64::from(pdf) * self.light_paths));
        }
        others += if start.point.is_some() {
            self.hit_over_connect(&connection, pdf_direction_w, distance_squared)
        } else {
            // Of the position on the disc that distant light comes through, times the cosine at the lens.
            let (pdf_position, pdf_direction_w) = world.lights.pdf_le(start.light, None, -connection.d);
            let pdf_disc = pdf_position * pdf_direction_w / pdf;
            self.hit_over_connect(&connection, pdf_disc, 1.0)
        };
        self.splat(Strategy { s: 1, t: 1 }, connection.film, value, others, Some(&shadow_ray));
    }

    /// Strategies (s, 1).
    fn connect(&mut self, end: &LightVertex, sampler: &Sampler) {
        let camera = &self.pass.world.camera;
        let u = if camera.is_delta() {
            Vec2::ZERO
        } else {
            let [u, v, ..] = sampler.block(SETS_PER_VERTEX * (end.s - 1) + LENS_SET);
            Vec2::new(u, v)
        };
        let point = &end.vertex.point;
        let Some(connection) = camera.sample_wi(point.p, u) else { return };
        if !self.pass.is_sampled(connection.film) {
            return;
        }
        let Some(scattered) = end.vertex.evaluate(-connection.d, TransportMode::Importance) else { return };
        let distance_squared = connection.p.distance_squared(point.p);
        let pdf_camera = self.camera_pdf(&connection, distance_squared);
        let value = end.beta * scattered.f * (pdf_camera / self.light_paths) as f32;
        let mut others = self.hit_over_connect(&connection, scattered.pdf_w, distance_squared);
        if self.paths.with_eye_paths {
            let pdf = pdf_camera * f64::from(end.vertex.cos(connection.d)) / self.light_paths;
            let pdf_rev_w = f64::from(scattered.pdf_rev_w);
            others += self.paths.heuristic.shorter(&end.partials, pdf, pdf_rev_w);
        }
        let Some(shadow_ray) = Ray::spawn_to_point(point, connection.p) else { return };
        let shadow_ray = connection.shorten(shadow_ray);
        self.splat(Strategy { s: end.s, t: 1 }, connection.film, value, others, Some(&shadow_ray));
    }

    /// Density per area across the ray with which camera rays of one pixel meet what the lens point was connected to.
    fn camera_pdf(&self, connection: &CameraConnection, distance_squared: f32) -> f64 {
        let lens = f64::from(self.pass.world.camera.lens_area());
        f64::from(connection.importance) * f64::from(connection.cos) * lens / f64::from(distance_squared)
    }

    /// Density of strategy `t = 0` over that of `t = 1`, raised, for a path that leaves towards the lens with density `pdf_w`.
    fn hit_over_connect(&self, connection: &CameraConnection, pdf_w: f32, distance_squared: f32) -> f64 {
        if !self.paths.hit {
            return 0.0;
        }
        let area = f64::from(self.pass.world.camera.lens_area());
        let pdf = f64::from(pdf_w) * f64::from(connection.cos) / f64::from(distance_squared);
        self.paths.heuristic.raise(pdf * area)
    }

    /// Strategies (s, 0).
    fn hit_lens(&mut self, walk: &Walk, hit: Option<Hit>, flight: Flight, depth: u32) {
        let world = self.pass.world;
        let is_first = depth == 1;
        if is_first && world.lights.is_delta(self.start.light) {
            return;
        }
        let is_near = !is_first || self.start.point.is_some();
        let t_surface = hit.map_or(f32::INFINITY, |h| h.t);
        let Some(lens) = world.camera.hit(&walk.ray, t_surface, is_near) else { return };
        if !self.pass.is_sampled(lens.film) {
            return;
        }
        let h = self.paths.heuristic;
        let partials = if is_first {
            self.first_partials(walk.ray.o + lens.t * walk.ray.d, lens.cos, true)
        } else {
            h.arrive(flight, lens.t * lens.t, lens.cos)
        };
        let pdf_lens = 1.0 / f64::from(world.camera.lens_area());
        let mut others = 0.0;
        if self.paths.connect {
            others += h.raise(pdf_lens) * partials.d_vcm;
        }
        if self.paths.with_eye_paths {
            let pdf_camera_w = f64::from(lens.importance * lens.cos) / pdf_lens;
            others += h.raise(pdf_lens * pdf_camera_w / self.light_paths) * partials.d_vc;
        }
        let value = self.power * walk.beta * (f64::from(lens.importance) / self.light_paths) as f32;
        self.splat(Strategy { s: depth + 1, t: 0 }, lens.film, value, others, None);
    }

    /// Adds a contribution unless its shadow ray is blocked. `others` is the sum over all other strategies relative to this one.
    fn splat(&mut self, strategy: Strategy, film: Vec2, value: Rgb, others: f64, shadow_ray: Option<&Ray>) {
        if let Some(ray) = shadow_ray {
            self.scratch.rays += 1;
            if self.pass.query.occluded(ray) {
                return;
            }
        }
        let weight = (1.0 / (1.0 + others)) as f32;
        self.observer.contribution(strategy, Some(film), value, weight);
        self.scratch.splats.push(Splat { position: film, radiance: value * weight });
    }
}
