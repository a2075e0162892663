//! Changes to a scene after it was loaded: another sensor, integrator or material by a text of Mitsuba XML, further shapes and lights,
//! and new vertices for a mesh.
//!
//! Edits are all or nothing. What they do not mention stays as it is, to the address of its buffers, so that what was built over it can be
//! kept.

use std::collections::HashMap;
use std::path::Path;

use thiserror::Error;

use super::mesh::{Placement, RawMesh};
use super::mitsuba::{self, MAX_BSDF_DEPTH, MAX_BSDF_PARTS};
use super::{LoadError, LoadOptions, Log, Warning};
use crate::scene::{Geometry, Material, MaterialId, MeshError, Scene, TriangleMesh, map_materials};

/// What edits need to know of a scene, and rendering does not.
#[derive(Debug, Clone, Default)]
pub struct Origins {
    /// Materials by the `id` of their BSDF.
    pub(super) materials: HashMap<String, MaterialId>,
    /// How each shape was placed if its mesh came from a file.
    pub(super) placements: Vec<Option<Placement>>,
}

/// Why a mesh was not replaced.
#[derive(Debug, Error, PartialEq)]
pub enum EditError {
    /// There is no such shape.
    #[error("there is no shape `{name}`; there are: {}", list(.known))]
    UnknownShape {
        /// The name asked for.
        name: String,
        /// Those there are.
        known: Vec<String>,
    },
    /// The shape has no vertices of its own.
    #[error("shape `{name}` does not come from a mesh file, or is one of several that do")]
    NotAMesh {
        /// The shape.
        name: String,
    },
    /// The mesh is not valid.
    #[error("shape `{name}`: {source}")]
    Mesh {
        /// The shape.
        name: String,
        /// Why.
        source: MeshError,
    },
}

/// The first of many names.
fn list(names: &[String]) -> String {
    const SHOWN: usize = 20;
    let more = if names.len() > SHOWN { ", ..." } else { "" };
    names[..names.len().min(SHOWN)].join(", ") + more
}

impl Origins {
    /// Of a file that is a mesh.
    pub(super) fn of_bare_mesh() -> Self {
        Self { placements: vec![Some(Placement::bare(false))], ..Self::default() }
    }

    /// Changes a scene by a Mitsuba scene in which everything is optional: its sensor and its integrator take the place of those there are, each
    /// BSDF the place of the one with its `id`, in all shapes; shapes, emitters, and BSDFs with an `id` that is new are added.
    ///
    /// # Errors
    /// As of [`load`](super::load), and if a shape's name or an environment is there already; then nothing is changed.
    pub fn edit(
        &mut self,
        scene: &mut Scene,
        text: &str,
        directory: &Path,
        options: &LoadOptions,
    ) -> Result<Vec<Warning>, LoadError> {
        let mut log = Log { lenient: options.lenient, ..Log::default() };
        mitsuba::edit(&mitsuba::Text::Memory(text, directory), options, scene, self, &mut log)?;
        Ok(log.warnings)
    }

    /// Gives the shape of that name, which came from a mesh file, other vertices and triangles, placed in the world as those were. Attributes of vertices
    /// and faces stay.
    ///
    /// # Errors
    /// Any [`EditError`]; then nothing is changed.
    pub fn set_mesh(&self, scene: &mut Scene, name: &str, mesh: RawMesh) -> Result<(), EditError> {
        let Some(index) = scene.shapes.iter().position(|shape| shape.name == name) else {
            let known = scene.shapes.iter().map(|shape| shape.name.clone()).collect();
            return Err(EditError::UnknownShape { name: name.to_owned(), known });
        };
        let (Some(Some(placement)), Geometry::Mesh(old)) =
            (self.placements.get(index), &mut scene.shapes[index].geometry)
        else {
            return Err(EditError::NotAMesh { name: name.to_owned() });
        };
        let attributes = old.attributes().to_vec();
        let new = mesh
            .place(placement)
            .and_then(|mesh| mesh.with_attributes(attributes))
            .map_err(|source| EditError::Mesh { name: name.to_owned(), source })?;
        let old = std::mem::replace(old, TriangleMesh::empty());
        scene.shapes[index].geometry = Geometry::Mesh(new.in_place_of(old));
        Ok(())
    }

    /// Puts materials in the place of others, and drops those that nothing is made of any more. `None` if some would be made of too many.
    pub(super) fn replace_materials(
        &mut self,
        scene: &mut Scene,
        replaced: &HashMap<MaterialId, MaterialId>,
    ) -> Option<()> {
        let mut copy =
            Copy { old: &scene.materials, replaced, new: Vec::new(), parts: Vec::new(), ids: HashMap::new() };
        for shape in &scene.shapes {
            copy.take(shape.material, 0)?;
            if let Geometry::Instance(instance) = &shape.geometry {
                for part in instance.group().shapes() {
                    copy.take(part.material, 0)?;
                }
            }
        }
        for id in self.materials.values() {
            copy.take(*id, 0)?;
        }
        let Copy { new, ids, .. } = copy;
        let now = |id: MaterialId| ids.get(&id).copied().unwrap_or(id);
        map_materials(&mut scene.shapes, now);
        for id in self.materials.values_mut() {
            *id = now(*id);
        }
        scene.materials = new;
        Some(())
    }
}

/// A list of materials on its way into another.
struct Copy<'a> {
    old: &'a [Material],
    replaced: &'a HashMap<MaterialId, MaterialId>,
    new: Vec<Material>,
    /// Of how many each of the new ones is made.
    parts: Vec<u32>,
    ids: HashMap<MaterialId, MaterialId>,
}

impl Copy<'_> {
    /// Copies a material after those that it is made of.
    fn take(&mut self, id: MaterialId, depth: usize) -> Option<MaterialId> {
        if let Some(known) = self.ids.get(&id) {
            return Some(*known);
        }
        let source = self.replaced.get(&id).copied().unwrap_or(id);
        let mut material = self.old.get(source.0 as usize)?.clone();
        if depth > MAX_BSDF_DEPTH {
            return None;
        }
        for part in material.parts_mut().into_iter().flatten() {
            *part = self.take(*part, depth + 1)?;
        }
        let parts = mitsuba::count_parts(&material, &self.parts);
        if parts > MAX_BSDF_PARTS {
            return None;
        }
        self.parts.push(parts);
        let new = super::push(&mut self.new, material);
        self.ids.insert(id, new);
        self.ids.insert(source, new);
        Some(new)
    }
}
