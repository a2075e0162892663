//! The backward path tracer (`path`): paths start at the camera and find the lights in two ways, by sampling them
//! (next-event estimation) and by hitting them, joined by multiple importance sampling with the power heuristic
//! (Veach 1997, chapter 9; Kajiya 1986).
//!
//! It cannot find light that reaches a diffuse surface through a delta lobe from a point light, and
//! finds caustics from small lights only by luck.

use glam::{Vec2, Vec3};

use super::parameters::{PathLength, bad, unknown};
use super::{IntegratorError, PathObserver, Strategy};
use crate::query::{Hit, Ray, RayQuery};
use crate::sampling::Sampler;
use crate::scene::Rgb;
use crate::transport::World;
use crate::transport::bsdf::TransportMode;
use crate::transport::mis::power_heuristic;
use crate::transport::vertex::SurfaceVertex;
use crate::transport::walk::Walk;

/// Parameters, with Mitsuba's names, meaning and defaults.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Backward {
    /// How long paths get.
    pub length: PathLength,
    /// Camera rays pass through area lights and see no environment.
    pub hide_emitters: bool,
}

/// Finds caustics (light that comes to a vertex by delta lobes alone, LS+D) for the backward path tracer.
pub(crate) trait Caustics {
    /// Whether paths find them by hitting lights; then they are not to be found otherwise.
    const BY_PATHS: bool;

    /// What the vertex scatters of them towards where the path came from. `depth` segments lead to it.
    fn radiance(&mut self, vertex: &SurfaceVertex, depth: u32) -> Rgb;
}

/// Caustics are found by hitting lights.
struct FoundByPaths;

impl Caustics for FoundByPaths {
    const BY_PATHS: bool = true;

    #[inline(always)]
    fn radiance(&mut self, _: &SurfaceVertex, _: u32) -> Rgb {
        Rgb::ZERO
    }
}

/// Dimension sets of the sampler: set 0 belongs to film and lens, then each vertex takes two.
/// The first holds where on a light and in which direction to scatter, interleaved: of a Sobol' set the pairs (0, 2) and (1, 3)
/// are spread more evenly than (0, 1) and (2, 3). (relMSE of the Cornell box, 24 samples: 0.00256 against 0.00306.)
pub(super) const DIRECTION_SET: u32 = 1;
/// The second which light, which lobe and whether to go on; often none of them is open, and the set is not made.
pub(super) const CHOICE_SET: u32 = 2;
pub(super) const SETS_PER_VERTEX: u32 = 2;

impl Backward {
    /// Reads parameters from text.
    ///
    /// # Errors
    /// If a parameter is not known or its value is out of range.
    pub fn from_parameters(parameters: &[(String, String)]) -> Result<Self, IntegratorError> {
        let mut this = Self::default();
        for (name, value) in parameters {
            match name.as_str() {
                "hide_emitters" => {
                    this.hide_emitters =
                        value.parse().map_err(|_| bad("hide_emitters", value, "`true` or `false`"))?;
                }
                _ if this.length.read(name, value)? => {}
                _ => return Err(unknown("path", name, "max_depth, rr_depth, hide_emitters")),
            }
        }
        Ok(this)
    }

    /// Name and parameters, in the form that the command line takes.
    pub fn describe(&self) -> String {
        format!("path:{},hide_emitters={}", self.length.describe(), self.hide_emitters)
    }

    /// Radiance that arrives at the camera along `camera_ray`, and the number of rays that were traced for it.
    pub fn radiance<Q: RayQuery, O: PathObserver>(
        &self,
        world: &World,
        query: &Q,
        camera_ray: Ray,
        sampler: &Sampler,
        observer: &mut O,
    ) -> (Rgb, u32) {
        self.walk(world, query, camera_ray, sampler, &mut FoundByPaths, observer)
    }

