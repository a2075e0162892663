//! The `sensor` plugins and what belongs to them: `film`, `rfilter` and `sampler`.

use glam::{DAffine3, DVec2, UVec2};

use super::super::{LoadError, Log};
use super::plugin::{Kind, Parameter, Plugin};
use super::properties::Properties;
use super::xml::Category;
use crate::scene::{Camera, FilmSettings, Filter, FovAxis, Lens, PixelRect};

pub(super) type SensorBuild = fn(&Properties) -> Result<Camera, LoadError>;
pub(super) type FilmBuild = fn(&Properties, &mut Log) -> Result<FilmSettings, LoadError>;
pub(super) type FilterBuild = fn(&Properties) -> Result<Filter, LoadError>;
pub(super) type SamplerBuild = fn(&Properties, &mut Log) -> Result<u32, LoadError>;

pub(super) const SENSORS: &[Plugin<SensorBuild>] = &[
    Plugin::new("perspective", "pinhole camera", &[PERSPECTIVE, PRINCIPAL_POINT, CAMERA], |p| {
        // Mitsuba reads it for all projective cameras; a pinhole has everything in focus.
        p.ignore("focus_distance");
        let principal_point =
            DVec2::new(p.float("principal_point_offset_x")?, p.float("principal_point_offset_y")?);
        Ok(Camera { principal_point, ..camera(p, Lens::Pinhole)? })
    }),
    Plugin::new("orthographic", "camera with parallel rays", &[CAMERA], |p| {
        p.ignore("focus_distance");
        camera(p, Lens::Orthographic)
    }),
    Plugin::new(
        "thinlens",
        "camera with depth of field",
        &[
            PERSPECTIVE,
            CAMERA,
            &[Parameter::required("aperture_radius", Kind::Float, "radius of the lens; 0 is a pinhole")],
        ],
        |p| {
            let focus_distance =
                if p.has("focus_distance") { p.positive("focus_distance")? } else { p.positive("far_clip")? };
            let aperture_radius = p.float("aperture_radius")?;
            if aperture_radius == 0.0 {
                return camera(p, Lens::Pinhole);
            }
            camera(p, Lens::Thin { aperture_radius: p.positive("aperture_radius")?, focus_distance })
        },
    ),
];

const PRINCIPAL_POINT: &[Parameter] = &[
    Parameter::new("principal_point_offset_x", Kind::Float, "0", "moves the picture, in widths to the left"),
    Parameter::new("principal_point_offset_y", Kind::Float, "0", "moves the picture, in heights up"),
];

const PERSPECTIVE: &[Parameter] = &[
    Parameter::optional("fov", Kind::Float, "field of view in degrees; else by focal_length"),
    Parameter::new("focal_length", Kind::FloatOrString, "50mm", "of a 35 mm film camera, millimetres"),
    Parameter::new("fov_axis", Kind::String, "x", "what fov spans: x, y, diagonal, smaller or larger"),
];

const CAMERA: &[Parameter] = &[
    Parameter::optional("to_world", Kind::Transform, "camera space (+z forward, +x left) to world space"),
    Parameter::new("near_clip", Kind::Float, "0.01", "nothing nearer is seen"),
    Parameter::new("far_clip", Kind::Float, "10000", "nothing farther is seen"),
    Parameter::optional("focus_distance", Kind::Float, "what is in focus, by default far_clip; for thinlens"),
    Parameter::optional("shutter_open", Kind::Float, "without effect: nothing moves"),
    Parameter::optional("shutter_close", Kind::Float, "without effect: nothing moves"),
    Parameter::object(Category::Film, "by default hdrfilm"),
    Parameter::object(Category::Sampler, "by default independent"),
];

fn camera(p: &Properties, lens: Lens) -> Result<Camera, LoadError> {
    let to_world = p.transform("to_world");
    for shutter in ["shutter_open", "shutter_close"] {
        p.ignore(shutter);
    }
    let is_parallel = lens == Lens::Orthographic;
    if is_parallel {
        if to_world.matrix3.determinant() == 0.0 || !to_world.inverse().is_finite() {
            return Err(p.error(
                "to_world",
                "`to_world` of the camera is singular",
                "an invertible transform",
            ));
        }
    } else if !is_similarity(&to_world) {
        let found = "`to_world` of the camera shears or scales unevenly";
        return Err(p.error("to_world", found, "rotation, translation and even scale"));
    }
    let (near_clip, far_clip) = (p.positive("near_clip")?, p.positive("far_clip")?);
    if near_clip >= far_clip {
        return Err(p.bad_value("far_clip", "a distance beyond near_clip"));
    }
    let (fov, fov_axis) = if is_parallel { (90.0, FovAxis::X) } else { field_of_view(p)? };
    Ok(Camera { to_world, fov, fov_axis, lens, near_clip, far_clip, principal_point: DVec2::ZERO })
}

