//! What several subjects need: random numbers, meshes, shapes.

use glam::{DVec3, Vec3};
use helmholtz::sampling::sampler::mix;
use helmholtz::scene::{AnalyticShape, Geometry, MaterialId, Shape, TriangleMesh};
use std::collections::HashMap;

/// A fixed stream of random numbers (`SplitMix64`).
pub(crate) struct Rng(pub(crate) u64);

impl Rng {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.0)
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * 2f64.powi(-53)
    }

    /// Uniform in the cube [-1, 1]^3.
    pub(crate) fn cube(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    /// Uniform on the unit sphere.
    pub(crate) fn direction(&mut self) -> DVec3 {
        loop {
            let p = self.cube();
            let r = p.length();
            if r > 0.1 && r < 1.0 {
                return p / r;
            }
        }
    }
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

/// The unit icosphere: an octahedron, its triangles split in four `levels` times. Closed, 8 * 4^levels triangles.
pub(crate) fn icosphere(levels: u32) -> (Vec<DVec3>, Vec<[u32; 3]>) {
    let mut positions = vec![DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z];
    let mut triangles =
        vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    for _ in 0..levels {
        let mut midpoints = HashMap::new();
        let mut split = Vec::with_capacity(triangles.len() * 4);
        for [a, b, c] in triangles {
            let mut midpoint = |i: u32, j: u32| {
                *midpoints.entry((i.min(j), i.max(j))).or_insert_with(|| {
                    positions.push((positions[i as usize] + positions[j as usize]).normalize());
                    positions.len() as u32 - 1
                })
            };
            let (ab, bc, ca) = (midpoint(a, b), midpoint(b, c), midpoint(c, a));
            split.extend([[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]);
        }
        triangles = split;
    }
    (positions, triangles)
}
