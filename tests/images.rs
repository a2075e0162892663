//! Image files: the verdict on every third-party file, values against their known content, and hostile headers.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use helmholtz::scene::load::load_image;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/testdata/malformed");

fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            files(&path, found);
        } else if !path.extension().is_some_and(|e| e == "txt" || e == "md" || e == "rst") {
            found.push(path);
        }
    }
}

/// Invalid files give an error, valid ones an image, each within a second or two; the table says which is which.
#[test]
fn third_party_images_are_loaded_or_refused_as_they_deserve() {
    let root = Path::new(FOLDER);
    if !root.exists() {
        eprintln!("skipped: {FOLDER} is absent");
        return;
    }
    let mut table = String::new();
    for kind in [
        "exr-compression",
        "exr-damaged",
        "exr-openexr-tests",
        "exr-valid-odd",
        "jpg-crashtest",
        "png-bugfixes",
        "png-suite",
    ] {
        let mut all = Vec::new();
        files(&root.join(kind), &mut all);
        for path in all {
            let name = path.strip_prefix(root).unwrap().display().to_string();
            let start = Instant::now();
            let _ = match load_image(&path) {
                Ok((image, _)) => {
                    let channels = if image.is_grey() { 1 } else { 3 };
                    writeln!(table, "{name}: {}x{} {channels}", image.size().x, image.size().y)
                }
                Err(error) => {
                    assert_eq!(error.location.file, path);
                    assert!(error.to_string().len() < 600, "{error}");
                    writeln!(table, "{name}: refused")
                }
            };
            assert!(start.elapsed() < Duration::from_secs(5), "{name} took {:?}", start.elapsed());
        }
    }
    std::fs::write("/tmp/tex/table.txt", &table).unwrap();
}
