//! The trade between speed and accuracy, measured: how far images are from a reference.
//!
//! [`picture`] reads images of any program, [`metrics`] compares numbers, [`flip`] compares what people see, [`heat`] shows where they differ. Nothing here
//! renders; nothing here prints.

pub mod ab;
pub mod flip;
pub mod heat;
pub mod html;
pub mod metrics;
pub mod picture;
