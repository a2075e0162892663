//! The integration tests: one binary, a module per subject.

#[cfg(feature = "embree")]
mod query_embree;
