//! Functions on renders: start, watch, cancel, read.

use std::ffi::c_char;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{SyncSender, sync_channel};

use super::arguments::{self, check_array, text};
use super::border::{Failure, Outcome, call};
use super::job::{Job, Options, lock};
use super::registry::Registry;
use super::scene::{SCENES, SceneObject, in_pool};
use super::types::{
    helmholtz_progress, helmholtz_render, helmholtz_render_options, helmholtz_scene, helmholtz_status,
    helmholtz_status as Status,
};
use crate::film::{Image, output};

static RENDERS: Registry<Job> = Registry::new("render");

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
