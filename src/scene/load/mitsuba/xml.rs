//! XML text to a tree of objects with named values: includes, parameters, aliases and references are resolved here,
//! and nothing is known of plugins.

use std::borrow::Cow;
use std::collections::HashMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DVec3};
use roxmltree::{Document as Xml, Node};

use super::super::error::abridged;
use super::super::{LoadError, Location, Log, Position, RawMesh};
use super::values::{self, Color, Expected, Value};
use super::{spectra, upgrade};

/// Elements nested deeper than any scene needs; parsing recurses.
const MAX_DEPTH: usize = 50;
/// As in Mitsuba.
const MAX_INCLUDE_DEPTH: usize = 15;
/// Files that include each other can multiply.
const MAX_SOURCES: usize = 1000;
/// Parameters made of parameters can multiply too.
const MAX_SUBSTITUTED_LENGTH: usize = 1 << 20;

/// Aliases of aliases; they could run in circles.
const MAX_ALIASES: usize = 10;
/// Attributes of one element.
const MAX_ATTRIBUTES: usize = 1000;
/// Values of one object; each is compared with those before it.
const MAX_PROPERTIES: usize = 1000;

/// What kind of plugin an object is; the name of its XML element.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Category {
    /// Scattering at a surface.
    Bsdf,
    /// A light.
    Emitter,
    /// What collects samples.
    Film,
    /// A light transport algorithm.
    Integrator,
    /// A participating medium.
    Medium,
    /// Scattering in a medium.
    Phase,
    /// A reconstruction filter.
    Rfilter,
    /// A source of sample points.
    Sampler,
    /// A camera.
    Sensor,
    /// A surface.
    Shape,
    /// A spectrum made by a plugin.
    Spectrum,
    /// A texture.
    Texture,
    /// A volume grid.
    Volume,
}

impl Category {
    const ALL: [(Self, &'static str); 13] = [
        (Self::Bsdf, "bsdf"),
        (Self::Emitter, "emitter"),
        (Self::Film, "film"),
        (Self::Integrator, "integrator"),
        (Self::Medium, "medium"),
        (Self::Phase, "phase"),
        (Self::Rfilter, "rfilter"),
        (Self::Sampler, "sampler"),
        (Self::Sensor, "sensor"),
        (Self::Shape, "shape"),
        (Self::Spectrum, "spectrum"),
        (Self::Texture, "texture"),
        (Self::Volume, "volume"),
    ];

    fn from_tag(tag: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, t)| *t == tag).map(|(c, _)| *c)
    }
}

impl fmt::Display for Category {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let tag = Self::ALL.iter().find(|(c, _)| c == self).map_or("", |(_, t)| t);
        f.write_str(tag)
    }
}

/// A place in one of the files; made into line and column only when it is shown.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Span {
    source: usize,
    offset: usize,
}

/// Index into [`Document::objects`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct ObjectId(pub(super) usize);

/// A plugin as the file states it.
#[derive(Debug)]
pub(super) struct Object {
    pub(super) category: Category,
    pub(super) plugin: String,
    pub(super) id: Option<String>,
    pub(super) at: Span,
    pub(super) properties: Vec<Property>,
    pub(super) children: Vec<Child>,
}

/// A named value of an object.
#[derive(Debug)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) value: Value,
    /// The value as the file writes it; empty for transforms.
    pub(super) text: String,
    pub(super) at: Span,
}

/// An object within another.
#[derive(Debug)]
pub(super) struct Child {
    pub(super) name: Option<String>,
    pub(super) object: ObjectId,
    pub(super) at: Span,
}

struct Source {
    path: PathBuf,
    text: String,
    /// Offsets at which lines start.
    lines: Vec<usize>,
}

/// Everything that a scene file and its includes say.
#[derive(Default)]
pub(super) struct Document {
    sources: Vec<Source>,
    pub(super) objects: Vec<Object>,
    search: Vec<PathBuf>,
    /// The children of the scene.
    pub(super) roots: Vec<Child>,
    /// Meshes in memory by the names of files that they stand for.
    pub(super) meshes: Vec<(String, Arc<RawMesh>)>,
}

