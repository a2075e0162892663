//! `auto`: the integrator that is expected to have the least error at equal cost.
//!
//! Candidates are those that the classes of paths in the scene ask for ([`Requirements`]): `path` and `bdpt` always, and photons for caustics
//! (`sppm:mode=caustic`) where some are that `path` cannot find or finds by luck. Each is tried in a [`Pilot`], and those that come close to each other in one of
//! as many passes as a render has. The choice is a function of the scene and the film's size, and of nothing that depends on the machine.

use glam::UVec2;

use crate::integrators::backward::Backward;
use crate::integrators::bidirectional::Bidirectional;
use crate::integrators::photon_map::PhotonMapper;
use crate::integrators::{Ability, Integrator, PathLength, TooManyStored};
use crate::query::RayQuery;
use crate::scene::Scene;
use crate::scene::requirements::{PathClass, Requirements};
use crate::study::pilot::Pilot;
use crate::transport::World;

/// What people call the choice, where they name integrators.
pub const AUTO: &str = "auto";

/// Rays per pixel for which errors are compared: some ten seconds at 512x512 on two cores.
const BUDGET: f64 = 500.0;

/// Passes of a pilot's group: with eight groups and a thousand pixels 130,000 samples.
const PASSES: u32 = 16;

/// The same with photons, of which a pass has as many as in a render: the noise of a lookup depends on their number.
const PHOTON_PASSES: u32 = 2;

/// Candidates with expected errors of less than this many times the least are tried again, in as many passes as the budget pays for, but at most [`MAX_PASSES`]:
/// noise falls faster than with the inverse of the number of samples where these are spread evenly, and rare light is seen late. In the Cornell box of the test data
/// `relative_variance` of `path` falls from 0.050 after 16 passes to 0.025 after 256.
const CLOSE: f64 = 5.0;
const MAX_PASSES: f64 = 128.0;

/// Light is missing if it is this many standard errors less than what another integrator finds, and this share of it.
const MISSING_ERRORS: f64 = 4.0;
const MISSING_SHARE: f64 = 0.01;

/// What a ray of `bdpt` and of photons costs beside one of `path`, shading included: 0.43, 0.46 and 0.33 us in `scenes/ring.xml`; 0.32, 0.34
/// and 0.27 in `scenes/glass-spheres.xml`.
const BIDIRECTIONAL_COST: f64 = 1.25;
const PHOTON_COST: f64 = 1.35;

/// relMSE that the blur of `sppm` leaves at the budget, about.
const BLUR: f64 = 5e-4;

/// An integrator with the reason for it.
#[derive(Debug, Clone, PartialEq)]
pub struct Choice {
    /// The integrator.
    pub integrator: Integrator,
    /// Why, in a line.
    pub why: String,
}

/// A candidate that was tried.
#[derive(Debug)]
struct Candidate {
    integrator: Integrator,
    name: &'static str,
    pilot: Pilot,
    /// What its rays cost.
    cost: f64,
}

/// Chooses an integrator for paths of a length.
///
/// # Errors
/// If a pilot has too many photons.
pub fn choose<Q: RayQuery>(scene: &Scene, query: &Q, length: PathLength) -> Result<Choice, TooManyStored> {
    choose_among(candidates(length), scene, query, length)
}

/// Chooses an integrator that has no bias, for references.
///
/// # Errors
/// As of [`choose`].
pub fn choose_unbiased<Q: RayQuery>(
    scene: &Scene,
    query: &Q,
    length: PathLength,
) -> Result<Choice, TooManyStored> {
    let mut unbiased = candidates(length);
    unbiased.retain(|(_, integrator, _)| integrator.bias().is_none());
    choose_among(unbiased, scene, query, length)
}

