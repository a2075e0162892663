//! Mitsuba 3 XML scenes, and those of Mitsuba 2 and 0.4 to 0.6.
//!
//! Loading goes in steps: `xml` turns text into a tree of objects with named values, knowing no plugin. Each object
//! is then built by the entry for its plugin in the table of its category (`shapes`, `bsdfs`, `emitters`,
//! `sensors`), which reads its parameters through `properties`. Mesh files are collected on the way and loaded
//! last, in parallel. To add a plugin is to add its entry to a table, and, if it is something new, to the scene.
//!
//! Scenes of 0.x are put into the words of Mitsuba 3 by `upgrade` as they are read.
//!
//! Values, defaults and geometry follow Mitsuba 3.9. Stricter than there: what would have no effect is an error.

mod bsdfs;
mod conductors;
mod emitters;
mod instances;
mod integrators;
mod properties;
mod sensors;
mod shapes;
mod spectra;
mod spectrum_plugins;
mod textures;
mod upgrade;
mod values;
mod xml;

pub use properties::{Default, Description, Kind, Parameter};
pub use xml::Category;
pub(super) use xml::Text;

use std::collections::{HashMap, HashSet};

use rayon::prelude::*;

use super::image::Images;
use super::mesh::Placement;
use super::{
    DEFAULT_SAMPLE_COUNT, LoadError, LoadOptions, Location, Log, Origins, bounds_of, default_film,
    framing_camera, push,
};
use crate::scene::{
    Camera, Emitter, FilmSettings, Filter, Geometry, Input, IntegratorSettings, Material, MaterialId, Rgb,
    Scene, Shape, Texture, TextureId,
};
use emitters::Light;
use instances::PlannedInstance;
use properties::{Plugin, Properties, find};
use shapes::Surface;
use xml::{Document, Object, ObjectId, Span};

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

/// What a document holds.
struct Built {
    shapes: Vec<Shape>,
    /// Of each shape, if its mesh came from a file.
    placements: Vec<Option<Placement>>,
    materials: Vec<Material>,
    textures: Vec<Texture>,
    emitters: Vec<Emitter>,
    sensor: Option<Sensor>,
    integrator: Option<IntegratorSettings>,
    /// Materials by the id of their BSDF.
    names: HashMap<String, MaterialId>,
    asks_for_attributes: HashSet<MaterialId>,
}

/// A shape whose geometry may yet have to be loaded.
struct PlannedShape {
    name: String,
    surface: Surface,
    material: MaterialId,
    emission: Option<Input<Rgb>>,
    /// Of its mesh, that its material and emission ask for.
    attributes: Vec<Attribute>,
}

/// The name of a mesh attribute, and where it is asked for.
type Attribute = (String, Span);

struct Sensor {
    camera: Camera,
    film: FilmSettings,
    sample_count: u32,
}

/// The scene in the making.
struct Builder<'a> {
    document: &'a Document,
    log: &'a mut Log,
    images: Images,
    textures: Vec<Texture>,
    /// `None` while a texture is being built.
    texture_ids: HashMap<ObjectId, Option<TextureId>>,
    materials: Vec<Material>,
    /// Of how many others each of the materials is made.
    parts: Vec<u32>,
    /// `None` while a BSDF is being built, which is how circles are noticed.
    material_ids: HashMap<ObjectId, Option<MaterialId>>,
    default_materials: Vec<MaterialId>,
    /// What the BSDF that is being built asks of meshes.
    attributes: Vec<Attribute>,
    /// The same of those that are built, if it is anything.
    material_attributes: HashMap<MaterialId, Vec<Attribute>>,
    depth: usize,
    shapes: Vec<PlannedShape>,
    /// Of shapes that are only seen through instances, in the order of the file.
    groups: Vec<(ObjectId, Vec<PlannedShape>)>,
    instances: Vec<PlannedInstance>,
    emitters: Vec<Emitter>,
    sensor: Option<Sensor>,
    integrator: Option<IntegratorSettings>,
}

impl<'a> Builder<'a> {
    /// For a document whose materials and textures come after those there are.
    fn new(
        document: &'a Document,
        materials: Vec<Material>,
        textures: Vec<Texture>,
        log: &'a mut Log,
    ) -> Self {
        let mut images = Images::default();
        images.prefetch(textures::files(document), log);
        Self {
            document,
            log,
            images,
            textures,
            texture_ids: HashMap::new(),
            // Nothing in the document can refer to those there are, whose parts therefore need not be counted.
            parts: vec![1; materials.len()],
            materials,
            material_ids: HashMap::new(),
            default_materials: Vec::new(),
            attributes: Vec::new(),
            material_attributes: HashMap::new(),
            depth: 0,
            shapes: Vec::new(),
            groups: Vec::new(),
            instances: Vec::new(),
            emitters: Vec::new(),
            sensor: None,
            integrator: None,
        }
    }

