//! Mitsuba's serialized meshes: files made here byte by byte, valid and broken.

use std::io::Write;
use std::path::Path;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use glam::{Vec2, Vec3};
use helmholtz::scene::load::{LoadOptions, load};
use helmholtz::scene::{Geometry, TriangleMesh};
use proptest::prelude::*;

/// The file of streams: header and stream of each, then the table.
pub(crate) fn file(version: u16, streams: &[Vec<u8>]) -> Vec<u8> {
    let (mut bytes, mut offsets) = (Vec::new(), Vec::new());
    for stream in streams {
        offsets.push(bytes.len());
        bytes.extend(0x041c_u16.to_le_bytes());
        bytes.extend(version.to_le_bytes());
        let mut packed = ZlibEncoder::new(Vec::new(), Compression::default());
        packed.write_all(stream).expect("into memory");
        bytes.extend(packed.finish().expect("into memory"));
    }
    for offset in &offsets {
        if version == 3 {
            bytes.extend((*offset as u32).to_le_bytes());
        } else {
            bytes.extend((*offset as u64).to_le_bytes());
        }
    }
    bytes.extend((offsets.len() as u32).to_le_bytes());
    bytes
}

/// Flags, name (version 4), counts; then numbers of the width that the flags say, then indices.
fn stream(version: u16, flags: u32, counts: [u64; 2], numbers: &[f64], indices: &[u32]) -> Vec<u8> {
    let mut bytes = flags.to_le_bytes().to_vec();
    if version == 4 {
        bytes.extend(b"a mesh\0");
    }
    for n in counts {
        bytes.extend(n.to_le_bytes());
    }
    for &x in numbers {
        if flags & 0x2000 == 0 {
            bytes.extend((x as f32).to_le_bytes());
        } else {
            bytes.extend(x.to_le_bytes());
        }
    }
    for i in indices {
        bytes.extend(i.to_le_bytes());
    }
    bytes
}

const CORNERS: [f64; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];

/// One triangle without attributes.
pub(crate) fn triangle(version: u16) -> Vec<u8> {
    stream(version, 0x1000, [3, 1], &CORNERS, &[0, 1, 2])
}

/// The mesh in a file, loaded by a scene.
pub(crate) fn load_file(bytes: &[u8], parameters: &str) -> Result<TriangleMesh, String> {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("a.serialized"), bytes).expect("written");
    let text = format!(
        "<scene version='3.0.0'><shape type='serialized'><string name='filename' value='a.serialized'/>\
         {parameters}</shape></scene>"
    );
    let scene = folder.path().join("scene.xml");
    std::fs::write(&scene, text).expect("written");
    let loaded = load(Path::new(&scene), &LoadOptions::default()).map_err(|e| e.to_string())?;
    match loaded.scene.shapes.into_iter().next().map(|s| s.geometry) {
        Some(Geometry::Mesh(mesh)) => Ok(mesh),
        other => panic!("{other:?}"),
    }
}

#[test]
fn all_versions_and_layouts_load() {
    for version in [3, 4] {
        for precision in [0x1000, 0x2000] {
            // Normals, texture coordinates, colours.
            let mut numbers = CORNERS.to_vec();
            // Not those of the triangle, which would not be kept.
            numbers.extend([0.0, 0.6, 0.8].repeat(3));
            numbers.extend([0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
            numbers.extend((0..9).map(|i| f64::from(i) / 8.0));
            let full = stream(version, precision | 0x000b, [3, 1], &numbers, &[2, 0, 1]);
            let bytes = file(version, &[triangle(version), full]);
            let mesh = load_file(&bytes, "<integer name='shape_index' value='1'/>").expect("the second mesh");
            assert_eq!(mesh.triangles(), [[2, 0, 1]]);
            assert_eq!(mesh.positions(), [Vec3::ZERO, Vec3::X, Vec3::Y]);
            assert_eq!(mesh.normals(), [Vec3::new(0.0, 0.6, 0.8); 3]);
            assert_eq!(mesh.uvs(), [Vec2::ZERO, Vec2::X, Vec2::Y]);
            assert_eq!(mesh.attributes()[0].name, "vertex_color");
            assert_eq!(mesh.attributes()[0].values[8], 1.0);
            let first = load_file(&bytes, "").expect("the first mesh");
            assert_eq!((first.triangles(), first.uvs().len()), (&[[0, 1, 2]][..], 0));
        }
    }
}

#[test]
fn broken_files_are_located_errors() {
    let good = file(4, &[triangle(4)]);
    let claim = |counts| file(4, &[stream(4, 0x1000, counts, &CORNERS, &[0, 1, 2])]);
    let mut magic = good.clone();
    magic[0] = 0;
    let mut version = good.clone();
    version[2] = 9;
    let end = good.len();
    let mut count = good.clone();
    count[end - 4..].copy_from_slice(&u32::MAX.to_le_bytes());
    let mut offset = good.clone();
    offset[end - 12..end - 4].copy_from_slice(&u64::MAX.to_le_bytes());
    let mut zlib = good.clone();
    zlib[6] ^= 0xff;
    for (bytes, parameters, words) in [
        (vec![], "", "cannot be read"),
        (magic, "", "magic number"),
        (version, "", "version 9"),
        (count, "", "a table of 4294967295 meshes"),
        (offset, "", "a place within the file"),
        (zlib, "", "a broken zlib stream"),
        (good.clone(), "<integer name='shape_index' value='1'/>", "shape_index 1 of 1 meshes"),
        (good[..end - 1].to_vec(), "", "expected"),
        (claim([u64::MAX, 1]), "", "18446744073709551615 vertices"),
        (claim([1 << 40, 1]), "", "vertices"),
        (claim([3, u64::MAX / 12]), "", "triangles"),
        (claim([3, 0]), "", "a mesh without triangles"),
        (claim([4, 1]), "", "bytes of mesh data"),
        (file(4, &[stream(4, 0x1000, [3, 1], &CORNERS, &[0, 1, 3])]), "", "uses vertex 3"),
    ] {
        let error = load_file(&bytes, parameters).expect_err(words);
        assert!(error.contains(words) && error.contains("a.serialized"), "{words}: {error}");
    }
}

proptest! {
    /// Whatever bytes change, a file loads or is refused; it does not bring the program down.
    #[test]
    fn damage_is_survived(places in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6), cut in any::<prop::sample::Index>()) {
        let mut bytes = file(4, &[triangle(4), triangle(4)]);
        for (place, value) in places {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        let _ = load_file(&bytes, "");
        bytes.truncate(cut.index(bytes.len()));
        let _ = load_file(&bytes, "<integer name='shape_index' value='1'/>");
    }
}
