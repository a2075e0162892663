//! The `helmholtz` program: parses its arguments and hands them to [`helmholtz::cli`].

use std::process::ExitCode;

use clap::Parser;
use helmholtz::cli::{self, Cli};
use helmholtz::processor;

fn main() -> ExitCode {
    if !processor::suits() {
        eprintln!("{}", processor::MESSAGE);
        return ExitCode::FAILURE;
    }
    cli::run(Cli::parse())
}
