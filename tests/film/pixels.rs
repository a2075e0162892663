//! What a pixel is: the weighted mean of the samples around it; its variance; its AOVs.

use super::*;
use helmholtz::film::{NO_ID, filter};

#[test]
fn filters_are_those_of_mitsuba() {
    // `mi.load_dict({'type': ...}).eval(x)` of Mitsuba 3.9.1, scalar_rgb.
    let gaussian = Filter::Gaussian { stddev: 0.5 };
    let mitchell = Filter::Mitchell { b: 1.0 / 3.0, c: 1.0 / 3.0 };
    let mitchell2 = Filter::Mitchell { b: 0.2, c: 0.5 };
    let lanczos = |lobes| Filter::Lanczos { lobes };
    let tent = |radius| Filter::Tent { radius };
    // Its Gaussian is a polynomial fit; Mitsuba states no bound, 4.2e-4 is the most found.
    let (exact, fit) = (2e-6, 5e-4);
    for (filter, x, expected, tolerance) in [
        (Filter::Box, -0.5, 1.0, 0.0),
        (Filter::Box, 0.3, 1.0, 0.0),
        (Filter::Box, 0.5, 0.0, 0.0),
        (tent(1.0), 0.3, 0.7, exact),
        (tent(1.0), -0.5, 0.5, exact),
        (tent(1.5), 0.8, 0.466_666_638, exact),
        (tent(1.5), 1.7, 0.0, exact),
        (gaussian, 0.0, 0.999_247_133, fit),
        (gaussian, 0.3, 0.835_047_841, fit),
        (gaussian, 0.75, 0.324_242_562, fit),
        (gaussian, 1.25, 0.043_603_464, fit),
        (gaussian, -1.75, 0.001_843_098, 1e-5),
        (Filter::Gaussian { stddev: 0.6 }, 1.2, 0.134_977_534, fit),
        (mitchell, 0.0, 0.888_888_955, exact),
        (mitchell, 0.3, 0.740_388_989, exact),
        (mitchell, -1.25, -0.023_437_421, exact),
        (mitchell, 1.9, -0.002_944_246, exact),
        (mitchell2, 0.8, 0.203_733_190, exact),
        (mitchell2, 1.7, -0.030_599_601, exact),
        (lanczos(3), 0.0, 1.0, exact),
        (lanczos(3), 0.3, 0.844_343_125, exact),
        (lanczos(3), -1.25, -0.132_871_016, exact),
        (lanczos(3), 2.5, 0.024_317_074, exact),
        (lanczos(2), 1.2, -0.078_667_044, exact),
        (lanczos(4), 2.6, 0.050_804_346, exact),
    ] {
        let value = filter::evaluate(&filter, x);
        assert!((value - expected).abs() <= tolerance, "{filter:?} at {x}: {value}, Mitsuba {expected}");
    }
}

#[test]
fn a_constant_stays_constant_up_to_the_borders() {
    let colour = Rgb::new(0.1, 7.3, 1e-3);
    let size = UVec2::new(37, 19);
    for filter in FILTERS {
        for settings in [settings(size, filter), cropped(size, UVec2::new(30, 0), UVec2::new(7, 5), filter)] {
            let mut film = film(&settings);
            let mut samples = film.new_pass();
            for pass in 0..3 {
                fill(&mut samples, pass, |_, _, _| colour);
                film.add_pass(pass, Some(&samples), &[]).unwrap();
            }
            let image = film.develop();
            for (name, value) in ["R", "G", "B"].into_iter().zip(colour.to_array()) {
                // A pass sums up to 81 products in f32, whose roundings of 2^-24 add up like a random walk: 9 steps, and 4 for the
                // negative lobes.
                let is_close = |&v: &f32| (v / value - 1.0).abs() < 13.0 * f32::EPSILON / 2.0;
                assert!(image.floats(name).unwrap().iter().all(is_close), "{filter:?} {name}");
            }
        }
    }
}

/// The definition: over all samples of all passes, sum f L / sum f, with the filter itself and not its table.
fn brute_force(settings: &FilmSettings, film: &Film, passes: u32, pixel: IVec2) -> [f64; 3] {
    let area = film.sampled_area();
    let (mut sum, mut weights) = ([0.0; 3], 0.0);
    for pass in 0..passes {
        for y in area.min.y..area.min.y + area.size.y as i32 {
            for x in area.min.x..area.min.x + area.size.x as i32 {
                let sample = IVec2::new(x, y);
                let u = random(sample, pass);
                let d = (sample - pixel).as_dvec2() + u.truncate().as_dvec2() - 0.5;
                let f = filter::evaluate(&settings.filter, d.x) * filter::evaluate(&settings.filter, d.y);
                let radiance = gradient(sample, u.truncate(), u.z);
                for (sum, value) in sum.iter_mut().zip(radiance.to_array()) {
                    *sum += f * f64::from(value);
                }
                weights += f;
            }
        }
    }
    sum.map(|s| s / weights)
}

