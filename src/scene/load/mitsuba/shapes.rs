//! The `shape` plugins, and how the geometry of their shapes is loaded.

use std::path::PathBuf;
use std::sync::Arc;

use glam::{DAffine3, DVec3, Vec2, Vec3};
use rayon::prelude::*;

use super::super::mesh::{Normals, Placement, RawMesh};
use super::super::{LoadError, Location, Log, obj, ply, serialized};
use super::builder::{Attribute, PlannedShape};
use super::plugin::{Kind, Parameter, Plugin};
use super::properties::Properties;
use super::values::tangent_frame;
use super::xml::{Category, Document, one_of};
use crate::scene::{AnalyticKind, AnalyticShape, Geometry, MeshError, Shape, TriangleMesh};

pub(super) type Build = fn(&Properties) -> Result<Surface, LoadError>;

/// A geometry, or the file from which it can be loaded, independently of all others.
pub(super) enum Surface {
    Ready(Geometry),
    File(MeshFile),
}

/// A mesh that is to be loaded.
pub(super) struct MeshFile {
    path: PathBuf,
    format: Format,
    placement: Placement,
    /// Where the scene names the file.
    from: Location,
    /// What stands for the file, if it is not to be read.
    memory: Option<Arc<RawMesh>>,
}

#[derive(Clone, Copy)]
enum Format {
    Obj,
    Ply,
    /// The mesh of that index in the file.
    Serialized {
        index: u32,
    },
}

impl Surface {
    /// How the mesh of a file is placed.
    pub(super) fn placement(&self) -> Option<Placement> {
        match self {
            Self::Ready(_) => None,
            Self::File(file) => Some(file.placement),
        }
    }
}

impl MeshFile {
    pub(super) fn load(&self, log: &mut Log) -> Result<Geometry, LoadError> {
        let Self { path, format, placement, from, memory } = self;
        if let Some(mesh) = memory {
            let refuse = |e: MeshError| LoadError::new(from.clone(), e.to_string(), "a valid mesh");
            return RawMesh::clone(mesh).place(placement).map(Geometry::Mesh).map_err(refuse);
        }
        match *format {
            Format::Obj => obj::load_mesh(path, from, placement, log),
            Format::Ply => ply::load_mesh(path, from, placement, log),
            Format::Serialized { index } => serialized::load_mesh(path, from, index, placement, log),
        }
    }
}

pub(super) const PLUGINS: &[Plugin<Build>] = &[
    Plugin::new(
        "obj",
        "mesh from a Wavefront OBJ file",
        &[MESH_FILE, &[Parameter::new("flip_tex_coords", Kind::Boolean, "true", "turn v to 1 - v")], COMMON],
        |p| mesh_file(p, Format::Obj),
    ),
    Plugin::new(
        "ply",
        "mesh from a PLY file",
        &[MESH_FILE, &[Parameter::new("flip_tex_coords", Kind::Boolean, "false", "turn v to 1 - v")], COMMON],
        |p| mesh_file(p, Format::Ply),
    ),
    Plugin::new(
        "serialized",
        "mesh from a file of Mitsuba's own format",
        &[
            MESH_FILE,
            &[
                Parameter::new("shape_index", Kind::Integer, "0", "which mesh of the file"),
                Parameter::new("flip_tex_coords", Kind::Boolean, "false", "turn v to 1 - v"),
            ],
            COMMON,
        ],
        |p| {
            let index = p.integer("shape_index", "a whole number of 0 or more")?;
            mesh_file(p, Format::Serialized { index })
        },
    ),
    Plugin::new("rectangle", "[-1, 1]^2 in the xy plane, normal +z", &[COMMON], |p| {
        quads(p, &[(Vec3::Z, [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])], RECTANGLE_UVS)
    }),
    Plugin::new("cube", "[-1, 1]^3, normals outwards", &[COMMON], |p| quads(p, &CUBE, CUBE_UVS)),
    Plugin::new(
        "sphere",
        "sphere, normal outwards",
        &[
            &[
                Parameter::optional("center", Kind::Vector, "by default the origin"),
                Parameter::new("radius", Kind::Float, "1", "in object space"),
            ],
            COMMON,
        ],
        |p| {
            let radius = p.positive("radius")?;
            let center = p.optional_vector("center").unwrap_or(DVec3::ZERO);
            let local = DAffine3::from_translation(center) * DAffine3::from_scale(DVec3::splat(radius));
            analytic(p, AnalyticKind::Sphere, local)
        },
    ),
    Plugin::new("disk", "unit disk in the xy plane, normal +z", &[COMMON], |p| {
        analytic(p, AnalyticKind::Disk, DAffine3::IDENTITY)
    }),
    Plugin::new(
        "cylinder",
        "open cylinder, normal outwards",
        &[
            &[
                Parameter::optional("p0", Kind::Vector, "start of the axis, by default the origin"),
                Parameter::optional("p1", Kind::Vector, "end of the axis, by default (0, 0, 1)"),
                Parameter::new("radius", Kind::Float, "1", "in object space"),
            ],
            COMMON,
        ],
        cylinder,
    ),
];

