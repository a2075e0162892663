//! Mitsuba's serialized meshes: the bytes as a file, and as what a sound file packs, which blind changes to a zlib stream never reach.
#![no_main]

use std::io::Write;
use std::sync::LazyLock;

use flate2::Compression;
use flate2::write::ZlibEncoder;
use helmholtz_fuzz::Folder;
use libfuzzer_sys::fuzz_target;

static FOLDER: LazyLock<Folder> = LazyLock::new(Folder::new);

const SCENE: &[u8] = b"<scene version='3.0.0'><shape type='serialized'><string name='filename' value='a.serialized'/></shape></scene>";

/// A file of one mesh.
fn packed(mesh: &[u8]) -> Vec<u8> {
    let mut file = vec![0x1c, 0x04, 4, 0];
    let mut stream = ZlibEncoder::new(&mut file, Compression::fast());
    stream.write_all(mesh).expect("into memory");
    stream.finish().expect("into memory");
    file.extend(0_u64.to_le_bytes());
    file.extend(1_u32.to_le_bytes());
    file
}

fuzz_target!(|bytes: &[u8]| {
    for file in [bytes, &packed(bytes)] {
        FOLDER.write("a.serialized", file);
        FOLDER.load("a.xml", SCENE);
    }
});
