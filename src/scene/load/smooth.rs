//! Normals of vertices for meshes that have none, and the splitting of vertices along creases.

use std::cmp::Ordering;

use glam::{DVec3, Vec2, Vec3};

use super::mesh::RawMesh;

/// Normals of vertices as the mean of their triangles' normals, weighted by angle (Thuermer and Wuethrich 1998,
/// "Computing vertex normals from polygonal facets"), as Mitsuba computes them.
pub(super) fn normals(positions: &[Vec3], triangles: &[[u32; 3]]) -> Vec<Vec3> {
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

/// Directions that the corners at one place are compared with; further ones stay by themselves. A hostile file could have a
/// different one for each of a million triangles.
const MAX_CREASES: usize = 64;

/// Gives each triangle corner the vertex that it shares with the other corners at the same place (position and texture coordinates) whose
/// triangles' normals are within `angle` of the first one's, in the order of the triangles: the greedy clustering by which Mitsuba 0.6
/// rebuilds meshes.
pub(super) fn split_creases(mesh: &mut RawMesh, angle: f64) {
    let position = |i: u32| mesh.positions.get(i as usize).copied();
    let mut flat = Vec::with_capacity(mesh.triangles.len());
    for t in &mesh.triangles {
        // Indices out of range are reported when the mesh is built.
        let [Some(a), Some(b), Some(c)] = t.map(position) else { return };
        let (a, b, c) = (a.as_dvec3(), b.as_dvec3(), c.as_dvec3());
        flat.push((b - a).cross(c - a).normalize_or_zero());
    }
    let place = |&(t, k): &(u32, usize)| {
        let vertex = mesh.triangles[t as usize][k] as usize;
        (mesh.positions[vertex], mesh.uvs.get(vertex).copied().unwrap_or(Vec2::ZERO))
    };
    let mut corners: Vec<_> =
        (0..mesh.triangles.len() as u32).flat_map(|t| (0..3).map(move |k| (t, k))).collect();
    corners.sort_by(|a, b| compare(place(a), place(b)));
    // Old vertices by their new index, from which attributes are copied.
    let mut origins = Vec::new();
    let mut triangles = mesh.triangles.clone();
    for same in corners.chunk_by(|a, b| compare(place(a), place(b)).is_eq()) {
        let mut clusters: Vec<(DVec3, u32)> = Vec::new();
        for &(t, k) in same {
            let n = flat[t as usize];
            let fits = |(first, _): &&(DVec3, u32)| *first == n || first.dot(n) > angle.cos();
            triangles[t as usize][k] = if let Some(&(_, vertex)) = clusters.iter().find(fits) {
                vertex
            } else {
                let new = origins.len() as u32;
                origins.push(mesh.triangles[t as usize][k] as usize);
                if clusters.len() < MAX_CREASES {
                    clusters.push((n, new));
                }
                new
            };
        }
    }
    mesh.triangles = triangles;
    mesh.positions = origins.iter().map(|&i| mesh.positions[i]).collect();
    if !mesh.uvs.is_empty() {
        mesh.uvs = origins.iter().map(|&i| mesh.uvs.get(i).copied().unwrap_or(Vec2::ZERO)).collect();
    }
    for attribute in mesh.attributes.iter_mut().filter(|a| !a.per_face) {
        let n = attribute.channels;
        attribute.values = origins.iter().flat_map(|&i| attribute.values[i * n..][..n].to_vec()).collect();
    }
}

/// Some order of places in which equal ones are neighbours; 0 and -0 are equal.
fn compare(a: (Vec3, Vec2), b: (Vec3, Vec2)) -> Ordering {
    let key = |(p, uv): (Vec3, Vec2)| [p.x, p.y, p.z, uv.x, uv.y].map(|x| x + 0.0);
    let (a, b) = (key(a), key(b));
    a.iter().zip(&b).map(|(x, y)| x.total_cmp(y)).find(|o| o.is_ne()).unwrap_or(Ordering::Equal)
}
