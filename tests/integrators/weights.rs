//! The weights of all strategies on the same explicit path.
//!
//! Paths are drawn from the camera, by scattering; their last vertex lies on a light, in the environment, or at a sampled light point. Each
//! is then taken to pieces in all ways: for each strategy (s, t) the sums are carried along both subpaths by the code that renders, and
//! the weight is compared with Veach's definition, from the densities of all strategies, each multiplied out in f64 vertex by
//! vertex. Nothing is random about the comparison: the limit of 1e-5 covers the f32 of positions and densities.

use glam::{DAffine3, DMat3, DVec2, DVec3, UVec2, Vec2, Vec3};
use helmholtz::integrators::weights::Weights;
use helmholtz::query::{Hit, Ray, RayQuery};
use helmholtz::scene::{
    Emitter, EnvironmentMap, Lens, Material, MaterialId, Microfacet, Perturbation, PixelRect, Principled,
    Rgb, Scene, Spot, SurfacePoint, TriangleMesh,
};
use helmholtz::transport::World;
use helmholtz::transport::bsdf::Materials;
use helmholtz::transport::bsdf::TransportMode;
use helmholtz::transport::camera::{CameraConnection, LensHit};
use helmholtz::transport::lights::{LeSample, LiSample, LightId};
use helmholtz::transport::mis::{Flight, Heuristic, Partials};
use helmholtz::transport::vertex::{Scatter, SurfaceVertex};

use crate::backends::{BackendTest, on_first_backend};
use crate::scene_builder::{Build, diffuse, empty, image, quad, scaled, sphere};
use crate::statistics::Random;

const LIGHT_PATHS: f64 = 64.0;

/// A vertex on a surface as both subpaths know it, and the event there if both neighbours belong to one subpath.
struct Inner<'a> {
    /// `wo` towards the light.
    from_light: SurfaceVertex<'a>,
    /// `wo` towards the eye.
    from_eye: SurfaceVertex<'a>,
    is_delta: bool,
    /// Index of refraction on the light's side over that on the eye's side.
    eta: f32,
}

/// Where a path begins.
struct LightEnd {
    light: LightId,
    /// None for what is not a surface.
    point: Option<SurfacePoint>,
    /// Position of a point or spot light or of `point`.
    p: Vec3,
    /// Direction from the light to the next vertex.
    d: Vec3,
    is_infinite: bool,
}

/// A path from a light to the lens; `inner[0]` is next to the light.
struct ExplicitPath<'a> {
    light: LightEnd,
    inner: Vec<Inner<'a>>,
    lens: Vec3,
}

fn distance_squared(a: Vec3, b: Vec3) -> f64 {
    a.as_dvec3().distance_squared(b.as_dvec3())
}

fn cos(n: Vec3, d: Vec3) -> f64 {
    n.as_dvec3().dot(d.as_dvec3()).abs()
}

