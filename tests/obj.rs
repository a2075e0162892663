//! The OBJ parser against `tobj` on files that both read alike, and on what only ours reads.

use std::collections::HashSet;
use std::fmt::Write;
use std::io::Cursor;
use std::path::Path;

use glam::{Vec2, Vec3};
use helmholtz::scene::load::{LoadOptions, Loaded, load};
use helmholtz::scene::{Geometry, Input, Material, Texture, TriangleMesh};
use proptest::prelude::*;

const LIBRARY: &str = "newmtl red\nKd 1 0 0\nnewmtl blue\nKd 0 0 1\n";

fn load_text(text: &str) -> Loaded {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("a.mtl"), LIBRARY).expect("written");
    let path = folder.path().join("a.obj");
    std::fs::write(&path, text).expect("written");
    load(&path, &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}\n{text}"))
}

fn mesh(loaded: &Loaded, shape: usize) -> &TriangleMesh {
    match &loaded.scene.shapes[shape].geometry {
        Geometry::Mesh(mesh) => mesh,
        Geometry::Analytic(_) | Geometry::Instance(_) => panic!("an OBJ file has meshes only"),
    }
}

/// A line of a file in the making.
#[derive(Debug, Clone)]
enum Line {
    /// Position, texture coordinates and normal at once, so that there are as many of each.
    Vertex([f32; 8]),
    /// Three corners by what part of those above they name, each attribute by its own; and whether backwards.
    Face([[prop::sample::Index; 3]; 3], bool),
    Other(&'static str),
}

/// Lines that say nothing about geometry.
const OTHERS: [&str; 10] =
    ["g a", "o b c", "g", "usemtl red", "usemtl blue ", "usemtl none", "# f 1 2", "", "s 1", "cstype x"];

fn line() -> impl Strategy<Value = Line> {
    prop_oneof![
        3 => prop::array::uniform8(-1e3_f32..1e3).prop_map(Line::Vertex),
        3 => (any::<[[prop::sample::Index; 3]; 3]>(), any::<bool>()).prop_map(|(f, back)| Line::Face(f, back)),
        1 => prop::sample::select(&OTHERS[..]).prop_map(Line::Other),
    ]
}

/// A number in one of the spellings of exporters.
fn spelled(x: f32, how: usize) -> String {
    match how % 4 {
        0 => format!("{x}"),
        1 => format!("{x:.6}"),
        2 => format!("{x:e}"),
        _ => format!("{x:+.3}"),
    }
}

/// The text of a file; which attributes its corners have is the same throughout.
fn text(lines: &[Line], has: [bool; 2], space: &str) -> String {
    let mut out = "mtllib a.mtl\n".to_owned();
    let mut count = 0;
    for (i, line) in lines.iter().enumerate() {
        match line {
            Line::Vertex(x) => {
                let x: Vec<String> = x.iter().enumerate().map(|(k, x)| spelled(*x, i + k)).collect();
                let _ = writeln!(out, "v{space}{}", x[..3].join(space));
                let _ = writeln!(out, "vt{space}{}\nvn {}{space}", x[3..5].join(space), x[5..].join(space));
                count += 1;
            }
            Line::Face(corners, backwards) if count > 0 => {
                out.push('f');
                for corner in corners {
                    let name = |k: usize| {
                        let index = corner[k].index(count) as i64;
                        (if *backwards { index - count as i64 } else { index + 1 }).to_string()
                    };
                    let (vt, vn) = (name(1), name(2));
                    let _ = match has {
                        [false, false] => write!(out, "{space}{}", name(0)),
                        [true, false] => write!(out, "{space}{}/{vt}", name(0)),
                        [false, true] => write!(out, "{space}{}//{vn}", name(0)),
                        [true, true] => write!(out, "{space}{}/{vt}/{vn}", name(0)),
                    };
                }
                out.push('\n');
            }
            Line::Face(..) => {}
            Line::Other(other) => {
                let _ = writeln!(out, "{other}");
            }
        }
    }
    out
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(400) })]

    /// The same parts, vertices in the same order, the same triangles, to the last bit.
    #[test]
    fn files_mean_what_they_mean_to_tobj(
        lines in prop::collection::vec(line(), 3..60),
        has in any::<[bool; 2]>(),
        space in prop::sample::select(&[" ", "\t", "   "][..]),
        end in prop::sample::select(&["\n", "\r\n"][..]),
    ) {
        // Each file has at least one vertex.
        let first = [Line::Vertex([1.0, 2.0, 3.0, 0.1, 0.2, 1.0, 2.0, 2.0])];
        let mut text = text(&[&first[..], &lines].concat(), has, space);
        text.push_str(["f 1 1 1", "f 1/1 1/1 1/1", "f 1//1 1//1 1//1", "f 1/1/1 1/1/1 1/1/1"][usize::from(has[0]) + 2 * usize::from(has[1])]);
        let text = text.replace('\n', end) + end;
        // A name that is missing is an error there.
        let theirs = text.replace(&format!("g{end}"), &format!("g unnamed{end}"));
        let options = tobj::LoadOptions { single_index: true, triangulate: true, ..Default::default() };
        let library = |_:  &Path| tobj::load_mtl_buf(&mut Cursor::new(LIBRARY));
        let (models, _) = tobj::load_obj_buf(&mut Cursor::new(theirs), &options, library).expect("a valid file");
        let models: Vec<_> = models.into_iter().filter(|m| !m.mesh.indices.is_empty()).collect();
        let ours = load_text(&text);
        prop_assert_eq!(ours.scene.shapes.len(), models.len());
        for (i, model) in models.iter().enumerate() {
            prop_assert_eq!(&ours.scene.shapes[i].name, &model.name.replace("unnamed_object", "unnamed"));
            let (ours, theirs) = (mesh(&ours, i), &model.mesh);
            let positions: Vec<Vec3> = theirs.positions.chunks_exact(3).map(Vec3::from_slice).collect();
            prop_assert_eq!(ours.positions(), &positions[..]);
            prop_assert_eq!(ours.triangles().as_flattened(), &theirs.indices[..]);
            let uvs: Vec<Vec2> = theirs.texcoords.chunks_exact(2).map(|t| Vec2::new(t[0], 1.0 - t[1])).collect();
            prop_assert_eq!(ours.uvs(), &uvs[..]);
            let normal = |n: &[f32]| Vec3::from_slice(n).as_dvec3().normalize_or_zero().as_vec3();
            let normals: Vec<Vec3> = theirs.normals.chunks_exact(3).map(normal).collect();
            prop_assert_eq!(ours.normals(), &normals[..]);
        }
    }
}

