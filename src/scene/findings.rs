//! What people should know about a scene before they render it, found by looking at the plain data: things without effect, and geometry that is
//! probably not meant. Nothing here is an error; all of it renders.

use std::collections::HashMap;

use glam::{DVec3, Vec3};

use super::requirements::Requirements;
use super::{Aabb, AnalyticKind, Geometry, Input, Material, MaterialId, Scene, Shape, TriangleMesh};

/// What a finding is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FindingKind {
    /// A material that no surface has.
    UnusedMaterial,
    /// A texture that no material or light has that is used.
    UnusedTexture,
    /// A light that shines away from everything.
    LightFacesAway,
    /// A closed surface whose normals point the wrong way.
    InsideOut,
    /// Triangles without area.
    DegenerateTriangles,
    /// A shape so far from the origin that its coordinates are coarse.
    FarFromOrigin,
    /// Nothing emits.
    NoLight,
}

impl FindingKind {
    /// A name for programs.
    pub fn name(self) -> &'static str {
        match self {
            Self::UnusedMaterial => "unused_material",
            Self::UnusedTexture => "unused_texture",
            Self::LightFacesAway => "light_faces_away",
            Self::InsideOut => "inside_out",
            Self::DegenerateTriangles => "degenerate_triangles",
            Self::FarFromOrigin => "far_from_origin",
            Self::NoLight => "no_light",
        }
    }
}

/// Something to know.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Finding {
    /// What it is about.
    pub kind: FindingKind,
    /// A sentence for people.
    pub text: String,
}

/// A shape is far from the origin if the spacing of f32 numbers there is more than this share of its size.
const COARSE: f64 = 1e-4;

/// Everything there is to know about a scene. Takes time and memory in proportion to its triangles; groups of instances are looked at once, in their
/// own space.
pub fn findings(scene: &Scene, requirements: &Requirements) -> Vec<Finding> {
    let mut found = Vec::new();
    let mut add = |kind, text| found.push(Finding { kind, text });
    let unused = |used: &[bool]| (0..used.len()).filter(|&i| !used[i]).collect::<Vec<_>>();
    for i in unused(&requirements.used_materials) {
        add(
            FindingKind::UnusedMaterial,
            format!("material {i} ({}) is on no surface", scene.materials[i].kind()),
        );
    }
    for i in unused(&requirements.used_textures) {
        add(FindingKind::UnusedTexture, format!("texture {i} is in no material or light that is used"));
    }
    if requirements.lights.delta() + requirements.lights.visible() == 0 {
        add(FindingKind::NoLight, "nothing emits: the image will be black".to_owned());
    }
    for (index, shape) in scene.shapes.iter().enumerate() {
        if shape.emission.is_some() && faces_away(scene, index) {
            let text = format!("light `{}` shines away from everything else", shape.name);
            add(FindingKind::LightFacesAway, text);
        }
        for finding in of_geometry(shape) {
            add(finding.kind, finding.text);
        }
        if let Some(text) = inside_out(scene, shape) {
            add(FindingKind::InsideOut, text);
        }
        if let Some(text) = far_away(shape) {
            add(FindingKind::FarFromOrigin, text);
        }
    }
    found
}

/// Degenerate triangles of a shape, or of the parts of its group.
fn of_geometry(shape: &Shape) -> Vec<Finding> {
    match &shape.geometry {
        Geometry::Analytic(_) => Vec::new(),
        Geometry::Instance(instance) => instance.group().shapes().iter().flat_map(of_geometry).collect(),
        Geometry::Mesh(mesh) => {
            let area = |t: u32| {
                let [a, b, c] = mesh.corners(t).map(Vec3::as_dvec3);
                (b - a).cross(c - a)
            };
            let count = (0..mesh.triangles().len() as u32).filter(|&t| area(t) == DVec3::ZERO).count();
            let text = || {
                format!("{count} of {} triangles of `{}` have no area", mesh.triangles().len(), shape.name)
            };
            (count > 0)
                .then(|| Finding { kind: FindingKind::DegenerateTriangles, text: text() })
                .into_iter()
                .collect()
        }
    }
}

