//! What stands within an object: values of every kind, transforms, other objects and references to them.

use glam::{DAffine3, DVec3};
use roxmltree::Node;

use super::super::{Category, Child, Document, Object, ObjectId, Property, Span, locate, one_of};
use super::{Attributes, Named, Pending, SceneReader};
use crate::scene::load::error::abridged;
use crate::scene::load::mitsuba::values::{self, Color, Expected, Value};
use crate::scene::load::mitsuba::{spectra, upgrade};
use crate::scene::load::{LoadError, Location};

/// Elements nested deeper than any scene needs; parsing recurses.
const MAX_DEPTH: usize = 50;
/// Values of one object; each is compared with those before it.
const MAX_PROPERTIES: usize = 1000;

/// What an element within an object is.
pub(super) enum Member {
    Child(Child),
    Property(Property),
}

impl SceneReader<'_> {
    /// A value, object or reference within `parent` (`None` for the scene).
    pub(super) fn member(
        &mut self,
        node: Node,
        at: Span,
        depth: usize,
        parent: Option<ObjectId>,
    ) -> Result<Member, LoadError> {
        if depth > MAX_DEPTH {
            return self.error(at, format!("elements nested {depth} deep"), format!("at most {MAX_DEPTH}"));
        }
        let tag = node.tag_name().name();
        // `<spectrum>` is a value or, with `type`, an object.
        let category =
            Category::from_tag(tag).filter(|&c| c != Category::Spectrum || node.has_attribute("type"));
        if let Some(category) = category {
            return self.object(node, at, depth, category).map(Member::Child);
        }
        if tag == "ref" {
            let attributes = self.attributes(node, at, &["name", "id"])?;
            let id = attributes.require("id", &self.document)?.0.to_owned();
            let name = attributes.get("name").map(|(n, _)| self.current_name(n));
            let child = parent.map_or(&self.document.roots, |p| &self.document.objects[p.0].children).len();
            self.pending.push(Pending { parent, child, id });
            // The target is filled in by `resolve`.
            return Ok(Member::Child(Child { name, object: ObjectId(usize::MAX), at }));
        }
        self.property(node, at).map(Member::Property)
    }

    fn object(&mut self, node: Node, at: Span, depth: usize, category: Category) -> Result<Child, LoadError> {
        let attributes = self.attributes(node, at, &["type", "id", "name"])?;
        let plugin = attributes.require("type", &self.document)?.0.to_owned();
        let id = attributes.get("id").map(|(id, at)| (id.to_owned(), at));
        let name = attributes.get("name").map(|(n, _)| self.current_name(n));
        let object = ObjectId(self.document.objects.len());
        if let Some((id, at)) = &id {
            self.name(id, Named::Object(object), *at)?;
        }
        let id = id.map(|(id, _)| id);
        let new = Object { category, plugin, id, at, properties: Vec::new(), children: Vec::new() };
        self.document.objects.push(new);
        for child in self.elements(node, at.source) {
            let at = Span { source: at.source, offset: child.range().start };
            match self.member(child, at, depth + 1, Some(object))? {
                Member::Child(child) => self.document.objects[object.0].children.push(child),
                Member::Property(property) => self.add_property(object, property)?,
            }
        }
        if self.is_old {
            let Document { sources, objects, .. } = &mut self.document;
            upgrade::object(&mut objects[object.0], |p| locate(sources, p.at), self.log);
        }
        Ok(Child { name, object, at })
    }

    /// The name of a parameter in Mitsuba 3.
    fn current_name(&self, name: &str) -> String {
        if self.is_old { upgrade::underscored(name) } else { name.to_owned() }
    }

    fn add_property(&mut self, object: ObjectId, property: Property) -> Result<(), LoadError> {
        let properties = &self.document.objects[object.0].properties;
        if properties.len() >= MAX_PROPERTIES {
            return self.error(
                property.at,
                "an object with too many parameters",
                format!("at most {MAX_PROPERTIES}"),
            );
        }
        if let Some(first) = properties.iter().find(|p| p.name == property.name) {
            let expected = format!("each parameter once; it is also at {}", self.document.locate(first.at));
            return self.error(property.at, format!("the parameter `{}` again", property.name), expected);
        }
        self.document.objects[object.0].properties.push(property);
        Ok(())
    }

    fn property(&mut self, node: Node, at: Span) -> Result<Property, LoadError> {
        let tag = node.tag_name().name();
        if tag == "transform" {
            let attributes = self.attributes(node, at, &["name"])?;
            let name = self.current_name(attributes.require("name", &self.document)?.0);
            let value = Value::Transform(self.transform(node, at)?);
            return Ok(Property { name, value, text: String::new(), at });
        }
        if tag == "blackbody" && self.is_old {
            return self.black_body(node, at);
        }
        if tag == "spectrum" && node.has_attribute("filename") {
            return self.spectrum_file(node, at);
        }
        let parse: fn(&str) -> Result<Value, Expected> = match tag {
            "float" => |t| values::float(t).map(Value::Float),
            "integer" => |t| values::integer(t).map(Value::Integer),
            "boolean" => |t| values::boolean(t).map(Value::Boolean),
            "string" => |t| Ok(Value::String(t.to_owned())),
            "rgb" => |t| values::rgb(t).map(Value::Color),
            "srgb" if self.is_old => |t| values::srgb(t).map(Value::Color),
            // Three numbers were the colours of builds for RGB.
            "spectrum" if self.is_old => |t| {
                values::spectrum(t).or_else(|expected| values::rgb(t).map_err(|_| expected)).map(Value::Color)
            },
            "spectrum" => |t| values::spectrum(t).map(Value::Color),
            "vector" | "point" => |t| values::vector(t).map(Value::Vector),
            _ => {
                let expected = "an object (shape, bsdf, ...), a reference (ref), or a value (float, integer, boolean, \
                                string, rgb, spectrum, vector, point, transform)";
                return self.error(at, format!("<{tag}>"), expected);
            }
        };
        if let Some(inner) = node.children().find(Node::is_element) {
            let at = Span { source: at.source, offset: inner.range().start };
            return self.error(
                at,
                format!("<{}> within <{tag}>", inner.tag_name().name()),
                "an empty element",
            );
        }
        let coordinates = matches!(tag, "vector" | "point");
        let allowed: &[&str] =
            if coordinates { &["name", "value", "x", "y", "z"] } else { &["name", "value"] };
        let attributes = self.attributes(node, at, allowed)?;
        let name = self.current_name(attributes.require("name", &self.document)?.0);
        if coordinates && attributes.get("value").is_none() {
            let mut v = [0.0; 3];
            for (x, axis) in v.iter_mut().zip(["x", "y", "z"]) {
                let (text, at) = attributes.require(axis, &self.document)?;
                *x = self.parsed(values::float(text), text, at)?;
            }
            let text = v.map(|x| x.to_string()).join(", ");
            return Ok(Property { name, value: Value::Vector(v.into()), text, at });
        }
        let (text, value_at) = attributes.require("value", &self.document)?;
        if let Some((axis, ..)) = attributes.pairs.iter().find(|(n, ..)| ["x", "y", "z"].contains(n)) {
            return self.error(at, format!("both `value` and `{axis}`"), "one of them");
        }
        let value = self.parsed(parse(text), text, value_at)?;
        Ok(Property { name, value, text: text.to_owned(), at })
    }

    /// Of Mitsuba 0.x: a temperature in kelvin, and a factor.
    fn black_body(&mut self, node: Node, at: Span) -> Result<Property, LoadError> {
        let attributes = self.attributes(node, at, &["name", "temperature", "scale"])?;
        let name = self.current_name(attributes.require("name", &self.document)?.0);
        let (text, value_at) = attributes.require("temperature", &self.document)?;
        let temperature =
            self.parsed(values::float(text.trim().trim_end_matches(['k', 'K'])), text, value_at)?;
        if !spectra::TEMPERATURES.contains(&temperature) {
            return self.error(value_at, format!("a temperature of {temperature}"), "1 to 1e9 kelvin");
        }
        let scale = attributes.get("scale").map(|(text, at)| self.parsed(values::float(text), text, at));
        let mut color = spectra::black_body(temperature);
        color.emission *= scale.transpose()?.unwrap_or(1.0);
        let value = Value::Color(Color::Wavelengths(color));
        Ok(Property { name, value, text: text.to_owned(), at })
    }

    fn spectrum_file(&mut self, node: Node, at: Span) -> Result<Property, LoadError> {
        let attributes = self.attributes(node, at, &["name", "filename"])?;
        let name = self.current_name(attributes.require("name", &self.document)?.0);
        let (file, file_at) = attributes.require("filename", &self.document)?;
        let path = self.document.resolve_path(file, file_at);
        let bytes = self.log.read(&path, Some(&self.document.locate(file_at)))?;
        let color = values::spectrum_file(&String::from_utf8_lossy(&bytes)).ok_or_else(|| {
            let expected = "a wavelength and a value per line, in ascending order";
            LoadError::new(Location::file(&path), "no spectrum", expected)
        })?;
        Ok(Property { name, value: Value::Color(Color::Wavelengths(color)), text: file.to_owned(), at })
    }

    fn parsed<T>(&self, value: Result<T, Expected>, text: &str, at: Span) -> Result<T, LoadError> {
        value.map_err(|expected| self.document.error(at, format!("`{}`", abridged(text)), expected))
    }

    /// The steps of a transform, each applied after those above it.
    fn transform(&mut self, node: Node, at: Span) -> Result<DAffine3, LoadError> {
        let mut total = DAffine3::IDENTITY;
        for step in self.elements(node, at.source) {
            let at = Span { source: at.source, offset: step.range().start };
            total = self.transform_step(step, at)? * total;
        }
        Ok(total)
    }

    fn transform_step(&mut self, node: Node, at: Span) -> Result<DAffine3, LoadError> {
        match node.tag_name().name() {
            "translate" => {
                let attributes = self.attributes(node, at, &["value", "x", "y", "z"])?;
                Ok(DAffine3::from_translation(self.components(&attributes, 0.0)?))
            }
            "scale" => {
                let attributes = self.attributes(node, at, &["value", "x", "y", "z"])?;
                Ok(DAffine3::from_scale(self.components(&attributes, 1.0)?))
            }
            "rotate" => {
                let attributes = self.attributes(node, at, &["value", "x", "y", "z", "angle"])?;
                let given = self.components(&attributes, 0.0)?;
                let Some(axis) = given.try_normalize() else {
                    return self.error(
                        at,
                        "a rotation without an axis",
                        "an axis (x, y, z or value) other than zero",
                    );
                };
                if !given.abs_diff_eq(axis, 1e-3) {
                    let message = "the rotation's axis is not of unit length: Mitsuba 3 makes a distortion of it, here it is normalised";
                    self.log.warn(self.document.locate(at), message);
                }
                let (text, angle_at) = attributes.require("angle", &self.document)?;
                let angle = self.parsed(values::float(text), text, angle_at)?;
                Ok(DAffine3::from_axis_angle(axis, angle.to_radians()))
            }
            tag if tag == "lookat" || (tag == "lookAt" && self.is_old) => {
                let attributes = self.attributes(node, at, &["origin", "target", "up"])?;
                let mut points = [DVec3::ZERO; 2];
                for (point, name) in points.iter_mut().zip(["origin", "target"]) {
                    let (text, at) = attributes.require(name, &self.document)?;
                    *point = self.parsed(values::vector(text), text, at)?;
                }
                let up = attributes.get("up").map(|(text, at)| self.parsed(values::vector(text), text, at));
                let look_at = values::look_at(points[0], points[1], up.transpose()?);
                look_at.map_err(|expected| self.document.error(at, "a view without direction", expected))
            }
            "matrix" => {
                let attributes = self.attributes(node, at, &["value"])?;
                let (text, value_at) = attributes.require("value", &self.document)?;
                self.parsed(values::matrix(text), text, value_at)
            }
            tag => self.error(
                at,
                format!("<{tag}> in <transform>"),
                one_of(&["translate", "scale", "rotate", "lookat", "matrix"]),
            ),
        }
    }

    /// `value`, or `x`, `y` and `z`, each of which may be missing.
    fn components(&self, attributes: &Attributes, missing: f64) -> Result<DVec3, LoadError> {
        let mut v = [missing; 3];
        let mut any = None;
        for (x, axis) in v.iter_mut().zip(["x", "y", "z"]) {
            if let Some((text, at)) = attributes.get(axis) {
                *x = self.parsed(values::float(text), text, at)?;
                any = Some(axis);
            }
        }
        match (attributes.get("value"), any) {
            (Some(_), Some(axis)) => {
                self.error(attributes.at, format!("both `value` and `{axis}`"), "one of them")
            }
            (Some((text, at)), None) => self.parsed(values::vector(text), text, at),
            (None, _) => Ok(v.into()),
        }
    }
}

/// Whether an element may stand in a scene.
pub(super) fn is_known(tag: &str) -> bool {
    const VALUES: [&str; 13] = [
        "ref",
        "float",
        "integer",
        "boolean",
        "string",
        "rgb",
        "srgb",
        "spectrum",
        "blackbody",
        "vector",
        "point",
        "transform",
        "include",
    ];
    Category::from_tag(tag).is_some() || VALUES.contains(&tag)
}
