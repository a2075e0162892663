//! Light transport algorithms, one file each.
//!
//! An integrator is a set of parameters with a function that makes samples or splats; it owns no threads, no film and no
//! random numbers. [`render`](crate::render) calls it with the [`Pass`] that it works on.

mod ability;
pub mod backward;
pub mod bidirectional;
mod collect;
pub mod forward;
mod light_path;
mod observer;
mod parameters;
mod pass;
pub mod photon_map;
pub mod vpl;
pub mod weights;

pub use ability::Ability;
pub(crate) use backward::Caustics;
pub use collect::TooManyStored;
pub use observer::{PathObserver, Strategy, Unobserved};
pub use parameters::PathLength;
pub use pass::{Pass, Scratch};

use thiserror::Error;

use crate::transport::World;
use backward::Backward;
use bidirectional::Bidirectional;
use forward::{Connect, Forward};
use photon_map::{PhotonMapper, Show};
use vpl::VirtualLights;

/// An integrator with its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Integrator {
    /// Paths from the camera.
    Backward(Backward),
    /// Paths from the lights.
    Forward(Forward),
    /// Both, and their connections.
    Bidirectional(Bidirectional),
    /// Photons, looked up by paths from the camera.
    PhotonMap(PhotonMapper),
    /// Virtual point lights, gathered by paths from the camera.
    VirtualLights(VirtualLights),
}

/// Why an integrator was refused.
#[derive(Debug, Error, PartialEq)]
pub enum IntegratorError {
    /// There is none of that name.
    #[error("integrator `{name}` is not known; there are: {}", Integrator::NAMES.join(", "))]
    UnknownName {
        /// The name asked for.
        name: String,
    },
    /// It has no such parameter.
    #[error("integrator `{integrator}` has no parameter `{parameter}`; it has: {known}")]
    UnknownParameter {
        /// The integrator.
        integrator: &'static str,
        /// The parameter asked for.
        parameter: String,
        /// Its parameters.
        known: String,
    },
    /// A parameter has a value that it cannot have.
    #[error("parameter `{parameter}` is `{value}`, but should be {expected}")]
    BadValue {
        /// The parameter.
        parameter: &'static str,
        /// Its value.
        value: String,
        /// What the value should be.
        expected: String,
    },
}

impl Integrator {
    /// Names that [`Integrator::new`] takes.
    pub const NAMES: &'static [&'static str] =
        &["path", "backward", "ptracer", "forward", "bdpt", "bidirectional", "photonmapper", "sppm", "vpl"];

    /// The integrator called `name` with parameters given as text; those not given have their defaults.
    ///
    /// # Errors
    /// If the name, a parameter or a value is not known.
    pub fn new(name: &str, parameters: &[(String, String)]) -> Result<Self, IntegratorError> {
        match name {
            "path" | "backward" => Ok(Self::Backward(Backward::from_parameters(parameters)?)),
            "ptracer" | "forward" => Ok(Self::Forward(Forward::from_parameters(parameters)?)),
            "bdpt" | "bidirectional" => Ok(Self::Bidirectional(Bidirectional::from_parameters(parameters)?)),
            "photonmapper" | "sppm" => {
                Ok(Self::PhotonMap(PhotonMapper::from_parameters(name == "sppm", parameters)?))
            }
            "vpl" => Ok(Self::VirtualLights(VirtualLights::from_parameters(parameters)?)),
            _ => Err(IntegratorError::UnknownName { name: name.to_owned() }),
        }
    }

    /// Name and parameters, in the form that the command line takes.
    pub fn describe(&self) -> String {
        match self {
            Self::Backward(backward) => backward.describe(),
            Self::Forward(forward) => forward.describe(),
            Self::Bidirectional(bidirectional) => bidirectional.describe(),
            Self::PhotonMap(mapper) => mapper.describe(),
            Self::VirtualLights(vpl) => vpl.describe(),
        }
    }

    /// What a person should know before rendering this world: why the image will be black.
    pub fn warning(&self, world: &World) -> Option<&'static str> {
        match self {
            Self::Forward(Forward { connect: Connect::Hit, .. }) if world.camera.is_delta() => Some(
                "nothing hits a pinhole: with connect=hit the image is black; use a thinlens sensor or connect=nee",
            ),
            _ => None,
        }
    }

    /// Whether light paths and their splats make the whole image, without samples of pixels.
    pub fn only_splats(&self) -> bool {
        matches!(self, Self::Forward(_) | Self::PhotonMap(PhotonMapper { show: Show::Photons, .. }))
    }

    /// How long its paths get.
    pub fn length(&self) -> PathLength {
        match self {
            Self::Backward(backward) => backward.length,
            Self::Forward(forward) => forward.length,
            Self::Bidirectional(bidirectional) => bidirectional.length,
            Self::PhotonMap(mapper) => mapper.length,
            Self::VirtualLights(vpl) => vpl.length,
        }
    }
}
