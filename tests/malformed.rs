//! Broken, hostile and merely unusual files: loaders neither panic nor hang, and load what is valid.

use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use helmholtz::scene::Geometry;
use helmholtz::scene::load::{LoadError, LoadOptions, Loaded, Position, load, load_image};
use proptest::prelude::*;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/testdata/malformed");

/// The valid files with their numbers of shapes and triangles; all others are refused. The numbers were checked against
/// the faces and groups in the files: a polygon of n corners makes n - 2 triangles.
const VALID: &[(&str, usize, usize)] = &[
    ("obj-assimp/WusonOBJ.obj", 1, 3732),
    ("obj-assimp/box.obj", 1, 12),
    ("obj-assimp/box_longline.obj", 1, 944),
    ("obj-assimp/box_mat_with_spaces.obj", 1, 12),
    ("obj-assimp/box_without_lineending.obj", 1, 12),
    ("obj-assimp/concave_polygon.obj", 1, 64),
    ("obj-assimp/cube_mtllib_after_g.obj", 1, 12),
    ("obj-assimp/cube_usemtl.obj", 4, 12),
    ("obj-assimp/cube_with_vertexcolors.obj", 1, 12),
    ("obj-assimp/cube_with_vertexcolors_uni.obj", 1, 12),
    ("obj-assimp/empty_mat.obj", 1, 256),
    ("obj-assimp/mtl_different_folder.obj", 1, 12),
    ("obj-assimp/multiple_spaces.obj", 1, 1),
    ("obj-assimp/only_a_part_of_vertexcolors.obj", 1, 3),
    ("obj-assimp/regr01.obj", 55, 2710),
    ("obj-assimp/regr_3429812.obj", 3, 4),
    ("obj-assimp/space_in_material_name.obj", 1, 64),
    ("obj-assimp/spider.obj", 19, 1368),
    ("obj-assimp/testmixed.obj", 1, 12),
    ("obj-draco/cube_att.obj", 1, 12),
    ("obj-draco/cube_att_partial.obj", 1, 12),
    ("obj-draco/cube_att_sub_o.obj", 3, 12),
    ("obj-draco/cube_att_sub_o_2.obj", 3, 12),
    ("obj-draco/cube_quads.obj", 1, 12),
    ("obj-draco/deg_faces.obj", 1, 4),
    ("obj-draco/degenerate_mesh.obj", 1, 1),
    ("obj-draco/empty_name.obj", 1, 1),
    ("obj-draco/eof_test.obj", 1, 1),
    ("obj-draco/extra_vertex.obj", 1, 3),
    ("obj-draco/multiple_isolated_triangles.obj", 1, 5),
    ("obj-draco/multiple_tetrahedrons.obj", 1, 20),
    ("obj-draco/non_manifold_wrap.obj", 1, 12),
    ("obj-draco/octagon.obj", 1, 6),
    ("obj-draco/octagon_preserved.obj", 1, 6),
    ("obj-draco/one_face_123.obj", 1, 1),
    ("obj-draco/one_face_312.obj", 1, 1),
    ("obj-draco/one_face_321.obj", 1, 1),
    ("obj-draco/point_cloud_test_pos.obj", 1, 2),
    ("obj-draco/point_cloud_test_pos_norm.obj", 1, 2),
    ("obj-draco/sphere.obj", 1, 224),
    ("obj-draco/test_nm.obj", 1, 170),
    ("obj-draco/test_nm_trans.obj", 1, 170),
    ("obj-draco/test_sphere.obj", 1, 224),
    ("obj-draco/test_wrong_attribute_mapping.obj", 1, 1),
    ("obj-draco/three_faces_123.obj", 1, 3),
    ("obj-draco/three_faces_312.obj", 1, 3),
    ("obj-draco/triangle.obj", 1, 1),
    ("obj-draco/triangle_with_degenerate_tex_coords.obj", 1, 1),
    ("obj-draco/two_faces_123.obj", 1, 2),
    ("obj-draco/two_faces_312.obj", 1, 2),
    ("obj-tinyobjloader/catmark_torus_creases0.obj", 1, 64),
    ("obj-tinyobjloader/colorspace-issue-184.obj", 1, 1),
    ("obj-tinyobjloader/cornell_box.obj", 8, 36),
    ("obj-tinyobjloader/cornell_box_multimaterial.obj", 9, 36),
    ("obj-tinyobjloader/cube-vertex-w-component.obj", 6, 12),
    ("obj-tinyobjloader/cube-vertexcol.obj", 6, 12),
    ("obj-tinyobjloader/cube.obj", 6, 12),
    ("obj-tinyobjloader/issue-138.obj", 2, 12),
    ("obj-tinyobjloader/issue-161-inconsistent-f.obj", 1, 12),
    ("obj-tinyobjloader/issue-162-smoothing-group.obj", 2, 12),
    ("obj-tinyobjloader/issue-235-usemtl-then-o.obj", 2, 2),
    ("obj-tinyobjloader/issue-244-mtl-searchpaths.obj", 2, 2),
    ("obj-tinyobjloader/issue-246-usemtl-whitespace.obj", 1, 1),
    ("obj-tinyobjloader/issue-248-texres-texopt.obj", 6, 12),
    ("obj-tinyobjloader/issue-295-trianguation-failure.obj", 1, 28),
    ("obj-tinyobjloader/issue-319-002.obj", 1, 14),
    ("obj-tinyobjloader/issue-319-003.obj", 1, 8),
    ("obj-tinyobjloader/issue-330.obj", 1, 3),
    ("obj-tinyobjloader/issue-92.obj", 1, 1),
    ("obj-tinyobjloader/issue-95-2.obj", 1, 1),
    ("obj-tinyobjloader/issue-95.obj", 1, 1),
    ("obj-tinyobjloader/leading-decimal-dot-issue-201.obj", 1, 1),
    ("obj-tinyobjloader/leading-zero-in-exponent-notation-issue-210.obj", 1, 1),
    ("obj-tinyobjloader/map-bump.obj", 2, 400),
    ("obj-tinyobjloader/missing_material_file.obj", 8, 36),
    ("obj-tinyobjloader/mtl filename with whitespace issue46.obj", 6, 12),
    ("obj-tinyobjloader/mtllib-multiple-files-issue-112.obj", 1, 1),
    ("obj-tinyobjloader/no_material.obj", 8, 36),
    ("obj-tinyobjloader/norm-texopt.obj", 1, 1),
    ("obj-tinyobjloader/pbr-mat-ext.obj", 1, 2),
    ("obj-tinyobjloader/refl.obj", 6, 12),
    ("obj-tinyobjloader/skin-weight.obj", 6, 12),
    ("obj-tinyobjloader/smoothing-group-two-squares.obj", 1, 3),
    ("obj-tinyobjloader/smoothing-normal.obj", 2, 6),
    ("obj-tinyobjloader/texture-filename-with-whitespace.obj", 6, 12),
    ("obj-tinyobjloader/texture-options-issue-85.obj", 1, 1),
    ("obj-tinyobjloader/tr-and-d-issue-43.obj", 2, 400),
    ("obj-tinyobjloader/usemtl-issue-104.obj", 1, 6),
    ("obj-tinyobjloader/usemtl-issue-68.obj", 2, 400),
    ("obj-ufbx-fuzz/obj_fuzz/fuzz_0186.obj", 3, 5),
    ("obj-ufbx-fuzz/obj_fuzz/fuzz_0188.obj", 2, 6),
    ("ply-happly/platonic_shelf.ply", 1, 80),
    ("ply-happly/platonic_shelf_ascii.ply", 1, 80),
    ("ply-happly/platonic_shelf_big_endian.ply", 1, 80),
    ("ply-trimesh/BoxTextured.ply", 1, 12),
    ("ply-trimesh/cube_blender_uv.ply", 1, 12),
    ("ply-trimesh/cube_blender_uv_meshlab.ply", 1, 12),
    ("ply-trimesh/fixed_top.ply", 1, 4772),
    ("ply-trimesh/fuze.ply", 1, 1000),
    ("ply-trimesh/fuze_ascii.ply", 1, 1000),
    ("ply-trimesh/metadata.ply", 1, 2),
    ("ply-trimesh/mirror.ply", 1, 286),
    ("ply-trimesh/multi.ply", 1, 2),
    ("ply-trimesh/octagonal_pocket.ply", 1, 3262),
    ("ply-trimesh/plane.ply", 1, 2),
    ("ply-trimesh/plane_tri.ply", 1, 2),
    ("ply-trimesh/reference.ply", 1, 1610),
    ("ply-trimesh/sphere.ply", 1, 1280),
    ("ply-trimesh/tet.ply", 1, 4),
];

