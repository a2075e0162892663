//! The command line: one file per subcommand. All printing to people happens here.

mod ab;
mod common;
mod debug_pixel;
mod diff;
mod inspect;
mod integrator;
mod merge;
mod output;
mod parse;
mod progress;
mod render;
mod selftest;
mod study;
mod table;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Exit code for an image that was finished, or a question that was answered.
pub const EXIT_DONE: u8 = 0;
/// Exit code for an error: a scene that does not load, a file that cannot be written. A message says which.
pub const EXIT_ERROR: u8 = 1;
/// Exit code of a comparison for images that differ by more than they may, or for predictions that do not hold.
pub const EXIT_DIFFERENT: u8 = 3;
/// Exit code for backends of which one gave a wrong answer, and for a selftest of which a check failed.
pub const EXIT_FAULTS: u8 = 4;
/// Exit code for a render that was interrupted by Ctrl-C and saved what it had.
pub const EXIT_INTERRUPTED: u8 = 130;

/// A renderer that follows light both ways.
///
/// Reads Mitsuba scenes (.xml) and plain meshes (.obj, .ply); writes OpenEXR and PNG.
///
/// Exit codes: 0 done; 1 error; 2 wrong usage; 3 images differ by more than asked for, or a scene from what is predicted; 4 backends disagree and one is wrong, or a check failed; 130 interrupted by Ctrl-C after saving.
#[derive(Debug, Parser)]
#[command(version, max_term_width = 100)]
pub struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Render(Box<render::RenderArgs>),
    Merge(merge::MergeArgs),
    Diff(diff::DiffArgs),
    Ab(Box<ab::AbArgs>),
    Inspect(inspect::InspectArgs),
    Study(Box<study::StudyArgs>),
    Selftest(selftest::SelftestArgs),
}

/// Runs a parsed command line and says how it went. Errors are printed to standard error.
pub fn run(cli: Cli) -> ExitCode {
    let result = match cli.command {
        Command::Render(args) => render::run(&args),
        Command::Merge(args) => merge::run(&args),
        Command::Diff(args) => diff::run(&args),
        Command::Ab(args) => ab::run(&args),
        Command::Inspect(args) => inspect::run(&args),
        Command::Study(args) => study::run(&args),
        Command::Selftest(args) => selftest::run(&args),
    };
    match result {
        Ok(code) => ExitCode::from(code),
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::from(EXIT_ERROR)
        }
    }
}

/// What a subcommand fails with: a message for a person, with everything that is needed to act on it.
type CliError = Box<dyn std::error::Error>;
