//! Functions on renders: start, watch, cancel, read.

use std::cell::Cell;
use std::ffi::{c_char, c_int, c_void};
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::arguments::{self, check_array, optional_text, text};
use super::border::{Failure, Outcome, call};
use super::prepared::Prepared;
use super::registry::Registry;
use super::scene::{SCENES, SceneObject, in_pool, thread_count};
use super::types::{
    helmholtz_progress, helmholtz_progress_function, helmholtz_render, helmholtz_render_options,
    helmholtz_scene, helmholtz_status, helmholtz_status as Status,
};
use crate::film::{Aov, AovSet, Film, Image, output};
use crate::integrators::{Integrator, IntegratorError};
use crate::query::RayQuery;
use crate::query::with_query;
use crate::render::{Control, Progress, Stop, Target, render_shared};
use crate::scene::IntegratorSettings;
use crate::spec::{Spec, spec};

static RENDERS: Registry<Job> = Registry::new("render");

/// What a render handle stands for.
struct Job {
    film: Mutex<Film>,
    target: Target,
    passes: Range<u32>,
    threads: usize,
    /// Name and version of the backend.
    backend: String,
    cancelled: AtomicBool,
    state: Mutex<JobState>,
    ended: Condvar,
    thread: Mutex<Option<JoinHandle<()>>>,
}

#[derive(Default)]
struct JobState {
    progress: Progress,
    end: Option<Outcome>,
}

/// The options of a render, out of the caller's memory.
struct Options {
    integrator: Option<Spec>,
    aovs: AovSet,
    seed: u64,
    first_pass: u32,
    pass_count: u32,
    time: Option<Duration>,
    threads: usize,
    callback: Callback,
}

/// The caller's function and what is handed to it.
#[derive(Clone, Copy)]
struct Callback {
    function: helmholtz_progress_function,
    user: *mut c_void,
}

// SAFETY: the caller is told that the function is called on another thread with the pointer that was given.
unsafe impl Send for Callback {}

thread_local! {
    /// The render whose callback this thread is in, as an address.
    static CURRENT: Cell<usize> = const { Cell::new(0) };
}

