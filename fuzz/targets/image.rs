//! Textures of all formats: the first bytes tell which; what they do not tell is TGA by the name.
#![no_main]

use std::sync::LazyLock;

use helmholtz::scene::load::load_image;
use helmholtz_fuzz::Folder;
use libfuzzer_sys::fuzz_target;

static FOLDER: LazyLock<Folder> = LazyLock::new(Folder::new);

fuzz_target!(|bytes: &[u8]| {
    let path = FOLDER.write("a.tga", bytes);
    if let Ok((image, _)) = load_image(&path) {
        let last = image.size() - 1;
        assert!(image.rgb(last.x, last.y, false).is_finite());
    }
});