impl ExplicitPath<'_> {
    /// Vertices, lens and light included.
    fn len(&self) -> usize {
        self.inner.len() + 2
    }

    /// Position of vertex `i`, counted from the light, 1 to `len - 1`; and 0 if the light is not infinitely far away.
    fn p(&self, i: usize) -> Vec3 {
        match i {
            0 => self.light.p,
            _ if i == self.len() - 1 => self.lens,
            _ => self.inner[i - 1].from_eye.point.p,
        }
    }

    /// Unit direction from vertex `i` to the next one towards the lens.
    fn d(&self, i: usize) -> Vec3 {
        if i == 0 { self.light.d } else { (self.p(i + 1) - self.p(i)).normalize() }
    }

    /// Density per area at vertex `to` of a direction with density `pdf_w` at its neighbour.
    fn per_area(&self, world: &World, pdf_w: f64, from: usize, to: usize) -> f64 {
        let d = self.d(from.min(to));
        if to == 0 && self.light.is_infinite {
            return pdf_w;
        }
        let cos = match to {
            0 => self.light.point.map_or(1.0, |point| cos(point.ng, d)),
            _ if to == self.len() - 1 => cos(world.camera.forward(), d),
            _ => cos(self.inner[to - 1].from_eye.point.ng, d),
        };
        // Parallel light and parallel camera rays do not spread.
        if from == 0 && self.light.is_infinite || from == self.len() - 1 && world.camera.is_parallel() {
            return pdf_w * cos;
        }
        pdf_w * cos / distance_squared(self.p(from), self.p(to))
    }

    /// Density with which a subpath from the light (or else from the lens) goes on at inner vertex `i`.
    fn scattering(&self, i: usize, from_light: bool) -> f64 {
        let inner = &self.inner[i - 1];
        let (next, vertex, mode) = if from_light {
            (self.d(i), &inner.from_light, TransportMode::Importance)
        } else {
            (-self.d(i - 1), &inner.from_eye, TransportMode::Radiance)
        };
        if !inner.is_delta {
            return f64::from(vertex.pdf_w(next, mode));
        }
        // A delta: 1 seen from the light's side. From the other it is denser by how much solid angle shrinks: n^2 cos dw is conserved.
        if from_light {
            return 1.0;
        }
        let (cos_light, cos_eye) = (cos(vertex.point.ng, self.d(i - 1)), cos(vertex.point.ng, self.d(i)));
        let eta = f64::from(inner.eta);
        eta * eta * cos_light / cos_eye
    }

    fn is_delta(&self, i: usize) -> bool {
        (1..self.len() - 1).contains(&i) && self.inner[i - 1].is_delta
    }

    /// Density times number of samples of strategy (s, t), by definition.
    fn density(&self, world: &World, s: usize) -> f64 {
        let n = self.len();
        let t = n - s;
        let lights = &world.lights;
        let light_is_delta = lights.is_delta(self.light.light);
        let exists = match (s, t) {
            (0, _) => !light_is_delta,
            (_, 0) => !world.camera.is_delta(),
            _ => !self.is_delta(s - 1) && !self.is_delta(s),
        };
        if !exists || (n == 2 && light_is_delta) {
            return 0.0;
        }
        let ng = self.light.point.map(|p| p.ng);
        let (pdf_position, pdf_direction) = lights.pdf_le(self.light.light, ng, self.light.d);
        let (pdf_position, pdf_direction) = (f64::from(pdf_position), f64::from(pdf_direction));
        // Of the first vertex alone, and of the second given the first.
        let (first, second) = if self.light.is_infinite {
            // Of the direction, or of the choice of this one; then of the place.
            let first = f64::from(lights.pdf_li_of_start(&self.start(world), self.p(1)));
            (first, pdf_position * pdf_direction / first)
        } else {
            (pdf_position, pdf_direction)
        };
        let light_side = match s {
            0 => 1.0,
            1 if t == 1 || light_is_delta || self.light.is_infinite => first,
            1 => match &self.light.point {
                Some(point) => {
                    let pdf_w = lights.pdf_li(self.light.light, self.p(1), point, -self.light.d);
                    self.per_area(world, f64::from(pdf_w), 1, 0)
                }
                None => unreachable!("a light that is no point, not infinite and no surface"),
            },
            _ => {
                let start = first * self.per_area(world, second, 0, 1);
                (1..s - 1)
                    .map(|i| self.per_area(world, self.scattering(i, true), i, i + 1))
                    .fold(start, |product, pdf| product * pdf)
            }
        };
        let area = f64::from(world.camera.lens_area());
        let eye_side = match t {
            0 => 1.0,
            1 => 1.0 / area,
            _ => {
                let pdf_w = f64::from(world.camera.pdf_we_w(self.lens, -self.d(n - 2)));
                let start = self.per_area(world, pdf_w, n - 1, n - 2) / area;
                (s + 1..n - 1)
                    .map(|i| self.per_area(world, self.scattering(i, false), i, i - 1))
                    .fold(start, |product, pdf| product * pdf)
            }
        };
        light_side * eye_side * if t < 2 { LIGHT_PATHS } else { 1.0 }
    }

    /// The sums at the end of the light subpath with `s` vertices, at least 2. The last may be the lens.
    fn light_partials(&self, weights: &Weights, start: &LeSample, s: usize) -> Partials {
        let h = weights.heuristic;
        let n = self.len();
        let cos_at = |i: usize| {
            let d = self.d(i - 1);
            let n = if i == n - 1 {
                weights.world.camera.forward()
            } else {
                self.inner[i - 1].from_light.point.ng
            };
            n.dot(d).abs()
        };
        let mut partials = weights.first_light_vertex(start, self.p(1), cos_at(1), n == 2);
        for i in 1..s - 1 {
            let inner = &self.inner[i - 1];
            let scatter = self.scatter(i, &inner.from_light, self.d(i), TransportMode::Importance);
            let turn = inner.from_light.turn(cos_at(i), &scatter, TransportMode::Importance);
            let flight = h.leave(&partials, &turn);
            partials = h.arrive(flight, self.p(i).distance_squared(self.p(i + 1)), cos_at(i + 1));
        }
        partials
    }

    fn scatter(&self, i: usize, vertex: &SurfaceVertex, wi: Vec3, mode: TransportMode) -> Scatter {
        let inner = &self.inner[i - 1];
        let eta = if mode == TransportMode::Radiance { inner.eta } else { 1.0 / inner.eta };
        Scatter { wi, weight: Rgb::ONE, pdf_w: vertex.pdf_w(wi, mode), is_delta: inner.is_delta, eta }
    }

    /// What leaves the last vertex but one of an eye subpath that ends at vertex `s`.
    fn eye_flight(&self, weights: &Weights, s: usize) -> Flight {
        let n = self.len();
        let (h, mode) = (weights.heuristic, TransportMode::Radiance);
        let mut flight = weights.leave_camera(&Ray::new(self.lens, -self.d(n - 2)));
        for i in (s + 1..n - 1).rev() {
            let vertex = &self.inner[i - 1].from_eye;
            let cos_in = vertex.cos(self.d(i));
            let partials = h.arrive(flight, self.spread(weights.world, i), cos_in);
            let scatter = self.scatter(i, vertex, -self.d(i - 1), mode);
            flight = h.leave(&partials, &vertex.turn(cos_in, &scatter, mode));
        }
        flight
    }

    fn eye_partials(&self, weights: &Weights, s: usize) -> Partials {
        let ng = match s {
            0 => self.light.point.expect("a surface").ng,
            _ => self.inner[s - 1].from_eye.point.ng,
        };
        let flight = self.eye_flight(weights, s);
        weights.heuristic.arrive(flight, self.spread(weights.world, s), ng.dot(self.d(s)).abs())
    }

    /// By how much an eye subpath has spread when it arrives at vertex `i`.
    fn spread(&self, world: &World, i: usize) -> f32 {
        if i == self.len() - 2 && world.camera.is_parallel() {
            1.0
        } else {
            self.p(i).distance_squared(self.p(i + 1))
        }
    }

    /// The start of a light path as it would have been drawn.
    fn start(&self, world: &World) -> LeSample {
        let ng = self.light.point.map(|p| p.ng);
        let (pdf_position, pdf_direction_w) = world.lights.pdf_le(self.light.light, ng, self.light.d);
        LeSample {
            light: self.light.light,
            ray: Ray::new(self.light.p, self.light.d),
            point: self.light.point,
            radiance: Rgb::ONE,
            cos: ng.map_or(1.0, |ng| ng.dot(self.light.d)),
            pdf_position,
            pdf_direction_w,
        }
    }

    /// The weight of strategy (s, t) as the renderer computes it.
    fn weight(&self, weights: &Weights, s: usize) -> f64 {
        let world = weights.world;
        let (n, start) = (self.len(), self.start(world));
        let t = n - s;
        let connection = |i: usize| {
            if i == 0 && self.light.is_infinite {
                world.camera.sample_distant(-self.d(0), Vec2::ZERO).expect("in front").0
            } else {
                world.camera.sample_wi(self.p(i), Vec2::ZERO).expect("in front")
            }
        };
        // The lens point is that of the path, not the one that is sampled. (Of parallel rays there is but one.)
        let connection = |i: usize| {
            if world.camera.is_parallel() {
                return connection(i);
            }
            let d = -self.d(i);
            let (importance, film) = world.camera.we(self.lens, d).expect("in front");
            CameraConnection {
                p: self.lens,
                d,
                importance,
                film,
                cos: d.dot(world.camera.forward()),
                ..connection(i)
            }
        };
        let others = match (s, t) {
            (0, _) if self.light.is_infinite => {
                weights.environment_hit_others(self.eye_flight(weights, 0), self.light.light, -self.light.d)
            }
            (0, _) => {
                let point = self.light.point.expect("a surface");
                let partials = self.eye_partials(weights, 0);
                weights.light_hit_others(
                    &partials,
                    (self.light.light, &point),
                    self.light.d,
                    self.p(1),
                    n == 2,
                )
            }
            (_, 0) => {
                let partials = self.light_partials(weights, &start, s);
                let c = connection(s - 2);
                let lens = LensHit { film: c.film, t: 0.0, importance: c.importance, cos: c.cos };
                weights.lens_hit_others(&partials, &lens)
            }
            (1, 1) => weights.start_seen_others(&start, &connection(0)),
            (1, _) => {
                let vertex = &self.inner[0].from_eye;
                let scattered = vertex.evaluate(-self.light.d, TransportMode::Radiance).expect("light");
                let light = world.lights.sample_li(&vertex.point, [0.5; 3]);
                let light = LiSample {
                    light: self.light.light,
                    wi: -self.light.d,
                    ng: self.light.point.map(|p| p.ng),
                    pdf_w: world.lights.pdf_li_of_start(&start, vertex.point.p),
                    is_delta: world.lights.is_delta(self.light.light),
                    radiance: Rgb::ONE,
                    shadow_ray: light.map_or(start.ray, |l| l.shadow_ray),
                };
                weights.light_sampled_others((vertex, &self.eye_partials(weights, 1)), &light, &scattered)
            }
            (_, 1) => {
                let vertex = &self.inner[s - 2].from_light;
                let scattered = vertex.evaluate(self.d(s - 1), TransportMode::Importance).expect("light");
                let partials = self.light_partials(weights, &start, s);
                weights.lens_sampled_others((vertex, &partials), &connection(s - 1), &scattered)
            }
            _ => {
                let (eye, light) = (&self.inner[s - 1].from_eye, &self.inner[s - 2].from_light);
                let d = self.d(s - 1);
                let eye_side = eye.evaluate(-d, TransportMode::Radiance).expect("light");
                let light_side = light.evaluate(d, TransportMode::Importance).expect("light");
                weights.connected_others(
                    (eye, &self.eye_partials(weights, s), &eye_side),
                    (light, &self.light_partials(weights, &start, s), &light_side),
                    d,
                    self.p(s - 1).distance_squared(self.p(s)),
                )
            }
        };
        1.0 / (1.0 + others)
    }

    /// Compares all weights with their definition.
    fn check(&self, name: &str, world: &World, heuristic: Heuristic) {
        let weights = Weights {
            world,
            heuristic,
            light_paths: LIGHT_PATHS,
            has_eye_paths: true,
            connects_lens: true,
            hits_lens: !world.camera.is_delta(),
        };
        let densities: Vec<f64> = (0..=self.len()).map(|s| self.density(world, s)).collect();
        let greatest = densities.iter().copied().fold(0.0, f64::max);
        let raised: Vec<f64> = densities.iter().map(|p| heuristic.raise(p / greatest)).collect();
        let sum: f64 = raised.iter().sum();
        let mut total = 0.0;
        for (s, raised) in raised.iter().enumerate().filter(|(_, raised)| **raised > 0.0) {
            let (weight, expected) = (self.weight(&weights, s), raised / sum);
            total += weight;
            let t = self.len() - s;
            assert!(
                (weight - expected).abs() < 1e-5,
                "{name}, {heuristic:?}: strategy ({s}, {t}) has weight {weight}, expected {expected}; {densities:?}"
            );
        }
        assert!((total - 1.0).abs() < 1e-5, "{name}: weights sum to {total}; {densities:?}");
    }
}

