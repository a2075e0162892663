//! Emitters: sampling against density, and light that leaves them against light that arrives.
//!
//! Places on a light are counted in cells of its surface, and what each cell should get is the density integrated over it by quadrature in
//! coordinates that this file lays on the surface itself, so that the expectation shares no code with the sampling.

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec2, Vec3};
use helmholtz::query::BuildQuality;
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::{Ray, RayQuery};
use helmholtz::scene::{
    AnalyticKind, AnalyticShape, Bitmap, Emitter, EnvironmentMap, Geometry, Input, MeshAttribute, Place, Rgb,
    Scene, Spot, SurfacePoint, TexelFilter, Texture, TextureId, Textures, TriangleMesh, Wrap,
};
use helmholtz::transport::World;

use crate::scene_builder::{Build, checkered, diffuse, empty, image, quad, sphere};
use crate::statistics::{FALSE_ALARM_RATE, Family, Moments, Random, chi_squared, z_test_two};

const CELLS: usize = 12;

/// A light with its own coordinates: position, normal and area per unit square at (a, b), and the other way round from
/// a surface point found by a ray.
struct Charted {
    name: &'static str,
    geometry: Geometry,
    at: fn(f64, f64) -> (DVec3, DVec3, f64),
    locate: fn(&SurfacePoint) -> (f64, f64),
}

const QUAD_CORNER: DVec3 = DVec3::new(-1.0, 2.0, -0.5);
const QUAD_EX: DVec3 = DVec3::new(2.0, 0.0, 0.0);
const QUAD_EY: DVec3 = DVec3::new(0.0, 0.0, 1.0);
const TRIANGLE: [DVec3; 3] =
    [DVec3::new(-1.0, 2.0, -0.5), DVec3::new(2.0, 2.5, 0.0), DVec3::new(0.3, 1.5, 1.2)];
const CENTER: DVec3 = DVec3::new(0.5, 2.0, 0.25);
const RADIUS: f64 = 0.75;

fn charted_lights() -> Vec<Charted> {
    // The shape's own z axis becomes `axis`, which is up or down.
    let turned = |kind, axis: DVec3, scale| {
        let rotation =
            glam::DMat3::from_cols(DVec3::X, axis.cross(DVec3::X), axis) * glam::DMat3::from_diagonal(scale);
        let to_world = glam::DAffine3::from_mat3_translation(rotation, CENTER);
        Geometry::Analytic(AnalyticShape::new(kind, to_world, false).expect("a proper shape"))
    };
    let mesh = |corners: &[DVec3], triangles: Vec<[u32; 3]>, uvs: Vec<Vec2>| {
        let positions = corners.iter().map(|p| p.as_vec3()).collect();
        Geometry::Mesh(TriangleMesh::new(positions, triangles, Vec::new(), uvs, false).expect("a valid mesh"))
    };
    let (c, ex, ey) = (QUAD_CORNER, QUAD_EX, QUAD_EY);
    vec![
        Charted {
            name: "rectangle",
            geometry: mesh(
                &[c, c + ex, c + ex + ey, c + ey],
                vec![[0, 1, 2], [0, 2, 3]],
                vec![Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y],
            ),
            at: |a, b| {
                let n = QUAD_EX.cross(QUAD_EY);
                (QUAD_CORNER + QUAD_EX * a + QUAD_EY * b, n.normalize(), n.length())
            },
            locate: |p| (f64::from(p.uv.x), f64::from(p.uv.y)),
        },
        Charted {
            name: "triangle",
            geometry: mesh(&TRIANGLE, vec![[0, 1, 2]], Vec::new()),
            at: |a, b| {
                let (e1, e2) = (TRIANGLE[1] - TRIANGLE[0], TRIANGLE[2] - TRIANGLE[0]);
                let n = e1.cross(e2);
                (TRIANGLE[0] + e1 * (a * (1.0 - b)) + e2 * b, n.normalize(), n.length() * (1.0 - b))
            },
            locate: |p| {
                let b = f64::from(p.uv.y);
                (f64::from(p.uv.x) / (1.0 - b).max(1e-9), b)
            },
        },
        Charted {
            name: "sphere",
            geometry: sphere(CENTER.as_vec3(), RADIUS as f32),
            at: |a, b| {
                let (phi, theta) = (TAU * a, PI * b);
                let n = DVec3::new(theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos());
                (CENTER + RADIUS * n, n, TAU * PI * theta.sin() * RADIUS * RADIUS)
            },
            locate: |p| {
                let n = (p.p.as_dvec3() - CENTER).normalize();
                ((n.y.atan2(n.x) / TAU).rem_euclid(1.0), n.z.acos() / PI)
            },
        },
        Charted {
            name: "disk",
            geometry: turned(AnalyticKind::Disk, -DVec3::Y, DVec3::splat(RADIUS)),
            at: |a, b| {
                let (r, phi) = (RADIUS * a, TAU * b);
                (CENTER + DVec3::new(r * phi.cos(), 0.0, r * phi.sin()), -DVec3::Y, TAU * RADIUS * r)
            },
            locate: |p| {
                let q = p.p.as_dvec3() - CENTER;
                (q.x.hypot(q.z) / RADIUS, (q.z.atan2(q.x) / TAU).rem_euclid(1.0))
            },
        },
        Charted {
            name: "cylinder",
            geometry: turned(AnalyticKind::Cylinder, DVec3::Y, DVec3::new(RADIUS, RADIUS, 1.5)),
            at: |a, b| {
                let phi = TAU * a;
                let n = DVec3::new(phi.cos(), 0.0, phi.sin());
                (CENTER + RADIUS * n + DVec3::Y * (1.5 * b), n, TAU * RADIUS * 1.5)
            },
            locate: |p| {
                let q = p.p.as_dvec3() - CENTER;
                ((q.z.atan2(q.x) / TAU).rem_euclid(1.0), q.y / 1.5)
            },
        },
    ]
}

