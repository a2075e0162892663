//! Depth maps of virtual point lights: how far light goes in each direction, found by rays once, instead of a shadow ray for each pixel and light.
//!
//! A map is a paraboloid (Brabec, Annen and Seidel 2002, "Shadow mapping for hemispherical and omnidirectional light sources"): direction d of the hemisphere
//! around the normal n goes to the place d.xy / (1 + d.n) of the unit disc. A hemisphere is one map and no choice of a face, and pixels beside each
//! other read texels beside each other. Lights on surfaces that transmit have a second map for the other side.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::query::{Ray, RayQuery};
use crate::scene::SurfacePoint;
use crate::transport::bsdf::Frame;

/// Bytes that all maps of a pass may take. Lights that are left without use rays.
const MAX_BYTES: usize = 4 << 30;

/// Number of a light that has no map.
pub(super) const NO_MAP: u32 = u32::MAX;

/// From here to its double, numbers are integers.
const MANTISSA: f32 = (1 << 23) as f32;

/// Where a map stands and looks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Viewpoint {
    /// The surface point of the light.
    pub(super) point: SurfacePoint,
    /// Unit axis of the hemisphere.
    pub(super) axis: Vec3,
}

/// The maps of a pass.
#[derive(Debug, Default)]
pub(super) struct ShadowMaps {
    resolution: u32,
    bias: f32,
    /// Distance to what is hit, infinite if nothing is; `resolution` squared for each map, by rows.
    depths: Vec<f32>,
}

impl ShadowMaps {
    /// How many maps of a resolution there may be.
    pub(super) fn capacity(resolution: u32) -> usize {
        MAX_BYTES / (4 * (resolution * resolution) as usize)
    }

    /// Maps of `resolution` squared texels. `bias` is in texels: by so much of a texel's width a surface may be behind what was hit, measured
    /// along the surface, and still be lit. Also returns the number of rays traced.
    pub(super) fn new<Q: RayQuery>(
        query: &Q,
        viewpoints: &[Viewpoint],
        resolution: u32,
        bias: f32,
    ) -> (Self, u64) {
        let texels = (resolution * resolution) as usize;
        let mut depths = vec![f32::INFINITY; viewpoints.len() * texels];
        let rays = depths
            .par_chunks_mut(texels)
            .zip(viewpoints)
            .map(|(map, viewpoint)| fill(query, viewpoint, resolution, map))
            .sum();
        (Self { resolution, bias, depths }, rays)
    }

    /// Where the map of a light shows the unit direction `d` from it, and the depth that it must show there if light is to get as far as `distance`, to a
    /// surface that it meets at an angle whose cosine is `cos`. `d` is on the side of `axis`, which is the map's.
    #[inline(always)]
    pub(super) fn place(&self, map: u32, axis: Vec3, d: Vec3, distance: f32, cos: f32) -> (u32, f32) {
        let local = Frame::from_z(axis).to_local(d);
        let resolution = self.resolution as f32;
        let stretch = 1.0 + local.z;
        let place = (local.truncate() / stretch + 1.0) * (0.5 * resolution);
        // To an integer by its place in the mantissa, which vector registers can do. NaN becomes 0.
        let texel =
            |x: f32| ((x - 0.5).max(0.0).min(resolution - 1.0) + MANTISSA).to_bits() - MANTISSA.to_bits();
        let in_map = texel(place.y) * self.resolution + texel(place.x);
        // A texel is 2 / resolution wide on the disc; the angle that this is, shrinks towards the rim.
        let texel_angle = 2.0 / resolution * stretch;
        (map * self.resolution * self.resolution + in_map, distance * (1.0 - self.bias * texel_angle / cos))
    }

    /// The depth at a [`place`](Self::place).
    #[inline(always)]
    pub(super) fn depth(&self, place: u32) -> f32 {
        self.depths[place as usize]
    }
}

/// Traces the rays of a map. Returns their number.
fn fill<Q: RayQuery>(query: &Q, viewpoint: &Viewpoint, resolution: u32, map: &mut [f32]) -> u64 {
    /// What is at the rim looks just above the horizon.
    const RIM: f32 = 0.9995;
    let frame = Frame::from_z(viewpoint.axis);
    let width = 2.0 / resolution as f32;
    let mut rays = 0;
    for (i, depth) in map.iter_mut().enumerate() {
        let texel = Vec2::new((i as u32 % resolution) as f32, (i as u32 / resolution) as f32);
        let center = (texel + 0.5) * width - 1.0;
        if center.length() > 1.0 + width {
            continue;
        }
        let place = center.clamp_length_max(RIM);
        let r2 = place.length_squared();
        let d = frame.to_world((2.0 * place).extend(1.0 - r2) / (1.0 + r2)).normalize();
        rays += 1;
        if let Some(hit) = query.intersect(&Ray::spawn(&viewpoint.point, d)) {
            *depth = hit.t;
        }
    }
    rays
}
