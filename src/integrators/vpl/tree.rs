//! A tree over virtual point lights from which few are drawn, those that matter most likely, at a cost of the logarithm of their number.
//!
//! Each node bounds its lights by a box, a cone of normals and the sum of their powers. A draw goes down from the root and takes each child with a probability
//! in proportion to an estimate of its contribution (Conty Estevez and Kulla 2018, "Importance sampling of many lights with adaptive
//! tree splitting"; their draws, without the splitting). Each light that can contribute has a positive probability, so the estimate is unbiased.

use glam::Vec3;

/// What the tree knows of a light.
#[derive(Debug, Clone, Copy)]
pub struct TreeLight {
    /// World position.
    pub position: Vec3,
    /// Unit normal, on the side that most light goes to.
    pub normal: Vec3,
    /// Brightness, in any unit; at least 0.
    pub power: f32,
}

/// A point that is lit.
#[derive(Debug, Clone, Copy)]
pub struct Receiver {
    /// World position.
    pub p: Vec3,
    /// Unit normal, on the side that is looked at.
    pub normal: Vec3,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    min: Vec3,
    max: Vec3,
    /// Axis of the cone of normals.
    axis: Vec3,
    /// Cosine of the cone's half angle.
    cos: f32,
    power: f32,
    /// The second child (the first is the next node), or the light of a leaf.
    next: u32,
    is_leaf: bool,
}

/// Cosines are taken to be at least this: surfaces that transmit also shine to the other side, and are lit from there. At most so much is wasted on what is not lit.
const LEAST_COS: f32 = 0.02;

/// What a whole turn of the normal counts beside a scene's extent when lights are split into near and alike.
const NORMAL_EXTENT: f32 = 0.25;

/// See the module's text.
#[derive(Debug)]
pub struct LightTree {
    nodes: Vec<Node>,
    /// Squared distances count as no less: what is clamped does not get brighter.
    least_distance_squared: f32,
}

impl LightTree {
    /// A tree over lights. Nearer than the root of `least_distance_squared`, which is positive, all are equally likely. `None` if there are no lights or
    /// all are dark.
    pub fn new(lights: &[TreeLight], least_distance_squared: f32) -> Option<Self> {
        let mut order: Vec<u32> = (0..lights.len() as u32).collect();
        let bounds = lights.iter().fold((Vec3::MAX, Vec3::MIN), |(min, max), light| {
            (min.min(light.position), max.max(light.position))
        });
        let extent = (bounds.1 - bounds.0).max_element();
        let mut this = Self { nodes: Vec::with_capacity(2 * lights.len()), least_distance_squared };
        if !lights.is_empty() {
            this.build(lights, &mut order, NORMAL_EXTENT * extent);
        }
        this.nodes.first().is_some_and(|root| root.power > 0.0 && root.power.is_finite()).then_some(this)
    }

    /// Adds the subtree of some lights; halving them bounds the depth by the logarithm of their number. Returns its root.
    fn build(&mut self, lights: &[TreeLight], order: &mut [u32], normal_scale: f32) -> u32 {
        let root = self.nodes.len() as u32;
        if let [only] = *order {
            let TreeLight { position, normal, power } = lights[only as usize];
            let (min, max, axis) = (position, position, normal);
            self.nodes.push(Node { min, max, axis, cos: 1.0, power, next: only, is_leaf: true });
            return root;
        }
        let key = |index: u32| {
            let light = &lights[index as usize];
            [light.position, light.normal * normal_scale]
        };
        let mut bounds = [(Vec3::MAX, Vec3::MIN); 2];
        for &index in order.iter() {
            for ((min, max), value) in bounds.iter_mut().zip(key(index)) {
                (*min, *max) = (min.min(value), max.max(value));
            }
        }
        let [by_place, by_normal] = bounds.map(|(min, max)| max - min);
        let by_normal_first = by_normal.max_element() > by_place.max_element();
        let extent = if by_normal_first { by_normal } else { by_place };
        let axis = extent.max_position();
        let coordinate = |index: u32| key(index)[usize::from(by_normal_first)][axis];
        let middle = order.len() / 2;
        // The index settles ties, so that the tree is the same everywhere.
        order.select_nth_unstable_by(middle, |&a, &b| {
            coordinate(a).total_cmp(&coordinate(b)).then_with(|| a.cmp(&b))
        });
        let (min, max) = bounds[0];
        self.nodes.push(Node { min, max, axis: Vec3::Z, cos: -1.0, power: 0.0, next: 0, is_leaf: false });
        let (first, second) = order.split_at_mut(middle);
        let a = self.build(lights, first, normal_scale);
        let b = self.build(lights, second, normal_scale);
        let (a, b_node) = (self.nodes[a as usize], self.nodes[b as usize]);
        let (axis, cos) = cone_around(&a, &b_node);
        let node = &mut self.nodes[root as usize];
        (node.axis, node.cos, node.power, node.next) = (axis, cos, a.power + b_node.power, b);
        root
    }