fn field_of_view(p: &Properties) -> Result<(f64, FovAxis), LoadError> {
    p.exclusive("fov", "focal_length")?;
    if let Some(fov) = p.optional_float("fov") {
        let axes = [
            ("x", FovAxis::X),
            ("y", FovAxis::Y),
            ("diagonal", FovAxis::Diagonal),
            ("smaller", FovAxis::Smaller),
            ("larger", FovAxis::Larger),
        ];
        let axis = p.choice("fov_axis", &axes)?;
        return if fov > 0.0 && fov < 180.0 {
            Ok((fov, axis))
        } else {
            Err(p.bad_value("fov", "an angle between 0 and 180"))
        };
    }
    // Mitsuba takes focal lengths for those of a 36 x 24 mm film, across its diagonal, whatever `fov_axis` says.
    if p.has("fov_axis") {
        p.choice("fov_axis", &["x", "y", "diagonal", "smaller", "larger"].map(|n| (n, ())))?;
    }
    let length = match p.float_or_string("focal_length")? {
        Ok(x) => Some(x),
        Err(text) => text.trim().trim_end_matches("mm").trim_end().parse().ok(),
    };
    let length = length.filter(|x: &f64| *x > 0.0 && x.is_finite());
    let length =
        length.ok_or_else(|| p.bad_value("focal_length", "a length above 0 in millimetres, such as 50mm"))?;
    let half_diagonal = 36.0_f64.hypot(24.0) / 2.0;
    Ok((2.0 * (half_diagonal / length).atan().to_degrees(), FovAxis::Diagonal))
}

/// Whether a map keeps angles, within what a file's rounded numbers allow.
pub(super) fn is_similarity(map: &DAffine3) -> bool {
    let [x, y, z] = [map.x_axis, map.y_axis, map.z_axis];
    let scale = x.length();
    let even = [y, z].iter().all(|a| (a.length() - scale).abs() < 1e-3 * scale);
    let orthogonal = [x.dot(y), y.dot(z), z.dot(x)].iter().all(|d| d.abs() < 1e-3 * scale * scale);
    even && orthogonal && map.is_finite()
}

/// Pixels that a film may have: 4 GiB of RGBA in single precision.
const MAX_PIXELS: u64 = 1 << 28;

pub(super) const FILMS: &[Plugin<FilmBuild>] = &[Plugin::new(
    "hdrfilm",
    "image in high dynamic range",
    &[&[
        Parameter::new("width", Kind::Integer, "768", "pixels"),
        Parameter::new("height", Kind::Integer, "576", "pixels"),
        Parameter::new("crop_offset_x", Kind::Integer, "0", "first column that is rendered"),
        Parameter::new("crop_offset_y", Kind::Integer, "0", "first row that is rendered"),
        Parameter::optional("crop_width", Kind::Integer, "columns that are rendered, by default all"),
        Parameter::optional("crop_height", Kind::Integer, "rows that are rendered, by default all"),
        Parameter::optional("file_format", Kind::String, "without effect: the output's name decides"),
        Parameter::optional("pixel_format", Kind::String, "without effect: always rgb"),
        Parameter::new("component_format", Kind::String, "float16", "float16 or float32"),
        Parameter::new("sample_border", Kind::Boolean, "false", "without effect: borders are never darker"),
        Parameter::new("compensate", Kind::Boolean, "false", "without effect: sums are exact"),
        Parameter::object(Category::Rfilter, "by default gaussian"),
    ]],
    film,
)];

