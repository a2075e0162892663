//! A tree between the shapes that it was built over and those that they become.

use super::{Child, NO_TRIANGLE, Node, ObvhsQuery, Primitive, WIDTH, with_margin};
use crate::query::stamp::{Change, Stamps};
use crate::query::{BuildQuality, Update};
use crate::scene::{Aabb, Geometry, Shape};

/// What is left of an [`ObvhsQuery`] when the borrow of its shapes ends.
pub struct DetachedObvhs {
    bounds: Aabb,
    root: Child,
    nodes: Vec<Node>,
    primitives: Vec<Primitive>,
    groups: Vec<Self>,
    group_of: Vec<u32>,
    quality: BuildQuality,
    stamps: Stamps,
}

impl ObvhsQuery<'_> {
    /// Ends the borrow of the shapes, so that they can be changed.
    pub fn detach(self) -> DetachedObvhs {
        let Self { shapes, bounds, root, nodes, primitives, groups, group_of, quality } = self;
        let groups = groups.into_iter().map(ObvhsQuery::detach).collect();
        let stamps = Stamps::of(shapes);
        DetachedObvhs { bounds, root, nodes, primitives, groups, group_of, quality, stamps }
    }

    /// Takes over the positions of all meshes, and makes all boxes fit.
    fn refit(&mut self) {
        let Self { shapes, nodes, primitives, .. } = self;
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
    /// [`Update::Refit`] the tree with other boxes if only positions did.
    pub fn attach(self, shapes: &[Shape], quality: BuildQuality, update: Update) -> ObvhsQuery<'_> {
        let change = self.stamps.change(shapes);
        let is_kept = self.quality == quality
            && (change == Change::None || update == Update::Refit && change != Change::Other);
        if !is_kept {
            return ObvhsQuery::new(shapes, quality);
        }
        let Self { bounds, root, nodes, primitives, groups, group_of, .. } = self;
        let mut attached = Vec::with_capacity(groups.len());
        for (group, number) in groups.into_iter().zip(0..) {
            let instance = group_of.iter().position(|&of| of == number).map(|shape| &shapes[shape].geometry);
            // Every group has an instance: they were found by looking for those.
            let Some(Geometry::Instance(instance)) = instance else {
                return ObvhsQuery::new(shapes, quality);
            };
            attached.push(group.attach(instance.group().shapes(), quality, update));
        }
        let groups = attached;
        let mut query = ObvhsQuery { shapes, bounds, root, nodes, primitives, groups, group_of, quality };
        if change != Change::None {
            query.refit();
        }
        query
    }
}
