//! The map: photons in a balanced k-d tree, found by place.
//!
//! The tree is implicit: level by level each range of photons is halved at its median, so that all leaves are equally deep and a node knows its
//! range from its number. What it looks like depends on the photons and their order alone, not on the threads that build it.

use std::collections::BinaryHeap;

use glam::Vec3;
use rayon::prelude::*;

use super::photon::Photon;

/// Most photons in a leaf.
const LEAF: usize = 32;

/// Ranges up to this size are sorted by one task: half a megabyte.
const PHOTONS_PER_TASK: usize = 1 << 14;

/// Where a range is split.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Node {
    pub(super) split: f32,
    /// 0, 1 or 2.
    pub(super) axis: u32,
}

/// Photons, searchable by position.
#[derive(Debug)]
pub struct PhotonMap {
    photons: Vec<Photon>,
    /// Node `i` of level `l` is number `2^l + i`, of which 1 is subtracted here.
    nodes: Vec<Node>,
    /// Levels above the leaves.
    levels: u32,
}

/// Squared distances (their bits, which are in the same order) and indices of the nearest photons, the farthest first.
pub type NearestHeap = BinaryHeap<(u32, u32)>;

impl PhotonMap {
    /// Sorts photons into a map: O(n log n), on all threads.
    pub fn new(mut photons: Vec<Photon>) -> Self {
        let count = photons.len();
        let levels = levels(count);
        let mut preorder = vec![Node::default(); node_count(count)];
        build(&mut photons, &mut preorder, Range { count, level: 0, i: 0 });
        let mut nodes = vec![Node::default(); preorder.len()];
        order_by_level(&preorder, 1, &mut nodes);
        Self { photons, nodes, levels }
    }

    /// The map that was made of these parts before. `None` if there are too many or too few nodes, or one that makes no sense.
    pub(super) fn from_parts(photons: Vec<Photon>, nodes: Vec<Node>) -> Option<Self> {
        let is_sound = nodes.len() == node_count(photons.len()) && nodes.iter().all(|node| node.axis < 3);
        is_sound.then(|| Self { levels: levels(photons.len()), photons, nodes })
    }

    /// The inner nodes, level by level.
    pub(super) fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// All photons.
    pub fn photons(&self) -> &[Photon] {
        &self.photons
    }

    /// Calls `visit` with each photon that may be nearer to `at` than the root of `limit`, and some that are not. It gets their index too and
    /// returns the new limit.
    #[inline]
    fn search(&self, at: Vec3, mut limit: f32, mut visit: impl FnMut(u32, &Photon) -> f32) {
        let at_axis = at.to_array();
        // Subtrees still to be visited, with the squared distance of the plane before them.
        let mut stack = [(0_u32, 0.0_f32); 32];
        let mut depth = 0;
        let mut node = 1_u32;
        loop {
            while node.ilog2() < self.levels {
                let Node { split, axis } = self.nodes[node as usize - 1];
                let beyond = at_axis[axis as usize] - split;
                let near = 2 * node + u32::from(beyond > 0.0);
                stack[depth] = (near ^ 1, beyond * beyond);
                depth += 1;
                node = near;
            }
            let leaf = node as usize - (1 << self.levels);
            let count = self.photons.len();
            for i in boundary(count, self.levels, leaf)..boundary(count, self.levels, leaf + 1) {
                limit = visit(i as u32, &self.photons[i]);
            }
            loop {
                if depth == 0 {
                    return;
                }
                depth -= 1;
                let (next, distance) = stack[depth];
                if distance <= limit {
                    node = next;
                    break;
                }
            }
        }
    }

    /// Calls `visit` with each accepted photon nearer to a site than the root of `radius_squared`, and with its squared distance.
    #[inline]
    pub fn within(
        &self,
        site: &Site,
        radius_squared: f32,
        accepts: impl Fn(&Photon) -> bool,
        mut visit: impl FnMut(&Photon, f32),
    ) {
        self.search(site.p, radius_squared, |_, photon| {
            let distance = site.distance_squared(photon);
            if distance < radius_squared && accepts(photon) {
                visit(photon, distance);
            }
            radius_squared
        });
    }

    /// Fills `heap` with the `count` accepted photons that are nearest to a site; with fewer if there are not as many
    /// nearer than the root of `limit`. The heap's indices are those of [`photons`](Self::photons).
    #[inline]
    pub fn nearest(
        &self,
        site: &Site,
        count: usize,
        limit: f32,
        accepts: impl Fn(&Photon) -> bool,
        heap: &mut NearestHeap,
    ) {
        heap.clear();
        let mut bound = limit;
        self.search(site.p, limit, |index, photon| {
            let distance = site.distance_squared(photon);
            if distance < bound && accepts(photon) {
                let found = (distance.to_bits(), index);
                if heap.len() < count {
                    heap.push(found);
                } else if let Some(mut farthest) = heap.peek_mut() {
                    *farthest = found;
                }
                if heap.len() == count {
                    bound = heap.peek().map_or(limit, |farthest| f32::from_bits(farthest.0));
                }
            }
            bound
        });
    }
}

