/* Helmholtz, a renderer that follows light both ways: the C interface.
 *
 * Every function may be called from any thread. Those that can fail return a helmholtz_status; helmholtz_last_error() then says why, for this thread.
 * Handles are numbers, not pointers: one that was freed or made up is HELMHOLTZ_INVALID_HANDLE, not undefined behaviour. Null pointers, wrong sizes, NaN in
 * buffers and the like are HELMHOLTZ_INVALID_ARGUMENT or HELMHOLTZ_INVALID_SCENE. What cannot be checked is the caller's: that pointers which are not null point to
 * as much memory as the counts say, and that nobody else writes to it during the call. Where an allocation of moderate size fails, the process is aborted.
 *
 * Structs begin with their size, to be set to sizeof; set the rest to zero for the defaults.
 */

#ifndef HELMHOLTZ_H
#define HELMHOLTZ_H

/* Generated from src/capi by cbindgen: UPDATE_HEADER=1 cargo test --release header. Do not edit. */

#include <stddef.h>
#include <stdint.h>

// How a call went. Values keep their meaning; later versions may have more.
typedef enum helmholtz_status {
  // Done.
  HELMHOLTZ_OK = 0,
  // The render was cancelled. Its film holds the passes that were finished.
  HELMHOLTZ_CANCELLED = 1,
  // An argument is null, out of range, of the wrong size, not aligned, not UTF-8 or not known. Nothing was done.
  HELMHOLTZ_INVALID_ARGUMENT = 2,
  // The handle was never made, was freed, or is one of another kind. Nothing was done.
  HELMHOLTZ_INVALID_HANDLE = 3,
  // The scene cannot be changed while a render or query uses it, or a callback would wait for itself. Nothing was done; try again later.
  HELMHOLTZ_BUSY = 4,
  // The scene or mesh is not valid, or asks for what is not supported. Nothing was done.
  HELMHOLTZ_INVALID_SCENE = 5,
  // There is not enough memory, or no further thread can be started.
  HELMHOLTZ_OUT_OF_MEMORY = 6,
  // A file cannot be written.
  HELMHOLTZ_FILE_ERROR = 7,
  // The ray-query backend failed.
  HELMHOLTZ_BACKEND_ERROR = 8,
  // This build needs a processor with AVX2, and this machine has none.
  HELMHOLTZ_UNSUPPORTED_PROCESSOR = 9,
  // A defect in the library. A scene that was being changed is lost: free it. Please report it with the message.
  HELMHOLTZ_INTERNAL_ERROR = 10,
} helmholtz_status;

// What becomes of what was built for ray queries when meshes change.
typedef enum helmholtz_update {
  // It is built anew. Images are those of a scene that was loaded so.
  HELMHOLTZ_REBUILD = 0,
  // Hierarchies over meshes whose positions changed keep their shape, and only their boxes are computed anew: quicker to update, slower to trace. Where two
  // triangles are hit at the very same distance, as on an edge that they share, the other may be reported.
  HELMHOLTZ_REFIT = 1,
} helmholtz_update;

// A scene. Zero is no scene. Copies of a handle mean the same scene.
typedef struct helmholtz_scene {
  // Of no meaning to callers.
  uint64_t id;
} helmholtz_scene;

// Points origin + t direction for t_min < t < t_max. The layout is fixed.
typedef struct helmholtz_ray {
  // Origin.
  float origin[3];
  // At least 0.
  float t_min;
  // Of unit length.
  float direction[3];
  // May be infinite.
  float t_max;
} helmholtz_ray;

// A hit. The layout is fixed.
typedef struct helmholtz_hit {
  // Number of the shape; UINT32_MAX if nothing was hit.
  uint32_t shape;
  // Number of the triangle in its mesh; for an instance those of all its parts are counted through.
  uint32_t primitive;
  // Barycentric coordinate of the second corner.
  float u;
  // Barycentric coordinate of the third corner.
  float v;
  // Distance along the ray.
  float t;
} helmholtz_hit;

// How far a render is.
typedef struct helmholtz_progress {
  // sizeof(helmholtz_progress), set by the caller of helmholtz_render_poll.
  size_t size;
  // Passes that the film holds.
  uint32_t passes_done;
  // Passes that were asked for; UINT32_MAX if only a time was.
  uint32_t passes_total;
  // Rays traced.
  uint64_t rays;
  // Samples and splats that were left out because they were not finite.
  uint64_t dropped;
  // Time since the first pass began.
  double seconds;
  // 0 while it runs, 1 when it is finished, cancelled or has failed.
  int finished;
} helmholtz_progress;

