//! Where images go.

use std::path::{Path, PathBuf};

use super::CliError;
use crate::film::{Film, output};

/// The files that a render writes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Outputs {
    exr: Option<PathBuf>,
    png: PathBuf,
}

impl Outputs {
    /// From `-o`: `NAME.exr` means that file and `NAME.png` beside it, `NAME.png` only that. By default the scene's name in the
    /// current directory.
    pub(super) fn new(output: Option<&Path>, scene: &Path) -> Result<Self, CliError> {
        let default = || PathBuf::from(scene.file_stem().unwrap_or_default()).with_extension("exr");
        let path = output.map_or_else(default, Path::to_path_buf);
        let png = path.with_extension("png");
        match path.extension().and_then(|e| e.to_str()) {
            Some("exr") => Ok(Self { exr: Some(path), png }),
            Some("png") => Ok(Self { exr: None, png }),
            _ => Err(format!("{}: expected a name that ends in .exr or .png", path.display()).into()),
        }
    }

    /// Where an interrupted render is saved.
    pub(super) fn state(&self) -> PathBuf {
        self.png.with_extension("state")
    }

    /// Develops the film and writes the files. Returns what to tell a person.
    pub(super) fn write(&self, film: &Film, metadata: &[(String, String)]) -> Result<Vec<String>, CliError> {
        let image = film.develop();
        let mut written = Vec::new();
        if let Some(exr) = &self.exr {
            let clamped = output::write_exr(exr, &image, film.settings().half_float, metadata)?;
            written.push(match clamped {
                0 => format!("wrote {}", exr.display()),
                n => format!("wrote {} ({n} values are clamped to the largest half float)", exr.display()),
            });
        }
        output::write_png(&self.png, &image)?;
        written.push(format!("wrote {}", self.png.display()));
        Ok(written)
    }
}
