//! The one pass over an OBJ file: attributes, faces and parts as the text lists them.
//!
//! Indices are checked when parts become meshes, so that faces may come before what they name. What is wrong with a line that is
//! refused is not worked out here but in `diagnose`.

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::str::SplitAsciiWhitespace;

use glam::{Vec2, Vec3};

use super::super::mesh::RawMesh;
use super::super::{Location, Log, mtl};

/// Characters of a name. Each part has its own copy.
const MAX_NAME: usize = 200;

/// A corner's index of an attribute that it does not have.
const MISSING: u32 = u32::MAX;
/// An index that no attribute can have.
const NOWHERE: u32 = u32::MAX - 1;

/// Indices of position, texture coordinates and normal, counted from 0.
type Corner = [u32; 3];

/// The lines of a text, counted; one that ends in `\` is joined with the next.
pub(super) struct Lines<'a> {
    rest: &'a str,
    /// Lines taken so far.
    pub(super) count: usize,
}

impl<'a> Lines<'a> {
    pub(super) fn new(text: &'a str) -> Self {
        Self { rest: text, count: 0 }
    }

    fn physical_line(&mut self) -> Option<&'a str> {
        if self.rest.is_empty() {
            return None;
        }
        let end = memchr::memchr(b'\n', self.rest.as_bytes()).unwrap_or(self.rest.len());
        let line = &self.rest[..end];
        self.rest = self.rest.get(end + 1..).unwrap_or_default();
        self.count += 1;
        Some(line)
    }
}

impl<'a> Iterator for Lines<'a> {
    type Item = Cow<'a, str>;

    fn next(&mut self) -> Option<Self::Item> {
        let mut line = Cow::Borrowed(self.physical_line()?);
        while line.trim_ascii_end().ends_with('\\') {
            let joined = line.to_mut();
            joined.truncate(joined.trim_ascii_end().len() - 1);
            joined.push(' ');
            joined.push_str(self.physical_line().unwrap_or_default());
        }
        Some(line)
    }
}

/// Faces with one name and one material.
struct Part {
    name: String,
    material: Option<usize>,
    faces: usize,
}

/// A part of the file as a mesh, if it has faces.
pub(super) struct Group {
    pub(super) name: String,
    /// Index of the material in the libraries.
    pub(super) material: Option<usize>,
    pub(super) mesh: RawMesh,
}

/// A file as it was written.
#[derive(Default)]
pub(super) struct Obj {
    positions: Vec<Vec3>,
    uvs: Vec<Vec2>,
    normals: Vec<Vec3>,
    /// Of all faces, one after the other.
    corners: Vec<Corner>,
    /// Number of corners of each face, 3 or more.
    sizes: Vec<u32>,
    parts: Vec<Part>,
    /// Of all libraries.
    pub(super) materials: Vec<tobj::Material>,
}

impl Obj {
    /// Reads the text; `None` if a line is malformed. Unless `grouped`, names and materials are of no concern.
    pub(super) fn parse(path: &Path, text: &str, grouped: bool, log: &mut Log) -> Option<Self> {
        let mut obj = Self::default();
        let mut names: HashMap<String, usize> = HashMap::new();
        let (mut name, mut material) = ("unnamed".to_owned(), None);
        let mut libraries = HashSet::new();
        let mut ended = 0;
        for line in Lines::new(text) {
            let mut words = line.split_ascii_whitespace();
            match words.next() {
                Some("v") => obj.positions.push(vector(&mut words)?),
                Some("vn") => obj.normals.push(vector(&mut words)?),
                Some("vt") => {
                    let u = number(words.next())?;
                    let v = words.next().map_or(Some(0.0), |word| number(Some(word)))?;
                    obj.uvs.push(Vec2::new(u, v));
                }
                Some("f") => obj.face(words)?,
                Some(keyword @ ("g" | "o" | "usemtl" | "mtllib")) if grouped => {
                    let rest = line.trim()[keyword.len()..].trim();
                    let before = (name.clone(), material);
                    match keyword {
                        "usemtl" => material = names.get(rest).copied(),
                        "mtllib" => {
                            obj.add_library(mtl::load(path, rest, &mut libraries, log), &mut names);
                        }
                        _ if rest.is_empty() => "unnamed".clone_into(&mut name),
                        _ => name = rest.chars().take(MAX_NAME).collect(),
                    }
                    // A name begins a part even if it is that of the part before.
                    if matches!(keyword, "g" | "o") || material != before.1 {
                        obj.end_part(before, &mut ended);
                    }
                }
                _ => {}
            }
        }
        obj.end_part((name, material), &mut ended);
        Some(obj)
    }

