//! Loaders: what valid files become, and what invalid ones are told.
//! What several of these files use is here; `scenes` is about files as wholes and what they are told, the others about what is in them.

mod materials;
mod scenes;
mod shapes;

use std::path::PathBuf;

use glam::Vec3;
use helmholtz::scene::load::{LoadOptions, Loaded, load};
use helmholtz::scene::{Geometry, Material, Scene, Shape, TriangleMesh};

/// A folder for the files of one test, with its path in messages shortened.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, content).unwrap();
        path
    }

    fn load(&self, name: &str, options: &LoadOptions) -> Result<Loaded, String> {
        load(&self.0.path().join(name), options).map_err(|e| self.shorten(&e.to_string()))
    }

    fn shorten(&self, message: &str) -> String {
        message.replace(&format!("{}/", self.0.path().display()), "")
    }
}

fn lenient() -> LoadOptions {
    LoadOptions { lenient: true, ..LoadOptions::default() }
}

fn define(name: &str, value: &str) -> LoadOptions {
    LoadOptions { defines: vec![(name.to_owned(), value.to_owned())], ..LoadOptions::default() }
}

/// Loads what stands between `<scene>` tags. The first line of `body` is line 1.
fn xml_with(body: &str, options: &LoadOptions) -> Result<Loaded, String> {
    let folder = Folder::new();
    folder.write("scene.xml", format!("<scene version=\"3.0.0\">{body}</scene>"));
    folder.load("scene.xml", options)
}

fn xml(body: &str) -> Scene {
    xml_with(body, &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}\nin {body}")).scene
}

fn xml_error(body: &str) -> String {
    xml_with(body, &LoadOptions::default()).map(|_| ()).expect_err(body)
}

fn shape(body: &str) -> Shape {
    xml(body).shapes.remove(0)
}

fn mesh_of(shape: &Shape) -> &TriangleMesh {
    match &shape.geometry {
        Geometry::Mesh(mesh) => mesh,
        Geometry::Analytic(_) | Geometry::Instance(_) => panic!("{} is not a mesh", shape.name),
    }
}

fn triangle_count(shape: &Shape) -> usize {
    match &shape.geometry {
        Geometry::Mesh(mesh) => mesh.triangles().len(),
        Geometry::Analytic(_) | Geometry::Instance(_) => 0,
    }
}

/// The material of the scene's only shape.
fn material(bsdf: &str) -> Material {
    let scene = xml(&format!("<shape type=\"sphere\">{bsdf}</shape>"));
    scene.materials[scene.shapes[0].material.0 as usize].clone()
}

fn near(a: Vec3, b: [f32; 3]) -> bool {
    (a - Vec3::from(b)).abs().max_element() < 1e-5
}

const CORNER_OBJ: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 0 1\nvt .25 .25\nf 1/1 2/1 3/1\nf 1/1 4/1 2/1\n";

const TRIANGLE_PLY: &str = "ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty double y\n\
    property float z\nproperty uchar red\nproperty float s\nproperty float t\nelement face 1\n\
    property list uchar int vertex_index\nend_header\n0 0 0 7 0 0.25\n1 0 0 7 1 0\n1 1 0 7 1 1\n0 1 0 7 0 1\n4 0 1 2 3\n";
