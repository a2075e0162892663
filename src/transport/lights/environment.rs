//! Light from infinitely far away, by direction: constant, or an image.
//!
//! An image is sampled with a density exactly proportional to the luminance of its bilinear interpolation: first a cell between four texels
//! by the integral over its solid angle, then a place in the cell. So [`Environment::pdf_w`] is the luminance over a constant: it has
//! no seam where the image closes around, and at the poles nothing is divided by a vanishing sine.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Mat3, Vec2, Vec3};

use crate::sampling::distribution_2d::Distribution2d;
use crate::sampling::warp::{UNIFORM_SPHERE_PDF, square_to_sphere};
use crate::scene::{EnvironmentMap, Rgb, luminance};

/// An environment, ready to be sampled. Directions are unit vectors in the world that point to where light comes from.
#[derive(Debug)]
pub(super) enum Environment<'s> {
    Constant(Rgb),
    Map(MapSampler<'s>),
}

#[derive(Debug)]
pub(super) struct MapSampler<'s> {
    map: &'s EnvironmentMap,
    to_world: Mat3,
    to_map: Mat3,
    /// Over the cells between texels: one row less than there are of texels, and as many columns, because the last cell closes the circle.
    cells: Distribution2d,
    /// One over the integral of the unscaled luminance over the sphere.
    inverse_total: f32,
    brightest: f32,
}

impl<'s> Environment<'s> {
    /// `None` for a map that is black.
    pub(super) fn from_map(map: &'s EnvironmentMap) -> Option<Self> {
        MapSampler::new(map).map(Self::Map)
    }

    /// Radiance from a direction.
    #[inline]
    pub(super) fn le(&self, d: Vec3) -> Rgb {
        match self {
            Self::Constant(radiance) => *radiance,
            Self::Map(map) => map.texture(d) * map.map.scale(),
        }
    }

    /// Draws a direction.
    #[inline]
    pub(super) fn sample(&self, u: Vec2) -> Vec3 {
        match self {
            Self::Constant(_) => square_to_sphere(u),
            Self::Map(map) => map.sample(u),
        }
    }

    /// Density per solid angle of [`sample`](Self::sample).
    #[inline]
    pub(super) fn pdf_w(&self, d: Vec3) -> f32 {
        match self {
            Self::Constant(_) => UNIFORM_SPHERE_PDF,
            Self::Map(map) => luminance(map.texture(d)) * map.inverse_total,
        }
    }

    /// Integral of the luminance over the sphere of directions.
    pub(super) fn fluence(&self) -> f64 {
        match self {
            Self::Constant(radiance) => 4.0 * PI * f64::from(luminance(*radiance)),
            Self::Map(map) => map.cells.total() * f64::from(map.map.scale()),
        }
    }

    /// The greatest component of radiance.
    pub(super) fn brightest(&self) -> f32 {
        match self {
            Self::Constant(radiance) => radiance.max_element(),
            Self::Map(map) => map.brightest * map.map.scale(),
        }
    }
}

impl<'s> MapSampler<'s> {
    fn new(map: &'s EnvironmentMap) -> Option<Self> {
        let (width, height) = (map.size().x as usize, map.size().y as usize);
        let mut brightest = 0.0_f32;
        let luminances =
            |row: usize| (0..width).map(move |column| luminance(map.texel(column as u32, row as u32)));
        let mut weights = Vec::with_capacity(width * (height - 1));
        for row in 0..height - 1 {
            let (upper, lower) = Band::new(row, height).integrals();
            let both: Vec<f64> = luminances(row)
                .zip(luminances(row + 1))
                .map(|(a, b)| f64::from(a) * upper + f64::from(b) * lower)
                .collect();
            let longitude = TAU / width as f64;
            weights.extend((0..width).map(|i| 0.5 * longitude * (both[i] + both[(i + 1) % width])));
        }
        for row in 0..height {
            for column in 0..width {
                brightest = brightest.max(map.texel(column as u32, row as u32).max_element());
            }
        }
        let cells = Distribution2d::new(width, weights)?;
        let inverse_total = (1.0 / cells.total()) as f32;
        let to_world = map.to_world().as_mat3();
        Some(Self { map, to_world, to_map: to_world.transpose(), cells, inverse_total, brightest })
    }

    /// The interpolated texel that is seen in a direction.
    #[inline]
    fn texture(&self, d: Vec3) -> Rgb {
        let (width, height) = (self.map.size().x as usize, self.map.size().y as usize);
        let d = self.to_map * d;
        let turn = d.x.atan2(-d.z) * (1.0 / std::f32::consts::TAU);
        // Unlike the arc cosine this is accurate at the poles.
        let latitude = d.x.hypot(d.z).atan2(d.y) * std::f32::consts::FRAC_1_PI;
        let x = (turn * width as f32 - 0.5).rem_euclid(width as f32);
        let y = latitude * (height - 1) as f32;
        // `rem_euclid` may round up to the width.
        let (left, top) = ((x as usize).min(width - 1), (y as usize).min(height - 2));
        let right = if left + 1 == width { 0 } else { left + 1 };
        let (s, t) = (x - left as f32, y - top as f32);
        let row = |row| {
            self.map.texel(left as u32, row as u32) * (1.0 - s) + self.map.texel(right as u32, row as u32) * s
        };
        row(top) * (1.0 - t) + row(top + 1) * t
    }

    #[inline]
    fn sample(&self, u: Vec2) -> Vec3 {
        let (width, height) = (self.map.size().x as usize, self.map.size().y as usize);
        let cell = self.cells.sample(u);
        let right = (cell.column + 1) % width;
        let weight = |column, row| f64::from(luminance(self.map.texel(column as u32, row as u32)));
        let (a, b) = (weight(cell.column, cell.row), weight(right, cell.row));
        let (c, d) = (weight(cell.column, cell.row + 1), weight(right, cell.row + 1));
        let t = Band::new(cell.row, height).sample(f64::from(cell.rest.y), a + b, c + d);
        let s = sample_linear(f64::from(cell.rest.x), a + (c - a) * t, b + (d - b) * t);
        let phi = (cell.column as f64 + 0.5 + s) * (TAU / width as f64);
        let theta = (cell.row as f64 + t) * (PI / (height - 1) as f64);
        let ((sin_phi, cos_phi), (sin, cos)) = (phi.sin_cos(), theta.sin_cos());
        self.to_world * DVec3::new(sin_phi * sin, cos, -cos_phi * sin).as_vec3()
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
