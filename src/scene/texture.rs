//! Textures as plain data, and their values as functions of texture coordinates.
//!
//! A [`Texture`] is evaluated as a colour, a number, or a number with its slope (for bump maps). It knows nothing of
//! materials; a parameter that may be textured is an [`Input`]. Mesh attributes apart, textures depend on texture coordinates alone.
//!
//! Meaning and conventions are those of Mitsuba 3's plugins of the same names: (0, 0) is the corner of the image's
//! first texel, rows run from the top, texels are converted to linear colour before they are interpolated.

use std::sync::Arc;

use glam::{Affine2, Vec2};

use super::{Geometry, Image, Rgb, Scene, Shape, SurfacePoint, luminance};

/// Index into [`Scene::textures`](super::Scene::textures).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TextureId(pub u32);

/// A parameter that is the same everywhere on a surface, or varies over it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Input<T> {
    /// The same everywhere.
    Constant(T),
    /// A texture's value.
    Texture(TextureId),
}

impl<T> From<T> for Input<T> {
    fn from(value: T) -> Self {
        Self::Constant(value)
    }
}

/// The textures of a scene, and the shapes whose meshes they may ask for attributes.
#[derive(Debug, Clone, Copy)]
pub struct Textures<'a> {
    all: &'a [Texture],
    shapes: &'a [Shape],
}

/// Where a texture is evaluated.
#[derive(Debug, Clone, Copy)]
pub struct Place<'p> {
    /// Texture coordinates.
    pub uv: Vec2,
    /// The point on a surface, without which attributes of meshes are black.
    pub point: Option<&'p SurfacePoint>,
}

impl<'p> From<&'p SurfacePoint> for Place<'p> {
    #[inline]
    fn from(point: &'p SurfacePoint) -> Self {
        Self { uv: point.uv, point: Some(point) }
    }
}

impl Input<Rgb> {
    /// The value at a place.
    #[inline]
    pub fn at(self, textures: Textures, place: Place) -> Rgb {
        match self {
            Self::Constant(color) => color,
            Self::Texture(id) => textures.color(id, place),
        }
    }
}

impl Input<f32> {
    /// The value at a place; of a coloured texture its luminance.
    #[inline]
    pub fn at(self, textures: Textures, place: Place) -> f32 {
        match self {
            Self::Constant(value) => value,
            Self::Texture(id) => textures.number(id, place),
        }
    }
}

/// What is found between the centres of texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TexelFilter {
    /// The nearest texel.
    Nearest,
    /// Bilinear interpolation.
    Bilinear,
}

/// What is found beyond the unit square.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wrap {
    /// The image again.
    Repeat,
    /// The image mirrored.
    Mirror,
    /// The texel at the edge.
    Clamp,
}

/// An image as a texture.
#[derive(Debug, Clone)]
pub struct Bitmap {
    /// The image; all textures of one file share it.
    pub image: Arc<Image>,
    /// Texels are numbers as they are, not sRGB colours.
    pub raw: bool,
    /// Interpolation.
    pub filter: TexelFilter,
    /// Continuation beyond the unit square.
    pub wrap: Wrap,
    /// The surface's texture coordinates to those of the image.
    pub to_uv: Affine2,
}

/// A function of the place on a surface.
///
/// A texture that is made of others may only refer to those before it in [`Scene::textures`](super::Scene::textures): this
/// bounds the depth. Other references are black.
#[derive(Debug, Clone)]
pub enum Texture {
    /// An image.
    Bitmap(Bitmap),
    /// Squares of half a unit in two colours.
    Checkerboard {
        /// Of the square at the origin.
        color0: Input<Rgb>,
        /// Of the squares beside it.
        color1: Input<Rgb>,
        /// The surface's texture coordinates to those of the squares.
        to_uv: Affine2,
    },
    /// A texture times a colour.
    Scale {
        /// The texture.
        texture: TextureId,
        /// The factor.
        factor: Rgb,
    },
    /// An attribute of the mesh that the surface belongs to: interpolated between vertices, or constant on triangles. Of one or two
    /// channels the first is taken for grey. Black on shapes without it.
    MeshAttribute {
        /// Its name, `vertex_...` or `face_...`.
        name: String,
        /// Factor on it.
        scale: f32,
    },
}

