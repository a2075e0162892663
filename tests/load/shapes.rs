//! Where shapes stand, which side their normals are on, and meshes from OBJ and PLY.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec2, Vec3};
use helmholtz::scene::load::{LoadOptions, Severity};
use helmholtz::scene::{AnalyticKind, Emitter, Geometry, Material, Shape, SurfacePoint, TriangleMesh};

use super::{CORNER_OBJ, Folder, TRIANGLE_PLY, mesh_of, near, shape, xml};

/// Where a transform takes the point (1, 2, 3), by way of a tiny sphere there.
fn transformed(steps: &str) -> Vec3 {
    let sphere = shape(&format!(
        "<shape type='sphere'><point name='center' value='1 2 3'/><float name='radius' value='1e-6'/>\
         <transform name='to_world'>{steps}</transform></shape>"
    ));
    let Geometry::Analytic(sphere) = sphere.geometry else { panic!() };
    sphere.to_world().translation.as_vec3()
}

#[test]
fn transforms_are_those_computed_by_hand() {
    // Later steps are applied after earlier ones; rotations are counter-clockwise seen against the axis.
    for (steps, expected) in [
        ("<translate x='1'/><scale value='2'/>", [4.0, 4.0, 6.0]),
        ("<scale value='2'/><translate x='1'/>", [3.0, 4.0, 6.0]),
        ("<translate value='2'/>", [3.0, 4.0, 5.0]),
        ("<translate value='1, -2, 0.5'/>", [2.0, 0.0, 3.5]),
        ("<rotate z='1' angle='90'/>", [-2.0, 1.0, 3.0]),
        ("<rotate value='0 10 0' angle='90'/>", [3.0, 2.0, -1.0]),
        ("<rotate x='1' y='1' z='1' angle='120'/>", [3.0, 1.0, 2.0]),
        ("<matrix value='0 1 0 5  1 0 0 0  0 0 1 0  0 0 0 1'/>", [7.0, 1.0, 3.0]),
        ("<matrix value='0 1 0 1 0 0 0 0 1'/>", [2.0, 1.0, 3.0]),
        // Looking along +x with z up, left is +y: the point is 1 to the left, 2 up and 3 ahead.
        ("<lookat origin='10 0 0' target='11 0 0' up='0 0 1'/>", [13.0, 1.0, 2.0]),
        ("", [1.0, 2.0, 3.0]),
    ] {
        let p = transformed(steps);
        assert!(near(p, expected), "{steps}: {p}");
    }
}

#[test]
fn rectangle_and_cube_are_mitsubas() {
    let rectangle = shape("<shape type='rectangle'/>");
    let mesh = mesh_of(&rectangle);
    assert_eq!(mesh.triangles().len(), 2);
    assert_eq!(SurfacePoint::on_triangle(mesh, 0, 0, 0.2, 0.3).ns, Vec3::Z);
    for (p, uv) in mesh.positions().iter().zip(mesh.uvs()) {
        assert_eq!(*uv, Vec2::new(0.5 * (p.x + 1.0), 0.5 * (p.y + 1.0)));
    }

    let cube = shape("<shape type='cube' id='box'/>");
    assert_eq!(cube.name, "box");
    let mesh = mesh_of(&cube);
    assert!(mesh.normals().is_empty() && !mesh.flip_normals(), "the winding says it all");
    assert_eq!((mesh.positions().len(), mesh.triangles().len()), (24, 12));
    for t in mesh.triangles() {
        let [a, b, c] = t.map(|i| mesh.positions()[i as usize]);
        let n = (b - a).cross(c - a).normalize();
        assert!(n.dot(a) > 0.0, "normals point outwards");
    }
    let area: f32 = mesh.triangles().iter().map(|t| triangle_area(mesh, *t)).sum();
    assert!((area - 24.0).abs() < 1e-4);
    // As Mitsuba lists it: vertex 4 is (1, 1, -1) on the +y face with texture coordinate (0, 1).
    assert_eq!((mesh.positions()[4], mesh.uvs()[4]), (Vec3::new(1.0, 1.0, -1.0), Vec2::Y));
    assert_eq!((mesh.positions()[22], mesh.uvs()[22]), (Vec3::splat(-1.0), Vec2::X));
}

fn triangle_area(mesh: &TriangleMesh, t: [u32; 3]) -> f32 {
    let [a, b, c] = t.map(|i| mesh.positions()[i as usize]);
    0.5 * (b - a).cross(c - a).length()
}

