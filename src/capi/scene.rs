//! Functions on scenes: load, change, build.

use std::ffi::{CStr, c_char};
use std::panic::resume_unwind;
use std::path::Path;
use std::sync::{Arc, Mutex, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard, TryLockError};

use super::arguments::{self, optional_text, text};
use super::border::{Failure, Outcome, call};
use super::prepared::{Detached, Prepared};
use super::registry::Registry;
use super::types::{
    helmholtz_load_options, helmholtz_mesh, helmholtz_scene, helmholtz_scene_info, helmholtz_status,
    helmholtz_status as Status, helmholtz_update,
};
use crate::query::{Backend, Update};
use crate::scene::load::{LoadError, LoadOptions, Loaded, Origins, load, load_text};
use crate::scene::{Aabb, Scene};
use crate::spec::spec;

/// All scenes.
pub(super) static SCENES: Registry<SceneObject> = Registry::new("scene");

/// What a scene handle stands for.
pub(super) struct SceneObject {
    state: RwLock<State>,
    /// What there was to say, one line each.
    messages: Mutex<Vec<String>>,
    threads: usize,
}

struct State {
    form: Form,
    origins: Origins,
    backend: Backend,
    update: Update,
    /// Primitives over which hierarchies were built when the scene was last prepared.
    built_primitives: u64,
}

/// A scene that can be changed, or rendered.
enum Form {
    Raw(Box<(Scene, Option<Detached>)>),
    Prepared(Box<Prepared>),
    /// A panic came between the two.
    Lost,
}

/// Runs something on a pool of its own, whose threads have ended when it returns. 0 threads: one per core.
///
/// They are joined here, because a scope (and rayon's `build_scoped`) waits for what its threads do, but not for what they do when they
/// end: a caller who then unloads the library or leaves the process would pull the ground from under them.
pub(super) fn in_pool<R: Send>(threads: usize, body: impl FnOnce() -> R + Send) -> Outcome<R> {
    std::thread::scope(|scope| {
        let mut workers = Vec::new();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).spawn_handler(|worker| {
            workers.push(std::thread::Builder::new().spawn_scoped(scope, || worker.run())?);
            Ok(())
        });
        let pool = pool.build()?;
        let result = pool.install(body);
        drop(pool);
        for worker in workers {
            worker.join().unwrap_or_else(|panic| resume_unwind(panic));
        }
        Ok(result)
    })
}

/// More threads than this are a mistake.
const MAX_THREADS: u32 = 4096;

pub(super) fn thread_count(threads: u32) -> Outcome<usize> {
    if threads > MAX_THREADS {
        return Err(Failure::argument(format!("threads: at most {MAX_THREADS}, found {threads}")));
    }
    Ok(threads as usize)
}

fn lost() -> Failure {
    let message = "the scene is lost: an internal error came while it was being changed";
    Failure::new(Status::HELMHOLTZ_INTERNAL_ERROR, message)
}

impl SceneObject {
    fn new(loaded: Loaded, threads: usize) -> Self {
        let Loaded { scene, warnings, origins, .. } = loaded;
        let form = Form::Raw(Box::new((scene, None)));
        let (backend, update) = (Backend::default(), Update::default());
        let state = State { form, origins, backend, update, built_primitives: 0 };
        let messages = Mutex::new(warnings.iter().map(ToString::to_string).collect());
        Self { state: RwLock::new(state), messages, threads }
    }

    pub(super) fn say(&self, message: String) {
        self.messages.lock().unwrap_or_else(PoisonError::into_inner).push(message);
    }

    fn read(&self) -> Outcome<RwLockReadGuard<'_, State>> {
        // Nobody ever waits to write, so this only waits for who is writing.
        self.state.read().map_err(|_| lost())
    }

    /// The right to change the scene, which a running render has not let go of.
    fn write(&self) -> Outcome<RwLockWriteGuard<'_, State>> {
        self.state.try_write().map_err(|error| match error {
            TryLockError::Poisoned(_) => lost(),
            TryLockError::WouldBlock => Failure::busy("the scene is in use by a render or another call"),
        })
    }

    /// Lends the scene with all that is built over it; builds that before if need be.
    pub(super) fn with_prepared<R>(&self, body: impl FnOnce(&Prepared) -> R) -> Outcome<R> {
        loop {
            if let Form::Prepared(prepared) = &self.read()?.form {
                return Ok(body(prepared));
            }
            // Never waits to write: who then wants to read, as a callback may within a render, would wait behind.
            match self.state.try_write() {
                Ok(mut state) => state.prepare(self.threads)?,
                Err(TryLockError::WouldBlock) => std::thread::yield_now(),
                Err(TryLockError::Poisoned(_)) => return Err(lost()),
            }
        }
    }

    /// Changes the scene.
    fn edit(&self, body: impl FnOnce(&mut Scene, &mut Origins) -> Outcome) -> Outcome {
        let mut guard = self.write()?;
        let state = &mut *guard;
        let (mut scene, built) = match std::mem::replace(&mut state.form, Form::Lost) {
            Form::Raw(raw) => *raw,
            Form::Prepared(prepared) => prepared.dissolve(),
            Form::Lost => return Err(lost()),
        };
        let outcome = body(&mut scene, &mut state.origins);
        state.form = Form::Raw(Box::new((scene, built)));
        outcome
    }
}

