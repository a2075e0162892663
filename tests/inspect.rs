//! What a scene requires, what is odd about it, which integrator can sample it, and which one `auto` takes.

use std::path::Path;

use glam::{Affine2, DAffine3, DVec3, UVec2, UVec3, Vec3};
use helmholtz::integrators::{Ability, Integrator, PathLength};
use helmholtz::query::RayQuery;
use helmholtz::scene::findings::{FindingKind, findings};
use helmholtz::scene::load::{LoadOptions, load};
use helmholtz::scene::requirements::{Events, PathClass, Requirements};
use helmholtz::scene::{
    AnalyticKind, AnalyticShape, Emitter, Geometry, Input, Lens, Material, PixelRect, Rgb, Scene, Texture,
    TextureId,
};
use helmholtz::study::auto::choose;
use helmholtz::study::pilot::Pilot;
use helmholtz::study::verify::judge;
use helmholtz::transport::World;

use crate::backends::{BackendTest, on_first_backend};
use crate::integrators::agreement::integrator;
use crate::scene_builder::{Build, diffuse, empty, mesh, quad, sphere};

pub(crate) fn glass() -> Material {
    let white = Rgb::ONE;
    Material::Dielectric {
        eta: 1.5,
        specular_reflectance: white.into(),
        specular_transmittance: white.into(),
    }
}

/// A scene of the project, with a small film.
pub(crate) fn scene_file(name: &str) -> Scene {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes").join(name);
    small(&path)
}

/// A scene through a film of 256x256.
fn small(path: &Path) -> Scene {
    let mut scene = load(path, &LoadOptions::default()).expect("a scene").scene;
    let size = UVec2::splat(256);
    (scene.film.size, scene.film.crop) = (size, PixelRect { min: UVec2::ZERO, size });
    scene
}

/// Whether a path such as `LSDE` is of the language that the notation describes: letters, `X+`, and `(S|D)*`.
fn matches(notation: &str, path: &str) -> bool {
    if let Some(rest) = notation.strip_prefix("(S|D)*") {
        let inner = path.strip_prefix(['S', 'D']);
        return matches(rest, path) || inner.is_some_and(|path| matches(notation, path));
    }
    let Some(letter) = notation.chars().next() else { return path.is_empty() };
    let (rest, Some(path)) = (&notation[1..], path.strip_prefix(letter)) else { return false };
    match rest.strip_prefix('+') {
        Some(after) => matches(after, path) || matches(notation, path),
        None => matches(rest, path),
    }
}

/// All paths of up to seven events, taken apart in all ways: one class, whose notation describes the path and no other's does.
#[test]
fn each_path_is_of_the_one_class_that_its_notation_describes() {
    for length in 0..8_u32 {
        for bits in 0..1_u32 << length {
            let is_delta: Vec<bool> = (0..length).map(|i| bits >> i & 1 == 1).collect();
            let letters: String = is_delta.iter().map(|&d| if d { 'S' } else { 'D' }).collect();
            let path = format!("L{letters}E");
            let described: Vec<_> =
                PathClass::ALL.into_iter().filter(|c| matches(c.notation(), &path)).collect();
            assert_eq!(described.len(), 1, "{path}: {described:?}");
            assert!(length + 1 >= described[0].least_depth(), "{path}");
            for cut in 0..=is_delta.len() {
                let walk = |events: &mut dyn Iterator<Item = &bool>| {
                    events.fold(Events::default(), |all, &is_delta| all.then(is_delta))
                };
                let (light, eye) = is_delta.split_at(cut);
                let class = PathClass::of(walk(&mut light.iter()), walk(&mut eye.iter().rev()));
                assert_eq!(class, described[0], "{path} cut at {cut}");
            }
        }
    }
    for class in PathClass::ALL {
        let letters = class.notation().replace("(S|D)*", "").replace('+', "");
        assert_eq!(class.least_depth() as usize, letters.len() - 1, "{class:?}");
        assert_eq!(class.is_caustic(), letters.starts_with("LSD"));
        assert_eq!(class.is_mirrored(), letters.ends_with("SE"));
    }
}

