//! Image files: `OpenEXR` for numbers, PNG for eyes. Both appear under their name only when complete.

use super::image::{Channel, Image, Pixels};
use exr::prelude as exr_lib;
use exr_lib::{AnyChannel, AnyChannels, AttributeValue, FlatSamples, IntegerBounds, Text, WritableImage};
use half::f16;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// A file could not be written. What stood under its name before is untouched.
#[derive(Debug, thiserror::Error)]
#[error("cannot write {}: {source}", path.display())]
pub struct OutputError {
    /// The file.
    pub path: PathBuf,
    /// What failed.
    pub source: io::Error,
}

/// Writes a file so that at any time, even after a crash or on a full disk, its name leads to all of the old content
/// or all of the new: into a temporary file beside it, flushed to the disk, then renamed.
///
/// A symbolic link is followed. What is there but is no regular file (a device, a directory) is an error.
///
/// # Errors
/// If any step fails, `write` included.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> Result<(), OutputError> {
    replace(path, write).map_err(|source| OutputError { path: path.to_owned(), source })
}

fn replace(path: &Path, write: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>) -> io::Result<()> {
    let file = AtomicFile::create(path)?;
    let mut writer = BufWriter::with_capacity(1 << 16, file.temporary.as_file());
    write(&mut writer)?;
    writer.flush()?;
    drop(writer);
    file.commit()
}

/// A file in the making, for what is written bit by bit; see [`write_atomically`]. Nothing is left of it unless it is committed.
#[derive(Debug)]
pub(crate) struct AtomicFile {
    temporary: tempfile::NamedTempFile,
    target: PathBuf,
}

