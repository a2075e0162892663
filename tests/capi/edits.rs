//! Scenes that were edited are those that would have been loaded so: their images are the same, bit for bit.

use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;

use glam::Vec3;
use helmholtz::film::{AovSet, Film, Image};
use helmholtz::integrators::Integrator;
use helmholtz::query::BuildQuality;
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::render::{Control, Stop, Target, render};
use helmholtz::scene::load::{EditError, LoadOptions, Loaded, RawMesh, load, load_text};
use helmholtz::scene::{MeshError, Scene};
use helmholtz::transport::World;

use crate::support::icosphere;

fn sensor(x: f32) -> String {
    format!(
        r#"<sensor type="perspective"><transform name="to_world"><lookat origin="{x}, 1, 4" target="0, 0, 0" up="0, 1, 0"/></transform>
        <film type="hdrfilm"><integer name="width" value="24"/><integer name="height" value="16"/></film></sensor>"#
    )
}

const RED: &str = r#"<bsdf type="diffuse" id="paint"><rgb name="reflectance" value="0.8, 0.1, 0.1"/></bsdf>"#;
/// Of several parts, so that the order of materials matters.
const COATED: &str = r#"<bsdf type="blendbsdf" id="paint"><float name="weight" value="0.25"/><bsdf type="plastic"/>
    <bsdf type="mask"><float name="opacity" value="0.75"/><bsdf type="roughconductor"/></bsdf></bsdf>"#;

/// A ball that refers to a paint within a blend, and an instance that refers to it by itself.
fn scene_text(paint: &str, x: f32) -> String {
    format!(
        r#"<scene version="3.0.0">{}{paint}
        <bsdf type="blendbsdf" id="mix"><float name="weight" value="0.5"/><ref id="paint"/><bsdf type="diffuse"/></bsdf>
        <emitter type="constant"/>
        <shape type="ply" id="ball"><string name="filename" value="ball.ply"/><transform name="to_world"><scale value="0.8"/></transform><ref id="mix"/></shape>
        <shape type="shapegroup" id="group"><shape type="cube"><transform name="to_world"><scale value="0.3"/></transform><ref id="paint"/></shape></shape>
        <shape type="instance"><transform name="to_world"><translate x="1.5"/></transform><ref id="group"/></shape>
        <shape type="instance"><transform name="to_world"><translate x="-1.5"/></transform><ref id="group"/></shape></scene>"#,
        sensor(x)
    )
}

fn wrapped(text: &str) -> String {
    format!(r#"<scene version="3.0.0">{text}</scene>"#)
}

fn ball(scale: f64) -> RawMesh {
    let (positions, triangles) = icosphere(2);
    let positions = positions.iter().map(|p| (*p * (1.0 + scale * p.y)).as_vec3()).collect();
    RawMesh { positions, triangles, ..RawMesh::default() }
}

fn load_with(text: &str, ball: RawMesh) -> Loaded {
    let options =
        LoadOptions { meshes: vec![("ball.ply".to_owned(), Arc::new(ball))], ..LoadOptions::default() };
    load_text(text, Path::new(""), &options).unwrap()
}

fn image(scene: &Scene) -> Image {
    let world = World::new(scene);
    let query = ObvhsQuery::new(&scene.shapes, BuildQuality::Medium);
    let mut film = Film::new(&scene.film, AovSet::default(), world.lights.radiance_unit()).unwrap();
    let target = Target { integrator: Integrator::new("path", &[]).unwrap(), seed: 0 };
    let stop = Stop { passes: 0..4, time: None };
    render(&world, &query, &target, &mut film, &stop, |_| Control::Continue).unwrap();
    film.develop()
}

#[test]
fn a_mesh_in_memory_is_the_same_as_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = ball(0.25);
    let mut ply = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n",
        mesh.positions.len(),
        mesh.triangles.len()
    );
    for p in &mesh.positions {
        writeln!(ply, "{} {} {}", p.x, p.y, p.z).expect("memory");
    }
    for [a, b, c] in &mesh.triangles {
        writeln!(ply, "3 {a} {b} {c}").expect("memory");
    }
    std::fs::write(folder.path().join("ball.ply"), ply).unwrap();
    let file = folder.path().join("scene.xml");
    std::fs::write(&file, scene_text(RED, 0.0)).unwrap();
    let from_file = load(&file, &LoadOptions::default()).unwrap();
    let from_memory = load_with(&scene_text(RED, 0.0), mesh);
    assert_eq!(image(&from_file.scene), image(&from_memory.scene));
    assert!(from_memory.files.is_empty(), "no file was read");
}