#[test]
fn pixels_are_weighted_means() {
    let size = UVec2::new(35, 18);
    for filter in FILTERS {
        let settings = settings(size, filter);
        let mut film = film(&settings);
        render(&mut film, 0..2);
        let image = film.develop();
        // Corners, and the seams between the blocks and tasks that the film works in.
        for (x, y) in [(0, 0), (34, 17), (31, 15), (32, 16), (3, 17), (20, 9)] {
            let expected = brute_force(&settings, &film, 2, IVec2::new(x, y));
            let at = (y * 35 + x) as usize;
            for (name, expected) in ["R", "G", "B"].into_iter().zip(expected) {
                let value = f64::from(image.floats(name).unwrap()[at]);
                // The table is within 2e-6 of the filter per axis, relative to a weight sum around 1.
                assert!((value / expected - 1.0).abs() < 2e-5, "{filter:?} ({x}, {y}): {value} {expected}");
            }
        }
    }
}

#[test]
fn emission_scales_by_powers_of_two_exactly() {
    let render = |scale: f32| {
        let settings = settings(UVec2::new(9, 7), Filter::Gaussian { stddev: 0.5 });
        let mut film = Film::new(&settings, [Aov::Variance].into_iter().collect(), scale).unwrap();
        let mut samples = film.new_pass();
        for pass in 0..5 {
            fill(&mut samples, pass, |p, j, u| gradient(p, j, u) * scale);
            film.add_pass(pass, Some(&samples), &[]).unwrap();
        }
        assert!(film.dropped().is_none());
        film.develop()
    };
    let one = render(1.0);
    for scale in [2f32.powi(40), 2f32.powi(-40), 2f32.powi(100), 2f32.powi(-100)] {
        let image = render(scale);
        let scaled = |name, by: f32| one.floats(name).unwrap().iter().map(|v| v * by).collect::<Vec<_>>();
        assert_eq!(image.floats("R").unwrap(), scaled("R", scale));
        assert_eq!(image.floats("B").unwrap(), scaled("B", scale));
        if scale.log2().abs() < 50.0 {
            assert_eq!(image.floats("variance.G").unwrap(), scaled("variance.G", scale * scale));
        }
    }
}

#[test]
fn dropped_samples_are_black_counted_and_reported() {
    let bad = |pixel: IVec2, pass: u32| match (pixel.x, pixel.y, pass) {
        (2, 1, 0) => Some(Rgb::new(0.0, f32::NAN, 0.0)),
        (0, 0, 3) => Some(Rgb::new(f32::INFINITY, 0.0, 0.0)),
        (1, 2, 1) => Some(Rgb::new(0.0, 0.0, -f32::INFINITY)),
        (3, 3, 2) => Some(Rgb::splat(1e30)),
        _ => None,
    };
    let sample_count = [Aov::SampleCount].into_iter().collect();
    for order in [[0, 1, 2, 3], [3, 1, 0, 2]] {
        let mut film = Film::new(&settings(UVec2::splat(4), Filter::Box), sample_count, 1.0).unwrap();
        let mut samples = film.new_pass();
        for pass in order {
            fill(&mut samples, pass, |pixel, _, _| bad(pixel, pass).unwrap_or(Rgb::ONE));
            film.add_pass(pass, Some(&samples), &[]).unwrap();
        }
        let dropped = film.dropped();
        assert!(!dropped.is_none());
        assert_eq!((dropped.samples, dropped.splats, dropped.overflows), (4, 0, 0));
        let examples: Vec<_> = dropped.examples.iter().map(|e| (e.pass, e.x, e.y)).collect();
        assert_eq!(examples, [(0, 2, 1), (1, 1, 2), (2, 3, 3), (3, 0, 0)]);
        let image = film.develop();
        for i in 0..16 {
            let hurt = [0, 6, 9, 15].contains(&i);
            assert_eq!(image.floats("R").unwrap()[i], if hurt { 0.75 } else { 1.0 });
            assert_eq!(image.integers("sampleCount").unwrap()[i], if hurt { 3 } else { 4 });
        }
    }
}

