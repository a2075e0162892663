//! Third-party scenes, one by one: each loads, or is refused for the right reason.

use std::path::Path;

use helmholtz::scene::Geometry;
use helmholtz::scene::load::{LoadOptions, load};

/// What loading a scene without lenience should give.
#[derive(Debug)]
enum Expected {
    /// Shapes and triangles.
    Loads(usize, usize),
    /// The error contains these words.
    Refused(&'static str),
}
use Expected::{Loads, Refused};

const SCENES: &[(&str, Expected)] = &[];

#[test]
fn third_party_scenes_load_or_say_why_not() {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/testdata"));
    if !root.exists() {
        eprintln!("skipped: {} is absent", root.display());
        return;
    }
    let mut failures = Vec::new();
    for (name, expected) in SCENES {
        let found = load(&root.join(name), &LoadOptions::default());
        let fits = match (&found, expected) {
            (Ok(loaded), Loads(shapes, triangles)) => {
                let count = |g: &Geometry| match g {
                    Geometry::Mesh(mesh) => mesh.triangles().len(),
                    Geometry::Analytic(_) => 0,
                };
                let total: usize = loaded.scene.shapes.iter().map(|s| count(&s.geometry)).sum();
                if (loaded.scene.shapes.len(), total) != (*shapes, *triangles) {
                    failures.push(format!("{name}: {} shapes, {total} triangles", loaded.scene.shapes.len()));
                }
                true
            }
            (Err(error), Refused(words)) => error.to_string().contains(words),
            _ => false,
        };
        if !fits {
            let found = found.map_or_else(|e| e.to_string(), |l| format!("{} shapes", l.scene.shapes.len()));
            failures.push(format!("{name}: {found}; expected {expected:?}"));
        }
    }
    assert!(failures.is_empty(), "{}", failures.join("\n"));
}
