//! PLY (ASCII and binary of both byte orders) through `ply-rs-bw`.
//!
//! Elements are read one by one and converted at once: the crate's own way, a struct per element in one vector, takes
//! several times the memory. Vertex positions, normals and texture coordinates are used, and faces; numbered
//! properties of either are kept as attributes; other elements and properties are skipped.

use std::collections::HashMap;
use std::io::{BufRead, Cursor, ErrorKind};
use std::path::Path;

use glam::{Vec2, Vec3};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Header, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};

use super::error::abridged;
use super::mesh::{Placement, RawMesh};
use super::{GREY, LoadError, Location, Log, mesh_scene, push_two_sided};
use crate::scene::{Geometry, MeshAttribute, MeshError, Scene, Shape};

/// Loads the file as a scene of one grey shape.
pub(super) fn load_scene(path: &Path, log: &mut Log) -> Result<Scene, LoadError> {
    let bytes = log.read(path, None)?;
    let geometry = load(path, &bytes, &Placement::bare(false), log)?;
    let mut materials = Vec::new();
    let material = push_two_sided(&mut materials, GREY);
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok(mesh_scene(path, vec![Shape { name, geometry, material, emission: None }], materials, Vec::new(), log))
}

/// Loads the file as a mesh.
pub(super) fn load_mesh(
    path: &Path,
    from: &Location,
    placement: &Placement,
    log: &mut Log,
) -> Result<Geometry, LoadError> {
    let bytes = log.read(path, Some(from))?;
    load(path, &bytes, placement, log)
}

fn load(path: &Path, bytes: &[u8], placement: &Placement, log: &mut Log) -> Result<Geometry, LoadError> {
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = Parser::<Vertex>::new().read_header(&mut reader);
    let header = header.map_err(|e| {
        let location = e.line().map_or_else(|| Location::file(path), |line| Location::line(path, line));
        LoadError::new(location, one_line(&e), "a PLY header")
    })?;
    let line = reader.line();
    let mut body = Body { path, cursor: reader.into_inner(), encoding: header.encoding, line };
    check_header(path, &header)?;
    let mut mesh = RawMesh::default();
    let mut first_vertex = None;
    let mut first_face = None;
    for element in header.elements.values() {
        let at = body.here();
        match element.name.as_str() {
            "vertex" => {
                first_vertex = Some(at);
                read_vertices(&mut body, element, &mut mesh)?;
            }
            "face" => {
                first_face = Some(at);
                read_faces(&mut body, element, &mut mesh)?;
            }
            _ => body.each::<Skipped>(element, |_, _| Ok(()))?,
        }
    }
    if mesh.triangles.is_empty() {
        return Err(LoadError::new(Location::file(path), "no face of three corners or more", "a mesh"));
    }
    let bad = mesh.count_bad_attributes();
    if bad > 0 {
        log.warn(Location::file(path), format!("{bad} normals or texture coordinates are not finite"));
    }
    mesh.place(placement).map(Geometry::Mesh).map_err(|e| {
        let location = match &e {
            MeshError::BadVertex { vertex, .. } => body.element_location(first_vertex, *vertex),
            // Polygons make triangles and faces differ in number; the first face is all that is known.
            MeshError::IndexOutOfRange { .. } => body.element_location(first_face, 0),
            _ => Location::file(path),
        };
        LoadError::new(location, e.to_string(), "a valid mesh")
    })
}

/// Refuses what has no vertices, no faces or no positions before a payload is read.
fn check_header(path: &Path, header: &Header) -> Result<(), LoadError> {
    let mut names = header.elements.values().flat_map(|e| e.properties.keys().chain([&e.name]));
    if let Some(name) = names.find(|name| name.len() > MAX_NAME) {
        let found = format!("a name of {} bytes", name.len());
        return Err(LoadError::new(Location::file(path), found, format!("at most {MAX_NAME}")));
    }
    let names: Vec<String> =
        header.elements.values().take(8).map(|e| format!("{} {}", e.count, e.name)).collect();
    let missing = |expected: &str| {
        Err(LoadError::new(
            Location::file(path),
            format!("a PLY file with elements [{}]", abridged(&names.join(", "))),
            expected,
        ))
    };
    let Some(vertex) = header.elements.get("vertex").filter(|e| e.count > 0) else {
        return missing("an element `vertex`");
    };
    if !["x", "y", "z"].iter().all(|p| vertex.properties.contains_key(*p)) {
        return missing("vertex properties x, y and z");
    }
    match header.elements.get("face").filter(|e| e.count > 0) {
        None => missing("an element `face` (point clouds are not supported)"),
        Some(face) if !INDEX_LISTS.iter().any(|p| face.properties.contains_key(*p)) => {
            missing("a face property `vertex_indices` or `vertex_index`")
        }
        Some(_) => Ok(()),
    }
}

