//! The f64 reference against closed forms, what it blames answers for, and the comparison of backends that rests on it.

use std::sync::Arc;

use glam::{DAffine3, DQuat, DVec3, Vec3};
use helmholtz::film::{AovSet, Film, Image};
use helmholtz::integrators::Integrator;
use helmholtz::query::crosscheck::{Crosscheck, Findings, parse_query};
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::reference::{Fault, Line, Opinion, crossings, nearest};
use helmholtz::query::{AnyQuery, Backend, BuildQuality, Hit, Ray, RayQuery};
use helmholtz::render::{Control, Stop, Target, render};
use helmholtz::scene::load::{LoadOptions, load};
use helmholtz::scene::{Aabb, AnalyticKind, AnalyticShape, Geometry, Group, Instance, Scene, Shape};
use helmholtz::transport::World;

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

/// What a backend may get wrong.
#[derive(Clone, Copy)]
enum Lie {
    /// Hits of even primitives are lost.
    Blind,
    /// The next primitive is named.
    WrongName,
    /// Distances are a tenth too great, for surface and all.
    WrongPlace,
    /// What is seen is the far side.
    SeesThrough,
    /// The other triangle of a square is named.
    Neighbour,
    /// Everything is in the way.
    AlwaysOccluded,
}

struct Liar<'s>(ObvhsQuery<'s>, Lie);

impl RayQuery for Liar<'_> {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        let hit = self.0.intersect(ray)?;
        match self.1 {
            Lie::Blind => (hit.primitive % 2 == 1).then_some(hit),
            Lie::WrongName => Some(Hit { primitive: hit.primitive ^ 64, ..hit }),
            Lie::WrongPlace => Some(Hit { t: hit.t * 1.1, ..hit }),
            Lie::Neighbour => Some(Hit { primitive: hit.primitive ^ 1, ..hit }),
            Lie::SeesThrough => self.0.intersect(&Ray { t_min: hit.t.next_up() + 1e-3, ..*ray }),
            Lie::AlwaysOccluded => Some(hit),
        }
    }

    fn occluded(&self, ray: &Ray) -> bool {
        match self.1 {
            Lie::AlwaysOccluded => true,
            _ => self.intersect(ray).is_some(),
        }
    }

    fn bounds(&self) -> Aabb {
        self.0.bounds()
    }

    fn memory(&self) -> usize {
        self.0.memory()
    }

    fn name(&self) -> String {
        "liar".to_owned()
    }
}

fn globe() -> Vec<Shape> {
    let (positions, triangles) = icosphere(3);
    vec![mesh(placed(&positions, 1.0, DVec3::ZERO), triangles)]
}

#[test]
fn each_kind_of_lie_is_found_and_the_liar_named() {
    let shapes = globe();
    for lie in [Lie::Blind, Lie::WrongName, Lie::WrongPlace, Lie::SeesThrough, Lie::AlwaysOccluded] {
        let good = || ObvhsQuery::new(&shapes, BuildQuality::Medium);
        let check = Crosscheck::new(&shapes, good(), Liar(good(), lie));
        let mut rng = Rng(32);
        let mut hits = 0;
        for _ in 0..400 {
            // From outside through the globe, and rays that miss it.
            let o = rng.direction() * 3.0;
            let d = (rng.cube() * 0.9 - o).normalize();
            let ray = Ray::new(o.as_vec3(), d.as_vec3());
            hits += usize::from(check.intersect(&ray).is_some());
            check.occluded(&Ray { t_max: 1.5, ..ray });
        }
        assert!(hits > 150, "{hits}");
        let found = check.findings();
        assert_eq!((found.closest, found.occlusion, found.not_judged), (400, 400, 0));
        let named = |fault: fn(&Fault) -> bool| {
            found.faults.iter().filter(|j| j.faults[1].is_some_and(|f| fault(&f))).count()
        };
        assert!(found.faults.iter().all(|j| j.faults[0].is_none()), "{found:?}");
        let count = match lie {
            Lie::Blind => named(|f| matches!(f, Fault::Missed { .. })),
            Lie::WrongName | Lie::Neighbour => named(|f| matches!(f, Fault::NotMet)),
            // Beyond the corners a distance is put back; what it says is wrong nevertheless, unless the triangle is seen from straight above.
            Lie::WrongPlace => named(|f| matches!(f, Fault::Distance { .. })),
            Lie::SeesThrough => named(|f| matches!(f, Fault::Behind { .. })),
            Lie::AlwaysOccluded => named(|f| matches!(f, Fault::Imagined)),
        };
        assert!(count > 100, "{count} of {} faults, {} ties", found.faults.len(), found.ties);
    }
}

/// Rays from within a closed mesh, aimed at its vertices and edges exactly.
#[cfg(feature = "embree")]
fn aimed(positions: &[DVec3], triangles: &[[u32; 3]], mut ask: impl FnMut(&Ray)) {
    let mut rng = Rng(33);
    let middles = triangles.iter().map(|&[a, b, _]| (positions[a as usize] + positions[b as usize]) * 0.5);
    for target in positions.iter().copied().chain(middles) {
        let o = (rng.cube() * 0.1).as_vec3();
        ask(&Ray::new(o, (target - o.as_dvec3()).normalize().as_vec3()));
    }
}

