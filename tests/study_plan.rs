//! What a study is to render: configurations by default, by sweeps and by files, and what is said of those that cannot be.

use std::fs;

use glam::{DMat3, UVec2, Vec3};
use helmholtz::integrators::{Integrator, PathLength};
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::{Backend, BuildQuality};
use helmholtz::scene::requirements::Requirements;
use helmholtz::scene::{Emitter, EnvironmentMap, Material, Rgb, Scene};
use helmholtz::spec::spec;
use helmholtz::study::auto::{choose, choose_unbiased};
use helmholtz::study::config::Config;
use helmholtz::study::plan::{Plan, PlanError, Planner};

use crate::inspect::{glass, scene_file};
use crate::scene_builder::{Build, diffuse, empty, image, quad, sphere};

const OBVHS: Backend = Backend::Obvhs(BuildQuality::Medium);

fn depth(max_depth: Option<u32>) -> PathLength {
    PathLength { max_depth, rr_depth: 7 }
}

/// A floor under a point light, and on it a ball.
fn ball(material: Material) -> Scene {
    empty()
        .shape(quad(Vec3::new(-2.0, -1.0, 2.0), Vec3::Z * 4.0, Vec3::X * 4.0), diffuse(0.7), None)
        .shape(sphere(Vec3::new(0.0, -0.3, 4.0), 0.7), material, None)
        .emitter(Emitter::Point { position: Vec3::new(0.5, 2.0, 3.0), intensity: Rgb::splat(5.0) })
}

fn map() -> Emitter {
    let texels = (0..8 * 4).map(|i| [i as f32; 3]).collect();
    let map = EnvironmentMap::new(image(UVec2::new(8, 4), texels), 1.0, DMat3::IDENTITY);
    Emitter::Map(map.expect("a valid map"))
}

fn resolve(planner: Planner, scene: &Scene) -> Plan {
    planner.resolve(scene, &ObvhsQuery::new(&scene.shapes, BuildQuality::Medium)).expect("a plan")
}

fn defaults(scene: &Scene, max_depth: Option<u32>) -> Plan {
    let mut planner = Planner::new(depth(max_depth), OBVHS);
    planner.defaults(&Requirements::of(scene)).expect("different names");
    resolve(planner, scene)
}

fn names(plan: &Plan) -> Vec<&str> {
    plan.configurations.iter().map(|c| c.name.as_str()).collect()
}

#[test]
fn defaults_are_what_has_something_to_do() {
    let all = [
        "path",
        "bdpt",
        "ptracer",
        "photonmapper",
        "photonmapper caustic",
        "sppm",
        "sppm caustic",
        "vpl",
        "auto",
    ];
    let plan = defaults(&ball(glass()), Some(6));
    assert_eq!((names(&plan), plan.left_out.len()), (all.to_vec(), 0));
    for planned in &plan.configurations {
        assert_eq!(planned.integrator.length(), depth(Some(6)), "{}", planned.name);
        assert_eq!(planned.backend, OBVHS);
        assert_eq!(planned.choice.is_some(), planned.name == "auto");
    }
    // The choice is one of the others.
    assert_eq!(plan.distinct(), 8);

    let without = |scene: &Scene, max_depth| {
        let plan = defaults(scene, max_depth);
        let left_out: Vec<_> = plan.left_out.iter().map(|l| (l.name.clone(), l.why.clone())).collect();
        let names: Vec<_> = names(&plan).into_iter().map(str::to_owned).collect();
        (names, left_out)
    };
    let caustics = ["photonmapper caustic", "sppm caustic"];
    let (rest, left_out) = without(&ball(diffuse(0.5)), None);
    assert_eq!(rest.len(), 7);
    assert_eq!(left_out, caustics.map(|name| (name.to_owned(), "there are no caustics".to_owned())));
    // Direct light only.
    let (_, left_out) = without(&ball(diffuse(0.5)), Some(2));
    assert!(left_out.iter().any(|(name, why)| name == "vpl" && why.contains("indirect")), "{left_out:?}");
    // Photons cannot tell as long paths.
    let (rest, left_out) = without(&ball(glass()), Some(500));
    assert_eq!(rest, ["path", "bdpt", "ptracer", "vpl", "auto"]);
    assert!(left_out.len() == 4 && left_out.iter().all(|(_, why)| why.contains("127")), "{left_out:?}");
    // A lamp behind glass and nothing else: what is seen is in mirrors, and no photon stays.
    let lamp = empty().shape(sphere(Vec3::new(0.0, 0.0, 6.0), 1.0), Material::Null, Some(Rgb::ONE)).shape(
        sphere(Vec3::new(0.0, 0.0, 3.0), 1.0),
        glass(),
        None,
    );
    let (rest, left_out) = without(&lamp, None);
    assert_eq!(rest, ["path", "bdpt", "ptracer", "auto"], "{left_out:?}");
    assert!(left_out[0].1.contains("photons"), "{left_out:?}");
    // The lamp itself is seen, with what is in the glass left out.
    let plan = defaults(&lamp, None);
    let bias =
        |name: &str| plan.configurations.iter().find(|c| c.name == name).expect("planned").bias.clone();
    assert!(bias("ptracer").is_some_and(|why| why.contains("LS+E")), "{:?}", bias("ptracer"));
    assert_eq!(bias("path"), None);
}

