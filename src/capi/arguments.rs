//! What callers pass: pointers that may be null, texts that may not be UTF-8, structs of other versions.

use std::ffi::{CStr, c_char};
use std::mem::{MaybeUninit, size_of};

use glam::{Vec2, Vec3};

use super::border::{Failure, Outcome};
use super::types::{
    helmholtz_load_options, helmholtz_mesh, helmholtz_progress, helmholtz_render_options,
    helmholtz_scene_info, helmholtz_status as Status,
};
use crate::scene::load::RawMesh;

/// A struct whose first member is its size, for which any bytes are a value.
///
/// # Safety
/// `repr(C)`, begins with a `usize`, and all bit patterns but padding are valid, all zero among them.
pub(super) unsafe trait Versioned: Copy {}
// SAFETY: numbers, raw pointers and optional function pointers.
unsafe impl Versioned for helmholtz_mesh {}
// SAFETY: as above.
unsafe impl Versioned for helmholtz_load_options {}
// SAFETY: as above.
unsafe impl Versioned for helmholtz_render_options {}
// SAFETY: as above.
unsafe impl Versioned for helmholtz_scene_info {}
// SAFETY: as above.
unsafe impl Versioned for helmholtz_progress {}

/// No struct of a version to come is larger.
const MAX_STRUCT: usize = 4096;

/// The size that a struct says it has.
///
/// # Safety
/// `pointer` is null or points to a `usize`.
unsafe fn stated_size<T: Versioned>(pointer: *const T, what: &str) -> Outcome<usize> {
    not_null(pointer, what)?;
    // SAFETY: this function's own contract; not null.
    let size = unsafe { pointer.cast::<usize>().read_unaligned() };
    // All versions so far have the same members.
    if (size_of::<T>()..=MAX_STRUCT).contains(&size) {
        Ok(size)
    } else {
        let expected = size_of::<T>();
        Err(Failure::argument(format!("{what}: size is {size}, but should be {expected}: set it to sizeof")))
    }
}

/// The caller's struct. One of a later version must not use what it has more.
///
/// # Safety
/// `pointer` is null or points to as many readable bytes as the struct's `size` says.
pub(super) unsafe fn read<T: Versioned>(pointer: *const T, what: &str) -> Outcome<T> {
    // SAFETY: this function's own contract.
    let size = unsafe { stated_size(pointer, what)? };
    let bytes = pointer.cast::<u8>();
    for at in size_of::<T>()..size {
        // SAFETY: within `size`.
        if unsafe { bytes.add(at).read() } != 0 {
            let message = format!("{what}: it uses members that this version of the library does not have");
            return Err(Failure::argument(message));
        }
    }
    let mut value = MaybeUninit::<T>::zeroed();
    // SAFETY: `size` bytes can be read, which are at least those of `T`; any bytes are a `T`.
    unsafe {
        bytes.copy_to_nonoverlapping(value.as_mut_ptr().cast(), size_of::<T>());
        Ok(value.assume_init())
    }
}

/// Fills the caller's struct but for its size. What it has more is set to zero.
///
/// # Safety
/// `pointer` is null or points to as many writable bytes as the struct's `size` says.
pub(super) unsafe fn write<T: Versioned>(pointer: *mut T, value: &T, what: &str) -> Outcome {
    // SAFETY: this function's own contract.
    let size = unsafe { stated_size(pointer.cast_const(), what)? };
    let skipped = size_of::<usize>();
    // SAFETY: `size` bytes can be written, which are at least those of `T`.
    unsafe {
        let (from, to) = (std::ptr::from_ref(value).cast::<u8>(), pointer.cast::<u8>());
        to.add(skipped).copy_from_nonoverlapping(from.add(skipped), size_of::<T>() - skipped);
        to.add(size_of::<T>()).write_bytes(0, size - size_of::<T>());
    }
    Ok(())
}

pub(super) fn not_null<T>(pointer: *const T, what: &str) -> Outcome {
    if pointer.is_null() { Err(Failure::argument(format!("{what} is null"))) } else { Ok(()) }
}

