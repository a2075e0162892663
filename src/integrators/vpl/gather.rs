//! Phase 2: paths from the camera, and what the virtual lights of a pass send to the surfaces that they meet.

use glam::{Vec2, Vec3};

use super::block::{DiffuseReceiver, LANES, Sums};
use super::deposit::{DIFFUSE, Vpl, VplSet};
use super::shadow_map::NO_MAP;
use super::tree::Receiver;
use super::{Direct, VirtualLights, Visibility};
use crate::integrators::PathObserver;
use crate::integrators::backward::{
    CHOICE_SET, DIRECTION_SET, SETS_PER_VERTEX, hit_environment, hit_light, sample_light,
};
use crate::integrators::pass::{Pass, Scratch};
use crate::query::{Ray, RayQuery};
use crate::sampling::Sampler;
use crate::scene::{Rgb, SurfacePoint};
use crate::transport::bsdf::TransportMode;
use crate::transport::vertex::SurfaceVertex;
use crate::transport::walk::Walk;

impl VplSet<'_> {
    /// Share of the light between two surface elements that the sum over lights keeps, given both cosines and the squared distance. The rest is
    /// what compensation brings back.
    #[inline]
    fn kept(&self, cos_x: f32, cos_y: f32, distance_squared: f32) -> f32 {
        let g = cos_x * cos_y / distance_squared;
        // Of NaN and a number, min takes the number: nothing is lost of no light, and nothing if there is no limit.
        (self.clamp / g).min(1.0)
    }

    /// What [`kept`](Self::kept) leaves of the light from `y` to `x`.
    fn lost(&self, x: &SurfacePoint, y: &SurfacePoint) -> f32 {
        let line = y.p - x.p;
        let distance_squared = line.length_squared();
        let d = line / distance_squared.sqrt();
        1.0 - self.kept(x.ng.dot(d).abs(), y.ng.dot(d).abs(), distance_squared)
    }
}

/// A vertex that looks at many lights.
struct Seer<'v, 'w> {
    vertex: &'v SurfaceVertex<'w>,
    /// If it is diffuse, where it stands, and its BSDF.
    diffuse: Option<(DiffuseReceiver, Rgb)>,
}

impl<'v, 'w> Seer<'v, 'w> {
    fn new(vertex: &'v SurfaceVertex<'w>) -> Self {
        let (ng, ns) = (vertex.point.ng, vertex.point.ns);
        let (by_ng, by_ns) = (vertex.wo.dot(ng), vertex.wo.dot(ns));
        let side = 1.0_f32.copysign(by_ns);
        let reflectance = vertex.bsdf.diffuse_reflectance().filter(|_| by_ng * by_ns > 0.0);
        let receiver = DiffuseReceiver { p: vertex.point.p, ng: ng * side, ns: ns * side };
        let diffuse = reflectance.map(|rho| (receiver, rho * std::f32::consts::FRAC_1_PI));
        Self { vertex, diffuse }
    }

    /// Whether light along `line` is scattered at all, as far as that is soon told.
    #[inline]
    fn may_see(&self, line: Vec3) -> bool {
        self.diffuse.is_none_or(|(to, _)| line.dot(to.ng) > 0.0 && line.dot(to.ns) > 0.0)
    }

    /// BSDF times cosine, where [`may_see`](Self::may_see) says yes.
    #[inline]
    fn eval(&self, wi: Vec3) -> Rgb {
        match self.diffuse {
            Some((to, f)) => f * wi.dot(to.ns),
            None => self.vertex.eval(wi, TransportMode::Radiance),
        }
    }
}

/// Looks at the lights of a pass for one pixel.
struct Gather<'a, 'w, 's, Q> {
    vpl: &'a VirtualLights,
    pass: &'a Pass<'w, 's, Q>,
    rays: u64,
}

