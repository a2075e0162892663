//! What can be said of shapes before any ray is traced: that rounding has eaten their form, that triangles have no area.
//!
//! Meshes of shape groups are not looked at: they are where the group's own space has them.

use std::path::Path;

use glam::Vec3;
use rayon::prelude::*;

use super::{Location, Log, bounds_of};
use crate::scene::{Aabb, Geometry, Shape, TriangleMesh};

/// Rounding of vertices, as a share of the scene's size, from which on there is a warning: 1700 sizes away from the origin. Rays start up to 22 such roundings off a
/// surface ([`SurfacePoint::p_err`](crate::scene::SurfacePoint::p_err)), and images are off by as much.
const COARSE_SCENE: f64 = 1e-4;

/// The same for a mesh in a scene that is not: small things far from the origin look well enough from as far away.
const COARSE_MESH: f64 = 1e-3;

/// Half the last digit of the greatest coordinate, as a share of the diagonal; 0 for what has none.
fn rounding(bounds: Aabb) -> f64 {
    let size = (bounds.max.as_dvec3() - bounds.min.as_dvec3()).length();
    let reach = bounds.min.abs().max(bounds.max.abs()).max_element();
    if bounds.is_empty() || size == 0.0 { 0.0 } else { f64::from(reach * (f32::EPSILON / 2.0)) / size }
}

fn without_area(mesh: &TriangleMesh) -> usize {
    let is_flat = |t: &&[u32; 3]| {
        let [a, b, c] = t.map(|i| mesh.positions()[i as usize]).map(Vec3::as_dvec3);
        (b - a).cross(c - a).length_squared() == 0.0
    };
    mesh.triangles().iter().filter(is_flat).count()
}

/// Warns of a scene or a mesh so far from the origin that f32 hardly holds its shape, and counts triangles that no ray can hit.
pub(super) fn shapes(path: &Path, shapes: &[Shape], log: &mut Log) {
    let meshes = shapes.iter().filter_map(|shape| match &shape.geometry {
        Geometry::Mesh(mesh) => Some((shape.name.as_str(), mesh)),
        Geometry::Analytic(_) | Geometry::Instance(_) => None,
    });
    let coarsest = meshes.clone().map(|(name, mesh)| (rounding(mesh.bounds()), name));
    let coarsest = coarsest.max_by(|a, b| a.0.total_cmp(&b.0));
    let whole = rounding(bounds_of(shapes));
    let coarse = match coarsest {
        _ if whole > COARSE_SCENE => Some(("the scene".to_owned(), whole)),
        Some((share, name)) if share > COARSE_MESH => Some((format!("`{name}`"), share)),
        _ => None,
    };
    if let Some((what, share)) = coarse {
        log.warn(
            Location::file(path),
            format!(
                "{what} is so far from the origin that 32-bit coordinates move vertices by up to {:.2} % of its size, and rays start up to 22 times that off a surface: put it nearer to the origin",
                100.0 * share
            ),
        );
    }
    let flat: usize = meshes.par_bridge().map(|(_, mesh)| without_area(mesh)).sum();
    if flat > 0 {
        let triangles = if flat == 1 { "triangle" } else { "triangles" };
        log.note(
            Location::file(path),
            format!("{flat} {triangles} without area: no ray hits a line or a point"),
        );
    }
}
