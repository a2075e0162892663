//! The reader through which a plugin asks for the values of its parameters, which are checked against its entry in the table (`plugin`).

use std::cell::RefCell;

use glam::{DAffine3, DVec3, Vec3};

use super::super::{LoadError, Location, Log};
use super::plugin::{Default, Description, Kind, Parameter};
use super::values::{Color, Value};
use super::xml::{Category, Child, Document, Object, ObjectId, Property, Span, one_of};
use crate::scene::Rgb;

/// The parameters of one object, checked against the plugin's table.
pub(super) struct Properties<'a> {
    pub(super) document: &'a Document,
    pub(super) object: &'a Object,
    description: Description,
    /// Names of parameters that lenience ignores or that the plugin asked for.
    used: RefCell<Vec<&'a str>>,
}

impl<'a> Properties<'a> {
    /// Checks names and types of all parameters and nested objects.
    pub(super) fn new(
        document: &'a Document,
        object: &'a Object,
        description: Description,
        log: &mut Log,
    ) -> Result<Self, LoadError> {
        let properties = Self { document, object, description, used: RefCell::default() };
        for property in &object.properties {
            properties.check_property(property, log)?;
        }
        for child in &object.children {
            properties.check_child(child.name.as_deref(), child.at, document.object(child.object), log)?;
        }
        Ok(properties)
    }

    fn check_property(&self, property: &'a Property, log: &mut Log) -> Result<(), LoadError> {
        let Some(parameter) = self.description.parameters().find(|p| p.name == property.name) else {
            self.used.borrow_mut().push(&property.name);
            let found = format!("parameter `{}` of {} is not supported", property.name, self.title());
            return log.unsupported(self.document.error(property.at, found, self.choices()), "it is ignored");
        };
        if !parameter.kind.accepts(&property.value) {
            let found =
                format!("parameter `{}` of {} as <{}>", property.name, self.title(), property.value.tag());
            return Err(self.document.error(property.at, found, parameter.kind.elements()));
        }
        Ok(())
    }

    fn check_child(
        &self,
        name: Option<&str>,
        at: Span,
        child: &Object,
        log: &mut Log,
    ) -> Result<(), LoadError> {
        if self.description.parameters().any(|p| p.kind == Kind::Object(child.category)) {
            return Ok(());
        }
        let textured = |p: &&Parameter| Some(p.name) == name && p.kind.is_textured();
        if child.category == Category::Texture && self.description.parameters().any(|p| textured(&p)) {
            return Ok(());
        }
        let named = name.map(|n| format!(" as `{n}`")).unwrap_or_default();
        let found =
            format!("{} `{}`{named} in {} is not supported", child.category, child.plugin, self.title());
        let parameter = self.description.parameters().find(|p| Some(p.name) == name && p.kind.is_color());
        let substitute = match parameter.map(|p| p.default) {
            Some(Default::Value(value)) => format!("`{value}` is used"),
            _ => "it is ignored".to_owned(),
        };
        let expected = parameter.map_or_else(|| self.choices(), |p| p.kind.elements());
        log.unsupported(self.document.error(at, found, expected), &substitute)
    }

    /// Category and name.
    fn title(&self) -> String {
        format!("{} `{}`", self.object.category, self.description.name)
    }

    /// The names of all parameters and nested objects.
    fn choices(&self) -> String {
        let names: Vec<String> = self
            .description
            .parameters()
            .map(|p| if p.name.is_empty() { format!("<{}>", p.kind.elements()) } else { p.name.to_owned() })
            .collect();
        if names.is_empty() {
            "no parameters".to_owned()
        } else {
            one_of(&names.iter().map(String::as_str).collect::<Vec<_>>())
        }
    }

    /// Whether all given parameters were asked for; the others have no effect in this combination.
    pub(super) fn finish(&self) -> Result<(), LoadError> {
        let used = self.used.borrow();
        let unused = self.object.properties.iter().find(|p| !used.contains(&p.name.as_str()));
        unused.map_or(Ok(()), |p| {
            let found = format!("parameter `{}` of {} has no effect beside the others", p.name, self.title());
            Err(self.document.error(p.at, found, "only parameters that have an effect"))
        })
    }

