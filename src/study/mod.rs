//! The trade between speed and accuracy, measured: how far images are from a reference, and what two backends cost and disagree about.
//!
//! [`picture`] reads images of any program, [`metrics`] compares numbers, [`flip`] compares what people see, [`heat`] shows where they differ. [`ab`] runs two
//! backends on one scene; [`html`] is what reports are made of. Nothing here prints.

pub mod ab;
pub mod flip;
pub mod heat;
pub mod html;
pub mod metrics;
pub mod picture;
