//! What integrators share: scattering, emission, camera importance, the subpath walk and MIS weights.
//!
//! Directions `wo` (towards where the path came from) and `wi` (where it goes on) point away from the surface.
//! Densities are per area unless a name says `_w` (solid angle). Everything that scatters is told its
//! [`TransportMode`](bsdf::TransportMode), because refraction and shading normals treat radiance and importance differently.
//!
//! Flux when placing, importance when connecting: what a light path carries to a vertex is flux, and what leaves the vertex for where something looks at it is that
//! flux scattered in mode `Importance`. So a vertex of a light path can be stored and looked at (as a virtual point light, or by a connection) without a cosine or a
//! squared index too many: `eval(b, Importance)` at a vertex reached from `a`, times its geometric cosine to `a`, is the same as `eval(a, Radiance)` reached from `b`, times that to `b`.
//! A photon, which is looked at in place, instead keeps its flux per area, and its BSDF is that of radiance.
//!
//! Nothing here decides which paths are made: that is an integrator's whole business.

pub mod bsdf;
pub mod camera;
pub mod lights;
pub mod mis;
pub mod vertex;
pub mod walk;

use glam::{UVec2, Vec3};

use crate::scene::{Aabb, Scene};
use bsdf::Materials;
use camera::CameraModel;
use lights::Lights;

/// A scene with what light transport derives from it once: materials, light distribution and camera.
pub struct World<'s> {
    /// What the file says.
    pub scene: &'s Scene,
    /// Materials, ready to become BSDFs.
    pub materials: Materials<'s>,
    /// Emitters, ready to be sampled.
    pub lights: Lights<'s>,
    /// Camera, ready to be sampled.
    pub camera: CameraModel,
    /// Around shapes and camera.
    pub bounds: BoundingSphere,
}

impl<'s> World<'s> {
    /// Prepares a scene.
    pub fn new(scene: &'s Scene) -> Self {
        Self::for_film(scene, scene.film.size)
    }

    /// Prepares a scene whose environment map is sampled in so many columns, from 2 on, whatever it says itself.
    pub fn with_sampling_columns(scene: &'s Scene, columns: u32) -> Self {
        Self::prepare(scene, scene.film.size, Some(columns))
    }

    /// Prepares a scene as seen through a film of another size in pixels.
    pub fn for_film(scene: &'s Scene, film_size: UVec2) -> Self {
        Self::prepare(scene, film_size, None)
    }

    fn prepare(scene: &'s Scene, film_size: UVec2, sampling_columns: Option<u32>) -> Self {
        let bounds = scene.shapes.iter().fold(Aabb::EMPTY, |b, s| b.union(s.geometry.bounds()));
        let camera = CameraModel::new(&scene.camera, film_size);
        let bounds = BoundingSphere::new(bounds, &camera);
        let materials = Materials::new(scene);
        let lights = Lights::new(scene, bounds, sampling_columns);
        Self { scene, materials, lights, camera, bounds }
    }
}

/// A sphere around everything that light can reach and be seen from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundingSphere {
    /// World position.
    pub center: Vec3,
    /// Positive, so that a scene without shapes has a finite flux from its environment.
    pub radius: f32,
}

impl BoundingSphere {
    fn new(shapes: Aabb, camera: &CameraModel) -> Self {
        // The lens belongs to the scene: distant light must be able to hit it.
        let (center, radius) = shapes.extend(camera.position()).bounding_sphere();
        let margin = 1.0 + 1e-5;
        Self { center, radius: if radius > 0.0 { radius * margin } else { 1.0 } }
    }
}
