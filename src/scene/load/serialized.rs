//! Mitsuba's `serialized` format: several meshes in one file, each a zlib stream of its own.
//!
//! A header (magic number, version), one such pair before each stream, the streams, and at the end of the file a table of where each begins.
//! Versions 3 and 4 are in use; 4 added names and offsets of 64 bits. All numbers are little-endian.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

use flate2::read::ZlibDecoder;
use glam::{Vec2, Vec3};

use super::mesh::{Placement, RawMesh};
use super::{LoadError, Location, Log};
use crate::scene::{Geometry, MeshAttribute};

const MAGIC: u16 = 0x041c;

const HAS_NORMALS: u32 = 0x0001;
const HAS_UVS: u32 = 0x0002;
const HAS_COLORS: u32 = 0x0008;
const DOUBLE_PRECISION: u32 = 0x2000;

/// Bytes that a stream may unpack to regardless of its size.
const SMALL: u64 = 32 << 20;
/// Bytes out of one byte of a stream beyond that. Meshes reach 10; deflate at its limit 1032.
const MAX_EXPANSION: u64 = 100;
/// Characters of a mesh's name.
const MAX_NAME: usize = 4096;

/// Loads the mesh of the given index, counted from 0.
pub(super) fn load_mesh(
    path: &Path,
    from: &Location,
    index: u32,
    placement: &Placement,
    log: &mut Log,
) -> Result<Geometry, LoadError> {
    let (mut file, length) = log.open(path, from)?;
    let refuse =
        |at: u64, found: String, expected: &str| LoadError::new(Location::byte(path, at), found, expected);
    let io =
        |at: u64| move |e: std::io::Error| refuse(at, format!("cannot be read ({e})"), "a serialized mesh");
    let (version, begin, end) = find(&mut file, length, index, path)?;
    file.seek(SeekFrom::Start(begin)).map_err(io(begin))?;
    let packed = end - begin;
    let mut stream = Stream { bytes: ZlibDecoder::new(file.take(packed)), path, begin, unpacked: 0 };
    let flags = stream.u32()?;
    if version >= 4 {
        stream.skip_name()?;
    }
    let (vertices, triangles) = (stream.u64()?, stream.u64()?);
    let width: u64 = if flags & DOUBLE_PRECISION == 0 { 4 } else { 8 };
    let has = |flag: u32| flags & flag != 0;
    let floats =
        3 + 3 * u64::from(has(HAS_NORMALS)) + 2 * u64::from(has(HAS_UVS)) + 3 * u64::from(has(HAS_COLORS));
    let claim = vertices
        .checked_mul(floats * width)
        .zip(triangles.checked_mul(12))
        .and_then(|(a, b)| a.checked_add(b));
    let most = SMALL.max(packed.saturating_mul(MAX_EXPANSION));
    // Indices have 32 bits.
    let Some(claim) = claim.filter(|&c| c <= most && u32::try_from(vertices).is_ok()) else {
        let found = format!("{vertices} vertices and {triangles} triangles in {packed} bytes");
        return Err(refuse(begin, found, "as many as the stream can hold"));
    };
    if triangles == 0 {
        return Err(refuse(begin, "a mesh without triangles".to_owned(), "at least one"));
    }
    let mut data = Vec::new();
    let read = stream.bytes.take(claim).read_to_end(&mut data);
    let read = read.map_err(|e| refuse(begin, format!("a broken zlib stream ({e})"), "a serialized mesh"))?;
    if (read as u64) < claim {
        return Err(refuse(begin, format!("{read} bytes of mesh data"), &format!("{claim} bytes")));
    }
    let mut rest = &data[..];
    let mut take = |numbers: u64| -> Vec<f32> {
        let (head, tail) = rest.split_at((numbers * width) as usize);
        rest = tail;
        if width == 4 {
            head.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
        } else {
            let wide = |b: &[u8]| f64::from_le_bytes([b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7]]);
            head.chunks_exact(8).map(|b| wide(b) as f32).collect()
        }
    };
    let mut mesh = RawMesh::default();
    let vectors = |numbers: Vec<f32>| numbers.chunks_exact(3).map(Vec3::from_slice).collect();
    mesh.positions = vectors(take(3 * vertices));
    if has(HAS_NORMALS) {
        mesh.normals = vectors(take(3 * vertices));
    }
    if has(HAS_UVS) {
        mesh.uvs = take(2 * vertices).chunks_exact(2).map(Vec2::from_slice).collect();
    }
    if has(HAS_COLORS) {
        let values = take(3 * vertices);
        mesh.attributes.push(MeshAttribute {
            name: "vertex_color".to_owned(),
            per_face: false,
            channels: 3,
            values,
        });
    }
    mesh.triangles = rest.chunks_exact(12).map(|t| std::array::from_fn(|k| index_at(t, k))).collect();
    let bad = mesh.count_bad_attributes();
    if bad > 0 {
        log.warn(Location::byte(path, begin), format!("{bad} normals or texture coordinates are not finite"));
    }
    // The file's own flag for flat normals (0x0010) has no effect in Mitsuba 3 either.
    mesh.place(placement).map(Geometry::Mesh).map_err(|e| refuse(begin, e.to_string(), "a valid mesh"))
}

