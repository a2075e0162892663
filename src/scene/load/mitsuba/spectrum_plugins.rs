//! `<spectrum type="...">`: spectra as objects of their own, which become colours of the parameters that they are given for.
//!
//! `d65`, `uniform`, `srgb` and `rawconstant` mean what they mean in Mitsuba's `scalar_rgb`. That variant cannot evaluate `regular`, `irregular`
//! and `blackbody`; here they are integrated as the same spectra written as `<spectrum value="400:0.1, ...">` are.

use std::collections::HashMap;

use glam::DVec3;

use super::super::{LoadError, Log};
use super::plugin::{Kind, Parameter, Plugin};
use super::properties::Properties;
use super::spectra;
use super::values::{self, Color, Value};
use super::xml::{Category, Document, ObjectId, Property};

type Build = fn(&Properties) -> Result<Color, LoadError>;

pub(super) const PLUGINS: &[Plugin<Build>] = &[
    Plugin::new(
        "d65",
        "the white of RGB times a factor, for emitters",
        &[&[
            Parameter::new("scale", Kind::Float, "1", "factor"),
            Parameter::new("color", Kind::Emission, "1", "colour of the light"),
        ]],
        |p| {
            let scale = p.float("scale")?;
            Ok(Color::Rgb(p.color("color")?.as_dvec3() * scale))
        },
    ),
    Plugin::new(
        "uniform",
        "the same number for all three channels",
        &[&[Parameter::new("value", Kind::Float, "1", "the number")]],
        |p| Ok(Color::Rgb(DVec3::splat(p.float("value")?))),
    ),
    Plugin::new(
        "rawconstant",
        "the same number for all three channels",
        &[&[Parameter::required("value", Kind::Float, "the number")]],
        |p| Ok(Color::Rgb(DVec3::splat(p.float("value")?))),
    ),
    Plugin::new(
        "srgb",
        "a reflectance given as colour",
        &[&[Parameter::required("color", Kind::Emission, "the colour")]],
        |p| Ok(Color::Rgb(p.color("color")?.as_dvec3())),
    ),
    Plugin::new(
        "regular",
        "values at equal steps of wavelength",
        &[&[
            Parameter::required("wavelength_min", Kind::Float, "of the first value, nm"),
            Parameter::required("wavelength_max", Kind::Float, "of the last value, nm"),
            Parameter::required("values", Kind::String, "two numbers or more"),
        ]],
        |p| {
            let (first, last) = (p.float("wavelength_min")?, p.float("wavelength_max")?);
            let values = numbers(p, "values")?;
            if values.len() < 2 || first >= last {
                return Err(p.bad_value("values", "two numbers or more over a range that is not empty"));
            }
            let step = (last - first) / (values.len() - 1) as f64;
            let pairs = values.iter().enumerate().map(|(i, v)| (first + step * i as f64, *v));
            Ok(Color::Wavelengths(spectra::from_samples(&pairs.collect::<Vec<_>>())))
        },
    ),
    Plugin::new(
        "irregular",
        "values at wavelengths",
        &[&[
            Parameter::required("wavelengths", Kind::String, "ascending, nm"),
            Parameter::required("values", Kind::String, "as many numbers"),
        ]],
        |p| {
            let (wavelengths, values) = (numbers(p, "wavelengths")?, numbers(p, "values")?);
            let pairs: Vec<_> = wavelengths.iter().zip(&values).flat_map(|(w, v)| [*w, *v]).collect();
            let color = values::samples(&pairs).filter(|_| wavelengths.len() == values.len());
            let expected = "as many ascending wavelengths as values, at least one";
            color.map(Color::Wavelengths).ok_or_else(|| p.bad_value("wavelengths", expected))
        },
    ),
    Plugin::new(
        "blackbody",
        "the radiance of a black body, W / (m^2 sr nm)",
        &[&[Parameter::required("temperature", Kind::Float, "kelvin")]],
        |p| {
            let temperature = p.float("temperature")?;
            if !spectra::TEMPERATURES.contains(&temperature) {
                return Err(p.bad_value("temperature", "1 to 1e9 kelvin"));
            }
            Ok(Color::Wavelengths(spectra::black_body(temperature)))
        },
    ),
];

fn numbers(p: &Properties, name: &str) -> Result<Vec<f64>, LoadError> {
    values::floats(p.string(name)?).ok_or_else(|| p.bad_value(name, "finite numbers"))
}

/// Puts the colours of spectra in the place of the objects. What is no plugin of the table stays, for its error where it is used.
pub(super) fn fold(document: &mut Document, log: &mut Log) -> Result<(), LoadError> {
    let mut colors = HashMap::new();
    // Spectra within spectra come after those around them.
    for index in (0..document.objects.len()).rev() {
        if document.objects[index].category != Category::Spectrum {
            continue;
        }
        fold_children(document, index, &colors)?;
        let object = &document.objects[index];
        let Some(plugin) = PLUGINS.iter().find(|p| p.description.name == object.plugin) else { continue };
        let properties = Properties::new(document, object, plugin.description, log)?;
        let color = (plugin.build)(&properties)?;
        properties.finish()?;
        colors.insert(ObjectId(index), color);
    }
    for index in 0..document.objects.len() {
        fold_children(document, index, &colors)?;
    }
    document.roots.retain(|root| !colors.contains_key(&root.object));
    Ok(())
}

fn fold_children(
    document: &mut Document,
    index: usize,
    colors: &HashMap<ObjectId, Color>,
) -> Result<(), LoadError> {
    if colors.is_empty() {
        return Ok(());
    }
    let mut folded = Vec::new();
    for child in &document.objects[index].children {
        let (Some(color), Some(name)) = (colors.get(&child.object), &child.name) else { continue };
        let object = &document.objects[index];
        let is_known = |p: &Property| p.name == *name;
        if object.properties.iter().chain(&folded).any(is_known) {
            return Err(document.error(
                child.at,
                format!("the parameter `{name}` again"),
                "each parameter once",
            ));
        }
        let text = document.object(child.object).plugin.clone();
        folded.push(Property { name: name.clone(), value: Value::Color(*color), text, at: child.at });
    }
    let object = &mut document.objects[index];
    object.children.retain(|child| child.name.is_none() || !colors.contains_key(&child.object));
    object.properties.extend(folded);
    Ok(())
}
