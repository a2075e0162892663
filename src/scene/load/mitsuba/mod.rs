//! Mitsuba 3 XML scenes, and those of Mitsuba 2 and 0.4 to 0.6.
//!
//! Loading goes in steps: `xml` turns text into a tree of objects with named values, knowing no plugin. Each object
//! is then built by the entry for its plugin in the table of its category (`shapes`, `bsdfs`, `emitters`,
//! `sensors`; what an entry is says `plugin`), which reads its parameters through `properties`. `builder` calls them. Mesh files are collected on the way and loaded
//! last, in parallel. To add a plugin is to add its entry to a table, and, if it is something new, to the scene.
//!
//! Scenes of 0.x are put into the words of Mitsuba 3 by `upgrade` as they are read.
//!
//! Values, defaults and geometry follow Mitsuba 3.9. Stricter than there: what would have no effect is an error.

mod bsdfs;
mod builder;
mod conductors;
mod emitters;
mod instances;
mod integrators;
mod plugin;
mod properties;
mod sensors;
mod shapes;
mod spectra;
mod spectrum_plugins;
mod textures;
mod upgrade;
mod values;
mod xml;

pub use plugin::{Default, Description, Kind, Parameter};
pub use xml::Category;
pub(super) use xml::Text;

use std::collections::{HashMap, HashSet};

use super::{
    DEFAULT_SAMPLE_COUNT, LoadError, LoadOptions, Location, Log, Origins, bounds_of, default_film,
    framing_camera,
};
use crate::scene::{Emitter, Material, MaterialId, Scene};
use builder::{Attribute, Builder, Sensor};
use plugin::Plugin;
use xml::{Document, Span};

/// Every supported plugin with its category, for documentation.
pub fn supported() -> Vec<(Category, Description)> {
    fn all<B>(category: Category, table: &[Plugin<B>]) -> impl Iterator<Item = (Category, Description)> {
        table.iter().map(move |p| (category, p.description))
    }
    all(Category::Shape, shapes::PLUGINS)
        .chain(instances::DESCRIPTIONS.iter().map(|d| (Category::Shape, *d)))
        .chain(all(Category::Bsdf, bsdfs::PLUGINS))
        .chain(all(Category::Texture, textures::PLUGINS))
        .chain(all(Category::Spectrum, spectrum_plugins::PLUGINS))
        .chain(all(Category::Emitter, emitters::PLUGINS))
        .chain(all(Category::Sensor, sensors::SENSORS))
        .chain(all(Category::Film, sensors::FILMS))
        .chain(all(Category::Rfilter, sensors::FILTERS))
        .chain(all(Category::Sampler, sensors::SAMPLERS))
        .collect()
}

/// Loads a scene.
pub(super) fn load(text: &Text, options: &LoadOptions, log: &mut Log) -> Result<(Scene, Origins), LoadError> {
    let document = read(text, options, log)?;
    let built = Builder::new(&document, Vec::new(), Vec::new(), log).build()?;
    let origins = Origins { materials: built.names, placements: built.placements };
    let sensor = built.sensor.unwrap_or_else(|| {
        let note = "the scene has no sensor: using a camera that frames its shapes";
        log.note(Location::file(&text.path()), note);
        let camera = framing_camera(bounds_of(&built.shapes));
        Sensor { camera, film: default_film(), sample_count: DEFAULT_SAMPLE_COUNT }
    });
    let scene = Scene {
        shapes: built.shapes,
        materials: built.materials,
        textures: built.textures,
        emitters: built.emitters,
        camera: sensor.camera,
        film: sensor.film,
        integrator: built.integrator.unwrap_or_default(),
        sample_count: sensor.sample_count,
    };
    Ok((scene, origins))
}

