//! What a mesh file holds, before it is placed in the world; shared by all mesh formats.

use glam::{DAffine3, Vec2, Vec3};

use super::{polygon, smooth};
use crate::scene::mesh::normal_matrix;
use crate::scene::{MeshAttribute, MeshError, TriangleMesh};

/// Vertices and triangles as a file lists them, or as a program hands them over. Nothing is checked yet; placing it in the world does.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RawMesh {
    /// In the mesh's own space.
    pub positions: Vec<Vec3>,
    /// One per vertex, of any length, or none at all.
    pub normals: Vec<Vec3>,
    /// Texture coordinates, one per vertex or none at all.
    pub uvs: Vec<Vec2>,
    /// Vertex indices.
    pub triangles: Vec<[u32; 3]>,
    /// Further numbers on vertices or triangles.
    pub attributes: Vec<MeshAttribute>,
}

/// What becomes of normals that are missing from the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Normals {
    /// The file's, else flat.
    Given,
    /// The file's, else smooth (Mitsuba's default); where it has some, smooth where they are missing or zero.
    GivenOrSmooth,
    /// Flat, even if the file has normals (Mitsuba's `face_normals`).
    Flat,
    /// Smooth but for creases, even if the file has normals: between triangles whose planes make a greater angle than this, in radians
    /// (Mitsuba 0.6's `maxSmoothAngle`).
    Creased(f64),
}

/// How a mesh file becomes a shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Placement {
    pub(super) to_world: DAffine3,
    pub(super) normals: Normals,
    pub(super) flip_normals: bool,
    /// Texture coordinates (u, v) become (u, 1 - v).
    pub(super) flip_v: bool,
}

impl Placement {
    /// Of a bare mesh file: as it is.
    pub(super) fn bare(flip_v: bool) -> Self {
        Self { to_world: DAffine3::IDENTITY, normals: Normals::Given, flip_normals: false, flip_v }
    }
}

impl RawMesh {
    /// Adds the triangles of a polygon of vertices that are known already; see [`polygon::triangulate`].
    pub(super) fn push_polygon(&mut self, corners: &[u32]) {
        polygon::triangulate(corners, &self.positions, &mut self.triangles);
    }

    /// Number of texture coordinates, normals and numbers of attributes that are not finite; [`place`](Self::place) makes them zero.
    pub(super) fn count_bad_attributes(&self) -> usize {
        self.normals.iter().filter(|n| !n.is_finite()).count()
            + self.uvs.iter().filter(|t| !t.is_finite()).count()
            + self.attributes.iter().flat_map(|a| &a.values).filter(|v| !v.is_finite()).count()
    }

    /// The mesh in world space.
    pub(super) fn place(mut self, placement: &Placement) -> Result<TriangleMesh, MeshError> {
        let Placement { to_world, normals, flip_normals, flip_v } = *placement;
        // The identity is exact, but positions of 1e30 would overflow in its sums.
        if to_world != DAffine3::IDENTITY {
            for p in &mut self.positions {
                *p = to_world.transform_point3(p.as_dvec3()).as_vec3();
            }
        }
        if matches!(normals, Normals::Flat | Normals::Creased(_)) {
            self.normals.clear();
        }
        if let Normals::Creased(angle) = normals {
            smooth::split_creases(&mut self, angle);
        }
        let normal_to_world = normal_matrix(&to_world.matrix3);
        for n in &mut self.normals {
            *n = (normal_to_world * n.as_dvec3()).normalize_or_zero().as_vec3();
        }
        for value in self.attributes.iter_mut().flat_map(|a| &mut a.values).filter(|v| !v.is_finite()) {
            *value = 0.0;
        }
        match normals {
            Normals::Creased(_) => self.normals = smooth::normals(&self.positions, &self.triangles),
            Normals::GivenOrSmooth if self.normals.is_empty() => {
                self.normals = smooth::normals(&self.positions, &self.triangles);
            }
            Normals::GivenOrSmooth if self.normals.contains(&Vec3::ZERO) => {
                let smooth = smooth::normals(&self.positions, &self.triangles);
                for (n, smooth) in self.normals.iter_mut().zip(smooth) {
                    *n = if *n == Vec3::ZERO { smooth } else { *n };
                }
            }
            _ => {}
        }
        for uv in &mut self.uvs {
            let flipped = if flip_v { Vec2::new(uv.x, 1.0 - uv.y) } else { *uv };
            *uv = if flipped.is_finite() { flipped } else { Vec2::ZERO };
        }
        TriangleMesh::new(self.positions, self.triangles, self.normals, self.uvs, flip_normals)?
            .with_attributes(self.attributes)
    }
}
