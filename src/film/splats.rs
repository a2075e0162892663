//! Adding splats to the film.

use super::dropped::is_splat_kept;
use super::exact::ExactSum;
use super::filter::{FilterTable, MAX_RADIUS};
use super::layout::Scale;
use super::samples::Splat;
use crate::scene::PixelRect;
use glam::IVec2;
use rayon::prelude::*;
use std::ops::Range;

/// Adds the splats of one pass to sums of three per pixel of a crop window, without renormalisation at its borders. Returns the
/// number of sums that left their range.
///
/// Within the pass a pixel's splats are added in f64, in the order given, which must not depend on threads; what adds up over the
/// passes is exact. Each task looks at all splats and adds those that reach its rows: no locks, and few tasks, so little is read twice.
pub(super) fn add_splats(
    splats: &[Splat],
    filter: &FilterTable,
    scale: Scale,
    crop: PixelRect,
    sums: &mut [ExactSum],
) -> u64 {
    let width = crop.size.x as usize;
    let rows = (crop.size.y as usize).div_ceil(2 * rayon::current_num_threads());
    let add = |(i, sums): (usize, &mut [ExactSum])| {
        let min = crop.min.as_ivec2() + IVec2::new(0, (i * rows) as i32);
        let mut target =
            SplatTarget::new(filter, min, IVec2::new(width as i32, (sums.len() / 3 / width) as i32));
        for splat in splats.iter().filter(|s| is_splat_kept(s, scale.limit())) {
            target.add(splat);
        }
        target.flush(scale, sums)
    };
    sums.par_chunks_mut(rows * width * 3).enumerate().map(add).sum()
}

/// Some rows of the film that the splats of a pass are added to.
struct SplatTarget<'a> {
    filter: &'a FilterTable,
    /// First pixel.
    min: IVec2,
    size: IVec2,
    /// Radiance, and a fourth number to fill a vector register.
    sums: Vec<[f64; 4]>,
}

/// Weights along one axis.
type Weights = [f32; 2 * MAX_RADIUS as usize + 1];

impl<'a> SplatTarget<'a> {
    fn new(filter: &'a FilterTable, min: IVec2, size: IVec2) -> Self {
        let sums = vec![[0.0; 4]; size.x as usize * size.y as usize];
        Self { filter, min, size, sums }
    }

    /// Adds a finite splat, as far as it reaches these rows.
    fn add(&mut self, splat: &Splat) {
        let (border, taps) = (self.filter.border() as i32, self.filter.taps());
        let low = (self.min - border).as_vec2();
        let high = (self.min + self.size + border).as_vec2();
        if !(splat.position.cmpge(low).all() && splat.position.cmplt(high).all()) {
            return;
        }
        let corner = splat.position.floor();
        let jitter = splat.position - corner;
        let (mut x, mut y): (Weights, Weights) = ([0.0; _], [0.0; _]);
        for (weights, jitter) in [(&mut x, jitter.x), (&mut y, jitter.y)] {
            weights.iter_mut().zip(self.filter.weights(jitter, taps)).for_each(|(weight, w)| *weight = w);
        }
        let first = corner.as_ivec2() - border - self.min;
        let (xs, ys) = (taps_within(first.x, taps, self.size.x), taps_within(first.y, taps, self.size.y));
        let start_of_row = (first.y + ys.start as i32) as usize * self.size.x as usize;
        let start = start_of_row + (first.x + xs.start as i32) as usize;
        let (x, y) = (&x[xs], &y[ys]);
        // Constants, so that the loops are unrolled for the filters of a usual size.
        match (x.len(), y.len()) {
            (3, 3) => self.add_block(start, &x[..3], &y[..3], splat),
            (5, 5) => self.add_block(start, &x[..5], &y[..5], splat),
            (7, 7) => self.add_block(start, &x[..7], &y[..7], splat),
            _ => self.add_block(start, x, y, splat),
        }
    }

    /// Adds a splat to a block of pixels, of which `start` is the first.
    // Without inlining there would be no constants.
    #[inline(always)]
    fn add_block(&mut self, start: usize, x: &[f32], y: &[f32], splat: &Splat) {
        let width = self.size.x as usize;
        let radiance = splat.radiance.extend(0.0).to_array().map(f64::from);
        for (dy, weight) in y.iter().enumerate() {
            let row = radiance.map(|value| value * f64::from(*weight));
            let pixels = &mut self.sums[start + dy * width..][..x.len()];
            for (pixel, weight) in pixels.iter_mut().zip(x) {
                for (sum, value) in pixel.iter_mut().zip(row) {
                    *sum += value * f64::from(*weight);
                }
            }
        }
    }

    /// Adds what was gathered to the film's sums. Returns the number of these that left their range.
    fn flush(&self, scale: Scale, sums: &mut [ExactSum]) -> u64 {
        let mut overflows = 0;
        for (pixel, values) in sums.chunks_exact_mut(3).zip(&self.sums) {
            for (sum, &value) in pixel.iter_mut().zip(values) {
                if value != 0.0 {
                    overflows += u64::from(sum.add_f64(value, scale.radiance()));
                }
            }
        }
        overflows
    }
}

/// Those of `taps` taps that lie on pixels from 0 to `size`, the first of all being at pixel `first`.
fn taps_within(first: i32, taps: usize, size: i32) -> Range<usize> {
    let low = (-first).max(0) as usize;
    low..taps.min((size - first).max(0) as usize).max(low)
}
