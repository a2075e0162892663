//! Rendering to a target error: passes in independent groups, whose spread tells how far their mean is from what it converges to.
//!
//! Passes of one Sobol' sequence depend on each other, and their spread says more than the error of their mean. Beyond 2^16 passes the sampler goes on with another
//! scrambling, so that passes of different *epochs* of that length are independent: group g takes the first passes of epoch g. They are passes like all others, to be
//! saved and merged. Only where a parameter follows the pass index (`sppm`) do groups take turns instead; the estimate is then a little too high.
//!
//! ## The estimate
//!
//! relMSE is the mean over pixels of `(I - R)^2 / (R^2 + 0.01)`. `(I - R)^2` is estimated by the variance of the mean of the groups, and R in the denominator by
//! their median, which one bright speck does not move: with the mean, the speck would hide itself. The groups' own sums of squares give a confidence
//! bound, as if they were normal. What no group has seen, nothing estimates: light that is found very seldom, and bias ([`Integrator::bias`](crate::integrators::Integrator::bias)).

use std::time::{Duration, Instant};

use crate::film::{Film, FilmError};
use crate::integrators::Integrator;
use crate::integrators::photon_map::{Lookup, PhotonMapper};
use crate::query::RayQuery;
use crate::render::{Control, Progress, RenderError, Stop, Target, render};
use crate::study::metrics::REL_MSE_OFFSET;
use crate::transport::World;

/// Groups.
pub const GROUPS: u32 = 8;

/// The factor on the standard error of a mean of [`GROUPS`] values that 95 % of such means do not exceed: Student's t with 7 degrees of freedom.
const QUANTILE: f64 = 1.895;

/// Passes of an epoch of the sampler, as a power of 2.
const EPOCH_LOG2: u32 = 16;

/// How far an image is from what it converges to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorEstimate {
    /// Estimated relMSE.
    pub rel_mse: f64,
    /// What it is below with 95 % confidence.
    pub upper: f64,
}

/// Films that are independent of each other.
#[derive(Debug)]
pub struct Groups {
    films: Vec<Film>,
    /// Passes of each.
    count: u32,
}

/// How a render to a target ended.
#[derive(Debug)]
pub struct Outcome {
    /// All passes.
    pub groups: Groups,
    /// The last estimate; `None` if a group has no pass.
    pub estimate: Option<ErrorEstimate>,
    /// Whether the upper bound is below the target.
    pub is_reached: bool,
    /// What was done.
    pub progress: Progress,
}

impl Groups {
    /// Groups without passes; `empty` is a film without any.
    pub fn new(empty: &Film) -> Self {
        Self { films: vec![empty.clone(); GROUPS as usize], count: 0 }
    }

    /// The pass that is number `n` of a group.
    pub fn pass(integrator: &Integrator, group: u32, n: u32) -> u32 {
        match integrator {
            Integrator::PhotonMap(PhotonMapper { lookup: Lookup::Shrinking { .. }, .. }) => {
                n * GROUPS + group
            }
            _ => (group << EPOCH_LOG2) + n,
        }
    }

    /// The estimate, if all groups have the same number of passes, at least one.
    pub fn estimate(&self) -> Option<ErrorEstimate> {
        self.with_channels(estimate)
    }

    /// Variance of each pixel's mean over the groups, of red, green and blue; `None` where there is no [`estimate`](Self::estimate).
    pub fn variance(&self) -> Option<Vec<Vec<f32>>> {
        let of = |planes: &[&[f32]; GROUPS as usize]| {
            let at = |pixel| (deviations(planes, pixel).iter().sum::<f64>() / MEAN_OF_SQUARES) as f32;
            (0..planes[0].len()).map(at).collect()
        };
        self.with_channels(|channels| channels.iter().map(of).collect())
    }

    /// Does something with each group's values of red, green and blue, if all have the same number of passes, at least one.
    fn with_channels<R>(&self, work: impl FnOnce(&[[&[f32]; GROUPS as usize]]) -> R) -> Option<R> {
        if self.count == 0 || self.films.iter().any(|film| film.passes().len() != self.count) {
            return None;
        }
        let images: Vec<_> = self.films.iter().map(Film::develop).collect();
        let channels: Vec<[&[f32]; GROUPS as usize]> = ["R", "G", "B"]
            .iter()
            .filter_map(|name| {
                let planes: Option<Vec<_>> = images.iter().map(|image| image.floats(name)).collect();
                planes?.try_into().ok()
            })
            .collect();
        Some(work(&channels))
    }

    /// All passes in one film.
    ///
    /// # Errors
    /// None in truth: the films are made alike, of different passes.
    pub fn merge(self) -> Result<Film, FilmError> {
        let mut films = self.films.into_iter();
        let first = films.next().ok_or(FilmError::Mismatch("number"))?;
        films.try_fold(first, |mut all, film| {
            all.merge(&film)?;
            Ok(all)
        })
    }
}

/// What a sum of squared deviations is divided by to be the variance of a mean.
const MEAN_OF_SQUARES: f64 = (GROUPS * (GROUPS - 1)) as f64;

/// Squared deviations of the groups' values of a pixel from their mean.
fn deviations(planes: &[&[f32]; GROUPS as usize], pixel: usize) -> [f64; GROUPS as usize] {
    let values = planes.map(|plane| f64::from(plane[pixel]));
    let mean = values.iter().sum::<f64>() / f64::from(GROUPS);
    values.map(|value| (value - mean) * (value - mean))
}

