//! Reconstruction filters: the functions of Mitsuba's `rfilter` plugins, and the table that the film evaluates.
//!
//! A filter is a product f(x) f(y). The film needs f at all pixel centres around a point at once, for each sample of
//! each pass, so f is tabulated over the position within the pixel and interpolated linearly. The filter *is* that
//! piecewise linear function: its integral is known exactly, so a splat deposits its energy exactly, and since no
//! transcendental function is left, two machines agree to the last bit.

use crate::scene::Filter;
use std::f64::consts::PI;

/// Largest radius accepted, in pixels. A filter this wide costs 33 x 33 weights per sample.
pub const MAX_RADIUS: f32 = 16.0;

/// Table rows per pixel. The interpolation error is at most f'' / 8 / 1024^2, 5e-7 for the default Gaussian.
const RESOLUTION: usize = 1024;

/// Half the side in pixels of the square outside of which the filter is 0.
pub fn radius(filter: &Filter) -> f32 {
    match *filter {
        Filter::Box => 0.5,
        Filter::Tent { radius } => radius,
        Filter::Gaussian { stddev } => 4.0 * stddev,
        Filter::Mitchell { .. } => 2.0,
        Filter::Lanczos { lobes } => lobes as f32,
    }
}

/// The one-dimensional filter at `x` pixels from its centre, scaled as in Mitsuba (not normalised).
///
/// Mitsuba 3.9 evaluates its Gaussian by a polynomial that is off by up to 4e-4; this is the function it approximates.
pub fn evaluate(filter: &Filter, x: f64) -> f64 {
    let r = f64::from(radius(filter));
    let t = x.abs();
    match *filter {
        // Half-open, so that each point of the film belongs to one pixel.
        Filter::Box => f64::from((-0.5..0.5).contains(&x)),
        _ if t >= r => 0.0,
        Filter::Tent { .. } => 1.0 - t / r,
        Filter::Gaussian { stddev } => {
            let alpha = -0.5 / f64::from(stddev).powi(2);
            (alpha * t * t).exp() - (alpha * r * r).exp()
        }
        Filter::Mitchell { b, c } => mitchell(f64::from(b), f64::from(c), t),
        Filter::Lanczos { .. } => sinc(t) * sinc(t / r),
    }
}

/// Mitchell and Netravali 1988, "Reconstruction filters in computer graphics", equation 8, for `t` in [0, 2).
fn mitchell(b: f64, c: f64, t: f64) -> f64 {
    let cubic = |k3: f64, k2: f64, k1: f64, k0: f64| (((k3 * t + k2) * t + k1) * t + k0) / 6.0;
    if t < 1.0 {
        cubic(12.0 - 9.0 * b - 6.0 * c, -18.0 + 12.0 * b + 6.0 * c, 0.0, 6.0 - 2.0 * b)
    } else {
        cubic(-b - 6.0 * c, 6.0 * b + 30.0 * c, -12.0 * b - 48.0 * c, 8.0 * b + 24.0 * c)
    }
}

/// sin(pi x) / (pi x).
fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) }
}

/// A filter ready for use: normalised to integral 1 and tabulated.
#[derive(Debug, Clone)]
pub(super) struct FilterTable {
    border: usize,
    is_box: bool,
    /// `RESOLUTION + 1` rows of [`taps`](Self::taps) weights.
    rows: Vec<f32>,
}

impl FilterTable {
    /// Tabulates a filter. `None` if its radius is not in (0, [`MAX_RADIUS`]] or its integral is not positive.
    pub(super) fn new(filter: &Filter) -> Option<Self> {
        let radius = radius(filter);
        if !(radius > 0.0 && radius <= MAX_RADIUS) {
            return None;
        }
        if *filter == Filter::Box {
            // Its jump would fall on a row of the table; inside the pixel the weight is 1 everywhere.
            return Some(Self { border: 0, is_box: true, rows: vec![1.0; RESOLUTION + 1] });
        }
        let border = (radius - 0.5).ceil().max(0.0) as usize;
        let taps = 2 * border + 1;
        let weight = |row: usize, tap: usize| {
            let jitter = row as f64 / RESOLUTION as f64;
            evaluate(filter, jitter - 0.5 - (tap as f64 - border as f64))
        };
        let weights: Vec<f64> =
            (0..=RESOLUTION).flat_map(|row| (0..taps).map(move |tap| weight(row, tap))).collect();
        // The trapezoid rule is exact for what interpolation makes of the table.
        let ends = [&weights[..taps], &weights[RESOLUTION * taps..]];
        let half: f64 = ends.into_iter().flatten().sum::<f64>() / 2.0;
        let integral = (weights.iter().sum::<f64>() - half) / RESOLUTION as f64;
        (integral.is_finite() && integral > 0.0).then(|| Self {
            border,
            is_box: false,
            rows: weights.iter().map(|w| (w / integral) as f32).collect(),
        })
    }