// Called after each pass; a result other than 0 cancels the render.
//
// It runs on a thread of the render, which is not the one that started it, never twice at a time for one render, perhaps before helmholtz_render_start has returned. It may
// call any function but those that wait for or free this render, which say HELMHOLTZ_BUSY. It must not leave by longjmp. If it throws, the process is aborted.
typedef int (*helmholtz_progress_function)(const struct helmholtz_progress *progress, void *user);

// What is rendered. All zero but `size` is the default; so is a null pointer to it.
typedef struct helmholtz_render_options {
  // sizeof(helmholtz_render_options).
  size_t size;
  // As on the command line: "bdpt:max_depth=8". Null for the scene's.
  const char *integrator;
  // Names of AOVs, separated by commas, or null: depth, position, geometric_normal, shading_normal, albedo, uv, shape_id, primitive_id, sample_count, variance.
  const char *aovs;
  // Images with different seeds are independent.
  uint64_t seed;
  // The first pass.
  uint32_t first_pass;
  // How many passes, each of which takes one sample per pixel; 0 for as many as the scene asks for, or without limit if `seconds` is set.
  uint32_t pass_count;
  // Begin no pass after this time; 0 for no such limit.
  double seconds;
  // Threads; 0 for one per core. The image does not depend on it.
  uint32_t threads;
  // Called after each pass, or null.
  helmholtz_progress_function progress;
  // Handed to `progress`.
  void *user;
} helmholtz_render_options;

// A render, running or finished. Zero is no render. Copies of a handle mean the same render.
typedef struct helmholtz_render {
  // Of no meaning to callers.
  uint64_t id;
} helmholtz_render;

// Triangles in the caller's memory. They are read and copied by the call that gets them; afterwards the memory is the caller's to do with as it likes.
//
// All counts are of elements, all strides in bytes; a stride of 0 stands for elements without gaps. Buffers need no padding and no alignment.
typedef struct helmholtz_mesh {
  // sizeof(helmholtz_mesh).
  size_t size;
  // The `filename` by which a scene names it. Not used by helmholtz_scene_set_mesh.
  const char *name;
  // Vertices.
  size_t vertex_count;
  // Three floats per vertex, finite and below 1.8e18 in magnitude.
  const float *positions;
  // Bytes from a position to the next.
  size_t position_stride;
  // Three floats per vertex, or null.
  const float *normals;
  // Bytes from a normal to the next.
  size_t normal_stride;
  // Two floats per vertex, or null.
  const float *uvs;
  // Bytes from a texture coordinate to the next.
  size_t uv_stride;
  // Triangles.
  size_t triangle_count;
  // Three vertex indices per triangle, counter-clockwise seen from the side that normals point to.
  const uint32_t *indices;
  // Bytes from a triangle to the next.
  size_t index_stride;
} helmholtz_mesh;

// How a scene is loaded. All zero but `size` is the default; so is a null pointer to it.
typedef struct helmholtz_load_options {
  // sizeof(helmholtz_load_options).
  size_t size;
  // Meshes that stand for files: where a scene names one of them as the `filename` of a shape, no file is read.
  const struct helmholtz_mesh *meshes;
  // How many.
  size_t mesh_count;
  // Names and values of `$name` parameters in turn.
  const char *const *defines;
  // How many pairs.
  size_t define_count;
  // Where files are that a text names; null for the current directory. Not used where the scene is a file.
  const char *directory;
  // Not 0: replace what is not supported, with a message that says by what.
  int lenient;
  // Threads for loading, building and reading; 0 for one per core. They end before the call returns, but for those with which Embree builds.
  uint32_t threads;
} helmholtz_load_options;

// What there is in a scene.
typedef struct helmholtz_scene_info {
  // sizeof(helmholtz_scene_info), set by the caller.
  size_t size;
  // Pixels in a row of the image: of the crop window, if the film has one.
  uint32_t width;
  // Rows of the image.
  uint32_t height;
  // Samples per pixel, and so passes, that the scene asks for.
  uint32_t pass_count;
  // Shapes; those that rays hit have numbers below this.
  uint32_t shape_count;
  // Primitives of all shapes, those of instances counted for each.
  uint64_t primitive_count;
  // Least corner of the box around all shapes, +infinity if there are none.
  float bounds_min[3];
  // Greatest corner of the box around all shapes, -infinity if there are none.
  float bounds_max[3];
  // Primitives over which hierarchies were built when the scene was last made ready for rays: 0 if nothing had changed or everything that had could be refitted
  // (HELMHOLTZ_REFIT). Those of a shape group count once, and each of its instances as one.
  uint64_t built_primitive_count;
} helmholtz_scene_info;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Version of the library: major * 10000 + minor * 100 + patch. While the major version is 0, minor versions may change the interface; the shared library's name says
// which one it has (libhelmholtz.so.0.1). From 1.0 on only the major version may. Patches never do.
uint32_t helmholtz_version(void);

