//! Where random numbers come from and how they are shaped: sampler, warps, discrete distributions.

pub mod discrete;
pub mod distribution_2d;
pub mod sampler;
pub mod spherical;
pub mod warp;

pub use sampler::Sampler;
