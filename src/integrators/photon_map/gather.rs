//! Phase 2: paths from the camera, and the radiance that photons make where they end.

use glam::Vec2;

use super::super::pass::{Pass, Scratch};
use super::super::{Backward, Caustics, PathObserver};
use super::map::Site;
use super::photon::Photon;
use super::trace::{Disc, Photons};
use super::{Direct, Mode, PhotonMapper};
use crate::query::{Ray, RayQuery};
use crate::sampling::Sampler;
use crate::scene::Rgb;
use crate::transport::bsdf::TransportMode;
use crate::transport::vertex::SurfaceVertex;
use crate::transport::walk::Walk;

/// Dimension sets of the sampler: set 0 belongs to film and lens, then each vertex takes two.
const DIRECTION_SET: u32 = 1;
const CHOICE_SET: u32 = 2;
const SETS_PER_VERTEX: u32 = 2;

/// The sets of a ray of final gathering are its own.
const SETS_PER_GATHER_RAY: u32 = 1 << 14;

/// Least cosine between the normals of photon and surface. Rooms have corners, meshes bend by less.
const MIN_NORMAL_COS: f32 = 0.8;

/// The photons that an estimate counts.
#[derive(Debug, Clone, Copy)]
struct Wanted {
    /// Least number of segments from the light.
    min_depth: u32,
    /// Greatest number of segments from the light.
    max_depth: u32,
    /// Only those that came by delta lobes alone.
    is_specular: bool,
}

impl Wanted {
    fn includes(&self, photon: &Photon) -> bool {
        let depth = photon.depth();
        depth >= self.min_depth && depth <= self.max_depth && (photon.is_specular() || !self.is_specular)
    }
}

impl Photons {
    /// Reflected radiance at a vertex by the wanted photons, towards where the path came from.
    fn radiance(&self, vertex: &SurfaceVertex, wanted: Wanted, scratch: &mut Scratch) -> Rgb {
        let site = Site { p: vertex.point.p, ng: vertex.point.ng };
        let accepts = |photon: &Photon| wanted.includes(photon) && photon.ng().dot(site.ng) >= MIN_NORMAL_COS;
        let mut sum = Rgb::ZERO;
        let mut add = |photon: &Photon, x: f32| {
            sum += vertex.bsdf_value(photon.wi()) * photon.power * self.filter.density(x);
        };
        match self.disc {
            Disc::Radius { radius_squared } => {
                self.map.within(&site, radius_squared, accepts, |photon, distance_squared| {
                    add(photon, distance_squared / radius_squared);
                });
                sum / radius_squared
            }
            Disc::Nearest { k, radius_squared: limit } => {
                // The photons nearer than the one after the k nearest are as if strewn over a disc of that radius (of Poisson
                // points, k / (pi r^2) with the r of the k-th itself would be too much by k / (k - 1)). Stratified photons are more even than
                // that, which leaves up to 1 / (2 k) too little with the constant filter.
                let heap = &mut scratch.nearest;
                self.map.nearest(&site, k + 1, limit, accepts, heap);
                let farthest = if heap.len() > k { heap.pop() } else { None };
                // If it lies at the site itself, as all others do, the density is infinite, and the sample is dropped as such.
                let radius_squared =
                    farthest.map_or(limit, |(bits, _)| f32::from_bits(bits)).max(f32::MIN_POSITIVE);
                for &(bits, index) in heap.iter() {
                    add(&self.map.photons()[index as usize], f32::from_bits(bits) / radius_squared);
                }
                if heap.is_empty() { Rgb::ZERO } else { sum / radius_squared }
            }
        }
    }
}

/// Caustics of a pass's photons for the backward path tracer.
struct CausticMap<'a, 'w> {
    photons: &'a Photons,
    max_depth: u32,
    scratch: &'a mut Scratch<'w>,
}

impl Caustics for CausticMap<'_, '_> {
    const BY_PATHS: bool = false;

    fn radiance(&mut self, vertex: &SurfaceVertex, depth: u32) -> Rgb {
        let wanted = Wanted { min_depth: 2, max_depth: self.max_depth - depth, is_specular: true };
        self.photons.radiance(vertex, wanted, self.scratch)
    }
}

impl PhotonMapper {
    /// Radiance that arrives along `camera_ray`.
    pub fn sample<Q: RayQuery, O: PathObserver>(
        &self,
        pass: &Pass<Q>,
        camera_ray: Ray,
        sampler: &Sampler,
        scratch: &mut Scratch,
        observer: &mut O,
    ) -> Rgb {
        match self.mode {
            Mode::Full => {
                let walk = Walk::new(TransportMode::Radiance, camera_ray, Rgb::ONE);
                self.walk(pass, walk, sampler, scratch, observer)
            }
            Mode::Caustic => {
                let path = Backward { length: self.length, hide_emitters: false };
                let max_depth = self.length.limit();
                let mut caustics = CausticMap { photons: &pass.photons, max_depth, scratch };
                let (radiance, rays) =
                    path.walk(pass.world, pass.query, camera_ray, sampler, &mut caustics, observer);
                scratch.rays += u64::from(rays);
                radiance
            }
        }
    }

