//! Triangle meshes, laid out so that Embree can share the buffers.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::{DMat3, Vec2, Vec3};
use thiserror::Error;

use super::Aabb;

/// Why a mesh was refused.
#[derive(Debug, Error, PartialEq)]
pub enum MeshError {
    /// A triangle names a vertex that is not there.
    #[error("triangle {triangle} uses vertex {index}, but there are {vertices} vertices")]
    IndexOutOfRange {
        /// Which triangle.
        triangle: usize,
        /// The index it uses.
        index: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A coordinate is NaN, infinite or beyond what ray queries accept.
    #[error("vertex {vertex} is at ({}, {}, {}): coordinates must be finite and below {limit:e} in magnitude", position.x, position.y, position.z, limit = TriangleMesh::COORDINATE_LIMIT)]
    BadVertex {
        /// Which vertex.
        vertex: usize,
        /// Where it is said to be.
        position: Vec3,
    },
    /// Normals or texture coordinates are neither absent nor one per vertex.
    #[error("{found} {what} for {vertices} vertices")]
    AttributeCount {
        /// `normals` or `texture coordinates`.
        what: &'static str,
        /// How many there are.
        found: usize,
        /// How many there should be.
        vertices: usize,
    },
    /// More vertices or triangles than 32-bit indices can name.
    #[error("{found} {what}: at most 2^31 - 1 are supported")]
    TooLarge {
        /// `vertices` or `triangles`.
        what: &'static str,
        /// How many there are.
        found: usize,
    },
}

/// Numbers on a mesh besides texture coordinates, such as colours of vertices, by name.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshAttribute {
    /// `vertex_...` or `face_...`, as Mitsuba names it.
    pub name: String,
    /// One value per triangle instead of one per vertex.
    pub per_face: bool,
    /// Numbers in a value, 1 to 4.
    pub channels: usize,
    /// The values one after the other.
    pub values: Vec<f32>,
}

impl MeshAttribute {
    /// The value of a vertex or triangle as a colour: that of one or two channels is grey.
    #[inline]
    fn color(&self, element: u32) -> Vec3 {
        let first = element as usize * self.channels;
        let values = &self.values[first..first + self.channels];
        if self.channels < 3 { Vec3::splat(values[0]) } else { Vec3::from_slice(values) }
    }

    /// The value on a triangle, at barycentric coordinates of its second and third corner.
    #[inline]
    pub(super) fn at(&self, mesh: &TriangleMesh, triangle: u32, [u, v]: [f32; 2]) -> Vec3 {
        if self.per_face {
            return self.color(triangle);
        }
        let [a, b, c] = mesh.triangles[triangle as usize].map(|i| self.color(i));
        a * (1.0 - u - v) + b * u + c * v
    }
}

/// Triangles with shared vertices in world space. Always valid: indices are in range and coordinates are finite.
#[derive(Debug, Clone)]
pub struct TriangleMesh {
    /// One vertex more than there are: Embree reads 16 bytes from each 12-byte position, the last one included.
    padded_positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    normals: Vec<Vec3>,
    uvs: Vec<Vec2>,
    attributes: Vec<MeshAttribute>,
    flip_normals: bool,
    bounds: Aabb,
    /// Of the positions; see [`revision`](Self::revision).
    revision: u64,
    /// Of the triangles; see [`topology`](Self::topology).
    topology: u64,
}

/// A number that was not given out before.
pub(super) fn next_revision() -> u64 {
    static LAST: AtomicU64 = AtomicU64::new(0);
    LAST.fetch_add(1, Ordering::Relaxed) + 1
}

impl TriangleMesh {
    /// Embree's bound on coordinates (`FLT_LARGE`), beyond which its results are undefined.
    pub const COORDINATE_LIMIT: f32 = 1.844e18;

    /// Checks and takes the buffers. `normals` (unit length or zero) and `uvs` hold one entry per vertex or none at all.
    /// Normals that say nothing beyond the triangles' own planes, as those of a box, are not kept.
    ///
    /// # Errors
    /// Any [`MeshError`]; see its variants.
    pub fn new(
        mut positions: Vec<Vec3>,
        triangles: Vec<[u32; 3]>,
        mut normals: Vec<Vec3>,
        uvs: Vec<Vec2>,
        mut flip_normals: bool,
    ) -> Result<Self, MeshError> {
        let vertices = positions.len();
        for (what, found) in [("vertices", vertices), ("triangles", triangles.len())] {
            if found >= i32::MAX as usize {
                return Err(MeshError::TooLarge { what, found });
            }
        }
        for (what, found) in [("normals", normals.len()), ("texture coordinates", uvs.len())] {
            if found != 0 && found != vertices {
                return Err(MeshError::AttributeCount { what, found, vertices });
            }
        }
        for (vertex, &position) in positions.iter().enumerate() {
            // Written so that NaN fails.
            if !position.abs().cmplt(Vec3::splat(Self::COORDINATE_LIMIT)).all() {
                return Err(MeshError::BadVertex { vertex, position });
            }
        }
        for (triangle, t) in triangles.iter().enumerate() {
            if let Some(&index) = t.iter().find(|&&i| i as usize >= vertices) {
                return Err(MeshError::IndexOutOfRange { triangle, index, vertices });
            }
        }
        if let Some(turned_over) = are_flat(&positions, &triangles, &normals) {
            normals = Vec::new();
            flip_normals ^= turned_over;
        }
        let bounds = triangles.iter().flatten().fold(Aabb::EMPTY, |b, &i| b.extend(positions[i as usize]));
        positions.reserve_exact(1);
        positions.push(Vec3::ZERO);
        Ok(Self {
            padded_positions: positions,
            triangles,
            normals,
            uvs,
            attributes: Vec::new(),
            flip_normals,
            bounds,
            revision: next_revision(),
            topology: next_revision(),
        })
    }