#[test]
fn normals_keep_their_side_under_reflections_and_flat_scales() {
    let mirrored =
        shape("<shape type='cube'><transform name='to_world'><scale x='-1' y='2'/></transform></shape>");
    let mesh = mesh_of(&mirrored);
    for (p, n) in mesh.positions().iter().zip(mesh.normals()) {
        assert!((n.length() - 1.0).abs() < 1e-6 && n.dot(*p) > 0.0, "outwards at {p}: {n}");
    }
    let flat = shape("<shape type='rectangle'><transform name='to_world'><scale z='0'/></transform></shape>");
    assert!(mesh_of(&flat).normals().iter().all(|n| *n == Vec3::Z));
    let tilted = shape(
        "<shape type='rectangle'><transform name='to_world'><scale x='2'/><rotate y='1' angle='45'/></transform></shape>",
    );
    let h = 0.5_f32.sqrt();
    assert!(mesh_of(&tilted).normals().iter().all(|n| near(*n, [h, 0.0, h])));
}

#[test]
fn analytic_shapes_are_placed() {
    let Geometry::Analytic(sphere) = shape(
        "<shape type='sphere'><point name='center' x='1' y='0' z='0'/><float name='radius' value='2'/>
         <transform name='to_world'><scale value='3'/></transform><boolean name='flip_normals' value='true'/></shape>",
    )
    .geometry
    else {
        panic!()
    };
    assert_eq!(sphere.kind(), AnalyticKind::Sphere);
    assert_eq!(sphere.to_world().translation, DVec3::new(3.0, 0.0, 0.0));
    assert!((sphere.area() - 4.0 * std::f64::consts::PI * 36.0).abs() < 1e-9);
    assert!(sphere.flip_normals());

    let Geometry::Analytic(cylinder) = shape(
        "<shape type='cylinder'><point name='p0' value='1 1 1'/><point name='p1' value='1 5 1'/>
         <float name='radius' value='0.5'/></shape>",
    )
    .geometry
    else {
        panic!()
    };
    assert_eq!(cylinder.kind(), AnalyticKind::Cylinder);
    let end = cylinder.to_world().transform_point3(DVec3::Z);
    assert!((end - DVec3::new(1.0, 5.0, 1.0)).length() < 1e-12);
    // 2 pi r l.
    assert!((cylinder.area() - 4.0 * std::f64::consts::PI).abs() < 1e-9);
}

#[test]
fn an_obj_without_normals_is_smooth_unless_face_normals_are_asked_for() {
    let folder = Folder::new();
    folder.write("a.obj", CORNER_OBJ);
    let load = |extra: &str| {
        let shape = format!("<shape type='obj'><string name='filename' value='a.obj'/>{extra}</shape>");
        folder.write("scene.xml", format!("<scene version='3.0.0'>{shape}</scene>"));
        folder.load("scene.xml", &LoadOptions::default()).unwrap().scene.shapes.remove(0)
    };
    let smooth = load("");
    let mesh = mesh_of(&smooth);
    // At vertex 1, 45 degrees of a face with normal +z meet 90 degrees of one with +y; vertices 3 and 4 have one face each.
    let unit = 5.0_f32.sqrt().recip();
    assert!(near(mesh.normals()[0], [0.0, 2.0 * unit, unit]), "{:?}", mesh.normals());
    let at = |p: Vec3| mesh.normals()[mesh.positions().iter().position(|q| *q == p).unwrap()];
    assert!(near(at(Vec3::new(1.0, 1.0, 0.0)), [0.0, 0.0, 1.0]) && near(at(Vec3::Z), [0.0, 1.0, 0.0]));
    assert_eq!(mesh.uvs()[0], Vec2::new(0.25, 0.75));
    let flat =
        load("<boolean name='face_normals' value='true'/><boolean name='flip_tex_coords' value='false'/>");
    assert!(mesh_of(&flat).normals().is_empty());
    assert_eq!(mesh_of(&flat).uvs()[0], Vec2::splat(0.25));
}

