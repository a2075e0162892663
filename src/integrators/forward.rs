//! The forward path tracer (`ptracer`): paths start at the lights and find the camera in two ways, by connecting to a point on the lens
//! (next-event estimation) and, where the lens has an area, by hitting it; joined by multiple importance sampling.
//!
//! It renders caustics from any light, point lights included. What the camera sees in a mirror or through glass only a hit lens
//! shows, so with a pinhole all of it is black. And light that never comes near what the camera sees is wasted,
//! which makes it a bad choice for open worlds.

use super::light_path;
use super::parameters::{PathLength, choice, unknown, word};
use super::pass::{Pass, Scratch};
use super::weights::Weights;
use super::{IntegratorError, PathObserver};
use crate::query::RayQuery;
use crate::transport::mis::Heuristic;

/// How light paths reach the film.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Connect {
    /// Each vertex is connected to a point on the lens.
    Nee,
    /// By hitting the lens by chance. Black for a pinhole.
    Hit,
    /// Both, weighted.
    #[default]
    Both,
}

impl Connect {
    const ALL: [(&'static str, Self); 3] = [("nee", Self::Nee), ("hit", Self::Hit), ("both", Self::Both)];
}

/// Parameters. Those of [`PathLength`] are Mitsuba's; `connect=nee` is what Mitsuba's `ptracer` does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Forward {
    /// How long paths get.
    pub length: PathLength,
    /// How they reach the film.
    pub connect: Connect,
}

impl Forward {
    /// Reads parameters from text.
    ///
    /// # Errors
    /// If a parameter is not known or its value is out of range.
    pub fn from_parameters(parameters: &[(String, String)]) -> Result<Self, IntegratorError> {
        let mut this = Self::default();
        for (name, value) in parameters {
            match name.as_str() {
                "connect" => this.connect = choice("connect", value, &Connect::ALL)?,
                _ if this.length.read(name, value)? => {}
                _ => return Err(unknown("ptracer", name, "max_depth, rr_depth, connect")),
            }
        }
        Ok(this)
    }

    /// Name and parameters, in the form that the command line takes.
    pub fn describe(&self) -> String {
        let connect = word(&Connect::ALL, &self.connect);
        format!("ptracer:{},connect={connect}", self.length.describe())
    }

    /// Traces the light path of a slot; its splats go to `scratch`.
    pub fn trace_light_path<'w, Q: RayQuery, O: PathObserver>(
        &self,
        pass: &Pass<'w, '_, Q>,
        slot: u64,
        scratch: &mut Scratch<'w>,
        observer: &mut O,
    ) {
        let weights = Weights {
            world: pass.world,
            heuristic: Heuristic::Power,
            light_paths: pass.light_paths() as f64,
            has_eye_paths: false,
            connects_lens: self.connect != Connect::Hit,
            hits_lens: self.connect != Connect::Nee && !pass.world.camera.is_delta(),
        };
        light_path::trace(pass, self.length, &weights, slot, scratch, observer);
    }
}