/// Where a scene is read from.
pub(in super::super) enum Text<'a> {
    /// A file.
    File(&'a Path),
    /// A text, and where the files are that it names.
    Memory(&'a str, &'a Path),
}

impl Text<'_> {
    /// The file, or one that could hold the text.
    pub(super) fn path(&self) -> PathBuf {
        match self {
            Self::File(path) => path.to_path_buf(),
            Self::Memory(_, directory) => directory.join("(memory)"),
        }
    }
}

impl Document {
    /// Reads a scene with its includes. `defines` are values of `$name` parameters.
    pub(super) fn read(text: &Text, defines: &[(String, String)], log: &mut Log) -> Result<Self, LoadError> {
        let path = &text.path();
        let defines = defines
            .iter()
            .map(|(n, v)| (n.clone(), Define { value: v.clone(), used: false, outer: true }))
            .collect();
        let mut reader = SceneReader {
            document: Self::default(),
            defines,
            ids: HashMap::new(),
            pending: Vec::new(),
            is_old: false,
            log,
        };
        match text {
            Text::File(path) => reader.file(path, None, 0)?,
            Text::Memory(text, _) => reader.text(path, text, 0)?,
        }
        reader.resolve()?;
        if let Some((name, _)) =
            reader.defines.iter().filter(|(_, d)| d.outer && !d.used).min_by_key(|(n, _)| *n)
        {
            let expected = "only parameters that the scene uses";
            return Err(LoadError::new(
                Location::file(path),
                format!("the scene does not use ${name}"),
                expected,
            ));
        }
        Ok(reader.document)
    }

    pub(super) fn object(&self, id: ObjectId) -> &Object {
        &self.objects[id.0]
    }

    /// The mesh in memory that stands for a file.
    pub(super) fn mesh(&self, name: &str) -> Option<&Arc<RawMesh>> {
        self.meshes.iter().find(|(n, _)| n == name).map(|(_, mesh)| mesh)
    }

    /// All objects, in the order in which they begin.
    pub(super) fn objects(&self) -> impl Iterator<Item = &Object> {
        self.objects.iter()
    }

    /// File, line and column.
    pub(super) fn locate(&self, at: Span) -> Location {
        locate(&self.sources, at)
    }

    pub(super) fn error(&self, at: Span, found: impl Into<String>, expected: impl Into<String>) -> LoadError {
        LoadError::new(self.locate(at), found, expected)
    }

    /// The path of a file that is named at `at`: beside that file, beside the scene, or in a `<path>`.
    pub(super) fn resolve_path(&self, name: &str, at: Span) -> PathBuf {
        let beside = |source: usize| self.sources.get(source).map(|s| s.path.with_file_name("").join(name));
        let candidates = [at.source, 0].into_iter().filter_map(beside);
        let mut candidates = candidates.chain(self.search.iter().map(|s| s.join(name)));
        let first = candidates.next().unwrap_or_else(|| PathBuf::from(name));
        if first.exists() { first } else { candidates.find(|c| c.exists()).unwrap_or(first) }
    }
}

fn locate(sources: &[Source], at: Span) -> Location {
    let source = &sources[at.source];
    let line = source.lines.partition_point(|&start| start <= at.offset);
    let before = source.text.get(source.lines[line - 1]..at.offset).unwrap_or_default();
    // Characters of lines without end are not counted one by one for each of many warnings.
    let column = if before.len() < 10_000 { before.chars().count() } else { before.len() } + 1;
    Location { file: source.path.clone(), position: Position::LineColumn(line, column) }
}

struct Define {
    value: String,
    used: bool,
    /// Given from outside, not by `<default>`.
    outer: bool,
}

/// What an `id` or an alias stands for.
enum Named {
    Object(ObjectId),
    Alias(String),
}

/// A reference whose target was not known yet: the parent (`None` for the scene), and which of its children it is.
struct Pending {
    parent: Option<ObjectId>,
    child: usize,
    id: String,
}

