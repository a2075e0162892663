//! Warps and discrete distributions, against the densities they state.

use glam::{Vec2, Vec3};
use helmholtz::sampling::discrete::AliasTable;
use helmholtz::sampling::warp;
use std::f64::consts::TAU;

use super::statistics::{FALSE_ALARM_RATE, Family, Random, SphereChart, chi_squared, chi_squared_on_sphere};

const SAMPLES: u64 = 1 << 19;

#[test]
fn sphere_and_hemisphere_follow_their_densities() {
    let mut random = Random::new(101);
    let mut family = Family::default();
    // An axis that is not the warp's own.
    for axis in [Vec3::Z, Vec3::new(0.48, -0.6, 0.64)] {
        let chart = SphereChart::equal_area(axis);
        let sphere = || Some(warp::square_to_sphere(random.uniform_2d()));
        let test = chi_squared_on_sphere(&chart, SAMPLES, sphere, |_| f64::from(warp::UNIFORM_SPHERE_PDF));
        assert!((test.integral - 1.0).abs() < 1e-4);
        family.record(format!("sphere about {axis}"), test.p_value);
        let hemisphere = || Some(warp::square_to_cosine_hemisphere(random.uniform_2d()));
        let density = |d: Vec3| f64::from(warp::cosine_hemisphere_pdf(d.z));
        let test = chi_squared_on_sphere(&chart, SAMPLES, hemisphere, density);
        assert!((test.integral - 1.0).abs() < 1e-3);
        family.record(format!("hemisphere about {axis}"), test.p_value);
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// Uniform on disc and triangle: cells of equal area are equally full.
#[test]
fn disc_and_triangle_are_uniform() {
    const N: usize = 20;
    let mut random = Random::new(102);
    let mut family = Family::default();
    let index = |x: f64| ((x * N as f64) as usize).min(N - 1);
    let mut uniform = |name: &str, cell: &dyn Fn(Vec2) -> (f64, f64)| {
        let mut counts = vec![0_u64; N * N];
        for _ in 0..SAMPLES {
            let (s, t) = cell(random.uniform_2d());
            assert!((0.0..=1.0 + 1e-6).contains(&s) && (0.0..=1.0 + 1e-6).contains(&t), "{name}: {s} {t}");
            counts[index(s) * N + index(t)] += 1;
        }
        family.record(name, chi_squared(&counts, &vec![SAMPLES as f64 / (N * N) as f64; N * N]));
    };
    uniform("disc", &|u| {
        let d = warp::square_to_disc(u).as_dvec2();
        (d.length_squared(), (d.y.atan2(d.x) / TAU).rem_euclid(1.0))
    });
    // For barycentric coordinates b1, b2: (1 - b0)^2 and b1 / (b1 + b2) are uniform and independent.
    uniform("triangle", &|u| {
        let b = warp::square_to_triangle(u).as_dvec2();
        let sum = b.x + b.y;
        (sum * sum, if sum > 0.0 { b.x / sum } else { 0.5 })
    });
    family.assert_accepted(FALSE_ALARM_RATE);
}

#[test]
fn warps_stay_in_range_at_the_corners() {
    let ends = [0.0, f32::MIN_POSITIVE, 0.5, 1.0 - f32::EPSILON / 2.0];
    for u in ends.iter().flat_map(|&x| ends.map(|y| Vec2::new(x, y))) {
        assert!(warp::square_to_disc(u).length() <= 1.0 + 1e-6);
        let d = warp::square_to_cosine_hemisphere(u);
        assert!(
            d.z > 0.0 && (d.length() - 1.0).abs() < 1e-6 && warp::cosine_hemisphere_pdf(d.z) > 0.0,
            "{u}: {d}"
        );
        assert!((warp::square_to_sphere(u).length() - 1.0).abs() < 1e-6);
        let b = warp::square_to_triangle(u);
        assert!(b.min_element() >= 0.0 && b.x + b.y <= 1.0, "{u}: {b}");
    }
}

#[test]
fn alias_table_draws_by_weight() {
    let mut random = Random::new(103);
    let mut family = Family::default();
    let sets: [(&str, Vec<f64>); 4] = [
        ("one", vec![3.0]),
        ("equal", vec![1e300; 17]),
        ("linear with zeros", (0..100_u32).map(|i| f64::from(i % 10)).collect()),
        ("12 decades", (0..25).map(|i| 10.0_f64.powf(f64::from(i) / 2.0 - 6.0)).collect()),
    ];
    for (name, weights) in sets {
        let table = AliasTable::new(&weights).expect("valid weights");
        let greatest = weights.iter().copied().fold(0.0, f64::max);
        let total: f64 = weights.iter().map(|w| w / greatest).sum();
        let mut counts = vec![0_u64; weights.len()];
        for _ in 0..SAMPLES {
            counts[table.sample(random.uniform_f64())] += 1;
        }
        let probabilities: Vec<f64> = weights.iter().map(|w| w / greatest / total).collect();
        for (i, p) in probabilities.iter().enumerate() {
            assert!((f64::from(table.pdf(i)) - p).abs() <= 1e-6 * p, "{name} {i}");
        }
        let expected: Vec<f64> = probabilities.iter().map(|p| p * SAMPLES as f64).collect();
        // Where nothing is expected one draw makes the p-value 0.
        family.record(name, chi_squared(&counts, &expected));
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// Every number in [0, 1) of a fine grid, ends included, avoids the zeros wherever they stand.
#[test]
fn alias_table_never_draws_zero_weights() {
    for weights in
        [vec![0.0, 1.0], vec![1.0, 0.0], vec![0.0, 0.1, 0.0, 0.2, 0.7, 0.0], vec![1e-12, 0.0, 1.0, 1e-6, 0.0]]
    {
        let table = AliasTable::new(&weights).expect("valid weights");
        for i in 0..1_u32 << 24 {
            if i.is_multiple_of(63) || !(100..(1 << 24) - 100).contains(&i) {
                let index = table.sample(f64::from(i) / 16_777_216.0);
                assert!(weights[index] > 0.0, "{weights:?} drew {index} at {i}");
            }
        }
    }
}

/// Of two million indices with weights between 0.5 and 1, each is drawn as often as it should by numbers of 32 bits: those of the lighter half together get their share.
/// With 23 bits, four numbers for each bin, they would get an eighth more.
#[test]
fn alias_tables_of_millions_keep_their_probabilities() {
    let n = 1_u32 << 21;
    let weights: Vec<f64> = (0..n).map(|i| 0.5 + 0.5 * f64::from(i) / f64::from(n)).collect();
    let table = AliasTable::new(&weights).expect("valid weights");
    let lighter: f64 = weights[..n as usize / 2].iter().sum::<f64>() / weights.iter().sum::<f64>();
    let mut random = Random::new(104);
    let draws = 4_000_000;
    let found = (0..draws).filter(|_| table.sample(random.uniform_f64()) < n as usize / 2).count();
    let expected = f64::from(draws) * lighter;
    let z = (found as f64 - expected) / (expected * (1.0 - lighter)).sqrt();
    // A chance of 4e-8.
    assert!(z.abs() < 5.5, "{found} of {expected}: {z}");
}

#[test]
fn alias_table_refuses_invalid_weights() {
    for weights in [&[][..], &[0.0], &[1.0, -1.0], &[f64::NAN], &[1.0, f64::INFINITY]] {
        assert!(AliasTable::new(weights).is_none(), "{weights:?}");
    }
    // A subnormal greatest weight: 1 / greatest would overflow.
    let table = AliasTable::new(&[5e-324, 0.0]).expect("valid weights");
    assert_eq!((table.sample(0.9), table.pdf(0), table.len(), table.is_empty()), (0, 1.0, 2, false));
}
