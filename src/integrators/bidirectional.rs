//! The bidirectional path tracer (`bdpt`; Lafortune and Willems 1993, Veach 1997, chapter 10): for each camera sample a path
//! from the eye and a path from a light, and all ways to make one path of the two.
//!
//! Strategy (s, t) has s vertices from the light and t from the eye, of which the lens is one: `s = 0` hits a light, `s = 1` samples a
//! light point for the eye vertex, `t = 1` samples a lens point for the light vertex, `t = 0` hits the lens, and the others connect
//! two vertices. All strategies with `s + t - 1` up to `max_depth` are there. Their weights, over *all* strategies that
//! could have made the same path, are those of [`Heuristic`].
//!
//! What no strategy can make is what is delta at both ends of every edge: a point light's light that goes through smooth glass onto a
//! diffuse surface and back through the glass into a pinhole.

use glam::{IVec2, Vec3};

use super::light_path::{LightPaths, LightVertex};
use super::parameters::{PathLength, bad, unknown};
use super::pass::{Pass, Scratch};
use super::{IntegratorError, PathObserver, Strategy};
use crate::query::{Ray, RayQuery};
use crate::sampling::Sampler;
use crate::scene::Rgb;
use crate::transport::bsdf::TransportMode;
use crate::transport::mis::{Flight, Heuristic, Partials};
use crate::transport::vertex::SurfaceVertex;
use crate::transport::walk::Walk;

/// Parameters. Those of [`PathLength`] are Mitsuba's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bidirectional {
    /// How long paths get; Russian roulette counts the segments of each subpath.
    pub length: PathLength,
    /// How strategies are weighed.
    pub heuristic: Heuristic,
}

impl Default for Bidirectional {
    fn default() -> Self {
        Self { length: PathLength::default(), heuristic: Heuristic::Power }
    }
}

/// Dimension sets of the sampler, as in [`backward`](super::backward).
const LIGHT_SET: u32 = 1;
const SCATTER_SET: u32 = 2;
const SETS_PER_VERTEX: u32 = 2;

/// The present end of an eye subpath.
struct EyeVertex<'a> {
    vertex: &'a SurfaceVertex<'a>,
    beta: Rgb,
    partials: Partials,
    /// Segments up to here; the vertex is the path's `t = depth + 1`.
    depth: u32,
    cos_in: f32,
}

impl Bidirectional {
    /// Reads parameters from text.
    ///
    /// # Errors
    /// If a parameter is not known or its value is out of range.
    pub fn from_parameters(parameters: &[(String, String)]) -> Result<Self, IntegratorError> {
        let mut this = Self::default();
        for (name, value) in parameters {
            match name.as_str() {
                "exponent" => {
                    this.heuristic = match value.as_str() {
                        "1" => Heuristic::Balance,
                        "2" => Heuristic::Power,
                        _ => return Err(bad("exponent", value, "1 (balance heuristic) or 2")),
                    };
                }
                _ if this.length.read(name, value)? => {}
                _ => return Err(unknown("bdpt", name, "max_depth, rr_depth, exponent")),
            }
        }
        Ok(this)
    }

    /// Name and parameters, in the form that the command line takes.
    pub fn describe(&self) -> String {
        let exponent = match self.heuristic {
            Heuristic::Balance => 1,
            Heuristic::Power => 2,
        };
        format!("bdpt:{},exponent={exponent}", self.length.describe())
    }

    /// Traces the light path of a slot; its splats and vertices go to `scratch`.
    pub fn trace_light_path<'w, Q: RayQuery, O: PathObserver>(
        &self,
        pass: &Pass<'w, '_, Q>,
        slot: u64,
        scratch: &mut Scratch<'w>,
        observer: &mut O,
    ) {
        let paths = LightPaths {
            length: self.length,
            connect: true,
            hit: true,
            with_eye_paths: true,
            heuristic: self.heuristic,
        };
        paths.trace(pass, slot, scratch, observer);
    }

    /// Radiance that arrives along `camera_ray`, a ray of `pixel`, but for what arrives as splats: those go to `scratch`.
    pub fn sample<'w, Q: RayQuery, O: PathObserver>(
        &self,
        pass: &Pass<'w, '_, Q>,
        pixel: IVec2,
        camera_ray: Ray,
        sampler: &Sampler,
        scratch: &mut Scratch<'w>,
        observer: &mut O,
    ) -> Rgb {
        self.trace_light_path(pass, pass.slot(pixel), scratch, observer);
        EyePath { settings: self, pass, scratch, observer, radiance: Rgb::ZERO }.walk(camera_ray, sampler)
    }
}

