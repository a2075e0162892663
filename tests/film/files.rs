//! Image and state files.

use super::*;
use exr::prelude::{AnyImage, AttributeValue, FlatSamples, ReadChannels, ReadLayers};
use helmholtz::film::output::{write_atomically, write_exr, write_png};
use helmholtz::film::state::{RenderIdentity, StateErrorKind, load_state, save_state};
use helmholtz::film::{Channel, Image, Pixels, Splat};
use proptest::prelude::*;
use std::fs;
use std::io::{self, Write};
use std::path::Path;

fn read_exr(path: &Path) -> AnyImage {
    exr::prelude::read()
        .no_deep_data()
        .all_resolution_levels()
        .all_channels()
        .all_layers()
        .all_attributes()
        .from_file(path)
        .unwrap()
}

fn samples<'a>(image: &'a AnyImage, name: &str) -> &'a FlatSamples {
    let channels = &image.layer_data[0].channel_data.list;
    let channel = channels.iter().find(|c| c.name.eq(name)).unwrap_or_else(|| panic!("no channel {name}"));
    channel.sample_data.levels_as_slice().first().unwrap()
}

/// A film of 20 x 10 pixels, of which 7 x 5 from (11, 2) were rendered, with all AOVs.
fn small_film() -> Film {
    let settings =
        cropped(UVec2::new(20, 10), UVec2::new(11, 2), UVec2::new(7, 5), Filter::Tent { radius: 1.0 });
    let mut film = Film::new(&settings, all_aovs(), 1.0).unwrap();
    render(&mut film, 0..3);
    film
}

#[test]
fn exr_round_trip() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("image.exr");
    let image = small_film().develop();
    let metadata = [("scene", "Kügelchen – 球.xml"), ("integrator", "path:max_depth=8"), ("empty", "")];
    let metadata = metadata.map(|(name, value)| (name.to_owned(), value.to_owned()));
    for half in [false, true] {
        assert_eq!(write_exr(&path, &image, half, &metadata).unwrap(), 0);
        let read = read_exr(&path);
        let (window, layer) = (read.attributes.display_window, &read.layer_data[0]);
        assert_eq!((window.position.x(), window.position.y()), (0, 0));
        assert_eq!((window.size.x(), window.size.y()), (20, 10));
        let position = layer.attributes.layer_position;
        assert_eq!((position.x(), position.y()), (11, 2));
        assert_eq!((layer.size.x(), layer.size.y()), (7, 5));
        assert_eq!(layer.channel_data.list.len(), image.channels.len());
        for Channel { name, pixels } in &image.channels {
            match (pixels, samples(&read, name)) {
                (Pixels::Colour(written), FlatSamples::F16(read)) if half => {
                    let rounded: Vec<_> = written.iter().map(|&v| half::f16::from_f32(v)).collect();
                    assert_eq!(read, &rounded, "{name}");
                }
                (Pixels::Colour(written), FlatSamples::F32(read)) if !half => {
                    assert_eq!(read, written, "{name}");
                }
                (Pixels::Float(written), FlatSamples::F32(read)) => assert_eq!(read, written, "{name}"),
                (Pixels::Integer(written), FlatSamples::U32(read)) => assert_eq!(read, written, "{name}"),
                _ => panic!("{name}: wrong type of samples"),
            }
        }
        let attributes: Vec<_> = layer
            .attributes
            .other
            .iter()
            .chain(&read.attributes.other)
            .map(|(k, v)| (k.bytes(), v))
            .collect();
        for (name, value) in &metadata {
            let name = format!("helmholtz.{name}");
            let (_, found) = attributes.iter().find(|(k, _)| *k == name.as_bytes()).unwrap();
            assert!(matches!(found, AttributeValue::Text(t) if t.bytes() == value.as_bytes()), "{name}");
        }
    }
}

#[test]
fn png_is_srgb() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("image.png");
    // Encoded values by IEC 61966-2-1: 0.5 -> 0.735357, 0.18 -> 0.461356, 0.0031308 -> 0.04045, 0.001 -> 0.01292.
    let known = [
        (0.0, 0),
        (1.0, 255),
        (0.5, 188),
        (0.18, 118),
        (0.003_130_8, 10),
        (0.001, 3),
        (2.0, 255),
        (-1.0, 0),
        (f32::NAN, 0),
    ];
    let size = UVec2::new(known.len() as u32, 1);
    let channel = |name: &'static str, scale: f32| {
        let pixels = Pixels::Colour(known.iter().map(|(v, _)| v * scale).collect());
        Channel { name: name.into(), pixels }
    };
    let image = Image {
        film_size: size,
        crop: PixelRect { min: UVec2::ZERO, size },
        channels: vec![channel("R", 1.0), channel("G", 0.0), channel("B", 1.0)],
    };
    write_png(&path, &image).unwrap();
    let mut reader =
        png::Decoder::new(io::BufReader::new(fs::File::open(&path).unwrap())).read_info().unwrap();
    assert!(reader.info().srgb.is_some());
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let frame = reader.next_frame(&mut bytes).unwrap();
    assert_eq!((frame.width, frame.height, frame.color_type), (size.x, 1, png::ColorType::Rgb));
    let expected: Vec<u8> = known.iter().flat_map(|&(_, v)| [v, 0, v]).collect();
    assert_eq!(bytes, expected);
}

