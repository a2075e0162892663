//! Errors of images against values worked out by hand, FLIP against its authors' program, and files of several layouts.

use std::fs;
use std::path::Path;

use exr::prelude as lib;
use exr::prelude::WritableImage;
use glam::{UVec2, Vec3};
use half::f16;
use helmholtz::film::output::write_png;
use helmholtz::study::flip;
use helmholtz::study::heat::heat_map;
use helmholtz::study::metrics::{CompareError, compare, relative_squared_errors};
use helmholtz::study::picture::Picture;

fn picture(width: u32, pixels: Vec<Vec3>) -> Picture {
    let size = UVec2::new(width, pixels.len() as u32 / width);
    Picture { size, pixels, variance: None, is_display: false }
}

fn grey(width: u32, values: &[f32]) -> Picture {
    picture(width, values.iter().map(|&v| Vec3::splat(v)).collect())
}

fn close(found: f64, expected: f64) {
    assert!((found - expected).abs() <= 1e-6 * expected.abs().max(1e-3), "{found}, expected {expected}");
}

/// Differences 0.1, 0, -1, 0 at references 0, 1, 2, 0.5.
#[test]
fn errors_of_four_pixels() {
    let reference = grey(2, &[0.0, 1.0, 2.0, 0.5]);
    let mut image = grey(2, &[0.1, 1.0, 1.0, 0.5]);
    let errors = compare(&reference, &image).expect("the same size");
    close(errors.mse, 1.01 / 4.0);
    close(errors.rmse(), 0.502_493_781);
    close(errors.rel_mse, (1.0 + 1.0 / 4.01) / 4.0);
    close(errors.rel_mse_trimmed, errors.rel_mse);
    close(errors.psnr, 11.997_986_1);
    close(errors.bias, -0.225);
    assert_eq!((errors.bias_z, errors.non_finite, errors.non_finite_reference), (None, 0, 0));
    // Of integers, 1 is the peak.
    let display = Picture { is_display: true, ..reference.clone() };
    close(compare(&display, &image).expect("the same size").psnr, 5.977_386_2);
    // Twelve values of variance 0.04 have a mean of variance 0.04 / 12; the reference's own doubles it.
    image.variance = Some(vec![Vec3::splat(0.04); 4]);
    let z = |reference: &Picture| compare(reference, &image).expect("the same size").bias_z.expect("a z");
    close(z(&reference), -0.225 / (0.04_f64 / 12.0).sqrt());
    let unsure = Picture { variance: image.variance.clone(), ..reference.clone() };
    close(z(&unsure), -0.225 / (0.08_f64 / 12.0).sqrt());
    let same = compare(&reference, &reference).expect("the same size");
    assert!(same.psnr == f64::INFINITY && same.mse == 0.0 && same.rel_mse == 0.0);
}

/// Channels count by themselves.
#[test]
fn channels_are_averaged() {
    let reference = picture(1, vec![Vec3::new(1.0, 2.0, 0.0)]);
    let image = picture(1, vec![Vec3::new(1.5, 2.0, 0.3)]);
    let errors = compare(&reference, &image).expect("the same size");
    close(errors.mse, (0.25 + 0.09) / 3.0);
    close(errors.rel_mse, (0.25 / 1.01 + 0.09 / 0.01) / 3.0);
}

/// Of 2999 pixels two are left out, of 999 none.
#[test]
fn the_worst_pixels_are_trimmed() {
    for (count, left_out) in [(2999, 2), (999, 0)] {
        let reference = grey(count, &vec![0.3_f32.sqrt(); count as usize]);
        let mut image = reference.clone();
        for i in 0..3 {
            image.pixels[i * 7] = Vec3::splat(0.3_f32.sqrt() + (i + 1) as f32 * 0.5);
        }
        let errors = compare(&reference, &image).expect("the same size");
        let relative = |i: usize| (i as f64 * 0.5).powi(2) / 0.31;
        let kept: f64 = (1..=3 - left_out).map(relative).sum();
        assert!((errors.rel_mse_trimmed / (kept / (count as usize - left_out) as f64) - 1.0).abs() < 1e-5);
        let all: f64 = (1..=3).map(relative).sum();
        assert!((errors.rel_mse / (all / f64::from(count)) - 1.0).abs() < 1e-5);
    }
}

