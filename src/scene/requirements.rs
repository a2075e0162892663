//! What a scene requires of a renderer, worked out from the plain data: which lobes, lights and camera there are, which materials and
//! textures anything uses, and which classes of light paths can exist.
//!
//! What *may* exist is told here; how much light each class carries takes rays, and is measured by [`study::pilot`](crate::study::pilot).
//!
//! ## Classes
//!
//! Heckbert's notation (1990, "Adaptive radiosity textures for bidirectional ray tracing"): L a light, E the eye, S an event of a delta lobe, D any other. What an
//! integrator can sample depends on the two ends of a path, so that [`PathClass`] parts all paths L(S|D)*E by these: whether the event next to the light is
//! specular, whether the one next to the eye is, and whether there are no, one or more events D. Each path is of exactly one class.

use super::{
    Emitter, Geometry, Input, Lens, Material, MaterialId, Perturbation, Scene, Shape, Texture, TextureId,
};

/// A class of light paths; see the module's text.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PathClass {
    /// A light, seen.
    Emission,
    /// A light, seen in mirrors or through glass.
    EmissionMirrored,
    /// Direct light.
    Direct,
    /// Direct light, seen in mirrors or through glass.
    DirectMirrored,
    /// Light that comes by way of other surfaces.
    Indirect,
    /// The same, seen in mirrors or through glass.
    IndirectMirrored,
    /// Light that mirrors or glass throw on what is seen.
    Caustic,
    /// The same, seen in mirrors or through glass.
    CausticMirrored,
    /// Light of caustics elsewhere.
    CausticElsewhere,
    /// The same, seen in mirrors or through glass.
    CausticElsewhereMirrored,
}

/// Events along a subpath, counted from where it starts: as much of it as [`PathClass`] depends on.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Events {
    count: u32,
    diffuse: u32,
    first_is_delta: bool,
    last_is_delta: bool,
}

impl Events {
    /// With one event more at the end.
    #[must_use]
    pub fn then(self, is_delta: bool) -> Self {
        Self {
            count: self.count + 1,
            diffuse: self.diffuse + u32::from(!is_delta),
            first_is_delta: if self.count == 0 { is_delta } else { self.first_is_delta },
            last_is_delta: is_delta,
        }
    }
}

impl PathClass {
    /// All of them.
    pub const ALL: [Self; 10] = [
        Self::Emission,
        Self::EmissionMirrored,
        Self::Direct,
        Self::DirectMirrored,
        Self::Indirect,
        Self::IndirectMirrored,
        Self::Caustic,
        Self::CausticMirrored,
        Self::CausticElsewhere,
        Self::CausticElsewhereMirrored,
    ];

    /// In Heckbert's notation, as a regular expression.
    pub fn notation(self) -> &'static str {
        match self {
            Self::Emission => "LE",
            Self::EmissionMirrored => "LS+E",
            Self::Direct => "LDE",
            Self::DirectMirrored => "LDS+E",
            Self::Indirect => "LD(S|D)*DE",
            Self::IndirectMirrored => "LD(S|D)*DS+E",
            Self::Caustic => "LS+DE",
            Self::CausticMirrored => "LS+DS+E",
            Self::CausticElsewhere => "LS+D(S|D)*DE",
            Self::CausticElsewhereMirrored => "LS+D(S|D)*DS+E",
        }
    }

    /// In words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Emission => "lights",
            Self::EmissionMirrored => "lights in mirrors, through glass",
            Self::Direct => "direct light",
            Self::DirectMirrored => "direct light in mirrors, through glass",
            Self::Indirect => "indirect light",
            Self::IndirectMirrored => "indirect light in mirrors, through glass",
            Self::Caustic => "caustics",
            Self::CausticMirrored => "caustics in mirrors, through glass",
            Self::CausticElsewhere => "light of caustics elsewhere",
            Self::CausticElsewhereMirrored => "the same in mirrors, through glass",
        }
    }

    /// Notation and words of several.
    pub fn list(classes: &[Self]) -> String {
        let one = |class: &Self| format!("{} ({})", class.notation(), class.words());
        classes.iter().map(one).collect::<Vec<_>>().join(", ")
    }

    /// Least number of segments of a path of the class.
    pub fn least_depth(self) -> u32 {
        match self {
            Self::Emission => 1,
            Self::EmissionMirrored | Self::Direct => 2,
            Self::DirectMirrored | Self::Indirect | Self::Caustic => 3,
            Self::IndirectMirrored | Self::CausticMirrored | Self::CausticElsewhere => 4,
            Self::CausticElsewhereMirrored => 5,
        }
    }

    /// Whether the event next to the light is specular, on paths with an event D: light sampling does not find those.
    pub fn is_caustic(self) -> bool {
        matches!(
            self,
            Self::Caustic | Self::CausticMirrored | Self::CausticElsewhere | Self::CausticElsewhereMirrored
        )
    }

    /// Whether the event next to the eye is specular: nothing that is connected to the lens finds those.
    pub fn is_mirrored(self) -> bool {
        matches!(
            self,
            Self::EmissionMirrored
                | Self::DirectMirrored
                | Self::IndirectMirrored
                | Self::CausticMirrored
                | Self::CausticElsewhereMirrored
        )
    }

    /// The class of a path of which one part was walked from the light and the other from the eye; either may have no events.
    pub fn of(from_light: Events, from_eye: Events) -> Self {
        let first = |a: Events, b: Events| if a.count > 0 { a.first_is_delta } else { b.last_is_delta };
        let (is_caustic, is_mirrored) = (first(from_light, from_eye), first(from_eye, from_light));
        match (from_light.diffuse + from_eye.diffuse, is_caustic, is_mirrored) {
            (0, ..) if from_light.count + from_eye.count == 0 => Self::Emission,
            (0, ..) => Self::EmissionMirrored,
            (1, false, false) => Self::Direct,
            (1, false, true) => Self::DirectMirrored,
            (1, true, false) => Self::Caustic,
            (1, true, true) => Self::CausticMirrored,
            (_, false, false) => Self::Indirect,
            (_, false, true) => Self::IndirectMirrored,
            (_, true, false) => Self::CausticElsewhere,
            (_, true, true) => Self::CausticElsewhereMirrored,
        }
    }
}

