//! What looks at a scene or at images: single pixels, strategies, `diff`, `inspect` and `ab`.

use std::fs;

use super::{BACKENDS, Folder, SCENE, channels};

#[test]
fn a_pixel_is_explained_vertex_by_vertex() {
    let folder = Folder::new();
    let output = folder.run(&["render", SCENE, "--debug-pixel", "256,40", "--passes", "0..2"]);
    let text = String::from_utf8_lossy(&output.stdout);
    for part in ["pixel 256,40 pass 0", "pass 1", "hits `", "ng (", "beta (", "samples a light"] {
        assert!(text.contains(part), "no {part:?} in {text}");
    }
    assert!(!folder.path("cornell-box.exr").exists(), "it also rendered");
    assert!(folder.fail(&["render", SCENE, "--debug-pixel", "512,0"], 1).contains("not on the film"));
}

#[test]
fn light_paths_of_a_pixel_are_explained() {
    let folder = Folder::new();
    let output = folder.run(&[
        "render",
        SCENE,
        "--size",
        "12x12",
        "--debug-pixel",
        "3,10",
        "--integrator",
        "bdpt:max_depth=4",
        "--passes",
        "0..6",
    ]);
    let text = String::from_utf8_lossy(&output.stdout);
    for part in [
        "pixel 3,10 pass 0",
        "light 1:",
        "eye 1:",
        "samples the lens (s = ",
        "connects the subpaths",
        "light path ",
    ] {
        assert!(text.contains(part), "no {part:?} in {text}");
    }
}

#[test]
fn strategies_are_written_as_layers_and_sheets() {
    let folder = Folder::new();
    folder.succeed(&[
        "render",
        SCENE,
        "--size",
        "12x12",
        "--spp",
        "2",
        "--integrator",
        "bdpt:max_depth=3",
        "--strategies",
        "pyramid",
        "--quiet",
    ]);
    let names: Vec<_> =
        channels(&folder.path("pyramid/strategies.exr")).into_iter().map(|(name, _)| name).collect();
    for name in ["weighted.s1t2.R", "unweighted.s2t2.B", "weighted.s3t1.G", "unweighted.s0t4.R"] {
        assert!(names.iter().any(|n| n == name), "no {name} in {names:?}");
    }
    assert!(folder.path("pyramid/weighted.png").exists() && folder.path("pyramid/unweighted.png").exists());
    let text = folder.fail(&["render", SCENE, "--integrator", "bdpt", "--strategies", "pyramid"], 1);
    assert!(text.contains("max_depth"), "{text}");
    // There are no statistics to print.
    let text = folder.fail(&["render", SCENE, "--strategies", "pyramid", "--json"], 2);
    assert!(text.contains("cannot be used with"), "{text}");
}

/// Renders of two seeds differ by what their noise allows; exit codes, JSON and the heat map.
#[test]
fn images_are_compared() {
    let folder = Folder::new();
    for (seed, name) in [("1", "a.exr"), ("2", "b.exr")] {
        let size = ["--size", "32x32", "--spp", "16", "--aov", "variance", "--seed", seed, "-o", name];
        folder.succeed(&[&["render", SCENE, "--integrator", "path:max_depth=3"], &size[..]].concat());
    }
    let report = folder.run(&["diff", "a.exr", "b.exr", "--json", "--heat-map", "map.png"]);
    let json: serde_json::Value = serde_json::from_slice(&report.stdout).expect("JSON");
    let number = |name: &str| json[0][name].as_f64().unwrap_or_else(|| panic!("{name}: {json}"));
    assert!(number("relmse") > 0.0 && number("relmse") >= number("relmse_trimmed"));
    // The film's filter makes z up to 3 times as large as it should be: false alarms below 1e-4.
    assert!(number("bias_z").abs() < 12.0 && number("non_finite") == 0.0, "{json}");
    assert!(number("flip_ldr") > 0.0 && number("flip_hdr") < 1.0);
    assert!(folder.path("map.png").exists());
    let limit =
        |image: &str, limit: &str| folder.run(&["diff", "a.exr", image, "--max-relmse", limit]).status.code();
    assert_eq!(
        (limit("b.exr", "10"), limit("b.exr", "1e-9"), limit("a.exr", "0")),
        (Some(0), Some(3), Some(0))
    );
    let text = String::from_utf8(folder.run(&["diff", "a.exr", "a.exr", "b.png"]).stdout).expect("text");
    assert!(text.contains("PSNR inf dB") && text.contains("b.png") && text.contains("FLIP"), "{text}");
    folder.succeed(&["render", SCENE, "--size", "16x32", "--spp", "1", "-o", "small.exr"]);
    let error = folder.fail(&["diff", "a.exr", "small.exr"], 1);
    assert!(error.contains("16 x 32") && error.contains("32 x 32"), "{error}");
    assert!(
        folder.fail(&["diff", "a.exr", "a.exr", "b.exr", "--heat-map", "m.png"], 1).contains("one image")
    );
    assert!(folder.fail(&["diff", "a.exr", "none.exr"], 1).contains("none.exr"));
}

