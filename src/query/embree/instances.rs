//! Instances for Embree: one user geometry whose primitives are all instances of the scene, each of which hands the ray on to its group's
//! scene.
//!
//! Embree's own instances (`RTC_GEOMETRY_TYPE_INSTANCE`) invert the map and take rays through it in f32, which moves the surface by its condition number
//! in roundings and by the instance's distance from the origin; and each is an object of some 600 bytes. Here rays are mapped in f64 and
//! rounded once, by the code that the other backend uses too. See `vendor-notes/embree.md`.

use std::collections::HashMap;
use std::ptr;
use std::sync::Arc;

use super::device::Device;
use super::{EmbreeError, EmbreeSettings, Scene, add_shapes, commit, ffi};
use crate::query::Update;
use crate::scene::{Aabb, Geometry, Group, Instance, Shape};

/// An instance as the callbacks meet it.
struct Placed {
    /// Borrowed by the query, or nothing that is looked at.
    instance: *const Instance,
    /// Of the group; belongs to [`Instances`].
    scene: ffi::RTCScene,
    /// Index of the instance among the shapes.
    shape: u32,
}

/// What instances need besides the scene that they are attached to, which must be dropped first.
pub(super) struct Instances {
    /// One per group.
    scenes: Vec<Scene>,
    placed: Box<[Placed]>,
    /// Primitives of all groups.
    group_primitives: u64,
}

impl Instances {
    /// Builds the hierarchies of all groups that have instances among the shapes.
    pub(super) fn new(
        device: &Device,
        shapes: &[Shape],
        settings: EmbreeSettings,
    ) -> Result<Self, EmbreeError> {
        let mut scenes = Vec::new();
        let mut known: HashMap<*const Group, ffi::RTCScene> = HashMap::new();
        let mut placed = Vec::new();
        let mut group_primitives = 0;
        for (shape, index) in shapes.iter().zip(0..) {
            let Geometry::Instance(instance) = &shape.geometry else { continue };
            if instance.group().primitive_count() == 0 {
                continue;
            }
            let key = Arc::as_ptr(instance.group());
            let scene = if let Some(scene) = known.get(&key) {
                *scene
            } else {
                // SAFETY: the device is live.
                let scene = Scene(unsafe { ffi::rtcNewScene(device.handle()) });
                device.check("rtcNewScene")?;
                // SAFETY: the shapes are borrowed for longer than the scene is kept.
                unsafe { add_shapes(device, &scene, instance.group().shapes(), Update::Rebuild)? };
                commit(device, &scene, settings, Update::Rebuild)?;
                let handle = scene.0;
                known.insert(key, handle);
                scenes.push(scene);
                group_primitives += u64::from(instance.group().primitive_count());
                handle
            };
            placed.push(Placed { instance, scene, shape: index });
        }
        Ok(Self { scenes, placed: placed.into(), group_primitives })
    }

    /// Number of primitives over which hierarchies are built on behalf of instances: those of the groups, and the instances themselves.
    pub(super) fn built_primitives(&self) -> u64 {
        self.group_primitives + self.placed.len() as u64
    }

    /// Has the callbacks look at these shapes, which must be those of [`new`](Self::new).
    pub(super) fn look_at(&mut self, shapes: &[Shape]) {
        for placed in &mut self.placed {
            if let Some(Geometry::Instance(instance)) = shapes.get(placed.shape as usize).map(|s| &s.geometry)
            {
                placed.instance = instance;
            }
        }
    }

    /// Bytes held besides what Embree holds.
    pub(super) fn memory(&self) -> usize {
        size_of_val(&*self.placed) + self.scenes.capacity() * size_of::<Scene>()
    }

