//! From shapes to a tree: `obvhs` clusters boxes into a binary tree, which is packed into nodes of four children.

use std::ops::Range;
use std::time::Duration;

use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb as BuildBox;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};

use super::node::{Child, Node, WIDTH, with_margin};
use super::{MAX_DEPTH, NO_TRIANGLE, Primitive, Tree};
use crate::query::BuildQuality;
use crate::scene::{Aabb, Geometry, Shape};

fn parameters(quality: BuildQuality) -> BvhBuildParams {
    match quality {
        BuildQuality::Low => BvhBuildParams::very_fast_build(),
        BuildQuality::Medium => BvhBuildParams::medium_build(),
        BuildQuality::High => BvhBuildParams::slow_build(),
    }
}

impl Tree {
    /// A tree over all primitives of all shapes, an instance being one, on rayon's current thread pool.
    pub(super) fn build(shapes: &[Shape], quality: BuildQuality) -> Self {
        let (unordered, boxes) = collect(shapes);
        let bounds = boxes.iter().fold(Aabb::EMPTY, |all, &b| all.union(b));
        if boxes.is_empty() {
            return Self {
                bounds,
                root: Child::default(),
                nodes: Vec::new(),
                primitives: Vec::new(),
                quality,
            };
        }
        let tree = build_bvh2(&build_boxes(&boxes, bounds), parameters(quality), &mut Duration::default());
        let mut packer = Packer::new(&tree, &boxes);
        let (root, _) = packer.copy(0, 0);
        let primitives = packer.order.iter().map(|&i| unordered[i as usize]).collect();
        packer.nodes.shrink_to_fit();
        Self { bounds, root, nodes: packer.nodes, primitives, quality }
    }
}

/// All primitives of all shapes with their bounds; an instance counts as one.
fn collect(shapes: &[Shape]) -> (Vec<Primitive>, Vec<Aabb>) {
    let primitives_of = |geometry: &Geometry| match geometry {
        Geometry::Mesh(mesh) => mesh.triangles().len(),
        Geometry::Analytic(_) | Geometry::Instance(_) => 1,
    };
    let count = shapes.iter().map(|shape| primitives_of(&shape.geometry)).sum();
    let (mut primitives, mut boxes) = (Vec::with_capacity(count), Vec::with_capacity(count));
    for (shape, shape_index) in shapes.iter().zip(0..) {
        match &shape.geometry {
            Geometry::Mesh(mesh) => {
                for triangle in 0..mesh.triangles().len() as u32 {
                    let corners = mesh.corners(triangle);
                    primitives.push(Primitive { corners, shape: shape_index, index: triangle });
                    boxes.push(corners.into_iter().fold(Aabb::EMPTY, Aabb::extend));
                }
            }
            Geometry::Analytic(surface) => {
                primitives.push(Primitive {
                    corners: [Vec3::ZERO; 3],
                    shape: shape_index,
                    index: NO_TRIANGLE,
                });
                boxes.push(surface.bounds());
            }
            Geometry::Instance(instance) => {
                if instance.group().primitive_count() > 0 {
                    primitives.push(Primitive {
                        corners: [Vec3::ZERO; 3],
                        shape: shape_index,
                        index: NO_TRIANGLE,
                    });
                    boxes.push(instance.bounds());
                }
            }
        }
    }
    (primitives, boxes)
}