#[test]
fn what_is_not_finite_is_counted_and_left_out() {
    let reference = grey(2, &[0.0, 1.0, f32::INFINITY, 1.0]);
    let image = grey(2, &[f32::NAN, 1.5, 0.0, f32::NEG_INFINITY]);
    let errors = compare(&reference, &image).expect("the same size");
    assert_eq!((errors.non_finite, errors.non_finite_reference), (2, 1));
    close(errors.mse, 0.25);
    close(errors.bias, 0.5);
    let map = relative_squared_errors(&reference, &image).expect("the same size");
    assert_eq!(map.iter().map(|e| e.is_nan()).collect::<Vec<_>>(), [true, false, true, true]);
    let nothing = compare(&reference, &grey(2, &[f32::NAN; 4]));
    assert_eq!(nothing, Err(CompareError::Nothing));
    let error = compare(&reference, &grey(1, &[0.0; 4])).expect_err("another size").to_string();
    assert!(error.contains("1 x 4") && error.contains("2 x 2"), "{error}");
}

/// Two images by formula, linear.
fn patterns() -> [Picture; 2] {
    [false, true].map(|is_changed| {
        let pixel = |i: i32| {
            let (x, y) = (i % 48, i / 48);
            let a = ((x * 7 + y * 13) % 31) as f32 / 31.0;
            let b = ((x / 6 + y / 4) % 2) as f32;
            let c = ((x * x + 3 * y) % 17) as f32 / 17.0;
            let v = Vec3::new(0.2 + 0.6 * a, 0.1 + 0.8 * b, 0.3 * c + 0.2);
            let step = if x % 5 == 0 { 0.05 } else { 0.0 };
            let blue = if y > 16 { 1.2 } else { 1.0 };
            if is_changed { Vec3::new(v.x * 0.9, v.y + step, v.z * blue) } else { v }
        };
        picture(48, (0..48 * 32).map(pixel).collect())
    })
}

/// The authors' own program (`flip-evaluator` 1.7 of PyPI, `evaluate(..., inputsRGB=False)`) has these means, for the patterns as they are, and with a
/// bright spot and a dark part. It rounds differently: an independent version in f64 differs from it by up to 4e-5.
#[test]
fn flip_is_that_of_its_authors() {
    let near =
        |found: f64, expected: f64| assert!((found - expected).abs() < 1e-4, "{found}, expected {expected}");
    let [mut reference, mut image] = patterns();
    near(flip::ldr(&reference, &image), 0.173_547);
    near(flip::hdr(&reference, &image), 0.140_714);
    assert_eq!(flip::ldr(&reference, &reference), 0.0);
    assert_eq!(flip::hdr(&reference, &reference), 0.0);
    for (picture, spot, dark) in [(&mut reference, 200.0, 0.05), (&mut image, 180.0, 0.055)] {
        for (i, pixel) in picture.pixels.iter_mut().enumerate() {
            let (x, y) = (i % 48, i / 48);
            if (2..5).contains(&y) && (3..7).contains(&x) {
                *pixel *= spot;
            }
            if x >= 30 {
                *pixel *= dark;
            }
        }
    }
    near(flip::hdr(&reference, &image), 0.168_320);
    near(flip::hdr(&image, &reference), 0.168_235);
    near(flip::ldr(&reference, &image), 0.139_576);
    // What is not finite is nothing to stumble over.
    image.pixels[5] = Vec3::new(f32::NAN, 1.0, f32::INFINITY);
    assert!(flip::hdr(&reference, &image).is_finite() && flip::ldr(&reference, &image).is_finite());
    let black = picture(48, vec![Vec3::ZERO; 48 * 32]);
    assert!(flip::hdr(&black, &image).is_finite());
}

/// A file of one part with channels of the given names, the values counting up in rows.
fn write_channels(path: &Path, names: &[&str], is_half: bool) {
    let channel = |(c, name): (usize, &&str)| {
        let values = (0..6).map(move |i| (10 * c + i) as f32);
        let samples = if is_half {
            lib::FlatSamples::F16(values.map(f16::from_f32).collect())
        } else {
            lib::FlatSamples::F32(values.collect())
        };
        lib::AnyChannel::new(*name, samples)
    };
    let channels = lib::AnyChannels::sort(names.iter().enumerate().map(channel).collect());
    lib::Image::from_channels((3, 2), channels).write().to_file(path).expect("written");
}

