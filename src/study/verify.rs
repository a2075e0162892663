//! Whether pilots find what [`Integrator::ability`] predicts.
//!
//! Of each class, the energy of integrators that sample it well must agree; one that samples it poorly may have missed some, but has no more; one that cannot
//! has none, unless lights of another kind make the same class; and a class that cannot exist has none at all. Images as a whole are held against that of an
//! integrator that samples well all that exists and has no bias. Where nothing can be the measure, there is no verdict.

use super::pilot::{Estimate, Pilot};
use crate::integrators::{Ability, Integrator, PathLength};
use crate::scene::requirements::{PathClass, Requirements};

/// Two estimates differ if that is this many standard errors: with 14 degrees of freedom, once in 30,000 comparisons of normal ones.
const DIFFERENT: f64 = 6.0;

/// What differs by less than this share is the same all the same. A sample usually deviates by some 2.5 times the mean: of 260,000 the mean has a standard error of
/// 0.5 %, six of which are this. Groups that agree better than that may have missed the same rare light, and their error says nothing of it.
const TOLERANCE: f64 = 0.03;

/// What was measured, and whether that is as predicted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// Mean luminance; `None` if the integrator does not know the class of its paths.
    pub measured: Option<Estimate>,
    /// Whether the prediction holds; `None` if there is nothing to tell by.
    pub holds: Option<bool>,
}

impl Verdict {
    /// For tables, 18 characters: `!` where the prediction does not hold, `?` where nothing tells.
    pub fn cell(&self) -> String {
        let mark = match self.holds {
            Some(true) => ' ',
            Some(false) => '!',
            None => '?',
        };
        match self.measured {
            Some(Estimate { mean, error }) => format!(" {mark}{:>16}", format!("{mean:.5} ({error:.5})")),
            None => format!("  {:>16}", "-"),
        }
    }
}

/// Judges pilots of several integrators: for each a verdict on every class of [`PathClass::ALL`] and one on the whole image.
pub fn judge(tried: &[(Integrator, &Pilot)], needs: &Requirements, length: PathLength) -> Vec<Vec<Verdict>> {
    let classes = needs.classes(length.limit());
    let knows = |i: &Integrator| !matches!(i, Integrator::PhotonMap(_) | Integrator::VirtualLights(_));
    // What one is held against: of the others that should know, the one that is surest.
    let best = |row: usize, value: &dyn Fn(&Pilot) -> Estimate, is_fit: &dyn Fn(&Integrator) -> bool| {
        let others = tried.iter().enumerate().filter(|(i, (t, _))| *i != row && is_fit(t));
        others.map(|(_, (_, pilot))| value(pilot)).min_by(|a, b| a.error.total_cmp(&b.error))
    };
    let of_class = |row: usize, i: usize, class: PathClass| {
        let (integrator, pilot) = &tried[row];
        if !knows(integrator) {
            return Verdict { measured: None, holds: None };
        }
        let samples_well = |t: &Integrator| knows(t) && t.ability(class, needs) == Ability::Well;
        let best = best(row, &|p| p.classes[i], &samples_well);
        let measured = pilot.classes[i];
        let has_no_more = best.map(|best| !exceeds(&measured, &best));
        let holds = match (classes.contains(&class), integrator.ability(class, needs)) {
            (false, _) => Some(measured.mean == 0.0),
            (true, Ability::Cannot) if measured.mean == 0.0 => Some(true),
            (true, Ability::Cannot) => {
                let is_mixed = needs.lights.delta() > 0 && needs.lights.visible() > 0;
                if is_mixed { has_no_more } else { Some(false) }
            }
            (true, Ability::Poorly) => has_no_more,
            (true, Ability::Well) => best.map(|best| agree(&measured, &best)),
        };
        Verdict { measured: Some(measured), holds }
    };
    let is_able =
        |integrator: &Integrator| classes.iter().all(|&c| integrator.ability(c, needs) == Ability::Well);
    let judge = |row: usize| {
        let mut verdicts: Vec<_> =
            PathClass::ALL.into_iter().enumerate().map(|(i, class)| of_class(row, i, class)).collect();
        let total = tried[row].1.total;
        let best = best(row, &|p| p.total, &|t| is_able(t) && t.bias().is_none());
        let holds = best
            .map(|best| if is_able(&tried[row].0) { agree(&total, &best) } else { !exceeds(&total, &best) });
        verdicts.push(Verdict { measured: Some(total), holds });
        verdicts
    };
    (0..tried.len()).map(judge).collect()
}

fn exceeds(a: &Estimate, b: &Estimate) -> bool {
    a.exceeds_by(b) > DIFFERENT && a.mean > (1.0 + TOLERANCE) * b.mean
}

fn agree(a: &Estimate, b: &Estimate) -> bool {
    !exceeds(a, b) && !exceeds(b, a)
}