/// The boxes that the tree is decided by: in units of the scene, where areas neither vanish nor overflow, and each
/// enlarged by a pseudo-random trifle. Clustering pairs mutual nearest neighbours; among equal boxes, as in a strip of quads
/// or a pile of copies, all choose the one to their right, one pair forms per pass, and the build takes quadratic time.
fn build_boxes(boxes: &[Aabb], scene: Aabb) -> Vec<BuildBox> {
    let origin = scene.min.as_dvec3();
    let extent = (scene.max.as_dvec3() - origin).max_element().max(f64::MIN_POSITIVE);
    let to_unit = |p: Vec3| ((p.as_dvec3() - origin) / extent).as_vec3a();
    let enlarge = |(i, b): (u32, &Aabb)| {
        let (min, max) = (to_unit(b.min), to_unit(b.max));
        // The floor is what rounding to f32 has already done to the coordinates, twice over.
        let trifle = (max - min).max_element() * TRIFLE + 4.0 * f32::EPSILON;
        BuildBox::new(min - trifle * hashed_unit_cube(2 * i), max + trifle * hashed_unit_cube(2 * i + 1))
    };
    (0..).zip(boxes).map(enlarge).collect()
}

/// By how much of their size boxes are enlarged at most for the build: enough to tell neighbours apart, too little to matter.
const TRIFLE: f32 = 1.0 / 1024.0;

/// A pseudo-random point of the unit cube: 21 bits per coordinate of a multiplicative hash (Knuth, TAOCP 6.4).
fn hashed_unit_cube(i: u32) -> Vec3A {
    let bits = (u64::from(i) + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let bits = (bits ^ (bits >> 32)).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let coordinate = |shift: u32| ((bits >> shift) & 0x1f_ffff) as f32 / (1 << 21) as f32;
    Vec3A::new(coordinate(1), coordinate(22), coordinate(43))
}

/// Copies a binary tree into nodes of [`WIDTH`] children. The boxes are those of the primitives themselves, with a margin.
struct Packer<'a> {
    tree: &'a Bvh2,
    boxes: &'a [Aabb],
    /// Below this depth subtrees are rebuilt balanced instead of copied, so that [`MAX_DEPTH`] is kept.
    copied_depth: usize,
    nodes: Vec<Node>,
    /// Indices of the primitives in the order of the leaves.
    order: Vec<u32>,
}

impl<'a> Packer<'a> {
    fn new(tree: &'a Bvh2, boxes: &'a [Aabb]) -> Self {
        let spread_depth = boxes.len().next_power_of_two().ilog2().div_ceil(WIDTH.ilog2()) as usize;
        let copied_depth = MAX_DEPTH - spread_depth;
        Self { tree, boxes, copied_depth, nodes: Vec::new(), order: Vec::with_capacity(boxes.len()) }
    }

    /// Adds the subtree of a node of the binary tree, to stand `depth` levels below the root.
    fn copy(&mut self, index: usize, depth: usize) -> (Child, Aabb) {
        let tree = self.tree;
        let node = &tree.nodes[index];
        if node.is_leaf() {
            return self.leaf(&tree.primitive_indices[primitives_of(node)]);
        }
        if depth == self.copied_depth {
            return self.spread(&primitives_below(tree, index));
        }
        let children = widest_descendants(tree, index);
        self.inner(&children, |packer, &child| packer.copy(child, depth + 1))
    }

    /// Adds a balanced tree over primitives that are already in a sensible order.
    fn spread(&mut self, primitives: &[u32]) -> (Child, Aabb) {
        if primitives.len() <= WIDTH {
            return self.leaf(primitives);
        }
        let parts: Vec<&[u32]> = primitives.chunks(primitives.len().div_ceil(WIDTH)).collect();
        self.inner(&parts, |packer, part| packer.spread(part))
    }

    fn leaf(&mut self, primitives: &[u32]) -> (Child, Aabb) {
        let child = Child { first: self.order.len() as u32, count: primitives.len() as u32 };
        self.order.extend(primitives);
        let hull =
            primitives.iter().map(|&i| with_margin(self.boxes[i as usize])).fold(Aabb::EMPTY, Aabb::union);
        (child, hull)
    }