#[test]
fn a_sum_that_leaves_its_range_is_infinite_and_counted() {
    let mut film = film(&settings(UVec2::ONE, Filter::Box));
    let splat =
        helmholtz::film::Splat { position: Vec2::splat(0.5), radiance: Rgb::new(2f32.powi(40), 1.0, 0.0) };
    // 2^23 times 2^40 units is 2^63 units, the first value out of range; 2^62 is within.
    let many = vec![splat; 1 << 20];
    for pass in 0..3 {
        film.add_pass(pass, None, &many).unwrap();
    }
    assert!(film.dropped().is_none());
    for pass in 3..10 {
        film.add_pass(pass, None, &many).unwrap();
    }
    assert_eq!(film.dropped().overflows, 1);
    let image = film.develop();
    assert_eq!(image.floats("R").unwrap(), [f32::INFINITY]);
    assert_eq!(image.floats("G").unwrap(), [(1 << 20) as f32]);
}

/// Variance of the final pixel over many independent renderings, against the mean of what each estimates by itself.
///
/// The sample variance of 3000 renderings has a relative standard deviation of about sqrt(2 / 3000) = 2.6 %, so 15 % is
/// 5.8 of them; the bias of the ratio estimator, of order 1 / passes, is covered by the same tolerance.
#[test]
fn variance_is_that_of_repeated_renderings() {
    const RENDERINGS: u32 = 3000;
    const PASSES: u32 = 32;
    for filter in [Filter::Box, Filter::Tent { radius: 1.0 }, Filter::Gaussian { stddev: 0.5 }] {
        let (mut values, mut estimate) = (Vec::new(), 0.0);
        for rendering in 0..RENDERINGS {
            let mut film =
                Film::new(&settings(UVec2::ONE, filter), [Aov::Variance].into_iter().collect(), 1.0).unwrap();
            let mut samples = film.new_pass();
            for pass in 0..PASSES {
                // A slope, so that the position of samples matters, with noise on top.
                let shade = |p: IVec2, j: Vec2, u: f32| Rgb::splat(3.0 + p.x as f32 + j.x + 2.0 * u);
                fill(&mut samples, rendering * PASSES + pass, shade);
                film.add_pass(pass, Some(&samples), &[]).unwrap();
            }
            let image = film.develop();
            values.push(f64::from(image.floats("R").unwrap()[0]));
            estimate += f64::from(image.floats("variance.R").unwrap()[0]) / f64::from(RENDERINGS);
        }
        let mean = values.iter().sum::<f64>() / f64::from(RENDERINGS);
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / f64::from(RENDERINGS - 1);
        assert!((estimate / variance - 1.0).abs() < 0.15, "{filter:?}: estimated {estimate}, is {variance}");
        if filter == Filter::Box {
            // Var(jitter) + Var(2 u) = 5 / 12 per pass. The mean of so many estimates is good to 0.5 % (1 sigma).
            let analytic = 5.0 / 12.0 / f64::from(PASSES);
            assert!((estimate / analytic - 1.0).abs() < 0.025, "estimated {estimate}, is {analytic}");
        }
    }
}

#[test]
fn variance_needs_two_passes_and_is_zero_without_noise() {
    for filter in FILTERS {
        let aovs = [Aov::Variance].into_iter().collect();
        let mut film = Film::new(&settings(UVec2::splat(3), filter), aovs, 1.0).unwrap();
        let mut samples = film.new_pass();
        for pass in 0..4 {
            fill(&mut samples, pass, |_, _, _| Rgb::splat(0.3));
            film.add_pass(pass, Some(&samples), &[]).unwrap();
            let variance = film.develop().floats("variance.B").unwrap()[4];
            // What cancellation leaves is below the square of f32's precision.
            assert!(if pass == 0 { variance == f32::INFINITY } else { variance < 1e-14 }, "{variance}");
        }
    }
}

