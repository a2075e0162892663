//! Emitters, ready to be sampled: from a point that is to be lit (`sample_li`), or as the start of a light path (`sample_le`).
//!
//! Each emissive triangle, rectangle or analytic shape, each point, spot and directional light and the environment is one *light*,
//! chosen with a probability proportional to its power (with a textured radiance, by the mean over the light). What is infinitely far away emits through a disc that covers the bounding
//! sphere. From a point, triangles, rectangles and spheres are sampled by solid angle where that is well conditioned and by area
//! otherwise; which of the two is a function of light and point alone, so that [`Lights::pdf_li`] can tell the density of a light
//! point that another technique found.
//!
//! Here lights are collected and looked at; `li` samples them from a point, `le` starts light paths at them, and `start` is what is seen
//! of such a start, as a light of its own.

mod area;
mod environment;
mod le;
mod li;
mod luminance_map;
mod rectangle;
mod spot;
mod start;

pub use le::LeSample;
pub use li::LiSample;

use std::f32::consts::FRAC_1_PI;

use glam::{Vec2, Vec3};

use super::BoundingSphere;
use crate::sampling::discrete::AliasTable;
use crate::scene::{
    AnalyticShape, Emitter, Geometry, Input, Rgb, Scene, Shape, SurfacePoint, TextureId, Textures,
    TriangleMesh, luminance,
};
use environment::Environment;
use rectangle::Rectangle;
use spot::SpotLight;

/// Index of a light; see the module's text for what counts as one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LightId(u32);

/// In `Lights::of_primitive` and `Lights::first_primitive`: not a light.
const NONE: u32 = u32::MAX;

#[derive(Debug, Clone, Copy)]
enum Light {
    Triangle {
        shape: u32,
        triangle: u32,
    },
    /// Index into `Lights::rectangles`.
    Rectangle(u32),
    Analytic {
        shape: u32,
    },
    Point {
        position: Vec3,
        intensity: Rgb,
    },
    /// Index into `Lights::spots`.
    Spot(u32),
    Directional {
        direction: Vec3,
        irradiance: Rgb,
    },
    Environment,
}

/// The emitters of a scene.
#[derive(Debug)]
pub struct Lights<'s> {
    shapes: &'s [Shape],
    textures: Textures<'s>,
    all: Vec<Light>,
    /// One over the area of each light, 0 for those that have none.
    inverse_areas: Vec<f32>,
    rectangles: Vec<Rectangle>,
    spots: Vec<SpotLight>,
    /// `None` when nothing emits.
    table: Option<AliasTable>,
    /// For each shape, where its primitives begin in `of_primitive`; `NONE` for shapes that do not emit.
    first_primitive: Vec<u32>,
    of_primitive: Vec<u32>,
    environment: Option<(LightId, Environment<'s>)>,
    bounds: BoundingSphere,
    radiance_unit: f32,
}

impl<'s> Lights<'s> {
    /// Collects the emitters of a scene. `bounds` surrounds its shapes and its camera. An environment's map is sampled in so many columns, if that is said, else in as many
    /// as it says itself.
    pub fn new(scene: &'s Scene, bounds: BoundingSphere, sampling_columns: Option<u32>) -> Self {
        let mut this = Self {
            shapes: &scene.shapes,
            textures: Textures::of(scene),
            all: Vec::new(),
            inverse_areas: Vec::new(),
            rectangles: Vec::new(),
            spots: Vec::new(),
            table: None,
            first_primitive: vec![NONE; scene.shapes.len()],
            of_primitive: Vec::new(),
            environment: None,
            bounds,
            radiance_unit: 0.0,
        };
        let bounds: Vec<Rgb> = scene.shapes.iter().map(|shape| this.emission_bound(shape)).collect();
        for (index, shape) in scene.shapes.iter().enumerate() {
            let is_instance = matches!(shape.geometry, Geometry::Instance(_));
            if !is_instance && bounds[index].max_element() > 0.0 {
                this.first_primitive[index] = this.of_primitive.len() as u32;
                this.add_area_lights(index as u32, &shape.geometry);
            }
        }
        this.add_emitters(&scene.emitters, sampling_columns);
        let powers: Vec<f64> = this.all.iter().map(|&l| this.power(l, &bounds)).collect();
        this.table = AliasTable::new(&powers);
        let inverse_area = |area: f64| if area > 0.0 { (1.0 / area) as f32 } else { 0.0 };
        this.inverse_areas = this.all.iter().map(|&l| inverse_area(this.area(l))).collect();
        this.radiance_unit = this.characteristic_radiance(&bounds);
        this
    }

