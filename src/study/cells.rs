//! The folder of a study: what is finished is kept there and not rendered again.
//!
//! A *cell* is a configuration with a seed. Each has a folder of its own, `cells/PATH-SEED-HASH`, with `run.json` (what it is a run of, and what was measured) and an image for each
//! state that was measured, `PASSES.exr`. `run.json` is written last and atomically: where it is, the cell is finished. The reference is kept likewise, in `reference.exr` and
//! `reference.json`. Nothing else in the folder is read, changed or removed.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::picture::Picture;
use super::results::{self, Run};
use crate::film::output::{OutputError, write_atomically};

/// All that a run depends on. Two runs of one identity differ in what the clock says only.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Identity {
    /// Fingerprint of the scene's files and definitions.
    pub scene: String,
    /// Integrator with all parameters.
    pub integrator: String,
    /// Backend with its settings.
    pub backend: String,
    /// In how many columns the environment map is sampled, if not as the scene says.
    pub sampling_columns: Option<u32>,
    /// The seed.
    pub seed: u64,
    /// Budgets in seconds.
    pub budgets: Vec<f64>,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Threads, which time depends on.
    pub threads: usize,
    /// Checksum of the reference.
    pub reference: String,
    /// Version of the program.
    pub version: String,
}

/// All that a reference depends on that was rendered for a study.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReferenceIdentity {
    /// Fingerprint of the scene's files and definitions.
    pub scene: String,
    /// Longest paths; `None`: no limit.
    pub max_depth: Option<u32>,
    /// Backend with its settings.
    pub backend: String,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Time that it had, in seconds.
    pub seconds: f64,
    /// Version of the program.
    pub version: String,
}

/// What is known of a reference that is kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeptReference {
    /// What it is a reference of.
    pub identity: ReferenceIdentity,
    /// Checksum of the image.
    pub checksum: String,
    /// For the results.
    pub reference: results::Reference,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct KeptRun {
    identity: Identity,
    run: Run,
}

/// What may be kept.
#[derive(Debug)]
pub enum Kept<T> {
    /// It is.
    Whole(T),
    /// Nothing is.
    None,
    /// Something is that cannot be used.
    Broken {
        /// The file.
        file: PathBuf,
        /// What is wrong with it.
        why: String,
    },
}

/// The folder of a study.
#[derive(Debug, Clone)]
pub struct Store {
    folder: PathBuf,
}

impl Store {
    /// Makes the folder if it is not there.
    ///
    /// # Errors
    /// If it cannot be made.
    pub fn open(folder: &Path) -> Result<Self, OutputError> {
        make_folder(folder)?;
        Ok(Self { folder: folder.to_owned() })
    }

    /// The run of that identity, if it is finished and all its images are there.
    pub fn run(&self, identity: &Identity) -> Kept<Run> {
        let file = self.cell(identity).join("run.json");
        let kept = match read::<KeptRun>(&file) {
            Ok(Some(kept)) => kept,
            Ok(None) => return Kept::None,
            Err(why) => return Kept::Broken { file, why },
        };
        if kept.identity != *identity {
            return Kept::Broken { file, why: "is of another run".to_owned() };
        }
        let KeptRun { run, .. } = kept;
        if run.points.len() != identity.budgets.len() || run.seed != identity.seed {
            return Kept::Broken { file, why: "does not go with its own budgets and seed".to_owned() };
        }
        for point in &run.points {
            let file = self.image(identity, point.passes);
            let broken = match Picture::read(&file) {
                Ok(picture) if picture.size.to_array() == identity.size => continue,
                Ok(_) => "has another size".to_owned(),
                Err(error) => error.to_string(),
            };
            return Kept::Broken { file, why: broken };
        }
        Kept::Whole(run)
    }

    /// Clears the place of a cell that is about to be rendered: removes what an earlier attempt has left.
    ///
    /// # Errors
    /// If the folder cannot be made or read, or a file cannot be removed.
    pub fn begin(&self, identity: &Identity) -> Result<(), OutputError> {
        let folder = self.cell(identity);
        make_folder(&folder)?;
        let clear = || -> io::Result<()> {
            for entry in fs::read_dir(&folder)? {
                let path = entry?.path();
                let stem = path.file_stem().unwrap_or_default().to_string_lossy();
                let is_image = path.extension().is_some_and(|e| e == "exr") && stem.parse::<u32>().is_ok();
                if is_image || path.file_name().is_some_and(|name| name == "run.json") {
                    fs::remove_file(&path)?;
                }
            }
            Ok(())
        };
        clear().map_err(|source| OutputError { path: folder.clone(), source })
    }

    /// Where the image of a run after so many passes is.
    pub fn image(&self, identity: &Identity, passes: u32) -> PathBuf {
        self.cell(identity).join(format!("{passes}.exr"))
    }

    /// Keeps a run, whose images are written already.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn keep_run(&self, identity: &Identity, run: &Run) -> Result<(), OutputError> {
        let kept = KeptRun { identity: identity.clone(), run: run.clone() };
        write(&self.cell(identity).join("run.json"), &kept)
    }

    /// Where the reference is.
    pub fn reference_image(&self) -> PathBuf {
        self.folder.join("reference.exr")
    }

    /// What is known of the reference of that identity, if it is kept.
    pub fn reference(&self, identity: &ReferenceIdentity) -> Kept<KeptReference> {
        let file = self.folder.join("reference.json");
        match read::<KeptReference>(&file) {
            Ok(Some(kept)) if kept.identity == *identity => Kept::Whole(kept),
            Ok(_) => Kept::None,
            Err(why) => Kept::Broken { file, why },
        }
    }

    /// Keeps a reference, whose image is written already.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn keep_reference(&self, kept: &KeptReference) -> Result<(), OutputError> {
        write(&self.folder.join("reference.json"), kept)
    }

    /// The folder of a cell. Its name says what a person looks for; the checksum tells the rest apart.
    fn cell(&self, identity: &Identity) -> PathBuf {
        // All fields by name, so that none that is added is forgotten.
        let Identity {
            scene,
            integrator,
            backend,
            sampling_columns,
            seed,
            budgets,
            size,
            threads,
            reference,
            version,
        } = identity;
        let all = format!(
            "{scene} {integrator} {backend} {sampling_columns:?} {budgets:?} {size:?} {threads} {reference} {version}"
        );
        let name = integrator.split(':').next().unwrap_or_default();
        let checksum = crc32fast::hash(all.as_bytes());
        self.folder.join("cells").join(format!("{name}-{seed}-{checksum:08x}"))
    }
}

fn make_folder(folder: &Path) -> Result<(), OutputError> {
    fs::create_dir_all(folder).map_err(|source| OutputError { path: folder.to_owned(), source })
}

/// Reads a file of JSON; `None` if there is none.
fn read<T: DeserializeOwned>(file: &Path) -> Result<Option<T>, String> {
    match fs::read(file) {
        Ok(bytes) => serde_json::from_slice(&bytes).map(Some).map_err(|error| error.to_string()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error.to_string()),
    }
}

fn write<T: Serialize>(file: &Path, content: &T) -> Result<(), OutputError> {
    write_atomically(file, |out| {
        serde_json::to_writer_pretty(&mut *out, content)?;
        out.write_all(b"\n")
    })
}
