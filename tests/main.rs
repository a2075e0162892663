//! The integration tests: one binary, a module per subject.

mod analytic;
mod analytic_shapes;
mod backends;
mod benchmarks;
mod bsdf;
mod camera;
mod cli;
mod environment;
mod extremes;
mod film;
mod image_files;
mod images;
mod instances;
mod integrators;
mod lights;
mod load;
mod malformed;
mod mitsuba;
mod mitsuba_suite;
mod obj;
mod query;
#[cfg(feature = "embree")]
mod query_embree;
mod query_obvhs;
mod readme;
mod sampler;
mod scene_builder;
mod scenes_table;
mod serialized;
mod spherical;
mod statistics;
mod study;
mod support;
mod warp;
