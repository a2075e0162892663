//! The types of the C interface, under the names that C knows them by. `include/helmholtz.h` is generated from this file and those of the functions.
#![allow(
    non_camel_case_types,
    clippy::enum_variant_names,
    clippy::upper_case_acronyms,
    reason = "they are named as in C, so that the header and this file read alike"
)]

use std::ffi::{c_char, c_int, c_void};

/// How a call went. Values keep their meaning; later versions may have more.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum helmholtz_status {
    /// Done.
    HELMHOLTZ_OK = 0,
    /// The render was cancelled. Its film holds the passes that were finished.
    HELMHOLTZ_CANCELLED = 1,
    /// An argument is null, out of range, of the wrong size, not aligned, not UTF-8 or not known. Nothing was done.
    HELMHOLTZ_INVALID_ARGUMENT = 2,
    /// The handle was never made, was freed, or is one of another kind. Nothing was done.
    HELMHOLTZ_INVALID_HANDLE = 3,
    /// The scene cannot be changed while a render or query uses it, or a callback would wait for itself. Nothing was done; try again later.
    HELMHOLTZ_BUSY = 4,
    /// The scene or mesh is not valid, or asks for what is not supported. Nothing was done.
    HELMHOLTZ_INVALID_SCENE = 5,
    /// There is not enough memory, or no further thread can be started.
    HELMHOLTZ_OUT_OF_MEMORY = 6,
    /// A file cannot be written.
    HELMHOLTZ_FILE_ERROR = 7,
    /// The ray-query backend failed.
    HELMHOLTZ_BACKEND_ERROR = 8,
    /// This build needs a processor with AVX2, and this machine has none.
    HELMHOLTZ_UNSUPPORTED_PROCESSOR = 9,
    /// A defect in the library. A scene that was being changed is lost: free it. Please report it with the message.
    HELMHOLTZ_INTERNAL_ERROR = 10,
}

/// A scene. Zero is no scene. Copies of a handle mean the same scene.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct helmholtz_scene {
    /// Of no meaning to callers.
    pub id: u64,
}

/// A render, running or finished. Zero is no render. Copies of a handle mean the same render.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct helmholtz_render {
    /// Of no meaning to callers.
    pub id: u64,
}

/// Triangles in the caller's memory. They are read and copied by the call that gets them; afterwards the memory is the caller's to do with as it likes.
///
/// All counts are of elements, all strides in bytes; a stride of 0 stands for elements without gaps. Buffers need no padding and no alignment.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct helmholtz_mesh {
    /// sizeof(helmholtz_mesh).
    pub size: usize,
    /// The `filename` by which a scene names it. Not used by helmholtz_scene_set_mesh.
    pub name: *const c_char,
    /// Vertices.
    pub vertex_count: usize,
    /// Three floats per vertex, finite and below 1.8e18 in magnitude.
    pub positions: *const f32,
    /// Bytes from a position to the next.
    pub position_stride: usize,
    /// Three floats per vertex, or null.
    pub normals: *const f32,
    /// Bytes from a normal to the next.
    pub normal_stride: usize,
    /// Two floats per vertex, or null.
    pub uvs: *const f32,
    /// Bytes from a texture coordinate to the next.
    pub uv_stride: usize,
    /// Triangles.
    pub triangle_count: usize,
    /// Three vertex indices per triangle, counter-clockwise seen from the side that normals point to.
    pub indices: *const u32,
    /// Bytes from a triangle to the next.
    pub index_stride: usize,
}

/// How a scene is loaded. All zero but `size` is the default; so is a null pointer to it.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct helmholtz_load_options {
    /// sizeof(helmholtz_load_options).
    pub size: usize,
    /// Meshes that stand for files: where a scene names one of them as the `filename` of a shape, no file is read.
    pub meshes: *const helmholtz_mesh,
    /// How many.
    pub mesh_count: usize,
    /// Names and values of `$name` parameters in turn.
    pub defines: *const *const c_char,
    /// How many pairs.
    pub define_count: usize,
    /// Where files are that a text names; null for the current directory. Not used where the scene is a file.
    pub directory: *const c_char,
    /// Not 0: replace what is not supported, with a message that says by what.
    pub lenient: c_int,
    /// Threads for loading, building and reading; 0 for one per core. They end before the call returns, but for those with which Embree builds.
    pub threads: u32,
}