/// Calls the caller's function. Not `C-unwind` as that is: whatever it throws ends the process here, instead of unwinding through Rust.
extern "C" fn call_back(
    function: unsafe extern "C-unwind" fn(*const helmholtz_progress, *mut c_void) -> c_int,
    progress: &helmholtz_progress,
    user: *mut c_void,
) -> c_int {
    // SAFETY: the caller gave the function for this, with this pointer.
    unsafe { function(progress, user) }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What they hold is whole at any time.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Options {
    /// # Safety
    /// `pointer` is null or points to options as documented.
    unsafe fn read(pointer: *const helmholtz_render_options) -> Outcome<Self> {
        let mut options = Self {
            integrator: None,
            aovs: AovSet::default(),
            seed: 0,
            first_pass: 0,
            pass_count: 0,
            time: None,
            threads: 0,
            callback: Callback { function: None, user: std::ptr::null_mut() },
        };
        if pointer.is_null() {
            return Ok(options);
        }
        // SAFETY: this function's own contract, here and below.
        let given = unsafe { arguments::read(pointer, "options")? };
        if let Some(text) = unsafe { optional_text(given.integrator, "integrator")? } {
            let spec = spec(text).map_err(|e| Failure::argument(format!("integrator: {e}")))?;
            options.integrator = Some(spec);
        }
        // SAFETY: as above.
        if let Some(names) = unsafe { optional_text(given.aovs, "aovs")? } {
            options.aovs = aovs(names)?;
        }
        if given.seconds != 0.0 {
            let time = Duration::try_from_secs_f64(given.seconds);
            let refused = |_| Failure::argument(format!("seconds: {} is no time to wait", given.seconds));
            options.time = Some(time.map_err(refused)?);
        }
        Ok(Self {
            seed: given.seed,
            first_pass: given.first_pass,
            pass_count: given.pass_count,
            threads: thread_count(given.threads)?,
            callback: Callback { function: given.progress, user: given.user },
            ..options
        })
    }

    fn integrator(&self, settings: &IntegratorSettings) -> Result<Integrator, IntegratorError> {
        match (&self.integrator, &settings.name) {
            (Some(spec), _) => Integrator::new(&spec.name, &spec.parameters),
            (None, Some(name)) => Integrator::new(name, &settings.parameters),
            (None, None) => Integrator::new("path", &[]),
        }
    }

    fn passes(&self, sample_count: u32) -> Outcome<Range<u32>> {
        let count = match (self.pass_count, self.time) {
            (0, Some(_)) => u32::MAX - self.first_pass,
            (0, None) => sample_count,
            (count, _) => count,
        };
        let end = self.first_pass.checked_add(count);
        end.map(|end| self.first_pass..end).ok_or_else(|| Failure::argument("passes: more than there are"))
    }
}

fn aovs(names: &str) -> Outcome<AovSet> {
    let known = || Aov::ALL.map(Aov::name).join(", ");
    names
        .split(',')
        .map(str::trim)
        .filter(|name| !name.is_empty())
        .map(|name| {
            let aov = Aov::from_name(name);
            aov.ok_or_else(|| Failure::argument(format!("no AOV is called `{name}`; there are: {}", known())))
        })
        .collect()
}

impl Job {
    fn new(prepared: &Prepared, options: &Options, object: &SceneObject) -> Outcome<Self> {
        let (scene, world) = (prepared.scene(), prepared.world());
        let integrator = options.integrator(&scene.integrator)?;
        if let Some(warning) = integrator.warning(world) {
            object.say(format!("warning: {warning}"));
        }
        let film = Film::new(&scene.film, options.aovs, world.lights.radiance_unit())?;
        Ok(Self {
            film: Mutex::new(film),
            target: Target { integrator, seed: options.seed },
            passes: options.passes(scene.sample_count)?,
            threads: options.threads,
            backend: with_query!(prepared.query(), query => query.name()),
            cancelled: AtomicBool::new(false),
            state: Mutex::default(),
            ended: Condvar::new(),
            thread: Mutex::default(),
        })
    }

    /// Renders, on the threads of this render.
    fn run(&self, prepared: &Prepared, options: &Options) -> Outcome {
        let stop = Stop { passes: self.passes.clone(), time: options.time };
        let callback = options.callback;
        let progress = move |progress: &Progress| {
            lock(&self.state).progress = *progress;
            // The whole of it, because closures capture fields, and only the whole is `Send`.
            let callback: Callback = callback;
            if let Some(function) = callback.function {
                let progress = self.progress();
                let outer = CURRENT.replace(std::ptr::from_ref(self).addr());
                let cancels = call_back(function, &progress, callback.user) != 0;
                CURRENT.set(outer);
                if cancels {
                    self.cancelled.store(true, Ordering::Relaxed);
                }
            }
            if self.is_cancelled() { Control::Stop } else { Control::Continue }
        };
        if self.is_cancelled() {
            return Ok(());
        }
        in_pool(self.threads, move || {
            with_query!(prepared.query(), query => {
                render_shared(prepared.world(), query, &self.target, &self.film, &stop, progress)
            })
        })??;
        Ok(())
    }

    fn is_cancelled(&self) -> bool {
        self.cancelled.load(Ordering::Relaxed)
    }

    fn end(&self, outcome: Outcome) {
        lock(&self.state).end = Some(outcome);
        self.ended.notify_all();
    }

    fn progress(&self) -> helmholtz_progress {
        let (passes_done, dropped) = {
            let film = lock(&self.film);
            (film.passes().len(), film.dropped().samples + film.dropped().splats)
        };
        let state = lock(&self.state);
        helmholtz_progress {
            size: size_of::<helmholtz_progress>(),
            passes_done,
            passes_total: if self.passes.end == u32::MAX { u32::MAX } else { self.passes.len() as u32 },
            rays: state.progress.rays,
            dropped,
            seconds: state.progress.elapsed.as_secs_f64(),
            finished: state.end.is_some().into(),
        }
    }

    /// Refuses what would wait for this render on a thread that it waits for.
    fn check_not_current(&self) -> Outcome {
        if CURRENT.get() == std::ptr::from_ref(self).addr() {
            return Err(Failure::busy("a callback cannot wait for its own render"));
        }
        Ok(())
    }

    /// Waits for the end.
    fn wait(&self) -> Outcome {
        let mut state = lock(&self.state);
        let end = loop {
            if let Some(end) = &state.end {
                break end.clone();
            }
            state = self.ended.wait(state).unwrap_or_else(PoisonError::into_inner);
        };
        drop(state);
        end?;
        // One that was cancelled after its last pass is whole.
        let done = lock(&self.film).passes().len();
        if self.is_cancelled() && (done as usize) < self.passes.len() {
            let message = format!("cancelled after {done} passes");
            return Err(Failure::new(Status::HELMHOLTZ_CANCELLED, message));
        }
        Ok(())
    }

    /// What the film shows at the moment.
    fn develop(&self) -> Outcome<Image> {
        // On threads of its own: those of the render may be waiting for the film.
        in_pool(self.threads, || lock(&self.film).develop())
    }
}

/// The thread of a render: says whether it could begin, then renders.
fn render_thread(object: &SceneObject, options: &Options, started: &SyncSender<Outcome<Arc<Job>>>) {
    let mut current = None;
    let job = &mut current;
    let result = catch_unwind(AssertUnwindSafe(|| {
        object.with_prepared(|prepared| {
            let new = Arc::new(Job::new(prepared, options, object)?);
            *job = Some(Arc::clone(&new));
            // Nobody who started this render goes away before it has an answer.
            let _ = started.send(Ok(Arc::clone(&new)));
            new.run(prepared, options)
        })
    }));
    let outcome = match result {
        Ok(outcome) => outcome.and_then(|outcome| outcome),
        Err(payload) => Err(Failure::panic(&*payload)),
    };
    match (current, outcome) {
        (Some(job), outcome) => job.end(outcome),
        (None, Err(failure)) => {
            let _ = started.send(Err(failure));
        }
        (None, Ok(())) => {}
    }
}

/// Starts to render, and returns at once. The scene cannot be changed until the render has ended.
///
/// Any thread. Free the render with helmholtz_render_free.
///
/// # Safety
/// Pointers are null or valid; `options` is as documented there. Its callback and the pointer for it are valid until helmholtz_render_wait or helmholtz_render_free has returned.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_render_start(
    scene: helmholtz_scene,
    options: *const helmholtz_render_options,
    render: *mut helmholtz_render,
) -> helmholtz_status {
    call(|| {
        let object = SCENES.get(scene.id)?;
        arguments::not_null(render, "render")?;
        // SAFETY: this function's own contract.
        let options = unsafe { Options::read(options)? };
        let (sender, receiver) = sync_channel(1);
        let thread = std::thread::Builder::new()
            .name("helmholtz".to_owned())
            .spawn(move || render_thread(&object, &options, &sender))
            .map_err(|error| Failure::new(Status::HELMHOLTZ_OUT_OF_MEMORY, format!("no thread: {error}")))?;
        let job = match receiver.recv() {
            Ok(Ok(job)) => job,
            failed => {
                // It has ended, or is about to.
                let _ = thread.join();
                return Err(match failed {
                    Ok(Err(failure)) => failure,
                    _ => Failure::new(Status::HELMHOLTZ_INTERNAL_ERROR, "the render did not begin"),
                });
            }
        };
        *lock(&job.thread) = Some(thread);
        let id = RENDERS.add(job);
        // SAFETY: this function's own contract; not null.
        unsafe { render.write_unaligned(helmholtz_render { id }) };
        Ok(())
    })
}

