//! Values of properties as Mitsuba writes them: numbers, vectors, colours, transforms.

use glam::{DAffine3, DMat3, DMat4, DVec3};

use super::spectra::{self, SpectrumColor, srgb_to_linear};

/// A colour as the file writes it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Color {
    /// `<rgb>`: linear Rec. 709.
    Rgb(DVec3),
    /// `<spectrum value="x"/>`: the same at all wavelengths.
    Flat(f64),
    /// `<spectrum value="400:x, ..."/>` and other spectra.
    Wavelengths(SpectrumColor),
}

/// The value of a property.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    Float(f64),
    Integer(i64),
    Boolean(bool),
    String(String),
    /// `<vector>` and `<point>`, which Mitsuba does not tell apart either.
    Vector(DVec3),
    Color(Color),
    Transform(DAffine3),
}

impl Value {
    /// The XML element that makes such a value.
    pub(super) fn tag(&self) -> &'static str {
        match self {
            Self::Float(_) => "float",
            Self::Integer(_) => "integer",
            Self::Boolean(_) => "boolean",
            Self::String(_) => "string",
            Self::Vector(_) => "vector",
            Self::Color(Color::Rgb(_)) => "rgb",
            Self::Color(_) => "spectrum",
            Self::Transform(_) => "transform",
        }
    }
}

/// What was expected where parsing failed.
pub(super) type Expected = &'static str;

pub(super) fn float(text: &str) -> Result<f64, Expected> {
    text.trim().parse().ok().filter(|x: &f64| x.is_finite()).ok_or("a finite number")
}

pub(super) fn integer(text: &str) -> Result<i64, Expected> {
    text.trim().parse().map_err(|_| "a whole number")
}

pub(super) fn boolean(text: &str) -> Result<bool, Expected> {
    match text.trim().to_lowercase().as_str() {
        "true" => Ok(true),
        "false" => Ok(false),
        _ => Err("`true` or `false`"),
    }
}

/// Numbers separated by commas and white space.
pub(super) fn floats(text: &str) -> Option<Vec<f64>> {
    let words = text.split(|c: char| c == ',' || c.is_whitespace()).filter(|w| !w.is_empty());
    words.map(|w| float(w).ok()).collect()
}

/// Three numbers, or one that stands for all three.
pub(super) fn vector(text: &str) -> Result<DVec3, Expected> {
    match floats(text).as_deref() {
        Some(&[x]) => Ok(DVec3::splat(x)),
        Some(&[x, y, z]) => Ok(DVec3::new(x, y, z)),
        _ => Err("one or three finite numbers"),
    }
}

/// Three numbers, one that stands for all three, or `#rrggbb` in sRGB.
pub(super) fn rgb(text: &str) -> Result<Color, Expected> {
    let expected = "one or three finite numbers, or #rrggbb";
    if let Some(hex) = text.trim().strip_prefix('#') {
        let code = u32::from_str_radix(hex, 16).ok().filter(|_| hex.len() == 6).ok_or(expected)?;
        let [_, r, g, b] = code.to_be_bytes().map(|c| srgb_to_linear(f64::from(c) / 255.0));
        return Ok(Color::Rgb(DVec3::new(r, g, b)));
    }
    vector(text).map(Color::Rgb).map_err(|_| expected)
}

/// Like [`rgb`], but encoded by the transfer function of sRGB in either form (Mitsuba 0.x).
pub(super) fn srgb(text: &str) -> Result<Color, Expected> {
    match rgb(text)? {
        Color::Rgb(c) if !text.trim().starts_with('#') => {
            Ok(Color::Rgb(DVec3::new(srgb_to_linear(c.x), srgb_to_linear(c.y), srgb_to_linear(c.z))))
        }
        color => Ok(color),
    }
}

/// One number, or pairs of wavelength and value.
pub(super) fn spectrum(text: &str) -> Result<Color, Expected> {
    let expected = "a finite number, or pairs `wavelength:value`";
    if !text.contains(':') {
        return float(text).map(Color::Flat).map_err(|_| expected);
    }
    let pairs = floats(&text.replace(':', " ")).ok_or(expected)?;
    samples(&pairs).map(Color::Wavelengths).ok_or(expected)
}

/// A spectrum from wavelengths and values by turns; `None` unless there are whole pairs, in ascending order of wavelength.
pub(super) fn samples(numbers: &[f64]) -> Option<SpectrumColor> {
    let pairs: Vec<_> = numbers.chunks_exact(2).map(|pair| (pair[0], pair[1])).collect();
    let ascending = pairs.is_sorted_by(|a, b| a.0 < b.0);
    (numbers.len().is_multiple_of(2) && !pairs.is_empty() && ascending).then(|| spectra::from_samples(&pairs))
}

/// The content of a spectrum file: a wavelength and a value per line, `#` begins a comment.
pub(super) fn spectrum_file(text: &str) -> Option<SpectrumColor> {
    let lines: Vec<&str> = text.lines().map(|line| line.split('#').next().unwrap_or_default()).collect();
    samples(&floats(&lines.join(" "))?)
}

/// 16 numbers, or 9 for a matrix without translation, row by row.
pub(super) fn matrix(text: &str) -> Result<DAffine3, Expected> {
    let numbers = floats(text).ok_or("9 or 16 finite numbers")?;
    if let Ok(m) = <[f64; 9]>::try_from(&numbers[..]) {
        return Ok(DAffine3::from_mat3(DMat3::from_cols_array(&m).transpose()));
    }
    let m = <[f64; 16]>::try_from(numbers).map_err(|_| "9 or 16 finite numbers")?;
    if m[12..] != [0.0, 0.0, 0.0, 1.0] {
        return Err("a matrix with last row 0 0 0 1");
    }
    Ok(DAffine3::from_mat4(DMat4::from_cols_array(&m).transpose()))
}

/// Camera space (+z forward, +x left) to world space.
pub(super) fn look_at(origin: DVec3, target: DVec3, up: Option<DVec3>) -> Result<DAffine3, Expected> {
    let direction = (target - origin).try_normalize().ok_or("a target away from the origin")?;
    let up = up.filter(|u| *u != DVec3::ZERO).unwrap_or_else(|| tangent_frame(direction).x_axis);
    let left = up.cross(direction);
    // Relative to `up`, whose length is arbitrary.
    if left.length() <= 1e-12 * up.length() {
        return Err("an `up` vector that is not along the view");
    }
    Ok(super::super::look_along(origin, direction, up))
}

/// Some frame whose z axis is the unit vector `n` (Duff et al. 2017, "Building an orthonormal basis, revisited").
pub(super) fn tangent_frame(n: DVec3) -> DMat3 {
    let sign = 1.0_f64.copysign(n.z);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    let s = DVec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x);
    let t = DVec3::new(b, sign + n.y * n.y * a, -n.y);
    DMat3::from_cols(s, t, n)
}
