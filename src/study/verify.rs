//! Whether pilots find what [`Integrator::ability`] predicts.
//!
//! Of each class, the energy of integrators that sample it well must agree; one that samples it poorly may have missed some, but has no more; one that cannot
//! has none, unless lights of another kind make the same class; and a class that cannot exist has none at all. Images as a whole must agree where all classes that exist are sampled well.

use super::pilot::{Estimate, Pilot};
use crate::integrators::{Ability, Integrator, PathLength};
use crate::scene::requirements::{PathClass, Requirements};

/// Two estimates differ if that is this many standard errors: with 14 degrees of freedom, once in 30,000 comparisons of normal ones.
const DIFFERENT: f64 = 6.0;

/// What differs by less than this share is the same all the same: errors of noisy estimates are themselves uncertain.
const TOLERANCE: f64 = 0.03;

/// The same where one is biased: at edges photons of a fixed radius lose 4 % of the light in `scenes/glass-spheres.xml`.
const BIASED_TOLERANCE: f64 = 0.06;

/// What was measured, and whether that is as predicted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// Mean luminance; `None` if the integrator does not know the class of its paths.
    pub measured: Option<Estimate>,
    /// Whether the prediction holds.
    pub holds: bool,
}

impl Verdict {
    /// Whether the prediction holds.
    pub fn holds(&self) -> bool {
        self.holds
    }

    /// For tables, 18 characters.
    pub fn cell(&self) -> String {
        let mark = if self.holds { ' ' } else { '!' };
        match self.measured {
            Some(Estimate { mean, error }) => format!(" {mark}{:>16}", format!("{mean:.5} ({error:.5})")),
            None => format!(" {mark}{:>16}", "-"),
        }
    }
}

/// Judges pilots of several integrators: for each a verdict on every class of [`PathClass::ALL`] and one on the whole image.
pub fn judge(tried: &[(Integrator, &Pilot)], needs: &Requirements, length: PathLength) -> Vec<Vec<Verdict>> {
    let classes = needs.classes(length.limit());
    let knows = |i: &Integrator| !matches!(i, Integrator::PhotonMap(_) | Integrator::VirtualLights(_));
    let of_class = |i: usize, class: PathClass| {
        let able = tried.iter().filter(|(t, _)| knows(t) && t.ability(class, needs) == Ability::Well);
        let best = able.map(|(_, p)| p.classes[i]).min_by(|a, b| a.error.total_cmp(&b.error));
        let exists = classes.contains(&class);
        move |(integrator, pilot): &(Integrator, &Pilot)| {
            if !knows(integrator) {
                return Verdict { measured: None, holds: true };
            }
            let measured = pilot.classes[i];
            let holds = match (exists, integrator.ability(class, needs)) {
                (false, _) => measured.mean == 0.0,
                (true, Ability::Cannot) => {
                    let is_mixed = needs.lights.delta() > 0 && needs.lights.visible() > 0;
                    measured.mean == 0.0 || (is_mixed && best.is_none_or(|best| !exceeds(&measured, &best)))
                }
                (true, Ability::Poorly) => best.is_none_or(|best| !exceeds(&measured, &best)),
                (true, Ability::Well) => {
                    best.is_none_or(|best| !exceeds(&measured, &best) && !exceeds(&best, &measured))
                }
            };
            Verdict { measured: Some(measured), holds }
        }
    };
    let is_able =
        |integrator: &Integrator| classes.iter().all(|&c| integrator.ability(c, needs) == Ability::Well);
    let able = tried.iter().filter(|(integrator, _)| is_able(integrator));
    let whole = able.min_by(|(_, a), (_, b)| a.total.error.total_cmp(&b.total.error));
    let judge = |row: &(Integrator, &Pilot)| {
        let mut verdicts: Vec<_> =
            PathClass::ALL.into_iter().enumerate().map(|(i, class)| of_class(i, class)(row)).collect();
        let total = row.1.total;
        let holds = whole.is_none_or(|(reference, pilot)| {
            let is_biased = row.0.bias().or(reference.bias()).is_some();
            let tolerance = if is_biased { BIASED_TOLERANCE } else { TOLERANCE };
            let whole = pilot.total;
            !exceeds_beyond(tolerance, &total, &whole)
                && (!is_able(&row.0) || !exceeds_beyond(tolerance, &whole, &total))
        });
        verdicts.push(Verdict { measured: Some(total), holds });
        verdicts
    };
    tried.iter().map(judge).collect()
}

fn exceeds(a: &Estimate, b: &Estimate) -> bool {
    exceeds_beyond(TOLERANCE, a, b)
}

fn exceeds_beyond(tolerance: f64, a: &Estimate, b: &Estimate) -> bool {
    a.exceeds_by(b) > DIFFERENT && a.mean > (1.0 + tolerance) * b.mean
}
