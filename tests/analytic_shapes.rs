//! Spheres, disks and cylinders: distances, and rays that leave their surfaces.

use glam::{DAffine3, DMat3, DQuat, DVec3, Vec3};
use helmholtz::query::{Ray, analytic::intersect};
use helmholtz::scene::{AnalyticKind, AnalyticShape, SurfacePoint};

use crate::support::Rng;

const KINDS: [AnalyticKind; 3] = [AnalyticKind::Sphere, AnalyticKind::Disk, AnalyticKind::Cylinder];

/// A shape of a given size, turned at random, around or (cylinder) above `center`.
fn random_shape(rng: &mut Rng, kind: AnalyticKind, size: f64, center: DVec3) -> AnalyticShape {
    let turn = DMat3::from_quat(DQuat::from_axis_angle(rng.direction(), rng.unit() * 6.0));
    let length = if kind == AnalyticKind::Cylinder { 3.0 } else { 1.0 };
    let map = turn * DMat3::from_diagonal(DVec3::new(size, size, size * length));
    AnalyticShape::new(kind, DAffine3::from_mat3_translation(map, center), false).expect("a similarity")
}

/// A random point of the unit shape.
fn random_point(rng: &mut Rng, kind: AnalyticKind) -> DVec3 {
    let p = rng.direction();
    match kind {
        AnalyticKind::Sphere => p,
        AnalyticKind::Disk => p.with_z(0.0),
        AnalyticKind::Cylinder => p.with_z(0.0).normalize().with_z(rng.unit()),
    }
}

#[test]
fn rays_aimed_at_a_point_arrive_there() {
    let mut rng = Rng(1);
    for kind in KINDS {
        for size in [1e-4, 1.0, 1e4] {
            let center = rng.cube() * size;
            let shape = random_shape(&mut rng, kind, size, center);
            for _ in 0..2000 {
                // From outside the shape's hull; rays from the wrong side see another part of it first.
                let target = shape.to_world().transform_point3(random_point(&mut rng, kind));
                let o = (center + rng.direction() * size * 20.0).as_vec3();
                let d = (target - o.as_dvec3()).normalize().as_vec3();
                let t = intersect(&shape, &Ray::new(o, d)).map(f64::from);
                let expected = (target - o.as_dvec3()).length();
                let n = shape.to_object().matrix3 * d.as_dvec3();
                if kind == AnalyticKind::Disk && n.z.abs() / n.length() < 0.05 {
                    continue;
                }
                if let Some(t) = t {
                    // Where t falls short, the point must be on the surface all the same, and nearer.
                    let p = shape.to_object().transform_point3(o.as_dvec3() + d.as_dvec3() * t);
                    let off = match kind {
                        AnalyticKind::Sphere => p.length() - 1.0,
                        AnalyticKind::Disk => p.z,
                        AnalyticKind::Cylinder => p.with_z(0.0).length() - 1.0,
                    };
                    // t has 24 bits and is about 20 sizes.
                    assert!(off.abs() < 20.0 * 1e-7, "{kind:?} of size {size}: {p} is {off} off");
                    assert!(t < expected + size * 0.05, "{kind:?} of size {size}: {t} is beyond {expected}");
                } else {
                    // Aimed at the silhouette or rim, rounding may miss.
                    let p = shape.to_object().transform_point3(target);
                    let radial = if kind == AnalyticKind::Sphere { p } else { p.with_z(0.0) };
                    let silhouette = radial.dot(n.normalize()).abs() < 0.01;
                    let excused = match kind {
                        AnalyticKind::Sphere => silhouette,
                        AnalyticKind::Disk => p.length() > 0.9999,
                        AnalyticKind::Cylinder => silhouette || p.z < 1e-4 || p.z > 0.9999,
                    };
                    assert!(excused, "{kind:?} of size {size} missed at {p}");
                }
            }
        }
    }
}

#[test]
fn chords_of_spheres_from_inside() {
    // From a point inside, the two opposite distances multiply to r^2 - |o|^2 (power of a point).
    let mut rng = Rng(2);
    for radius in [1e-4, 1.0, 1e4] {
        for away in [0.0, 1.0, 1e2] {
            let center = (rng.direction() * away * radius).as_vec3().as_dvec3();
            let sphere = AnalyticShape::sphere(center, radius).expect("a sphere");
            for _ in 0..2000 {
                let o = (center + rng.direction() * rng.unit() * 0.99 * radius).as_vec3();
                let d = rng.direction().as_vec3();
                let [t, s] =
                    [d, -d].map(|d| f64::from(intersect(&sphere, &Ray::new(o, d)).expect("o is inside")));
                let power = radius * radius - (o.as_dvec3() - center).length_squared();
                let length = d.as_dvec3().length_squared();
                assert!(
                    (t * s * length / power - 1.0).abs() < 3e-7,
                    "radius {radius}: {t} * {s} is not {power}"
                );
            }
        }
    }
}

#[test]
fn small_distant_spheres() {
    // Seen from 1e4 radii away, the near point of the axis is at distance - radius.
    for radius in [1e-4, 1.0, 1e4] {
        let distance = 1e4 * radius;
        let sphere = AnalyticShape::sphere(DVec3::Z * distance, radius).expect("a sphere");
        let t = intersect(&sphere, &Ray::new(Vec3::ZERO, Vec3::Z)).expect("it is in front");
        assert_eq!(t, (distance - radius) as f32);
        // 1 +- 1e-6 of the radius beside the axis: inside and outside the silhouette.
        for (share, hit) in [(1.0 - 1e-6, true), (1.0 + 1e-6, false)] {
            let o = Vec3::X * (radius * share) as f32;
            assert_eq!(intersect(&sphere, &Ray::new(o, Vec3::Z)).is_some(), hit, "radius {radius}, {share}");
        }
    }
}

