//! The luminance of an environment by direction, as a density to draw directions by.
//!
//! The density is exactly proportional to the bilinear interpolation of luminance between texels: first a cell between four texels is drawn by the integral over its
//! solid angle, then a place in the cell. So [`LuminanceMap::pdf_w`] is the luminance over a constant: it has no seam where the map closes around, and at the poles nothing
//! is divided by a vanishing sine. The map may be coarser than the environment's own; then it is positive wherever that is.

use std::f64::consts::{PI, TAU};
use std::ops::{Add, Mul};

use glam::{DVec3, UVec2, Vec2};

use crate::sampling::distribution_2d::Distribution2d;

/// Luminance by latitude and longitude; columns and rows are as those of [`EnvironmentMap`](crate::scene::EnvironmentMap).
#[derive(Debug)]
pub(super) struct LuminanceMap {
    size: UVec2,
    texels: Vec<f32>,
    /// Over the cells between texels: one row less than there are of texels, and as many columns, because the last cell closes the circle.
    cells: Distribution2d,
    inverse_total: f32,
}

impl LuminanceMap {
    /// A map of so many columns, but no more than there are, with as many rows as go with them. `None` if it is black.
    pub(super) fn new(size: UVec2, columns: u32, luminance: impl Fn(u32, u32) -> f32) -> Option<Self> {
        if columns >= size.x {
            let texels = (0..size.y).flat_map(|row| (0..size.x).map(move |column| (column, row)));
            return Self::from_texels(size, texels.map(|(column, row)| luminance(column, row)).collect());
        }
        let bands = f64::from(size.y - 1) * f64::from(columns) / f64::from(size.x);
        let coarse = UVec2::new(columns.max(2), (bands.round() as u32 + 1).clamp(3, size.y));
        Self::from_texels(coarse, averages(size, coarse, luminance))
    }

    fn from_texels(size: UVec2, texels: Vec<f32>) -> Option<Self> {
        let (width, height) = (size.x as usize, size.y as usize);
        let mut weights = Vec::with_capacity(width * (height - 1));
        for row in 0..height - 1 {
            let (upper, lower) = Band::new(row, height).integrals();
            let (above, below) = (&texels[row * width..][..width], &texels[(row + 1) * width..][..width]);
            let both: Vec<f64> =
                above.iter().zip(below).map(|(a, b)| f64::from(*a) * upper + f64::from(*b) * lower).collect();
            let longitude = TAU / width as f64;
            weights.extend((0..width).map(|i| 0.5 * longitude * (both[i] + both[(i + 1) % width])));
        }
        let cells = Distribution2d::new(width, weights)?;
        let inverse_total = (1.0 / cells.total()) as f32;
        Some(Self { size, texels, cells, inverse_total })
    }

    /// Integral over the sphere of directions.
    pub(super) fn total(&self) -> f64 {
        self.cells.total()
    }

    /// Density per solid angle of [`sample`](Self::sample) at a position in the map.
    #[inline]
    pub(super) fn pdf_w(&self, position: Vec2) -> f32 {
        let texel = |column: u32, row: u32| self.texels[(row * self.size.x + column) as usize];
        Corners::around(position, self.size).interpolate(texel) * self.inverse_total
    }

    /// Draws a direction in the map's own space.
    #[inline]
    pub(super) fn sample(&self, u: Vec2) -> DVec3 {
        let (width, height) = (self.size.x as usize, self.size.y as usize);
        let cell = self.cells.sample(u);
        let right = (cell.column + 1) % width;
        let weight = |column, row| f64::from(self.texels[row * width + column]);
        let (a, b) = (weight(cell.column, cell.row), weight(right, cell.row));
        let (c, d) = (weight(cell.column, cell.row + 1), weight(right, cell.row + 1));
        let t = Band::new(cell.row, height).sample(f64::from(cell.rest.y), a + b, c + d);
        let s = sample_linear(f64::from(cell.rest.x), a + (c - a) * t, b + (d - b) * t);
        let phi = (cell.column as f64 + 0.5 + s) * (TAU / width as f64);
        let theta = (cell.row as f64 + t) * (PI / (height - 1) as f64);
        let ((sin_phi, cos_phi), (sin, cos)) = (phi.sin_cos(), theta.sin_cos());
        DVec3::new(sin_phi * sin, cos, -cos_phi * sin)
    }
}

