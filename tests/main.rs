//! The integration tests: one binary, a module per subject.

mod bsdf;
mod statistics;
mod warp;