    /// An error at a parameter, or at the object if the parameter is a default.
    pub(super) fn error(
        &self,
        name: &str,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> LoadError {
        self.document.error(self.span(name), found, expected)
    }

    /// An error about the value of a parameter.
    pub(super) fn bad_value(&self, name: &str, expected: impl Into<String>) -> LoadError {
        let text = self.object.properties.iter().find(|p| p.name == name).map_or("a default", |p| &p.text);
        self.error(name, format!("`{name}` is {text}"), expected)
    }

    /// The type of a parameter.
    pub(super) fn kind(&self, name: &str) -> Kind {
        self.description.parameters().find(|p| p.name == name).map_or(Kind::Unbounded, |p| p.kind)
    }

    /// The texture that stands for a parameter, if one does.
    pub(super) fn texture(&self, name: &str) -> Result<Option<(ObjectId, Span)>, LoadError> {
        let is_it = |c: &&Child| {
            c.name.as_deref() == Some(name) && self.document.object(c.object).category == Category::Texture
        };
        let mut textures = self.object.children.iter().filter(is_it);
        let first = textures.next();
        if let Some(second) = textures.next().or(first.filter(|_| self.has(name))) {
            let found = format!("`{name}` of {} given twice", self.title());
            return Err(self.document.error(second.at, found, "one value or texture"));
        }
        Ok(first.map(|c| (c.object, c.at)))
    }

    /// Whether the scene gives a parameter. This does not count as asking for it.
    pub(super) fn has(&self, name: &str) -> bool {
        self.object.properties.iter().any(|p| p.name == name)
    }

    /// Counts a parameter as asked for, though it has no effect.
    pub(super) fn ignore(&self, name: &str) {
        let _ = self.given(name);
    }

    /// Where a parameter is given, or else the object.
    pub(super) fn locate(&self, name: &str) -> Location {
        self.document.locate(self.span(name))
    }

    fn span(&self, name: &str) -> Span {
        self.object.properties.iter().find(|p| p.name == name).map_or(self.object.at, |p| p.at)
    }

    /// Two parameters of which at most one may be given.
    pub(super) fn exclusive(&self, a: &str, b: &str) -> Result<(), LoadError> {
        if self.has(a) && self.has(b) {
            return Err(self.error(b, format!("both `{a}` and `{b}`"), "one of them"));
        }
        Ok(())
    }

    /// The value that the scene gives.
    fn given(&self, name: &str) -> Option<&'a Property> {
        let property = self.object.properties.iter().find(|p| p.name == name)?;
        self.used.borrow_mut().push(&property.name);
        Some(property)
    }

