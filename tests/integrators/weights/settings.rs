//! Every kind of light and of camera, with three rooms.

use glam::{DAffine3, DMat3, DVec2, DVec3, UVec2, Vec3};
use helmholtz::scene::{
    Emitter, EnvironmentMap, Lens, Material, MaterialId, Microfacet, Perturbation, PixelRect, Principled,
    Rgb, Scene, Spot, TriangleMesh,
};

use super::drawing::Case;
use crate::backends::on_first_backend;
use crate::scene_builder::{Build, diffuse, empty, image, quad, scaled, sphere};

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

fn glass() -> Material {
    Material::Dielectric {
        eta: 1.5,
        specular_reflectance: Rgb::ONE.into(),
        specular_transmittance: Rgb::ONE.into(),
    }
}

/// A room with a glass ball, a rough metal ball, a rough glass pane and a smooth-shaded ball.
fn room() -> Scene {
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
        .shape(sphere(Vec3::new(-0.8, -0.7, 4.0), 0.7), glass(), None)
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

/// Two balls within one ball of glass: light paths and eye paths meet behind refractions, each within the glass's index.
fn balls_in_glass() -> Scene {
    walls()
        .shape(sphere(Vec3::new(0.0, 0.0, 3.8), 1.2), glass(), None)
        .shape(sphere(Vec3::new(-0.5, -0.1, 3.7), 0.45), diffuse(0.8), None)
        .shape(sphere(Vec3::new(0.5, 0.1, 3.7), 0.45), diffuse(0.8), None)
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

/// Its name, a room, the lights put into it, and the camera.
type Setting = (&'static str, fn() -> Scene, &'static [Change], Change);

/// Every kind of light and of camera, with the three rooms.
const CASES: [Setting; 17] = [
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
    ("balls in glass, pinhole", balls_in_glass, &[lamp, environment], pinhole),
    ("balls in glass, lens", balls_in_glass, &[ball_lamp], thin_lens),
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
