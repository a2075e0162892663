//! Images of single strategies: what each (s, t) contributes with its weight, and what it would alone.
//!
//! They are to look at: where a strategy is noisy, where weights cure it. And to test by: all strategies for paths of one length, unweighted,
//! have the same expectation wherever they can make the path at all.
//!
//! Every contribution goes to its strategy's film as a splat, those of camera samples too.

use std::collections::BTreeMap;

use glam::{UVec2, Vec2};
use rayon::prelude::*;

use crate::film::{AovSet, Channel, Film, FilmError, Image, Pixels, Splat};
use crate::integrators::{Integrator, Pass, PathObserver, Scratch, Strategy};
use crate::query::RayQuery;
use crate::render::{RenderError, Target, sample_pixel, trace_light_path};
use crate::scene::{FilmSettings, PixelRect, Rgb};
use crate::transport::World;
use crate::transport::vertex::SurfaceVertex;
use crate::transport::walk::Walk;

/// Rows of pixels whose contributions one task collects.
const TASK_ROWS: i32 = 4;

/// Greatest width and height of a contact sheet in pixels.
const SHEET_LIMIT: u32 = 4096;

/// The films of a strategy.
struct Pair {
    weighted: Film,
    unweighted: Film,
}

/// One contribution to the film.
#[derive(Clone, Copy)]
struct Contribution {
    strategy: Strategy,
    film: Vec2,
    value: Rgb,
    weight: f32,
}

/// The images of all strategies that contributed.
pub struct StrategyImages {
    settings: FilmSettings,
    passes: Vec<u32>,
    radiance_unit: f32,
    films: BTreeMap<Strategy, Pair>,
}

impl StrategyImages {
    /// No images yet, for a world's film.
    pub fn new(world: &World) -> Self {
        let settings = world.scene.film.clone();
        let radiance_unit = world.lights.radiance_unit();
        Self { settings, passes: Vec::new(), radiance_unit, films: BTreeMap::new() }
    }

    /// Renders a pass and adds it. Films are kept for each strategy: the caller limits the length of paths.
    ///
    /// # Errors
    /// If the pass was added before, or a film has no memory.
    pub fn add_pass<Q: RayQuery>(
        &mut self,
        world: &World,
        query: &Q,
        target: &Target,
        index: u32,
    ) -> Result<(), RenderError> {
        let area = Film::new(&self.settings, AovSet::default(), self.radiance_unit)?.sampled_area();
        let pass = Pass::new(world, query, target.integrator, target.seed, index, area)?;
        let mut splats: BTreeMap<Strategy, [Vec<Splat>; 2]> = BTreeMap::new();
        for Contribution { strategy, film, value, weight } in collect(&pass, target.integrator, |_| true) {
            let [weighted, unweighted] = splats.entry(strategy).or_default();
            weighted.push(Splat { position: film, radiance: value * weight });
            unweighted.push(Splat { position: film, radiance: value });
        }
        for &strategy in splats.keys() {
            if !self.films.contains_key(&strategy) {
                self.films.insert(strategy, self.new_pair()?);
            }
        }
        for (strategy, pair) in &mut self.films {
            let [weighted, unweighted] = splats.remove(strategy).unwrap_or_default();
            pair.weighted.add_pass(index, None, &weighted)?;
            pair.unweighted.add_pass(index, None, &unweighted)?;
        }
        self.passes.push(index);
        Ok(())
    }

    /// Films that have seen nothing in the passes so far.
    fn new_pair(&self) -> Result<Pair, FilmError> {
        let mut film = Film::new(&self.settings, AovSet::default(), self.radiance_unit)?;
        for &pass in &self.passes {
            film.add_pass(pass, None, &[])?;
        }
        Ok(Pair { weighted: film.clone(), unweighted: film })
    }

    /// Whether no pass was added yet.
    pub fn is_empty(&self) -> bool {
        self.passes.is_empty()
    }

    /// The strategies that have contributed, with their weighted and unweighted images.
    pub fn develop(&self) -> Vec<(Strategy, [Image; 2])> {
        let images = |pair: &Pair| [pair.weighted.develop(), pair.unweighted.develop()];
        self.films.iter().map(|(strategy, pair)| (*strategy, images(pair))).collect()
    }
}

/// Contributions of a strategy that should not be.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct OddCount {
    /// Infinite or no number.
    pub non_finite: u64,
    /// Finite, with a component below 0.
    pub negative: u64,
}

/// Traces a pass again and counts, for each strategy, the contributions that are not finite or negative. What photons and virtual lights contribute is no
/// strategy's and not counted.
///
/// # Errors
/// If the pass has too many photons, or the film makes no sense.
pub fn odd_contributions<Q: RayQuery>(
    world: &World,
    query: &Q,
    target: &Target,
    index: u32,
) -> Result<BTreeMap<Strategy, OddCount>, RenderError> {
    let area = Film::new(&world.scene.film, AovSet::default(), 1.0)?.sampled_area();
    let pass = Pass::new(world, query, target.integrator, target.seed, index, area)?;
    let mut counts: BTreeMap<Strategy, OddCount> = BTreeMap::new();
    for odd in collect(&pass, target.integrator, Contribution::is_odd) {
        let count = counts.entry(odd.strategy).or_default();
        let is_finite = (odd.value * odd.weight).is_finite();
        *if is_finite { &mut count.negative } else { &mut count.non_finite } += 1;
    }
    Ok(counts)
}

