//! Two backends on one scene: whether they agree ray by ray on what an integrator really asks, how far their images are apart, and what each costs.
//!
//! The rays are those of the integrator run on the first backend, told apart into primary (from the camera), bounce (all other closest-hit queries,
//! from lights too) and shadow (occlusion queries). Both backends answer all of them in bare loops, which is what is timed.

use std::collections::HashSet;
use std::fmt::Write as _;
use std::io;
use std::time::{Duration, Instant};

use glam::{IVec2, Vec3};
use rayon::prelude::*;

use super::flip;
use super::heat::{LEGEND, heat_map};
use super::html::Page;
use super::metrics::{Errors, compare, relative_squared_errors};
use super::picture::Picture;
use crate::film::{AovSet, Film, FilmError, Image};
use crate::integrators::Pass;
use crate::query::crosscheck::{Findings, Judged, Ledger};
use crate::query::recorder::Recorder;
use crate::query::{AnyQuery, Backend, BackendError, Hit, Ray, RayQuery, with_query};
use crate::render::{Control, RenderError, Stop, Target, camera_ray, render};
use crate::transport::World;

/// Kinds of rays, in the order of all arrays of three here.
pub const KINDS: [&str; 3] = ["primary", "bounce", "shadow"];

/// Rays of a pass that are written down at most: 512 MiB of them.
const ROOM: u64 = 1 << 24;

/// Rays that the backends are asked in turns.
const CHUNK: usize = 1 << 18;

/// How much is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Effort {
    /// Passes of the images.
    pub passes: u32,
    /// Rays, at least, unless a pass asks none.
    pub rays: u64,
}

/// Why there is no comparison.
#[derive(Debug, thiserror::Error)]
pub enum AbError {
    /// A backend was not built.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// The film makes no sense, or has no memory.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// An image was not rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// What was measured of one backend.
#[derive(Debug, Clone)]
pub struct Side {
    /// Its name and version.
    pub name: String,
    /// Time to build it.
    pub build: Duration,
    /// Bytes that it holds beside the shapes' own.
    pub bytes: usize,
    /// Time to answer all rays of each kind.
    pub answering: [Duration; 3],
    /// Time to render the image.
    pub rendering: Duration,
    /// The image.
    pub image: Image,
}

/// How far the images are apart; the first is the reference.
#[derive(Debug, Clone, PartialEq)]
pub struct Difference {
    /// Errors; `None` if no pixel is finite.
    pub errors: Option<Errors>,
    /// FLIP of colours clamped to [0, 1].
    pub flip_ldr: f64,
    /// FLIP over exposures.
    pub flip_hdr: f64,
    /// Pixels of which a bit differs.
    pub pixels: usize,
}

/// What a comparison found.
#[derive(Debug, Clone)]
pub struct Report {
    /// Primitives of the scene, those of a group once for each instance.
    pub primitives: u64,
    /// Passes of the images.
    pub passes: u32,
    /// The two backends.
    pub sides: [Side; 2],
    /// Rays of each kind and what the answers to them were.
    pub findings: [Findings; 3],
    /// Rays for which there was no room.
    pub not_recorded: u64,
    /// Of the images.
    pub difference: Difference,
}

/// Builds both backends and compares them.
///
/// # Errors
/// See [`AbError`].
pub fn run(
    world: &World,
    backends: [Backend; 2],
    target: &Target,
    effort: Effort,
) -> Result<Report, AbError> {
    let shapes = &world.scene.shapes;
    let [(mut a, first), (mut b, second)] = {
        let [a, b] = backends;
        [side(world, a, target, effort.passes)?, side(world, b, target, effort.passes)?]
    };
    let recorder = AnyQuery::Recorder(Box::new(Recorder::new(first, ROOM)));
    let mut comparison = Comparison::new(world, target, &second);
    comparison.ask_rays_of(&recorder, effort.rays)?;
    [a.answering, b.answering] = comparison.times;
    let findings = comparison.ledgers.map(|ledger| ledger.findings(shapes));
    let not_recorded = comparison.not_recorded;
    let difference = difference(&a.image, &b.image);
    let primitives = shapes.iter().map(|shape| u64::from(shape.geometry.primitive_count())).sum();
    Ok(Report { primitives, passes: effort.passes, sides: [a, b], findings, not_recorded, difference })
}

/// Builds a backend and renders an image by it.
fn side<'s>(
    world: &World<'s>,
    backend: Backend,
    target: &Target,
    passes: u32,
) -> Result<(Side, AnyQuery<'s>), AbError> {
    let start = Instant::now();
    let query = backend.build(&world.scene.shapes)?;
    let build = start.elapsed();
    let mut film = Film::new(&world.scene.film, AovSet::default(), world.lights.radiance_unit())?;
    let stop = Stop { passes: 0..passes, time: None };
    let start = Instant::now();
    with_query!(&query, query => render(world, query, target, &mut film, &stop, |_| Control::Continue))?;
    let rendering = start.elapsed();
    let (name, bytes, image) = (query.name(), query.memory(), film.develop());
    Ok((Side { name, build, bytes, answering: Default::default(), rendering, image }, query))
}