impl State {
    fn prepare(&mut self, threads: usize) -> Outcome {
        let raw = match std::mem::replace(&mut self.form, Form::Lost) {
            Form::Raw(raw) => raw,
            // Another thread was quicker.
            prepared @ Form::Prepared(_) => {
                self.form = prepared;
                return Ok(());
            }
            Form::Lost => return Err(lost()),
        };
        let (backend, update) = (self.backend, self.update);
        // Where there are no threads to be had, the scene must not be lost.
        let mut slot = Some(raw);
        let prepared = in_pool(threads, || {
            slot.take().map(|raw| {
                let (scene, built) = *raw;
                Prepared::new(scene, built, backend, update)
            })
        });
        match prepared {
            Ok(Some(Ok(prepared))) => {
                self.built_primitives = prepared.built_primitives();
                self.form = Form::Prepared(Box::new(prepared));
                Ok(())
            }
            Ok(Some(Err(failed))) => {
                let (scene, failure) = *failed;
                self.form = Form::Raw(Box::new((scene, None)));
                Err(failure)
            }
            Ok(None) => Err(lost()),
            Err(failure) => {
                self.form = slot.map_or(Form::Lost, Form::Raw);
                Err(failure)
            }
        }
    }

    /// The scene in whatever form it is.
    fn scene(&self) -> Outcome<&Scene> {
        match &self.form {
            Form::Raw(raw) => Ok(&raw.0),
            Form::Prepared(prepared) => Ok(prepared.scene()),
            Form::Lost => Err(lost()),
        }
    }
}

/// What the options of loading say.
struct Loading<'a> {
    options: LoadOptions,
    directory: &'a Path,
    threads: usize,
}

/// Copies everything but texts out of the caller's options.
///
/// # Safety
/// `pointer` is null or points to options as documented.
unsafe fn loading<'a>(pointer: *const helmholtz_load_options) -> Outcome<Loading<'a>> {
    let mut loading = Loading { options: LoadOptions::default(), directory: Path::new(""), threads: 0 };
    if pointer.is_null() {
        return Ok(loading);
    }
    // SAFETY: this function's own contract.
    let given = unsafe { arguments::read(pointer, "options")? };
    loading.threads = thread_count(given.threads)?;
    loading.options.lenient = given.lenient != 0;
    // SAFETY: as documented, a text or null.
    if let Some(directory) = unsafe { optional_text(given.directory, "directory")? } {
        loading.directory = Path::new(directory);
    }
    let defines = given.define_count.checked_mul(2);
    let defines = defines.ok_or_else(|| Failure::argument("define_count is too large"))?;
    arguments::check_array(given.defines, defines, "defines")?;
    for i in (0..defines).step_by(2) {
        // SAFETY: as documented, there are as many texts.
        let (name, value) = unsafe {
            (text(*given.defines.add(i), "a define")?, text(*given.defines.add(i + 1), "a define")?)
        };
        loading.options.defines.push((name.to_owned(), value.to_owned()));
    }
    if given.mesh_count > 0 {
        arguments::not_null(given.meshes, "meshes")?;
    }
    let mut at = given.meshes;
    for _ in 0..given.mesh_count {
        // SAFETY: as documented, there are as many meshes, one after the other as their size says.
        let (mesh, name, raw) = unsafe {
            let mesh = arguments::read(at, "mesh")?;
            (mesh, text(mesh.name, "the name of a mesh")?, arguments::mesh(&mesh)?)
        };
        if loading.options.meshes.iter().any(|(known, _)| known == name) {
            return Err(Failure::argument(format!("two meshes are called `{name}`")));
        }
        loading.options.meshes.push((name.to_owned(), Arc::new(raw)));
        at = at.wrapping_byte_add(mesh.size);
    }
    Ok(loading)
}

/// Loads a scene, and gives it a handle.
///
/// # Safety
/// `out` is null or can be written to.
unsafe fn add_scene(
    out: *mut helmholtz_scene,
    threads: usize,
    load: impl FnOnce() -> Result<Loaded, LoadError> + Send,
) -> Outcome {
    arguments::not_null(out, "scene")?;
    let loaded = in_pool(threads, load)??;
    let id = SCENES.add(Arc::new(SceneObject::new(loaded, threads)));
    // SAFETY: this function's own contract; not null.
    unsafe { out.write_unaligned(helmholtz_scene { id }) };
    Ok(())
}