/// Waits until a render has ended: HELMHOLTZ_OK if it is finished, HELMHOLTZ_CANCELLED, or why it failed. May be called again, with the same result.
///
/// Any thread but that of the render's callback.
#[unsafe(no_mangle)]
pub extern "C" fn helmholtz_render_wait(render: helmholtz_render) -> helmholtz_status {
    call(|| {
        let job = RENDERS.get(render.id)?;
        job.check_not_current()?;
        job.wait()
    })
}

/// Asks a render to end with the pass that it is at, and returns at once.
///
/// Any thread.
#[unsafe(no_mangle)]
pub extern "C" fn helmholtz_render_cancel(render: helmholtz_render) -> helmholtz_status {
    call(|| {
        RENDERS.get(render.id)?.cancelled.store(true, Ordering::Relaxed);
        Ok(())
    })
}

/// How far a render is.
///
/// Any thread.
///
/// # Safety
/// `progress` is null or as documented.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_render_poll(
    render: helmholtz_render,
    progress: *mut helmholtz_progress,
) -> helmholtz_status {
    call(|| {
        let job = RENDERS.get(render.id)?;
        // SAFETY: this function's own contract.
        unsafe { arguments::write(progress, &job.progress(), "progress") }
    })
}

/// Where pixels go in the caller's memory.
struct Layout {
    width: usize,
    height: usize,
    pixel_stride: usize,
    row_stride: usize,
}