/// Which lobes the materials of surfaces have.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
// Independent facts of which any may hold, no states.
#[allow(clippy::struct_excessive_bools)]
pub struct Lobes {
    /// Lambertian reflection.
    pub diffuse: bool,
    /// Lobes of rough surfaces.
    pub rough: bool,
    /// Delta lobes of reflection or refraction.
    pub specular: bool,
    /// Light that passes straight on: null materials and the holes of masks.
    pub straight: bool,
}

impl Lobes {
    /// Whether some event is a delta one (S).
    pub fn has_delta(self) -> bool {
        self.specular || self.straight
    }

    /// Whether some event is not (D).
    pub fn has_other(self) -> bool {
        self.diffuse || self.rough
    }
}

/// Which lights there are. Those of no power count as none.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LightKinds {
    /// Points.
    pub points: u32,
    /// Spots.
    pub spots: u32,
    /// Directional lights.
    pub directional: u32,
    /// Shapes that emit.
    pub area: u32,
    /// Skies of constant radiance.
    pub constant: u32,
    /// Skies given by an image.
    pub maps: u32,
}

impl LightKinds {
    /// Lights that no path can hit.
    pub fn delta(&self) -> u32 {
        self.points + self.spots + self.directional
    }

    /// Lights that paths can hit.
    pub fn visible(&self) -> u32 {
        self.area + self.constant + self.maps
    }

    /// Lights so far away that of what they send little comes near what is seen.
    pub fn distant(&self) -> u32 {
        self.directional + self.constant + self.maps
    }
}

/// What a scene requires.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Requirements {
    /// Lobes of the materials that are used.
    pub lobes: Lobes,
    /// Lights.
    pub lights: LightKinds,
    /// Whether the lens has an area that light paths can hit.
    pub has_lens: bool,
    /// Whether the camera looks in one direction only.
    pub is_orthographic: bool,
    /// For each material whether a surface has it.
    pub used_materials: Vec<bool>,
    /// For each texture whether a material or light that is used has it.
    pub used_textures: Vec<bool>,
}

impl Requirements {
    /// Those of a scene.
    pub fn of(scene: &Scene) -> Self {
        let mut this = Self {
            lobes: Lobes::default(),
            lights: light_kinds(scene),
            has_lens: matches!(scene.camera.lens, Lens::Thin { .. }),
            is_orthographic: scene.camera.lens == Lens::Orthographic,
            used_materials: vec![false; scene.materials.len()],
            used_textures: vec![false; scene.textures.len()],
        };
        for shape in &scene.shapes {
            this.use_shape(shape);
        }
        // Materials and textures are made of earlier ones only, so that one way back settles all.
        for index in (0..scene.materials.len()).rev() {
            if this.used_materials[index] {
                this.use_material(scene, index);
            }
        }
        for index in (0..scene.textures.len()).rev() {
            if this.used_textures[index] {
                this.use_texture(&scene.textures[index]);
            }
        }
        this
    }

    fn use_shape(&mut self, shape: &Shape) {
        if let Geometry::Instance(instance) = &shape.geometry {
            for part in instance.group().shapes() {
                self.use_shape(part);
            }
            return;
        }
        self.mark_material(shape.material);
        if let Some(Input::Texture(id)) = shape.emission {
            self.mark_texture(id);
        }
    }

    fn mark_material(&mut self, id: MaterialId) {
        if let Some(used) = self.used_materials.get_mut(id.0 as usize) {
            *used = true;
        }
    }

    fn mark_texture(&mut self, id: TextureId) {
        if let Some(used) = self.used_textures.get_mut(id.0 as usize) {
            *used = true;
        }
    }

    fn input<T>(&mut self, input: &Input<T>) {
        if let Input::Texture(id) = input {
            self.mark_texture(*id);
        }
    }