/// All files below a folder, with one of the extensions unless there are none, in order.
fn files(folder: &Path, extensions: &[&str], found: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            files(&path, extensions, found);
        } else if extensions.is_empty()
            || path.extension().is_some_and(|e| extensions.iter().any(|x| e == *x))
        {
            found.push(path);
        }
    }
}

/// Loads, and fails if that takes as long as only a hang would. Each took under 0.1 s when this was written.
fn load_soon(path: &Path) -> Result<Loaded, LoadError> {
    let start = Instant::now();
    let result = load(path, &LoadOptions::default());
    assert!(start.elapsed() < Duration::from_secs(5), "{} took {:?}", path.display(), start.elapsed());
    result
}

fn triangles(loaded: &Loaded) -> usize {
    let count = |g: &Geometry| match g {
        Geometry::Mesh(mesh) => mesh.triangles().len(),
        Geometry::Analytic(_) | Geometry::Instance(_) => 0,
    };
    loaded.scene.shapes.iter().map(|s| count(&s.geometry)).sum()
}

/// Whether the third-party files are there.
fn present() -> bool {
    let present = Path::new(FOLDER).exists();
    if !present {
        eprintln!("skipped: {FOLDER} is absent");
    }
    present
}

#[test]
fn third_party_files_are_loaded_or_refused_as_they_deserve() {
    if !present() {
        return;
    }
    let root = Path::new(FOLDER);
    let mut all = Vec::new();
    for kind in ["obj-assimp", "obj-draco", "obj-tinyobjloader", "obj-ufbx-fuzz", "ply-happly", "ply-trimesh"]
    {
        files(&root.join(kind), &["obj", "ply"], &mut all);
    }
    files(&root.join("xml-generic"), &["xml"], &mut all);
    files(&root.join("xml-mitsuba"), &["xml"], &mut all);
    let mut loaded = Vec::new();
    for path in &all {
        let name = path.strip_prefix(root).unwrap().to_str().unwrap();
        if let Ok(l) = load_soon(path) {
            loaded.push((name, l.scene.shapes.len(), triangles(&l)));
        }
    }
    assert_eq!(loaded, VALID);
}