#[test]
fn ply_of_all_encodings_is_the_same_mesh() {
    let folder = Folder::new();
    folder.write("a.ply", TRIANGLE_PLY);
    let (header, _) = TRIANGLE_PLY.split_once("end_header\n").unwrap();
    let vertices = [
        [0.0, 0.0, 0.0, 0.0, 0.25],
        [1.0, 0.0, 0.0, 1.0, 0.0],
        [1.0, 1.0, 0.0, 1.0, 1.0],
        [0.0, 1.0, 0.0, 0.0, 1.0_f32],
    ];
    for (name, little) in [("binary_little_endian", true), ("binary_big_endian", false)] {
        let float = |x: f32| if little { x.to_le_bytes() } else { x.to_be_bytes() };
        let mut bytes = format!("{}end_header\n", header.replace("ascii", name)).into_bytes();
        for [x, y, z, s, t] in vertices {
            bytes.extend(float(x));
            bytes.extend(if little { f64::from(y).to_le_bytes() } else { f64::from(y).to_be_bytes() });
            bytes.extend(float(z));
            bytes.push(7);
            bytes.extend([float(s), float(t)].concat());
        }
        bytes.push(4);
        bytes.extend((0..4_i32).flat_map(|i| if little { i.to_le_bytes() } else { i.to_be_bytes() }));
        folder.write(&format!("{name}.ply"), &bytes);
        // Cut anywhere, it is an error that says where.
        for length in [bytes.len() - 1, bytes.len() - 17, bytes.len() - 30] {
            folder.write("cut.ply", &bytes[..length]);
            let message = folder.load("cut.ply", &LoadOptions::default()).unwrap_err();
            assert!(
                message.starts_with("cut.ply: at byte ") && message.contains("the end of the file"),
                "{message}"
            );
        }
    }
    for name in ["a.ply", "binary_little_endian.ply", "binary_big_endian.ply"] {
        let loaded = folder.load(name, &LoadOptions::default()).unwrap();
        let mesh = mesh_of(&loaded.scene.shapes[0]);
        let positions: Vec<_> = mesh.positions().iter().map(Vec3::to_array).collect();
        assert_eq!(positions, vertices.map(|[x, y, z, ..]| [x, y, z]));
        assert_eq!(mesh.triangles(), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(mesh.uvs()[0], Vec2::new(0.0, 0.25));
        assert!(mesh.normals().is_empty());
    }
}

#[test]
fn a_bare_mesh_gets_a_sky_and_a_camera_that_sees_all_of_it() {
    let folder = Folder::new();
    folder.write("a.obj", "v -1 -1 100\nv 3 -1 100\nv 3 2 101\nv -1 2 100\nf -4 -3 -2 -1\n");
    let loaded = folder.load("a.obj", &LoadOptions::default()).unwrap();
    let notes: Vec<_> = loaded.warnings.iter().map(|w| (w.severity, w.message.as_str())).collect();
    let message =
        "a mesh, not a scene: using a constant white sky of radiance 1 and a camera that frames the mesh";
    assert_eq!(notes, [(Severity::Note, message)]);
    let scene = loaded.scene;
    assert_eq!(scene.emitters, [Emitter::Constant { radiance: Vec3::ONE }]);
    let camera = scene.camera;
    let to_camera = camera.to_world.inverse();
    // The film is wider than high, so the shorter side's field of view bounds both.
    let tan = (camera.fov.to_radians() / 2.0).tan();
    for p in mesh_of(&scene.shapes[0]).positions() {
        let q = to_camera.transform_point3(p.as_dvec3());
        assert!(q.z > camera.near_clip && q.z < camera.far_clip);
        assert!(q.x.abs() < q.z * tan && q.y.abs() < q.z * tan, "{q}");
    }
    assert!(camera.to_world.translation.z > 101.0 && camera.to_world.translation.y > 2.0);
}

#[test]
fn polygons_of_any_size_become_triangles() {
    let folder = Folder::new();
    let n = 1000;
    let circle: Vec<String> = (0..n)
        .map(|i| {
            let (s, c) = (f64::from(i) / f64::from(n) * std::f64::consts::TAU).sin_cos();
            format!("v {c} {s} 0\n")
        })
        .collect();
    let corners: Vec<_> = (1..=n).map(|i| i.to_string()).collect();
    let circle = circle.concat();
    folder.write("a.obj", format!("{circle}f {}\nl 1 2 3\np 1\nf 1 2\n", corners.join(" \\\n ")));
    let scene = folder.load("a.obj", &LoadOptions::default()).unwrap().scene;
    let mesh = mesh_of(&scene.shapes[0]);
    assert_eq!(mesh.triangles().len(), 998);
    let area: f32 = mesh.triangles().iter().map(|t| triangle_area(mesh, *t)).sum();
    // Area of the regular polygon.
    let exact = 0.5 * f64::from(n) * (std::f64::consts::TAU / f64::from(n)).sin();
    assert!((f64::from(area) - exact).abs() < 1e-4, "{area}");
}

/// Instances stand where their transforms put the group, which is held once, with normals that keep their side even where a transform reflects.
#[test]
fn instances_are_places_of_their_group() {
    let scene = xml("<shape type='instance' id='i'><ref id='g'/></shape>
        <shape type='shapegroup' id='g'><shape type='rectangle' id='r'/>
          <shape type='obj' id='flat'><string name='filename' value='CORNER'/><boolean name='face_normals' value='true'/></shape>
          <shape type='sphere' id='ball'><bsdf type='conductor'/></shape></shape>
        <shape type='instance' id='m'><ref id='g'/><transform name='to_world'><scale x='-2' y='2' z='2'/><translate z='5'/></transform></shape>
        <shape type='shapegroup' id='none'/><shape type='instance'><ref id='none'/></shape>"
        .replace("CORNER", &corner_file().display().to_string())
        .as_str());
    let names: Vec<_> = scene.shapes.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["i", "m"]);
    let instance_of = |shape: &Shape| match &shape.geometry {
        Geometry::Instance(instance) => instance.clone(),
        Geometry::Mesh(_) | Geometry::Analytic(_) => panic!("{} is no instance", shape.name),
    };
    let [i, m] = [0, 1].map(|shape| instance_of(&scene.shapes[shape]));
    assert!(std::sync::Arc::ptr_eq(i.group(), m.group()));
    assert!((m.to_world().translation - DVec3::Z * 5.0).length() < 1e-9);
    let count = scene.shapes[0].geometry.primitive_count();
    let (ball, within) = scene.shapes[1].part(count - 1);
    assert_eq!((ball.name.as_str(), within), ("ball", 0));
    assert!(matches!(scene.materials[ball.material.0 as usize], Material::Conductor { .. }));
    for primitive in [0, 1, 2, count - 2] {
        let normal = |shape| {
            SurfacePoint::from_hit(&scene.shapes, shape, primitive, 0.2, 0.3, Vec3::ZERO, Vec3::Z, 1.0).ng
        };
        let expected = (normal(0) * Vec3::new(-1.0, 1.0, 1.0)).normalize();
        assert!(normal(1).abs_diff_eq(expected, 1e-5), "{} became {}", normal(0), normal(1));
    }
}

