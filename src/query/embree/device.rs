//! An Embree device: its version, its errors, and how much memory it holds.

use std::ffi::{CStr, CString, c_char, c_void};
use std::ptr;
use std::sync::atomic::{AtomicIsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::EmbreeError;
use super::ffi;

/// Owns an `RTCDevice`. Everything made from it must be released before it is dropped.
pub(super) struct Device {
    handle: ffi::RTCDevice,
    /// Embree holds a pointer to it until the device is released.
    monitor: Arc<Monitor>,
    version: Version,
}

/// What Embree tells through its callbacks, which come from any of its threads.
#[derive(Default)]
struct Monitor {
    bytes: AtomicIsize,
    /// What was ever allocated, freed or not.
    #[cfg(test)]
    allocated: std::sync::atomic::AtomicUsize,
    first_error: Mutex<Option<String>>,
}

/// A version as Embree numbers it: 40303 is 4.3.3.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) struct Version(u32);

impl Version {
    /// The version of the header that the bindings were made from.
    const HEADER: Self =
        Self(ffi::RTC_VERSION_MAJOR * 10_000 + ffi::RTC_VERSION_MINOR * 100 + ffi::RTC_VERSION % 100);

    fn major_minor(self) -> (u32, u32) {
        (self.0 / 10_000, self.0 / 100 % 100)
    }

    /// Whether a library of this version has all that a header of version `header` declares, in the same layout.
    fn serves(self, header: Self) -> bool {
        let (major, minor) = self.major_minor();
        let (header_major, header_minor) = header.major_minor();
        major == header_major && minor >= header_minor
    }
}

impl std::fmt::Display for Version {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (major, minor) = self.major_minor();
        write!(f, "{major}.{minor}.{}", self.0 % 100)
    }
}

impl Device {
    /// Starts Embree with `threads` build threads, 0 for one per core, and checks that the library suits the header.
    pub(super) fn new(threads: usize) -> Result<Self, EmbreeError> {
        let config = CString::new(format!("threads={threads}")).unwrap_or_default();
        // SAFETY: `config` is a terminated string that outlives the call.
        let handle = unsafe { ffi::rtcNewDevice(config.as_ptr()) };
        if handle.is_null() {
            // SAFETY: null asks for the error of this thread's failed device creation.
            let code = unsafe { ffi::rtcGetDeviceError(ptr::null_mut()) };
            return Err(EmbreeError::Failed { call: "rtcNewDevice", message: error_name(code).to_owned() });
        }
        let property = |property| {
            // SAFETY: `handle` is a live device; an unknown property sets an error and returns 0.
            unsafe { ffi::rtcGetDeviceProperty(handle, property) }
        };
        let version = Version(property(ffi::RTC_DEVICE_PROPERTY_VERSION) as u32);
        let device = Self { handle, monitor: Arc::default(), version };
        if !version.serves(Version::HEADER) {
            let [library, header] = [version, Version::HEADER].map(|v| v.to_string());
            return Err(EmbreeError::Version { library, header });
        }
        for (what, usable) in [
            ("triangles", property(ffi::RTC_DEVICE_PROPERTY_TRIANGLE_GEOMETRY_SUPPORTED) != 0),
            ("user geometry", property(ffi::RTC_DEVICE_PROPERTY_USER_GEOMETRY_SUPPORTED) != 0),
            ("back faces", property(ffi::RTC_DEVICE_PROPERTY_BACKFACE_CULLING_ENABLED) == 0),
        ] {
            if !usable {
                return Err(EmbreeError::BuiltWithout { what });
            }
        }
        let monitor = Arc::as_ptr(&device.monitor).cast_mut().cast();
        // SAFETY: the monitor lives until after the device is released (`Drop` below), and both callbacks only use it
        // through shared references, so they may come from any thread.
        unsafe {
            ffi::rtcSetDeviceErrorFunction(handle, Some(on_error), monitor);
            ffi::rtcSetDeviceMemoryMonitorFunction(handle, Some(on_memory), monitor);
        }
        Ok(device)
    }

    pub(super) fn handle(&self) -> ffi::RTCDevice {
        self.handle
    }

    pub(super) fn version(&self) -> Version {
        self.version
    }

    /// Bytes that the device holds for acceleration structures and bookkeeping.
    pub(super) fn memory(&self) -> usize {
        usize::try_from(self.monitor.bytes.load(Ordering::Relaxed)).unwrap_or(0)
    }

    /// Bytes that were ever allocated.
    #[cfg(test)]
    pub(super) fn allocated(&self) -> usize {
        self.monitor.allocated.load(Ordering::Relaxed)
    }