    /// How many pixels beyond its own a sample reaches, in each direction.
    pub(super) fn border(&self) -> usize {
        self.border
    }

    /// Number of pixels along one axis that a sample reaches.
    pub(super) fn taps(&self) -> usize {
        2 * self.border + 1
    }

    /// Whether every sample counts for its own pixel alone, and fully.
    pub(super) fn is_box(&self) -> bool {
        self.is_box
    }

    /// The weights of a sample at `jitter` in [0, 1] within its pixel: the tap `border + d` is for the pixel `d` further on.
    /// `taps` is [`taps`](Self::taps), as a constant where that is known.
    #[inline(always)]
    pub(super) fn weights(&self, jitter: f32, taps: usize) -> impl Iterator<Item = f32> {
        let position = jitter * RESOLUTION as f32;
        let row = (position as usize).min(RESOLUTION - 1);
        let t = position - row as f32;
        let (below, above) = self.rows[row * taps..][..2 * taps].split_at(taps);
        below.iter().zip(above).map(move |(a, b)| a + t * (b - a))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILTERS: [Filter; 9] = [
        Filter::Box,
        Filter::Tent { radius: 1.0 },
        Filter::Tent { radius: 1.5 },
        Filter::Tent { radius: 0.3 },
        Filter::Gaussian { stddev: 0.5 },
        Filter::Gaussian { stddev: 0.8 },
        Filter::Mitchell { b: 1.0 / 3.0, c: 1.0 / 3.0 },
        Filter::Mitchell { b: 0.0, c: 0.5 },
        Filter::Lanczos { lobes: 3 },
    ];

    /// Integral of `evaluate` by the midpoint rule on intervals so small that only rounding is left.
    fn integral(filter: &Filter) -> f64 {
        let r = f64::from(radius(filter));
        let n = 400_000;
        (0..n).map(|i| evaluate(filter, (f64::from(i) + 0.5) / f64::from(n) * 2.0 * r - r)).sum::<f64>()
            * 2.0
            * r
            / f64::from(n)
    }

    #[test]
    fn table_is_the_normalised_filter() {
        for filter in FILTERS {
            let table = FilterTable::new(&filter).unwrap();
            let scale = 1.0 / integral(&filter);
            // The tent of radius 0.3 has its kinks off the grid: there the error is the slope's change over 8 rows.
            let tolerance = if filter == (Filter::Tent { radius: 0.3 }) { 0.01 } else { 2e-6 };
            for i in 0..1000 {
                let jitter = i as f32 / 1000.0;
                for (tap, w) in table.weights(jitter, table.taps()).enumerate() {
                    let x = f64::from(jitter) - 0.5 - (tap as f64 - table.border() as f64);
                    let expected = evaluate(&filter, x) * scale;
                    let w = f64::from(w);
                    assert!((w - expected).abs() < tolerance, "{filter:?} at {x}: {w} {expected}");
                }
            }
        }
    }

    #[test]
    fn table_integrates_to_one() {
        for filter in FILTERS {
            let table = FilterTable::new(&filter).unwrap();
            let n = 1 << 14;
            let mut sum = 0.0;
            for i in 0..n {
                sum += table.weights((i as f32 + 0.5) / n as f32, table.taps()).map(f64::from).sum::<f64>();
            }
            assert!((sum / f64::from(n) - 1.0).abs() < 1e-7, "{filter:?}: {}", sum / f64::from(n));
        }
    }

    #[test]
    fn nothing_outside_the_border() {
        for filter in FILTERS {
            let border = FilterTable::new(&filter).unwrap().border() as f64;
            assert_eq!(evaluate(&filter, border + 1.5), 0.0);
            assert_eq!(evaluate(&filter, border + 0.5), 0.0, "{filter:?}");
        }
    }

    #[test]
    fn senseless_filters_are_refused() {
        for filter in [
            Filter::Tent { radius: 0.0 },
            Filter::Tent { radius: -1.0 },
            Filter::Tent { radius: f32::NAN },
            Filter::Tent { radius: f32::INFINITY },
            Filter::Gaussian { stddev: 5.0 },
            Filter::Lanczos { lobes: 0 },
            Filter::Lanczos { lobes: u32::MAX },
            Filter::Mitchell { b: f32::NAN, c: 0.0 },
            // Mitchell's integral is 1 for any B and C, but not one that f64 could find among such terms.
            Filter::Mitchell { b: f32::INFINITY, c: 0.0 },
        ] {
            assert!(FilterTable::new(&filter).is_none(), "{filter:?}");
        }
    }
}
