//! Images as plain data, held in the depth that their file has.
//!
//! What a texel means is decided here (sRGB or linear, grey or colour); how texels become a function of texture
//! coordinates is the business of [`super::texture`]. Files are read in [`super::load`].

use glam::{UVec2, Vec3};
use half::f16;

use super::Rgb;

/// Texels in rows from the top, channels interleaved.
#[derive(Debug, Clone, PartialEq)]
pub enum Texels {
    /// 0..=255 means 0..=1.
    U8(Vec<u8>),
    /// 0..=65535 means 0..=1.
    U16(Vec<u16>),
    /// Half floats.
    F16(Vec<f16>),
    /// Single floats.
    F32(Vec<f32>),
}

impl Texels {
    fn len(&self) -> usize {
        match self {
            Self::U8(v) => v.len(),
            Self::U16(v) => v.len(),
            Self::F16(v) => v.len(),
            Self::F32(v) => v.len(),
        }
    }
}

/// A grey or RGB image of at least one texel.
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    size: UVec2,
    /// 1 or 3.
    channels: u32,
    texels: Texels,
}

impl Image {
    /// An image of `size` texels with 1 channel (grey) or 3 (red, green, blue). `None` if the number of texels or channels
    /// does not fit, or if there are none.
    pub fn new(size: UVec2, channels: u32, texels: Texels) -> Option<Self> {
        let count = u64::from(size.x) * u64::from(size.y) * u64::from(channels);
        // Coordinates are computed in i32.
        let fits = matches!(channels, 1 | 3) && count > 0 && i32::try_from(size.max_element()).is_ok();
        (fits && count == texels.len() as u64).then_some(Self { size, channels, texels })
    }

    /// Width and height in texels.
    #[inline]
    pub fn size(&self) -> UVec2 {
        self.size
    }

    /// Whether there is one channel instead of three.
    #[inline]
    pub fn is_grey(&self) -> bool {
        self.channels == 1
    }

    /// Whether texels are integers, the greatest of which means 1.
    pub fn is_integer(&self) -> bool {
        matches!(self.texels, Texels::U8(_) | Texels::U16(_))
    }

    /// Bytes that the texels take.
    pub fn memory(&self) -> usize {
        let bytes = match self.texels {
            Texels::U8(_) => 1,
            Texels::U16(_) | Texels::F16(_) => 2,
            Texels::F32(_) => 4,
        };
        bytes * self.texels.len()
    }

    /// The linear colour of a texel. Integer texels are sRGB-encoded unless `raw`; floats are linear always.
    /// Coordinates must be less than [`size`](Self::size).
    #[inline]
    pub fn rgb(&self, x: u32, y: u32, raw: bool) -> Rgb {
        let first = self.offset(x, y);
        if self.channels == 1 {
            Vec3::splat(self.value(first, raw))
        } else {
            Vec3::new(self.value(first, raw), self.value(first + 1, raw), self.value(first + 2, raw))
        }
    }

    /// Greatest value of any channel, linear, to find textures that go beyond a parameter's range.
    pub fn max_value(&self) -> f32 {
        match &self.texels {
            Texels::U8(_) | Texels::U16(_) => 1.0,
            Texels::F16(v) => v.iter().fold(0.0, |max: f32, x| max.max(x.to_f32())),
            Texels::F32(v) => v.iter().fold(0.0, |max: f32, &x| max.max(x)),
        }
    }

    #[inline]
    fn offset(&self, x: u32, y: u32) -> usize {
        (y as usize * self.size.x as usize + x as usize) * self.channels as usize
    }

    #[inline]
    fn value(&self, i: usize, raw: bool) -> f32 {
        match &self.texels {
            Texels::U8(v) if raw => f32::from(v[i]) * (1.0 / 255.0),
            Texels::U8(v) => SRGB_TO_LINEAR[v[i] as usize],
            Texels::U16(v) if raw => f32::from(v[i]) * (1.0 / 65535.0),
            Texels::U16(v) => {
                // Between the entries of the table the curve is straight to 1e-5 of 1.
                let (low, rest) = (v[i] / 257, f32::from(v[i] % 257) * (1.0 / 257.0));
                let (a, b) = (SRGB_TO_LINEAR[low as usize], SRGB_TO_LINEAR[usize::from(low + 1).min(255)]);
                a + (b - a) * rest
            }
            Texels::F16(v) => v[i].to_f32(),
            Texels::F32(v) => v[i],
        }
    }
}

/// Inverse of the sRGB transfer function (IEC 61966-2-1) for 8-bit values; made by the compiler.
static SRGB_TO_LINEAR: [f32; 256] = {
    let mut table = [0.0; 256];
    let mut i = 0;
    while i < 256 {
        let c = i as f64 / 255.0;
        table[i] = if c <= 0.04045 { c / 12.92 } else { power_2_4((c + 0.055) / 1.055) } as f32;
        i += 1;
    }
    table
};

/// `x^2.4` for x in (0, 1], as `x^2 (x^2)^(1/5)`; Newton's method finds the root.
const fn power_2_4(x: f64) -> f64 {
    let square = x * x;
    let mut root = 1.0;
    let mut step = 0;
    while step < 60 {
        let fourth = root * root * root * root;
        root -= (root - square / fourth) / 5.0;
        step += 1;
    }
    square * root
}

#[cfg(test)]
mod tests {
    use super::*;

    fn srgb(c: f64) -> f64 {
        if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
    }

    #[test]
    fn the_transfer_function_is_that_of_the_standard() {
        let bytes: Vec<u8> = (0..=255).collect();
        let image = Image::new(UVec2::new(256, 1), 1, Texels::U8(bytes)).expect("fits");
        for i in 0..256 {
            let c = f64::from(i) / 255.0;
            assert!((f64::from(image.rgb(i, 0, false).x) - srgb(c)).abs() < 1e-7, "{i}");
            assert!((f64::from(image.rgb(i, 0, true).y) - c).abs() < 1e-7, "{i}");
        }
        let words: Vec<u16> = (0..=u16::MAX).collect();
        let image = Image::new(UVec2::new(256, 256), 1, Texels::U16(words)).expect("fits");
        for i in 0..65536 {
            let c = f64::from(i) / 65535.0;
            assert!((f64::from(image.rgb(i % 256, i / 256, false).z) - srgb(c)).abs() < 1e-5, "{i}");
            assert!((f64::from(image.rgb(i % 256, i / 256, true).z) - c).abs() < 1e-7, "{i}");
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        let image = |x, y, channels, n| Image::new(UVec2::new(x, y), channels, Texels::U8(vec![0; n]));
        assert!(image(2, 3, 3, 18).is_some() && image(2, 3, 1, 6).is_some());
        assert!(image(2, 3, 3, 17).is_none() && image(2, 3, 2, 12).is_none() && image(0, 3, 1, 0).is_none());
        assert!(image(u32::MAX, u32::MAX, 3, 3).is_none());
    }
}
