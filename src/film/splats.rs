//! Adding splats to the film.

use super::dropped::is_splat_kept;
use super::exact::{ExactSum, Quantum};
use super::filter::FilterTable;
use super::layout::Scale;
use super::samples::Splat;
use crate::scene::PixelRect;
use glam::IVec2;
use rayon::prelude::*;

/// Adds splats to sums of three per pixel of a crop window, without renormalisation at its borders. Returns the number
/// of sums that left their range.
///
/// Each task looks at all splats and adds those that reach its rows: no locks, and few tasks, so little is read twice.
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
        let target = SplatTarget::new(filter, scale, min, width, sums);
        target.add(splats.iter().filter(|s| is_splat_kept(s, scale.limit())))
    };
    sums.par_chunks_mut(rows * width * 3).enumerate().map(add).sum()
}

/// Some rows of the film that splats are added to.
struct SplatTarget<'a> {
    filter: &'a FilterTable,
    quantum: Quantum,
    /// First pixel.
    min: IVec2,
    size: IVec2,
    sums: &'a mut [ExactSum],
    /// Weights per axis.
    x: Vec<f64>,
    y: Vec<f64>,
}

impl<'a> SplatTarget<'a> {
    fn new(
        filter: &'a FilterTable,
        scale: Scale,
        min: IVec2,
        width: usize,
        sums: &'a mut [ExactSum],
    ) -> Self {
        let size = IVec2::new(width as i32, (sums.len() / 3 / width) as i32);
        let weights = vec![0.0; filter.taps()];
        Self { filter, quantum: scale.radiance(), min, size, sums, x: weights.clone(), y: weights }
    }

    /// Adds finite splats. Returns the number of sums that left their range.
    fn add<'s>(mut self, splats: impl Iterator<Item = &'s Splat>) -> u64 {
        let border = self.filter.border() as f32;
        let low = self.min.as_vec2() - border;
        let high = (self.min + self.size).as_vec2() + border;
        splats
            .filter(|s| s.position.cmpge(low).all() && s.position.cmplt(high).all())
            .map(|s| self.add_one(s))
            .sum()
    }

    fn add_one(&mut self, splat: &Splat) -> u64 {
        let corner = splat.position.floor();
        let jitter = splat.position - corner;
        self.filter.weights(jitter.x, &mut self.x);
        self.filter.weights(jitter.y, &mut self.y);
        let first = corner.as_ivec2() - self.filter.border() as i32 - self.min;
        let mut overflows = 0;
        let radiance = splat.radiance.to_array().map(f64::from);
        // A filter reaches one pixel less than it has taps, unless the splat is in the middle of a pixel.
        let reached = |(at, weight): &(i32, &f64), size: i32| (0..size).contains(at) && **weight != 0.0;
        for (y, wy) in (first.y..).zip(&self.y).filter(|tap| reached(tap, self.size.y)) {
            for (x, wx) in (first.x..).zip(&self.x).filter(|tap| reached(tap, self.size.x)) {
                let weight = wx * wy;
                let pixel = (y as usize * self.size.x as usize + x as usize) * 3;
                for (sum, value) in self.sums[pixel..pixel + 3].iter_mut().zip(radiance) {
                    overflows += u64::from(sum.add(self.quantum.round(weight * value)));
                }
            }
        }
        overflows
    }
}