/// The side of a triangle that its shading normals point to: its geometric normal, not of unit length.
fn outward(mesh: &TriangleMesh, triangle: u32) -> DVec3 {
    let [a, b, c] = mesh.corners(triangle).map(Vec3::as_dvec3);
    let n = (b - a).cross(c - a);
    let shading = |t: [u32; 3]| t.iter().map(|&i| mesh.normals()[i as usize].as_dvec3()).sum::<DVec3>();
    let is_turned = !mesh.normals().is_empty() && shading(mesh.triangles()[triangle as usize]).dot(n) < 0.0;
    if is_turned == mesh.flip_normals() { n } else { -n }
}

/// Whether no other shape, and not the camera, reaches in front of an emitting shape. Of curved lights that is not asked.
fn faces_away(scene: &Scene, light: usize) -> bool {
    let others =
        scene.shapes.iter().enumerate().filter(|(i, _)| *i != light).map(|(_, s)| s.geometry.bounds());
    let mut places: Vec<DVec3> = others.filter(|b| !b.is_empty()).flat_map(corners).collect();
    places.push(scene.camera.to_world.translation);
    let is_in_front = |p: DVec3, n: DVec3| {
        // A neighbour in the same plane is not lit by it.
        places.iter().any(|place| (*place - p).dot(n) > 1e-5 * n.length() * (*place - p).length())
    };
    match &scene.shapes[light].geometry {
        Geometry::Mesh(mesh) => (0..mesh.triangles().len() as u32)
            .all(|t| !is_in_front(mesh.corners(t)[0].as_dvec3(), outward(mesh, t))),
        Geometry::Analytic(shape) if shape.kind() == AnalyticKind::Disk => {
            let n = super::mesh::normal_matrix(&shape.to_world().matrix3).z_axis;
            let n = if shape.flip_normals() { -n } else { n };
            !is_in_front(shape.to_world().translation, n)
        }
        Geometry::Analytic(_) | Geometry::Instance(_) => false,
    }
}

fn corners(b: Aabb) -> impl Iterator<Item = DVec3> {
    let (min, max) = (b.min.as_dvec3(), b.max.as_dvec3());
    (0..8_u32).map(move |i| DVec3::select(glam::BVec3::new(i & 1 > 0, i & 2 > 0, i & 4 > 0), max, min))
}

/// Whether a surface's normals point into what it encloses; `None` if it is not closed.
fn points_inwards(geometry: &Geometry) -> Option<bool> {
    match geometry {
        Geometry::Mesh(mesh) => {
            if !is_closed(mesh) {
                return None;
            }
            let origin = mesh.corners(0)[0].as_dvec3();
            let volume: f64 = (0..mesh.triangles().len() as u32)
                .map(|t| (mesh.corners(t)[0].as_dvec3() - origin).dot(outward(mesh, t)))
                .sum();
            (volume != 0.0).then_some(volume < 0.0)
        }
        Geometry::Analytic(shape) => (shape.kind() == AnalyticKind::Sphere).then(|| shape.flip_normals()),
        Geometry::Instance(_) => None,
    }
}

/// Whether each edge is shared by two triangles that run through it in opposite directions. Corners at the same place are the same.
fn is_closed(mesh: &TriangleMesh) -> bool {
    let mut edges: HashMap<[[u32; 3]; 2], i32> = HashMap::new();
    // -0 is 0.
    let key = |p: Vec3| p.to_array().map(|x| (x + 0.0).to_bits());
    for t in 0..mesh.triangles().len() as u32 {
        let [a, b, c] = mesh.corners(t).map(key);
        for (from, to) in [(a, b), (b, c), (c, a)] {
            if from != to {
                let (edge, direction) = if from < to { ([from, to], 1) } else { ([to, from], -1) };
                *edges.entry(edge).or_default() += direction;
            }
        }
    }
    !edges.is_empty() && edges.values().all(|&balance| balance == 0)
}

