//! Floors whose shading normals all lean one way, by their vertices or by a normal map: over a ball, what importance lacks on one side it has
//! too much of on the other; here it is half of what is seen. (Number 1 of [`super`].)

use std::f64::consts::PI;

use glam::{DVec3, Vec2, Vec3};
use helmholtz::scene::{
    Emitter, Geometry, Material, MaterialId, Perturbation, Rgb, Scene, Spot, TriangleMesh,
};

use super::forward::{Expected, check as check_mean};
use super::kinds::{BOTH, check, pinhole};
use crate::scene_builder::{Build, diffuse, empty, quad};

const ALBEDO: f32 = 0.6;
/// Sine and cosine of the angle by which normals lean.
const LEAN: (f32, f32) = (0.5, 0.866_025_4);

/// How a floor's normals come to lean.
#[derive(Clone, Copy, Debug)]
enum By {
    Vertices,
    Map { flips: bool, shadowing: bool },
}

/// The parallelogram of [`quad`] with normals that lean towards `ex`, to which `ey` is perpendicular.
fn leaning(mut scene: Scene, [corner, ex, ey]: [Vec3; 3], by: By) -> Scene {
    let mesh = |normals, uvs| {
        let positions = vec![corner, corner + ex, corner + ex + ey, corner + ey];
        let mesh = TriangleMesh::new(positions, vec![[0, 1, 2], [0, 2, 3]], normals, uvs, false);
        Geometry::Mesh(mesh.expect("a valid mesh"))
    };
    match by {
        By::Vertices => {
            let normal = ex.normalize() * LEAN.0 + ex.cross(ey).normalize() * LEAN.1;
            scene.shape(mesh(vec![normal; 4], Vec::new()), diffuse(ALBEDO), None)
        }
        By::Map { flips, shadowing } => {
            let uvs = vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
            scene.materials.push(diffuse(ALBEDO));
            let normal = Vec3::new(LEAN.0, 0.0, LEAN.1) * 0.5 + 0.5;
            let material = Material::Perturbed {
                by: Perturbation::Normal(normal.into()),
                flip_invalid_normals: flips,
                use_shadowing_function: shadowing,
                material: MaterialId(scene.materials.len() as u32 - 1),
            };
            scene.shape(mesh(Vec::new(), uvs), material, None)
        }
    }
}

fn spot(position: Vec3, target: Vec3, beam_width: f64, cutoff: f64) -> Emitter {
    let axis = (target - position).normalize();
    Emitter::Spot(Spot { position, axis, intensity: Rgb::splat(9.0), cutoff, beam_width })
}

/// Seen from above and lit from the side: the radiance of a point is `albedo / pi * I / d^2` times the cosine of the leaning normal, here by the midpoint rule
/// over the image.
#[test]
fn direct_light_has_the_leaning_cosine() {
    const FLOOR: [Vec3; 3] =
        [Vec3::new(-20.0, -20.0, 4.0), Vec3::new(0.0, 40.0, 0.0), Vec3::new(40.0, 0.0, 0.0)];
    let light = DVec3::new(0.0, 3.0, 2.5);
    let normal = DVec3::new(0.0, f64::from(LEAN.0), -f64::from(LEAN.1));
    let half_width = 4.0 * 20f64.to_radians().tan();
    let steps = 100;
    let place = |i: i32| half_width * (f64::from(2 * i + 1) / f64::from(steps) - 1.0);
    let radiance = |x: f64, y: f64| {
        let to_light = light - DVec3::new(x, y, 4.0);
        f64::from(ALBEDO) / PI * 9.0 * normal.dot(to_light) / to_light.length().powi(3)
    };
    let row = |i: i32| (0..steps).map(|j| radiance(place(i), place(j))).sum::<f64>();
    let expected = (0..steps).map(row).sum::<f64>() / f64::from(steps * steps);
    for by in
        [By::Vertices, By::Map { flips: false, shadowing: false }, By::Map { flips: true, shadowing: false }]
    {
        // All that is seen is within the beam.
        let scene = leaning(empty(), FLOOR, by).emitter(spot(light.as_vec3(), Vec3::Z * 4.0, 0.72, 0.75));
        for (name, passes) in [("ptracer", 128), ("bdpt", 32), ("path", 8)] {
            let what = format!("{by:?} by {name}");
            check_mean(&what, &scene, (name, "max_depth=2"), Expected::Exactly(expected), passes);
        }
    }
}

/// A floor in a slanting beam, and a wall that has light from the floor alone: what light paths evaluate, and what they sample.
fn beam(by: By) -> Scene {
    const FLOOR: [Vec3; 3] =
        [Vec3::new(-3.0, -1.0, 8.0), Vec3::new(6.0, 0.0, 0.0), Vec3::new(0.0, 0.0, -6.0)];
    let wall = quad(Vec3::new(-3.0, -1.0, 6.0), Vec3::Y * 4.0, Vec3::X * 6.0);
    let light = spot(Vec3::new(2.6, 0.2, 4.0), Vec3::new(-0.2, -1.0, 4.0), 0.15, 0.2);
    pinhole(leaning(empty(), FLOOR, by).shape(wall, diffuse(0.8), None).emitter(light))
}

/// By the limits of [`super::kinds`].
#[test]
fn light_from_a_leaning_floor() {
    check("leaning vertex normals", &beam(By::Vertices), BOTH);
    check("leaning normal map", &beam(By::Map { flips: true, shadowing: true }), BOTH);
}