/// A file that outlives the test's own folder.
fn corner_file() -> PathBuf {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("corner.obj");
    std::fs::write(&path, CORNER_OBJ).unwrap();
    path
}

#[test]
fn ply_attributes_are_kept() {
    let folder = Folder::new();
    folder.write(
        "a.ply",
        "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         property float color_0\nproperty float color_1\nproperty float color_2\nproperty uchar heat_x\n\
         element face 1\nproperty list uchar int vertex_indices\nproperty float weight_0\nend_header\n\
         0 0 0 1 2 3 255\n1 0 0 4 5 6 0\n1 1 0 7 8 9 51\n0 1 0 10 11 12 0\n4 0 1 2 3 0.25\n",
    );
    let scene = folder.load("a.ply", &LoadOptions::default()).unwrap().scene;
    let attributes = mesh_of(&scene.shapes[0]).attributes();
    let summary: Vec<_> = attributes.iter().map(|a| (a.name.as_str(), a.per_face, a.channels)).collect();
    assert_eq!(summary, [("vertex_color", false, 3), ("vertex_heat", false, 1), ("face_weight", true, 1)]);
    assert_eq!(attributes[0].values, (1..=12).map(|i| i as f32).collect::<Vec<_>>());
    let heat: Vec<_> = attributes[1].values.iter().map(|x| (x * 255.0).round()).collect();
    assert_eq!(heat, [255.0, 0.0, 51.0, 0.0]);
    // A value for each of the quad's triangles.
    assert_eq!(attributes[2].values, [0.25, 0.25]);
}

