//! Ray queries: closest hit and occlusion, behind one trait with two backends.
//!
//! A backend knows shapes and returns identities. It does not know materials, normals or texture
//! coordinates: those are rebuilt from the hit by [`SurfacePoint`], the same way for all backends.
//! Integrators are generic over [`RayQuery`], so that a query costs no dynamic dispatch.
//!
//! That the backends agree can be checked while anything is rendered ([`crosscheck`]); who is wrong where they do not is decided by brute
//! force in f64 ([`reference`](mod@reference)).

pub mod analytic;
mod backend;
pub mod crosscheck;
#[cfg(feature = "embree")]
pub mod embree;
pub mod hexfloat;
pub mod obvhs;
pub mod recorder;
pub mod reference;
mod stamp;
pub mod triangle;

pub(crate) use backend::with_query;
pub use backend::{AnyQuery, Backend, BackendError};

use glam::Vec3;

use crate::scene::{Aabb, Geometry, Shape, SurfacePoint};

/// How much work a backend puts into its hierarchy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BuildQuality {
    /// Quick to build, slow to trace. Morton codes in Embree, `very_fast_build` of `obvhs`.
    Low,
    /// Surface-area heuristic in Embree, `medium_build` of `obvhs`. The same hierarchy for any number of threads.
    #[default]
    Medium,
    /// Slow to build. Spatial splits in Embree, `slow_build` of `obvhs`.
    High,
}

/// What becomes of a hierarchy when shapes have changed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Update {
    /// It is built anew if any surface changed, the same as if it had been built so at first.
    #[default]
    Rebuild,
    /// Meshes whose positions changed keep their part of the hierarchy, with other boxes: quicker the more there is besides them. Hits at equal distances,
    /// as on an edge that two triangles share, may be others than after a rebuild. Any other change rebuilds.
    Refit,
}

/// A segment of a line without its ends: points `o + t d` for `t_min < t < t_max`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Origin.
    pub o: Vec3,
    /// Direction, unit length to within rounding.
    pub d: Vec3,
    /// Hits at this distance or nearer do not count; at least 0.
    pub t_min: f32,
    /// Hits at this distance or farther do not count; may be infinite.
    pub t_max: f32,
}

impl Ray {
    /// An unbounded ray.
    #[inline(always)]
    pub fn new(o: Vec3, d: Vec3) -> Self {
        Self { o, d, t_min: 0.0, t_max: f32::INFINITY }
    }

    /// An unbounded ray that leaves a surface in direction `d` (unit length), on the side that `d` points to.
    #[inline(always)]
    pub fn spawn(from: &SurfacePoint, d: Vec3) -> Self {
        Self::new(from.offset_towards(d), d)
    }

    /// The ray from one surface point towards another that ends just short of it, for [`RayQuery::occluded`].
    /// `None` if the two coincide to within their error bounds.
    #[inline(always)]
    pub fn spawn_between(from: &SurfacePoint, to: &SurfacePoint) -> Option<Self> {
        let line = to.p - from.p;
        Self::segment(from.offset_towards(line), to.offset_towards(-line), line)
    }

    /// The ray from a surface point towards the point `to`, which is on no surface, that ends just short of it.
    /// `None` if the two coincide to within the error bound of `from`.
    #[inline]
    pub fn spawn_to_point(from: &SurfacePoint, to: Vec3) -> Option<Self> {
        let line = to - from.p;
        Self::segment(from.offset_towards(line), to, line)
    }

    /// The ray from `o` to just before `end`, if that still runs in the sense of `line`.
    #[inline(always)]
    fn segment(o: Vec3, end: Vec3, line: Vec3) -> Option<Self> {
        let span = end - o;
        let length = span.length();
        // Rounding of the direction and of the length moves the end by less than this.
        let t_max = length * (1.0 - 4.0 * f32::EPSILON);
        // Distances below 1e-19, whose squares vanish, are none.
        (span.dot(line) > 0.0 && t_max > 0.0).then(|| Self { o, d: span / length, t_min: 0.0, t_max })
    }
}

