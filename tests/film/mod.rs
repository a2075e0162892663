//! The film: reconstruction, order independence, splats, variance, AOVs, files.

// Coordinates are small.
#![allow(clippy::cast_possible_wrap)]

mod files;
mod order;
mod pixels;
mod splats;

use glam::{IVec2, UVec2, Vec2, Vec3};
use helmholtz::film::{Aov, AovRecord, AovSet, Film, PassSamples, Sample};
use helmholtz::sampling::sampler::mix;
use helmholtz::scene::{FilmSettings, Filter, PixelRect, Rgb};
use rayon::prelude::*;

pub(crate) const FILTERS: [Filter; 7] = [
    Filter::Box,
    Filter::Tent { radius: 1.0 },
    Filter::Tent { radius: 1.7 },
    Filter::Gaussian { stddev: 0.5 },
    Filter::Mitchell { b: 1.0 / 3.0, c: 1.0 / 3.0 },
    Filter::Lanczos { lobes: 3 },
    // Wider than what the film unrolls its loops for.
    Filter::Gaussian { stddev: 1.1 },
];

pub(crate) fn settings(size: UVec2, filter: Filter) -> FilmSettings {
    FilmSettings { size, crop: PixelRect { min: UVec2::ZERO, size }, filter, half_float: false }
}

pub(crate) fn cropped(size: UVec2, min: UVec2, crop: UVec2, filter: Filter) -> FilmSettings {
    FilmSettings { crop: PixelRect { min, size: crop }, ..settings(size, filter) }
}

pub(crate) fn film(settings: &FilmSettings) -> Film {
    Film::new(settings, AovSet::default(), 1.0).unwrap()
}

pub(crate) fn all_aovs() -> AovSet {
    Aov::ALL.into_iter().collect()
}

/// Three numbers in [0, 1) that depend on pixel and pass alone.
pub(crate) fn random(pixel: IVec2, pass: u32) -> Vec3 {
    let key = u64::from(pixel.x as u32) << 32 | u64::from(pixel.y as u32);
    let bits = mix(mix(key) ^ u64::from(pass).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    Vec3::new((bits & 0xf_ffff) as f32, (bits >> 20 & 0xf_ffff) as f32, (bits >> 40 & 0xf_ffff) as f32)
        / (1 << 20) as f32
}

/// Fills a pass: jitter is random, radiance whatever `shade` makes of pixel, jitter and a random number.
pub(crate) fn fill(samples: &mut PassSamples, pass: u32, shade: impl Fn(IVec2, Vec2, f32) -> Rgb + Sync) {
    samples.par_bands_mut().for_each(|mut band| {
        band.for_each(|pixel, sample, record| {
            let u = random(pixel, pass);
            *sample = Sample { jitter: u.truncate(), radiance: shade(pixel, u.truncate(), u.z) };
            if let Some(record) = record {
                *record = surface(pixel, pass, u);
            }
        });
    });
}

/// What the sample of a pixel sees in these tests: in one of eight passes nothing.
pub(crate) fn surface(pixel: IVec2, pass: u32, u: Vec3) -> AovRecord {
    if u.z < 0.125 {
        return AovRecord::MISS;
    }
    AovRecord {
        shape: pixel.x.unsigned_abs() * 100 + pass,
        primitive: pixel.y.unsigned_abs() * 1000 + pass,
        depth: 1.0 + u.x,
        position: u * 10.0,
        ng: u - 0.5,
        ns: 0.5 - u,
        albedo: u * u,
        uv: u.truncate() * 3.0,
    }
}

/// Adds passes of a noisy gradient, brighter towards the lower right.
pub(crate) fn render(film: &mut Film, passes: impl IntoIterator<Item = u32>) {
    let mut samples = film.new_pass();
    for pass in passes {
        fill(&mut samples, pass, gradient);
        film.add_pass(pass, Some(&samples), &[]).unwrap();
    }
}

pub(crate) fn gradient(pixel: IVec2, jitter: Vec2, noise: f32) -> Rgb {
    let p = pixel.as_vec2() + jitter + 20.0;
    Rgb::new(p.x * noise, p.y * 0.1, p.x * p.y * 0.01 + noise)
}
