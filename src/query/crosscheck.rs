//! Two backends asked at once: [`Crosscheck`] answers as the first and compares with the second, query by query.
//!
//! Two answers can differ and both be right, since both backends compute in f32: at an edge either triangle may be named, at a silhouette the
//! surface may be met or not. [`Ledger`] takes such ties for what they are: at once where the two hits can be seen to be
//! the same place, and else when the disputes that it kept are judged by [`Opinion`], the brute force in f64. What is left are faults, each with the
//! ray that caused it.

use std::fmt;
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};

use rayon::prelude::*;

use super::reference::{Fault, Opinion};
use super::{Hit, Ray, RayQuery, hexfloat};
use crate::scene::{Aabb, Shape};

/// Distances of a primitive that both backends hit may differ by this many ulp without being looked at.
pub const TIE_ULPS: u32 = 16;

/// What two backends answered to a query.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Answers {
    /// The nearest hit.
    Closest([Option<Hit>; 2]),
    /// Whether anything is in the way.
    Occlusion([bool; 2]),
}

/// A query whose answers differ by more than can be settled on the spot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dispute {
    /// The ray.
    pub ray: Ray,
    /// What was answered.
    pub answers: Answers,
}

impl Dispute {
    /// What is wrong with each of the answers, by brute force over all primitives. Nothing with either: a tie.
    pub fn judge(&self, shapes: &[Shape]) -> [Option<Fault>; 2] {
        let opinion = Opinion::new(shapes, &self.ray);
        match &self.answers {
            Answers::Closest(hits) => hits.each_ref().map(|hit| opinion.judge_closest(hit.as_ref())),
            Answers::Occlusion(occluded) => occluded.map(|occluded| opinion.judge_occlusion(occluded)),
        }
    }

    /// Something to sort by, so that lists do not depend on threads.
    fn key(&self) -> [u32; 8] {
        let Ray { o, d, t_min, t_max } = self.ray;
        [o.x, o.y, o.z, d.x, d.y, d.z, t_min, t_max].map(f32::to_bits)
    }
}

/// In the form that [`parse_query`] reads: which query, then the ray in hexadecimal floats.
impl fmt::Display for Dispute {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let query = match self.answers {
            Answers::Closest(_) => "closest",
            Answers::Occlusion(_) => "occluded",
        };
        f.write_str(query)?;
        let Ray { o, d, t_min, t_max } = self.ray;
        for x in [o.x, o.y, o.z, d.x, d.y, d.z, t_min, t_max] {
            write!(f, " {}", hexfloat::format(x))?;
        }
        Ok(())
    }
}

/// Reads `closest` or `occluded` and the eight floats of a ray: origin, direction, least and greatest distance. Returns whether it is an occlusion query.
///
/// # Errors
/// What was expected instead.
pub fn parse_query(line: &str) -> Result<(bool, Ray), String> {
    let mut words = line.split_whitespace();
    let is_occlusion = match words.next() {
        Some("closest") => false,
        Some("occluded") => true,
        other => {
            return Err(format!("expected `closest` or `occluded`, found `{}`", other.unwrap_or_default()));
        }
    };
    let numbers =
        words.by_ref().take(8).map(|word| hexfloat::parse(word).ok_or(word)).collect::<Result<Vec<_>, _>>();
    let numbers = numbers.map_err(|word| format!("expected a number, found `{word}`"))?;
    let (&[ox, oy, oz, dx, dy, dz, t_min, t_max], None) = (&numbers[..], words.next()) else {
        return Err("expected eight numbers: origin, direction, least and greatest distance".to_owned());
    };
    Ok((is_occlusion, Ray { o: [ox, oy, oz].into(), d: [dx, dy, dz].into(), t_min, t_max }))
}

/// The disputes that are kept for judgement; each costs a look at every primitive.
const KEPT: usize = 1024;

/// What came of comparing answers: counts, and the disputes. Many threads write to it without waiting for each other.
pub struct Ledger {
    closest: AtomicU64,
    occlusion: AtomicU64,
    /// The same primitive, at distances 0, 1, 2 to 3, 4 to 7 and 8 to [`TIE_ULPS`] ulp apart.
    same: [AtomicU64; 5],
    ties: AtomicU64,
    disputes: AtomicU64,
    kept: Box<[OnceLock<Dispute>]>,
}

impl Default for Ledger {
    fn default() -> Self {
        Self {
            closest: AtomicU64::default(),
            occlusion: AtomicU64::default(),
            same: Default::default(),
            ties: AtomicU64::default(),
            disputes: AtomicU64::default(),
            kept: (0..KEPT).map(|_| OnceLock::new()).collect(),
        }
    }
}

impl Ledger {
    /// Compares two answers to a closest-hit query.
    pub fn compare_closest(&self, shapes: &[Shape], ray: &Ray, hits: [Option<Hit>; 2]) {
        self.closest.fetch_add(1, Relaxed);
        if let [Some(a), Some(b)] = hits {
            if (a.shape, a.primitive) == (b.shape, b.primitive) {
                let ulps = ulps_between(a.t, b.t);
                if ulps <= TIE_ULPS {
                    self.same[(u32::BITS - ulps.leading_zeros()).min(4) as usize].fetch_add(1, Relaxed);
                    return;
                }
            }
            if is_tie(shapes, ray, &a, &b) {
                self.ties.fetch_add(1, Relaxed);
                return;
            }
        } else if hits == [None, None] {
            return;
        }
        self.note(Dispute { ray: *ray, answers: Answers::Closest(hits) });
    }