#[test]
fn fuzzed_material_libraries_are_at_most_warnings() {
    if !present() {
        return;
    }
    let mut libraries = Vec::new();
    files(Path::new(FOLDER), &["mtl"], &mut libraries);
    assert!(libraries.len() > 22);
    let folder = tempfile::tempdir().unwrap();
    let obj = folder.path().join("a.obj");
    for library in libraries {
        let text = format!("mtllib {}\nusemtl a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", library.display());
        std::fs::write(&obj, text).unwrap();
        assert_eq!(triangles(&load_soon(&obj).unwrap()), 1, "{}", library.display());
    }
}

/// What [`hostile_files_need_little_memory`] runs in a process of its own.
#[test]
#[ignore = "a part of hostile_files_need_little_memory"]
fn load_all_hostile_files() {
    let mut all = Vec::new();
    files(Path::new(FOLDER), &[], &mut all);
    assert!(all.len() > 650, "{}", all.len());
    for path in all {
        eprintln!("{}", path.display());
        let start = Instant::now();
        if ["obj", "ply", "xml"].iter().any(|e| path.extension().is_some_and(|x| x == *e)) {
            let _ = load(&path, &LoadOptions::default());
        } else {
            let _ = load_image(&path);
        }
        assert!(start.elapsed() < Duration::from_secs(5), "took {:?}", start.elapsed());
    }
}