#[test]
fn lines_and_names_may_be_written_in_many_ways() {
    // Continued lines, Windows line ends, colours of some vertices only, faces before their vertices, zero for an absent attribute.
    let loaded = load_text(
        "mtllib a.mtl\r\nusemtl\tred\r\nf 1/1 2/0 \\\r\n 3/\r\nv 0 0 0 1 0 0\r\nv 1 0 0 2\r\n  v 0 1 0\r\nvt 0.5\r\ng\r\nusemtl blue\r\nf -3 -2 -1\r\nf 1 2 3",
    );
    assert_eq!(loaded.scene.shapes.len(), 2);
    let first = mesh(&loaded, 0);
    assert_eq!(first.positions(), [Vec3::ZERO, Vec3::X, Vec3::Y]);
    // Corners without the attribute have it as zero; v is turned over.
    assert_eq!(first.uvs(), [Vec2::new(0.5, 1.0), Vec2::new(0.0, 1.0), Vec2::new(0.0, 1.0)]);
    assert!(loaded.warnings.iter().any(|w| w.message.contains("2 vertices lack texture coordinates")));
    assert_eq!(mesh(&loaded, 1).triangles(), [[0, 1, 2], [0, 1, 2]]);
    assert_eq!(
        (loaded.scene.shapes[0].name.as_str(), loaded.scene.shapes[1].name.as_str()),
        ("unnamed", "unnamed")
    );
    assert_ne!(loaded.scene.shapes[0].material, loaded.scene.shapes[1].material);
}

#[test]
fn normals_of_some_faces_only_are_kept() {
    let loaded = load_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 3 4\nf 1//1 2//1 3//1\nf 1 2 3\n");
    let mesh = mesh(&loaded, 0);
    assert_eq!(mesh.triangles(), [[0, 1, 2], [3, 4, 5]]);
    let (slanted, none) = (Vec3::new(0.0, 0.6, 0.8), Vec3::ZERO);
    assert_eq!(mesh.normals(), [slanted, slanted, slanted, none, none, none]);
}

/// Models as exporters write them, with the number of `map_Kd` in their libraries.
#[test]
fn models_show_their_textures() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/testdata/meshes/blendswap-cc0");
    if !folder.exists() {
        eprintln!("skipped: {} is absent", folder.display());
        return;
    }
    for (name, textures) in [
        ("JapaneseLantern", 1),
        ("bedWithTexture", 2),
        ("chair", 2),
        ("couch", 2),
        ("decorativePlant", 0),
        ("emergencySign", 1),
        ("flowerBox", 0),
        ("kitchenaid", 2),
        ("peterbilt", 0),
        ("poolTable", 17),
    ] {
        let path = folder.join(name).join(format!("{name}.obj"));
        let scene = load(&path, &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}")).scene;
        let bitmaps = scene.textures.iter().filter(|t| matches!(t, Texture::Bitmap(_))).count();
        assert_eq!(bitmaps, textures, "{name}");
        // Each is on some shape, which has coordinates for it.
        let mut shown = HashSet::new();
        for shape in &scene.shapes {
            let Material::TwoSided { front, .. } = scene.materials[shape.material.0 as usize] else {
                continue;
            };
            if let Material::Diffuse { reflectance: Input::Texture(id) } = scene.materials[front.0 as usize] {
                let Geometry::Mesh(mesh) = &shape.geometry else { panic!("{name}: not a mesh") };
                assert_eq!(mesh.uvs().len(), mesh.positions().len(), "{name}: {}", shape.name);
                shown.insert(id);
            }
        }
        assert_eq!(shown.len(), textures, "{name}");
    }
}
