//! Arbitrary output variables: what else than radiance an image can hold.
//!
//! Names of channels follow `OpenEXR` (`Z`), pbrt-v4 (`P`, `N` geometric, `Ns` shading) and Mitsuba (`uv.U`, `albedo.R`).

use crate::scene::Rgb;
use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

/// One kind of arbitrary output variable.
///
/// Those that describe the first surface seen are averages, by a box filter, over the samples of the pixel itself that
/// hit something; 0 where nothing was hit. Averages of normals are not of unit length.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Aov {
    /// `Z`: distance along the camera ray.
    Depth,
    /// `P.X`, `P.Y`, `P.Z`: world position.
    Position,
    /// `N.X`, `N.Y`, `N.Z`: world geometric normal.
    GeometricNormal,
    /// `Ns.X`, `Ns.Y`, `Ns.Z`: world shading normal. Denoisers take this one.
    ShadingNormal,
    /// `albedo.R`, `albedo.G`, `albedo.B`: fraction of light that is scattered.
    Albedo,
    /// `uv.U`, `uv.V`: texture coordinates.
    Uv,
    /// `id.shape`: index of the shape, of the lowest pass; [`NO_ID`] where nothing was hit. An integer channel.
    ShapeId,
    /// `id.primitive`: index of the triangle, of the lowest pass; [`NO_ID`] where nothing was hit. An integer channel.
    PrimitiveId,
    /// `sampleCount`: samples taken in the pixel without those that were dropped. An integer channel.
    SampleCount,
    /// `variance.R`, `variance.G`, `variance.B`: estimated variance of the pixel's mean, without splats.
    Variance,
}

impl Aov {
    /// All kinds, in the order of their channels.
    pub const ALL: [Self; 10] = [
        Self::Depth,
        Self::Position,
        Self::GeometricNormal,
        Self::ShadingNormal,
        Self::Albedo,
        Self::Uv,
        Self::ShapeId,
        Self::PrimitiveId,
        Self::SampleCount,
        Self::Variance,
    ];

    /// The name by which people ask for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Depth => "depth",
            Self::Position => "position",
            Self::GeometricNormal => "geometric_normal",
            Self::ShadingNormal => "shading_normal",
            Self::Albedo => "albedo",
            Self::Uv => "uv",
            Self::ShapeId => "shape_id",
            Self::PrimitiveId => "primitive_id",
            Self::SampleCount => "sample_count",
            Self::Variance => "variance",
        }
    }

    /// The kind with the given [`name`](Self::name).
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|aov| aov.name() == name)
    }
}

/// Which AOVs an image has.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct AovSet(u16);

impl AovSet {
    /// Whether an AOV is in the set.
    #[inline]
    pub fn contains(self, aov: Aov) -> bool {
        self.0 >> aov as u16 & 1 == 1
    }

    /// The AOVs in the order of [`Aov::ALL`].
    pub fn iter(self) -> impl Iterator<Item = Aov> {
        Aov::ALL.into_iter().filter(move |&aov| self.contains(aov))
    }

    /// Whether an [`AovRecord`] must be filled for each sample.
    pub fn needs_records(self) -> bool {
        self.iter().any(|aov| !matches!(aov, Aov::SampleCount | Aov::Variance))
    }

    /// Whether one of the ids is in the set.
    pub(super) fn has_ids(self) -> bool {
        self.contains(Aov::ShapeId) || self.contains(Aov::PrimitiveId)
    }

    /// The averaged channels in the set, as indices into [`AVERAGED`].
    pub(super) fn averaged(self) -> Vec<usize> {
        (0..AVERAGED.len()).filter(|&i| self.contains(AVERAGED[i].aov)).collect()
    }
}

impl FromIterator<Aov> for AovSet {
    fn from_iter<I: IntoIterator<Item = Aov>>(aovs: I) -> Self {
        Self(aovs.into_iter().fold(0, |bits, aov| bits | 1 << aov as u16))
    }
}

/// Identity of nothing.
pub const NO_ID: u32 = u32::MAX;

/// What one camera sample saw first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AovRecord {
    /// Index of the shape; [`NO_ID`] if nothing was hit, and then nothing else counts.
    pub shape: u32,
    /// Index of the triangle in its mesh; 0 for other shapes.
    pub primitive: u32,
    /// Distance along the camera ray.
    pub depth: f32,
    /// World position.
    pub position: Vec3,
    /// World geometric normal.
    pub ng: Vec3,
    /// World shading normal.
    pub ns: Vec3,
    /// Fraction of light that is scattered.
    pub albedo: Rgb,
    /// Texture coordinates.
    pub uv: Vec2,
}

impl AovRecord {
    /// The record of a sample that hit nothing.
    pub const MISS: Self = Self {
        shape: NO_ID,
        primitive: NO_ID,
        depth: 0.0,
        position: Vec3::ZERO,
        ng: Vec3::ZERO,
        ns: Vec3::ZERO,
        albedo: Vec3::ZERO,
        uv: Vec2::ZERO,
    };

    /// Whether something was hit.
    #[inline]
    pub fn is_hit(&self) -> bool {
        self.shape != NO_ID
    }

    /// The values in the order of [`AVERAGED`].
    #[inline]
    pub(super) fn values(&self) -> [f32; AVERAGED.len()] {
        let Self { depth, position: p, ng, ns, albedo: c, uv, .. } = *self;
        [depth, p.x, p.y, p.z, ng.x, ng.y, ng.z, ns.x, ns.y, ns.z, c.x, c.y, c.z, uv.x, uv.y]
    }
}

/// A channel that is an average over hits.
pub(super) struct Averaged {
    /// The AOV it belongs to.
    pub(super) aov: Aov,
    /// Its name in files.
    pub(super) channel: &'static str,
}

const fn averaged(aov: Aov, channel: &'static str) -> Averaged {
    Averaged { aov, channel }
}

/// All averaged channels.
pub(super) const AVERAGED: [Averaged; 15] = [
    averaged(Aov::Depth, "Z"),
    averaged(Aov::Position, "P.X"),
    averaged(Aov::Position, "P.Y"),
    averaged(Aov::Position, "P.Z"),
    averaged(Aov::GeometricNormal, "N.X"),
    averaged(Aov::GeometricNormal, "N.Y"),
    averaged(Aov::GeometricNormal, "N.Z"),
    averaged(Aov::ShadingNormal, "Ns.X"),
    averaged(Aov::ShadingNormal, "Ns.Y"),
    averaged(Aov::ShadingNormal, "Ns.Z"),
    averaged(Aov::Albedo, "albedo.R"),
    averaged(Aov::Albedo, "albedo.G"),
    averaged(Aov::Albedo, "albedo.B"),
    averaged(Aov::Uv, "uv.U"),
    averaged(Aov::Uv, "uv.V"),
];
