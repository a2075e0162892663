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
    /// AOV records with a value that was not finite. They count as misses.
    pub records: u64,
    /// Sums that became infinite.
    pub overflows: u64,
    /// The first few dropped samples and splats, in order of pass and pixel.
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
    /// Whether nothing was dropped and nothing overflowed.
    pub fn is_none(&self) -> bool {
        self.samples == 0 && self.splats == 0 && self.records == 0 && self.overflows == 0
    }

    pub(super) fn merge(&mut self, other: &Self) {
        // Saturating, since counts may come from a file.
        for (own, other) in [
            (&mut self.samples, other.samples),
            (&mut self.splats, other.splats),
            (&mut self.records, other.records),
            (&mut self.overflows, other.overflows),
        ] {
            *own = own.saturating_add(other);
        }
        self.note(other.examples.iter().copied());
    }

    /// Counts the samples of a pass that are not kept.
    pub(super) fn note_samples(&mut self, pass: u32, samples: &PassSamples, limit: f32) {
        let is_dropped = |i: &usize| !is_kept(samples.samples()[*i].radiance, limit);
        let all = 0..samples.samples().len();
        let count = all.clone().into_par_iter().filter(is_dropped).count();
        if count > 0 {
            self.samples += count as u64;
            let first = all.filter(is_dropped).take(MAX_EXAMPLES);
            self.note(first.map(|i| DroppedExample::new(pass, samples.pixel(i))));
        }
    }

    /// Counts the splats of a pass that are not kept.
    pub(super) fn note_splats(&mut self, pass: u32, splats: &[Splat], limit: f32) {
        // What is no number counts as pixel 0.
        let example = |s: &Splat| DroppedExample::new(pass, s.position.floor().as_ivec2());
        let mut dropped: Vec<_> =
            splats.par_iter().filter(|s| !is_splat_kept(s, limit)).map(example).collect();
        self.splats += dropped.len() as u64;
        dropped.sort_unstable();
        self.note(dropped.into_iter().take(MAX_EXAMPLES));
    }

    fn note(&mut self, examples: impl IntoIterator<Item = DroppedExample>) {
        self.examples.extend(examples);
        self.examples.sort_unstable();
        self.examples.truncate(MAX_EXAMPLES);
    }
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
