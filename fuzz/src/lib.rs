//! What the fuzz targets share: files in a folder of their own, since loaders read files.
//!
//! A target only runs a loader; whatever the bytes are, it must return. libFuzzer finds panics, hangs and excess of memory.

use std::path::PathBuf;

use helmholtz::scene::load::{LoadOptions, Loaded, load};
use tempfile::TempDir;

/// A folder that lives as long as the process.
pub struct Folder(TempDir);

impl Folder {
    /// An empty folder.
    #[expect(clippy::new_without_default, reason = "it touches the file system")]
    pub fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    /// Writes a file into the folder.
    pub fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).expect("a writable temporary folder");
        path
    }

    /// Loads a scene or mesh from these bytes, strictly and then leniently. A refusal must say why in few words.
    pub fn load(&self, name: &str, bytes: &[u8]) -> Option<Loaded> {
        let path = self.write(name, bytes);
        let mut loaded = None;
        for lenient in [false, true] {
            match load(&path, &LoadOptions { lenient, ..LoadOptions::default() }) {
                Ok(l) => loaded = Some(l),
                Err(error) => assert!(error.to_string().len() < 2000, "a message without bound"),
            }
        }
        loaded
    }
}
