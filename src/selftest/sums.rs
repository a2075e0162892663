//! Sums over very many passes and of very different values.

use glam::{UVec2, Vec2};

use super::images::empty;
use super::{Finding, Group, SelftestError};
use crate::film::output::write_exr;
use crate::film::{AovSet, Channel, Film, Image, PassSamples, Pixels, Sample};
use crate::scene::{PixelRect, Rgb};
use crate::study::picture::Picture;

/// A film of one row of pixels and the given unit of radiance.
fn film(pixels: u32) -> Result<Film, SelftestError> {
    let mut settings = empty(1).film;
    let size = UVec2::new(pixels, 1);
    (settings.size, settings.crop) = (size, PixelRect { min: UVec2::ZERO, size });
    Ok(Film::new(&settings, AovSet::default(), 1.0)?)
}

/// Gives each pixel a radiance.
fn fill(samples: &mut PassSamples, radiance: impl Fn(u32) -> Rgb) {
    use rayon::prelude::*;
    let mut bands: Vec<_> = samples.par_bands_mut().collect();
    for band in &mut bands {
        band.for_each(|pixel, sample, _| {
            *sample = Sample { jitter: Vec2::splat(0.5), radiance: radiance(pixel.x as u32) };
        });
    }
}

/// All of these are exact: a mean may differ from the true one by the rounding of the result to f32 alone.
pub(super) fn check() -> Result<Vec<Finding>, SelftestError> {
    let finding = |check: &str, measured: f64, limit: f64| Finding {
        group: Group::Sums,
        check: check.to_owned(),
        backend: "",
        integrator: "",
        measured,
        limit: Some(limit),
    };
    let half_ulp = f64::from(f32::EPSILON / 2.0);
    Ok(vec![
        finding("2^20 passes: relative error of the mean", many_passes()?, half_ulp),
        finding("dim pixel beside one 1e12 times as bright: relative error", dim_beside_bright()?, half_ulp),
        finding("half floats: values beyond 65504 that are not clamped and counted", half_floats()?, 0.0),
    ])
}

/// Greatest relative error of the mean of 2^20 passes of 0.1, 1e-9 and 1e9, none of which is a sum of few powers of two; and of one whose value
/// is k in the k-th 1024 passes, where the mean is 1023 / 2.
fn many_passes() -> Result<f64, SelftestError> {
    let passes = 1_u32 << 20;
    let mut film = film(2)?;
    let mut samples = film.new_pass();
    let constant = Rgb::new(0.1, 1e-9, 1e9);
    for pass in 0..passes {
        if pass % 1024 == 0 {
            let growing = (pass / 1024) as f32;
            fill(&mut samples, |x| if x == 0 { constant } else { Rgb::splat(growing) });
        }
        film.add_pass(pass, Some(&samples), &[])?;
    }
    let image = film.develop();
    let mut worst = 0.0_f64;
    for (channel, expected) in ["R", "G", "B"].into_iter().zip(constant.to_array()) {
        let values = image.floats(channel).unwrap_or_default();
        let mean = 1023.0 / 2.0;
        for (value, expected) in values.iter().zip([f64::from(expected), mean]) {
            worst = worst.max((f64::from(*value) / expected - 1.0).abs());
        }
    }
    Ok(if film.dropped().is_none() { worst } else { f64::NAN })
}

/// The dim pixels' error; NaN unless the bright one is right.
fn dim_beside_bright() -> Result<f64, SelftestError> {
    let mut film = film(3)?;
    let mut samples = film.new_pass();
    let passes = 100;
    let dim = |pass: u32| 1e-3 * (0.5 + (pass * 37 % 64) as f32 / 64.0);
    for pass in 0..passes {
        fill(&mut samples, |x| Rgb::splat(if x == 1 { 1e9 } else { dim(pass) }));
        film.add_pass(pass, Some(&samples), &[])?;
    }
    let expected = (0..passes).map(|pass| f64::from(dim(pass))).sum::<f64>() / f64::from(passes);
    let image = film.develop();
    Ok(match image.floats("R") {
        Some(&[a, bright, b]) if bright == 1e9 && film.dropped().is_none() => {
            [a, b].map(|value| (f64::from(value) / expected - 1.0).abs()).into_iter().fold(0.0, f64::max)
        }
        _ => f64::NAN,
    })
}

/// Writes an image as half floats, reads it again, and counts what is not clamped to the greatest half, changed though it has one, or not counted.
fn half_floats() -> Result<f64, SelftestError> {
    let directory = tempfile::tempdir()?;
    let path = directory.path().join("half.exr");
    let greatest = f32::from(half::f16::MAX);
    let values = vec![greatest, 65505.0, 1e30, -1e30, f32::INFINITY, 6e-8];
    // 2^-24 is the smallest half above 0.
    let expected = [greatest, greatest, greatest, -greatest, greatest, 2f32.powi(-24)];
    let size = UVec2::new(values.len() as u32, 1);
    let channel = |name: &'static str| Channel { name: name.into(), pixels: Pixels::Colour(values.clone()) };
    let image = Image {
        film_size: size,
        crop: PixelRect { min: UVec2::ZERO, size },
        channels: ["R", "G", "B"].map(channel).to_vec(),
    };
    let clamped = write_exr(&path, &image, true, &[])?;
    let Ok(read) = Picture::read(&path) else { return Ok(f64::NAN) };
    let wrong = read.pixels.iter().zip(expected).filter(|(pixel, value)| pixel.x != *value).count();
    // Four in each of three channels are beyond the range.
    Ok(wrong as f64 + (clamped as f64 - 12.0).abs())
}