/// What converges to something else is said to.
#[test]
fn bias_is_told() {
    let mut planner = Planner::new(depth(Some(6)), OBVHS);
    for text in [
        "path",
        "path:max_depth=3",
        "path:max_depth=-1,rr_depth=2",
        "path:hide_emitters=true",
        "vpl:clamp=1,compensate=false",
        "bdpt",
    ] {
        planner.integrator(&spec(text).expect("a spec")).expect("an integrator");
    }
    let plan = resolve(planner, &ball(diffuse(0.5)));
    let bias: Vec<_> = plan.configurations.iter().map(|c| c.bias.as_deref().unwrap_or("none")).collect();
    assert_eq!(bias[0], "none");
    assert_eq!(bias[1], "paths have up to 3 segments, those of the scene 6");
    assert_eq!(bias[2], "paths have up to any number of segments, those of the scene 6");
    assert_eq!(bias[3], "lights are hidden");
    assert!(bias[4].contains("clamp"), "{bias:?}");
    assert_eq!(bias[5], "none");
    // A point light behind glass is never hit.
    let mut planner = Planner::new(depth(Some(6)), OBVHS);
    planner.integrator(&spec("path").expect("a spec")).expect("an integrator");
    let plan = resolve(planner, &ball(glass()));
    assert!(plan.configurations[0].bias.as_deref().is_some_and(|why| why.contains("LS+DE")));
}

#[test]
fn sweeps_are_configurations() {
    let scene = ball(diffuse(0.5));
    let mut planner = Planner::new(depth(Some(4)), OBVHS);
    planner.sweep("photonmapper:photons=100,radius=0.1..0.4x3").expect("a sweep");
    planner.sweep("obvhs:quality=low|high").expect("a sweep");
    planner.sweep("auto:max_depth=3|4").expect("a sweep");
    let plan = resolve(planner, &scene);
    let expected = [
        "photonmapper:photons=100,radius=0.1",
        "photonmapper:photons=100,radius=0.2",
        "photonmapper:photons=100,radius=0.4",
        "obvhs:quality=low",
        "obvhs:quality=high",
        "auto:max_depth=3",
        "auto:max_depth=4",
    ];
    assert_eq!(names(&plan), expected);
    let texts: Vec<_> = plan.configurations.iter().map(|c| c.integrator.describe()).collect();
    assert!(texts[1].contains("radius=0.2") && texts[1].contains("max_depth=4,rr_depth=7"), "{}", texts[1]);
    // Backends are swept with what auto takes.
    assert!(texts[3] == texts[4] && texts[3] == texts[6] && plan.configurations[3].choice.is_some());
    let backends: Vec<_> = plan.configurations[3..5].iter().map(|c| c.backend).collect();
    assert_eq!(backends, [Backend::Obvhs(BuildQuality::Low), Backend::Obvhs(BuildQuality::High)]);

    for (text, why) in [
        ("nothing:a=1|2", "`nothing` is not known; integrators: path"),
        ("path:max_depth=1|two", "`path:max_depth=two`: parameter `max_depth`"),
        ("path:rr=1|2", "no parameter `rr`"),
        ("obvhs:quality=low|best", "does not take `quality=best`"),
        ("path:max_depth=2", "no parameter has several"),
        ("path:max_depth=2|2", "two configurations `path:max_depth=2`"),
        (
            "envmap:sampling_columns=1|2",
            "`envmap:sampling_columns=1`: expected `sampling_columns`, a whole number",
        ),
        ("envmap:columns=2|3", "expected `sampling_columns`, a whole number from 2 on"),
        ("envmap:scale=1,sampling_columns=2|3", "expected `sampling_columns` alone"),
    ] {
        let error = Planner::new(depth(None), OBVHS).sweep(text).expect_err(text).to_string();
        assert!(error.contains(why), "{text}: {error}");
    }
}