/// A point that receives light, with a normal that sees all of it.
fn receiver(p: Vec3) -> SurfacePoint {
    let n = (CENTER.as_vec3() - p).normalize();
    SurfacePoint { p, p_err: 1e-6, ng: n, ns: n, uv: Vec2::ZERO, shape: 0, primitive: 0 }
}

fn lit_by(geometry: Geometry) -> Scene {
    empty().shape(geometry, diffuse(0.0), Some(Rgb::splat(2.0)))
}

/// Integrates over a cell with 8 x 8 points of Gauss and Legendre.
fn integrate_cell(f: impl Fn(f64, f64) -> f64, i: usize, j: usize) -> f64 {
    const NODES: [(f64, f64); 4] = [
        (0.183_434_642_495_649_8, 0.362_683_783_378_362),
        (0.525_532_409_916_329, 0.313_706_645_877_887_3),
        (0.796_666_477_413_626_7, 0.222_381_034_453_374_5),
        (0.960_289_856_497_536_3, 0.101_228_536_290_376_3),
    ];
    let h = 1.0 / CELLS as f64;
    let nodes = || NODES.into_iter().flat_map(|(x, w)| [(0.5 - 0.5 * x, 0.5 * w), (0.5 + 0.5 * x, 0.5 * w)]);
    let sum: f64 = nodes()
        .flat_map(|(x, wx)| nodes().map(move |(y, wy)| (x, y, wx * wy)))
        .map(|(x, y, w)| w * f((i as f64 + x) * h, (j as f64 + y) * h))
        .sum();
    sum * h * h
}

