//! Paths from the light: how they start, walk, and reach the film. Shared by the forward and the bidirectional integrator; those that only leave
//! something where they land, photons or lights, are walked by [`deposit`].
//!
//! A light path with `s` vertices reaches the film by connecting its end to a point on the lens (strategy `t = 1`), or by hitting the lens
//! by chance (`t = 0`), which a pinhole does not allow. A point light or a directional one is not seen directly, neither way: it
//! would be a dot of no size.

use glam::Vec2;

use super::observer::{PathObserver, Strategy};
use super::parameters::PathLength;
use super::pass::{Pass, Scratch};
use super::weights::Weights;
use crate::film::Splat;
use crate::query::{Hit, Ray, RayQuery};
use crate::sampling::Sampler;
use crate::scene::Rgb;
use crate::transport::bsdf::TransportMode;
use crate::transport::lights::LeSample;
use crate::transport::mis::{Flight, Partials};
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

/// Sets of the sampler: two for the start, then two for each vertex. The first of each two holds a pair for a place (on the light, on the
/// lens) and one for a direction, interleaved as in [`backward`](super::backward); the second all choices.
pub(super) const DIRECTION_SET: u32 = 0;
pub(super) const CHOICE_SET: u32 = 1;
pub(super) const SETS_PER_VERTEX: u32 = 2;

/// Number of segments after which survival is no longer certain even where nothing is absorbed.
const FAIR_DEPTH: u32 = 32;

/// Starts the light path of a slot, of which each pass has `count`. `None` if nothing is emitted.
pub(super) fn start<Q>(pass: &Pass<Q>, slot: u64, count: u64) -> Option<(LeSample, Sampler)> {
    let sampler = pass.light_sampler(slot, count);
    let [u, x, v, y] = sampler.block(DIRECTION_SET);
    let (choice, _) = sampler.choices(CHOICE_SET);
    Some((pass.world.lights.sample_le(choice, Vec2::new(x, y), Vec2::new(u, v))?, sampler))
}

/// A vertex of a light path that leaves something there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Landing<'v, 'w> {
    /// Where.
    pub(super) vertex: &'v SurfaceVertex<'w>,
    /// Share of the start's power that arrives, before [`SurfaceVertex::incidence_correction`].
    pub(super) beta: Rgb,
    /// Segments from the light.
    pub(super) depth: u32,
    /// Whether it came by delta lobes alone, or straight from the light.
    pub(super) is_specular: bool,
}

/// Walks a light path of at most `last` segments and shows each vertex that is not specular to `leave`. A path lives on with the
/// probability that the brightest channel is reflected, so that all carry about the same power; and `goes_on`, told whether it has come by delta
/// lobes alone, may end it. Returns the number of rays traced.
pub(super) fn deposit<'w, Q: RayQuery>(
    pass: &Pass<'w, '_, Q>,
    start: &LeSample,
    sampler: &Sampler,
    last: u32,
    goes_on: impl Fn(bool) -> bool,
    mut leave: impl FnMut(&Landing<'_, 'w>),
) -> u64 {
    let mut walk = Walk::new(TransportMode::Importance, start.ray, Rgb::ONE);
    let mut is_specular = true;
    for depth in 1..=last {
        let Some(hit) = pass.query.intersect(&walk.ray) else { return u64::from(depth) };
        let vertex = SurfaceVertex::new(&pass.world.materials, &hit, &walk.ray);
        if !vertex.bsdf.is_delta() {
            leave(&Landing { vertex: &vertex, beta: walk.beta, depth, is_specular });
        }
        let set = SETS_PER_VERTEX * depth;
        let [u, _, v, _] = sampler.block(set + DIRECTION_SET);
        let [lobe, roulette, ..] = sampler.block(set + CHOICE_SET);
        let Some(scatter) = walk.scatter(&vertex, [lobe, u, v]) else { return u64::from(depth) };
        is_specular &= scatter.is_delta;
        let most = if depth < FAIR_DEPTH { 1.0 } else { Walk::MAX_SURVIVAL };
        if !goes_on(is_specular) || !walk.survives(roulette, most) {
            return u64::from(depth);
        }
    }
    u64::from(last)
}

