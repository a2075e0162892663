//! Small scenes, elsewhere or otherwise, rendered by each integrator, and what their images are held against.

use glam::{DAffine3, DVec3, UVec2, Vec3};

use super::solids::{Solid, quad};
use super::{Bench, SelftestError, Task};
use crate::film::{AovSet, Film};
use crate::integrators::{Integrator, IntegratorError};
use crate::query::RayQuery;
use crate::render::{Control, RenderError, Stop, Target, render};
use crate::scene::{
    AnalyticKind, AnalyticShape, Emitter, Geometry, Lens, Material, MaterialId, Microfacet, Rgb, Scene,
    Shape, Spot, TriangleMesh,
};
use crate::transport::World;

/// An integrator: its name, and parameters as text.
pub(super) type Algorithm = (&'static str, &'static [(&'static str, &'static str)]);

/// Each integrator with parameters for small scenes. Radii are the default ones, which go with the size of the scene, or follow from the photons.
pub(super) const INTEGRATORS: [Algorithm; 6] = [
    ("path", &[("max_depth", "8")]),
    ("ptracer", &[("max_depth", "8")]),
    ("bdpt", &[("max_depth", "8")]),
    ("photonmapper", &[("max_depth", "8"), ("photons", "4000"), ("lookup", "knn"), ("k", "30")]),
    ("sppm", &[("max_depth", "8"), ("photons", "4000")]),
    ("vpl", &[("max_depth", "8"), ("count", "10")]),
];

/// The same with radii that make little noise, given in world units: for scenes of unit size.
pub(super) const AT_UNIT_SIZE: [Algorithm; 6] = [
    INTEGRATORS[0],
    INTEGRATORS[1],
    INTEGRATORS[2],
    INTEGRATORS[3],
    ("sppm", &[("max_depth", "8"), ("photons", "4000"), ("radius", "0.1")]),
    INTEGRATORS[5],
];

/// An integrator by its name and parameters.
pub(super) fn integrator(name: &str, parameters: &[(&str, &str)]) -> Result<Integrator, IntegratorError> {
    let owned = |&(key, value): &(&str, &str)| (key.to_owned(), value.to_owned());
    Integrator::new(name, &parameters.iter().map(owned).collect::<Vec<_>>())
}

/// A scene of `size` pixels without shapes, seen from the origin along +z.
pub(super) fn empty(size: u32) -> Scene {
    Scene::empty(UVec2::splat(size), 60.0)
}

/// Adds a shape with a material of its own.
pub(super) fn add(scene: &mut Scene, geometry: Geometry, material: Material, emission: Option<Rgb>) {
    let id = MaterialId(scene.materials.len() as u32);
    scene.materials.push(material);
    let name = format!("shape{}", scene.shapes.len());
    scene.shapes.push(Shape { name, geometry, material: id, emission: emission.map(Into::into) });
}

/// A diffuse material.
pub(super) fn diffuse(albedo: f32) -> Material {
    Material::Diffuse { reflectance: Rgb::splat(albedo).into() }
}

/// A sphere, whose normal points inwards if it is `hollow`.
pub(super) fn sphere(center: DVec3, radius: f64, hollow: bool) -> Result<Geometry, SelftestError> {
    let to_world = DAffine3::from_translation(center) * DAffine3::from_scale(DVec3::splat(radius));
    let sphere = AnalyticShape::new(AnalyticKind::Sphere, to_world, hollow);
    Ok(Geometry::Analytic(sphere.ok_or(SelftestError::Shape)?))
}

