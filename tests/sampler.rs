//! The sampler: stratified within a stream, independent between streams, epochs and beyond the sequence's dimensions.
//!
//! Correlations are tested by z-score. Under independence the mean of n products (u - 1/2)(v - 1/2) has the standard
//! deviation 1 / (12 sqrt n); |z| > 5.5 has a chance of 3.8e-8, so that the at most 1000 tests here raise a false alarm
//! with a chance below 4e-5. All is computed from fixed seeds.

use helmholtz::sampling::Sampler;

const Z_LIMIT: f64 = 5.5;

/// Dimension set `set` of sample `index`.
fn block(seed: u64, stream: u64, index: u32, set: u32) -> [f32; 4] {
    Sampler::new(seed, stream, index).block(set)
}

/// z-score of the correlation of pairs, which are independent and uniform under the hypothesis.
fn correlation_z(pairs: impl Iterator<Item = (f32, f32)>) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0_f64);
    for (u, v) in pairs {
        sum += (f64::from(u) - 0.5) * (f64::from(v) - 0.5);
        n += 1.0;
    }
    12.0 * sum / n.sqrt()
}

fn assert_uncorrelated(pairs: impl Iterator<Item = (f32, f32)>, what: &str) {
    let z = correlation_z(pairs);
    assert!(z.abs() < Z_LIMIT, "{what}: z = {z}");
}

/// The greatest number of points in one cell of a grid of `columns` by `rows`.
fn fullest_cell(points: &[(f32, f32)], columns: usize, rows: usize) -> usize {
    let mut counts = vec![0; columns * rows];
    for &(x, y) in points {
        counts[(y * rows as f32) as usize * columns + (x * columns as f32) as usize] += 1;
    }
    counts.into_iter().max().unwrap_or(0)
}

/// The least t for which 2^m points are a (t, m, 2)-net: each elementary interval of area 2^(t-m) holds 2^t of them.
fn net_quality(points: &[(f32, f32)]) -> u32 {
    let m = points.len().trailing_zeros();
    let is_net = |t: u32| (0..=m - t).all(|k| fullest_cell(points, 1 << k, 1 << (m - t - k)) == 1 << t);
    (0..=m).find(|&t| is_net(t)).unwrap_or(m)
}

/// Choices are the same numbers, the first with the bits that f32 has no room for, of which each is 1 as often as 0.
#[test]
fn choices_are_the_block_with_more_bits() {
    let mut ones = [0_u32; 32];
    let count = 1 << 14;
    for stream in 0..count {
        for (index, set) in [(3, 0), (70_000, 40), (5, 1000)] {
            let sampler = Sampler::new(7, stream, index);
            let (first, rest) = sampler.choices(set);
            let [a, b, c, d] = sampler.block(set);
            assert_eq!(rest, [b, c, d]);
            let scaled = first * 4_294_967_296.0;
            assert!(scaled.fract() == 0.0 && (0.0..1.0).contains(&first));
            assert!((f64::from(a)..f64::from(a) + 1.0 / 8_388_608.0).contains(&first), "{first} {a}");
            let bits = scaled as u32;
            (0..32).for_each(|i| ones[i] += bits >> i & 1);
        }
    }
    let n = 3.0 * count as f64;
    for (i, ones) in ones.into_iter().enumerate() {
        let z = (f64::from(ones) - 0.5 * n) / (0.25 * n).sqrt();
        assert!(z.abs() < Z_LIMIT, "bit {i}: z = {z}");
    }
}

#[test]
fn numbers_are_in_the_unit_interval_and_repeatable() {
    for index in [0, 1, 65_535, 65_536, u32::MAX] {
        for stream in [0, 1, u64::MAX] {
            for set in 0..100 {
                let numbers = block(7, stream, index, set);
                assert!(numbers.iter().all(|u| (0.0..1.0).contains(u)));
                assert_eq!(numbers, block(7, stream, index, set));
            }
        }
    }
}

#[test]
fn each_dimension_is_stratified_over_indices() {
    // Also from an index that is a multiple of the number of points, and within a later epoch.
    for (stream, first) in [(0, 0), (1, 1024), (99, 65_536 + 3 * 1024)] {
        for set in [0, 1, 5, 40, 63] {
            let points: Vec<[f32; 4]> = (0..1024).map(|i| block(3, stream, first + i, set)).collect();
            for d in 0..4 {
                let projected: Vec<(f32, f32)> = points.iter().map(|p| (p[d], 0.0)).collect();
                assert_eq!(
                    fullest_cell(&projected, 1024, 1),
                    1,
                    "stream {stream}, dimension {}",
                    4 * set as usize + d
                );
            }
        }
    }
}

#[test]
fn first_block_is_a_net_in_its_pairs() {
    // The first two dimensions of Sobol' are a (0, m, 2)-net. The next two come from primitive polynomials of degrees 2 and 3, for
    // which the theory (Sobol' 1967) promises t <= (2 - 1) + (3 - 1). Owen's scrambling leaves t as it is.
    for stream in 0..4 {
        for m in [4, 6, 8, 10] {
            let points: Vec<[f32; 4]> = (0..1 << m).map(|i| block(11, stream, i, 0)).collect();
            let quality =
                |a: usize, b: usize| net_quality(&points.iter().map(|p| (p[a], p[b])).collect::<Vec<_>>());
            assert_eq!(quality(0, 1), 0, "stream {stream}, 2^{m} points");
            assert!(quality(2, 3) <= 3, "stream {stream}, 2^{m} points: t = {}", quality(2, 3));
        }
    }
}

