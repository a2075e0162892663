//! Light from infinitely far away, by direction: constant, or an image, which is sampled by its [luminance](LuminanceMap).

use std::f64::consts::PI;

use glam::{Mat3, Vec2, Vec3};

use super::luminance_map::{Corners, LuminanceMap};
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
    density: LuminanceMap,
    brightest: f32,
}

impl<'s> Environment<'s> {
    /// A map by whose luminance in so many columns directions are drawn. `None` if it is black.
    pub(super) fn from_map(map: &'s EnvironmentMap, columns: u32) -> Option<Self> {
        MapSampler::new(map, columns).map(Self::Map)
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
            Self::Map(map) => map.density.pdf_w(map.position(d)),
        }
    }

    /// Integral of the luminance over the sphere of directions, as it is drawn from.
    pub(super) fn fluence(&self) -> f64 {
        match self {
            Self::Constant(radiance) => 4.0 * PI * f64::from(luminance(*radiance)),
            Self::Map(map) => map.density.total() * f64::from(map.map.scale()),
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
    fn new(map: &'s EnvironmentMap, columns: u32) -> Option<Self> {
        let mut brightest = 0.0_f32;
        for row in 0..map.size().y {
            for column in 0..map.size().x {
                brightest = brightest.max(map.texel(column, row).max_element());
            }
        }
        let texel = |column, row| luminance(map.texel(column, row));
        let density = LuminanceMap::new(map.size(), columns, texel)?;
        let to_world = map.to_world().as_mat3();
        Some(Self { map, to_world, to_map: to_world.transpose(), density, brightest })
    }

    /// Where a direction is in the map: its part of a turn, within half a turn of 0, and of the way from the upper to the lower pole.
    #[inline]
    fn position(&self, d: Vec3) -> Vec2 {
        let d = self.to_map * d;
        let turn = d.x.atan2(-d.z) * (1.0 / std::f32::consts::TAU);
        // Unlike the arc cosine this is accurate at the poles.
        Vec2::new(turn, d.x.hypot(d.z).atan2(d.y) * std::f32::consts::FRAC_1_PI)
    }

    /// The interpolated texel that is seen in a direction.
    #[inline]
    fn texture(&self, d: Vec3) -> Rgb {
        let corners = Corners::around(self.position(d), self.map.size());
        corners.interpolate(|column, row| self.map.texel(column, row))
    }

    #[inline]
    fn sample(&self, u: Vec2) -> Vec3 {
        self.to_world * self.density.sample(u).as_vec3()
    }
}
