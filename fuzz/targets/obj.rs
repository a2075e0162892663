//! OBJ with MTL: what comes after the first byte 0 is the library `a.mtl`, which an OBJ can name.
#![no_main]

use std::sync::LazyLock;

use helmholtz_fuzz::Folder;
use libfuzzer_sys::fuzz_target;

static FOLDER: LazyLock<Folder> = LazyLock::new(|| {
    let folder = Folder::new();
    folder.write("a.png", include_bytes!("../../tests/scenes/textures/grey.png"));
    folder
});

fuzz_target!(|bytes: &[u8]| {
    let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
    FOLDER.write("a.mtl", bytes.get(end + 1..).unwrap_or_default());
    FOLDER.load("a.obj", &bytes[..end]);
});
