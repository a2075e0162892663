//! Every kind of light, of camera and of material at least once, by `bdpt` and, where it can, `ptracer` against `path`.
//!
//! The materials are those of `tests/scenes`, whose lights and camera are exchanged. What `path` cannot find is left out: lights of no size go
//! with materials without delta lobes; and `ptracer` sees neither delta surfaces directly nor, through an orthographic camera, the sky.
//!
//! 64 images of each integrator: each of some 30 comparisons has 15 values (4 blocks and the image, in three colours), each of which raises a
//! false alarm with a chance below 1e-6 (see [`crate::images`]); all together below 5e-4. A bias of 5.5 errors is found: of the whole image 0.5 to
//! 5 % by `bdpt`, and at most 15 %, since errors must be below 2 %. The runs by hand at the end see half a percent of each block.

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3, UVec2, Vec3};
use helmholtz::query::RayQuery;
use helmholtz::scene::{
    AnalyticKind, AnalyticShape, Emitter, EnvironmentMap, Filter, Geometry, Lens, Material, Microfacet,
    PixelRect, Rgb, Scene, Spot, TriangleMesh,
};
use helmholtz::transport::World;

use super::agreement::{Versus, integrator, scene};
use crate::backends::{BackendTest, on_first_backend};
use crate::images::{estimate, render_runs};
use crate::scene_builder::{Build, diffuse, image, quad, sphere};

const RUNS: u64 = 64;
const LIMIT: f64 = 5.5;
const PATH_LENGTH: &str = "max_depth=5,rr_depth=4";

/// The objects of a scene of `tests/scenes` on the floor, without their lights.
fn unlit(name: &str) -> Scene {
    let mut scene = scene(name);
    scene.emitters.clear();
    scene.shapes.retain(|shape| shape.emission.is_none());
    scene
}

/// The floor alone.
fn floor() -> Scene {
    let mut scene = unlit("plastic");
    scene.shapes.truncate(1);
    scene
}

/// A coarse ball whose shading normals are those of a sphere, far from those of its triangles.
fn smooth_ball(center: DVec3, radius: f64) -> Geometry {
    let (positions, triangles) = crate::support::icosphere(1);
    let normals: Vec<Vec3> = positions.iter().map(|p| p.as_vec3()).collect();
    let positions = crate::support::placed(&positions, radius, center);
    Geometry::Mesh(TriangleMesh::new(positions, triangles, normals, Vec::new(), false).expect("a valid mesh"))
}

/// Smooth-shaded balls, diffuse and glossy, near to each other and to the floor.
fn smooth() -> Scene {
    let metal = Material::RoughConductor {
        distribution: Microfacet::Ggx,
        alpha: [0.3.into(); 2],
        eta: Rgb::splat(0.2).into(),
        k: Rgb::splat(3.0).into(),
        specular_reflectance: Rgb::ONE.into(),
    };
    floor().shape(smooth_ball(DVec3::new(-0.7, 0.6, 0.0), 0.6), diffuse(0.9), None).shape(
        smooth_ball(DVec3::new(0.7, 0.7, 0.2), 0.7),
        metal,
        None,
    )
}

fn dielectric(eta: f32) -> Material {
    Material::Dielectric {
        eta,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    }
}

/// A ball in water in glass, and rough glass around glass.
fn nested() -> Scene {
    let frosted = Material::RoughDielectric {
        distribution: Microfacet::Ggx,
        alpha: [0.3.into(); 2],
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    };
    let (left, right) = (Vec3::new(-0.9, 0.9, 0.0), Vec3::new(0.9, 0.8, 0.0));
    floor()
        .shape(sphere(left, 0.85), dielectric(1.5), None)
        .shape(sphere(left, 0.65), dielectric(1.33 / 1.5), None)
        .shape(sphere(left, 0.35), diffuse(0.8), None)
        .shape(sphere(right, 0.75), frosted, None)
        .shape(sphere(right, 0.4), dielectric(1.8 / 1.5), None)
}

