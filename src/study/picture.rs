//! Pictures to be compared: RGB in rows from the top, from OpenEXR, PFM or what textures may be, as they are. Unlike textures they keep what is
//! not a finite number, which is to be counted.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::{AnyChannel, AttributeValue, FlatSamples, Sample};
use glam::{UVec2, Vec3};

use crate::film::Image;
use crate::scene::load::{LoadError, Location, exr as exr_file, load_image};

/// An image as it is compared.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// Width and height in pixels.
    pub size: UVec2,
    /// Linear colour, in rows from the top; of integer files after decoding sRGB.
    pub pixels: Vec<Vec3>,
    /// Estimated variance of each pixel's mean, of files with the layer `variance`.
    pub variance: Option<Vec<Vec3>>,
    /// Whether the file held integers, of which 1 is the brightest.
    pub is_display: bool,
}

impl Picture {
    /// Reads a file, whose first bytes tell its format. Of OpenEXR the first part that has `R`, `G` and `B` counts, or a layer of that name's ending, or `Y`.
    ///
    /// # Errors
    /// A file that cannot be read, is broken, or has no colours.
    pub fn read(path: &Path) -> Result<Self, LoadError> {
        let refuse = |why: String| LoadError::new(Location::file(path), why, "a readable file");
        if !fs::metadata(path).map_err(|e| refuse(format!("cannot be opened ({e})")))?.is_file() {
            return Err(refuse("is not a regular file".to_owned()));
        }
        let mut start = Vec::new();
        let file = File::open(path).map_err(|e| refuse(format!("cannot be opened ({e})")))?;
        file.take(4).read_to_end(&mut start).map_err(|e| refuse(format!("cannot be read ({e})")))?;
        let read = || fs::read(path).map_err(|e| refuse(format!("cannot be read ({e})")));
        if exr_file::is_exr(&start) {
            return read_exr(path, &read()?);
        }
        if start.starts_with(b"PF") || start.starts_with(b"Pf") {
            return read_pfm(path, &read()?);
        }
        let (image, _) = load_image(path)?;
        let size = image.size();
        let at = |i: u32| image.rgb(i % size.x, i / size.x, false);
        let pixels = (0..size.x * size.y).map(at).collect();
        Ok(Self { size, pixels, variance: None, is_display: image.is_integer() })
    }

    /// The colours of an image that was developed here.
    pub fn of(image: &Image) -> Self {
        let [r, g, b] = ["R", "G", "B"].map(|name| image.floats(name).unwrap_or_default());
        let pixels = r.iter().zip(g).zip(b).map(|((&r, &g), &b)| Vec3::new(r, g, b)).collect();
        Self { size: image.crop.size, pixels, variance: None, is_display: false }
    }

    /// Red, green and blue of a pixel.
    pub fn at(&self, x: u32, y: u32) -> Vec3 {
        self.pixels[y as usize * self.size.x as usize + x as usize]
    }
}

/// The seed that a file was rendered with, if it is an OpenEXR image that Helmholtz wrote.
pub fn seed_of(path: &Path) -> Option<u64> {
    let meta = MetaData::read_from_file(path, false).ok()?;
    let attributes = meta.headers.iter().flat_map(|header| &header.own_attributes.other);
    let mut seeds = attributes.filter_map(|(name, value)| match value {
        AttributeValue::Text(text) if name.eq("helmholtz.seed") => text.to_string().parse().ok(),
        _ => None,
    });
    seeds.next()
}

fn read_exr(path: &Path, bytes: &[u8]) -> Result<Picture, LoadError> {
    let file = exr_file::read_parts(path, bytes)?;
    for layer in &file.layer_data {
        let channels = &layer.channel_data.list;
        let Some(pixels) = colours(channels) else { continue };
        let variance = vectors(channels, &["variance.R", "variance.G", "variance.B"]);
        let size = UVec2::new(layer.size.0 as u32, layer.size.1 as u32);
        // Channels may be subsampled, and then are shorter.
        if pixels.len() != size.x as usize * size.y as usize {
            return Err(broken(path, "subsampled channels"));
        }
        return Ok(Picture { size, pixels, variance, is_display: false });
    }
    Err(broken(path, "an OpenEXR image without channels R, G, B or Y"))
}