/// A vertex of an eye path that is being drawn, with the event that led on from it.
struct Drawn<'a> {
    vertex: SurfaceVertex<'a>,
    hit: Hit,
    is_delta: bool,
    eta: f32,
}

/// Puts a path together from the light's end and vertices counted from the eye.
fn assemble<'a>(
    materials: &'a Materials<'a>,
    light: LightEnd,
    drawn: Vec<Drawn>,
    lens: Vec3,
) -> ExplicitPath<'a> {
    // Directions from the positions themselves: a spawned ray starts a little beside its vertex.
    let seen_by =
        |hit: &Hit, p: Vec3, d: Vec3| SurfaceVertex::new(materials, &Hit { t: 0.0, ..*hit }, &Ray::new(p, d));
    let positions: Vec<Vec3> =
        std::iter::once(lens).chain(drawn.iter().map(|drawn| drawn.vertex.point.p)).collect();
    let mut inner = Vec::new();
    for (i, Drawn { hit, is_delta, eta, .. }) in drawn.into_iter().enumerate() {
        let p = positions[i + 1];
        let from_eye = seen_by(&hit, p, (p - positions[i]).normalize());
        let d = positions.get(i + 2).map_or(light.d, |next| (p - next).normalize());
        inner.push(Inner { from_light: seen_by(&hit, p, d), from_eye, is_delta, eta });
    }
    inner.reverse();
    ExplicitPath { light, inner, lens }
}