/// The version of the file, and where the stream of a mesh begins and ends.
fn find(file: &mut File, length: u64, index: u32, path: &Path) -> Result<(u16, u64, u64), LoadError> {
    let refuse =
        |at: u64, found: String, expected: &str| LoadError::new(Location::byte(path, at), found, expected);
    let mut read = |at: u64, bytes: &mut [u8]| {
        let read = file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(bytes));
        read.map_err(|e| refuse(at, format!("cannot be read ({e})"), "a serialized mesh"))
    };
    let mut header = [0; 4];
    read(0, &mut header)?;
    let (magic, version) =
        (u16::from_le_bytes([header[0], header[1]]), u16::from_le_bytes([header[2], header[3]]));
    if magic != MAGIC || !(3..=4).contains(&version) {
        let found = format!("magic number {magic:#06x} and version {version}");
        return Err(refuse(0, found, "0x041c and version 3 or 4, of a Mitsuba serialized mesh"));
    }
    let mut count = [0; 4];
    read(length.saturating_sub(4), &mut count)?;
    let count = u32::from_le_bytes(count);
    let width: u64 = if version == 3 { 4 } else { 8 };
    let table = length.checked_sub(4 + u64::from(count) * width).filter(|table| *table >= 4 && count > 0);
    let Some(table) = table else {
        return Err(refuse(
            length.saturating_sub(4),
            format!("a table of {count} meshes"),
            "one that fits the file",
        ));
    };
    if index >= count {
        return Err(refuse(
            table,
            format!("shape_index {index} of {count} meshes"),
            "an index below their number",
        ));
    }
    let mut offset = |i: u32| {
        let mut bytes = [0; 8];
        let at = table + u64::from(i) * width;
        read(at, &mut bytes[..width as usize])?;
        Ok(u64::from_le_bytes(bytes))
    };
    let begin = offset(index)?;
    let end = if index + 1 < count { offset(index + 1)? } else { table };
    // Before each stream magic number and version are repeated.
    let at = table + u64::from(index) * width;
    match begin.checked_add(4) {
        Some(stream) if stream < end && end <= table => Ok((version, stream, end)),
        _ => Err(refuse(at, format!("a mesh from byte {begin} to {end}"), "a place within the file")),
    }
}

/// Little-endian index `k` of a triangle's twelve bytes.
fn index_at(bytes: &[u8], k: usize) -> u32 {
    u32::from_le_bytes([bytes[4 * k], bytes[4 * k + 1], bytes[4 * k + 2], bytes[4 * k + 3]])
}

/// The head of an unpacked stream.
struct Stream<'a> {
    bytes: ZlibDecoder<std::io::Take<File>>,
    path: &'a Path,
    begin: u64,
    unpacked: u64,
}

impl Stream<'_> {
    fn read<const N: usize>(&mut self) -> Result<[u8; N], LoadError> {
        let mut bytes = [0; N];
        self.bytes.read_exact(&mut bytes).map_err(|e| {
            let found = format!("a broken zlib stream ({e}, {} bytes into it)", self.unpacked);
            LoadError::new(Location::byte(self.path, self.begin), found, "a serialized mesh")
        })?;
        self.unpacked += N as u64;
        Ok(bytes)
    }

    fn u32(&mut self) -> Result<u32, LoadError> {
        self.read().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, LoadError> {
        self.read().map(u64::from_le_bytes)
    }

    fn skip_name(&mut self) -> Result<(), LoadError> {
        for _ in 0..MAX_NAME {
            if self.read::<1>()? == [0] {
                return Ok(());
            }
        }
        let found = format!("a name of more than {MAX_NAME} bytes");
        Err(LoadError::new(Location::byte(self.path, self.begin), found, "a serialized mesh"))
    }
}