/// All third-party files, one after the other, by a process that may use 256 MiB beyond what it has before the first.
#[test]
#[cfg(target_os = "linux")]
fn hostile_files_need_little_memory() {
    if !present() {
        return;
    }
    // The program and its libraries, threads and their stacks: address space, of which little is used.
    let own = 256 << 10;
    let script = format!("ulimit -v {}; exec \"$0\" \"$@\"", own + (256 << 10));
    let program = std::env::current_exe().expect("this program");
    let output = std::process::Command::new("sh")
        .args(["-c", &script])
        .arg(program)
        .args(["--exact", "malformed::load_all_hostile_files", "--ignored", "--nocapture"])
        .envs([("RAYON_NUM_THREADS", "1"), ("MALLOC_ARENA_MAX", "1")])
        .output()
        .expect("a shell");
    let text = String::from_utf8_lossy(&output.stderr);
    // Of the file at which it ended, the name is the last line but what was said about it.
    let last: Vec<_> = text.lines().rev().take(5).collect();
    assert!(output.status.success(), "{} after: {last:#?}", output.status);
    assert!(text.lines().count() > 650, "files were left out");
}

/// Inputs on which a loader once failed, found by the targets in `fuzz/`.
#[test]
fn findings_of_fuzzing_stay_mended() {
    let mut all = Vec::new();
    files(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/data/regressions")), &[], &mut all);
    for path in all {
        let start = Instant::now();
        let bytes = std::fs::read(&path).expect("a file of the project");
        match path.extension().and_then(|e| e.to_str()) {
            // As the fuzz target reads them: after a byte 0 comes the library.
            Some("obj") => {
                let folder = tempfile::tempdir().expect("a folder");
                let mut parts = bytes.splitn(2, |&b| b == 0);
                let obj = folder.path().join("a.obj");
                std::fs::write(&obj, parts.next().unwrap_or_default()).expect("written");
                std::fs::write(folder.path().join("a.mtl"), parts.next().unwrap_or_default())
                    .expect("written");
                let _ = load(&obj, &LoadOptions::default());
            }
            Some("ply" | "xml") => {
                drop(load(&path, &LoadOptions { lenient: true, ..LoadOptions::default() }))
            }
            Some("serialized") => drop(crate::serialized::load_file(&bytes, "")),
            _ => drop(load_image(&path)),
        }
        assert!(start.elapsed() < Duration::from_secs(5), "{} took {:?}", path.display(), start.elapsed());
    }
}

/// Loads `content` from a file with the extension.
fn load_bytes(extension: &str, content: &[u8]) -> Result<Loaded, LoadError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(format!("file.{extension}"));
    std::fs::write(&path, content).unwrap();
    load_soon(&path)
}

fn refused(extension: &str, content: &str) -> String {
    let error = load_bytes(extension, content.as_bytes()).map(|_| ()).unwrap_err();
    assert!(error.to_string().len() < 1000);
    error.to_string()
}

#[test]
fn xml_that_grows_or_nests_without_bound_is_refused() {
    let scene = |body: &str| format!("<scene version='3.0.0'>{body}</scene>");
    let nested = |n: usize| "<bsdf type='twosided'>".repeat(n) + &"</bsdf>".repeat(n);
    assert!(refused("xml", &scene(&nested(100))).contains("nested"));
    refused("xml", &scene(&nested(100_000)));
    refused("xml", &"<scene version='3.0.0'>".repeat(300_000));

    let doubling: String = (1..60).fold("<default name='a0' value='xxxxxxxx'/>".to_owned(), |mut s, i| {
        let _ = write!(s, "<default name='a{i}' value='$a{0}$a{0}'/>", i - 1);
        s
    });
    assert!(refused("xml", &scene(&doubling)).contains("without bound"));

    // A chain of references as deep as there are objects, and one that closes.
    let chain = |n: usize, last: &str| {
        (0..n).fold(String::new(), |mut s, i| {
            let _ = write!(s, "<bsdf type='twosided' id='b{i}'><ref id='b{}'/></bsdf>", i + 1);
            s
        }) + last
    };
    assert!(refused("xml", &scene(&chain(20_000, "<bsdf type='diffuse' id='b20000'/>"))).contains("levels"));
    assert!(refused("xml", &scene(&chain(3, "<alias id='b0' as='b3'/>"))).contains("contains itself"));
    refused(
        "xml",
        &scene("<alias id='b' as='a'/><alias id='a' as='b'/><shape type='sphere'><ref id='a'/></shape>"),
    );

    // Blends of blends: each twice the one before.
    let doubled = (1..40).fold("<bsdf type='diffuse' id='b0'/>".to_owned(), |mut s, i| {
        let _ = write!(
            s,
            "<bsdf type='blendbsdf' id='b{i}'><float name='weight' value='0.5'/><ref id='b{0}'/><ref id='b{0}'/></bsdf>",
            i - 1
        );
        s
    });
    assert!(refused("xml", &scene(&doubled)).contains("too many others"));

    let values = (0..20_000).fold(String::new(), |mut s, i| {
        let _ = write!(s, "<float name='p{i}' value='1'/>");
        s
    });
    refused("xml", &scene(&format!("<integrator type='path'>{values}</integrator>")));
    let attributes = (0..200_000).fold(String::new(), |mut s, i| {
        let _ = write!(s, " a{i} = '1'");
        s
    });
    assert!(refused("xml", &scene(&format!("<integrator{attributes}/>"))).contains("attributes"));
}