    /// Makes the faces since the last part one of this name and material.
    fn end_part(&mut self, (name, material): (String, Option<usize>), ended: &mut usize) {
        let faces = self.sizes.len() - *ended;
        if faces > 0 {
            self.parts.push(Part { name, material, faces });
            *ended = self.sizes.len();
        }
    }

    /// Adds the materials of a library; a later one of the same name takes the place of an earlier.
    fn add_library(&mut self, library: tobj::MTLLoadResult, names: &mut HashMap<String, usize>) {
        let Ok((mut materials, by_name)) = library else { return };
        let first = self.materials.len();
        names.extend(by_name.into_iter().map(|(name, index)| (name, first + index)));
        self.materials.append(&mut materials);
    }

    fn face(&mut self, words: SplitAsciiWhitespace) -> Option<()> {
        let first = self.corners.len();
        for word in words {
            let corner = self.corner(word)?;
            self.corners.push(corner);
        }
        match self.corners.len() - first {
            // Points and lines.
            0..3 => self.corners.truncate(first),
            size => self.sizes.push(u32::try_from(size).ok()?),
        }
        Some(())
    }

    fn corner(&self, word: &str) -> Option<Corner> {
        let above = [self.positions.len(), self.uvs.len(), self.normals.len()];
        let mut corner = [MISSING; 3];
        for (kind, part) in word.as_bytes().split(|&b| b == b'/').enumerate() {
            if part.is_empty() {
                continue;
            }
            let index = integer(part)?;
            let from_0 = match index {
                1.. => index - 1,
                0 => i64::from(MISSING),
                _ => index.checked_add(*above.get(kind)? as i64)?,
            };
            *corner.get_mut(kind)? = match u32::try_from(from_0) {
                Ok(MISSING) if index == 0 => MISSING,
                Ok(i) if i < NOWHERE => i,
                _ => NOWHERE,
            };
        }
        Some(corner)
    }

    /// The parts as meshes of their own; `None` if a corner names what is not there.
    pub(super) fn groups(&mut self, path: &Path, log: &mut Log) -> Option<Vec<Group>> {
        let mut vertices =
            Vertices { of: vec![[0; 2]; self.positions.len()], others: HashMap::new(), part: 0 };
        let (mut corners, mut sizes) = (&self.corners[..], &self.sizes[..]);
        let mut groups = Vec::new();
        for Part { name, material, faces } in std::mem::take(&mut self.parts) {
            let (these, later) = sizes.split_at(faces);
            let (mine, others) = corners.split_at(these.iter().map(|&n| n as usize).sum());
            (corners, sizes) = (others, later);
            let mesh = self.mesh(&name, mine, these, &mut vertices, path, log)?;
            groups.push(Group { name, material, mesh });
        }
        Some(groups)
    }

