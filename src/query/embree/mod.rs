//! Ray queries by Intel Embree 4.
//!
//! [`EmbreeQuery`] is a safe wrapper around one committed Embree scene that borrows the shapes it was built from. The
//! bindings are generated from the installed header; what is known about the library is in `vendor-notes/embree.md`.
#![allow(unsafe_code)]

mod detached;
mod device;
mod ffi;
mod geometry;
mod instances;

use std::ptr;

use glam::Vec3;
use thiserror::Error;

use super::{BuildQuality, Hit, Ray, RayQuery, Update};
use crate::scene::{Aabb, Geometry, Shape, TriangleMesh};
pub use detached::DetachedEmbree;
use device::Device;
use instances::Instances;

/// Hits nearer than this do not count. It is far below what Embree's tests resolve, and there so that `tnear` and its
/// products in those tests are no denormals, which cost up to a quarter of the speed. (Flushing denormals to zero would
/// have to be done on every thread that ever asks a query, and gains nothing beyond this.)
const LEAST_DISTANCE: f32 = 1e-30;

/// How an [`EmbreeQuery`] is built. The defaults are measured: see `vendor-notes/embree.md`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EmbreeSettings {
    /// Watertight triangle and box tests. On by default: without it rays slip through edges, and the ends of a ray's
    /// interval are off by a few ulp.
    pub robust: bool,
    /// Effort of the build; medium by default. High adds spatial splits and is **not deterministic** when built by several
    /// threads; for scenes that are robust or compact, Embree 4.4 builds the same as for medium.
    pub quality: BuildQuality,
    /// Keep indices instead of copies of the vertices in the hierarchy: less memory, slower queries. Off by default.
    pub compact: bool,
}

impl Default for EmbreeSettings {
    fn default() -> Self {
        Self { robust: true, quality: BuildQuality::default(), compact: false }
    }
}

/// Why Embree cannot be used.
#[derive(Debug, Error, PartialEq, Eq)]
pub enum EmbreeError {
    /// The library that was loaded does not fit the header that this program was compiled with.
    #[error(
        "Embree {library} was loaded, but this program was compiled for Embree {header} or a later version with the same first number"
    )]
    Version {
        /// Version of the library.
        library: String,
        /// Version of the header.
        header: String,
    },
    /// The library was compiled without something that is needed.
    #[error("the Embree library was compiled without {what}")]
    BuiltWithout {
        /// What is missing.
        what: &'static str,
    },
    /// A shape is not finite or reaches beyond [`TriangleMesh::COORDINATE_LIMIT`].
    #[error("shape {name} reaches beyond {limit:e}, the bound of Embree's coordinates", limit = TriangleMesh::COORDINATE_LIMIT)]
    OutOfRange {
        /// The shape's name.
        name: String,
    },
    /// Embree reported an error.
    #[error("{call} failed: {message}")]
    Failed {
        /// Which call, or the last of several.
        call: &'static str,
        /// Embree's description.
        message: String,
    },
}

/// Owns an `RTCScene`.
struct Scene(ffi::RTCScene);

impl Drop for Scene {
    fn drop(&mut self) {
        // SAFETY: this is the only reference to the scene that was made, and it is not used again.
        unsafe { ffi::rtcReleaseScene(self.0) };
    }
}

/// Shapes as a committed Embree scene. Geometry ids are indices of shapes; the one after them stands for all instances.
pub struct EmbreeQuery<'s> {
    // Dropped in this order: the scene before what it points to and before its device.
    scene: Scene,
    instances: Instances,
    device: Device,
    shapes: &'s [Shape],
    bounds: Aabb,
    settings: EmbreeSettings,
    update: Update,
    built_primitives: u64,
}

// SAFETY: Embree's handles belong to no thread. After the commit in `new` the scene is only read, by queries, which
// Embree allows from any number of threads; the shapes behind its pointers are borrowed and never change.
unsafe impl Send for EmbreeQuery<'_> {}
// SAFETY: as for `Send`.
unsafe impl Sync for EmbreeQuery<'_> {}