    /// Draws a light for a receiver with `u` in [0, 1): its index and its probability. `None` where rounding leaves none.
    #[inline]
    pub fn sample(&self, to: &Receiver, u: f64) -> Option<(u32, f32)> {
        let (mut u, mut pdf, mut at) = (u, 1.0, 0_usize);
        loop {
            let node = &self.nodes[at];
            if node.is_leaf {
                return (pdf > 0.0).then_some((node.next, pdf as f32));
            }
            let second = node.next as usize;
            let p = self.first_probability(at, second, to)?;
            if u < p {
                (u, pdf, at) = (u / p, pdf * p, at + 1);
            } else {
                (u, pdf, at) = ((u - p) / (1.0 - p), pdf * (1.0 - p), second);
            }
        }
    }

    /// Probability of the first of two children; `None` if neither can be taken.
    #[inline]
    fn first_probability(&self, at: usize, second: usize, to: &Receiver) -> Option<f64> {
        let [a, b] = [at + 1, second].map(|i| f64::from(self.importance(&self.nodes[i], to)));
        let sum = a + b;
        (sum > 0.0 && sum.is_finite()).then(|| a / sum)
    }

    /// Estimate of a node's contribution.
    #[inline]
    fn importance(&self, node: &Node, to: &Receiver) -> f32 {
        let half = 0.5 * (node.max - node.min);
        let line = node.min + half - to.p;
        let radius_squared = half.length_squared();
        let distance_squared = line.length_squared();
        if distance_squared <= radius_squared {
            return node.power / radius_squared.max(self.least_distance_squared);
        }
        let wi = line / distance_squared.sqrt();
        // The box is seen within this angle.
        let sin_box_squared = radius_squared / distance_squared;
        let cos_box = (1.0 - sin_box_squared).max(0.0).sqrt();
        let cos_light = cos_of_difference(-wi.dot(node.axis), node.cos);
        let cos_light = cos_of_difference(cos_light, cos_box);
        let cos_to = cos_of_difference(wi.dot(to.normal), cos_box);
        let cosines = cos_light.max(LEAST_COS) * cos_to.max(LEAST_COS);
        node.power * cosines / distance_squared.max(self.least_distance_squared)
    }
}

/// cos(max(a - b, 0)) from the cosines of both angles, in [0, pi].
#[inline]
fn cos_of_difference(cos_a: f32, cos_b: f32) -> f32 {
    if cos_a >= cos_b {
        return 1.0;
    }
    let sines = (1.0 - cos_a * cos_a).max(0.0) * (1.0 - cos_b * cos_b).max(0.0);
    cos_a * cos_b + sines.sqrt()
}

/// The cone around the cones of two nodes: axis and cosine of its half angle.
fn cone_around(a: &Node, b: &Node) -> (Vec3, f32) {
    let sum = a.axis + b.axis;
    let Some(axis) = sum.try_normalize().filter(|_| a.cos > -1.0 && b.cos > -1.0) else {
        return (a.axis, -1.0);
    };
    let half_angle =
        |node: &Node| node.axis.dot(axis).clamp(-1.0, 1.0).acos() + node.cos.clamp(-1.0, 1.0).acos();
    let angle = half_angle(a).max(half_angle(b));
    (axis, if angle < std::f32::consts::PI { angle.cos() } else { -1.0 })
}