    /// The first error since the last check, as the failure of `call`.
    pub(super) fn check(&self, call: &'static str) -> Result<(), EmbreeError> {
        let error = self.monitor.first_error.lock().unwrap_or_else(PoisonError::into_inner).take();
        error.map_or(Ok(()), |message| Err(EmbreeError::Failed { call, message }))
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: this is the only reference to the device that was made, and it is not used again.
        unsafe { ffi::rtcReleaseDevice(self.handle) };
    }
}

/// Embree's error callback: keeps the first message. `extern "C"`, so a panic would abort rather than unwind into Embree.
unsafe extern "C" fn on_error(monitor: *mut c_void, code: ffi::RTCError, message: *const c_char) {
    // SAFETY: `Device::new` registered a pointer to a `Monitor` that is alive as long as the device.
    let monitor = unsafe { &*monitor.cast::<Monitor>() };
    let detail = if message.is_null() {
        String::new()
    } else {
        // SAFETY: Embree passes a terminated string.
        let text = unsafe { CStr::from_ptr(message) };
        format!(": {}", text.to_string_lossy())
    };
    let mut first = monitor.first_error.lock().unwrap_or_else(PoisonError::into_inner);
    first.get_or_insert_with(|| format!("{}{detail}", error_name(code)));
}

/// Embree's memory callback: adds up what is allocated and freed. Never asks Embree to stop.
unsafe extern "C" fn on_memory(monitor: *mut c_void, bytes: isize, _after_the_fact: bool) -> bool {
    // SAFETY: as in `on_error`.
    let monitor = unsafe { &*monitor.cast::<Monitor>() };
    monitor.bytes.fetch_add(bytes, Ordering::Relaxed);
    #[cfg(test)]
    monitor.allocated.fetch_add(bytes.max(0) as usize, Ordering::Relaxed);
    true
}

fn error_name(code: ffi::RTCError) -> &'static str {
    match code {
        ffi::RTC_ERROR_INVALID_ARGUMENT => "invalid argument",
        ffi::RTC_ERROR_INVALID_OPERATION => "invalid operation",
        ffi::RTC_ERROR_OUT_OF_MEMORY => "out of memory",
        ffi::RTC_ERROR_UNSUPPORTED_CPU => "this processor is not supported",
        ffi::RTC_ERROR_CANCELLED => "cancelled",
        _ => "unknown error",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_library_serves_headers_of_its_major_version_and_no_newer_minor() {
        let library = Version(40_303);
        assert!(library.serves(Version(40_303)));
        assert!(library.serves(Version(40_300)));
        assert!(library.serves(Version(40_304)), "patch releases change no interface");
        assert!(!library.serves(Version(40_400)));
        assert!(!library.serves(Version(30_303)));
        assert_eq!(library.to_string(), "4.3.3");
    }

    #[test]
    fn errors_are_captured_once() {
        let device = Device::new(0).unwrap();
        // SAFETY: an out-of-range enum value is an error that Embree reports, on a live device.
        let geometry = unsafe { ffi::rtcNewGeometry(device.handle(), 9999) };
        assert!(geometry.is_null());
        let error = device.check("rtcNewGeometry").unwrap_err().to_string();
        assert!(error.contains("rtcNewGeometry") && error.len() > 20, "{error}");
        assert_eq!(device.check("rtcNewGeometry"), Ok(()));
    }

    #[test]
    fn what_a_scene_allocates_is_freed_with_it() {
        use crate::query::Update;
        use crate::query::embree::{EmbreeSettings, Scene, commit, geometry};
        use crate::scene::{AnalyticShape, Geometry, TriangleMesh};
        use glam::{DVec3, Vec3};

        let corners = (0..3000).map(|i| Vec3::new(i as f32, (i % 7) as f32, (i % 3) as f32)).collect();
        let triangles = (0..1000).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]).collect();
        let mesh = Geometry::Mesh(TriangleMesh::new(corners, triangles, vec![], vec![], false).unwrap());
        let sphere = Geometry::Analytic(AnalyticShape::sphere(DVec3::ZERO, 1.0).unwrap());
        let device = Device::new(0).unwrap();
        let before = device.memory();
        // SAFETY: the device is live.
        let scene = Scene(unsafe { ffi::rtcNewScene(device.handle()) });
        // SAFETY: the geometries are dropped after the scene.
        unsafe {
            geometry::attach(&device, &scene, 0, &mesh, Update::Rebuild).unwrap();
            geometry::attach(&device, &scene, 1, &sphere, Update::Rebuild).unwrap();
        }
        commit(&device, &scene, EmbreeSettings::default(), Update::Rebuild).unwrap();
        assert!(device.memory() > before + 1000 * 16);
        drop(scene);
        assert_eq!(device.memory(), before);
    }
}