/// Draws a path from the camera and calls `found` wherever it meets a light, and once for a light point sampled at its last vertex.
fn draw<Q: RayQuery>(world: &World, query: &Q, random: &mut Random, mut found: impl FnMut(ExplicitPath)) {
    const GREATEST_LENGTH: usize = 6;
    let (scene, lights) = (world.scene, &world.lights);
    let film = random.uniform_2d() * scene.film.size.as_vec2();
    let camera_ray = world.camera.spawn_ray(film, random.uniform_2d());
    let mut ray = camera_ray;
    let mut drawn: Vec<Drawn> = Vec::new();
    // A path is taken to pieces once, since its vertices are not copied: the last chance is chosen beforehand.
    let length = 1 + (random.uniform() * GREATEST_LENGTH as f32) as usize;
    while drawn.len() < length {
        let Some(hit) = query.intersect(&ray) else {
            // The one direction in which parallel rays see the sky is found by no other strategy.
            let is_found = !(drawn.is_empty() && world.camera.is_parallel());
            if let Some(light) = lights.environment().filter(|_| is_found) {
                let end = LightEnd { light, point: None, p: Vec3::ZERO, d: -ray.d, is_infinite: true };
                found(assemble(&world.materials, end, drawn, camera_ray.o));
            }
            return;
        };
        let vertex = SurfaceVertex::new(&world.materials, &hit, &ray);
        if let Some(light) = lights.light_at(&vertex.point).filter(|_| vertex.point.ng.dot(ray.d) < 0.0) {
            let point = vertex.point;
            // From the vertices themselves: spawned rays start a little beside.
            let from = drawn.last().map_or(camera_ray.o, |last| last.vertex.point.p);
            let d = (from - point.p).normalize();
            let end = LightEnd { light, point: Some(point), p: point.p, d, is_infinite: false };
            found(assemble(&world.materials, end, drawn, camera_ray.o));
            return;
        }
        if drawn.len() + 1 == length {
            let Some(sample) = lights.sample_li(&vertex.point, random.uniform_3d()) else { return };
            let blocked = query.occluded(&sample.shadow_ray);
            // Only lights of no size: the others are met by chance.
            if !sample.is_delta || blocked || vertex.evaluate(sample.wi, TransportMode::Radiance).is_none() {
                return;
            }
            let light = sample.light;
            let is_infinite = sample.shadow_ray.t_max == f32::INFINITY;
            let end = if is_infinite {
                LightEnd { light, point: None, p: Vec3::ZERO, d: -sample.wi, is_infinite }
            } else {
                let p = sample.shadow_ray.o + sample.shadow_ray.d * sample.shadow_ray.t_max;
                LightEnd { light, point: None, p, d: (vertex.point.p - p).normalize(), is_infinite }
            };
            drawn.push(Drawn { vertex, hit, is_delta: false, eta: 1.0 });
            found(assemble(&world.materials, end, drawn, camera_ray.o));
            return;
        }
        let Some(scatter) = vertex.scatter(random.uniform_3d(), TransportMode::Radiance) else { return };
        drawn.push(Drawn { vertex, hit, is_delta: scatter.is_delta, eta: scatter.eta });
        ray = Ray::spawn(&vertex.point, scatter.wi);
    }
}

