//! The `helmholtz` program: parses its arguments and hands them to [`helmholtz::cli`].

use std::process::ExitCode;

use clap::Parser;
use helmholtz::cli::{self, Cli};

fn main() -> ExitCode {
    cli::run(Cli::parse())
}