fn inside_out(scene: &Scene, shape: &Shape) -> Option<String> {
    let role = Role::of(&scene.materials, shape.material)?;
    let is_inwards = points_inwards(&shape.geometry)?;
    let name = &shape.name;
    let bounds = shape.geometry.bounds();
    let holds = |b: Aabb, p: Vec3| p.cmpge(b.min).all() && p.cmple(b.max).all();
    if role == Role::Refracts {
        let is_around = |other: &&Shape| {
            let b = other.geometry.bounds();
            !std::ptr::eq(*other, shape)
                && holds(b, bounds.min)
                && holds(b, bounds.max)
                && Role::of(&scene.materials, other.material) == Some(Role::Refracts)
        };
        // A bubble in glass is meant to be.
        let is_bubble = scene.shapes.iter().any(|s| is_around(&s));
        return (is_inwards && !is_bubble).then(|| {
            format!("`{name}` refracts, but its normals point inwards: its inside and outside are exchanged")
        });
    }
    let is_camera_inside = holds(bounds, scene.camera.to_world.translation.as_vec3());
    (shape.emission.is_none() && is_inwards != is_camera_inside).then(|| {
        let (normals, side) = if is_inwards { ("inwards", "outside") } else { ("outwards", "inside") };
        format!("`{name}` has normals that point {normals}, and a material of one side: seen from {side} it is black")
    })
}

/// What side normals are for.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Role {
    /// They tell the inside from the outside of a dielectric.
    Refracts,
    /// They tell the side that scatters; the other is black.
    OneSided,
}

impl Role {
    /// `None` where both sides are alike.
    fn of(materials: &[Material], id: MaterialId) -> Option<Self> {
        let (material, before) = materials.get(..=id.0 as usize)?.split_last()?;
        match material {
            Material::Dielectric { .. } | Material::RoughDielectric { .. } => Some(Self::Refracts),
            Material::Principled(p) if p.spec_trans != Input::Constant(0.0) => Some(Self::Refracts),
            Material::Diffuse { .. }
            | Material::Conductor { .. }
            | Material::RoughConductor { .. }
            | Material::Plastic { .. }
            | Material::Principled(_) => Some(Self::OneSided),
            Material::ThinDielectric { .. } | Material::Null | Material::TwoSided { .. } => None,
            Material::Mask { material, .. } | Material::Perturbed { material, .. } => {
                Self::of(before, *material)
            }
            Material::Blend { first, second, .. } => {
                let (first, second) = (Self::of(before, *first), Self::of(before, *second));
                if first == second { first } else { None }
            }
        }
    }
}

fn far_away(shape: &Shape) -> Option<String> {
    let bounds = shape.geometry.bounds();
    if bounds.is_empty() {
        return None;
    }
    let far = bounds.min.abs().max(bounds.max.abs()).max_element();
    let size = (bounds.max.as_dvec3() - bounds.min.as_dvec3()).length();
    let spacing = f64::from(far.next_up()) - f64::from(far);
    (spacing > COARSE * size).then(|| {
        format!(
            "`{}` is {size:.3e} across and lies at {far:.3e}, where f32 coordinates are {spacing:.1e} apart: move the scene to the origin",
            shape.name
        )
    })
}

impl Material {
    /// Mitsuba's name for it.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Diffuse { .. } => "diffuse",
            Self::Conductor { .. } => "conductor",
            Self::RoughConductor { .. } => "roughconductor",
            Self::Dielectric { .. } => "dielectric",
            Self::RoughDielectric { .. } => "roughdielectric",
            Self::ThinDielectric { .. } => "thindielectric",
            Self::Plastic { roughness: None, .. } => "plastic",
            Self::Plastic { .. } => "roughplastic",
            Self::Principled(_) => "principled",
            Self::Null => "null",
            Self::TwoSided { .. } => "twosided",
            Self::Mask { .. } => "mask",
            Self::Blend { .. } => "blendbsdf",
            Self::Perturbed { by: super::Perturbation::Bump { .. }, .. } => "bumpmap",
            Self::Perturbed { .. } => "normalmap",
        }
    }
}