/// Channels by name, of layers, grey, with alpha and more; as halves and floats.
#[test]
fn exr_files_of_several_layouts() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.exr");
    for is_half in [false, true] {
        // Names, and which of them are red, green and blue.
        for (names, rgb) in [
            (&["R", "G", "B"] as &[&str], [0, 1, 2]),
            (&["A", "B", "G", "R", "Z"], [3, 2, 1]),
            (&["Y"], [0, 0, 0]),
            (&["Y", "A"], [0, 0, 0]),
            (&["albedo.R", "albedo.G", "albedo.B", "R", "G", "B"], [3, 4, 5]),
            (&["image.R", "image.G", "image.B", "depth.Y"], [0, 1, 2]),
        ] {
            write_channels(&path, names, is_half);
            let read = Picture::read(&path).expect("readable");
            assert_eq!(
                (read.size, read.is_display, read.variance.is_none()),
                (UVec2::new(3, 2), false, true)
            );
            for (i, pixel) in read.pixels.iter().enumerate() {
                let expected = Vec3::from_array(rgb.map(|c| (10 * c + i) as f32));
                assert_eq!(*pixel, expected, "{names:?}");
            }
            assert_eq!(read.at(1, 1), read.pixels[4]);
        }
    }
    write_channels(&path, &["R", "G", "B", "variance.R", "variance.G", "variance.B"], false);
    let variance = Picture::read(&path).expect("readable").variance.expect("a variance");
    assert_eq!(variance[1], Vec3::new(31.0, 41.0, 51.0));
    write_channels(&path, &["Z"], false);
    assert!(Picture::read(&path).expect_err("no colours").to_string().contains("channels"));
}

fn pfm(header: &str, values: &[f32], is_little: bool) -> Vec<u8> {
    let bytes = values.iter().flat_map(|v| if is_little { v.to_le_bytes() } else { v.to_be_bytes() });
    header.bytes().chain(bytes).collect()
}

/// Rows from the bottom, in both orders of bytes; hostile headers are errors.
#[test]
fn pfm_files() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.pfm");
    let read = |bytes: &[u8]| {
        fs::write(&path, bytes).expect("written");
        Picture::read(&path)
    };
    let colours: Vec<f32> = (0..12).map(|i| i as f32).chain([f32::NAN; 6]).collect();
    for (scale, is_little) in [("-1.0", true), ("1.0", false)] {
        let image = read(&pfm(&format!("PF\n2 3\n{scale}\n"), &colours, is_little)).expect("readable");
        assert_eq!(image.size, UVec2::new(2, 3));
        assert!(image.at(0, 0).is_nan() && image.at(1, 0).is_nan());
        assert_eq!(image.at(0, 1), Vec3::new(6.0, 7.0, 8.0));
        assert_eq!(image.at(1, 2), Vec3::new(3.0, 4.0, 5.0));
        let grey = read(&pfm(&format!("Pf 2 1 {scale}\n"), &[0.5, 0.25], is_little)).expect("readable");
        assert_eq!(grey.pixels, [Vec3::splat(0.5), Vec3::splat(0.25)]);
    }
    for header in [
        "PF",
        "PF\n",
        "PF\n2",
        "PF 2 1 1",
        "PF\n2 1 0\n",
        "PF\n2 1 nan\n",
        "PF\n-2 1 1\n",
        "PF\n2.5 1 1\n",
        "PF\n16777216 16777216 -1\n",
        "PF\n1e300 1 -1\n",
        "PF\n3 1 -1\n",
        "Pf\n2 1 -1\n",
    ] {
        let error = read(&pfm(header, &[0.0; 6], true)).expect_err(header).to_string();
        assert!(error.contains("a.pfm"), "{error}");
    }
}

/// What was written as PNG comes back, to 8 bits; the file's own values are sRGB.
#[test]
fn png_files_are_linear_when_read() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.png");
    let errors = [0.0, 1e-3, 0.1, 7.0];
    let map = heat_map(UVec2::new(2, 2), &errors);
    write_png(&path, &map).expect("written");
    let read = Picture::read(&path).expect("readable");
    assert!(read.is_display && read.size == UVec2::new(2, 2));
    for (i, pixel) in read.pixels.iter().enumerate() {
        let expected = Vec3::from_array(["R", "G", "B"].map(|c| map.floats(c).expect("a colour")[i]));
        assert!(pixel.distance(expected) < 0.02, "{pixel}, {expected}");
    }
    assert!(Picture::read(folder.path()).is_err() && Picture::read(&folder.path().join("none")).is_err());
    fs::write(&path, b"nothing of the kind").expect("written");
    assert!(Picture::read(&path).is_err());
}
