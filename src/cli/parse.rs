//! The small languages of arguments: `640x480`, `10,20,64x48`, `30s`, `0..16`. What names a thing with parameters is a [`Spec`](crate::spec::Spec).

use std::ops::Range;
use std::time::Duration;

use glam::UVec2;

use crate::scene::PixelRect;

fn number<T: std::str::FromStr>(text: &str, what: &str) -> Result<T, String> {
    text.trim().parse().map_err(|_| format!("expected {what}, found `{text}`"))
}

/// `WIDTHxHEIGHT`, both positive.
pub(super) fn size(text: &str) -> Result<UVec2, String> {
    let (w, h) = text.split_once('x').ok_or_else(|| format!("expected WIDTHxHEIGHT, found `{text}`"))?;
    let size = UVec2::new(number(w, "a width in pixels")?, number(h, "a height in pixels")?);
    if size.min_element() == 0 || size.max_element() > 1 << 16 {
        return Err(format!("width and height must be from 1 to 65536, found `{text}`"));
    }
    Ok(size)
}

/// `X,Y`.
pub(super) fn pixel(text: &str) -> Result<UVec2, String> {
    let (x, y) = text.split_once(',').ok_or_else(|| format!("expected X,Y, found `{text}`"))?;
    Ok(UVec2::new(number(x, "a pixel column")?, number(y, "a pixel row")?))
}

/// `X,Y,WIDTHxHEIGHT`.
pub(super) fn crop(text: &str) -> Result<PixelRect, String> {
    let (min, extent) =
        text.rsplit_once(',').ok_or_else(|| format!("expected X,Y,WIDTHxHEIGHT, found `{text}`"))?;
    Ok(PixelRect { min: pixel(min)?, size: size(extent)? })
}

/// A number with a unit: `ms`, `s`, `m` or `h`.
pub(super) fn duration(text: &str) -> Result<Duration, String> {
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

/// A number above 0.
pub(super) fn positive(text: &str) -> Result<f64, String> {
    let value: f64 = number(text, "a number")?;
    if value > 0.0 && value.is_finite() {
        Ok(value)
    } else {
        Err(format!("expected a number above 0, found `{text}`"))
    }
}

/// `FIRST..END`, the end not included.
pub(super) fn passes(text: &str) -> Result<Range<u32>, String> {
    let (first, end) = text.split_once("..").ok_or_else(|| format!("expected FIRST..END, found `{text}`"))?;
    let range = number(first, "the first pass")?..number(end, "the pass after the last")?;
    if range.is_empty() {
        return Err(format!("`{text}` holds no pass"));
    }
    Ok(range)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_and_crops() {
        assert_eq!(size("640x480"), Ok(UVec2::new(640, 480)));
        assert!(size("640").is_err() && size("0x4").is_err() && size("70000x4").is_err());
        assert_eq!(crop("10,20,64x48"), Ok(PixelRect { min: UVec2::new(10, 20), size: UVec2::new(64, 48) }));
        assert!(crop("10,64x48").is_err());
    }

    #[test]
    fn durations() {
        assert_eq!(duration("30s"), Ok(Duration::from_secs(30)));
        assert_eq!(duration("1.5m"), Ok(Duration::from_secs(90)));
        assert_eq!(duration("250ms"), Ok(Duration::from_millis(250)));
        assert!(duration("30").is_err() && duration("-1s").is_err() && duration("NaNs").is_err());
    }

    #[test]
    fn ranges() {
        assert_eq!(passes("0..16"), Ok(0..16));
        assert!(passes("16..16").is_err() && passes("16").is_err() && passes("-1..2").is_err());
    }
}
