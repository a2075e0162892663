//! Cameras: the rays they send against the importance they give to light that arrives.

use glam::{DAffine3, DMat3, DQuat, DVec2, DVec3, UVec2, Vec2, Vec3};
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
        principal_point: DVec2::ZERO,
    };
    let moved = Camera { principal_point: DVec2::new(0.1, -0.2), ..camera(Lens::Pinhole) };
    vec![
        ("pinhole", CameraModel::new(&camera(Lens::Pinhole), SIZE)),
        ("pinhole with its principal point moved", CameraModel::new(&moved, SIZE)),
        (
            "thin lens",
            CameraModel::new(&camera(Lens::Thin { aperture_radius: 0.2, focus_distance: 3.0 }), SIZE),
        ),
    ]
}

/// An orthographic camera whose rays are not at right angles to its film, which is 3 wide.
fn orthographic() -> Camera {
    let map =
        DMat3::from_cols(DVec3::new(1.5, 0.0, 0.0), DVec3::new(0.2, 1.2, 0.0), DVec3::new(0.3, 0.4, 2.0));
    let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.3, -0.7, 0.2));
    Camera {
        to_world: DAffine3::from_mat3_translation(turn * map, DVec3::new(1.0, -2.0, 0.5)),
        fov: 90.0,
        fov_axis: FovAxis::X,
        lens: Lens::Orthographic,
        near_clip: 0.5,
        far_clip: 10.0,
        principal_point: DVec2::ZERO,
    }
}

/// Rays of an orthographic camera leave its film side by side, and a point anywhere along one connects back to its film position, if it is
/// between the clipping planes as Mitsuba means them: the nearer is scaled with the camera, the depth between is not.
#[test]
fn orthographic_rays_connect_back() {
    let settings = orthographic();
    let camera = CameraModel::new(&settings, SIZE);
    let axis = settings.to_world.matrix3.z_axis;
    let near = (0.5 * axis.length()) as f32;
    let corner = settings.to_world.transform_point3(DVec3::new(1.0, 48.0 / 64.0, 0.0)).as_vec3();
    assert!(camera.spawn_ray(Vec2::ZERO, Vec2::ZERO).o.distance(corner) < 1e-5);
    let mut random = Random::new(4);
    for _ in 0..10_000 {
        let film = random.uniform_2d() * SIZE.as_vec2();
        let ray = camera.spawn_ray(film, random.uniform_2d());
        assert!(ray.d.distance(axis.normalize().as_vec3()) < 1e-6);
        assert!((ray.t_min - near).abs() < 1e-5 && (ray.t_max - near - 9.5).abs() < 1e-5);
        let t = random.uniform() * 15.0;
        let connection = camera.sample_wi(ray.o + ray.d * t, random.uniform_2d());
        if (t - ray.t_min).abs() > 1e-4 && (t - ray.t_max).abs() > 1e-4 {
            assert_eq!(connection.is_some(), t > ray.t_min && t < ray.t_max, "{t}");
        }
        let Some(connection) = connection else { continue };
        assert!(connection.film.distance(film) < 1e-3, "{film} became {}", connection.film);
        assert!(connection.p.distance(ray.o) < 1e-4 && connection.cos == 1.0 && connection.d == ray.d);
    }
}

/// The principal point moves the picture by its offset, as Mitsuba does: what was in the middle is seen a tenth of the width to the left.
#[test]
fn the_principal_point_moves_the_picture() {
    let settings = |principal_point| Camera {
        to_world: DAffine3::IDENTITY,
        fov: 90.0,
        fov_axis: FovAxis::X,
        lens: Lens::Pinhole,
        near_clip: 0.0,
        far_clip: 1e9,
        principal_point,
    };
    let moved = CameraModel::new(&settings(DVec2::new(0.1, 0.25)), SIZE);
    let film = moved.sample_wi(Vec3::Z, Vec2::ZERO).expect("in front").film;
    assert!(film.distance(SIZE.as_vec2() * Vec2::new(0.4, 0.25)) < 1e-4, "{film}");
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
        let camera = Camera {
            to_world,
            fov: 50.0,
            fov_axis,
            lens: Lens::Pinhole,
            near_clip: 0.0,
            far_clip: 1e9,
            principal_point: DVec2::ZERO,
        };
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
        principal_point: DVec2::ZERO,
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
    let parallel = ("orthographic", CameraModel::new(&orthographic(), SIZE));
    for (name, camera) in cameras().into_iter().chain([parallel]) {
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
