//! PLY, text and binary.
#![no_main]

use std::sync::LazyLock;

use helmholtz_fuzz::Folder;
use libfuzzer_sys::fuzz_target;

static FOLDER: LazyLock<Folder> = LazyLock::new(Folder::new);

fuzz_target!(|bytes: &[u8]| {
    FOLDER.load("a.ply", bytes);
});
