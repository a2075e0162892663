//! Wavefront OBJ, and with it the materials of its MTL libraries.
//!
//! `parse` reads the file in one pass; `diagnose` finds the line of an error. Materials are `tobj`'s, which parses the libraries
//! (`mtl`); its OBJ half took six times as long as Mitsuba's loader. See `vendor-notes/loaders.md`.

mod diagnose;
mod parse;

use std::borrow::Cow;
use std::path::Path;

use super::mesh::Placement;
use super::{GREY, LoadError, Location, Log, mesh_scene, mtl, push_two_sided};
use crate::scene::{Geometry, MeshError, Scene, Shape};
use diagnose::diagnose;
use parse::{Group, Obj};

/// Loads the file as a scene: a shape per group and material, materials from MTL.
pub(super) fn load_scene(path: &Path, log: &mut Log) -> Result<Scene, LoadError> {
    let bytes = log.read(path, None)?;
    let text = text(path, &bytes)?;
    let (groups, library) = read(path, &text, true, log)?;
    let mut translator = mtl::Translator::new(path);
    let translated: Vec<_> = library.iter().map(|m| translator.translate(m, log)).collect();
    let mtl::Translator { mut materials, textures, .. } = translator;
    let mut grey = None;
    let mut shapes = Vec::new();
    for group in groups {
        let geometry = group.mesh.place(&Placement::bare(true));
        let geometry = geometry.map_err(|e| mesh_error(path, &text, &group.name, &e))?;
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
    let text = text(path, &bytes)?;
    let (groups, _) = read(path, &text, false, log)?;
    let mesh = groups.into_iter().next().map(|g| g.mesh).unwrap_or_default();
    mesh.place(placement).map(Geometry::Mesh).map_err(|e| mesh_error(path, &text, "mesh", &e))
}

fn mesh_error(path: &Path, text: &str, group: &str, error: &MeshError) -> LoadError {
    diagnose(path, text, || {
        LoadError::new(Location::file(path), format!("in `{group}`, {error}"), "a valid mesh")
    })
}

/// The file as text; what is not UTF-8 in it is replaced.
fn text<'a>(path: &Path, bytes: &'a [u8]) -> Result<Cow<'a, str>, LoadError> {
    if bytes.starts_with(&[0xff, 0xfe]) || bytes.starts_with(&[0xfe, 0xff]) {
        return Err(LoadError::new(Location::file(path), "UTF-16 text", "an OBJ file in ASCII or UTF-8"));
    }
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    // To check is much faster than to replace.
    Ok(std::str::from_utf8(bytes).map_or_else(|_| String::from_utf8_lossy(bytes), Cow::Borrowed))
}

/// The parts that have faces, and the materials they refer to by index.
fn read(
    path: &Path,
    text: &str,
    grouped: bool,
    log: &mut Log,
) -> Result<(Vec<Group>, Vec<tobj::Material>), LoadError> {
    let invalid = || LoadError::new(Location::file(path), "malformed lines", "valid Wavefront OBJ");
    let refuse = || diagnose(path, text, invalid);
    let mut obj = Obj::parse(path, text, grouped, log).ok_or_else(refuse)?;
    let groups = obj.groups(path, log).ok_or_else(refuse)?;
    if groups.is_empty() {
        return Err(LoadError::new(
            Location::file(path),
            "a file without faces",
            "at least one line `f ...`",
        ));
    }
    Ok((groups, obj.materials))
}