// What went wrong in the last call of this thread that failed; empty if none did. The text is valid until this thread's next call that fails, or its end.
const char *helmholtz_last_error(void);

// The name of a status, as in this header; "unknown" for other numbers. The text is valid for ever.
const char *helmholtz_status_name(int status);

// The nearest hit of each of `count` rays, on the calling thread. A ray with a NaN or infinite origin or direction hits nothing.
//
// Any thread, any number of them at a time. Builds what is needed if the scene has changed.
//
// # Safety
// `rays` and `hits` have `count` elements and do not overlap.
enum helmholtz_status helmholtz_intersect(struct helmholtz_scene scene,
                                          const struct helmholtz_ray *rays,
                                          struct helmholtz_hit *hits,
                                          size_t count);

// Whether each of `count` rays hits anything, 1 or 0, on the calling thread.
//
// Any thread, any number of them at a time. Builds what is needed if the scene has changed.
//
// # Safety
// `rays` and `occluded` have `count` elements and do not overlap.
enum helmholtz_status helmholtz_occluded(struct helmholtz_scene scene,
                                         const struct helmholtz_ray *rays,
                                         uint8_t *occluded,
                                         size_t count);

// Starts to render, and returns at once. The scene cannot be changed until the render has ended.
//
// Any thread. Free the render with helmholtz_render_free.
//
// # Safety
// Pointers are null or valid; `options` is as documented there. Its callback and the pointer for it are valid until helmholtz_render_wait or helmholtz_render_free has returned.
enum helmholtz_status helmholtz_render_start(struct helmholtz_scene scene,
                                             const struct helmholtz_render_options *options,
                                             struct helmholtz_render *render);

// Waits until a render has ended: HELMHOLTZ_OK if it is finished, HELMHOLTZ_CANCELLED, or why it failed. May be called again, with the same result.
//
// Any thread but that of the render's callback.
enum helmholtz_status helmholtz_render_wait(struct helmholtz_render render);

// Asks a render to end with the pass that it is at, and returns at once.
//
// Any thread.
enum helmholtz_status helmholtz_render_cancel(struct helmholtz_render render);

// How far a render is.
//
// Any thread.
//
// # Safety
// `progress` is null or as documented.
enum helmholtz_status helmholtz_render_poll(struct helmholtz_render render,
                                            struct helmholtz_progress *progress);

// Copies channels of the film, as it is at the moment, into the caller's memory.
//
// `channels` are names separated by commas, as in the EXR file: "R,G,B", "Z", "albedo.R,albedo.G,albedo.B"; "A" is 1 everywhere, since the film keeps no coverage. The first
// pixel is the upper left one. The element for channel c of the pixel (x, y) is `data[y * row_stride + x * pixel_stride + c]`; a stride of 0 stands for no gaps. `capacity` is the number of floats
// at `data`.
//
// Any thread, also that of the callback.
//
// # Safety
// `data` can take `capacity` floats; `channels` is null or a text that ends with a zero.
enum helmholtz_status helmholtz_render_read(struct helmholtz_render render,
                                            const char *channels,
                                            float *data,
                                            size_t capacity,
                                            size_t pixel_stride,
                                            size_t row_stride);

// Copies one channel of whole numbers, "id.shape", "id.primitive" or "sampleCount", as helmholtz_render_read does with floats. UINT32_MAX is no id.
//
// Any thread, also that of the callback.
//
// # Safety
// `data` can take `capacity` numbers; `channel` is null or a text that ends with a zero.
enum helmholtz_status helmholtz_render_read_integers(struct helmholtz_render render,
                                                     const char *channel,
                                                     uint32_t *data,
                                                     size_t capacity,
                                                     size_t pixel_stride,
                                                     size_t row_stride);

// Writes the film, as it is at the moment, to an OpenEXR (.exr, with all channels) or PNG (.png) file. The file appears whole or not at all.
//
// Any thread, also that of the callback.
//
// # Safety
// `path` is null or a text that ends with a zero.
enum helmholtz_status helmholtz_render_save(struct helmholtz_render render,
                                            const char *path);

