//! The bias of images, measured: what is left of their squared error once noise is taken away.

use glam::DVec3;

use super::metrics::REL_MSE_OFFSET;
use super::picture::Picture;

/// Relative squared bias: the mean over pixels and channels of `(M - R)^2 / (R^2 + 0.01)`, where M is the mean of independent images, less what the noise of M and of
/// the reference R add to it: `(M - R)^2` has the expectation `bias^2 + Var M + Var R`. Var M is a half, third, ... of the spread between the images, and Var R the reference's
/// layer; a reference without one counts as exact. So the value is an estimate with an error of its own, and may be below 0.
///
/// Pixels that are not finite in an image or in the reference are left out. `None` for fewer than two images, or if nothing is left.
///
/// # Panics
/// If the pictures differ in size.
pub fn squared_bias(images: &[Picture], reference: &Picture) -> Option<f64> {
    if images.len() < 2 {
        return None;
    }
    let n = images.len() as f64;
    let (mut sum, mut count) = (0.0, 0_usize);
    for (at, r) in reference.pixels.iter().enumerate() {
        let values = images.iter().map(|image| image.pixels[at].as_dvec3());
        let mean = values.clone().sum::<DVec3>() / n;
        let spread = values.map(|v| (v - mean) * (v - mean)).sum::<DVec3>() / (n * (n - 1.0));
        let noise = reference.variance.as_ref().map_or(DVec3::ZERO, |layer| layer[at].as_dvec3());
        let r = r.as_dvec3();
        let relative = ((mean - r) * (mean - r) - spread - noise) / (r * r + REL_MSE_OFFSET);
        if relative.is_finite() {
            sum += relative.element_sum() / 3.0;
            count += 1;
        }
    }
    (count > 0).then(|| sum / count as f64)
}

/// relMSE that the noise of a picture stands for, by its variance layer; `None` without one, or if nothing in it is finite.
pub fn noise(picture: &Picture) -> Option<f64> {
    let layer = picture.variance.as_ref()?;
    let relative = |(r, v): (&glam::Vec3, &glam::Vec3)| {
        let r = r.as_dvec3();
        (v.as_dvec3() / (r * r + REL_MSE_OFFSET)).element_sum() / 3.0
    };
    let values: Vec<f64> = picture.pixels.iter().zip(layer).map(relative).filter(|v| v.is_finite()).collect();
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}