/// A closed box with walls of grey and rust, lit by a lamp below its ceiling and by a point light, with a ball of glass, one of rough metal and a coarse ball with the normals
/// of a smooth one; through a thin lens. Everything is within 2 of the origin.
pub(super) fn room(size: u32) -> Result<Scene, SelftestError> {
    let mut scene = empty(size);
    scene.camera.lens = Lens::Thin { aperture_radius: 0.05, focus_distance: 1.8 };
    scene.camera.to_world = DAffine3::from_translation(DVec3::new(0.125, 0.0, -0.875));
    let mut walls = Solid::gridded_cube(2).placed(1.0, DVec3::ZERO)?;
    walls = inside_out(&walls)?;
    add(&mut scene, Geometry::Mesh(walls), diffuse(0.6), None);
    let lamp = quad(DVec3::new(-0.4, 0.95, -0.3), DVec3::X * 0.8, DVec3::Z * 0.6)?;
    add(&mut scene, Geometry::Mesh(lamp), diffuse(0.0), Some(Rgb::new(5.0, 4.0, 3.0)));
    let glass = Material::Dielectric {
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    add(&mut scene, sphere(DVec3::new(-0.5, -0.6, 0.4), 0.35, false)?, glass, None);
    let metal = Material::RoughConductor {
        distribution: Microfacet::Ggx,
        alpha: [0.2.into(), 0.2.into()],
        eta: Rgb::splat(0.2).into(),
        k: Rgb::splat(3.0).into(),
        specular_reflectance: Rgb::ONE.into(),
    };
    add(&mut scene, sphere(DVec3::new(0.5, -0.65, 0.5), 0.3, false)?, metal, None);
    let ball = Solid::icosphere(2);
    let normals = ball.positions.iter().map(|p| p.as_vec3()).collect();
    let flat = ball.placed(0.3, DVec3::new(0.1, 0.2, 0.6))?;
    let (positions, triangles) = (flat.positions().to_vec(), flat.triangles().to_vec());
    let smooth = TriangleMesh::new(positions, triangles, normals, Vec::new(), false)?;
    add(&mut scene, Geometry::Mesh(smooth), diffuse(0.8), None);
    let (position, intensity) = (Vec3::new(-0.7, 0.5, -0.2), Rgb::new(0.1, 0.2, 0.3));
    scene.emitters.push(Emitter::Point { position, intensity });
    Ok(scene)
}

/// Radiance that walls in the furnace emit, and their albedo; seen from inside they have `FURNACE_RADIANCE`.
const FURNACE: (f32, f32) = (0.5, 0.5);
/// Le / (1 - albedo), wherever one looks and whatever the shape, so long as it is closed.
pub(super) const FURNACE_RADIANCE: f64 = 1.0;

/// The inside of the cube [-1, 1]^3 under an affine map, glowing, and a camera in it. The camera is turned as the map does, unless this is more than a rotation and a mirror.
pub(super) fn furnace(map: &DAffine3, is_rotation: bool, size: u32) -> Result<Scene, SelftestError> {
    let mut scene = empty(size);
    let walls = inside_out(&Solid::gridded_cube(1).placed(1.0, DVec3::ZERO)?)?;
    add(&mut scene, Geometry::Mesh(walls), diffuse(FURNACE.1), Some(Rgb::splat(FURNACE.0)));
    scene.camera.to_world = DAffine3::from_translation(DVec3::new(0.1, -0.2, 0.3));
    let mut scene = moved(scene, map)?;
    if !is_rotation {
        scene.camera.to_world.matrix3 = glam::DMat3::IDENTITY;
    }
    Ok(scene)
}

/// The mesh with its normals turned over.
fn inside_out(mesh: &TriangleMesh) -> Result<TriangleMesh, SelftestError> {
    let (positions, triangles) = (mesh.positions().to_vec(), mesh.triangles().to_vec());
    let (normals, uvs) = (mesh.normals().to_vec(), mesh.uvs().to_vec());
    Ok(TriangleMesh::new(positions, triangles, normals, uvs, !mesh.flip_normals())?)
}

/// Everything in a scene, the camera included, under an affine map; computed in f64 and rounded once. A similarity keeps radiance: intensities of point and spot lights
/// grow by the square of its scale. A camera takes similarities only, an environment map stays as it is, and so do instances.
///
/// # Errors
/// If that leads out of the range of coordinates.
pub fn moved(mut scene: Scene, map: &DAffine3) -> Result<Scene, SelftestError> {
    let is_mirror = map.matrix3.determinant() < 0.0;
    for shape in &mut scene.shapes {
        shape.geometry = match &shape.geometry {
            Geometry::Mesh(mesh) => {
                let at = |p: &Vec3| map.transform_point3(p.as_dvec3()).as_vec3();
                // Normals go by the inverse transpose, and then keep their side; vertices in order change it under a mirror.
                let turn = map.matrix3.inverse().transpose();
                let normal = |n: &Vec3| (turn * n.as_dvec3()).normalize_or_zero().as_vec3();
                let flip = mesh.flip_normals() ^ (is_mirror && mesh.normals().is_empty());
                Geometry::Mesh(TriangleMesh::new(
                    mesh.positions().iter().map(at).collect(),
                    mesh.triangles().to_vec(),
                    mesh.normals().iter().map(normal).collect(),
                    mesh.uvs().to_vec(),
                    flip,
                )?)
            }
            Geometry::Analytic(analytic) => {
                let to_world = *map * *analytic.to_world();
                let placed = AnalyticShape::new(analytic.kind(), to_world, analytic.flip_normals());
                Geometry::Analytic(placed.ok_or(SelftestError::Shape)?)
            }
            Geometry::Instance(instance) => Geometry::Instance(instance.clone()),
        };
    }
    let scale = map.matrix3.determinant().abs().cbrt();
    for emitter in &mut scene.emitters {
        match emitter {
            Emitter::Point { position, intensity } | Emitter::Spot(Spot { position, intensity, .. }) => {
                *position = map.transform_point3(position.as_dvec3()).as_vec3();
                *intensity *= (scale * scale) as f32;
            }
            Emitter::Directional { .. } | Emitter::Constant { .. } | Emitter::Map(_) => {}
        }
        match emitter {
            Emitter::Spot(Spot { axis: d, .. }) | Emitter::Directional { direction: d, .. } => {
                *d = map.transform_vector3(d.as_dvec3()).normalize().as_vec3();
            }
            Emitter::Point { .. } | Emitter::Constant { .. } | Emitter::Map(_) => {}
        }
    }
    scene.camera.to_world = *map * scene.camera.to_world;
    Ok(scene)
}

/// The scene with everything that emits brighter by a factor.
pub(super) fn brighter(mut scene: Scene, factor: f32) -> Scene {
    use crate::scene::Input;
    for shape in &mut scene.shapes {
        if let Some(Input::Constant(radiance)) = &mut shape.emission {
            *radiance *= factor;
        }
    }
    for emitter in &mut scene.emitters {
        match emitter {
            Emitter::Point { intensity: power, .. }
            | Emitter::Spot(Spot { intensity: power, .. })
            | Emitter::Directional { irradiance: power, .. }
            | Emitter::Constant { radiance: power } => *power *= factor,
            Emitter::Map(_) => {}
        }
    }
    scene
}

/// An image: its values with channels one after the other, and how many samples were dropped.
pub(super) struct Rendered {
    pub(super) values: Vec<f32>,
    pub(super) dropped: bool,
}

impl Rendered {
    /// Mean over pixels and channels; NaN if anything was dropped, so that no comparison passes.
    pub(super) fn mean(&self) -> f64 {
        if self.dropped {
            return f64::NAN;
        }
        self.values.iter().map(|&v| f64::from(v)).sum::<f64>() / self.values.len() as f64
    }

    /// The share of values that are not those of another image times a power of two.
    pub(super) fn share_that_differs(&self, other: &Self, factor: f32) -> f64 {
        if self.dropped || other.dropped {
            return f64::NAN;
        }
        let differs = |(a, b): &(&f32, &f32)| **a != **b * factor;
        self.values.iter().zip(&other.values).filter(differs).count() as f64 / self.values.len() as f64
    }
}

struct Render<'a> {
    scene: &'a Scene,
    integrator: Integrator,
    seeds: std::ops::Range<u64>,
    passes: u32,
}

