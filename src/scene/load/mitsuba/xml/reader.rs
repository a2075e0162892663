//! Files, what they include, and what has a name: parameters, identities and aliases.

mod element;

use std::borrow::Cow;
use std::collections::HashMap;
use std::path::Path;

use roxmltree::{Document as Xml, Node};

use super::{Document, ObjectId, Source, Span, Text, one_of};
use crate::scene::load::{LoadError, Location, Log, Position};
use element::{Member, is_known};

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

impl Document {
    /// Reads a scene with its includes. `defines` are values of `$name` parameters.
    pub(in crate::scene::load::mitsuba) fn read(
        text: &Text,
        defines: &[(String, String)],
        log: &mut Log,
    ) -> Result<Self, LoadError> {
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