/// How much farther a photon is along the normal than across it: the disc about a site is a flat ellipsoid, so that photons on surfaces behind or
/// before it do not count.
const FLATNESS: f32 = 8.0;

/// A surface point about which photons are looked for.
#[derive(Debug, Clone, Copy)]
pub struct Site {
    /// World position.
    pub p: Vec3,
    /// Geometric normal, unit length.
    pub ng: Vec3,
}

impl Site {
    /// Squared distance of a photon, with distances along the normal taken eight times as long.
    #[inline]
    pub fn distance_squared(&self, photon: &Photon) -> f32 {
        let to = photon.position - self.p;
        let height = to.dot(self.ng);
        to.length_squared() + (FLATNESS * FLATNESS - 1.0) * height * height
    }
}

/// Levels above the leaves of a map of `count` photons.
fn levels(count: usize) -> u32 {
    count.div_ceil(LEAF).max(1).next_power_of_two().ilog2()
}

/// Number of inner nodes of a map of `count` photons.
pub(super) fn node_count(count: usize) -> usize {
    (1 << levels(count)) - 1
}

/// Where range `i` of a level begins: ranges differ in size by one at most, and each is the union of two of the next level.
#[inline]
fn boundary(count: usize, level: u32, i: usize) -> usize {
    ((count as u64 * i as u64) >> level) as usize
}

/// Range `i` of a level of a map of `count` photons.
#[derive(Debug, Clone, Copy)]
struct Range {
    count: usize,
    level: u32,
    i: usize,
}

impl Range {
    /// The number of photons in its first half, and its halves.
    fn halves(self) -> (usize, [Self; 2]) {
        let Self { count, level, i } = self;
        let size = boundary(count, level + 1, 2 * i + 1) - boundary(count, level, i);
        (size, [2 * i, 2 * i + 1].map(|i| Self { count, level: level + 1, i }))
    }
}

/// Sorts the photons of a range into its subtree, whose nodes are in preorder here: so a range that fits into a cache is done with before it leaves
/// it.
fn build(photons: &mut [Photon], nodes: &mut [Node], range: Range) {
    let Some((node, nodes)) = nodes.split_first_mut() else { return };
    let (middle, [first, second]) = range.halves();
    let is_large = photons.len() > PHOTONS_PER_TASK;
    *node = halve(photons, middle);
    let (photons, others) = photons.split_at_mut(middle);
    let (nodes, other_nodes) = nodes.split_at_mut(nodes.len() / 2);
    if is_large {
        rayon::join(|| build(photons, nodes, first), || build(others, other_nodes, second));
    } else {
        build(photons, nodes, first);
        build(others, other_nodes, second);
    }
}

/// Puts a subtree whose root has a number (1: the whole tree) where a search looks for it.
fn order_by_level(preorder: &[Node], number: usize, nodes: &mut [Node]) {
    if let Some((root, rest)) = preorder.split_first() {
        nodes[number - 1] = *root;
        let (first, second) = rest.split_at(rest.len() / 2);
        order_by_level(first, 2 * number, nodes);
        order_by_level(second, 2 * number + 1, nodes);
    }
}

/// Moves the photons of a range so that those from `middle` on lie beyond all before, along the longest side of their box.
fn halve(range: &mut [Photon], middle: usize) -> Node {
    let corners = |photons: &[Photon]| {
        let first = photons.first().map_or(Vec3::ZERO, |photon| photon.position);
        photons
            .iter()
            .fold((first, first), |(min, max), photon| (min.min(photon.position), max.max(photon.position)))
    };
    let join = |a: (Vec3, Vec3), b: (Vec3, Vec3)| (a.0.min(b.0), a.1.max(b.1));
    let (min, max) = if range.len() > PHOTONS_PER_TASK {
        let parts = range.par_chunks(PHOTONS_PER_TASK).map(corners);
        parts.reduce_with(join).unwrap_or_default()
    } else {
        corners(range)
    };
    let axis = (max - min).max_position();
    if middle >= range.len() {
        return Node { split: max[axis], axis: axis as u32 };
    }
    let (_, median, _) =
        range.select_nth_unstable_by(middle, |a, b| a.position[axis].total_cmp(&b.position[axis]));
    Node { split: median.position[axis], axis: axis as u32 }
}
