//! `helmholtz inspect`: what a scene holds, what it requires, and which integrator can do it.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use glam::UVec2;
use serde_json::{Value, json};

use super::common::Reading;
use super::integrator::Wanted;
use super::render::resize;
use super::{CliError, EXIT_DIFFERENT, EXIT_DONE};
use crate::integrators::vpl::VirtualLights;
use crate::integrators::{Ability, Integrator, PathLength};
use crate::query::{Backend, RayQuery};
use crate::scene::findings::{Finding, findings};
use crate::scene::load::load;
use crate::scene::requirements::{PathClass, Requirements};
use crate::scene::{Geometry, Scene, Shape, Texture};
use crate::spec::{Spec, size, spec};
use crate::study::auto::choose;
use crate::study::pilot::Pilot;
use crate::study::verify::{Verdict, judge};
use crate::transport::World;

/// Say what a scene holds and requires
///
/// Which classes of light paths can exist in it, in Heckbert's notation (L a light, E the eye, S an event in a mirror or smooth glass, D any other),
/// and which integrator samples them well, poorly (by luck) or cannot; and what is odd about it.
///
/// With --verify short renders measure how much light each class carries by each integrator, and whether that is what the table
/// predicts. Photons and virtual lights do not know their classes; of them the whole image is measured. Exit code 3 if a prediction does not hold.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  helmholtz inspect scenes/ring.xml
  helmholtz inspect scenes/ring.xml --integrator path:max_depth=4 --verify
  helmholtz inspect room.xml --json")]