impl Contribution {
    fn is_odd(&self) -> bool {
        let sum = self.value * self.weight;
        !sum.is_finite() || sum.cmplt(Rgb::ZERO).any()
    }
}

/// All contributions of a pass that are to be kept, in an order that does not depend on threads.
fn collect<Q: RayQuery>(
    pass: &Pass<Q>,
    integrator: Integrator,
    keep: fn(&Contribution) -> bool,
) -> Vec<Contribution> {
    let (min, size) = (pass.area.min, pass.area.size.as_ivec2());
    let tasks: Vec<Vec<Contribution>> = (0..(size.y + TASK_ROWS - 1) / TASK_ROWS)
        .into_par_iter()
        .map_init(Scratch::default, |scratch, task| {
            let mut recorder = Recorder { keep, contributions: Vec::new(), unplaced: Vec::new() };
            for y in task * TASK_ROWS..((task + 1) * TASK_ROWS).min(size.y) {
                for x in 0..size.x {
                    let pixel = min + glam::IVec2::new(x, y);
                    if matches!(integrator, Integrator::Forward(_)) {
                        trace_light_path(pass, integrator, pass.slot(pixel), scratch, &mut recorder);
                    } else {
                        let sample = sample_pixel(pass, integrator, pixel, scratch, &mut recorder);
                        recorder.place(pixel.as_vec2() + sample.jitter);
                    }
                    scratch.splats.clear();
                }
            }
            recorder.contributions
        })
        .collect();
    tasks.concat()
}

/// Writes contributions down.
struct Recorder {
    keep: fn(&Contribution) -> bool,
    contributions: Vec<Contribution>,
    /// Where the contributions of the present camera sample are; they do not know their place yet.
    unplaced: Vec<usize>,
}

impl Recorder {
    fn place(&mut self, film: Vec2) {
        for i in self.unplaced.drain(..) {
            self.contributions[i].film = film;
        }
    }
}

impl PathObserver for Recorder {
    fn segment(&mut self, _: &Walk, _: u32, _: Option<&SurfaceVertex>) {}

    fn contribution(&mut self, strategy: Strategy, film: Option<Vec2>, value: Rgb, weight: f32) {
        let contribution = Contribution { strategy, film: film.unwrap_or_default(), value, weight };
        if !(self.keep)(&contribution) {
            return;
        }
        if film.is_none() {
            self.unplaced.push(self.contributions.len());
        }
        self.contributions.push(contribution);
    }
}

/// All images as layers of one: channels `weighted.s1t2.R` and so on. `None` if there are none.
pub fn layers(images: &[(Strategy, [Image; 2])]) -> Option<Image> {
    let (_, [first, _]) = images.first()?;
    let channels = images.iter().flat_map(|(Strategy { s, t }, pair)| {
        ["weighted", "unweighted"].into_iter().zip(pair).flat_map(move |(kind, image)| {
            image.channels.iter().map(move |channel| Channel {
                name: format!("{kind}.s{s}t{t}.{}", channel.name).into(),
                pixels: channel.pixels.clone(),
            })
        })
    });
    Some(Image { channels: channels.collect(), ..first.clone() })
}

/// A contact sheet as in Veach's thesis: path lengths from the top, in each row `s` from the left. Made smaller by averaging where it would be too
/// large. `which` is 0 for the weighted images and 1 for the unweighted ones. `None` if there are none.
pub fn contact_sheet(images: &[(Strategy, [Image; 2])], which: usize) -> Option<Image> {
    /// Radiance between the images.
    const GAP: f32 = 0.03;
    let rows = images.iter().map(|(strategy, _)| strategy.s + strategy.t - 1).max()?;
    let columns = images.iter().map(|(strategy, _)| strategy.s + 1).max()?;
    let tile = images[0].1[which].crop.size;
    let shrink = (tile * UVec2::new(columns, rows)).max_element().div_ceil(SHEET_LIMIT);
    let cell = (tile / shrink).max(UVec2::ONE) + 1;
    let size = cell * UVec2::new(columns, rows);
    let mut colours = [const { Vec::new() }; 3];
    for (colour, name) in colours.iter_mut().zip(["R", "G", "B"]) {
        colour.resize((size.x * size.y) as usize, GAP);
        for (strategy, pair) in images {
            let values = pair[which].floats(name)?;
            let corner = cell * UVec2::new(strategy.s, strategy.s + strategy.t - 2);
            for y in 0..cell.y - 1 {
                for x in 0..cell.x - 1 {
                    let block = (0..shrink * shrink).filter_map(|i| {
                        let at = UVec2::new(x, y) * shrink + UVec2::new(i % shrink, i / shrink);
                        at.cmplt(tile).all().then(|| values[(at.y * tile.x + at.x) as usize])
                    });
                    let mean = block.sum::<f32>() / (shrink * shrink) as f32;
                    colour[((corner.y + y) * size.x + corner.x + x) as usize] = mean;
                }
            }
        }
    }
    let channels = ["R", "G", "B"]
        .into_iter()
        .zip(colours)
        .map(|(name, values)| Channel { name: name.into(), pixels: Pixels::Colour(values) });
    Some(Image { film_size: size, crop: PixelRect { min: UVec2::ZERO, size }, channels: channels.collect() })
}