#[test]
fn streams_are_independent() {
    // Neighbours in a row, in a column of an image 512 wide, and streams that differ in a high bit.
    for distance in [1, 2, 512, 1 << 33] {
        for set in [0, 3] {
            for index in [0, 1, 63] {
                for d in 0..4 {
                    let pairs = (0..16_384)
                        .map(|s| (block(5, s, index, set)[d], block(5, s + distance, index, set)[3 - d]));
                    assert_uncorrelated(
                        pairs,
                        &format!("streams at distance {distance}, set {set}, index {index}, dimension {d}"),
                    );
                    let pairs = (0..16_384)
                        .map(|s| (block(5, s, index, set)[d], block(5, s + distance, index, set)[d]));
                    assert_uncorrelated(
                        pairs,
                        &format!("streams at distance {distance}, set {set}, index {index}, dimension {d}"),
                    );
                }
            }
        }
    }
}

#[test]
fn seeds_are_independent() {
    for d in 0..4 {
        let pairs = (0..16_384).map(|seed| (block(seed, 9, 17, 1)[d], block(seed + 1, 9, 17, 1)[d]));
        assert_uncorrelated(pairs, &format!("seeds, dimension {d}"));
        // (seed, stream) and (stream, seed) must not be the same sampler.
        let pairs = (0..16_384).map(|k| (block(k, k + 1, 17, 1)[d], block(k + 1, k, 17, 1)[d]));
        assert_uncorrelated(pairs, &format!("seeds and streams exchanged, dimension {d}"));
    }
}

#[test]
fn epochs_of_a_stream_are_independent() {
    for d in 0..4 {
        for epochs in [1, 2, 0xffff] {
            let pairs = (0..16_384).map(|s| (block(2, s, 5, 0)[d], block(2, s, 5 + (epochs << 16), 0)[d]));
            assert_uncorrelated(pairs, &format!("{epochs} epochs apart, dimension {d}"));
            // Epoch e of a stream must not be another epoch of a neighbour.
            let pairs =
                (0..16_384).map(|s| (block(2, s + 1, 5, 0)[d], block(2, s, 5 + (epochs << 16), 0)[d]));
            assert_uncorrelated(pairs, &format!("{epochs} epochs apart in the next stream, dimension {d}"));
        }
    }
}

#[test]
fn blocks_of_a_sample_are_uncorrelated_over_streams() {
    // Within a stream some pairs of Sobol' dimensions (15 and 40, say) are badly distributed together at 64 points. Scrambling
    // makes that noise, not bias: over the streams every pair must be uncorrelated.
    for (a, b) in [
        ((3, 3), (10, 0)),
        ((0, 2), (9, 1)),
        ((0, 3), (10, 3)),
        ((1, 0), (9, 3)),
        ((63, 3), (64, 0)),
        ((64, 1), (65, 1)),
    ] {
        let pairs = (0..16_384).map(|s| (block(4, s, 21, a.0)[a.1], block(4, s, 21, b.0)[b.1]));
        assert_uncorrelated(pairs, &format!("dimensions {a:?} and {b:?}"));
    }
}

#[test]
fn dimensions_beyond_the_sequence_are_independent() {
    const BEYOND: u32 = 64;
    for (a, b) in [(0, 1), (0, 3), (1, 2), (2, 3)] {
        let over_indices = (0..16_384).map(|i| block(8, 3, i, BEYOND)).map(|v| (v[a], v[b]));
        assert_uncorrelated(over_indices, &format!("dimensions {a} and {b} of a block"));
        let next_index = (0..16_384).map(|i| (block(8, 3, i, BEYOND)[a], block(8, 3, i + 1, BEYOND)[b]));
        assert_uncorrelated(next_index, &format!("dimensions {a} and {b} of neighbouring indices"));
        let next_block = (0..16_384).map(|i| (block(8, 3, i, BEYOND)[a], block(8, 3, i, BEYOND + 1)[b]));
        assert_uncorrelated(next_block, &format!("dimensions {a} and {b} of neighbouring blocks"));
        let next_stream = (0..16_384).map(|s| (block(8, s, 0, BEYOND)[a], block(8, s + 1, 0, BEYOND)[b]));
        assert_uncorrelated(next_stream, &format!("dimensions {a} and {b} of neighbouring streams"));
        let next_epoch = (0..16_384).map(|i| (block(8, 3, i, BEYOND)[a], block(8, 3, i + 65_536, BEYOND)[b]));
        assert_uncorrelated(next_epoch, &format!("dimensions {a} and {b} of neighbouring epochs"));
    }
}

#[test]
fn every_dimension_is_uniform_over_streams() {
    // Pearson's statistic of 64 bins has mean 63 and variance 126; 63 + 8 sqrt(126) has a chance below 1e-10.
    for (set, index) in [(0, 0), (0, 65_536), (7, 100), (63, 65_535), (64, 0), (100, 7)] {
        let mut counts = [[0_u32; 64]; 4];
        for stream in 0..32_768 {
            for (d, u) in block(6, stream, index, set).into_iter().enumerate() {
                counts[d][(u * 64.0) as usize] += 1;
            }
        }
        for (d, bins) in counts.iter().enumerate() {
            let statistic: f64 = bins.iter().map(|&n| (f64::from(n) - 512.0).powi(2) / 512.0).sum();
            assert!(
                statistic < 63.0 + 8.0 * 126_f64.sqrt(),
                "set {set}, index {index}, dimension {d}: {statistic}"
            );
        }
    }
}