// Cancels a render if it runs, waits for the end of its pass, and frees it. Its handle is never given out again. Zero is freed without a word.
//
// Any thread but that of the render's callback.
enum helmholtz_status helmholtz_render_free(struct helmholtz_render render);

// Loads a scene file: Mitsuba XML (.xml), or a mesh (.obj, .ply), which gets a neutral sky and a camera that sees all of it.
//
// Any thread. Free the scene with helmholtz_scene_free.
//
// # Safety
// Pointers are null or valid, texts end with a zero; `options` is as documented there.
enum helmholtz_status helmholtz_scene_load(const char *path,
                                           const struct helmholtz_load_options *options,
                                           struct helmholtz_scene *scene);

// Loads a scene from a text of Mitsuba XML. With `options->meshes`, its meshes may lie in memory instead of in files.
//
// Any thread. Free the scene with helmholtz_scene_free.
//
// # Safety
// Pointers are null or valid, texts end with a zero; `options` is as documented there.
enum helmholtz_status helmholtz_scene_parse(const char *xml,
                                            const struct helmholtz_load_options *options,
                                            struct helmholtz_scene *scene);

// Changes a scene by a text of Mitsuba XML in which everything is optional. Its sensor and its integrator take the place of those there are, each BSDF the place
// of the one with its id, for all shapes that use it; further shapes, emitters and BSDFs are added. All or nothing.
//
// What was built for ray queries is kept unless shapes are added. Textures of BSDFs that were replaced stay in memory as long as the scene.
//
// Any thread; HELMHOLTZ_BUSY while a render or another call uses the scene.
//
// # Safety
// Pointers are null or valid, texts end with a zero; `options` is as documented there.
enum helmholtz_status helmholtz_scene_edit(struct helmholtz_scene scene,
                                           const char *xml,
                                           const struct helmholtz_load_options *options);

// Gives the shape of that id, which came from a mesh (of a file or in memory), other vertices and triangles. They are placed by the transform, and get the normals, that the scene
// asked for when it was loaded.
//
// If the triangles are the same as before, this is a deformation: what was built for ray queries is updated as helmholtz_scene_set_backend says.
// Shapes in shape groups cannot be changed.
//
// Any thread; HELMHOLTZ_BUSY while a render or another call uses the scene.
//
// # Safety
// Pointers are null or valid, texts end with a zero; `mesh` is as documented there.
enum helmholtz_status helmholtz_scene_set_mesh(struct helmholtz_scene scene,
                                               const char *shape,
                                               const struct helmholtz_mesh *mesh);

// Chooses what answers ray queries, as on the command line: "embree", "embree:quality=high", "obvhs"; null for the default. And what becomes of
// what was built when meshes are deformed: HELMHOLTZ_REBUILD (the default) or HELMHOLTZ_REFIT.
//
// Any thread; HELMHOLTZ_BUSY while a render or another call uses the scene.
//
// # Safety
// `backend` is null or a text that ends with a zero.
enum helmholtz_status helmholtz_scene_set_backend(struct helmholtz_scene scene,
                                                  const char *backend,
                                                  int32_t update);

// Builds what rays and renders need, as far as it is not there. They would do it themselves: this only chooses the moment.
//
// Any thread.
enum helmholtz_status helmholtz_scene_commit(struct helmholtz_scene scene);

// What there is in a scene.
//
// Any thread.
//
// # Safety
// `info` is null or as documented.
enum helmholtz_status helmholtz_scene_describe(struct helmholtz_scene scene,
                                               struct helmholtz_scene_info *info);

// The number that hits give for the shape of that id.
//
// Any thread.
//
// # Safety
// Pointers are null or valid, texts end with a zero.
enum helmholtz_status helmholtz_scene_find_shape(struct helmholtz_scene scene,
                                                 const char *shape,
                                                 uint32_t *number);

// Copies what there was to say about the scene since it was loaded, one line each: what was chosen, replaced or has no effect. `length` gets the number of
// bytes that the whole text takes with its final zero; `text` gets as much of it as fits, always with a final zero. With a `capacity` of 0, `text` may be null.
//
// Any thread.
//
// # Safety
// `text` can take `capacity` bytes; `length` is null or can be written to.
enum helmholtz_status helmholtz_scene_messages(struct helmholtz_scene scene,
                                               char *text,
                                               size_t capacity,
                                               size_t *length);

// Frees a scene. Renders that use it go on. Its handle is never given out again. Zero is freed without a word.
//
// Any thread.
enum helmholtz_status helmholtz_scene_free(struct helmholtz_scene scene);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* HELMHOLTZ_H */
