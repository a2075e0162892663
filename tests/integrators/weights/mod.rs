//! The weights of all strategies on the same explicit path.
//!
//! Paths are drawn from the camera, by scattering; their last vertex lies on a light, in the environment, or at a sampled light point. Each
//! is then taken to pieces in all ways: for each strategy (s, t) the sums are carried along both subpaths by the code that renders, and
//! the weight is compared with Veach's definition, from the densities of all strategies, each multiplied out in f64 vertex by
//! vertex. Nothing is random about the comparison: the limit of 1e-5 covers the f32 of positions and densities.
//!
//! Here are the explicit path and its weights; `drawing` draws paths and compares, `settings` has the scenes and the tests.

mod drawing;
mod settings;

use glam::{Vec2, Vec3};
use helmholtz::integrators::weights::Weights;
use helmholtz::query::Ray;
use helmholtz::scene::{Rgb, SurfacePoint};
use helmholtz::transport::World;
use helmholtz::transport::bsdf::TransportMode;
use helmholtz::transport::camera::{CameraConnection, LensHit};
use helmholtz::transport::lights::{LeSample, LiSample, LightId};
use helmholtz::transport::mis::{Flight, Heuristic, Partials};
use helmholtz::transport::vertex::{Scatter, SurfaceVertex};

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

    /// Whether two neighbours that can be connected lie between refractions.
    fn can_connect_behind_deltas(&self) -> bool {
        let is_crossed = |inner: &Inner| inner.is_delta && inner.eta != 1.0;
        self.inner
            .windows(4)
            .any(|w| is_crossed(&w[0]) && !w[1].is_delta && !w[2].is_delta && is_crossed(&w[3]))
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
                let light = world.lights.sample_li(&vertex.point, 0.5, Vec2::splat(0.5));
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