fn lamp(scene: Scene, geometry: Geometry, radiance: f32) -> Scene {
    scene.shape(geometry, diffuse(0.5), Some(Rgb::new(1.0, 0.9, 0.7) * radiance))
}

fn analytic(kind: AnalyticKind, to_world: DAffine3) -> Geometry {
    Geometry::Analytic(AnalyticShape::new(kind, to_world, false).expect("a proper shape"))
}

fn rectangle(scene: Scene) -> Scene {
    lamp(scene, quad(Vec3::new(-2.0, 3.8, -2.0), Vec3::X * 4.0, Vec3::Z * 3.0), 2.0)
}

/// In view.
fn ball(scene: Scene) -> Scene {
    lamp(scene, sphere(Vec3::new(0.2, 2.3, -1.2), 0.8), 4.0)
}

fn disk(scene: Scene) -> Scene {
    let down = DQuat::from_rotation_x(std::f64::consts::FRAC_PI_2);
    let to_world =
        DAffine3::from_scale_rotation_translation(DVec3::new(1.6, 1.2, 1.0), down, DVec3::new(0.3, 3.4, 0.5));
    lamp(scene, analytic(AnalyticKind::Disk, to_world), 4.0)
}

/// Mirrored too.
fn cylinder(scene: Scene) -> Scene {
    let across = DQuat::from_rotation_y(std::f64::consts::FRAC_PI_2);
    let to_world = DAffine3::from_scale_rotation_translation(
        DVec3::new(1.0, -1.0, 4.0),
        across,
        DVec3::new(-2.0, 3.6, -0.5),
    );
    lamp(scene, analytic(AnalyticKind::Cylinder, to_world), 3.0)
}

/// Eight triangles.
fn octahedron(scene: Scene) -> Scene {
    let (positions, triangles) = crate::support::icosphere(0);
    let positions = crate::support::placed(&positions, 1.8, DVec3::new(1.0, 3.6, 0.4));
    let mesh = TriangleMesh::new(positions, triangles, Vec::new(), Vec::new(), false).expect("a valid mesh");
    lamp(scene, Geometry::Mesh(mesh), 3.0)
}

/// With smooth normals, under a map that mirrors: light must leave it on the same side for all strategies (number 2 of [`super`]).
fn mirrored_mesh(scene: Scene) -> Scene {
    let mut geometry = smooth_ball(DVec3::new(1.2, -3.0, 0.8), 0.9);
    if let Geometry::Mesh(mesh) = &mut geometry {
        let mirrored = |vectors: &[Vec3]| vectors.iter().map(|v| Vec3::new(v.x, -v.y, v.z)).collect();
        let (positions, normals) = (mirrored(mesh.positions()), mirrored(mesh.normals()));
        *mesh = TriangleMesh::new(positions, mesh.triangles().to_vec(), normals, mesh.uvs().to_vec(), false)
            .expect("a valid mesh");
    }
    lamp(scene, geometry, 3.0)
}

fn point(scene: Scene) -> Scene {
    scene
        .emitter(Emitter::Point { position: Vec3::new(-2.0, 4.0, 3.0), intensity: Rgb::new(12.0, 10.0, 8.0) })
}

fn spot(scene: Scene) -> Scene {
    let position = Vec3::new(2.0, 4.0, 2.0);
    scene.emitter(Emitter::Spot(Spot {
        position,
        axis: -position.normalize(),
        intensity: Rgb::new(20.0, 25.0, 30.0),
        cutoff: 0.5,
        beam_width: 0.2,
    }))
}

fn directional(scene: Scene) -> Scene {
    scene.emitter(Emitter::Directional {
        direction: Vec3::new(0.4, -1.0, -0.5).normalize(),
        irradiance: Rgb::new(2.0, 1.8, 1.5),
    })
}

fn constant(scene: Scene) -> Scene {
    scene.emitter(Emitter::Constant { radiance: Rgb::new(0.5, 0.6, 0.8) })
}

