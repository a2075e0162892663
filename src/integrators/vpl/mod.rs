//! Virtual point lights (`vpl`; Keller 1997, "Instant radiosity").
//!
//! Phase 1 sends paths from the lights, which leave a virtual point light wherever they land on a surface that is rough enough, after any number of bounces.
//! Phase 2 follows paths from the camera to the first such surface, and adds what all virtual lights send there:
//! `L = sum Phi f_y G V f_x`. Direct light comes from the lights themselves, sampled and hit as by the backward path tracer; with `direct=vpl` the
//! starts of the light paths are virtual lights too.
//!
//! All pixels of a pass share its lights, so that a pass has no noise but *splotches*: bright spots around single lights, in corners most of all. Each
//! pass has lights of its own, drawn from its index, and many passes converge.
//!
//! ## Clamping, and what it takes
//!
//! The geometry term `G = cos_x cos_y / d^2` is unbounded: where surfaces meet, the sum has infinite variance. `clamp` bounds it, and what is beyond
//! is lost: corners darken. With `compensate=true` exactly that is brought back (Kollig and Keller 2004, "Illumination in the presence of weak
//! singularities"): the vertex x scatters a ray, and what arrives from its end y counts for the share `max(0, 1 - clamp / G)` that was
//! taken from the light between x and y; at y the same is done again. The result is unbiased and has no such spikes.
//! `clamp` is in units of 1 over the squared radius of a sphere around scene and camera: 100 is the term of two patches that face each other a tenth of the radius apart.
//!
//! ## Did we account for all light transport?
//!
//! No. In Heckbert's notation, with D for any event that is not of a specular lobe, and E the eye, the sum and direct light find
//! `LE | LS+E | LDS*E | L(S|D)*DDS*E`. What is missed is **`L(S|D)*SDS*E`**: all light that comes to the first
//! surface that is not specular *from a specular one*. Such are caustics (LS+DE), as the light path would have to leave its light on
//! the surface that it is to light, and also rooms seen in a diffuse reflection of a mirror (LDSDE). Caustics *on other surfaces* do light the first
//! surface (LSDDE), and what the camera sees in mirrors and through glass is there.
//!
//! Where a lobe is narrow, few virtual lights would matter much, as rare splotches that only very many passes even out: at normal incidence a mirror lobe of roughness
//! alpha peaks at `1 / (4 alpha^2)` times what a white diffuse surface scatters. So a surface whose lobes are all narrower than that of `roughness` (0.2 by default: 6 times) counts as
//! specular, S, in both phases. It is lit by the lights themselves, and paths go on from it. Refraction narrows a lobe by `|eta - 1| / 2` beside reflection, so that rough glass
//! seldom is rough enough. A narrow lobe *beside* a wide one (a polished coat on a diffuse base) is summed with it.
//!
//! `compensate=true` finds the missing class too. A specular y has an infinite G: nothing of its light is in the sum, so
//! its share is 1, and the path goes on through it. What remains missing is then what the backward path tracer misses: delta lights behind delta surfaces.
//!
//! ## Flux and importance
//!
//! A virtual light is made of the *flux* that arrives, divided by the number of paths *emitted*, and by scattering of importance: without the scaling
//! of radiance in glass and with Veach's correction for shading normals. What looks at it gathers radiance. See [`transport`](crate::transport).

mod block;
mod deposit;
mod gather;
mod shadow_map;
mod tree;

pub use deposit::VplSet;
pub use tree::{LightTree, Receiver, TreeLight};

use super::IntegratorError;
use super::parameters::{PathLength, bad, choice, number, unknown, word};

/// How it is found out whether a virtual light is seen.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Visibility {
    /// Not at all: nothing casts shadows of indirect light.
    None,
    /// By a shadow ray.
    #[default]
    Rays,
    /// By a depth map for each light.
    ShadowMap {
        /// Texels of a map's side, for a hemisphere.
        resolution: u32,
        /// In texels: how far behind what the map shows a surface may be, measured along the surface.
        bias: f32,
    },
}

/// Where direct light comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Direct {
    /// From the lights, sampled and hit.
    #[default]
    Nee,
    /// From the starts of the light paths, the same for all pixels.
    Vpl,
}

/// Parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VirtualLights {
    /// How long paths get: segments from the light and from the camera together, and the one that connects them. Russian roulette after `rr_depth` is that of eye
    /// paths; light paths have their own.
    pub length: PathLength,
    /// Light paths in each pass. Each leaves a light at each of its vertices.
    pub count: u32,
    /// How it is found out whether a light is seen.
    pub visibility: Visibility,
    /// Greatest geometry term that counts in full; see the module's text for its unit. At least 0, may be infinite.
    pub clamp: f32,
    /// Whether what the clamp takes is found otherwise.
    pub compensate: bool,
    /// Where direct light comes from.
    pub direct: Direct,
    /// Surfaces of narrower lobes than those of a metal of this roughness leave no virtual lights and do not look at any: they count as specular. In [0, 1]; 0: only delta
    /// lobes do.
    pub roughness: f32,
    /// Virtual lights that a surface looks at, drawn by importance; `None`: all.
    pub samples: Option<u32>,
}

