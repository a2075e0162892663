//! What a study concludes from its [`Results`]: errors with their confidence, ranks, slopes, bias. Numbers only; the report puts them into words and pictures.
//!
//! ## The error
//!
//! The relMSE of seeds spreads by factors rather than by amounts, so that means and intervals are of its logarithm: the geometric mean, with Student's t. Those of a few
//! seeds are comparable even where one has a bright speck; the trimmed relMSE says how much that is. What is measured includes the noise of the reference,
//! whose own relMSE is subtracted from mean and interval alike. Where more than half is the reference's, an error is little more than an upper bound, and is marked.
//!
//! ## Ranks
//!
//! A configuration's rank at a budget is one more than the number of configurations whose interval lies wholly below its own. So all that nothing beats share rank 1, two that overlap
//! may differ in rank only by a third that beats one of them, and with a single seed there are no ranks. Two 95 % intervals of the same mean miss each other in less than 5 % of
//! all cases, which errs on the side of not ranking.

use serde::{Deserialize, Serialize};

use super::results::{Configuration, Results, Run};
use super::statistics::{CONFIDENCE, LogMean, mean_and_error, median, slope, student_t};

/// Times that differ by less than this share are the same for the front: snapshots are made at the end of a pass.
const SAME_TIME: f64 = 0.05;

/// What a study concludes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Summary {
    /// Of each configuration, in the order of the results.
    pub configurations: Vec<Conclusion>,
}

/// What is concluded about a configuration.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Conclusion {
    /// Its name.
    pub name: String,
    /// Its error at each budget; `None` where no run got so far.
    pub at: Vec<Option<AtBudget>>,
    /// Where the time of the longest budget went; `None` without runs.
    pub time: Option<TimeSplit>,
    /// Bytes that the backend holds beside the scene, the most of all runs.
    pub query_bytes: u64,
    /// How the error falls with time; `None` with fewer than two budgets that the reference is good enough for.
    pub slope: Option<Slope>,
    /// 1 / (relMSE x seconds) at the greatest budget. `None` if nothing is left of the error when the reference's own is subtracted.
    pub efficiency: Option<f64>,
    /// What remains however long it renders; `None` with fewer than two seeds.
    pub bias: Option<BiasFloor>,
}

/// A configuration's error at a budget.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AtBudget {
    /// Seeds that got so far.
    pub seeds: usize,
    /// Mean time spent on rendering, in seconds.
    pub seconds: f64,
    /// relMSE as it was measured. `None` if a seed's was 0 or no number.
    pub measured: Option<LogMean>,
    /// relMSE less that of the reference, and not less than 0.
    pub rel_mse: Option<LogMean>,
    /// The same without the worst 0.1 % of the pixels. The whole of the reference's error is subtracted, though those pixels had a part of it.
    pub trimmed: Option<LogMean>,
    /// Whether more than half of what was measured is the error of the reference.
    pub is_mostly_reference: bool,
    /// One more than the number of configurations that are better beyond doubt; `None` without an interval.
    pub rank: Option<usize>,
    /// Whether nothing in the study has less error in the same time (to 5 %) or less.
    pub is_on_front: bool,
}

/// Seconds, the medians of all runs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct TimeSplit {
    /// To load the scene.
    pub load: f64,
    /// To build the backend.
    pub build: f64,
    /// From the start of rendering to the end of the first pass.
    pub first_image: f64,
    /// From there to the last budget.
    pub rest: f64,
}

/// The exponent of the error as a power of time: -1 where the error is noise of independent samples, less for well-spread ones, 0 where it is bias.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Slope {
    /// The mean over runs of the least-squares slope of ln relMSE over ln seconds.
    pub value: f64,
    /// Its standard error, from the spread of the runs, which are independent as the points of one are not; `None` with a single run.
    pub error: Option<f64>,
}

