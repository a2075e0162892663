//! The f64 reference against closed forms, what it blames answers for, and the comparison of backends that rests on it.

use glam::{DAffine3, DQuat, DVec3, Vec3};
use helmholtz::query::reference::{Fault, Line, Opinion, crossings, nearest};
use helmholtz::query::{Hit, Ray};
use helmholtz::scene::{AnalyticKind, AnalyticShape, Geometry, Group, Instance, Shape};
use std::sync::Arc;

use crate::support::{Rng, analytic, icosphere, mesh, placed, shape};

/// The square [0,1]^2 at height `z`, split along the diagonal from the origin.
fn square(z: f32) -> Shape {
    let corners = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    mesh(corners.map(|[x, y]| Vec3::new(x, y, z)).into(), vec![[0, 1, 2], [0, 2, 3]])
}

fn down(x: f32, y: f32) -> Ray {
    Ray::new(Vec3::new(x, y, 3.0), Vec3::NEG_Z)
}

fn hit(shape: u32, primitive: u32, t: f32) -> Hit {
    Hit { shape, primitive, u: 0.0, v: 0.0, t }
}

#[test]
fn the_reference_meets_triangles_where_they_are() {
    let shapes = [square(0.0), square(1.0)];
    let found = crossings(&shapes, &Line::from(&down(0.5, 0.25)), 0.0);
    let named: Vec<_> = found.iter().map(|c| (c.shape, c.primitive, c.t, c.cosine)).collect();
    assert_eq!(named, [(0, 0, 3.0, 1.0), (1, 0, 2.0, 1.0)]);
    let first = nearest(&shapes, &down(0.25, 0.5)).expect("met");
    assert_eq!((first.shape, first.primitive, first.t), (1, 1, 2.0));
    // The interval is open at both ends.
    assert_eq!(nearest(&shapes, &Ray { t_min: 2.0, ..down(0.25, 0.5) }).expect("met").shape, 0);
    assert_eq!(nearest(&shapes, &Ray { t_min: 2.0, t_max: 3.0, ..down(0.25, 0.5) }), None);
    // A tilted line: through (0.5, 0.25, 0) at a slope of 3 to 4, so that distances are 5 to 4.
    let ray = Ray::new(Vec3::new(0.5, 0.25 - 3.0, 4.0), Vec3::new(0.0, 0.6, -0.8));
    let found = crossings(&shapes[..1], &Line::from(&ray), 0.0);
    assert!((found[0].t - 5.0).abs() < 1e-6 && (found[0].cosine - 0.8).abs() < 1e-7, "{found:?}");
}

#[test]
fn the_reference_meets_analytic_shapes_and_instances() {
    let turned = DQuat::from_rotation_x(0.5);
    let placed = |kind, at: DVec3, scale: DVec3| {
        let map = DAffine3::from_scale_rotation_translation(scale, turned, at);
        analytic(AnalyticShape::new(kind, map, false).expect("a shape"))
    };
    let at = DVec3::new(1.0, -2.0, 3.0);
    let shapes = [
        placed(AnalyticKind::Sphere, at, DVec3::splat(2.0)),
        placed(AnalyticKind::Disk, at, DVec3::new(2.0, 3.0, 1.0)),
        placed(AnalyticKind::Cylinder, at, DVec3::new(2.0, 2.0, 5.0)),
    ];
    // Along the axis of the disk and the cylinder: through the middle of one and through the other without touching it.
    let axis = turned * DVec3::Z;
    let line = Line { o: at - axis * 10.0, d: axis * 0.5 };
    let found = crossings(&shapes, &line, 0.0);
    let ts: Vec<_> = found.iter().map(|c| (c.shape, (c.t * 1e9).round() / 1e9)).collect();
    assert_eq!(ts, [(0, 16.0), (0, 24.0), (1, 20.0)]);
    // Across it, at half its height.
    let across = turned * DVec3::X;
    let line = Line { o: at + axis * 2.5 - across * 10.0, d: across };
    let found = crossings(&shapes[2..], &line, 0.0);
    let ts: Vec<_> = found.iter().map(|c| (c.t * 1e9).round() / 1e9).collect();
    assert_eq!(ts, [8.0, 12.0]);
    // Beyond its end there is nothing, and just before it something.
    let beyond =
        |z: f64| crossings(&shapes[2..], &Line { o: at + axis * z - across * 10.0, d: across }, 0.0).len();
    assert_eq!((beyond(5.001), beyond(4.999), beyond(-0.001)), (0, 2, 0));
    // The same sphere as an instance of a unit sphere, flattened: from (0, 0, 10) down to the height 0.5.
    let ball = analytic(AnalyticShape::sphere(DVec3::ZERO, 1.0).expect("a sphere"));
    let group = Arc::new(Group::new(vec![square(7.0), ball]).expect("a group"));
    let map = DAffine3::from_scale(DVec3::new(3.0, 3.0, 0.5));
    let instance = shape(Geometry::Instance(Instance::new(group, map).expect("an instance")));
    let found = crossings(&[instance], &Line { o: DVec3::Z * 10.0 + DVec3::X * 1e-3, d: DVec3::NEG_Z }, 0.0);
    assert_eq!(found.len(), 3, "{found:?}");
    assert_eq!((found[0].primitive, found[1].primitive, found[2].primitive), (0, 2, 2));
    assert!((found[0].t - 6.5).abs() < 1e-12 && (found[1].t - 9.5).abs() < 1e-6, "{found:?}");
}

