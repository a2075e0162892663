//! What `render` and `merge` write and say.

use std::fs;
use std::process::Command;

use super::{BACKENDS, Folder, SCENE, channels};

#[test]
fn an_image_is_the_same_for_any_number_of_threads() {
    for backend in BACKENDS {
        let folder = Folder::new();
        let render = |threads: &str, name: &str| {
            folder.succeed(&[
                "render",
                SCENE,
                "--size",
                "48x40",
                "--spp",
                "6",
                "--backend",
                backend,
                "--threads",
                threads,
                "--aov",
                "variance,depth,albedo,shape_id",
                "--quiet",
                "-o",
                name,
            ]);
            channels(&folder.path(name))
        };
        let one = render("1", "one.exr");
        assert!(one.iter().any(|(_, bits)| bits.iter().any(|&b| b != 0)), "the image is black");
        for threads in ["2", "5"] {
            assert!(one == render(threads, "more.exr"), "{backend} with {threads} threads differs");
        }
    }
}

#[test]
fn resuming_and_merging_change_no_bit() {
    let folder = Folder::new();
    let common = ["render", SCENE, "--size", "40x40", "--quiet", "--aov", "variance"];
    let render = |more: &[&str]| folder.succeed(&[&common, more].concat());
    render(&["--spp", "12", "-o", "whole.exr"]);
    render(&["--passes", "0..5", "--save-state", "a.state", "-o", "a.exr"]);
    render(&["--passes", "5..12", "--save-state", "b.state", "-o", "b.exr"]);
    render(&["--spp", "12", "--resume", "a.state", "-o", "resumed.exr"]);
    folder.succeed(&["merge", "b.state", "a.state", "-o", "merged.exr"]);
    let whole = channels(&folder.path("whole.exr"));
    assert!(whole == channels(&folder.path("resumed.exr")), "the resumed image differs");
    assert!(whole == channels(&folder.path("merged.exr")), "the merged image differs");
    assert!(whole != channels(&folder.path("a.exr")), "the parts are no parts");

    let shared = folder.fail(&["merge", "a.state", "a.state", "-o", "twice.exr"], 1);
    assert!(shared.contains("pass"), "{shared}");
    let other = folder.fail(&[&common[..], &["--seed", "1", "--resume", "a.state"]].concat(), 1);
    assert!(other.contains("seed"), "{other}");
}

#[test]
fn a_crop_is_a_part_of_the_image() {
    let folder = Folder::new();
    let common = ["render", SCENE, "--size", "40x30", "--spp", "3", "--quiet"];
    folder.succeed(&[&common[..], &["-o", "full.exr"]].concat());
    folder.succeed(&[&common[..], &["--crop", "7,5,16x12", "-o", "crop.exr"]].concat());
    let (full, crop) = (channels(&folder.path("full.exr")), channels(&folder.path("crop.exr")));
    for ((name, full), (_, crop)) in full.iter().zip(&crop) {
        for (i, bits) in crop.iter().enumerate() {
            let at = (5 + i / 16) * 40 + 7 + i % 16;
            assert_eq!(full[at], *bits, "channel {name}, pixel {i}");
        }
    }
}

#[test]
fn statistics_are_json_on_standard_output() {
    let folder = Folder::new();
    let output = folder.run(&["render", SCENE, "--size", "16x16", "--spp", "2", "--json", "--quiet"]);
    assert!(output.status.success() && output.stderr.is_empty());
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(json["passes"], 2);
    assert_eq!(json["size"], serde_json::json!([16, 16]));
    assert_eq!(json["dropped"]["samples"], 0);
    assert!(json["rays"].as_u64().is_some_and(|rays| rays >= 2 * 16 * 16));
    assert!(folder.path("cornell-box.exr").exists() && folder.path("cornell-box.png").exists());
}

#[test]
fn time_stops_a_render_between_passes() {
    let folder = Folder::new();
    let output = folder.run(&["render", SCENE, "--size", "16x16", "--time", "50ms", "--json", "--quiet"]);
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(json["passes"].as_u64().is_some_and(|passes| passes >= 1));
}

/// With splats too, threads, resuming and merging change no bit.
#[test]
fn splats_are_reproducible() {
    for integrator in ["ptracer:max_depth=5", "bdpt:max_depth=5"] {
        let folder = Folder::new();
        let common = ["render", SCENE, "--size", "40x30", "--quiet", "--integrator", integrator];
        let render = |more: &[&str]| folder.succeed(&[&common, more].concat());
        render(&["--spp", "5", "--threads", "1", "-o", "one.exr"]);
        render(&["--spp", "5", "--threads", "3", "-o", "three.exr"]);
        render(&["--passes", "0..2", "--save-state", "a.state", "-o", "a.exr"]);
        render(&["--passes", "2..5", "--save-state", "b.state", "-o", "b.exr"]);
        render(&["--spp", "5", "--resume", "b.state", "-o", "resumed.exr"]);
        folder.succeed(&["merge", "b.state", "a.state", "-o", "merged.exr"]);
        let one = channels(&folder.path("one.exr"));
        assert!(one.iter().any(|(_, bits)| bits.iter().any(|&b| b != 0)), "the image is black");
        for other in ["three.exr", "resumed.exr", "merged.exr"] {
            assert!(one == channels(&folder.path(other)), "{integrator}: {other} differs");
        }
    }
}