/// Changes a scene; see [`Origins::edit`].
pub(super) fn edit(
    text: &Text,
    options: &LoadOptions,
    scene: &mut Scene,
    origins: &mut Origins,
    log: &mut Log,
) -> Result<(), LoadError> {
    let document = read(text, options, log)?;
    let bsdf = |child: &&xml::Child| document.object(child.object).category == Category::Bsdf;
    let unnamed = |child: &&xml::Child| document.object(child.object).id.is_none();
    if let Some(child) = document.roots.iter().filter(bsdf).find(unnamed) {
        return Err(document.error(child.at, "a BSDF without an id", "the id of the one that it replaces"));
    }
    let (materials, textures) = (scene.materials.clone(), scene.textures.clone());
    let built = Builder::new(&document, materials, textures, log).build()?;
    let start = document.roots.first().map_or(Span::default(), |child| child.at);
    let is_environment = |e: &Emitter| matches!(e, Emitter::Constant { .. } | Emitter::Map(_));
    if built.emitters.iter().any(is_environment) && scene.emitters.iter().any(is_environment) {
        return Err(document.error(start, "a second environment", "at most one `constant` or `envmap`"));
    }
    let there: HashSet<&str> = scene.shapes.iter().map(|s| s.name.as_str()).collect();
    if let Some(shape) = built.shapes.iter().find(|shape| there.contains(shape.name.as_str())) {
        let found = format!("a second shape `{}`", shape.name);
        return Err(document.error(start, found, "an id that the scene does not have"));
    }
    let mut replaced = HashMap::new();
    for (name, new) in &built.names {
        let Some(old) = origins.materials.get(name) else { continue };
        if built.asks_for_attributes.contains(new) {
            let found = format!("attributes of meshes in BSDF `{name}`, which replaces another");
            return Err(document.error(start, found, "them in a scene that is loaded"));
        }
        replaced.insert(*old, *new);
    }
    // What can fail, on a copy.
    let mut names = origins.materials.clone();
    for (name, new) in built.names {
        names.entry(name).or_insert(new);
    }
    let old_materials = std::mem::replace(&mut scene.materials, built.materials);
    let old_names = std::mem::replace(&mut origins.materials, names);
    let shape_count = scene.shapes.len();
    scene.shapes.extend(built.shapes);
    if !replaced.is_empty() && origins.replace_materials(scene, &replaced).is_none() {
        scene.shapes.truncate(shape_count);
        scene.materials = old_materials;
        origins.materials = old_names;
        let expected = format!("at most {MAX_BSDF_PARTS}, {MAX_BSDF_DEPTH} levels deep");
        return Err(document.error(start, "a BSDF of too many others", expected));
    }
    scene.textures = built.textures;
    scene.emitters.extend(built.emitters);
    origins.placements.resize(shape_count, None);
    origins.placements.extend(built.placements);
    if let Some(Sensor { camera, film, sample_count }) = built.sensor {
        (scene.camera, scene.film, scene.sample_count) = (camera, film, sample_count);
    }
    if let Some(integrator) = built.integrator {
        scene.integrator = integrator;
    }
    Ok(())
}

/// The text as a tree of objects.
fn read(text: &Text, options: &LoadOptions, log: &mut Log) -> Result<Document, LoadError> {
    let mut document = Document::read(text, &options.defines, log)?;
    document.meshes.clone_from(&options.meshes);
    spectrum_plugins::fold(&mut document, log)?;
    Ok(document)
}

/// BSDFs nested in or referring to each other; building recurses.
pub(super) const MAX_BSDF_DEPTH: usize = 50;

/// Materials that one is made of. BSDFs that refer to others can multiply: each of 50 that blends the one before with itself
/// would take for ever to evaluate.
pub(super) const MAX_BSDF_PARTS: u32 = 64;

/// Of how many others a material is made, from what is known of those.
pub(super) fn count_parts(material: &Material, known: &[u32]) -> u32 {
    let of = |id: MaterialId| known[id.0 as usize];
    match *material {
        Material::Blend { first, second, .. } => of(first) + of(second),
        Material::TwoSided { front, back } => of(front).max(of(back)),
        Material::Mask { material, .. } | Material::Perturbed { material, .. } => of(material) + 1,
        _ => 1,
    }
}