/// The estimate from the values of each channel in each group.
fn estimate(channels: &[[&[f32]; GROUPS as usize]]) -> ErrorEstimate {
    let n = f64::from(GROUPS);
    let mut squares = [0.0; GROUPS as usize];
    let mut count = 0_usize;
    for planes in channels {
        for pixel in 0..planes[0].len() {
            let mut sorted = planes.map(|plane| f64::from(plane[pixel]));
            sorted.sort_by(f64::total_cmp);
            let median = 0.5 * (sorted[GROUPS as usize / 2 - 1] + sorted[GROUPS as usize / 2]);
            let weight = 1.0 / (median * median + REL_MSE_OFFSET);
            for (sum, square) in squares.iter_mut().zip(deviations(planes, pixel)) {
                *sum += square * weight;
            }
            count += 1;
        }
    }
    // Their mean is the estimate.
    let parts = squares.map(|sum| n * sum / (count.max(1) as f64 * MEAN_OF_SQUARES));
    let rel_mse = parts.iter().sum::<f64>() / n;
    let spread = parts.iter().map(|p| (p - rel_mse) * (p - rel_mse)).sum::<f64>() / (n - 1.0);
    ErrorEstimate { rel_mse, upper: rel_mse + QUANTILE * (spread / n).sqrt() }
}

/// Renders until the error is below a target with 95 % confidence, the time is over, or `progress` says so, which is called after each pass
/// with the last estimate. `empty` is the film to fill. Estimates are made after 1, 2, 3, 4, 6, 8, 12, ... passes of each group, so that few chances are given to a lucky one.
///
/// # Errors
/// As of [`render`].
pub fn render_to_error<Q: RayQuery>(
    world: &World,
    query: &Q,
    target: &Target,
    empty: &Film,
    (rel_mse, time): (f64, Option<Duration>),
    mut progress: impl FnMut(&Progress, Option<ErrorEstimate>) -> Control,
) -> Result<Outcome, RenderError> {
    let start = Instant::now();
    let mut groups = Groups::new(empty);
    let mut done = Progress::default();
    let (mut last, mut is_reached, mut is_stopped) = (None, false, false);
    let mut next_estimate = 1;
    while !is_reached && !is_stopped && groups.count < 1 << EPOCH_LOG2 {
        for (group, film) in (0..).zip(&mut groups.films) {
            let pass = Groups::pass(&target.integrator, group, groups.count);
            let stop = Stop { passes: pass..pass + 1, time: None };
            let one = render(world, query, target, film, &stop, |_| Control::Continue)?;
            done.add(&one, start.elapsed());
            let is_late = time.is_some_and(|limit| start.elapsed() >= limit);
            is_stopped |= progress(&done, last) == Control::Stop || is_late;
            if is_stopped {
                break;
            }
        }
        if !is_stopped || groups.films.iter().all(|film| film.passes().len() > groups.count) {
            groups.count += 1;
            if groups.count == next_estimate || is_stopped {
                last = groups.estimate();
                is_reached = last.is_some_and(|estimate| estimate.upper < rel_mse);
                // 1, 2, 3, 4, 6, 8, 12, 16: powers of 2, at which the sequences are at their best, and between them.
                let power = 1 << groups.count.ilog2();
                next_estimate =
                    if groups.count > power || power == 1 { 2 * power } else { power + power / 2 };
            }
        }
    }
    Ok(Outcome { groups, estimate: last, is_reached, progress: done })
}

#[cfg(test)]
mod tests {
    use super::{GROUPS, QUANTILE, estimate};

    /// Groups of alternately 1 - d and 1 + d: the mean's variance is d^2 / 7, each group's share alike.
    #[test]
    fn the_estimate_is_the_variance_of_the_mean() {
        let d = 0.1_f32;
        let planes: Vec<Vec<f32>> =
            (0..GROUPS).map(|g| vec![1.0 + if g % 2 == 0 { d } else { -d }; 6]).collect();
        let planes: [&[f32]; GROUPS as usize] = std::array::from_fn(|g| planes[g].as_slice());
        let found = estimate(&[planes, planes]);
        let expected = f64::from(d * d) / 7.0 / 1.01;
        assert!((found.rel_mse / expected - 1.0).abs() < 1e-5, "{found:?}, expected {expected}");
        assert!((found.upper / found.rel_mse - 1.0).abs() < 1e-5, "{found:?}");
    }

    /// A speck of 80 in one group of eight, over 1: the mean is 10.875 too high, and the variance of the mean is nearly its square. Not hidden by the mean's own square.
    #[test]
    fn a_speck_does_not_hide_itself() {
        let planes: Vec<[f32; 1]> = (0..GROUPS).map(|g| [if g == 3 { 88.0 } else { 1.0 }]).collect();
        let planes: [&[f32]; GROUPS as usize] = std::array::from_fn(|g| planes[g].as_slice());
        let found = estimate(&[planes]);
        let error = 87.0 / 8.0;
        assert!((found.rel_mse * 1.01 / (error * error) - 1.0).abs() < 1e-5, "{found:?}");
        assert!(found.upper > (1.0 + 0.8 * QUANTILE) * found.rel_mse, "{found:?}");
    }
}