    fn value(&self, name: &str) -> Option<&'a Value> {
        self.given(name).map(|p| &p.value)
    }

    /// The text of a default. Asking for a parameter that the table does not have is an error in this program, found
    /// by the test that builds every plugin.
    fn default(&self, name: &str) -> Result<&'static str, LoadError> {
        let parameter = self.description.parameters().find(|p| p.name == name);
        match parameter.map(|p| p.default) {
            Some(Default::Value(text)) => Ok(text),
            Some(Default::Required) => Err(self.error(
                name,
                format!("{} without `{name}`", self.title()),
                format!("a parameter `{name}`"),
            )),
            Some(Default::Unset) | None => unreachable!("`{name}` of {} has no default", self.title()),
        }
    }

    fn default_number(&self, name: &str) -> Result<f64, LoadError> {
        let text = self.default(name)?;
        text.parse().map_err(|_| self.error(name, format!("default `{text}`"), "a number"))
    }

    /// A number, if the scene gives it.
    pub(super) fn optional_float(&self, name: &str) -> Option<f64> {
        match self.value(name)? {
            Value::Float(x) => Some(*x),
            Value::Integer(i) => Some(*i as f64),
            _ => None,
        }
    }

    /// A number.
    pub(super) fn float(&self, name: &str) -> Result<f64, LoadError> {
        self.optional_float(name).map_or_else(|| self.default_number(name), Ok)
    }

    /// A number above 0 that is above 0 in single precision too.
    pub(super) fn positive(&self, name: &str) -> Result<f64, LoadError> {
        let x = self.float(name)?;
        let single = x as f32;
        if single > 0.0 && single.is_finite() { Ok(x) } else { Err(self.bad_value(name, "a number above 0")) }
    }

    /// A whole number between bounds that fit it.
    pub(super) fn integer<T: TryFrom<i64>>(&self, name: &str, expected: &str) -> Result<T, LoadError> {
        let number = match self.value(name) {
            Some(Value::Integer(i)) => *i,
            _ => self.default_number(name)? as i64,
        };
        T::try_from(number).map_err(|_| self.bad_value(name, expected))
    }

    /// A switch.
    pub(super) fn boolean(&self, name: &str) -> Result<bool, LoadError> {
        match self.value(name) {
            Some(Value::Boolean(b)) => Ok(*b),
            _ => Ok(self.default(name)? == "true"),
        }
    }

    /// A text, if the scene gives it.
    pub(super) fn optional_string(&self, name: &str) -> Option<&'a str> {
        match self.value(name)? {
            Value::String(s) => Some(s),
            _ => None,
        }
    }

    /// A text.
    pub(super) fn string(&self, name: &str) -> Result<&'a str, LoadError> {
        self.optional_string(name).map_or_else(|| self.default(name), Ok)
    }

    /// A text among `choices`.
    pub(super) fn choice<T: Copy>(&self, name: &str, choices: &[(&str, T)]) -> Result<T, LoadError> {
        let text = self.string(name)?;
        let names: Vec<_> = choices.iter().map(|(n, _)| *n).collect();
        let chosen = choices.iter().find(|(n, _)| *n == text).map(|(_, c)| *c);
        chosen.ok_or_else(|| self.bad_value(name, one_of(&names)))
    }

    /// Three numbers, if the scene gives them.
    pub(super) fn optional_vector(&self, name: &str) -> Option<DVec3> {
        match self.value(name)? {
            Value::Vector(v) => Some(*v),
            _ => None,
        }
    }

    /// A transform; the identity by default.
    pub(super) fn transform(&self, name: &str) -> DAffine3 {
        match self.value(name) {
            Some(Value::Transform(t)) => *t,
            _ => DAffine3::IDENTITY,
        }
    }

    /// A colour, within the bounds of its kind.
    pub(super) fn color(&self, name: &str) -> Result<Rgb, LoadError> {
        let kind = self.kind(name);
        let color = match self.value(name) {
            Some(Value::Color(Color::Rgb(c))) => *c,
            // Equal energy at all wavelengths is no RGB white; Mitsuba makes the difference for emitters alone.
            Some(Value::Color(Color::Flat(x))) if kind.is_emission() => *x * EQUAL_ENERGY,
            // Spectral colours may lie outside of what RGB can mix; they are moved to its border, as in Mitsuba.
            Some(Value::Color(Color::Wavelengths(c))) => match kind {
                Kind::Emission | Kind::TexturedEmission => c.emission.max(DVec3::ZERO),
                Kind::Reflectance => c.reflectance.clamp(DVec3::ZERO, DVec3::ONE),
                _ => c.reflectance.max(DVec3::ZERO),
            },
            Some(Value::Color(Color::Flat(x)) | Value::Float(x)) => DVec3::splat(*x),
            Some(Value::Integer(i)) => DVec3::splat(*i as f64),
            _ => DVec3::splat(self.default_number(name)?),
        };
        let (highest, expected) = match kind {
            Kind::Reflectance => (1.0, "values between 0 and 1"),
            _ => (f64::from(f32::MAX), "values of 0 or more within single precision"),
        };
        if color.min_element() < 0.0 || color.max_element() > highest {
            return Err(self.bad_value(name, expected));
        }
        Ok(Vec3::new(color.x as f32, color.y as f32, color.z as f32))
    }

    /// A number given as such or by a text.
    pub(super) fn float_or_string(&self, name: &str) -> Result<Result<f64, &'a str>, LoadError> {
        match self.value(name) {
            Some(Value::Float(x)) => Ok(Ok(*x)),
            Some(Value::Integer(i)) => Ok(Ok(*i as f64)),
            Some(Value::String(s)) => Ok(Err(s)),
            _ => self.default(name).map(Err),
        }
    }

    /// The nested objects of a category.
    pub(super) fn objects(&self, category: Category) -> impl Iterator<Item = (ObjectId, Span)> {
        let children = self.object.children.iter();
        children
            .filter(move |c| self.document.object(c.object).category == category)
            .map(|c| (c.object, c.at))
    }

    /// The only nested object of a category, if any.
    pub(super) fn optional_object(&self, category: Category) -> Result<Option<ObjectId>, LoadError> {
        let mut objects = self.objects(category);
        let first = objects.next();
        match objects.next() {
            Some((_, at)) => {
                let found = format!("a second {category} in {}", self.title());
                Err(self.document.error(at, found, format!("at most one {category}")))
            }
            None => Ok(first.map(|(id, _)| id)),
        }
    }
}

/// XYZ = (1, 1, 1) in linear Rec. 709, which is what Mitsuba's RGB variants make of `<spectrum value="1"/>` in emitters:
/// the row sums of the matrix from XYZ.
const EQUAL_ENERGY: DVec3 = DVec3::new(1.204_794, 0.948_291, 0.908_916);