const COMMON: &[Parameter] = &[
    Parameter::optional("to_world", Kind::Transform, "object space to world space"),
    Parameter::new("flip_normals", Kind::Boolean, "false", "turn normals over"),
    Parameter::object(Category::Bsdf, "what the surface is made of, by default diffuse"),
    Parameter::object(Category::Emitter, "an `area` emitter"),
];

const MESH_FILE: &[Parameter] = &[
    Parameter::required("filename", Kind::String, "beside the scene, or in a <path>"),
    Parameter::new("face_normals", Kind::Boolean, "false", "flat, instead of the file's or smooth normals"),
    Parameter::optional(
        "max_smooth_angle",
        Kind::Float,
        "degrees: new normals, smooth between triangles at a lesser angle (Mitsuba 0.6)",
    ),
];

fn mesh_file(p: &Properties, format: Format) -> Result<Surface, LoadError> {
    let name = p.string("filename")?;
    let memory = p.document.mesh(name).cloned();
    let path = p.document.resolve_path(name, p.object.at);
    let normals = match (p.boolean("face_normals")?, p.optional_float("max_smooth_angle")) {
        (false, None) => Normals::GivenOrSmooth,
        (true, None) => Normals::Flat,
        (false, Some(angle)) if (0.0..=180.0).contains(&angle) => Normals::Creased(angle.to_radians()),
        (false, Some(_)) => return Err(p.bad_value("max_smooth_angle", "an angle from 0 to 180 degrees")),
        (true, Some(_)) => {
            return Err(p.error(
                "max_smooth_angle",
                "`max_smooth_angle` beside `face_normals`",
                "one of them",
            ));
        }
    };
    let placement = Placement {
        to_world: p.transform("to_world"),
        normals,
        flip_normals: p.boolean("flip_normals")?,
        flip_v: p.boolean("flip_tex_coords")?,
    };
    Ok(Surface::File(MeshFile { path, format, placement, from: p.locate("filename"), memory }))
}

/// A face's normal and its corners.
type Quad = (Vec3, [[i8; 3]; 4]);

const RECTANGLE_UVS: [Vec2; 4] = [Vec2::ZERO, Vec2::X, Vec2::ONE, Vec2::Y];

/// The faces of the cube with corners in Mitsuba's order, on which texture coordinates depend.
const CUBE: [Quad; 6] = [
    (Vec3::NEG_Y, [[1, -1, -1], [1, -1, 1], [-1, -1, 1], [-1, -1, -1]]),
    (Vec3::Y, [[1, 1, -1], [-1, 1, -1], [-1, 1, 1], [1, 1, 1]]),
    (Vec3::X, [[1, -1, -1], [1, 1, -1], [1, 1, 1], [1, -1, 1]]),
    (Vec3::Z, [[1, -1, 1], [1, 1, 1], [-1, 1, 1], [-1, -1, 1]]),
    (Vec3::NEG_X, [[-1, -1, 1], [-1, 1, 1], [-1, 1, -1], [-1, -1, -1]]),
    (Vec3::NEG_Z, [[1, 1, -1], [1, -1, -1], [-1, -1, -1], [-1, 1, -1]]),
];

const CUBE_UVS: [Vec2; 4] = [Vec2::Y, Vec2::ONE, Vec2::X, Vec2::ZERO];

/// A mesh of squares with a normal per vertex, which keeps its side under reflections.
fn quads(p: &Properties, faces: &[Quad], uvs: [Vec2; 4]) -> Result<Surface, LoadError> {
    let mut mesh = RawMesh::default();
    for (normal, corners) in faces {
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(corners.map(|c| Vec3::from(c.map(f32::from))));
        mesh.normals.extend([*normal; 4]);
        mesh.uvs.extend(uvs);
        mesh.push_polygon(&[first, first + 1, first + 2, first + 3]);
    }
    let placement = Placement {
        to_world: p.transform("to_world"),
        normals: Normals::Given,
        flip_normals: p.boolean("flip_normals")?,
        flip_v: false,
    };
    let mesh =
        mesh.place(&placement).map_err(|e| p.error("to_world", e.to_string(), "a smaller transform"))?;
    Ok(Surface::Ready(Geometry::Mesh(mesh)))
}