    /// Follows a path from the camera through delta lobes and adds up what it meets.
    fn walk<Q: RayQuery, O: PathObserver>(
        &self,
        pass: &Pass<Q>,
        mut walk: Walk,
        sampler: &Sampler,
        scratch: &mut Scratch,
        observer: &mut O,
    ) -> Rgb {
        let Pass { world, query, .. } = *pass;
        let max_depth = self.length.limit();
        let mut radiance = Rgb::ZERO;
        for depth in 1..=max_depth {
            scratch.rays += 1;
            let Some(hit) = query.intersect(&walk.ray) else {
                observer.segment(&walk, depth, None);
                radiance += walk.beta * world.lights.le_environment(walk.ray.d);
                break;
            };
            let vertex = SurfaceVertex::new(&world.materials, &hit, &walk.ray);
            observer.segment(&walk, depth, Some(&vertex));
            radiance += walk.beta * world.lights.le(&vertex.point, vertex.wo);
            if depth == max_depth {
                break;
            }
            let set = SETS_PER_VERTEX * (depth - 1);
            let [u, light_u, v, light_v] = sampler.block(set + DIRECTION_SET);
            let (light, [lobe, roulette, _]) = sampler.choices(set + CHOICE_SET);
            if !vertex.bsdf.is_delta() {
                let light = (light, Vec2::new(light_u, light_v));
                radiance += walk.beta * self.reflected(pass, &vertex, depth, (light, sampler), scratch);
            }
            // Of a surface that is smooth in part, the smooth part goes on.
            let scatter = walk.scatter(&vertex, [lobe, u, v]);
            if scatter.is_none_or(|scatter| !scatter.is_delta)
                || (depth >= self.length.rr_depth && !walk.survives(roulette, Walk::MAX_SURVIVAL))
            {
                break;
            }
        }
        radiance
    }

    /// What a vertex scatters by lobes that are not delta. `depth` segments lead to it.
    fn reflected<'a, Q: RayQuery>(
        &self,
        pass: &Pass<'a, '_, Q>,
        vertex: &SurfaceVertex<'a>,
        depth: u32,
        ((choice, light_u), sampler): ((f64, Vec2), &Sampler),
        scratch: &mut Scratch,
    ) -> Rgb {
        let max_depth = self.length.limit() - depth;
        let by_nee = self.direct == Direct::Nee;
        let is_gathered = self.final_gather > 0;
        let wanted = Wanted { min_depth: 1 + u32::from(by_nee), max_depth, is_specular: is_gathered };
        let mut radiance = pass.photons.radiance(vertex, wanted, scratch);
        if by_nee && let Some(light) = pass.world.lights.sample_li(&vertex.point, choice, light_u) {
            let scattered = vertex.eval(light.wi, TransportMode::Radiance);
            if scattered != Rgb::ZERO {
                scratch.rays += 1;
                if !pass.query.occluded(&light.shadow_ray) {
                    radiance += scattered * light.radiance / light.pdf_w;
                }
            }
        }
        let indirect: Rgb = (0..self.final_gather)
            .map(|ray| self.gather(pass, vertex, depth, (sampler, SETS_PER_GATHER_RAY * (ray + 1)), scratch))
            .sum();
        if is_gathered { radiance + indirect / self.final_gather as f32 } else { radiance }
    }

    /// A ray of final gathering, which goes on through delta lobes: the light that it brings from the next surface that is not specular.
    /// Light that comes without such a surface is direct light or a caustic, which have been counted.
    fn gather<'a, Q: RayQuery>(
        &self,
        pass: &Pass<'a, '_, Q>,
        vertex: &SurfaceVertex<'a>,
        first_depth: u32,
        (sampler, first_set): (&Sampler, u32),
        scratch: &mut Scratch,
    ) -> Rgb {
        let max_depth = self.length.limit();
        // The first event is the surface's own, and delta lobes are followed elsewhere.
        let mut walk = Walk::new(TransportMode::Radiance, Ray::new(vertex.point.p, -vertex.wo), Rgb::ONE);
        let mut vertex = *vertex;
        let mut radiance = Rgb::ZERO;
        for depth in first_depth + 1..max_depth {
            let set = first_set + SETS_PER_VERTEX * (depth - first_depth);
            let [u, v, lobe, roulette] = sampler.block(set);
            let Some(scatter) = walk.scatter(&vertex, [lobe, u, v]) else { break };
            let is_first = depth == first_depth + 1;
            if scatter.is_delta == is_first
                || (depth > self.length.rr_depth && !walk.survives(roulette, Walk::MAX_SURVIVAL))
            {
                break;
            }
            scratch.rays += 1;
            let Some(hit) = pass.query.intersect(&walk.ray) else { break };
            vertex = SurfaceVertex::new(&pass.world.materials, &hit, &walk.ray);
            if !vertex.bsdf.is_delta() {
                let wanted = Wanted { min_depth: 1, max_depth: max_depth - depth, is_specular: false };
                radiance += walk.beta * pass.photons.radiance(&vertex, wanted, scratch);
            }
        }
        radiance
    }
}