impl<'a> Textures<'a> {
    /// Textures without a scene around them.
    pub fn new(all: &'a [Texture]) -> Self {
        Self { all, shapes: &[] }
    }

    /// Those of a scene.
    #[inline]
    pub fn of(scene: &'a Scene) -> Self {
        Self { all: &scene.textures, shapes: &scene.shapes }
    }

    /// A texture, and those that it may be made of.
    #[inline]
    fn get(self, id: TextureId) -> Option<(&'a Texture, Self)> {
        let (texture, before) = self.all.get(..=id.0 as usize)?.split_last()?;
        Some((texture, Self { all: before, ..self }))
    }

    /// The colour of a texture. Non-finite coordinates, which loaders do not let through, give some texel.
    #[inline(never)] // Out of the way of paths without textures.
    pub fn color(self, id: TextureId, place: Place) -> Rgb {
        self.get(id).map_or(Rgb::ZERO, |(texture, before)| texture.color(before, place))
    }

    /// The number of a texture: the luminance of its colour. But of a checkerboard the squares change places, as they do in
    /// Mitsuba 3.9 where a number is asked for.
    #[inline(never)]
    pub fn number(self, id: TextureId, place: Place) -> f32 {
        match self.get(id) {
            Some((&Texture::Checkerboard { color0, color1, to_uv }, before)) => {
                let swapped = Texture::Checkerboard { color0: color1, color1: color0, to_uv };
                luminance(swapped.color(before, place))
            }
            _ => luminance(self.color(id, place)),
        }
    }

    /// The slope along u and v of the number that a texture gives. 0 where steps have none: in checkerboards, and in bitmaps
    /// without interpolation; and for attributes of meshes.
    #[inline]
    pub fn slope(self, id: TextureId, uv: Vec2) -> Vec2 {
        match self.get(id) {
            Some((Texture::Bitmap(bitmap), _)) if bitmap.filter == TexelFilter::Bilinear => bitmap.slope(uv),
            // Only grey factors commute with the luminance; loaders give bump maps no others.
            Some((Texture::Scale { texture, factor }, before)) => {
                before.slope(*texture, uv) * luminance(*factor)
            }
            _ => Vec2::ZERO,
        }
    }

    /// A colour that an input on a shape nowhere exceeds, per channel.
    pub fn bound(self, input: Input<Rgb>, shape: &Shape) -> Rgb {
        let id = match input {
            Input::Constant(color) => return color,
            Input::Texture(id) => id,
        };
        let Some((texture, before)) = self.get(id) else { return Rgb::ZERO };
        match texture {
            Texture::Bitmap(bitmap) => Rgb::splat(bitmap.image.max_value()),
            Texture::Checkerboard { color0, color1, .. } => {
                before.bound(*color0, shape).max(before.bound(*color1, shape))
            }
            Texture::Scale { texture, factor } => before.bound(Input::Texture(*texture), shape) * *factor,
            Texture::MeshAttribute { name, scale } => match &shape.geometry {
                Geometry::Mesh(mesh) => {
                    let values = mesh.attribute(name).map_or(&[][..], |a| &a.values);
                    Rgb::splat(values.iter().fold(0.0, |max: f32, v| max.max(v * scale)))
                }
                Geometry::Analytic(_) | Geometry::Instance(_) => Rgb::ZERO,
            },
        }
    }

    /// Calls `found` with the name of every mesh attribute that a texture is made of.
    pub fn each_attribute(self, id: TextureId, found: &mut impl FnMut(&str)) {
        let Some((texture, before)) = self.get(id) else { return };
        match texture {
            Texture::Bitmap(_) => {}
            Texture::MeshAttribute { name, .. } => found(name),
            Texture::Scale { texture, .. } => before.each_attribute(*texture, found),
            Texture::Checkerboard { color0, color1, .. } => {
                for input in [color0, color1] {
                    if let Input::Texture(id) = input {
                        before.each_attribute(*id, found);
                    }
                }
            }
        }
    }
}

