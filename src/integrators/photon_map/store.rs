//! Files of photon maps: photons traced once, looked up as often as one likes by other radii, filters or film sizes.
//!
//! ```text
//! "HELMPHOT"  version: u32  header length: u32  header (JSON: what the photons are of)
//!   of each pass: index: u32  photons: u32  photons, 32 bytes each  inner nodes of the tree, 8 bytes each
//! u32::MAX  passes: u32  CRC-32 of all before: u32
//! ```
//!
//! Numbers are little-endian; photons are in the order of the tree, so that what is loaded is what was saved, to the last bit. A
//! file is checked as a whole before anything of it is used; what it claims never makes the reader allocate more than the file is long.

use std::fs::File;
use std::io::{self, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::map::{Node, PhotonMap, node_count};
use super::photon::Photon;
use crate::film::checked::{Checked, read_array};
use crate::film::output::AtomicFile;
use crate::film::state::{RenderIdentity, StateErrorKind};

const MAGIC: [u8; 8] = *b"HELMPHOT";
const VERSION: u32 = 3;
/// Index that no pass has.
const END: u32 = u32::MAX;
const PHOTON_BYTES: u64 = size_of::<Photon>() as u64;
const NODE_BYTES: u64 = 8;
const CHECKSUM_BYTES: u64 = 4;
const BUFFER: usize = 1 << 16;

/// A photon file could not be used.
#[derive(Debug, thiserror::Error)]
#[error("photons {}: {kind}", path.display())]
pub struct PhotonFileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it.
    #[source]
    pub kind: PhotonFileErrorKind,
}

/// What can be wrong with a photon file.
#[derive(Debug, thiserror::Error)]
pub enum PhotonFileErrorKind {
    /// It could not be read or written.
    #[error(transparent)]
    Io(#[from] io::Error),
    /// It is something else.
    #[error("not photons of Helmholtz")]
    Magic,
    /// It was written by another version.
    #[error("has version {0} of the format, expected {VERSION}")]
    Version(u32),
    /// Its parts do not fit together.
    #[error("damaged: {0}")]
    Damaged(String),
    /// Content and checksum disagree.
    #[error("damaged: wrong checksum")]
    Checksum,
    /// Its photons are of another scene, of other settings or of another seed.
    #[error(transparent)]
    Identity(StateErrorKind),
    /// It has no photons of a pass.
    #[error("holds passes {first}..{end}, but not pass {pass}")]
    Missing {
        /// The pass asked for.
        pass: u32,
        /// First pass in the file.
        first: u32,
        /// One more than the last.
        end: u32,
    },
}

fn damaged(what: impl Into<String>) -> PhotonFileErrorKind {
    PhotonFileErrorKind::Damaged(what.into())
}

/// Where the photons of a render come from, and where they go besides.
pub enum PhotonStore {
    /// They are traced, and forgotten after their pass.
    Traced,
    /// They are traced, and written to a file.
    Saved(Box<PhotonWriter>),
    /// They are read from a file.
    Loaded(Box<PhotonReader>),
}

/// A photon file that is being written. It appears under its name when it is [finished](Self::finish).
pub struct PhotonWriter {
    path: PathBuf,
    out: BufWriter<Checked<AtomicFile>>,
    passes: u32,
}

impl PhotonWriter {
    /// Begins a file of photons of `identity`: its scene, [what the photons depend on](super::PhotonMapper::describe_photons) as the integrator,
    /// and its seed.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn create(path: &Path, identity: &RenderIdentity) -> Result<Self, PhotonFileError> {
        let create = || {
            let file = AtomicFile::create(path)?;
            // Buffered, because the checksum is slow on a few bytes at a time.
            let mut out = BufWriter::with_capacity(BUFFER, Checked::new(file));
            let header = serde_json::to_vec(identity)?;
            let length = u32::try_from(header.len()).map_err(io::Error::other)?;
            out.write_all(&MAGIC)?;
            out.write_all(&VERSION.to_le_bytes())?;
            out.write_all(&length.to_le_bytes())?;
            out.write_all(&header)?;
            Ok(out)
        };
        let out = create().map_err(|error: io::Error| at(path)(error.into()))?;
        Ok(Self { path: path.to_owned(), out, passes: 0 })
    }

