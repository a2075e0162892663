//! What the loader says of meshes that are far away or have triangles without area.

use std::io::Write;

use helmholtz::scene::load::{LoadOptions, Warning, load};

/// Warnings on a tetrahedron of size 1 at distance `x`, with `more` lines at the end of the file.
fn warnings(x: f64, more: &str) -> Vec<String> {
    let mut file = tempfile::Builder::new().suffix(".obj").tempfile().expect("a file");
    let vertex = |dx: f64, y: f64, z: f64| format!("v {} {y} {z}\n", x + dx);
    let vertices =
        [vertex(0.0, 0.0, 0.0), vertex(1.0, 0.0, 0.0), vertex(0.0, 1.0, 0.0), vertex(0.0, 0.0, 1.0)];
    let text = vertices.concat() + "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n" + more;
    file.write_all(text.as_bytes()).expect("written");
    let loaded = load(file.path(), &LoadOptions::default()).expect("a valid mesh");
    loaded.warnings.iter().map(|w: &Warning| w.message.clone()).collect()
}

#[test]
fn a_mesh_that_rounding_eats_is_announced() {
    let is_far = |text: &String| text.contains("far from the origin");
    // Its diagonal is sqrt 3. A ten-thousandth of that is half of the last digit at 2.9e3.
    for (x, expected) in [(0.0, false), (1e3, false), (2.8e3, false), (3e3, true), (-1e6, true)] {
        assert_eq!(warnings(x, "").iter().any(is_far), expected, "at {x}");
    }
    let text = warnings(1e6, "").into_iter().find(is_far).expect("a warning");
    // 1e6 / 2^24 / sqrt 3.
    assert!(text.starts_with("the scene") && text.contains("3.44 %"), "{text}");
    // In a larger scene a small mesh may be ten times as far away.
    let large = "o large\nv -1e6 0 0\nv 0 1e6 0\nv 0 0 1e6\nf 5 6 7\n";
    let of_mesh = |x| warnings(x, large).into_iter().find(is_far);
    assert_eq!(of_mesh(2.8e4), None);
    assert!(of_mesh(3e4).is_some_and(|text| text.starts_with('`')), "of one mesh");
}

#[test]
fn triangles_without_area_are_counted() {
    let counted = |more: &str| warnings(0.0, more).into_iter().find(|text| text.contains("without area"));
    assert_eq!(counted(""), None);
    assert!(counted("f 1 1 2\n").is_some_and(|text| text.starts_with("1 triangle ")));
    assert!(counted("f 1 1 2\nf 3 3 3\n").is_some_and(|text| text.starts_with("2 triangles ")));
}
