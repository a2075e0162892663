//! Splats: energy, borders, crops.

use super::*;
use helmholtz::film::Splat;

fn splat(x: f32, y: f32) -> Splat {
    Splat { position: Vec2::new(x, y), radiance: Rgb::new(1.0, 0.5, 2.0) }
}

fn red(film: &Film) -> Vec<f32> {
    film.develop().floats("R").unwrap().to_vec()
}

#[test]
fn a_splat_keeps_its_energy() {
    let side = 64;
    for filter in FILTERS {
        // One splat for each of 64 x 64 positions within a pixel: their mean is the filter's integral, by the midpoint rule.
        let positions = (0..side * side).map(|i| Vec2::new((i % side) as f32, (i / side) as f32) + 0.5);
        let splats: Vec<_> =
            positions.map(|p| splat(10.0 + p.x / side as f32, 10.0 + p.y / side as f32)).collect();
        let mut film = film(&settings(UVec2::splat(21), filter));
        film.add_pass(0, None, &splats).unwrap();
        let total: f64 = red(&film).iter().map(|&v| f64::from(v)).sum::<f64>() / f64::from(side * side);
        assert!((total - 1.0).abs() < 1e-4, "{filter:?}: {total}");
    }
}

#[test]
fn splats_and_samples_agree_up_to_the_borders() {
    // Light that is even over the sampled area, by splats at all positions, makes every pixel 1: no dark or bright rim.
    let side = 32;
    for filter in FILTERS {
        let mut film = film(&settings(UVec2::new(6, 5), filter));
        let area = film.sampled_area();
        let extent = area.size * side;
        let splats: Vec<_> = (0..extent.y)
            .flat_map(|y| (0..extent.x).map(move |x| (UVec2::new(x, y).as_vec2() + 0.5) / side as f32))
            .map(|p| Splat {
                position: area.min.as_vec2() + p,
                radiance: Rgb::splat(1.0 / (side * side) as f32),
            })
            .collect();
        film.add_pass(0, None, &splats).unwrap();
        for value in red(&film) {
            assert!((value - 1.0).abs() < 2e-4, "{filter:?}: {value}");
        }
    }
}

#[test]
fn a_splat_near_the_border_is_what_it_is_inside() {
    for filter in FILTERS {
        let mut film = film(&settings(UVec2::splat(32), filter));
        let mut inside = film.clone();
        film.add_pass(0, None, &[splat(0.25, 0.75), splat(31.5, 31.75), splat(-0.25, 8.5)]).unwrap();
        inside.add_pass(0, None, &[splat(16.25, 16.75)]).unwrap();
        let (border, inside) = (red(&film), red(&inside));
        for y in 0..4 {
            for x in 0..4 {
                assert_eq!(border[y * 32 + x], inside[(16 + y) * 32 + 16 + x], "{filter:?} {x} {y}");
            }
        }
        // From outside the film a splat still reaches in, unless the filter is the box.
        assert_eq!(border[8 * 32] > 0.0, filter != Filter::Box);
        assert!(border[31 * 32 + 31] > 0.0);
    }
}

#[test]
fn the_box_is_one_pixel() {
    let mut film = film(&settings(UVec2::new(3, 2), Filter::Box));
    film.add_pass(0, None, &[splat(1.0, 0.0), splat(2.999, 1.999), splat(3.0, 0.0), splat(0.0, -1e-30)])
        .unwrap();
    assert_eq!(red(&film), [0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
}

#[test]
fn splats_are_divided_by_passes_and_added_to_samples() {
    let mut film = film(&settings(UVec2::splat(2), Filter::Box));
    let mut samples = film.new_pass();
    for pass in 0..4 {
        fill(&mut samples, pass, |_, _, _| Rgb::splat(3.0));
        let splats = if pass == 2 { vec![splat(0.5, 0.5)] } else { vec![] };
        film.add_pass(pass, Some(&samples), &splats).unwrap();
    }
    assert_eq!(red(&film), [3.25, 3.0, 3.0, 3.0]);
}

#[test]
fn splats_that_are_no_numbers_are_dropped_and_counted() {
    let mut film = film(&settings(UVec2::splat(4), Filter::Tent { radius: 1.0 }));
    let bad = Splat { radiance: Rgb::new(1.0, f32::NAN, 1.0), ..splat(2.5, 1.5) };
    let splats = [splat(f32::NAN, 1.0), bad, splat(1.5, f32::INFINITY), splat(1e30, -1e30)];
    film.add_pass(7, None, &splats).unwrap();
    assert_eq!(film.dropped().splats, 3);
    assert!(film.dropped().examples.iter().any(|e| (e.pass, e.x, e.y) == (7, 2, 1)));
    assert!(red(&film).iter().all(|&v| v == 0.0));
}
