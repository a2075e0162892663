//! Wavefront OBJ through `tobj`.
//!
//! `tobj` parses; what it cannot do is done around it. [`Feed`] hands it the lines of the file in a form that it reads
//! right, and [`diagnose`] finds the line of an error, which `tobj` does not tell. See `vendor-notes/loaders.md`.

use std::borrow::Cow;
use std::cell::{Cell, RefCell};
use std::io::{self, BufRead, Read};
use std::path::Path;

use glam::{Vec2, Vec3};

use super::error::abridged;
use super::mesh::{Placement, RawMesh};
use super::{GREY, LoadError, Location, Log, mesh_scene, mtl, push_two_sided};
use crate::scene::{Geometry, MeshError, Scene, Shape, TriangleMesh};

/// How many `mtllib` lines of a file are followed, so that a small file cannot cause large ones to be read without end.
const MAX_LIBRARIES: usize = 100;

/// A part of the file with one name and one material.
struct Group {
    name: String,
    material: Option<usize>,
    mesh: RawMesh,
}

/// Loads the file as a scene: a shape per group and material, materials from MTL.
pub(super) fn load_scene(path: &Path, log: &mut Log) -> Result<Scene, LoadError> {
    let bytes = log.read(path, None)?;
    let (groups, library) = parse(path, &bytes, true, log)?;
    let mut translator = mtl::Translator::new(path);
    let translated: Vec<_> = library.iter().map(|m| translator.translate(m, log)).collect();
    let mtl::Translator { mut materials, textures, .. } = translator;
    let mut grey = None;
    let mut shapes = Vec::new();
    for group in groups {
        let geometry = group.mesh.place(&Placement::bare(true));
        let geometry = geometry.map_err(|e| mesh_error(path, &bytes, &group.name, &e))?;
        let (material, emission) = match group.material.and_then(|m| translated.get(m)) {
            Some(&known) => known,
            None => (*grey.get_or_insert_with(|| push_two_sided(&mut materials, GREY)), None),
        };
        shapes.push(Shape { name: group.name, geometry: Geometry::Mesh(geometry), material, emission });
    }
    Ok(mesh_scene(path, shapes, materials, textures, log))
}

/// Loads all faces of the file as one mesh; groups and materials are of no concern.
pub(super) fn load_mesh(
    path: &Path,
    from: &Location,
    placement: &Placement,
    log: &mut Log,
) -> Result<Geometry, LoadError> {
    let bytes = log.read(path, Some(from))?;
    let (groups, _) = parse(path, &bytes, false, log)?;
    let mesh = groups.into_iter().next().map(|g| g.mesh).unwrap_or_default();
    mesh.place(placement).map(Geometry::Mesh).map_err(|e| mesh_error(path, &bytes, "mesh", &e))
}

fn mesh_error(path: &Path, bytes: &[u8], group: &str, error: &MeshError) -> LoadError {
    diagnose(bytes).map_or_else(
        || LoadError::new(Location::file(path), format!("in `{group}`, {error}"), "a valid mesh"),
        |d| LoadError::new(Location::line(path, d.line), d.found, d.expected),
    )
}

/// The groups that have faces, and the materials they refer to by index.
fn parse(
    path: &Path,
    bytes: &[u8],
    grouped: bool,
    log: &mut Log,
) -> Result<(Vec<Group>, Vec<tobj::Material>), LoadError> {
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err(LoadError::new(Location::file(path), "UTF-16 text", "an OBJ file in ASCII or UTF-8"));
    }
    let mut feed = Feed::new(bytes, grouped);
    let (mut models, materials) = read(&mut feed, path, bytes, log)?;
    if models.iter().any(|m| lacks_some(&m.mesh)) {
        log.note(
            Location::file(path),
            "some faces lack normals or texture coordinates: these are smooth and 0 there",
        );
        // Libraries are read again, without saying the same twice.
        let mut feed = Feed { completed: true, ..Feed::new(bytes, grouped) };
        models = read(&mut feed, path, bytes, &mut Log::default())?.0;
    }
    let groups: Vec<Group> =
        models.into_iter().map(|m| group(m, path, log)).filter(|g| !g.mesh.triangles.is_empty()).collect();
    if groups.is_empty() {
        return Err(LoadError::new(
            Location::file(path),
            "a file without faces",
            "at least one line `f ...`",
        ));
    }
    Ok((groups, materials))
}

