//! Mitsuba scenes. Files that they name lie beside them: a mesh of each format, an image, and a file to include.
#![no_main]

use std::sync::LazyLock;

use helmholtz::transport::World;
use helmholtz_fuzz::Folder;
use libfuzzer_sys::fuzz_target;

static FOLDER: LazyLock<Folder> = LazyLock::new(|| {
    let folder = Folder::new();
    folder.write("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n");
    folder.write("a.png", include_bytes!("../../tests/scenes/textures/grey.png"));
    folder.write("b.xml", b"<scene version='3.0.0'><bsdf type='diffuse' id='b'/></scene>");
    folder
});

fuzz_target!(|bytes: &[u8]| {
    if let Some(loaded) = FOLDER.load("a.xml", bytes) {
        // What rendering prepares must stand any scene that loads.
        let _ = World::new(&loaded.scene);
    }
});