impl Default for VirtualLights {
    fn default() -> Self {
        Self {
            length: PathLength::default(),
            count: 1000,
            visibility: Visibility::Rays,
            clamp: 100.0,
            compensate: true,
            direct: Direct::Nee,
            roughness: 0.2,
            samples: None,
        }
    }
}

/// Where direct light comes from, by name.
const DIRECT: [(&str, Direct); 2] = [("nee", Direct::Nee), ("vpl", Direct::Vpl)];

/// Limits on what a parameter may ask for.
const MAX_COUNT: u32 = 1 << 24;
const MAX_SAMPLES: u32 = 1 << 20;
const MAX_RESOLUTION: u32 = 4096;

impl VirtualLights {
    /// Reads parameters from text.
    ///
    /// # Errors
    /// If a parameter is not known, its value is out of range, or it does not go with the others.
    pub fn from_parameters(parameters: &[(String, String)]) -> Result<Self, IntegratorError> {
        let mut this = Self::default();
        let (mut visibility, mut resolution, mut bias) = ("rays", None, None);
        for (name, value) in parameters {
            match name.as_str() {
                "count" => {
                    this.count = number("count", value, |n| (1..=MAX_COUNT).contains(n), "from 1 to 2^24")?;
                }
                "roughness" => {
                    this.roughness = number("roughness", value, |r| (0.0..=1.0).contains(r), "from 0 to 1")?;
                }
                "samples" if value == "all" => this.samples = None,
                "samples" => {
                    let (range, expected) = (1..=MAX_SAMPLES, "`all`, or from 1 to 2^20");
                    this.samples = Some(number("samples", value, |n| range.contains(n), expected)?);
                }
                "clamp" => {
                    this.clamp = number("clamp", value, |c| *c >= 0.0, "at least 0, or `inf`")?;
                }
                "compensate" => {
                    this.compensate = choice("compensate", value, &[("true", true), ("false", false)])?;
                }
                "direct" => this.direct = choice("direct", value, &DIRECT)?,
                "visibility" => {
                    let words = ["none", "rays", "shadowmap"];
                    visibility = choice("visibility", value, &words.map(|word| (word, word)))?;
                }
                "resolution" => {
                    let range = 1..=MAX_RESOLUTION;
                    resolution = Some(number("resolution", value, |n| range.contains(n), "from 1 to 4096")?);
                }
                "bias" => {
                    let is_good = |b: &f32| *b >= 0.0 && b.is_finite();
                    bias = Some(number("bias", value, is_good, "a number of texels, at least 0")?);
                }
                _ if this.length.read(name, value)? => {}
                _ => {
                    let known = "max_depth, rr_depth, count, visibility, resolution, bias, clamp, compensate, direct, roughness, samples";
                    return Err(unknown("vpl", name, known));
                }
            }
        }
        this.visibility = match (visibility, resolution, bias) {
            ("shadowmap", resolution, bias) => {
                Visibility::ShadowMap { resolution: resolution.unwrap_or(64), bias: bias.unwrap_or(1.0) }
            }
            (_, Some(resolution), _) => {
                return Err(bad(
                    "resolution",
                    &resolution.to_string(),
                    "left out but for visibility=shadowmap",
                ));
            }
            (_, _, Some(bias)) => {
                return Err(bad("bias", &bias.to_string(), "left out but for visibility=shadowmap"));
            }
            ("none", ..) => Visibility::None,
            _ => Visibility::Rays,
        };
        Ok(this)
    }

    /// Name and parameters, in the form that the command line takes.
    pub fn describe(&self) -> String {
        let visibility = match self.visibility {
            Visibility::None => "none".to_owned(),
            Visibility::Rays => "rays".to_owned(),
            Visibility::ShadowMap { resolution, bias } => {
                format!("shadowmap,resolution={resolution},bias={bias}")
            }
        };
        let direct = word(&DIRECT, &self.direct);
        let samples = self.samples.map_or_else(|| "all".to_owned(), |samples| samples.to_string());
        let Self { length, count, clamp, compensate, roughness, .. } = self;
        format!(
            "vpl:{},count={count},visibility={visibility},clamp={clamp},compensate={compensate},direct={direct},roughness={roughness},samples={samples}",
            length.describe()
        )
    }
}
