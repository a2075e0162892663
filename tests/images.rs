//! Images as statistics: independent runs of a render, and the comparison of two such sets by blocks of 8x8 pixels and as a whole.
//!
//! With [`RUNS`] runs on both sides the difference of two means in units of its error follows Student's t with at least 15 degrees of freedom:
//! 9.5 is exceeded with a chance below 1.0e-7, 6 with 2.4e-5. With 64 runs it is t with at least 63, and 5.5 is exceeded with a chance below 1e-6.
//! Blocks cannot see a bias that is everywhere the same and small; the mean over the image can.

use std::ops::Range;

use helmholtz::film::{AovSet, Film};
use helmholtz::integrators::Integrator;
use helmholtz::query::RayQuery;
use helmholtz::render::{Control, Stop, Target, render};
use helmholtz::scene::Scene;
use helmholtz::transport::World;

pub(crate) const RUNS: usize = 16;
const BLOCK: usize = 8;

pub(crate) type Pixels = Vec<[f32; 3]>;

/// Renders one image for each seed and expects that no sample is dropped.
pub(crate) fn render_runs<Q: RayQuery>(
    scene: &Scene,
    world: &World,
    query: &Q,
    integrator: Integrator,
    seeds: Range<u64>,
    passes: u32,
) -> Vec<Pixels> {
    seeds
        .map(|seed| {
            let unit = world.lights.radiance_unit();
            let mut film = Film::new(&scene.film, AovSet::default(), unit).expect("a film");
            let stop = Stop { passes: 0..passes, time: None };
            let target = Target { integrator, seed };
            render(world, query, &target, &mut film, &stop, |_| Control::Continue).expect("rendered");
            assert!(film.dropped().is_none(), "dropped samples: {:?}", film.dropped());
            let image = film.develop();
            let [r, g, b] = ["R", "G", "B"].map(|c| image.floats(c).expect("a colour").to_vec());
            (0..r.len()).map(|i| [r[i], g[i], b[i]]).collect()
        })
        .collect()
}

/// A mean and its standard error.
pub(crate) type Mean = (f64, f64);

/// Means of blocks and of the image, with their standard errors; channels interleaved.
pub(crate) struct Estimate {
    pub(crate) blocks: Vec<Mean>,
    pub(crate) image: Vec<Mean>,
}

pub(crate) fn mean_and_error(values: impl ExactSizeIterator<Item = f64> + Clone) -> Mean {
    let n = values.len() as f64;
    let mean = values.clone().sum::<f64>() / n;
    let variance = values.map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    (mean, (variance / n).sqrt())
}

/// Means over blocks of one image, rows from the top, channels interleaved.
fn block_means(image: &[[f32; 3]], width: usize) -> Vec<f64> {
    let height = image.len() / width;
    let mut means = Vec::new();
    for top in (0..height).step_by(BLOCK) {
        for left in (0..width).step_by(BLOCK) {
            let (bottom, right) = ((top + BLOCK).min(height), (left + BLOCK).min(width));
            let pixels = (top..bottom).flat_map(|y| &image[y * width + left..y * width + right]);
            let sums =
                pixels.fold([0.0; 3], |sums, pixel| std::array::from_fn(|c| sums[c] + f64::from(pixel[c])));
            means.extend(sums.map(|sum: f64| sum / ((bottom - top) * (right - left)) as f64));
        }
    }
    means
}

pub(crate) fn estimate(images: &[Vec<[f32; 3]>], width: usize) -> Estimate {
    let blocks: Vec<Vec<f64>> = images.iter().map(|image| block_means(image, width)).collect();
    let totals: Vec<[f64; 3]> = images
        .iter()
        .map(|image| {
            std::array::from_fn(|c| image.iter().map(|p| f64::from(p[c])).sum::<f64>() / image.len() as f64)
        })
        .collect();
    Estimate {
        blocks: (0..blocks[0].len()).map(|i| mean_and_error(blocks.iter().map(|b| b[i]))).collect(),
        image: (0..3).map(|c| mean_and_error(totals.iter().map(|t| t[c]))).collect(),
    }
}

impl Estimate {
    /// What differs by more than `image_limit` or `block_limit` errors.
    pub(crate) fn differences(
        &self,
        other: &Self,
        what: &str,
        image_limit: f64,
        block_limit: f64,
    ) -> Vec<String> {
        let mut all = differences(&format!("{what}, image channel"), &self.image, &other.image, image_limit);
        all.extend(differences(&format!("{what}, block value"), &self.blocks, &other.blocks, block_limit));
        all
    }
}

fn differences(what: &str, ours: &[Mean], theirs: &[Mean], limit: f64) -> Vec<String> {
    assert_eq!(ours.len(), theirs.len());
    // Where neither has any variance (an even background), rounding is left.
    let brightest = theirs.iter().fold(0.0_f64, |b, (mean, _)| b.max(mean.abs()));
    let rounding = 1e-5 * brightest;
    let differ = |(i, (a, b)): (usize, (&Mean, &Mean))| {
        let error = a.1.hypot(b.1);
        let excess = (a.0 - b.0).abs() - rounding;
        (excess > limit * error).then(|| {
            let t = (a.0 - b.0) / error;
            format!("{what} {i}: {:.6} but expected {:.6}, {t:.1} errors apart", a.0, b.0)
        })
    };
    ours.iter().zip(theirs).enumerate().filter_map(differ).collect()
}