    fn add_area_lights(&mut self, shape: u32, geometry: &Geometry) {
        match geometry {
            // They emit nothing.
            Geometry::Instance(_) => {}
            Geometry::Analytic(_) => {
                self.of_primitive.push(self.all.len() as u32);
                self.all.push(Light::Analytic { shape });
            }
            Geometry::Mesh(mesh) => {
                let count = mesh.triangles().len() as u32;
                let mut triangle = 0;
                while triangle < count {
                    let light = self.all.len() as u32;
                    self.of_primitive.push(light);
                    if let Some(rectangle) = Rectangle::find(mesh, shape, triangle) {
                        self.of_primitive.push(light);
                        self.all.push(Light::Rectangle(self.rectangles.len() as u32));
                        self.rectangles.push(rectangle);
                        triangle += 2;
                    } else {
                        self.all.push(Light::Triangle { shape, triangle });
                        triangle += 1;
                    }
                }
            }
        }
    }

    fn add_emitters(&mut self, emitters: &'s [Emitter], sampling_columns: Option<u32>) {
        for emitter in emitters {
            let light = match emitter {
                Emitter::Point { position, intensity } => {
                    Light::Point { position: *position, intensity: *intensity }
                }
                Emitter::Spot(spot) => {
                    self.spots.push(SpotLight::new(spot));
                    Light::Spot(self.spots.len() as u32 - 1)
                }
                Emitter::Directional { direction, irradiance } => {
                    Light::Directional { direction: *direction, irradiance: *irradiance }
                }
                Emitter::Constant { .. } | Emitter::Map(_) => {
                    let environment = match emitter {
                        Emitter::Constant { radiance } if radiance.max_element() > 0.0 => {
                            Some(Environment::Constant(*radiance))
                        }
                        Emitter::Map(map) => {
                            let columns = sampling_columns.unwrap_or(map.sampling_columns());
                            Environment::from_map(map, columns)
                        }
                        _ => None,
                    };
                    let Some(environment) = environment.filter(|_| self.environment.is_none()) else {
                        continue;
                    };
                    self.environment = Some((LightId(self.all.len() as u32), environment));
                    Light::Environment
                }
            };
            self.all.push(light);
        }
    }

    /// Emitted flux of a light, by luminance, in W.
    fn power(&self, light: Light, bounds: &[Rgb]) -> f64 {
        use std::f64::consts::PI;
        let y = |c: Rgb| f64::from(luminance(c));
        match light {
            Light::Triangle { .. } | Light::Rectangle(_) | Light::Analytic { .. } => {
                PI * self.area(light) * self.mean_luminance(light, bounds)
            }
            Light::Point { intensity, .. } => 4.0 * PI * y(intensity),
            Light::Spot(spot) => {
                let spot = &self.spots[spot as usize];
                spot.solid_angle() * y(spot.intensity)
            }
            Light::Directional { irradiance, .. } => self.disc_area() * y(irradiance),
            Light::Environment => {
                self.disc_area() * self.environment.as_ref().map_or(0.0, |(_, e)| e.fluence())
            }
        }
    }

