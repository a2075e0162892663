//! The weighted sums of one pass: from samples to pixels through the filter.

use super::dropped::is_kept;
use super::filter::FilterTable;
use super::samples::{PassSamples, Sample};
use crate::scene::Rgb;
use glam::Vec4;
use std::ops::Range;

/// Width of the block of pixels worked on at a time, so that its samples stay in the cache.
const BLOCK_WIDTH: usize = 32;

/// What the filter makes of one pass at one pixel: sum of f L (three channels) and sum of f.
///
/// The few samples around a pixel are summed in f32, whose rounding is far below their noise and has no bias; what adds up
/// over the passes is exact.
pub(super) type Weighted = [f64; 4];

/// Radiance of a sample and the weight 1 it comes with. What is dropped counts as black.
#[inline]
fn weighted(sample: &Sample, limit: f32) -> Vec4 {
    let kept = if is_kept(sample.radiance, limit) { sample.radiance } else { Rgb::ZERO };
    kept.extend(1.0)
}

/// Reconstructs pixels from samples. One per task, because it holds the weights of a block.
pub(super) struct Reconstruction<'a> {
    table: &'a FilterTable,
    samples: &'a PassSamples,
    limit: f32,
    /// Samples per row of the block, with its border.
    width: usize,
    contributions: Vec<Vec4>,
    /// [`FilterTable::taps`] weights per sample and axis.
    weights_x: Vec<f32>,
    weights_y: Vec<f32>,
}

impl<'a> Reconstruction<'a> {
    /// `limit` is the greatest radiance that is not dropped.
    pub(super) fn new(table: &'a FilterTable, samples: &'a PassSamples, limit: f32) -> Self {
        let (contributions, weights_x, weights_y) = (Vec::new(), Vec::new(), Vec::new());
        Self { table, samples, limit, width: 0, contributions, weights_x, weights_y }
    }

    /// Calls `add` with each pixel of the given rows of the film (counted from the first of the crop window).
    /// The order of additions within a pixel is that of the neighbours, whatever the rows.
    pub(super) fn for_each(&mut self, rows: Range<usize>, mut add: impl FnMut(usize, usize, Weighted)) {
        let columns = self.samples.area().size.x as usize - 2 * self.table.border();
        if self.table.is_box() {
            for y in rows {
                for x in 0..columns {
                    let sample = &self.samples.samples()[self.samples.index(x, y)];
                    add(x, y, weighted(sample, self.limit).as_dvec4().to_array());
                }
            }
            return;
        }
        for start in (0..columns).step_by(BLOCK_WIDTH) {
            let block = start..(start + BLOCK_WIDTH).min(columns);
            self.load(block.clone(), rows.clone());
            for y in rows.clone() {
                for x in block.clone() {
                    add(x, y, self.sum_around(x - block.start, y - rows.start).as_dvec4().to_array());
                }
            }
        }
    }

    /// Evaluates the filter for all samples that reach a block of pixels.
    fn load(&mut self, columns: Range<usize>, rows: Range<usize>) {
        let taps = self.table.taps();
        let margin = taps - 1;
        self.width = columns.len() + margin;
        let n = self.width * (rows.len() + margin);
        self.contributions.clear();
        self.weights_x.resize(n * taps, 0.0);
        self.weights_y.resize(n * taps, 0.0);
        let mut weights = self.weights_x.chunks_exact_mut(taps).zip(self.weights_y.chunks_exact_mut(taps));
        for y in rows.start..rows.end + margin {
            let first = self.samples.index(columns.start, y);
            let row = &self.samples.samples()[first..][..self.width];
            for (sample, (x, y)) in row.iter().zip(&mut weights) {
                self.contributions.push(weighted(sample, self.limit));
                self.table.weights(sample.jitter.x, x);
                self.table.weights(sample.jitter.y, y);
            }
        }
    }

    /// Sums over the samples around a pixel of the block.
    #[inline]
    fn sum_around(&self, x: usize, y: usize) -> Vec4 {
        // Constants, so that the loops are unrolled for the filters of a usual size.
        match self.table.taps() {
            3 => self.sum_taps(3, x, y),
            5 => self.sum_taps(5, x, y),
            7 => self.sum_taps(7, x, y),
            taps => self.sum_taps(taps, x, y),
        }
    }

    // Without inlining there would be no constants.
    #[inline(always)]
    fn sum_taps(&self, taps: usize, x: usize, y: usize) -> Vec4 {
        let mut total = Vec4::ZERO;
        for dy in 0..taps {
            let first = (y + dy) * self.width + x;
            let contributions = &self.contributions[first..][..taps];
            let weights_x = self.weights_x[first * taps..][..taps * taps].chunks_exact(taps);
            let weights_y = self.weights_y[first * taps..][..taps * taps].chunks_exact(taps);
            let mut row = Vec4::ZERO;
            for (dx, ((c, wx), wy)) in contributions.iter().zip(weights_x).zip(weights_y).enumerate() {
                // A sample `dx` columns after the first lies `dx - border` from the pixel, so the pixel `border - dx` from it.
                let weight = wx[taps - 1 - dx] * wy[taps - 1 - dy];
                row += *c * weight;
            }
            total += row;
        }
        total
    }
}