/// Directions drawn towards each kind of light fall on its surface as `pdf_li` says.
///
/// From the front, near, at a distance where area takes over from solid angle, and at a grazing angle.
#[test]
fn light_points_follow_their_density() {
    const COUNT: u64 = 200_000;
    let mut family = Family::default();
    let places = [
        Vec3::new(0.4, -1.0, 0.2),
        Vec3::new(0.1, 0.9, 0.1),
        Vec3::new(9.0, -90.0, 30.0),
        Vec3::new(-6.0, 0.4, 2.0),
    ];
    for light in charted_lights() {
        let scene = lit_by(light.geometry.clone());
        let world = World::new(&scene);
        let query = ObvhsQuery::new(&scene.shapes, BuildQuality::default());
        for (place, p) in places.into_iter().enumerate() {
            let from = receiver(p);
            let mut random = Random::new(place as u64);
            let mut observed = vec![0; CELLS * CELLS];
            let mut drawn = 0;
            for _ in 0..COUNT {
                // `None` where the light's back was drawn.
                let Some(sample) = world.lights.sample_li(&from, random.uniform_f64(), random.uniform_2d())
                else {
                    continue;
                };
                let ray = Ray::spawn(&from, sample.wi);
                // Rays along the silhouette may miss.
                let Some(hit) = query.intersect(&ray) else { continue };
                let point = hit.surface(&scene.shapes, &ray);
                let pdf = world.lights.pdf_li(sample.light, from.p, &point, sample.wi);
                // Densities per area grow without bound towards the silhouette, where f32 no longer tells their place.
                if point.ng.dot(sample.wi) < -0.05 {
                    assert!(
                        (pdf / sample.pdf_w - 1.0).abs() < 1e-2,
                        "{}: {pdf} {}",
                        light.name,
                        sample.pdf_w
                    );
                }
                let (a, b) = (light.locate)(&point);
                let cell = |x: f64| ((x * CELLS as f64) as usize).min(CELLS - 1);
                observed[cell(a) * CELLS + cell(b)] += 1;
                drawn += 1;
            }
            let id =
                world.lights.light_at(&SurfacePoint { shape: 0, primitive: 0, ..from }).expect("a light");
            let density = |a: f64, b: f64| {
                let (q, n, area) = (light.at)(a, b);
                let to = q - p.as_dvec3();
                let wi = to.normalize();
                let cos = -wi.dot(n);
                if cos <= 0.0 {
                    return 0.0;
                }
                let (n, wi) = (n.as_vec3(), wi.as_vec3());
                let point = SurfacePoint {
                    p: q.as_vec3(),
                    p_err: 0.0,
                    ng: n,
                    ns: n,
                    uv: Vec2::ZERO,
                    shape: 0,
                    primitive: 0,
                };
                f64::from(world.lights.pdf_li(id, from.p, &point, wi)) * cos / to.length_squared() * area
            };
            let expected: Vec<f64> = (0..CELLS * CELLS)
                .map(|i| integrate_cell(density, i / CELLS, i % CELLS) * COUNT as f64)
                .collect();
            // A cell across the horizon is integrated inexactly; a sliver of it is left to the pool of small cells.
            let total: f64 = expected.iter().sum();
            let share = total / COUNT as f64;
            assert!((share - drawn as f64 / COUNT as f64).abs() < 0.01, "{} from {p}: {share}", light.name);
            let scale = drawn as f64 / total;
            let expected: Vec<f64> = expected.iter().map(|e| e * scale).collect();
            let horizon = light.name == "sphere" || light.name == "cylinder";
            if !horizon {
                family.record(format!("{} from {p}", light.name), chi_squared(&observed, &expected));
                continue;
            }
            // Smooth surfaces turn away inside cells: only those wholly in view have an exact expectation.
            let in_view = |i: usize| {
                let corner = |di: usize, dj: usize| {
                    let (q, n, _) = (light.at)(
                        (i / CELLS + di) as f64 / CELLS as f64,
                        (i % CELLS + dj) as f64 / CELLS as f64,
                    );
                    (p.as_dvec3() - q).normalize().dot(n) > 0.02
                };
                corner(0, 0) && corner(0, 1) && corner(1, 0) && corner(1, 1)
            };
            let (mut seen, mut wanted) = (Vec::new(), Vec::new());
            for i in (0..CELLS * CELLS).filter(|&i| in_view(i)) {
                seen.push(observed[i]);
                wanted.push(expected[i] / scale);
            }
            // The rest is one cell, so that the total is right by construction.
            seen.push(COUNT - seen.iter().sum::<u64>());
            wanted.push(COUNT as f64 - wanted.iter().sum::<f64>());
            family.record(format!("{} from {p}", light.name), chi_squared(&seen, &wanted));
        }
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// Light that leaves every kind of emitter and falls on a patch is as much as the patch finds by looking for the emitter:
/// `sample_le` and `sample_li` agree.
#[test]
fn emission_agrees_with_illumination() {
    const COUNT: u64 = 400_000;
    let mut family = Family::default();
    let patch = || quad(Vec3::new(-0.8, -1.0, -0.8), Vec3::Z * 1.6, Vec3::X * 1.6);
    let mut scenes: Vec<(String, Scene)> = charted_lights()
        .into_iter()
        .map(|l| (l.name.to_owned(), empty().shape(l.geometry, diffuse(0.0), Some(Rgb::new(1.0, 2.0, 3.0)))))
        .collect();
    scenes.extend(charted_lights().into_iter().map(|l| {
        let scene = empty().shape(l.geometry, diffuse(0.0), Some(Rgb::ONE));
        (format!("textured {}", l.name), checkered(scene))
    }));
    let point = Emitter::Point { position: Vec3::new(0.3, 0.5, 0.1), intensity: Rgb::splat(4.0) };
    let sky = Emitter::Constant { radiance: Rgb::splat(0.5) };
    scenes.push(("point".to_owned(), empty().emitter(point.clone())));
    scenes.push(("constant".to_owned(), empty().emitter(sky.clone())));
    let axis = Vec3::new(-0.2, -1.0, 0.1).normalize();
    let spot = Emitter::Spot(Spot {
        position: Vec3::new(0.3, 0.5, 0.1),
        axis,
        intensity: Rgb::splat(6.0),
        cutoff: 0.5,
        beam_width: 0.2,
    });
    let sun = Emitter::Directional { direction: axis, irradiance: Rgb::splat(2.0) };
    let mut texels = Random::new(8);
    let texels = (0..16 * 9).map(|_| [0; 3].map(|_| texels.log_uniform(0.1, 10.0))).collect();
    let turn = glam::DMat3::from_rotation_z(0.7);
    let map = EnvironmentMap::new(image(glam::UVec2::new(16, 9), texels), 0.3, turn).expect("a valid map");
    scenes.push(("spot".to_owned(), empty().emitter(spot.clone())));
    scenes.push(("directional".to_owned(), empty().emitter(sun.clone())));
    scenes.push(("map".to_owned(), empty().emitter(Emitter::Map(map.clone()))));
    scenes.push((
        "spot, sun and map".to_owned(),
        empty().emitter(spot).emitter(sun).emitter(Emitter::Map(map)),
    ));
    let many = charted_lights().into_iter().fold(empty().emitter(point).emitter(sky), |scene, l| {
        scene.shape(l.geometry, diffuse(0.0), Some(Rgb::splat(0.7)))
    });
    scenes.push(("all".to_owned(), many));
    for (name, scene) in scenes {
        let scene = scene.shape(patch(), diffuse(0.0), None);
        let target = scene.shapes.len() as u32 - 1;
        let world = World::new(&scene);
        let query = ObvhsQuery::new(&scene.shapes, BuildQuality::default());
        let mut random = Random::new(7);
        let mut emitted = Moments::default();
        for _ in 0..COUNT {
            let (position, direction) = (random.uniform_2d(), random.uniform_2d());
            let sample = world.lights.sample_le(random.uniform_f64(), position, direction).expect("a light");
            let (position, direction) =
                world.lights.pdf_le(sample.light, sample.point.map(|p| p.ng), sample.ray.d);
            assert!((position / sample.pdf_position - 1.0).abs() < 1e-4);
            assert!((direction - sample.pdf_direction_w).abs() < 1e-4 * direction.max(1e-3), "{name}");
            let flux = sample.radiance.y * sample.cos / (sample.pdf_position * sample.pdf_direction_w);
            // The patch's upper side only: it has no thickness.
            let arrives =
                query.intersect(&sample.ray).is_some_and(|hit| hit.shape == target) && sample.ray.d.y < 0.0;
            emitted.push(if arrives { f64::from(flux) } else { 0.0 });
        }
        let Geometry::Mesh(mesh) = &scene.shapes[target as usize].geometry else {
            unreachable!("a quad is a mesh")
        };
        let mut received = Moments::default();
        for _ in 0..COUNT {
            let half = u32::from(random.uniform() < 0.5);
            let b = helmholtz::sampling::warp::square_to_triangle(random.uniform_2d());
            let point = SurfacePoint::on_triangle(mesh, target, half, b.x, b.y);
            let light = world.lights.sample_li(&point, random.uniform_f64(), random.uniform_2d());
            let value = light.filter(|l| !query.occluded(&l.shadow_ray)).map_or(0.0, |l| {
                let area = 1.6 * 1.6;
                f64::from(l.radiance.y * l.wi.dot(point.ng).max(0.0) / l.pdf_w) * area
            });
            received.push(value);
        }
        family.record(name, z_test_two(&emitted, &received));
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// The choice of a light follows power, over twelve decades of it.
#[test]
fn lights_are_chosen_by_power() {
    let intensities = [1e-6_f32, 1.0, 1e6];
    let scene = intensities.iter().fold(empty(), |scene, &i| {
        scene.emitter(Emitter::Point { position: Vec3::splat(i.log10()), intensity: Rgb::splat(i) })
    });
    let world = World::new(&scene);
    let total: f32 = intensities.iter().sum();
    for (i, intensity) in intensities.into_iter().enumerate() {
        // Walk through the unit interval to find a number that chooses this light.
        let found = (0..2_000_000).map(|k| f64::from(k) / 2e6).find_map(|u| {
            let sample = world.lights.sample_le(u, Vec2::splat(0.5), Vec2::splat(0.5))?;
            (sample.radiance.x == intensity).then_some(sample.pdf_position)
        });
        match found {
            Some(pdf) => assert!((pdf / (intensity / total) - 1.0).abs() < 1e-5, "light {i}: {pdf}"),
            None => assert!(intensity < 1.0, "light {i} is never chosen"),
        }
    }
}

/// With a texture the mean over the light counts: half of the squares are eleven times as bright. And what emits from less than the grid
/// of that mean can see is chosen all the same.
#[test]
fn textured_lights_are_chosen_by_their_mean() {
    let lamp = |x: f32| {
        let corners = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];
        let positions = corners.map(|c| Vec3::new(x + c.x, 2.0, c.y)).to_vec();
        let triangles = vec![[0, 1, 2], [0, 2, 3]];
        let mesh = TriangleMesh::new(positions, triangles, Vec::new(), corners.to_vec(), false);
        Geometry::Mesh(mesh.expect("a valid mesh"))
    };
    let pair = |texture| {
        let mut scene = empty().shape(lamp(0.0), diffuse(0.0), None).shape(
            lamp(3.0),
            diffuse(0.0),
            Some(Rgb::splat(2.0)),
        );
        scene.textures.push(texture);
        scene.shapes[0].emission = Some(Input::Texture(TextureId(0)));
        scene
    };
    let share = |scene: &Scene| {
        let world = World::new(scene);
        let start = |u| world.lights.sample_le(u, Vec2::splat(0.3), Vec2::splat(0.5));
        let first = (0..1000).map(|i| start((f64::from(i) + 0.5) / 1000.0));
        // A path that starts in the dark is none; the other lamp emits everywhere.
        let other = first.flatten().find(|s| s.point.is_some_and(|p| p.shape == 1)).expect("the other lamp");
        1.0 - other.pdf_position
    };
    let squares = Texture::Checkerboard {
        color0: Rgb::splat(11.0).into(),
        color1: Rgb::splat(1.0).into(),
        to_uv: glam::Affine2::from_scale(Vec2::splat(4.0)),
    };
    assert!((share(&pair(squares)) - 6.0 / 8.0).abs() < 1e-3);
    let mut texels = vec![[0.0; 3]; 256 * 256];
    texels[256 * 77 + 33] = [1000.0; 3];
    let spark = Bitmap {
        image: image(glam::UVec2::splat(256), texels),
        raw: true,
        filter: TexelFilter::Nearest,
        wrap: Wrap::Clamp,
        to_uv: glam::Affine2::IDENTITY,
    };
    // The true mean is 0.015; a hundredth of the brightest is 10.
    assert!((share(&pair(Texture::Bitmap(spark))) - 10.0 / 12.0).abs() < 1e-3);
}

/// Attributes of vertices are linear over a triangle however far away and distorted it is, those of faces constant; one channel is grey.
#[test]
fn attributes_of_meshes_are_interpolated() {
    let corners = [Vec3::new(1.0e3, 0.0, 5.0), Vec3::new(1.004e3, 1.0, 5.0), Vec3::new(1.001e3, 8.0, 7.0)];
    let attribute = |name: &str, per_face, channels, values: &[f32]| MeshAttribute {
        name: name.to_owned(),
        per_face,
        channels,
        values: values.to_vec(),
    };
    let mesh = TriangleMesh::new(corners.to_vec(), vec![[0, 1, 2], [2, 1, 0]], Vec::new(), Vec::new(), false)
        .and_then(|mesh| {
            mesh.with_attributes(vec![
                attribute("vertex_color", false, 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
                attribute("face_grey", true, 1, &[0.25, 0.75]),
            ])
        })
        .expect("a valid mesh");
    let mut scene = empty().shape(Geometry::Mesh(mesh.clone()), diffuse(0.5), None);
    for (name, scale) in [("vertex_color", 1.0), ("face_grey", 2.0), ("vertex_none", 1.0)] {
        scene.textures.push(Texture::MeshAttribute { name: name.to_owned(), scale });
    }
    let at = |texture, point: &SurfacePoint| {
        Input::<Rgb>::Texture(TextureId(texture)).at(Textures::of(&scene), Place::from(point))
    };
    let mut random = Random::new(5);
    for _ in 0..1000 {
        let b = helmholtz::sampling::warp::square_to_triangle(random.uniform_2d());
        let point = SurfacePoint::on_triangle(&mesh, 0, 0, b.x, b.y);
        let expected = Rgb::new(1.0 - b.x - b.y, b.x, b.y);
        // Positions near 1000 are rounded to 6e-5, on edges of 4.
        assert!(at(0, &point).abs_diff_eq(expected, 1e-4), "{} {expected}", at(0, &point));
        assert_eq!(at(1, &point), Rgb::splat(0.5));
        assert_eq!(at(1, &SurfacePoint::on_triangle(&mesh, 0, 1, b.x, b.y)), Rgb::splat(1.5));
        assert_eq!(at(2, &point), Rgb::ZERO);
    }
}
