//! What a hierarchy was built over, remembered without holding on to it, so that it can be told later how much of it still holds.

use glam::DAffine3;

use crate::scene::{AnalyticShape, Geometry, Shape};

/// A list of shapes: where it lies, and what each of its surfaces is.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stamps {
    /// Address of the list.
    shapes: usize,
    surfaces: Vec<Stamp>,
}

/// What tells a surface from another, and where its buffers lie.
#[derive(Debug, Clone, PartialEq)]
enum Stamp {
    Mesh { revision: u64, topology: u64, positions: usize, triangles: usize },
    Analytic(AnalyticShape),
    Instance { group: u64, address: usize, to_world: DAffine3 },
}

/// How shapes differ from those of some stamps.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Change {
    /// The same surfaces in the same places.
    None,
    /// Some meshes, by their indices, have other positions and nothing else is different.
    Deformed(Vec<u32>),
    /// Anything else.
    Other,
}

impl Stamp {
    fn of(geometry: &Geometry) -> Self {
        match geometry {
            Geometry::Mesh(mesh) => Self::Mesh {
                revision: mesh.revision(),
                topology: mesh.topology(),
                positions: mesh.positions().as_ptr().addr(),
                triangles: mesh.triangles().as_ptr().addr(),
            },
            Geometry::Analytic(shape) => Self::Analytic(shape.clone()),
            Geometry::Instance(instance) => Self::Instance {
                group: instance.group().revision(),
                address: std::ptr::from_ref(&**instance.group()).addr(),
                to_world: *instance.to_world(),
            },
        }
    }

    /// Whether only positions differ.
    fn is_deformed(&self, now: &Self) -> bool {
        matches!(
            (self, now),
            (Self::Mesh { topology: a, triangles: b, .. }, Self::Mesh { topology: c, triangles: d, .. })
                if (a, b) == (c, d)
        )
    }
}

impl Stamps {
    pub(super) fn of(shapes: &[Shape]) -> Self {
        Self {
            shapes: shapes.as_ptr().addr(),
            surfaces: shapes.iter().map(|shape| Stamp::of(&shape.geometry)).collect(),
        }
    }

    /// What has changed.
    pub(super) fn change(&self, shapes: &[Shape]) -> Change {
        let now = Self::of(shapes);
        if now.shapes != self.shapes || now.surfaces.len() != self.surfaces.len() {
            return Change::Other;
        }
        let mut deformed = Vec::new();
        for (index, (then, now)) in (0..).zip(self.surfaces.iter().zip(&now.surfaces)) {
            if then == now {
                continue;
            }
            if !then.is_deformed(now) {
                return Change::Other;
            }
            deformed.push(index);
        }
        if deformed.is_empty() { Change::None } else { Change::Deformed(deformed) }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::scene::{MaterialId, TriangleMesh};

    fn mesh(x: f32, triangles: Vec<[u32; 3]>) -> TriangleMesh {
        let positions = vec![Vec3::ZERO, Vec3::X * x, Vec3::Y, Vec3::Z];
        TriangleMesh::new(positions, triangles, vec![], vec![], false).unwrap()
    }

    fn shape(mesh: TriangleMesh) -> Shape {
        let geometry = Geometry::Mesh(mesh);
        Shape { name: String::new(), geometry, material: MaterialId(0), emission: None }
    }

    #[test]
    fn changes_are_told_apart() {
        let triangles = vec![[0, 1, 2]];
        let mut shapes = vec![shape(mesh(1.0, triangles.clone())), shape(mesh(1.0, triangles.clone()))];
        let stamps = Stamps::of(&shapes);
        assert_eq!(stamps.change(&shapes), Change::None);
        shapes[1].material = MaterialId(7);
        assert_eq!(stamps.change(&shapes), Change::None, "a material is no surface");

        let replace = |shapes: &mut Vec<Shape>, new: TriangleMesh| {
            let Geometry::Mesh(old) = &mut shapes[1].geometry else { unreachable!() };
            let old = std::mem::replace(old, mesh(1.0, vec![]));
            shapes[1].geometry = Geometry::Mesh(new.in_place_of(old));
        };
        replace(&mut shapes, mesh(2.0, triangles));
        assert_eq!(stamps.change(&shapes), Change::Deformed(vec![1]));
        replace(&mut shapes, mesh(2.0, vec![[0, 1, 3]]));
        assert_eq!(stamps.change(&shapes), Change::Other, "another triangle");
        shapes.pop();
        assert_eq!(stamps.change(&shapes), Change::Other, "a shape less");
    }

    #[test]
    fn a_copy_is_not_what_was_built_over() {
        let shapes = vec![shape(mesh(1.0, vec![[0, 1, 2]]))];
        let copy = shapes.clone();
        assert_eq!(Stamps::of(&shapes).change(&copy), Change::Other);
    }
}