#[test]
fn inspect_says_what_there_is() {
    let folder = Folder::new();
    let glass = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/glass-spheres.xml");
    let output = folder.run(&["inspect", glass, "--json"]);
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(output.status.code(), Some(0));
    // 30 is the luminance of the intensity, times 4 pi.
    let flux = report["lights"][0]["flux"].as_f64().expect("a number");
    let expected = 4.0 * std::f64::consts::PI * (0.212_671 * 30.0 + 0.715_160 * 28.0 + 0.072_169 * 25.0);
    assert!((flux / expected - 1.0).abs() < 1e-5, "{flux}, expected {expected}");
    assert_eq!(report["lights"][0]["kind"], "point");
    assert_eq!((&report["triangles"], &report["analytic_shapes"]), (&4.into(), &4.into()));
    let classes: Vec<_> =
        report["classes"].as_array().expect("classes").iter().map(|c| &c["paths"]).collect();
    assert_eq!(classes.len(), 8);
    let caustics = &report["classes"][4]["integrators"];
    assert_eq!((&caustics["path"], &caustics["bdpt"]), (&"cannot".into(), &"well".into()));
    assert!(
        report["shortcomings"].as_array().expect("a list").len() == 4
            && report["findings"] == serde_json::json!([])
    );
    let text =
        String::from_utf8_lossy(&folder.run(&["inspect", glass, "--integrator", "bdpt"]).stdout).into_owned();
    for part in [
        "1 x point",
        "LS+DS+E",
        "caustics in mirrors",
        "integrator  bdpt:",
        "note: the integrator cannot find all",
    ] {
        assert!(text.contains(part), "{part} is not in {text}");
    }
    folder.fail(&["inspect", "none.xml"], 1);
}

/// Verified by short renders; what is verified as predicted exits with 0.
#[test]
fn inspect_verifies_its_table() {
    let folder = Folder::new();
    let output = folder.run(&["inspect", SCENE, "--verify", "--integrator", "path:max_depth=3"]);
    let text = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{text}");
    assert!(text.contains("measured") && text.contains("auto takes path"), "{text}");
    // Only where the sign is explained.
    assert_eq!(text.matches('!').count(), 1, "{text}");
}

/// Two backends agree on the Cornell box; the report is one file, and a list of rays can be asked again.
#[test]
fn backends_are_compared() {
    let folder = Folder::new();
    let common = ["ab", SCENE, "--size", "24x20", "--spp", "2", "--rays", "20000"];
    let (a, b) = if BACKENDS.len() > 1 { ("embree", "obvhs") } else { ("obvhs", "obvhs:quality=high") };
    let output = folder.run(&[&common[..], &["--a", a, "--b", b, "--json", "-o", "report.html"]].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    for kind in ["primary", "bounce", "shadow"] {
        let rays = &json["rays"][kind];
        assert!(rays["compared"].as_u64().is_some_and(|n| n > 3000) && rays["faults"] == 0, "{kind}: {rays}");
        assert!(json["backends"][1]["rays_per_second"][kind].as_f64().is_some_and(|rate| rate > 1000.0));
    }
    // Each pass has one primary ray for each pixel and the filter's border around.
    let primary = json["rays"]["primary"]["compared"].as_u64().expect("a number");
    let border = |n: u64| (24 + 2 * n) * (20 + 2 * n);
    assert!((0..4).any(|n| primary.is_multiple_of(border(n))), "{primary}");
    assert_eq!(json["faults"].as_array().map(Vec::len), Some(0));
    let page = fs::read_to_string(folder.path("report.html")).expect("a report");
    assert_eq!(page.matches("<img alt=").count(), 3);
    assert_eq!(page.matches("src=\"data:image/png;base64,iVBORw0KGgo").count(), 3);
    assert!(!page.contains("http"), "it needs the network");

    // Down the middle of the box, and a ray that leaves it backwards.
    fs::write(
        folder.path("rays.txt"),
        "# two\nclosest 0 1 -8 0 0 1 0 inf\noccluded 0x0p+0 0x1p+0 -0x1p+3 0 0 -1 0 inf\n",
    )
    .expect("written");
    let output = folder.run(&["ab", SCENE, "--a", a, "--b", b, "--replay", "rays.txt"]);
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(output.status.success(), "{text}");
    assert_eq!(text.matches("both are right").count(), 2, "{text}");
    fs::write(folder.path("bad.txt"), "# two\nclosest 0 1\n").expect("written");
    let text = folder.fail(&["ab", SCENE, "--a", a, "--b", b, "--replay", "bad.txt"], 1);
    assert!(text.contains("bad.txt:2: expected eight numbers"), "{text}");
}
