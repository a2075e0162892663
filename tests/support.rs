//! What several subjects need: random numbers, meshes, shapes.

use glam::{DVec3, Vec3};
use helmholtz::scene::{AnalyticShape, Geometry, MaterialId, Shape, TriangleMesh};
pub(crate) use helmholtz::selftest::solids::Rng;
use helmholtz::selftest::solids::Solid;

pub(crate) fn shape(geometry: Geometry) -> Shape {
    Shape { name: String::new(), geometry, material: MaterialId(0), emission: None }
}

pub(crate) fn analytic(surface: AnalyticShape) -> Shape {
    shape(Geometry::Analytic(surface))
}

pub(crate) fn mesh(positions: Vec<Vec3>, triangles: Vec<[u32; 3]>) -> Shape {
    let mesh = TriangleMesh::new(positions, triangles, Vec::new(), Vec::new(), false).expect("a valid mesh");
    shape(Geometry::Mesh(mesh))
}

/// The positions of a mesh under p -> p * scale + offset, in f64 and rounded once.
pub(crate) fn placed(positions: &[DVec3], scale: f64, offset: DVec3) -> Vec<Vec3> {
    positions.iter().map(|&p| (p * scale + offset).as_vec3()).collect()
}

/// The unit icosphere: positions and triangles of [`Solid::icosphere`].
pub(crate) fn icosphere(levels: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let Solid { positions, triangles } = Solid::icosphere(levels);
    (positions, triangles)
}