/// Whether some corners of faces lack what others have: then tobj leaves it out, so that the rest cannot be told apart.
fn lacks_some(mesh: &tobj::Mesh) -> bool {
    let vertices = mesh.positions.len() / 3;
    let is_part = |found: usize| found != 0 && found != vertices;
    is_part(mesh.normals.len() / 3) || is_part(mesh.texcoords.len() / 2)
}

/// What `tobj` makes of the lines.
fn read(
    feed: &mut Feed,
    path: &Path,
    bytes: &[u8],
    log: &mut Log,
) -> Result<(Vec<tobj::Model>, Vec<tobj::Material>), LoadError> {
    let options = tobj::LoadOptions {
        single_index: true,
        ignore_points: true,
        ignore_lines: true,
        ..Default::default()
    };
    let shared_log = RefCell::new(&mut *log);
    let libraries = Cell::new(0);
    let result = tobj::load_obj_buf(feed, &options, |name| {
        libraries.set(libraries.get() + 1);
        if libraries.get() > MAX_LIBRARIES {
            return Err(tobj::LoadError::GenericFailure);
        }
        mtl::load(path, name, &mut shared_log.borrow_mut())
    });
    if libraries.get() > MAX_LIBRARIES {
        log.warn(Location::file(path), format!("only the first {MAX_LIBRARIES} `mtllib` are read"));
    }
    let (models, materials) = result.map_err(|e| {
        let d = diagnose(bytes);
        let d = d.unwrap_or_else(|| Diagnosis::new(feed.line, e.to_string(), "valid Wavefront OBJ"));
        LoadError::new(Location::line(path, d.line), d.found, d.expected)
    })?;
    Ok((models, materials.unwrap_or_default()))
}

fn group(model: tobj::Model, path: &Path, log: &mut Log) -> Group {
    let tobj::Model { mesh, name } = model;
    let mut raw = RawMesh {
        positions: mesh.positions.chunks_exact(3).map(Vec3::from_slice).collect(),
        normals: mesh.normals.chunks_exact(3).map(Vec3::from_slice).collect(),
        uvs: mesh.texcoords.chunks_exact(2).map(Vec2::from_slice).collect(),
        triangles: Vec::with_capacity(mesh.indices.len() / 3),
        attributes: Vec::new(),
    };
    let bad = raw.count_bad_attributes();
    if bad > 0 {
        log.warn(
            Location::file(path),
            format!("`{name}`: {bad} normals or texture coordinates are not finite"),
        );
    }
    if mesh.face_arities.is_empty() {
        raw.triangles.extend(mesh.indices.chunks_exact(3).map(|t| [t[0], t[1], t[2]]));
    } else {
        let mut rest = &mesh.indices[..];
        for &arity in &mesh.face_arities {
            let (corners, after) = rest.split_at((arity as usize).min(rest.len()));
            raw.push_polygon(corners);
            rest = after;
        }
    }
    Group { name, material: mesh.material_id, mesh: raw }
}

/// The lines of an OBJ file as `tobj` can read them. Each line stays one line, so that lines can be counted:
/// - bytes that are not UTF-8 are replaced, a line that ends in `\` is joined with the next;
/// - `v` keeps three numbers (`tobj` fails on colours of some vertices only), `vt` gets the second that it may omit;
/// - names are set off from their keyword by one space, and are never empty;
/// - `l`, which `tobj` takes for a face, is left out, and without grouping so are names and materials;
/// - if `completed`, a normal and texture coordinates of 0 come first, and corners of faces that lack either name those.
struct Feed<'a> {
    rest: &'a [u8],
    grouped: bool,
    completed: bool,
    current: Cow<'a, [u8]>,
    used: usize,
    /// Lines taken so far.
    line: usize,
}

