//! Diffuse virtual lights, eight side by side, for a diffuse surface that looks at all of them: most of the work of a pass, and the same
//! few operations for each light. What is left of it, other surfaces, other lights and samples drawn from the tree, goes light by light in
//! [`gather`](super::gather).

use glam::Vec3;

use super::deposit::Vpl;
use super::shadow_map::{NO_MAP, ShadowMaps};
use crate::scene::Rgb;

/// Lights in a block: as many f32 as a vector register holds.
pub(super) const LANES: usize = 8;

/// A number for each light.
type Lanes = [f32; LANES];

/// Vectors, one for each light, by coordinates.
#[derive(Debug, Clone, Default)]
struct Vectors([Lanes; 3]);

impl Vectors {
    #[inline(always)]
    fn set(&mut self, lane: usize, v: Vec3) {
        for (lanes, coordinate) in self.0.iter_mut().zip(v.to_array()) {
            lanes[lane] = coordinate;
        }
    }

    #[inline(always)]
    fn get(&self, lane: usize) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|axis| self.0[axis][lane]))
    }
}

/// Up to eight diffuse lights. Lanes that are left over hold lights with neither normals nor power, which nothing sees.
#[derive(Debug, Clone, Default)]
pub(super) struct Block {
    p: Vectors,
    ng: Vectors,
    ns: Vectors,
    rgb: Vectors,
    depth: [u32; LANES],
    map: [u32; LANES],
    /// Whether each of the lights has a map.
    is_mapped: bool,
}

/// A diffuse surface point, with both normals on the side that it is looked at from.
#[derive(Debug, Clone, Copy)]
pub(super) struct DiffuseReceiver {
    /// World position.
    pub(super) p: Vec3,
    /// Geometric normal.
    pub(super) ng: Vec3,
    /// Shading normal.
    pub(super) ns: Vec3,
}

/// How much of the light of each of a block a receiver gets, in the light's units, and how that light travels.
#[derive(Debug, Default)]
pub(super) struct Seen {
    /// Clamped geometry term with the receiver's shading normal; 0 where no light goes.
    pub(super) share: Lanes,
    /// Unit direction from the light.
    d: Vectors,
    distance: Lanes,
    /// Of the angle at the receiver, by its geometric normal.
    cos: Lanes,
}

impl Block {
    /// Packs up to eight lights, all diffuse.
    pub(super) fn new(lights: &[Vpl]) -> Self {
        let mut this = Self { is_mapped: lights.iter().all(|light| light.map != NO_MAP), ..Self::default() };
        for (lane, light) in lights.iter().enumerate() {
            this.p.set(lane, light.position());
            this.ng.set(lane, light.ng);
            this.ns.set(lane, light.ns);
            this.rgb.set(lane, light.rgb);
            this.depth[lane] = light.depth;
            this.map[lane] = if this.is_mapped { light.map } else { 0 };
        }
        this
    }

    /// Whether [`hide`](Self::hide) can tell which lights are hidden.
    pub(super) fn is_mapped(&self) -> bool {
        self.is_mapped
    }

    /// What a receiver gets if nothing is in between. `clamp` bounds the geometry term; lights of paths longer than `max_depth` do not count.
    #[inline]
    pub(super) fn look(&self, to: &DiffuseReceiver, clamp: f32, max_depth: u32) -> Seen {
        let mut seen = Seen::default();
        for lane in 0..LANES {
            let line = to.p - self.p.get(lane);
            let distance_squared = line.length_squared();
            let distance = distance_squared.sqrt();
            let d = line / distance;
            let (cos_x, shading_x) = (-d.dot(to.ng), -d.dot(to.ns));
            let (cos_y, shading_y) = (d.dot(self.ng.get(lane)), d.dot(self.ns.get(lane)));
            // No `&&`: nothing here may branch. NaN, of a distance of 0, is not above 0.
            let least = cos_x.min(shading_x).min(cos_y.min(shading_y));
            let term = (cos_x * cos_y / distance_squared).min(clamp) * (shading_x / cos_x);
            let lit = if least > 0.0 { term } else { 0.0 };
            seen.share[lane] = if self.depth[lane] <= max_depth { lit } else { 0.0 };
            seen.d.set(lane, d);
            seen.distance[lane] = distance;
            seen.cos[lane] = cos_x;
        }
        seen
    }

    /// Takes away the share of lights that are hidden, as their maps have it.
    #[inline]
    pub(super) fn hide(&self, maps: &ShadowMaps, seen: &mut Seen) {
        let (mut texels, mut limits) = ([0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            (texels[lane], limits[lane]) = maps.place(
                self.map[lane],
                self.ng.get(lane),
                seen.d.get(lane),
                seen.distance[lane],
                seen.cos[lane],
            );
        }
        let depths = texels.map(|texel| maps.depth(texel));
        for lane in 0..LANES {
            seen.share[lane] = if limits[lane] <= depths[lane] { seen.share[lane] } else { 0.0 };
        }
    }

    /// Adds what the lights send to a sum for each lane.
    #[inline]
    pub(super) fn add(&self, seen: &Seen, sums: &mut Sums) {
        for (sums, rgb) in sums.0.0.iter_mut().zip(&self.rgb.0) {
            for lane in 0..LANES {
                sums[lane] += rgb[lane] * seen.share[lane];
            }
        }
    }
}

/// Irradiance so far, from each lane.
#[derive(Debug, Default)]
pub(super) struct Sums(Vectors);

impl Sums {
    /// Irradiance from all.
    pub(super) fn total(&self) -> Rgb {
        (0..LANES).map(|lane| self.0.get(lane)).sum()
    }
}