    fn mesh(
        &self,
        name: &str,
        corners: &[Corner],
        sizes: &[u32],
        vertices: &mut Vertices,
        path: &Path,
        log: &mut Log,
    ) -> Option<RawMesh> {
        let (indices, keys) = vertices.number(corners)?;
        let mut mesh = RawMesh {
            positions: keys.iter().map(|k| self.positions[k[0] as usize]).collect(),
            uvs: gather(&keys, 1, &self.uvs)?,
            normals: gather(&keys, 2, &self.normals)?,
            triangles: Vec::with_capacity(indices.len() - 2 * sizes.len()),
            attributes: Vec::new(),
        };
        for (kind, what, instead) in [
            (1, "texture coordinates", "which are 0 there"),
            (2, "normals", "and are smooth there, flat in a bare mesh"),
        ] {
            let missing = keys.iter().filter(|k| k[kind] == MISSING).count();
            if missing > 0 && missing < keys.len() {
                log.warn(Location::file(path), format!("`{name}`: some faces lack {what}, {instead}"));
            }
        }
        let bad = mesh.count_bad_attributes();
        if bad > 0 {
            log.warn(
                Location::file(path),
                format!("`{name}`: {bad} normals or texture coordinates are not finite"),
            );
        }
        let mut rest = &indices[..];
        for &size in sizes {
            let (face, after) = rest.split_at(size as usize);
            match *face {
                [a, b, c] => mesh.triangles.push([a, b, c]),
                _ => mesh.push_polygon(face),
            }
            rest = after;
        }
        Some(mesh)
    }
}

/// The attribute of each vertex, or none if no vertex has it; `None` if one is not there. In files without the attribute indices
/// of it mean nothing.
fn gather<T: Copy + Default>(keys: &[Corner], kind: usize, values: &[T]) -> Option<Vec<T>> {
    if values.is_empty() || keys.iter().all(|k| k[kind] == MISSING) {
        return Some(Vec::new());
    }
    let value = |k: &Corner| match k[kind] {
        MISSING => Some(T::default()),
        index => values.get(index as usize).copied(),
    };
    keys.iter().map(value).collect()
}

/// Numbers the vertices of parts, which are corners without repetition.
struct Vertices {
    /// Of each position, the part that used it last (counted from 1) and its first vertex there.
    of: Vec<[u32; 2]>,
    /// Vertices of the part whose positions had others before, as seams have.
    others: HashMap<Corner, u32>,
    part: u32,
}

impl Vertices {
    /// A vertex for each corner of the next part, and the corner for each vertex; `None` if a position is not there.
    fn number(&mut self, corners: &[Corner]) -> Option<(Vec<u32>, Vec<Corner>)> {
        self.part += 1;
        // Not cleared, which would take as long as the largest part did.
        self.others = HashMap::new();
        let mut keys: Vec<Corner> = Vec::new();
        let mut indices = Vec::with_capacity(corners.len());
        for corner in corners {
            let [part, first] = self.of.get_mut(corner[0] as usize)?;
            let new = keys.len() as u32;
            let vertex = if *part != self.part {
                (*part, *first) = (self.part, new);
                new
            } else if keys[*first as usize] == *corner {
                *first
            } else {
                *self.others.entry(*corner).or_insert(new)
            };
            if vertex == new {
                keys.push(*corner);
            }
            indices.push(vertex);
        }
        Some((indices, keys))
    }
}

/// An integer of less than 2^63 in size, as [`str::parse`] takes it. Corners are most of what large files hold, and are read by this in half the time.
fn integer(text: &[u8]) -> Option<i64> {
    let (is_negative, digits) = match text {
        [b'-', digits @ ..] => (true, digits),
        [b'+', digits @ ..] | digits => (false, digits),
    };
    let add = |sum: i64, digit: &u8| {
        let digit = digit.checked_sub(b'0').filter(|digit| *digit < 10)?;
        sum.checked_mul(10)?.checked_add(i64::from(digit))
    };
    let value = digits.iter().try_fold(0, add).filter(|_| !digits.is_empty())?;
    Some(if is_negative { -value } else { value })
}

fn number(word: Option<&str>) -> Option<f32> {
    word?.parse().ok()
}

fn vector(words: &mut SplitAsciiWhitespace) -> Option<Vec3> {
    Some(Vec3::new(number(words.next())?, number(words.next())?, number(words.next())?))
}