struct Case<'a> {
    name: String,
    scene: &'a Scene,
    /// Size of the scene, beside that of [`room`].
    scale: f64,
}

impl BackendTest for Case<'_> {
    fn run<Q: RayQuery>(&self, _: &str, query: &Q) {
        let world = World::new(self.scene);
        let mut random = Random::new(7);
        let mut lengths = [0; 9];
        for _ in 0..80_000 {
            draw(&world, query, &mut random, |path| {
                // Where a path grazes a surface or a corner, the f32 of its own cosines is not good to 1e-5.
                let is_grazing = (0..path.len() - 1).any(|i| {
                    let n = |i: usize| path.inner.get(i.wrapping_sub(1)).map(|inner| inner.from_eye.point.ng);
                    let is_short =
                        i > 0 && distance_squared(path.p(i), path.p(i + 1)) < 0.01 * self.scale * self.scale;
                    is_short || [n(i), n(i + 1)].into_iter().flatten().any(|n| cos(n, path.d(i)) < 0.02)
                });
                if !is_grazing {
                    lengths[path.len()] += 1;
                    path.check(&self.name, &world, Heuristic::Balance);
                    path.check(&self.name, &world, Heuristic::Power);
                }
            });
        }
        assert!(lengths[3..7].iter().all(|&n| n > 30), "{}: too few paths, {lengths:?}", self.name);
    }
}