    /// Kinds of lights that there are, by Mitsuba's names, with their number and flux in W.
    pub fn flux_by_kind(&self) -> Vec<(&'static str, usize, f64)> {
        let bounds: Vec<Rgb> = self.shapes.iter().map(|shape| self.emission_bound(shape)).collect();
        let mut kinds: Vec<(&'static str, usize, f64)> = Vec::new();
        for &light in &self.all {
            let kind = match light {
                Light::Triangle { .. } | Light::Rectangle(_) | Light::Analytic { .. } => "area",
                Light::Point { .. } => "point",
                Light::Spot(_) => "spot",
                Light::Directional { .. } => "directional",
                Light::Environment => "environment",
            };
            let flux = self.power(light, &bounds);
            match kinds.iter_mut().find(|(known, ..)| *known == kind) {
                Some((_, count, sum)) => {
                    *count += 1;
                    *sum += flux;
                }
                None => kinds.push((kind, 1, flux)),
            }
        }
        kinds
    }

    /// A radiance that a shape nowhere exceeds, per channel; 0 if it emits nothing.
    fn emission_bound(&self, shape: &Shape) -> Rgb {
        shape.emission.map_or(Rgb::ZERO, |radiance| self.textures.bound(radiance, shape))
    }

    /// The shape of an area light.
    fn shape_of(&self, light: Light) -> Option<u32> {
        match light {
            Light::Triangle { shape, .. } | Light::Analytic { shape } => Some(shape),
            Light::Rectangle(r) => Some(self.rectangles[r as usize].corner.shape),
            Light::Point { .. } | Light::Spot(_) | Light::Directional { .. } | Light::Environment => None,
        }
    }

    /// Mean luminance of an area light over its surface; of a texture the mean over a grid, and at least a hundredth of its bound, so that
    /// no light is left out because the grid missed what emits.
    fn mean_luminance(&self, light: Light, bounds: &[Rgb]) -> f64 {
        /// Points on a light, and on all lights of a shape together.
        const MOST: usize = 1024;
        const MOST_OF_SHAPE: usize = 16 * MOST;
        let Some(shape) = self.shape_of(light) else { return 0.0 };
        let radiance = match self.shapes[shape as usize].emission {
            None => return 0.0,
            Some(Input::Constant(radiance)) => return f64::from(luminance(radiance)),
            Some(radiance) => radiance,
        };
        let lights = self.shapes[shape as usize].geometry.primitive_count().max(1) as usize;
        let n = (MOST_OF_SHAPE / lights).clamp(4, MOST).isqrt() as u16;
        let middle = |i: u16| (f32::from(i) + 0.5) / f32::from(n);
        let cells = (0..n).flat_map(|y| (0..n).map(move |x| Vec2::new(middle(x), middle(y))));
        let points = cells.filter_map(|u| self.sample_area_light_uniformly(light, u));
        let value = |p: SurfacePoint| luminance(radiance.at(self.textures, (&p).into()).max(Rgb::ZERO));
        let sum: f64 = points.map(|p| f64::from(value(p))).sum();
        (sum / f64::from(n).powi(2)).max(0.01 * f64::from(luminance(bounds[shape as usize])))
    }

    /// Area of the disc through which distant light comes.
    fn disc_area(&self) -> f64 {
        std::f64::consts::PI * f64::from(self.bounds.radius).powi(2)
    }

    #[inline]
    fn mesh(&self, shape: u32) -> Option<&'s TriangleMesh> {
        match &self.shapes[shape as usize].geometry {
            Geometry::Mesh(mesh) => Some(mesh),
            Geometry::Analytic(_) | Geometry::Instance(_) => None,
        }
    }