#[test]
fn aovs_are_means_over_hits_and_ids_of_the_lowest_pass() {
    let size = UVec2::new(6, 5);
    for filter in [Filter::Box, Filter::Gaussian { stddev: 0.5 }] {
        let mut film = Film::new(&settings(size, filter), all_aovs(), 1.0).unwrap();
        let passes = [5, 3, 8, 12];
        render(&mut film, passes);
        let image = film.develop();
        let names: Vec<_> = image.channels.iter().map(|c| c.name.as_ref()).collect();
        assert_eq!(names[..3], ["R", "G", "B"]);
        for i in 0..30 {
            let pixel = IVec2::new(i % 6, i / 6);
            let i = i as usize;
            let records: Vec<_> = passes.map(|p| surface(pixel, p, random(pixel, p))).into();
            let hits: Vec<_> = records.iter().filter(|r| r.is_hit()).collect();
            let mean = |value: fn(&AovRecord) -> f32| {
                let sum: f64 = hits.iter().map(|r| f64::from(value(r))).sum();
                (sum / hits.len().max(1) as f64) as f32
            };
            for (name, expected) in [
                ("Z", mean(|r| r.depth)),
                ("P.Y", mean(|r| r.position.y)),
                ("N.Z", mean(|r| r.ng.z)),
                ("Ns.X", mean(|r| r.ns.x)),
                ("albedo.G", mean(|r| r.albedo.y)),
                ("uv.V", mean(|r| r.uv.y)),
            ] {
                let value = image.floats(name).unwrap()[i];
                assert!(
                    (value - expected).abs() <= 1e-6 * expected.abs(),
                    "{name} at {pixel}: {value} {expected}"
                );
            }
            assert_eq!(image.integers("id.shape").unwrap()[i], records[1].shape);
            assert_eq!(image.integers("id.primitive").unwrap()[i], records[1].primitive);
            assert_eq!(image.integers("sampleCount").unwrap()[i], 4);
        }
        assert!(image.integers("id.shape").unwrap().contains(&NO_ID), "the test has misses");
    }
}

#[test]
fn no_aovs_unless_asked_for() {
    let mut film = film(&settings(UVec2::ONE, Filter::Box));
    render(&mut film, 0..2);
    assert_eq!(film.develop().channels.len(), 3);
    film.new_pass()
        .par_bands_mut()
        .for_each(|mut band| band.for_each(|_, _, record| assert!(record.is_none())));
}

#[test]
fn names_of_aovs_are_found() {
    for aov in Aov::ALL {
        assert_eq!(Aov::from_name(aov.name()), Some(aov));
    }
    assert_eq!(Aov::from_name("Depth"), None);
}

#[test]
fn bands_cover_the_sampled_area_once() {
    let film = film(&cropped(
        UVec2::new(50, 40),
        UVec2::new(10, 20),
        UVec2::new(21, 7),
        Filter::Gaussian { stddev: 0.5 },
    ));
    let area = film.sampled_area();
    assert_eq!((area.min, area.size), (IVec2::new(8, 18), UVec2::new(25, 11)));
    let mut samples = film.new_pass();
    let mut pixels: Vec<_> = samples
        .par_bands_mut()
        .flat_map_iter(|mut band| {
            let mut pixels = Vec::new();
            band.for_each(|pixel, _, _| pixels.push((pixel.y, pixel.x)));
            pixels
        })
        .collect();
    pixels.sort_unstable();
    let expected: Vec<_> = (18..29).flat_map(|y| (8..33).map(move |x| (y, x))).collect();
    assert_eq!(pixels, expected);
}

#[test]
fn senseless_settings_are_errors() {
    let film = |settings: &FilmSettings| Film::new(settings, AovSet::default(), 1.0);
    let size = UVec2::splat(8);
    for bad in [
        settings(UVec2::new(0, 8), Filter::Box),
        settings(UVec2::new(1 << 25, 8), Filter::Box),
        settings(size, Filter::Tent { radius: f32::NAN }),
        cropped(size, UVec2::new(8, 0), UVec2::ONE, Filter::Box),
        cropped(size, UVec2::new(4, 4), UVec2::new(5, 1), Filter::Box),
        cropped(size, UVec2::new(4, 4), UVec2::new(u32::MAX, 1), Filter::Box),
        cropped(size, UVec2::ZERO, UVec2::new(0, 4), Filter::Box),
    ] {
        assert!(film(&bad).is_err(), "{bad:?}");
    }
    // A scene without light has no radiance unit.
    for unit in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::MAX, f32::MIN_POSITIVE] {
        let mut film = Film::new(&settings(UVec2::ONE, Filter::Box), AovSet::default(), unit).unwrap();
        let mut samples = film.new_pass();
        fill(&mut samples, 0, |_, _, _| Rgb::ZERO);
        film.add_pass(0, Some(&samples), &[]).unwrap();
        assert_eq!(film.develop().floats("R").unwrap(), [0.0]);
    }
}
