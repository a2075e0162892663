//! The account of what was not added.

use super::samples::{PassSamples, Splat};
use crate::scene::Rgb;
use glam::IVec2;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

/// How many of the dropped contributions are reported with their pixel and pass.
pub(super) const MAX_EXAMPLES: usize = 8;

/// Contributions that were left out of the sums, and sums that left their range.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Dropped {
    /// Camera samples whose radiance was NaN, infinite or beyond 2^40 radiance units. They count as black.
    pub samples: u64,
    /// Splats likewise, or of a position that is no number.
    pub splats: u64,
    /// Camera samples and splats with a component below 0, which no light makes. They are added as they are.
    #[serde(default)]
    pub negative: u64,
    /// AOV records with a value that was not finite. They count as misses.
    pub records: u64,
    /// Sums that became infinite.
    pub overflows: u64,
    /// The first few dropped or negative samples and splats, in order of pass and pixel.
    pub examples: Vec<DroppedExample>,
}

/// Where a contribution was dropped.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct DroppedExample {
    /// The pass.
    pub pass: u32,
    /// Row of the pixel on the full film.
    pub y: i32,
    /// Column of the pixel on the full film.
    pub x: i32,
}

impl DroppedExample {
    fn new(pass: u32, pixel: IVec2) -> Self {
        Self { pass, y: pixel.y, x: pixel.x }
    }
}

impl Dropped {
    /// Whether nothing was dropped, nothing overflowed and nothing was negative.
    pub fn is_none(&self) -> bool {
        [self.samples, self.splats, self.negative, self.records, self.overflows] == [0; 5]
    }

    /// The passes that the examples are of, each once.
    pub fn example_passes(&self) -> Vec<u32> {
        let mut passes: Vec<u32> = self.examples.iter().map(|example| example.pass).collect();
        passes.dedup();
        passes
    }

    pub(super) fn merge(&mut self, other: &Self) {
        // Saturating, since counts may come from a file.
        for (own, other) in [
            (&mut self.samples, other.samples),
            (&mut self.splats, other.splats),
            (&mut self.negative, other.negative),
            (&mut self.records, other.records),
            (&mut self.overflows, other.overflows),
        ] {
            *own = own.saturating_add(other);
        }
        self.note(other.examples.iter().copied());
    }

    /// Counts the samples of a pass that are not kept or negative.
    pub(super) fn note_samples(&mut self, pass: u32, samples: &PassSamples, limit: f32) {
        let radiance = |i: usize| samples.samples()[i].radiance;
        let is_odd = |i: &usize| !is_kept(radiance(*i), limit) || is_negative(radiance(*i));
        let all = 0..samples.samples().len();
        let odd: Vec<usize> = all.into_par_iter().filter(is_odd).collect();
        let dropped = odd.iter().filter(|&&i| !is_kept(radiance(i), limit)).count();
        self.samples += dropped as u64;
        self.negative += (odd.len() - dropped) as u64;
        let first = odd.iter().take(MAX_EXAMPLES);
        self.note(first.map(|&i| DroppedExample::new(pass, samples.pixel(i))));
    }

    /// Counts the splats of a pass that are not kept or negative.
    pub(super) fn note_splats(&mut self, pass: u32, splats: &[Splat], limit: f32) {
        // What is no number counts as pixel 0.
        let example = |s: &&Splat| DroppedExample::new(pass, s.position.floor().as_ivec2());
        let is_odd = |s: &&Splat| !is_splat_kept(s, limit) || is_negative(s.radiance);
        let odd: Vec<&Splat> = splats.par_iter().filter(is_odd).collect();
        let dropped = odd.iter().filter(|s| !is_splat_kept(s, limit)).count();
        self.splats += dropped as u64;
        self.negative += (odd.len() - dropped) as u64;
        let mut examples: Vec<_> = odd.iter().map(example).collect();
        examples.sort_unstable();
        self.note(examples.into_iter().take(MAX_EXAMPLES));
    }

    fn note(&mut self, examples: impl IntoIterator<Item = DroppedExample>) {
        self.examples.extend(examples);
        self.examples.sort_unstable();
        self.examples.truncate(MAX_EXAMPLES);
    }
}

/// Whether a radiance is less than nothing.
#[inline]
fn is_negative(radiance: Rgb) -> bool {
    radiance.cmplt(Rgb::ZERO).any()
}

/// Whether a radiance is added or dropped.
#[inline]
pub(super) fn is_kept(radiance: Rgb, limit: f32) -> bool {
    // NaN compares false.
    radiance.abs().cmple(Rgb::splat(limit)).all()
}

/// Whether a splat is added or dropped.
#[inline]
pub(super) fn is_splat_kept(splat: &Splat, limit: f32) -> bool {
    splat.position.is_finite() && is_kept(splat.radiance, limit)
}
