//! State files: a film and what it is a film of, to resume a rendering or to merge parts made elsewhere.
//!
//! ```text
//! "HELMFILM"  version: u32  header length: u32  header (JSON)  sums  splats  ids  CRC-32 of all before: u32
//! ```
//!
//! Numbers are little-endian; sums and splats are the 128-bit integers of [`ExactSum`], so nothing is rounded. A file
//! that was damaged or made up is an error, and never makes the reader allocate more than the file is long.

use super::checked::{Checked, read_array};
use super::dropped::MAX_EXAMPLES;
use super::exact::ExactSum;
use super::layout::Scale;
use super::output::{OutputError, write_atomically};
use super::{Aov, Dropped, Film, FilmError, PassRanges, zeroed};
use crate::scene::{FilmSettings, Filter, PixelRect};
use glam::UVec2;
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};

const MAGIC: [u8; 8] = *b"HELMFILM";
const VERSION: u32 = 2;
/// Bytes before the header, and of the checksum.
const PREFIX: u64 = 16;
const CHECKSUM: u64 = 4;

/// What a film is a film of. Only states that agree in all of it can be merged.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RenderIdentity {
    /// Fingerprint of everything in the scene that pixels depend on.
    pub scene: String,
    /// The integrator with its parameters.
    pub integrator: String,
    /// Seed of the random numbers.
    pub seed: u64,
}

impl RenderIdentity {
    /// Whether films of both can be merged.
    ///
    /// # Errors
    /// [`StateErrorKind::Identity`] with the first difference.
    pub fn check_same(&self, other: &Self) -> Result<(), StateErrorKind> {
        let differ = |what, own: String, other: String| {
            if own == other { Ok(()) } else { Err(StateErrorKind::Identity { what, own, other }) }
        };
        differ("scene", self.scene.clone(), other.scene.clone())?;
        differ("integrator", self.integrator.clone(), other.integrator.clone())?;
        differ("seed", self.seed.to_string(), other.seed.to_string())
    }
}

/// A state file could not be used.
#[derive(Debug, thiserror::Error)]
#[error("state {}: {kind}", path.display())]
pub struct StateError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    #[source]
    pub kind: StateErrorKind,
}

/// What can be wrong with a state file.
#[derive(Debug, thiserror::Error)]
pub enum StateErrorKind {
    /// It could not be read.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// It is something else.
    #[error("not a state of Helmholtz")]
    Magic,
    /// It was written by another version.
    #[error("has version {0} of the format, expected {VERSION}")]
    Version(u32),
    /// Its length does not fit its header.
    #[error("damaged: {found} bytes long, expected {expected}")]
    Length {
        /// Length of the file.
        found: u64,
        /// Length that the header implies, or the least possible.
        expected: u64,
    },
    /// The header is not what it should be.
    #[error("damaged: bad header: {0}")]
    Header(String),
    /// Content and checksum disagree.
    #[error("damaged: wrong checksum")]
    Checksum,
    /// It belongs to another rendering.
    #[error("is of another rendering: {what} {other:?}, expected {own:?}")]
    Identity {
        /// Which part differs.
        what: &'static str,
        /// What was expected.
        own: String,
        /// What was found.
        other: String,
    },
    /// Its film does not go with the others.
    #[error(transparent)]
    Film(#[from] FilmError),
}

#[derive(Serialize, Deserialize)]
#[serde(remote = "Filter", rename_all = "snake_case")]
enum FilterHeader {
    Box,
    Tent { radius: f32 },
    Gaussian { stddev: f32 },
    Mitchell { b: f32, c: f32 },
    Lanczos { lobes: u32 },
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    identity: RenderIdentity,
    film_size: [u32; 2],
    crop_min: [u32; 2],
    crop_size: [u32; 2],
    #[serde(with = "FilterHeader")]
    filter: Filter,
    half_float: bool,
    aovs: Vec<Aov>,
    /// Binary logarithm of the radiance unit.
    radiance_unit_log2: i32,
    passes: PassRanges,
    dropped: Dropped,
    has_splats: bool,
}

impl Header {
    fn new(identity: &RenderIdentity, film: &Film) -> Self {
        let FilmSettings { size, crop, filter, half_float } = film.settings;
        Self {
            identity: identity.clone(),
            film_size: size.to_array(),
            crop_min: crop.min.to_array(),
            crop_size: crop.size.to_array(),
            filter,
            half_float,
            aovs: film.aovs.iter().collect(),
            radiance_unit_log2: film.scale.unit_log2,
            passes: film.passes.clone(),
            dropped: film.dropped.clone(),
            has_splats: !film.splats.is_empty(),
        }
    }

    fn settings(&self) -> FilmSettings {
        FilmSettings {
            size: UVec2::from_array(self.film_size),
            crop: PixelRect {
                min: UVec2::from_array(self.crop_min),
                size: UVec2::from_array(self.crop_size),
            },
            filter: self.filter,
            half_float: self.half_float,
        }
    }