    fn error<T>(
        &self,
        at: Span,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Result<T, LoadError> {
        Err(self.document.error(at, found, expected))
    }

    fn note(&mut self, at: Span, message: impl Into<String>) {
        self.log.note(self.document.locate(at), message);
    }

    /// The checked parameters of an object and its plugin's entry, if that is supported.
    fn properties<B>(
        &mut self,
        table: &'static [Plugin<B>],
        id: ObjectId,
        substitute: &str,
    ) -> Result<Option<(&'static B, Properties<'a>)>, LoadError> {
        let object = self.document.object(id);
        let Some(plugin) = find(table, object, self.document, substitute, self.log)? else { return Ok(None) };
        let properties = Properties::new(self.document, object, plugin.description, self.log)?;
        Ok(Some((&plugin.build, properties)))
    }

    /// An object directly in the scene.
    fn root(&mut self, id: ObjectId, at: Span) -> Result<(), LoadError> {
        let object = self.document.object(id);
        match object.category {
            Category::Shape => self.shape(id),
            Category::Bsdf => self.material(id, at).map(drop),
            Category::Texture => self.texture(id, at).map(drop),
            Category::Emitter => self.free_emitter(id),
            Category::Sensor => self.sensor(id),
            Category::Integrator => self.integrator(object),
            Category::Film | Category::Sampler | Category::Rfilter => {
                self.error(at, format!("{} directly in the scene", object.category), "it within a sensor")
            }
            _ => {
                let found = format!("{} `{}` is not supported", object.category, object.plugin);
                let expected = xml::one_of(&["shape", "bsdf", "texture", "emitter", "sensor", "integrator"]);
                self.log.unsupported(self.document.error(at, found, expected), "it is ignored")
            }
        }
    }

    /// The material of a BSDF; each is built once, however many refer to it.
    fn material(&mut self, id: ObjectId, at: Span) -> Result<MaterialId, LoadError> {
        match self.material_ids.get(&id) {
            Some(Some(material)) => {
                self.attributes.extend(self.material_attributes.get(material).into_iter().flatten().cloned());
                return Ok(*material);
            }
            Some(None) => return self.error(at, "a BSDF that contains itself", "no circular references"),
            None => {}
        }
        if self.depth >= MAX_BSDF_DEPTH {
            return self.error(at, "BSDFs in each other", format!("at most {MAX_BSDF_DEPTH} levels"));
        }
        self.material_ids.insert(id, None);
        self.depth += 1;
        let attributes_around = std::mem::take(&mut self.attributes);
        let material = match self.properties(bsdfs::PLUGINS, id, "diffuse with reflectance 0.5 is used")? {
            Some((build, properties)) => {
                let material = build(&properties, self)?;
                properties.finish()?;
                self.push_material(material, at)?
            }
            None => self.default_material(super::GREY),
        };
        self.depth -= 1;
        self.material_ids.insert(id, Some(material));
        let attributes = std::mem::replace(&mut self.attributes, attributes_around);
        if !attributes.is_empty() {
            self.attributes.extend(attributes.iter().cloned());
            self.material_attributes.insert(material, attributes);
        }
        Ok(material)
    }

    /// Adds a material that comes after those it is made of.
    fn push_material(&mut self, material: Material, at: Span) -> Result<MaterialId, LoadError> {
        let parts = count_parts(&material, &self.parts);
        if parts > MAX_BSDF_PARTS {
            return self.error(at, "a BSDF of too many others", format!("at most {MAX_BSDF_PARTS}"));
        }
        let is_composite = matches!(
            material,
            Material::Principled(_)
                | Material::Blend { .. }
                | Material::Mask { .. }
                | Material::Perturbed { .. }
        );
        if let (true, Some((name, _))) = (is_composite, self.attributes.first()) {
            let found = format!("attribute `{name}` of meshes in a principled BSDF or one made of others");
            return self.error(
                at,
                found,
                "it in a simple BSDF, perhaps within `twosided`, or in an `area` emitter",
            );
        }
        self.parts.push(parts);
        Ok(push(&mut self.materials, material))
    }

    /// One of the materials of shapes that name none: those are few, and each is kept once.
    fn default_material(&mut self, material: Material) -> MaterialId {
        let found =
            self.default_materials.iter().copied().find(|id| self.materials[id.0 as usize] == material);
        found.unwrap_or_else(|| {
            self.parts.push(1);
            let id = push(&mut self.materials, material);
            self.default_materials.push(id);
            id
        })
    }

    /// A shape directly in the scene.
    fn shape(&mut self, id: ObjectId) -> Result<(), LoadError> {
        match self.document.object(id).plugin.as_str() {
            instances::GROUP => self.group(id),
            instances::INSTANCE => self.instance(id),
            _ => {
                let shape = self.planned_shape(id)?;
                self.shapes.extend(shape);
                Ok(())
            }
        }
    }

    /// A shape with geometry of its own; `None` if lenience leaves it out.
    fn planned_shape(&mut self, id: ObjectId) -> Result<Option<PlannedShape>, LoadError> {
        let Some((build, properties)) = self.properties(shapes::PLUGINS, id, "the shape is left out")? else {
            return Ok(None);
        };
        let object = properties.object;
        let bsdf = properties.optional_object(Category::Bsdf)?;
        let emission = match properties.optional_object(Category::Emitter)? {
            Some(emitter) => self.emission(emitter)?,
            None => None,
        };
        let mut attributes = match emission {
            Some(Input::Texture(texture)) => self.attributes_of(texture, object.at),
            _ => Vec::new(),
        };
        let material = match bsdf {
            Some(bsdf) => self.material(bsdf, object.at)?,
            // As in Mitsuba: a lamp without a BSDF reflects nothing.
            None if emission.is_some() => self.default_material(super::BLACK),
            None => self.default_material(super::GREY),
        };
        attributes.extend(self.material_attributes.get(&material).into_iter().flatten().cloned());
        let surface = build(&properties)?;
        properties.finish()?;
        let name = object.id.clone().unwrap_or_else(|| format!("{}-{}", object.plugin, self.shapes.len()));
        Ok(Some(PlannedShape { name, surface, material, emission, attributes }))
    }

    fn light(&mut self, id: ObjectId) -> Result<Option<Light>, LoadError> {
        let is_sky = matches!(self.document.object(id).plugin.as_ref(), "sky" | "sunsky");
        let instead = if is_sky { "a white sky is put in its place" } else { "the light is left out" };
        let Some((build, properties)) = self.properties(emitters::PLUGINS, id, instead)? else {
            let white = Light::Free(Emitter::Constant { radiance: Rgb::ONE });
            return Ok(is_sky.then_some(white));
        };
        properties.ignore("sampling_weight");
        let light = build(&properties, self)?;
        properties.finish()?;
        Ok(Some(light))
    }

    /// The radiance of an emitter that is part of a shape.
    fn emission(&mut self, id: ObjectId) -> Result<Option<Input<Rgb>>, LoadError> {
        let object = self.document.object(id);
        match self.light(id)? {
            Some(Light::Area { radiance }) => Ok(Some(radiance)),
            Some(Light::Free(_)) => {
                self.error(object.at, format!("emitter `{}` in a shape", object.plugin), "an `area` emitter")
            }
            None => Ok(None),
        }
    }

    fn free_emitter(&mut self, id: ObjectId) -> Result<(), LoadError> {
        let at = self.document.object(id).at;
        match self.light(id)? {
            Some(Light::Area { .. }) => {
                self.error(at, "an `area` emitter outside of shapes", "it within a shape")
            }
            Some(Light::Free(emitter)) => {
                let is_environment = |e: &Emitter| matches!(e, Emitter::Constant { .. } | Emitter::Map(_));
                if is_environment(&emitter) && self.emitters.iter().any(is_environment) {
                    return self.error(at, "a second environment", "at most one `constant` or `envmap`");
                }
                self.emitters.push(emitter);
                Ok(())
            }
            None => Ok(()),
        }
    }

    fn sensor(&mut self, id: ObjectId) -> Result<(), LoadError> {
        let at = self.document.object(id).at;
        let substitute = "a camera that frames the scene is used";
        let Some((build, properties)) = self.properties(sensors::SENSORS, id, substitute)? else {
            return Ok(());
        };
        let camera = build(&properties)?;
        let film = match properties.optional_object(Category::Film)? {
            Some(film) => self.film(film)?,
            None => default_film(),
        };
        let sample_count = match properties.optional_object(Category::Sampler)? {
            Some(sampler) => self.sampler(sampler)?,
            None => DEFAULT_SAMPLE_COUNT,
        };
        properties.finish()?;
        if self.sensor.is_some() {
            self.note(at, "only the first sensor of the scene is used");
        } else {
            self.sensor = Some(Sensor { camera, film, sample_count });
        }
        Ok(())
    }

    fn film(&mut self, id: ObjectId) -> Result<FilmSettings, LoadError> {
        let Some((build, properties)) =
            self.properties(sensors::FILMS, id, "hdrfilm of 768 x 576 pixels is used")?
        else {
            return Ok(default_film());
        };
        let mut film = build(&properties, self.log)?;
        if let Some(filter) = properties.optional_object(Category::Rfilter)? {
            film.filter = self.filter(filter)?;
        }
        properties.finish()?;
        Ok(film)
    }

    fn filter(&mut self, id: ObjectId) -> Result<Filter, LoadError> {
        let Some((build, properties)) = self.properties(sensors::FILTERS, id, "gaussian is used")? else {
            return Ok(default_film().filter);
        };
        let filter = build(&properties)?;
        properties.finish()?;
        Ok(filter)
    }

    fn sampler(&mut self, id: ObjectId) -> Result<u32, LoadError> {
        let Some((build, properties)) =
            self.properties(sensors::SAMPLERS, id, "4 samples per pixel are taken")?
        else {
            return Ok(DEFAULT_SAMPLE_COUNT);
        };
        let count = build(&properties, self.log)?;
        properties.finish()?;
        Ok(count)
    }

    /// Integrators are known above the scene; their parameters stay text.
    fn integrator(&mut self, object: &Object) -> Result<(), LoadError> {
        if self.integrator.is_some() {
            return self.error(object.at, "a second integrator", "at most one");
        }
        self.integrator = Some(integrators::settings(self.document, object, self.log)?);
        Ok(())
    }

    /// Builds everything, and loads the meshes.
    fn build(mut self) -> Result<Built, LoadError> {
        let document = self.document;
        for child in &document.roots {
            self.root(child.object, child.at)?;
        }
        let log = self.log;
        let mut placements: Vec<_> = self.shapes.iter().map(|shape| shape.surface.placement()).collect();
        let mut shapes = load_all(self.shapes, self.document, log)?;
        let mut groups = Vec::with_capacity(self.groups.len());
        for (id, group) in self.groups {
            groups.push((id, load_all(group, self.document, log)?));
        }
        instances::place(self.document, self.instances, groups, &mut shapes)?;
        placements.resize(shapes.len(), None);
        let name = |(id, material): (&ObjectId, &Option<MaterialId>)| {
            Some((document.object(*id).id.clone()?, (*material)?))
        };
        Ok(Built {
            shapes,
            placements,
            names: self.material_ids.iter().filter_map(name).collect(),
            asks_for_attributes: self.material_attributes.into_keys().collect(),
            materials: self.materials,
            textures: self.textures,
            emitters: self.emitters,
            sensor: self.sensor,
            integrator: self.integrator,
        })
    }
}

/// Loads the geometry of shapes, in parallel.
fn load_all(planned: Vec<PlannedShape>, document: &Document, log: &mut Log) -> Result<Vec<Shape>, LoadError> {
    let lenient = log.lenient;
    let loaded: Vec<_> = planned
        .into_par_iter()
        .map(|shape| {
            let mut log = Log { lenient, ..Log::default() };
            let geometry = match shape.surface {
                Surface::Ready(geometry) => Ok(geometry),
                Surface::File(file) => file.load(&mut log),
            };
            let PlannedShape { name, material, emission, attributes, .. } = shape;
            let shape = geometry.and_then(|geometry| {
                check_attributes(&name, &geometry, &attributes, document)?;
                Ok(Shape { name, geometry, material, emission })
            });
            (shape, log)
        })
        .collect();
    let mut shapes = Vec::with_capacity(loaded.len());
    // In the order of the file, so that which error is reported does not depend on threads.
    for (shape, messages) in loaded {
        log.absorb(messages);
        shapes.push(shape?);
    }
    Ok(shapes)
}

/// Whether a shape has the attributes that its material and emission ask for.
fn check_attributes(
    name: &str,
    geometry: &Geometry,
    attributes: &[Attribute],
    document: &Document,
) -> Result<(), LoadError> {
    let mesh = match geometry {
        Geometry::Mesh(mesh) => Some(mesh),
        Geometry::Analytic(_) | Geometry::Instance(_) => None,
    };
    let has = |attribute: &str| mesh.is_some_and(|m| m.attribute(attribute).is_some());
    let Some((missing, at)) = attributes.iter().find(|(attribute, _)| !has(attribute)) else { return Ok(()) };
    let there: Vec<_> = mesh.iter().flat_map(|m| m.attributes()).map(|a| a.name.as_str()).collect();
    let expected = if there.is_empty() { "a mesh with attributes".to_owned() } else { xml::one_of(&there) };
    Err(document.error(*at, format!("attribute `{missing}`, which shape `{name}` does not have"), expected))
}
