//! The integration tests: one binary, a module per subject.

mod load;
mod malformed;