impl<'s> EmbreeQuery<'s> {
    /// Builds the hierarchy, with as many threads as the current rayon pool has. Vertices and indices are shared with `shapes`, not copied.
    ///
    /// # Errors
    /// If the library does not suit, a shape is out of range, or Embree fails, for instance for want of memory.
    pub fn new(shapes: &'s [Shape], settings: EmbreeSettings) -> Result<Self, EmbreeError> {
        Self::with_update(shapes, settings, Update::Rebuild)
    }

    /// [`new`](Self::new), for shapes that will change. For [`Update::Refit`] each mesh has a hierarchy of its own below that of all, which is slower to
    /// trace.
    ///
    /// # Errors
    /// As of [`new`](Self::new).
    pub fn with_update(
        shapes: &'s [Shape],
        settings: EmbreeSettings,
        update: Update,
    ) -> Result<Self, EmbreeError> {
        let device = Device::new(rayon::current_num_threads())?;
        // Before the scene, so that it is dropped after it if something fails.
        let instances = Instances::new(&device, shapes, settings)?;
        // SAFETY: the device is live.
        let scene = Scene(unsafe { ffi::rtcNewScene(device.handle()) });
        device.check("rtcNewScene")?;
        // SAFETY: the shapes are borrowed for 's, which `EmbreeQuery` and with it the scene cannot outlive; the scene is dropped before
        // `instances`.
        unsafe {
            add_shapes(&device, &scene, shapes, update)?;
            instances.attach(&device, &scene, shapes.len() as u32)?;
        }
        commit(&device, &scene, settings, update)?;
        let bounds = shapes.iter().fold(Aabb::EMPTY, |bounds, shape| bounds.union(shape.geometry.bounds()));
        let own = shapes.iter().filter(|shape| !matches!(shape.geometry, Geometry::Instance(_)));
        let own: u64 = own.map(|shape| u64::from(shape.geometry.primitive_count())).sum();
        let built_primitives = own + instances.built_primitives();
        Ok(Self { scene, instances, device, shapes, bounds, settings, update, built_primitives })
    }

    /// Number of primitives over which hierarchies were built to make this query: of a new one all, those of a group once and each instance as one; of one that was
    /// made by [`DetachedEmbree::attach`] none if there was nothing to build.
    pub fn built_primitives(&self) -> u64 {
        self.built_primitives
    }

    /// Index of the shape and the primitive of a hit on an instance.
    #[cold]
    #[inline(never)]
    fn in_instance(&self, hit: &ffi::RTCHit) -> (u32, u32) {
        let shape = hit.instID[0];
        let first = match &self.shapes[shape as usize].geometry {
            Geometry::Instance(instance) => instance.group().first_primitive(hit.geomID),
            Geometry::Mesh(_) | Geometry::Analytic(_) => 0,
        };
        (shape, first + hit.primID)
    }
}

/// Adds all but instances to a scene, with their indices as geometry ids.
///
/// # Safety
/// `shapes` must outlive `scene`, in place and unchanged.
unsafe fn add_shapes(
    device: &Device,
    scene: &Scene,
    shapes: &[Shape],
    update: Update,
) -> Result<(), EmbreeError> {
    for (shape, id) in shapes.iter().zip(0..) {
        check_range(shape)?;
        // SAFETY: this function's own contract.
        unsafe { geometry::attach(device, scene, id, &shape.geometry, update)? };
    }
    Ok(())
}

/// Meshes and instances are in range by construction; Embree would leave out an analytic shape that is not, without a word.
fn check_range(shape: &Shape) -> Result<(), EmbreeError> {
    let Geometry::Analytic(analytic) = &shape.geometry else { return Ok(()) };
    let Aabb { min, max } = analytic.bounds();
    // Written so that NaN fails.
    if min.abs().max(max.abs()).cmplt(Vec3::splat(TriangleMesh::COORDINATE_LIMIT)).all() {
        Ok(())
    } else {
        Err(EmbreeError::OutOfRange { name: shape.name.clone() })
    }
}