#[test]
fn the_other_triangle_of_an_edge_is_a_tie_there_and_a_fault_beside_it() {
    // Squares split along their diagonals, at dyadic places: rays meet the diagonals to the last bit.
    const N: u32 = 8;
    let at = |i: u32| i as f32 / N as f32;
    let mut positions = Vec::new();
    let mut triangles = Vec::new();
    for i in 0..N {
        for j in 0..N {
            let first = positions.len() as u32;
            positions.extend(
                [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)].map(|(x, y)| Vec3::new(at(x), at(y), 0.0)),
            );
            triangles.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
        }
    }
    let shapes = [mesh(positions, triangles)];
    for (beside, expected) in [(0.25, (64, 0)), (0.5, (0, 64))] {
        let good = || ObvhsQuery::new(&shapes, BuildQuality::Medium);
        let check = Crosscheck::new(&shapes, good(), Liar(good(), Lie::Neighbour));
        for i in 0..N {
            for j in 0..N {
                let (x, y) = (i as f32 + 0.25, j as f32 + beside);
                assert!(check.intersect(&down(x / N as f32, y / N as f32)).is_some());
            }
        }
        let found = check.findings();
        assert_eq!((found.ties, found.faults.len()), expected, "{:?}", found.faults);
        assert!(found.faults.iter().all(|j| j.faults == [None, Some(Fault::NotMet)]), "{:?}", found.faults);
    }
}

/// Fast mode loses rays at edges (vendor-notes/embree.md), which is what a crosscheck is to find.
#[cfg(feature = "embree")]
#[test]
fn leaks_of_fast_mode_are_faults() {
    use helmholtz::query::embree::{EmbreeQuery, EmbreeSettings};
    let (positions, triangles) = icosphere(5);
    let shapes = [mesh(placed(&positions, 1.0, DVec3::ZERO), triangles.clone())];
    let fast = EmbreeQuery::new(&shapes, EmbreeSettings { robust: false, ..EmbreeSettings::default() })
        .expect("Embree");
    let check = Crosscheck::new(&shapes, ObvhsQuery::new(&shapes, BuildQuality::Medium), fast);
    aimed(&positions, &triangles, |ray| {
        check.intersect(ray);
    });
    let found = check.findings();
    assert!(found.faults.len() as u64 + found.not_judged > 10, "{} faults", found.faults.len());
    for judged in &found.faults {
        assert!(matches!(judged.faults, [None, Some(Fault::Missed { .. })]), "{judged:?}");
    }
}

#[test]
fn disputes_beyond_the_room_are_counted() {
    let shapes = globe();
    let good = || ObvhsQuery::new(&shapes, BuildQuality::Medium);
    let check = Crosscheck::new(&shapes, good(), Liar(good(), Lie::AlwaysOccluded));
    for i in 0..1500 {
        check.occluded(&Ray { t_max: 0.5, ..Ray::new(Vec3::new(0.0, 0.0, i as f32 * 1e-5), Vec3::X) });
    }
    let found = check.findings();
    assert_eq!((found.faults.len(), found.not_judged, found.is_clean()), (1024, 476, false));
}

#[test]
fn queries_survive_being_written_down() {
    let shapes = globe();
    let good = || ObvhsQuery::new(&shapes, BuildQuality::Medium);
    let check = Crosscheck::new(&shapes, good(), Liar(good(), Lie::Blind));
    let mut rng = Rng(34);
    for _ in 0..50 {
        let ray = Ray {
            t_min: 1e-30,
            t_max: 1e30,
            ..Ray::new((rng.cube() * 0.5).as_vec3(), rng.direction().as_vec3())
        };
        check.intersect(&ray);
        check.occluded(&ray);
    }
    let faults = check.findings().faults;
    assert!(faults.len() > 20);
    for judged in faults {
        let (is_occlusion, ray) = parse_query(&judged.dispute.to_string()).expect("as written");
        assert_eq!(ray, judged.dispute.ray);
        assert_eq!(is_occlusion, judged.dispute.to_string().starts_with("occluded"));
    }
    for bad in [
        "",
        "closest",
        "nearest 0 0 0 0 0 1 0 inf",
        "closest 0 0 0 0 0 1 0",
        "closest 0 0 0 0 0 1 0 inf 7",
        "closest 0 0 x 0 0 1 0 inf",
    ] {
        assert!(parse_query(bad).is_err(), "{bad}");
    }
}

fn image<Q: RayQuery>(scene: &Scene, query: &Q, integrator: &str) -> (Image, u64) {
    let world = World::new(scene);
    let mut film = Film::new(&scene.film, AovSet::default(), world.lights.radiance_unit()).expect("a film");
    let parameters = [("max_depth".to_owned(), "5".to_owned())];
    let target = Target { integrator: Integrator::new(integrator, &parameters).expect("known"), seed: 3 };
    let stop = Stop { passes: 0..2, time: None };
    let done = render(&world, query, &target, &mut film, &stop, |_| Control::Continue).expect("rendered");
    (film.develop(), done.rays)
}

fn crosscheck_of(query: &AnyQuery) -> Findings {
    let AnyQuery::Crosscheck(crosscheck) = query else { panic!("no crosscheck") };
    crosscheck.findings()
}

/// The image is that of the first backend to the last bit, and every ray is compared.
#[test]
fn a_crosscheck_renders_what_its_first_backend_does() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box.xml");
    let mut scene = load(&path, &LoadOptions::default()).expect("a scene").scene;
    scene.film.size = glam::UVec2::splat(24);
    scene.film.crop.size = scene.film.size;
    for integrator in ["path", "ptracer", "bdpt"] {
        let first = Backend::default().build(&scene.shapes).expect("built");
        let both = Backend::Crosscheck.build(&scene.shapes).expect("built");
        let (expected, rays) = image(&scene, &first, integrator);
        assert_eq!(image(&scene, &both, integrator).0, expected, "{integrator}");
        let found = crosscheck_of(&both);
        assert!(found.is_clean(), "{integrator}: {:?}", found.faults);
        assert!(
            found.closest + found.occlusion >= rays && rays > 1000,
            "{integrator}: {found:?}, {rays} rays"
        );
    }
}
