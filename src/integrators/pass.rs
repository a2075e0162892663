//! One pass, as integrators see it, and the memory they work in.

use glam::{IVec2, Vec2};

use super::Integrator;
use super::collect::TooManyStored;
use super::light_path::LightVertex;
use super::photon_map::{NearestHeap, PhotonMap, Photons};
use super::vpl::VplSet;
use crate::film::{SampledArea, Splat};
use crate::query::RayQuery;
use crate::sampling::Sampler;
use crate::sampling::sampler::mix;
use crate::transport::World;

/// All that the samples and light paths of a pass depend on, but for the integrator's parameters.
pub struct Pass<'a, 's, Q> {
    /// What is rendered.
    pub world: &'a World<'s>,
    /// Answers ray queries.
    pub query: &'a Q,
    /// Images with different seeds are independent.
    pub seed: u64,
    /// Which pass.
    pub index: u32,
    /// The pixels that a pass samples; splats elsewhere do not reach the film.
    pub area: SampledArea,
    /// Photons; none unless the integrator looks them up.
    pub photons: Photons,
    /// Virtual point lights; none unless the integrator gathers them.
    pub vpls: VplSet<'a>,
}

/// Set in the streams of light paths, and in none of a pixel: no row has this number.
const LIGHT_STREAM: u64 = 1 << 63;

/// Light paths that share a stream, stratified together; the sampler's sequence is that long.
const LIGHT_PATHS_PER_STREAM_LOG2: u32 = 16;

impl<'a, 's, Q: RayQuery> Pass<'a, 's, Q> {
    /// A pass, ready for its samples: traces its photons or virtual lights if the integrator needs them, on all threads.
    ///
    /// # Errors
    /// If there are too many photons or virtual lights.
    pub fn new(
        world: &'a World<'s>,
        query: &'a Q,
        integrator: Integrator,
        seed: u64,
        index: u32,
        area: SampledArea,
    ) -> Result<Self, TooManyStored> {
        let mut this = Self::empty(world, query, seed, index, area);
        match integrator {
            Integrator::PhotonMap(mapper) => this.photons = mapper.photons(&this)?,
            Integrator::VirtualLights(vpl) => this.vpls = vpl.lights(&this)?,
            Integrator::Backward(_) | Integrator::Forward(_) | Integrator::Bidirectional(_) => {}
        }
        Ok(this)
    }

    /// A pass, ready for its samples, with photons that were traced before.
    pub fn with_photons(
        world: &'a World<'s>,
        query: &'a Q,
        integrator: Integrator,
        seed: u64,
        index: u32,
        area: SampledArea,
        map: PhotonMap,
    ) -> Self {
        let mut this = Self::empty(world, query, seed, index, area);
        if let Integrator::PhotonMap(mapper) = integrator {
            this.photons = mapper.look_up(&this, map, 0);
        }
        this
    }

    /// A pass without photons or virtual lights.
    pub(crate) fn empty(
        world: &'a World<'s>,
        query: &'a Q,
        seed: u64,
        index: u32,
        area: SampledArea,
    ) -> Self {
        Self { world, query, seed, index, area, photons: Photons::none(), vpls: VplSet::default() }
    }
}

impl<Q> Pass<'_, '_, Q> {
    /// Number of light paths: as many as there are pixels in the sampled area. Each splat is divided by it.
    #[inline]
    pub fn light_paths(&self) -> u64 {
        u64::from(self.area.size.x) * u64::from(self.area.size.y)
    }

    /// The light path that goes with a pixel of the sampled area, in [0, `light_paths`). Within whole blocks of 256 pixels they are shuffled: neighbours in the light paths'
    /// sequence are alike in some ways, which showed as stripes when pixels took them in order.
    #[inline]
    pub fn slot(&self, pixel: IVec2) -> u64 {
        let at = (pixel - self.area.min).as_uvec2();
        let slot = u64::from(at.y) * u64::from(self.area.size.x) + u64::from(at.x);
        let block = slot >> 8;
        if (block + 1) << 8 > self.light_paths() {
            return slot;
        }
        let key = mix(self.seed ^ mix(u64::from(self.index) << 32 | block));
        block << 8 | u64::from(shuffled(slot as u8, key))
    }

    /// Random numbers of a pixel's camera sample.
    #[inline]
    pub fn pixel_sampler(&self, pixel: IVec2) -> Sampler {
        // Pixels beyond the film's border have negative coordinates; the bits tell them apart all the same.
        let stream = u64::from(pixel.y as u32) << 32 | u64::from(pixel.x as u32);
        Sampler::new(self.seed, stream, self.index)
    }

    /// Random numbers of the light path of a slot, of which each pass has `count`. Neighbours in slots are neighbours in a low-discrepancy sequence, so that light is spread
    /// evenly over the whole scene already within a pass.
    #[inline]
    pub fn light_sampler(&self, slot: u64, count: u64) -> Sampler {
        let path = u64::from(self.index) * count + slot;
        let index = path & ((1 << LIGHT_PATHS_PER_STREAM_LOG2) - 1);
        Sampler::new(self.seed, LIGHT_STREAM | path >> LIGHT_PATHS_PER_STREAM_LOG2, index as u32)
    }

    /// Whether a film position lies in the sampled area.
    #[inline]
    pub fn is_sampled(&self, film: Vec2) -> bool {
        let min = self.area.min.as_vec2();
        film.cmpge(min).all() && film.cmplt(min + self.area.size.as_vec2()).all()
    }
}

/// Where a number is in a permutation of 0 to 255 that depends on `key`.
#[inline]
fn shuffled(i: u8, key: u64) -> u8 {
    let [a, b, c, d, ..] = key.to_le_bytes();
    // Products with odd numbers and shifted sums have inverses.
    let i = (i ^ a).wrapping_mul(b | 1);
    let i = (i ^ i >> 4).wrapping_add(c).wrapping_mul(d | 1);
    i ^ i >> 3
}

/// Memory that one thread works in, used again for path after path.
#[derive(Debug, Default)]
pub struct Scratch<'w> {
    /// The present light path's vertices that can be connected.
    pub(super) light_vertices: Vec<LightVertex<'w>>,
    /// The photons that were found last.
    pub(super) nearest: NearestHeap,
    /// Splats of the present pass.
    pub splats: Vec<Splat>,
    /// Rays traced, closest-hit and occlusion.
    pub rays: u64,
}

#[cfg(test)]
mod tests {
    use super::{mix, shuffled};

    #[test]
    fn shuffling_leaves_nothing_out() {
        for key in (0..1000).map(mix) {
            let mut seen = [false; 256];
            (0..=255).for_each(|i| seen[usize::from(shuffled(i, key))] = true);
            assert_eq!(seen, [true; 256]);
        }
    }
}