#[test]
fn requirements_follow_from_what_is_used() {
    let floor = || quad(Vec3::new(-1.0, -1.0, 4.0), Vec3::Y * 2.0, Vec3::X * 2.0);
    let point = || Emitter::Point { position: Vec3::new(0.0, 0.0, 3.0), intensity: Rgb::ONE };
    let plain = empty().shape(floor(), diffuse(0.5), None).emitter(point());
    let needs = Requirements::of(&plain);
    assert_eq!(needs.classes(u32::MAX), [PathClass::Direct, PathClass::Indirect]);
    assert_eq!(needs.classes(2), [PathClass::Direct]);
    // Glass brings the rest but for what shows the light, and a lamp that.
    let with_glass = plain.clone().shape(sphere(Vec3::new(0.0, 0.0, 3.5), 0.2), glass(), None);
    let needs = Requirements::of(&with_glass);
    assert_eq!(needs.classes(u32::MAX), PathClass::ALL[2..]);
    assert_eq!(needs.classes(3), [2, 3, 4, 6].map(|i| PathClass::ALL[i]));
    let lamp = with_glass.clone().shape(sphere(Vec3::Z, 0.1), diffuse(0.0), Some(Rgb::ONE));
    assert_eq!(Requirements::of(&lamp).classes(u32::MAX), PathClass::ALL);
    // Of mirrors alone, nothing is lit; black scatters nothing.
    let mirrors = empty().shape(floor(), glass(), Some(Rgb::ONE));
    assert_eq!(Requirements::of(&mirrors).classes(u32::MAX), PathClass::ALL[..2]);
    let black = empty().shape(floor(), diffuse(0.0), None).emitter(point());
    assert_eq!(Requirements::of(&black).classes(u32::MAX), []);
    // A material counts through what is made of it, and only if some surface has it.
    let mut unused = plain.clone();
    unused.materials.push(glass());
    assert!(!Requirements::of(&unused).lobes.has_delta());
    let glass_id = helmholtz::scene::MaterialId(1);
    let first = helmholtz::scene::MaterialId(0);
    unused.materials.push(Material::Blend { weight: 0.5.into(), first, second: glass_id });
    unused.shapes[0].material = helmholtz::scene::MaterialId(2);
    let needs = Requirements::of(&unused);
    assert!(needs.lobes.has_delta() && needs.used_materials == [true; 3]);
}

/// The kinds of findings, in order.
fn kinds(scene: &Scene) -> Vec<FindingKind> {
    findings(scene, &Requirements::of(scene)).iter().map(|f| f.kind).collect()
}

/// A closed cube of side 2 around a point, normals outwards unless flipped.
fn cube(center: Vec3, is_flipped: bool) -> Geometry {
    let corner = |i: u32| {
        let side = |bit: u32| if i >> bit & 1 == 1 { 1.0 } else { -1.0 };
        center + Vec3::new(side(0), side(1), side(2))
    };
    let faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let halves = faces.into_iter().flat_map(|[a, b, c, d]| [UVec3::new(a, b, c), UVec3::new(a, c, d)]);
    let turn = |t: UVec3| if is_flipped { UVec3::new(t.x, t.z, t.y) } else { t };
    mesh((0..8).map(corner).collect(), &halves.map(turn).collect::<Vec<_>>())
}