/// `R`, `G` and `B`; or those of the first layer that has them; or grey.
fn colours(channels: &[AnyChannel<FlatSamples>]) -> Option<Vec<Vec3>> {
    let named = || vectors(channels, &["R", "G", "B"]);
    let layered = || {
        channels.iter().find_map(|channel| {
            let name = channel.name.to_string();
            let layer = name.strip_suffix(".R")?;
            vectors(channels, &["R", "G", "B"].map(|c| format!("{layer}.{c}")))
        })
    };
    named().or_else(|| vectors(channels, &["Y", "Y", "Y"])).or_else(layered)
}

fn vectors(channels: &[AnyChannel<FlatSamples>], names: &[impl AsRef<str>; 3]) -> Option<Vec<Vec3>> {
    let find = |name: &str| channels.iter().find(|c| c.name.eq(name)).map(|c| &c.sample_data);
    let [r, g, b] = [find(names[0].as_ref())?, find(names[1].as_ref())?, find(names[2].as_ref())?];
    let value = |plane: &FlatSamples, i: usize| Sample::to_f32(plane.value_by_flat_index(i));
    let count = r.len().min(g.len()).min(b.len());
    Some((0..count).map(|i| Vec3::new(value(r, i), value(g, i), value(b, i))).collect())
}

/// Portable float maps: `PF` (colour) or `Pf` (grey), width, height and scale as text, whose sign tells the order of bytes; then floats in rows from the
/// bottom.
fn read_pfm(path: &Path, bytes: &[u8]) -> Result<Picture, LoadError> {
    let mut rest = bytes;
    let mut word = || {
        let start = rest.iter().position(|b| !b.is_ascii_whitespace())?;
        let length = rest[start..].iter().position(u8::is_ascii_whitespace)?;
        let word = std::str::from_utf8(&rest[start..start + length]).ok();
        // One byte of space ends the header; the next may be data.
        rest = &rest[start + length + 1..];
        word
    };
    let kind = word();
    let channels: usize = if kind == Some("PF") { 3 } else { 1 };
    let mut number = || word()?.parse::<f64>().ok();
    let header = (|| Some((number()?, number()?, number()?)))();
    let Some((width, height, scale)) = header else {
        return Err(broken(path, "a PFM header that makes no sense"));
    };
    let is_size = |v: f64| (1.0..=f64::from(1 << 24)).contains(&v) && v.fract() == 0.0;
    if !is_size(width) || !is_size(height) || scale == 0.0 || !scale.is_finite() {
        return Err(broken(path, format!("a PFM image of {width} x {height} with scale {scale}")));
    }
    let size = UVec2::new(width as u32, height as u32);
    let values = u64::from(size.x) * u64::from(size.y) * channels as u64;
    if rest.len() as u64 != 4 * values {
        return Err(broken(path, format!("{} bytes of PFM data instead of {}", rest.len(), 4 * values)));
    }
    let value = |bytes: &[u8; 4]| {
        if scale < 0.0 { f32::from_le_bytes(*bytes) } else { f32::from_be_bytes(*bytes) }
    };
    let row = size.x as usize * channels;
    let floats: Vec<f32> = rest.as_chunks().0.iter().map(value).collect();
    let pixel = |v: &[f32]| if channels == 3 { Vec3::from_slice(v) } else { Vec3::splat(v[0]) };
    let pixels =
        floats.chunks_exact(row).rev().flat_map(|row| row.chunks_exact(channels).map(pixel)).collect();
    Ok(Picture { size, pixels, variance: None, is_display: false })
}

fn broken(path: &Path, found: impl Into<String>) -> LoadError {
    LoadError::new(Location::file(path), found, "an OpenEXR, PFM, PNG, JPEG, Radiance HDR, TGA or BMP image")
}
