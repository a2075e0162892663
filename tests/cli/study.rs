//! `helmholtz study`.

use std::fs;

use super::{Folder, SCENE};

/// A study leaves a report, goes on where it was, and says what is wrong before it renders anything.
#[test]
fn a_study_is_reported_and_kept() {
    let folder = Folder::new();
    let common = ["study", SCENE, "--size", "16x16", "--reference-time", "60ms", "--seeds", "2"];
    let study = |more: &[&str]| folder.run(&[&common[..], &["--budget", "20ms,10ms"], more].concat());
    let integrators = ["--integrator", "path", "--sweep", "vpl:count=3|5"];
    let first = study(&integrators);
    let [out, told] = [&first.stdout, &first.stderr].map(|text| String::from_utf8_lossy(text).into_owned());
    assert!(first.status.success(), "{told}");
    assert!(told.contains("3 configurations, 2 seeds: 6 runs") && !told.contains("(kept)"), "{told}");
    for name in ["path", "vpl:count=3", "vpl:count=5"] {
        assert!(out.contains(name), "{out}");
    }
    for file in ["report.html", "report.csv", "report.json", "reference.exr", "reference.json"] {
        assert!(folder.path("cornell-box.study").join(file).is_file(), "{file}");
    }
    let again = study(&[&integrators[..], &["--json"]].concat());
    assert_eq!(String::from_utf8_lossy(&again.stderr).matches("(kept)").count(), 6);
    let json: serde_json::Value = serde_json::from_slice(&again.stdout).expect("JSON");
    let file = fs::read(folder.path("cornell-box.study").join("report.json")).expect("a report");
    assert_eq!(json, serde_json::from_slice::<serde_json::Value>(&file).expect("JSON"));
    let results = &json["results"];
    assert_eq!(results["budgets"], serde_json::json!([0.01, 0.02]));
    assert_eq!((results["size"][0].as_u64(), results["scene"].as_str()), (Some(16), Some("cornell-box")));
    let runs = |i: usize| results["configurations"][i]["runs"].as_array().map(Vec::len);
    assert_eq!([runs(0), runs(1), runs(2)], [Some(2); 3]);
    // The scene's paths are as long, whatever the integrator.
    let text = |i: usize| results["configurations"][i]["integrator"].as_str().expect("an integrator");
    let depth = |i| text(i).split("max_depth=").nth(1).and_then(|t| t.split(',').next());
    assert!(depth(0).is_some() && depth(0) == depth(1), "{} {}", text(0), text(1));

    fs::write(folder.path("study.toml"), "seeds = 3\n[[configuration]]\nname = 'a'\nintegrator = 'nope'\n")
        .expect("written");
    let fail = |more: &[&str]| folder.fail(&[&common[..], more, &["-o", "none"]].concat(), 1);
    for (more, why) in [
        (&["--sweep", "path:rr_depth=3"][..], "no parameter has several values"),
        (&["--sweep", "nope:a=1|2"], "`nope` is not known"),
        (&["--integrator", "path:a=1"], "no parameter `a`"),
        (&["--integrator", "path", "--integrator", "path"], "two configurations `path`"),
        (&["--backend", "nope"], "not in this build"),
        (&["--config", "study.toml"], "study.toml:2:1"),
        (&["--config", "none.toml"], "none.toml"),
        (&["--budget", "0s", "--integrator", "path"], "above 0"),
    ] {
        let error = fail(more);
        assert!(error.contains(why), "{more:?}: {error}");
    }
    let reference = |file: &str| {
        folder.fail(&["study", SCENE, "--size", "16x16", "--integrator", "path", "--reference", file], 1)
    };
    folder.succeed(&["render", SCENE, "--size", "16x8", "--spp", "1", "-o", "other.exr"]);
    assert!(reference("other.exr").contains("16 x 8 pixels, but the images are 16 x 16"));
    folder.succeed(&["render", SCENE, "--size", "16x16", "--spp", "1", "--seed", "3", "-o", "same.exr"]);
    assert!(reference("same.exr").contains("seed 3"));
    assert!(reference("none.exr").contains("none.exr"));
    let usage = folder.run(&[&common[..], &["--reference", "a.exr"]].concat());
    assert_eq!(usage.status.code(), Some(2));
}
