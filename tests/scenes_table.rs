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

const SCENES: &[(&str, Expected)] = &[
    ("scenes/cbox/cbox.xml", Loads(8, 38)),
    ("scenes/cbox/cbox_v3.xml", Loads(8, 38)),
    ("scenes/country-kitchen/kitchen-envmap.xml", Loads(292, 1_414_391)),
    (
        "scenes/country-kitchen/kitchen.xml",
        Refused("emitter `sunsky` is not supported; expected an `envmap`"),
    ),
    ("scenes/country-kitchen/kitchen_v3.xml", Loads(292, 1_414_391)),
    (
        "scenes/sms-ring/ring.xml",
        Refused("ring.xml:39:13: parameter `caustic_emitter_single` of emitter `area`"),
    ),
    ("scenes/sms-ring/ring_notebook_normalmapped.xml", Refused("parameter `caustic_emitter_single`")),
    ("scenes/sms-ring/ring_notebook_normalmapped_v3.xml", Loads(3, 4)),
    ("scenes/sms-ring/ring_notebook_simple.xml", Refused("parameter `caustic_emitter_single`")),
    ("scenes/sms-ring/ring_notebook_simple_v3.xml", Loads(3, 4)),
    ("scenes/sms-ring/ring_v3.xml", Loads(3, 4)),
    ("scenes/sponza/sponza.xml", Loads(38, 66_445)),
    ("scenes/sponza/sponza_v3.xml", Loads(38, 66_445)),
    (
        "scenes/staircase2/scene.xml",
        Refused("medium `homogeneous` as `interior` in shape `obj` is not supported"),
    ),
    ("scenes/torus/obj/torus.xml", Refused("parameter `alpha` of bsdf `conductor` is not supported")),
    ("scenes/torus/torus.xml", Refused("torus.xml:5:5: <dpt>; expected an object")),
    ("scenes/torus/torus_obj_v3.xml", Loads(5, 23_614)),
    ("scenes/torus/torus_v3.xml", Loads(5, 23_614)),
    ("scenes/veach-bidir/scene.xml", Loads(14, 11_544)),
];

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
                    Geometry::Analytic(_) | Geometry::Instance(_) => 0,
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