#[test]
fn findings_name_what_is_odd_and_nothing_else() {
    let lit = || {
        let position = Vec3::new(0.0, 3.0, 0.0);
        empty().emitter(Emitter::Point { position, intensity: Rgb::ONE })
    };
    let ahead = Vec3::new(0.0, 0.0, 6.0);
    assert_eq!(kinds(&lit().shape(cube(ahead, false), diffuse(0.5), None)), []);
    assert_eq!(kinds(&empty()), [FindingKind::NoLight]);
    // Closed surfaces: of one side seen from the other, and glass.
    let inside_out = [FindingKind::InsideOut];
    assert_eq!(kinds(&lit().shape(cube(ahead, true), diffuse(0.5), None)), inside_out);
    assert_eq!(kinds(&lit().shape(cube(Vec3::ZERO, false), diffuse(0.5), None)), inside_out);
    assert_eq!(kinds(&lit().shape(cube(Vec3::ZERO, true), diffuse(0.5), None)), []);
    assert_eq!(kinds(&lit().shape(cube(ahead, false), glass(), None)), []);
    assert_eq!(kinds(&lit().shape(cube(ahead, true), glass(), None)), inside_out);
    let bubble = |r| {
        let to_world = DAffine3::from_scale_rotation_translation(
            DVec3::splat(r),
            glam::DQuat::IDENTITY,
            ahead.as_dvec3(),
        );
        Geometry::Analytic(AnalyticShape::new(AnalyticKind::Sphere, to_world, true).expect("a sphere"))
    };
    assert_eq!(kinds(&lit().shape(bubble(0.5), glass(), None)), inside_out);
    // Air in glass is meant to be.
    let hollow = lit().shape(sphere(ahead, 1.0), glass(), None).shape(bubble(0.5), glass(), None);
    assert_eq!(kinds(&hollow), []);
    // An open surface has no inside.
    assert_eq!(kinds(&lit().shape(quad(ahead, Vec3::X, Vec3::Y), diffuse(0.5), None)), []);
    // A lamp over a floor, and turned away from it; the camera is at the origin.
    let floor = || quad(Vec3::new(-1.0, -1.0, 1.0), Vec3::Z, Vec3::X);
    let lamp = |ex, ey| {
        let lamp = quad(Vec3::new(0.0, 2.0, 1.0), ex, ey);
        empty().shape(floor(), diffuse(0.5), None).shape(lamp, diffuse(0.0), Some(Rgb::ONE))
    };
    assert_eq!(kinds(&lamp(Vec3::X, Vec3::Z)), []);
    assert_eq!(kinds(&lamp(Vec3::Z, Vec3::X)), [FindingKind::LightFacesAway]);
    // Of the four triangles, one has a corner twice and one lies on a line.
    let corners = vec![Vec3::Z, Vec3::Z + Vec3::X, Vec3::Z + Vec3::Y, Vec3::Z + 2.0 * Vec3::X];
    let triangles = [[0, 1, 2], [0, 0, 2], [0, 1, 3], [1, 3, 2]].map(UVec3::from_array);
    let found = lit().shape(mesh(corners, &triangles), diffuse(0.5), None);
    assert_eq!(kinds(&found), [FindingKind::DegenerateTriangles]);
    let text = &findings(&found, &Requirements::of(&found))[0].text;
    assert!(text.contains("2 of 4 triangles"), "{text}");
    // The cube is 3.5 across. Numbers are 0.125 apart at 2e6, and 0.00012 at 2e3.
    for (distance, expected) in [(2e6, &[FindingKind::FarFromOrigin] as &[_]), (2e3, &[])] {
        let far = lit().shape(cube(Vec3::Z * distance, false), diffuse(0.5), None);
        assert_eq!(kinds(&far), expected, "{distance}");
    }
    // A texture in a material that nothing has; and one within another that is used.
    let mut unused = lit().shape(cube(ahead, false), diffuse(0.5), None);
    let checks = |color0: Input<Rgb>| Texture::Checkerboard {
        color0,
        color1: Rgb::ONE.into(),
        to_uv: Affine2::IDENTITY,
    };
    unused.textures = vec![checks(Rgb::ZERO.into()), checks(Input::Texture(TextureId(0)))];
    unused.materials.push(Material::Diffuse { reflectance: Input::Texture(TextureId(1)) });
    let both = [FindingKind::UnusedMaterial, FindingKind::UnusedTexture, FindingKind::UnusedTexture];
    assert_eq!(kinds(&unused), both);
    unused.shapes[0].material = helmholtz::scene::MaterialId(1);
    assert_eq!(kinds(&unused), [FindingKind::UnusedMaterial]);
}

#[test]
fn the_scenes_of_the_project_are_not_odd() {
    for name in
        ["cornell-box", "torus-in-glass", "ring", "hidden-lamps", "lens", "glass-spheres", "open-world"]
    {
        let scene = scene_file(&format!("{name}.xml"));
        let found = findings(&scene, &Requirements::of(&scene));
        assert!(found.is_empty(), "{name}: {found:?}");
    }
}

/// What only one integrator does not do, and what needs the right light and lens.
#[test]
fn abilities_depend_on_lights_and_lens() {
    use Ability::{Cannot, Poorly, Well};
    let glass_ball =
        || empty().shape(sphere(Vec3::Z, 0.2), glass(), None).shape(sphere(Vec3::Y, 0.2), diffuse(0.5), None);
    let lamp = Requirements::of(&glass_ball().shape(sphere(Vec3::X, 0.1), diffuse(0.0), Some(Rgb::ONE)));
    let point = Emitter::Point { position: Vec3::X, intensity: Rgb::ONE };
    let point = Requirements::of(&glass_ball().emitter(point));
    let sky = Requirements::of(&glass_ball().emitter(Emitter::Constant { radiance: Rgb::ONE }));
    let lens = Requirements { has_lens: true, ..lamp.clone() };
    let able = |name, needs: &Requirements, class| integrator(name, "").ability(class, needs);
    for (name, [by_point, by_lamp, by_sky]) in [
        ("path", [Cannot, Poorly, Well]),
        ("bdpt", [Well, Well, Well]),
        ("ptracer", [Well, Well, Poorly]),
        ("sppm", [Well, Well, Poorly]),
        ("vpl", [Cannot, Poorly, Well]),
    ] {
        let found = [&point, &lamp, &sky].map(|needs| able(name, needs, PathClass::Caustic));
        assert_eq!(found, [by_point, by_lamp, by_sky], "{name}");
    }
    assert_eq!(able("bdpt", &point, PathClass::CausticMirrored), Cannot);
    assert_eq!(able("ptracer", &lamp, PathClass::DirectMirrored), Cannot);
    assert_eq!(able("ptracer", &lens, PathClass::DirectMirrored), Poorly);
    assert_eq!(integrator("ptracer", "connect=nee").ability(PathClass::DirectMirrored, &lens), Cannot);
    let caustics = integrator("sppm", "mode=caustic");
    assert_eq!(caustics.ability(PathClass::CausticMirrored, &point), Well);
    for name in ["path", "ptracer", "bdpt"] {
        assert_eq!(integrator(name, "").bias(), None);
    }
    for (name, parameters) in [("sppm", ""), ("vpl", "compensate=false"), ("vpl", "visibility=none")] {
        assert!(integrator(name, parameters).bias().is_some(), "{name} {parameters}");
    }
}

