//! The trade between speed and accuracy, measured: how far images are from a reference, what two backends cost and disagree about, and which integrator suits a
//! scene.
//!
//! [`picture`] reads images of any program, [`metrics`] compares numbers, [`flip`] compares what people see, [`heat`] shows where they differ. [`ab`] runs two
//! backends on one scene; [`html`] is what reports are made of. [`pilot`] renders a few pixels to learn what carries light, [`auto`] chooses an integrator by that, and [`verify`]
//! holds it against what integrators should be able to do. [`converge`] renders until the error is small enough. [`results`] is what a study of many configurations measures, [`summary`] what
//! follows from it by [`statistics`], and [`report`], with a [`plot`], how a person is told. Nothing here prints.

pub mod ab;
pub mod auto;
pub mod converge;
pub mod flip;
pub mod heat;
pub mod html;
pub mod metrics;
pub mod picture;
pub mod pilot;
pub mod plot;
pub mod report;
pub mod results;
pub mod statistics;
pub mod summary;
pub mod verify;