    /// Adds the map of a pass; passes come in order.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn add(&mut self, pass: u32, map: &PhotonMap) -> Result<(), PhotonFileError> {
        self.passes += 1;
        let mut write = || {
            let count = u32::try_from(map.photons().len()).map_err(io::Error::other)?;
            self.out.write_all(&pass.to_le_bytes())?;
            self.out.write_all(&count.to_le_bytes())?;
            for photon in map.photons() {
                self.out.write_all(&photon.to_le_bytes())?;
            }
            for node in map.nodes() {
                self.out.write_all(&node.split.to_le_bytes())?;
                self.out.write_all(&node.axis.to_le_bytes())?;
            }
            Ok(())
        };
        write().map_err(|error: io::Error| at(&self.path)(error.into()))
    }

    /// Completes the file and gives it its name. Returns the number of passes in it.
    ///
    /// # Errors
    /// If it cannot be written; a file of that name that existed is then untouched.
    pub fn finish(mut self) -> Result<u32, PhotonFileError> {
        let mut finish = || {
            self.out.write_all(&END.to_le_bytes())?;
            self.out.write_all(&self.passes.to_le_bytes())?;
            self.out.flush()
        };
        let finished = finish().and_then(|()| {
            let Checked { mut inner, checksum } =
                self.out.into_inner().map_err(io::IntoInnerError::into_error)?;
            inner.write_all(&checksum.finalize().to_le_bytes())?;
            inner.commit()
        });
        finished.map_err(|error| at(&self.path)(error.into()))?;
        Ok(self.passes)
    }
}

/// Where in a file the photons of a pass are.
struct Entry {
    pass: u32,
    count: u32,
    offset: u64,
}

impl Entry {
    fn bytes(&self) -> u64 {
        u64::from(self.count) * PHOTON_BYTES + node_count(self.count as usize) as u64 * NODE_BYTES
    }
}

/// A photon file that has been checked.
pub struct PhotonReader {
    path: PathBuf,
    file: File,
    /// In the order of their passes; at least one.
    entries: Vec<Entry>,
}

impl PhotonReader {
    /// Opens a file and checks that it is whole and that its photons are of `expected`, as [`PhotonWriter::create`] has it.
    ///
    /// # Errors
    /// If it cannot be read, is of another version, damaged, or of something else.
    pub fn open(path: &Path, expected: &RenderIdentity) -> Result<Self, PhotonFileError> {
        let open = || {
            let file = File::open(path)?;
            let length = file.metadata()?.len();
            let entries = scan(&file, length, expected)?;
            Ok(Self { path: path.to_owned(), file, entries })
        };
        open().map_err(at(path))
    }

    /// Passes from the first to the last in the file; there may be gaps.
    pub fn passes(&self) -> std::ops::Range<u32> {
        let (first, last) = (self.entries.first(), self.entries.last());
        first.map_or(0, |entry| entry.pass)..last.map_or(0, |entry| entry.pass + 1)
    }

    /// Whether there are photons of each of these passes.
    ///
    /// # Errors
    /// [`PhotonFileErrorKind::Missing`], with the first pass that is not there.
    pub fn check(&self, mut passes: std::ops::Range<u32>) -> Result<(), PhotonFileError> {
        passes.try_for_each(|pass| self.find(pass).map(|_| ()))
    }

    fn find(&self, pass: u32) -> Result<&Entry, PhotonFileError> {
        let found = self.entries.binary_search_by_key(&pass, |entry| entry.pass);
        let std::ops::Range { start: first, end } = self.passes();
        found
            .map(|i| &self.entries[i])
            .map_err(|_| at(&self.path)(PhotonFileErrorKind::Missing { pass, first, end }))
    }