/// What there is in a scene.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct helmholtz_scene_info {
    /// sizeof(helmholtz_scene_info), set by the caller.
    pub size: usize,
    /// Pixels in a row of the image: of the crop window, if the film has one.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Samples per pixel, and so passes, that the scene asks for.
    pub pass_count: u32,
    /// Shapes; those that rays hit have numbers below this.
    pub shape_count: u32,
    /// Primitives of all shapes, those of instances counted for each.
    pub primitive_count: u64,
    /// Least corner of the box around all shapes, +infinity if there are none.
    pub bounds_min: [f32; 3],
    /// Greatest corner of the box around all shapes, -infinity if there are none.
    pub bounds_max: [f32; 3],
    /// Primitives over which hierarchies were built when the scene was last made ready for rays: 0 if nothing had changed or everything that had could be refitted
    /// (HELMHOLTZ_REFIT). Those of a shape group count once, and each of its instances as one.
    pub built_primitive_count: u64,
}

/// What becomes of what was built for ray queries when meshes change.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum helmholtz_update {
    /// It is built anew. Images are those of a scene that was loaded so.
    HELMHOLTZ_REBUILD = 0,
    /// Hierarchies over meshes whose positions changed keep their shape, and only their boxes are computed anew: quicker to update, slower to trace. Where two
    /// triangles are hit at the very same distance, as on an edge that they share, the other may be reported.
    HELMHOLTZ_REFIT = 1,
}

/// Points origin + t direction for t_min < t < t_max. The layout is fixed.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct helmholtz_ray {
    /// Origin.
    pub origin: [f32; 3],
    /// At least 0.
    pub t_min: f32,
    /// Of unit length.
    pub direction: [f32; 3],
    /// May be infinite.
    pub t_max: f32,
}

/// A hit. The layout is fixed.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct helmholtz_hit {
    /// Number of the shape; UINT32_MAX if nothing was hit.
    pub shape: u32,
    /// Number of the triangle in its mesh; for an instance those of all its parts are counted through.
    pub primitive: u32,
    /// Barycentric coordinate of the second corner.
    pub u: f32,
    /// Barycentric coordinate of the third corner.
    pub v: f32,
    /// Distance along the ray.
    pub t: f32,
}

/// How far a render is.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct helmholtz_progress {
    /// sizeof(helmholtz_progress), set by the caller of helmholtz_render_poll.
    pub size: usize,
    /// Passes that the film holds.
    pub passes_done: u32,
    /// Passes that were asked for; UINT32_MAX if only a time was.
    pub passes_total: u32,
    /// Rays traced.
    pub rays: u64,
    /// Samples and splats that were left out because they were not finite.
    pub dropped: u64,
    /// Time since the first pass began.
    pub seconds: f64,
    /// 0 while it runs, 1 when it is finished, cancelled or has failed.
    pub finished: c_int,
}

/// Called after each pass; a result other than 0 cancels the render.
///
/// It runs on a thread of the render, which is not the one that started it, never twice at a time for one render, perhaps before helmholtz_render_start has returned. It may
/// call any function but those that wait for or free this render, which say HELMHOLTZ_BUSY. It must not leave by longjmp. If it throws, the process is aborted.
pub type helmholtz_progress_function =
    Option<unsafe extern "C-unwind" fn(progress: *const helmholtz_progress, user: *mut c_void) -> c_int>;

/// What is rendered. All zero but `size` is the default; so is a null pointer to it.
#[repr(C)]
#[derive(Debug, Clone, Copy)]
pub struct helmholtz_render_options {
    /// sizeof(helmholtz_render_options).
    pub size: usize,
    /// As on the command line: "bdpt:max_depth=8". Null for the scene's.
    pub integrator: *const c_char,
    /// Names of AOVs, separated by commas, or null: depth, position, geometric_normal, shading_normal, albedo, uv, shape_id, primitive_id, sample_count, variance.
    pub aovs: *const c_char,
    /// Images with different seeds are independent.
    pub seed: u64,
    /// The first pass.
    pub first_pass: u32,
    /// How many passes, each of which takes one sample per pixel; 0 for as many as the scene asks for, or without limit if `seconds` is set.
    pub pass_count: u32,
    /// Begin no pass after this time; 0 for no such limit.
    pub seconds: f64,
    /// Threads; 0 for one per core. The image does not depend on it.
    pub threads: u32,
    /// Called after each pass, or null.
    pub progress: helmholtz_progress_function,
    /// Handed to `progress`.
    pub user: *mut c_void,
}