pub(super) struct InspectArgs {
    /// Mitsuba scene (.xml) or mesh (.obj, .ply)
    scene: PathBuf,
    /// Integrator to judge instead of the scene's, with parameters as of `render`
    #[arg(long, value_name = "NAME:KEY=VALUE,...", value_parser = spec)]
    integrator: Option<Spec>,
    /// Measure what the table predicts by short renders
    #[arg(long)]
    verify: bool,
    /// Film size in pixels instead of the scene's
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    size: Option<UVec2>,
    /// Ray queries by, as of `render`
    #[arg(long, value_name = "NAME:KEY=VALUE,...", value_parser = spec)]
    backend: Option<Spec>,
    #[command(flatten)]
    reading: Reading,
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

/// The integrators of the table.
const TABLE: [&str; 7] = ["path", "ptracer", "bdpt", "photonmapper", "sppm", "sppm:mode=caustic", "vpl"];

/// Passes of a group of a pilot for --verify: 260,000 samples in all.
const PASSES: u32 = 32;

/// The same with photons.
const PHOTON_PASSES: u32 = 2;

pub(super) fn run(args: &InspectArgs) -> Result<u8, CliError> {
    let mut loaded = load(&args.scene, &args.reading.options())?;
    for warning in &loaded.warnings {
        eprintln!("{warning}");
    }
    if let Some(size) = args.size {
        resize(&mut loaded.scene, size);
    }
    let scene = &loaded.scene;
    let wanted = Wanted::new(args.integrator.as_ref(), &scene.integrator, args.reading.lenient)?;
    let inspection = Inspection::new(scene, wanted)?;
    let verified = match (args.verify, &args.backend) {
        (false, _) => None,
        (true, spec) => {
            let backend = spec.as_ref().map(|s| Backend::new(&s.name, &s.parameters)).transpose()?;
            Some(inspection.verify(&backend.unwrap_or_default().build(&scene.shapes)?)?)
        }
    };
    if args.json {
        println!("{:#}", inspection.json(verified.as_ref()));
    } else {
        println!("{}", args.scene.display());
        print!("{}", inspection.text());
        if let Some(verified) = &verified {
            print!("{}", verified.text(&inspection));
        }
    }
    let holds =
        verified.is_none_or(|v| v.rows.iter().all(|row| row.verdicts.iter().all(|v| v.holds != Some(false))));
    Ok(if holds { EXIT_DONE } else { EXIT_DIFFERENT })
}

/// What is told without tracing a ray.
struct Inspection<'a> {
    scene: &'a Scene,
    needs: Requirements,
    classes: Vec<PathClass>,
    length: PathLength,
    /// The integrator that would render; `None` for `auto`.
    chosen: Option<Integrator>,
    /// Rows of the table.
    integrators: Vec<(&'static str, Integrator)>,
    contents: Contents,
    lights: Vec<(&'static str, usize, f64)>,
    findings: Vec<Finding>,
    /// What the chosen integrator cannot do, or only by luck.
    shortcomings: Vec<String>,
}

/// What there is how much of.
#[derive(Default)]
struct Contents {
    meshes: usize,
    analytic: usize,
    instances: usize,
    /// Triangles as they are held, and as they stand in the scene.
    triangles: u64,
    triangles_placed: u64,
    mesh_bytes: usize,
    texture_bytes: usize,
}

impl Contents {
    fn of(scene: &Scene) -> Self {
        let mut this = Self::default();
        let mut groups = Vec::new();
        for shape in &scene.shapes {
            if let Geometry::Instance(instance) = &shape.geometry {
                this.instances += 1;
                let group = instance.group();
                let parts = group.shapes();
                this.triangles_placed += parts.iter().map(triangles).sum::<u64>();
                if !groups.contains(&std::sync::Arc::as_ptr(group)) {
                    groups.push(std::sync::Arc::as_ptr(group));
                    for part in parts {
                        this.hold(part);
                    }
                }
            } else {
                this.triangles_placed += triangles(shape);
                this.hold(shape);
            }
        }
        let mut images = Vec::new();
        for texture in &scene.textures {
            if let Texture::Bitmap(bitmap) = texture
                && !images.contains(&std::sync::Arc::as_ptr(&bitmap.image))
            {
                images.push(std::sync::Arc::as_ptr(&bitmap.image));
                this.texture_bytes += bitmap.image.memory();
            }
        }
        this
    }

    fn hold(&mut self, shape: &Shape) {
        self.triangles += triangles(shape);
        match &shape.geometry {
            Geometry::Mesh(mesh) => {
                self.meshes += 1;
                self.mesh_bytes += mesh.memory();
            }
            Geometry::Analytic(_) => self.analytic += 1,
            Geometry::Instance(_) => {}
        }
    }
}

fn triangles(shape: &Shape) -> u64 {
    match &shape.geometry {
        Geometry::Mesh(mesh) => mesh.triangles().len() as u64,
        Geometry::Analytic(_) | Geometry::Instance(_) => 0,
    }
}

/// The integrator and the passes of a group of its pilot: fewer virtual lights, which changes their noise only, but all photons, fewer of which would lie further apart and have more
/// bias.
fn in_small(integrator: Integrator) -> (Integrator, u32) {
    match integrator {
        Integrator::PhotonMap(_) => (integrator, PHOTON_PASSES),
        Integrator::VirtualLights(vpl) => {
            (Integrator::VirtualLights(VirtualLights { count: 10, ..vpl }), PASSES)
        }
        _ => (integrator, PASSES),
    }
}

impl<'a> Inspection<'a> {
    fn new(scene: &'a Scene, wanted: Wanted) -> Result<Self, CliError> {
        let needs = Requirements::of(scene);
        let (chosen, length) = match wanted {
            Wanted::ByUser(integrator) | Wanted::ByScene(integrator) => {
                (Some(integrator), integrator.length())
            }
            Wanted::Auto(length) => (None, length),
        };
        let depth = length.max_depth.map_or_else(|| "-1".to_owned(), |depth| depth.to_string());
        let named = |name: &'static str| {
            let Spec { name: plugin, mut parameters } = spec(name)?;
            parameters.push(("max_depth".to_owned(), depth.clone()));
            Ok((name, Integrator::new(&plugin, &parameters).map_err(|error| error.to_string())?))
        };
        let integrators = TABLE.into_iter().map(named).collect::<Result<_, String>>()?;
        let classes = needs.classes(length.limit());
        let shortcoming = |integrator: &Integrator, class: &PathClass| {
            let how = match integrator.ability(*class, &needs) {
                Ability::Well => return None,
                Ability::Poorly => "finds only by luck",
                Ability::Cannot => "cannot find all",
            };
            Some(format!("the integrator {how} light of paths {} ({})", class.notation(), class.words()))
        };
        let shortcomings =
            chosen.iter().flat_map(|i| classes.iter().filter_map(|c| shortcoming(i, c))).collect();
        Ok(Self {
            findings: findings(scene, &needs),
            contents: Contents::of(scene),
            lights: World::new(scene).lights.flux_by_kind(),
            scene,
            needs,
            classes,
            length,
            chosen,
            integrators,
            shortcomings,
        })
    }

    fn chosen_name(&self) -> String {
        self.chosen.map_or_else(|| "auto".to_owned(), |integrator| integrator.describe())
    }

    fn text(&self) -> String {
        let Contents { meshes, analytic, instances, triangles, triangles_placed, mesh_bytes, texture_bytes } =
            self.contents;
        let mib = |bytes: usize| bytes as f64 / f64::from(1 << 20);
        let placed = if instances > 0 {
            format!(", {triangles_placed} with {instances} instances")
        } else {
            String::new()
        };
        let film = self.scene.film.size;
        let mut text = format!(
            "  surfaces    {meshes} meshes, {analytic} analytic shapes; {triangles} triangles{placed}; {:.1} MiB\n  materials   {}\n  textures    {}, {:.1} MiB\n",
            mib(mesh_bytes),
            self.materials(),
            self.scene.textures.len(),
            mib(texture_bytes)
        );
        // Writing to a String cannot fail.
        for (kind, count, flux) in &self.lights {
            let _ = writeln!(text, "  light       {count} x {kind}, {flux:.4e} W");
        }
        let _ = writeln!(text, "  camera      {}, {}x{} pixels", self.lens(), film.x, film.y);
        let _ = writeln!(text, "  integrator  {}\n", self.chosen_name());
        text += &self.table();
        for finding in self.findings.iter().map(|f| &f.text).chain(&self.shortcomings) {
            let _ = writeln!(text, "  note: {finding}");
        }
        text
    }

    fn table(&self) -> String {
        if self.classes.is_empty() {
            return "  no light reaches the camera\n".to_owned();
        }
        let header = self.integrators.iter().map(|(name, _)| format!(" {name:>17}"));
        let mut text = format!("  {:16}{}\n", "paths", header.collect::<String>());
        for &class in &self.classes {
            let cell = |(_, i): &(_, Integrator)| format!(" {:>17}", i.ability(class, &self.needs).word());
            let cells: String = self.integrators.iter().map(cell).collect();
            let _ = writeln!(text, "  {:16}{cells}  {}", class.notation(), class.words());
        }
        text
    }

    /// Kinds of materials with their number, and the lobes that they have.
    fn materials(&self) -> String {
        let mut kinds = std::collections::BTreeMap::new();
        for material in &self.scene.materials {
            *kinds.entry(material.kind()).or_insert(0) += 1;
        }
        let kinds: Vec<_> = kinds.iter().map(|(kind, count)| format!("{count} {kind}")).collect();
        format!("{} (lobes: {})", kinds.join(", "), self.lobes().join(", "))
    }

    fn lobes(&self) -> Vec<&'static str> {
        let lobes = self.needs.lobes;
        let all = [
            ("diffuse", lobes.diffuse),
            ("rough", lobes.rough),
            ("specular", lobes.specular),
            ("straight", lobes.straight),
        ];
        all.into_iter().filter(|(_, has)| *has).map(|(name, _)| name).collect()
    }