/// Parts of the walls of a room, seen by the camera.
fn walls() -> Scene {
    let mut scene = empty();
    let size = UVec2::splat(8);
    scene.film.size = size;
    scene.film.crop = PixelRect { min: UVec2::ZERO, size };
    scene
        .shape(quad(Vec3::new(-2.0, -1.5, 1.0), Vec3::Z * 5.0, Vec3::X * 4.0), diffuse(0.6), None)
        .shape(quad(Vec3::new(-2.0, -1.5, 6.0), Vec3::Y * 3.0, Vec3::X * 4.0), diffuse(0.5), None)
        .shape(quad(Vec3::new(2.0, -1.5, 1.0), Vec3::Z * 5.0, Vec3::Y * 3.0), diffuse(0.7), None)
}

fn rough_metal(alpha: [f32; 2]) -> Material {
    Material::RoughConductor {
        distribution: Microfacet::Ggx,
        alpha: alpha.map(Into::into),
        eta: Rgb::splat(0.2).into(),
        k: Rgb::splat(3.0).into(),
        specular_reflectance: Rgb::ONE.into(),
    }
}

/// A room with a glass ball, a rough metal ball, a rough glass pane and a smooth-shaded ball.
fn room() -> Scene {
    let glass = Material::Dielectric {
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    let pane = Material::RoughDielectric {
        distribution: Microfacet::Beckmann,
        alpha: [0.3.into(); 2],
        eta: 1.4,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    let (positions, triangles) = crate::support::icosphere(2);
    let normals: Vec<Vec3> = positions.iter().map(|p| p.as_vec3()).collect();
    let positions = crate::support::placed(&positions, 0.5, DVec3::new(0.9, 0.9, 4.4));
    let smooth = TriangleMesh::new(positions, triangles, normals, Vec::new(), false).expect("a valid mesh");
    walls()
        .shape(sphere(Vec3::new(-0.8, -0.7, 4.0), 0.7), glass, None)
        .shape(sphere(Vec3::new(0.9, -0.8, 4.6), 0.6), rough_metal([0.15, 0.3]), None)
        .shape(quad(Vec3::new(-1.2, 0.1, 3.0), Vec3::X * 1.5, Vec3::Y * 1.0), pane, None)
        .shape(helmholtz::scene::Geometry::Mesh(smooth), diffuse(0.8), None)
}

/// A room with balls of the materials that have several lobes, holes or perturbed normals.
fn cabinet() -> Scene {
    let plastic = Material::Plastic {
        roughness: None,
        eta: 1.5,
        diffuse_reflectance: Rgb::splat(0.6).into(),
        specular_reflectance: Rgb::ONE.into(),
        nonlinear: false,
    };
    let principled = Material::Principled(Box::new(Principled {
        base_color: Rgb::new(0.8, 0.5, 0.4).into(),
        roughness: 0.8.into(),
        anisotropic: 0.0.into(),
        metallic: 0.2.into(),
        spec_trans: 0.5.into(),
        spec_tint: 0.3.into(),
        sheen: 0.5.into(),
        sheen_tint: 0.5.into(),
        flatness: 0.3.into(),
        clearcoat: 0.0.into(),
        clearcoat_gloss: 0.0.into(),
        eta: 1.5,
    }));
    let sheet = Material::ThinDielectric {
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    let mut scene = walls();
    let mut part = |material| {
        scene.materials.push(material);
        MaterialId(scene.materials.len() as u32 - 1)
    };
    let (matt, metal) = (part(diffuse(0.7)), part(rough_metal([0.4; 2])));
    let blend = Material::Blend { weight: 0.4.into(), first: matt, second: metal };
    let mask = Material::Mask { opacity: 0.6.into(), material: matt };
    let bumped = Material::Perturbed {
        by: Perturbation::Normal(Rgb::new(0.7, 0.45, 0.9).into()),
        flip_invalid_normals: true,
        use_shadowing_function: false,
        material: matt,
    };
    scene
        .shape(sphere(Vec3::new(-1.2, -0.8, 4.2), 0.6), plastic, None)
        .shape(sphere(Vec3::new(0.0, -0.8, 4.4), 0.55), principled, None)
        .shape(sphere(Vec3::new(1.2, -0.8, 4.2), 0.5), blend, None)
        .shape(sphere(Vec3::new(-1.1, 0.5, 4.4), 0.5), mask, None)
        .shape(sphere(Vec3::new(0.0, 0.6, 4.6), 0.5), bumped, None)
        .shape(sphere(Vec3::new(1.1, 0.5, 4.4), 0.5), sheet, None)
        .shape(quad(Vec3::new(-0.6, -0.4, 3.0), Vec3::X * 1.2, Vec3::Y), Material::Null, None)
}

fn lamp(scene: Scene) -> Scene {
    let corner = Vec3::new(-1.0, 1.4, 3.0);
    scene.shape(quad(corner, Vec3::X * 2.0, Vec3::Z * 1.5), diffuse(0.0), Some(Rgb::splat(4.0)))
}

fn ball_lamp(scene: Scene) -> Scene {
    scene.shape(sphere(Vec3::new(0.3, 1.8, 3.4), 0.8), diffuse(0.0), Some(Rgb::splat(9.0)))
}

fn point_light(scene: Scene) -> Scene {
    scene.emitter(Emitter::Point { position: Vec3::new(-0.3, 1.2, 3.0), intensity: Rgb::ONE })
}

fn spot(scene: Scene) -> Scene {
    let axis = Vec3::new(0.1, -1.0, 1.2).normalize();
    let position = Vec3::new(-0.3, 1.2, 2.5);
    let spot = Spot { position, axis, intensity: Rgb::splat(3.0), cutoff: 1.0, beam_width: 0.6 };
    scene.emitter(Emitter::Spot(spot))
}

fn directional(scene: Scene) -> Scene {
    let direction = Vec3::new(0.3, -1.0, 0.8).normalize();
    scene.emitter(Emitter::Directional { direction, irradiance: Rgb::splat(2.0) })
}

fn environment(scene: Scene) -> Scene {
    scene.emitter(Emitter::Constant { radiance: Rgb::splat(0.4) })
}

fn map(scene: Scene) -> Scene {
    let texels = (0..8 * 5).map(|i| [0.2 + (i % 7) as f32; 3]).collect();
    let turn = DMat3::from_rotation_x(0.5);
    let map = EnvironmentMap::new(image(UVec2::new(8, 5), texels), 0.3, turn).expect("a valid map");
    scene.emitter(Emitter::Map(map))
}

fn pinhole(scene: Scene) -> Scene {
    scene
}

fn thin_lens(mut scene: Scene) -> Scene {
    scene.camera.lens = Lens::Thin { aperture_radius: 0.2, focus_distance: 4.0 };
    scene
}

/// From the side a little, so that no axis is special; pixels are not square.
fn orthographic(mut scene: Scene) -> Scene {
    scene.camera.lens = Lens::Orthographic;
    scene.camera.to_world = DAffine3::from_rotation_y(0.2)
        * DAffine3::from_rotation_x(-0.1)
        * DAffine3::from_scale(DVec3::new(1.5, 1.2, 1.0));
    scene
}

/// A window of a larger film, with the principal point moved.
fn crop(mut scene: Scene) -> Scene {
    scene.film.size = UVec2::new(24, 16);
    scene.film.crop.min = UVec2::new(9, 3);
    scene.camera.principal_point = DVec2::new(0.1, -0.05);
    thin_lens(scene)
}

/// Makes a scene of another: a light or a camera.
type Change = fn(Scene) -> Scene;

/// Every kind of light and of camera, with the two rooms.
const CASES: [(&str, fn() -> Scene, &[Change], Change); 15] = [
    ("area light, pinhole", room, &[lamp], pinhole),
    ("area light, lens", room, &[lamp], thin_lens),
    ("point light, pinhole", room, &[point_light], pinhole),
    ("point light, lens", room, &[point_light], thin_lens),
    ("environment, pinhole", room, &[environment], pinhole),
    ("environment, lens", room, &[environment], thin_lens),
    ("sphere, orthographic", room, &[ball_lamp], orthographic),
    ("spot, crop", room, &[spot], crop),
    ("directional, orthographic", room, &[directional], orthographic),
    ("map, lens", room, &[map], thin_lens),
    ("map, orthographic", room, &[map], orthographic),
    ("all lights, lens", room, &[map, directional, spot, point_light, ball_lamp, lamp], thin_lens),
    ("several lobes, lens", cabinet, &[lamp, point_light], thin_lens),
    ("several lobes, sky, orthographic", cabinet, &[map, spot], orthographic),
    ("several lobes, sky, crop", cabinet, &[environment, directional], crop),
];

fn build(room: fn() -> Scene, lights: &[Change], camera: Change) -> Scene {
    camera(lights.iter().fold(room(), |scene, light| light(scene)))
}

#[test]
fn weights_are_as_defined_and_sum_to_one() {
    for (name, room, lights, camera) in CASES {
        let scene = build(room, lights, camera);
        on_first_backend(&scene.shapes, &Case { name: name.to_owned(), scene: &scene, scale: 1.0 });
    }
}

/// The same at other scales: every ratio is the same, so every weight is. (Number 10 of [`super`].)
#[test]
fn weights_survive_scale() {
    for exponent in [-6, 6] {
        let scale = 10f64.powi(exponent);
        for (name, room, lights, camera) in [
            (
                "area and point lights, lens",
                room as fn() -> Scene,
                &[lamp as Change, point_light][..],
                thin_lens as Change,
            ),
            ("spot and sky, orthographic", room, &[spot, map], orthographic),
            ("several lobes, sky, pinhole", cabinet, &[environment, directional], pinhole),
        ] {
            let scene = scaled(build(room, lights, camera), scale);
            let name = format!("{name}, scaled by 1e{exponent}");
            on_first_backend(&scene.shapes, &Case { name, scene: &scene, scale });
        }
    }
}
