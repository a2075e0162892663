//! The choice of a backend at run time, with its settings as text.

use thiserror::Error;

#[cfg(feature = "embree")]
use super::embree::{self, EmbreeSettings};
use super::obvhs;

/// A backend with its settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Backend {
    /// Intel Embree.
    #[cfg(feature = "embree")]
    Embree(EmbreeSettings),
    /// The pure-Rust backend.
    Obvhs(obvhs::BuildQuality),
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
        return Self::Obvhs(obvhs::BuildQuality::default());
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
    use embree::BuildQuality::{High, Low, Medium};
    let mut settings = EmbreeSettings::default();
    for (key, value) in text {
        match (key.as_str(), value.as_str()) {
            ("robust", "true" | "false") => settings.robust = value == "true",
            ("compact", "true" | "false") => settings.compact = value == "true",
            ("quality", "low") => settings.quality = Low,
            ("quality", "medium") => settings.quality = Medium,
            ("quality", "high") => settings.quality = High,
            _ => {
                let known = "robust=true|false, quality=low|medium|high, compact=true|false";
                return Err(bad_setting("embree", key, value, known));
            }
        }
    }
    Ok(settings)
}

fn obvhs_quality(text: &[(String, String)]) -> Result<obvhs::BuildQuality, BackendError> {
    use obvhs::BuildQuality::{High, Low, Medium};
    let mut quality = obvhs::BuildQuality::default();
    for (key, value) in text {
        quality = match (key.as_str(), value.as_str()) {
            ("quality", "low") => Low,
            ("quality", "medium") => Medium,
            ("quality", "high") => High,
            _ => return Err(bad_setting("obvhs", key, value, "quality=low|medium|high")),
        }
    }
    Ok(quality)
}

fn bad_setting(backend: &'static str, key: &str, value: &str, known: &'static str) -> BackendError {
    BackendError::BadSetting { backend, key: key.to_owned(), value: value.to_owned(), known }
}