impl<'a> Feed<'a> {
    fn new(bytes: &'a [u8], grouped: bool) -> Self {
        let rest = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        Self { rest, grouped, completed: false, current: Cow::Borrowed(&[]), used: 0, line: 0 }
    }

    /// The next physical line with its end, empty at the end of the file.
    fn physical_line(&mut self) -> &'a [u8] {
        let end = self.rest.iter().position(|&b| b == b'\n').map_or(self.rest.len(), |i| i + 1);
        let (line, rest) = self.rest.split_at(end);
        self.rest = rest;
        self.line += usize::from(!line.is_empty());
        line
    }

    fn logical_line(&mut self) -> Cow<'a, [u8]> {
        let mut line = Cow::Borrowed(self.physical_line());
        while let Some(head) = line.trim_ascii_end().strip_suffix(b"\\") {
            let mut joined = [head, b" "].concat();
            let next = self.physical_line();
            if next.is_empty() {
                joined.push(b'\n');
            }
            joined.extend_from_slice(next);
            line = Cow::Owned(joined);
        }
        line
    }

    fn advance(&mut self) {
        if self.completed && self.line == 0 {
            self.line = 1;
            self.used = 0;
            self.current = Cow::Borrowed(b"vn 0 0 0\nvt 0 0\n");
            return;
        }
        let line = self.logical_line();
        self.used = 0;
        self.current = match keyword(&line) {
            b"l" => Cow::Borrowed(&b"\n"[..]),
            b"g" | b"o" | b"usemtl" | b"mtllib" if !self.grouped => Cow::Borrowed(&b"\n"[..]),
            b"g" | b"o" | b"usemtl" | b"mtllib" => named(&line),
            b"v" => fit(line, 3),
            b"vt" => fit(line, 2),
            b"f" if self.completed => completed(&line),
            _ => line,
        };
        if std::str::from_utf8(&self.current).is_err() {
            self.current = Cow::Owned(String::from_utf8_lossy(&self.current).into_owned().into_bytes());
        }
    }
}

/// The first word of a line.
fn keyword(line: &[u8]) -> &[u8] {
    let line = line.trim_ascii_start();
    let end = line.iter().position(u8::is_ascii_whitespace).unwrap_or(line.len());
    &line[..end]
}

/// The line with its keyword, one space and the name.
fn named(line: &[u8]) -> Cow<'static, [u8]> {
    let (line, keyword) = (line.trim_ascii(), keyword(line));
    let name = line[keyword.len()..].trim_ascii();
    Cow::Owned([keyword, b" ", if name.is_empty() { b"unnamed" } else { name }, b"\n"].concat())
}

/// A face whose corners all have texture coordinates and normals; see [`Feed`]. What is malformed stays so.
fn completed(line: &[u8]) -> Cow<'static, [u8]> {
    let text = String::from_utf8_lossy(line);
    let mut out = String::from("f");
    for corner in text.split_whitespace().skip(1) {
        let mut parts = corner.splitn(3, '/');
        let position = parts.next().unwrap_or_default();
        // Counted backwards, the first are never reached; counted from 1, all have moved on by one.
        let mut attribute = || match parts.next().unwrap_or_default() {
            "" => "1".to_owned(),
            text => text
                .parse()
                .map_or(text.to_owned(), |i: i64| if i > 0 { i.saturating_add(1) } else { i }.to_string()),
        };
        let (uv, normal) = (attribute(), attribute());
        out.extend([" ", position, "/", &uv, "/", &normal]);
    }
    out.push('\n');
    Cow::Owned(out.into_bytes())
}

/// The line with exactly `count` numbers after the keyword, if it has at least one.
fn fit(line: Cow<[u8]>, count: usize) -> Cow<[u8]> {
    let words = || line.split(u8::is_ascii_whitespace).filter(|w| !w.is_empty());
    let numbers = words().count() - 1;
    if numbers == count || numbers == 0 || (numbers < count && count != 2) {
        return line;
    }
    let mut fitted: Vec<u8> = words().take(1 + count).collect::<Vec<_>>().join(&b' ');
    fitted.extend_from_slice(if numbers < count { b" 0\n" } else { b"\n" });
    Cow::Owned(fitted)
}