/// The eye subpath of a sample and what it has gathered.
struct EyePath<'a, 'w, 's, Q, O> {
    settings: &'a Bidirectional,
    pass: &'a Pass<'w, 's, Q>,
    scratch: &'a mut Scratch<'w>,
    observer: &'a mut O,
    radiance: Rgb,
}

impl<Q: RayQuery, O: PathObserver> EyePath<'_, '_, '_, Q, O> {
    fn walk(mut self, camera_ray: Ray, sampler: &Sampler) -> Rgb {
        let h = self.settings.heuristic;
        let max_depth = self.settings.length.limit();
        let mut walk = Walk::new(TransportMode::Radiance, camera_ray, Rgb::ONE);
        let mut flight = self.leave_camera(&camera_ray);
        let mut from = camera_ray.o;
        for depth in 1..=max_depth {
            self.scratch.rays += 1;
            let Some(hit) = self.pass.query.intersect(&walk.ray) else {
                self.observer.segment(walk.mode, depth, &walk.ray, None, walk.beta);
                self.hit_environment(&walk, flight, depth);
                break;
            };
            let vertex = SurfaceVertex::new(&self.pass.world.materials, &hit, &walk.ray);
            self.observer.segment(walk.mode, depth, &walk.ray, Some((&vertex, hit.t)), walk.beta);
            let cos_in = vertex.cos(vertex.wo);
            // Parallel camera rays do not spread.
            let is_spread = depth > 1 || !self.pass.world.camera.is_parallel();
            let spread = if is_spread { from.distance_squared(vertex.point.p) } else { 1.0 };
            let partials = h.arrive(flight, spread, cos_in);
            let end = EyeVertex { vertex: &vertex, beta: walk.beta, partials, depth, cos_in };
            self.hit_light(&end, from);
            if depth == max_depth {
                break;
            }
            let set = SETS_PER_VERTEX * (depth - 1);
            if !vertex.bsdf.is_delta() {
                let [choice, u, v, _] = sampler.block(set + LIGHT_SET);
                self.sample_light(&end, [choice, u, v]);
                self.connect_all(&end, max_depth);
            }
            let [lobe, u, v, roulette] = sampler.block(set + SCATTER_SET);
            let Some(scatter) = walk.scatter(&vertex, [lobe, u, v]) else { break };
            if depth >= self.settings.length.rr_depth && !walk.survives(roulette) {
                break;
            }
            flight = h.leave(&partials, &vertex.turn(cos_in, &scatter, walk.mode));
            from = vertex.point.p;
        }
        self.radiance
    }

    /// The sums where the camera ray sets out. Each strategy with a splat has as many samples for a pixel as there are light paths.
    fn leave_camera(&self, ray: &Ray) -> Flight {
        let (h, camera) = (self.settings.heuristic, &self.pass.world.camera);
        let pdf = f64::from(camera.pdf_we_w(ray.o, ray.d)) / self.pass.light_paths() as f64;
        let d_vc = if camera.is_delta() {
            0.0
        } else {
            let cos = f64::from(camera.forward().dot(ray.d));
            h.raise(cos * f64::from(camera.lens_area()) / pdf)
        };
        Flight { d_vcm: h.raise(1.0 / pdf), d_vc }
    }

    /// Adds a contribution to the sample. `others` is the sum over all other strategies relative to this one.
    #[inline]
    fn add(&mut self, s: u32, depth: u32, value: Rgb, others: f64) {
        let weight = (1.0 / (1.0 + others)) as f32;
        self.observer.contribution(Strategy { s, t: depth + 1 }, None, value, weight);
        self.radiance += value * weight;
    }

    /// Strategy (0, t), for a path that left the scene to the environment.
    fn hit_environment(&mut self, walk: &Walk, flight: Flight, depth: u32) {
        let lights = &self.pass.world.lights;
        let Some(light) = lights.environment() else { return };
        let emitted = lights.le_environment(walk.ray.d);
        if emitted == Rgb::ZERO {
            return;
        }
        if depth == 1 && self.pass.world.camera.is_parallel() {
            // No other strategy finds the one direction in which the camera looks.
            return self.add(0, depth, walk.beta * emitted, 0.0);
        }
        let h = self.settings.heuristic;
        let partials = h.arrive(flight, 1.0, 1.0);
        let (pdf_position, pdf_direction_w) = lights.pdf_le(light, None, -walk.ray.d);
        let others = h.raise(f64::from(lights.pdf_environment(walk.ray.d))) * partials.d_vcm
            + h.raise(f64::from(pdf_position) * f64::from(pdf_direction_w)) * partials.d_vc;
        self.add(0, depth, walk.beta * emitted, others);
    }

    /// Strategy (0, t), for light that the vertex itself emits.
    fn hit_light(&mut self, end: &EyeVertex, from: Vec3) {
        let lights = &self.pass.world.lights;
        let point = &end.vertex.point;
        let Some(light) = lights.light_at(point) else { return };
        let emitted = lights.le(point, end.vertex.wo);
        if emitted == Rgb::ZERO {
            return;
        }
        let h = self.settings.heuristic;
        let (pdf_position, pdf_direction_w) = lights.pdf_le(light, Some(point.ng), end.vertex.wo);
        let pdf_position = f64::from(pdf_position);
        // What is seen directly, strategy (1, 1) finds from the start of a light path.
        let pdf_connect = if end.depth == 1 {
            pdf_position
        } else {
            let pdf_w = f64::from(lights.pdf_li(light, from, point, -end.vertex.wo));
            pdf_w * f64::from(end.cos_in) / f64::from(from.distance_squared(point.p))
        };
        let others = h.raise(pdf_connect) * end.partials.d_vcm
            + h.raise(pdf_position * f64::from(pdf_direction_w)) * end.partials.d_vc;
        self.add(0, end.depth, end.beta * emitted, others);
    }

    /// Strategy (1, t).
    fn sample_light(&mut self, end: &EyeVertex, u: [f32; 3]) {
        let lights = &self.pass.world.lights;
        let Some(light) = lights.sample_li(&end.vertex.point, u) else { return };
        let Some(scattered) = end.vertex.evaluate(light.wi, TransportMode::Radiance) else { return };
        self.scratch.rays += 1;
        if self.pass.query.occluded(&light.shadow_ray) {
            return;
        }
        let h = self.settings.heuristic;
        let at = end.vertex.point.p;
        let pdf_ratio = lights.le_over_li(light.light, light.ng, -light.wi, at, light.pdf_w)
            * f64::from(end.vertex.cos(light.wi));
        let mut others = h.shorter(&end.partials, pdf_ratio, f64::from(scattered.pdf_rev_w));
        if !light.is_delta {
            others += h.raise(f64::from(scattered.pdf_w) / f64::from(light.pdf_w));
        }
        let value = end.beta * scattered.f * light.radiance / light.pdf_w;
        self.add(1, end.depth, value, others);
    }

    /// Strategies (s, t) with `s` of at least 2.
    fn connect_all(&mut self, end: &EyeVertex, max_depth: u32) {
        // The vertices are lent out, so that nothing is copied.
        let vertices = std::mem::take(&mut self.scratch.light_vertices);
        // s + t - 1 segments, where t = depth + 1. The vertices are in order.
        for light in vertices.iter().take_while(|light| light.s + end.depth <= max_depth) {
            self.connect(end, light);
        }
        self.scratch.light_vertices = vertices;
    }

    fn connect(&mut self, end: &EyeVertex, light: &LightVertex) {
        let line = light.vertex.point.p - end.vertex.point.p;
        let distance_squared = line.length_squared();
        let d = line / distance_squared.sqrt();
        let Some(eye_side) = end.vertex.evaluate(d, TransportMode::Radiance) else { return };
        let Some(light_side) = light.vertex.evaluate(-d, TransportMode::Importance) else { return };
        let Some(shadow_ray) = Ray::spawn_between(&end.vertex.point, &light.vertex.point) else { return };
        self.scratch.rays += 1;
        if self.pass.query.occluded(&shadow_ray) {
            return;
        }
        let h = self.settings.heuristic;
        let pdf_area = |pdf_w: f32, cos: f32| f64::from(pdf_w) * f64::from(cos) / f64::from(distance_squared);
        let light_pdf = pdf_area(eye_side.pdf_w, light.vertex.cos(d));
        let eye_pdf = pdf_area(light_side.pdf_w, end.vertex.cos(d));
        let others = h.shorter(&light.partials, light_pdf, f64::from(light_side.pdf_rev_w))
            + h.shorter(&end.partials, eye_pdf, f64::from(eye_side.pdf_rev_w));
        let value = end.beta * eye_side.f * light_side.f * light.beta / distance_squared;
        self.add(light.s, end.depth, value, others);
    }
}
