//! The photon map (`photonmapper`; Jensen 1996, "Global illumination using photon maps") and its progressive form (`sppm`; Hachisuka and
//! Jensen 2009, in the memoryless formulation of Knaus and Zwicker 2011, "Progressive photon mapping: a probabilistic approach").
//!
//! Phase 1 sends photons from the lights and stores them wherever they meet a surface that is not specular. Phase 2 follows paths from
//! the camera through specular surfaces to the first that is not, and estimates the radiance there from the density of photons:
//! `L = sum f_r power w(d / r) / r^2` over a disc of radius r, where the filter w has integral 1. So paths of class LS+DS+E, which no
//! strategy of the bidirectional integrator can make for a small light, are simply found.
//!
//! Each pass has photons of its own, so that many passes average out the noise. What stays is *bias*: light is blurred over the disc, and lost at edges, where
//! the disc reaches over surfaces on which no photon can land. `sppm` lets the disc shrink from pass to pass so that
//! both noise and bias vanish.
//!
//! ## Power
//!
//! Lights are chosen by luminous power and directions by emission, so that photons of one light start equal. At each surface a photon lives on with
//! the probability that its brightest channel is reflected, and its power is divided by it: that channel then stays as it was, and the others
//! take the colour of the surface. So density alone carries brightness. (After 32 segments 5 % at least die at each surface, that
//! walks end where nothing absorbs; survivors are that much brighter.) Power is divided by the number of photons *emitted*: were it the number
//! stored, as the lecture's slide has it, a scene would get brighter by absorbing.
//!
//! ## Photons as they are
//!
//! `show=photons` draws each photon as a dot where the camera sees it: as if the scene were a white diffuse one, seen without any blur. The mean of many passes is
//! irradiance over pi, of the light that the map holds. Photons are not seen in mirrors or through glass, which they do not lie on.
//!
//! ## Caustics only
//!
//! `mode=caustic` stores photons of class LS+D only. At each vertex that is not specular the backward path tracer adds what they make, and
//! leaves out the light that it finds behind specular surfaces by chance itself: a path whose last scattering events before the
//! light are specular, and one before those is not. Each path is so counted once.

mod gather;
mod kernel;
mod map;
mod photon;
mod show;
pub mod store;
mod trace;

pub use kernel::Filter;
pub use map::{NearestHeap, PhotonMap, Site};
pub use photon::Photon;
pub use trace::Photons;

use super::IntegratorError;
use super::parameters::{PathLength, bad, choice, number, unknown};

/// Which photons an estimate takes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lookup {
    /// The nearest.
    Nearest {
        /// How many.
        k: u32,
        /// Those farther away than this do not count, in world units. `None`: 1/8 of the radius of a sphere around scene and camera.
        radius: Option<f32>,
    },
    /// All nearer than a radius in world units, `None`: 1/200 of the radius of a sphere around scene and camera.
    Radius(Option<f32>),
    /// All nearer than a radius that shrinks from pass to pass: `r_(i+1)^2 = r_i^2 (i + alpha) / (i + 1)`, pass 0 having `i = 1`.
    Shrinking {
        /// Radius of the first pass, as of [`Lookup::Radius`].
        radius: Option<f32>,
        /// Between 0 and 1: small values lessen bias faster and noise slower.
        alpha: f32,
    },
}

/// Where direct light comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Direct {
    /// From the map, as all light.
    #[default]
    Photons,
    /// By sampling lights (next-event estimation).
    Nee,
}

/// What the map is used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Mode {
    /// For all light.
    #[default]
    Full,
    /// For caustics, LS+D; all else is the backward path tracer's.
    Caustic,
}

/// What the image shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Show {
    /// Radiance.
    #[default]
    Radiance,
    /// The photons themselves, each a dot.
    Photons,
}

/// Parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PhotonMapper {
    /// How long paths get: segments from the light and from the camera together. Russian roulette after `rr_depth` is that of eye paths;
    /// photons have their own.
    pub length: PathLength,
    /// Photons emitted in each pass.
    pub photons: u32,
    /// Which photons an estimate takes.
    pub lookup: Lookup,
    /// How they count.
    pub filter: Filter,
    /// Where direct light comes from; in caustic mode from the path tracer.
    pub direct: Direct,
    /// What the map is used for.
    pub mode: Mode,
    /// Rays that a first surface sends out to look the map up elsewhere; 0 looks it up where it is.
    pub final_gather: u32,
    /// What the image shows.
    pub show: Show,
}

/// Limits on what a parameter may ask for.
const MAX_PHOTONS: u32 = 1 << 28;
const MAX_NEAREST: u32 = 1 << 20;
const MAX_GATHER: u32 = 1 << 16;

/// How fast the disc shrinks unless said otherwise.
const DEFAULT_ALPHA: f32 = 0.7;

impl PhotonMapper {
    /// `sppm:mode=caustic` with its defaults: caustics by photons, all else by paths.
    ///
    /// # Errors
    /// If paths may be longer than photons can tell.
    pub fn caustics(length: PathLength) -> Result<Self, IntegratorError> {
        let this = Self {
            length,
            photons: Self::DEFAULT_PHOTONS,
            lookup: Lookup::Shrinking { radius: None, alpha: DEFAULT_ALPHA },
            filter: Filter::default(),
            direct: Direct::default(),
            mode: Mode::Caustic,
            final_gather: 0,
            show: Show::default(),
        };
        this.check()?;
        Ok(this)
    }

    /// Photons in each pass unless said otherwise.
    pub const DEFAULT_PHOTONS: u32 = 200_000;

