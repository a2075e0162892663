//! What a pass hands to the film: a sample for each pixel, and splats.

use super::aov::AovRecord;
use crate::scene::Rgb;
use glam::{IVec2, UVec2, Vec2};
use rayon::prelude::*;

/// Rows handed to one task: high enough for the blocks of [`Band::for_each`], low enough to feed many threads.
const BAND_ROWS: usize = 4;

/// Width of the blocks in which a band is walked. Rays of neighbouring pixels visit the same nodes.
const BLOCK_WIDTH: usize = 8;

/// A rectangle of pixels that may reach beyond the film.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SampledArea {
    /// First pixel; negative where the filter's border lies outside the film.
    pub min: IVec2,
    /// Width and height in pixels.
    pub size: UVec2,
}

/// One camera sample of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Sample {
    /// Position within the pixel, in [0, 1) x [0, 1).
    pub jitter: Vec2,
    /// Estimate of the radiance that arrives there.
    pub radiance: Rgb,
}

/// A contribution to the film at any position, as light paths make them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Splat {
    /// Position on the film in pixels: pixel (x, y) spans [x, x + 1) x [y, y + 1).
    pub position: Vec2,
    /// Contribution, already divided by the number of light paths of the pass.
    pub radiance: Rgb,
}

/// One sample for each pixel of the sampled area: the camera half of a pass. Reused from pass to pass.
#[derive(Debug, Clone)]
pub struct PassSamples {
    area: SampledArea,
    samples: Vec<Sample>,
    /// As many as samples, or none.
    records: Vec<AovRecord>,
}

impl PassSamples {
    pub(super) fn new(area: SampledArea, with_records: bool) -> Self {
        let n = area.size.x as usize * area.size.y as usize;
        let records = if with_records { vec![AovRecord::MISS; n] } else { Vec::new() };
        Self { area, samples: vec![Sample::default(); n], records }
    }

    /// The pixels that the samples belong to.
    pub fn area(&self) -> SampledArea {
        self.area
    }

    /// The area in bands of rows, in parallel. Every sample (and record) must be overwritten in every pass.
    pub fn par_bands_mut(&mut self) -> impl IndexedParallelIterator<Item = Band<'_>> {
        let width = self.area.size.x as usize;
        let bands = self.area.size.y.div_ceil(BAND_ROWS as u32) as usize;
        let min = self.area.min;
        let chunk = width * BAND_ROWS;
        // Without records, each band gets an empty part of them.
        let mut records = self.records.chunks_mut(chunk);
        let records: Vec<_> = (0..bands).map(|_| records.next().unwrap_or_default()).collect();
        self.samples.par_chunks_mut(chunk).zip(records).enumerate().map(move |(i, (samples, records))| Band {
            min: min + IVec2::new(0, (i * BAND_ROWS) as i32),
            width,
            samples,
            records,
        })
    }

    /// The pixel of the sample of an index.
    pub(super) fn pixel(&self, index: usize) -> IVec2 {
        let width = self.area.size.x as usize;
        self.area.min + IVec2::new((index % width) as i32, (index / width) as i32)
    }

    /// All samples, row by row.
    pub(super) fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// The sample of a pixel by its position in the area.
    #[inline]
    pub(super) fn index(&self, x: usize, y: usize) -> usize {
        y * self.area.size.x as usize + x
    }

    /// The records; empty if no AOV needs them.
    pub(super) fn records(&self) -> &[AovRecord] {
        &self.records
    }
}

/// A few rows of a [`PassSamples`], to be filled by one task.
#[derive(Debug)]
pub struct Band<'a> {
    min: IVec2,
    width: usize,
    samples: &'a mut [Sample],
    records: &'a mut [AovRecord],
}

impl Band<'_> {
    /// Visits each pixel of the band once, block by block: its film coordinates, its sample, and its record if AOVs need one.
    pub fn for_each(&mut self, mut visit: impl FnMut(IVec2, &mut Sample, Option<&mut AovRecord>)) {
        let rows = self.samples.len() / self.width;
        for block in (0..self.width).step_by(BLOCK_WIDTH) {
            for y in 0..rows {
                for x in block..(block + BLOCK_WIDTH).min(self.width) {
                    let i = y * self.width + x;
                    let pixel = self.min + IVec2::new(x as i32, y as i32);
                    visit(pixel, &mut self.samples[i], self.records.get_mut(i));
                }
            }
        }
    }
}
