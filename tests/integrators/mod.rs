//! Forward and bidirectional path tracing: against the backward path tracer, against closed forms, and against themselves.

mod agreement;
mod forward;
mod photon_bias;
mod photon_files;
mod photons;
mod strategies;
mod weights;
