//! The `obvhs` backend: the shared suite, and what only it promises.

use glam::{DVec3, Vec3};
use helmholtz::query::BuildQuality;
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::{Ray, RayQuery};
use helmholtz::scene::Shape;

use crate::query::Backend;
use crate::support::{Rng, icosphere, mesh, placed};

struct Obvhs;

impl Backend for Obvhs {
    type Query<'s> = ObvhsQuery<'s>;

    fn build(shapes: &[Shape]) -> ObvhsQuery<'_> {
        ObvhsQuery::new(shapes, BuildQuality::default())
    }
}

crate::query::suite!(Obvhs);

#[test]
fn denormal_and_huge_coordinates() {
    let (positions, triangles) = icosphere(3);
    for scale in [1e-41, 1e-30, 1e17] {
        let shapes = [mesh(placed(&positions, scale, DVec3::ZERO), triangles.clone())];
        for quality in [BuildQuality::Low, BuildQuality::Medium, BuildQuality::High] {
            let query = ObvhsQuery::new(&shapes, quality);
            let mut rng = Rng(11);
            for _ in 0..1000 {
                let ray = Ray::new(Vec3::ZERO, rng.direction().as_vec3());
                let hit = query.intersect(&ray).expect("the sphere is closed");
                // The mesh lies within 1 % of the sphere; denormals round to 1e-45.
                assert!((f64::from(hit.t) / scale - 1.0).abs() < 0.02, "{hit:?} at scale {scale:e}");
            }
        }
    }
}

/// Meshes on which clustering of nearest neighbours finds nothing but ties.
fn tied_meshes(n: u32) -> [Shape; 3] {
    let pile = mesh(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]; n as usize]);
    let strip_positions = (0..n + 2).map(|i| Vec3::new((i / 2) as f32, (i % 2) as f32, 0.0)).collect();
    let strip = mesh(strip_positions, (0..n).map(|i| [i, i + 1, i + 2]).collect());
    let line_positions = (0..=n).map(|i| Vec3::X * i as f32).collect();
    let line = mesh(line_positions, (0..n).map(|i| [i, i + 1, i]).collect());
    [pile, strip, line]
}

#[test]
fn ties_do_not_make_the_build_quadratic() {
    // Without a remedy this takes hours.
    let n = 200_000;
    let [pile, strip, line] = tied_meshes(n);
    let down = |x: f32| Ray::new(Vec3::new(x, 0.25, 1.0), Vec3::NEG_Z);
    assert!(ObvhsQuery::new(&[pile], BuildQuality::Medium).intersect(&down(0.25)).is_some());
    let strip = [strip];
    let query = ObvhsQuery::new(&strip, BuildQuality::Medium);
    for i in 0..1000 {
        let hit = query.intersect(&down(i as f32 + 0.25)).expect("the strip has no holes");
        assert_eq!(hit.primitive, 2 * i);
    }
    assert!(!ObvhsQuery::new(&[line], BuildQuality::Medium).occluded(&down(3.5)));
}

#[test]
fn hits_do_not_depend_on_the_number_of_threads() {
    // Copies of a mesh, so that a change in the tree shows in which copy is found. Large enough for obvhs to go parallel.
    let (positions, triangles) = icosphere(7);
    let positions = placed(&positions, 1.0, DVec3::ZERO);
    let shapes: Vec<Shape> = (0..3).map(|_| mesh(positions.clone(), triangles.clone())).collect();
    let hits = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
        let query = pool.install(|| ObvhsQuery::new(&shapes, BuildQuality::Medium));
        let mut rng = Rng(12);
        (0..20_000)
            .map(|_| query.intersect(&Ray::new(Vec3::ZERO, rng.direction().as_vec3())))
            .collect::<Vec<_>>()
    };
    let one = hits(1);
    assert!(one.iter().all(Option::is_some));
    assert_eq!(one, hits(2));
    assert_eq!(one, hits(5));
}

#[test]
fn nested_shells_of_all_sizes() {
    // A tree over 2^-k scaled copies is a chain; rays from the centre must find the innermost one.
    let (positions, triangles) = icosphere(1);
    let shapes: Vec<Shape> =
        (0..120).map(|k| mesh(placed(&positions, 0.5f64.powi(k), DVec3::ZERO), triangles.clone())).collect();
    let query = ObvhsQuery::new(&shapes, BuildQuality::Medium);
    let mut rng = Rng(13);
    for _ in 0..2000 {
        let d = rng.direction();
        let hit = query.intersect(&Ray::new(Vec3::ZERO, d.as_vec3())).expect("the shells are closed");
        assert_eq!(hit.shape, 119);
        let hit =
            query.intersect(&Ray::new((d * 9.0).as_vec3(), (-d).as_vec3())).expect("the shells are closed");
        assert_eq!(hit.shape, 0);
    }
}

#[test]
fn borders_belong_to_a_lone_square() {
    // Rays that run exactly along a side of all boxes, where no neighbour would catch them; zeros of both signs.
    let corners = vec![Vec3::ZERO, Vec3::X, Vec3::new(1.0, 1.0, 0.0), Vec3::Y];
    let shapes = [mesh(corners, vec![[0, 1, 2], [0, 2, 3]])];
    let query = ObvhsQuery::new(&shapes, BuildQuality::Medium);
    for zero in [0.0, -0.0] {
        for (x, y) in
            [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.5, 0.0), (1.0, 0.5), (0.5, 1.0), (0.0, 0.5)]
        {
            let ray = Ray::new(Vec3::new(x, y, 2.0), Vec3::new(zero, zero, -1.0));
            assert_eq!(query.intersect(&ray).map(|hit| hit.t), Some(2.0), "{ray:?}");
        }
    }
}