impl Layout {
    /// Checks that everything fits.
    fn new(image: &Image, channels: usize, capacity: usize, strides: [usize; 2]) -> Outcome<Self> {
        let (width, height) = (image.crop.size.x as usize, image.crop.size.y as usize);
        let [pixel_stride, row_stride] = strides;
        let pixel_stride = if pixel_stride == 0 { channels } else { pixel_stride };
        let tight = width.checked_mul(pixel_stride);
        let row_stride = if row_stride == 0 { tight } else { Some(row_stride) };
        let needed = (|| {
            let row = row_stride?.checked_mul(height - 1)?;
            row.checked_add((width - 1).checked_mul(pixel_stride)?)?.checked_add(channels)
        })();
        match (needed, row_stride) {
            (Some(needed), Some(row_stride)) if needed <= capacity => {
                Ok(Self { width, height, pixel_stride, row_stride })
            }
            _ => {
                let needed = needed.map_or("more than there is memory".to_owned(), |n| n.to_string());
                Err(Failure::argument(format!(
                    "{width} x {height} pixels with these strides take {needed} elements, but the capacity is {capacity}"
                )))
            }
        }
    }

    /// Writes one channel.
    ///
    /// # Safety
    /// The capacity that was checked can be written at `data`.
    unsafe fn write<T: Copy>(&self, data: *mut T, channel: usize, value: impl Fn(usize) -> T) {
        for y in 0..self.height {
            for x in 0..self.width {
                let at = y * self.row_stride + x * self.pixel_stride + channel;
                // SAFETY: below the capacity, by the check in `new`.
                unsafe { data.add(at).write(value(y * self.width + x)) };
            }
        }
    }
}

/// Copies channels of the film, as it is at the moment, into the caller's memory.
///
/// `channels` are names separated by commas, as in the EXR file: "R,G,B", "Z", "albedo.R,albedo.G,albedo.B"; "A" is 1 everywhere, since the film keeps no coverage. The first
/// pixel is the upper left one. The element for channel c of the pixel (x, y) is `data[y * row_stride + x * pixel_stride + c]`; a stride of 0 stands for no gaps. `capacity` is the number of floats
/// at `data`.
///
/// Any thread, also that of the callback.
///
/// # Safety
/// `data` can take `capacity` floats; `channels` is null or a text that ends with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_render_read(
    render: helmholtz_render,
    channels: *const c_char,
    data: *mut f32,
    capacity: usize,
    pixel_stride: usize,
    row_stride: usize,
) -> helmholtz_status {
    call(|| {
        let job = RENDERS.get(render.id)?;
        // SAFETY: this function's own contract.
        let names: Vec<_> = unsafe { text(channels, "channels")? }.split(',').map(str::trim).collect();
        arguments::not_null(data.cast_const(), "data")?;
        check_array(data.cast_const(), capacity, "data")?;
        let image = job.develop()?;
        let layout = Layout::new(&image, names.len(), capacity, [pixel_stride, row_stride])?;
        let channels: Vec<_> = names.iter().map(|name| image.floats(name)).collect();
        if let Some(i) = (0..names.len()).find(|&i| channels[i].is_none() && names[i] != "A") {
            return Err(no_channel(&image, names[i], "float"));
        }
        for (c, values) in channels.into_iter().enumerate() {
            // SAFETY: this function's own contract.
            unsafe { layout.write(data, c, |pixel| values.map_or(1.0, |values| values[pixel])) };
        }
        Ok(())
    })
}