/// Loads a scene file: Mitsuba XML (.xml), or a mesh (.obj, .ply), which gets a neutral sky and a camera that sees all of it.
///
/// Any thread. Free the scene with helmholtz_scene_free.
///
/// # Safety
/// Pointers are null or valid, texts end with a zero; `options` is as documented there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_scene_load(
    path: *const c_char,
    options: *const helmholtz_load_options,
    scene: *mut helmholtz_scene,
) -> helmholtz_status {
    // SAFETY: this function's own contract.
    call(|| unsafe {
        let path = text(path, "path")?;
        let Loading { options, threads, .. } = loading(options)?;
        add_scene(scene, threads, || load(Path::new(path), &options))
    })
}

/// Loads a scene from a text of Mitsuba XML. With `options->meshes`, its meshes may lie in memory instead of in files.
///
/// Any thread. Free the scene with helmholtz_scene_free.
///
/// # Safety
/// Pointers are null or valid, texts end with a zero; `options` is as documented there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_scene_parse(
    xml: *const c_char,
    options: *const helmholtz_load_options,
    scene: *mut helmholtz_scene,
) -> helmholtz_status {
    // SAFETY: this function's own contract.
    call(|| unsafe {
        let xml = text(xml, "xml")?;
        let Loading { options, directory, threads } = loading(options)?;
        add_scene(scene, threads, || load_text(xml, directory, &options))
    })
}

/// Changes a scene by a text of Mitsuba XML in which everything is optional. Its sensor and its integrator take the place of those there are, each BSDF the place
/// of the one with its id, for all shapes that use it; further shapes, emitters and BSDFs are added. All or nothing.
///
/// What was built for ray queries is kept unless shapes are added. Textures of BSDFs that were replaced stay in memory as long as the scene.
///
/// Any thread; HELMHOLTZ_BUSY while a render or another call uses the scene.
///
/// # Safety
/// Pointers are null or valid, texts end with a zero; `options` is as documented there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_scene_edit(
    scene: helmholtz_scene,
    xml: *const c_char,
    options: *const helmholtz_load_options,
) -> helmholtz_status {
    // SAFETY: this function's own contract.
    call(|| unsafe {
        let object = SCENES.get(scene.id)?;
        let xml = text(xml, "xml")?;
        let Loading { options, directory, threads } = loading(options)?;
        object.edit(|scene, origins| {
            let warnings = in_pool(threads, || origins.edit(scene, xml, directory, &options))??;
            for warning in warnings {
                object.say(warning.to_string());
            }
            Ok(())
        })
    })
}

/// Gives the shape of that id, which came from a mesh (of a file or in memory), other vertices and triangles. They are placed by the transform, and get the normals, that the scene
/// asked for when it was loaded.
///
/// If the triangles are the same as before, this is a deformation: what was built for ray queries is updated as helmholtz_scene_set_backend says.
/// Shapes in shape groups cannot be changed.
///
/// Any thread; HELMHOLTZ_BUSY while a render or another call uses the scene.
///
/// # Safety
/// Pointers are null or valid, texts end with a zero; `mesh` is as documented there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_scene_set_mesh(
    scene: helmholtz_scene,
    shape: *const c_char,
    mesh: *const helmholtz_mesh,
) -> helmholtz_status {
    // SAFETY: this function's own contract.
    call(|| unsafe {
        let object = SCENES.get(scene.id)?;
        let shape = text(shape, "shape")?;
        let mesh = arguments::mesh(&arguments::read(mesh, "mesh")?)?;
        object.edit(|scene, origins| Ok(origins.set_mesh(scene, shape, mesh)?))
    })
}

/// Chooses what answers ray queries, as on the command line: "embree", "embree:quality=high", "obvhs"; null for the default. And what becomes of
/// what was built when meshes are deformed: HELMHOLTZ_REBUILD (the default) or HELMHOLTZ_REFIT.
///
/// Any thread; HELMHOLTZ_BUSY while a render or another call uses the scene.
///
/// # Safety
/// `backend` is null or a text that ends with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_scene_set_backend(
    scene: helmholtz_scene,
    backend: *const c_char,
    update: i32,
) -> helmholtz_status {
    call(|| {
        let object = SCENES.get(scene.id)?;
        // SAFETY: this function's own contract.
        let backend = match unsafe { optional_text(backend, "backend")? } {
            None => Backend::default(),
            Some(text) => {
                let spec = spec(text).map_err(|error| Failure::argument(format!("backend: {error}")))?;
                Backend::new(&spec.name, &spec.parameters)?
            }
        };
        // As a number, because no other value of an enum may come into Rust.
        let update = match update {
            x if x == helmholtz_update::HELMHOLTZ_REBUILD as i32 => Update::Rebuild,
            x if x == helmholtz_update::HELMHOLTZ_REFIT as i32 => Update::Refit,
            _ => return Err(Failure::argument(format!("update: there is no {update}"))),
        };
        object.edit(|_, _| Ok(()))?;
        let mut state = object.write()?;
        (state.backend, state.update) = (backend, update);
        Ok(())
    })
}