#[test]
fn open_cylinders_have_no_caps() {
    let cylinder = AnalyticShape::new(AnalyticKind::Cylinder, DAffine3::IDENTITY, false).expect("a cylinder");
    assert_eq!(intersect(&cylinder, &Ray::new(Vec3::new(0.5, 0.0, -1.0), Vec3::Z)), None);
    // In through the opening, out through the wall: z = -0.5 + t 0.8, x = t 0.6 = 1.
    let hit = intersect(&cylinder, &Ray::new(Vec3::new(0.0, 0.0, -0.5), Vec3::new(0.6, 0.0, 0.8)));
    assert!((hit.expect("the wall") - 1.0 / 0.6).abs() < 1e-6);
    // Over the rim of the near wall (z = 1.06 there) to the far wall (z = 0.475).
    let hit = intersect(&cylinder, &Ray::new(Vec3::new(-2.0, 0.0, 1.35), Vec3::new(0.96, 0.0, -0.28)));
    assert!((hit.expect("the far wall") - 3.0 / 0.96).abs() < 1e-6);
    assert_eq!(intersect(&cylinder, &Ray::new(Vec3::new(-2.0, 0.0, 1.25), Vec3::X)), None);
}

#[test]
fn spawned_rays_leave_the_surface() {
    let mut rng = Rng(3);
    for kind in KINDS {
        for size in [1e-4, 1.0, 1e4] {
            for away in [0.0, 1.0, 1e2, 1e4] {
                let center = rng.direction() * away * size;
                let shape = random_shape(&mut rng, kind, size, center);
                for _ in 0..1500 {
                    let point = SurfacePoint::on_analytic(&shape, 0, random_point(&mut rng, kind));
                    check_outwards(&mut rng, &shape, &point, kind, size);
                    check_inwards(&mut rng, &shape, &point, kind, size);
                }
            }
        }
    }
}

#[test]
fn spawned_rays_leave_a_surface_at_the_origin() {
    // Where all coordinates are about 0 an error bound relative to them would vanish.
    let mut rng = Rng(4);
    for kind in KINDS {
        for size in [1e-4, 1.0, 1e4] {
            for _ in 0..1500 {
                let on_shape = random_point(&mut rng, kind);
                let centered = random_shape(&mut rng, kind, size, DVec3::ZERO);
                let map = centered.to_world().matrix3;
                let moved = DAffine3::from_mat3_translation(map, -(map * on_shape));
                let shape = AnalyticShape::new(kind, moved, false).expect("a similarity");
                let point = SurfacePoint::on_analytic(&shape, 0, on_shape);
                check_outwards(&mut rng, &shape, &point, kind, size);
                check_inwards(&mut rng, &shape, &point, kind, size);
            }
        }
    }
}

/// A direction on the side of `n`, half of the time within 1e-3 of the tangent plane.
fn on_side(rng: &mut Rng, n: Vec3) -> Vec3 {
    let n = n.as_dvec3();
    let tilt = if rng.bits().is_multiple_of(2) { 1.0 } else { 1e-3 };
    let tangent = rng.direction().cross(n).normalize();
    let d = (tangent + n * rng.unit() * tilt).normalize().as_vec3();
    if d.dot(n.as_vec3()) < 0.0 { tangent.as_vec3() } else { d }
}

fn check_outwards(rng: &mut Rng, shape: &AnalyticShape, point: &SurfacePoint, kind: AnalyticKind, size: f64) {
    let d = on_side(rng, point.ng);
    let ray = Ray::spawn(point, d);
    assert_eq!(intersect(shape, &ray), None, "{kind:?} of size {size}: {ray:?} from {point:?} comes back");
}

fn check_inwards(rng: &mut Rng, shape: &AnalyticShape, point: &SurfacePoint, kind: AnalyticKind, size: f64) {
    let d = on_side(rng, -point.ng);
    let ray = Ray::spawn(point, d);
    let found = intersect(shape, &ray).map(f64::from);
    // A chord that leaves at sine s from the tangent plane of a circle has length 2 r s.
    let sine = -d.as_dvec3().dot(point.ng.as_dvec3());
    let across = shape.to_world().matrix3.x_axis.length();
    // Normal and direction have f32 components: the sine is uncertain by 2e-7.
    let tilt = 2.0 * across * 2e-7;
    match kind {
        AnalyticKind::Disk => assert_eq!(found, None, "{kind:?} of size {size}: {ray:?} comes back"),
        AnalyticKind::Sphere => {
            let chord = 2.0 * across * sine;
            // The offset from the surface shortens the chord by itself over the sine.
            let tolerance = 3.0 * f64::from(point.p_err) / sine + 1e-6 * chord + tilt;
            if tolerance < 0.3 * chord {
                let t = found.unwrap_or_else(|| {
                    panic!("size {size}: {ray:?} from {point:?} does not reach the far side")
                });
                assert!((t - chord).abs() < tolerance, "size {size}: {t} instead of {chord}: {ray:?}");
            }
        }
        // The far side may lie beyond the rim; what is found must not be where the ray began.
        AnalyticKind::Cylinder => {
            let axis = shape.to_world().matrix3.z_axis.normalize();
            let flat = d.as_dvec3() - axis * d.as_dvec3().dot(axis);
            let chord = 2.0 * across * sine / flat.length_squared();
            let tolerance =
                (3.0 * f64::from(point.p_err) / sine + tilt) / flat.length_squared() + 1e-6 * chord;
            if tolerance < 0.3 * chord {
                assert!(
                    found.is_none_or(|t| (t - chord).abs() < tolerance),
                    "size {size}: {found:?} instead of {chord}: {ray:?}"
                );
            }
        }
    }
}