/// Copies one channel of whole numbers, "id.shape", "id.primitive" or "sampleCount", as helmholtz_render_read does with floats. UINT32_MAX is no id.
///
/// Any thread, also that of the callback.
///
/// # Safety
/// `data` can take `capacity` numbers; `channel` is null or a text that ends with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_render_read_integers(
    render: helmholtz_render,
    channel: *const c_char,
    data: *mut u32,
    capacity: usize,
    pixel_stride: usize,
    row_stride: usize,
) -> helmholtz_status {
    call(|| {
        let job = RENDERS.get(render.id)?;
        // SAFETY: this function's own contract.
        let name = unsafe { text(channel, "channel")? };
        arguments::not_null(data.cast_const(), "data")?;
        check_array(data.cast_const(), capacity, "data")?;
        let image = job.develop()?;
        let layout = Layout::new(&image, 1, capacity, [pixel_stride, row_stride])?;
        let values = image.integers(name).ok_or_else(|| no_channel(&image, name, "integer"))?;
        // SAFETY: this function's own contract.
        unsafe { layout.write(data, 0, |pixel| values[pixel]) };
        Ok(())
    })
}

fn no_channel(image: &Image, name: &str, kind: &str) -> Failure {
    let known: Vec<_> = image.channels.iter().map(|c| c.name.as_ref()).collect();
    let known = known.join(", ");
    Failure::argument(format!("the film has no {kind} channel `{name}`; it has: {known}"))
}

/// Writes the film, as it is at the moment, to an OpenEXR (.exr, with all channels) or PNG (.png) file. The file appears whole or not at all.
///
/// Any thread, also that of the callback.
///
/// # Safety
/// `path` is null or a text that ends with a zero.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_render_save(
    render: helmholtz_render,
    path: *const c_char,
) -> helmholtz_status {
    call(|| {
        let job = RENDERS.get(render.id)?;
        // SAFETY: this function's own contract.
        let path = Path::new(unsafe { text(path, "path")? });
        let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
        if !["exr", "png"].contains(&extension) {
            return Err(Failure::argument(format!("{}: expected a name in .exr or .png", path.display())));
        }
        let image = job.develop()?;
        if extension == "png" {
            return Ok(output::write_png(path, &image)?);
        }
        let (half, passes) = {
            let film = lock(&job.film);
            (film.settings().half_float, film.passes().ranges().to_vec())
        };
        let passes: Vec<_> = passes.iter().map(|r| format!("{}..{}", r.start, r.end)).collect();
        let metadata = [
            ("integrator", job.target.integrator.describe()),
            ("seed", job.target.seed.to_string()),
            ("passes", passes.join(",")),
            ("backend", job.backend.clone()),
            ("version", env!("CARGO_PKG_VERSION").to_owned()),
        ]
        .map(|(name, value)| (name.to_owned(), value));
        in_pool(job.threads, || output::write_exr(path, &image, half, &metadata))??;
        Ok(())
    })
}

/// Cancels a render if it runs, waits for the end of its pass, and frees it. Its handle is never given out again. Zero is freed without a word.
///
/// Any thread but that of the render's callback.
#[unsafe(no_mangle)]
pub extern "C" fn helmholtz_render_free(render: helmholtz_render) -> helmholtz_status {
    call(|| {
        if render.id == 0 {
            return Ok(());
        }
        RENDERS.get(render.id)?.check_not_current()?;
        let job = RENDERS.remove(render.id)?;
        job.cancelled.store(true, Ordering::Relaxed);
        if let Some(thread) = lock(&job.thread).take() {
            // Its panics were caught.
            let _ = thread.join();
        }
        Ok(())
    })
}
