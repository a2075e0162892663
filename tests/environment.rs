//! Light from afar: the grid distribution, images by direction, spot and directional lights.
//!
//! The expected radiance of an image is computed here from the definition (Mitsuba's: angles to fractions of the image, bilinear
//! between texels), in f64, so that it shares no code with what is tested.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DQuat, DVec3, UVec2, Vec2, Vec3};
use helmholtz::sampling::distribution_2d::Distribution2d;
use helmholtz::scene::{Emitter, EnvironmentMap, Rgb, Spot, SurfacePoint, luminance};
use helmholtz::transport::World;

use crate::scene_builder::{Build, empty, image};
use crate::statistics::{
    FALSE_ALARM_RATE, Family, Moments, Random, SphereChart, chi_squared, chi_squared_on_sphere, z_test,
};

const SAMPLES: u64 = 1 << 19;

fn receiver() -> SurfacePoint {
    SurfacePoint {
        p: Vec3::ZERO,
        p_err: 1e-6,
        ng: Vec3::Z,
        ns: Vec3::Z,
        uv: Vec2::ZERO,
        shape: 0,
        primitive: 0,
    }
}

/// Images that are hard to sample: random texels over two decades, one bright texel in the dark, at the seam, in the first and last row.
fn images() -> Vec<(&'static str, UVec2, Vec<[f32; 3]>)> {
    let mut random = Random::new(1);
    let mut noise =
        |w: u32, h: u32| (0..w * h).map(|_| [0; 3].map(|_| random.log_uniform(0.1, 10.0))).collect();
    let single = |w: u32, h: u32, x: u32, y: u32, rest: f32| {
        (0..w * h).map(|i| if i == y * w + x { [3.0, 2.0, 1.0] } else { [rest; 3] }).collect()
    };
    vec![
        ("noise", UVec2::new(16, 9), noise(16, 9)),
        ("least size", UVec2::new(2, 3), noise(2, 3)),
        ("one texel", UVec2::new(20, 10), single(20, 10, 7, 4, 0.0)),
        ("one texel at the seam", UVec2::new(20, 10), single(20, 10, 19, 5, 1e-3)),
        ("one texel at the pole", UVec2::new(12, 7), single(12, 7, 3, 0, 0.01)),
        ("one texel at the other pole", UVec2::new(12, 7), single(12, 7, 0, 6, 0.0)),
    ]
}

/// Radiance of the image in a direction of its own space.
fn expected_texel(size: UVec2, texels: &[[f32; 3]], d: DVec3) -> DVec3 {
    let (w, h) = (size.x as usize, size.y as usize);
    let u = d.x.atan2(-d.z) / TAU * w as f64 - 0.5;
    let v = d.y.clamp(-1.0, 1.0).acos() / PI * (h - 1) as f64;
    let (i, j) = (u.floor(), v.floor().min((h - 2) as f64));
    let (s, t) = (u - i, v - j);
    let texel = |i: f64, j: f64| {
        let [r, g, b] = texels[j as usize * w + (i as i64).rem_euclid(w as i64) as usize];
        DVec3::new(f64::from(r), f64::from(g), f64::from(b))
    };
    (texel(i, j) * (1.0 - s) + texel(i + 1.0, j) * s) * (1.0 - t)
        + (texel(i, j + 1.0) * (1.0 - s) + texel(i + 1.0, j + 1.0) * s) * t
}

fn rotation() -> DMat3 {
    DMat3::from_quat(DQuat::from_euler(glam::EulerRot::XYZ, 0.4, 1.1, -0.3))
}

