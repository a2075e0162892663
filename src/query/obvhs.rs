//! The pure-Rust backend: a hierarchy built by `obvhs`, traversed here.
//!
//! `obvhs` decides the tree (parallel locally-ordered clustering, then reinsertion and collapse of leaves). Nodes, boxes
//! and traversal are ours, because its own traversal loses hits: boxes without slack for rounding, directions clamped
//! at 1.2e-7, entries dropped from a full stack. See `vendor-notes/obvhs.md`.

mod detached;

pub use detached::DetachedObvhs;

use std::collections::HashMap;
use std::ops::{ControlFlow, Range};
use std::sync::Arc;
use std::time::Duration;

use glam::{Vec3, Vec3A, Vec4};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb as BuildBox;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::bvh2::{Bvh2, node::Bvh2Node};

use super::triangle::WatertightRay;
use super::{BuildQuality, Hit, Ray, RayQuery, analytic};
use crate::scene::{Aabb, Geometry, Group, Shape};

fn parameters(quality: BuildQuality) -> BvhBuildParams {
    match quality {
        BuildQuality::Low => BvhBuildParams::very_fast_build(),
        BuildQuality::Medium => BvhBuildParams::medium_build(),
        BuildQuality::High => BvhBuildParams::slow_build(),
    }
}

/// Slack on the distances at which a ray enters and leaves a box: each is a difference, a reciprocal and a product,
/// all rounded (3 half ulps), and entry is compared with exit or with the rounded distance of a hit.
const SLACK: f32 = 4.0 * f32::EPSILON;

/// Components of a direction below this (2^-80) are taken as this in box tests, so that 0 times infinity does not arise.
/// The ray moves by 2^-80 of its length, far below an ulp; where it runs along a side of a box, the margin keeps it inside.
const LEAST_COMPONENT: f32 = f32::from_bits((127 - 80) << 23);

/// Children of a node: as many as an SSE register has lanes.
const WIDTH: usize = 4;

/// Deepest tree that traversal has a stack for.
const MAX_DEPTH: usize = 32;

/// All children of the deepest node wait at once, and all but one of each node above.
const STACK_SIZE: usize = MAX_DEPTH * (WIDTH - 1) + 1;

/// Stands for a triangle's index in a [`Primitive`] that is an analytic shape or an instance; meshes have fewer than 2^31 triangles.
const NO_TRIANGLE: u32 = u32::MAX;

/// A primitive as traversal meets it: a leaf's primitives lie side by side, with nothing left to look up.
#[derive(Debug, Clone, Copy)]
struct Primitive {
    corners: [Vec3; 3],
    shape: u32,
    /// Index of the triangle in its mesh, or [`NO_TRIANGLE`].
    index: u32,
}

/// What lies in a box: `count` primitives from `first`, or, if `count` is 0, the node of that index.
#[derive(Debug, Clone, Copy, Default)]
struct Child {
    first: u32,
    count: u32,
}

/// Four boxes and what lies in them, in two cache lines.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
struct Node {
    /// Per axis: least and greatest coordinate of each child.
    bounds: [[Vec4; 2]; 3],
    children: [Child; WIDTH],
}

impl Node {
    /// Boxes that no ray meets: least at +infinity, greatest at -infinity.
    const EMPTY: Self = Self {
        bounds: [[Vec4::INFINITY, Vec4::NEG_INFINITY]; 3],
        children: [Child { first: 0, count: 0 }; WIDTH],
    };

    fn new(children: &[(Child, Aabb)]) -> Self {
        let mut node = Self::EMPTY;
        for (lane, (child, hull)) in children.iter().enumerate() {
            node.children[lane] = *child;
            for (axis, [least, greatest]) in node.bounds.iter_mut().enumerate() {
                (least[lane], greatest[lane]) = (hull.min[axis], hull.max[axis]);
            }
        }
        node
    }
}

/// A ray prepared for box tests.
struct BoxRay {
    origin: [Vec4; 3],
    inverse: [Vec4; 3],
    /// Which of the two bounds of an axis the ray reaches first.
    near: [usize; 3],
    t_min: f32,
}

impl BoxRay {
    #[inline]
    fn new(ray: &Ray) -> Self {
        let d =
            ray.d.to_array().map(|d| if d.abs() < LEAST_COMPONENT { LEAST_COMPONENT.copysign(d) } else { d });
        Self {
            origin: ray.o.to_array().map(Vec4::splat),
            inverse: d.map(|d| Vec4::splat(1.0 / d)),
            near: d.map(|d| usize::from(d < 0.0)),
            t_min: ray.t_min,
        }
    }