    /// Reads parameters of `photonmapper`, or of `sppm` if it is to be progressive, from text.
    ///
    /// # Errors
    /// If a parameter is not known, its value is out of range, or it does not go with the others.
    pub fn from_parameters(
        is_progressive: bool,
        parameters: &[(String, String)],
    ) -> Result<Self, IntegratorError> {
        let mut this =
            Self { lookup: Lookup::Radius(None), mode: Mode::Full, ..Self::caustics(PathLength::default())? };
        let (mut alpha, mut radius) = (DEFAULT_ALPHA, None);
        let (mut by_radius, mut k) = (is_progressive, None);
        let name = if is_progressive { "sppm" } else { "photonmapper" };
        for (parameter, value) in parameters {
            match parameter.as_str() {
                "photons" => {
                    let range = 1..=MAX_PHOTONS;
                    this.photons = number("photons", value, |n| range.contains(n), "from 1 to 2^28")?;
                }
                "filter" => this.filter = Filter::parse(value)?,
                "direct" => {
                    let choices = [("photons", Direct::Photons), ("nee", Direct::Nee)];
                    this.direct = choice("direct", value, &choices)?;
                }
                "mode" => {
                    this.mode = choice("mode", value, &[("full", Mode::Full), ("caustic", Mode::Caustic)])?;
                }
                "radius" => {
                    // Squares and their inverses are in range then.
                    let expected = "a positive, finite length in world units, from 1e-18 to 1e18";
                    radius = Some(number("radius", value, |r| (1e-18..=1e18).contains(r), expected)?);
                }
                "show" => {
                    let choices = [("radiance", Show::Radiance), ("photons", Show::Photons)];
                    this.show = choice("show", value, &choices)?;
                }
                "final_gather" => {
                    let expected = "from 0 to 65536";
                    this.final_gather = number("final_gather", value, |&n| n <= MAX_GATHER, expected)?;
                }
                "alpha" if is_progressive => {
                    alpha = number("alpha", value, |&a| a > 0.0 && a < 1.0, "a number between 0 and 1")?;
                }
                "lookup" if !is_progressive => {
                    by_radius = choice("lookup", value, &[("knn", false), ("radius", true)])?;
                }
                "k" if !is_progressive => {
                    let range = 1..=MAX_NEAREST;
                    k = Some(number("k", value, |n| range.contains(n), "from 1 to 2^20")?);
                }
                _ if this.length.read(parameter, value)? => {}
                _ if is_progressive => {
                    let known = "max_depth, rr_depth, photons, radius, alpha, filter, direct, mode, final_gather, show";
                    return Err(unknown(name, parameter, known));
                }
                _ => {
                    let known = "max_depth, rr_depth, photons, lookup, k, radius, filter, direct, mode, final_gather, show";
                    return Err(unknown(name, parameter, known));
                }
            }
        }
        this.lookup = match (is_progressive, by_radius, k) {
            (true, ..) => Lookup::Shrinking { radius, alpha },
            (false, true, None) => Lookup::Radius(radius),
            (false, true, Some(k)) => {
                return Err(bad("k", &k.to_string(), "left out with lookup=radius"));
            }
            (false, false, k) => Lookup::Nearest { k: k.unwrap_or(100), radius },
        };
        this.check()?;
        Ok(this)
    }

    /// Whether the parameters go together.
    fn check(&self) -> Result<(), IntegratorError> {
        if let Some(depth) = self.length.max_depth.filter(|&depth| depth > photon::MAX_DEPTH) {
            return Err(bad("max_depth", &depth.to_string(), "at most 127, or -1, with photons"));
        }
        if self.mode == Mode::Caustic && (self.direct == Direct::Nee || self.final_gather > 0) {
            let expected =
                "`full` with direct=nee or final_gather: direct and indirect light are the path tracer's";
            return Err(bad("mode", "caustic", expected));
        }
        Ok(())
    }

    /// Name and parameters, in the form that the command line takes.
    pub fn describe(&self) -> String {
        let (name, lookup) = match self.lookup {
            Lookup::Nearest { k, radius } => ("photonmapper", format!("lookup=knn,k={k}{}", show(radius))),
            Lookup::Radius(radius) => ("photonmapper", format!("lookup=radius{}", show(radius))),
            Lookup::Shrinking { radius, alpha } => ("sppm", format!("alpha={alpha}{}", show(radius))),
        };
        let kind = match (self.mode, self.direct) {
            (Mode::Caustic, _) => "mode=caustic".to_owned(),
            (Mode::Full, Direct::Photons) => format!("direct=photons,final_gather={}", self.final_gather),
            (Mode::Full, Direct::Nee) => format!("direct=nee,final_gather={}", self.final_gather),
        };
        let (length, photons, filter) = (self.length.describe(), self.photons, self.filter.name());
        let show = if self.show == Show::Photons { ",show=photons" } else { "" };
        format!("{name}:{length},photons={photons},{lookup},filter={filter},{kind}{show}")
    }

    /// All parameters that photons depend on, before they are looked up. `rr_depth` is that of eye paths.
    pub fn describe_photons(&self) -> String {
        let max_depth = self.length.max_depth.map_or(-1, i64::from);
        let kinds = match self.mode {
            Mode::Caustic => "caustic",
            Mode::Full if self.stores_direct() => "all",
            Mode::Full => "indirect",
        };
        format!("max_depth={max_depth},photons={},stored={kinds}", self.photons)
    }

    /// Whether photons that come straight from a light are looked up.
    fn stores_direct(&self) -> bool {
        self.mode == Mode::Full && (self.direct == Direct::Photons || self.final_gather > 0)
    }
}

fn show(radius: Option<f32>) -> String {
    radius.map_or_else(String::new, |radius| format!(",radius={radius}"))
}
