//! The sampler: four numbers for each (seed, stream, index, dimension set), and nothing else.
//!
//! A *stream* is a pixel or a light path slot; *index* counts its samples, one per pass. Within a stream, the samples
//! over the passes are an Owen-scrambled Sobol' sequence (Burley 2020, "Practical hash-based Owen scrambling"),
//! four dimensions at a time; streams are scrambled independently of each other.
//!
//! The crate's own `sample_4d` also shuffles the indices, which serves to use few dimensions many times over; here each dimension
//! is used once, so that is left out: points in their own order cost half as much, since all pixels of a pass take the same one.
//!
//! The sequence of the `sobol_burley` crate has 2^16 points in 256 dimensions. A stream's samples beyond 2^16
//! continue with another scrambling of the same sequence; dimensions beyond 256 are independent hashes.

use sobol_burley::NUM_DIMENSION_SETS_4D;
use sobol_burley::parts::{Int4, owen_scramble_int4_rev, sobol_int4_rev};

const SEQUENCE_LENGTH_LOG2: u32 = 16;

/// 2^64 over the golden ratio, the increment of SplitMix64.
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// Mixes 64 bits (the finaliser of SplitMix64, Steele et al. 2014): every input bit affects every output bit.
#[inline]
pub fn mix(mut x: u64) -> u64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ (x >> 31)
}

/// The numbers of one sample.
#[derive(Debug, Clone, Copy)]
pub struct Sampler {
    key: u64,
    index: u32,
}

impl Sampler {
    /// The sampler of sample `index` of `stream`.
    #[inline]
    pub fn new(seed: u64, stream: u64, index: u32) -> Self {
        let epoch = u64::from(index >> SEQUENCE_LENGTH_LOG2);
        let seed = mix(seed.wrapping_add(GOLDEN));
        let stream = mix(seed ^ stream.wrapping_mul(0xd134_2543_de82_ef95));
        Self { key: mix(stream.wrapping_add(epoch)), index: index & ((1 << SEQUENCE_LENGTH_LOG2) - 1) }
    }

    /// Dimensions `4 set .. 4 set + 4`, each in [0, 1) and stratified together over the indices of the stream.
    #[inline]
    pub fn block(&self, set: u32) -> [f32; 4] {
        self.bits(set).to_f32_norm()
    }

    /// The same with all 32 bits of the first, for a choice among many: f32 has 23 of them, which are 4 for each of two million lights.
    #[inline]
    pub fn choices(&self, set: u32) -> (f64, [f32; 3]) {
        let bits = self.bits(set);
        let [first, ..] = <[u32; 4]>::from(bits);
        let [_, a, b, c] = bits.to_f32_norm();
        (f64::from(first) * (1.0 / 4_294_967_296.0), [a, b, c])
    }

    /// The numbers as fractions of 2^32.
    #[inline]
    fn bits(&self, set: u32) -> Int4 {
        if set < NUM_DIMENSION_SETS_4D {
            let sobol = sobol_int4_rev(self.index.reverse_bits(), set);
            // A scramble for each dimension of each stream.
            let first = mix(self.key.wrapping_add(u64::from(2 * set).wrapping_mul(GOLDEN)));
            let second = mix(self.key.wrapping_add(u64::from(2 * set + 1).wrapping_mul(GOLDEN)));
            let scramble =
                Int4::from([first as u32, (first >> 32) as u32, second as u32, (second >> 32) as u32]);
            return owen_scramble_int4_rev(sobol, scramble).reverse_bits();
        }
        let x = mix(self.key ^ (u64::from(self.index) << 32 | u64::from(set)));
        let y = mix(x ^ self.key.rotate_left(17));
        Int4::from([x, x >> 32, y, y >> 32].map(|bits| bits as u32))
    }
}