/// Builds what rays and renders need, as far as it is not there. They would do it themselves: this only chooses the moment.
///
/// Any thread.
#[unsafe(no_mangle)]
pub extern "C" fn helmholtz_scene_commit(scene: helmholtz_scene) -> helmholtz_status {
    call(|| SCENES.get(scene.id)?.with_prepared(|_| ()))
}

/// What there is in a scene.
///
/// Any thread.
///
/// # Safety
/// `info` is null or as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_scene_describe(
    scene: helmholtz_scene,
    info: *mut helmholtz_scene_info,
) -> helmholtz_status {
    call(|| {
        let object = SCENES.get(scene.id)?;
        let state = object.read()?;
        let scene = state.scene()?;
        let bounds = scene.shapes.iter().fold(Aabb::EMPTY, |b, shape| b.union(shape.geometry.bounds()));
        let value = helmholtz_scene_info {
            size: 0,
            width: scene.film.crop.size.x,
            height: scene.film.crop.size.y,
            pass_count: scene.sample_count,
            shape_count: scene.shapes.len() as u32,
            primitive_count: scene.shapes.iter().map(|s| u64::from(s.geometry.primitive_count())).sum(),
            bounds_min: bounds.min.to_array(),
            bounds_max: bounds.max.to_array(),
            built_primitive_count: state.built_primitives,
        };
        // SAFETY: this function's own contract.
        unsafe { arguments::write(info, &value, "info") }
    })
}

/// The number that hits give for the shape of that id.
///
/// Any thread.
///
/// # Safety
/// Pointers are null or valid, texts end with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_scene_find_shape(
    scene: helmholtz_scene,
    shape: *const c_char,
    number: *mut u32,
) -> helmholtz_status {
    call(|| {
        let object = SCENES.get(scene.id)?;
        arguments::not_null(number, "number")?;
        // SAFETY: this function's own contract.
        let name = unsafe { text(shape, "shape")? };
        let state = object.read()?;
        let found = state.scene()?.shapes.iter().position(|shape| shape.name == name);
        let found = found.ok_or_else(|| Failure::argument(format!("there is no shape `{name}`")))?;
        // SAFETY: this function's own contract; not null.
        unsafe { number.write_unaligned(found as u32) };
        Ok(())
    })
}

/// Copies what there was to say about the scene since it was loaded, one line each: what was chosen, replaced or has no effect. `length` gets the number of
/// bytes that the whole text takes with its final zero; `text` gets as much of it as fits, always with a final zero. With a `capacity` of 0, `text` may be null.
///
/// Any thread.
///
/// # Safety
/// `text` can take `capacity` bytes; `length` is null or can be written to.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_scene_messages(
    scene: helmholtz_scene,
    text: *mut c_char,
    capacity: usize,
    length: *mut usize,
) -> helmholtz_status {
    call(|| {
        let object = SCENES.get(scene.id)?;
        let mut lines = object.messages.lock().unwrap_or_else(PoisonError::into_inner).join("\n");
        lines.retain(|c| c != '\0');
        lines.push('\0');
        // A character must not be cut, nor the zero be lost.
        let room = capacity.min(lines.len());
        let kept = (0..room).rev().find(|&end| lines.is_char_boundary(end)).unwrap_or(0);
        arguments::check_array(text.cast_const(), capacity, "text")?;
        // SAFETY: this function's own contract; `kept` is less than `capacity`.
        unsafe {
            if capacity > 0 {
                text.copy_from_nonoverlapping(lines.as_ptr().cast(), kept);
                text.add(kept).write(0);
            }
            if !length.is_null() {
                length.write_unaligned(lines.len());
            }
        }
        debug_assert!(CStr::from_bytes_with_nul(lines.as_bytes()).is_ok());
        Ok(())
    })
}

/// Frees a scene. Renders that use it go on. Its handle is never given out again. Zero is freed without a word.
///
/// Any thread.
#[unsafe(no_mangle)]
pub extern "C" fn helmholtz_scene_free(scene: helmholtz_scene) -> helmholtz_status {
    call(|| if scene.id == 0 { Ok(()) } else { SCENES.remove(scene.id).map(drop) })
}
