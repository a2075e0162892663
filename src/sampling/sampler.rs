//! The sampler: a number for each (seed, stream, index, dimension), and nothing else.
//!
//! A *stream* is a pixel or a light path slot; *index* counts its samples, one per pass. Within a stream the samples
//! over the passes are an Owen-scrambled Sobol' sequence (Burley 2020, "Practical hash-based Owen scrambling"),
//! four dimensions at a time; streams are scrambled independently of each other.
//!
//! The sequence of the `sobol_burley` crate has 2^16 points in 256 dimensions. A stream's samples beyond 2^16
//! continue with another scrambling of the same sequence; dimensions beyond 256 are independent hashes.

use glam::Vec2;

/// Largest f32 below 1.
pub const ONE_MINUS_EPSILON: f32 = 1.0 - f32::EPSILON / 2.0;

const SEQUENCE_LENGTH_LOG2: u32 = 16;

/// Mixes 64 bits (the finaliser of SplitMix64, Steele et al. 2014): every input bit affects every output bit.
#[inline]
pub fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// Draws the numbers of one sample in the order of its dimensions.
#[derive(Debug, Clone)]
pub struct Sampler {
    key: u64,
    index: u32,
    seed: u32,
    /// Dimension set that `block` was made from, plus 1; so the next one to draw.
    next_set: u32,
    block: [f32; 4],
    used: usize,
}

impl Sampler {
    /// The sampler of sample `index` of `stream`.
    #[inline]
    pub fn new(seed: u64, stream: u64, index: u32) -> Self {
        let epoch = u64::from(index >> SEQUENCE_LENGTH_LOG2);
        let stream_key = mix(mix(seed.wrapping_add(0x9e37_79b9_7f4a_7c15)) ^ stream.wrapping_mul(0xd134_2543_de82_ef95));
        let key = mix(stream_key.wrapping_add(epoch));
        Self {
            key,
            index: index & ((1 << SEQUENCE_LENGTH_LOG2) - 1),
            seed: (key >> 32) as u32,
            next_set: 0,
            block: [0.0; 4],
            used: 4,
        }
    }

    #[inline]
    fn refill(&mut self) {
        self.block = if self.next_set < sobol_burley::NUM_DIMENSION_SETS_4D {
            sobol_burley::sample_4d(self.index, self.next_set, self.seed)
        } else {
            let x = mix(self.key ^ (u64::from(self.index) << 32 | u64::from(self.next_set)));
            let y = mix(x ^ self.key.rotate_left(17));
            [x as u32, (x >> 32) as u32, y as u32, (y >> 32) as u32].map(|b| (b >> 8) as f32 * (1.0 / 16_777_216.0))
        };
        self.next_set += 1;
        self.used = 0;
    }

    /// The next four numbers in [0, 1), stratified together. Numbers left over from an earlier block are skipped.
    #[inline]
    pub fn next_4d(&mut self) -> [f32; 4] {
        self.refill();
        self.used = 4;
        self.block
    }

    /// The next number in [0, 1).
    #[inline]
    pub fn next_1d(&mut self) -> f32 {
        if self.used == 4 {
            self.refill();
        }
        self.used += 1;
        self.block[self.used - 1]
    }

    /// The next two numbers in [0, 1), from the same block of four.
    #[inline]
    pub fn next_2d(&mut self) -> Vec2 {
        if self.used > 2 {
            self.refill();
        }
        self.used += 2;
        Vec2::new(self.block[self.used - 2], self.block[self.used - 1])
    }
}
