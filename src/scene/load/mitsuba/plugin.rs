//! Tables of plugins and their parameters.
//!
//! A plugin is one entry in the table of its category: its name, a line of help, its parameters with types and defaults,
//! and the function that builds it. Everything else follows from the entry: unknown parameters and wrong types are
//! found, error messages list what is supported, and defaults are filled in. Values are asked for through `properties`.

use super::super::{LoadError, Log};
use super::values::Value;
use super::xml::{Category, Document, Object, one_of};

/// Type of a parameter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A number.
    Float,
    /// A whole number.
    Integer,
    /// `true` or `false`.
    Boolean,
    /// Text.
    String,
    /// A number, or a text that names or contains one.
    FloatOrString,
    /// Three numbers.
    Vector,
    /// A reflectance or transmittance: colour or number in [0, 1].
    Reflectance,
    /// A radiance or intensity: colour or number, 0 or more; a flat spectrum is the equal-energy white, which is not
    /// the white of RGB.
    Emission,
    /// Such a radiance, or a texture of it.
    TexturedEmission,
    /// A colour or number without bound, such as an index of refraction.
    Unbounded,
    /// A number, or a texture of numbers.
    FloatOrTexture,
    /// A transform.
    Transform,
    /// A nested object of a category, under any name.
    Object(Category),
}

impl Kind {
    /// The XML elements that give such a parameter.
    pub fn elements(self) -> String {
        match self {
            Self::Float => "float".to_owned(),
            Self::Integer => "integer".to_owned(),
            Self::Boolean => "boolean".to_owned(),
            Self::String => "string".to_owned(),
            Self::FloatOrString => "float or string".to_owned(),
            Self::Vector => "point or vector".to_owned(),
            Self::Emission => "rgb, spectrum or float".to_owned(),
            Self::Reflectance | Self::TexturedEmission | Self::Unbounded => {
                "rgb, spectrum, float or texture".to_owned()
            }
            Self::FloatOrTexture => "float or texture".to_owned(),
            Self::Transform => "transform".to_owned(),
            Self::Object(category) => category.to_string(),
        }
    }

    pub(super) fn accepts(self, value: &Value) -> bool {
        match value {
            Value::Integer(_) => {
                matches!(self, Self::Float | Self::Integer | Self::FloatOrString | Self::FloatOrTexture)
                    || self.is_color()
            }
            Value::Float(_) => {
                matches!(self, Self::Float | Self::FloatOrString | Self::FloatOrTexture) || self.is_color()
            }
            Value::Boolean(_) => self == Self::Boolean,
            Value::String(_) => matches!(self, Self::String | Self::FloatOrString),
            Value::Vector(_) => self == Self::Vector,
            Value::Color(_) => self.is_color(),
            Value::Transform(_) => self == Self::Transform,
        }
    }

    /// Whether a texture may take the place of the value.
    pub(super) fn is_textured(self) -> bool {
        matches!(self, Self::Reflectance | Self::TexturedEmission | Self::Unbounded | Self::FloatOrTexture)
    }

    pub(super) fn is_color(self) -> bool {
        matches!(self, Self::Reflectance | Self::Unbounded) || self.is_emission()
    }

    pub(super) fn is_emission(self) -> bool {
        matches!(self, Self::Emission | Self::TexturedEmission)
    }
}

/// What a parameter is if the scene does not give it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Default {
    /// The plugin needs it.
    Required,
    /// Something that depends on other parameters; the help says what.
    Unset,
    /// This value, as the scene would write it.
    Value(&'static str),
}

/// A parameter of a plugin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Parameter {
    /// As the scene names it; empty for nested objects, which may have any name.
    pub name: &'static str,
    /// Its type.
    pub kind: Kind,
    /// Its default.
    pub default: Default,
    /// What it does, in a line.
    pub help: &'static str,
}

impl Parameter {
    /// With a default value.
    pub(super) const fn new(
        name: &'static str,
        kind: Kind,
        default: &'static str,
        help: &'static str,
    ) -> Self {
        Self { name, kind, default: Default::Value(default), help }
    }

    /// Without a default value of its own.
    pub(super) const fn optional(name: &'static str, kind: Kind, help: &'static str) -> Self {
        Self { name, kind, default: Default::Unset, help }
    }

    pub(super) const fn required(name: &'static str, kind: Kind, help: &'static str) -> Self {
        Self { name, kind, default: Default::Required, help }
    }

    pub(super) const fn object(category: Category, help: &'static str) -> Self {
        Self { name: "", kind: Kind::Object(category), default: Default::Unset, help }
    }
}

/// What there is to say about a plugin, for messages and tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Description {
    /// The `type` by which scenes name it.
    pub name: &'static str,
    /// What it is, in a line.
    pub help: &'static str,
    /// Its parameters, in groups that plugins share.
    pub parameters: &'static [&'static [Parameter]],
}

impl Description {
    /// All parameters.
    pub fn parameters(&self) -> impl Iterator<Item = &'static Parameter> {
        self.parameters.iter().copied().flatten()
    }
}

/// An entry in the table of a category; `build` makes the plugin.
pub(super) struct Plugin<Build> {
    pub(super) description: Description,
    pub(super) build: Build,
}

impl<Build> Plugin<Build> {
    pub(super) const fn new(
        name: &'static str,
        help: &'static str,
        parameters: &'static [&'static [Parameter]],
        build: Build,
    ) -> Self {
        Self { description: Description { name, help, parameters }, build }
    }
}

/// The plugin that an object names. `None`, with a warning, if it is not supported but lenience lets it pass.
pub(super) fn find<Build>(
    table: &'static [Plugin<Build>],
    object: &Object,
    document: &Document,
    substitute: &str,
    log: &mut Log,
) -> Result<Option<&'static Plugin<Build>>, LoadError> {
    if let Some(plugin) = table.iter().find(|p| p.description.name == object.plugin) {
        return Ok(Some(plugin));
    }
    let mut names: Vec<_> = table.iter().map(|p| p.description.name).collect();
    if object.category == Category::Shape {
        names.extend([super::instances::GROUP, super::instances::INSTANCE]);
    }
    let found = format!("{} `{}` is not supported", object.category, object.plugin);
    let way_round =
        WAYS_ROUND.iter().find(|(c, plugin, _)| *c == object.category && *plugin == object.plugin);
    let expected = way_round.map_or_else(|| one_of(&names), |(.., way)| (*way).to_owned());
    log.unsupported(document.error(object.at, found, expected), substitute)?;
    Ok(None)
}

/// What to write instead of plugins that are not supported but have an equivalent.
const WAYS_ROUND: &[(Category, &str, &str)] =
    &[(Category::Emitter, "sunsky", SKY), (Category::Emitter, "sky", SKY), (Category::Emitter, "sun", SKY)];

const SKY: &str =
    "an `envmap` of the sky as an image, which Mitsuba itself can write, or `directional` for the sun alone";
