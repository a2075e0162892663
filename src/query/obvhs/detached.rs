//! A tree between the shapes that it was built over and those that they become.

use super::node::{Child, Node, WIDTH, with_margin};
use super::{NO_TRIANGLE, ObvhsQuery, Primitive, Tree};
use crate::query::stamp::{Change, Stamps};
use crate::query::{BuildQuality, Update};
use crate::scene::{Aabb, Geometry, Shape};

/// What is left of an [`ObvhsQuery`] when the borrow of its shapes ends.
pub struct DetachedObvhs {
    tree: Tree,
    groups: Vec<Self>,
    group_of: Vec<u32>,
    stamps: Stamps,
}

impl ObvhsQuery<'_> {
    /// Ends the borrow of the shapes, so that they can be changed.
    pub fn detach(self) -> DetachedObvhs {
        let Self { shapes, tree, groups, group_of, .. } = self;
        let groups = groups.into_iter().map(ObvhsQuery::detach).collect();
        DetachedObvhs { tree, groups, group_of, stamps: Stamps::of(shapes) }
    }
}

impl Tree {
    /// Takes over the positions of all meshes, and makes all boxes fit. Which primitives lie together stays as it was.
    fn refit(&mut self, shapes: &[Shape]) {
        let Self { nodes, primitives, .. } = self;
        for primitive in &mut *primitives {
            if let Geometry::Mesh(mesh) = &shapes[primitive.shape as usize].geometry {
                primitive.corners = mesh.corners(primitive.index);
            }
        }
        self.bounds = primitives.iter().fold(Aabb::EMPTY, |b, p| b.union(p.bounds(shapes)));
        // Children come after their parents.
        for slot in (0..nodes.len()).rev() {
            let children = nodes[slot].children.into_iter().filter(|child| child.first + child.count > 0);
            let hull = |child: Child| {
                let first = child.first as usize;
                if child.count == 0 {
                    return nodes[first].hull();
                }
                let leaf = &primitives[first..first + child.count as usize];
                leaf.iter().fold(Aabb::EMPTY, |b, p| b.union(with_margin(p.bounds(shapes))))
            };
            let children: Vec<_> = children.map(|child| (child, hull(child))).collect();
            nodes[slot] = Node::new(&children);
        }
    }
}

impl Primitive {
    /// Bounds of a primitive of these shapes.
    fn bounds(&self, shapes: &[Shape]) -> Aabb {
        if self.index == NO_TRIANGLE {
            shapes[self.shape as usize].geometry.bounds()
        } else {
            self.corners.into_iter().fold(Aabb::EMPTY, Aabb::extend)
        }
    }
}

impl Node {
    /// Around all children.
    fn hull(&self) -> Aabb {
        let mut hull = Aabb::EMPTY;
        for lane in 0..WIDTH {
            for (axis, [least, greatest]) in self.bounds.iter().enumerate() {
                hull.min[axis] = hull.min[axis].min(least[lane]);
                hull.max[axis] = hull.max[axis].max(greatest[lane]);
            }
        }
        hull
    }
}

impl DetachedObvhs {
    /// A query over the shapes as they are now, with as much of what was built before as still holds: all of it if no surface changed, and for
    /// [`Update::Refit`] the tree with other boxes if only positions did. Boxes are computed anew for all shapes, deformed or not.
    pub fn attach(self, shapes: &[Shape], quality: BuildQuality, update: Update) -> ObvhsQuery<'_> {
        let change = self.stamps.change(shapes);
        let is_kept = self.tree.quality == quality
            && (change == Change::None || update == Update::Refit && change != Change::Other);
        if !is_kept {
            return ObvhsQuery::new(shapes, quality);
        }
        let Self { mut tree, groups, group_of, .. } = self;
        let mut attached = Vec::with_capacity(groups.len());
        for (group, number) in groups.into_iter().zip(0..) {
            let instance = group_of.iter().position(|&of| of == number).map(|shape| &shapes[shape].geometry);
            // Every group has an instance: they were found by looking for those.
            let Some(Geometry::Instance(instance)) = instance else {
                return ObvhsQuery::new(shapes, quality);
            };
            attached.push(group.attach(instance.group().shapes(), quality, update));
        }
        if change != Change::None {
            tree.refit(shapes);
        }
        let built_primitives = attached.iter().map(ObvhsQuery::built_primitives).sum();
        ObvhsQuery { shapes, tree, groups: attached, group_of, built_primitives }
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::scene::{MaterialId, TriangleMesh};

    const COUNT: u32 = 500;

    /// Triangles along x, the order being theirs or shuffled.
    fn row(y: f32, shuffled: bool) -> TriangleMesh {
        // 37 is prime to 500.
        let place = |i: u32| if shuffled { i * 37 % COUNT } else { i };
        let corners = |i: u32| {
            let at = Vec3::new(place(i) as f32, y, 0.0);
            [at, at + 0.5 * Vec3::X, at + 0.5 * Vec3::Z]
        };
        let positions = (0..COUNT).flat_map(corners).collect();
        let triangles = (0..COUNT).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        TriangleMesh::new(positions, triangles, vec![], vec![], false).unwrap()
    }

    /// Which primitives lie together, and in which order: the children of all nodes, then the primitives.
    fn topology(query: &ObvhsQuery) -> Vec<(u32, u32)> {
        let children = query.tree.nodes.iter().flat_map(|node| node.children);
        let primitives = query.tree.primitives.iter().map(|p| (p.shape, p.index));
        children.map(|child| (child.first, child.count)).chain(primitives).collect()
    }

    #[test]
    fn a_refit_keeps_the_tree_and_a_rebuild_does_not() {
        for update in [Update::Refit, Update::Rebuild] {
            let shape = |mesh| Shape {
                name: String::new(),
                geometry: Geometry::Mesh(mesh),
                material: MaterialId(0),
                emission: None,
            };
            let mut shapes = vec![shape(row(0.0, false)), shape(row(5.0, false))];
            let query = ObvhsQuery::new(&shapes, BuildQuality::Medium);
            assert_eq!(query.built_primitives(), u64::from(2 * COUNT));
            let (before, nodes) = (topology(&query), query.tree.nodes.as_ptr());
            let detached = query.detach();

            let empty = TriangleMesh::new(vec![], vec![], vec![], vec![], false).unwrap();
            let Geometry::Mesh(old) = &mut shapes[0].geometry else { unreachable!() };
            let old = std::mem::replace(old, empty);
            shapes[0].geometry = Geometry::Mesh(row(0.0, true).in_place_of(old));
            let rebuilt = topology(&ObvhsQuery::new(&shapes, BuildQuality::Medium));
            assert_ne!(rebuilt, before, "the deformation is too tame to tell");

            let query = detached.attach(&shapes, BuildQuality::Medium, update);
            if update == Update::Refit {
                assert_eq!((topology(&query), query.built_primitives()), (before, 0));
                assert_eq!(query.tree.nodes.as_ptr(), nodes, "the very same nodes");
            } else {
                assert_eq!((topology(&query), query.built_primitives()), (rebuilt, u64::from(2 * COUNT)));
            }
            // Nothing has changed since.
            let after = topology(&query);
            let query = query.detach().attach(&shapes, BuildQuality::Medium, update);
            assert_eq!((topology(&query), query.built_primitives()), (after, 0));
        }
    }
}
