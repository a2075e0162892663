//! The pure-Rust backend: a hierarchy built by `obvhs`, traversed here.
//!
//! `obvhs` decides the tree (parallel locally-ordered clustering, then reinsertion and collapse of leaves; `build`). Nodes and boxes (`node`) and
//! traversal are ours, because its own traversal loses hits: boxes without slack for rounding, directions clamped
//! at 1.2e-7, entries dropped from a full stack. See `vendor-notes/obvhs.md`. What outlives the borrow of the shapes is in `detached`.

mod build;
mod detached;
mod node;

pub use detached::DetachedObvhs;

use std::collections::HashMap;
use std::ops::ControlFlow;
use std::sync::Arc;

use glam::Vec3;

use super::triangle::WatertightRay;
use super::{BuildQuality, Hit, Ray, RayQuery, analytic};
use crate::scene::{Aabb, Geometry, Group, Shape};
use node::{BoxRay, Child, Node, WIDTH};

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

/// What is built over shapes, and does not borrow them.
struct Tree {
    bounds: Aabb,
    root: Child,
    nodes: Vec<Node>,
    primitives: Vec<Primitive>,
    quality: BuildQuality,
}

/// Ray queries over shapes by a tree of bounding boxes. Instances are primitives of it, and their groups have trees of their own.
pub struct ObvhsQuery<'s> {
    shapes: &'s [Shape],
    tree: Tree,
    /// One for each group that has instances here.
    groups: Vec<Self>,
    /// For each shape the index in `groups`, where that is an instance; empty if none is.
    group_of: Vec<u32>,
    built_primitives: u64,
}

impl<'s> ObvhsQuery<'s> {
    /// Builds the tree over all primitives of all shapes, on rayon's current thread pool. The tree does not depend on the
    /// number of threads.
    pub fn new(shapes: &'s [Shape], quality: BuildQuality) -> Self {
        let tree = Tree::build(shapes, quality);
        let (groups, group_of) = group_queries(shapes, quality);
        let of_groups: u64 = groups.iter().map(Self::built_primitives).sum();
        let built_primitives = tree.primitives.len() as u64 + of_groups;
        Self { shapes, tree, groups, group_of, built_primitives }
    }

    /// Number of primitives over which trees were built to make this query: of a new one all, those of a group once and each instance as one; of one that was
    /// made by [`DetachedObvhs::attach`] none if there was nothing to build.
    pub fn built_primitives(&self) -> u64 {
        self.built_primitives
    }

    /// Hands each leaf that the ray meets before `t_max` to `visit`, which may lower `t_max` or end the search.
    #[inline]
    fn traverse(&self, ray: &Ray, mut visit: impl FnMut(&[Primitive], &mut f32) -> ControlFlow<()>) {
        // Also refuses NaN in the range, by way of the comparison.
        if self.tree.primitives.is_empty()
            || !(ray.o.is_finite() && ray.d.is_finite() && ray.t_min < ray.t_max)
        {
            return;
        }
        let box_ray = BoxRay::new(ray);
        let mut t_max = ray.t_max;
        // What is still to be visited, with the distance at which the ray enters it.
        let mut stack = [(Child::default(), 0.0); STACK_SIZE];
        stack[0].0 = self.tree.root;
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (child, t) = stack[height];
            if t > t_max {
                continue;
            }
            let first = child.first as usize;
            if child.count > 0 {
                if visit(&self.tree.primitives[first..first + child.count as usize], &mut t_max).is_break() {
                    return;
                }
                continue;
            }
            let node = &self.tree.nodes[first];
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
        self.tree.bounds
    }

    fn memory(&self) -> usize {
        self.tree.nodes.capacity() * size_of::<Node>()
            + self.tree.primitives.capacity() * size_of::<Primitive>()
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
