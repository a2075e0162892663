//! What a mesh file holds, before it is placed in the world; shared by all mesh formats.

use glam::{DAffine3, DVec3, Vec2, Vec3};

use super::polygon;
use crate::scene::mesh::normal_matrix;
use crate::scene::{MeshAttribute, MeshError, TriangleMesh};

/// Vertices and triangles as a file lists them. Nothing is checked yet; [`place`](Self::place) does.
#[derive(Debug, Default)]
pub(super) struct RawMesh {
    pub(super) positions: Vec<Vec3>,
    /// One per vertex, of any length, or none at all.
    pub(super) normals: Vec<Vec3>,
    /// One per vertex or none at all.
    pub(super) uvs: Vec<Vec2>,
    pub(super) triangles: Vec<[u32; 3]>,
    pub(super) attributes: Vec<MeshAttribute>,
}

/// What becomes of normals that are missing from the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Normals {
    /// The file's, else flat.
    Given,
    /// The file's, else smooth (Mitsuba's default).
    GivenOrSmooth,
    /// Flat, even if the file has normals (Mitsuba's `face_normals`).
    Flat,
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
        if normals == Normals::Flat {
            self.normals.clear();
        }
        let normal_to_world = normal_matrix(&to_world.matrix3);
        for n in &mut self.normals {
            *n = (normal_to_world * n.as_dvec3()).normalize_or_zero().as_vec3();
        }
        for value in self.attributes.iter_mut().flat_map(|a| &mut a.values).filter(|v| !v.is_finite()) {
            *value = 0.0;
        }
        if normals == Normals::GivenOrSmooth && self.normals.is_empty() {
            self.normals = smooth_normals(&self.positions, &self.triangles);
        }
        for uv in &mut self.uvs {
            let flipped = if flip_v { Vec2::new(uv.x, 1.0 - uv.y) } else { *uv };
            *uv = if flipped.is_finite() { flipped } else { Vec2::ZERO };
        }
        TriangleMesh::new(self.positions, self.triangles, self.normals, self.uvs, flip_normals)?
            .with_attributes(self.attributes)
    }
}

/// Normals of vertices as the mean of their triangles' normals, weighted by angle (Thuermer and Wuethrich 1998,
/// "Computing vertex normals from polygonal facets"), as Mitsuba computes them.
fn smooth_normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
    let mut sums = vec![DVec3::ZERO; positions.len()];
    for t in triangles {
        // Indices out of range are reported when the mesh is built.
        let [Some(&a), Some(&b), Some(&c)] = t.map(|i| positions.get(i as usize)) else { continue };
        let corners = [a, b, c].map(Vec3::as_dvec3);
        let Some(normal) = (corners[1] - corners[0]).cross(corners[2] - corners[0]).try_normalize() else {
            continue;
        };
        for k in 0..3 {
            let (p, q, r) = (corners[k], corners[(k + 1) % 3], corners[(k + 2) % 3]);
            sums[t[k] as usize] += normal * (q - p).angle_between(r - p);
        }
    }
    sums.into_iter().map(|n| n.normalize_or_zero().as_vec3()).collect()
}
