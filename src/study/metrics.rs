//! Errors of an image against a reference, as numbers.
//!
//! Means are over pixels and channels, in f64. Pixels that are not finite in either image are counted and left out of all else.

use glam::{DVec3, UVec2};

use super::picture::Picture;

/// Keeps relative errors of dark pixels finite: `relMSE` is the mean of `(I - R)^2 / (R^2 + 0.01)`.
pub(super) const REL_MSE_OFFSET: f64 = 0.01;

/// The share of pixels with the greatest relative errors that the trimmed relMSE leaves out, rounded down to whole pixels.
const TRIMMED: f64 = 0.001;

/// How far an image is from a reference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Errors {
    /// Mean squared error.
    pub mse: f64,
    /// Mean of `(I - R)^2 / (R^2 + 0.01)`.
    pub rel_mse: f64,
    /// The same without the worst 0.1 % of the pixels.
    pub rel_mse_trimmed: f64,
    /// Peak signal-to-noise ratio in dB. The peak is 1 for a reference of integers, else the reference's greatest value. Infinite for equal images.
    pub psnr: f64,
    /// Mean of I - R.
    pub bias: f64,
    /// The bias in standard errors, by the variance layers of the image and, if it has one, of the reference. `None` if the image has none. Pixels
    /// count as independent: a reconstruction filter wider than a pixel ties them together, and z is then too large by up to the width of the filter in pixels.
    pub bias_z: Option<f64>,
    /// Pixels with a channel that is not finite, in the image.
    pub non_finite: usize,
    /// The same in the reference.
    pub non_finite_reference: usize,
}

impl Errors {
    /// Root of the mean squared error.
    pub fn rmse(&self) -> f64 {
        self.mse.sqrt()
    }
}

/// Why two pictures cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CompareError {
    /// They differ in size.
    #[error("is {} x {} pixels, but the reference {} x {}", .image.x, .image.y, .reference.x, .reference.y)]
    Size {
        /// Of the image.
        image: UVec2,
        /// Of the reference.
        reference: UVec2,
    },
    /// No pixel is finite in both.
    #[error("has no pixel that is finite in both images")]
    Nothing,
}

/// Relative squared error of each pixel, the mean of its channels; NaN where either image is not finite.
///
/// # Errors
/// If the sizes differ.
pub fn relative_squared_errors(reference: &Picture, image: &Picture) -> Result<Vec<f64>, CompareError> {
    if reference.size != image.size {
        return Err(CompareError::Size { image: image.size, reference: reference.size });
    }
    let error = |(r, i): (&glam::Vec3, &glam::Vec3)| {
        if !(r.is_finite() && i.is_finite()) {
            return f64::NAN;
        }
        let (r, i) = (r.as_dvec3(), i.as_dvec3());
        ((i - r) * (i - r) / (r * r + REL_MSE_OFFSET)).element_sum() / 3.0
    };
    Ok(reference.pixels.iter().zip(&image.pixels).map(error).collect())
}

/// Compares an image with a reference.
///
/// # Errors
/// If the sizes differ, or there is nothing to compare.
pub fn compare(reference: &Picture, image: &Picture) -> Result<Errors, CompareError> {
    let mut relative = relative_squared_errors(reference, image)?;
    relative.retain(|e| e.is_finite());
    let count = relative.len();
    if count == 0 {
        return Err(CompareError::Nothing);
    }
    let bad = |picture: &Picture| picture.pixels.iter().filter(|p| !p.is_finite()).count();
    let pairs = || {
        let both = reference.pixels.iter().zip(&image.pixels).enumerate();
        both.filter(|(_, (r, i))| r.is_finite() && i.is_finite())
            .map(|(at, (r, i))| (at, r.as_dvec3(), i.as_dvec3()))
    };
    let mean = |sum: DVec3| sum.element_sum() / (3 * count) as f64;
    let mse = mean(pairs().map(|(_, r, i)| (i - r) * (i - r)).sum());
    let bias = mean(pairs().map(|(_, r, i)| i - r).sum());
    let greatest = pairs().map(|(_, r, _)| r.max_element()).fold(0.0, f64::max);
    let peak = if reference.is_display { 1.0 } else { greatest };
    let variance = |picture: &Picture| {
        let layer = picture.variance.as_ref()?;
        let sum: DVec3 = pairs().map(|(at, ..)| layer[at].as_dvec3()).sum();
        Some(sum.element_sum() / ((3 * count) as f64).powi(2))
    };
    let bias_z = variance(image)
        .map(|own| bias / (own + variance(reference).unwrap_or(0.0)).sqrt())
        .filter(|z| z.is_finite());
    relative.sort_by(f64::total_cmp);
    let kept = count - (TRIMMED * count as f64) as usize;
    Ok(Errors {
        mse,
        rel_mse: relative.iter().sum::<f64>() / count as f64,
        rel_mse_trimmed: relative[..kept].iter().sum::<f64>() / kept as f64,
        psnr: 10.0 * (peak * peak / mse).log10(),
        bias,
        bias_z,
        non_finite: bad(image),
        non_finite_reference: bad(reference),
    })
}