impl Task for Render<'_> {
    type Output = Result<Vec<Rendered>, RenderError>;

    fn run<Q: RayQuery>(&self, query: &Q) -> Self::Output {
        let world = World::new(self.scene);
        let image = |seed| {
            let mut film = Film::new(&self.scene.film, AovSet::default(), world.lights.radiance_unit())?;
            let stop = Stop { passes: 0..self.passes, time: None };
            let target = Target { integrator: self.integrator, seed };
            render(&world, query, &target, &mut film, &stop, |_| Control::Continue)?;
            let image = film.develop();
            let channels = ["R", "G", "B"].map(|name| image.floats(name).unwrap_or_default());
            Ok(Rendered { values: channels.concat(), dropped: !film.dropped().is_none() })
        };
        self.seeds.clone().map(image).collect()
    }
}

/// Images of a scene by independent seeds.
pub(super) fn images(
    bench: &Bench,
    scene: &Scene,
    integrator: Integrator,
    seeds: std::ops::Range<u64>,
    passes: u32,
) -> Result<Vec<Rendered>, SelftestError> {
    Ok(bench.on(&scene.shapes, &Render { scene, integrator, seeds, passes })??)
}

/// An image of a scene.
pub(super) fn image(
    bench: &Bench,
    scene: &Scene,
    integrator: Integrator,
    passes: u32,
) -> Result<Rendered, SelftestError> {
    let mut images = images(bench, scene, integrator, 1..2, passes)?;
    images.pop().ok_or(SelftestError::Shape)
}

/// Mean of independent images and its standard error.
pub(super) fn mean_and_error(images: &[Rendered]) -> (f64, f64) {
    let n = images.len() as f64;
    let means: Vec<f64> = images.iter().map(Rendered::mean).collect();
    let mean = means.iter().sum::<f64>() / n;
    let variance = means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}
