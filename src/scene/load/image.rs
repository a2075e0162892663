//! Image files: PNG, JPEG, Radiance HDR, TGA and BMP through `image`, OpenEXR through `exr`.
//!
//! The format is told by the file's first bytes, not by its name, except for TGA, which has none. Decoders allocate what the header
//! claims, so the claim is checked first against what a file of that length can hold.

use std::collections::HashMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::UVec2;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader};
use rayon::prelude::*;

use super::{LoadError, Location, Log, exr};
use crate::scene::{Image, Texels};

/// Files that are decoded without regard to their length.
const SMALL: u64 = 32 << 20;
/// Bytes of texels per byte of file. Deflate makes at most 1032 out of one; JPEG, at two bits per block, 1024.
const MAX_EXPANSION: u64 = 1100;

/// Which channels of an image are wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Content {
    /// Colour or grey, without alpha.
    Color,
    /// Alpha; of images without alpha what they have instead.
    Alpha,
}

/// Images by file: each is read once, however many refer to it.
#[derive(Default)]
pub(super) struct Images {
    loaded: HashMap<(PathBuf, Content), Result<Arc<Image>, LoadError>>,
}

impl Images {
    /// Reads files in parallel, so that [`get`](Self::get) finds them; `from` is where the scene names them.
    pub(super) fn prefetch(&mut self, files: Vec<(PathBuf, Location)>, log: &mut Log) {
        let mut wanted: Vec<(PathBuf, Location)> = Vec::new();
        let mut known = std::collections::HashSet::new();
        for (path, from) in files {
            if known.insert(canonical(&path)) {
                wanted.push((path, from));
            }
        }
        let results: Vec<_> = wanted
            .into_par_iter()
            .map(|(path, from)| {
                let mut log = Log::default();
                let image = read(&path, Some(&from), Content::Color, &mut log).map(Arc::new);
                (path, image, log)
            })
            .collect();
        for (path, image, messages) in results {
            log.absorb(messages);
            self.loaded.insert((canonical(&path), Content::Color), image);
        }
    }

    /// The image in a file.
    pub(super) fn get(
        &mut self,
        path: &Path,
        from: Option<&Location>,
        content: Content,
        log: &mut Log,
    ) -> Result<Arc<Image>, LoadError> {
        let image = self.loaded.entry((canonical(path), content));
        image.or_insert_with(|| read(path, from, content, log).map(Arc::new)).clone()
    }
}

/// The one name of a file that has many.
fn canonical(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| path.to_path_buf())
}

/// Reads an image file. `from` is where it was named, if in another file.
pub(super) fn read(
    path: &Path,
    from: Option<&Location>,
    content: Content,
    log: &mut Log,
) -> Result<Image, LoadError> {
    // The other name of Radiance HDR, which `image` does not know.
    const RGBE: &[u8] = b"#?RGBE";
    let mut bytes = log.read(path, from)?;
    if bytes.starts_with(RGBE) {
        bytes.splice(..RGBE.len(), *b"#?RADIANCE");
    }
    if exr::is_exr(&bytes) {
        return exr::decode(path, &bytes, content, log);
    }
    let is_tga = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("tga"));
    let format = image::guess_format(&bytes).ok().or(is_tga.then_some(ImageFormat::Tga));
    let supported = |f: &ImageFormat| {
        use ImageFormat::{Bmp, Hdr, Jpeg, Png, Tga};
        matches!(f, Png | Jpeg | Hdr | Tga | Bmp)
    };
    let Some(format) = format.filter(supported) else {
        return Err(refuse(path, "not an image of a known format"));
    };
    decode(path, &bytes, format, content, log)
}

/// An error about an image file's content.
pub(super) fn refuse(path: &Path, found: impl Into<String>) -> LoadError {
    LoadError::new(Location::file(path), found, "a PNG, JPEG, OpenEXR, Radiance HDR, TGA or BMP image")
}

