//! Lights that are not surfaces, as the scene file states them; [`crate::transport::lights`] samples them.

use std::sync::Arc;

use glam::{DMat3, UVec2, Vec3};

use super::{Image, Rgb};

/// A light that is not a surface. Area lights are [`Shape`](super::Shape)s with an [`emission`](super::Shape::emission).
/// Of [`Constant`](Self::Constant) and [`Map`](Self::Map), the environments, a scene has at most one; of several
/// the first counts.
#[derive(Debug, Clone, PartialEq)]
pub enum Emitter {
    /// A point that radiates the same in all directions.
    Point {
        /// World position.
        position: Vec3,
        /// Radiant intensity, W/sr.
        intensity: Rgb,
    },
    /// A point that radiates into a cone (Mitsuba's `spot`).
    Spot(Spot),
    /// Parallel light from infinitely far away (Mitsuba's `directional`).
    Directional {
        /// Unit direction in which the light travels.
        direction: Vec3,
        /// Irradiance on a surface that faces the light, W/m^2.
        irradiance: Rgb,
    },
    /// An environment of constant radiance, infinitely far away.
    Constant {
        /// Radiance from every direction.
        radiance: Rgb,
    },
    /// An environment given by an image (Mitsuba's `envmap`).
    Map(EnvironmentMap),
}

/// A point light whose intensity falls off linearly with the angle to its axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// World position.
    pub position: Vec3,
    /// Unit direction of the axis.
    pub axis: Vec3,
    /// Radiant intensity along the axis, W/sr.
    pub intensity: Rgb,
    /// Angle to the axis, radians, at and beyond which there is no light; at most pi.
    pub cutoff: f64,
    /// Angle to the axis, radians, up to which the intensity is constant; from 0 to `cutoff`.
    pub beam_width: f64,
}

/// Radiance by direction, in an image of latitude and longitude.
///
/// As in Mitsuba: in the map's own space +y is up. The first row is the direction +y, the last -y, rows between at equal angles.
/// Columns are centred at longitudes (i + 1/2) / width of a turn; longitude 0 looks to -z, a quarter to +x. Between, radiance
/// is interpolated bilinearly.
#[derive(Debug, Clone, PartialEq)]
pub struct EnvironmentMap {
    image: Arc<Image>,
    scale: f32,
    to_world: DMat3,
    sampling_columns: u32,
}

impl EnvironmentMap {
    /// A map from an image, whose values below 0 count as 0. `to_world` takes the map's space to the world. `None` unless there are at
    /// least 2 columns and 3 rows; `scale` and all texels times it are finite, and `scale` is 0 or more; and `to_world` is a rotation, perhaps with
    /// a reflection or an even scale, which has no effect.
    pub fn new(image: Arc<Image>, scale: f32, to_world: DMat3) -> Option<Self> {
        let to_world = to_world * to_world.x_axis.length().recip();
        let orthogonal = (to_world.transpose() * to_world).abs_diff_eq(DMat3::IDENTITY, 1e-3);
        let size = image.size();
        let finite = (0..size.y)
            .all(|row| (0..size.x).all(|column| (image.rgb(column, row, false) * scale).is_finite()));
        (size.x >= 2 && size.y >= 3 && scale >= 0.0 && scale.is_finite() && finite && orthogonal)
            .then_some(Self { image, scale, to_world, sampling_columns: size.x })
    }

    /// Has directions drawn by the luminance of a map of so many columns, from 2 on, and as many rows as go with them: a coarser one takes less memory, but follows small
    /// bright lights less closely. The image that a render converges to stays. More columns than the map has are as good as those.
    #[must_use]
    pub fn with_sampling_columns(mut self, columns: u32) -> Self {
        self.sampling_columns = columns.clamp(2, self.size().x);
        self
    }

    /// Columns of the map by whose luminance directions are drawn.
    pub fn sampling_columns(&self) -> u32 {
        self.sampling_columns
    }

    /// Columns and rows.
    pub fn size(&self) -> UVec2 {
        self.image.size()
    }

    /// What texels are multiplied by to be radiance.
    pub fn scale(&self) -> f32 {
        self.scale
    }

    /// The map's space to the world: an orthogonal matrix.
    pub fn to_world(&self) -> DMat3 {
        self.to_world
    }

    /// The texel of a column and a row, both in range, not scaled.
    #[inline]
    pub fn texel(&self, column: u32, row: u32) -> Rgb {
        self.image.rgb(column, row, false).max(Rgb::ZERO)
    }
}
