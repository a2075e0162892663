//! Paths drawn from the camera, and what is asked of each.

use glam::Vec3;
use helmholtz::query::{Hit, Ray, RayQuery};
use helmholtz::scene::Scene;
use helmholtz::transport::World;
use helmholtz::transport::bsdf::{Materials, TransportMode};
use helmholtz::transport::mis::Heuristic;
use helmholtz::transport::vertex::SurfaceVertex;

use super::{ExplicitPath, Inner, LightEnd, cos, distance_squared};
use crate::backends::BackendTest;
use crate::statistics::Random;

/// A vertex of an eye path that is being drawn, with the event that led on from it.
struct Drawn<'a> {
    vertex: SurfaceVertex<'a>,
    hit: Hit,
    is_delta: bool,
    eta: f32,
}

/// Puts a path together from the light's end and vertices counted from the eye.
fn assemble<'a>(
    materials: &'a Materials<'a>,
    light: LightEnd,
    drawn: Vec<Drawn>,
    lens: Vec3,
) -> ExplicitPath<'a> {
    // Directions from the positions themselves: a spawned ray starts a little beside its vertex.
    let seen_by =
        |hit: &Hit, p: Vec3, d: Vec3| SurfaceVertex::new(materials, &Hit { t: 0.0, ..*hit }, &Ray::new(p, d));
    let positions: Vec<Vec3> =
        std::iter::once(lens).chain(drawn.iter().map(|drawn| drawn.vertex.point.p)).collect();
    let mut inner = Vec::new();
    for (i, Drawn { hit, is_delta, eta, .. }) in drawn.into_iter().enumerate() {
        let p = positions[i + 1];
        let from_eye = seen_by(&hit, p, (p - positions[i]).normalize());
        let d = positions.get(i + 2).map_or(light.d, |next| (p - next).normalize());
        inner.push(Inner { from_light: seen_by(&hit, p, d), from_eye, is_delta, eta });
    }
    inner.reverse();
    ExplicitPath { light, inner, lens }
}

/// Draws a path from the camera and calls `found` wherever it meets a light, and once for a light point sampled at its last vertex.
fn draw<Q: RayQuery>(world: &World, query: &Q, random: &mut Random, mut found: impl FnMut(ExplicitPath)) {
    const GREATEST_LENGTH: usize = 6;
    let (scene, lights) = (world.scene, &world.lights);
    let film = random.uniform_2d() * scene.film.size.as_vec2();
    let camera_ray = world.camera.spawn_ray(film, random.uniform_2d());
    let mut ray = camera_ray;
    let mut drawn: Vec<Drawn> = Vec::new();
    // A path is taken to pieces once, since its vertices are not copied: the last chance is chosen beforehand.
    let length = 1 + (random.uniform() * GREATEST_LENGTH as f32) as usize;
    while drawn.len() < length {
        let Some(hit) = query.intersect(&ray) else {
            // The one direction in which parallel rays see the sky is found by no other strategy.
            let is_found = !(drawn.is_empty() && world.camera.is_parallel());
            if let Some(light) = lights.environment().filter(|_| is_found) {
                let end = LightEnd { light, point: None, p: Vec3::ZERO, d: -ray.d, is_infinite: true };
                found(assemble(&world.materials, end, drawn, camera_ray.o));
            }
            return;
        };
        let vertex = SurfaceVertex::new(&world.materials, &hit, &ray);
        if let Some(light) = lights.light_at(&vertex.point).filter(|_| vertex.point.ng.dot(ray.d) < 0.0) {
            let point = vertex.point;
            // From the vertices themselves: spawned rays start a little beside.
            let from = drawn.last().map_or(camera_ray.o, |last| last.vertex.point.p);
            let d = (from - point.p).normalize();
            let end = LightEnd { light, point: Some(point), p: point.p, d, is_infinite: false };
            found(assemble(&world.materials, end, drawn, camera_ray.o));
            return;
        }
        if drawn.len() + 1 == length {
            let light = lights.sample_li(&vertex.point, random.uniform_f64(), random.uniform_2d());
            let Some(sample) = light else { return };
            let blocked = query.occluded(&sample.shadow_ray);
            // Only lights of no size: the others are met by chance.
            if !sample.is_delta || blocked || vertex.evaluate(sample.wi, TransportMode::Radiance).is_none() {
                return;
            }
            let light = sample.light;
            let is_infinite = sample.shadow_ray.t_max == f32::INFINITY;
            let end = if is_infinite {
                LightEnd { light, point: None, p: Vec3::ZERO, d: -sample.wi, is_infinite }
            } else {
                let p = sample.shadow_ray.o + sample.shadow_ray.d * sample.shadow_ray.t_max;
                LightEnd { light, point: None, p, d: (vertex.point.p - p).normalize(), is_infinite }
            };
            drawn.push(Drawn { vertex, hit, is_delta: false, eta: 1.0 });
            found(assemble(&world.materials, end, drawn, camera_ray.o));
            return;
        }
        let Some(scatter) = vertex.scatter(random.uniform_3d(), TransportMode::Radiance) else { return };
        drawn.push(Drawn { vertex, hit, is_delta: scatter.is_delta, eta: scatter.eta });
        ray = Ray::spawn(&vertex.point, scatter.wi);
    }
}

pub(super) struct Case<'a> {
    pub(super) name: String,
    pub(super) scene: &'a Scene,
    /// Size of the scene, beside that of [`room`].
    pub(super) scale: f64,
}

impl BackendTest for Case<'_> {
    fn run<Q: RayQuery>(&self, _: &str, query: &Q) {
        let world = World::new(self.scene);
        let mut random = Random::new(7);
        let mut lengths = [0; 9];
        let mut enclosed = 0;
        for _ in 0..80_000 {
            draw(&world, query, &mut random, |path| {
                // Where a path grazes a surface or a corner, the f32 of its own cosines is not good to 1e-5.
                let is_grazing = (0..path.len() - 1).any(|i| {
                    let n = |i: usize| path.inner.get(i.wrapping_sub(1)).map(|inner| inner.from_eye.point.ng);
                    let is_short =
                        i > 0 && distance_squared(path.p(i), path.p(i + 1)) < 0.01 * self.scale * self.scale;
                    is_short || [n(i), n(i + 1)].into_iter().flatten().any(|n| cos(n, path.d(i)) < 0.02)
                });
                if !is_grazing {
                    lengths[path.len()] += 1;
                    enclosed += u32::from(path.can_connect_behind_deltas());
                    path.check(&self.name, &world, Heuristic::Balance);
                    path.check(&self.name, &world, Heuristic::Power);
                }
            });
        }
        assert!(lengths[3..7].iter().all(|&n| n > 30), "{}: too few paths, {lengths:?}", self.name);
        let has_enclosed = self.name.starts_with("balls in glass");
        assert!(!has_enclosed || enclosed > 30, "{}: too few paths, {enclosed} connect in glass", self.name);
    }
}