    fn inner<T>(&mut self, parts: &[T], add: impl Fn(&mut Self, &T) -> (Child, Aabb)) -> (Child, Aabb) {
        let slot = self.nodes.len();
        self.nodes.push(Node::EMPTY);
        let children: Vec<_> = parts.iter().map(|part| add(self, part)).collect();
        self.nodes[slot] = Node::new(&children);
        let hull = children.iter().fold(Aabb::EMPTY, |hull, (_, b)| hull.union(*b));
        (Child { first: slot as u32, count: 0 }, hull)
    }
}

/// Children of a node of the binary tree, of which inner ones are replaced by their own children, largest
/// first, until there are [`WIDTH`]: rays meet large boxes most often.
fn widest_descendants(tree: &Bvh2, index: usize) -> Vec<usize> {
    let children_of = |index: usize| {
        let first = tree.nodes[index].first_index as usize;
        [first, first + 1]
    };
    let area = |index: usize| tree.nodes[index].aabb().half_area();
    let mut children = children_of(index).to_vec();
    while children.len() < WIDTH {
        let inner = (0..children.len()).filter(|&i| !tree.nodes[children[i]].is_leaf());
        let Some(largest) = inner.max_by(|&i, &j| area(children[i]).total_cmp(&area(children[j]))) else {
            break;
        };
        let [left, right] = children_of(children[largest]);
        children[largest] = left;
        children.push(right);
    }
    children
}

/// Where in the tree's list a leaf's primitives are.
fn primitives_of(leaf: &Bvh2Node) -> Range<usize> {
    let first = leaf.first_index as usize;
    first..first + leaf.prim_count as usize
}

/// The primitives of a subtree from left to right. Not recursive: it is for trees that are too deep.
fn primitives_below(tree: &Bvh2, index: usize) -> Vec<u32> {
    let mut primitives = Vec::new();
    let mut pending = vec![index];
    while let Some(index) = pending.pop() {
        let node = &tree.nodes[index];
        if node.is_leaf() {
            primitives.extend(&tree.primitive_indices[primitives_of(node)]);
        } else {
            let first = node.first_index as usize;
            pending.extend([first + 1, first]);
        }
    }
    primitives
}

#[cfg(test)]
mod tests {
    use super::*;

    fn depth(nodes: &[Node], child: Child) -> usize {
        if child.count > 0 {
            return 0;
        }
        1 + nodes[child.first as usize]
            .children
            .iter()
            .filter(|c| c.first + c.count > 0)
            .map(|&c| depth(nodes, c))
            .max()
            .unwrap_or(0)
    }

    #[test]
    fn deep_trees_are_made_to_fit_the_stack() {
        // A chain: each node has a leaf to its left and the rest to its right.
        let count = 1000_u32;
        let hull = |i: u32| Aabb { min: Vec3::splat(i as f32), max: Vec3::splat(count as f32) };
        let boxes: Vec<Aabb> =
            (0..count).map(|i| Aabb { max: Vec3::splat(i as f32 + 1.0), ..hull(i) }).collect();
        let node =
            |b: Aabb, count, first| Bvh2Node::new(BuildBox::new(b.min.into(), b.max.into()), count, first);
        let mut tree = Bvh2 { primitive_indices: (0..count).collect(), ..Bvh2::default() };
        tree.nodes.push(node(hull(0), 0, 1));
        for i in 0..count - 1 {
            tree.nodes.push(node(boxes[i as usize], 1, i));
            let last = i + 2 == count;
            tree.nodes.push(node(hull(i + 1), u32::from(last), if last { i + 1 } else { 2 * i + 3 }));
        }
        let mut packer = Packer::new(&tree, &boxes);
        let (root, bounds) = packer.copy(0, 0);
        // A chain of 1000 is cut where 5 more levels, log4 1000, still fit.
        assert!(depth(&packer.nodes, root) > MAX_DEPTH - 5 && depth(&packer.nodes, root) <= MAX_DEPTH);
        assert_eq!(packer.order, tree.primitive_indices);
        assert!(bounds.min.max_element() <= 0.0 && bounds.max.min_element() >= count as f32);
    }
}