    /// Adds all instances to the scene as geometry `id`.
    ///
    /// # Safety
    /// `self` and the shapes must outlive `scene`; neither moves, because they are behind pointers.
    pub(super) unsafe fn attach(&self, device: &Device, scene: &Scene, id: u32) -> Result<(), EmbreeError> {
        if self.placed.is_empty() {
            return Ok(());
        }
        let count = u32::try_from(self.placed.len()).unwrap_or(u32::MAX);
        let data = self.placed.as_ptr().cast_mut().cast();
        // SAFETY: the device is live. The callbacks take the user data to be `count` of `Placed`, and never write to them.
        unsafe {
            let handle = ffi::rtcNewGeometry(device.handle(), ffi::RTC_GEOMETRY_TYPE_USER);
            device.check("rtcNewGeometry")?;
            ffi::rtcSetGeometryUserPrimitiveCount(handle, count);
            ffi::rtcSetGeometryUserData(handle, data);
            ffi::rtcSetGeometryBoundsFunction(handle, Some(bounds), ptr::null_mut());
            ffi::rtcSetGeometryIntersectFunction(handle, Some(intersect));
            ffi::rtcSetGeometryOccludedFunction(handle, Some(occluded));
            ffi::rtcCommitGeometry(handle);
            ffi::rtcAttachGeometryByID(scene.0, handle, id);
            ffi::rtcReleaseGeometry(handle);
        }
        device.check("rtcAttachGeometryByID")
    }
}

/// A ray in the space of an instance's group; the interval stays.
fn ray_to_group(instance: &Instance, ray: &ffi::RTCRay) -> ffi::RTCRay {
    let world = super::geometry::open_interval(ray);
    let (o, d) = instance.ray_to_group(world.o, world.d);
    ffi::RTCRay { org_x: o.x, org_y: o.y, org_z: o.z, dir_x: d.x, dir_y: d.y, dir_z: d.z, ..*ray }
}

// The callbacks are `extern "C"`: should anything in them panic, Rust aborts rather than unwind into Embree.

unsafe extern "C" fn bounds(args: *const ffi::RTCBoundsFunctionArguments) {
    // SAFETY: Embree passes valid arguments, the user data of `attach`, and the index of one of its primitives.
    let (placed, out) = unsafe {
        let args = &*args;
        (&*args.geometryUserPtr.cast::<Placed>().add(args.primID as usize), &mut *args.bounds_o)
    };
    // SAFETY: the shapes outlive the scene that is being built.
    let Aabb { min, max } = unsafe { &*placed.instance }.bounds();
    *out = ffi::RTCBounds {
        lower_x: min.x,
        lower_y: min.y,
        lower_z: min.z,
        upper_x: max.x,
        upper_y: max.y,
        upper_z: max.z,
        ..Default::default()
    };
}

unsafe extern "C" fn intersect(args: *const ffi::RTCIntersectFunctionNArguments) {
    // SAFETY: Embree passes valid arguments. N is 1 because only `rtcIntersect1` is called: `valid` has one entry, and `RTCRayHitN` is an
    // `RTCRayHit`. The user data is that of `attach`, its scenes are committed, its shapes are borrowed by the query. No reference is held while Embree goes on with the ray.
    unsafe {
        if (*args).N != 1 || *(*args).valid == 0 {
            return;
        }
        let placed = &*(*args).geometryUserPtr.cast::<Placed>().add((*args).primID as usize);
        let mut ray = ray_to_group(&*placed.instance, &(*(*args).rayhit.cast::<ffi::RTCRayHit>()).ray);
        ffi::rtcForwardIntersect1(args, placed.scene, &raw mut ray, placed.shape);
    }
}

unsafe extern "C" fn occluded(args: *const ffi::RTCOccludedFunctionNArguments) {
    // SAFETY: as in `intersect`; `RTCRayN` is an `RTCRay`.
    unsafe {
        if (*args).N != 1 || *(*args).valid == 0 {
            return;
        }
        let placed = &*(*args).geometryUserPtr.cast::<Placed>().add((*args).primID as usize);
        let mut ray = ray_to_group(&*placed.instance, &*(*args).ray.cast::<ffi::RTCRay>());
        ffi::rtcForwardOccluded1(args, placed.scene, &raw mut ray, placed.shape);
    }
}