/// Relative squared bias at the greatest budget, and whether it can be told from none.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct BiasFloor {
    /// The estimate.
    pub squared: f64,
    /// What an estimate exceeds in less than 2.5 % of all cases where there is no bias. It is the mean, over pairs of seeds, of the product of their deviations from
    /// the reference; that of n seeds varies at most as their mean relMSE does (by 1 / (n - 1) of its variance, had the reference no noise), hence Student's t times
    /// the standard error of that. It is no less than the reference's own relMSE: what is smaller than that, the reference cannot show.
    pub uncertainty: f64,
    /// Whether the estimate exceeds its uncertainty. `None` if nothing tells the reference's error, which may then be all of it.
    pub is_seen: Option<bool>,
    /// Of a biased configuration whose bias is seen: seconds after which noise is less than bias, if it goes on to fall as 1 / time, but no less than the first
    /// image needs.
    pub noise_is_less_after: Option<f64>,
}

impl LogMean {
    /// The same of values that are all less by `own`, but not less than 0. The median, which the geometric mean is of log-normal values, goes along with any
    /// monotone map.
    fn less(self, own: f64) -> Self {
        let less = |value: f64| (value - own).max(0.0);
        Self { mean: less(self.mean), interval: self.interval.map(|ends| ends.map(less)) }
    }
}

impl Summary {
    /// Draws the conclusions.
    pub fn of(results: &Results) -> Self {
        let own = results.reference.rel_mse.unwrap_or(0.0);
        let conclude = |configuration| conclude(configuration, results, own);
        let mut this = Self { configurations: results.configurations.iter().map(conclude).collect() };
        for budget in 0..results.budgets.len() {
            this.rank(budget);
        }
        this.mark_front();
        this
    }

    /// The configurations that got to a budget, each with what is known of it there.
    pub fn at(&self, budget: usize) -> impl Iterator<Item = (&Conclusion, &AtBudget)> {
        self.configurations.iter().filter_map(move |c| Some((c, c.at.get(budget)?.as_ref()?)))
    }

    /// The configuration with the least error at a budget, if any is known.
    pub fn best(&self, budget: usize) -> Option<(&Conclusion, LogMean)> {
        let known = self.at(budget).filter_map(|(c, at)| Some((c, at.measured?)));
        known.min_by(|a, b| a.1.mean.total_cmp(&b.1.mean))
    }

    fn points_mut(&mut self) -> impl Iterator<Item = &mut AtBudget> {
        self.configurations.iter_mut().flat_map(|c| c.at.iter_mut().flatten())
    }

    fn rank(&mut self, budget: usize) {
        let intervals: Vec<_> = self.at(budget).filter_map(|(_, at)| at.measured?.interval).collect();
        for at in self.configurations.iter_mut().filter_map(|c| c.at.get_mut(budget)?.as_mut()) {
            let own = at.measured.and_then(|m| m.interval);
            at.rank = own.map(|[low, _]| 1 + intervals.iter().filter(|[_, high]| *high < low).count());
        }
    }

    fn mark_front(&mut self) {
        let place = |at: &AtBudget| at.measured.map(|m| [at.seconds, m.mean]);
        let all: Vec<_> = self.points_mut().filter_map(|at| place(at)).collect();
        for at in self.points_mut() {
            let beats = |own: [f64; 2], other: &[f64; 2]| {
                let ([seconds, error], [other_seconds, other_error]) = (own, *other);
                (other_error < error && other_seconds <= seconds * (1.0 + SAME_TIME))
                    || (other_error == error && other_seconds < seconds)
            };
            at.is_on_front = place(at).is_some_and(|own| !all.iter().any(|other| beats(own, other)));
        }
    }
}

impl Conclusion {
    /// What is known at the greatest budget that was reached, and its index.
    pub fn last(&self) -> Option<(usize, &AtBudget)> {
        self.at.iter().enumerate().rev().find_map(|(i, at)| Some((i, at.as_ref()?)))
    }
}