#[test]
fn right_answers_are_not_blamed_and_wrong_ones_are() {
    let shapes = [square(0.0), square(1.0)];
    let ray = down(0.5, 0.25);
    let opinion = Opinion::new(&shapes, &ray);
    assert_eq!(opinion.judge_closest(Some(&hit(1, 0, 2.0))), None);
    assert_eq!(opinion.judge_closest(Some(&hit(1, 0, 2.000_001))), None);
    assert_eq!(opinion.judge_closest(None), Some(Fault::Missed { at: 2.0 }));
    assert_eq!(opinion.judge_closest(Some(&hit(0, 0, 3.0))), Some(Fault::Behind { at: 2.0 }));
    assert_eq!(opinion.judge_closest(Some(&hit(1, 1, 2.0))), Some(Fault::NotMet));
    assert_eq!(opinion.judge_closest(Some(&hit(7, 9, 2.0))), Some(Fault::NotMet));
    // Put back between the corners, a distance of anything is right for a triangle seen from straight above.
    assert_eq!(opinion.judge_closest(Some(&hit(1, 0, 2.5))), None);
    assert_eq!(opinion.judge_occlusion(true), None);
    assert_eq!(opinion.judge_occlusion(false), Some(Fault::Missed { at: 2.0 }));
    let short = Opinion::new(&shapes, &Ray { t_max: 1.9, ..ray });
    assert_eq!(short.judge_occlusion(true), Some(Fault::Imagined));
    assert_eq!(short.judge_occlusion(false), None);
    assert_eq!(short.judge_closest(Some(&hit(1, 0, 2.0))), Some(Fault::NotMet));
    // A tilted ray: its distance to the triangle is not that of a corner.
    let ray = Ray::new(Vec3::new(0.5, 0.25 - 3.0, 4.0), Vec3::new(0.0, 0.6, -0.8));
    let opinion = Opinion::new(&shapes[..1], &ray);
    assert_eq!(opinion.judge_closest(Some(&hit(0, 0, 5.0))), None);
    assert!(matches!(opinion.judge_closest(Some(&hit(0, 0, 5.1))), Some(Fault::Distance { .. })));
}

#[test]
fn edges_within_a_mesh_are_sure_and_borders_are_not() {
    let shapes = [square(0.0)];
    // The diagonal: either triangle is right, none is not.
    let within = Opinion::new(&shapes, &down(0.5, 0.5));
    assert_eq!(within.judge_closest(Some(&hit(0, 0, 3.0))), None);
    assert_eq!(within.judge_closest(Some(&hit(0, 1, 3.0))), None);
    assert_eq!(within.judge_closest(None), Some(Fault::Missed { at: 3.0 }));
    // The border of the square: hit or miss is right, by less than rounding outside too.
    for x in [0.0, -1e-7, 1e-7] {
        let border = Opinion::new(&shapes, &down(x, 0.5));
        assert_eq!(border.judge_closest(Some(&hit(0, 1, 3.0))), None);
        assert_eq!(border.judge_closest(None), None);
        assert_eq!((border.judge_occlusion(true), border.judge_occlusion(false)), (None, None));
    }
    let outside = Opinion::new(&shapes, &down(-1e-4, 0.5));
    assert_eq!(outside.judge_closest(Some(&hit(0, 1, 3.0))), Some(Fault::NotMet));
    assert_eq!(outside.judge_closest(None), None);
    // A vertex where many triangles meet, exactly aimed at, on a closed mesh.
    let (positions, triangles) = icosphere(3);
    let globe = [mesh(placed(&positions, 1.0, DVec3::ZERO), triangles)];
    let mut rng = Rng(31);
    for target in &positions {
        let o = (rng.cube() * 0.1).as_vec3();
        let ray = Ray::new(o, (target - o.as_dvec3()).normalize().as_vec3());
        let missed = Opinion::new(&globe, &ray).judge_closest(None);
        assert!(matches!(missed, Some(Fault::Missed { .. })), "{ray:?}: {missed:?}");
    }
}