/// Answers compared so far, and the time that they took.
struct Comparison<'a, 's> {
    world: &'a World<'s>,
    target: &'a Target,
    second: &'a AnyQuery<'s>,
    ledgers: [Ledger; 3],
    /// Of each backend, for each kind of ray.
    times: [[Duration; 3]; 2],
    asked: u64,
    not_recorded: u64,
}

impl<'a, 's> Comparison<'a, 's> {
    fn new(world: &'a World<'s>, target: &'a Target, second: &'a AnyQuery<'s>) -> Self {
        let (ledgers, times) = Default::default();
        Self { world, target, second, ledgers, times, asked: 0, not_recorded: 0 }
    }

    /// Renders passes with the first backend, and after each asks both for the rays of the pass, until there were `count`.
    fn ask_rays_of(&mut self, first: &AnyQuery, count: u64) -> Result<(), AbError> {
        let AnyQuery::Recorder(recorder) = first else { unreachable!("rays come from a recorder") };
        let settings = &self.world.scene.film;
        let mut film = Film::new(settings, AovSet::default(), self.world.lights.radiance_unit())?;
        let area = film.sampled_area();
        let stop = Stop { passes: 0..u32::MAX, time: None };
        render(self.world, first, self.target, &mut film, &stop, |progress| {
            let Target { integrator: _, seed } = *self.target;
            let pass = Pass::empty(self.world, first, seed, progress.passes - 1, area);
            let of_camera = |i: u64| {
                let at = IVec2::new((i % u64::from(area.size.x)) as i32, (i / u64::from(area.size.x)) as i32);
                key(&camera_ray(&pass, area.min + at).0)
            };
            let primary: HashSet<_> = (0..pass.light_paths()).into_par_iter().map(of_camera).collect();
            let (recording, not_recorded) = recorder.take();
            self.not_recorded += not_recorded;
            let before = self.asked;
            let (primary, bounce): (Vec<_>, Vec<_>) =
                recording.closest.into_par_iter().partition(|ray| primary.contains(&key(ray)));
            self.ask_closest(0, recorder.query(), &primary);
            self.ask_closest(1, recorder.query(), &bounce);
            self.ask_occlusion(recorder.query(), &recording.occlusion);
            let is_enough = self.asked >= count || self.asked == before;
            if is_enough { Control::Stop } else { Control::Continue }
        })?;
        Ok(())
    }

    fn ask_closest(&mut self, kind: usize, first: &AnyQuery, rays: &[Ray]) {
        let shapes = &self.world.scene.shapes;
        for chunk in rays.chunks(CHUNK) {
            let [on_a, on_b] = &mut self.times;
            let a = timed(&mut on_a[kind], || with_query!(first, query => closest(query, chunk)));
            let b = timed(&mut on_b[kind], || with_query!(self.second, query => closest(query, chunk)));
            let ledger = &self.ledgers[kind];
            (chunk, a, b).into_par_iter().for_each(|(ray, a, b)| ledger.compare_closest(shapes, ray, [a, b]));
        }
        self.asked += rays.len() as u64;
    }

    fn ask_occlusion(&mut self, first: &AnyQuery, rays: &[Ray]) {
        for chunk in rays.chunks(CHUNK) {
            let [on_a, on_b] = &mut self.times;
            let a = timed(&mut on_a[2], || with_query!(first, query => occlusion(query, chunk)));
            let b = timed(&mut on_b[2], || with_query!(self.second, query => occlusion(query, chunk)));
            let ledger = &self.ledgers[2];
            (chunk, a, b).into_par_iter().for_each(|(ray, a, b)| ledger.compare_occlusion(ray, [a, b]));
        }
        self.asked += rays.len() as u64;
    }
}

/// Runs something and adds the time that it takes.
fn timed<T>(total: &mut Duration, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let result = work();
    *total += start.elapsed();
    result
}

/// Rays that one task answers at least.
const RAYS_PER_TASK: usize = 256;

fn closest<Q: RayQuery>(query: &Q, rays: &[Ray]) -> Vec<Option<Hit>> {
    rays.par_iter().with_min_len(RAYS_PER_TASK).map(|ray| query.intersect(ray)).collect()
}

fn occlusion<Q: RayQuery>(query: &Q, rays: &[Ray]) -> Vec<bool> {
    rays.par_iter().with_min_len(RAYS_PER_TASK).map(|ray| query.occluded(ray)).collect()
}

fn key(ray: &Ray) -> [u32; 6] {
    let (o, d) = (ray.o, ray.d);
    [o.x, o.y, o.z, d.x, d.y, d.z].map(f32::to_bits)
}

fn difference(a: &Image, b: &Image) -> Difference {
    let (a, b) = (Picture::of(a), Picture::of(b));
    let bits = |p: &Vec3| p.to_array().map(f32::to_bits);
    Difference {
        errors: compare(&a, &b).ok(),
        flip_ldr: flip::ldr(&a, &b),
        flip_hdr: flip::hdr(&a, &b),
        pixels: a.pixels.iter().zip(&b.pixels).filter(|(a, b)| bits(a) != bits(b)).count(),
    }
}