#[test]
fn includes_that_never_end_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.xml");
    let include = "<include filename='a.xml'/>";
    for body in [include.to_owned(), include.repeat(10)] {
        std::fs::write(&path, format!("<scene version='3.0.0'>{body}</scene>")).unwrap();
        assert!(load_soon(&path).unwrap_err().to_string().contains("too deep or too often"));
    }
    // A device that never ends.
    std::fs::write(&path, "<scene version='3.0.0'><include filename='/dev/zero'/></scene>").unwrap();
    assert!(load_soon(&path).unwrap_err().to_string().contains("regular file"));
}

#[test]
fn ply_headers_that_claim_too_much_are_refused_at_the_end_of_the_file() {
    let vertex = "property float x\nproperty float y\nproperty float z\n";
    let face = "property list uint uint vertex_indices\n";
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let header = |vertices: u64, faces: u64| {
            format!(
                "ply\nformat {format} 1.0\nelement vertex {vertices}\n{vertex}element nothing {}\nelement face {faces}\n\
                 {face}end_header\n",
                u64::MAX
            )
        };
        assert!(refused("ply", &header(1 << 60, 1)).contains("the end of the file"));
        // A vertex of zeros, as text and as bytes, and then a face of 2^32 - 1 corners.
        let body = if format == "ascii" { "0 0 0\n4294967295 0\n" } else { "\0\0\0\0\0\0\0\0\0\0\0\0" };
        let mut file = (header(1, 1) + body).into_bytes();
        if format != "ascii" {
            file.extend([0xff; 8]);
        }
        assert!(load_bytes("ply", &file).is_err());
    }
}

#[test]
fn obj_indices_and_numbers_at_the_extremes_are_refused_with_their_line() {
    let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n";
    for face in [
        "f 1 2 9223372036854775807",
        "f 1 2 -9223372036854775808",
        "f 1 2 99999999999999999999",
        "f 1/9223372036854775807 2/1 3/1",
        "f 1//4611686018427387905 2//1 3//1",
        "f 0 1 2",
        "f 1 2 4",
        "f 1/1/1/1 2 3",
        "f / / /",
    ] {
        let error = load_bytes("obj", format!("{vertices}{face}\n").as_bytes()).map(|_| ()).expect_err(face);
        assert_eq!(error.location.position, Position::Line(6), "{face}: {error}");
    }
    for vertex in ["v 1 2", "v 1e30 0 0", "v inf 0 0", "v NaN 0 0", "v 1e999 0 0", "v", "v a b c"] {
        let error = load_bytes("obj", format!("{vertices}{vertex}\nf 1 2 4\n").as_bytes())
            .map(|_| ())
            .expect_err(vertex);
        assert_eq!(error.location.position, Position::Line(6), "{vertex}: {error}");
    }
    // Normals and texture coordinates that are not finite are not used, but the mesh is.
    let odd = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvn nan 0 inf\nvn 1e38 1e38 1e38\nvt inf 0\nf 1/1/1 2/1/2 3/1/1\n";
    let loaded = load_bytes("obj", odd.as_bytes()).unwrap();
    let Geometry::Mesh(mesh) = &loaded.scene.shapes[0].geometry else { panic!() };
    assert!(mesh.normals().iter().all(|n| n.is_finite()) && mesh.uvs().iter().all(|t| t.is_finite()));
    assert_eq!(loaded.warnings.len(), 2);
}