impl<Q: RayQuery> Gather<'_, '_, '_, Q> {
    /// Radiance that a vertex scatters of what all virtual lights send, or an estimate from some. `max_depth` bounds the segments of a path from the
    /// light to the virtual one.
    fn all(&mut self, vertex: &SurfaceVertex, max_depth: u32, u: f32) -> Rgb {
        let set = &self.pass.vpls;
        let seer = Seer::new(vertex);
        let mut sum = Rgb::ZERO;
        let Some(samples) = self.vpl.samples else {
            let mut others = &set.lights[..];
            if let Some((to, f)) = &seer.diffuse {
                sum += *f * self.blocks(to, vertex, max_depth);
                others = &set.lights[set.diffuse().len()..];
            }
            for light in others {
                sum += self.one(light, &seer, max_depth);
            }
            for start in 0..set.starts.len() {
                sum += self.start(start, vertex);
            }
            return sum;
        };
        let samples_inverse = 1.0 / f64::from(samples);
        if let Some(tree) = &set.tree {
            let normal = vertex.point.ng * 1.0_f32.copysign(vertex.point.ng.dot(vertex.wo));
            let to = Receiver { p: vertex.point.p, normal };
            for i in 0..samples {
                let u = (f64::from(i) + f64::from(u)) * samples_inverse;
                if let Some((index, probability)) = tree.sample(&to, u) {
                    sum += self.one(&set.lights[index as usize], &seer, max_depth) / probability;
                }
            }
            sum *= samples_inverse as f32;
        }
        if !set.starts.is_empty() {
            // Each stands for the same power.
            let mut direct = Rgb::ZERO;
            for i in 0..samples {
                let place = (f64::from(i) + f64::from(u)) * samples_inverse * set.starts.len() as f64;
                direct += self.start((place as usize).min(set.starts.len() - 1), vertex);
            }
            sum += direct * (set.starts.len() as f64 * samples_inverse) as f32;
        }
        sum
    }

    /// Irradiance on a diffuse vertex by all diffuse lights.
    fn blocks(&mut self, to: &DiffuseReceiver, vertex: &SurfaceVertex, max_depth: u32) -> Rgb {
        let set = &self.pass.vpls;
        let mut sums = Sums::default();
        for (block, lights) in set.blocks.iter().zip(set.diffuse().chunks(LANES)) {
            let mut seen = block.look(to, set.clamp, max_depth);
            match self.vpl.visibility {
                Visibility::None => {}
                Visibility::ShadowMap { .. } if block.is_mapped() => block.hide(&set.maps, &mut seen),
                Visibility::Rays | Visibility::ShadowMap { .. } => {
                    for (light, share) in lights.iter().zip(&mut seen.share) {
                        if *share > 0.0 && !self.is_seen(light, &vertex.point) {
                            *share = 0.0;
                        }
                    }
                }
            }
            block.add(&seen, &mut sums);
        }
        sums.total()
    }

    /// Whether nothing is between a light and a point, asked by a ray.
    #[inline]
    fn is_seen(&mut self, light: &Vpl, point: &SurfacePoint) -> bool {
        self.rays += 1;
        Ray::spawn_between(point, &light.point()).is_some_and(|ray| !self.pass.query.occluded(&ray))
    }

    /// What a vertex scatters of a virtual light.
    #[inline]
    fn one(&mut self, light: &Vpl, seer: &Seer, max_depth: u32) -> Rgb {
        let vertex = seer.vertex;
        let line = light.position() - vertex.point.p;
        let distance_squared = line.length_squared();
        let is_behind = light.vertex == DIFFUSE && (line.dot(light.ng) >= 0.0 || line.dot(light.ns) >= 0.0);
        if is_behind || light.depth > max_depth || distance_squared <= 0.0 || !seer.may_see(line) {
            return Rgb::ZERO;
        }
        let distance = distance_squared.sqrt();
        let wi = line / distance;
        let scattered = seer.eval(wi);
        if scattered == Rgb::ZERO {
            return Rgb::ZERO;
        }
        let cos_x = vertex.cos(wi);
        let cos_y = light.ng.dot(wi).abs();
        let sent = match light.vertex {
            DIFFUSE => light.rgb * cos_y,
            number => {
                let end = &self.pass.vpls.vertices[number as usize];
                light.rgb * end.eval(-wi, TransportMode::Importance)
            }
        };
        let kept = self.pass.vpls.kept(cos_x, cos_y, distance_squared);
        let value = sent * scattered * (kept / distance_squared);
        if value == Rgb::ZERO || !self.is_lit(light, &vertex.point, (wi, distance, cos_x)) {
            Rgb::ZERO
        } else {
            value
        }
    }

    /// Whether light gets from a virtual light to a point, which sees it in direction `wi`.
    #[inline]
    fn is_lit(&mut self, light: &Vpl, point: &SurfacePoint, (wi, distance, cos): (Vec3, f32, f32)) -> bool {
        match self.vpl.visibility {
            Visibility::None => true,
            Visibility::ShadowMap { .. } if light.map != NO_MAP => {
                let is_front = light.vertex == DIFFUSE || light.ng.dot(wi) < 0.0;
                let (map, axis) = if is_front { (light.map, light.ng) } else { (light.map + 1, -light.ng) };
                let maps = &self.pass.vpls.maps;
                let (place, limit) = maps.place(map, axis, -wi, distance, cos);
                limit <= maps.depth(place)
            }
            Visibility::Rays | Visibility::ShadowMap { .. } => self.is_seen(light, point),
        }
    }

    /// What a vertex scatters of the start of a light path. Its shadows are made by rays, as there are fewer of them and most are soft.
    fn start(&mut self, start: usize, vertex: &SurfaceVertex) -> Rgb {
        let set = &self.pass.vpls;
        let start = &set.starts[start];
        let Some(light) = self.pass.world.lights.li_of_start(start, &vertex.point) else { return Rgb::ZERO };
        let scattered = vertex.eval(light.wi, TransportMode::Radiance);
        if scattered == Rgb::ZERO {
            return Rgb::ZERO;
        }
        if self.vpl.visibility != Visibility::None {
            self.rays += 1;
            if self.pass.query.occluded(&light.shadow_ray) {
                return Rgb::ZERO;
            }
        }
        let kept = start.point.as_ref().map_or(1.0, |point| 1.0 - set.lost(&vertex.point, point));
        scattered * light.radiance * (kept / light.pdf_w / self.vpl.count as f32)
    }
}

