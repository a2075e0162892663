//! The trade between speed and accuracy, measured: how far images are from a reference, what two backends cost and disagree about, and which integrator suits a
//! scene.
//!
//! [`picture`] reads images of any program, [`metrics`] compares numbers, [`flip`] compares what people see, [`heat`] shows where they differ. [`ab`] runs two
//! backends on one scene; [`html`] is what reports are made of. [`pilot`] renders a few pixels to learn what carries light, [`auto`] chooses an integrator by that, and [`verify`]
//! holds it against what integrators should be able to do. [`converge`] renders until the error is small enough. Nothing here prints.
//!
//! A *study* renders one scene in many ways and asks which is best: [`plan`] says what is rendered, by command-line texts or a [`config`] file, [`run`] renders it and keeps
//! what is finished in a folder ([`cells`]), [`reference`](mod@reference) is what images are compared with, and [`bias`] what error time does not lessen. [`results`] is what was measured, [`summary`]
//! what follows from it by [`statistics`], and [`report`], with a [`plot`], how a person is told.

pub mod ab;
pub mod auto;
pub mod bias;
pub mod cells;
pub mod config;
pub mod converge;
pub mod flip;
pub mod heat;
pub mod html;
pub mod metrics;
pub mod picture;
pub mod pilot;
pub mod plan;
pub mod plot;
pub mod reference;
pub mod report;
pub mod results;
pub mod run;
pub mod statistics;
pub mod summary;
mod sweep;
pub mod verify;

use std::path::PathBuf;

use crate::film::FilmError;
use crate::film::output::OutputError;
use crate::integrators::TooManyStored;
use crate::query::BackendError;
use crate::render::RenderError;
use crate::scene::load::LoadError;

/// Why a study ends without results.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The budgets are no ladder.
    #[error("budgets should be at least one, all above 0, each greater than the one before")]
    Budgets,
    /// There are no seeds, or one is there twice.
    #[error("seeds should be at least one, all different")]
    Seeds,
    /// A run would have the noise of the reference.
    #[error(
        "the reference was rendered with seed {0}, which is among the study's: their noise would be the same"
    )]
    SeedOfReference(u64),
    /// A file cannot be the reference.
    #[error("reference {}: {why}", path.display())]
    Reference {
        /// The file.
        path: PathBuf,
        /// Why.
        why: String,
    },
    /// An image cannot be read.
    #[error(transparent)]
    Image(#[from] LoadError),
    /// A file cannot be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// The film makes no sense, or has no memory.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// The backend of the reference cannot be built.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// The pilot of the reference has too many photons.
    #[error(transparent)]
    Pilot(#[from] TooManyStored),
    /// The reference cannot be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
}
