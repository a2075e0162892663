//! Closed meshes that are hard on ray queries, and random numbers to aim at them.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use crate::sampling::sampler::mix;
use crate::scene::{Geometry, MaterialId, MeshError, Shape, TriangleMesh};

/// A fixed stream of random numbers (`SplitMix64`).
#[derive(Debug, Clone)]
pub struct Rng(pub u64);

impl Rng {
    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.0)
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * 2f64.powi(-53)
    }

    /// Uniform among 0 to `n - 1`.
    pub fn index(&mut self, n: usize) -> usize {
        ((self.unit() * n as f64) as usize).min(n - 1)
    }

    /// From `low` to `high`, both positive, uniform in the logarithm.
    pub fn log_uniform(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.unit())
    }

    /// Uniform in the cube [-1, 1]^3.
    pub fn cube(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0
    }

    /// Uniform on the unit sphere.
    pub fn direction(&mut self) -> DVec3 {
        loop {
            let p = self.cube();
            let r = p.length();
            if r > 0.1 && r < 1.0 {
                return p / r;
            }
        }
    }
}

/// A triangle mesh in f64, star-shaped around the origin and of about unit size if closed.
#[derive(Debug, Clone)]
pub struct Solid {
    /// Positions of the vertices.
    pub positions: Vec<DVec3>,
    /// Vertex indices, counter-clockwise seen from outside.
    pub triangles: Vec<[u32; 3]>,
}

impl Solid {
    /// The unit icosphere: an octahedron, its triangles split in four `levels` times. Closed, 8 * 4^levels triangles.
    pub fn icosphere(levels: u32) -> Self {
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
        Self { positions, triangles }
    }

    /// The cube [-1, 1]^3, each side a grid of n x n squares. Closed, but vertices of different sides are not shared.
    pub fn gridded_cube(n: u32) -> Self {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        let at = |k: u32| f64::from(k) / f64::from(n) * 2.0 - 1.0;
        for side in 0..6 {
            let first = positions.len() as u32;
            let z = if side % 2 == 0 { 1.0 } else { -1.0 };
            for (i, j) in (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j))) {
                positions.push(match side / 2 {
                    0 => DVec3::new(at(i), at(j), z),
                    1 => DVec3::new(at(j), z, at(i)),
                    _ => DVec3::new(z, at(i), at(j)),
                });
            }
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let a = first + i * (n + 1) + j;
                let (b, c, d) = (a + n + 1, a + n + 2, a + 1);
                // i and j turn around the outward normal, or the other way on the side behind.
                let faces = if z > 0.0 { [[a, b, c], [a, c, d]] } else { [[a, c, b], [a, d, c]] };
                triangles.extend(faces);
            }
        }
        Self { positions, triangles }
    }

    /// A double cone of 2 n slivers that all meet in its two tips.
    pub fn double_cone(n: u32, radius: f64, height: f64) -> Self {
        let mut positions = vec![DVec3::Z * height, DVec3::NEG_Z * height];
        let mut triangles = Vec::new();
        for i in 0..n {
            let (sin, cos) = (f64::from(i) / f64::from(n) * std::f64::consts::TAU).sin_cos();
            positions.push(DVec3::new(cos, sin, 0.0) * radius);
            let (a, b) = (2 + i, 2 + (i + 1) % n);
            triangles.extend([[a, b, 0], [b, a, 1]]);
        }
        Self { positions, triangles }
    }

    /// The mesh under p -> p * scale + offset, computed in f64 and rounded once.
    ///
    /// # Errors
    /// If that leads out of the range of coordinates.
    pub fn placed(&self, scale: f64, offset: DVec3) -> Result<TriangleMesh, MeshError> {
        let positions = self.positions.iter().map(|&p| (p * scale + offset).as_vec3()).collect();
        TriangleMesh::new(positions, self.triangles.clone(), Vec::new(), Vec::new(), false)
    }
}

/// The parallelogram `corner + s ex + t ey` as two triangles; the normal is `ex` cross `ey`.
///
/// # Errors
/// If that leads out of the range of coordinates.
pub fn quad(corner: DVec3, ex: DVec3, ey: DVec3) -> Result<TriangleMesh, MeshError> {
    let positions = [corner, corner + ex, corner + ex + ey, corner + ey].map(DVec3::as_vec3).to_vec();
    TriangleMesh::new(positions, vec![[0, 1, 2], [0, 2, 3]], Vec::new(), Vec::new(), false)
}

/// A mesh as a shape of material 0 that does not emit.
pub fn shape(mesh: TriangleMesh) -> Shape {
    Shape { name: String::new(), geometry: Geometry::Mesh(mesh), material: MaterialId(0), emission: None }
}

/// The world position of a barycentric point of a triangle, in f64.
pub fn between([a, b, c]: [Vec3; 3], u: f64, v: f64) -> DVec3 {
    let [a, b, c] = [a, b, c].map(Vec3::as_dvec3);
    a + (b - a) * u + (c - a) * v
}