/// What is left of the file after the header.
struct Body<'a> {
    path: &'a Path,
    cursor: Cursor<&'a [u8]>,
    encoding: Encoding,
    /// Of the next element, if the file is text.
    line: usize,
}

impl Body<'_> {
    /// Where the next element is: a line, or an offset in a binary file.
    fn here(&self) -> u64 {
        if self.encoding == Encoding::Ascii { self.line as u64 } else { self.cursor.position() }
    }

    fn location(&self, at: u64) -> Location {
        if self.encoding == Encoding::Ascii {
            Location::line(self.path, at as usize)
        } else {
            Location::byte(self.path, at)
        }
    }

    /// Where element `index` of those that start at `first` is; elements of binary files need not be of equal size.
    fn element_location(&self, first: Option<u64>, index: usize) -> Location {
        let within = if self.encoding == Encoding::Ascii { index as u64 } else { 0 };
        first.map_or_else(|| Location::file(self.path), |f| self.location(f + within))
    }

    /// Reads all elements of a kind and hands each to `take`, which may say why it refuses it.
    fn each<E: PropertyAccess>(
        &mut self,
        element: &ElementDef,
        mut take: impl FnMut(usize, E) -> Result<(), String>,
    ) -> Result<(), LoadError> {
        // Elements without properties take no bytes, so that their number is not bounded by the file's size.
        if element.properties.is_empty() {
            return Ok(());
        }
        let parser = Parser::<E>::new();
        let mut text = String::new();
        for index in 0..element.count {
            let at = self.here();
            let expected = || format!("{} `{}` of {}", element.name, index + 1, element.count);
            let read = match self.encoding {
                Encoding::Ascii => {
                    text.clear();
                    self.line += 1;
                    let length = self.cursor.read_line(&mut text);
                    if length.is_ok_and(|n| n == 0) {
                        return Err(LoadError::new(self.location(at), "the end of the file", expected()));
                    }
                    parser.read_ascii_element(&text, element)
                }
                Encoding::BinaryLittleEndian => parser.read_little_endian_element(&mut self.cursor, element),
                Encoding::BinaryBigEndian => parser.read_big_endian_element(&mut self.cursor, element),
            };
            let refuse = |found: String| Err(LoadError::new(self.location(at), found, expected()));
            match read.map(|e| take(index, e)) {
                Ok(Ok(())) => {}
                Ok(Err(why)) => return refuse(why),
                Err(e) if e.kind() == ErrorKind::UnexpectedEof => {
                    return refuse("the end of the file".to_owned());
                }
                Err(e) => return refuse(one_line(&e)),
            }
        }
        Ok(())
    }
}

/// A run of properties that together are an attribute, as Mitsuba names them: `color_0` to `color_2`, or with x, y, z or r, g, b for the digits,
/// make `vertex_color`; r, g and b by themselves too.
struct AttributeFields {
    name: String,
    /// Which of the element's [`Extra`] values.
    fields: Vec<usize>,
    /// Bytes stand for 0 to 1.
    factors: Vec<f32>,
}

/// The attribute that a property is a part of.
fn attribute_name(property: &str) -> Option<&str> {
    const DIGITS: [&str; 4] = ["0123", "1234", "xyzw", "rgba"];
    match property {
        "r" | "g" | "b" => Some("color"),
        _ => property
            .rsplit_once('_')
            .filter(|(_, digit)| digit.len() == 1 && DIGITS.iter().any(|d| d.contains(digit)))
            .map(|(name, _)| name),
    }
}

/// The runs of properties that are attributes of an element.
fn attribute_fields(element: &ElementDef, prefix: &str) -> Vec<AttributeFields> {
    let mut found: Vec<AttributeFields> = Vec::new();
    let mut index: HashMap<&str, usize> = HashMap::new();
    let mut position = 0;
    for (field, property) in &element.properties {
        let PropertyType::Scalar(scalar) = &property.data_type else { continue };
        let Some(name) = attribute_name(field) else { continue };
        let factor = if matches!(scalar, ScalarType::UChar) { 1.0 / 255.0 } else { 1.0 };
        let at = *index.entry(name).or_insert(found.len());
        if at == found.len() {
            found.push(AttributeFields {
                name: format!("{prefix}_{name}"),
                fields: Vec::new(),
                factors: Vec::new(),
            });
        }
        if found[at].fields.len() < 4 {
            found[at].fields.push(position);
            found[at].factors.push(factor);
        }
        position += 1;
    }
    found
}

/// Values of all properties of one element that are parts of attributes, in the order of the header.
#[derive(Default)]
struct Extra(Vec<f32>);

impl Extra {
    fn set(&mut self, name: &str, property: &Property) -> PropertyAccessResult {
        match property.to_f32_lossy().filter(|_| attribute_name(name).is_some()) {
            Some(value) => {
                self.0.push(value);
                PropertyAccessResult::Set
            }
            None => PropertyAccessResult::Ignored,
        }
    }

