//! The integration tests: one binary, a module per subject.

mod analytic;
mod backends;
#[cfg(feature = "embree")]
mod query_embree;
mod scene_builder;
mod sampler;
mod spherical;
mod query;
mod query_obvhs;
mod support;
