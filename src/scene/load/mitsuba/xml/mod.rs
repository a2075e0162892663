//! XML text to a tree of objects with named values: includes, parameters, aliases and references are resolved here,
//! and nothing is known of plugins.

mod reader;

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::super::{LoadError, Location, Position, RawMesh};
use super::values::Value;

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
#[derive(Clone, Copy)]
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

/// A list to choose from.
pub(super) fn one_of(names: &[&str]) -> String {
    match names {
        [only] => format!("`{only}`"),
        _ => format!("one of {}", names.join(", ")),
    }
}
