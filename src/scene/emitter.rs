//! Lights that are not surfaces, as the scene file states them; [`crate::transport::lights`] samples them.

use glam::{DMat3, UVec2, Vec3};

use super::Rgb;

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
    size: UVec2,
    texels: Vec<[f32; 3]>,
    scale: f32,
    to_world: DMat3,
}

impl EnvironmentMap {
    /// A map from rows of texels, the first row first. `to_world` takes the map's space to the world. `None` unless there are at
    /// least 2 columns, 3 rows and as many texels as that makes, all finite and 0 or more; `scale` is too; and
    /// `to_world` is a rotation, perhaps with a reflection or an even scale, which has no effect.
    pub fn new(size: UVec2, texels: Vec<[f32; 3]>, scale: f32, to_world: DMat3) -> Option<Self> {
        let count = u64::from(size.x) * u64::from(size.y);
        let valid = |x: &f32| *x >= 0.0 && x.is_finite();
        let length = to_world.x_axis.length();
        let to_world = to_world * length.recip();
        let orthogonal = (to_world.transpose() * to_world).abs_diff_eq(DMat3::IDENTITY, 1e-3);
        (size.x >= 2
            && size.y >= 3
            && texels.len() as u64 == count
            && texels.iter().flatten().all(valid)
            && valid(&scale)
            && orthogonal)
            .then_some(Self { size, texels, scale, to_world })
    }

    /// Columns and rows.
    pub fn size(&self) -> UVec2 {
        self.size
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
    pub fn texel(&self, column: usize, row: usize) -> Rgb {
        Rgb::from_array(self.texels[row * self.size.x as usize + column])
    }
}
