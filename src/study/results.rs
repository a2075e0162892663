//! What a study has measured, as data: configurations, their runs, and the errors along each run. Nothing is computed here; the summary draws
//! conclusions, and both are written to the study's JSON.
//!
//! A *configuration* is an integrator with its parameters on a backend with its. A *run* is one render of a configuration with one seed, which goes on
//! to the greatest budget and is compared with the reference whenever a budget is used up, so that a ladder of budgets costs no more than its last rung.

use serde::{Deserialize, Serialize};

/// All that a study has measured.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Results {
    /// Name of the scene.
    pub scene: String,
    /// Width and height of the images in pixels.
    pub size: [u32; 2],
    /// Threads at work.
    pub threads: usize,
    /// Version of the program.
    pub version: String,
    /// Time to load the scene, in seconds.
    pub load: f64,
    /// Budgets in seconds of rendering, ascending. Time to load, build and to compare images does not count.
    pub budgets: Vec<f64>,
    /// What images are compared with.
    pub reference: Reference,
    /// What was measured of each configuration.
    pub configurations: Vec<Configuration>,
}

/// The image that others are compared with.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reference {
    /// The file, or how it was rendered.
    pub origin: String,
    /// relMSE that the reference itself is expected to have, from its variance layer or from independent groups of passes; `None` if nothing tells.
    pub rel_mse: Option<f64>,
    /// Time to render it in seconds; `None` if it was given.
    pub seconds: Option<f64>,
}

/// What was measured of a configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Configuration {
    /// A short name, unique in the study.
    pub name: String,
    /// The integrator with all parameters, as the command line takes it.
    pub integrator: String,
    /// The backend with its settings, as the command line takes it.
    pub backend: String,
    /// In how many columns the environment map is sampled; `None`: as the scene says.
    pub sampling_columns: Option<u32>,
    /// Why its image does not converge to the truth however long it takes; `None` if it does.
    pub bias: Option<String>,
    /// Its runs, one for each seed. Empty if it failed.
    pub runs: Vec<Run>,
    /// Relative squared bias at each budget: the mean over pixels of (mean image of all seeds - R)^2 / (R^2 + 0.01), less what the noise of the mean and of the
    /// reference add to it. May be a little below 0, where there is no bias to see. Empty with fewer than two seeds.
    pub squared_bias: Vec<f64>,
    /// Why it has no runs.
    pub failure: Option<String>,
}

/// One render of a configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Run {
    /// The seed.
    pub seed: u64,
    /// Time to build the backend, in seconds.
    pub build: f64,
    /// Time from the start of rendering to the end of the first pass, in seconds.
    pub first_image: f64,
    /// Bytes that the backend holds beside the scene.
    pub query_bytes: u64,
    /// What was seen at each budget, in their order.
    pub points: Vec<Point>,
}

/// The state of a run when a budget was used up, which is at the end of a pass.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Point {
    /// Time spent on rendering, in seconds: the budget or a little less than a pass more, and a whole pass in any case.
    pub seconds: f64,
    /// Passes.
    pub passes: u32,
    /// Rays traced.
    pub rays: u64,
    /// Mean squared error.
    pub mse: f64,
    /// Mean of (I - R)^2 / (R^2 + 0.01). The reference's own noise is part of it.
    pub rel_mse: f64,
    /// The same without the worst 0.1 % of the pixels.
    pub rel_mse_trimmed: f64,
    /// FLIP of colours clamped to [0, 1].
    pub flip: f64,
}
