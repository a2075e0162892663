//! Nodes of four boxes each, and the test that tells which of them a ray meets. What lies in a box is for others to know.

use glam::Vec4;

use crate::query::Ray;
use crate::scene::Aabb;

/// Slack on the distances at which a ray enters and leaves a box: each is a difference, a reciprocal and a product,
/// all rounded (3 half ulps), and entry is compared with exit or with the rounded distance of a hit.
const SLACK: f32 = 4.0 * f32::EPSILON;

/// Components of a direction below this (2^-80) are taken as this in box tests, so that 0 times infinity does not arise.
/// The ray moves by 2^-80 of its length, far below an ulp; where it runs along a side of a box, the margin keeps it inside.
const LEAST_COMPONENT: f32 = f32::from_bits((127 - 80) << 23);

/// Children of a node: as many as an SSE register has lanes.
pub(super) const WIDTH: usize = 4;

/// What lies in a box: `count` primitives from `first`, or, if `count` is 0, the node of that index.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Child {
    pub(super) first: u32,
    pub(super) count: u32,
}

/// Four boxes and what lies in them, in two cache lines.
#[derive(Debug, Clone, Copy)]
#[repr(C, align(64))]
pub(super) struct Node {
    /// Per axis: least and greatest coordinate of each child.
    pub(super) bounds: [[Vec4; 2]; 3],
    pub(super) children: [Child; WIDTH],
}

impl Node {
    /// Boxes that no ray meets: least at +infinity, greatest at -infinity.
    pub(super) const EMPTY: Self = Self {
        bounds: [[Vec4::INFINITY, Vec4::NEG_INFINITY]; 3],
        children: [Child { first: 0, count: 0 }; WIDTH],
    };

    pub(super) fn new(children: &[(Child, Aabb)]) -> Self {
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
pub(super) struct BoxRay {
    origin: [Vec4; 3],
    inverse: [Vec4; 3],
    /// Which of the two bounds of an axis the ray reaches first.
    near: [usize; 3],
    t_min: f32,
}

impl BoxRay {
    #[inline]
    pub(super) fn new(ray: &Ray) -> Self {
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
    pub(super) fn enter(&self, node: &Node, t_max: f32) -> ([f32; WIDTH], u32) {
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

/// The box enlarged by 2^-22 of its greatest extent and a step: more than the triangle test moves corners, and
/// enough that a ray that runs exactly along a side of the box meets it.
pub(super) fn with_margin(b: Aabb) -> Aabb {
    let margin = (b.max - b.min).max_element() * (2.0 * f32::EPSILON);
    let down = |x: f32| (x - margin).next_down();
    let up = |x: f32| (x + margin).next_up();
    Aabb { min: b.min.map(down), max: b.max.map(up) }
}
