//! What several subjects need: random numbers, meshes, shapes.

use std::path::Path;

use exr::prelude::{ReadChannels, ReadLayers};
use glam::{DVec3, Vec3};
use helmholtz::scene::{AnalyticShape, Geometry, MaterialId, Shape, TriangleMesh};
pub(crate) use helmholtz::selftest::solids::Rng;
use helmholtz::selftest::solids::Solid;

/// Names and values of all channels of an EXR file.
pub(crate) fn exr_channels(path: &Path) -> Vec<(String, Vec<f32>)> {
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    let list = image.layer_data.channel_data.list;
    list.iter().map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect())).collect()
}

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