    fn use_material(&mut self, scene: &Scene, index: usize) {
        let lobes = &mut self.lobes;
        match &scene.materials[index] {
            Material::Diffuse { reflectance } => {
                // What is black scatters nothing.
                lobes.diffuse |= *reflectance != Input::Constant(super::Rgb::ZERO);
                self.input(reflectance);
            }
            Material::Conductor { eta, k, specular_reflectance } => {
                lobes.specular = true;
                for input in [eta, k, specular_reflectance] {
                    self.input(input);
                }
            }
            Material::RoughConductor { alpha, eta, k, specular_reflectance, .. } => {
                lobes.rough = true;
                for input in [eta, k, specular_reflectance] {
                    self.input(input);
                }
                self.input(&alpha[0]);
                self.input(&alpha[1]);
            }
            Material::Dielectric { specular_reflectance, specular_transmittance, .. }
            | Material::ThinDielectric { specular_reflectance, specular_transmittance, .. } => {
                lobes.specular = true;
                self.input(specular_reflectance);
                self.input(specular_transmittance);
            }
            Material::RoughDielectric { alpha, specular_reflectance, specular_transmittance, .. } => {
                lobes.rough = true;
                self.input(specular_reflectance);
                self.input(specular_transmittance);
                self.input(&alpha[0]);
                self.input(&alpha[1]);
            }
            Material::Plastic { roughness, diffuse_reflectance, specular_reflectance, .. } => {
                lobes.diffuse = true;
                lobes.rough |= roughness.is_some();
                lobes.specular |= roughness.is_none();
                self.input(diffuse_reflectance);
                self.input(specular_reflectance);
            }
            Material::Principled(p) => {
                lobes.diffuse = true;
                lobes.rough = true;
                self.input(&p.base_color);
                let numbers = [
                    p.roughness,
                    p.anisotropic,
                    p.metallic,
                    p.spec_trans,
                    p.spec_tint,
                    p.sheen,
                    p.sheen_tint,
                    p.flatness,
                    p.clearcoat,
                    p.clearcoat_gloss,
                ];
                for input in numbers {
                    self.input(&input);
                }
            }
            Material::Null => lobes.straight = true,
            Material::TwoSided { front, back } => {
                self.mark_material(*front);
                self.mark_material(*back);
            }
            Material::Mask { opacity, material } => {
                lobes.straight |= *opacity != Input::Constant(1.0);
                self.input(opacity);
                self.mark_material(*material);
            }
            Material::Blend { weight, first, second } => {
                self.input(weight);
                self.mark_material(*first);
                self.mark_material(*second);
            }
            Material::Perturbed { by, material, .. } => {
                match by {
                    Perturbation::Bump { texture, .. } => self.mark_texture(*texture),
                    Perturbation::Normal(normal) => self.input(normal),
                }
                self.mark_material(*material);
            }
        }
    }

    fn use_texture(&mut self, texture: &Texture) {
        match texture {
            Texture::Checkerboard { color0, color1, .. } => {
                self.input(color0);
                self.input(color1);
            }
            Texture::Scale { texture, .. } => self.mark_texture(*texture),
            Texture::Bitmap(_) | Texture::MeshAttribute { .. } => {}
        }
    }

    /// Whether paths of a class can exist that have at most `max_depth` segments.
    pub fn has(&self, class: PathClass, max_depth: u32) -> bool {
        let is_lit = match class {
            // Points and directions are not seen.
            PathClass::Emission | PathClass::EmissionMirrored => self.lights.visible() > 0,
            _ => self.lights.visible() + self.lights.delta() > 0,
        };
        let needs_delta = class.is_caustic() || class.is_mirrored();
        let needs_other = !matches!(class, PathClass::Emission | PathClass::EmissionMirrored);
        is_lit
            && class.least_depth() <= max_depth
            && (!needs_delta || self.lobes.has_delta())
            && (!needs_other || self.lobes.has_other())
    }

    /// The classes that can exist.
    pub fn classes(&self, max_depth: u32) -> Vec<PathClass> {
        PathClass::ALL.into_iter().filter(|&class| self.has(class, max_depth)).collect()
    }
}

fn light_kinds(scene: &Scene) -> LightKinds {
    let mut kinds = LightKinds::default();
    let emits = |shape: &&Shape| {
        shape.emission.is_some_and(|e| !matches!(e, Input::Constant(c) if c.max_element() <= 0.0))
    };
    kinds.area = scene.shapes.iter().filter(emits).count() as u32;
    for emitter in &scene.emitters {
        match emitter {
            Emitter::Point { intensity, .. } => kinds.points += u32::from(intensity.max_element() > 0.0),
            Emitter::Spot(spot) => kinds.spots += u32::from(spot.intensity.max_element() > 0.0),
            Emitter::Directional { irradiance, .. } => {
                kinds.directional += u32::from(irradiance.max_element() > 0.0);
            }
            Emitter::Constant { radiance } => kinds.constant += u32::from(radiance.max_element() > 0.0),
            Emitter::Map(_) => kinds.maps += 1,
        }
    }
    kinds
}