    /// Where the ray enters each of the boxes, and a bit for each that it meets before `t_max`.
    #[inline]
    fn enter(&self, node: &Node, t_max: f32) -> ([f32; WIDTH], u32) {
        // The mask only tells the compiler that the index is in range.
        let distance = |axis: usize, bound: usize| {
            (node.bounds[axis][bound & 1] - self.origin[axis]) * self.inverse[axis]
        };
        let [x, y, z] = self.near;
        let near = distance(0, x).max(distance(1, y)).max(distance(2, z)) * (1.0 - SLACK);
        let far = distance(0, 1 - x).min(distance(1, 1 - y)).min(distance(2, 1 - z)) * (1.0 + SLACK);
        let hits = near.max(Vec4::splat(self.t_min)).cmple(far.min(Vec4::splat(t_max)));
        (near.to_array(), hits.bitmask())
    }
}

/// Ray queries over shapes by a tree of bounding boxes. Instances are primitives of it, and their groups have trees of their own.
pub struct ObvhsQuery<'s> {
    shapes: &'s [Shape],
    bounds: Aabb,
    root: Child,
    nodes: Vec<Node>,
    primitives: Vec<Primitive>,
    /// One for each group that has instances here.
    groups: Vec<Self>,
    /// For each shape the index in `groups`, where that is an instance; empty if none is.
    group_of: Vec<u32>,
    quality: BuildQuality,
}

impl<'s> ObvhsQuery<'s> {
    /// Builds the tree over all primitives of all shapes, on rayon's current thread pool. The tree does not depend on the
    /// number of threads.
    pub fn new(shapes: &'s [Shape], quality: BuildQuality) -> Self {
        let (unordered, boxes) = collect(shapes);
        let (groups, group_of) = group_queries(shapes, quality);
        let bounds = boxes.iter().fold(Aabb::EMPTY, |all, &b| all.union(b));
        if boxes.is_empty() {
            return Self {
                shapes,
                bounds,
                root: Child::default(),
                nodes: Vec::new(),
                primitives: Vec::new(),
                groups,
                group_of,
                quality,
            };
        }
        let tree = build_bvh2(&build_boxes(&boxes, bounds), parameters(quality), &mut Duration::default());
        let mut packer = Packer::new(&tree, &boxes);
        let (root, _) = packer.copy(0, 0);
        let primitives = packer.order.iter().map(|&i| unordered[i as usize]).collect();
        packer.nodes.shrink_to_fit();
        Self { shapes, bounds, root, nodes: packer.nodes, primitives, groups, group_of, quality }
    }

    /// Hands each leaf that the ray meets before `t_max` to `visit`, which may lower `t_max` or end the search.
    #[inline]
    fn traverse(&self, ray: &Ray, mut visit: impl FnMut(&[Primitive], &mut f32) -> ControlFlow<()>) {
        // Also refuses NaN in the range, by way of the comparison.
        if self.primitives.is_empty() || !(ray.o.is_finite() && ray.d.is_finite() && ray.t_min < ray.t_max) {
            return;
        }
        let box_ray = BoxRay::new(ray);
        let mut t_max = ray.t_max;
        // What is still to be visited, with the distance at which the ray enters it.
        let mut stack = [(Child::default(), 0.0); STACK_SIZE];
        stack[0].0 = self.root;
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (child, t) = stack[height];
            if t > t_max {
                continue;
            }
            let first = child.first as usize;
            if child.count > 0 {
                if visit(&self.primitives[first..first + child.count as usize], &mut t_max).is_break() {
                    return;
                }
                continue;
            }
            let node = &self.nodes[first];
            let (t, mut hits) = box_ray.enter(node, t_max);
            // The nearest on top, because a hit in it may make the others unnecessary.
            let base = height;
            while hits != 0 {
                let lane = hits.trailing_zeros() as usize % WIDTH;
                hits &= hits - 1;
                let mut place = height;
                while place > base && stack[place - 1].1 < t[lane] {
                    stack[place] = stack[place - 1];
                    place -= 1;
                }
                stack[place] = (node.children[lane], t[lane]);
                height += 1;
            }
        }
    }

    /// The hit on one primitive, if it lies before `t_max`.
    #[inline]
    fn hit(&self, primitive: &Primitive, ray: &Ray, prepared: &WatertightRay, t_max: f32) -> Option<Hit> {
        if primitive.index == NO_TRIANGLE {
            return self.hit_other(primitive.shape, &Ray { t_max, ..*ray });
        }
        let hit = prepared.intersect(&primitive.corners, t_max)?;
        Some(Hit { shape: primitive.shape, primitive: primitive.index, u: hit.u, v: hit.v, t: hit.t })
    }

    /// The hit on an analytic shape or an instance.
    #[inline(never)]
    fn hit_other(&self, shape: u32, ray: &Ray) -> Option<Hit> {
        match &self.shapes[shape as usize].geometry {
            Geometry::Mesh(_) => None,
            Geometry::Analytic(surface) => {
                let t = analytic::intersect(surface, ray)?;
                Some(Hit { shape, primitive: 0, u: 0.0, v: 0.0, t })
            }
            Geometry::Instance(instance) => {
                let (o, d) = instance.ray_to_group(ray.o, ray.d);
                let hit = self.group(shape).intersect(&Ray { o, d, ..*ray })?;
                let primitive = instance.group().first_primitive(hit.shape) + hit.primitive;
                Some(Hit { shape, primitive, ..hit })
            }
        }
    }

    /// Whether an analytic shape or an instance is hit.
    #[inline(never)]
    fn occluded_by_other(&self, shape: u32, ray: &Ray) -> bool {
        match &self.shapes[shape as usize].geometry {
            Geometry::Mesh(_) => false,
            Geometry::Analytic(surface) => analytic::intersect(surface, ray).is_some(),
            Geometry::Instance(instance) => {
                let (o, d) = instance.ray_to_group(ray.o, ray.d);
                self.group(shape).occluded(&Ray { o, d, ..*ray })
            }
        }
    }

    /// What answers for the group of the instance that is shape `shape`.
    fn group(&self, shape: u32) -> &Self {
        &self.groups[self.group_of[shape as usize] as usize]
    }
}