/// Where a mesh attribute is asked for that is not there, or that the BSDF cannot carry, the file is told.
#[test]
fn attributes_that_cannot_be_had_are_errors() {
    let folder = Folder::new();
    folder.write("corner.obj", CORNER_OBJ);
    let error = |body: &str| {
        folder.write("a.xml", format!("<scene version='3.0.0'>{body}</scene>"));
        folder.load("a.xml", &LoadOptions::default()).map(|_| ()).expect_err(body)
    };
    let texture = |name: &str, attribute: &str| {
        format!(
            "<texture type='mesh_attribute' name='{name}'><string name='name' value='{attribute}'/></texture>"
        )
    };
    let mesh = "<shape type='obj'><string name='filename' value='corner.obj'/>";
    let color = texture("reflectance", "vertex_color");
    let found =
        error(&format!("{mesh}<bsdf type='twosided'><bsdf type='diffuse'>{color}</bsdf></bsdf></shape>"));
    assert!(
        found.starts_with("a.xml:1:") && found.contains("attribute `vertex_color`, which shape"),
        "{found}"
    );
    let shared =
        format!("<bsdf type='diffuse' id='b'>{color}</bsdf><shape type='sphere'><ref id='b'/></shape>");
    assert!(error(&shared).contains("attribute `vertex_color`"));
    let lamp = texture("radiance", "face_heat");
    let found = error(&format!("{mesh}<emitter type='area'>{lamp}</emitter></shape>"));
    assert!(found.contains("attribute `face_heat`"), "{found}");
    let found = error(&format!("<bsdf type='mask'><bsdf type='diffuse'>{color}</bsdf></bsdf>"));
    assert!(found.contains("attribute `vertex_color` of meshes in a principled BSDF"), "{found}");
    assert!(
        error(&format!("<bsdf type='diffuse'>{}</bsdf>", texture("reflectance", "color")))
            .contains("`vertex_`")
    );
}

/// A face without normals beside one that has them: what is given stays, what lacks becomes smooth, or flat in a bare mesh.
#[test]
fn normals_that_some_faces_lack() {
    let folder = Folder::new();
    folder.write(
        "a.obj",
        "usemtl red\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nvn 0.6 0 0.8\nf 1//1 2//1 3//-1\nf 1 3 4\nf 1 4 5\n",
    );
    folder.write(
        "a.xml",
        "<scene version='3.0.0'><shape type='obj'><string name='filename' value='a.obj'/></shape></scene>",
    );
    let normal = |mesh: &TriangleMesh, triangle| SurfacePoint::on_triangle(mesh, 0, triangle, 0.25, 0.25).ns;
    let loaded = folder.load("a.xml", &LoadOptions::default()).unwrap();
    assert!(loaded.warnings.iter().any(|w| w.message.contains("some faces lack normals")));
    let mesh = mesh_of(&loaded.scene.shapes[0]);
    assert!(normal(mesh, 0).abs_diff_eq(Vec3::new(0.6, 0.0, 0.8), 1e-6));
    // The edge that the two others share: between +z and +x.
    let shared = SurfacePoint::on_triangle(mesh, 0, 2, 0.0, 0.0).ns;
    assert!(shared.abs_diff_eq(SurfacePoint::on_triangle(mesh, 0, 1, 0.0, 0.0).ns, 1e-6), "{shared}");
    assert!(shared.x > 0.3 && shared.z > 0.3, "{shared}");
    let bare = folder.load("a.obj", &LoadOptions::default()).unwrap().scene;
    let mesh = mesh_of(&bare.shapes[0]);
    assert!(normal(mesh, 0).abs_diff_eq(Vec3::new(0.6, 0.0, 0.8), 1e-6));
    assert_eq!((normal(mesh, 1), normal(mesh, 2)), (Vec3::Z, Vec3::X));
}

/// A cube of eight vertices: its edges are creases of 90 degrees.
#[test]
fn creases_split_vertices() {
    let folder = Folder::new();
    let mut cube = String::new();
    for i in 0..8 {
        writeln!(cube, "v {} {} {}", i & 1, i >> 1 & 1, i >> 2).unwrap();
    }
    cube += "f 1 3 4 2\nf 5 6 8 7\nf 1 2 6 5\nf 3 7 8 4\nf 1 5 7 3\nf 2 4 8 6\n";
    folder.write("cube.obj", cube);
    let mesh = |angle: f64| {
        folder.write(
            "a.xml",
            format!(
                "<scene version='0.6.0'><shape type='obj'><string name='filename' value='cube.obj'/>
                 <float name='maxSmoothAngle' value='{angle}'/></shape></scene>"
            ),
        );
        mesh_of(&folder.load("a.xml", &LoadOptions::default()).unwrap().scene.shapes[0]).clone()
    };
    for (angle, vertices) in [(40.0, 24), (89.0, 24), (91.0, 8), (180.0, 8)] {
        let mesh = mesh(angle);
        assert_eq!(mesh.positions().len(), vertices, "{angle}");
        for triangle in 0..12 {
            let point = SurfacePoint::on_triangle(&mesh, 0, triangle, 0.0, 0.0);
            let outwards = point.p - Vec3::splat(0.5);
            let expected = if vertices == 24 { point.ng } else { outwards.normalize() };
            assert!(point.ns.abs_diff_eq(expected, 1e-5), "{angle}: {} {expected}", point.ns);
            assert!(point.ng.dot(outwards) > 0.0);
        }
    }
}