/// Where there is an environment map, it may be sampled in fewer columns; by sweeps and by files.
#[test]
fn environment_maps_are_sampled_as_they_are_asked_to_be() {
    let scene = ball(diffuse(0.5)).emitter(map());
    let mut planner = Planner::new(depth(Some(2)), OBVHS);
    planner.sweep("envmap:sampling_columns=2|4").expect("a sweep");
    let path = spec("path").expect("a spec");
    planner.add("three".to_owned(), &path, None, Some(3)).expect("new");
    planner.add("all".to_owned(), &path, None, None).expect("new");
    let plan = resolve(planner.clone(), &scene);
    assert_eq!(names(&plan), ["envmap:sampling_columns=2", "envmap:sampling_columns=4", "three", "all"]);
    let columns: Vec<_> = plan.configurations.iter().map(|c| c.sampling_columns).collect();
    assert_eq!(columns, [Some(2), Some(4), Some(3), None]);
    assert_eq!(plan.distinct(), 4);
    let dark = ball(diffuse(0.5));
    let error = planner.resolve(&dark, &ObvhsQuery::new(&dark.shapes, BuildQuality::Medium));
    let error = error.expect_err("no map").to_string();
    assert_eq!(error, "`envmap:sampling_columns=2`: the scene has no environment map");
}

/// Backends as text, and back.
#[test]
fn backends_are_described_as_they_are_named() {
    let mut texts = vec!["obvhs:quality=low", "obvhs:quality=high", "crosscheck"];
    if cfg!(feature = "embree") {
        texts.push("embree:robust=false,quality=low,compact=true");
        texts.push("embree:robust=true,quality=high,compact=false");
    }
    for text in texts {
        let named = spec(text).expect("a spec");
        assert_eq!(Backend::new(&named.name, &named.parameters).expect("a backend").describe(), text);
    }
}

