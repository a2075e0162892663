//! The small languages of arguments: `10,20,64x48`, `0..16`. What configuration files write too is in [`spec`](crate::spec).

use std::ops::Range;

use glam::UVec2;

use crate::scene::PixelRect;
use crate::spec::{number, size};

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
    fn crops() {
        assert_eq!(crop("10,20,64x48"), Ok(PixelRect { min: UVec2::new(10, 20), size: UVec2::new(64, 48) }));
        assert!(crop("10,64x48").is_err());
    }

    #[test]
    fn ranges() {
        assert_eq!(passes("0..16"), Ok(0..16));
        assert!(passes("16..16").is_err() && passes("16").is_err() && passes("-1..2").is_err());
    }
}
