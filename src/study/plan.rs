//! What a study is to render: configurations, each an integrator on a backend under a name, as people ask for them. Nothing is rendered here but the pilots of
//! [`auto`](super::auto).
//!
//! Integrators whose text does not say how long paths are have paths as long as the scene's own integrator, so that all configurations converge to one image; what
//! does not is told by [`Planned::bias`].

use thiserror::Error;

use super::auto::{AUTO, choose};
use super::sweep;
use crate::integrators::backward::Backward;
use crate::integrators::photon_map::{Mode, PhotonMapper};
use crate::integrators::{Ability, Integrator, IntegratorError, PathLength, TooManyStored};
use crate::query::{Backend, BackendError, RayQuery};
use crate::scene::requirements::{PathClass, Requirements};
use crate::scene::{Emitter, Scene};
use crate::spec::{Spec, spec};

/// A configuration to be rendered.
#[derive(Debug, Clone, PartialEq)]
pub struct Planned {
    /// Unique in the plan.
    pub name: String,
    /// The integrator.
    pub integrator: Integrator,
    /// The backend.
    pub backend: Backend,
    /// In how many columns the scene's environment map is sampled; `None`: as the scene says.
    pub sampling_columns: Option<u32>,
    /// Why its image does not converge to the scene's, however long it takes; `None` if it does.
    pub bias: Option<String>,
    /// Why `auto` chose the integrator; `None` if it was named.
    pub choice: Option<String>,
}

/// A configuration that makes no sense for the scene.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    /// Its name.
    pub name: String,
    /// Its integrator, as it would have been asked for.
    pub integrator: Spec,
    /// Why it is left out.
    pub why: String,
}

/// Configurations to be rendered.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plan {
    /// In the order in which they were asked for.
    pub configurations: Vec<Planned>,
    /// Those of [`Planner::defaults`] that do not apply.
    pub left_out: Vec<LeftOut>,
}

impl Plan {
    /// How many configurations there are that differ in more than their names.
    pub fn distinct(&self) -> usize {
        let is_new = |(i, one): &(usize, &Planned)| {
            let what = |p: &Planned| (p.integrator, p.backend, p.sampling_columns);
            !self.configurations[..*i].iter().any(|other| what(other) == what(one))
        };
        self.configurations.iter().enumerate().filter(is_new).count()
    }
}

/// Why there is no plan.
#[derive(Debug, Error, PartialEq)]
pub enum PlanError {
    /// A text that names an integrator or a backend, or a sweep of one, cannot be read.
    #[error("{0}")]
    Text(String),
    /// An integrator was refused.
    #[error("`{text}`: {error}")]
    Integrator {
        /// What was asked for.
        text: String,
        /// Why it was refused.
        error: IntegratorError,
    },
    /// A backend was refused.
    #[error("`{text}`: {error}")]
    Backend {
        /// What was asked for.
        text: String,
        /// Why it was refused.
        error: BackendError,
    },
    /// A sweep of nothing that there is.
    #[error("`{text}`: `{name}` is not known; integrators: {}, {AUTO}; backends: {}; environment: {ENVMAP}", Integrator::NAMES.join(", "), Backend::NAMES.join(", "))]
    UnknownName {
        /// What was asked for.
        text: String,
        /// The name in it.
        name: String,
    },
    /// How an environment map is to be sampled makes no sense.
    #[error("`{text}`: {why}")]
    Environment {
        /// What was asked for.
        text: String,
        /// Why it was refused.
        why: String,
    },
    /// Two configurations have one name.
    #[error("there are two configurations `{0}`")]
    Name(String),
    /// A pilot has too many photons.
    #[error("{AUTO}: {0}")]
    Auto(#[from] TooManyStored),
}

/// An integrator, as it is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Wanted {
    Named(Integrator),
    Auto(PathLength),
}

/// What sweeps of how environment maps are sampled are called, and their only parameter: as in scene files.
const ENVMAP: &str = "envmap";
const SAMPLING_COLUMNS: &str = "sampling_columns";

/// A configuration, before [`auto`](super::auto) has chosen.
#[derive(Debug, Clone)]
struct Entry {
    name: String,
    wanted: Wanted,
    backend: Backend,
    sampling_columns: Option<u32>,
}

/// What is asked for.
#[derive(Debug, Clone)]
pub struct Planner {
    /// Of the scene's own integrator.
    length: PathLength,
    /// Where none is named.
    backend: Backend,
    wanted: Vec<Entry>,
    left_out: Vec<LeftOut>,
}

