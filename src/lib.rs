//! # Helmholtz: a renderer that follows light both ways
//!
//! Helmholtz reads Mitsuba scenes and plain meshes, answers ray queries with Intel Embree or,
//! swapped at run time, with the pure-Rust `obvhs`, and solves light transport on that one
//! abstraction. Start reading at [`integrators`]; everything an integrator needs lies below it.
//!
//! Data flows one way, from the top of this map to its bottom; nothing below knows what is above it.
//!
//! | module | what it holds |
//! |---|---|
//! | [`cli`] | one file per subcommand; all printing to people happens there |
//! | [`capi`] | the C interface: handles, status codes, no panic across the border |
//! | [`selftest`] | checks at the extremes of scale, place, roughness, radiance |
//! | [`study`] | the trade, measured: errors of images, backends side by side, what a scene's light is made of, which integrator suits it, rendering to an error, studies of many configurations |
//! | [`strategies`] | the driver for images of single strategies |
//! | [`render`] | the driver: passes, threads, progress, stop conditions, checkpoints |
//! | [`integrators`] | one file or folder per algorithm |
//! | [`transport`] | what integrators share: BSDFs, emitters, camera importance, subpath walk, MIS |
//! | [`film`] | accumulation, reconstruction filters, AOVs, EXR and PNG output |
//! | [`sampling`] | sampler (per pixel, pass and dimension), warps, discrete distributions |
//! | [`query`] | closest-hit and occlusion queries: Embree, obvhs, one checked against the other |
//! | [`processor`] | whether this machine's processor suits this build |
//! | [`spec`] | things with parameters in a line of text, as the command line and the C interface name them |
//! | [`scene`] | plain data: shapes, materials, emitters, camera; and the loaders |
//!
//! ## One pass is a function
//!
//! `pass(scene, integrator, seed, pass_index)` has no other input. Random numbers come from the
//! seed, the pixel, the pass and the dimension, never from a thread. Within a pass the film adds in
//! an order that does not depend on threads, and between passes in an arithmetic in which order does not matter. So an image is the same to the last
//! bit for any number of threads, whether rendered in one go, resumed, or merged from parts.
#![deny(unsafe_code)]

pub mod capi;
pub mod cli;
pub mod film;
pub mod integrators;
pub mod processor;
pub mod query;
pub mod render;
pub mod sampling;
pub mod scene;
pub mod selftest;
pub mod spec;
pub mod strategies;
pub mod study;
pub mod transport;
