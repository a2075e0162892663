//! Which integrator is to be used: the one that the command line names, or the scene, or `auto`.

use std::time::Instant;

use super::CliError;
use crate::integrators::{Integrator, IntegratorError, PathLength};
use crate::query::RayQuery;
use crate::scene::requirements::{PathClass, Requirements};
use crate::scene::{IntegratorSettings, Scene};
use crate::spec::Spec;
use crate::study::auto::{AUTO, choose};

/// An integrator that was asked for.
#[derive(Debug, Clone, Copy)]
pub(super) enum Wanted {
    /// On the command line.
    ByUser(Integrator),
    /// In the scene.
    ByScene(Integrator),
    /// Whichever suits the scene, for paths of this length.
    Auto(PathLength),
}

impl Wanted {
    /// From `--integrator` and the scene. A lenient answer to an integrator of the scene that there is not is `path`.
    pub(super) fn new(
        spec: Option<&Spec>,
        settings: &IntegratorSettings,
        is_lenient: bool,
    ) -> Result<Self, CliError> {
        let of_scene = settings.name.as_ref().map(|name| Integrator::new(name, &settings.parameters));
        match (spec, of_scene) {
            (Some(spec), of_scene) if spec.name == AUTO => {
                let length = of_scene.and_then(Result::ok).map(|integrator| integrator.length());
                Ok(Self::Auto(PathLength::from_parameters(
                    AUTO,
                    length.unwrap_or_default(),
                    &spec.parameters,
                )?))
            }
            (Some(spec), _) => Ok(Self::ByUser(Integrator::new(&spec.name, &spec.parameters)?)),
            (None, Some(Ok(integrator))) => Ok(Self::ByScene(integrator)),
            (None, Some(Err(error))) => Self::instead_of(settings, &error, is_lenient),
            (None, None) => Ok(Self::Auto(PathLength::default())),
        }
    }

    /// What stands in for an integrator of the scene that there is not, if lenience allows it.
    fn instead_of(
        settings: &IntegratorSettings,
        error: &IntegratorError,
        is_lenient: bool,
    ) -> Result<Self, CliError> {
        let at = settings.location.as_ref().map(|l| format!("{l}: ")).unwrap_or_default();
        if !is_lenient {
            return Err(format!("{at}{error}; --integrator names another, --lenient takes path").into());
        }
        eprintln!("warning: {at}{error}; path is used");
        Ok(Self::ByUser(Integrator::new("path", &[])?))
    }

    /// The integrator, and what to tell a person about it.
    pub(super) fn resolve<Q: RayQuery>(
        self,
        scene: &Scene,
        query: &Q,
    ) -> Result<(Integrator, Option<String>), CliError> {
        match self {
            Self::ByUser(integrator) => Ok((integrator, None)),
            Self::ByScene(integrator) => Ok((integrator, hint(scene, integrator))),
            Self::Auto(length) => {
                let start = Instant::now();
                let choice = choose(scene, query, length)?;
                let seconds = start.elapsed().as_secs_f64();
                Ok((choice.integrator, Some(format!("auto takes {} ({seconds:.1} s)", choice.why))))
            }
        }
    }
}

/// What a scene's own integrator cannot do in it.
fn hint(scene: &Scene, integrator: Integrator) -> Option<String> {
    let blind = integrator.blind_to(&Requirements::of(scene));
    (!blind.is_empty()).then(|| {
        format!(
            "hint: the scene's integrator cannot find all light of paths {}; --integrator auto looks for one that does",
            PathClass::list(&blind)
        )
    })
}
