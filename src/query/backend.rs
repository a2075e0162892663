//! The choice of a backend at run time, with its settings as text.

use thiserror::Error;

use super::crosscheck::Crosscheck;
#[cfg(feature = "embree")]
use super::embree::{EmbreeError, EmbreeQuery, EmbreeSettings};
use super::obvhs::ObvhsQuery;
use super::recorder::Recorder;
use super::{BuildQuality, Hit, Ray, RayQuery};
use crate::scene::{Aabb, Shape};

/// A backend with its settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Backend {
    /// Intel Embree.
    #[cfg(feature = "embree")]
    Embree(EmbreeSettings),
    /// The pure-Rust backend.
    Obvhs(BuildQuality),
    /// The default backend, compared query by query with another: see [`Crosscheck`].
    Crosscheck,
}

/// Why a choice was refused.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum BackendError {
    /// There is none of that name in this build.
    #[error("backend `{name}` is not in this build; there are: {}", Backend::NAMES.join(", "))]
    UnknownName {
        /// The name asked for.
        name: String,
    },
    /// A setting or its value is not known.
    #[error("backend `{backend}` does not take `{key}={value}`; it takes: {known}")]
    BadSetting {
        /// The backend.
        backend: &'static str,
        /// The setting asked for.
        key: String,
        /// Its value.
        value: String,
        /// What there is.
        known: &'static str,
    },
    /// Embree refused to build.
    #[cfg(feature = "embree")]
    #[error(transparent)]
    Embree(#[from] EmbreeError),
}

impl Default for Backend {
    fn default() -> Self {
        #[cfg(feature = "embree")]
        return Self::Embree(EmbreeSettings::default());
        #[cfg(not(feature = "embree"))]
        return Self::Obvhs(BuildQuality::default());
    }
}

impl Backend {
    /// Names that [`Backend::new`] takes.
    pub const NAMES: &'static [&'static str] = &[
        #[cfg(feature = "embree")]
        "embree",
        "obvhs",
        "crosscheck",
    ];

    /// What [`Crosscheck`](Self::Crosscheck) compares the default with: the other backend, or, where there is none, another tree.
    const SECOND: Self = if cfg!(feature = "embree") {
        Self::Obvhs(BuildQuality::Medium)
    } else {
        Self::Obvhs(BuildQuality::Low)
    };

    /// The backend called `name` with settings given as text; those not given have their defaults.
    ///
    /// # Errors
    /// If the name, a setting or a value is not known.
    pub fn new(name: &str, settings: &[(String, String)]) -> Result<Self, BackendError> {
        match name {
            #[cfg(feature = "embree")]
            "embree" => embree_settings(settings).map(Self::Embree),
            "obvhs" => obvhs_quality(settings).map(Self::Obvhs),
            "crosscheck" => match settings.first() {
                None => Ok(Self::Crosscheck),
                Some((key, value)) => Err(bad_setting("crosscheck", key, value, "no settings")),
            },
            _ => Err(BackendError::UnknownName { name: name.to_owned() }),
        }
    }

    /// Name and settings, in the form that the command line takes.
    pub fn describe(&self) -> String {
        match self {
            #[cfg(feature = "embree")]
            Self::Embree(EmbreeSettings { robust, quality, compact }) => {
                format!("embree:robust={robust},quality={},compact={compact}", quality_name(*quality))
            }
            Self::Obvhs(quality) => format!("obvhs:quality={}", quality_name(*quality)),
            Self::Crosscheck => "crosscheck".to_owned(),
        }
    }

    /// Builds the backend over shapes.
    ///
    /// # Errors
    /// If Embree refuses.
    pub fn build(self, shapes: &[Shape]) -> Result<AnyQuery<'_>, BackendError> {
        Ok(match self {
            #[cfg(feature = "embree")]
            Self::Embree(settings) => AnyQuery::Embree(EmbreeQuery::new(shapes, settings)?),
            Self::Obvhs(quality) => AnyQuery::Obvhs(ObvhsQuery::new(shapes, quality)),
            Self::Crosscheck => {
                let (first, second) = (Self::default().build(shapes)?, Self::SECOND.build(shapes)?);
                AnyQuery::Crosscheck(Box::new(Crosscheck::new(shapes, first, second)))
            }
        })
    }
}