/// Builds the hierarchy.
fn commit(
    device: &Device,
    scene: &Scene,
    settings: EmbreeSettings,
    update: Update,
) -> Result<(), EmbreeError> {
    let quality = match settings.quality {
        // What Embree calls low is a hierarchy of hierarchies, each with a quality of its own.
        _ if update == Update::Refit => ffi::RTC_BUILD_QUALITY_LOW,
        BuildQuality::Low => ffi::RTC_BUILD_QUALITY_LOW,
        BuildQuality::Medium => ffi::RTC_BUILD_QUALITY_MEDIUM,
        BuildQuality::High => ffi::RTC_BUILD_QUALITY_HIGH,
    };
    let mut flags = ffi::RTC_SCENE_FLAG_NONE;
    if settings.robust {
        flags |= ffi::RTC_SCENE_FLAG_ROBUST;
    }
    if settings.compact {
        flags |= ffi::RTC_SCENE_FLAG_COMPACT;
    }
    if update == Update::Refit {
        // Without it Embree forgets after a commit what it has built, and builds all of it at the next.
        flags |= ffi::RTC_SCENE_FLAG_DYNAMIC;
    }
    // SAFETY: the scene is live, and no query runs yet.
    unsafe {
        ffi::rtcSetSceneBuildQuality(scene.0, quality);
        ffi::rtcSetSceneFlags(scene.0, flags);
        ffi::rtcCommitScene(scene.0);
    }
    device.check("rtcCommitScene")
}

/// The ray for Embree, or `None` for one that hits nothing by definition: empty, NaN or infinite.
///
/// Embree's robust tests accept `tnear <= t <= tfar`, so the interval shrinks by one float at either end.
#[inline]
fn closed_interval(ray: &Ray) -> Option<ffi::RTCRay> {
    // Most rays have the whole half-line, for which the steps of one float make no difference.
    let tnear = if ray.t_min == 0.0 { LEAST_DISTANCE } else { ray.t_min.next_up().max(LEAST_DISTANCE) };
    let tfar = if ray.t_max == f32::INFINITY { f32::MAX } else { ray.t_max.next_down() };
    // One NaN or infinity among them makes this sum NaN. A NaN in `t_max` fails the comparison; that in `t_min`, `max` has dropped.
    let zero = (ray.o + ray.d).element_sum() * 0.0 + ray.t_min * 0.0;
    (tnear <= tfar && zero == 0.0).then_some(ffi::RTCRay {
        org_x: ray.o.x,
        org_y: ray.o.y,
        org_z: ray.o.z,
        tnear,
        dir_x: ray.d.x,
        dir_y: ray.d.y,
        dir_z: ray.d.z,
        time: 0.0,
        tfar,
        mask: u32::MAX,
        id: 0,
        flags: 0,
    })
}

impl RayQuery for EmbreeQuery<'_> {
    #[inline(always)]
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let ray = closed_interval(ray)?;
        let (tnear, tfar) = (ray.tnear, ray.tfar);
        let none = ffi::RTC_INVALID_GEOMETRY_ID;
        let hit = ffi::RTCHit { geomID: none, instID: [none], ..Default::default() };
        let mut query = ffi::RTCRayHit { ray, hit };
        // SAFETY: the scene is committed; `query` has the size and alignment of the header's struct.
        unsafe { ffi::rtcIntersect1(self.scene.0, &raw mut query, ptr::null_mut()) };
        if query.hit.geomID == none {
            return None;
        }
        let (shape, primitive) = if query.hit.instID[0] == none {
            (query.hit.geomID, query.hit.primID)
        } else {
            self.in_instance(&query.hit)
        };
        Some(Hit { shape, primitive, u: query.hit.u, v: query.hit.v, t: query.ray.tfar.clamp(tnear, tfar) })
    }

    #[inline(always)]
    fn occluded(&self, ray: &Ray) -> bool {
        let Some(mut query) = closed_interval(ray) else { return false };
        // SAFETY: the scene is committed; `query` has the size and alignment of the header's struct.
        unsafe { ffi::rtcOccluded1(self.scene.0, &raw mut query, ptr::null_mut()) };
        query.tfar == f32::NEG_INFINITY
    }

    fn bounds(&self) -> Aabb {
        self.bounds
    }

    fn memory(&self) -> usize {
        self.device.memory() + self.instances.memory()
    }

    fn name(&self) -> String {
        format!("embree {}", self.device.version())
    }
}