    /// The map of a pass.
    ///
    /// # Errors
    /// If the file has no such pass, or cannot be read.
    pub fn read(&self, pass: u32) -> Result<PhotonMap, PhotonFileError> {
        let entry = self.find(pass)?;
        let read = || {
            (&self.file).seek(SeekFrom::Start(entry.offset))?;
            read_map(&mut BufReader::with_capacity(BUFFER, &self.file), entry.count as usize)
        };
        read().map_err(at(&self.path))
    }
}

fn at(path: &Path) -> impl Fn(PhotonFileErrorKind) -> PhotonFileError {
    move |kind| PhotonFileError { path: path.to_owned(), kind }
}

/// Reads all of a file and finds where its photons are.
fn scan(file: &File, length: u64, expected: &RenderIdentity) -> Result<Vec<Entry>, PhotonFileErrorKind> {
    const PREFIX: u64 = 16;
    const PASS: u64 = 8;
    if length < PREFIX + PASS + CHECKSUM_BYTES {
        return Err(damaged(format!("only {length} bytes long")));
    }
    // The checksum lies beyond what is buffered, so that buffering cannot mix it into itself.
    let end = length - CHECKSUM_BYTES;
    let mut input = BufReader::with_capacity(BUFFER, Checked::new(file.take(end)));
    if read_array(&mut input)? != MAGIC {
        return Err(PhotonFileErrorKind::Magic);
    }
    let version = u32::from_le_bytes(read_array(&mut input)?);
    if version != VERSION {
        return Err(PhotonFileErrorKind::Version(version));
    }
    let header_length = u64::from(u32::from_le_bytes(read_array(&mut input)?));
    let mut offset = PREFIX + header_length;
    if offset + PASS > end {
        return Err(damaged("its end is missing"));
    }
    let mut header = vec![0; header_length as usize];
    input.read_exact(&mut header)?;
    let identity: RenderIdentity =
        serde_json::from_slice(&header).map_err(|error| damaged(format!("bad header: {error}")))?;
    expected.check_same(&identity).map_err(PhotonFileErrorKind::Identity)?;
    let mut entries: Vec<Entry> = Vec::new();
    loop {
        if offset + PASS > end {
            return Err(damaged("its end is missing"));
        }
        let [pass, count] = [read_array(&mut input)?, read_array(&mut input)?].map(u32::from_le_bytes);
        offset += PASS;
        if pass == END {
            if count as usize != entries.len() || offset != end {
                return Err(damaged("passes are missing, or something follows its end"));
            }
            break;
        }
        let entry = Entry { pass, count, offset };
        if entries.last().is_some_and(|last| last.pass >= pass) {
            return Err(damaged("passes are not in order"));
        }
        if entry.bytes() > end - offset {
            return Err(damaged(format!("it ends before all {count} photons of pass {pass}")));
        }
        io::copy(&mut (&mut input).take(entry.bytes()), &mut io::sink())?;
        offset += entry.bytes();
        entries.push(entry);
    }
    let Checked { inner, checksum } = input.into_inner();
    if u32::from_le_bytes(read_array(&mut inner.into_inner())?) != checksum.finalize() {
        return Err(PhotonFileErrorKind::Checksum);
    }
    if entries.is_empty() {
        return Err(damaged("it holds no passes"));
    }
    Ok(entries)
}

/// Reads a map of `count` photons. The file has been checked to be that long, so the allocations are backed by it.
fn read_map(input: &mut impl Read, count: usize) -> Result<PhotonMap, PhotonFileErrorKind> {
    let mut photons = Vec::with_capacity(count);
    for _ in 0..count {
        let photon = Photon::from_le_bytes(&read_array(input)?);
        photons.push(photon.ok_or_else(|| damaged("a photon that is not finite"))?);
    }
    let mut nodes = Vec::with_capacity(node_count(count));
    for _ in 0..node_count(count) {
        let split = f32::from_le_bytes(read_array(input)?);
        let axis = u32::from_le_bytes(read_array(input)?);
        nodes.push(Node { split, axis });
    }
    PhotonMap::from_parts(photons, nodes).ok_or_else(|| damaged("a tree that makes no sense"))
}