    /// Without vertices and triangles.
    pub(super) fn empty() -> Self {
        Self {
            padded_positions: vec![Vec3::ZERO],
            triangles: Vec::new(),
            normals: Vec::new(),
            uvs: Vec::new(),
            attributes: Vec::new(),
            flip_normals: false,
            bounds: Aabb::EMPTY,
            revision: 0,
            topology: 0,
        }
    }

    /// This mesh in the place of `old`. If both have the same triangles, the buffer of the old one is kept, and with it its
    /// [`topology`](Self::topology): a hierarchy over the old mesh can be refitted to this one.
    #[must_use]
    pub fn in_place_of(mut self, old: Self) -> Self {
        if self.triangles == old.triangles && self.positions().len() == old.positions().len() {
            self.triangles = old.triangles;
            self.topology = old.topology;
        }
        self
    }

    /// A number that stands for the positions: meshes that share it have the same, because a mesh never changes but for being replaced.
    pub fn revision(&self) -> u64 {
        self.revision
    }

    /// A number that stands for the triangles and the number of vertices, in the same way.
    pub fn topology(&self) -> u64 {
        self.topology
    }

    /// The mesh with further attributes.
    ///
    /// # Errors
    /// [`MeshError::AttributeCount`] if one has not as many numbers as its name, channels and the mesh ask for.
    pub fn with_attributes(mut self, attributes: Vec<MeshAttribute>) -> Result<Self, MeshError> {
        for a in &attributes {
            let elements = if a.per_face { self.triangles.len() } else { self.positions().len() };
            if !(1..=4).contains(&a.channels) || a.values.len() != elements * a.channels {
                let (found, vertices) = (a.values.len(), elements);
                return Err(MeshError::AttributeCount {
                    what: "numbers of a mesh attribute",
                    found,
                    vertices,
                });
            }
        }
        self.attributes = attributes;
        Ok(self)
    }

    /// The attribute of a name. A mesh has few, so that they are searched one by one.
    pub fn attribute(&self, name: &str) -> Option<&MeshAttribute> {
        self.attributes.iter().find(|a| a.name == name)
    }

    /// Further attributes in the order of the file.
    pub fn attributes(&self) -> &[MeshAttribute] {
        &self.attributes
    }

    /// World positions, one per vertex.
    #[inline]
    pub fn positions(&self) -> &[Vec3] {
        &self.padded_positions[..self.padded_positions.len() - 1]
    }

    /// The positions and one vertex more, so that 16 bytes can be read from each of the positions.
    #[cfg(feature = "embree")]
    pub(crate) fn padded_positions(&self) -> &[Vec3] {
        &self.padded_positions
    }

    /// Vertex indices, three per triangle, all in range.
    #[inline]
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Shading normals, one per vertex, or empty for a flat mesh.
    #[inline]
    pub fn normals(&self) -> &[Vec3] {
        &self.normals
    }

    /// Texture coordinates, one per vertex, or empty.
    #[inline]
    pub fn uvs(&self) -> &[Vec2] {
        &self.uvs
    }

    /// Whether normals are turned over; without it they point to the side from which a triangle's vertices run counter-clockwise.
    #[inline]
    pub fn flip_normals(&self) -> bool {
        self.flip_normals
    }

    /// The three corners of a triangle.
    #[inline]
    pub fn corners(&self, triangle: u32) -> [Vec3; 3] {
        self.triangles[triangle as usize].map(|i| self.padded_positions[i as usize])
    }

    /// World bounds of the vertices that triangles use.
    pub fn bounds(&self) -> Aabb {
        self.bounds
    }

    /// Bytes held by the buffers.
    pub fn memory(&self) -> usize {
        self.padded_positions.capacity() * size_of::<Vec3>()
            + self.triangles.capacity() * size_of::<[u32; 3]>()
            + self.normals.capacity() * size_of::<Vec3>()
            + self.uvs.capacity() * size_of::<Vec2>()
            + self.attributes.iter().map(|a| a.values.capacity() * size_of::<f32>()).sum::<usize>()
    }
}

/// Whether all normals are those of the triangles they are used by (`Some(false)`) or their opposites (`Some(true)`), to within
/// the rounding of unit vectors.
fn are_flat(positions: &[Vec3], triangles: &[[u32; 3]], normals: &[Vec3]) -> Option<bool> {
    const ROUNDING: f64 = 8.0 * f32::EPSILON as f64;
    let &[first, ..] = triangles else { return None };
    if normals.is_empty() {
        return None;
    }
    let flat = |t: [u32; 3]| {
        let [a, b, c] = t.map(|i| positions[i as usize].as_dvec3());
        (b - a).cross(c - a).normalize_or_zero()
    };
    let turned_over = flat(first).dot(normals[first[0] as usize].as_dvec3()) < 0.0;
    let sign = if turned_over { -1.0 } else { 1.0 };
    let is_flat = |&t: &[u32; 3]| {
        let n = flat(t) * sign;
        t.iter().all(|&i| normals[i as usize].as_dvec3().distance_squared(n) < ROUNDING * ROUNDING)
    };
    triangles.iter().all(is_flat).then_some(turned_over)
}

/// The inverse transpose up to a positive factor, from cofactors, so that it exists for singular maps too
/// (a rectangle scaled to nothing along its normal is still a rectangle).
pub(super) fn normal_matrix(m: &DMat3) -> DMat3 {
    let (x, y, z) = (m.x_axis, m.y_axis, m.z_axis);
    let sign = if m.determinant() < 0.0 { -1.0 } else { 1.0 };
    DMat3::from_cols(y.cross(z), z.cross(x), x.cross(y)) * sign
}
