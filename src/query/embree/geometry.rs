//! Meshes and analytic shapes as Embree geometries: meshes share their buffers, analytic shapes answer through callbacks.

use std::mem::size_of;
use std::ptr;

use glam::Vec3;

use super::device::Device;
use super::{EmbreeError, Scene, ffi};
use crate::query::{Ray, Update, analytic};
use crate::scene::{AnalyticShape, Geometry, TriangleMesh};

/// Adds a shape to the scene as geometry `id`, unless it is an instance. Embree gets pointers into `geometry`.
///
/// # Safety
/// `geometry` must outlive `scene`, in place and unchanged.
pub(super) unsafe fn attach(
    device: &Device,
    scene: &Scene,
    id: u32,
    geometry: &Geometry,
    update: Update,
) -> Result<(), EmbreeError> {
    let kind = match geometry {
        // Embree has no geometry without primitives.
        Geometry::Mesh(mesh) if mesh.triangles().is_empty() => return Ok(()),
        Geometry::Instance(_) => return Ok(()),
        Geometry::Mesh(_) => ffi::RTC_GEOMETRY_TYPE_TRIANGLE,
        Geometry::Analytic(_) => ffi::RTC_GEOMETRY_TYPE_USER,
    };
    // SAFETY: the device is live. The scene takes its own reference to the geometry, so ours is released at once and the
    // geometry is freed with the scene. What the two `set` functions ask for is this function's own contract.
    unsafe {
        let handle = ffi::rtcNewGeometry(device.handle(), kind);
        device.check("rtcNewGeometry")?;
        match geometry {
            Geometry::Mesh(mesh) => {
                set_triangles(handle, mesh);
                if update == Update::Refit {
                    ffi::rtcSetGeometryBuildQuality(handle, ffi::RTC_BUILD_QUALITY_REFIT);
                }
            }
            Geometry::Analytic(shape) => set_analytic(handle, shape),
            Geometry::Instance(_) => {}
        }
        ffi::rtcCommitGeometry(handle);
        ffi::rtcAttachGeometryByID(scene.0, handle, id);
        ffi::rtcReleaseGeometry(handle);
    }
    device.check("rtcAttachGeometryByID")
}

/// Shares the mesh's buffers.
///
/// # Safety
/// `handle` is a live triangle geometry; `mesh` outlives it, in place and unchanged.
unsafe fn set_triangles(handle: ffi::RTCGeometry, mesh: &TriangleMesh) {
    // SAFETY: this function's own contract; the buffer of triangles has the item count and stride named.
    unsafe {
        set_positions(handle, mesh);
        ffi::rtcSetSharedGeometryBuffer(
            handle,
            ffi::RTC_BUFFER_TYPE_INDEX,
            0,
            ffi::RTC_FORMAT_UINT3,
            mesh.triangles().as_ptr().cast(),
            0,
            size_of::<[u32; 3]>(),
            mesh.triangles().len(),
        );
    }
}

/// Shares the mesh's positions.
///
/// # Safety
/// As of [`set_triangles`].
pub(super) unsafe fn set_positions(handle: ffi::RTCGeometry, mesh: &TriangleMesh) {
    let vertices = mesh.padded_positions();
    // SAFETY: the buffer has the item count and stride named. Embree reads 16 bytes per vertex; the padding vertex,
    // which is not counted, holds those behind the last.
    unsafe {
        ffi::rtcSetSharedGeometryBuffer(
            handle,
            ffi::RTC_BUFFER_TYPE_VERTEX,
            0,
            ffi::RTC_FORMAT_FLOAT3,
            vertices.as_ptr().cast(),
            0,
            size_of::<Vec3>(),
            vertices.len() - 1,
        );
    }
}

/// Makes `shape` a user geometry of one primitive.
///
/// # Safety
/// `handle` is a live user geometry; `shape` outlives it, in place and unchanged.
unsafe fn set_analytic(handle: ffi::RTCGeometry, shape: &AnalyticShape) {
    let shape = ptr::from_ref(shape).cast_mut().cast();
    // SAFETY: the callbacks take the user data to be an `AnalyticShape`, and never write to it.
    unsafe {
        ffi::rtcSetGeometryUserPrimitiveCount(handle, 1);
        ffi::rtcSetGeometryUserData(handle, shape);
        ffi::rtcSetGeometryBoundsFunction(handle, Some(bounds), ptr::null_mut());
        ffi::rtcSetGeometryIntersectFunction(handle, Some(intersect));
        ffi::rtcSetGeometryOccludedFunction(handle, Some(occluded));
    }
}