    fn lens(&self) -> &'static str {
        if self.needs.is_orthographic {
            "orthographic"
        } else if self.needs.has_lens {
            "thin lens"
        } else {
            "pinhole"
        }
    }

    /// Short renders by all integrators of the table.
    fn verify<Q: RayQuery>(&self, query: &Q) -> Result<Verified, CliError> {
        let size = Pilot::film_size(self.scene.film.size);
        let world = World::for_film(self.scene, size);
        let pilot = |&(name, integrator): &(&'static str, Integrator)| {
            let (small, passes) = in_small(integrator);
            Ok((name, integrator, Pilot::run(&world, query, small, size, passes)?))
        };
        let pilots: Vec<_> = self.integrators.iter().map(pilot).collect::<Result<_, CliError>>()?;
        let tried: Vec<_> = pilots.iter().map(|(_, integrator, pilot)| (*integrator, pilot)).collect();
        let verdicts = judge(&tried, &self.needs, self.length);
        let rows = pilots.iter().zip(verdicts).map(|((name, _, pilot), verdicts)| Row {
            name,
            pilot: pilot.clone(),
            verdicts,
        });
        let rows = rows.collect();
        Ok(Verified { rows, auto: choose(self.scene, query, self.length)?.why })
    }

    fn json(&self, verified: Option<&Verified>) -> Value {
        let Contents { meshes, analytic, instances, triangles, triangles_placed, mesh_bytes, texture_bytes } =
            self.contents;
        let class = |class: &PathClass| {
            let ability = |(name, i): &(&str, Integrator)| {
                ((*name).to_owned(), i.ability(*class, &self.needs).word().into())
            };
            let table: serde_json::Map<String, Value> = self.integrators.iter().map(ability).collect();
            json!({"paths": class.notation(), "words": class.words(), "integrators": table})
        };
        let light =
            |(kind, count, flux): &(&str, usize, f64)| json!({"kind": kind, "count": count, "flux": flux});
        let finding = |f: &Finding| json!({"kind": f.kind.name(), "text": f.text});
        json!({
            "meshes": meshes,
            "analytic_shapes": analytic,
            "instances": instances,
            "triangles": triangles,
            "triangles_with_instances": triangles_placed,
            "mesh_bytes": mesh_bytes,
            "textures": self.scene.textures.len(),
            "texture_bytes": texture_bytes,
            "materials": self.scene.materials.iter().map(crate::scene::Material::kind).collect::<Vec<_>>(),
            "lobes": self.lobes(),
            "lights": self.lights.iter().map(light).collect::<Vec<_>>(),
            "camera": self.lens(),
            "size": self.scene.film.size.to_array(),
            "integrator": self.chosen_name(),
            "classes": self.classes.iter().map(class).collect::<Vec<_>>(),
            "findings": self.findings.iter().map(finding).collect::<Vec<_>>(),
            "shortcomings": self.shortcomings,
            "verified": verified.map(Verified::json),
        })
    }
}

