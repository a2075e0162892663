//! Heat maps: where an image is far from its reference.

use glam::{UVec2, Vec3};

use crate::film::Image;

/// Decades of error from black to white.
const LEAST_LOG10: f64 = -4.0;

/// Linear colours of relative squared errors 1e-4, 1e-3, 0.01, 0.1 and 1, getting brighter throughout.
const COLOURS: [Vec3; 5] = [
    Vec3::ZERO,
    Vec3::new(0.04, 0.02, 0.25),
    Vec3::new(0.45, 0.03, 0.15),
    Vec3::new(0.95, 0.35, 0.02),
    Vec3::new(1.0, 1.0, 0.8),
];

/// What is not a number.
const BAD: Vec3 = Vec3::new(0.0, 1.0, 0.0);

/// What the colours of [`heat_map`] mean, for captions.
pub const LEGEND: &str = "black up to 1e-4, blue 1e-3, red 0.01, orange 0.1, white from 1";

/// A picture of relative squared errors, a row from the top after the other: black up to 1e-4, then blue, red, orange, and white from 1 on, logarithmic; green
/// where a pixel is not finite.
pub fn heat_map(size: UVec2, errors: &[f64]) -> Image {
    let colours: Vec<Vec3> = errors.iter().map(|&error| colour(error)).collect();
    Image::of_colours(size, &colours)
}

fn colour(error: f64) -> Vec3 {
    if error.is_nan() {
        return BAD;
    }
    let at = (error.log10() - LEAST_LOG10).clamp(0.0, -LEAST_LOG10);
    let below = (at as usize).min(COLOURS.len() - 2);
    COLOURS[below].lerp(COLOURS[below + 1], (at - below as f64) as f32)
}

#[cfg(test)]
mod tests {
    use super::{BAD, COLOURS, colour};

    #[test]
    fn colours_follow_decades() {
        for (i, expected) in COLOURS.iter().enumerate() {
            assert!(colour(10f64.powi(i as i32 - 4)).distance(*expected) < 1e-5, "{i}");
        }
        assert_eq!((colour(0.0), colour(1e9)), (COLOURS[0], COLOURS[4]));
        assert_eq!(colour(f64::NAN), BAD);
        assert!(colour(10f64.powf(-1.5)).distance((COLOURS[2] + COLOURS[3]) * 0.5) < 1e-5);
    }
}
