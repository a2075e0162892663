//! Textures as plain data, and their values as functions of texture coordinates.
//!
//! A [`Texture`] is evaluated as a colour, a number, or a number with its slope (for bump maps). It knows nothing of
//! materials; a parameter of a material that may be textured is an [`Input`].
//!
//! Meaning and conventions are those of Mitsuba 3's plugins of the same names: (0, 0) is the corner of the image's
//! first texel, rows run from the top, texels are converted to linear colour before they are interpolated.

use std::sync::Arc;

use glam::{Affine2, Vec2};

use super::{Image, Rgb, luminance};

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

impl Input<Rgb> {
    /// The value at `uv`.
    #[inline]
    pub fn at(self, textures: &[Texture], uv: Vec2) -> Rgb {
        match self {
            Self::Constant(color) => color,
            Self::Texture(id) => color(textures, id, uv),
        }
    }
}

impl Input<f32> {
    /// The value at `uv`; of a coloured texture its luminance.
    #[inline]
    pub fn at(self, textures: &[Texture], uv: Vec2) -> f32 {
        match self {
            Self::Constant(value) => value,
            Self::Texture(id) => number(textures, id, uv),
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

/// A function of texture coordinates.
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
}

/// The colour of a texture at `uv`. Non-finite coordinates, which loaders do not let through, give some texel.
#[inline(never)] // Out of the way of paths without textures.
pub fn color(textures: &[Texture], id: TextureId, uv: Vec2) -> Rgb {
    let Some((texture, before)) = textures.get(..=id.0 as usize).and_then(<[Texture]>::split_last) else {
        return Rgb::ZERO;
    };
    texture.color(before, uv)
}

impl Texture {
    /// The colour at `uv`; `before` are the textures that this one may be made of.
    #[inline]
    fn color(&self, before: &[Self], uv: Vec2) -> Rgb {
        match self {
            Self::Bitmap(bitmap) => bitmap.color(uv),
            Self::Checkerboard { color0, color1, to_uv } => {
                let q = to_uv.transform_point2(uv);
                let right = (q - q.floor()).cmpgt(Vec2::splat(0.5));
                if right.x == right.y { color0 } else { color1 }.at(before, uv)
            }
            Self::Scale { texture, factor } => color(before, *texture, uv) * *factor,
        }
    }
}

/// The number of a texture at `uv`: the luminance of its colour. But of a checkerboard the squares change places, as they do in
/// Mitsuba 3.9 where a number is asked for.
#[inline(never)]
pub fn number(textures: &[Texture], id: TextureId, uv: Vec2) -> f32 {
    match textures.get(id.0 as usize) {
        Some(&Texture::Checkerboard { color0, color1, to_uv }) => {
            let swapped = Texture::Checkerboard { color0: color1, color1: color0, to_uv };
            luminance(swapped.color(&textures[..id.0 as usize], uv))
        }
        _ => luminance(color(textures, id, uv)),
    }
}

/// The slope along u and v of the number that a texture gives at `uv`. 0 where steps have none: in checkerboards, and in bitmaps
/// without interpolation.
#[inline]
pub fn slope(textures: &[Texture], id: TextureId, uv: Vec2) -> Vec2 {
    let Some((texture, before)) = textures.get(..=id.0 as usize).and_then(<[Texture]>::split_last) else {
        return Vec2::ZERO;
    };
    match texture {
        Texture::Bitmap(bitmap) if bitmap.filter == TexelFilter::Bilinear => bitmap.slope(uv),
        Texture::Bitmap(_) | Texture::Checkerboard { .. } => Vec2::ZERO,
        // Only grey factors commute with the luminance; loaders give bump maps no others.
        Texture::Scale { texture, factor } => slope(before, *texture, uv) * luminance(*factor),
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
