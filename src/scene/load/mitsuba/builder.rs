//! From a tree of objects to the parts of a scene: each object is built by the entry for its plugin, BSDFs and textures once however many refer to them,
//! and mesh files are loaded last.

use std::collections::{HashMap, HashSet};

use super::super::image::Images;
use super::super::mesh::Placement;
use super::super::{BLACK, DEFAULT_SAMPLE_COUNT, GREY, LoadError, Log, default_film, push};
use super::emitters::{self, Light};
use super::instances::{self, PlannedInstance};
use super::plugin::{Plugin, find};
use super::properties::Properties;
use super::shapes::{self, Surface, load_all};
use super::xml::{self, Category, Document, Object, ObjectId, Span};
use super::{MAX_BSDF_DEPTH, MAX_BSDF_PARTS, bsdfs, count_parts, integrators, sensors, textures};
use crate::scene::{
    Camera, Emitter, FilmSettings, Filter, Input, IntegratorSettings, Material, MaterialId, Rgb, Shape,
    Texture, TextureId,
};

/// What a document holds.
pub(super) struct Built {
    pub(super) shapes: Vec<Shape>,
    /// Of each shape, if its mesh came from a file.
    pub(super) placements: Vec<Option<Placement>>,
    pub(super) materials: Vec<Material>,
    pub(super) textures: Vec<Texture>,
    pub(super) emitters: Vec<Emitter>,
    pub(super) sensor: Option<Sensor>,
    pub(super) integrator: Option<IntegratorSettings>,
    /// Materials by the id of their BSDF.
    pub(super) names: HashMap<String, MaterialId>,
    pub(super) asks_for_attributes: HashSet<MaterialId>,
}

/// A shape whose geometry may yet have to be loaded.
pub(super) struct PlannedShape {
    pub(super) name: String,
    pub(super) surface: Surface,
    pub(super) material: MaterialId,
    pub(super) emission: Option<Input<Rgb>>,
    /// Of its mesh, that its material and emission ask for.
    pub(super) attributes: Vec<Attribute>,
}

/// The name of a mesh attribute, and where it is asked for.
pub(super) type Attribute = (String, Span);

pub(super) struct Sensor {
    pub(super) camera: Camera,
    pub(super) film: FilmSettings,
    pub(super) sample_count: u32,
}

/// The scene in the making.
pub(super) struct Builder<'a> {
    pub(super) document: &'a Document,
    pub(super) log: &'a mut Log,
    pub(super) images: Images,
    pub(super) textures: Vec<Texture>,
    /// `None` while a texture is being built.
    pub(super) texture_ids: HashMap<ObjectId, Option<TextureId>>,
    pub(super) materials: Vec<Material>,
    /// Of how many others each of the materials is made.
    pub(super) parts: Vec<u32>,
    /// `None` while a BSDF is being built, which is how circles are noticed.
    pub(super) material_ids: HashMap<ObjectId, Option<MaterialId>>,
    pub(super) default_materials: Vec<MaterialId>,
    /// What the BSDF that is being built asks of meshes.
    pub(super) attributes: Vec<Attribute>,
    /// The same of those that are built, if it is anything.
    pub(super) material_attributes: HashMap<MaterialId, Vec<Attribute>>,
    pub(super) depth: usize,
    pub(super) shapes: Vec<PlannedShape>,
    /// Of shapes that are only seen through instances, in the order of the file.
    pub(super) groups: Vec<(ObjectId, Vec<PlannedShape>)>,
    pub(super) instances: Vec<PlannedInstance>,
    pub(super) emitters: Vec<Emitter>,
    pub(super) sensor: Option<Sensor>,
    pub(super) integrator: Option<IntegratorSettings>,
}

impl<'a> Builder<'a> {
    /// For a document whose materials and textures come after those there are.
    pub(super) fn new(
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

    pub(super) fn error<T>(
        &self,
        at: Span,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> Result<T, LoadError> {
        Err(self.document.error(at, found, expected))
    }

    pub(super) fn note(&mut self, at: Span, message: impl Into<String>) {
        self.log.note(self.document.locate(at), message);
    }

    /// The checked parameters of an object and its plugin's entry, if that is supported.
    pub(super) fn properties<B>(
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
    pub(super) fn material(&mut self, id: ObjectId, at: Span) -> Result<MaterialId, LoadError> {
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
            None => self.default_material(GREY),
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
    pub(super) fn push_material(&mut self, material: Material, at: Span) -> Result<MaterialId, LoadError> {
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
    pub(super) fn planned_shape(&mut self, id: ObjectId) -> Result<Option<PlannedShape>, LoadError> {
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
            None if emission.is_some() => self.default_material(BLACK),
            None => self.default_material(GREY),
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
    pub(super) fn build(mut self) -> Result<Built, LoadError> {
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
