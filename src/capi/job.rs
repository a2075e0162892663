//! A render behind its handle: its options, its state, the caller's callback. The functions on it are in `render`.

use std::cell::Cell;
use std::ffi::{c_int, c_void};
use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use super::arguments::{self, optional_text};
use super::border::{Failure, Outcome};
use super::prepared::Prepared;
use super::scene::{SceneObject, in_pool, thread_count};
use super::types::{
    helmholtz_progress, helmholtz_progress_function, helmholtz_render_options, helmholtz_status as Status,
};
use crate::film::{Aov, AovSet, Film, Image};
use crate::integrators::{Integrator, IntegratorError};
use crate::query::RayQuery;
use crate::query::with_query;
use crate::render::{Control, Progress, Stop, Target, render_shared};
use crate::scene::IntegratorSettings;
use crate::spec::{Spec, spec};

/// What a render handle stands for.
pub(super) struct Job {
    pub(super) film: Mutex<Film>,
    pub(super) target: Target,
    passes: Range<u32>,
    pub(super) threads: usize,
    /// Name and version of the backend.
    pub(super) backend: String,
    pub(super) cancelled: AtomicBool,
    state: Mutex<JobState>,
    ended: Condvar,
    pub(super) thread: Mutex<Option<JoinHandle<()>>>,
}

#[derive(Default)]
struct JobState {
    progress: Progress,
    end: Option<Outcome>,
}

/// The options of a render, out of the caller's memory.
pub(super) struct Options {
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

pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    // What they hold is whole at any time.
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Options {
    /// # Safety
    /// `pointer` is null or points to options as documented.
    pub(super) unsafe fn read(pointer: *const helmholtz_render_options) -> Outcome<Self> {
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
    pub(super) fn new(prepared: &Prepared, options: &Options, object: &SceneObject) -> Outcome<Self> {
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
    pub(super) fn run(&self, prepared: &Prepared, options: &Options) -> Outcome {
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

    pub(super) fn end(&self, outcome: Outcome) {
        lock(&self.state).end = Some(outcome);
        self.ended.notify_all();
    }

    pub(super) fn progress(&self) -> helmholtz_progress {
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
    pub(super) fn check_not_current(&self) -> Outcome {
        if CURRENT.get() == std::ptr::from_ref(self).addr() {
            return Err(Failure::busy("a callback cannot wait for its own render"));
        }
        Ok(())
    }

    /// Waits for the end.
    pub(super) fn wait(&self) -> Outcome {
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
    pub(super) fn develop(&self) -> Outcome<Image> {
        // On threads of its own: those of the render may be waiting for the film.
        in_pool(self.threads, || lock(&self.film).develop())
    }
}