    /// Appends the values, `times` times, to those of the elements before.
    fn append(&self, attributes: &mut [(AttributeFields, MeshAttribute)], times: usize) {
        for (AttributeFields { fields, factors, .. }, attribute) in attributes {
            for _ in 0..times {
                let value = |(&i, factor): (&usize, &f32)| self.0.get(i).map_or(0.0, |v| v * factor);
                let values = fields.iter().zip(factors.iter()).map(value);
                attribute.values.extend(values);
            }
        }
    }
}

/// The attributes of an element, as yet without values.
fn attributes(element: &ElementDef, prefix: &str) -> Vec<(AttributeFields, MeshAttribute)> {
    let empty = |fields: AttributeFields| {
        let attribute = MeshAttribute {
            name: fields.name.clone(),
            per_face: prefix == "face",
            channels: fields.fields.len(),
            values: Vec::new(),
        };
        (fields, attribute)
    };
    attribute_fields(element, prefix).into_iter().map(empty).collect()
}

fn read_vertices(body: &mut Body, element: &ElementDef, mesh: &mut RawMesh) -> Result<(), LoadError> {
    let has = |names: [&str; 2]| names.iter().all(|n| element.properties.contains_key(*n));
    let normals = has(["nx", "ny"]) && element.properties.contains_key("nz");
    let uvs = has(["u", "v"]) || has(["s", "t"]) || has(["texture_u", "texture_v"]);
    let mut attributes = attributes(element, "vertex");
    body.each::<Vertex>(element, |_, vertex| {
        vertex.extra.append(&mut attributes, 1);
        mesh.positions.push(vertex.position);
        if normals {
            mesh.normals.push(vertex.normal);
        }
        if uvs {
            mesh.uvs.push(vertex.uv);
        }
        Ok(())
    })?;
    mesh.attributes.extend(attributes.into_iter().map(|(_, attribute)| attribute));
    Ok(())
}

fn read_faces(body: &mut Body, element: &ElementDef, mesh: &mut RawMesh) -> Result<(), LoadError> {
    // Where faces come before the vertices, the mesh as a whole is checked later.
    let vertices = if mesh.positions.is_empty() { usize::MAX } else { mesh.positions.len() };
    let mut attributes = attributes(element, "face");
    body.each::<Face>(element, |_, face| {
        if face.invalid {
            return Err("a vertex index that is negative or not whole".to_owned());
        }
        if let Some(index) = face.corners.iter().find(|&&i| i as usize >= vertices) {
            return Err(format!("vertex index {index} of {vertices} vertices"));
        }
        let before = mesh.triangles.len();
        mesh.push_polygon(&face.corners);
        face.extra.append(&mut attributes, mesh.triangles.len() - before);
        Ok(())
    })?;
    mesh.attributes.extend(attributes.into_iter().map(|(_, attribute)| attribute));
    Ok(())
}

/// The crate's messages quote input and span lines; only their first line says what is wrong.
fn one_line(error: &ParseError) -> String {
    let text = error.to_string();
    let message = text.lines().next().unwrap_or_default().trim_end_matches('.');
    let message =
        message.split_once(": ").filter(|(head, _)| head.starts_with("Line ")).map_or(message, |(_, m)| m);
    message.chars().take(120).collect()
}

/// Bytes of a name in the header. Names are looked at for each element.
const MAX_NAME: usize = 200;

/// Names under which programs store the corners of a face.
const INDEX_LISTS: [&str; 2] = ["vertex_indices", "vertex_index"];

#[derive(Default)]
struct Vertex {
    position: Vec3,
    normal: Vec3,
    uv: Vec2,
    extra: Extra,
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let field = match name {
            "x" => &mut self.position.x,
            "y" => &mut self.position.y,
            "z" => &mut self.position.z,
            "nx" => &mut self.normal.x,
            "ny" => &mut self.normal.y,
            "nz" => &mut self.normal.z,
            "u" | "s" | "texture_u" => &mut self.uv.x,
            "v" | "t" | "texture_v" => &mut self.uv.y,
            _ => return self.extra.set(name, &property),
        };
        let Some(value) = property.to_f32_lossy() else { return PropertyAccessResult::Ignored };
        *field = value;
        PropertyAccessResult::Set
    }
}

#[derive(Default)]
struct Face {
    corners: Vec<u32>,
    /// An index is negative or not whole.
    invalid: bool,
    extra: Extra,
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self::default()
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !INDEX_LISTS.contains(&name) {
            return self.extra.set(name, &property);
        }
        match property {
            Property::ListUInt(list) => self.corners = list,
            Property::ListInt(list) => {
                self.invalid = list.iter().any(|&i| i < 0);
                // In place: both types have the same size.
                self.corners = list.into_iter().map(|i| i as u32).collect();
            }
            other => match other.to_u32_list() {
                Some(list) => self.corners = list,
                None => self.invalid = true,
            },
        }
        PropertyAccessResult::Set
    }
}

/// An element of no interest.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}
