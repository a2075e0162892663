//! The photon record: 32 bytes.

use glam::{Vec2, Vec3};

use crate::scene::Rgb;

/// Greatest number of segments that a record can tell apart; longer paths are stored as of this length.
pub(super) const MAX_DEPTH: u32 = 127;

const DIRECTION_BITS: u32 = 16;
const NORMAL_BITS: u32 = 12;
const NORMAL_MASK: u32 = (1 << (2 * NORMAL_BITS)) - 1;
const SPECULAR_BIT: u32 = 1 << 31;

/// Power that arrives at a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Photon {
    /// World position.
    pub position: Vec3,
    /// Flux in W, already divided by the number of photons emitted.
    pub power: Rgb,
    /// Octahedral, 16 bits a coordinate: errs by less than 1e-4 radians.
    direction: u32,
    /// From the lowest bit: the geometric normal, octahedral in 2 x 12 bits; seven bits of depth; whether all events before were specular.
    normal_and_path: u32,
}

const _: () = assert!(size_of::<Photon>() == 32);

impl Photon {
    /// A photon that arrives from direction `wi` (unit, away from the surface) on a surface of geometric normal `ng`, after `depth` segments,
    /// with nothing but delta events before if `is_specular`.
    #[inline]
    pub fn new(position: Vec3, power: Rgb, wi: Vec3, ng: Vec3, depth: u32, is_specular: bool) -> Self {
        let path = depth.min(MAX_DEPTH) << (2 * NORMAL_BITS) | if is_specular { SPECULAR_BIT } else { 0 };
        let normal_and_path = encode(ng, NORMAL_BITS) | path;
        Self { position, power, direction: encode(wi, DIRECTION_BITS), normal_and_path }
    }

    /// The record as bytes, for files.
    pub(super) fn to_le_bytes(self) -> [u8; size_of::<Self>()] {
        let Self { position, power, direction, normal_and_path } = self;
        let floats = [position, power].map(|v| v.to_array().map(f32::to_bits));
        let words = floats.into_iter().flatten().chain([direction, normal_and_path]);
        let mut bytes = [0; size_of::<Self>()];
        for (place, word) in bytes.as_chunks_mut().0.iter_mut().zip(words) {
            *place = word.to_le_bytes();
        }
        bytes
    }

    /// The record that [`to_le_bytes`](Self::to_le_bytes) wrote; `None` if it is not finite, as no photon is.
    pub(super) fn from_le_bytes(bytes: &[u8; size_of::<Self>()]) -> Option<Self> {
        let word = |i: usize| u32::from_le_bytes(bytes.as_chunks().0[i]);
        let vector = |i| Vec3::from_array([i, i + 1, i + 2].map(|i| f32::from_bits(word(i))));
        let this =
            Self { position: vector(0), power: vector(3), direction: word(6), normal_and_path: word(7) };
        (this.position.is_finite() && this.power.is_finite()).then_some(this)
    }

    /// Unit direction that it came from, away from the surface.
    #[inline]
    pub fn wi(&self) -> Vec3 {
        decode(self.direction, DIRECTION_BITS)
    }

    /// Geometric normal where it arrived, to within 1e-3 radians.
    #[inline]
    pub fn ng(&self) -> Vec3 {
        decode(self.normal_and_path & NORMAL_MASK, NORMAL_BITS)
    }

    /// Segments from the light, at least 1; 127 for all that are longer.
    #[inline]
    pub fn depth(&self) -> u32 {
        self.normal_and_path >> (2 * NORMAL_BITS) & MAX_DEPTH
    }

    /// Whether it was scattered by delta lobes only, or not at all.
    #[inline]
    pub fn is_specular(&self) -> bool {
        self.normal_and_path & SPECULAR_BIT != 0
    }
}

/// A unit vector as a point of the square onto which the octahedron unfolds (Meyer et al. 2010, "On floating-point normal vectors").
#[inline]
fn encode(v: Vec3, bits: u32) -> u32 {
    let mut p = v.truncate() / v.abs().element_sum();
    if v.z < 0.0 {
        p = (1.0 - Vec2::new(p.y, p.x).abs()) * p.signum();
    }
    let last = ((1 << bits) - 1) as f32;
    let q = ((0.5 * p + 0.5) * last + 0.5).clamp(Vec2::ZERO, Vec2::splat(last)).as_uvec2();
    q.x | q.y << bits
}

#[inline]
fn decode(code: u32, bits: u32) -> Vec3 {
    let last = (1_u32 << bits) - 1;
    let p = Vec2::new((code & last) as f32, (code >> bits & last) as f32) * (2.0 / last as f32) - 1.0;
    let z = 1.0 - p.x.abs() - p.y.abs();
    let p = if z < 0.0 { (1.0 - Vec2::new(p.y, p.x).abs()) * p.signum() } else { p };
    p.extend(z).normalize()
}
