//! Phase 1: photons are sent out and stored, and how a pass looks them up is settled.

use super::super::collect::{TooManyStored, collect};
use super::super::light_path::{self, Landing};
use super::super::pass::Pass;
use super::kernel::Filter;
use super::map::PhotonMap;
use super::photon::Photon;
use super::{Lookup, Mode, PhotonMapper};
use crate::query::RayQuery;
use crate::scene::Rgb;

/// Photon paths that one task traces.
const PATHS_PER_TASK: u32 = 4096;

/// Radius of the disc by default, in radii of the sphere around scene and camera.
const DEFAULT_RADIUS: f32 = 1.0 / 200.0;

/// Largest disc of the nearest photons by default, in those radii. Without a bound, a place that has fewer than `k` photons on its side, such as the back of a lamp,
/// would look at all the photons there are: a pass with final gathering took minutes instead of seconds.
const LARGEST_OF_NEAREST: f32 = 25.0;

/// Photons that a pass may store, 2 GiB of them; their number follows from the scene only when they are traced.
const MAX_STORED: usize = 1 << 26;

/// The photons of a pass and how they are looked up.
#[derive(Debug)]
pub struct Photons {
    /// The photons.
    pub map: PhotonMap,
    /// Rays that were traced to store them.
    pub rays: u64,
    pub(super) disc: Disc,
    pub(super) filter: Filter,
}

/// The photons that an estimate takes in the present pass.
#[derive(Debug, Clone, Copy)]
pub(super) enum Disc {
    /// The nearest `k` that are within the root of `radius_squared`.
    Nearest { k: usize, radius_squared: f32 },
    /// All within the root of `radius_squared`.
    Radius { radius_squared: f32 },
}

impl Photons {
    /// No photons.
    pub(in crate::integrators) fn none() -> Self {
        let disc = Disc::Radius { radius_squared: 0.0 };
        Self { map: PhotonMap::new(Vec::new()), rays: 0, disc, filter: Filter::Constant }
    }
}

impl PhotonMapper {
    /// The photons of a pass: a function of the pass alone, however many threads trace them.
    pub(in crate::integrators) fn photons<Q: RayQuery>(
        &self,
        pass: &Pass<Q>,
    ) -> Result<Photons, TooManyStored> {
        let (photons, rays) = self.trace(pass)?;
        Ok(self.look_up(pass, PhotonMap::new(photons), rays))
    }

    /// Sends out all photons of a pass, on all threads. Returns those that were stored, in the order of their slots, and the number of rays.
    ///
    /// # Errors
    /// If there are too many.
    pub fn trace<Q: RayQuery>(&self, pass: &Pass<Q>) -> Result<(Vec<Photon>, u64), TooManyStored> {
        let bytes = size_of::<Photon>();
        let error = TooManyStored { what: "photons", parameter: "photons", limit: MAX_STORED, bytes };
        let trace = |slot, (stored, rays): &mut (Vec<_>, u64)| *rays += self.trace_photon(pass, slot, stored);
        let tasks = collect(self.photons, PATHS_PER_TASK, &error, |(stored, _)| stored.len(), trace)?;
        let rays = tasks.iter().map(|(_, rays)| rays).sum();
        let mut photons = Vec::with_capacity(tasks.iter().map(|(stored, _)| stored.len()).sum());
        for (stored, _) in tasks {
            photons.extend(stored);
        }
        Ok((photons, rays))
    }