#[test]
fn edits_make_the_scene_that_would_have_been_loaded() {
    let Loaded { mut scene, mut origins, .. } = load_with(&scene_text(RED, 0.0), ball(0.0));
    let before = image(&scene);
    let mut edit = |scene: &mut Scene, text: &str| {
        origins.edit(scene, &wrapped(text), Path::new(""), &LoadOptions::default())
    };
    edit(&mut scene, &sensor(2.0)).unwrap();
    assert_eq!(image(&scene), image(&load_with(&scene_text(RED, 2.0), ball(0.0)).scene));
    for (paint, x) in [(COATED, 2.0), (RED, 2.0), (COATED, 1.0)] {
        edit(&mut scene, &format!("{paint}{}", sensor(x))).unwrap();
        assert_eq!(image(&scene), image(&load_with(&scene_text(paint, x), ball(0.0)).scene), "{paint}");
    }
    // What is not used any more does not pile up.
    let count = scene.materials.len();
    for _ in 0..20 {
        edit(&mut scene, COATED).unwrap();
    }
    assert_eq!(scene.materials.len(), count);
    edit(&mut scene, &format!("{RED}{}", sensor(0.0))).unwrap();
    assert_eq!(image(&scene), before);
}

#[test]
fn a_deformed_mesh_is_the_one_that_would_have_been_loaded() {
    let Loaded { mut scene, origins, .. } = load_with(&scene_text(RED, 0.0), ball(0.0));
    origins.set_mesh(&mut scene, "ball", ball(0.5)).unwrap();
    assert_eq!(image(&scene), image(&load_with(&scene_text(RED, 0.0), ball(0.5)).scene));
}

#[test]
fn refused_edits_change_nothing() {
    let Loaded { mut scene, mut origins, .. } = load_with(&scene_text(RED, 0.0), ball(0.0));
    let before = image(&scene);
    for (text, complaint) in [
        (r#"<bsdf type="diffuse"/>"#, "without an id"),
        (r#"<emitter type="constant"/>"#, "a second environment"),
        (r#"<shape type="sphere" id="ball"/>"#, "a second shape `ball`"),
        (r#"<bsdf type="plaster" id="paint"/>"#, "not supported"),
        (r#"<shape type="ply" id="other"><string name="filename" value="other.ply"/></shape>"#, "other.ply"),
        ("<", "expected"),
    ] {
        // With something that would change the image.
        let text = wrapped(&format!("{}{text}", sensor(3.0)));
        let error = origins.edit(&mut scene, &text, Path::new(""), &LoadOptions::default()).unwrap_err();
        assert!(error.to_string().contains(complaint), "{error}");
    }
    let error = origins.set_mesh(&mut scene, "sphere", ball(0.0)).unwrap_err();
    assert!(matches!(error, EditError::UnknownShape { .. }) && error.to_string().contains("ball"), "{error}");
    let instance = scene.shapes[1].name.clone();
    let error = origins.set_mesh(&mut scene, &instance, ball(0.0)).unwrap_err();
    assert!(matches!(error, EditError::NotAMesh { .. }), "{error}");
    let mut bad = ball(0.0);
    bad.positions[3] = Vec3::NAN;
    let error = origins.set_mesh(&mut scene, "ball", bad).unwrap_err();
    assert!(
        matches!(error, EditError::Mesh { source: MeshError::BadVertex { vertex: 3, .. }, .. }),
        "{error}"
    );
    assert_eq!(image(&scene), before);
}

#[test]
fn materials_that_grow_with_every_edit_are_refused() {
    // Each edit puts a mask around what is inside of the one before.
    let Loaded { mut scene, mut origins, .. } = load_with(&scene_text(RED, 0.0), ball(0.0));
    let mut inner = "paint".to_owned();
    let refused = (0..200).find(|i| {
        let next = format!("inner{i}");
        let text = format!(r#"<bsdf type="mask" id="{inner}"><bsdf type="diffuse" id="{next}"/></bsdf>"#);
        inner = next;
        origins.edit(&mut scene, &wrapped(&text), Path::new(""), &LoadOptions::default()).is_err()
    });
    assert!(refused.is_some_and(|edits| edits > 20), "{refused:?}");
}
