//! What goes wrong in loading, and where: errors and warnings with the place in the file that caused them.

use std::fmt;
use std::path::{Path, PathBuf};

use thiserror::Error;

/// A place within a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Position {
    /// The file as a whole.
    File,
    /// A line of a text file, counted from 1.
    Line(usize),
    /// A line and a column (in characters), both counted from 1.
    LineColumn(usize, usize),
    /// An offset into a binary file.
    Byte(u64),
}

/// A file and a place in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Location {
    /// The file, as it was opened.
    pub file: PathBuf,
    /// Where in the file.
    pub position: Position,
}

impl Location {
    /// A file as a whole.
    pub fn file(file: &Path) -> Self {
        Self { file: file.to_path_buf(), position: Position::File }
    }

    /// A line of a file, counted from 1.
    pub fn line(file: &Path, line: usize) -> Self {
        Self { file: file.to_path_buf(), position: Position::Line(line) }
    }

    /// An offset into a binary file.
    pub fn byte(file: &Path, offset: u64) -> Self {
        Self { file: file.to_path_buf(), position: Position::Byte(offset) }
    }
}

impl fmt::Display for Location {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let file = self.file.display();
        match self.position {
            Position::File => write!(f, "{file}"),
            Position::Line(line) => write!(f, "{file}:{line}"),
            Position::LineColumn(line, column) => write!(f, "{file}:{line}:{column}"),
            Position::Byte(offset) => write!(f, "{file}: at byte {offset}"),
        }
    }
}

/// Why a scene was refused: where, what was found there, and what was expected instead.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{location}: {found}; expected {expected}")]
pub struct LoadError {
    /// Where.
    pub location: Location,
    /// What the file says.
    pub found: String,
    /// What it could have said.
    pub expected: String,
}

impl LoadError {
    /// An error of these three parts.
    pub fn new(location: Location, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self { location, found: found.into(), expected: expected.into() }
    }
}

/// How much a [`Warning`] matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    /// Something was chosen that the file leaves open.
    Note,
    /// Something in the file has no effect, or is doubtful.
    Warning,
    /// [`lenient`](super::LoadOptions::lenient) put something else in the place of what is not supported.
    Replaced,
}

/// Something that the user should know of a scene that did load.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Warning {
    /// How much it matters.
    pub severity: Severity,
    /// Where.
    pub location: Location,
    /// What, and what was done about it.
    pub message: String,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        write!(f, "{}: {}", self.location, self.message)
    }
}

/// The start of a text from a file, which may be very long and hold what a terminal would obey.
pub(super) fn abridged(text: &str) -> String {
    const LONGEST: usize = 60;
    let printable = |c: char| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c };
    let mut short: String = text.chars().take(LONGEST).map(printable).collect();
    if text.chars().nth(LONGEST).is_some() {
        short.push_str("...");
    }
    short
}
