//! Things in a line of text, as people, configuration files and callers through the C interface write them: integrators and backends with their parameters
//! (`path:max_depth=4,rr_depth=8`), sizes (`640x480`) and times (`30s`).

use std::fmt;
use std::str::FromStr;
use std::time::Duration;

use glam::UVec2;

/// A thing with parameters, as in `path:max_depth=4,rr_depth=8`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Spec {
    /// What it is called.
    pub name: String,
    /// Keys and values, in the order in which they were given.
    pub parameters: Vec<(String, String)>,
}

impl fmt::Display for Spec {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.name)?;
        for (i, (key, value)) in self.parameters.iter().enumerate() {
            write!(f, "{}{key}={value}", if i == 0 { ':' } else { ',' })?;
        }
        Ok(())
    }
}

/// Reads `name` or `name:key=value,...`.
///
/// # Errors
/// If there is no name, or a parameter without `=`.
pub fn spec(text: &str) -> Result<Spec, String> {
    let (name, rest) = text.split_once(':').unwrap_or((text, ""));
    if name.is_empty() {
        return Err("expected a name, perhaps followed by `:key=value,...`".to_owned());
    }
    let parameters = rest.split(',').filter(|p| !p.is_empty()).map(key_value).collect::<Result<_, _>>()?;
    Ok(Spec { name: name.to_owned(), parameters })
}

/// Reads `name=value`; the value may be empty.
///
/// # Errors
/// If there is no name or no `=`.
pub fn key_value(text: &str) -> Result<(String, String), String> {
    match text.split_once('=') {
        Some((key, value)) if !key.is_empty() => Ok((key.to_owned(), value.to_owned())),
        _ => Err(format!("expected `name=value`, found `{text}`")),
    }
}

/// Reads a number; `what` says what is expected.
pub(crate) fn number<T: FromStr>(text: &str, what: &str) -> Result<T, String> {
    text.trim().parse().map_err(|_| format!("expected {what}, found `{text}`"))
}

/// Reads `WIDTHxHEIGHT`, both from 1 to 65536.
///
/// # Errors
/// If it is anything else.
pub fn size(text: &str) -> Result<UVec2, String> {
    let (w, h) = text.split_once('x').ok_or_else(|| format!("expected WIDTHxHEIGHT, found `{text}`"))?;
    let size = UVec2::new(number(w, "a width in pixels")?, number(h, "a height in pixels")?);
    if size.min_element() == 0 || size.max_element() > 1 << 16 {
        return Err(format!("width and height must be from 1 to 65536, found `{text}`"));
    }
    Ok(size)
}

/// Reads a number with a unit: `ms`, `s`, `m` or `h`.
///
/// # Errors
/// If it is anything else, or less than 0.
pub fn duration(text: &str) -> Result<Duration, String> {
    let digits = text.find(|c: char| c.is_ascii_alphabetic()).unwrap_or(text.len());
    let (value, unit) = text.split_at(digits);
    let seconds: f64 = number(value, "a number with a unit, such as 30s, 5m or 2h")?;
    let scale = match unit {
        "ms" => 1e-3,
        "s" => 1.0,
        "m" => 60.0,
        "h" => 3600.0,
        _ => return Err(format!("expected one of the units ms, s, m, h, found `{text}`")),
    };
    Duration::try_from_secs_f64(seconds * scale)
        .map_err(|_| format!("`{text}` is not a time that can be waited for"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes() {
        assert_eq!(size("640x480"), Ok(UVec2::new(640, 480)));
        assert!(size("640").is_err() && size("0x4").is_err() && size("70000x4").is_err());
    }

    #[test]
    fn durations() {
        assert_eq!(duration("30s"), Ok(Duration::from_secs(30)));
        assert_eq!(duration("1.5m"), Ok(Duration::from_secs(90)));
        assert_eq!(duration("250ms"), Ok(Duration::from_millis(250)));
        assert!(duration("30").is_err() && duration("-1s").is_err() && duration("NaNs").is_err());
    }

    #[test]
    fn specs() {
        let path = spec("path:max_depth=4,rr_depth=8").unwrap();
        assert_eq!(path.name, "path");
        assert_eq!(path.parameters, [("max_depth".into(), "4".into()), ("rr_depth".into(), "8".into())]);
        assert!(spec("path").unwrap().parameters.is_empty());
        for text in ["path", "path:max_depth=4,rr_depth=8"] {
            assert_eq!(spec(text).unwrap().to_string(), text);
        }
        assert!(spec(":a=1").is_err());
        assert!(spec("path:a").is_err());
    }
}
