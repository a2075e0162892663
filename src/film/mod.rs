//! The film: it sums what passes contribute, and develops the sums into images.
//!
//! A pass contributes one sample to each pixel of the *sampled area* ([`PassSamples`]) and any number of splats
//! ([`Splat`]). The sampled area is the crop window with a border as wide as the filter reaches, also where that lies
//! outside the full film: so pixels at the border see the whole filter, and a crop is, bit for bit, that part of the
//! full image as far as camera samples make it (light paths are numbered within the sampled area; their splats agree only in expectation). A pixel is
//!
//! ```text
//! sum f L / sum f  +  (sum of splats, f S) / passes
//! ```
//!
//! with the filter f of integral 1 and sums over all samples of all passes. What one pass makes of a pixel is summed in floating point, in an
//! order that is the pass's own; what adds up over passes is exact ([`exact`]), so the
//! image depends on *which* passes were added, not on their order, on threads, or on how the passes were split
//! between films that were merged.
//!
//! What is not here: the choice of passes and when to stop ([`crate::render`]), and tone mapping beyond the sRGB
//! transfer function of PNG.

pub mod aov;
pub(crate) mod checked;
mod dropped;
pub mod exact;
pub mod filter;
mod image;
mod layout;
pub mod output;
mod passes;
mod reconstruct;
mod samples;
mod splats;
pub mod state;

pub use aov::{Aov, AovRecord, AovSet, NO_ID};
pub use dropped::{Dropped, DroppedExample};
pub use image::{Channel, Image, Pixels};
pub use passes::PassRanges;
pub use samples::{Band, PassSamples, Sample, SampledArea, Splat};

use crate::scene::{FilmSettings, Filter, PixelRect};
use aov::AVERAGED;
use dropped::is_kept;
use exact::ExactSum;
use filter::FilterTable;
use glam::UVec2;
use layout::{AovOutcome, COUNT, Layout, Scale, WEIGHT};
use rayon::prelude::*;
use reconstruct::Reconstruction;

/// Rows of pixels that one task adds to.
const TASK_ROWS: usize = 16;

/// Largest width and height: coordinates are exact in f32.
const MAX_SIZE: u32 = 1 << 24;

/// Why a film cannot be made or added to.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FilmError {
    /// The film or its crop window is empty or too large.
    #[error("film of {} x {} pixels: width and height must be from 1 to {MAX_SIZE}", .0.x, .0.y)]
    Size(UVec2),
    /// The crop window is empty or not within the film.
    #[error(
        "crop window of {} x {} pixels at ({}, {}) is not a part of the film of {} x {} pixels",
        .crop.size.x, .crop.size.y, .crop.min.x, .crop.min.y, .film.x, .film.y
    )]
    Crop {
        /// The crop window.
        crop: PixelRect,
        /// Size of the full film.
        film: UVec2,
    },
    /// The filter's radius is out of range, or its integral is not positive.
    #[error("reconstruction filter {0:?}: its radius must be above 0 and at most {max} pixels, its integral positive", max = filter::MAX_RADIUS)]
    Filter(Filter),
    /// There is not enough memory.
    #[error("film of {} x {} pixels: no memory for {bytes} bytes", .size.x, .size.y)]
    Memory {
        /// Size of the crop window.
        size: UVec2,
        /// Bytes that were asked for.
        bytes: u128,
    },
    /// A pass was added twice, or has the index [`u32::MAX`].
    #[error("pass {0} was added before or is out of range")]
    Pass(u32),
    /// Films of which one does not continue the other.
    #[error("the films differ in their {0}")]
    Mismatch(&'static str),
}

/// Exact sums over passes, from which images are developed.
#[derive(Debug, Clone)]
pub struct Film {
    settings: FilmSettings,
    aovs: AovSet,
    scale: Scale,
    filter: FilterTable,
    layout: Layout,
    passes: PassRanges,
    dropped: Dropped,
    /// [`Layout::stride`] sums per pixel of the crop window.
    sums: Vec<ExactSum>,
    /// Three sums per pixel, or none as long as there are no splats.
    splats: Vec<ExactSum>,
    /// Shape and primitive per pixel, of the lowest pass; empty unless asked for.
    ids: Vec<[u32; 2]>,
}

impl Film {
    /// An empty film.
    ///
    /// `radiance_unit` is a radiance that is typical of the scene, within some orders of magnitude: sums are multiples
    /// of 2^-64 of it and hold up to 2^62 times it. Only its binary exponent matters. A value that is not positive,
    /// normal and finite (a scene without light) is taken for 1.
    ///
    /// # Errors
    /// If sizes, crop window or filter make no sense, or memory is short.
    pub fn new(settings: &FilmSettings, aovs: AovSet, radiance_unit: f32) -> Result<Self, FilmError> {
        Self::with_scale(settings, aovs, Scale::new(radiance_unit))
    }