impl AtomicFile {
    /// A temporary file beside what it is to replace.
    pub(crate) fn create(path: &Path) -> io::Result<Self> {
        let target = match path.canonicalize() {
            Ok(target) if target.is_file() => target,
            Ok(_) => return Err(io::Error::new(io::ErrorKind::InvalidInput, "not a regular file")),
            Err(_) => path.to_owned(),
        };
        let mut builder = tempfile::Builder::new();
        builder.prefix(".helmholtz-");
        #[cfg(unix)]
        {
            // Temporary files are private by default; this one is to become an ordinary file, subject to the umask.
            use std::os::unix::fs::PermissionsExt;
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let temporary = builder.tempfile_in(directory(&target))?;
        Ok(Self { temporary, target })
    }

    /// Flushes it to the disk and gives it its name.
    pub(crate) fn commit(self) -> io::Result<()> {
        self.temporary.as_file().sync_all()?;
        self.temporary.persist(&self.target)?;
        // The rename itself is made durable where directories can be synchronised; elsewhere there is nothing to do.
        let _ = File::open(directory(&self.target)).and_then(|d| d.sync_all());
        Ok(())
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.temporary.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.temporary.flush()
    }
}

fn directory(file: &Path) -> &Path {
    match file.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Writes an `OpenEXR` file (one part, ZIP compression), its data window being the crop window on the full film.
///
/// With `half`, [`Pixels::Colour`] channels are half floats: values beyond +-65504, the largest, are clamped to it. The
/// number of values clamped is returned. Other channels always have 32 bits.
///
/// Each pair of `metadata` becomes a string attribute `helmholtz.<name>`, in UTF-8; names are to be ASCII.
///
/// # Errors
/// If the file cannot be written.
pub fn write_exr(
    path: &Path,
    image: &Image,
    half: bool,
    metadata: &[(String, String)],
) -> Result<usize, OutputError> {
    let mut clamped = 0;
    let channels = image.channels.iter().map(|c| exr_channel(c, half, &mut clamped)).collect();
    let size = |v: glam::UVec2| (v.x as usize, v.y as usize);
    let mut layer = exr_lib::Layer::new(
        size(image.crop.size),
        exr_lib::LayerAttributes::default(),
        // The crate's default is tiles, which some readers of plain images do not expect.
        exr_lib::Encoding {
            compression: exr_lib::Compression::ZIP16,
            blocks: exr_lib::Blocks::ScanLines,
            line_order: exr_lib::LineOrder::Increasing,
        },
        AnyChannels::sort(channels),
    );
    let min = image.crop.min.as_ivec2();
    layer.attributes.layer_position = (min.x, min.y).into();
    layer.attributes.software_name = Some(concat!("Helmholtz ", env!("CARGO_PKG_VERSION")).into());
    layer.attributes.other = metadata.iter().map(|(name, value)| exr_attribute(name, value)).collect();
    let window = IntegerBounds::from_dimensions(size(image.film_size));
    let file = exr_lib::Image::new(exr_lib::ImageAttributes::new(window), layer);
    write_atomically(path, |writer| {
        file.write().to_buffered(writer).map_err(|error| match error {
            exr_lib::Error::Io(error) => error,
            other => io::Error::other(other),
        })
    })?;
    Ok(clamped)
}

fn exr_attribute(name: &str, value: &str) -> (Text, AttributeValue) {
    // OpenEXR's strings are bytes, by custom UTF-8. The crate's checked constructors would refuse all but Latin-1.
    let text = |s: &str| Text::from_slice_unchecked(s.as_bytes());
    (text(&format!("helmholtz.{name}")), AttributeValue::Text(text(value)))
}

fn exr_channel(channel: &Channel, half: bool, clamped: &mut usize) -> AnyChannel<FlatSamples> {
    let samples = match &channel.pixels {
        Pixels::Colour(values) if half => {
            FlatSamples::F16(values.iter().map(|&v| to_half(v, clamped)).collect())
        }
        Pixels::Colour(values) | Pixels::Float(values) => FlatSamples::F32(values.clone()),
        Pixels::Integer(values) => FlatSamples::U32(values.clone()),
    };
    AnyChannel::new(channel.name.as_ref(), samples)
}

fn to_half(value: f32, clamped: &mut usize) -> f16 {
    let max = f16::MAX.to_f32();
    *clamped += usize::from(value.abs() > max);
    f16::from_f32(value.clamp(-max, max))
}

/// Writes the colour as a PNG file: [`encode_png`].
///
/// # Errors
/// If the file cannot be written.
pub fn write_png(path: &Path, image: &Image) -> Result<(), OutputError> {
    write_atomically(path, |writer| writer.write_all(&encode_png(image)?))
}

/// The colour as the bytes of a PNG file: 8 bits, sRGB transfer function, values clamped to [0, 1]. There is no exposure to
/// set: radiance 1 is white.
///
/// # Errors
/// If PNG has no such image: one of no pixels or too many.
pub fn encode_png(image: &Image) -> io::Result<Vec<u8>> {
    let colour = ["R", "G", "B"].map(|name| image.floats(name).unwrap_or_default());
    let pixels = image.crop.size.x as usize * image.crop.size.y as usize;
    let bytes: Vec<u8> =
        (0..pixels).flat_map(|i| colour.map(|c| srgb8(c.get(i).copied().unwrap_or_default()))).collect();
    let mut file = Vec::new();
    let mut encoder = png::Encoder::new(&mut file, image.crop.size.x, image.crop.size.y);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let encode = || {
        let mut writer = encoder.write_header()?;
        writer.write_image_data(&bytes)?;
        writer.finish()
    };
    encode().map_err(|error| match error {
        png::EncodingError::IoError(error) => error,
        other => io::Error::other(other),
    })?;
    Ok(file)
}

/// The sRGB transfer function (IEC 61966-2-1) in 8 bits. NaN is black.
fn srgb8(linear: f32) -> u8 {
    let c = f64::from(linear.clamp(0.0, 1.0));
    let encoded = if c <= 0.003_130_8 { 12.92 * c } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 };
    (encoded * 255.0).round() as u8
}