/// A text.
///
/// # Safety
/// `text` is null or points to bytes that end with a zero and do not change during `'a`.
pub(super) unsafe fn text<'a>(text: *const c_char, what: &str) -> Outcome<&'a str> {
    not_null(text, what)?;
    // SAFETY: this function's own contract; not null.
    let bytes = unsafe { CStr::from_ptr(text) };
    bytes.to_str().map_err(|_| Failure::argument(format!("{what} is not UTF-8")))
}

/// A text that may be left out.
///
/// # Safety
/// As of [`text`].
pub(super) unsafe fn optional_text<'a>(pointer: *const c_char, what: &str) -> Outcome<Option<&'a str>> {
    // SAFETY: this function's own contract.
    if pointer.is_null() { Ok(None) } else { unsafe { text(pointer, what) }.map(Some) }
}

/// Checks an array: null only if it is empty, aligned, and no larger than memory.
pub(super) fn check_array<T>(pointer: *const T, count: usize, what: &str) -> Outcome {
    if count == 0 {
        return Ok(());
    }
    not_null(pointer, what)?;
    if !pointer.is_aligned() {
        return Err(Failure::argument(format!("{what} is not aligned to {} bytes", align_of::<T>())));
    }
    let fits = count.checked_mul(size_of::<T>()).is_some_and(|bytes| isize::try_from(bytes).is_ok());
    if fits { Ok(()) } else { Err(Failure::argument(format!("{what}: {count} elements are too many"))) }
}

/// Copies `count` elements of `N` numbers that lie `stride` bytes apart.
///
/// # Safety
/// `data` is null or all the elements can be read.
unsafe fn strided<T: Copy, const N: usize, V>(
    data: *const T,
    count: usize,
    stride: usize,
    what: &str,
    element: impl Fn([T; N]) -> V,
) -> Outcome<Vec<V>> {
    let tight = N * size_of::<T>();
    let stride = if stride == 0 { tight } else { stride };
    if stride < tight {
        return Err(Failure::argument(format!("{what}: a stride of {stride} bytes, but {tight} are needed")));
    }
    if count > 0 {
        not_null(data, what)?;
    }
    // The mesh names more than this anyway; with it, no address below can overflow by the count alone.
    let fits = count.checked_mul(stride).is_some_and(|bytes| isize::try_from(bytes).is_ok());
    if !fits || count >= i32::MAX as usize {
        return Err(Failure::argument(format!("{what}: {count} elements are too many")));
    }
    let mut copy = Vec::new();
    // One more for the padding that Embree wants.
    copy.try_reserve_exact(count + 1).map_err(|_| {
        Failure::new(Status::HELMHOLTZ_OUT_OF_MEMORY, format!("{what}: no memory for {count} elements"))
    })?;
    let bytes = data.cast::<u8>();
    copy.extend((0..count).map(|i| {
        // SAFETY: the element can be read, by this function's own contract.
        element(unsafe { bytes.add(i * stride).cast::<[T; N]>().read_unaligned() })
    }));
    Ok(copy)
}

/// A copy of the caller's mesh.
///
/// # Safety
/// The pointers of `mesh` are null or as the struct documents.
pub(super) unsafe fn mesh(mesh: &helmholtz_mesh) -> Outcome<RawMesh> {
    let vertices = mesh.vertex_count;
    let given = |pointer: *const f32| if pointer.is_null() { 0 } else { vertices };
    // SAFETY: this function's own contract.
    unsafe {
        Ok(RawMesh {
            positions: strided(
                mesh.positions,
                vertices,
                mesh.position_stride,
                "positions",
                Vec3::from_array,
            )?,
            normals: strided(
                mesh.normals,
                given(mesh.normals),
                mesh.normal_stride,
                "normals",
                Vec3::from_array,
            )?,
            uvs: strided(mesh.uvs, given(mesh.uvs), mesh.uv_stride, "uvs", Vec2::from_array)?,
            triangles: strided(mesh.indices, mesh.triangle_count, mesh.index_stride, "indices", |t| t)?,
            attributes: Vec::new(),
        })
    }
}
