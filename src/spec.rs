//! Things with parameters in a line of text, such as `path:max_depth=4,rr_depth=8`: integrators and backends, as people, configuration files
//! and callers through the C interface name them.

/// A thing with parameters, as in `path:max_depth=4,rr_depth=8`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Spec {
    /// What it is called.
    pub name: String,
    /// Keys and values, in the order in which they were given.
    pub parameters: Vec<(String, String)>,
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn specs() {
        let path = spec("path:max_depth=4,rr_depth=8").unwrap();
        assert_eq!(path.name, "path");
        assert_eq!(path.parameters, [("max_depth".into(), "4".into()), ("rr_depth".into(), "8".into())]);
        assert!(spec("path").unwrap().parameters.is_empty());
        assert!(spec(":a=1").is_err());
        assert!(spec("path:a").is_err());
    }
}