/// What is the same all along a light path.
struct Tracer<'a, 'w, 's, Q, O> {
    weights: &'a Weights<'a, 's>,
    length: PathLength,
    pass: &'a Pass<'w, 's, Q>,
    start: LeSample,
    /// What the start emits over its density.
    power: Rgb,
    scratch: &'a mut Scratch<'w>,
    observer: &'a mut O,
}

/// Traces the light path of a slot. Its splats and, if there are eye paths, its vertices go to `scratch`.
pub(super) fn trace<'w, 's, Q: RayQuery, O: PathObserver>(
    pass: &Pass<'w, 's, Q>,
    length: PathLength,
    weights: &Weights<'_, 's>,
    slot: u64,
    scratch: &mut Scratch<'w>,
    observer: &mut O,
) {
    scratch.light_vertices.clear();
    let sampler = pass.light_sampler(slot, pass.light_paths());
    let [u, x, v, y] = sampler.block(DIRECTION_SET);
    let (choice, [lens_u, _, lens_v]) = sampler.choices(CHOICE_SET);
    let Some(start) = pass.world.lights.sample_le(choice, Vec2::new(x, y), Vec2::new(u, v)) else { return };
    let power = start.power();
    let mut tracer = Tracer { weights, length, pass, start, power, scratch, observer };
    if weights.connects_lens && length.limit() >= 1 {
        tracer.connect_start(Vec2::new(lens_u, lens_v));
    }
    tracer.walk(&sampler);
}

