//! Cameras: the rays they send against the importance they give to light that arrives.

use glam::{DAffine3, DQuat, DVec3, UVec2, Vec2, Vec3};
use helmholtz::scene::{Camera, FovAxis, Lens};
use helmholtz::transport::camera::CameraModel;

use crate::statistics::{FALSE_ALARM_RATE, Family, Moments, Random, z_test};

const SIZE: UVec2 = UVec2::new(64, 48);

fn cameras() -> Vec<(&'static str, CameraModel)> {
    let place = DAffine3::from_scale_rotation_translation(
        DVec3::splat(2.0),
        DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 0.2),
        DVec3::new(1.0, -2.0, 0.5),
    );
    let camera = |lens| Camera {
        to_world: place,
        fov: 50.0,
        fov_axis: FovAxis::X,
        lens,
        near_clip: 0.01,
        far_clip: 1e4,
    };
    vec![
        ("pinhole", CameraModel::new(&camera(Lens::Pinhole), SIZE)),
        (
            "thin lens",
            CameraModel::new(&camera(Lens::Thin { aperture_radius: 0.2, focus_distance: 3.0 }), SIZE),
        ),
    ]
}

/// A ray's film position is found again from its origin and direction.
#[test]
fn rays_project_back_to_their_film_position() {
    let mut random = Random::new(1);
    for (name, camera) in cameras() {
        for _ in 0..10_000 {
            let film = random.uniform_2d() * SIZE.as_vec2();
            let ray = camera.spawn_ray(film, random.uniform_2d());
            let (_, found) = camera.we(ray.o, ray.d).expect("in front of the lens");
            assert!(found.distance(film) < 1e-3, "{name}: {film} became {found}");
            assert!((ray.d.length() - 1.0).abs() < 1e-6);
        }
    }
}

/// Field of view: the ray through the middle of an edge makes half the angle with the axis, on each axis that it can be measured across.
#[test]
fn field_of_view_is_measured_across_its_axis() {
    let (w, h) = (SIZE.x as f32, SIZE.y as f32);
    let cases = [
        (FovAxis::X, Vec2::new(w, h / 2.0)),
        (FovAxis::Y, Vec2::new(w / 2.0, h)),
        (FovAxis::Smaller, Vec2::new(w / 2.0, 0.0)),
        (FovAxis::Larger, Vec2::new(0.0, h / 2.0)),
        (FovAxis::Diagonal, Vec2::new(w, h)),
    ];
    for (fov_axis, film) in cases {
        let to_world = DAffine3::IDENTITY;
        let camera =
            Camera { to_world, fov: 50.0, fov_axis, lens: Lens::Pinhole, near_clip: 0.0, far_clip: 1e9 };
        let camera = CameraModel::new(&camera, SIZE);
        let angle = camera.spawn_ray(film, Vec2::ZERO).d.z.acos().to_degrees();
        assert!((angle - 25.0).abs() < 1e-3, "{fov_axis:?}: {angle}");
    }
}

/// Mitsuba's camera space: x points to the left of the image and y up.
#[test]
fn image_orientation() {
    let camera = Camera {
        to_world: DAffine3::IDENTITY,
        fov: 50.0,
        fov_axis: FovAxis::X,
        lens: Lens::Pinhole,
        near_clip: 0.0,
        far_clip: 1e9,
    };
    let d = CameraModel::new(&camera, SIZE).spawn_ray(Vec2::ZERO, Vec2::ZERO).d;
    assert!(d.x > 0.0 && d.y > 0.0 && d.z > 0.0, "upper left corner looks to {d}");
}