    /// As [`radiance`](Self::radiance), with caustics from wherever.
    #[inline(always)]
    pub(super) fn walk<Q: RayQuery, O: PathObserver, C: Caustics>(
        &self,
        world: &World,
        query: &Q,
        camera_ray: Ray,
        sampler: &Sampler,
        caustics: &mut C,
        observer: &mut O,
    ) -> (Rgb, u32) {
        let max_depth = self.length.limit();
        let mut radiance = Rgb::ZERO;
        let mut rays = 0;
        let mut walk = Walk::new(TransportMode::Radiance, camera_ray, Rgb::ONE);
        let mut previous = None;
        // Whether some vertex has scattered by a lobe that is not delta.
        let mut is_diffused = false;
        for depth in 1..=max_depth {
            rays += 1;
            let is_caustic = !C::BY_PATHS && is_diffused && walk.is_delta;
            let mut ray = walk.ray;
            let Some(hit) = self.next_hit(world, query, &mut ray, depth) else {
                observer.segment(&walk, depth, None);
                if !(is_caustic || self.hide_emitters && depth == 1) {
                    radiance += hit_environment(world, &walk, depth, observer);
                }
                break;
            };
            let vertex = SurfaceVertex::new(&world.materials, &hit, &ray);
            observer.segment(&walk, depth, Some(&vertex));
            if !is_caustic {
                radiance += hit_light(world, &walk, previous, &vertex, depth, observer);
            }
            if depth == max_depth {
                break;
            }
            let set = SETS_PER_VERTEX * (depth - 1);
            let may_end = depth >= self.length.rr_depth;
            let [u, light_u, v, light_v] = sampler.block(set + DIRECTION_SET);
            let has_choice = may_end || world.lights.len() > 1 || vertex.bsdf.has_lobes();
            let (light, [lobe, roulette, _]) =
                if has_choice { sampler.choices(set + CHOICE_SET) } else { (0.0, [0.0; 3]) };
            if !vertex.bsdf.is_delta() {
                let u = (light, Vec2::new(light_u, light_v));
                let (lit, traced) = sample_light(world, query, &walk, &vertex, depth, u, observer);
                radiance += lit;
                rays += traced;
                radiance += walk.beta * caustics.radiance(&vertex, depth);
            }
            if walk.scatter(&vertex, [lobe, u, v]).is_none()
                || (may_end && !walk.survives(roulette, Walk::MAX_SURVIVAL))
            {
                break;
            }
            is_diffused |= !walk.is_delta;
            previous = Some(vertex.point.p);
        }
        (radiance, rays)
    }

    /// What `ray` meets. Camera rays pass through hidden lights, and begin anew behind each.
    #[inline(always)]
    fn next_hit<Q: RayQuery>(&self, world: &World, query: &Q, ray: &mut Ray, depth: u32) -> Option<Hit> {
        let mut hit = query.intersect(ray)?;
        while self.hide_emitters && depth == 1 && world.scene.shapes[hit.shape as usize].emission.is_some() {
            let point = hit.surface(&world.scene.shapes, ray);
            *ray = Ray { t_max: ray.t_max - point.p.distance(ray.o), ..Ray::spawn(&point, ray.d) };
            hit = query.intersect(ray)?;
        }
        Some(hit)
    }
}

/// Light of the environment, for a walk that left the scene.
#[inline]
pub(super) fn hit_environment<O: PathObserver>(
    world: &World,
    walk: &Walk,
    depth: u32,
    observer: &mut O,
) -> Rgb {
    let emitted = world.lights.le_environment(walk.ray.d);
    if emitted == Rgb::ZERO {
        return Rgb::ZERO;
    }
    let pdf_environment = || world.lights.pdf_environment(walk.ray.d);
    let weight = if walk.is_delta { 1.0 } else { power_heuristic(walk.pdf_w, pdf_environment()) };
    let value = walk.beta * emitted;
    observer.contribution(Strategy { s: 0, t: depth + 1 }, None, value, weight);
    value * weight
}

/// Light that the vertex itself emits towards the vertex before, which is at `previous` unless that is the camera.
#[inline]
pub(super) fn hit_light<O: PathObserver>(
    world: &World,
    walk: &Walk,
    previous: Option<Vec3>,
    vertex: &SurfaceVertex,
    depth: u32,
    observer: &mut O,
) -> Rgb {
    let Some(light) = world.lights.light_at(&vertex.point) else { return Rgb::ZERO };
    let emitted = world.lights.le(&vertex.point, vertex.wo);
    if emitted == Rgb::ZERO {
        return Rgb::ZERO;
    }
    let weight = match previous {
        Some(from) if !walk.is_delta => {
            power_heuristic(walk.pdf_w, world.lights.pdf_li(light, from, &vertex.point, walk.ray.d))
        }
        _ => 1.0,
    };
    let value = walk.beta * emitted;
    observer.contribution(Strategy { s: 0, t: depth + 1 }, None, value, weight);
    value * weight
}

/// Light from a light chosen and sampled for this vertex, and the number of rays that were traced.
#[inline(always)]
pub(super) fn sample_light<Q: RayQuery, O: PathObserver>(
    world: &World,
    query: &Q,
    walk: &Walk,
    vertex: &SurfaceVertex,
    depth: u32,
    (choice, u): (f64, Vec2),
    observer: &mut O,
) -> (Rgb, u32) {
    let Some(light) = world.lights.sample_li(&vertex.point, choice, u) else { return (Rgb::ZERO, 0) };
    let scattered = vertex.eval(light.wi, TransportMode::Radiance);
    if scattered == Rgb::ZERO {
        return (Rgb::ZERO, 0);
    }
    if query.occluded(&light.shadow_ray) {
        return (Rgb::ZERO, 1);
    }
    let weight = if light.is_delta {
        1.0
    } else {
        power_heuristic(light.pdf_w, vertex.pdf_w(light.wi, TransportMode::Radiance))
    };
    let value = walk.beta * scattered * light.radiance / light.pdf_w;
    observer.contribution(Strategy { s: 1, t: depth + 1 }, None, value, weight);
    (value * weight, 1)
}