#[test]
fn a_failed_write_leaves_the_old_file() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("file");
    write_atomically(&path, |f| f.write_all(b"old")).unwrap();
    let full = io::Error::from(io::ErrorKind::StorageFull);
    let error = write_atomically(&path, |f| f.write_all(&vec![0; 1 << 20]).and(Err(full))).unwrap_err();
    assert!(error.to_string().contains(&path.display().to_string()), "{error}");
    assert_eq!(fs::read(&path).unwrap(), b"old");
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1, "nothing is left beside it");
    write_atomically(&path, |f| f.write_all(b"new")).unwrap();
    assert_eq!(fs::read(&path).unwrap(), b"new");
}

#[test]
fn errors_name_the_file() {
    let directory = tempfile::tempdir().unwrap();
    let image = small_film().develop();
    let missing = directory.path().join("missing/image.png");
    assert!(write_png(&missing, &image).unwrap_err().to_string().contains("missing/image.png"));
    assert!(write_exr(directory.path(), &image, true, &[]).unwrap_err().to_string().contains("regular file"));
    assert!(load_state(&missing).unwrap_err().to_string().contains("missing/image.png"));
}

#[cfg(unix)]
#[test]
fn files_are_ordinary_and_links_are_followed() {
    use std::os::unix::fs::{PermissionsExt, symlink};
    let directory = tempfile::tempdir().unwrap();
    let (path, link, usual) =
        (directory.path().join("a"), directory.path().join("b"), directory.path().join("c"));
    fs::write(&usual, "").unwrap();
    write_atomically(&path, |f| f.write_all(b"1")).unwrap();
    let mode = |path| fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&path), mode(&usual));
    symlink(&path, &link).unwrap();
    write_atomically(&link, |f| f.write_all(b"2")).unwrap();
    assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
    assert_eq!(fs::read(&path).unwrap(), b"2");
}

fn identity() -> RenderIdentity {
    RenderIdentity { scene: "0123abcd".into(), integrator: "path:max_depth=8".into(), seed: u64::MAX }
}

/// A small state with every part a state can have, as bytes.
fn state_bytes(path: &Path) -> Vec<u8> {
    let mut film =
        Film::new(&settings(UVec2::new(3, 2), Filter::Tent { radius: 1.0 }), all_aovs(), 1.0).unwrap();
    render(&mut film, 0..2);
    film.add_pass(9, None, &[Splat { position: Vec2::ONE, radiance: Rgb::ONE }]).unwrap();
    save_state(path, &identity(), &film).unwrap();
    fs::read(path).unwrap()
}

/// The same content with the checksum made right.
fn with_checksum(mut content: Vec<u8>) -> Vec<u8> {
    let checksum = crc32fast::hash(&content);
    content.extend(checksum.to_le_bytes());
    content
}

fn state_of(header: &str, payload: &[u8]) -> Vec<u8> {
    let length = (header.len() as u32).to_le_bytes();
    with_checksum([&b"HELMFILM\x02\0\0\0"[..], &length, header.as_bytes(), payload].concat())
}

#[test]
fn state_round_trip() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("state");
    let bytes = state_bytes(&path);
    let (loaded, film) = load_state(&path).unwrap();
    assert_eq!(loaded, identity());
    assert_eq!(film.passes().to_string(), "0-1, 9-9");
    save_state(&path, &loaded, &film).unwrap();
    assert!(fs::read(&path).unwrap() == bytes);
}

#[test]
fn every_damage_is_found() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("state");
    let bytes = state_bytes(&path);
    let damaged = directory.path().join("damaged");
    let refused = |bytes: &[u8]| {
        fs::write(&damaged, bytes).unwrap();
        load_state(&damaged).is_err()
    };
    for i in 0..bytes.len() {
        let mut flipped = bytes.clone();
        flipped[i] ^= 1 << (i % 8);
        assert!(refused(&flipped), "bit flipped in byte {i}");
    }
    for length in (0..bytes.len()).step_by(7).chain([bytes.len() - 1]) {
        assert!(refused(&bytes[..length]), "cut to {length} bytes");
    }
    assert!(refused(&[&bytes[..], &[0]].concat()), "one byte more");
    assert!(!refused(&bytes), "undamaged");
}