/// AOVs show what the camera sees, also where no camera sample is taken for the image.
#[test]
fn aovs_do_not_depend_on_the_integrator() {
    let folder = Folder::new();
    let depth = |integrator: &str| {
        folder.succeed(&[
            "render",
            SCENE,
            "--size",
            "16x16",
            "--spp",
            "2",
            "--quiet",
            "--aov",
            "depth,albedo",
            "--integrator",
            integrator,
            "-o",
            "image.exr",
        ]);
        let named =
            |(name, bits): (String, Vec<u32>)| (name == "Z" || name.starts_with("albedo")).then_some(bits);
        channels(&folder.path("image.exr")).into_iter().filter_map(named).collect::<Vec<_>>()
    };
    let expected = depth("path");
    assert_eq!(expected.len(), 4);
    for integrator in ["ptracer", "bdpt"] {
        assert!(depth(integrator) == expected, "{integrator}");
    }
}

/// Photons are saved and loaded, at another size too; what does not fit is said, and so is a scene in which no photon lands.
#[test]
fn photons_are_saved_and_loaded() {
    let folder = Folder::new();
    let with = |integrator: &str, more: &[&str]| {
        let mut arguments = vec!["render", SCENE, "--size", "24x16", "--integrator", integrator];
        arguments.extend(more);
        arguments.iter().map(|a| (*a).to_owned()).collect::<Vec<_>>()
    };
    let succeed =
        |arguments: Vec<String>| folder.succeed(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let fail =
        |arguments: Vec<String>| folder.fail(&arguments.iter().map(String::as_str).collect::<Vec<_>>(), 1);
    let sppm = "sppm:photons=2000,max_depth=5";
    let text = succeed(with(sppm, &["--spp", "3", "--save-photons", "p", "-o", "a.exr"]));
    assert!(text.contains("photons of 3 passes"), "{text}");
    succeed(with(sppm, &["--spp", "3", "--load-photons", "p", "-o", "b.exr", "--backend", "obvhs"]));
    succeed(with(sppm, &["--spp", "3", "-o", "c.exr", "--load-photons", "p"]));
    assert!(channels(&folder.path("a.exr")) == channels(&folder.path("c.exr")));
    succeed(with(
        "photonmapper:photons=2000,max_depth=5,show=photons",
        &["--time", "60s", "--load-photons", "p", "-o", "d.exr"],
    ));
    assert!(channels(&folder.path("d.exr")).iter().any(|(_, bits)| bits.iter().any(|b| *b != 0)));
    for (integrator, more, told) in [
        (sppm, &["--spp", "4"] as &[&str], "not pass 3"),
        (sppm, &["--spp", "3", "--seed", "1"], "seed"),
        ("sppm:photons=1999,max_depth=5", &["--spp", "3"], "integrator"),
        ("sppm:photons=2000,max_depth=5,mode=caustic", &["--spp", "3"], "integrator"),
        ("path", &["--spp", "3"], "photonmapper"),
        (sppm, &["--spp", "3", "-D", "a=b"], "scene"),
    ] {
        let error = fail(with(integrator, &[more, &["--load-photons", "p"]].concat()));
        assert!(error.contains(told), "{told}: {error}");
    }
    let dark = folder.path("dark.xml");
    fs::write(&dark, r#"<scene version="3.0.0"><shape type="rectangle"/></scene>"#).expect("written");
    let text = folder.succeed(&[
        "render",
        "dark.xml",
        "--size",
        "8x8",
        "--spp",
        "1",
        "--integrator",
        "photonmapper",
    ]);
    assert!(text.contains("no photon was stored"), "{text}");
}

/// Nothing hits a pinhole, and that is said.
#[test]
fn a_black_image_is_announced() {
    let folder = Folder::new();
    let text = folder.succeed(&[
        "render",
        SCENE,
        "--size",
        "8x8",
        "--spp",
        "1",
        "--integrator",
        "ptracer:connect=hit",
    ]);
    assert!(text.contains("pinhole"), "{text}");
}

/// What is wrong is named, with the choices, and nothing is written.
#[test]
fn errors_name_the_choices() {
    let folder = Folder::new();
    fs::write(folder.path("broken.xml"), "<scene version='3.0.0'>\n <shape type='spere'/></scene>")
        .expect("written");
    let cases: &[(&[&str], i32, &[&str])] = &[
        (&["render", "missing.xml"], 1, &["missing.xml"]),
        (&["render", "broken.xml"], 1, &["broken.xml:2:", "spere", "sphere"]),
        (&["render", "image.png"], 1, &["xml", "obj", "ply"]),
        (&["render", SCENE, "--integrator", "pathh"], 1, &["pathh", "backward"]),
        (&["render", SCENE, "--integrator", "path:depth=3"], 1, &["depth", "max_depth", "rr_depth"]),
        (&["render", SCENE, "--integrator", "path:max_depth=x"], 1, &["max_depth", "`x`", "integer"]),
        (
            &["render", SCENE, "--integrator", "ptracer:connect=eye"],
            1,
            &["connect", "`eye`", "nee", "hit", "both"],
        ),
        (&["render", SCENE, "--integrator", "bdpt:exponent=3"], 1, &["exponent", "`3`", "`1` or `2`"]),
        (&["render", SCENE, "--integrator", "bdpt:hide_emitters=true"], 1, &["hide_emitters", "max_depth"]),
        (&["render", SCENE, "--backend", "optix"], 1, &["optix", "obvhs"]),
        (&["render", SCENE, "--backend", "obvhs:robust=true"], 1, &["robust=true", "quality"]),
        (&["render", SCENE, "-o", "image.jpg"], 1, &[".exr", ".png"]),
        (
            &["render", SCENE, "-o", "no/such/folder/image.exr", "--spp", "1", "--size", "8x8"],
            1,
            &["no/such/folder"],
        ),
        (&["render", SCENE, "--crop", "500,0,64x64"], 1, &["512x512"]),
        (&["render", SCENE, "--size", "12"], 2, &["WIDTHxHEIGHT"]),
        (&["render", SCENE, "--time", "5"], 2, &["ms, s, m, h"]),
        (&["render", SCENE, "--aov", "colour"], 2, &["albedo"]),
        (&["merge", "nothing.state", "-o", "x.exr"], 1, &["nothing.state"]),
    ];
    for (arguments, code, parts) in cases {
        let text = folder.fail(arguments, *code);
        for part in *parts {
            assert!(text.contains(part), "{arguments:?} does not name {part:?}: {text}");
        }
    }
    let left: Vec<_> = fs::read_dir(folder.0.path())
        .expect("the folder")
        .filter_map(Result::ok)
        .map(|e| e.file_name())
        .collect();
    assert_eq!(left, ["broken.xml"]);
}

/// The first Ctrl-C finishes the pass, saves, and says how to go on; going on gives the image of an undisturbed render.
#[cfg(unix)]
#[test]
fn ctrl_c_saves_and_the_render_can_be_resumed() {
    let folder = Folder::new();
    let mut child = Command::new(env!("CARGO_BIN_EXE_helmholtz"))
        .current_dir(folder.0.path())
        .args(["render", SCENE, "--size", "64x64", "--spp", "1000000", "-o", "long.exr"])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .expect("the program runs");
    std::thread::sleep(std::time::Duration::from_millis(700));
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
    assert!(killed.success());
    let output = child.wait().map(|status| status.code()).expect("it ends");
    assert_eq!(output, Some(130));
    let mut text = String::new();
    std::io::Read::read_to_string(&mut child.stderr.take().expect("standard error"), &mut text)
        .expect("text");
    assert!(text.contains("--resume long.state"), "{text}");
    assert!(folder.path("long.exr").exists());

    let saved =
        helmholtz::film::state::load_state(&folder.path("long.state")).expect("a state").1.passes().len();
    let more = (saved + 3).to_string();
    folder.succeed(&[
        "render",
        SCENE,
        "--size",
        "64x64",
        "--spp",
        &more,
        "--resume",
        "long.state",
        "-o",
        "resumed.exr",
        "--quiet",
    ]);
    folder.succeed(&["render", SCENE, "--size", "64x64", "--spp", &more, "-o", "whole.exr", "--quiet"]);
    assert!(
        channels(&folder.path("resumed.exr")) == channels(&folder.path("whole.exr")),
        "the resumed image differs"
    );
}

/// A bare mesh is rendered under a neutral sky by a camera that sees it, and it is said so.
#[test]
fn a_bare_mesh_can_be_rendered() {
    let folder = Folder::new();
    fs::write(
        folder.path("tetra.obj"),
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
    )
    .expect("written");
    let text = folder.succeed(&["render", "tetra.obj", "--size", "32x32", "--spp", "4"]);
    assert!(text.contains("sky") && text.contains("camera"), "{text}");
    let image = channels(&folder.path("tetra.exr"));
    let green: Vec<f32> = image
        .iter()
        .find(|(name, _)| name == "G")
        .expect("green")
        .1
        .iter()
        .map(|&b| f32::from_bits(b))
        .collect();
    // White sky around, a grey body in the middle.
    assert_eq!(green[0], 1.0);
    assert!(green[16 * 32 + 16] < 0.9);
}

/// The scene's integrator is respected, with a hint where it is blind; `auto` looks for another, and keeps the scene's length of paths.
#[test]
fn auto_is_for_those_who_name_no_integrator() {
    let folder = Folder::new();
    let glass = concat!(env!("CARGO_MANIFEST_DIR"), "/scenes/glass-spheres.xml");
    let small = ["--size", "16x16", "--spp", "1", "-o", "a.png"];
    let render = |extra: &[&str]| folder.succeed(&[&["render", glass], &small as &[_], extra].concat());
    let text = render(&[]);
    assert!(text.contains("hint:") && text.contains("LS+DE") && !text.contains("auto takes"), "{text}");
    let text = render(&["--integrator", "path"]);
    assert!(!text.contains("hint:"), "{text}");
    let output =
        folder.run(&[&["render", glass], &small as &[_], &["--integrator", "auto", "--json"]].concat());
    let told = String::from_utf8_lossy(&output.stderr);
    assert!(told.contains("auto takes ") && told.contains("as path misses"), "{told}");
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(report["integrator"].as_str().expect("a name").contains("max_depth=10"), "{report}");
    let text = folder.fail(&["render", glass, "--integrator", "auto:photons=3"], 1);
    assert!(text.contains("integrator `auto` has no parameter `photons`"), "{text}");
    // A mesh names none.
    fs::write(folder.path("a.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").expect("written");
    let text = folder.succeed(&["render", "a.obj", "--size", "16x16", "--spp", "1"]);
    assert!(text.contains("auto takes path"), "{text}");
}

#[test]
fn an_error_can_be_asked_for() {
    let folder = Folder::new();
    let render = |extra: &[&str]| {
        let common = ["render", SCENE, "--size", "24x24", "-o", "a.exr", "--json"];
        let output = folder.run(&[&common as &[_], extra].concat());
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
        (report, String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let (report, told) = render(&["--error", "0.05", "--integrator", "path"]);
    assert!(
        report["relmse_upper"].as_f64().expect("a bound") < 0.05 && told.contains("the target is reached"),
        "{told}"
    );
    assert!(report["bias"].is_null() && report["passes"].as_u64().expect("a number").is_multiple_of(8));
    // Time is over first; photons are biased, which is said.
    let (report, told) =
        render(&["--error", "1e-9", "--integrator", "photonmapper:photons=100", "--time", "100ms"]);
    assert!(told.contains("NOT reached") || told.contains("no estimate"), "{told}");
    assert!(told.contains("does not cover bias") && report["bias"].is_string(), "{told}");
    for wrong in ["0", "-1", "nan", "inf"] {
        folder.fail(&["render", SCENE, "--error", wrong], 2);
    }
    folder.fail(&["render", SCENE, "--error", "0.1", "--spp", "3"], 2);
}

#[test]
fn a_render_is_crosschecked() {
    let folder = Folder::new();
    let common = ["render", SCENE, "--size", "24x20", "--spp", "2", "-o"];
    folder.succeed(&[&common[..], &["plain.exr"]].concat());
    let output = folder.run(&[&common[..], &["checked.exr", "--backend", "crosscheck", "--json"]].concat());
    let text = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && text.contains(" 0 faults, 0 disputes not judged"), "{text}");
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let found = &json["crosscheck"];
    // Rays of light sampling and of paths are each asked once of both.
    assert_eq!(found["compared"], json["rays"], "{found}");
    assert!(found["compared"].as_u64().is_some_and(|rays| rays > 1000), "{found}");
    // Same primitive, by ulps apart; ties are of closest hits, whose number is not above all.
    let same: u64 =
        found["same_by_ulps"].as_array().expect("counts").iter().filter_map(serde_json::Value::as_u64).sum();
    let ties = found["ties"].as_u64().expect("a number");
    assert!(same > 500 && same + ties <= json["rays"].as_u64().expect("a number"), "{found}");
    assert_eq!((&found["faults"], &found["not_judged"]), (&serde_json::json!([]), &serde_json::json!(0)));
    assert_eq!(found["backends"].as_array().map(Vec::len), Some(2));
    assert_eq!(channels(&folder.path("plain.exr")), channels(&folder.path("checked.exr")));
    let text = folder.fail(&[&common[..], &["x.exr", "--backend", "crosscheck:quality=low"]].concat(), 1);
    assert!(text.contains("no settings"), "{text}");
}