impl VirtualLights {
    /// Radiance that arrives along `camera_ray`.
    ///
    /// The walk is that of the backward path tracer. What a vertex scatters has a *share*: all of it where the path has come from the camera, by a
    /// delta lobe or from a narrow one, since no virtual light connects across those; and otherwise what the clamp took from the light between this vertex and the one
    /// before (all, if this one is specular or narrow: there are no virtual lights on it), or nothing if that is not to be compensated.
    pub fn sample<'w, Q: RayQuery, O: PathObserver>(
        &self,
        pass: &Pass<'w, '_, Q>,
        camera_ray: Ray,
        sampler: &Sampler,
        scratch: &mut Scratch<'w>,
        observer: &mut O,
    ) -> Rgb {
        let Pass { world, query, .. } = *pass;
        let max_depth = self.length.limit();
        let mut gather = Gather { vpl: self, pass, rays: 0 };
        let mut radiance = Rgb::ZERO;
        let mut walk = Walk::new(TransportMode::Radiance, camera_ray, Rgb::ONE);
        let mut previous: Option<Vec3> = None;
        // The vertex before, if virtual lights were looked at from there.
        let mut gathered: Option<SurfacePoint> = None;
        for depth in 1..=max_depth {
            gather.rays += 1;
            let Some(hit) = query.intersect(&walk.ray) else {
                observer.segment(&walk, depth, None);
                if self.direct == Direct::Nee || gathered.is_none() {
                    radiance += hit_environment(world, &walk, depth, observer);
                }
                break;
            };
            let vertex = SurfaceVertex::new(&world.materials, &hit, &walk.ray);
            observer.segment(&walk, depth, Some(&vertex));
            let taken = match &gathered {
                Some(from) if self.compensate => pass.vpls.lost(from, &vertex.point),
                Some(_) => 0.0,
                None => 1.0,
            };
            radiance += if self.direct == Direct::Vpl && gathered.is_some() {
                // The lights are virtual ones too. Without the place before, nothing else could have found them.
                taken * hit_light(world, &walk, None, &vertex, depth, observer)
            } else {
                hit_light(world, &walk, previous, &vertex, depth, observer)
            };
            let is_narrow = vertex.bsdf.is_narrow(self.roughness);
            let share = if is_narrow && self.compensate { 1.0 } else { taken };
            if depth == max_depth || (share == 0.0 && !self.compensate) {
                break;
            }
            let set = SETS_PER_VERTEX * (depth - 1);
            let [u, light_u, v, light_v] = sampler.block(set + DIRECTION_SET);
            let (light, [lobe, roulette, virtual_u]) = sampler.choices(set + CHOICE_SET);
            if !vertex.bsdf.is_delta() && share > 0.0 {
                let part = Walk { beta: walk.beta * share, ..walk };
                if self.direct == Direct::Nee || is_narrow {
                    let u = (light, Vec2::new(light_u, light_v));
                    let (lit, rays) = sample_light(world, query, &part, &vertex, depth, u, observer);
                    radiance += lit;
                    gather.rays += u64::from(rays);
                }
                if !is_narrow {
                    // One segment leads from here to the virtual light.
                    radiance += part.beta * gather.all(&vertex, max_depth - depth - 1, virtual_u);
                }
            }
            let Some(scatter) = walk.scatter(&vertex, [lobe, u, v]) else { break };
            if !scatter.is_delta {
                walk.beta *= share;
            }
            let may_end = depth >= self.length.rr_depth || share < 1.0;
            if walk.beta == Rgb::ZERO || (may_end && !walk.survives(roulette, Walk::MAX_SURVIVAL)) {
                break;
            }
            previous = Some(vertex.point.p);
            gathered = (!is_narrow && !scatter.is_delta).then_some(vertex.point);
        }
        scratch.rays += gather.rays;
        radiance
    }
}
