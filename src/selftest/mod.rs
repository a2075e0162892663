//! Checks at the extremes of number ranges: what `helmholtz selftest` runs on a machine, and `tests/extremes` group by group.
//!
//! A check measures one thing, on one backend and perhaps by one integrator, and holds it against a limit; why the limit is right is in
//! the check's own documentation. A [`Finding`] without a limit is reported and cannot fail: it says where something begins that the README's table of
//! limits states. What is compared are closed forms, exact arithmetic and the same scene elsewhere, never numbers that were written down from
//! an earlier run.
//!
//! Nothing here is made for speed and nothing prints. What differs between *two backends* on the same rays is not asked here.

mod densities;
mod images;
mod leaks;
mod lights;
mod malformed;
mod materials;
mod places;
pub mod solids;
mod sums;
mod watertight;

#[cfg(feature = "embree")]
use crate::query::embree::EmbreeSettings;
use crate::query::{Backend, BuildQuality, RayQuery, with_query};
use crate::render::RenderError;
use crate::scene::Shape;

pub use images::moved;
pub use leaks::{missed_contacts, own_hits, sandwich_leaks};
pub use watertight::{Escapes, escapes};

/// How long to look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effort {
    /// A minute on two cores, for all checks.
    Quick,
    /// A hundred times as many rays; images with a quarter of the noise.
    Full,
}

/// What a check is about: a line of the list of extremes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// Closed meshes let no ray out.
    Watertightness,
    /// Rays leave the surface they start on, and do not pass others.
    SelfIntersection,
    /// The whole scene by a factor.
    Scale,
    /// The scene far from the origin.
    Place,
    /// Rotated, mirrored, squeezed.
    Orientation,
    /// Roughness, index and reflectance.
    Materials,
    /// Radiance, area, and number of lights.
    Lights,
    /// Weights of strategies.
    Densities,
    /// Sums over passes and of very different pixels.
    Sums,
    /// Geometry that makes no sense.
    Malformed,
}

impl Group {
    /// All of them, in the order of the table.
    pub const ALL: [Self; 10] = [
        Self::Watertightness,
        Self::SelfIntersection,
        Self::Scale,
        Self::Place,
        Self::Orientation,
        Self::Materials,
        Self::Lights,
        Self::Densities,
        Self::Sums,
        Self::Malformed,
    ];

    /// As the table names it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Watertightness => "watertightness",
            Self::SelfIntersection => "self-intersection",
            Self::Scale => "scale",
            Self::Place => "place",
            Self::Orientation => "orientation",
            Self::Materials => "materials",
            Self::Lights => "lights",
            Self::Densities => "densities",
            Self::Sums => "sums",
            Self::Malformed => "malformed",
        }
    }
}

/// What a check measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Finding {
    /// What it is about.
    pub group: Group,
    /// What was measured, in words that end in its unit.
    pub check: String,
    /// Backend with the settings that matter; empty where no ray is traced.
    pub backend: &'static str,
    /// Integrator; empty where no light is transported.
    pub integrator: &'static str,
    /// The number.
    pub measured: f64,
    /// What it may be at most; `None` where it is only reported.
    pub limit: Option<f64>,
}

impl Finding {
    /// Whether the number is within its limit. NaN is not.
    pub fn is_passed(&self) -> bool {
        self.limit.is_none_or(|limit| self.measured <= limit)
    }
}

/// Why a check could not be made.
#[derive(Debug, thiserror::Error)]
pub enum SelftestError {
    /// A backend refused a scene that it should take.
    #[error("{backend}: {message}")]
    Backend {
        /// The backend.
        backend: &'static str,
        /// What it said.
        message: String,
    },
    /// A render failed.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// An image could not be written.
    #[error(transparent)]
    Output(#[from] crate::film::output::OutputError),
    /// A film cannot be made.
    #[error(transparent)]
    Film(#[from] crate::film::FilmError),
    /// A mesh of a check is out of range.
    #[error(transparent)]
    Mesh(#[from] crate::scene::MeshError),
    /// A shape of a check cannot be placed where it should be.
    #[error("a shape of a check cannot be placed")]
    Shape,
    /// An integrator of a check is not known.
    #[error(transparent)]
    Integrator(#[from] crate::integrators::IntegratorError),
    /// There is no place for temporary files.
    #[error(transparent)]
    File(#[from] std::io::Error),
}

/// A backend under test, and how hard to look.
#[derive(Debug, Clone, Copy)]
pub struct Bench {
    /// As the table names it.
    pub name: &'static str,
    /// The backend.
    pub backend: Backend,
    /// How hard to look.
    pub effort: Effort,
}

impl Bench {
    /// Every backend of this build with its default settings.
    pub fn all(effort: Effort) -> Vec<Self> {
        [
            #[cfg(feature = "embree")]
            Self { name: "embree", backend: Backend::Embree(EmbreeSettings::default()), effort },
            Self { name: "obvhs", backend: Backend::Obvhs(BuildQuality::default()), effort },
        ]
        .to_vec()
    }

    /// A number of rays: of the quick form, and a hundred times that.
    fn rays(&self, quick: u64) -> u64 {
        match self.effort {
            Effort::Quick => quick,
            Effort::Full => 100 * quick,
        }
    }

    /// A finding on this backend without an integrator.
    fn finding(
        &self,
        group: Group,
        check: impl Into<String>,
        measured: f64,
        limit: impl Into<Option<f64>>,
    ) -> Finding {
        let limit = limit.into();
        Finding { group, check: check.into(), backend: self.name, integrator: "", measured, limit }
    }

    /// Builds the backend over shapes and runs a task on it.
    fn on<T: Task>(&self, shapes: &[Shape], task: &T) -> Result<T::Output, SelftestError> {
        let refused = |error| SelftestError::Backend { backend: self.name, message: format!("{error}") };
        let query = self.backend.build(shapes).map_err(refused)?;
        Ok(with_query!(&query, query => task.run(query)))
    }
}

/// What is done with any backend: a closure cannot be generic.
trait Task {
    type Output;
    fn run<Q: RayQuery>(&self, query: &Q) -> Self::Output;
}

/// Runs the checks of a group on a backend. Those that trace no rays are made on the first one only.
///
/// # Errors
/// If the checks cannot be made; what they find is no error.
pub fn run(group: Group, bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let is_first = Bench::all(bench.effort).first().is_some_and(|first| first.name == bench.name);
    match group {
        Group::Watertightness => watertight::check(bench),
        Group::SelfIntersection => leaks::check(bench),
        Group::Scale => places::check_scale(bench),
        Group::Place => places::check_place(bench),
        Group::Orientation => places::check_orientation(bench),
        Group::Materials => materials::check(bench),
        Group::Lights => lights::check(bench),
        Group::Densities => densities::check(bench),
        Group::Sums if is_first => sums::check(),
        Group::Malformed => malformed::check(bench),
        Group::Sums => Ok(Vec::new()),
    }
}