    fn with_scale(settings: &FilmSettings, aovs: AovSet, scale: Scale) -> Result<Self, FilmError> {
        let filter = Self::check(settings)?;
        let layout = Layout::new(filter.is_box(), aovs);
        let size = settings.crop.size;
        let sums = zeroed(size, layout.stride, ExactSum::default())?;
        let ids = zeroed(size, usize::from(aovs.has_ids()), [NO_ID; 2])?;
        let (passes, dropped, splats) = (PassRanges::default(), Dropped::default(), Vec::new());
        Ok(Self {
            settings: settings.clone(),
            aovs,
            scale,
            filter,
            layout,
            passes,
            dropped,
            sums,
            splats,
            ids,
        })
    }

    /// Checks the settings; returns the filter ready for use.
    fn check(settings: &FilmSettings) -> Result<FilterTable, FilmError> {
        let FilmSettings { size, crop, filter, .. } = *settings;
        if size.min_element() == 0 || size.max_element() > MAX_SIZE {
            return Err(FilmError::Size(size));
        }
        let fits = |min: u32, extent: u32, full: u32| extent > 0 && min < full && extent <= full - min;
        if !(fits(crop.min.x, crop.size.x, size.x) && fits(crop.min.y, crop.size.y, size.y)) {
            return Err(FilmError::Crop { crop, film: size });
        }
        FilterTable::new(&filter).ok_or(FilmError::Filter(filter))
    }

    /// Bytes that a film keeps per pixel, without splats.
    fn bytes_per_pixel(settings: &FilmSettings, aovs: AovSet) -> Result<usize, FilmError> {
        let layout = Layout::new(Self::check(settings)?.is_box(), aovs);
        let ids = if aovs.has_ids() { size_of::<[u32; 2]>() } else { 0 };
        Ok(layout.stride * size_of::<ExactSum>() + ids)
    }

    /// What the film was made for.
    pub fn settings(&self) -> &FilmSettings {
        &self.settings
    }

    /// Which AOVs it keeps.
    pub fn aovs(&self) -> AovSet {
        self.aovs
    }

    /// The passes that were added.
    pub fn passes(&self) -> &PassRanges {
        &self.passes
    }

    /// What was left out.
    pub fn dropped(&self) -> &Dropped {
        &self.dropped
    }

    /// The pixels that a pass samples: the crop window and a border as wide as the filter reaches.
    pub fn sampled_area(&self) -> SampledArea {
        let border = self.filter.border() as u32;
        let crop = self.settings.crop;
        SampledArea { min: crop.min.as_ivec2() - border as i32, size: crop.size + 2 * border }
    }

    /// A buffer for the samples of a pass, to be used again for each.
    pub fn new_pass(&self) -> PassSamples {
        PassSamples::new(self.sampled_area(), self.aovs.needs_records())
    }

    /// Adds one whole pass: its camera samples (`None` if the integrator takes none; then for all passes) and its splats.
    ///
    /// # Errors
    /// [`FilmError::Pass`] if the film has this pass; then nothing is added. [`FilmError::Memory`] with the first splats.
    ///
    /// # Panics
    /// If the samples were made by another film's [`new_pass`](Self::new_pass).
    pub fn add_pass(
        &mut self,
        pass: u32,
        samples: Option<&PassSamples>,
        splats: &[Splat],
    ) -> Result<(), FilmError> {
        if !splats.is_empty() && self.splats.is_empty() {
            self.splats = zeroed(self.settings.crop.size, 3, ExactSum::default())?;
        }
        let is_lowest = self.passes.first().is_none_or(|first| pass < first);
        if !self.passes.insert(pass) {
            return Err(FilmError::Pass(pass));
        }
        if let Some(samples) = samples {
            assert_eq!(samples.area(), self.sampled_area(), "samples of another film");
            self.dropped.note_samples(pass, samples, self.scale.limit());
            self.add_samples(samples);
            self.add_records(samples);
            if is_lowest {
                self.take_ids(samples);
            }
        }
        self.add_splats(pass, splats);
        Ok(())
    }

    fn width(&self) -> usize {
        self.settings.crop.size.x as usize
    }

