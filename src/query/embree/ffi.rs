//! What bindgen makes of the installed `embree4/rtcore.h`; `build.rs` holds the list of what is taken from it.

#![allow(
    dead_code,
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals,
    missing_docs,
    unreachable_pub,
    clippy::all,
    clippy::pedantic,
    reason = "generated code under the names of the C header; enums come with all their values"
)]

include!(concat!(env!("OUT_DIR"), "/embree.rs"));

/// The header's `RTC_INVALID_GEOMETRY_ID`, a cast that bindgen does not evaluate.
pub const RTC_INVALID_GEOMETRY_ID: u32 = u32::MAX;

#[cfg(test)]
mod tests {
    use std::mem::{align_of, offset_of, size_of};

    use super::*;

    unsafe extern "C" {
        static helmholtz_embree_layout: [usize; 41];
        static helmholtz_embree_layout_count: usize;
    }

    #[test]
    fn structs_have_the_layout_that_the_c_compiler_gives_them() {
        // In the order of layout.c.
        let rust = [
            size_of::<RTCRay>(),
            align_of::<RTCRay>(),
            offset_of!(RTCRay, org_x),
            offset_of!(RTCRay, tnear),
            offset_of!(RTCRay, dir_x),
            offset_of!(RTCRay, time),
            offset_of!(RTCRay, tfar),
            offset_of!(RTCRay, mask),
            offset_of!(RTCRay, id),
            offset_of!(RTCRay, flags),
            size_of::<RTCHit>(),
            align_of::<RTCHit>(),
            offset_of!(RTCHit, Ng_x),
            offset_of!(RTCHit, u),
            offset_of!(RTCHit, v),
            offset_of!(RTCHit, primID),
            offset_of!(RTCHit, geomID),
            offset_of!(RTCHit, instID),
            size_of::<RTCRayHit>(),
            align_of::<RTCRayHit>(),
            offset_of!(RTCRayHit, ray),
            offset_of!(RTCRayHit, hit),
            size_of::<RTCBounds>(),
            align_of::<RTCBounds>(),
            offset_of!(RTCBounds, lower_x),
            offset_of!(RTCBounds, upper_x),
            size_of::<RTCBoundsFunctionArguments>(),
            offset_of!(RTCBoundsFunctionArguments, geometryUserPtr),
            offset_of!(RTCBoundsFunctionArguments, bounds_o),
            size_of::<RTCIntersectFunctionNArguments>(),
            offset_of!(RTCIntersectFunctionNArguments, valid),
            offset_of!(RTCIntersectFunctionNArguments, geometryUserPtr),
            offset_of!(RTCIntersectFunctionNArguments, primID),
            offset_of!(RTCIntersectFunctionNArguments, rayhit),
            offset_of!(RTCIntersectFunctionNArguments, N),
            offset_of!(RTCIntersectFunctionNArguments, geomID),
            size_of::<RTCOccludedFunctionNArguments>(),
            offset_of!(RTCOccludedFunctionNArguments, valid),
            offset_of!(RTCOccludedFunctionNArguments, geometryUserPtr),
            offset_of!(RTCOccludedFunctionNArguments, ray),
            offset_of!(RTCOccludedFunctionNArguments, N),
        ];
        // SAFETY: two constants of layout.c; the count is checked before the array is read.
        unsafe {
            assert_eq!(helmholtz_embree_layout_count, rust.len());
            assert_eq!(helmholtz_embree_layout, rust);
        }
    }
}
