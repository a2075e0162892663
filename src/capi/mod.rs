//! The C interface: scenes, ray queries and renders for programs in other languages.
//!
//! `include/helmholtz.h` is generated from here; its text is the documentation of these functions. What holds for all of them:
//!
//! - Each returns a [`helmholtz_status`] (or what cannot fail), and on failure leaves a message for [`helmholtz_last_error`].
//! - No panic leaves a function (`border`), and none of what is documented as checked is undefined behaviour. Handles are numbers from a counter
//!   (`registry`), never followed as pointers: those that were freed, made up, or are of another kind are told apart with certainty but for luck.
//! - Any function may be called from any thread at any time. A scene is locked for as long as a call or a render uses it; what would change it meanwhile says
//!   [`HELMHOLTZ_BUSY`](helmholtz_status::HELMHOLTZ_BUSY) instead of waiting.
//! - No thread of ours outlives the call or the render that started it; rayon's global pool is never used. Those with which Embree builds are TBB's, which keeps them.
//!
//! What it is not: another way to describe scenes. Those are Mitsuba XML, whose meshes may lie in the caller's memory; so every name and
//! default is that of the files.
#![allow(unsafe_code)]

mod arguments;
mod border;
mod job;
mod prepared;
mod query;
mod registry;
mod render;
mod scene;
mod types;

pub use query::*;
pub use render::*;
pub use scene::*;
pub use types::*;

use std::ffi::{c_char, c_int};

use crate::processor;

/// Version of the library: major * 10000 + minor * 100 + patch. While the major version is 0, minor versions may change the interface; the shared library's name says
/// which one it has (libhelmholtz.so.0.1). From 1.0 on only the major version may. Patches never do.
#[unsafe(no_mangle)]
pub extern "C" fn helmholtz_version() -> u32 {
    const fn number(text: &str) -> u32 {
        let (digits, mut value, mut i) = (text.as_bytes(), 0, 0);
        while i < digits.len() {
            value = value * 10 + (digits[i] - b'0') as u32;
            i += 1;
        }
        value
    }
    const VERSION: u32 = number(env!("CARGO_PKG_VERSION_MAJOR")) * 10_000
        + number(env!("CARGO_PKG_VERSION_MINOR")) * 100
        + number(env!("CARGO_PKG_VERSION_PATCH"));
    VERSION
}

/// What went wrong in the last call of this thread that failed; empty if none did. The text is valid until this thread's next call that fails, or its end.
#[unsafe(no_mangle)]
pub extern "C" fn helmholtz_last_error() -> *const c_char {
    if !processor::suits() {
        return c"this build of helmholtz needs a processor with AVX2".as_ptr();
    }
    border::last_error()
}

/// The name of a status, as in this header; "unknown" for other numbers. The text is valid for ever.
#[unsafe(no_mangle)]
pub extern "C" fn helmholtz_status_name(status: c_int) -> *const c_char {
    let name = match status {
        0 => c"HELMHOLTZ_OK",
        1 => c"HELMHOLTZ_CANCELLED",
        2 => c"HELMHOLTZ_INVALID_ARGUMENT",
        3 => c"HELMHOLTZ_INVALID_HANDLE",
        4 => c"HELMHOLTZ_BUSY",
        5 => c"HELMHOLTZ_INVALID_SCENE",
        6 => c"HELMHOLTZ_OUT_OF_MEMORY",
        7 => c"HELMHOLTZ_FILE_ERROR",
        8 => c"HELMHOLTZ_BACKEND_ERROR",
        9 => c"HELMHOLTZ_UNSUPPORTED_PROCESSOR",
        10 => c"HELMHOLTZ_INTERNAL_ERROR",
        _ => c"unknown",
    };
    name.as_ptr()
}