/// All but what depends on other configurations.
fn conclude(configuration: &Configuration, results: &Results, own: f64) -> Conclusion {
    let runs = &configuration.runs;
    let at: Vec<_> = (0..results.budgets.len()).map(|budget| at_budget(runs, budget, own)).collect();
    let time = (!runs.is_empty()).then(|| {
        let of = |f: &dyn Fn(&Run) -> f64| median(runs.iter().map(f)).unwrap_or(0.0);
        let rest = |run: &Run| run.points.last().map_or(0.0, |p| (p.seconds - run.first_image).max(0.0));
        TimeSplit {
            load: results.load,
            build: of(&|r| r.build),
            first_image: of(&|r| r.first_image),
            rest: of(&rest),
        }
    });
    let slope = fit(runs, &at, own);
    let mut conclusion = Conclusion {
        name: configuration.name.clone(),
        at,
        time,
        query_bytes: runs.iter().map(|run| run.query_bytes).max().unwrap_or(0),
        slope,
        efficiency: None,
        bias: None,
    };
    if let Some((budget, last)) = conclusion.last() {
        let product = last.rel_mse.map_or(0.0, |e| e.mean * last.seconds);
        let efficiency = (product > 0.0).then(|| 1.0 / product);
        let bias = bias_floor(configuration, budget, results.reference.rel_mse);
        (conclusion.efficiency, conclusion.bias) = (efficiency, bias);
    }
    conclusion
}

fn at_budget(runs: &[Run], budget: usize, own: f64) -> Option<AtBudget> {
    let points: Vec<_> = runs.iter().filter_map(|run| run.points.get(budget)).collect();
    if points.is_empty() {
        return None;
    }
    let log_mean =
        |error: &dyn Fn(usize) -> f64| LogMean::of(&(0..points.len()).map(error).collect::<Vec<_>>());
    let measured = log_mean(&|i| points[i].rel_mse);
    Some(AtBudget {
        seeds: points.len(),
        seconds: points.iter().map(|p| p.seconds).sum::<f64>() / points.len() as f64,
        measured,
        rel_mse: measured.map(|m| m.less(own)),
        trimmed: log_mean(&|i| points[i].rel_mse_trimmed).map(|m| m.less(own)),
        is_mostly_reference: measured.is_some_and(|m| own > 0.5 * m.mean),
        rank: None,
        is_on_front: false,
    })
}

/// The mean slope of the runs, over those budgets at which the error is mostly their own. Budgets within one pass share its snapshot, which counts once.
fn fit(runs: &[Run], at: &[Option<AtBudget>], own: f64) -> Option<Slope> {
    let is_fit = |budget: usize| {
        at[budget].as_ref().is_some_and(|at| at.measured.is_some() && !at.is_mostly_reference)
            && runs
                .iter()
                .all(|run| run.points.get(budget).is_none_or(|p| p.rel_mse > own && p.seconds > 0.0))
    };
    let budgets: Vec<usize> = (0..at.len()).filter(|&budget| is_fit(budget)).collect();
    let of_run = |run: &Run| {
        let mut points: Vec<_> = budgets.iter().filter_map(|&budget| run.points.get(budget)).collect();
        points.dedup_by_key(|point| point.passes);
        slope(&points.iter().map(|p| [p.seconds.ln(), (p.rel_mse - own).ln()]).collect::<Vec<_>>())
    };
    let slopes: Vec<f64> = runs.iter().filter_map(of_run).collect();
    let (value, error) = mean_and_error(&slopes);
    value.is_finite().then_some(Slope { value, error })
}

/// See [`BiasFloor`].
fn bias_floor(configuration: &Configuration, budget: usize, own: Option<f64>) -> Option<BiasFloor> {
    let squared = *configuration.squared_bias.get(budget).filter(|b| b.is_finite())?;
    let points = configuration.runs.iter().filter_map(|run| run.points.get(budget));
    let (errors, seconds): (Vec<_>, Vec<_>) = points.map(|p| (p.rel_mse, p.seconds)).unzip();
    let (mean, spread) = mean_and_error(&errors);
    let spread = spread.filter(|spread| spread.is_finite())?;
    let reach = spread * student_t(errors.len() as u32 - 1, CONFIDENCE);
    let uncertainty = reach.max(own.unwrap_or(0.0));
    let is_seen = own.map(|_| squared > uncertainty);
    let noise_is_less_after = (configuration.bias.is_some() && is_seen == Some(true)).then(|| {
        let noise = (mean - own.unwrap_or(0.0) - squared).max(0.0);
        let first_image = median(configuration.runs.iter().map(|run| run.first_image)).unwrap_or(0.0);
        (mean_and_error(&seconds).0 * noise / squared).max(first_image)
    });
    Some(BiasFloor { squared, uncertainty, is_seen, noise_is_less_after })
}