// The callbacks are `extern "C"`: should anything in them panic, Rust aborts rather than unwind into Embree.

unsafe extern "C" fn bounds(args: *const ffi::RTCBoundsFunctionArguments) {
    // SAFETY: Embree passes valid arguments, and the user data of `set_analytic`.
    let (shape, out) = unsafe { (&*(*args).geometryUserPtr.cast::<AnalyticShape>(), &mut *(*args).bounds_o) };
    let b = shape.bounds();
    *out = ffi::RTCBounds {
        lower_x: b.min.x,
        lower_y: b.min.y,
        lower_z: b.min.z,
        upper_x: b.max.x,
        upper_y: b.max.y,
        upper_z: b.max.z,
        ..Default::default()
    };
}

unsafe extern "C" fn intersect(args: *const ffi::RTCIntersectFunctionNArguments) {
    // SAFETY: Embree passes valid arguments.
    let args = unsafe { &*args };
    // SAFETY: `valid` has N entries, and N is 1 because only `rtcIntersect1` is called.
    if args.N != 1 || unsafe { *args.valid } == 0 {
        return;
    }
    // SAFETY: for N = 1, `RTCRayHitN` is an `RTCRayHit`; the user data is that of `set_analytic`.
    let (shape, query) = unsafe {
        (&*args.geometryUserPtr.cast::<AnalyticShape>(), &mut *args.rayhit.cast::<ffi::RTCRayHit>())
    };
    if let Some(t) = analytic::intersect(shape, &open_interval(&query.ray)) {
        query.ray.tfar = t;
        query.hit.u = 0.0;
        query.hit.v = 0.0;
        query.hit.primID = args.primID;
        query.hit.geomID = args.geomID;
        // SAFETY: as above; Embree keeps in its context which instance is being traversed.
        query.hit.instID = unsafe { (*args.context).instID };
    }
}

unsafe extern "C" fn occluded(args: *const ffi::RTCOccludedFunctionNArguments) {
    // SAFETY: Embree passes valid arguments.
    let args = unsafe { &*args };
    // SAFETY: `valid` has N entries, and N is 1 because only `rtcOccluded1` is called.
    if args.N != 1 || unsafe { *args.valid } == 0 {
        return;
    }
    // SAFETY: for N = 1, `RTCRayN` is an `RTCRay`; the user data is that of `set_analytic`.
    let (shape, ray) =
        unsafe { (&*args.geometryUserPtr.cast::<AnalyticShape>(), &mut *args.ray.cast::<ffi::RTCRay>()) };
    if analytic::intersect(shape, &open_interval(ray)).is_some() {
        ray.tfar = f32::NEG_INFINITY;
    }
}

/// Undoes [`closed_interval`](super::closed_interval): Embree's `tnear <= t <= tfar` as `t_min < t < t_max`.
pub(super) fn open_interval(ray: &ffi::RTCRay) -> Ray {
    Ray {
        o: Vec3::new(ray.org_x, ray.org_y, ray.org_z),
        d: Vec3::new(ray.dir_x, ray.dir_y, ray.dir_z),
        t_min: ray.tnear.next_down(),
        t_max: ray.tfar.next_up(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::query::embree::{EmbreeQuery, EmbreeSettings};
    use crate::scene::{MaterialId, Shape};

    #[test]
    fn buffers_are_shared_and_not_copied() {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y];
        let mesh = TriangleMesh::new(positions, vec![[0, 1, 2]], vec![], vec![], false).unwrap();
        let (vertices, indices) = (mesh.positions().as_ptr().cast(), mesh.triangles().as_ptr().cast());
        let shapes = [Shape {
            name: String::new(),
            geometry: Geometry::Mesh(mesh),
            material: MaterialId(0),
            emission: None,
        }];
        let query = EmbreeQuery::new(&shapes, EmbreeSettings::default()).unwrap();
        // SAFETY: the scene is live and has a geometry 0.
        let data =
            |kind| unsafe { ffi::rtcGetGeometryBufferData(ffi::rtcGetGeometry(query.scene.0, 0), kind, 0) };
        assert_eq!(data(ffi::RTC_BUFFER_TYPE_VERTEX).cast_const(), vertices);
        assert_eq!(data(ffi::RTC_BUFFER_TYPE_INDEX).cast_const(), indices);
    }
}
