//! BSDFs, textures, spectra, and materials of MTL files.

use std::path::Path;

use glam::Vec3;
use helmholtz::scene::load::{LoadOptions, Loaded};
use helmholtz::scene::{Emitter, Input, Material, Microfacet, Texture};

use super::{Folder, material, near, xml, xml_error};

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
