//! `helmholtz merge`: parts of a render become one image.

use std::path::PathBuf;

use clap::Args;

use super::output::Outputs;
use super::{CliError, EXIT_DONE};
use crate::film::state::{load_state, save_state};

/// Add up state files of the same render with different passes
///
/// The image is the same to the last bit as if all passes had been rendered at once. Files of another scene,
/// integrator, seed or film, or with passes in common, are refused.
#[derive(Debug, Args)]
pub(super) struct MergeArgs {
    /// State files, from `render --save-state`
    #[arg(required = true, value_name = "STATE")]
    states: Vec<PathBuf>,
    /// Image to write: NAME.exr (and NAME.png beside it) or NAME.png
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// Save the sum as a state file too
    #[arg(long, value_name = "FILE")]
    save_state: Option<PathBuf>,
}

pub(super) fn run(args: &MergeArgs) -> Result<u8, CliError> {
    let outputs = Outputs::new(Some(&args.output), &args.output)?;
    let (first, rest) = args.states.split_first().ok_or("no state files given")?;
    let (identity, mut film) = load_state(first)?;
    for path in rest {
        let refused = |error: &dyn std::fmt::Display| {
            format!("{} does not go with {}: {error}", path.display(), first.display())
        };
        let (other_identity, other) = load_state(path)?;
        identity.check_same(&other_identity).map_err(|error| refused(&error))?;
        film.merge(&other).map_err(|error| refused(&error))?;
    }
    let metadata = [("integrator", identity.integrator.clone()), ("seed", identity.seed.to_string())];
    let metadata: Vec<_> = metadata.into_iter().map(|(name, value)| (name.to_owned(), value)).collect();
    for line in outputs.write(&film, &metadata)? {
        eprintln!("{line}");
    }
    if let Some(path) = &args.save_state {
        save_state(path, &identity, &film)?;
        eprintln!("wrote {}", path.display());
    }
    eprintln!("{} samples per pixel from {} files", film.passes().len(), args.states.len());
    Ok(EXIT_DONE)
}
