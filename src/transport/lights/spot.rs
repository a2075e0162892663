//! A point light that shines into a cone.

use std::f64::consts::TAU;

use glam::{Vec2, Vec3};

use super::super::bsdf::Frame;
use crate::scene::{Rgb, Spot};

/// A spot light, ready to be sampled.
#[derive(Debug, Clone, Copy)]
pub(super) struct SpotLight {
    pub(super) position: Vec3,
    pub(super) intensity: Rgb,
    axis: Vec3,
    cutoff: f32,
    /// One over the angle in which intensity falls from full to nothing; 0 where it drops at once.
    inverse_transition: f32,
    /// 1 - cos(cutoff), which for a narrow cone is more precise than the cosine.
    cap_height: f32,
    /// Integral of the falloff over the sphere of directions.
    solid_angle: f64,
}

impl SpotLight {
    pub(super) fn new(spot: &Spot) -> Self {
        let Spot { position, axis, intensity, cutoff, beam_width } = *spot;
        let transition = cutoff - beam_width;
        let cap = |angle: f64| 2.0 * (0.5 * angle).sin().powi(2);
        // Of the falloff times the sine, integrated by parts.
        let solid_angle = if transition > 1e-6 {
            TAU * (1.0 - (cutoff.sin() - beam_width.sin()) / transition)
        } else {
            TAU * cap(cutoff)
        };
        Self {
            position,
            intensity,
            axis,
            cutoff: cutoff as f32,
            inverse_transition: if transition > 1e-6 { transition.recip() as f32 } else { 0.0 },
            cap_height: cap(cutoff) as f32,
            solid_angle,
        }
    }

    /// Intensity in unit direction `d`, away from the light.
    #[inline]
    pub(super) fn intensity(&self, d: Vec3) -> Rgb {
        // Of a narrow cone the cosine would tell little.
        let angle = self.axis.cross(d).length().atan2(self.axis.dot(d));
        let within = self.cutoff - angle;
        if within <= 0.0 {
            Rgb::ZERO
        } else if self.inverse_transition > 0.0 {
            self.intensity * (within * self.inverse_transition).min(1.0)
        } else {
            self.intensity
        }
    }

    /// Integral over all directions of the intensity over that on the axis.
    pub(super) fn solid_angle(&self) -> f64 {
        self.solid_angle
    }

    /// Draws a direction, uniform in the cone.
    #[inline]
    pub(super) fn sample(&self, u: Vec2) -> Vec3 {
        let height = u.x * self.cap_height;
        let (sin_phi, cos_phi) = (std::f32::consts::TAU * u.y).sin_cos();
        let r = (height * (2.0 - height)).max(0.0).sqrt();
        Frame::from_z(self.axis).to_world(Vec3::new(r * cos_phi, r * sin_phi, 1.0 - height)).normalize()
    }

    /// Density per solid angle of [`sample`](Self::sample).
    #[inline]
    pub(super) fn pdf_w(&self, d: Vec3) -> f32 {
        // Chords tell small angles apart, which cosines do not. Both vectors are rounded.
        const ROUNDING: f32 = 4.0 * f32::EPSILON;
        let inside = d.distance(self.axis) <= (2.0 * self.cap_height).sqrt() + ROUNDING;
        if inside { 1.0 / (std::f32::consts::TAU * self.cap_height) } else { 0.0 }
    }
}
