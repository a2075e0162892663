//! Image files: the verdict on every third-party file, values against Mitsuba's decoders, and hostile headers.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use helmholtz::scene::Image;
use helmholtz::scene::load::load_image;

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/testdata/malformed");

/// All files below a folder, without texts about them.
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

/// Means of the channels, without the sRGB curve.
fn means(image: &Image) -> [f64; 3] {
    let size = image.size();
    let mut sum = glam::DVec3::ZERO;
    for y in 0..size.y {
        for x in 0..size.x {
            sum += image.rgb(x, y, true).as_dvec3();
        }
    }
    (sum / (f64::from(size.x) * f64::from(size.y))).to_array()
}

/// `data/images.txt` says of every file whether it is refused, or its size and channels. Where Mitsuba reads it too, the means of the
/// channels are compared; not of the JPEG files, which are all damaged, and which decoders mend in their own ways.
#[test]
fn third_party_images_are_loaded_or_refused_as_they_deserve() {
    let root = Path::new(FOLDER);
    if !root.exists() {
        eprintln!("skipped: {FOLDER} is absent");
        return;
    }
    let mut all = Vec::new();
    for kind in [
        "exr-compression",
        "exr-damaged",
        "exr-openexr-tests",
        "exr-valid-odd",
        "jpg-crashtest",
        "png-bugfixes",
        "png-suite",
    ] {
        files(&root.join(kind), &mut all);
    }
    let lines: Vec<_> = include_str!("data/images.txt").lines().filter(|l| !l.starts_with('#')).collect();
    assert_eq!(lines.len(), all.len());
    let mut compared = 0;
    for (path, line) in all.iter().zip(lines) {
        let name = path.strip_prefix(root).unwrap().display().to_string();
        let expected: Vec<_> =
            line.strip_prefix(&format!("{name}: ")).expect("the same order").split(' ').collect();
        let start = Instant::now();
        let result = load_image(path);
        assert!(start.elapsed() < Duration::from_secs(5), "{name} took {:?}", start.elapsed());
        let image = match result {
            Ok((image, _)) => image,
            Err(error) => {
                assert_eq!(expected, ["refused"], "{error}");
                assert_eq!(&error.location.file, path);
                assert!(error.to_string().len() < 600, "{error}");
                continue;
            }
        };
        let size = format!("{}x{}", image.size().x, image.size().y);
        let channels = if image.is_grey() { "1" } else { "3" };
        assert_eq!(expected[..2], [size.as_str(), channels], "{name}");
        let same_layout = matches!(
            (expected.get(2), channels),
            (Some(&("RGB" | "RGBA")), "3") | (Some(&("Y" | "YA")), "1")
        );
        if !same_layout || name.starts_with("jpg-") {
            continue;
        }
        for (channel, (ours, theirs)) in means(&image).into_iter().zip(&expected[3..]).enumerate() {
            if image.is_grey() && channel > 0 {
                break;
            }
            let theirs: f64 = theirs.parse().expect("a number");
            // Mitsuba's numbers have five digits after the point.
            assert!(
                (ours - theirs).abs() <= 1e-4 * theirs.abs() + 2e-5,
                "{name}: {ours} but Mitsuba has {theirs}"
            );
            compared += 1;
        }
    }
    assert!(compared > 150, "{compared}");
}

/// The same picture in every format that the scenes' textures have.
#[test]
fn formats_agree() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/scenes/textures");
    let load = |name: &str| load_image(&Path::new(folder).join(name)).unwrap_or_else(|e| panic!("{e}")).0;
    let png = load("patches.png");
    for (name, factor, tolerance) in [
        ("patches-16.png", 1.0, 0.003),
        ("patches.tga", 1.0, 0.0),
        ("patches.bmp", 1.0, 0.0),
        ("patches-alpha.png", 1.0, 0.0),
        ("patches.exr", 0.9, 0.003),
        ("patches.hdr", 0.9, 0.006),
    ] {
        let other = load(name);
        assert_eq!(other.size(), png.size(), "{name}");
        for y in 0..png.size().y {
            for x in 0..png.size().x {
                let (a, b) = (png.rgb(x, y, true) * factor, other.rgb(x, y, true));
                assert!((a - b).abs().max_element() <= tolerance, "{name} at {x}, {y}: {a} {b}");
            }
        }
    }
}

/// A header that claims far more than the file can hold is refused before anything is allocated.
#[test]
fn claims_beyond_the_file_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |name: &str, bytes: &[u8]| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        load_image(&path).map(|_| ()).unwrap_err().to_string()
    };
    let mut tga = vec![0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0xff, 0xff, 0xff, 0xff, 24, 0];
    tga.extend([1; 100]);
    assert!(refused("a.tga", &tga).contains("claims"));
    let mut bmp = b"BM\0\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0".to_vec();
    bmp.extend([0x00, 0x7f, 0, 0, 0x00, 0x7f, 0, 0, 1, 0, 24, 0]);
    bmp.extend([0; 24]);
    assert!(refused("a.bmp", &bmp).contains("claims"));
    let hdr = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 60000\n\x02\x02";
    assert!(refused("a.hdr", hdr).contains("claims"));
    assert!(refused("a.png", b"neither fish nor fowl").contains("known format"));
    assert!(refused("a.tga", b"").contains("broken") || refused("a.tga", b"").contains("format"));
}
