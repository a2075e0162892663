//! Weights of multiple importance sampling (Veach 1997, chapter 9).
//!
//! Two techniques are weighed by [`power_heuristic`]. A path that *every* pair of a light and an eye subpath could have made is
//! weighed by [`Heuristic`], whose sums over all strategies are carried along both subpaths, so that a connection costs
//! the same for any path length (Georgiev 2012, "Implementing vertex connection and merging"; van Antwerpen 2011).
//!
//! ## The sums
//!
//! Number the vertices of a subpath from its emitter, x0, x1, ... xn. Let `f_i` be the density per area of `x_i` as this subpath makes it
//! and `r_i` the density of the same vertex as the other subpath, coming from `x_(i+1)`, would make it. The strategies in
//! which this subpath is shorter have, relative to the one in which it ends at `x_n`, the densities
//! `r_n / f_n`, `(r_n r_(n-1)) / (f_n f_(n-1))`, and so on; those that would have to connect a delta vertex do not exist.
//! `r_n` depends on what is connected, `r_(n-1)` also, by the scattering density at `x_n` alone; all else is known beforehand:
//!
//! ```text
//! sum = r_n^b (d_vcm + sigma_rev^b d_vc)
//! ```
//!
//! Each factor is a *ratio* of densities with the geometric terms cancelled, kept in f64: it then survives scenes of any
//! scale. Raising each to the power b raises the products, so the recursion holds for the power heuristic too.
//! Russian roulette is not part of these densities. The weights sum to one without it, which is all that is needed.

/// The power heuristic with exponent 2 for a sample drawn with density `pdf` that another technique would
/// have drawn with density `other`, one sample each. Computed from the ratio, so that it neither overflows nor
/// becomes NaN for densities near the limits of f32.
#[inline]
pub fn power_heuristic(pdf: f32, other: f32) -> f32 {
    let ratio = other / pdf;
    1.0 / (1.0 + ratio * ratio)
}

/// The power heuristic over all strategies, and the recursion that sums them up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Heuristic {
    /// Exponent 1.
    Balance,
    /// Exponent 2.
    Power,
}

/// The sums at a vertex of a subpath, over the strategies in which the subpath is shorter. See the module's text.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Partials {
    /// `1 / f_n^b`, 0 if the vertex before cannot be connected.
    pub d_vcm: f64,
    /// The terms of all still shorter subpaths.
    pub d_vc: f64,
}

/// The sums between two vertices: all of [`Partials`] at the next vertex that does not depend on where that is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Flight {
    /// `1 / pdf_w^b`, 0 after a delta event.
    pub d_vcm: f64,
    /// `d_vc` of the next vertex but for the cosine there.
    pub d_vc: f64,
}

/// How a path goes on from a vertex, for the weights. Cosines are absolute and with the geometric normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turn {
    /// Cosine of the direction from which the subpath came.
    pub cos_in: f32,
    /// Cosine of the direction in which it goes on.
    pub cos_out: f32,
    /// Density per solid angle of going on this way.
    pub pdf_w: f32,
    /// Density per solid angle of the way back, from where the path goes on to where it came from.
    pub pdf_rev_w: f32,
    /// Whether this is a delta lobe; then both densities are of no account.
    pub is_delta: bool,
    /// Index of refraction where the path goes, over that where it came from.
    pub eta: f32,
}

impl Heuristic {
    /// A ratio of densities to the power of the heuristic.
    #[inline]
    pub fn raise(self, ratio: f64) -> f64 {
        match self {
            Self::Balance => ratio,
            Self::Power => ratio * ratio,
        }
    }

    /// From a vertex on, in a direction.
    ///
    /// A delta lobe is chosen with the same probability both ways. As a density it is not the same: `n^2 cos dw` is
    /// conserved across a boundary (étendue), so that the way back has `cos_in / (eta^2 cos_out)` times the density of the way there.
    #[inline]
    pub fn leave(self, at: &Partials, turn: &Turn) -> Flight {
        if turn.is_delta {
            let ratio = f64::from(turn.cos_in) / f64::from(turn.eta * turn.eta);
            return Flight { d_vcm: 0.0, d_vc: finite(self.raise(ratio) * at.d_vc) };
        }
        let pdf_w = f64::from(turn.pdf_w);
        let shorter = at.d_vcm + self.raise(f64::from(turn.pdf_rev_w)) * at.d_vc;
        Flight {
            d_vcm: finite(self.raise(1.0 / pdf_w)),
            d_vc: finite(self.raise(f64::from(turn.cos_out) / pdf_w) * shorter),
        }
    }

    /// To the next vertex, at a distance, where the direction has the (absolute, geometric) cosine `cos`. Distance and cosine are 1 for
    /// an environment that was reached.
    #[inline]
    pub fn arrive(self, flight: Flight, distance_squared: f32, cos: f32) -> Partials {
        let (distance_squared, cos) = (f64::from(distance_squared), f64::from(cos));
        Partials {
            d_vcm: finite(flight.d_vcm * self.raise(distance_squared / cos)),
            d_vc: finite(flight.d_vc / self.raise(cos)),
        }
    }

    /// The sum over strategies with a shorter subpath, relative to the present one: `pdf` is the density per area with which the other
    /// subpath would have made the end of this one, `pdf_rev_w` the density with which it would have gone on from there
    /// to the vertex before.
    #[inline]
    pub fn shorter(self, at: &Partials, pdf: f64, pdf_rev_w: f64) -> f64 {
        self.raise(pdf) * (at.d_vcm + self.raise(pdf_rev_w) * at.d_vc)
    }
}

/// Sums that overflow stay greatest: infinity times zero would be NaN.
#[inline]
fn finite(x: f64) -> f64 {
    x.min(f64::MAX)
}

#[cfg(test)]
mod tests {
    use super::power_heuristic;

    #[test]
    fn weights_sum_to_one_at_the_extremes() {
        for (a, b) in [(1.0, 1.0), (1e-30, 1e30), (3e38, 3e38), (1e-38, 1e-38), (0.3, 0.7), (1e20, 1e-3)] {
            let sum = power_heuristic(a, b) + power_heuristic(b, a);
            assert!((sum - 1.0).abs() < 1e-6, "{a} {b}: {sum}");
        }
        assert_eq!(power_heuristic(2.0, 0.0), 1.0);
        assert!((power_heuristic(1.0, 2.0) - 0.2).abs() < 1e-7);
    }
}