const OBJ: &str = "mtllib file.obj\no a\nv 0 0 0\nv 1 0 0 1\nv 1 1 0\nv 0 1e-3 0 1 1 1\nvt 0 .5\nvn 0 0 1\n\
    usemtl m\nf 1/1/1 2/1/1 -2/1/1 4/1/1\ng b\nf 1//1 2//1 \\\n 3//1\n";
const PLY: &str = "ply\nformat ascii 1.0\ncomment c\nelement vertex 3\nproperty float x\nproperty double y\n\
    property int z\nproperty uchar u\nproperty uchar v\nelement face 1\nproperty list uchar short vertex_index\n\
    end_header\n0 0 0 1 0\n1 0 0 0 1\n0 1.5 0 1 1\n3 0 1 2\n";
const XML: &str = "<scene version='3.0.0'><default name='r' value='2'/><bsdf type='diffuse' id='a'>\
    <rgb name='reflectance' value='0.5, 0.1 0.2'/></bsdf><shape type='sphere'><float name='radius' value='$r'/>\
    <ref id='a'/><transform name='to_world'><rotate x='1' angle='20'/><lookat origin='1 2 3' target='0 0 0'/></transform>\
    <emitter type='area'><spectrum name='radiance' value='3'/></emitter></shape><sensor type='perspective'>\
    <film type='hdrfilm'><integer name='width' value='10'/></film></sensor></scene>";

/// A valid file of each loader.
fn seeds() -> [(&'static str, &'static str); 3] {
    [("obj", OBJ), ("ply", PLY), ("xml", XML)]
}

#[test]
fn the_seeds_of_the_property_tests_are_valid() {
    for (extension, seed) in seeds() {
        load_bytes(extension, seed.as_bytes()).unwrap_or_else(|e| panic!("{e}"));
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(256) })]

    #[test]
    fn mutated_files_neither_panic_nor_hang(
        which in 0..3_usize,
        edits in prop::collection::vec((any::<prop::sample::Index>(), 0..4_u8, any::<u8>()), 1..8),
        cut in prop::option::of(any::<prop::sample::Index>()),
    ) {
        let (extension, seed) = seeds()[which];
        let mut bytes = seed.as_bytes().to_vec();
        for (place, kind, byte) in edits {
            let i = place.index(bytes.len());
            match kind {
                0 => bytes[i] = byte,
                1 => bytes.insert(i, byte),
                // Something that means something to a parser.
                2 => bytes[i] = b"-0.9e/<>'$ \n\\"[usize::from(byte) % 12],
                _ => {
                    let end = (i + usize::from(byte)).min(bytes.len());
                    let copy = bytes[i..end].to_vec();
                    bytes.extend(copy);
                }
            }
        }
        if let Some(cut) = cut {
            bytes.truncate(cut.index(bytes.len()));
        }
        let _ = load_bytes(extension, &bytes);
    }

    #[test]
    fn arbitrary_bytes_neither_panic_nor_hang(
        which in 0..3_usize,
        bytes in prop::collection::vec(any::<u8>(), 0..200),
        header in any::<bool>(),
    ) {
        let (extension, _) = seeds()[which];
        let header: &[u8] = match (header, extension) {
            (true, "ply") => b"ply\nformat binary_little_endian 1.0\nelement vertex 9\nproperty float x\nproperty float y\n\
                property float z\nelement face 9\nproperty list uchar uchar vertex_indices\nend_header\n",
            (true, "xml") => b"<scene version='3.0.0'><",
            (true, _) => b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf ",
            (false, _) => b"",
        };
        let _ = load_bytes(extension, &[header, &bytes[..]].concat());
    }
}
