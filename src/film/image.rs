//! A developed image: named channels of plain numbers.

use std::borrow::Cow;

use crate::scene::PixelRect;
use glam::{UVec2, Vec3};

/// The pixels of one channel, row by row.
#[derive(Debug, Clone, PartialEq)]
pub enum Pixels {
    /// Numbers for which the precision of half floats is enough to look at: colours and directions.
    Colour(Vec<f32>),
    /// Numbers that need 32 bits: distances, positions, texture coordinates, variances.
    Float(Vec<f32>),
    /// Counts and identities.
    Integer(Vec<u32>),
}

/// A named channel of an [`Image`].
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Name as in `OpenEXR`: `R`, `albedo.R`, `Z`.
    pub name: Cow<'static, str>,
    /// One value per pixel of the crop window.
    pub pixels: Pixels,
}

/// An image: what a film holds after some number of passes.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Size of the full film in pixels.
    pub film_size: UVec2,
    /// The part of it that the channels hold.
    pub crop: PixelRect,
    /// The channels, the first three being `R`, `G`, `B`.
    pub channels: Vec<Channel>,
}

impl Image {
    /// An image of nothing but colours, row by row from the top.
    pub fn of_colours(size: UVec2, pixels: &[Vec3]) -> Self {
        let channel = |(name, c): (&'static str, usize)| Channel {
            name: Cow::Borrowed(name),
            pixels: Pixels::Colour(pixels.iter().map(|v| v[c]).collect()),
        };
        let channels = [("R", 0), ("G", 1), ("B", 2)].map(channel).into();
        Self { film_size: size, crop: PixelRect { min: UVec2::ZERO, size }, channels }
    }

    /// A channel of floating-point numbers by its name.
    pub fn floats(&self, name: &str) -> Option<&[f32]> {
        self.channels.iter().find(|c| c.name == name).and_then(|c| match &c.pixels {
            Pixels::Colour(values) | Pixels::Float(values) => Some(values.as_slice()),
            Pixels::Integer(_) => None,
        })
    }

    /// A channel of integers by its name.
    pub fn integers(&self, name: &str) -> Option<&[u32]> {
        self.channels.iter().find(|c| c.name == name).and_then(|c| match &c.pixels {
            Pixels::Integer(values) => Some(values.as_slice()),
            Pixels::Colour(_) | Pixels::Float(_) => None,
        })
    }
}
