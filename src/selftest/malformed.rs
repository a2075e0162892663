//! Geometry that makes no sense: refused, or harmless.

use glam::{DAffine3, Vec3};

use super::images::{FURNACE_RADIANCE, INTEGRATORS, furnace, images, integrator, mean_and_error, room};
use super::places::{PAIRED_SIZE, difference, paired};
use super::{Bench, Finding, Group, SelftestError};
use crate::scene::{Geometry, MeshError, Scene, TriangleMesh};

/// What cannot be a mesh is an error, so the number of such that are taken is 0; what is one, but has no area or lies twice in the same place, changes no radiance.
///
/// The limit for the latter is that of the furnace: 5.5 errors of 64 images; and for what lies twice that of other scales, as the paths are the same. (Triangles that *glow* twice in
/// the same place do count up to twice where light is sampled, and once where it is hit: that is in the README's limits. More than 2^31 vertices are refused too; that is not tried here, for want of memory.)
pub(super) fn check(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let mut findings = vec![bench.finding(
        Group::Malformed,
        "meshes with impossible vertices or indices that are taken",
        f64::from(taken()),
        0.0,
    )];
    for (name, spoil) in [
        ("triangles without area in it", without_area as fn(&TriangleMesh) -> Extra),
        ("needles of aspect 1e8 in its walls", needles),
    ] {
        let scene = spoiled(spoil)?;
        for (label, passes) in [("path", 1), ("ptracer", 16), ("bdpt", 1)] {
            let (mean, error) =
                mean_and_error(&images(bench, &scene, integrator(label, &[])?, 0..64, passes)?);
            let measured = if error > 0.004 { f64::NAN } else { (mean / FURNACE_RADIANCE - 1.0).abs() };
            let check = format!("glowing box, {name}: relative error of its radiance");
            let finding = bench.finding(Group::Malformed, check, measured, 5.5 * error + 1e-5);
            findings.push(Finding { integrator: label, ..finding });
        }
    }
    let room = room(PAIRED_SIZE)?;
    let mut doubled = room.clone();
    for shape in &mut doubled.shapes {
        if let (Geometry::Mesh(mesh), None) = (&shape.geometry, &shape.emission) {
            shape.geometry = Geometry::Mesh(twice(mesh)?);
        }
    }
    let check = "room, every triangle that does not glow twice: relative difference of the mean";
    let forms = [&room, &doubled];
    findings.extend(paired(bench, Group::Malformed, &INTEGRATORS, forms, (check, Some(2e-3)), difference)?);
    Ok(findings)
}

/// Of meshes that are impossible, the number that is taken.
fn taken() -> u32 {
    let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
    let mesh = |positions: Vec<Vec3>, triangle: [u32; 3]| {
        TriangleMesh::new(positions, vec![triangle], Vec::new(), Vec::new(), false)
    };
    let beyond = TriangleMesh::COORDINATE_LIMIT;
    let mut taken = 0;
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, beyond, -beyond] {
        for corner in 0..3 {
            for axis in 0..3 {
                let mut positions = corners.to_vec();
                positions[corner][axis] = bad;
                taken += u32::from(!matches!(mesh(positions, [0, 1, 2]), Err(MeshError::BadVertex { .. })));
            }
        }
    }
    for index in [3, i32::MAX as u32, u32::MAX] {
        let refused = matches!(mesh(corners.to_vec(), [0, index, 2]), Err(MeshError::IndexOutOfRange { .. }));
        taken += u32::from(!refused);
    }
    taken
}

/// Vertices and triangles to add; indices count on from the mesh's own vertices.
type Extra = (Vec<Vec3>, Vec<[u32; 3]>);

fn twice(mesh: &TriangleMesh) -> Result<TriangleMesh, MeshError> {
    let triangles = [mesh.triangles(), mesh.triangles()].concat();
    let (normals, uvs) = (mesh.normals().to_vec(), mesh.uvs().to_vec());
    TriangleMesh::new(mesh.positions().to_vec(), triangles, normals, uvs, mesh.flip_normals())
}

/// Points, and segments across the box.
fn without_area(mesh: &TriangleMesh) -> Extra {
    let n = mesh.positions().len() as u32;
    let points = vec![Vec3::splat(-0.5), Vec3::splat(0.5), Vec3::ZERO];
    (points, vec![[n, n, n], [n, n + 1, n], [n, n + 1, n + 2], [n + 1, n + 1, n + 2]])
}

/// In the plane of each wall, 2 long and 2e-8 wide, one end in the other's corners.
fn needles(mesh: &TriangleMesh) -> Extra {
    let n = mesh.positions().len() as u32;
    let (mut positions, mut triangles) = (Vec::new(), Vec::new());
    for (i, t) in mesh.triangles().iter().enumerate() {
        let [a, b, c] = t.map(|i| mesh.positions()[i as usize]);
        // Around 0 the coordinates have steps small enough for this.
        let (middle, along, across) = ((a + b + c) / 3.0, (b - a) * 0.25, (c - a) * 2e-8);
        let first = n + 3 * i as u32;
        positions.extend([middle - along, middle + along, middle + across]);
        triangles.push([first, first + 1, first + 2]);
    }
    (positions, triangles)
}

/// The glowing box with more in its mesh.
fn spoiled(spoil: fn(&TriangleMesh) -> Extra) -> Result<Scene, SelftestError> {
    let mut scene = furnace(&DAffine3::IDENTITY, true, 16)?;
    let Geometry::Mesh(mesh) = &scene.shapes[0].geometry else { return Err(SelftestError::Shape) };
    scene.shapes[0].geometry = Geometry::Mesh(with(mesh, spoil(mesh))?);
    Ok(scene)
}

/// A mesh with more in it.
fn with(mesh: &TriangleMesh, (positions, triangles): Extra) -> Result<TriangleMesh, MeshError> {
    let positions = [mesh.positions(), &positions].concat();
    let triangles = [mesh.triangles(), &triangles].concat();
    TriangleMesh::new(positions, triangles, Vec::new(), Vec::new(), mesh.flip_normals())
}