impl Texture {
    /// The colour; `before` are the textures that this one may be made of.
    #[inline]
    fn color(&self, before: Textures, place: Place) -> Rgb {
        match self {
            Self::Bitmap(bitmap) => bitmap.color(place.uv),
            Self::Checkerboard { color0, color1, to_uv } => {
                let q = to_uv.transform_point2(place.uv);
                let right = (q - q.floor()).cmpgt(Vec2::splat(0.5));
                if right.x == right.y { color0 } else { color1 }.at(before, place)
            }
            Self::Scale { texture, factor } => before.color(*texture, place) * *factor,
            Self::MeshAttribute { name, scale } => {
                let value = place.point.and_then(|point| point.mesh_attribute(before.shapes, name));
                value.unwrap_or(Rgb::ZERO) * *scale
            }
        }
    }
}

/// The four texels around a point, and where it lies between them.
struct Cell {
    texels: [[Rgb; 2]; 2],
    fraction: Vec2,
}

impl Bitmap {
    /// The colour at `uv`.
    #[inline]
    pub fn color(&self, uv: Vec2) -> Rgb {
        match self.filter {
            TexelFilter::Nearest => {
                let q = self.to_uv.transform_point2(uv) * self.image.size().as_vec2();
                let [x, y] = q.floor().as_ivec2().to_array();
                self.texel(x, y)
            }
            TexelFilter::Bilinear => {
                let Cell { texels: [[a, b], [c, d]], fraction } = self.cell(uv);
                let (top, bottom) = (a.lerp(b, fraction.x), c.lerp(d, fraction.x));
                top.lerp(bottom, fraction.y)
            }
        }
    }

    /// The slope of the luminance along the surface's u and v.
    #[inline]
    fn slope(&self, uv: Vec2) -> Vec2 {
        let Cell { texels, fraction } = self.cell(uv);
        let [[a, b], [c, d]] = texels.map(|row| row.map(luminance));
        let along_x = (b - a) + ((d - c) - (b - a)) * fraction.y;
        let along_y = (c - a) + ((d - b) - (c - a)) * fraction.x;
        let slope = Vec2::new(along_x, along_y) * self.image.size().as_vec2();
        self.to_uv.matrix2.transpose() * slope
    }

    #[inline]
    fn cell(&self, uv: Vec2) -> Cell {
        let q = self.to_uv.transform_point2(uv) * self.image.size().as_vec2() - 0.5;
        let corner = q.floor();
        let [x, y] = corner.as_ivec2().to_array();
        let (right, below) = (x.saturating_add(1), y.saturating_add(1));
        let texels =
            [[self.texel(x, y), self.texel(right, y)], [self.texel(x, below), self.texel(right, below)]];
        Cell { texels, fraction: q - corner }
    }

    /// The texel at coordinates that may lie outside the image.
    #[inline]
    fn texel(&self, x: i32, y: i32) -> Rgb {
        let size = self.image.size();
        self.image.rgb(self.wrap.apply(x, size.x), self.wrap.apply(y, size.y), self.raw)
    }
}

impl Wrap {
    /// The coordinate within `0..n` that stands for `x`.
    #[inline]
    fn apply(self, x: i32, n: u32) -> u32 {
        if x >= 0 && (x as u32) < n {
            return x as u32;
        }
        let last = i64::from(n) - 1;
        let (x, n) = (i64::from(x), i64::from(n));
        let wrapped = match self {
            Self::Repeat => x.rem_euclid(n),
            Self::Mirror => {
                let y = x.rem_euclid(2 * n);
                y.min(2 * n - 1 - y)
            }
            Self::Clamp => x.clamp(0, last),
        };
        wrapped as u32
    }
}
