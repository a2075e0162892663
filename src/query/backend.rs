//! The choice of a backend at run time, with its settings as text.

use thiserror::Error;

use super::BuildQuality;
#[cfg(feature = "embree")]
use super::embree::EmbreeSettings;

/// A backend with its settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Backend {
    /// Intel Embree.
    #[cfg(feature = "embree")]
    Embree(EmbreeSettings),
    /// The pure-Rust backend.
    Obvhs(BuildQuality),
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
    ];

    /// The backend called `name` with settings given as text; those not given have their defaults.
    ///
    /// # Errors
    /// If the name, a setting or a value is not known.
    pub fn new(name: &str, settings: &[(String, String)]) -> Result<Self, BackendError> {
        match name {
            #[cfg(feature = "embree")]
            "embree" => embree_settings(settings).map(Self::Embree),
            "obvhs" => obvhs_quality(settings).map(Self::Obvhs),
            _ => Err(BackendError::UnknownName { name: name.to_owned() }),
        }
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

fn quality(name: &str) -> Option<BuildQuality> {
    match name {
        "low" => Some(BuildQuality::Low),
        "medium" => Some(BuildQuality::Medium),
        "high" => Some(BuildQuality::High),
        _ => None,
    }
}

fn bad_setting(backend: &'static str, key: &str, value: &str, known: &'static str) -> BackendError {
    BackendError::BadSetting { backend, key: key.to_owned(), value: value.to_owned(), known }
}