/// Uniform radiance 1 gives each pixel 1: the integral of We cos over the lens and the directions of the film is the number of pixels.
#[test]
fn importance_is_normalised_per_pixel() {
    let mut family = Family::default();
    let mut random = Random::new(2);
    for (name, camera) in cameras() {
        let mut sum = Moments::default();
        for _ in 0..400_000 {
            // Any lens point will do; directions uniform over the hemisphere in front, independent of the camera's own sampling.
            let p = camera.spawn_ray(SIZE.as_vec2() * 0.5, random.uniform_2d()).o;
            let mut d = random.direction();
            if d.dot(camera.forward()) < 0.0 {
                d = -d;
            }
            let value = camera.we(p, d).map_or(0.0, |(importance, film)| {
                let on_film = film.cmpge(Vec2::ZERO).all() && film.cmplt(SIZE.as_vec2()).all();
                let cos = d.dot(camera.forward());
                if on_film { f64::from(importance * cos * camera.lens_area()) } else { 0.0 }
            });
            sum.push(value * std::f64::consts::TAU);
        }
        family.record(name, z_test(&sum, f64::from(SIZE.element_product())));
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// The density of a pixel's directions integrates to 1 over what the pixel sees.
#[test]
fn direction_density_is_normalised() {
    for (name, camera) in cameras() {
        let origin = camera.spawn_ray(Vec2::ZERO, Vec2::new(0.7, 0.3)).o;
        // Solid angle of a small square of the film, by the cross product of its edge directions.
        let pixel = Vec2::new(5.0, 40.0);
        let n = 64;
        let corner = |i: i32, j: i32| {
            let film = pixel + Vec2::new(i as f32, j as f32) / n as f32;
            camera.spawn_ray(film, Vec2::new(0.7, 0.3)).d.as_dvec3()
        };
        let mut sum = 0.0;
        for i in 0..n {
            for j in 0..n {
                let (a, b, c) = (corner(i, j), corner(i + 1, j), corner(i, j + 1));
                let solid_angle = (b - a).cross(c - a).length();
                sum += solid_angle * f64::from(camera.pdf_we_w(origin, a.as_vec3()));
            }
        }
        assert!((sum - 1.0).abs() < 2e-3, "{name}: {sum}");
    }
}

/// A small glowing patch is seen by camera rays as brightly as its light connects to the lens, and in the same place of the film.
#[test]
fn connections_agree_with_rays() {
    let mut family = Family::default();
    let mut random = Random::new(3);
    for (name, camera) in cameras() {
        // A disc facing the camera, out of focus for the lens, whose blur stays on the film.
        let axis = camera.spawn_ray(Vec2::new(30.0, 22.0), Vec2::splat(0.5)).d;
        let (center, radius) = (camera.position() + axis * 4.0, 0.3_f32);
        let (x, y) = axis.any_orthonormal_pair();
        let (mut by_rays, mut by_connections) = (Moments::default(), Moments::default());
        let (mut rays_x, mut connections_x) = (Moments::default(), Moments::default());
        let pixels = SIZE.element_product() as f32;
        for _ in 0..400_000 {
            let film = random.uniform_2d() * SIZE.as_vec2();
            let ray = camera.spawn_ray(film, random.uniform_2d());
            let t = (center - ray.o).dot(axis) / ray.d.dot(axis);
            let seen = f32::from((ray.o + ray.d * t).distance(center) < radius) * pixels;
            by_rays.push(f64::from(seen));
            rays_x.push(f64::from(seen * film.x));

            let disc = helmholtz::sampling::warp::square_to_disc(random.uniform_2d()) * radius;
            let q: Vec3 = center + x * disc.x + y * disc.y;
            let area = std::f32::consts::PI * radius * radius;
            let c = camera.sample_wi(q, random.uniform_2d()).expect("in front");
            // Radiance 1 leaves the patch: sum over pixels of We G, over the densities of both points.
            let g = c.d.dot(axis) * c.cos / q.distance_squared(c.p);
            let value = c.importance * g * area * camera.lens_area();
            by_connections.push(f64::from(value));
            connections_x.push(f64::from(value * c.film.x));
        }
        family
            .record(format!("{name}, brightness"), crate::statistics::z_test_two(&by_rays, &by_connections));
        family.record(format!("{name}, place"), crate::statistics::z_test_two(&rays_x, &connections_x));
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}