impl Report {
    /// Whether no fault was found, nor may have been overlooked.
    pub fn is_clean(&self) -> bool {
        self.findings.iter().all(Findings::is_clean)
    }

    /// All faults.
    pub fn faults(&self) -> impl Iterator<Item = &Judged> {
        self.findings.iter().flat_map(|findings| &findings.faults)
    }

    /// Rays of a kind that were compared.
    pub fn rays(&self, kind: usize) -> u64 {
        self.findings[kind].closest + self.findings[kind].occlusion
    }

    /// Rays of a kind that a backend answered in a second, on all threads.
    pub fn rays_per_second(&self, side: usize, kind: usize) -> f64 {
        self.rays(kind) as f64 / self.sides[side].answering[kind].as_secs_f64().max(1e-9)
    }

    /// What each backend costs, a header first.
    pub fn costs(&self) -> Vec<Vec<String>> {
        let [a, b] = &self.sides;
        let mut rows = vec![vec![String::new(), a.name.clone(), b.name.clone(), "ratio".to_owned()]];
        let mut row = |what: &str, unit: &str, [a, b]: [f64; 2]| {
            let ratio = if a > 0.0 { format!("{:.2}", b / a) } else { "-".to_owned() };
            rows.push(vec![format!("{what}, {unit}"), format!("{a:.3}"), format!("{b:.3}"), ratio]);
        };
        let of = |f: &dyn Fn(&Side) -> f64| [f(a), f(b)];
        row("build", "s", of(&|side| side.build.as_secs_f64()));
        row("bytes per primitive", "B", of(&|side| side.bytes as f64 / self.primitives.max(1) as f64));
        for (kind, name) in KINDS.iter().enumerate() {
            row(&format!("{name} rays"), "M/s", [0, 1].map(|side| self.rays_per_second(side, kind) * 1e-6));
        }
        row(&format!("{} passes", self.passes), "s", of(&|side| side.rendering.as_secs_f64()));
        rows
    }

    /// How far the answers agree, a header first.
    pub fn agreement(&self) -> Vec<Vec<String>> {
        let header = [
            "rays",
            "compared",
            "same hit: 0",
            "1",
            "2..3",
            "4..7",
            "8..16 ulp",
            "ties",
            "faults",
            "not judged",
        ];
        let mut rows = vec![header.map(str::to_owned).to_vec()];
        for (kind, findings) in self.findings.iter().enumerate() {
            let mut row = vec![KINDS[kind].to_owned(), self.rays(kind).to_string()];
            // Occlusion queries have no hits to be the same.
            let same = |n: u64| if findings.closest > 0 { n.to_string() } else { "-".to_owned() };
            row.extend(findings.same.map(same));
            row.extend(
                [findings.ties, findings.faults.len() as u64, findings.not_judged].map(|n| n.to_string()),
            );
            rows.push(row);
        }
        rows
    }

    /// How far the images are apart, in a line.
    pub fn difference(&self) -> String {
        let Difference { errors, flip_ldr, flip_hdr, pixels } = &self.difference;
        let errors = errors.map_or_else(
            || "no finite pixel".to_owned(),
            |e| format!("RMSE {:.3e}, relMSE {:.3e}", e.rmse(), e.rel_mse),
        );
        let all = self.sides[0].image.crop.size.element_product();
        format!("images: {pixels} of {all} pixels differ; {errors}, FLIP {flip_ldr:.5} (HDR {flip_hdr:.5})")
    }

    /// The faults, each on two lines: what is wrong, and the query as [`parse_query`](crate::query::crosscheck::parse_query) reads it.
    pub fn fault_list(&self) -> String {
        let names = self.sides.each_ref().map(|side| side.name.as_str());
        self.faults().fold(String::new(), |mut text, judged| {
            // Writing to a String cannot fail.
            let _ = writeln!(text, "# {}\n{}", judged.blame(names), judged.dispute);
            text
        })
    }

    /// The report as one HTML file, with images.
    ///
    /// # Errors
    /// If PNG has no image of that size.
    pub fn html(&self, title: &str) -> io::Result<String> {
        let mut page = Page::new(title);
        page.table(&self.costs());
        page.heading("Agreement");
        page.table(&self.agreement());
        page.paragraph(
            "Ties are answers that differ and are both right to f32: edges, silhouettes, ends of intervals. Faults are decided by brute force in f64.",
        );
        if self.faults().next().is_some() {
            page.preformatted(&self.fault_list());
        }
        page.heading("Images");
        page.paragraph(&self.difference());
        for side in &self.sides {
            page.image(&side.name, &side.image)?;
        }
        let [a, b] = self.sides.each_ref().map(|side| Picture::of(&side.image));
        if let Ok(errors) = relative_squared_errors(&a, &b) {
            let caption = format!("relative squared difference: {LEGEND}");
            page.image(&caption, &heat_map(a.size, &errors))?;
        }
        Ok(page.finish())
    }
}
