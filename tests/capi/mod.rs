//! The C interface: its header, what Rust can see of it without unsafe code, and what lies under it. The functions themselves are called from C by `run.sh`.

mod edits;
mod header;
mod refit;