/// A sky with a bright patch, turned.
fn map(scene: Scene) -> Scene {
    let mut texels = vec![[0.2, 0.3, 0.5]; 8 * 5];
    texels[8 + 3] = [6.0, 5.0, 3.0];
    texels[3 * 8 + 6] = [0.0; 3];
    let turn = DMat3::from_rotation_y(0.7);
    let map = EnvironmentMap::new(image(UVec2::new(8, 5), texels), 1.0, turn).expect("a valid map");
    scene.emitter(Emitter::Map(map))
}

/// One of each kind, so that the choice among them matters.
fn all(scene: Scene) -> Scene {
    map(directional(spot(point(octahedron(ball(rectangle(scene)))))))
}

pub(super) fn pinhole(mut scene: Scene) -> Scene {
    let size = UVec2::splat(16);
    (scene.film.size, scene.film.crop) = (size, PixelRect { min: UVec2::ZERO, size });
    scene.film.filter = Filter::Box;
    scene
}

fn thin(scene: Scene) -> Scene {
    let mut scene = pinhole(scene);
    scene.camera.lens = Lens::Thin { aperture_radius: 0.4, focus_distance: 4.5 };
    scene
}

/// Pixels are not square.
fn orthographic(scene: Scene) -> Scene {
    let mut scene = pinhole(scene);
    scene.camera.lens = Lens::Orthographic;
    scene.camera.to_world *= DAffine3::from_scale(DVec3::new(2.4, 1.9, 1.0));
    scene
}

/// A window of a larger film, with the principal point moved, cut in front and behind.
fn cropped(scene: Scene) -> Scene {
    let mut scene = pinhole(scene);
    scene.film.size = UVec2::new(31, 27);
    scene.film.crop.min = UVec2::new(4, 9);
    scene.camera.principal_point = DVec2::new(-0.15, 0.1);
    (scene.camera.near_clip, scene.camera.far_clip) = (4.3, 7.0);
    scene
}

/// The same through a lens.
fn cropped_thin(scene: Scene) -> Scene {
    let mut scene = cropped(scene);
    scene.camera.lens = Lens::Thin { aperture_radius: 0.3, focus_distance: 5.0 };
    scene
}

const BDPT: &[(&str, u32)] = &[("bdpt", 4)];
pub(super) const BOTH: &[(&str, u32)] = &[("bdpt", 4), ("ptracer", 24)];
/// Passes of `path`.
const REFERENCE: u32 = 12;

pub(super) fn check(name: &str, scene: &Scene, tested: &[(&str, u32)]) {
    for &(tested, passes) in tested {
        let versus = Versus {
            name,
            scene,
            tested: integrator(tested, PATH_LENGTH),
            reference: integrator("path", PATH_LENGTH),
            passes: [passes, REFERENCE],
            runs: RUNS,
            limits: [LIMIT; 2],
            greatest_error: 0.02,
        };
        on_first_backend(&scene.shapes, &versus);
    }
}