fn film(p: &Properties, log: &mut Log) -> Result<FilmSettings, LoadError> {
    let pixels = "a number of pixels above 0";
    let above_zero = |name: &str| match p.integer::<u32>(name, pixels)? {
        0 => Err(p.bad_value(name, pixels)),
        n => Ok(n),
    };
    let size = UVec2::new(above_zero("width")?, above_zero("height")?);
    if u64::from(size.x) * u64::from(size.y) > MAX_PIXELS {
        let found = format!("a film of {} x {} pixels", size.x, size.y);
        return Err(p.error("width", found, format!("at most {MAX_PIXELS} pixels")));
    }
    let min = UVec2::new(p.integer("crop_offset_x", "a column")?, p.integer("crop_offset_y", "a row")?);
    if !min.cmplt(size).all() {
        return Err(p.error(
            "crop_offset_x",
            format!("a crop at {min}"),
            format!("within the film of {size}"),
        ));
    }
    let rest = size - min;
    let crop = UVec2::new(
        if p.has("crop_width") { above_zero("crop_width")? } else { rest.x },
        if p.has("crop_height") { above_zero("crop_height")? } else { rest.y },
    );
    if crop.x > rest.x || crop.y > rest.y {
        return Err(p.error(
            "crop_width",
            format!("a crop of {crop} at {min}"),
            format!("within the film of {size}"),
        ));
    }
    for (name, usual) in [("file_format", "openexr"), ("pixel_format", "rgb")] {
        if let Some(other) = p.optional_string(name).filter(|text| !text.eq_ignore_ascii_case(usual)) {
            log.note(p.locate(name), format!("`{name}` {other} has no effect"));
        }
    }
    let half_float = p.choice("component_format", &[("float16", true), ("float32", false)])?;
    p.boolean("sample_border")?;
    p.boolean("compensate")?;
    let crop = PixelRect { min, size: crop };
    Ok(FilmSettings { size, crop, half_float, ..super::super::default_film() })
}

pub(super) const FILTERS: &[Plugin<FilterBuild>] = &[
    Plugin::new("box", "1 within the pixel", &[], |_| Ok(Filter::Box)),
    Plugin::new(
        "tent",
        "linear ramp",
        &[&[Parameter::new("radius", Kind::Float, "1", "half-width in pixels")]],
        |p| Ok(Filter::Tent { radius: pixels(p, "radius")? }),
    ),
    Plugin::new(
        "gaussian",
        "Gaussian cut at four standard deviations",
        &[&[Parameter::new("stddev", Kind::Float, "0.5", "standard deviation in pixels")]],
        |p| Ok(Filter::Gaussian { stddev: pixels(p, "stddev")? }),
    ),
    Plugin::new(
        "mitchell",
        "Mitchell and Netravali's cubic",
        &[&[
            Parameter::new("B", Kind::Float, "0.333333333", "its parameter B"),
            Parameter::new("C", Kind::Float, "0.333333333", "its parameter C"),
        ]],
        |p| Ok(Filter::Mitchell { b: p.float("B")? as f32, c: p.float("C")? as f32 }),
    ),
    Plugin::new(
        "lanczos",
        "windowed sinc",
        &[&[Parameter::new("lobes", Kind::Integer, "3", "radius in pixels")]],
        |p| {
            let expected = "a whole number from 1 to 50";
            let lobes = p.integer("lobes", expected)?;
            if (1..=50).contains(&lobes) {
                Ok(Filter::Lanczos { lobes })
            } else {
                Err(p.bad_value("lobes", expected))
            }
        },
    ),
];

/// A filter's width; a film does not want filters wider than this.
fn pixels(p: &Properties, name: &str) -> Result<f32, LoadError> {
    let width = p.positive(name)?;
    if width > 50.0 {
        Err(p.bad_value(name, "a width above 0 and at most 50 pixels"))
    } else {
        Ok(width as f32)
    }
}

/// They differ in parameters only: points are always an Owen-scrambled Sobol' sequence.
pub(super) const SAMPLERS: &[Plugin<SamplerBuild>] = &[
    Plugin::new("independent", "sets the number of samples", &[SAMPLER], sample_count),
    Plugin::new("stratified", "sets the number of samples", &[SAMPLER, JITTER], sample_count),
    Plugin::new("multijitter", "sets the number of samples", &[SAMPLER, JITTER], sample_count),
    Plugin::new(
        "orthogonal",
        "sets the number of samples",
        &[SAMPLER, JITTER, &[Parameter::optional("strength", Kind::Integer, "without effect")]],
        sample_count,
    ),
    Plugin::new("ldsampler", "sets the number of samples", &[SAMPLER], sample_count),
];

const SAMPLER: &[Parameter] = &[
    Parameter::new("sample_count", Kind::Integer, "4", "samples per pixel"),
    Parameter::optional("seed", Kind::Integer, "without effect"),
];

const JITTER: &[Parameter] = &[Parameter::optional("jitter", Kind::Boolean, "without effect")];

fn sample_count(p: &Properties, log: &mut Log) -> Result<u32, LoadError> {
    for name in ["seed", "jitter", "strength"].into_iter().filter(|n| p.has(n)) {
        p.ignore(name);
        log.note(
            p.locate(name),
            format!("`{name}` has no effect: points are an Owen-scrambled Sobol' sequence"),
        );
    }
    let expected = "a whole number above 0";
    match p.integer("sample_count", expected)? {
        0 => Err(p.bad_value("sample_count", expected)),
        n => Ok(n),
    }
}