    fn add_samples(&mut self, samples: &PassSamples) {
        let (width, stride) = (self.width(), self.layout.stride);
        let Self { filter, layout, scale, sums, .. } = self;
        let task = width * stride * TASK_ROWS;
        let overflows: u64 = sums
            .par_chunks_mut(task)
            .enumerate()
            .map_init(
                || Reconstruction::new(filter, samples, scale.limit()),
                |reconstruction, (i, sums)| {
                    let first = i * TASK_ROWS;
                    let mut overflows = 0;
                    reconstruction.for_each(first..first + sums.len() / (width * stride), |x, y, pass| {
                        let pixel = &mut sums[((y - first) * width + x) * stride..][..stride];
                        overflows += layout.add(pixel, pass, *scale);
                    });
                    overflows
                },
            )
            .sum();
        self.dropped.overflows += overflows;
    }

    fn add_records(&mut self, samples: &PassSamples) {
        if self.layout.kept.is_none() && self.layout.hits.is_none() {
            return;
        }
        let (width, border, limit) = (self.width(), self.filter.border(), self.scale.limit());
        let Self { layout, sums, .. } = self;
        let add = |(pixel, sums): (usize, &mut [ExactSum])| {
            let at = samples.index(pixel % width + border, pixel / width + border);
            let kept = is_kept(samples.samples()[at].radiance, limit);
            layout.add_record(sums, kept, samples.records().get(at))
        };
        let outcome = sums.par_chunks_exact_mut(layout.stride).enumerate().map(add).reduce(
            AovOutcome::default,
            |a, b| AovOutcome { dropped: a.dropped + b.dropped, overflows: a.overflows + b.overflows },
        );
        self.dropped.records += outcome.dropped;
        self.dropped.overflows += outcome.overflows;
    }

    fn take_ids(&mut self, samples: &PassSamples) {
        let (width, border) = (self.width(), self.filter.border());
        for (pixel, ids) in self.ids.iter_mut().enumerate() {
            let at = samples.index(pixel % width + border, pixel / width + border);
            let record = &samples.records()[at];
            *ids = if record.is_hit() { [record.shape, record.primitive] } else { [NO_ID; 2] };
        }
    }

    fn add_splats(&mut self, pass: u32, splats: &[Splat]) {
        if splats.is_empty() {
            return;
        }
        self.dropped.note_splats(pass, splats, self.scale.limit());
        let Self { filter, scale, splats: sums, settings, .. } = self;
        self.dropped.overflows += splats::add_splats(splats, filter, *scale, settings.crop, sums);
    }

    /// Adds the passes of another film of the same scene.
    ///
    /// # Errors
    /// [`FilmError::Mismatch`] or, if the films share a pass, [`FilmError::Pass`]; then nothing is changed.
    pub fn merge(&mut self, other: &Self) -> Result<(), FilmError> {
        let checks = [
            (self.settings == other.settings, "settings (size, crop window, filter)"),
            (self.aovs == other.aovs, "AOVs"),
            (self.scale == other.scale, "radiance units"),
        ];
        if let Some((_, what)) = checks.into_iter().find(|(same, _)| !same) {
            return Err(FilmError::Mismatch(what));
        }
        if let Some(pass) = self.passes.common(&other.passes) {
            return Err(FilmError::Pass(pass));
        }
        if let Some(first) = other.passes.first()
            && self.passes.first().is_none_or(|own| first < own)
        {
            self.ids.clone_from(&other.ids);
        }
        self.passes = self.passes.union(&other.passes);
        self.dropped.merge(&other.dropped);
        self.dropped.overflows += merge_sums(&mut self.sums, &other.sums);
        if self.splats.is_empty() {
            self.splats.clone_from(&other.splats);
        } else {
            self.dropped.overflows += merge_sums(&mut self.splats, &other.splats);
        }
        Ok(())
    }

    /// The image that the passes added so far make. Pixels without any weight are 0.
    pub fn develop(&self) -> Image {
        let mut channels: Vec<_> = ["R", "G", "B"]
            .into_iter()
            .enumerate()
            .map(|(c, name)| self.colour_channel(name, |pixel| self.radiance(pixel, c)))
            .collect();
        for (slot, &i) in self.layout.averaged.iter().enumerate() {
            channels.push(self.averaged_channel(slot, &AVERAGED[i]));
        }
        let ids = [(Aov::ShapeId, "id.shape"), (Aov::PrimitiveId, "id.primitive")];
        for (i, (aov, name)) in ids.into_iter().enumerate() {
            if self.aovs.contains(aov) {
                let pixels = Pixels::Integer(self.ids.iter().map(|ids| ids[i]).collect());
                channels.push(Channel { name: name.into(), pixels });
            }
        }
        if let Some(at) = self.layout.kept {
            let count = |sums: &[ExactSum]| sums[at].value(COUNT) as u32;
            let pixels = Pixels::Integer(self.sums.par_chunks_exact(self.layout.stride).map(count).collect());
            channels.push(Channel { name: "sampleCount".into(), pixels });
        }
        if let Some(at) = self.layout.moments {
            for (c, name) in ["variance.R", "variance.G", "variance.B"].into_iter().enumerate() {
                let pixels = Pixels::Float(self.per_pixel(|pixel| self.variance(pixel, at, c)));
                channels.push(Channel { name: name.into(), pixels });
            }
        }
        Image { film_size: self.settings.size, crop: self.settings.crop, channels }
    }

