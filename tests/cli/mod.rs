//! The program from end to end: what it writes, what it says, and that threads, resuming and merging change no bit.

mod explain;
mod render;
mod study;

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tempfile::TempDir;

use crate::support::exr_channels;

const SCENE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/cornell-box.xml");
const BACKENDS: &[&str] = &[
    #[cfg(feature = "embree")]
    "embree",
    "obvhs",
];

struct Folder(TempDir);

impl Folder {
    fn new() -> Self {
        Self(TempDir::new().expect("a temporary folder"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// Runs the program in this folder.
    fn run(&self, arguments: &[&str]) -> Output {
        let mut command = Command::new(env!("CARGO_BIN_EXE_helmholtz"));
        command.current_dir(self.0.path()).args(arguments).output().expect("the program runs")
    }

    /// Runs it and expects success; standard error.
    fn succeed(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(output.status.success(), "{arguments:?}: {text}");
        text
    }

    /// Runs it and expects an error with this exit code; standard error.
    fn fail(&self, arguments: &[&str], code: i32) -> String {
        let output = self.run(arguments);
        assert_eq!(output.status.code(), Some(code), "{arguments:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    }
}

/// Names and bits of all channels of a file.
fn channels(path: &Path) -> Vec<(String, Vec<u32>)> {
    let bits = |(name, values): (String, Vec<f32>)| (name, values.into_iter().map(f32::to_bits).collect());
    exr_channels(path).into_iter().map(bits).collect()
}
