//! Loaders: what valid files become, and what invalid ones are told.

use std::path::{Path, PathBuf};

use glam::{DVec3, Vec2, Vec3};
use helmholtz::scene::load::{LoadOptions, Loaded, Severity, load, mitsuba};
use helmholtz::scene::{
    AnalyticKind, Emitter, Filter, FovAxis, Geometry, Input, Lens, Material, Microfacet, Scene, Shape,
    SurfacePoint, Texture, TriangleMesh,
};

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
fn the_camera_looks_along_plus_z_with_plus_x_to_the_left() {
    let camera = xml("<sensor type='perspective'><float name='fov' value='40'/><transform name='to_world'>\
                      <lookat origin='0 0 5' target='0 0 0' up='0 1 0'/></transform></sensor>")
    .camera;
    let at = |v: DVec3| camera.to_world.transform_vector3(v).as_vec3();
    assert!(near(at(DVec3::Z), [0.0, 0.0, -1.0]));
    assert!(near(at(DVec3::Y), [0.0, 1.0, 0.0]));
    // Looking along -z, the world's -x is on the left.
    assert!(near(at(DVec3::X), [-1.0, 0.0, 0.0]));
    assert_eq!(camera.to_world.translation, DVec3::new(0.0, 0.0, 5.0));
}

#[test]
fn an_empty_scene_has_mitsubas_defaults() {
    let scene = xml("<sensor type='perspective'/>");
    assert_eq!(scene.film.size.to_array(), [768, 576]);
    assert_eq!(scene.film.crop.size.to_array(), [768, 576]);
    assert_eq!(scene.film.filter, Filter::Gaussian { stddev: 0.5 });
    assert!(scene.film.half_float);
    assert_eq!(scene.sample_count, 4);
    assert_eq!(scene.integrator.name, None);
    let camera = scene.camera;
    assert_eq!((camera.near_clip, camera.far_clip, camera.lens), (0.01, 1e4, Lens::Pinhole));
    // 50 mm across the diagonal of a 36 x 24 mm film: across the width of 4:3, Mitsuba's 38.1848 degrees.
    assert_eq!(camera.fov_axis, FovAxis::Diagonal);
    let across_width = 2.0 * ((camera.fov.to_radians() / 2.0).tan() * 0.8).atan();
    assert!((across_width.to_degrees() - 38.1848).abs() < 1e-3, "{}", across_width.to_degrees());
    assert_eq!(material(""), Material::Diffuse { reflectance: Vec3::splat(0.5).into() });
}