    fn per_pixel(&self, value: impl Fn(usize) -> f64 + Sync) -> Vec<f32> {
        let n = self.sums.len() / self.layout.stride;
        (0..n).into_par_iter().map(|pixel| value(pixel) as f32).collect()
    }

    fn colour_channel(&self, name: &'static str, value: impl Fn(usize) -> f64 + Sync) -> Channel {
        Channel { name: name.into(), pixels: Pixels::Colour(self.per_pixel(value)) }
    }

    fn averaged_channel(&self, slot: usize, averaged: &aov::Averaged) -> Channel {
        let hits = self.layout.hits.unwrap_or_default();
        let mean = |pixel| {
            let sums = self.pixel_sums(pixel);
            ratio(sums[hits + 1 + slot].value(WEIGHT), sums[hits].value(COUNT))
        };
        match averaged.aov {
            Aov::Albedo | Aov::GeometricNormal | Aov::ShadingNormal => {
                self.colour_channel(averaged.channel, mean)
            }
            _ => Channel { name: averaged.channel.into(), pixels: Pixels::Float(self.per_pixel(mean)) },
        }
    }

    fn pixel_sums(&self, pixel: usize) -> &[ExactSum] {
        &self.sums[pixel * self.layout.stride..][..self.layout.stride]
    }

    /// Sum of the filter over all passes.
    fn weight(&self, sums: &[ExactSum]) -> f64 {
        self.layout.weight.map_or(f64::from(self.passes.len()), |at| sums[at].value(WEIGHT))
    }

    fn radiance(&self, pixel: usize, channel: usize) -> f64 {
        let sums = self.pixel_sums(pixel);
        let quantum = self.scale.radiance();
        let samples = ratio(sums[channel].value(quantum), self.weight(sums));
        let splats = self.splats.get(pixel * 3 + channel).map_or(0.0, |sum| sum.value(quantum));
        samples + ratio(splats, f64::from(self.passes.len()))
    }

    /// Estimated variance of the ratio R = A / B of sums over N passes (Cochran 1977, "Sampling techniques", 2.11):
    /// N / (N - 1) sum (a - R b)^2 / B^2. Infinite for fewer than two passes.
    fn variance(&self, pixel: usize, moments: usize, channel: usize) -> f64 {
        let sums = self.pixel_sums(pixel);
        let n = f64::from(self.passes.len());
        if n < 2.0 {
            return f64::INFINITY;
        }
        let (a, b) = (sums[channel].value(self.scale.radiance()), self.weight(sums));
        let aa = sums[moments + channel].value(self.scale.squared());
        if aa.is_infinite() {
            return f64::INFINITY;
        }
        let (ab, bb) = if self.layout.weight.is_some() {
            (sums[moments + 3 + channel].value(self.scale.radiance()), sums[moments + 6].value(WEIGHT))
        } else {
            (a, n)
        };
        let r = ratio(a, b);
        // Rounding can make it negative where all passes agree.
        let spread = (aa - 2.0 * r * ab + r * r * bb).max(0.0);
        ratio(n / (n - 1.0) * spread, b * b)
    }
}

/// `a / b`, and 0 where there is nothing to divide by.
fn ratio(a: f64, b: f64) -> f64 {
    if b == 0.0 { 0.0 } else { a / b }
}

/// `count` elements per pixel, or an error instead of the abort that `vec!` would be.
fn zeroed<T: Clone>(size: UVec2, count: usize, zero: T) -> Result<Vec<T>, FilmError> {
    let elements = u128::from(size.x) * u128::from(size.y) * count as u128;
    let error = || FilmError::Memory { size, bytes: elements * size_of::<T>() as u128 };
    let n = usize::try_from(elements).map_err(|_| error())?;
    let mut vec = Vec::new();
    vec.try_reserve_exact(n).map_err(|_| error())?;
    vec.resize(n, zero);
    Ok(vec)
}

/// Adds sums to sums. Returns how many left their range.
fn merge_sums(own: &mut [ExactSum], other: &[ExactSum]) -> u64 {
    own.par_iter_mut().zip(other).map(|(a, b)| u64::from(a.add(b.quanta()))).sum()
}
