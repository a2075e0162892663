//! The integration tests: one binary, a module per subject.

mod analytic;
mod query;
mod query_obvhs;
mod support;