/// Pilots of `path`, `ptracer`, `bdpt` and photons: each part of the image is in one class, classes are what the table predicts, and a false prediction is noticed.
struct Verified<'a> {
    name: &'a str,
    scene: Scene,
    /// Classes that surely carry light, more than ten errors of it, by `bdpt` or `path`.
    carries: &'a [PathClass],
    /// Classes that nothing makes, by whatever integrator, but what f32 leaves at edges.
    absent: &'a [PathClass],
}

impl BackendTest for Verified<'_> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let (scene, length) = (&self.scene, PathLength { max_depth: Some(6), rr_depth: 5 });
        let needs = Requirements::of(scene);
        let size = UVec2::splat(24);
        let world = World::for_film(scene, size);
        let integrators: Vec<Integrator> =
            [("path", ""), ("ptracer", ""), ("bdpt", ""), ("sppm", "photons=2000,")]
                .map(|(name, extra)| integrator(name, &format!("{extra}max_depth=6")))
                .to_vec();
        let pilots: Vec<Pilot> =
            integrators.iter().map(|&i| Pilot::run(&world, query, i, size, 16).expect("a pilot")).collect();
        for (integrator, pilot) in integrators.iter().zip(&pilots).take(3) {
            let sum: f64 = pilot.classes.iter().map(|class| class.mean).sum();
            let what = format!("{} by {} on {backend}", self.name, integrator.describe());
            assert!((sum / pilot.total.mean - 1.0).abs() < 1e-5, "{what}: {sum} {:?}", pilot.total);
        }
        for &class in self.carries {
            let found = [0, 2].map(|i| pilots[i].classes[class as usize]);
            assert!(found.iter().any(|e| e.mean > 10.0 * e.error), "{}: no {class:?}, {found:?}", self.name);
        }
        for &class in self.absent {
            for (integrator, pilot) in integrators.iter().zip(&pilots).take(3) {
                let share = pilot.classes[class as usize].mean / pilot.total.mean;
                assert!(share < 1e-5, "{}: {class:?} by {}: {share}", self.name, integrator.describe());
            }
        }
        let tried: Vec<_> = integrators.iter().copied().zip(&pilots).collect();
        for (verdicts, integrator) in judge(&tried, &needs, length).iter().zip(&integrators) {
            let wrong = verdicts.iter().position(|v| v.holds == Some(false));
            assert!(wrong.is_none(), "{} by {}: {verdicts:?}", self.name, integrator.describe());
        }
        // Were there no glass, classes that carry light would not exist; were there a pinhole, a lens would not be hit.
        let mut false_needs = needs.clone();
        false_needs.lobes.specular = false;
        let is_noticed = judge(&tried, &false_needs, length).iter().flatten().any(|v| v.holds == Some(false));
        assert_eq!(is_noticed, needs.lobes.specular, "{}", self.name);
    }
}