/// The nearest intersection of a ray with the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Index of the shape.
    pub shape: u32,
    /// Index of the triangle in its mesh; 0 for analytic shapes. In an instance the primitives of all its parts are counted through, so that
    /// this names part and triangle; [`Shape::part`] tells them apart.
    pub primitive: u32,
    /// Barycentric coordinate of the triangle's second corner; 0 for analytic shapes.
    pub u: f32,
    /// Barycentric coordinate of the triangle's third corner; 0 for analytic shapes.
    pub v: f32,
    /// Distance along the ray, as the backend computed it. Where a ray all but lies in the plane of a sliver this can be far off; what
    /// must be right there asks for [`distance`](Self::distance) or for the surface point.
    pub t: f32,
}

/// How far the distance of a hit may lie outside those of the triangle's corners before it is taken to be wrong, relative
/// to the distance of the farthest corner: 128 roundings. Everyday hits keep the very distance that the queries compare.
const DISTANCE_SLACK: f32 = 128.0 * f32::EPSILON;

impl Hit {
    /// Distance along the ray, put back between those of the triangle's corners where it cannot be right.
    ///
    /// Where a ray all but lies in the plane of a sliver, the division by their angle leaves nothing of the distance:
    /// Embree reports 12291 for a triangle that is 600 away (its issues 387 and 423). Barycentrics are not affected. The
    /// distance can only be mended for the hit that was chosen; occlusion and the choice itself stay as they are.
    pub fn distance(&self, shapes: &[Shape], ray: &Ray) -> f32 {
        let mesh = match &shapes[self.shape as usize].geometry {
            Geometry::Mesh(mesh) => mesh,
            Geometry::Analytic(_) => return self.t,
            Geometry::Instance(instance) => {
                let (shape, primitive) = instance.group().part(self.primitive);
                let (o, d) = instance.ray_to_group(ray.o, ray.d);
                return Self { shape, primitive, ..*self }
                    .distance(instance.group().shapes(), &Ray { o, d, ..*ray });
            }
        };
        let corners = mesh.corners(self.primitive).map(|corner| corner - ray.o);
        // Of unit length in the world, but not in the space of a group.
        let length = ray.d.length();
        let [a, b, c] = corners.map(|corner| (corner / length).dot(ray.d / length));
        let farthest = corners.iter().fold(0.0, |far: f32, corner| far.max(corner.abs().max_element()));
        let slack = DISTANCE_SLACK * farthest / length;
        let (near, far) = (a.min(b).min(c), a.max(b).max(c));
        let outside = self.t < near - slack || self.t > far + slack;
        if outside { self.t.clamp(near, far).clamp(ray.t_min, ray.t_max) } else { self.t }
    }

    /// The surface point that was hit. `shapes` and `ray` are those of the query.
    #[inline(always)]
    pub fn surface(&self, shapes: &[Shape], ray: &Ray) -> SurfacePoint {
        SurfacePoint::from_hit(shapes, self.shape, self.primitive, self.u, self.v, ray.o, ray.d, self.t)
    }
}

/// Answers ray queries over a fixed set of shapes. Queries may be made from any number of threads.
pub trait RayQuery: Sync {
    /// The nearest hit with `t_min < t < t_max`, if any. A ray with a NaN or infinite origin or direction hits nothing.
    fn intersect(&self, ray: &Ray) -> Option<Hit>;

    /// Whether anything is hit with `t_min < t < t_max`.
    fn occluded(&self, ray: &Ray) -> bool;

    /// Bounds of all shapes.
    fn bounds(&self) -> Aabb;

    /// Bytes held by the acceleration structure, without the shapes' own buffers.
    fn memory(&self) -> usize;

    /// Name of the backend and version of its library.
    fn name(&self) -> String;
}