#[test]
fn sensors_films_and_samplers_are_read() {
    let scene = xml("<sensor type='thinlens'><string name='fov_axis' value='larger'/><float name='fov' value='30'/>
        <float name='aperture_radius' value='0.5'/><float name='focus_distance' value='7'/>
        <film type='hdrfilm'><integer name='width' value='640'/><integer name='height' value='480'/>
            <integer name='crop_offset_x' value='10'/><integer name='crop_offset_y' value='20'/>
            <integer name='crop_width' value='100'/><integer name='crop_height' value='50'/>
            <string name='component_format' value='float32'/>
            <rfilter type='mitchell'><float name='B' value='0.25'/></rfilter></film>
        <sampler type='multijitter'><integer name='sample_count' value='64'/></sampler></sensor>
        <integrator type='path'><integer name='max_depth' value='8'/><boolean name='hide_emitters' value='true'/>
        </integrator>");
    let camera = scene.camera;
    assert_eq!(camera.lens, Lens::Thin { aperture_radius: 0.5, focus_distance: 7.0 });
    assert_eq!((camera.fov, camera.fov_axis), (30.0, FovAxis::Larger));
    let film = scene.film;
    assert_eq!((film.crop.min.to_array(), film.crop.size.to_array()), ([10, 20], [100, 50]));
    assert_eq!(film.filter, Filter::Mitchell { b: 0.25, c: 1.0 / 3.0 });
    assert!(!film.half_float);
    assert_eq!(scene.sample_count, 64);
    assert_eq!(scene.integrator.name.as_deref(), Some("path"));
    let parameters: Vec<_> =
        scene.integrator.parameters.iter().map(|(n, v)| (n.as_str(), v.as_str())).collect();
    assert_eq!(parameters, [("max_depth", "8"), ("hide_emitters", "true")]);
}

#[test]
fn bsdfs_have_mitsubas_parameters_and_defaults() {
    let (zero, one) = (Input::Constant(Vec3::ZERO), Input::Constant(Vec3::ONE));
    let specular_reflectance = one;
    assert_eq!(
        material("<bsdf type='conductor'/>"),
        Material::Conductor { eta: zero, k: one, specular_reflectance }
    );
    assert_eq!(
        material(
            "<bsdf type='roughconductor'><rgb name='eta' value='2.5 2 1.5'/><rgb name='k' value='3, 2, 1'/>
             <float name='alpha_u' value='0.2'/><float name='alpha_v' value='0.3'/>
             <string name='distribution' value='ggx'/></bsdf>"
        ),
        Material::RoughConductor {
            distribution: Microfacet::Ggx,
            alpha: [0.2.into(), 0.3.into()],
            eta: Vec3::new(2.5, 2.0, 1.5).into(),
            k: Vec3::new(3.0, 2.0, 1.0).into(),
            specular_reflectance
        }
    );
    assert_eq!(
        material("<bsdf type='roughdielectric'/>"),
        Material::RoughDielectric {
            distribution: Microfacet::Beckmann,
            alpha: [0.1.into(); 2],
            eta: (1.5046 / 1.000_277_f64) as f32,
            specular_reflectance,
            specular_transmittance: one
        }
    );
    let Material::Dielectric { eta, .. } = material(
        "<bsdf type='dielectric'><string name='int_ior' value='water'/><integer name='ext_ior' value='1'/></bsdf>",
    ) else {
        panic!()
    };
    assert_eq!(eta, 1.333);
    let scene = xml("<bsdf type='diffuse' id='red'><rgb name='reflectance' value='#ff8000'/></bsdf>
        <shape type='sphere'><bsdf type='twosided'><ref id='red'/><bsdf type='conductor'/></bsdf></shape>");
    let Material::TwoSided { front, back } = scene.materials[scene.shapes[0].material.0 as usize] else {
        panic!()
    };
    let Material::Diffuse { reflectance: Input::Constant(reflectance) } = scene.materials[front.0 as usize]
    else {
        panic!()
    };
    // 128/255 through the inverse of the sRGB curve.
    assert!(near(reflectance, [1.0, 0.215_860_5, 0.0]), "{reflectance}");
    assert!(matches!(scene.materials[back.0 as usize], Material::Conductor { .. }));
}

#[test]
fn a_flat_spectrum_is_equal_energy_white_in_emitters_only() {
    let radiance = |value: &str| {
        let scene = xml(&format!("<emitter type='constant'>{value}</emitter>"));
        let Emitter::Constant { radiance } = scene.emitters[0] else { panic!() };
        radiance
    };
    assert_eq!(radiance("<rgb name='radiance' value='5'/>"), Vec3::splat(5.0));
    assert_eq!(radiance("<float name='radiance' value='5'/>"), Vec3::splat(5.0));
    // What Mitsuba 3.9 (scalar_rgb) holds after loading.
    let flat = radiance("<spectrum name='radiance' value='5'/>");
    assert!(near(flat, [6.023_97, 4.741_455, 4.544_58]), "{flat}");
    let grey = material("<bsdf type='diffuse'><spectrum name='reflectance' value='0.25'/></bsdf>");
    assert_eq!(grey, Material::Diffuse { reflectance: Vec3::splat(0.25).into() });
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

const CORNER_OBJ: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 0 1\nvt .25 .25\nf 1/1 2/1 3/1\nf 1/1 4/1 2/1\n";

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
fn parameters_aliases_includes_and_paths_resolve() {
    let folder = Folder::new();
    std::fs::create_dir(folder.0.path().join("sub")).unwrap();
    folder.write("sub/a.obj", CORNER_OBJ);
    folder.write(
        "sub/inner.xml",
        "<scene version='3.0.0'><bsdf type='diffuse' id='grey'/>
        <shape type='obj'><string name='filename' value='a.obj'/><ref id='black'/></shape></scene>",
    );
    folder.write(
        "scene.xml",
        "<scene version='3.0.0'><path value='sub'/><default name='r' value='3'/><default name='rr' value='$r'/>
         <include filename='sub/inner.xml'/><include filename='sub/${r}'/></scene>",
    );
    assert!(folder.load("scene.xml", &LoadOptions::default()).unwrap_err().contains("undefined parameter $"));
    folder.write(
        "scene.xml",
        "<scene version='3.0.0'><path value='sub'/><default name='r' value='3'/><default name='rr' value='4$r'/>
         <include filename='sub/inner.xml'/><alias id='grey' as='white'/>
         <bsdf type='diffuse' id='black'><rgb name='reflectance' value='0'/></bsdf>
         <shape type='sphere'><float name='radius' value='$rr'/><ref id='white'/></shape>
         <shape type='ply'><string name='filename' value='b.ply'/></shape></scene>",
    );
    folder.write("sub/b.ply", TRIANGLE_PLY);
    for (options, radius) in
        [(LoadOptions::default(), 43.0), (define("r", "5"), 45.0), (define("rr", "2"), 2.0)]
    {
        let loaded = folder.load("scene.xml", &options).unwrap();
        let scene = loaded.scene;
        assert_eq!(
            scene.materials[scene.shapes[0].material.0 as usize],
            Material::Diffuse { reflectance: Vec3::ZERO.into() }
        );
        let Geometry::Analytic(sphere) = &scene.shapes[1].geometry else { panic!() };
        assert_eq!(sphere.to_world().x_axis.x, radius);
        let files: Vec<_> = loaded.files.iter().map(|f| folder.shorten(&f.display().to_string())).collect();
        assert_eq!(files, ["scene.xml", "sub/inner.xml", "sub/a.obj", "sub/b.ply"]);
    }
    assert!(folder.load("scene.xml", &define("q", "1")).unwrap_err().contains("the scene does not use $q"));
}

const TRIANGLE_PLY: &str = "ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty double y\n\
    property float z\nproperty uchar red\nproperty float s\nproperty float t\nelement face 1\n\
    property list uchar int vertex_index\nend_header\n0 0 0 7 0 0.25\n1 0 0 7 1 0\n1 1 0 7 1 1\n0 1 0 7 0 1\n4 0 1 2 3\n";

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
fn mtl_materials_are_translated() {
    let folder = Folder::new();
    folder.write(
        "m.mtl",
        "newmtl red\nKd 1 0 0\nKs 0.5 0.5 0.5\nnewmtl lamp\nKe 5 5 4\nKd 0\nnewmtl glass\nd 0.1\nNi 1.5\nKd 1 1 1\n\
         newmtl brass\nKd 0 0 0\nKs 0.9 0.7 0.3\nNs 198\nnewmtl mirror\nKd 0 0 0\nKs 1 1 1\nillum 3\nKa 0.1 0.1\n\
         newmtl pale\nKd spectral file.rfl\nmap_Kd wood.png\n",
    );
    let names = ["red", "lamp", "glass", "brass", "mirror", "pale", "absent"];
    let faces = names.map(|n| format!("usemtl {n}\nf 1 2 3\n")).concat();
    folder.write("a.obj", format!("mtllib m.mtl\nmtllib none.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n{faces}"));
    let Loaded { scene, warnings, .. } = folder.load("a.obj", &LoadOptions::default()).unwrap();
    let shapes: Vec<_> = scene.shapes.iter().collect();
    assert_eq!(shapes.len(), names.len());
    let of = |i: usize| match &scene.materials[shapes[i].material.0 as usize] {
        Material::TwoSided { front, back } => {
            assert_eq!(front, back);
            scene.materials[front.0 as usize].clone()
        }
        other => other.clone(),
    };
    assert_eq!(of(0), Material::Diffuse { reflectance: Vec3::X.into() });
    assert_eq!(of(1), Material::Diffuse { reflectance: Vec3::ZERO.into() });
    assert_eq!(
        shapes.iter().filter_map(|s| s.emission).collect::<Vec<_>>(),
        [Input::Constant(Vec3::new(5.0, 5.0, 4.0))]
    );
    assert!(matches!(of(2), Material::Dielectric { eta: 1.5, .. }));
    // sqrt(2 / 200).
    assert!(matches!(of(3), Material::RoughConductor { alpha: [Input::Constant(0.1), _], .. }));
    assert!(matches!(of(4), Material::Conductor { .. }));
    let grey = Material::Diffuse { reflectance: Vec3::splat(0.5).into() };
    assert_eq!((of(5), of(6)), (grey.clone(), grey));
    // The lamp lights the scene.
    assert!(scene.emitters.is_empty());
    let warnings: Vec<_> = warnings.iter().map(|w| folder.shorten(&w.to_string())).collect();
    insta::assert_snapshot!(warnings.join("\n"), @r"
    m.mtl:19: malformed `Ka` is ignored
    m.mtl:21: malformed `Kd` is ignored
    a.obj: material library none.mtl: cannot be opened (No such file or directory (os error 2)); its materials become grey
    a.obj: material `pale`: wood.png: cannot be opened (No such file or directory (os error 2)); expected a readable file; it is left out
    a.obj: a mesh, not a scene: using a camera that frames the mesh
    ");
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

#[test]
fn every_plugin_builds_with_its_defaults() {
    let folder = Folder::new();
    folder.write("a.obj", CORNER_OBJ);
    folder.write("a.ply", TRIANGLE_PLY);
    folder.write("a.serialized", crate::serialized::file(4, &[crate::serialized::triangle(4)]));
    let grey = image::RgbImage::from_pixel(4, 4, image::Rgb([90, 90, 90]));
    for name in ["a.bitmap", "a.envmap"] {
        let mut png = std::io::Cursor::new(Vec::new());
        grey.write_to(&mut png, image::ImageFormat::Png).unwrap();
        folder.write(name, png.into_inner());
    }
    // `spectra_may_be_objects` has the spectra, which are parameters of others.
    let is_object = |category: &mitsuba::Category| *category != mitsuba::Category::Spectrum;
    for (category, plugin) in mitsuba::supported().into_iter().filter(|(c, _)| is_object(c)) {
        let name = plugin.name;
        let required: String = plugin
            .parameters()
            .filter(|p| p.default == mitsuba::Default::Required && p.name != "normalmap")
            .map(|p| match p.name {
                "filename" if name == "bitmap" => {
                    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/textures");
                    format!("<string name='filename' value='{folder}/patches.png'/>")
                }
                "filename" => format!("<string name='filename' value='a.{name}'/>"),
                "name" => "<string name='name' value='vertex_color'/>".to_owned(),
                "weights" => "<string name='weights' value='1'/>".to_owned(),
                other => format!("<float name='{other}' value='1'/>"),
            })
            .collect();
        let bsdf = "<bsdf type='diffuse'/>";
        let texture = "<texture type='checkerboard'/>";
        let inside = match name {
            "twosided" | "mask" | "mixturebsdf" => bsdf.to_owned(),
            "normalmap" => format!("{bsdf}{}", texture.replace(" type", " name='normalmap' type")),
            "blendbsdf" => bsdf.repeat(2),
            "instance" => "<shape type='shapegroup'><shape type='cube'/></shape>".to_owned(),
            "bumpmap" => format!("{bsdf}{texture}"),
            "scale" => texture.to_owned(),
            _ => String::new(),
        };
        let object = format!("<{category} type='{name}'>{required}{inside}</{category}>");
        let body = match category {
            mitsuba::Category::Rfilter => {
                format!("<sensor type='perspective'><film type='hdrfilm'>{object}</film></sensor>")
            }
            mitsuba::Category::Film | mitsuba::Category::Sampler => {
                format!("<sensor type='perspective'>{object}</sensor>")
            }
            mitsuba::Category::Emitter if name == "area" => format!("<shape type='cube'>{object}</shape>"),
            mitsuba::Category::Texture => format!(
                "<bsdf type='diffuse'>{}</bsdf>",
                object.replacen("<texture", "<texture name='reflectance'", 1)
            ),
            _ => object,
        };
        folder.write("scene.xml", format!("<scene version='3.0.0'>{body}</scene>"));
        folder
            .load("scene.xml", &LoadOptions::default())
            .unwrap_or_else(|e| panic!("{category} {name}: {e}"));
        // Defaults are valid values of their type.
        for p in plugin.parameters() {
            if let (mitsuba::Default::Value(value), mitsuba::Kind::Float) = (p.default, p.kind) {
                assert!(value.parse::<f64>().is_ok(), "{name} {}", p.name);
            }
            assert!(!p.help.is_empty());
        }
    }
}

#[test]
fn errors_say_where_what_and_what_instead() {
    let bodies = [
        "<shape type='torus'/>",
        "\n  <shape type='sphere'>\n    <float name='radios' value='2'/></shape>",
        "<shape type='sphere'><string name='radius' value='2'/></shape>",
        "<shape type='sphere'><float name='radius' value='2x'/></shape>",
        "<shape type='sphere'><float name='radius' value='-1'/></shape>",
        "<shape type='sphere'><float name='radius' value='$r'/></shape>",
        "<shape type='sphere'><transform name='to_world'><scale x='2'/></transform></shape>",
        "<shape type='sphere'><ref id='nobody'/></shape>",
        "<shape type='sphere' id='a'/>\n<shape type='sphere' id='a'/>",
        "<shape type='sphere' colour='red'/>",
        "<shape type='sphere'><bsdf type='diffuse'/><bsdf type='diffuse'/></shape>",
        "<shape type='sphere'><float name='radius' value='1'/><float name='radius' value='1'/></shape>",
        "<shape type='obj'><string name='filename' value='none.obj'/></shape>",
        "<shape type='obj'/>",
        "<bsdf type='diffuse'><rgb name='reflectance' value='1.5 0 0'/></bsdf>",
        "<bsdf type='diffuse'><texture name='reflectance' type='bitmap'/></bsdf>",
        "<bsdf type='diffuse'><spectrum name='reflectance' value='700:0.1, 400:0.3'/></bsdf>",
        "<bsdf type='plastic'><float name='int_ior' value='1'/><float name='ext_ior' value='1'/></bsdf>",
        "<bsdf type='conductor'><string name='material' value='Xx'/></bsdf>",
        "<bsdf type='roughconductor'><float name='alpha_u' value='0.1'/></bsdf>",
        "<bsdf type='roughconductor'><float name='alpha' value='0.1'/><float name='alpha_u' value='0.1'/></bsdf>",
        "<bsdf type='twosided'><bsdf type='dielectric'/></bsdf>",
        "<bsdf type='twosided' id='a'><ref id='a'/></bsdf>",
        "<emitter type='area'/>",
        "<emitter type='point'><point name='position' value='0'/><transform name='to_world'/></emitter>",
        "<sensor type='perspective'><float name='fov' value='180'/></sensor>",
        "<sensor type='thinlens'><float name='principal_point_offset_x' value='1'/></sensor>",
        "<sensor type='orthographic'><transform name='to_world'><scale x='0'/></transform></sensor>",
        "<emitter type='sunsky'/>",
        "<emitter type='spot'><float name='beam_width' value='21'/></emitter>",
        "<emitter type='directional'><vector name='direction' value='0'/></emitter>",
        "<emitter type='constant'/><emitter type='constant'/>",
        "<shape type='instance'/>",
        "<shape type='shapegroup'><shape type='sphere'><emitter type='area'/></shape></shape>",
        "<shape type='shapegroup' id='g'><shape type='sphere'/></shape><shape type='instance'><ref id='g'/>\
         <transform name='to_world'><scale x='0'/></transform></shape>",
        "<integrator type='moment'/>",
        "<sensor type='perspective'><film type='hdrfilm'><integer name='width' value='1000000'/></film></sensor>",
        "<texture type='wood'/>",
        "<wobble/>",
        "<integrator type='path'/><integrator type='path'/>",
    ];
    let messages: Vec<_> = bodies.iter().map(|b| xml_error(b)).collect();
    insta::assert_snapshot!(messages.join("\n"), @r"
    scene.xml:1:24: shape `torus` is not supported; expected one of obj, ply, serialized, rectangle, cube, sphere, disk, cylinder, shapegroup, instance
    scene.xml:3:5: parameter `radios` of shape `sphere` is not supported; expected one of center, radius, to_world, flip_normals, <bsdf>, <emitter>
    scene.xml:1:45: parameter `radius` of shape `sphere` as <string>; expected float
    scene.xml:1:66: `2x`; expected a finite number
    scene.xml:1:45: `radius` is -1; expected a number above 0
    scene.xml:1:66: undefined parameter $r; expected a parameter given by <default> above or by -D r=value
    scene.xml:1:45: `to_world` distorts the sphere; expected rotation, translation and even scale
    scene.xml:1:45: a reference to `nobody`; expected the id of an object in the scene
    scene.xml:2:22: the id `a` again; expected each id once; it is also at scene.xml:1:45
    scene.xml:1:45: attribute `colour` in <shape>; expected one of type, id, name
    scene.xml:1:67: a second bsdf in shape `sphere`; expected at most one bsdf
    scene.xml:1:77: the parameter `radius` again; expected each parameter once; it is also at scene.xml:1:45
    scene.xml:1:42: file none.obj: cannot be opened (No such file or directory (os error 2)); expected a readable file
    scene.xml:1:24: shape `obj` without `filename`; expected a parameter `filename`
    scene.xml:1:45: `reflectance` is 1.5 0 0; expected values between 0 and 1
    scene.xml:1:45: texture `bitmap` without `filename`; expected a parameter `filename`
    scene.xml:1:74: `700:0.1, 400:0.3`; expected a finite number, or pairs `wavelength:value`
    scene.xml:1:45: equal indices of refraction inside and outside; expected two that differ
    scene.xml:1:47: `material` is Xx; expected one of none, Ag, Al, AlAs, AlAs_palik, Au, Be, Be_palik, Cr, CsI, CsI_palik, Cu, Cu2O, Cu2O_palik, CuO, CuO_palik, Cu_palik, Hg, HgTe, HgTe_palik, Hg_palik, Ir, Ir_palik, K, K_palik, Li, Li_palik, MgO, MgO_palik, Mo, Mo_palik, Na_palik, Nb, Nb_palik, Ni_palik, Rh, Rh_palik, Se-e, Se-e_palik, Se, Se_palik, SiC, SiC_palik, SnTe, SnTe_palik, Ta, Ta_palik, Te-e, Te-e_palik, Te, Te_palik, ThF4, ThF4_palik, TiC, TiC_palik, TiN, TiN_palik, TiO2-e, TiO2-e_palik, TiO2, TiO2_palik, VC, VC_palik, VN, VN_palik, V_palik, W, a-C, d-C, d-C_palik; or the metal by eta and k
    scene.xml:1:24: one of alpha_u and alpha_v without `alpha_v`; expected both or neither
    scene.xml:1:52: both `alpha` and alpha_u or alpha_v; expected one of them
    scene.xml:1:46: a BSDF with transmission in `twosided`; expected one that only reflects
    scene.xml:1:53: a BSDF that contains itself; expected no circular references
    scene.xml:1:24: an `area` emitter outside of shapes; expected it within a shape
    scene.xml:1:80: both `position` and `to_world`; expected one of them
    scene.xml:1:51: `fov` is 180; expected an angle between 0 and 180
    scene.xml:1:48: parameter `principal_point_offset_x` of sensor `thinlens` is not supported; expected one of fov, focal_length, fov_axis, to_world, near_clip, far_clip, focus_distance, shutter_open, shutter_close, <film>, <sampler>, aperture_radius
    scene.xml:1:52: `to_world` of the camera is singular; expected an invertible transform
    scene.xml:1:24: emitter `sunsky` is not supported; expected an `envmap` of the sky as an image, which Mitsuba itself can write, or `directional` for the sun alone
    scene.xml:1:45: `beam_width` is 21; expected an angle from 0 to cutoff_angle
    scene.xml:1:52: a directional light without direction; expected a vector other than zero
    scene.xml:1:50: a second environment; expected at most one `constant` or `envmap`
    scene.xml:1:24: an instance without a shape group; expected a <ref> to a `shapegroup`
    scene.xml:1:49: a shape that emits in a shape group; expected lights outside of shape groups
    scene.xml:1:86: a map that is singular, not finite, or scales by more than 1e12 or less than its inverse; expected less, or a transform that can be inverted
    scene.xml:1:24: integrator `moment` around 0 objects; expected one integrator in it
    scene.xml:1:72: a film of 1000000 x 576 pixels; expected at most 268435456 pixels
    scene.xml:1:24: texture `wood` is not supported; expected one of bitmap, checkerboard, scale, mesh_attribute
    scene.xml:1:24: <wobble>; expected an object (shape, bsdf, emitter, sensor, integrator, ...)
    scene.xml:1:49: a second integrator; expected at most one
    ");
}

#[test]
fn lenience_replaces_what_is_not_supported_and_says_so() {
    let body = "<shape type='torus'/><shape type='sphere'><float name='radios' value='2'/>
        <bsdf type='hair'><ref id='nowhere' name='x'/></bsdf><emitter type='mesh'/></shape>
        <bsdf type='diffuse'><texture name='reflectance' type='wood'/></bsdf><medium type='homogeneous'/>
        <sensor type='fisheye'/><dpt/><integrator type='moment'><integrator type='path'/></integrator>"
        .replace("<ref id='nowhere' name='x'/>", "");
    let Loaded { scene, warnings, .. } = xml_with(&body, &lenient()).unwrap();
    assert_eq!(scene.shapes.len(), 1);
    let replaced = warnings.iter().filter(|w| w.severity == Severity::Replaced).count();
    let messages: Vec<_> = warnings.iter().map(|w| w.message.as_str()).collect();
    insta::assert_snapshot!(messages.join("\n"), @r"
    <dpt>; it is ignored
    shape `torus` is not supported; the shape is left out
    parameter `radios` of shape `sphere` is not supported; it is ignored
    emitter `mesh` is not supported; the light is left out
    bsdf `hair` is not supported; diffuse with reflectance 0.5 is used
    texture `wood` is not supported; grey of 0.5 is used
    medium `homogeneous` is not supported; it is ignored
    sensor `fisheye` is not supported; a camera that frames the scene is used
    the scene has no sensor: using a camera that frames its shapes
    ");
    assert_eq!(replaced, 8);
    // What is wrong rather than unsupported stays an error.
    assert!(xml_with("<shape type='sphere'><float name='radius' value='x'/></shape>", &lenient()).is_err());
}

#[test]
fn only_known_versions_load() {
    let folder = Folder::new();
    let mut messages = Vec::new();
    for root in [
        "<scene version='0.3.0'/>",
        "<scene version='1.0.0'/>",
        "<scene version='x'/>",
        "<scene/>",
        "<bsdf version='3.0.0' type='diffuse'/>",
    ] {
        folder.write("scene.xml", root);
        messages.push(folder.load("scene.xml", &LoadOptions::default()).unwrap_err());
    }
    insta::assert_snapshot!(messages.join("\n"), @r#"
    scene.xml:1:8: scene version `0.3.0`; expected 2.0.0 or newer, as Mitsuba 2 and 3 write, or 0.4.0 to 0.6.0
    scene.xml:1:8: scene version `1.0.0`; expected 2.0.0 or newer, as Mitsuba 2 and 3 write, or 0.4.0 to 0.6.0
    scene.xml:1:8: scene version `x`; expected 2.0.0 or newer, as Mitsuba 2 and 3 write, or 0.4.0 to 0.6.0
    scene.xml:1:1: <scene> without `version`; expected an attribute `version`
    scene.xml:1:1: <bsdf>; expected a Mitsuba scene: <scene version="3.0.0">
    "#);
    for version in ["2.1.0", "0.6.0", "0.4.0"] {
        folder.write("scene.xml", format!("<scene version='{version}'/>"));
        assert!(folder.load("scene.xml", &LoadOptions::default()).is_ok());
    }
    folder.write("scene.blend", "");
    insta::assert_snapshot!(folder.load("scene.blend", &LoadOptions::default()).unwrap_err(), @"scene.blend: a file of type .blend; expected a Mitsuba scene (.xml) or a mesh (.obj, .ply)");
}

/// Third-party scenes, or `None` with a word about it where they are absent.
fn testdata(path: &str) -> Option<PathBuf> {
    let path = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/testdata")).join(path);
    if !path.exists() {
        eprintln!("skipped: {} is absent", path.display());
        return None;
    }
    Some(path)
}

#[test]
fn published_scenes_load() {
    let scenes = [("scenes/cbox/cbox_v3.xml", false, 8, 38), ("scenes/sms-ring/ring_v3.xml", false, 3, 4)];
    for (name, needs_lenience, shapes, triangles) in scenes {
        let Some(path) = testdata(name) else { continue };
        assert_eq!(load(&path, &LoadOptions::default()).is_err(), needs_lenience, "{name}");
        let scene = load(&path, &lenient()).unwrap_or_else(|e| panic!("{e}")).scene;
        assert_eq!(scene.shapes.len(), shapes, "{name}");
        let found: usize = scene.shapes.iter().map(triangle_count).sum();
        assert_eq!(found, triangles, "{name}");
    }
}

#[test]
fn textures_take_the_place_of_values() {
    let folder = Folder::new();
    let image = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/textures/patches.png");
    let texture = format!(
        "<texture type='bitmap' id='t' name='reflectance'><string name='filename' value='{image}'/></texture>"
    );
    let scene = |body: &str| format!("<scene version='3.0.0'>{body}</scene>");
    let load = |body: &str| {
        folder.write("a.xml", scene(body));
        folder.load("a.xml", &LoadOptions::default())
    };
    let loaded = load(&format!(
        "<bsdf type='diffuse'>{texture}</bsdf><bsdf type='diffuse'><ref id='t' name='reflectance'/></bsdf>
         <bsdf type='plastic'><texture type='bitmap' name='diffuse_reflectance'><string name='filename' value='{image}'/>
         <boolean name='raw' value='true'/></texture></bsdf>"
    ));
    let scene = loaded.unwrap().scene;
    assert_eq!(scene.textures.len(), 2, "one per texture");
    let images: Vec<_> = scene
        .textures
        .iter()
        .map(|t| if let Texture::Bitmap(b) = t { std::sync::Arc::as_ptr(&b.image) } else { panic!() })
        .collect();
    assert_eq!(images[0], images[1], "one image per file");
    let error = load(&format!("<bsdf type='diffuse'>{texture}<float name='reflectance' value='1'/></bsdf>"))
        .unwrap_err();
    assert!(error.contains("given twice"), "{error}");
    let error = load(
        "<bsdf type='diffuse'><texture type='bitmap' name='reflectance'><string name='filename' value='no.png'/></texture></bsdf>",
    );
    assert!(error.unwrap_err().contains("a.xml:1:"));
    let error = load("<bsdf type='diffuse'><texture type='perlin' name='reflectance'/></bsdf>").unwrap_err();
    assert!(error.contains("bitmap, checkerboard, scale"), "{error}");
    let error =
        load("<bsdf type='dielectric'><texture type='checkerboard' name='int_ior'/></bsdf>").unwrap_err();
    assert!(error.contains("not supported"), "{error}");
}

/// What Mitsuba 3 does not have any more, by translation.
#[test]
fn materials_of_mitsuba_06_are_translated() {
    let scene =
        xml("<bsdf type='mixturebsdf'><string name='weights' value='0.5, 0.2'/><bsdf type='diffuse'/>
         <bsdf type='conductor'/></bsdf>");
    // 0.3 of nothing, then 0.5 of 0.8, then 0.2 of all.
    let weights: Vec<_> = scene
        .materials
        .iter()
        .filter_map(
            |m| if let Material::Blend { weight: Input::Constant(w), .. } = m { Some(*w) } else { None },
        )
        .collect();
    assert_eq!(weights.len(), 2);
    assert!((weights[0] - 0.625).abs() < 1e-6 && (weights[1] - 0.2).abs() < 1e-6, "{weights:?}");
    let scene = xml(
        "<bsdf type='phong'><rgb name='specular_reflectance' value='0.2 0.1 0'/><float name='exponent' value='98'/></bsdf>",
    );
    let Some(&Material::Blend { weight: Input::Constant(weight), first, second }) = scene.materials.last()
    else {
        panic!()
    };
    let Material::Diffuse { reflectance: Input::Constant(kd) } = scene.materials[first.0 as usize] else {
        panic!()
    };
    let Material::RoughConductor { alpha: [Input::Constant(alpha), _], specular_reflectance, .. } =
        scene.materials[second.0 as usize]
    else {
        panic!()
    };
    let Input::Constant(ks) = specular_reflectance else { panic!() };
    assert!(near(kd * (1.0 - weight), [0.5; 3]) && near(ks * weight, [0.2, 0.1, 0.0]));
    assert!((alpha * alpha - 0.02).abs() < 1e-6);
}

#[test]
fn conductors_have_names() {
    let Material::Conductor { eta: Input::Constant(eta), k: Input::Constant(k), .. } =
        material("<bsdf type='conductor'><string name='material' value='Au'/></bsdf>")
    else {
        panic!()
    };
    // As Mitsuba 3.9.1 prints them in scalar_rgb.
    assert!((eta - Vec3::new(0.14304, 0.37531, 1.44205)).abs().max_element() < 1e-4);
    assert!((k - Vec3::new(3.983, 2.38556, 1.60336)).abs().max_element() < 1e-4);
}

/// The same scene in the words of Mitsuba 0.6 and of Mitsuba 3.
#[test]
fn old_scenes_become_new_ones() {
    let old = "<scene version='0.6.0'>
        <integrator type='path'><integer name='maxDepth' value='7'/><boolean name='strictNormals' value='true'/></integrator>
        <sensor type='thinlens'><float name='apertureRadius' value='0.1'/><float name='focusDistance' value='3'/>
          <string name='fovAxis' value='smaller'/><float name='fov' value='30'/>
          <transform name='toWorld'><lookAt origin='1 2 3' target='0 0 0' up='0 1 0'/></transform>
          <sampler type='sobol'><integer name='sampleCount' value='9'/></sampler>
          <film type='ldrfilm'><integer name='width' value='20'/><integer name='height' value='10'/>
            <boolean name='banner' value='false'/><float name='gamma' value='2.2'/>
            <string name='fileFormat' value='png'/><rfilter type='catmullrom'/></film></sensor>
        <bsdf type='dielectric' id='g'><float name='intIOR' value='1.3'/><string name='extIOR' value='air'/></bsdf>
        <shape type='sphere'><ref id='g'/><boolean name='flipNormals' value='true'/></shape>
        <emitter type='constant'><spectrum name='radiance' value='1, 2, 3'/></emitter>
        <emitter type='point'><srgb name='intensity' value='0.5'/></emitter></scene>";
    let new = "<scene version='3.0.0'>
        <integrator type='path'><integer name='max_depth' value='7'/></integrator>
        <sensor type='thinlens'><float name='aperture_radius' value='0.1'/><float name='focus_distance' value='3'/>
          <string name='fov_axis' value='smaller'/><float name='fov' value='30'/>
          <transform name='to_world'><lookat origin='1 2 3' target='0 0 0' up='0 1 0'/></transform>
          <sampler type='independent'><integer name='sample_count' value='9'/></sampler>
          <film type='hdrfilm'><integer name='width' value='20'/><integer name='height' value='10'/>
            <rfilter type='mitchell'><float name='B' value='0'/><float name='C' value='0.5'/></rfilter></film></sensor>
        <bsdf type='dielectric' id='g'><float name='int_ior' value='1.3'/><string name='ext_ior' value='air'/></bsdf>
        <shape type='sphere'><ref id='g'/><boolean name='flip_normals' value='true'/></shape>
        <emitter type='constant'><rgb name='radiance' value='1, 2, 3'/></emitter>
        <emitter type='point'><rgb name='intensity' value='0.21404114'/></emitter></scene>";
    let folder = Folder::new();
    let [old, new] = [old, new].map(|text| {
        folder.write("scene.xml", text);
        folder.load("scene.xml", &LoadOptions::default()).unwrap_or_else(|e| panic!("{e}"))
    });
    let (a, b) = (&old.scene, &new.scene);
    assert_eq!(a.camera, b.camera);
    assert_eq!(a.film, b.film);
    assert_eq!((a.sample_count, &a.materials), (b.sample_count, &b.materials));
    assert_eq!(a.integrator.parameters, b.integrator.parameters);
    assert_eq!(a.emitters[0], b.emitters[0]);
    let (Emitter::Point { intensity: a, .. }, Emitter::Point { intensity: b, .. }) =
        (&a.emitters[1], &b.emitters[1])
    else {
        panic!()
    };
    assert!(a.abs_diff_eq(*b, 1e-6), "{a} {b}");
    // What has no effect is said.
    let notes: Vec<_> = old.warnings.iter().map(|w| w.message.as_str()).collect();
    assert!(
        notes.iter().any(|n| n.contains("banner")) && notes.iter().any(|n| n.contains("strict_normals")),
        "{notes:?}"
    );
}

#[test]
fn integrators_are_unwrapped_and_translated() {
    let settings = |text: &str| xml(text).integrator;
    let wrapped = settings(
        "<integrator type='moment'><integrator type='aov'><string name='aovs' value='d:depth'/>\
         <integrator type='direct'><integer name='emitter_samples' value='4'/></integrator></integrator></integrator>",
    );
    assert_eq!(wrapped.name.as_deref(), Some("path"));
    assert_eq!(wrapped.parameters, [("max_depth".to_owned(), "2".to_owned())]);
    let volume = settings("<integrator type='volpath'><integer name='max_depth' value='5'/></integrator>");
    assert_eq!((volume.name.as_deref(), volume.parameters.len()), (Some("path"), 1));
    // Others are for those above to judge.
    assert_eq!(settings("<integrator type='vcm'/>").name.as_deref(), Some("vcm"));
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

/// Of spectra as objects: the same as in other words.
#[test]
fn spectra_may_be_objects() {
    let radiance = |spectrum: &str| {
        let scene = xml(&format!("<shape type='sphere'><emitter type='area'>{spectrum}</emitter></shape>"));
        match scene.shapes[0].emission {
            Some(Input::Constant(radiance)) => radiance,
            other => panic!("{other:?} of {spectrum}"),
        }
    };
    let list = radiance("<spectrum name='radiance' value='400:0.1, 500:0.9, 600:0.6'/>");
    let object = |kind: &str, parameters: &str| {
        radiance(&format!("<spectrum type='{kind}' name='radiance'>{parameters}</spectrum>"))
    };
    let values = "<string name='values' value='0.1, 0.9, 0.6'/>";
    let range = "<float name='wavelength_min' value='400'/><float name='wavelength_max' value='600'/>";
    assert_eq!(object("regular", &format!("{range}{values}")), list);
    let wavelengths = "<string name='wavelengths' value='400 500 600'/>";
    assert_eq!(object("irregular", &format!("{wavelengths}{values}")), list);
    assert_eq!(object("uniform", "<float name='value' value='0.4'/>"), Vec3::splat(0.4));
    let inner = "<float name='scale' value='2'/><spectrum type='srgb' name='color'><rgb name='color' value='.5 .25 1'/></spectrum>";
    assert_eq!(object("d65", inner), Vec3::new(1.0, 0.5, 2.0));
    let hot = object("blackbody", "<float name='temperature' value='3000'/>");
    assert!(hot.x > hot.y && hot.y > hot.z && hot.z > 0.0, "{hot}");
    let shared = "<spectrum type='uniform' id='s'><float name='value' value='3'/></spectrum>
                  <shape type='sphere'><emitter type='area'><ref id='s' name='radiance'/></emitter></shape>";
    assert_eq!(xml(shared).shapes[0].emission, Some(Input::Constant(Vec3::splat(3.0))));
    for (spectrum, words) in [
        ("<spectrum type='volume' name='radiance'/>", "spectrum `volume` as `radiance`"),
        ("<spectrum type='blackbody' name='radiance'/>", "without `temperature`"),
        ("<spectrum type='d65' name='radiance'/><float name='radiance' value='1'/>", "again"),
        (
            "<spectrum type='irregular' name='radiance'><string name='wavelengths' value='500 400'/>
             <string name='values' value='1 1'/></spectrum>",
            "ascending",
        ),
    ] {
        let error =
            xml_error(&format!("<shape type='sphere'><emitter type='area'>{spectrum}</emitter></shape>"));
        assert!(error.contains(words), "{error}");
    }
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
        cube += &format!("v {} {} {}\n", i & 1, i >> 1 & 1, i >> 2);
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

/// `map_Ke` times `Ke`, or alone where that is absent.
#[test]
fn emission_maps_of_mtl() {
    let folder = Folder::new();
    let image = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/scenes/textures/patches.png");
    folder.write("map.png", std::fs::read(image).unwrap());
    let mtl = "newmtl a\nKe 2 4 6\nmap_Ke map.png\nnewmtl b\nmap_Ke map.png\nnewmtl c\nKe 1 1 1\n";
    folder.write("a.mtl", mtl);
    let face = |name: &str| format!("usemtl {name}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n");
    folder.write("a.obj", format!("mtllib a.mtl\n{}{}{}", face("a"), face("b"), face("c")));
    let loaded = folder.load("a.obj", &LoadOptions::default()).unwrap();
    assert!(!loaded.warnings.iter().any(|w| w.message.contains("map_Ke")), "{:?}", loaded.warnings);
    let scene = loaded.scene;
    let texture = |shape: usize| match scene.shapes[shape].emission {
        Some(Input::Texture(id)) => &scene.textures[id.0 as usize],
        other => panic!("{other:?}"),
    };
    assert!(matches!(texture(0), Texture::Scale { factor, .. } if *factor == Vec3::new(2.0, 4.0, 6.0)));
    assert!(matches!(texture(1), Texture::Bitmap(_)));
    assert_eq!(scene.shapes[2].emission, Some(Input::Constant(Vec3::ONE)));
}
