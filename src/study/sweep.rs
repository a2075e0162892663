//! Sweeps: one line of text for several specs that differ in one value, `photonmapper:radius=0.001..0.1x7` or `path:rr_depth=2|5|100`.

use crate::spec::{Spec, spec};

/// Most values of a sweep.
const MAX_VALUES: usize = 100;

/// The specs that a sweep stands for. Exactly one parameter has several values: a list `A|B|...`, or a range `A..BxN` of N numbers with both ends, which grow by a
/// constant factor if both ends are positive, else by a constant step. Between whole ends all are whole, each once, and may so be fewer than N.
///
/// # Errors
/// If it is no spec, no parameter or more than one has several values, or a range makes no sense.
pub(super) fn expand(text: &str) -> Result<Vec<Spec>, String> {
    let spec = spec(text)?;
    let mut swept = None;
    for (index, (key, value)) in spec.parameters.iter().enumerate() {
        let Some(values) = values(value).map_err(|why| format!("`{key}={value}`: {why}"))? else { continue };
        if let Some((first, _)) = swept.replace((index, values)) {
            let first = &spec.parameters[first].0;
            return Err(format!("both `{first}` and `{key}` have several values; expected one that does"));
        }
    }
    let (index, values) =
        swept.ok_or("no parameter has several values; expected `key=A..BxN` or `key=A|B|...`")?;
    let with = |value| {
        let mut one = spec.clone();
        one.parameters[index].1 = value;
        one
    };
    Ok(values.into_iter().map(with).collect())
}

/// The values that a text stands for; `None` if it is one value.
fn values(text: &str) -> Result<Option<Vec<String>>, String> {
    let values: Vec<String> = if text.contains('|') {
        text.split('|').map(str::to_owned).collect()
    } else if let Some((first, rest)) = text.split_once("..") {
        let (last, count) = rest.rsplit_once('x').ok_or("expected `A..BxN`, with the number of values")?;
        range(first, last, count)?
    } else {
        return Ok(None);
    };
    if values.iter().any(String::is_empty) {
        return Err("a value of the list is empty".to_owned());
    }
    if values.len() > MAX_VALUES {
        return Err(format!("{} values; at most {MAX_VALUES} are possible", values.len()));
    }
    Ok(Some(values))
}

fn range(first: &str, last: &str, count: &str) -> Result<Vec<String>, String> {
    let end = |text: &str| {
        let value: Option<f64> = text.parse().ok();
        value.filter(|v| v.is_finite()).ok_or_else(|| format!("`{text}` is not a number"))
    };
    let (a, b) = (end(first)?, end(last)?);
    let count: Option<usize> = count.parse().ok();
    let count = count
        .filter(|n| (2..=MAX_VALUES).contains(n))
        .ok_or_else(|| format!("expected from 2 to {MAX_VALUES} values"))?;
    if a == b {
        return Err("both ends are the same".to_owned());
    }
    let is_whole = [first, last].iter().all(|text| text.parse::<i64>().is_ok());
    let value = |i: usize| {
        let x = i as f64 / (count - 1) as f64;
        let value = if a > 0.0 && b > 0.0 { a * (b / a).powf(x) } else { a + (b - a) * x };
        if is_whole { value.round().to_string() } else { short(value) }
    };
    let inner = (1..count - 1).map(value);
    let mut all: Vec<_> = std::iter::once(first.to_owned()).chain(inner).collect();
    all.push(last.to_owned());
    all.dedup();
    Ok(all)
}

/// Four digits are enough to tell the values of a sweep apart, and can be read.
fn short(value: f64) -> String {
    let rounded: f64 = format!("{value:.3e}").parse().unwrap_or(value);
    rounded.to_string()
}

#[cfg(test)]
mod tests {
    use super::expand;

    fn texts(text: &str) -> Vec<String> {
        expand(text).expect(text).iter().map(ToString::to_string).collect()
    }

    /// Factors of 10^(1/3) by hand: 1, 2.154, 4.642, 10.
    #[test]
    fn ranges_keep_their_ends() {
        let found = texts("photonmapper:k=5,radius=0.001..0.1x7");
        let expected = ["0.001", "0.002154", "0.004642", "0.01", "0.02154", "0.04642", "0.1"];
        assert_eq!(found, expected.map(|r| format!("photonmapper:k=5,radius={r}")));
        assert_eq!(
            texts("vpl:count=10..10000x4"),
            ["10", "100", "1000", "10000"].map(|n| format!("vpl:count={n}"))
        );
        assert_eq!(texts("vpl:count=1..3x9"), ["vpl:count=1", "vpl:count=2", "vpl:count=3"]);
        assert_eq!(texts("vpl:count=100..1x3"), ["vpl:count=100", "vpl:count=10", "vpl:count=1"]);
        assert_eq!(texts("vpl:clamp=0..1.0x3"), ["vpl:clamp=0", "vpl:clamp=0.5", "vpl:clamp=1.0"]);
        assert_eq!(texts("a:b=1e-3..1e3x3"), ["a:b=1e-3", "a:b=1", "a:b=1e3"]);
    }

    #[test]
    fn lists_are_taken_as_they_are() {
        assert_eq!(
            texts("path:rr_depth=2|5|100"),
            ["path:rr_depth=2", "path:rr_depth=5", "path:rr_depth=100"]
        );
        assert_eq!(texts("embree:robust=true|false"), ["embree:robust=true", "embree:robust=false"]);
    }

    #[test]
    fn what_makes_no_sense_is_refused() {
        for (text, why) in [
            ("path", "no parameter has several"),
            ("path:max_depth=3", "no parameter has several"),
            ("path:max_depth=1|2,rr_depth=1|2", "`max_depth` and `rr_depth`"),
            ("path:max_depth=1..4", "`max_depth=1..4`: expected `A..BxN`"),
            ("path:max_depth=1..4x1", "from 2 to 100"),
            ("path:max_depth=1..4x1000000000000", "from 2 to 100"),
            ("path:max_depth=1..x3", "`` is not a number"),
            ("path:max_depth=NaN..1x3", "`NaN` is not a number"),
            ("path:max_depth=1..infx3", "`inf` is not a number"),
            ("path:max_depth=4..4x3", "the same"),
            ("path:max_depth=4||5", "empty"),
            (":a=1|2", "expected a name"),
        ] {
            let error = expand(text).expect_err(text);
            assert!(error.contains(why), "{text}: {error}");
        }
        assert!(expand(&format!("a:b={}", "1|".repeat(200) + "1")).is_err_and(|e| e.contains("201 values")));
    }
}
