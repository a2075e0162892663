//! Filters of the density estimate, normalised: photons of an even flux on a plane give that flux.

use std::f32::consts::FRAC_1_PI;

use super::super::IntegratorError;
use super::super::parameters::{choice, word};

/// Slope of the lecture's Gaussian (Pavicic, in Graphics Gems).
const BETA: f32 = 1.953;

/// How photons count by their distance from the middle of the disc.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Filter {
    /// All the same.
    #[default]
    Constant,
    /// `1 - d / r`.
    Cone,
    /// `alpha (1 - (1 - exp(-beta d^2 / 2 r^2)) / (1 - exp(-beta)))` with beta = 1.953; whatever alpha is, the normalisation cancels it.
    /// At the rim it still has 0.27 of its height.
    Gaussian,
}

impl Filter {
    const ALL: [(&'static str, Self); 3] =
        [("constant", Self::Constant), ("cone", Self::Cone), ("gaussian", Self::Gaussian)];

    pub(super) fn parse(value: &str) -> Result<Self, IntegratorError> {
        choice("filter", value, &Self::ALL)
    }

    pub(super) fn name(self) -> &'static str {
        word(&Self::ALL, &self)
    }

    /// Density per unit area of the filter on a disc of radius 1, at the squared distance `x` in [0, 1) from its middle. Its integral over the
    /// disc is 1. For the Gaussian, with `t = d^2`, that is
    /// `pi alpha int_0^1 (1 - (1 - exp(-beta t / 2)) / (1 - exp(-beta))) dt = pi alpha (1 - (1 - (1 - exp(-beta / 2)) 2 / beta) / (1 - exp(-beta)))`.
    #[inline]
    pub fn density(self, x: f32) -> f32 {
        match self {
            Self::Constant => FRAC_1_PI,
            Self::Cone => 3.0 * FRAC_1_PI * (1.0 - x.sqrt()),
            Self::Gaussian => {
                let whole = 1.0 - (-BETA).exp();
                let mean = 1.0 - (1.0 - (1.0 - (-0.5 * BETA).exp()) * (2.0 / BETA)) / whole;
                FRAC_1_PI / mean * (1.0 - (1.0 - (-0.5 * BETA * x).exp()) / whole)
            }
        }
    }
}
