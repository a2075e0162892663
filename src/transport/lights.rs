//! Emitters, ready to be sampled: from a point that is to be lit (`sample_li`), or as the start of a light path (`sample_le`).
//!
//! Each emissive triangle, rectangle or analytic shape, each point, spot and directional light and the environment is one *light*,
//! chosen with a probability proportional to its power. What is infinitely far away emits through a disc that covers the bounding sphere. From a point, triangles, rectangles and spheres are sampled by solid angle where that
//! is well conditioned and by area otherwise; which of the two is a function of light and point alone, so that
//! [`Lights::pdf_li`] can tell the density of a light point that another technique found.

mod environment;
mod spot;
mod start;

use std::f32::consts::{FRAC_1_PI, PI};

use glam::{DVec3, Vec2, Vec3};

use super::BoundingSphere;
use super::bsdf::Frame;
use crate::query::Ray;
use crate::sampling::discrete::AliasTable;
use crate::sampling::spherical::{PlacedRectangle, SphereCone, SphericalRectangle, SphericalTriangle};
use crate::sampling::warp::{
    UNIFORM_SPHERE_PDF, cosine_hemisphere_pdf, square_to_cosine_hemisphere, square_to_disc, square_to_sphere,
    square_to_triangle,
};
use crate::scene::{
    AnalyticKind, AnalyticShape, Emitter, Geometry, Rgb, Scene, Shape, SurfacePoint, TriangleMesh, luminance,
};
use environment::Environment;
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

/// A flat light farther away than this many times its diameter is sampled by area: the density per solid angle then varies by
/// so little over it that the estimate hardly becomes noisier, and a sample is cheaper.
/// Figures are in `vendor-notes/measurements.md`.
const FAR: f32 = 1.0;

/// Two triangles of a mesh that together are a rectangle.
#[derive(Debug, Clone, Copy)]
struct Rectangle {
    placed: PlacedRectangle,
    ex: Vec3,
    ey: Vec3,
    /// One of the corners where only one of the triangles is, and where error bounds are greatest.
    corner: SurfacePoint,
    center: Vec3,
    /// Squared distance from `center` beyond which it is sampled by area.
    far_squared: f32,
    /// Position and texture coordinates of that corner and of the one opposite, on the other triangle: the two are planes of
    /// their own, to within rounding.
    ends: [(Vec3, Vec2); 2],
    /// For each triangle, how texture coordinates change along `ex` and `ey`.
    uv_edges: [[Vec2; 2]; 2],
}

/// A direction towards a light, drawn for a point.
#[derive(Debug, Clone, Copy)]
pub struct LiSample {
    /// Which light.
    pub light: LightId,
    /// Unit direction to the light.
    pub wi: Vec3,
    /// Radiance arriving if nothing is between; for a point or spot light, intensity over squared distance;
    /// for a directional light, irradiance.
    pub radiance: Rgb,
    /// Density per solid angle, the choice of the light included; for a delta light the probability of that choice alone.
    pub pdf_w: f32,
    /// Whether no other technique can find this direction.
    pub is_delta: bool,
    /// Normal of the light where it was hit, if it is a surface.
    pub ng: Option<Vec3>,
    /// Tells by [`occluded`](crate::query::RayQuery::occluded) whether anything is between.
    pub shadow_ray: Ray,
}

/// The start of a light path.
#[derive(Debug, Clone, Copy)]
pub struct LeSample {
    /// Which light.
    pub light: LightId,
    /// The path's first ray.
    pub ray: Ray,
    /// Where it starts, for area lights.
    pub point: Option<SurfacePoint>,
    /// Emitted radiance in that direction; intensity for a point or spot light, irradiance for a directional light.
    pub radiance: Rgb,
    /// Cosine between ray and normal; 1 where there is no surface.
    pub cos: f32,
    /// Density of the position per area (of the light, or of the disc that distant light comes through), the choice of the light
    /// included. For a point or spot light the probability of the choice alone.
    pub pdf_position: f32,
    /// Density of the direction per solid angle; 1 for a directional light.
    pub pdf_direction_w: f32,
}

