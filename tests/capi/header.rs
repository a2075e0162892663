//! `include/helmholtz.h` is what cbindgen makes of `src/capi`, and nothing else.

use std::fs;
use std::path::Path;

/// `UPDATE_HEADER=1 cargo test --release header` writes it anew.
#[test]
fn the_checked_in_header_is_that_of_the_source() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let header = cbindgen::Builder::new()
        .with_config(
            cbindgen::Config::from_file(root.join("include/cbindgen.toml")).expect("a configuration"),
        )
        .with_src(root.join("src/capi/mod.rs"))
        .generate()
        .expect("a header");
    let mut generated = Vec::new();
    header.write(&mut generated);
    let path = root.join("include/helmholtz.h");
    if std::env::var_os("UPDATE_HEADER").is_some() {
        fs::write(&path, &generated).expect("a writable header");
    }
    let generated = String::from_utf8(generated).expect("a header in UTF-8");
    let checked_in = fs::read_to_string(&path).expect("include/helmholtz.h");
    assert!(
        generated == checked_in,
        "include/helmholtz.h is stale: UPDATE_HEADER=1 cargo test --release header"
    );
    // Every function that is exported is declared, so that no file is missing above.
    let declared = generated.lines().filter(|l| l.contains("helmholtz_") && l.contains('(')).count();
    assert!(declared > 20, "{generated}");
}