macro_rules! kinds {
    ($($test:ident: $objects:expr, $light:ident, $camera:ident, $tested:expr;)*) => {
        $(#[test] fn $test() { check(stringify!($test), &$camera($light($objects)), $tested); })*
    };
}

kinds! {
    rectangle_thin_bumpmap: unlit("bumpmap"), rectangle, thin, BDPT;
    ball_orthographic_normalmap: unlit("normalmap"), ball, orthographic, BDPT;
    disk_pinhole_plastic: unlit("plastic"), disk, pinhole, BDPT;
    cylinder_crop_mask: unlit("mask"), cylinder, cropped, BDPT;
    octahedron_orthographic_blend: unlit("blendbsdf"), octahedron, orthographic, BDPT;
    mirrored_mesh_thin_smooth: smooth(), mirrored_mesh, thin, BOTH;
    point_orthographic_principled: unlit("principled"), point, orthographic, BOTH;
    point_thin_smooth: smooth(), point, thin, BOTH;
    spot_crop_roughplastic: unlit("roughplastic"), spot, cropped, BOTH;
    spot_orthographic_roughconductor: unlit("roughconductor"), spot, orthographic, BOTH;
    directional_thin_principled_transmission: unlit("principled-transmission"), directional, thin, BOTH;
    directional_orthographic_smooth: smooth(), directional, orthographic, BOTH;
    constant_orthographic_null: unlit("null"), constant, orthographic, BDPT;
    constant_crop_adapters: unlit("adapters"), constant, cropped, BDPT;
    map_thin_thindielectric: unlit("thindielectric"), map, thin, BDPT;
    map_crop_thin_roughdielectric: unlit("roughdielectric"), map, cropped_thin, BDPT;
    constant_pinhole_nested: nested(), constant, pinhole, BDPT;
    all_crop_thin_smooth: smooth(), all, cropped_thin, BOTH;
    all_orthographic_smooth: smooth(), all, orthographic, BDPT;
}

/// Russian roulette from the first event on stays out of the weights (number 14 of [`super`]): against paths that it never ends.
#[test]
fn roulette_is_no_part_of_the_weights() {
    let scene = thin(map(rectangle(smooth())));
    let versus = Versus {
        name: "roulette",
        scene: &scene,
        tested: integrator("bdpt", "max_depth=5,rr_depth=1"),
        reference: integrator("path", "max_depth=5,rr_depth=99"),
        passes: [4, REFERENCE],
        runs: RUNS,
        limits: [LIMIT; 2],
        greatest_error: 0.01,
    };
    on_first_backend(&scene.shapes, &versus);
}

/// Each block's difference is below half a percent, and so are five of its errors.
fn check_long(name: &str, scene: &Scene, passes: [u32; 2]) {
    on_first_backend(&scene.shapes, &Long { name, scene, passes });
}

struct Long<'a> {
    name: &'a str,
    scene: &'a Scene,
    passes: [u32; 2],
}

impl BackendTest for Long<'_> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let world = World::new(self.scene);
        let render = |name: &str, seeds, passes| {
            let integrator = integrator(name, "max_depth=6,rr_depth=5");
            let images = render_runs(self.scene, &world, query, integrator, seeds, passes);
            estimate(&images, self.scene.film.crop.size.x as usize)
        };
        let tested = render("bdpt", 0..RUNS, self.passes[0]);
        let reference = render("path", 1000..1000 + RUNS, self.passes[1]);
        let relative = |i: usize| {
            let (a, b) = (tested.blocks[i], reference.blocks[i]);
            ((a.0 - b.0) / b.0, a.1.hypot(b.1) / b.0)
        };
        let blocks: Vec<_> = (0..tested.blocks.len()).map(relative).collect();
        let greatest = |f: fn(&(f64, f64)) -> f64| blocks.iter().map(f).fold(0.0, f64::max);
        let (difference, error) = (greatest(|b| b.0.abs()), greatest(|b| b.1));
        let z = greatest(|b| b.0.abs() / b.1);
        println!(
            "{} on {backend}: greatest difference of a block {difference:.5}, greatest error {error:.5}, greatest z {z:.1}",
            self.name
        );
        assert!(error < 0.001, "{}: too noisy", self.name);
        assert!(difference < 0.005 && z < LIMIT, "{}: they differ", self.name);
    }
}

/// `cargo test --release -- --ignored --nocapture kinds::long`. Takes five minutes; figures are in `vendor-notes/measurements.md`.
#[test]
#[ignore = "takes minutes"]
fn long_smooth_shaded_and_bumped() {
    check_long("smooth-shaded", &pinhole(constant(rectangle(smooth()))), [160, 480]);
    check_long("bump-mapped", &pinhole(constant(unlit("bumpmap"))), [160, 480]);
}

/// As above.
#[test]
#[ignore = "takes minutes"]
fn long_nested_dielectrics() {
    check_long("nested dielectrics", &pinhole(constant(nested())), [160, 480]);
}