struct SceneReader<'a> {
    document: Document,
    defines: HashMap<String, Define>,
    ids: HashMap<String, (Named, Span)>,
    pending: Vec<Pending>,
    /// Whether the file that is being read is one of Mitsuba 0.x.
    is_old: bool,
    log: &'a mut Log,
}

/// The attributes of an element, checked against those that it may have, with parameters filled in.
struct Attributes<'a> {
    tag: &'a str,
    at: Span,
    pairs: Vec<(&'a str, String, Span)>,
}

impl Attributes<'_> {
    fn get(&self, name: &str) -> Option<(&str, Span)> {
        self.pairs.iter().find(|(n, ..)| *n == name).map(|(_, value, at)| (value.as_str(), *at))
    }

    fn require(&self, name: &str, document: &Document) -> Result<(&str, Span), LoadError> {
        self.get(name).ok_or_else(|| {
            document.error(
                self.at,
                format!("<{}> without `{name}`", self.tag),
                format!("an attribute `{name}`"),
            )
        })
    }
}

impl SceneReader<'_> {
    fn error<T>(
        &self,
        at: Span,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Result<T, LoadError> {
        Err(self.document.error(at, found, expected))
    }

    /// Reads a file and adds what its `<scene>` holds to the scene.
    fn file(&mut self, path: &Path, from: Option<Span>, depth: usize) -> Result<(), LoadError> {
        let from = from.map(|at| self.document.locate(at));
        let bytes = self.log.read(path, from.as_ref())?;
        let text = String::from_utf8(bytes).map_err(|e| {
            let offset = e.utf8_error().valid_up_to() as u64;
            LoadError::new(Location::byte(path, offset), "bytes that are not UTF-8", "an XML file in UTF-8")
        })?;
        self.text(path, &text, depth)
    }

    /// Adds what a text's `<scene>` holds to the scene. The path is for messages, and for files to be found beside it.
    fn text(&mut self, path: &Path, text: &str, depth: usize) -> Result<(), LoadError> {
        let source = self.document.sources.len();
        refuse_crowded_tags(path, text)?;
        let lines = std::iter::once(0).chain(text.match_indices('\n').map(|(i, _)| i + 1)).collect();
        self.document.sources.push(Source { path: path.to_path_buf(), text: text.to_owned(), lines });
        let options = roxmltree::ParsingOptions { allow_dtd: false, ..Default::default() };
        let xml = Xml::parse_with_options(text, options).map_err(|e| {
            let pos = e.pos();
            let position = Position::LineColumn(pos.row as usize, pos.col as usize);
            // The position is said already.
            let found = e.to_string().replace(&format!(" at {}:{}", pos.row, pos.col), "");
            LoadError::new(
                Location { file: path.to_path_buf(), position },
                found,
                "well-formed XML without a DTD",
            )
        })?;
        self.scene(xml.root_element(), source, depth)
    }

    fn scene(&mut self, root: Node, source: usize, depth: usize) -> Result<(), LoadError> {
        let at = Span { source, offset: root.range().start };
        if root.tag_name().name() != "scene" {
            return self.error(
                at,
                format!("<{}>", root.tag_name().name()),
                "a Mitsuba scene: <scene version=\"3.0.0\">",
            );
        }
        let attributes = self.attributes(root, at, &["version"])?;
        let (version, version_at) = attributes.require("version", &self.document)?;
        let numbers: Vec<Option<u32>> = version.split('.').map(|n| n.trim().parse().ok()).collect();
        let is_old = match numbers[..] {
            [Some(2..), ..] => false,
            [Some(0), Some(4..), ..] => true,
            _ => {
                let expected = "2.0.0 or newer, as Mitsuba 2 and 3 write, or 0.4.0 to 0.6.0";
                return self.error(version_at, format!("scene version `{version}`"), expected);
            }
        };
        // Each file has a version of its own.
        let outer = std::mem::replace(&mut self.is_old, is_old);
        self.scene_members(root, source, depth)?;
        self.is_old = outer;
        Ok(())
    }

    fn scene_members(&mut self, root: Node, source: usize, depth: usize) -> Result<(), LoadError> {
        for node in self.elements(root, source) {
            let at = Span { source, offset: node.range().start };
            match node.tag_name().name() {
                "include" => self.include(node, at, depth)?,
                "alias" => self.alias(node, at)?,
                "default" => self.default(node, at)?,
                "path" => self.search_path(node, at)?,
                tag if !is_known(tag) => {
                    let found = format!("<{tag}>");
                    let error = self.document.error(
                        at,
                        found,
                        "an object (shape, bsdf, emitter, sensor, integrator, ...)",
                    );
                    self.log.unsupported(error, "it is ignored")?;
                }
                tag => match self.member(node, at, 1, None)? {
                    Member::Child(child) => self.document.roots.push(child),
                    Member::Property(p) => {
                        return self.error(
                            at,
                            format!("<{tag} name=\"{}\"> in <scene>", p.name),
                            "an object",
                        );
                    }
                },
            }
        }
        Ok(())
    }

    /// The elements within a node. Text has no meaning in a scene.
    fn elements<'i>(&mut self, node: Node<'i, 'i>, source: usize) -> Vec<Node<'i, 'i>> {
        let mut texts =
            node.children().filter(|n| n.is_text() && !n.text().unwrap_or_default().trim().is_empty());
        if let Some(text) = texts.next() {
            let at = self.document.locate(Span { source, offset: text.range().start });
            self.log.warn(at, "text between elements has no meaning");
        }
        node.children().filter(Node::is_element).collect()
    }

    fn include(&mut self, node: Node, at: Span, depth: usize) -> Result<(), LoadError> {
        let attributes = self.attributes(node, at, &["filename"])?;
        let (name, _) = attributes.require("filename", &self.document)?;
        if depth >= MAX_INCLUDE_DEPTH || self.document.sources.len() >= MAX_SOURCES {
            let expected = format!("at most {MAX_INCLUDE_DEPTH} nested includes and {MAX_SOURCES} files");
            return self.error(at, format!("<include filename=\"{name}\"> too deep or too often"), expected);
        }
        let path = self.document.resolve_path(name, at);
        self.file(&path, Some(at), depth + 1)
    }

    fn alias(&mut self, node: Node, at: Span) -> Result<(), LoadError> {
        let attributes = self.attributes(node, at, &["id", "as"])?;
        let (id, _) = attributes.require("id", &self.document)?;
        let (new, new_at) = attributes.require("as", &self.document)?;
        self.name(new, Named::Alias(id.to_owned()), new_at)
    }

    fn name(&mut self, id: &str, named: Named, at: Span) -> Result<(), LoadError> {
        if let Some((_, before)) = self.ids.get(id) {
            let expected = format!("each id once; it is also at {}", self.document.locate(*before));
            return self.error(at, format!("the id `{id}` again"), expected);
        }
        self.ids.insert(id.to_owned(), (named, at));
        Ok(())
    }

    fn default(&mut self, node: Node, at: Span) -> Result<(), LoadError> {
        let attributes = self.attributes(node, at, &["name", "value"])?;
        let (name, _) = attributes.require("name", &self.document)?;
        let (value, _) = attributes.require("value", &self.document)?;
        let define = Define { value: value.to_owned(), used: false, outer: false };
        self.defines.entry(name.to_owned()).or_insert(define);
        Ok(())
    }

    fn search_path(&mut self, node: Node, at: Span) -> Result<(), LoadError> {
        let attributes = self.attributes(node, at, &["value"])?;
        let (name, value_at) = attributes.require("value", &self.document)?;
        let path = self.document.resolve_path(name, at);
        if !path.is_dir() {
            return self.error(value_at, format!("`{name}`"), "a folder that exists");
        }
        self.document.search.push(path);
        Ok(())
    }

    /// The attributes of an element, which must be among `allowed`.
    fn attributes<'n>(
        &mut self,
        node: Node<'n, '_>,
        at: Span,
        allowed: &[&'static str],
    ) -> Result<Attributes<'n>, LoadError> {
        let tag = node.tag_name().name();
        let mut pairs = Vec::new();
        for attribute in node.attributes() {
            let at = Span { source: at.source, offset: attribute.range().start };
            let name = attribute.name();
            if !allowed.contains(&name) {
                return self.error(at, format!("attribute `{name}` in <{tag}>"), one_of(allowed));
            }
            let value = self.substitute(attribute.value(), at)?.into_owned();
            pairs.push((name, value, at));
        }
        Ok(Attributes { tag, at, pairs })
    }

    /// The text with each `$name` replaced by the value of the parameter; the longest name that fits counts.
    fn substitute<'t>(&mut self, text: &'t str, at: Span) -> Result<Cow<'t, str>, LoadError> {
        if !text.contains('$') {
            return Ok(Cow::Borrowed(text));
        }
        let mut out = String::new();
        let mut rest = text;
        while let Some((before, after)) = rest.split_once('$') {
            let word =
                after.find(|c: char| !c.is_alphanumeric() && c != '_').map_or(after, |end| &after[..end]);
            let ends = word.char_indices().map(|(i, c)| i + c.len_utf8()).rev();
            let Some(name) = ends.map(|end| &word[..end]).find(|n| self.defines.contains_key(*n)) else {
                let expected = format!("a parameter given by <default> above or by -D {word}=value");
                return self.error(at, format!("undefined parameter ${word}"), expected);
            };
            out.push_str(before);
            if let Some(define) = self.defines.get_mut(name) {
                define.used = true;
                out.push_str(&define.value);
            }
            rest = &after[name.len()..];
            if out.len() > MAX_SUBSTITUTED_LENGTH {
                return self.error(at, "parameters that add up without bound", "a shorter value");
            }
        }
        out.push_str(rest);
        Ok(Cow::Owned(out))
    }
}

