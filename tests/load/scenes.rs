//! Files as wholes: defaults, sensors, references, versions, and what is told where something is wrong.

use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};
use helmholtz::scene::load::{LoadOptions, Loaded, Severity, load, mitsuba};
use helmholtz::scene::{Emitter, Filter, FovAxis, Geometry, Lens, Material, Rgb};

use super::{
    CORNER_OBJ, Folder, TRIANGLE_PLY, define, lenient, material, near, triangle_count, xml, xml_error,
    xml_with,
};

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

/// 4x4 pixels.
fn grey_png() -> Vec<u8> {
    let mut png = std::io::Cursor::new(Vec::new());
    let grey = image::RgbImage::from_pixel(4, 4, image::Rgb([90, 90, 90]));
    grey.write_to(&mut png, image::ImageFormat::Png).unwrap();
    png.into_inner()
}

#[test]
fn every_plugin_builds_with_its_defaults() {
    let folder = Folder::new();
    folder.write("a.obj", CORNER_OBJ);
    folder.write("a.ply", TRIANGLE_PLY);
    folder.write("a.serialized", crate::serialized::file(4, &[crate::serialized::triangle(4)]));
    for name in ["a.bitmap", "a.envmap"] {
        folder.write(name, grey_png());
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
fn environments_say_how_they_are_sampled() {
    let folder = Folder::new();
    folder.write("sky.png", grey_png());
    let columns = |parameter: &str| {
        let sky = "<string name='filename' value='sky.png'/>";
        let body = format!("<emitter type='envmap'>{sky}{parameter}</emitter>");
        folder.write("scene.xml", format!("<scene version='3.0.0'>{body}</scene>"));
        let scene = folder.load("scene.xml", &LoadOptions::default())?.scene;
        let Emitter::Map(map) = &scene.emitters[0] else { panic!("an environment map") };
        Ok::<_, String>(map.sampling_columns())
    };
    let of = |n: &str| columns(&format!("<integer name='sampling_columns' value='{n}'/>"));
    assert_eq!([columns(""), of("2"), of("3"), of("5")], [Ok(4), Ok(2), Ok(3), Ok(4)]);
    for bad in ["1", "0", "-3"] {
        let error = of(bad).expect_err(bad);
        assert!(
            error.contains("scene.xml:1:") && error.contains("expected a whole number from 2 on"),
            "{error}"
        );
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
        <sensor type='fisheye'/><emitter type='sunsky'/><dpt/><integrator type='moment'><integrator type='path'/></integrator>"
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
    emitter `sunsky` is not supported; a white sky is put in its place
    the scene has no sensor: using a camera that frames its shapes
    ");
    assert_eq!(replaced, 9);
    assert!(matches!(scene.emitters[..], [Emitter::Constant { radiance: Rgb::ONE }]));
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