impl RayQuery for ObvhsQuery<'_> {
    #[inline]
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let prepared = WatertightRay::new(ray);
        let mut nearest = None;
        self.traverse(ray, |leaf, t_max| {
            for primitive in leaf {
                if let Some(hit) = self.hit(primitive, ray, &prepared, *t_max) {
                    *t_max = hit.t;
                    nearest = Some(hit);
                }
            }
            ControlFlow::Continue(())
        });
        nearest
    }

    #[inline]
    fn occluded(&self, ray: &Ray) -> bool {
        let prepared = WatertightRay::new(ray);
        let mut occluded = false;
        self.traverse(ray, |leaf, t_max| {
            occluded = leaf.iter().any(|primitive| {
                if primitive.index == NO_TRIANGLE {
                    self.occluded_by_other(primitive.shape, ray)
                } else {
                    prepared.intersect(&primitive.corners, *t_max).is_some()
                }
            });
            if occluded { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        });
        occluded
    }

    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn memory(&self) -> usize {
        self.nodes.capacity() * size_of::<Node>()
            + self.primitives.capacity() * size_of::<Primitive>()
            + self.group_of.capacity() * size_of::<u32>()
            + self.groups.iter().map(|group| size_of::<Self>() + group.memory()).sum::<usize>()
    }

    fn name(&self) -> String {
        "obvhs 0.4".to_owned()
    }
}

/// A query for each group that has instances among the shapes, and which of them each shape has.
fn group_queries(shapes: &[Shape], quality: BuildQuality) -> (Vec<ObvhsQuery<'_>>, Vec<u32>) {
    let (mut queries, mut query_of) = (Vec::new(), Vec::new());
    let mut known: HashMap<*const Group, u32> = HashMap::new();
    for (index, shape) in shapes.iter().enumerate() {
        let Geometry::Instance(instance) = &shape.geometry else { continue };
        let query = known.entry(Arc::as_ptr(instance.group())).or_insert_with(|| {
            queries.push(ObvhsQuery::new(instance.group().shapes(), quality));
            queries.len() as u32 - 1
        });
        query_of.resize(shapes.len(), u32::MAX);
        query_of[index] = *query;
    }
    (queries, query_of)
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

/// The box enlarged by 2^-22 of its greatest extent and a step: more than the triangle test moves corners, and
/// enough that a ray that runs exactly along a side of the box meets it.
fn with_margin(b: Aabb) -> Aabb {
    let margin = (b.max - b.min).max_element() * (2.0 * f32::EPSILON);
    let down = |x: f32| (x - margin).next_down();
    let up = |x: f32| (x + margin).next_up();
    Aabb { min: b.min.map(down), max: b.max.map(up) }
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
