//! Files that say what a study is to render, for `helmholtz study --config`:
//!
//! ```toml
//! budgets = ["1s", "4s", "16s"]
//! seeds = 5
//! size = "256x256"
//! reference = "truth.exr"      # beside this file
//!
//! [[configuration]]
//! name = "no roulette"
//! integrator = "path:rr_depth=1000"
//! backend = "obvhs"
//! sampling_columns = 256       # of the environment map
//! ```
//!
//! All is optional but name and integrator of a configuration.

use std::fs;
use std::num::NonZeroU32;
use std::path::{Path, PathBuf};
use std::time::Duration;

use glam::UVec2;
use serde::{Deserialize, Deserializer, de};
use toml::Spanned;

use super::plan::{PlanError, Planner};
use crate::scene::load::{Location, Position};
use crate::spec::{Spec, duration, size, spec};

/// What such a file says.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Budgets.
    #[serde(default, deserialize_with = "budgets")]
    pub budgets: Vec<Duration>,
    /// Number of seeds.
    pub seeds: Option<NonZeroU32>,
    /// File of the reference.
    pub reference: Option<PathBuf>,
    /// Size of the film in pixels.
    #[serde(default, deserialize_with = "film_size")]
    pub size: Option<UVec2>,
    #[serde(default, rename = "configuration")]
    configurations: Vec<Spanned<Configuration>>,
    /// To locate errors.
    #[serde(skip)]
    source: (PathBuf, String),
}

#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct Configuration {
    name: String,
    #[serde(deserialize_with = "required_spec")]
    integrator: Spec,
    #[serde(default, deserialize_with = "optional_spec")]
    backend: Option<Spec>,
    #[serde(default, deserialize_with = "columns")]
    sampling_columns: Option<u32>,
}

/// Why a file was refused, and where.
#[derive(Debug, thiserror::Error)]
#[error("{location}: {why}")]
pub struct ConfigError {
    /// Where.
    pub location: Location,
    /// Why.
    pub why: String,
}

impl Config {
    /// Reads a file.
    ///
    /// # Errors
    /// If it cannot be read, is not TOML, has a key that is not known or a value that makes no sense.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = fs::read_to_string(path)
            .map_err(|error| ConfigError { location: Location::file(path), why: error.to_string() })?;
        let located = |error: toml::de::Error| ConfigError {
            location: error
                .span()
                .map_or_else(|| Location::file(path), |span| location(path, &text, span.start)),
            why: error.message().to_owned(),
        };
        let mut this: Self = toml::from_str(&text).map_err(located)?;
        this.reference = this.reference.map(|file| path.with_file_name("").join(file));
        this.source = (path.to_owned(), text);
        Ok(this)
    }

    /// Asks for the configurations of the file.
    ///
    /// # Errors
    /// If one is refused.
    pub fn plan(&self, planner: &mut Planner) -> Result<(), ConfigError> {
        let (path, text) = &self.source;
        for entry in &self.configurations {
            let Configuration { name, integrator, backend, sampling_columns } = entry.as_ref();
            let located = |error: PlanError| ConfigError {
                location: location(path, text, entry.span().start),
                why: error.to_string(),
            };
            planner.add(name.clone(), integrator, backend.as_ref(), *sampling_columns).map_err(located)?;
        }
        Ok(())
    }
}

/// The place of a byte in a text.
fn location(file: &Path, text: &str, byte: usize) -> Location {
    let before = text.get(..byte).unwrap_or(text);
    let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
    let (line, column) = (1 + before.matches('\n').count(), 1 + before[line_start..].chars().count());
    Location { file: file.to_owned(), position: Position::LineColumn(line, column) }
}

fn columns<'de, D: Deserializer<'de>>(from: D) -> Result<Option<u32>, D::Error> {
    let columns = u32::deserialize(from)?;
    if columns < 2 { Err(de::Error::custom("expected a whole number from 2 on")) } else { Ok(Some(columns)) }
}

fn budgets<'de, D: Deserializer<'de>>(from: D) -> Result<Vec<Duration>, D::Error> {
    let texts = Vec::<String>::deserialize(from)?;
    texts.iter().map(|text| duration(text)).collect::<Result<_, _>>().map_err(de::Error::custom)
}

fn film_size<'de, D: Deserializer<'de>>(from: D) -> Result<Option<UVec2>, D::Error> {
    size(&String::deserialize(from)?).map(Some).map_err(de::Error::custom)
}

fn required_spec<'de, D: Deserializer<'de>>(from: D) -> Result<Spec, D::Error> {
    spec(&String::deserialize(from)?).map_err(de::Error::custom)
}

fn optional_spec<'de, D: Deserializer<'de>>(from: D) -> Result<Option<Spec>, D::Error> {
    required_spec(from).map(Some)
}