/// Texels of a coarser map. Each is the mean of those around it, weighted as interpolation at their places weights it, so that wherever the finer map is positive the coarser one is.
fn averages(size: UVec2, coarse: UVec2, luminance: impl Fn(u32, u32) -> f32) -> Vec<f32> {
    let mut sums = vec![(0.0_f64, 0.0_f64); (coarse.x * coarse.y) as usize];
    for row in 0..size.y {
        for column in 0..size.x {
            let place = Vec2::new((column as f32 + 0.5) / size.x as f32, row as f32 / (size.y - 1) as f32);
            let value = f64::from(luminance(column, row));
            for (column, row, weight) in Corners::around(place, coarse).weights() {
                let (sum, weights) = &mut sums[(row * coarse.x + column) as usize];
                *sum += f64::from(weight) * value;
                *weights += f64::from(weight);
            }
        }
    }
    sums.into_iter().map(|(sum, weights)| if weights > 0.0 { (sum / weights) as f32 } else { 0.0 }).collect()
}

/// The four texels around a position.
pub(super) struct Corners {
    columns: [u32; 2],
    top: u32,
    /// Of the right column and the lower row.
    shares: Vec2,
}

impl Corners {
    /// Around a position in a map of a size: x in turns, y from 0 at the upper pole to 1 at the lower.
    #[inline]
    pub(super) fn around(position: Vec2, size: UVec2) -> Self {
        let (width, height) = (size.x, size.y);
        let x = (position.x * width as f32 - 0.5).rem_euclid(width as f32);
        let y = position.y * (height - 1) as f32;
        // `rem_euclid` may round up to the width.
        let (left, top) = ((x as u32).min(width - 1), (y as u32).min(height - 2));
        let right = if left + 1 == width { 0 } else { left + 1 };
        Self { columns: [left, right], top, shares: Vec2::new(x - left as f32, y - top as f32) }
    }

    /// Column, row and weight of each.
    #[inline]
    fn weights(&self) -> [(u32, u32, f32); 4] {
        let Self { columns: [left, right], top, shares: Vec2 { x, y } } = *self;
        let bottom = top + 1;
        let (upper, lower) = (1.0 - y, y);
        [
            (left, top, (1.0 - x) * upper),
            (right, top, x * upper),
            (left, bottom, (1.0 - x) * lower),
            (right, bottom, x * lower),
        ]
    }

    /// The value between those of texels.
    #[inline]
    pub(super) fn interpolate<T: Add<Output = T> + Mul<f32, Output = T>>(
        &self,
        texel: impl Fn(u32, u32) -> T,
    ) -> T {
        let Self { columns: [left, right], top, shares: Vec2 { x, y } } = *self;
        let row = |row| texel(left, row) * (1.0 - x) + texel(right, row) * x;
        row(top) * (1.0 - y) + row(top + 1) * y
    }
}

/// The angles from the pole between two rows of texels.
struct Band {
    start: f64,
    height: f64,
}

impl Band {
    fn new(row: usize, rows: usize) -> Self {
        let height = PI / (rows - 1) as f64;
        Self { start: row as f64 * height, height }
    }

    /// Integrals of sin theta over the band, weighted by what falls linearly from 1 to 0, and by what rises from 0 to 1.
    fn integrals(&self) -> (f64, f64) {
        let rising = self.integral(self.height, 0.0, 1.0);
        (self.integral(self.height, 1.0, 1.0) - rising, rising)
    }

    /// Integral of (a + (b - a) x / height) sin(start + x) from x = 0.
    fn integral(&self, x: f64, a: f64, b: f64) -> f64 {
        let slope = (b - a) / self.height;
        let ((sin_start, cos_start), (sin, cos)) = (self.start.sin_cos(), (self.start + x).sin_cos());
        a * cos_start - (a + slope * x) * cos + slope * (sin - sin_start)
    }

    /// Draws the fraction of the band's height by the density of [`integral`](Self::integral), by Newton's method within a shrinking bracket.
    fn sample(&self, u: f64, a: f64, b: f64) -> f64 {
        const STEPS: usize = 20;
        let wanted = u * self.integral(self.height, a, b);
        let (mut low, mut high) = (0.0, self.height);
        let mut x = u * self.height;
        for _ in 0..STEPS {
            let excess = self.integral(x, a, b) - wanted;
            if excess > 0.0 {
                high = x;
            } else {
                low = x;
            }
            let density = (a + (b - a) * x / self.height) * (self.start + x).sin();
            let next = x - excess / density;
            // Written so that NaN, where the density vanishes, halves the bracket.
            let next = if next > low && next < high { next } else { 0.5 * (low + high) };
            let done = (next - x).abs() < 1e-7 * self.height;
            x = next;
            if done {
                break;
            }
        }
        x / self.height
    }
}

/// Draws from [0, 1] with a density that goes linearly from `a` to `b`, both 0 or more.
#[inline]
fn sample_linear(u: f64, a: f64, b: f64) -> f64 {
    let root = (a * a + u * (b * b - a * a)).max(0.0).sqrt();
    if a + root > 0.0 { (u * (a + b) / (a + root)).min(1.0) } else { u }
}
