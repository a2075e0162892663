//! What integrators share: scattering at surfaces.

pub mod bsdf;
