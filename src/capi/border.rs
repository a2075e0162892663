//! The border that every call crosses: panics and errors become a status and a message.

use std::cell::RefCell;
use std::ffi::{CString, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use super::types::helmholtz_status as Status;
use crate::film::FilmError;
use crate::film::output::OutputError;
use crate::integrators::IntegratorError;
use crate::processor;
use crate::query::BackendError;
use crate::render::RenderError;
use crate::scene::load::{EditError, LoadError};

/// Why a call failed.
#[derive(Debug, Clone)]
pub(super) struct Failure {
    pub(super) status: Status,
    pub(super) message: String,
}

/// The result of what a call does.
pub(super) type Outcome<T = ()> = Result<T, Failure>;

impl Failure {
    pub(super) fn new(status: Status, message: impl Into<String>) -> Self {
        Self { status, message: message.into() }
    }

    pub(super) fn argument(message: impl Into<String>) -> Self {
        Self::new(Status::HELMHOLTZ_INVALID_ARGUMENT, message)
    }

    pub(super) fn busy(message: &str) -> Self {
        Self::new(Status::HELMHOLTZ_BUSY, message)
    }

    /// Of a panic, which is a defect.
    pub(super) fn panic(payload: &(dyn std::any::Any + Send)) -> Self {
        let text = payload.downcast_ref::<&str>().copied();
        let text = text.or_else(|| payload.downcast_ref::<String>().map(String::as_str));
        let message = format!("internal error: {}", text.unwrap_or("a panic"));
        Self::new(Status::HELMHOLTZ_INTERNAL_ERROR, message)
    }
}

impl From<LoadError> for Failure {
    fn from(error: LoadError) -> Self {
        Self::new(Status::HELMHOLTZ_INVALID_SCENE, error.to_string())
    }
}

impl From<EditError> for Failure {
    fn from(error: EditError) -> Self {
        let status = match error {
            EditError::Mesh { .. } => Status::HELMHOLTZ_INVALID_SCENE,
            EditError::UnknownShape { .. } | EditError::NotAMesh { .. } => Status::HELMHOLTZ_INVALID_ARGUMENT,
        };
        Self::new(status, error.to_string())
    }
}

impl From<BackendError> for Failure {
    fn from(error: BackendError) -> Self {
        Self::argument(error.to_string())
    }
}

impl From<IntegratorError> for Failure {
    fn from(error: IntegratorError) -> Self {
        Self::argument(error.to_string())
    }
}

impl From<FilmError> for Failure {
    fn from(error: FilmError) -> Self {
        let status = match error {
            FilmError::Memory { .. } => Status::HELMHOLTZ_OUT_OF_MEMORY,
            _ => Status::HELMHOLTZ_INVALID_SCENE,
        };
        Self::new(status, error.to_string())
    }
}

impl From<RenderError> for Failure {
    fn from(error: RenderError) -> Self {
        match error {
            RenderError::Film(error) => error.into(),
            RenderError::TooManyStored(_) => Self::new(Status::HELMHOLTZ_OUT_OF_MEMORY, error.to_string()),
            RenderError::PhotonFile(_) => Self::new(Status::HELMHOLTZ_FILE_ERROR, error.to_string()),
        }
    }
}

impl From<OutputError> for Failure {
    fn from(error: OutputError) -> Self {
        Self::new(Status::HELMHOLTZ_FILE_ERROR, error.to_string())
    }
}

impl From<rayon::ThreadPoolBuildError> for Failure {
    fn from(error: rayon::ThreadPoolBuildError) -> Self {
        Self::new(Status::HELMHOLTZ_OUT_OF_MEMORY, format!("no threads: {error}"))
    }
}

thread_local! {
    static LAST_ERROR: RefCell<CString> = RefCell::default();
}

/// The text for [`helmholtz_last_error`](super::helmholtz_last_error).
pub(super) fn last_error() -> *const c_char {
    // Where a thread is ending, there is no message any more.
    LAST_ERROR.try_with(|last| last.borrow().as_ptr()).unwrap_or(c"".as_ptr())
}

/// Remembers why this thread's call failed.
fn remember(failure: Failure) -> Status {
    let bytes = failure.message.into_bytes().into_iter().filter(|&byte| byte != 0).collect::<Vec<u8>>();
    let message = CString::new(bytes).unwrap_or_default();
    let _ = LAST_ERROR.try_with(|last| *last.borrow_mut() = message);
    failure.status
}

/// Runs what a call does, on a processor that can.
#[inline(always)]
pub(super) fn call(body: impl FnOnce() -> Outcome) -> Status {
    if !processor::suits() {
        return Status::HELMHOLTZ_UNSUPPORTED_PROCESSOR;
    }
    guarded(body)
}

/// Apart from [`call`], so that no instruction of it comes before the processor was asked.
#[inline(never)]
fn guarded(body: impl FnOnce() -> Outcome) -> Status {
    // What a panic leaves behind is told by the locks that it poisons.
    match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => Status::HELMHOLTZ_OK,
        Ok(Err(failure)) => remember(failure),
        Err(payload) => remember(Failure::panic(&*payload)),
    }
}
