//! An image depends on which passes were added, and on nothing else.

use super::*;
use helmholtz::film::exact::{ExactSum, Quantum};
use helmholtz::film::state::{RenderIdentity, load_state, save_state};
use helmholtz::film::{FilmError, Splat};

fn identity() -> RenderIdentity {
    RenderIdentity { scene: "test".into(), integrator: "none".into(), seed: 1 }
}

/// A film's entire content, as bytes.
fn bytes(film: &Film) -> Vec<u8> {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("state");
    save_state(&path, &identity(), film).unwrap();
    std::fs::read(&path).unwrap()
}

fn splats(pass: u32) -> Vec<Splat> {
    let at = |i| random(IVec2::new(-1000, i), pass);
    (0..300).map(|i| Splat { position: at(i).truncate() * 44.0 - 2.0, radiance: at(i + 1000) }).collect()
}

/// Adds passes with samples, splats and now and then something to drop.
fn render_all(film: &mut Film, passes: &[u32]) {
    let mut samples = film.new_pass();
    for &pass in passes {
        let shade = |p: IVec2, j, u| if u < 1e-3 { Rgb::NAN } else { gradient(p, j, u) };
        fill(&mut samples, pass, shade);
        film.add_pass(pass, Some(&samples), &splats(pass)).unwrap();
    }
}

fn with_threads(threads: usize, film: &mut Film, passes: &[u32]) {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap()
        .install(|| render_all(film, passes));
}

#[test]
fn threads_order_and_splits_do_not_matter() {
    let directory = tempfile::tempdir().unwrap();
    for filter in FILTERS {
        let empty = Film::new(&settings(UVec2::new(41, 35), filter), all_aovs(), 5.0).unwrap();
        let mut one_go = empty.clone();
        with_threads(1, &mut one_go, &[0, 1, 2, 3, 4, 5, 6, 7]);
        let expected = bytes(&one_go);
        assert!(one_go.dropped().samples > 0, "the test drops something");

        let mut threads = empty.clone();
        with_threads(5, &mut threads, &[0, 1, 2, 3, 4, 5, 6, 7]);
        assert!(bytes(&threads) == expected, "{filter:?}: threads");

        let mut order = empty.clone();
        with_threads(2, &mut order, &[5, 2, 7, 0, 1, 6, 3, 4]);
        assert!(bytes(&order) == expected, "{filter:?}: order");

        let path = directory.path().join("part");
        let mut resumed = empty.clone();
        with_threads(2, &mut resumed, &[0, 1, 2]);
        save_state(&path, &identity(), &resumed).unwrap();
        let (loaded_identity, mut resumed) = load_state(&path).unwrap();
        assert_eq!(loaded_identity, identity());
        with_threads(3, &mut resumed, &[3, 4, 5, 6, 7]);
        assert!(bytes(&resumed) == expected, "{filter:?}: resumed");

        let parts = [&[6, 7, 1][..], &[5, 4], &[0, 3, 2], &[]];
        let mut merged = empty.clone();
        for part in parts {
            let mut film = empty.clone();
            with_threads(2, &mut film, part);
            merged.merge(&film).unwrap();
        }
        assert!(bytes(&merged) == expected, "{filter:?}: merged");
        assert_eq!(merged.develop(), one_go.develop());
        assert_ne!(expected, bytes(&empty));
    }
}

#[test]
fn a_crop_is_that_part_of_the_full_image() {
    let (size, min, part) = (UVec2::new(40, 36), UVec2::new(17, 0), UVec2::new(20, 19));
    for filter in FILTERS {
        let develop = |settings: &FilmSettings| {
            let mut film = Film::new(settings, all_aovs(), 1.0).unwrap();
            render_all(&mut film, &[0, 1, 2]);
            film.develop()
        };
        let full = develop(&settings(size, filter));
        let crop = develop(&cropped(size, min, part, filter));
        assert_eq!(crop.crop, PixelRect { min, size: part });
        assert_eq!(crop.film_size, size);
        for channel in &crop.channels {
            for y in 0..part.y {
                for x in 0..part.x {
                    let (a, b) = ((y * 20 + x) as usize, ((y + min.y) * 40 + x + min.x) as usize);
                    let name = channel.name.as_ref();
                    let same = match (crop.floats(name), full.floats(name)) {
                        (Some(crop), Some(full)) => crop[a].to_bits() == full[b].to_bits(),
                        _ => crop.integers(name).unwrap()[a] == full.integers(name).unwrap()[b],
                    };
                    assert!(same, "{filter:?} {name} at {x}, {y}");
                }
            }
        }
    }
}

#[test]
fn a_pass_counts_once() {
    let mut film = film(&settings(UVec2::splat(3), Filter::Box));
    render(&mut film, 4..6);
    let before = bytes(&film);
    let samples = film.new_pass();
    assert_eq!(film.add_pass(5, Some(&samples), &[]), Err(FilmError::Pass(5)));
    let mut other = Film::new(film.settings(), film.aovs(), 1.0).unwrap();
    render(&mut other, 5..7);
    assert_eq!(film.merge(&other), Err(FilmError::Pass(5)));
    assert!(bytes(&film) == before, "errors change nothing");
}

#[test]
fn films_of_other_scenes_do_not_merge() {
    let base = settings(UVec2::splat(3), Filter::Box);
    let mut film = film(&base);
    let none = AovSet::default();
    for other in [
        Film::new(&settings(UVec2::splat(4), Filter::Box), none, 1.0),
        Film::new(&settings(UVec2::splat(3), Filter::Tent { radius: 1.0 }), none, 1.0),
        Film::new(&base, all_aovs(), 1.0),
        Film::new(&base, none, 2.0),
    ] {
        assert!(matches!(film.merge(&other.unwrap()), Err(FilmError::Mismatch(_))));
    }
    assert_eq!(film.merge(&Film::new(&base, none, 1.0).unwrap()), Ok(()));
}

/// Sums of terms over 80 binary orders of magnitude, against big integers: each f32 here is a multiple of 2^-64, so
/// the reference is exact without any rounding of its own.
#[test]
fn sums_are_exact_over_a_wide_range() {
    let quantum = Quantum::from_log2(-64);
    let term = |i: u32| {
        let u = random(IVec2::new(i as i32, 7), 0);
        let magnitude = (u.y * 80.0).floor() as i32 - 40;
        (u.x - 0.5) * 2f32.powi(magnitude)
    };
    let n = 1 << 20;
    let reference: i128 = (0..n).map(|i| (f64::from(term(i)) * 2f64.powi(64)) as i128).sum();
    // A permutation: an odd multiplier modulo a power of two.
    for multiplier in [1u32, 0x9e37_79b9, 0x85eb_ca6b] {
        let mut sum = ExactSum::default();
        for i in 0..n {
            assert!(!sum.add(quantum.round(f64::from(term(i.wrapping_mul(multiplier) % n)))));
        }
        assert_eq!(sum.quanta(), reference);
    }
    let naive: f64 = (0..n).map(|i| f64::from(term(i))).sum();
    assert_ne!((naive * 2f64.powi(64)) as i128, reference, "f64 would do as well: the test tests nothing");
}