impl<Q: RayQuery, O: PathObserver> Tracer<'_, '_, '_, Q, O> {
    /// The walk through the scene. `depth` segments lead to the vertex, which is the path's vertex `s = depth + 1`.
    fn walk(&mut self, sampler: &Sampler) {
        let h = self.weights.heuristic;
        let max_depth = self.length.limit();
        // The last segment of a path is left to the connection, unless the lens can be hit.
        let last = if self.weights.hits_lens { max_depth } else { max_depth.saturating_sub(1) };
        let mut walk = Walk::new(TransportMode::Importance, self.start.ray, Rgb::ONE);
        let mut flight = Flight::default();
        let mut from = self.start.ray.o;
        for depth in 1..=last {
            self.scratch.rays += 1;
            // Observers know of a segment before of what it contributes, as on eye paths.
            let Some(hit) = self.pass.query.intersect(&walk.ray) else {
                self.observer.segment(&walk, depth, None);
                if self.weights.hits_lens {
                    self.hit_lens(&walk, None, flight, depth);
                }
                break;
            };
            let vertex = SurfaceVertex::new(&self.pass.world.materials, &hit, &walk.ray);
            self.observer.segment(&walk, depth, Some(&vertex));
            if self.weights.hits_lens {
                self.hit_lens(&walk, Some(hit), flight, depth);
            }
            if depth == max_depth {
                break;
            }
            let cos_in = vertex.cos(vertex.wo);
            let partials = if depth == 1 {
                self.weights.first_light_vertex(&self.start, vertex.point.p, cos_in, false)
            } else {
                h.arrive(flight, from.distance_squared(vertex.point.p), cos_in)
            };
            let beta = self.power * walk.beta;
            let set = SETS_PER_VERTEX * depth;
            let [u, lens_u, v, lens_v] = sampler.block(set + DIRECTION_SET);
            if !vertex.bsdf.is_delta() {
                let end = LightVertex { vertex, beta, partials, s: depth + 1 };
                if self.weights.connects_lens {
                    self.connect(&end, Vec2::new(lens_u, lens_v));
                }
                if self.weights.has_eye_paths {
                    self.scratch.light_vertices.push(end);
                }
            }
            if depth == last {
                break;
            }
            let may_end = depth >= self.length.rr_depth;
            let has_choice = may_end || vertex.bsdf.has_lobes();
            let [lobe, roulette, ..] = if has_choice { sampler.block(set + CHOICE_SET) } else { [0.0; 4] };
            let Some(scatter) = walk.scatter(&vertex, [lobe, u, v]) else { break };
            if may_end && !walk.survives(roulette, Walk::MAX_SURVIVAL) {
                break;
            }
            flight = h.leave(&partials, &vertex.turn(cos_in, &scatter, walk.mode));
            from = vertex.point.p;
        }
    }

    /// Strategy (1, 1): the light's own point, seen from the lens.
    fn connect_start(&mut self, u: Vec2) {
        let (world, start) = (self.pass.world, self.start);
        if world.lights.is_delta(start.light) {
            return;
        }
        let (connection, shadow_ray, cos, distance_squared, pdf, radiance) = if let Some(point) = &start.point
        {
            let Some(connection) = world.camera.sample_wi(point.p, u) else { return };
            let Some(ray) = Ray::spawn_to_point(point, connection.p) else { return };
            let (ray, cos) = (connection.shorten(ray), point.ng.dot(connection.d).abs());
            let radiance = world.lights.le(point, -connection.d);
            (connection, ray, cos, connection.p.distance_squared(point.p), start.pdf_position, radiance)
        } else {
            let Some((connection, ray)) = world.camera.sample_distant(-start.ray.d, u) else { return };
            (connection, ray, 1.0, 1.0, world.lights.pdf_li_of_start(&start, connection.p), start.radiance)
        };
        let pdf_camera = self.weights.camera_pdf(&connection, distance_squared) * f64::from(cos);
        let value = radiance * (pdf_camera / f64::from(pdf) / self.weights.light_paths) as f32;
        if value == Rgb::ZERO || !self.pass.is_sampled(connection.film) || self.is_blocked(&shadow_ray) {
            return;
        }
        let others = self.weights.start_seen_others(&start, &connection);
        self.splat(Strategy { s: 1, t: 1 }, connection.film, value, others);
    }

    /// Strategies (s, 1).
    fn connect(&mut self, end: &LightVertex, u: Vec2) {
        let camera = &self.pass.world.camera;
        let point = &end.vertex.point;
        let Some(connection) = camera.sample_wi(point.p, u) else { return };
        if !self.pass.is_sampled(connection.film) {
            return;
        }
        let Some(scattered) = end.vertex.evaluate(-connection.d, TransportMode::Importance) else { return };
        let Some(shadow_ray) = Ray::spawn_to_point(point, connection.p) else { return };
        if self.is_blocked(&connection.shorten(shadow_ray)) {
            return;
        }
        let pdf_camera = self.weights.camera_pdf(&connection, connection.p.distance_squared(point.p));
        let value = end.beta * scattered.f * (pdf_camera / self.weights.light_paths) as f32;
        let others = self.weights.lens_sampled_others((&end.vertex, &end.partials), &connection, &scattered);
        self.splat(Strategy { s: end.s, t: 1 }, connection.film, value, others);
    }

    fn is_blocked(&mut self, shadow_ray: &Ray) -> bool {
        self.scratch.rays += 1;
        self.pass.query.occluded(shadow_ray)
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
        let partials = if is_first {
            let at = walk.ray.o + lens.t * walk.ray.d;
            self.weights.first_light_vertex(&self.start, at, lens.cos, true)
        } else {
            self.weights.heuristic.arrive(flight, lens.t * lens.t, lens.cos)
        };
        let importance = f64::from(lens.importance) / self.weights.light_paths;
        let value = self.power * walk.beta * importance as f32;
        let others = self.weights.lens_hit_others(&partials, &lens);
        self.splat(Strategy { s: depth + 1, t: 0 }, lens.film, value, others);
    }

    /// Adds a contribution. `others` is the sum over all other strategies relative to this one.
    fn splat(&mut self, strategy: Strategy, film: Vec2, value: Rgb, others: f64) {
        let weight = (1.0 / (1.0 + others)) as f32;
        self.observer.contribution(strategy, Some(film), value, weight);
        self.scratch.splats.push(Splat { position: film, radiance: value * weight });
    }
}
