//! The arguments of `helmholtz render`, and what of the scene they change.

use std::ops::Range;
use std::path::PathBuf;
use std::time::Duration;

use clap::Args;
use glam::UVec2;

use super::super::common::{Reading, Threads};
use super::super::{CliError, parse};
use crate::film::Aov;
use crate::query::Backend;
use crate::scene::{PixelRect, Scene};
use crate::spec::{Spec, duration, size, spec};

/// Render a scene or a mesh to OpenEXR and PNG
///
/// SCENE is a Mitsuba scene (.xml) or a mesh (.obj, .ply). A mesh without lights gets a neutral sky, one
/// without a camera a view of all of it.
///
/// The image depends on the scene, the integrator, the seed and the passes, and on nothing else: it is the same
/// to the last bit for any number of threads, and whether it was rendered at once, resumed or merged.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  helmholtz render scenes/cornell-box.xml
  helmholtz render room.xml --time 5m -o room.exr
  helmholtz render room.xml --integrator path:max_depth=4 --spp 256
  helmholtz render room.xml --error 0.01 --time 1h
  helmholtz render room.xml --integrator bdpt:max_depth=8 --time 10m
  helmholtz render room.xml --integrator bdpt:max_depth=5 --size 256x256 --strategies pyramid
  helmholtz render room.xml --integrator sppm:photons=500000 --time 10m
  helmholtz render room.xml --integrator photonmapper:mode=caustic,lookup=radius --time 10m
  helmholtz render room.xml --integrator vpl:count=1000,visibility=shadowmap --spp 16
  helmholtz render room.xml --backend obvhs --size 640x360
  helmholtz render room.xml --passes 0..64 --save-state a.state    (on one machine)
  helmholtz render room.xml --passes 64..128 --save-state b.state  (on another)
  helmholtz merge a.state b.state -o room.exr")]
