//! The weighted sums of one pass: from samples to pixels through the filter.

use super::dropped::is_kept;
use super::filter::{FilterTable, MAX_RADIUS};
use super::samples::{PassSamples, Sample};
use crate::scene::Rgb;
use std::ops::Range;

/// Width of the block of pixels worked on at a time, so that its samples stay in the cache.
const BLOCK_WIDTH: usize = 32;

/// Pixels summed side by side: as many f32 as a vector register holds.
const LANES: usize = 8;

/// A number for each sample in a row of a block, with the widest border there is.
type Row = [f32; BLOCK_WIDTH + 2 * MAX_RADIUS as usize];

/// What the filter makes of one pass at one pixel: sum of f L (three channels) and sum of f.
///
/// The few samples around a pixel are summed in f32, whose rounding is far below their noise and has no bias; what adds up
/// over the passes is exact.
pub(super) type Weighted = [f32; 4];

/// Radiance of a sample. What is dropped counts as black.
#[inline]
fn kept(sample: &Sample, limit: f32) -> Rgb {
    if is_kept(sample.radiance, limit) { sample.radiance } else { Rgb::ZERO }
}

/// Reconstructs pixels from samples. One per task, because it holds the samples and weights of a block.
pub(super) struct Reconstruction<'a> {
    table: &'a FilterTable,
    samples: &'a PassSamples,
    limit: f32,
    /// Red, green and blue of the samples of a block.
    radiance: Vec<[Row; 3]>,
    /// For each row [`FilterTable::taps`] weights along each axis.
    weights_x: Vec<Row>,
    weights_y: Vec<Row>,
}

impl<'a> Reconstruction<'a> {
    /// `limit` is the greatest radiance that is not dropped.
    pub(super) fn new(table: &'a FilterTable, samples: &'a PassSamples, limit: f32) -> Self {
        let (radiance, weights_x, weights_y) = Default::default();
        Self { table, samples, limit, radiance, weights_x, weights_y }
    }

    /// Calls `add` with each pixel of the given rows of the film (counted from the first of the crop window).
    /// The order of additions within a pixel is that of the neighbours, whatever the rows.
    pub(super) fn for_each(&mut self, rows: Range<usize>, mut add: impl FnMut(usize, usize, Weighted)) {
        let columns = self.samples.area().size.x as usize - 2 * self.table.border();
        if self.table.is_box() {
            for y in rows {
                for x in 0..columns {
                    let sample = &self.samples.samples()[self.samples.index(x, y)];
                    add(x, y, kept(sample, self.limit).extend(1.0).to_array());
                }
            }
            return;
        }
        for start in (0..columns).step_by(BLOCK_WIDTH) {
            let block = start..(start + BLOCK_WIDTH).min(columns);
            self.load(block.clone(), rows.clone());
            for y in rows.clone() {
                for x in block.clone().step_by(LANES) {
                    let sums = self.sum_around(x - start, y - rows.start);
                    for lane in 0..LANES.min(block.end - x) {
                        add(x + lane, y, sums.map(|channel| channel[lane]));
                    }
                }
            }
        }
    }

    /// Evaluates the filter for all samples that reach a block of pixels.
    fn load(&mut self, columns: Range<usize>, rows: Range<usize>) {
        // Constants, so that the loops are unrolled for the filters of a usual size.
        match self.table.taps() {
            3 => self.load_taps(3, columns, rows),
            5 => self.load_taps(5, columns, rows),
            7 => self.load_taps(7, columns, rows),
            taps => self.load_taps(taps, columns, rows),
        }
    }

    // Without inlining there would be no constants.
    #[inline(always)]
    fn load_taps(&mut self, taps: usize, columns: Range<usize>, rows: Range<usize>) {
        let margin = taps - 1;
        let count = rows.len() + margin;
        self.radiance.resize(count, [[0.0; _]; 3]);
        self.weights_x.resize(count * taps, [0.0; _]);
        self.weights_y.resize(count * taps, [0.0; _]);
        let weights = self.weights_x.chunks_exact_mut(taps).zip(self.weights_y.chunks_exact_mut(taps));
        for ((row, radiance), (weights_x, weights_y)) in self.radiance.iter_mut().enumerate().zip(weights) {
            let first = self.samples.index(columns.start, rows.start + row);
            let samples = &self.samples.samples()[first..][..columns.len() + margin];
            for (column, sample) in samples.iter().enumerate() {
                let Rgb { x, y, z } = kept(sample, self.limit);
                for (row, value) in radiance.iter_mut().zip([x, y, z]) {
                    row[column] = value;
                }
                for (row, weight) in weights_x.iter_mut().zip(self.table.weights(sample.jitter.x, taps)) {
                    row[column] = weight;
                }
                for (row, weight) in weights_y.iter_mut().zip(self.table.weights(sample.jitter.y, taps)) {
                    row[column] = weight;
                }
            }
        }
    }

    /// Sums over the samples around [`LANES`] pixels of the block that are side by side.
    #[inline]
    fn sum_around(&self, x: usize, y: usize) -> [[f32; LANES]; 4] {
        // Constants as in `load`.
        match self.table.taps() {
            3 => self.sum_taps(3, x, y),
            5 => self.sum_taps(5, x, y),
            7 => self.sum_taps(7, x, y),
            taps => self.sum_taps(taps, x, y),
        }
    }

    #[inline(always)]
    fn sum_taps(&self, taps: usize, x: usize, y: usize) -> [[f32; LANES]; 4] {
        // Checked here, so that it need not be for each of the loads below.
        assert!(x + taps - 1 + LANES <= size_of::<Row>() / size_of::<f32>());
        let mut sums = [[0.0; LANES]; 4];
        let radiance = &self.radiance[y..y + taps];
        let weights_x = &self.weights_x[y * taps..][..taps * taps];
        let weights_y = &self.weights_y[y * taps..][..taps * taps];
        for (dy, [red, green, blue]) in radiance.iter().enumerate() {
            // A sample `dx` columns after the first lies `dx - border` from the pixel, so the pixel `border - dx` from it.
            let weights_y = &weights_y[dy * taps + taps - 1 - dy];
            for dx in 0..taps {
                let (of_x, of_y) =
                    (lanes(&weights_x[dy * taps + taps - 1 - dx], x + dx), lanes(weights_y, x + dx));
                let weight: [f32; LANES] = std::array::from_fn(|i| of_x[i] * of_y[i]);
                add_product(&mut sums[0], weight, lanes(red, x + dx));
                add_product(&mut sums[1], weight, lanes(green, x + dx));
                add_product(&mut sums[2], weight, lanes(blue, x + dx));
                add_product(&mut sums[3], weight, &[1.0; LANES]);
            }
        }
        sums
    }
}

#[inline(always)]
fn lanes(row: &Row, first: usize) -> &[f32] {
    &row[first..first + LANES]
}

#[inline(always)]
fn add_product(sums: &mut [f32; LANES], weights: [f32; LANES], values: &[f32]) {
    for (i, sum) in sums.iter_mut().enumerate() {
        *sum += weights[i] * values[i];
    }
}