/// An error if the header claims more than a file of this length can hold.
pub(super) fn check_claim(path: &Path, file: usize, texels: u64) -> Result<(), LoadError> {
    if texels <= SMALL.max(file as u64 * MAX_EXPANSION) {
        return Ok(());
    }
    Err(refuse(path, format!("a header that claims {texels} bytes of texels in a file of {file} bytes")))
}

fn decode(
    path: &Path,
    bytes: &[u8],
    format: ImageFormat,
    content: Content,
    log: &mut Log,
) -> Result<Image, LoadError> {
    let broken = |e: image::ImageError| refuse(path, format!("a broken image ({e})"));
    let mut reader = ImageReader::with_format(Cursor::new(bytes), format);
    let mut limits = image::Limits::no_limits();
    limits.max_alloc = Some(SMALL.max(bytes.len() as u64 * MAX_EXPANSION));
    reader.limits(limits);
    let decoder = reader.into_decoder().map_err(broken)?;
    check_claim(path, bytes.len(), decoder.total_bytes())?;
    let (width, height) = decoder.dimensions();
    let decoded = DynamicImage::from_decoder(decoder).map_err(broken)?;
    let (channels, texels) = select(decoded, content).ok_or_else(|| refuse(path, "an unknown layout"))?;
    finish(path, UVec2::new(width, height), channels, texels, log)
}

/// The wanted channels of a decoded image.
fn select(image: DynamicImage, content: Content) -> Option<(u32, Texels)> {
    use DynamicImage as D;
    let alpha = content == Content::Alpha;
    Some(match image {
        D::ImageLuma8(i) => (1, Texels::U8(i.into_raw())),
        D::ImageRgb8(i) => (3, Texels::U8(i.into_raw())),
        D::ImageLuma16(i) => (1, Texels::U16(i.into_raw())),
        D::ImageRgb16(i) => (3, Texels::U16(i.into_raw())),
        D::ImageRgb32F(i) => (3, Texels::F32(i.into_raw())),
        D::ImageLumaA8(i) => (1, Texels::U8(pick(&i.into_raw(), 2, usize::from(alpha), 1))),
        D::ImageLumaA16(i) => (1, Texels::U16(pick(&i.into_raw(), 2, usize::from(alpha), 1))),
        D::ImageRgba8(i) if alpha => (1, Texels::U8(pick(&i.into_raw(), 4, 3, 1))),
        D::ImageRgba16(i) if alpha => (1, Texels::U16(pick(&i.into_raw(), 4, 3, 1))),
        D::ImageRgba8(i) => (3, Texels::U8(pick(&i.into_raw(), 4, 0, 3))),
        D::ImageRgba16(i) => (3, Texels::U16(pick(&i.into_raw(), 4, 0, 3))),
        _ => return None,
    })
}

/// `count` of every `stride` values, from `first` on.
fn pick<T: Copy>(values: &[T], stride: usize, first: usize, count: usize) -> Vec<T> {
    values.chunks_exact(stride).flat_map(|texel| &texel[first..first + count]).copied().collect()
}

/// Checks the texels: what is not a finite number becomes 0, with a warning.
pub(super) fn finish(
    path: &Path,
    size: UVec2,
    channels: u32,
    mut texels: Texels,
    log: &mut Log,
) -> Result<Image, LoadError> {
    let mut bad = 0;
    match &mut texels {
        Texels::F16(values) => values.iter_mut().filter(|x| !x.is_finite()).for_each(|x| {
            *x = half::f16::ZERO;
            bad += 1;
        }),
        Texels::F32(values) => values.iter_mut().filter(|x| !x.is_finite()).for_each(|x| {
            *x = 0.0;
            bad += 1;
        }),
        Texels::U8(_) | Texels::U16(_) => {}
    }
    if bad > 0 {
        log.warn(Location::file(path), format!("{bad} values that are not finite are taken for 0"));
    }
    Image::new(size, channels, texels).ok_or_else(|| refuse(path, format!("{size} texels")))
}
