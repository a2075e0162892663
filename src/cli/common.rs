//! Options that several subcommands have.

use clap::Args;

use super::CliError;
use crate::scene::load::LoadOptions;
use crate::spec::key_value;

/// How scene files are read.
#[derive(Debug, Args)]
pub(super) struct Reading {
    /// Replace $NAME in the scene file
    #[arg(short = 'D', value_name = "NAME=VALUE", value_parser = key_value)]
    pub(super) define: Vec<(String, String)>,
    /// Replace what is not supported in a scene file, with a warning that says by what
    #[arg(long)]
    pub(super) lenient: bool,
}

impl Reading {
    pub(super) fn options(&self) -> LoadOptions {
        LoadOptions { defines: self.define.clone(), lenient: self.lenient, ..LoadOptions::default() }
    }
}

/// On how many threads all is done; does not change results.
#[derive(Debug, Args)]
pub(super) struct Threads {
    /// Threads [default: one per core]; do not change the image
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    threads: Option<u32>,
}

impl Threads {
    /// Before anything else is done on several.
    pub(super) fn start(&self) -> Result<(), CliError> {
        if let Some(threads) = self.threads {
            rayon::ThreadPoolBuilder::new().num_threads(threads as usize).build_global()?;
        }
        Ok(())
    }
}