pub(in crate::cli) struct RenderArgs {
    /// Mitsuba scene (.xml) or mesh (.obj, .ply)
    pub(super) scene: PathBuf,
    /// Image to write: NAME.exr (and NAME.png beside it) or NAME.png [default: the scene's name, here]
    #[arg(short, long, value_name = "FILE")]
    pub(super) output: Option<PathBuf>,
    /// Samples per pixel; one pass makes one [default: what the scene says, without limit if only --time is given]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) spp: Option<u32>,
    /// Begin no pass after this time: 30s, 5m, 2h, 500ms
    #[arg(long, value_name = "TIME", value_parser = duration)]
    pub(super) time: Option<Duration>,
    /// Stop as soon as the relMSE of the image, estimated from the spread of eight independent groups of passes, is below this with 95 % confidence; --time
    /// stops it earlier. Bias is not covered
    #[arg(long, value_name = "RELMSE", value_parser = parse::positive,
        conflicts_with_all = ["spp", "passes", "resume", "save_photons", "load_photons", "strategies", "debug_pixel"])]
    pub(super) error: Option<f64>,
    /// Render only these passes: FIRST..END, END not included
    #[arg(long, value_name = "RANGE", value_parser = parse::passes, conflicts_with = "spp")]
    pub(super) passes: Option<Range<u32>>,
    /// Seed of the random numbers: images with different seeds are independent
    #[arg(long, default_value_t = 0)]
    pub(super) seed: u64,
    #[command(flatten)]
    pub(super) threads: Threads,
    /// Film size in pixels instead of the scene's; a crop window of the scene is dropped
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    pub(super) size: Option<UVec2>,
    /// Part of the film to render
    #[arg(long, value_name = "X,Y,WIDTHxHEIGHT", value_parser = parse::crop)]
    pub(super) crop: Option<PixelRect>,
    /// Ray queries by: embree (settings robust=true|false, quality=low|medium|high, compact=true|false),
    /// obvhs (setting quality=low|medium|high) or crosscheck (the default, compared query by query with the other; exit code 4 for a fault)
    #[arg(long, value_name = "NAME:KEY=VALUE,...", value_parser = spec)]
    pub(super) backend: Option<Spec>,
    /// Algorithm instead of the scene's, which is auto where it names none: auto, whichever of the next ones has the least error at equal cost in a short trial (max_depth, rr_depth); path, paths from the camera (max_depth, rr_depth, hide_emitters); ptracer, paths from the lights
    /// (max_depth, rr_depth, connect=nee|hit|both); bdpt, both and their connections (max_depth, rr_depth, exponent=1|2); photonmapper, photons from
    /// the lights gathered around what the camera sees (max_depth, rr_depth, photons, lookup=knn|radius, k, radius, filter=constant|cone|gaussian,
    /// direct=photons|nee, mode=full|caustic, final_gather, show=radiance|photons); sppm, the same with a radius that shrinks from pass to pass (alpha, and no lookup or k); vpl,
    /// virtual point lights left by paths from the lights (max_depth, rr_depth, count, visibility=none|rays|shadowmap, resolution, bias, clamp, compensate=true|false,
    /// direct=nee|vpl, roughness, samples=all|N)
    #[arg(long, value_name = "NAME:KEY=VALUE,...", value_parser = spec)]
    pub(super) integrator: Option<Spec>,
    #[command(flatten)]
    pub(super) reading: Reading,
    /// More layers for the EXR: depth, position, geometric_normal, shading_normal, albedo, uv, shape_id, primitive_id, sample_count, variance
    #[arg(long, value_name = "NAME,...", value_delimiter = ',', value_parser = aov)]
    pub(super) aov: Vec<Aov>,
    /// Go on from a state file; its passes are not rendered again
    #[arg(long, value_name = "FILE")]
    pub(super) resume: Option<PathBuf>,
    /// Save a state file at the end, to be resumed or merged
    #[arg(long, value_name = "FILE")]
    pub(super) save_state: Option<PathBuf>,
    /// Write the photons of all passes that are rendered to a file, 32 bytes each and some more for their tree
    #[arg(long, value_name = "FILE", conflicts_with_all = ["strategies", "debug_pixel"])]
    pub(super) save_photons: Option<PathBuf>,
    /// Take photons from such a file instead of tracing them; radius, lookup, filter, film and backend may be others than those that they were saved with
    #[arg(long, value_name = "FILE", conflicts_with_all = ["save_photons", "strategies", "debug_pixel"])]
    pub(super) load_photons: Option<PathBuf>,
    /// Print the paths of a pixel, vertex by vertex, instead of rendering; --passes says which (pass 0 by default)
    #[arg(long, value_name = "X,Y", value_parser = parse::pixel)]
    pub(super) debug_pixel: Option<UVec2>,
    /// Write what each strategy (s, t) contributes instead of the image: DIR/strategies.exr with layers weighted.sStT and unweighted.sStT, and
    /// the contact sheets weighted.png and unweighted.png, path lengths from the top, s from the left. For paths of at most 10 segments
    #[arg(long, value_name = "DIR", conflicts_with_all = ["resume", "save_state", "debug_pixel", "aov", "output"])]
    pub(super) strategies: Option<PathBuf>,
    /// No progress and no messages but errors
    #[arg(long)]
    pub(super) quiet: bool,
    /// Print statistics as JSON on standard output
    #[arg(long, conflicts_with_all = ["strategies", "debug_pixel"])]
    pub(super) json: bool,
}

fn aov(name: &str) -> Result<Aov, String> {
    let names = || Aov::ALL.map(Aov::name).join(", ");
    Aov::from_name(name).ok_or_else(|| format!("no such AOV; there are: {}", names()))
}

/// Changes the size of the film; a crop window is dropped.
pub(in crate::cli) fn resize(scene: &mut Scene, size: UVec2) {
    scene.film.size = size;
    scene.film.crop = PixelRect { min: UVec2::ZERO, size };
}

impl RenderArgs {
    /// Applies the arguments that change the scene.
    pub(super) fn edit(&self, scene: &mut Scene) -> Result<(), CliError> {
        if let Some(size) = self.size {
            resize(scene, size);
        }
        if let Some(crop) = self.crop {
            let end = crop.min.checked_add(crop.size);
            if !end.is_some_and(|end| end.cmple(scene.film.size).all()) {
                return Err(format!(
                    "--crop reaches beyond the film of {}x{}",
                    scene.film.size.x, scene.film.size.y
                )
                .into());
            }
            scene.film.crop = crop;
        }
        Ok(())
    }

    pub(super) fn backend(&self) -> Result<Backend, CliError> {
        Ok(match &self.backend {
            Some(spec) => Backend::new(&spec.name, &spec.parameters)?,
            None => Backend::default(),
        })
    }

    /// The passes to render: from --passes, --spp or the scene; all there are if --time alone says when to stop.
    pub(super) fn pass_range(&self, scene: &Scene) -> Range<u32> {
        match (&self.passes, self.spp, self.time) {
            (Some(range), _, _) => range.clone(),
            (None, Some(spp), _) => 0..spp,
            (None, None, Some(_)) => 0..u32::MAX,
            (None, None, None) => 0..scene.sample_count,
        }
    }
}