/// The default configurations. A pass of `vpl` with its default of 1000 lights takes longer than a study has time.
const DEFAULTS: [(&str, &str); 9] = [
    ("path", "path"),
    ("bdpt", "bdpt"),
    ("ptracer", "ptracer"),
    ("photonmapper", "photonmapper"),
    ("photonmapper caustic", "photonmapper:mode=caustic"),
    ("sppm", "sppm"),
    ("sppm caustic", "sppm:mode=caustic"),
    ("vpl", "vpl:count=100"),
    (AUTO, AUTO),
];

impl Planner {
    /// For a scene whose own integrator has paths of this length. `backend` is that of configurations that name none.
    pub fn new(length: PathLength, backend: Backend) -> Self {
        Self { length, backend, wanted: Vec::new(), left_out: Vec::new() }
    }

    /// Whether nothing was asked for.
    pub fn is_empty(&self) -> bool {
        self.wanted.is_empty()
    }

    /// Asks for an integrator, under that text as its name.
    ///
    /// # Errors
    /// If it is not known, a parameter is wrong, or the name is taken.
    pub fn integrator(&mut self, text: &Spec) -> Result<(), PlanError> {
        self.add(text.to_string(), text, None, None)
    }

    /// Asks for a configuration.
    ///
    /// # Errors
    /// If integrator or backend are not known, a parameter is wrong, or the name is taken.
    pub fn add(
        &mut self,
        name: String,
        integrator: &Spec,
        backend: Option<&Spec>,
        sampling_columns: Option<u32>,
    ) -> Result<(), PlanError> {
        let wanted = self
            .read_integrator(integrator)
            .map_err(|error| PlanError::Integrator { text: integrator.to_string(), error })?;
        let backend = backend.map_or(Ok(self.backend), read_backend)?;
        self.push(Entry { name, wanted, backend, sampling_columns })
    }

    /// Asks for all that a sweep stands for: `NAME:key=A..BxN,...` or `NAME:key=A|B|...,...`. Backends and `envmap:sampling_columns` are swept with the integrator that
    /// [`auto`](super::auto) chooses.
    ///
    /// # Errors
    /// If the sweep cannot be read, or one of what it stands for is refused.
    pub fn sweep(&mut self, text: &str) -> Result<(), PlanError> {
        for one in sweep::expand(text).map_err(|why| PlanError::Text(format!("`{text}`: {why}")))? {
            let name = one.name.as_str();
            let (wanted, backend) = (Wanted::Auto(self.length), self.backend);
            let entry = Entry { name: one.to_string(), wanted, backend, sampling_columns: None };
            if Backend::NAMES.contains(&name) {
                self.push(Entry { backend: read_backend(&one)?, ..entry })?;
            } else if name == ENVMAP {
                self.push(Entry { sampling_columns: Some(read_columns(&one)?), ..entry })?;
            } else if name == AUTO || Integrator::NAMES.contains(&name) {
                self.integrator(&one)?;
            } else {
                return Err(PlanError::UnknownName { text: text.to_owned(), name: one.name });
            }
        }
        Ok(())
    }

    /// Asks for every integrator that has something to do in a scene with these requirements. What has not is kept with the reason.
    ///
    /// # Errors
    /// If a name is taken.
    pub fn defaults(&mut self, needs: &Requirements) -> Result<(), PlanError> {
        for (name, text) in DEFAULTS {
            let spec = spec(text).map_err(PlanError::Text)?;
            let reason = match self.read_integrator(&spec) {
                Ok(wanted) => match does_not_apply(wanted, self.length, needs) {
                    None => {
                        let (name, backend) = (name.to_owned(), self.backend);
                        self.push(Entry { name, wanted, backend, sampling_columns: None })?;
                        continue;
                    }
                    Some(reason) => reason.to_owned(),
                },
                // The scene's paths may be longer than photons can tell.
                Err(error) => error.to_string(),
            };
            self.left_out.push(LeftOut { name: name.to_owned(), integrator: spec, why: reason });
        }
        Ok(())
    }

    fn push(&mut self, entry: Entry) -> Result<(), PlanError> {
        if self.wanted.iter().any(|other| other.name == entry.name) {
            return Err(PlanError::Name(entry.name));
        }
        self.wanted.push(entry);
        Ok(())
    }

    fn read_integrator(&self, text: &Spec) -> Result<Wanted, IntegratorError> {
        if text.name == AUTO {
            return PathLength::from_parameters(AUTO, self.length, &text.parameters).map(Wanted::Auto);
        }
        let PathLength { max_depth, rr_depth } = self.length;
        let of_scene = [
            ("max_depth".to_owned(), max_depth.map_or(-1, i64::from).to_string()),
            ("rr_depth".to_owned(), rr_depth.to_string()),
        ];
        // Of a parameter that is given twice the last counts.
        let parameters: Vec<_> = of_scene.into_iter().chain(text.parameters.iter().cloned()).collect();
        Integrator::new(&text.name, &parameters).map(Wanted::Named)
    }