/// Decided by 6 errors with 14 degrees of freedom, 44 verdicts in each of five scenes: a false alarm in 100 changes of the random numbers, and none without.
#[test]
fn what_the_table_predicts_is_measured() {
    use PathClass::{Caustic, Direct, DirectMirrored, Emission, Indirect, IndirectMirrored};
    for (name, carries) in [
        ("glass-spheres.xml", &[Direct, DirectMirrored, Indirect, Caustic] as &[_]),
        ("ring.xml", &[Direct, DirectMirrored, Caustic]),
        ("lens.xml", &[DirectMirrored, IndirectMirrored]),
        ("open-world.xml", &[Direct, Indirect]),
    ] {
        let scene = scene_file(name);
        // The camera looks through a lens of glass, which light paths have to hit it through.
        let absent = if name == "lens.xml" { &[Emission, Direct, Indirect, Caustic] as &[_] } else { &[] };
        on_first_backend(&scene.shapes, &Verified { name, scene: scene.clone(), carries, absent });
    }
    // An orthographic camera under glass and a sky, and a directional light.
    let mut scene = empty()
        .shape(quad(Vec3::new(-2.0, -2.0, 6.0), Vec3::Y * 4.0, Vec3::X * 4.0), diffuse(0.6), None)
        .shape(sphere(Vec3::new(0.0, 0.0, 5.0), 0.6), glass(), None)
        .emitter(Emitter::Constant { radiance: Rgb::ONE })
        .emitter(Emitter::Directional { direction: Vec3::Z, irradiance: Rgb::splat(2.0) });
    scene.camera.lens = Lens::Orthographic;
    let carries = &[Direct, DirectMirrored, Caustic];
    on_first_backend(
        &scene.shapes,
        &Verified { name: "glass and sky", scene: scene.clone(), carries, absent: &[] },
    );
}

/// `choose`, by one thread and by three.
struct Chosen<'a> {
    name: &'a str,
    scene: &'a Scene,
    expected: &'a [&'a str],
}

impl BackendTest for Chosen<'_> {
    fn run<Q: RayQuery>(&self, _: &str, query: &Q) {
        let length = PathLength { max_depth: Some(8), rr_depth: 5 };
        let choice = choose(self.scene, query, length).expect("a choice");
        println!("{}: {}", self.name, choice.why);
        let name = choice.integrator.describe();
        assert!(self.expected.iter().any(|e| name.starts_with(e)), "{}: {}", self.name, choice.why);
        assert_eq!(choice.integrator.length(), length);
        if self.name == "ring.xml" {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().expect("threads");
            assert_eq!(pool.install(|| choose(self.scene, query, length)).expect("a choice"), choice);
        }
    }
}

/// Those integrators that have the least relMSE after equal CPU time, or at most 1.5 times it (`vendor-notes/measurements.md`, "Which integrator").
#[test]
fn auto_takes_an_integrator_that_is_good_there() {
    for (name, expected) in [
        ("cornell-box.xml", &["path"] as &[_]),
        ("open-world.xml", &["path"]),
        ("hidden-lamps.xml", &["bdpt"]),
        ("ring.xml", &["sppm"]),
        ("torus-in-glass.xml", &["sppm"]),
        ("glass-spheres.xml", &["bdpt", "sppm"]),
        ("lens.xml", &["path", "bdpt"]),
    ] {
        let scene = scene_file(name);
        on_first_backend(&scene.shapes, &Chosen { name, scene: &scene, expected });
    }
    // Where noise falls faster than with the number of samples, and where light is so rare that few passes do not see it.
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/testdata/scenes");
    for (name, expected) in [("cbox/cbox_v3.xml", &["path"] as &[_]), ("torus/torus_v3.xml", &["sppm"])] {
        let scene = small(&data.join(name));
        on_first_backend(&scene.shapes, &Chosen { name, scene: &scene, expected });
    }
    // With nothing to choose by.
    let dark = empty().shape(sphere(Vec3::Z, 0.1), diffuse(0.5), None);
    on_first_backend(&dark.shapes, &Chosen { name: "dark", scene: &dark, expected: &["path"] });
}

/// Emission times a constant changes no choice and no reason.
#[test]
fn auto_does_not_depend_on_the_unit_of_light() {
    struct Reason<'a>(&'a Scene, std::cell::RefCell<Vec<String>>);
    impl BackendTest for Reason<'_> {
        fn run<Q: RayQuery>(&self, _: &str, query: &Q) {
            for exponent in [0, 40, -40] {
                let mut scene = self.0.clone();
                for shape in &mut scene.shapes {
                    if let Some(Input::Constant(radiance)) = &mut shape.emission {
                        *radiance *= 2.0_f32.powi(exponent);
                    }
                }
                let length = PathLength { max_depth: Some(4), rr_depth: 5 };
                self.1.borrow_mut().push(choose(&scene, query, length).expect("a choice").why);
            }
        }
    }
    let scene = scene_file("hidden-lamps.xml");
    let reasons = Reason(&scene, std::cell::RefCell::default());
    on_first_backend(&scene.shapes, &reasons);
    let reasons = reasons.1.into_inner();
    assert!(reasons.iter().all(|r| *r == reasons[0]), "{reasons:?}");
}