/// An integrator's pilot, and what it says about each class of [`PathClass::ALL`], and last about the whole image.
struct Row {
    name: &'static str,
    pilot: Pilot,
    verdicts: Vec<Verdict>,
}

/// What short renders have found.
struct Verified {
    rows: Vec<Row>,
    auto: String,
}

impl Verified {
    fn text(&self, inspection: &Inspection) -> String {
        let header = self.rows.iter().map(|row| format!(" {:>17}", row.name));
        let mut text = format!("\n  {:16}{}\n", "measured", header.collect::<String>());
        for (i, class) in PathClass::ALL.iter().enumerate() {
            let is_seen = |row: &Row| row.pilot.classes[i].mean > 0.0;
            if inspection.classes.contains(class) || self.rows.iter().any(is_seen) {
                let cells: String = self.rows.iter().map(|row| row.verdicts[i].cell()).collect();
                let _ = writeln!(text, "  {:16}{cells}", class.notation());
            }
        }
        let cells: String =
            self.rows.iter().filter_map(|row| row.verdicts.last()).map(Verdict::cell).collect();
        let _ = writeln!(text, "  {:16}{cells}", "all");
        let _ = writeln!(
            text,
            "  mean luminance and its standard error; `!` where the prediction does not hold, `?` where there is nothing to tell by, - where classes are not known\n"
        );
        let _ = writeln!(text, "  auto takes {}", self.auto);
        text
    }

    fn json(&self) -> Value {
        let row = |row: &Row| {
            let class = |(i, class): (usize, &PathClass)| {
                let Verdict { measured, holds } = row.verdicts[i];
                json!({"paths": class.notation(), "mean": measured.map(|m| m.mean), "error": measured.map(|m| m.error), "holds": holds})
            };
            let total = row.pilot.total;
            let holds = row.verdicts.last().and_then(|v| v.holds);
            json!({
                "integrator": row.name,
                "mean": total.mean,
                "error": total.error,
                "holds": holds,
                "rays_per_sample": row.pilot.rays,
                "rays_shared_by_a_pass": row.pilot.shared_rays,
                "classes": PathClass::ALL.iter().enumerate().map(class).collect::<Vec<_>>(),
            })
        };
        json!({"integrators": self.rows.iter().map(row).collect::<Vec<_>>(), "auto": self.auto})
    }
}