    #[inline]
    fn analytic(&self, shape: u32) -> Option<&'s AnalyticShape> {
        match &self.shapes[shape as usize].geometry {
            Geometry::Analytic(analytic) => Some(analytic),
            Geometry::Mesh(_) | Geometry::Instance(_) => None,
        }
    }

    /// World area of an area light, in f64: the squares of tiny edges vanish in f32.
    fn area(&self, light: Light) -> f64 {
        match light {
            Light::Triangle { shape, triangle } => self.mesh(shape).map_or(0.0, |mesh| {
                let [a, b, c] = mesh.corners(triangle).map(Vec3::as_dvec3);
                0.5 * (b - a).cross(c - a).length()
            }),
            Light::Rectangle(r) => {
                let r = &self.rectangles[r as usize];
                r.ex.as_dvec3().cross(r.ey.as_dvec3()).length()
            }
            Light::Analytic { shape } => self.analytic(shape).map_or(0.0, AnalyticShape::area),
            Light::Point { .. } | Light::Spot(_) | Light::Directional { .. } | Light::Environment => 0.0,
        }
    }

    fn characteristic_radiance(&self, bounds: &[Rgb]) -> f32 {
        let far2 = self.bounds.radius * self.bounds.radius;
        self.all.iter().fold(0.0, |unit: f32, &light| {
            let radiance = match light {
                Light::Point { intensity, .. } => intensity.max_element() / far2,
                Light::Spot(spot) => self.spots[spot as usize].intensity.max_element() / far2,
                Light::Directional { irradiance, .. } => irradiance.max_element() * FRAC_1_PI,
                Light::Environment => self.environment.as_ref().map_or(0.0, |(_, e)| e.brightest()),
                Light::Triangle { .. } | Light::Rectangle(_) | Light::Analytic { .. } => {
                    self.shape_of(light).map_or(0.0, |shape| bounds[shape as usize].max_element())
                }
            };
            unit.max(radiance)
        })
    }

    /// A radiance that is typical of the scene's brightest parts: of the brightest area light or environment, or what a point light sends
    /// across the scene, or a white surface makes of a directional light. 0 if nothing emits. Scales with emission, which makes it a unit for sums.
    pub fn radiance_unit(&self) -> f32 {
        self.radiance_unit
    }

    /// The light that a surface point belongs to.
    #[inline]
    pub fn light_at(&self, point: &SurfacePoint) -> Option<LightId> {
        let first = self.first_primitive[point.shape as usize];
        (first != NONE).then(|| LightId(self.of_primitive[(first + point.primitive) as usize]))
    }

    /// Radiance that a surface point emits in direction `wo`: from the side of its normal only.
    #[inline]
    pub fn le(&self, point: &SurfacePoint, wo: Vec3) -> Rgb {
        match self.shapes[point.shape as usize].emission {
            Some(Input::Constant(radiance)) if point.ng.dot(wo) > 0.0 => radiance,
            Some(Input::Texture(id)) if point.ng.dot(wo) > 0.0 => self.textured_emission(id, *point),
            _ => Rgb::ZERO,
        }
    }

    /// Takes a copy, so that points on other lights need no address.
    #[inline(never)]
    fn textured_emission(&self, id: TextureId, point: SurfacePoint) -> Rgb {
        self.textures.color(id, (&point).into()).max(Rgb::ZERO)
    }

    /// The light that is all around, if there is one.
    #[inline]
    pub fn environment(&self) -> Option<LightId> {
        self.environment.as_ref().map(|(light, _)| *light)
    }

    /// Radiance that arrives from the environment in unit direction `d`, which points away from the scene.
    #[inline]
    pub fn le_environment(&self, d: Vec3) -> Rgb {
        self.environment.as_ref().map_or(Rgb::ZERO, |(_, environment)| environment.le(d))
    }

    /// Number of lights.
    #[inline]
    pub fn len(&self) -> usize {
        self.all.len()
    }

    /// Whether nothing emits.
    pub fn is_empty(&self) -> bool {
        self.all.is_empty()
    }

    /// Chooses a light: the light and its probability. `None` if nothing emits.
    #[inline]
    fn choose(&self, u: f64) -> Option<(LightId, Light, f32)> {
        let table = self.table.as_ref()?;
        let index = table.sample(u);
        Some((LightId(index as u32), self.all[index], table.pdf(index)))
    }

    #[inline]
    fn choice_pdf(&self, light: LightId) -> f32 {
        self.table.as_ref().map_or(0.0, |t| t.pdf(light.0 as usize))
    }

    /// Whether a light is a point or a direction, which no path can hit.
    #[inline]
    pub fn is_delta(&self, light: LightId) -> bool {
        match self.all[light.0 as usize] {
            Light::Point { .. } | Light::Spot(_) | Light::Directional { .. } => true,
            Light::Triangle { .. } | Light::Rectangle(_) | Light::Analytic { .. } | Light::Environment => {
                false
            }
        }
    }
}