#[test]
fn errors_say_what_is_wrong() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("state");
    let bytes = state_bytes(&path);
    let error = |bytes: &[u8]| {
        fs::write(&path, bytes).unwrap();
        let error = load_state(&path).unwrap_err();
        assert!(error.to_string().contains("state"), "{error}");
        error.kind
    };
    assert!(matches!(error(b"\x89PNG\r\n\x1a\n and so on and on"), StateErrorKind::Magic));
    assert!(matches!(error(b""), StateErrorKind::Length { .. }));
    let mut version = bytes.clone();
    version[8] = 255;
    assert!(matches!(error(&version), StateErrorKind::Version(255)));
    assert!(matches!(error(&bytes[..bytes.len() - 1]), StateErrorKind::Length { .. }));
    let mut sum = bytes.clone();
    let at = sum.len() - 100;
    sum[at] ^= 1;
    assert!(matches!(error(&sum), StateErrorKind::Checksum));
    for (other, what) in [
        (RenderIdentity { scene: "x".into(), ..identity() }, "scene"),
        (RenderIdentity { integrator: "x".into(), ..identity() }, "integrator"),
        (RenderIdentity { seed: 3, ..identity() }, "seed"),
    ] {
        let error = identity().check_same(&other).unwrap_err();
        assert!(error.to_string().contains(what), "{error}");
    }
    assert!(identity().check_same(&identity()).is_ok());
}

/// Files whose checksum is right but whose header lies must neither be believed nor allocate what they claim.
#[test]
fn claims_are_checked_against_the_length() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("state");
    let header = |size: &str, filter: &str, passes: &str, unit: i32, dropped: &str| {
        format!(
            r#"{{"identity":{{"scene":"","integrator":"","seed":0}},"film_size":{size},"crop_min":[0,0],"crop_size":{size},
            "filter":{filter},"half_float":true,"aovs":[],"radiance_unit_log2":{unit},"passes":{passes},
            "dropped":{{"samples":{dropped},"splats":0,"records":0,"overflows":0,"examples":[]}},"has_splats":false}}"#
        )
    };
    let check = |header: &str, payload: usize| {
        fs::write(&path, state_of(header, &vec![0; payload])).unwrap();
        load_state(&path).map(|_| ()).map_err(|e| e.kind)
    };
    let good = r#"[{"start":0,"end":4}]"#;
    assert!(check(&header("[1,1]", "\"box\"", good, 0, "0"), 48).is_ok(), "the test's own header is right");
    assert!(check(&header("[1,1]", "\"box\"", good, 0, &u64::MAX.to_string()), 48).is_ok());
    for (size, filter, passes, unit) in [
        ("[16777216,16777216]", "\"box\"", good, 0),
        ("[4294967295,4294967295]", "\"box\"", good, 0),
        ("[0,1]", "\"box\"", good, 0),
        ("[1,1]", r#"{"tent":{"radius":1e30}}"#, good, 0),
        ("[1,1]", r#"{"tent":{"radius":null}}"#, good, 0),
        ("[1,1]", r#"{"lanczos":{"lobes":4294967295}}"#, good, 0),
        ("[1,1]", "\"bax\"", good, 0),
        ("[1,1]", "\"box\"", r#"[{"start":4,"end":4}]"#, 0),
        ("[1,1]", "\"box\"", r#"[{"start":4,"end":6},{"start":5,"end":9}]"#, 0),
        ("[1,1]", "\"box\"", r#"[{"start":5,"end":1}]"#, 0),
        ("[1,1]", "\"box\"", good, 1_000_000),
        ("[1,1]", "\"box\"", good, i32::MIN),
    ] {
        let header = header(size, filter, passes, unit, "0");
        assert!(check(&header, 48).is_err(), "{header}");
    }
    let deep = "[".repeat(100_000);
    assert!(check(&deep, 48).is_err());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]

    #[test]
    fn any_bytes_are_read_or_refused(header in "\\PC{0,200}", payload in prop::collection::vec(any::<u8>(), 0..200)) {
        let file = tempfile::NamedTempFile::new().unwrap();
        fs::write(file.path(), state_of(&header, &payload)).unwrap();
        prop_assert!(load_state(file.path()).is_err());
    }

    /// A valid file with some bytes replaced and the checksum made right: whatever is loaded must be usable.
    #[test]
    fn tampered_states_do_no_harm(changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4)) {
        let file = tempfile::NamedTempFile::new().unwrap();
        let mut bytes = state_bytes(file.path());
        bytes.truncate(bytes.len() - 4);
        for (at, value) in changes {
            let at = at.index(bytes.len());
            bytes[at] = value;
        }
        fs::write(file.path(), with_checksum(bytes)).unwrap();
        if let Ok((_, film)) = load_state(file.path()) {
            let image = film.develop();
            prop_assert!(image.floats("R").is_some());
            let mut other = film.clone();
            prop_assert!(other.merge(&film).is_err() || film.passes().is_empty());
        }
    }
}