#[test]
fn images_are_looked_up_as_defined() {
    let mut random = Random::new(2);
    for (name, size, texels) in images() {
        for to_world in
            [DMat3::IDENTITY, rotation() * 2.5, rotation() * DMat3::from_diagonal(DVec3::new(1.0, 1.0, -1.0))]
        {
            let map = EnvironmentMap::new(image(size, texels.clone()), 0.5, to_world).expect("a valid map");
            let scene = empty().emitter(Emitter::Map(map));
            let world = World::new(&scene);
            let own_axes = [Vec3::X, Vec3::Y, Vec3::Z, -Vec3::X, -Vec3::Y, -Vec3::Z];
            let others: Vec<Vec3> = (0..2000).map(|_| random.direction()).collect();
            for d in own_axes.into_iter().chain(others) {
                let found = world.lights.le_environment(d).as_dvec3();
                let local = (to_world.inverse() * d.as_dvec3()).normalize();
                let expected = expected_texel(size, &texels, local) * 0.5;
                assert!(found.abs_diff_eq(expected, 2e-4 * 10.0), "{name}: {d}: {found} {expected}");
            }
        }
    }
}

/// Directions follow the luminance of the image, which the test integrates itself; `pdf_environment` is the same density.
///
/// Cells of equal solid angle about an axis that goes through no pole or seam, and about the image's own.
#[test]
fn directions_follow_luminance() {
    let mut family = Family::default();
    let mut random = Random::new(3);
    for (name, size, texels) in images() {
        for to_world in [DMat3::IDENTITY, rotation()] {
            let map = EnvironmentMap::new(image(size, texels.clone()), 7.0, to_world).expect("a valid map");
            let scene = empty().emitter(Emitter::Map(map));
            let world = World::new(&scene);
            let brightness = |d: Vec3| {
                let local = to_world.transpose() * d.as_dvec3();
                f64::from(luminance(expected_texel(size, &texels, local).as_vec3()))
            };
            let pole = (to_world * DVec3::Y).as_vec3();
            for axis in [pole, Vec3::new(0.48, -0.6, 0.64)] {
                // At a pole with one bright texel the image is different from each side: quadrature needs it in a corner of its cells.
                if axis != pole && name.contains("pole") {
                    continue;
                }
                let chart = SphereChart::equal_area(axis);
                let total = chart.integral(brightness);
                let sample = || {
                    let sample = world.lights.sample_li(&receiver(), 0.5, random.uniform_2d())?;
                    let expected = (brightness(sample.wi) / total) as f32;
                    let pdf = world.lights.pdf_environment(sample.wi);
                    assert!(
                        (pdf / expected - 1.0).abs() < 2e-2 || (pdf - expected).abs() < 1e-3,
                        "{name}: {pdf} {expected}"
                    );
                    assert_eq!(pdf, sample.pdf_w);
                    assert_eq!(sample.radiance, world.lights.le_environment(sample.wi));
                    Some(sample.wi)
                };
                let test = chi_squared_on_sphere(&chart, SAMPLES, sample, |d| {
                    f64::from(world.lights.pdf_environment(d))
                });
                assert!((test.integral - 1.0).abs() < 1e-4, "{name} about {axis}: {}", test.integral);
                family.record(format!("{name} about {axis}"), test.p_value);
            }
        }
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// Directions by a coarser map: they follow the density that is stated for them, which is nowhere 0 where light comes from, and estimate the same light.
#[test]
fn coarser_sampling_changes_noise_alone() {
    let mut family = Family::default();
    let mut random = Random::new(6);
    for (name, size, texels) in images() {
        for columns in [2, 3, 7] {
            if columns >= size.x {
                continue;
            }
            let map = EnvironmentMap::new(image(size, texels.clone()), 7.0, rotation()).expect("a valid map");
            let scene = empty().emitter(Emitter::Map(map.clone().with_sampling_columns(columns)));
            let world = World::new(&scene);
            let fine = empty().emitter(Emitter::Map(map));
            let (told, fine) = (World::with_sampling_columns(&fine, columns), World::new(&fine));
            for _ in 0..20_000 {
                let light = fine.lights.sample_li(&receiver(), 0.5, random.uniform_2d()).expect("a sample");
                let pdf = world.lights.pdf_environment(light.wi);
                assert!(pdf > 0.0, "{name} by {columns}: light from {} is never drawn", light.wi);
                assert_eq!(pdf, told.lights.pdf_environment(light.wi));
            }
            let brightness = |d: Vec3| {
                let local = rotation().transpose() * d.as_dvec3();
                7.0 * f64::from(luminance(expected_texel(size, &texels, local).as_vec3()))
            };
            let pole = (rotation() * DVec3::Y).as_vec3();
            let chart = SphereChart::equal_area(pole);
            let mut light = Moments::default();
            let sample = || {
                let sample = world.lights.sample_li(&receiver(), 0.5, random.uniform_2d())?;
                assert_eq!(world.lights.pdf_environment(sample.wi), sample.pdf_w);
                light.push(f64::from(luminance(sample.radiance) / sample.pdf_w));
                Some(sample.wi)
            };
            let density = |d| f64::from(world.lights.pdf_environment(d));
            let test = chi_squared_on_sphere(&chart, SAMPLES, sample, density);
            assert!((test.integral - 1.0).abs() < 1e-4, "{name} by {columns}: {}", test.integral);
            family.record(format!("directions of {name} by {columns}"), test.p_value);
            family
                .record(format!("light of {name} by {columns}"), z_test(&light, chart.integral(brightness)));
        }
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// An image's samples estimate the light of the whole sphere with no noise where it is grey: density is proportional to radiance.
#[test]
fn grey_images_are_sampled_without_noise() {
    let size = UVec2::new(16, 9);
    let mut random = Random::new(4);
    let texels = (0..16 * 9).map(|_| [random.log_uniform(0.01, 100.0); 3]).collect();
    let map = EnvironmentMap::new(image(size, texels), 1.0, DMat3::IDENTITY).expect("a valid map");
    let scene = empty().emitter(Emitter::Map(map));
    let world = World::new(&scene);
    let ratio = |s: helmholtz::transport::lights::LiSample| s.radiance.y / s.pdf_w;
    let first = ratio(world.lights.sample_li(&receiver(), 0.5, Vec2::splat(0.5)).expect("a sample"));
    for _ in 0..10_000 {
        let sample = world.lights.sample_li(&receiver(), 0.5, random.uniform_2d()).expect("a sample");
        assert!((ratio(sample) / first - 1.0).abs() < 1e-5);
    }
}

#[test]
fn grids_are_drawn_by_weight() {
    let mut random = Random::new(5);
    let mut family = Family::default();
    let weights: Vec<f64> = (0..35).map(|i| if i % 4 == 0 { 0.0 } else { f64::from(i * i) }).collect();
    let grid = Distribution2d::new(7, weights.clone()).expect("valid weights");
    let total: f64 = weights.iter().sum();
    assert!((grid.total() - total).abs() < 1e-9 * total);
    let mut counts = vec![0_u64; weights.len()];
    let mut rests = [Moments::default(); 2];
    for _ in 0..SAMPLES {
        let cell = grid.sample(random.uniform_2d());
        counts[cell.row * 7 + cell.column] += 1;
        for (moments, rest) in rests.iter_mut().zip(cell.rest.to_array()) {
            assert!((0.0..1.0).contains(&rest));
            moments.push(f64::from(rest));
        }
    }
    let expected: Vec<f64> = weights.iter().map(|w| w / total * SAMPLES as f64).collect();
    family.record("cells", chi_squared(&counts, &expected));
    for (axis, rest) in rests.iter().enumerate() {
        family.record(format!("rest {axis}"), z_test(rest, 0.5));
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// The ends of the unit interval draw no cell of weight 0, wherever those are.
#[test]
fn grids_never_draw_zero_weights() {
    let ends = [0.0, f32::MIN_POSITIVE, 0.5, 1.0 - f32::EPSILON / 2.0];
    for weights in
        [[0.0, 1e-30, 0.0, 0.0], [0.0, 0.0, 0.0, 1e30], [1.0, 0.0, 0.0, 0.0], [1e-300, 1e300, 1.0, 0.0]]
    {
        let grid = Distribution2d::new(2, weights.to_vec()).expect("valid weights");
        for u in ends.iter().flat_map(|&x| ends.map(|y| Vec2::new(x, y))) {
            let cell = grid.sample(u);
            assert!(weights[cell.row * 2 + cell.column] > 0.0, "{weights:?} at {u}: {cell:?}");
            assert!(cell.rest.is_finite());
        }
    }
}

#[test]
fn grids_refuse_invalid_weights() {
    for (columns, weights) in [
        (1, vec![]),
        (0, vec![1.0]),
        (2, vec![1.0; 3]),
        (2, vec![0.0; 4]),
        (1, vec![1.0, -1.0]),
        (1, vec![f64::NAN]),
        (1, vec![f64::INFINITY]),
    ] {
        assert!(Distribution2d::new(columns, weights.clone()).is_none(), "{columns} {weights:?}");
    }
}

#[test]
fn maps_refuse_what_is_not_light() {
    let map = |w, h, value: f32, scale, to_world| {
        EnvironmentMap::new(
            image(UVec2::new(w, h), vec![[1.0, value, 1.0]; w as usize * h as usize]),
            scale,
            to_world,
        )
    };
    assert!(map(2, 3, 1.0, 1.0, DMat3::IDENTITY).is_some());
    assert!(map(1, 3, 1.0, 1.0, DMat3::IDENTITY).is_none());
    assert!(map(2, 2, 1.0, 1.0, DMat3::IDENTITY).is_none());
    for value in [-1.0, f32::NAN, f32::INFINITY] {
        assert_eq!(map(2, 3, value, 1.0, DMat3::IDENTITY).is_some(), value == -1.0);
        assert!(map(2, 3, 1.0, value, DMat3::IDENTITY).is_none());
    }
    assert!(map(2, 3, 1.0, 1.0, DMat3::from_diagonal(DVec3::new(1.0, 2.0, 1.0))).is_none());
    assert!(map(2, 3, 1.0, 1.0, DMat3::ZERO).is_none());
    // A black map is no light.
    let black = map(2, 3, 1.0, 0.0, DMat3::IDENTITY).expect("a valid map");
    let scene = empty().emitter(Emitter::Map(black));
    let world = World::new(&scene);
    assert!(world.lights.sample_li(&receiver(), 0.5, Vec2::splat(0.5)).is_none());
    assert_eq!(world.lights.le_environment(Vec3::X), Rgb::ZERO);
}

fn spots() -> Vec<Spot> {
    let axis = Vec3::new(0.48, -0.6, 0.64);
    let spot = |cutoff: f64, beam_width: f64| Spot {
        position: Vec3::new(1.0, 2.0, 3.0),
        axis,
        intensity: Rgb::new(1.0, 2.0, 3.0),
        cutoff: cutoff.to_radians(),
        beam_width: beam_width.to_radians(),
    };
    vec![
        spot(20.0, 15.0),
        spot(60.0, 0.0),
        spot(35.0, 35.0),
        spot(150.0, 100.0),
        spot(0.05, 0.02),
        spot(180.0, 90.0),
    ]
}

/// Falls linearly with the angle from the beam's edge to the cutoff (Mitsuba's definition); what is emitted adds up to the integral of that, and
/// what a point receives is the intensity in its direction over the squared distance.
#[test]
fn spots_fall_off_linearly_with_the_angle() {
    let mut random = Random::new(6);
    let mut family = Family::default();
    for spot in spots() {
        let scene = empty().emitter(Emitter::Spot(spot));
        let world = World::new(&scene);
        let axis = spot.axis.as_dvec3().normalize();
        let falloff = |angle: f64| {
            if angle >= spot.cutoff {
                0.0
            } else if angle <= spot.beam_width {
                1.0
            } else {
                (spot.cutoff - angle) / (spot.cutoff - spot.beam_width)
            }
        };
        // Midpoint rule in the angle.
        let n = 200_000;
        let step = spot.cutoff / f64::from(n);
        let flux: f64 = (0..n)
            .map(|i| (f64::from(i) + 0.5) * step)
            .map(|angle| falloff(angle) * angle.sin() * step * TAU * f64::from(spot.intensity.y))
            .sum();
        let mut emitted = Moments::default();
        for _ in 0..SAMPLES {
            let sample =
                world.lights.sample_le(random.uniform_f64(), random.uniform_2d(), random.uniform_2d());
            let sample = sample.expect("a light");
            let (_, pdf) = world.lights.pdf_le(sample.light, None, sample.ray.d);
            assert_eq!(pdf, sample.pdf_direction_w);
            emitted.push(f64::from(sample.radiance.y / (sample.pdf_position * pdf)));
            let d = sample.ray.d.as_dvec3();
            let angle = axis.cross(d).length().atan2(axis.dot(d));
            // On the edge of a light without falloff rounding decides.
            if (angle - spot.cutoff).abs() < 1e-6 {
                continue;
            }
            let expected = falloff(angle) * f64::from(spot.intensity.y);
            assert!(
                (f64::from(sample.radiance.y) - expected).abs() < 1e-3 * f64::from(spot.intensity.y),
                "{spot:?}"
            );
            let from = SurfacePoint { p: sample.ray.o + sample.ray.d * 2.0, ..receiver() };
            let received = world.lights.sample_li(&from, random.uniform_f64(), random.uniform_2d());
            let received = received.map_or(0.0, |s| f64::from(s.radiance.y));
            assert!((received - expected / 4.0).abs() < 1e-3, "{spot:?}");
        }
        family.record(format!("flux of {spot:?}"), z_test(&emitted, flux));
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// Directions of a spot are uniform over its cone, in cells of equal solid angle about its axis, with that density; outside it is 0.
#[test]
fn spots_draw_directions_by_their_density() {
    const RINGS: usize = 16;
    const SECTORS: usize = 24;
    let mut random = Random::new(7);
    let mut family = Family::default();
    for spot in spots() {
        let scene = empty().emitter(Emitter::Spot(spot));
        let world = World::new(&scene);
        let axis = spot.axis.as_dvec3();
        let (x, y) = axis.any_orthonormal_pair();
        let cap = 2.0 * (spot.cutoff / 2.0).sin().powi(2);
        let mut counts = vec![0_u64; RINGS * SECTORS];
        for _ in 0..SAMPLES {
            let sample = world.lights.sample_le(0.5, Vec2::ZERO, random.uniform_2d()).expect("a light");
            let d = sample.ray.d.as_dvec3().normalize();
            assert!((f64::from(sample.pdf_direction_w) * TAU * cap - 1.0).abs() < 1e-5, "{spot:?}");
            let ring = (0.5 * (d - axis).length_squared() / cap * RINGS as f64) as usize;
            let sector = (d.dot(y).atan2(d.dot(x)) / TAU).rem_euclid(1.0) * SECTORS as f64;
            counts[ring.min(RINGS - 1) * SECTORS + (sector as usize).min(SECTORS - 1)] += 1;
            let mirrored = -sample.ray.d;
            let outside = mirrored.as_dvec3().angle_between(axis) > spot.cutoff + 1e-3;
            assert!(!outside || world.lights.pdf_le(sample.light, None, mirrored).1 == 0.0);
        }
        let expected = vec![SAMPLES as f64 / (RINGS * SECTORS) as f64; RINGS * SECTORS];
        // Directions in f32 cannot tell the cells of a cone of a twentieth of a degree apart.
        if spot.cutoff > 0.01 {
            family.record(format!("{spot:?}"), chi_squared(&counts, &expected));
        }
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}