    /// Checks what neither the JSON reader nor [`Film::new`] does.
    fn check(&self) -> Result<(), StateErrorKind> {
        let checks = [
            (self.passes.is_valid(), "passes are not in order"),
            ((-126..=127).contains(&self.radiance_unit_log2), "radiance unit out of range"),
            (self.dropped.examples.len() <= MAX_EXAMPLES, "too many dropped samples"),
        ];
        match checks.into_iter().find(|(good, _)| !good) {
            Some((_, what)) => Err(StateErrorKind::Header(what.to_owned())),
            None => Ok(()),
        }
    }

    /// Bytes between header and checksum; u128 because the header may claim anything.
    fn payload(&self) -> Result<u128, FilmError> {
        let film = Film::bytes_per_pixel(&self.settings(), self.aovs.iter().copied().collect())?;
        let splats = if self.has_splats { 3 * size_of::<ExactSum>() } else { 0 };
        let pixels = u128::from(self.crop_size[0]) * u128::from(self.crop_size[1]);
        Ok(pixels * (film + splats) as u128)
    }
}

/// Saves a film atomically.
///
/// # Errors
/// If the file cannot be written; one of that name that existed is untouched.
pub fn save_state(path: &Path, identity: &RenderIdentity, film: &Film) -> Result<(), OutputError> {
    write_atomically(path, |file| {
        let header = serde_json::to_vec(&Header::new(identity, film))?;
        let length = u32::try_from(header.len()).map_err(io::Error::other)?;
        // Buffered, because the checksum is slow on 16 bytes at a time.
        let mut out = BufWriter::with_capacity(1 << 16, Checked::new(&mut *file));
        out.write_all(&MAGIC)?;
        out.write_all(&VERSION.to_le_bytes())?;
        out.write_all(&length.to_le_bytes())?;
        out.write_all(&header)?;
        for sum in film.sums.iter().chain(&film.splats) {
            out.write_all(&sum.to_le_bytes())?;
        }
        for id in film.ids.as_flattened() {
            out.write_all(&id.to_le_bytes())?;
        }
        out.flush()?;
        let checksum = out.get_ref().checksum.clone().finalize();
        drop(out);
        file.write_all(&checksum.to_le_bytes())
    })
}

/// Loads a film that [`save_state`] saved.
///
/// # Errors
/// If the file cannot be read, is of another version, or is damaged.
pub fn load_state(path: &Path) -> Result<(RenderIdentity, Film), StateError> {
    let load = || -> Result<_, StateErrorKind> {
        let file = File::open(path)?;
        let length = file.metadata()?.len();
        read_state(file, length)
    };
    load().map_err(|kind| StateError { path: path.to_owned(), kind })
}

/// Reads a state from a source of known length.
fn read_state(source: impl Read, length: u64) -> Result<(RenderIdentity, Film), StateErrorKind> {
    let least = PREFIX + CHECKSUM;
    if length < least {
        return Err(StateErrorKind::Length { found: length, expected: least });
    }
    // The checksum lies beyond what is buffered, so that buffering cannot mix it into itself.
    let mut input = BufReader::with_capacity(1 << 16, Checked::new(source.take(length - CHECKSUM)));
    if read_array(&mut input)? != MAGIC {
        return Err(StateErrorKind::Magic);
    }
    let version = u32::from_le_bytes(read_array(&mut input)?);
    if version != VERSION {
        return Err(StateErrorKind::Version(version));
    }
    let header_length = u64::from(u32::from_le_bytes(read_array(&mut input)?));
    if header_length > length - least {
        return Err(StateErrorKind::Length { found: length, expected: least + header_length });
    }
    let mut bytes = vec![0; header_length as usize];
    input.read_exact(&mut bytes)?;
    let header: Header =
        serde_json::from_slice(&bytes).map_err(|error| StateErrorKind::Header(error.to_string()))?;
    header.check()?;
    let expected = u128::from(least + header_length) + header.payload()?;
    if u128::from(length) != expected {
        let expected = u64::try_from(expected).unwrap_or(u64::MAX);
        return Err(StateErrorKind::Length { found: length, expected });
    }
    let film = read_film(&mut input, &header)?;
    let Checked { inner, checksum } = input.into_inner();
    if u32::from_le_bytes(read_array(&mut inner.into_inner())?) != checksum.finalize() {
        return Err(StateErrorKind::Checksum);
    }
    Ok((header.identity, film))
}

/// Reads the sums. The length of the source has been checked, so the allocations are backed by it.
fn read_film(input: &mut impl Read, header: &Header) -> Result<Film, StateErrorKind> {
    let aovs = header.aovs.iter().copied().collect();
    let scale = Scale { unit_log2: header.radiance_unit_log2 };
    let mut film = Film::with_scale(&header.settings(), aovs, scale)?;
    if header.has_splats {
        film.splats = zeroed(film.settings.crop.size, 3, ExactSum::default())?;
    }
    for sum in film.sums.iter_mut().chain(&mut film.splats) {
        *sum = ExactSum::from_le_bytes(read_array(input)?);
    }
    for id in film.ids.as_flattened_mut() {
        *id = u32::from_le_bytes(read_array(input)?);
    }
    film.passes = header.passes.clone();
    film.dropped = header.dropped.clone();
    Ok(film)
}