    /// Compares two answers to an occlusion query.
    pub fn compare_occlusion(&self, ray: &Ray, occluded: [bool; 2]) {
        self.occlusion.fetch_add(1, Relaxed);
        if occluded[0] != occluded[1] {
            self.note(Dispute { ray: *ray, answers: Answers::Occlusion(occluded) });
        }
    }

    #[cold]
    fn note(&self, dispute: Dispute) {
        let number = self.disputes.fetch_add(1, Relaxed);
        if let Some(slot) = self.kept.get(number as usize) {
            // Each number is given once.
            let _ = slot.set(dispute);
        }
    }

    /// Judges what was kept, on all threads.
    pub fn findings(&self, shapes: &[Shape]) -> Findings {
        let kept: Vec<Dispute> = self.kept.iter().filter_map(|slot| slot.get().copied()).collect();
        let mut judged: Vec<Judged> =
            kept.par_iter().map(|&dispute| Judged { dispute, faults: dispute.judge(shapes) }).collect();
        judged.sort_by_key(|j| j.dispute.key());
        let (faults, ties): (Vec<_>, Vec<_>) = judged.into_iter().partition(|j| j.faults != [None, None]);
        let disputes = self.disputes.load(Relaxed);
        Findings {
            closest: self.closest.load(Relaxed),
            occlusion: self.occlusion.load(Relaxed),
            same: self.same.each_ref().map(|count| count.load(Relaxed)),
            ties: self.ties.load(Relaxed) + ties.len() as u64,
            faults,
            not_judged: disputes - kept.len() as u64,
        }
    }
}

/// A dispute with what is wrong with each answer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Judged {
    /// The query.
    pub dispute: Dispute,
    /// What is wrong with the first and the second answer.
    pub faults: [Option<Fault>; 2],
}

impl Judged {
    /// Who is wrong and how, by the names of the backends.
    pub fn blame(&self, names: [&str; 2]) -> String {
        let about = |(name, fault): (&str, Option<Fault>)| fault.map(|fault| format!("{name} {fault}"));
        let parts: Vec<String> = names.into_iter().zip(self.faults).filter_map(about).collect();
        if parts.is_empty() { "a tie".to_owned() } else { parts.join("; ") }
    }
}

/// What came of comparing two backends.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Findings {
    /// Closest-hit queries compared.
    pub closest: u64,
    /// Occlusion queries compared.
    pub occlusion: u64,
    /// Hits on the same primitive at distances 0, 1, 2 to 3, 4 to 7 and 8 to [`TIE_ULPS`] ulp apart.
    pub same: [u64; 5],
    /// Answers that differ, but are both right to f32.
    pub ties: u64,
    /// Answers of which one or both are wrong, in an order that does not depend on threads.
    pub faults: Vec<Judged>,
    /// Disputes beyond the first 1024 of a ledger, which are not judged: there may be faults among them.
    pub not_judged: u64,
}

impl Findings {
    /// Whether no fault was found, nor may have been overlooked.
    pub fn is_clean(&self) -> bool {
        self.faults.is_empty() && self.not_judged == 0
    }

    /// Adds those of other queries.
    pub fn add(&mut self, other: Self) {
        self.closest += other.closest;
        self.occlusion += other.occlusion;
        for (own, other) in self.same.iter_mut().zip(other.same) {
            *own += other;
        }
        self.ties += other.ties;
        self.faults.extend(other.faults);
        self.not_judged += other.not_judged;
    }
}

/// How many floats lie between two of one sign, the second included.
fn ulps_between(a: f32, b: f32) -> u32 {
    a.to_bits().abs_diff(b.to_bits())
}

/// Whether two hits are on primitives that the ray does meet, at distances that f32 cannot tell apart.
fn is_tie(shapes: &[Shape], ray: &Ray, a: &Hit, b: &Hit) -> bool {
    let opinion = Opinion::of_primitives(shapes, ray, &[(a.shape, a.primitive), (b.shape, b.primitive)]);
    let (Some(own_a), Some(own_b)) = (opinion.named(a), opinion.named(b)) else { return false };
    let are_right = opinion.judge_hit(a).is_none() && opinion.judge_hit(b).is_none();
    are_right && (own_a.t - own_b.t).abs() <= own_a.tolerance() + own_b.tolerance()
}

/// Answers as the first backend does, and compares with the second.
pub struct Crosscheck<'s, A, B> {
    shapes: &'s [Shape],
    first: A,
    second: B,
    ledger: Ledger,
}

impl<'s, A: RayQuery, B: RayQuery> Crosscheck<'s, A, B> {
    /// Two backends, both built over these shapes.
    pub fn new(shapes: &'s [Shape], first: A, second: B) -> Self {
        Self { shapes, first, second, ledger: Ledger::default() }
    }

    /// What came of it so far.
    pub fn findings(&self) -> Findings {
        self.ledger.findings(self.shapes)
    }

    /// Names of the two backends.
    pub fn names(&self) -> [String; 2] {
        [self.first.name(), self.second.name()]
    }
}

impl<A: RayQuery, B: RayQuery> RayQuery for Crosscheck<'_, A, B> {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let answer = self.first.intersect(ray);
        self.ledger.compare_closest(self.shapes, ray, [answer, self.second.intersect(ray)]);
        answer
    }

    fn occluded(&self, ray: &Ray) -> bool {
        let answer = self.first.occluded(ray);
        self.ledger.compare_occlusion(ray, [answer, self.second.occluded(ray)]);
        answer
    }

    fn bounds(&self) -> Aabb {
        self.first.bounds()
    }

    fn memory(&self) -> usize {
        self.first.memory() + self.second.memory()
    }

    fn name(&self) -> String {
        format!("crosscheck of {} and {}", self.first.name(), self.second.name())
    }
}