/// Chooses among candidates, of which `path` is the first.
fn choose_among<Q: RayQuery>(
    candidates: Vec<(&'static str, Integrator, f64)>,
    scene: &Scene,
    query: &Q,
    length: PathLength,
) -> Result<Choice, TooManyStored> {
    let needs = Requirements::of(scene);
    let path = candidates[0].1;
    let classes = needs.classes(length.limit());
    let is_simple = |class: &PathClass| *class <= PathClass::DirectMirrored;
    if classes.iter().all(is_simple) {
        return Ok(Choice { integrator: path, why: "path, as there is direct light at most".to_owned() });
    }
    let size = Pilot::film_size(scene.film.size);
    let world = World::for_film(scene, size);
    let film_pixels = f64::from(scene.film.size.x) * f64::from(scene.film.size.y);
    let of_path = |class: &PathClass| path.ability(*class, &needs);
    let has_caustics = classes.iter().any(|class| of_path(class) < Ability::Well);
    let mut tried = Vec::new();
    for (name, integrator, cost) in candidates {
        let is_photons = matches!(integrator, Integrator::PhotonMap(_));
        if is_photons && !has_caustics {
            continue;
        }
        let passes = if is_photons { PHOTON_PASSES } else { PASSES };
        let pilot = Pilot::run(&world, query, integrator, size, passes)?;
        tried.push(Candidate { integrator, name, pilot, cost });
    }
    let mut errors = expected_errors(&tried, film_pixels);
    if try_close_ones_again(&mut tried, &errors, &world, query, size)? {
        errors = expected_errors(&tried, film_pixels);
    }
    let best = (0..tried.len()).min_by(|&a, &b| errors[a].total_cmp(&errors[b])).unwrap_or(0);
    let why = explain(&tried, &errors, best, &classes, &needs);
    Ok(Choice { integrator: tried[best].integrator, why })
}

/// Gives candidates that are close to the best a pilot of as many passes as the budget pays for. Whether there were any.
fn try_close_ones_again<Q: RayQuery>(
    tried: &mut [Candidate],
    errors: &[f64],
    world: &World,
    query: &Q,
    size: UVec2,
) -> Result<bool, TooManyStored> {
    let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
    let is_close = |error: f64| error <= CLOSE * least;
    if errors.iter().filter(|error| is_close(**error)).count() < 2 {
        return Ok(false);
    }
    for (Candidate { integrator, pilot, cost, .. }, error) in tried.iter_mut().zip(errors) {
        let passes = (BUDGET / (pilot.rays * *cost)).min(MAX_PASSES) as u32;
        if is_close(*error) && passes > PASSES && !matches!(integrator, Integrator::PhotonMap(_)) {
            *pilot = Pilot::run(world, query, *integrator, size, passes)?;
        }
    }
    Ok(true)
}

/// Integrators with their names and what their rays cost, `path` first. No photons where paths may be longer than they can tell.
fn candidates(length: PathLength) -> Vec<(&'static str, Integrator, f64)> {
    let path = Integrator::Backward(Backward { length, hide_emitters: false });
    let bdpt = Integrator::Bidirectional(Bidirectional { length, ..Bidirectional::default() });
    let mut all = vec![("path", path, 1.0), ("bdpt", bdpt, BIDIRECTIONAL_COST)];
    let photons = PhotonMapper::caustics(length).ok();
    all.extend(photons.map(|mapper| ("sppm:mode=caustic", Integrator::PhotonMap(mapper), PHOTON_COST)));
    all
}

/// relMSE of each after the budget.
fn expected_errors(tried: &[Candidate], film_pixels: f64) -> Vec<f64> {
    (0..tried.len()).map(|i| expected_error(tried, i, film_pixels)).collect()
}

/// relMSE after the budget, about: noise, blur, and what is missing altogether.
fn expected_error(tried: &[Candidate], which: usize, film_pixels: f64) -> f64 {
    let Candidate { integrator, pilot, cost, .. } = &tried[which];
    let rays = pilot.rays + pilot.shared_rays / film_pixels;
    let passes = (BUDGET / (rays * cost)).max(1.0);
    let noise = pilot.relative_variance(&reference(tried)) / passes;
    let noise = match integrator {
        // The disc shrinks with the number of passes to the power of -0.3, and noise grows as much.
        Integrator::PhotonMap(_) => noise * passes.powf(0.3) / 1.3 + BLUR,
        _ => noise,
    };
    // Missing light stays missing, however long a render takes: it counts for more than its square.
    noise + missing(tried, which)
}

/// Luminance of the pilot's pixels, as the candidates have it in the middle.
fn reference(tried: &[Candidate]) -> Vec<f64> {
    let pixel = |i: usize| {
        let mut values: Vec<f64> = tried.iter().map(|c| c.pilot.pixels[i].mean).collect();
        values.sort_by(f64::total_cmp);
        let n = values.len();
        0.5 * (values[(n - 1) / 2] + values[n / 2])
    };
    (0..tried[0].pilot.pixels.len()).map(pixel).collect()
}

/// Share of the light that an integrator misses and another finds.
fn missing(tried: &[Candidate], which: usize) -> f64 {
    let own = &tried[which].pilot.total;
    let share = |c: &Candidate| {
        let other = &c.pilot.total;
        let share = 1.0 - own.mean / other.mean;
        if other.exceeds_by(own) > MISSING_ERRORS && share > MISSING_SHARE { share } else { 0.0 }
    };
    tried.iter().map(share).fold(0.0, f64::max)
}

fn explain(
    tried: &[Candidate],
    errors: &[f64],
    best: usize,
    classes: &[PathClass],
    needs: &Requirements,
) -> String {
    let name = tried[best].name;
    let missed = missing(tried, 0);
    if best != 0 && missed > 0.0 {
        let blind = |class: &&PathClass| tried[0].integrator.ability(**class, needs) < Ability::Well;
        let notation: Vec<_> = classes.iter().filter(blind).map(|class| class.notation()).collect();
        let of =
            if notation.is_empty() { String::new() } else { format!(" (paths {})", notation.join(", ")) };
        return format!("{name}, as path misses {:.0} % of the light{of}", 100.0 * missed);
    }
    // Against path, or where that is chosen against the next best.
    let others = (0..tried.len()).filter(|&i| i != best);
    let rival = if best == 0 { others.min_by(|&a, &b| errors[a].total_cmp(&errors[b])) } else { Some(0) };
    match rival {
        Some(rival) if errors[best] > 0.0 => format!(
            "{name}: at equal cost {} is expected to have {:.1} times its squared error",
            tried[rival].name,
            errors[rival] / errors[best]
        ),
        _ => format!("{name}: there is no noise to choose by"),
    }
}