impl BufRead for Feed<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.used == self.current.len() {
            self.advance();
        }
        Ok(&self.current[self.used..])
    }

    fn consume(&mut self, amount: usize) {
        self.used += amount;
    }
}

impl Read for Feed<'_> {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let n = self.fill_buf()?.read(out)?;
        self.consume(n);
        Ok(n)
    }
}

/// What is wrong with a line.
struct Diagnosis {
    line: usize,
    found: String,
    expected: String,
}

impl Diagnosis {
    fn new(line: usize, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Self { line, found: found.into(), expected: expected.into() }
    }
}

/// Finds the first line that makes a file invalid. Only called once the file was refused.
fn diagnose(bytes: &[u8]) -> Option<Diagnosis> {
    // Positive indices may run ahead of what they name.
    let mut totals = [0; 3];
    let _ = each_line(bytes, |_, text| {
        if let Some((kind, _)) = attribute(text) {
            totals[kind] += 1;
        }
        None
    });
    let mut above = [0; 3];
    each_line(bytes, |line, text| {
        if let Some((kind, count)) = attribute(text) {
            above[kind] += 1;
            return malformed_attribute(line, text, kind, count);
        }
        let corners = text.trim_start().strip_prefix("f").filter(|t| t.starts_with(char::is_whitespace))?;
        corners.split_whitespace().find_map(|c| malformed_corner(line, c, above, totals))
    })
}

/// The first diagnosis that `check` makes of the lines.
fn each_line(bytes: &[u8], mut check: impl FnMut(usize, &str) -> Option<Diagnosis>) -> Option<Diagnosis> {
    let mut feed = Feed::new(bytes, true);
    loop {
        feed.advance();
        if feed.current.is_empty() {
            return None;
        }
        if let Some(found) = check(feed.line, &String::from_utf8_lossy(&feed.current)) {
            return Some(found);
        }
    }
}

/// What vertex attributes are called, in the order in which a face corner names them.
const ATTRIBUTES: [&str; 3] = ["vertices", "texture coordinates", "normals"];

/// Which of [`ATTRIBUTES`] a line holds, and of how many numbers.
fn attribute(text: &str) -> Option<(usize, usize)> {
    match text.split_whitespace().next() {
        Some("v") => Some((0, 3)),
        Some("vt") => Some((1, 2)),
        Some("vn") => Some((2, 3)),
        _ => None,
    }
}

fn malformed_attribute(line: usize, text: &str, kind: usize, count: usize) -> Option<Diagnosis> {
    let limit = TriangleMesh::COORDINATE_LIMIT;
    // Attributes other than positions may be anything that is a number.
    let valid = |w: &str| w.parse::<f32>().is_ok_and(|x| kind != 0 || x.abs() < limit);
    if text.split_whitespace().skip(1).take(count).filter(|w| valid(w)).count() == count {
        return None;
    }
    let finite =
        if kind == 0 { format!("finite numbers below {limit:e} in magnitude") } else { "numbers".to_owned() };
    Some(Diagnosis::new(line, format!("`{}`", abridged(text.trim())), format!("{count} {finite}")))
}

fn malformed_corner(line: usize, corner: &str, above: [usize; 3], totals: [usize; 3]) -> Option<Diagnosis> {
    let refuse = |expected: String| {
        Some(Diagnosis::new(line, format!("face corner `{}`", abridged(corner)), expected))
    };
    for (kind, part) in corner.split('/').enumerate() {
        if part.is_empty() && kind != 0 {
            continue;
        }
        let Some(index) = part.parse::<isize>().ok().filter(|_| kind < 3) else {
            return refuse("`v`, `v/vt`, `v//vn` or `v/vt/vn` with whole numbers".to_owned());
        };
        let reaches =
            if index < 0 { index.unsigned_abs() <= above[kind] } else { index as usize <= totals[kind] };
        if index == 0 && kind == 0 || !reaches {
            let (count, name) = (if index < 0 { above[kind] } else { totals[kind] }, ATTRIBUTES[kind]);
            return refuse(format!(
                "an index of one of {count} {name}, counted from 1, or backwards from -1"
            ));
        }
    }
    None
}
