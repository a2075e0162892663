//! Parameters that integrators share, read from text. Names, meaning and defaults are Mitsuba's.

use std::str::FromStr;

use super::IntegratorError;

/// Limits on the length of paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PathLength {
    /// Greatest number of segments of a path: 1 shows lights only, 2 direct light. `None`: no limit (`-1`).
    pub max_depth: Option<u32>,
    /// Number of segments after which Russian roulette begins; at least 1. For each subpath by itself.
    pub rr_depth: u32,
}

impl Default for PathLength {
    fn default() -> Self {
        Self { max_depth: None, rr_depth: 5 }
    }
}

impl PathLength {
    /// Greatest number of segments.
    #[inline]
    pub fn limit(&self) -> u32 {
        self.max_depth.unwrap_or(u32::MAX)
    }

    /// Takes parameters that must all be of these; `default` has those that are not given.
    ///
    /// # Errors
    /// If a parameter is not known, for an integrator called `name`, or its value is out of range.
    pub fn from_parameters(
        name: &'static str,
        default: Self,
        parameters: &[(String, String)],
    ) -> Result<Self, IntegratorError> {
        let mut this = default;
        for (parameter, value) in parameters {
            if !this.read(parameter, value)? {
                return Err(unknown(name, parameter, "max_depth, rr_depth"));
            }
        }
        Ok(this)
    }

    /// Takes a parameter if it is one of these. Whether it is.
    pub(super) fn read(&mut self, name: &str, value: &str) -> Result<bool, IntegratorError> {
        match name {
            "max_depth" => {
                let error = || bad("max_depth", value, "an integer of at least 0, or -1 for no limit");
                let depth: i64 = value.parse().map_err(|_| error())?;
                self.max_depth = match depth {
                    -1 => None,
                    _ => Some(u32::try_from(depth).map_err(|_| error())?),
                };
            }
            "rr_depth" => {
                self.rr_depth = number("rr_depth", value, |&depth| depth > 0, "an integer of at least 1")?;
            }
            _ => return Ok(false),
        }
        Ok(true)
    }

    pub(super) fn describe(&self) -> String {
        format!("max_depth={},rr_depth={}", self.max_depth.map_or(-1, i64::from), self.rr_depth)
    }
}

/// A parameter has a value that it cannot have.
pub(super) fn bad(parameter: &'static str, value: &str, expected: impl Into<String>) -> IntegratorError {
    IntegratorError::BadValue { parameter, value: value.to_owned(), expected: expected.into() }
}

/// The choice that one of some words stands for.
pub(super) fn choice<T: Copy>(
    parameter: &'static str,
    value: &str,
    choices: &[(&str, T)],
) -> Result<T, IntegratorError> {
    let found = choices.iter().find(|(word, _)| *word == value);
    found.map(|(_, choice)| *choice).ok_or_else(|| {
        let words: Vec<_> = choices.iter().map(|(word, _)| format!("`{word}`")).collect();
        let (last, others) = words.split_last().map_or(("", &[][..]), |(last, others)| (last, others));
        bad(parameter, value, format!("{} or {last}", others.join(", ")))
    })
}

/// The word that stands for a choice.
pub(super) fn word<T: PartialEq>(choices: &[(&'static str, T)], choice: &T) -> &'static str {
    choices.iter().find(|(_, c)| c == choice).map_or("", |(word, _)| word)
}

/// A number that is accepted.
pub(super) fn number<T: FromStr>(
    parameter: &'static str,
    value: &str,
    accepts: impl Fn(&T) -> bool,
    expected: &str,
) -> Result<T, IntegratorError> {
    value.parse().ok().filter(accepts).ok_or_else(|| bad(parameter, value, expected))
}

/// There is no such parameter.
pub(super) fn unknown(integrator: &'static str, parameter: &str, known: &str) -> IntegratorError {
    IntegratorError::UnknownParameter { integrator, parameter: parameter.to_owned(), known: known.to_owned() }
}