fn cylinder(p: &Properties) -> Result<Surface, LoadError> {
    let radius = p.positive("radius")?;
    let p0 = p.optional_vector("p0").unwrap_or(DVec3::ZERO);
    let axis = p.optional_vector("p1").unwrap_or(DVec3::Z) - p0;
    let Some(direction) = axis.try_normalize() else {
        return Err(p.error("p1", "a cylinder of length 0", "p0 and p1 apart"));
    };
    let local = DAffine3::from_mat3_translation(tangent_frame(direction), p0)
        * DAffine3::from_scale(DVec3::new(radius, radius, axis.length()));
    analytic(p, AnalyticKind::Cylinder, local)
}

/// The unit shape under `local` and then `to_world`.
fn analytic(p: &Properties, kind: AnalyticKind, local: DAffine3) -> Result<Surface, LoadError> {
    let to_world = p.transform("to_world") * local;
    let shape = AnalyticShape::new(kind, to_world, p.boolean("flip_normals")?).ok_or_else(|| {
        let expected = match kind {
            AnalyticKind::Sphere => "rotation, translation and even scale",
            AnalyticKind::Disk => "rotation, translation and scale along the axes, without shear",
            AnalyticKind::Cylinder => "rotation, translation, and the same scale along x and y",
        };
        p.error("to_world", format!("`to_world` distorts the {}", p.object.plugin), expected)
    })?;
    let bounds = shape.bounds();
    let farthest = bounds.min.abs().max(bounds.max.abs()).max_element();
    if farthest.is_nan() || farthest >= TriangleMesh::COORDINATE_LIMIT {
        let expected = format!("coordinates below {:e}", TriangleMesh::COORDINATE_LIMIT);
        return Err(p.error(
            "to_world",
            format!("a {} that reaches to {farthest:e}", p.object.plugin),
            expected,
        ));
    }
    Ok(Surface::Ready(Geometry::Analytic(shape)))
}

/// Loads the geometry of shapes, in parallel.
pub(super) fn load_all(
    planned: Vec<PlannedShape>,
    document: &Document,
    log: &mut Log,
) -> Result<Vec<Shape>, LoadError> {
    let lenient = log.lenient;
    let loaded: Vec<_> = planned
        .into_par_iter()
        .map(|shape| {
            let mut log = Log { lenient, ..Log::default() };
            let geometry = match shape.surface {
                Surface::Ready(geometry) => Ok(geometry),
                Surface::File(file) => file.load(&mut log),
            };
            let PlannedShape { name, material, emission, attributes, .. } = shape;
            let shape = geometry.and_then(|geometry| {
                check_attributes(&name, &geometry, &attributes, document)?;
                Ok(Shape { name, geometry, material, emission })
            });
            (shape, log)
        })
        .collect();
    let mut shapes = Vec::with_capacity(loaded.len());
    // In the order of the file, so that which error is reported does not depend on threads.
    for (shape, messages) in loaded {
        log.absorb(messages);
        shapes.push(shape?);
    }
    Ok(shapes)
}

/// Whether a shape has the attributes that its material and emission ask for.
fn check_attributes(
    name: &str,
    geometry: &Geometry,
    attributes: &[Attribute],
    document: &Document,
) -> Result<(), LoadError> {
    let mesh = match geometry {
        Geometry::Mesh(mesh) => Some(mesh),
        Geometry::Analytic(_) | Geometry::Instance(_) => None,
    };
    let has = |attribute: &str| mesh.is_some_and(|m| m.attribute(attribute).is_some());
    let Some((missing, at)) = attributes.iter().find(|(attribute, _)| !has(attribute)) else { return Ok(()) };
    let there: Vec<_> = mesh.iter().flat_map(|m| m.attributes()).map(|a| a.name.as_str()).collect();
    let expected = if there.is_empty() { "a mesh with attributes".to_owned() } else { one_of(&there) };
    Err(document.error(*at, format!("attribute `{missing}`, which shape `{name}` does not have"), expected))
}