#[test]
fn files_say_what_is_rendered() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("study.toml");
    let read = |text: &str| {
        fs::write(&path, text).expect("written");
        Config::read(&path)
    };
    let config = read(
        "budgets = ['1s', '250ms']\nseeds = 5\nsize = '64x48'\nreference = 'truth.exr'\n\
         [[configuration]]\nname = 'short'\nintegrator = 'path:max_depth=2'\nbackend = 'obvhs:quality=low'\n\
         [[configuration]]\nname = 'a name'\nintegrator = 'vpl'\nsampling_columns = 64\n",
    )
    .expect("a configuration");
    assert_eq!(config.budgets, [1000, 250].map(std::time::Duration::from_millis));
    assert_eq!(config.seeds.map(std::num::NonZeroU32::get), Some(5));
    assert_eq!(config.size.map(|s| s.to_array()), Some([64, 48]));
    assert_eq!(config.reference, Some(folder.path().join("truth.exr")));
    let mut planner = Planner::new(depth(Some(4)), OBVHS);
    config.plan(&mut planner).expect("a plan");
    let plan = resolve(planner, &ball(diffuse(0.5)).emitter(map()));
    assert_eq!(names(&plan), ["short", "a name"]);
    assert_eq!(
        [plan.configurations[0].sampling_columns, plan.configurations[1].sampling_columns],
        [None, Some(64)]
    );
    assert_eq!(plan.configurations[0].backend, Backend::Obvhs(BuildQuality::Low));
    assert_eq!(plan.configurations[1].backend, OBVHS);
    assert!(matches!(plan.configurations[1].integrator, Integrator::VirtualLights(_)));
    assert!(read("").expect("nothing is fine").budgets.is_empty());

    // What is wrong, and where.
    for (text, at, why) in [
        ("budget = ['1s']\n", ":1:1", "budget"),
        ("seeds = 1\nbudgets = ['1s', '1x']\n", ":2:", "units"),
        ("budgets = 3\n", ":1:11", "expected a sequence"),
        ("seeds = 0\n", ":1:9", "nonzero"),
        ("seeds = -1\n", ":1:9", "-1"),
        ("\n\nsize = '64'\n", ":3:8", "WIDTHxHEIGHT"),
        ("a = [", ":1:", "array"),
        ("[[configuration]]\nname = 'a'\n", ":1:1", "integrator"),
        ("[[configuration]]\nname = 'a'\nintegrator = 'path:x'\n", ":3:14", "name=value"),
        ("[[configuration]]\nname = 'a'\nintegrator = 'path'\nseed = 3\n", ":4:1", "seed"),
        ("[[configuration]]\nname = 'a'\nintegrator = 'path'\nsampling_columns = 1\n", ":4:20", "from 2 on"),
    ] {
        let error = read(text).expect_err(text).to_string();
        assert!(error.contains(&format!("study.toml{at}")) && error.contains(why), "{text}: {error}");
    }
    for (text, at, why) in [
        ("[[configuration]]\nname = 'a'\nintegrator = 'nope'\n", ":1:1", "`nope` is not known"),
        (
            "\n[[configuration]]\nname = 'a'\nintegrator = 'path'\nbackend = 'nope'\n",
            ":2:1",
            "`nope` is not in this build",
        ),
        (
            "[[configuration]]\nname = 'a'\nintegrator = 'path'\n[[configuration]]\nname = 'a'\nintegrator = 'vpl'\n",
            ":4:1",
            "two configurations `a`",
        ),
    ] {
        let config = read(text).expect(text);
        let error = config.plan(&mut Planner::new(depth(None), OBVHS)).expect_err(text).to_string();
        assert!(error.contains(&format!("study.toml{at}")) && error.contains(why), "{text}: {error}");
    }
    let missing = Config::read(&folder.path().join("none.toml")).expect_err("no file").to_string();
    assert!(missing.contains("none.toml"), "{missing}");
    // Nested without end, and not text.
    assert!(read(&format!("a = {}", "[".repeat(100_000))).is_err());
    fs::write(&path, [0xff, 0xfe, 0x00]).expect("written");
    assert!(Config::read(&path).is_err());
}

/// Where `auto` takes photons, a reference takes what has no bias.
#[test]
fn references_have_no_bias() {
    let scene = scene_file("ring.xml");
    let query = ObvhsQuery::new(&scene.shapes, BuildQuality::Medium);
    let length = PathLength { max_depth: Some(8), rr_depth: 5 };
    let auto = choose(&scene, &query, length).expect("a choice").integrator;
    let unbiased = choose_unbiased(&scene, &query, length).expect("a choice").integrator;
    assert!(auto.bias().is_some(), "{}", auto.describe());
    assert!(unbiased.bias().is_none() && unbiased.length() == length);
    // Light from the metal reaches the wood where no path from the camera finds the small lamp.
    assert!(matches!(unbiased, Integrator::Bidirectional(_)), "{}", unbiased.describe());
}

#[test]
fn names_are_unique() {
    let mut planner = Planner::new(depth(None), OBVHS);
    let path = spec("path").expect("a spec");
    planner.integrator(&path).expect("new");
    assert_eq!(planner.integrator(&path), Err(PlanError::Name("path".to_owned())));
    planner.add("other".to_owned(), &path, None, None).expect("new");
}
