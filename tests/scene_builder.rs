//! Small scenes made in code, for tests with analytic answers.

use std::sync::Arc;

use glam::{Affine2, DAffine3, DVec3, UVec2, UVec3, Vec2, Vec3};
use helmholtz::scene::{
    AnalyticShape, Emitter, Geometry, Image, Input, Material, MaterialId, Rgb, Scene, Shape, Spot, Texels,
    Texture, TextureId, TriangleMesh,
};

/// A scene of 8x8 pixels without shapes, seen from the origin along +z.
pub(crate) fn empty() -> Scene {
    Scene::empty(UVec2::splat(8), 40.0)
}

pub(crate) trait Build: Sized {
    fn shape(self, geometry: Geometry, material: Material, emission: Option<Rgb>) -> Self;
    fn emitter(self, emitter: Emitter) -> Self;
}

impl Build for Scene {
    fn shape(mut self, geometry: Geometry, material: Material, emission: Option<Rgb>) -> Self {
        let id = MaterialId(self.materials.len() as u32);
        self.materials.push(material);
        let name = format!("shape{}", self.shapes.len());
        self.shapes.push(Shape { name, geometry, material: id, emission: emission.map(Into::into) });
        self
    }

    fn emitter(mut self, emitter: Emitter) -> Self {
        self.emitters.push(emitter);
        self
    }
}

/// The scene with the emission of its first shape in small squares of two colours.
pub(crate) fn checkered(mut scene: Scene) -> Scene {
    scene.textures.push(Texture::Checkerboard {
        color0: Rgb::new(1.0, 6.0, 3.0).into(),
        color1: Rgb::new(2.0, 0.5, 1.0).into(),
        to_uv: Affine2::from_scale(Vec2::new(2.3, 1.7)),
    });
    scene.shapes[0].emission = Some(Input::Texture(TextureId(0)));
    scene
}

pub(crate) fn diffuse(albedo: f32) -> Material {
    Material::Diffuse { reflectance: Rgb::splat(albedo).into() }
}

pub(crate) fn sphere(center: Vec3, radius: f32) -> Geometry {
    Geometry::Analytic(AnalyticShape::sphere(center.as_dvec3(), f64::from(radius)).expect("a proper sphere"))
}

/// A sphere whose normal points inwards.
pub(crate) fn hollow_sphere(center: Vec3, radius: f64) -> Geometry {
    let to_world = DAffine3::from_scale_rotation_translation(
        DVec3::splat(radius),
        glam::DQuat::IDENTITY,
        center.as_dvec3(),
    );
    let kind = helmholtz::scene::AnalyticKind::Sphere;
    Geometry::Analytic(AnalyticShape::new(kind, to_world, true).expect("a proper sphere"))
}

/// The parallelogram `corner + s ex + t ey` as two triangles; the normal is `ex` cross `ey`.
pub(crate) fn quad(corner: Vec3, ex: Vec3, ey: Vec3) -> Geometry {
    let positions = vec![corner, corner + ex, corner + ex + ey, corner + ey];
    mesh(positions, &[UVec3::new(0, 1, 2), UVec3::new(0, 2, 3)])
}

pub(crate) fn mesh(positions: Vec<Vec3>, triangles: &[UVec3]) -> Geometry {
    let triangles = triangles.iter().map(UVec3::to_array).collect();
    Geometry::Mesh(
        TriangleMesh::new(positions, triangles, Vec::new(), Vec::new(), false).expect("a valid mesh"),
    )
}

/// Everything in a scene, the camera included, times a factor. Radiance stays; a point or spot light's intensity grows by the square.
pub(crate) fn scaled(mut scene: Scene, scale: f64) -> Scene {
    for shape in &mut scene.shapes {
        shape.geometry = match &shape.geometry {
            Geometry::Mesh(mesh) => {
                let positions = mesh.positions().iter().map(|p| (p.as_dvec3() * scale).as_vec3()).collect();
                let (normals, uvs) = (mesh.normals().to_vec(), mesh.uvs().to_vec());
                let (triangles, flip) = (mesh.triangles().to_vec(), mesh.flip_normals());
                Geometry::Mesh(
                    TriangleMesh::new(positions, triangles, normals, uvs, flip).expect("a valid mesh"),
                )
            }
            Geometry::Analytic(analytic) => {
                let to_world = DAffine3::from_scale(DVec3::splat(scale)) * *analytic.to_world();
                let analytic = AnalyticShape::new(analytic.kind(), to_world, analytic.flip_normals());
                Geometry::Analytic(analytic.expect("a proper shape"))
            }
            Geometry::Instance(_) => unimplemented!("no test scales instances"),
        };
    }
    for emitter in &mut scene.emitters {
        if let Emitter::Point { position, intensity } | Emitter::Spot(Spot { position, intensity, .. }) =
            emitter
        {
            *position *= scale as f32;
            *intensity *= (scale * scale) as f32;
        }
    }
    // The lens is given in camera units.
    scene.camera.to_world = DAffine3::from_scale(DVec3::splat(scale)) * scene.camera.to_world;
    scene
}

/// An image of floats, rows from the top.
pub(crate) fn image(size: UVec2, texels: Vec<[f32; 3]>) -> Arc<Image> {
    let texels = Texels::F32(texels.into_iter().flatten().collect());
    Arc::new(Image::new(size, 3, texels).expect("as many texels as the size says"))
}