    /// A map as the pass looks it up.
    pub(in crate::integrators) fn look_up<Q>(&self, pass: &Pass<Q>, map: PhotonMap, rays: u64) -> Photons {
        let scale = DEFAULT_RADIUS * pass.world.bounds.radius;
        let squared = |radius: f32, shrunk: f64| {
            let radius_squared = (f64::from(radius).powi(2) * shrunk) as f32;
            // Of scenes beyond all measure too, and after any number of passes, it is a number that can be divided by.
            radius_squared.clamp(f32::MIN_POSITIVE, f32::MAX)
        };
        let disc = |radius, shrunk| Disc::Radius { radius_squared: squared(radius, shrunk) };
        let disc = match self.lookup {
            Lookup::Nearest { k, radius } => {
                let radius = radius.unwrap_or(LARGEST_OF_NEAREST * scale);
                Disc::Nearest { k: k as usize, radius_squared: squared(radius, 1.0) }
            }
            Lookup::Radius(radius) => disc(radius.unwrap_or(scale), 1.0),
            Lookup::Shrinking { radius, alpha } => {
                disc(radius.unwrap_or(scale), shrink(f64::from(alpha), pass.index))
            }
        };
        Photons { map, rays, disc, filter: self.filter }
    }

    /// Sends out the photon of a slot and stores it where it goes. Returns the number of rays traced.
    fn trace_photon<Q: RayQuery>(&self, pass: &Pass<Q>, slot: u32, stored: &mut Vec<Photon>) -> u64 {
        let Some((start, sampler)) = light_path::start(pass, u64::from(slot), u64::from(self.photons)) else {
            return 0;
        };
        let power = start.power() / self.photons as f32;
        // The last segment of a path is the eye's.
        let last = self.length.limit().saturating_sub(1);
        let goes_on = |is_specular| self.mode == Mode::Full || is_specular;
        light_path::deposit(pass, &start, &sampler, last, goes_on, |landing| {
            let Landing { vertex, beta, depth, is_specular } = *landing;
            let power = power * beta * vertex.incidence_correction();
            if self.stores(depth, is_specular) && power != Rgb::ZERO {
                let point = &vertex.point;
                stored.push(Photon::new(point.p, power, vertex.wo, point.ng, depth, is_specular));
            }
        })
    }

    /// Whether photons of a kind are looked up at all.
    fn stores(&self, depth: u32, is_specular: bool) -> bool {
        match self.mode {
            Mode::Caustic => is_specular && depth > 1,
            Mode::Full => depth > 1 || self.stores_direct(),
        }
    }
}

/// The squared radius of pass `index` over that of pass 0: the product of `(j + alpha) / (j + 1)` for j from 1 to `index`, which is
/// `gamma(i + alpha) / (gamma(1 + alpha) gamma(i + 1))` with `i = index + 1`.
fn shrink(alpha: f64, index: u32) -> f64 {
    /// Factors that are multiplied one by one; Stirling's series is exact to 1e-12 beyond.
    const EXACT: u32 = 256;
    let factor = |j: u32| (f64::from(j) + alpha) / (f64::from(j) + 1.0);
    let product: f64 = (1..=index.min(EXACT)).map(factor).product();
    if index <= EXACT {
        return product;
    }
    let tail = |x: f64| 1.0 / (12.0 * x) - 1.0 / (360.0 * x.powi(3));
    // ln(gamma(a) / gamma(b)), ordered so that large terms do not cancel.
    let ln_ratio = |i: u32| {
        let (a, b) = (f64::from(i) + 1.0 + alpha, f64::from(i) + 2.0);
        (b - 0.5) * ((a - b) / b).ln_1p() + (a - b) * (a.ln() - 1.0) + tail(a) - tail(b)
    };
    product * (ln_ratio(index) - ln_ratio(EXACT)).exp()
}

#[cfg(test)]
mod tests {
    use super::shrink;

    /// The recursion of Knaus and Zwicker, eq. 11, done step by step.
    #[test]
    fn radii_follow_the_recursion() {
        for alpha in [0.1, 0.7, 0.99] {
            let mut expected = 1.0;
            for i in 1..100_000_u32 {
                let relative = shrink(alpha, i - 1) / expected;
                assert!((relative - 1.0_f64).abs() < 1e-10, "alpha {alpha}, pass {i}: {relative}");
                expected *= (f64::from(i) + alpha) / (f64::from(i) + 1.0);
            }
        }
        assert!(shrink(0.5, u32::MAX) > 0.0);
    }
}
