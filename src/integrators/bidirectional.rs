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

use glam::{IVec2, Vec2, Vec3};

use super::light_path::{self, LightVertex};
use super::parameters::{PathLength, choice, unknown, word};
use super::pass::{Pass, Scratch};
use super::weights::Weights;
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

/// Exponents of the densities in the weights.
const EXPONENTS: [(&str, Heuristic); 2] = [("1", Heuristic::Balance), ("2", Heuristic::Power)];

/// Dimension sets of the sampler, as in [`backward`](super::backward).
const DIRECTION_SET: u32 = 1;
const CHOICE_SET: u32 = 2;
const SETS_PER_VERTEX: u32 = 2;

/// The present end of an eye subpath.
struct EyeVertex<'a> {
    vertex: &'a SurfaceVertex<'a>,
    beta: Rgb,
    partials: Partials,
    /// Segments up to here; the vertex is the path's `t = depth + 1`.
    depth: u32,
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
                "exponent" => this.heuristic = choice("exponent", value, &EXPONENTS)?,
                _ if this.length.read(name, value)? => {}
                _ => return Err(unknown("bdpt", name, "max_depth, rr_depth, exponent")),
            }
        }
        Ok(this)
    }

    /// Name and parameters, in the form that the command line takes.
    pub fn describe(&self) -> String {
        format!("bdpt:{},exponent={}", self.length.describe(), word(&EXPONENTS, &self.heuristic))
    }

    /// Traces the light path of a slot; its splats and vertices go to `scratch`.
    pub fn trace_light_path<'w, Q: RayQuery, O: PathObserver>(
        &self,
        pass: &Pass<'w, '_, Q>,
        slot: u64,
        scratch: &mut Scratch<'w>,
        observer: &mut O,
    ) {
        light_path::trace(pass, self.length, &self.weights(pass), slot, scratch, observer);
    }

    fn weights<'a, 's, Q>(&self, pass: &Pass<'a, 's, Q>) -> Weights<'a, 's> {
        Weights {
            world: pass.world,
            heuristic: self.heuristic,
            light_paths: pass.light_paths() as f64,
            has_eye_paths: true,
            connects_lens: true,
            hits_lens: !pass.world.camera.is_delta(),
        }
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
        let weights = self.weights(pass);
        light_path::trace(pass, self.length, &weights, pass.slot(pixel), scratch, observer);
        let path = EyePath { weights, length: self.length, pass, scratch, observer, radiance: Rgb::ZERO };
        path.walk(camera_ray, sampler)
    }
}

/// The eye subpath of a sample and what it has gathered.
struct EyePath<'a, 'w, 's, Q, O> {
    weights: Weights<'a, 's>,
    length: PathLength,
    pass: &'a Pass<'w, 's, Q>,
    scratch: &'a mut Scratch<'w>,
    observer: &'a mut O,
    radiance: Rgb,
}

impl<Q: RayQuery, O: PathObserver> EyePath<'_, '_, '_, Q, O> {
    fn walk(mut self, camera_ray: Ray, sampler: &Sampler) -> Rgb {
        let h = self.weights.heuristic;
        let max_depth = self.length.limit();
        let mut walk = Walk::new(TransportMode::Radiance, camera_ray, Rgb::ONE);
        let mut flight = self.weights.leave_camera(&camera_ray);
        let mut from = camera_ray.o;
        for depth in 1..=max_depth {
            self.scratch.rays += 1;
            let Some(hit) = self.pass.query.intersect(&walk.ray) else {
                self.observer.segment(&walk, depth, None);
                self.hit_environment(&walk, flight, depth);
                break;
            };
            let vertex = SurfaceVertex::new(&self.pass.world.materials, &hit, &walk.ray);
            self.observer.segment(&walk, depth, Some(&vertex));
            let cos_in = vertex.cos(vertex.wo);
            // Parallel camera rays do not spread.
            let is_spread = depth > 1 || !self.pass.world.camera.is_parallel();
            let spread = if is_spread { from.distance_squared(vertex.point.p) } else { 1.0 };
            let partials = h.arrive(flight, spread, cos_in);
            let end = EyeVertex { vertex: &vertex, beta: walk.beta, partials, depth };
            self.hit_light(&end, from);
            if depth == max_depth {
                break;
            }
            let set = SETS_PER_VERTEX * (depth - 1);
            let may_end = depth >= self.length.rr_depth;
            let [u, light_u, v, light_v] = sampler.block(set + DIRECTION_SET);
            let has_choice = may_end || self.pass.world.lights.len() > 1 || vertex.bsdf.has_lobes();
            let (light, [lobe, roulette, _]) =
                if has_choice { sampler.choices(set + CHOICE_SET) } else { (0.0, [0.0; 3]) };
            if !vertex.bsdf.is_delta() {
                self.sample_light(&end, light, Vec2::new(light_u, light_v));
                self.connect_all(&end, max_depth);
            }
            let Some(scatter) = walk.scatter(&vertex, [lobe, u, v]) else { break };
            if may_end && !walk.survives(roulette, Walk::MAX_SURVIVAL) {
                break;
            }
            flight = h.leave(&partials, &vertex.turn(cos_in, &scatter, walk.mode));
            from = vertex.point.p;
        }
        self.radiance
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
        let others = if depth == 1 && self.pass.world.camera.is_parallel() {
            // No other strategy finds the one direction in which the camera looks.
            0.0
        } else {
            self.weights.environment_hit_others(flight, light, walk.ray.d)
        };
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
        let (wo, is_first) = (end.vertex.wo, end.depth == 1);
        let others = self.weights.light_hit_others(&end.partials, (light, point), wo, from, is_first);
        self.add(0, end.depth, end.beta * emitted, others);
    }

    /// Strategy (1, t).
    fn sample_light(&mut self, end: &EyeVertex, choice: f64, u: Vec2) {
        let lights = &self.pass.world.lights;
        let Some(light) = lights.sample_li(&end.vertex.point, choice, u) else { return };
        let Some(scattered) = end.vertex.evaluate(light.wi, TransportMode::Radiance) else { return };
        self.scratch.rays += 1;
        if self.pass.query.occluded(&light.shadow_ray) {
            return;
        }
        let others = self.weights.light_sampled_others((end.vertex, &end.partials), &light, &scattered);
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
        // Many pairs end here, before anything is evaluated.
        if !(end.vertex.faces(d) && light.vertex.faces(-d)) {
            return;
        }
        let Some(eye_side) = end.vertex.evaluate(d, TransportMode::Radiance) else { return };
        let Some(light_side) = light.vertex.evaluate(-d, TransportMode::Importance) else { return };
        let Some(shadow_ray) = Ray::spawn_between(&end.vertex.point, &light.vertex.point) else { return };
        self.scratch.rays += 1;
        if self.pass.query.occluded(&shadow_ray) {
            return;
        }
        let others = self.weights.connected_others(
            (end.vertex, &end.partials, &eye_side),
            (&light.vertex, &light.partials, &light_side),
            d,
            distance_squared,
        );
        let value = end.beta * eye_side.f * light_side.f * light.beta / distance_squared;
        self.add(light.s, end.depth, value, others);
    }
}