impl LeSample {
    /// What is emitted over its density: the power that the path carries.
    #[inline]
    pub fn power(&self) -> Rgb {
        // One division at a time: the product of both densities may leave the range of f32 sooner.
        self.radiance * (self.cos / self.pdf_direction_w) / self.pdf_position
    }
}

/// The emitters of a scene.
#[derive(Debug)]
pub struct Lights<'s> {
    shapes: &'s [Shape],
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
    /// Collects the emitters of a scene. `bounds` surrounds its shapes and its camera.
    pub fn new(scene: &'s Scene, bounds: BoundingSphere) -> Self {
        let mut this = Self {
            shapes: &scene.shapes,
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
        for (index, shape) in scene.shapes.iter().enumerate() {
            if shape.emission.is_some_and(|e| e.max_element() > 0.0) {
                this.first_primitive[index] = this.of_primitive.len() as u32;
                this.add_area_lights(index as u32, &shape.geometry);
            }
        }
        this.add_emitters(&scene.emitters);
        let powers: Vec<f64> = this.all.iter().map(|&l| this.power(l)).collect();
        this.table = AliasTable::new(&powers);
        let inverse_area = |area: f64| if area > 0.0 { (1.0 / area) as f32 } else { 0.0 };
        this.inverse_areas = this.all.iter().map(|&l| inverse_area(this.area(l))).collect();
        this.radiance_unit = this.characteristic_radiance();
        this
    }

    fn add_area_lights(&mut self, shape: u32, geometry: &Geometry) {
        match geometry {
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

    fn add_emitters(&mut self, emitters: &'s [Emitter]) {
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
                        Emitter::Map(map) => Environment::from_map(map),
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
    fn power(&self, light: Light) -> f64 {
        use std::f64::consts::PI;
        let y = |c: Rgb| f64::from(luminance(c));
        match light {
            Light::Triangle { .. } | Light::Rectangle(_) | Light::Analytic { .. } => {
                PI * self.area(light) * y(self.emission(light))
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

    /// Radiance of an area light.
    fn emission(&self, light: Light) -> Rgb {
        match light {
            Light::Triangle { shape, .. } | Light::Analytic { shape } => self.shape_emission(shape),
            Light::Rectangle(r) => self.shape_emission(self.rectangles[r as usize].corner.shape),
            Light::Point { .. } | Light::Spot(_) | Light::Directional { .. } | Light::Environment => {
                Rgb::ZERO
            }
        }
    }

    /// Area of the disc through which distant light comes.
    fn disc_area(&self) -> f64 {
        std::f64::consts::PI * f64::from(self.bounds.radius).powi(2)
    }

    fn shape_emission(&self, shape: u32) -> Rgb {
        self.shapes[shape as usize].emission.unwrap_or(Rgb::ZERO)
    }

    fn mesh(&self, shape: u32) -> Option<&'s TriangleMesh> {
        match &self.shapes[shape as usize].geometry {
            Geometry::Mesh(mesh) => Some(mesh),
            Geometry::Analytic(_) => None,
        }
    }

    fn analytic(&self, shape: u32) -> Option<&'s AnalyticShape> {
        match &self.shapes[shape as usize].geometry {
            Geometry::Analytic(analytic) => Some(analytic),
            Geometry::Mesh(_) => None,
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

    fn characteristic_radiance(&self) -> f32 {
        let far2 = self.bounds.radius * self.bounds.radius;
        self.all.iter().fold(0.0, |unit: f32, &light| {
            let radiance = match light {
                Light::Point { intensity, .. } => intensity.max_element() / far2,
                Light::Spot(spot) => self.spots[spot as usize].intensity.max_element() / far2,
                Light::Directional { irradiance, .. } => irradiance.max_element() * FRAC_1_PI,
                Light::Environment => self.environment.as_ref().map_or(0.0, |(_, e)| e.brightest()),
                Light::Triangle { .. } | Light::Rectangle(_) | Light::Analytic { .. } => {
                    self.emission(light).max_element()
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
            Some(radiance) if point.ng.dot(wo) > 0.0 => radiance,
            _ => Rgb::ZERO,
        }
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
    fn choose(&self, u: f32) -> Option<(LightId, Light, f32)> {
        let table = self.table.as_ref()?;
        let index = table.sample(u);
        Some((LightId(index as u32), self.all[index], table.pdf(index)))
    }

    fn choice_pdf(&self, light: LightId) -> f32 {
        self.table.as_ref().map_or(0.0, |t| t.pdf(light.0 as usize))
    }

    /// Draws a direction from a surface point to a light: `u[0]` chooses the light, `u[1..3]` the place on it.
    /// `None` where the chosen light sends nothing this way.
    #[inline(always)]
    pub fn sample_li(&self, from: &SurfacePoint, u: [f32; 3]) -> Option<LiSample> {
        let (id, light, choice) = self.choose(u[0])?;
        let uv = Vec2::new(u[1], u[2]);
        match light {
            Light::Point { position, intensity } => point_li(id, from, position, choice, |_| intensity),
            Light::Spot(spot) => {
                let spot = &self.spots[spot as usize];
                point_li(id, from, spot.position, choice, |d| spot.intensity(d))
            }
            Light::Directional { direction, irradiance } => {
                let wi = -direction;
                let shadow_ray = Ray::spawn(from, wi);
                Some(LiSample {
                    light: id,
                    wi,
                    radiance: irradiance,
                    pdf_w: choice,
                    is_delta: true,
                    ng: None,
                    shadow_ray,
                })
            }
            Light::Environment => {
                let (_, environment) = self.environment.as_ref()?;
                let wi = environment.sample(uv);
                let (radiance, pdf_w) = (environment.le(wi), choice * environment.pdf_w(wi));
                let shadow_ray = Ray::spawn(from, wi);
                (pdf_w > 0.0).then_some(LiSample {
                    light: id,
                    wi,
                    radiance,
                    pdf_w,
                    is_delta: false,
                    ng: None,
                    shadow_ray,
                })
            }
            Light::Triangle { .. } | Light::Rectangle(_) | Light::Analytic { .. } => {
                let (point, pdf) = self.sample_area_light(id, light, from.p, uv)?;
                let shadow_ray = Ray::spawn_between(from, &point)?;
                let wi = shadow_ray.d;
                let radiance = self.le(&point, -wi);
                let pdf_w = choice * pdf.per_solid_angle(from.p, &point, wi);
                (radiance != Rgb::ZERO && pdf_w > 0.0).then_some(LiSample {
                    light: id,
                    wi,
                    radiance,
                    pdf_w,
                    is_delta: false,
                    ng: Some(point.ng),
                    shadow_ray,
                })
            }
        }
    }

    #[inline(always)]
    fn sample_area_light(
        &self,
        id: LightId,
        light: Light,
        from: Vec3,
        u: Vec2,
    ) -> Option<(SurfacePoint, AreaPdf)> {
        let by_area = AreaPdf::Area(self.inverse_areas[id.0 as usize]);
        if let Light::Rectangle(r) = light {
            let rectangle = &self.rectangles[r as usize];
            if !rectangle.is_near(from) {
                return Some((rectangle.point(u), by_area));
            }
        }
        self.sample_near_or_curved(light, by_area, from, u)
    }

    /// What is worth a call: all but rectangles that are far.
    #[inline(never)]
    fn sample_near_or_curved(
        &self,
        light: Light,
        by_area: AreaPdf,
        from: Vec3,
        u: Vec2,
    ) -> Option<(SurfacePoint, AreaPdf)> {
        match light {
            Light::Triangle { shape, triangle } => {
                let mesh = self.mesh(shape)?;
                let (b, pdf) = match triangle_seen_from(mesh.corners(triangle), from) {
                    Some(spherical) => {
                        (spherical.sample(u), AreaPdf::SolidAngle(1.0 / spherical.solid_angle()))
                    }
                    None => (square_to_triangle(u), by_area),
                };
                Some((SurfacePoint::on_triangle(mesh, shape, triangle, b.x, b.y), pdf))
            }
            Light::Rectangle(r) => {
                let rectangle = &self.rectangles[r as usize];
                let (st, pdf) = match rectangle.seen_from(from) {
                    Some(spherical) => {
                        (spherical.sample(u), AreaPdf::SolidAngle(1.0 / spherical.solid_angle()))
                    }
                    None => (u, by_area),
                };
                Some((rectangle.point(st), pdf))
            }
            Light::Analytic { shape } => {
                let analytic = self.analytic(shape)?;
                if let Some(cone) = sphere_cone(analytic, from) {
                    let near = analytic.to_object().transform_vector3(cone.sample(u).as_dvec3());
                    let point = SurfacePoint::on_analytic(analytic, shape, near);
                    return Some((point, AreaPdf::SolidAngle(1.0 / cone.solid_angle())));
                }
                Some((point_on_analytic(analytic, shape, u), by_area))
            }
            Light::Point { .. } | Light::Spot(_) | Light::Directional { .. } | Light::Environment => None,
        }
    }

    /// Density per solid angle with which [`sample_li`](Self::sample_li) draws, for the point `from`, the emissive point `on`
    /// seen in direction `wi`; the choice of the light included.
    #[inline]
    pub fn pdf_li(&self, light: LightId, from: Vec3, on: &SurfacePoint, wi: Vec3) -> f32 {
        let choice = self.choice_pdf(light);
        let inverse_area = self.inverse_areas[light.0 as usize];
        let solid_angle = match self.all[light.0 as usize] {
            Light::Triangle { shape, triangle } => self
                .mesh(shape)
                .and_then(|mesh| triangle_seen_from(mesh.corners(triangle), from))
                .map(|spherical| spherical.solid_angle()),
            Light::Rectangle(r) => {
                let r = &self.rectangles[r as usize];
                r.seen_from(from).map(|spherical| spherical.solid_angle())
            }
            Light::Analytic { shape } => {
                self.analytic(shape).and_then(|a| sphere_cone(a, from)).map(|cone| cone.solid_angle())
            }
            Light::Point { .. } | Light::Spot(_) | Light::Directional { .. } | Light::Environment => {
                return 0.0;
            }
        };
        let pdf = match solid_angle {
            Some(solid_angle) => AreaPdf::SolidAngle(1.0 / solid_angle),
            None => AreaPdf::Area(inverse_area),
        };
        choice * pdf.per_solid_angle(from, on, wi)
    }

    /// Density per solid angle with which [`sample_li`](Self::sample_li) draws the direction `d` to the environment.
    #[inline]
    pub fn pdf_environment(&self, d: Vec3) -> f32 {
        self.environment
            .as_ref()
            .map_or(0.0, |(light, environment)| self.choice_pdf(*light) * environment.pdf_w(d))
    }

    /// Starts a light path: `choice` chooses the light by power, then `position` and `direction` place and aim the ray.
    #[inline]
    pub fn sample_le(&self, choice: f32, position: Vec2, direction: Vec2) -> Option<LeSample> {
        let (id, light, choice) = self.choose(choice)?;
        match light {
            Light::Point { position: p, intensity } => Some(LeSample {
                light: id,
                ray: Ray::new(p, square_to_sphere(direction)),
                point: None,
                radiance: intensity,
                cos: 1.0,
                pdf_position: choice,
                pdf_direction_w: UNIFORM_SPHERE_PDF,
            }),
            Light::Spot(spot) => {
                let spot = &self.spots[spot as usize];
                let d = spot.sample(direction);
                Some(LeSample {
                    light: id,
                    ray: Ray::new(spot.position, d),
                    point: None,
                    radiance: spot.intensity(d),
                    cos: 1.0,
                    pdf_position: choice,
                    pdf_direction_w: spot.pdf_w(d),
                })
            }
            Light::Directional { direction: d, irradiance } => Some(LeSample {
                light: id,
                ray: self.distant_ray(d, position),
                point: None,
                radiance: irradiance,
                cos: 1.0,
                pdf_position: choice * self.distant_position_pdf(),
                pdf_direction_w: 1.0,
            }),
            Light::Environment => {
                let (_, environment) = self.environment.as_ref()?;
                let towards = environment.sample(direction);
                let pdf_direction_w = environment.pdf_w(towards);
                (pdf_direction_w > 0.0).then_some(LeSample {
                    light: id,
                    ray: self.distant_ray(-towards, position),
                    point: None,
                    radiance: environment.le(towards),
                    cos: 1.0,
                    pdf_position: choice * self.distant_position_pdf(),
                    pdf_direction_w,
                })
            }
            Light::Triangle { .. } | Light::Rectangle(_) | Light::Analytic { .. } => {
                let point = self.sample_area_light_uniformly(light, position)?;
                let local = square_to_cosine_hemisphere(direction);
                let d = Frame::from_z(point.ng).to_world(local);
                Some(LeSample {
                    light: id,
                    ray: Ray::spawn(&point, d),
                    point: Some(point),
                    radiance: self.emission(light),
                    cos: local.z,
                    pdf_position: choice * self.inverse_areas[id.0 as usize],
                    pdf_direction_w: cosine_hemisphere_pdf(local.z),
                })
            }
        }
    }

    fn sample_area_light_uniformly(&self, light: Light, u: Vec2) -> Option<SurfacePoint> {
        match light {
            Light::Triangle { shape, triangle } => {
                let b = square_to_triangle(u);
                Some(SurfacePoint::on_triangle(self.mesh(shape)?, shape, triangle, b.x, b.y))
            }
            Light::Rectangle(r) => {
                let rectangle = &self.rectangles[r as usize];
                Some(rectangle.point(u))
            }
            Light::Analytic { shape } => Some(point_on_analytic(self.analytic(shape)?, shape, u)),
            Light::Point { .. } | Light::Spot(_) | Light::Directional { .. } | Light::Environment => None,
        }
    }

    /// A ray in direction `d` through the bounding sphere, from outside it.
    #[inline]
    fn distant_ray(&self, d: Vec3, position: Vec2) -> Ray {
        let disc = square_to_disc(position) * self.bounds.radius;
        let o = self.bounds.center + Frame::from_z(d).to_world(disc.extend(-self.bounds.radius));
        Ray::new(o, d)
    }

    /// Density per area across its direction with which distant light is placed.
    #[inline]
    fn distant_position_pdf(&self) -> f32 {
        FRAC_1_PI / (self.bounds.radius * self.bounds.radius)
    }

    /// The densities of [`sample_le`](Self::sample_le), position then direction, for a path that leaves `light` in direction `d`.
    /// `ng` is the normal where it leaves an area light.
    #[inline]
    pub fn pdf_le(&self, light: LightId, ng: Option<Vec3>, d: Vec3) -> (f32, f32) {
        let choice = self.choice_pdf(light);
        let inverse_area = self.inverse_areas[light.0 as usize];
        match (self.all[light.0 as usize], ng) {
            (Light::Point { .. }, _) => (choice, UNIFORM_SPHERE_PDF),
            (Light::Spot(spot), _) => (choice, self.spots[spot as usize].pdf_w(d)),
            (Light::Directional { .. }, _) => (choice * self.distant_position_pdf(), 1.0),
            (Light::Environment, _) => {
                let pdf_w = self.environment.as_ref().map_or(0.0, |(_, environment)| environment.pdf_w(-d));
                (choice * self.distant_position_pdf(), pdf_w)
            }
            (_, Some(ng)) => (choice * inverse_area, cosine_hemisphere_pdf(ng.dot(d))),
            (_, None) => (0.0, 0.0),
        }
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

    /// Density per solid angle with which [`sample_li`](Self::sample_li) would have found, from the point `at`, the start of a light path
    /// that leads there; the probability of the light alone if it is a delta.
    #[inline]
    pub fn pdf_li_of_start(&self, start: &LeSample, at: Vec3) -> f32 {
        match (self.all[start.light.0 as usize], &start.point) {
            (Light::Point { .. } | Light::Spot(_) | Light::Directional { .. }, _) => {
                self.choice_pdf(start.light)
            }
            (Light::Environment, _) => self.pdf_environment(-start.ray.d),
            (_, Some(point)) => self.pdf_li(start.light, at, point, -start.ray.d),
            (_, None) => 0.0,
        }
    }

    /// How much denser light paths that start at `light` in direction `d` are at the point `at` than places on the light that are sampled from
    /// there with density `pdf_li`: the quotient of both densities of this segment, per area across `d` at `at`.
    /// `ng` is the normal where the path leaves an area light.
    #[inline]
    pub fn le_over_li(&self, light: LightId, ng: Option<Vec3>, d: Vec3, at: Vec3, pdf_li: f32) -> f64 {
        let (pdf_position, pdf_direction_w) = self.pdf_le(light, ng, d);
        // Area per solid angle seen from `at` over area per solid angle seen from the light; the squared distance cancels unless
        // there is no area.
        let spread = match self.all[light.0 as usize] {
            Light::Point { position, .. } => at.distance_squared(position),
            Light::Spot(spot) => at.distance_squared(self.spots[spot as usize].position),
            Light::Directional { .. } | Light::Environment => 1.0,
            Light::Triangle { .. } | Light::Rectangle(_) | Light::Analytic { .. } => {
                ng.map_or(1.0, |ng| ng.dot(d).abs())
            }
        };
        f64::from(pdf_position) * f64::from(pdf_direction_w) / (f64::from(pdf_li) * f64::from(spread))
    }
}

/// Light from a point of no size, with the `intensity` that it has in a direction away from it. `None` where that is none.
#[inline]
fn point_li(
    light: LightId,
    from: &SurfacePoint,
    position: Vec3,
    choice: f32,
    intensity: impl Fn(Vec3) -> Rgb,
) -> Option<LiSample> {
    let shadow_ray = Ray::spawn_to_point(from, position)?;
    let to = position - from.p;
    let radiance = intensity(-shadow_ray.d) / to.length_squared();
    (radiance != Rgb::ZERO).then_some(LiSample {
        light,
        wi: shadow_ray.d,
        radiance,
        pdf_w: choice,
        is_delta: true,
        ng: None,
        shadow_ray,
    })
}

/// The density of a point on an area light, in the measure it was drawn in.
#[derive(Debug, Clone, Copy)]
enum AreaPdf {
    Area(f32),
    SolidAngle(f32),
}

impl AreaPdf {
    #[inline]
    fn per_solid_angle(self, from: Vec3, on: &SurfacePoint, wi: Vec3) -> f32 {
        match self {
            Self::SolidAngle(pdf) => pdf,
            Self::Area(pdf) => {
                let (cos, distance) = (on.ng.dot(wi).abs(), from.distance(on.p));
                // Grouped so that a tiny area times a huge squared distance stays in range.
                if cos > 0.0 { pdf * distance * distance / cos } else { 0.0 }
            }
        }
    }
}

/// The triangle as a part of the sphere of directions; `None` where it is to be sampled by area.
#[inline]
fn triangle_seen_from(corners: [Vec3; 3], p: Vec3) -> Option<SphericalTriangle> {
    let [a, b, c] = corners;
    let diameter_squared = a.distance_squared(b).max(b.distance_squared(c)).max(c.distance_squared(a));
    let is_near = a.distance_squared(p) < FAR * FAR * diameter_squared;
    is_near.then(|| SphericalTriangle::new(corners, p)).flatten()
}

/// The directions to a sphere.
fn sphere_cone(analytic: &AnalyticShape, from: Vec3) -> Option<SphereCone> {
    if analytic.kind() != AnalyticKind::Sphere {
        return None;
    }
    let radius = analytic.to_world().matrix3.x_axis.length();
    SphereCone::new(analytic.to_world().translation.as_vec3(), radius as f32, from)
}

/// Uniform by area.
fn point_on_analytic(analytic: &AnalyticShape, shape: u32, u: Vec2) -> SurfacePoint {
    let near: DVec3 = match analytic.kind() {
        AnalyticKind::Sphere => square_to_sphere(u).as_dvec3(),
        AnalyticKind::Disk => square_to_disc(u).extend(0.0).as_dvec3(),
        AnalyticKind::Cylinder => {
            let (sin, cos) = (2.0 * PI * u.x).sin_cos();
            Vec3::new(cos, sin, u.y).as_dvec3()
        }
    };
    SurfacePoint::on_analytic(analytic, shape, near)
}

impl Rectangle {
    /// Whether `triangle` and the next one share a diagonal of a rectangle and face the same way.
    fn find(mesh: &TriangleMesh, shape: u32, triangle: u32) -> Option<Self> {
        // Relative error that f32 vertices have after a transform.
        const TOLERANCE: f32 = 1e-5;
        if triangle as usize + 1 >= mesh.triangles().len() {
            return None;
        }
        let (a, b) = (mesh.corners(triangle), mesh.corners(triangle + 1));
        let apex = (0..3).find(|&i| !b.contains(&a[i]))?;
        let (at_ex, at_ey) = ((apex + 1) % 3, (apex + 2) % 3);
        let opposite = (0..3).find(|&i| !a.contains(&b[i]))?;
        let slots_b =
            [opposite, b.iter().position(|&p| p == a[at_ex])?, b.iter().position(|&p| p == a[at_ey])?];
        let (corner, ex, ey) = (a[apex], a[at_ex] - a[apex], a[at_ey] - a[apex]);
        let size = ex.length() + ey.length();
        let perpendicular = ex.dot(ey).abs() <= TOLERANCE * ex.length() * ey.length();
        let closes = (corner + ex + ey).distance(b[opposite]) <= TOLERANCE * size;
        // In the second triangle the diagonal is passed the other way round.
        let same_side = (slots_b[0] + 1) % 3 == slots_b[2];
        let proper = ex.length_squared() > 0.0 && ey.length_squared() > 0.0;
        if !(perpendicular && closes && same_side && proper) {
            return None;
        }
        let at_corner = |triangle, slot| {
            let (u, v) = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)][slot];
            SurfacePoint::on_triangle(mesh, shape, triangle, u, v)
        };
        let [first, second] = [at_corner(triangle, apex), at_corner(triangle + 1, opposite)];
        let uv_edges = [
            [at_ex, at_ey].map(|slot| at_corner(triangle, slot).uv - first.uv),
            [slots_b[2], slots_b[1]].map(|slot| second.uv - at_corner(triangle + 1, slot).uv),
        ];
        Some(Self {
            placed: PlacedRectangle::new(corner, ex, ey),
            ex,
            ey,
            corner: SurfacePoint { p_err: first.p_err.max(second.p_err), ..first },
            center: corner + 0.5 * (ex + ey),
            far_squared: (FAR * (ex + ey).length()).powi(2),
            ends: [(first.p, first.uv), (second.p, second.uv)],
            uv_edges,
        })
    }

    /// The rectangle as a part of the sphere of directions; `None` where it is to be sampled by area.
    #[inline]
    fn seen_from(&self, p: Vec3) -> Option<SphericalRectangle> {
        self.is_near(p).then(|| SphericalRectangle::new(&self.placed, p)).flatten()
    }

    #[inline]
    fn is_near(&self, p: Vec3) -> bool {
        self.center.distance_squared(p) < self.far_squared
    }

    /// The point at `corner + st.x ex + st.y ey`. Its error bound is the greatest of the rectangle; its shading normal
    /// is the corner's, which light does not depend on.
    #[inline]
    fn point(&self, st: Vec2) -> SurfacePoint {
        let is_second = st.x + st.y > 1.0;
        let (p, uv) = self.ends[usize::from(is_second)];
        let [du, dv] = self.uv_edges[usize::from(is_second)];
        let st = if is_second { st - 1.0 } else { st };
        SurfacePoint {
            p: p + self.ex * st.x + self.ey * st.y,
            uv: uv + du * st.x + dv * st.y,
            primitive: self.corner.primitive + u32::from(is_second),
            ..self.corner
        }
    }
}
