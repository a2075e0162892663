//! Forward and bidirectional path tracing: against the backward path tracer, against closed forms, and against themselves.

mod agreement;
mod forward;
mod photons;
mod strategies;
mod vpl;
mod weights;