/// A backend whose kind is not known when compiling, for what is not about speed: each query costs a branch. It also saves compiling integrators
/// for each pair of backends.
pub enum AnyQuery<'s> {
    /// Intel Embree.
    #[cfg(feature = "embree")]
    Embree(EmbreeQuery<'s>),
    /// The pure-Rust backend.
    Obvhs(ObvhsQuery<'s>),
    /// Two of them, compared.
    Crosscheck(Box<Crosscheck<'s, Self, Self>>),
    /// One of them, whose rays are written down.
    Recorder(Box<Recorder<Self>>),
}

/// Evaluates an expression with the backend inside of an [`AnyQuery`], compiled for each of them; where two are at work, or rays are written
/// down, with the [`AnyQuery`] itself.
macro_rules! with_query {
    ($any:expr, $query:ident => $result:expr) => {
        match $any {
            #[cfg(feature = "embree")]
            $crate::query::AnyQuery::Embree($query) => $result,
            $crate::query::AnyQuery::Obvhs($query) => $result,
            $query @ ($crate::query::AnyQuery::Crosscheck(_) | $crate::query::AnyQuery::Recorder(_)) => {
                $result
            }
        }
    };
}
pub(crate) use with_query;

/// Asks whatever is inside.
macro_rules! ask {
    ($any:expr, $query:ident => $result:expr) => {
        match $any {
            #[cfg(feature = "embree")]
            AnyQuery::Embree($query) => $result,
            AnyQuery::Obvhs($query) => $result,
            AnyQuery::Crosscheck($query) => $result,
            AnyQuery::Recorder($query) => $result,
        }
    };
}

impl RayQuery for AnyQuery<'_> {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        ask!(self, query => query.intersect(ray))
    }

    fn occluded(&self, ray: &Ray) -> bool {
        ask!(self, query => query.occluded(ray))
    }

    fn bounds(&self) -> Aabb {
        ask!(self, query => query.bounds())
    }

    fn memory(&self) -> usize {
        ask!(self, query => query.memory())
    }

    fn name(&self) -> String {
        ask!(self, query => query.name())
    }
}

#[cfg(feature = "embree")]
fn embree_settings(text: &[(String, String)]) -> Result<EmbreeSettings, BackendError> {
    let mut settings = EmbreeSettings::default();
    for (key, value) in text {
        match (key.as_str(), value.as_str(), quality(value)) {
            ("robust", "true" | "false", _) => settings.robust = value == "true",
            ("compact", "true" | "false", _) => settings.compact = value == "true",
            ("quality", _, Some(quality)) => settings.quality = quality,
            _ => {
                let known = "robust=true|false, quality=low|medium|high, compact=true|false";
                return Err(bad_setting("embree", key, value, known));
            }
        }
    }
    Ok(settings)
}

fn obvhs_quality(text: &[(String, String)]) -> Result<BuildQuality, BackendError> {
    let mut found = BuildQuality::default();
    for (key, value) in text {
        found = match (key.as_str(), quality(value)) {
            ("quality", Some(quality)) => quality,
            _ => return Err(bad_setting("obvhs", key, value, "quality=low|medium|high")),
        }
    }
    Ok(found)
}

const QUALITIES: [(&str, BuildQuality); 3] =
    [("low", BuildQuality::Low), ("medium", BuildQuality::Medium), ("high", BuildQuality::High)];

fn quality(name: &str) -> Option<BuildQuality> {
    QUALITIES.into_iter().find(|(n, _)| *n == name).map(|(_, quality)| quality)
}

fn quality_name(quality: BuildQuality) -> &'static str {
    QUALITIES.into_iter().find(|(_, q)| *q == quality).map_or("", |(name, _)| name)
}

fn bad_setting(backend: &'static str, key: &str, value: &str, known: &'static str) -> BackendError {
    BackendError::BadSetting { backend, key: key.to_owned(), value: value.to_owned(), known }
}