    /// Lets [`auto`](super::auto) choose where it was asked to. `query` holds the scene's shapes.
    ///
    /// # Errors
    /// If a pilot has too many photons, or an environment map is to be sampled and there is none.
    pub fn resolve<Q: RayQuery>(self, scene: &Scene, query: &Q) -> Result<Plan, PlanError> {
        let needs = Requirements::of(scene);
        let mut chosen: Vec<(PathLength, super::auto::Choice)> = Vec::new();
        let mut configurations = Vec::new();
        let has_map = scene.emitters.iter().any(|emitter| matches!(emitter, Emitter::Map(_)));
        for Entry { name, wanted, backend, sampling_columns } in self.wanted {
            if sampling_columns.is_some() && !has_map {
                let why = "the scene has no environment map".to_owned();
                return Err(PlanError::Environment { text: name, why });
            }
            let (integrator, choice) = match wanted {
                Wanted::Named(integrator) => (integrator, None),
                Wanted::Auto(length) => {
                    if !chosen.iter().any(|(l, _)| *l == length) {
                        chosen.push((length, choose(scene, query, length)?));
                    }
                    let choice = chosen.iter().find(|(l, _)| *l == length).map(|(_, choice)| choice);
                    let Some(choice) = choice else { unreachable!("it was chosen just now") };
                    (choice.integrator, Some(choice.why.clone()))
                }
            };
            let bias = bias(&integrator, self.length, &needs);
            configurations.push(Planned { name, integrator, backend, sampling_columns, bias, choice });
        }
        Ok(Plan { configurations, left_out: self.left_out })
    }
}

fn read_backend(text: &Spec) -> Result<Backend, PlanError> {
    Backend::new(&text.name, &text.parameters)
        .map_err(|error| PlanError::Backend { text: text.to_string(), error })
}

fn read_columns(text: &Spec) -> Result<u32, PlanError> {
    let error = |why: String| PlanError::Environment { text: text.to_string(), why };
    let [(key, value)] = text.parameters.as_slice() else {
        return Err(error(format!("expected `{SAMPLING_COLUMNS}` alone")));
    };
    let columns = value.parse().ok().filter(|columns| *columns >= 2);
    match columns {
        Some(columns) if key == SAMPLING_COLUMNS => Ok(columns),
        _ => Err(error(format!("expected `{SAMPLING_COLUMNS}`, a whole number from 2 on"))),
    }
}

/// Why an integrator has nothing to do in a scene that others have not, for paths of that length.
fn does_not_apply(wanted: Wanted, length: PathLength, needs: &Requirements) -> Option<&'static str> {
    let Wanted::Named(integrator) = wanted else { return None };
    let classes = needs.classes(length.limit());
    let finds = |class: &PathClass| integrator.ability(*class, needs) > Ability::Cannot;
    let is_indirect = |class: &PathClass| {
        use PathClass::{CausticElsewhere, CausticElsewhereMirrored, Indirect, IndirectMirrored};
        matches!(class, Indirect | IndirectMirrored | CausticElsewhere | CausticElsewhereMirrored)
    };
    match integrator {
        Integrator::Forward(_) if !classes.iter().any(finds) => {
            Some("light paths do not reach the camera: all that it sees is in mirrors or through glass")
        }
        Integrator::PhotonMap(_) if !needs.lobes.has_other() => {
            Some("there is no surface on which photons are stored")
        }
        Integrator::PhotonMap(PhotonMapper { mode: Mode::Caustic, .. })
            if !classes.iter().any(|class| class.is_caustic()) =>
        {
            Some("there are no caustics")
        }
        Integrator::VirtualLights(_) if !classes.iter().any(is_indirect) => {
            Some("there is no indirect light")
        }
        _ => None,
    }
}

/// Why an image does not converge to that of paths of a length.
fn bias(integrator: &Integrator, length: PathLength, needs: &Requirements) -> Option<String> {
    let mut reasons: Vec<String> = integrator.bias().into_iter().map(str::to_owned).collect();
    let depth = |l: PathLength| l.max_depth.map_or_else(|| "any number of".to_owned(), |d| d.to_string());
    if integrator.length().max_depth != length.max_depth {
        let (own, others) = (depth(integrator.length()), depth(length));
        reasons.push(format!("paths have up to {own} segments, those of the scene {others}"));
    }
    if matches!(integrator, Integrator::Backward(Backward { hide_emitters: true, .. })) {
        reasons.push("lights are hidden".to_owned());
    }
    let blind = integrator.blind_to(needs);
    if !blind.is_empty() {
        reasons.push(format!("cannot find all light of paths {}", PathClass::list(&blind)));
    }
    (!reasons.is_empty()).then(|| reasons.join("; "))
}