/// What an element within an object is.
enum Member {
    Child(Child),
    Property(Property),
}

impl SceneReader<'_> {
    /// A value, object or reference within `parent` (`None` for the scene).
    fn member(
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

    /// Fills in the targets of references, which may stand before their targets.
    fn resolve(&mut self) -> Result<(), LoadError> {
        for Pending { parent, child, id } in std::mem::take(&mut self.pending) {
            let target = self.target(&id);
            let children = match parent {
                Some(parent) => &mut self.document.objects[parent.0].children,
                None => &mut self.document.roots,
            };
            let child = &mut children[child];
            let Some(target) = target else {
                let at = child.at;
                return self.error(at, format!("a reference to `{id}`"), "the id of an object in the scene");
            };
            child.object = target;
        }
        Ok(())
    }

    fn target(&self, id: &str) -> Option<ObjectId> {
        let mut id = id;
        for _ in 0..MAX_ALIASES {
            match &self.ids.get(id)?.0 {
                Named::Object(object) => return Some(*object),
                Named::Alias(next) => id = next,
            }
        }
        None
    }
}

/// Whether an element may stand in a scene.
fn is_known(tag: &str) -> bool {
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

/// The XML parser takes quadratic time in the attributes of an element, to find repetitions, and has no limit for one
/// element. Quotes after `=` since the last `<` are at least as many as those attributes.
fn refuse_crowded_tags(path: &Path, text: &str) -> Result<(), LoadError> {
    let (mut count, mut last) = (0, b' ');
    for (offset, &byte) in text.as_bytes().iter().enumerate() {
        match byte {
            b'<' => count = 0,
            b'"' | b'\'' if last == b'=' => count += 1,
            _ => {}
        }
        if count > MAX_ATTRIBUTES {
            let found = format!("an element with more than {MAX_ATTRIBUTES} attributes");
            return Err(LoadError::new(Location::byte(path, offset as u64), found, "a Mitsuba scene"));
        }
        if !byte.is_ascii_whitespace() {
            last = byte;
        }
    }
    Ok(())
}

/// A list to choose from.
pub(super) fn one_of(names: &[&str]) -> String {
    match names {
        [only] => format!("`{only}`"),
        _ => format!("one of {}", names.join(", ")),
    }
}
