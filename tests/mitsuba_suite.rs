//! Scenes of Mitsuba's own renders test suite against the reference images that come with them.
//!
//! As Mitsuba's test does it: a pixel's difference from the reference in units of its standard error (from the variance of one sample, which comes with the
//! reference) has a p-value, and Sidak's correction for the number of pixels says which is too small at 1 %. That is done in XYZ: the variances were
//! estimated there and turned into RGB as if they were colours (`test_renders.py`), so that only the way back makes variances of them. References
//! are noisy themselves and variances are estimates, so a quarter of a percent of the values may fail, as there. Where the variance is nearly 0
//! any rounding is many errors: differences below a thousandth of the image's mean count for none, and [`SUM_ROUNDING`] is allowed. The mean over
//! the image is compared too, by 5 errors plus that thousandth: a false alarm has a chance below 1e-6 there.

use std::path::{Path, PathBuf};

use helmholtz::film::{AovSet, Film};
use helmholtz::integrators::Integrator;
use helmholtz::query::RayQuery;
use helmholtz::render::{Control, Stop, Target, render};
use helmholtz::scene::Scene;
use helmholtz::scene::load::{LoadOptions, load};
use helmholtz::transport::World;

use crate::backends::{BackendTest, on_each_backend};
use crate::statistics::{erfc, sidak};
use crate::support::exr_channels;

/// Folder, scene, reference.
const SCENES: &[(&str, &str, &str)] = &[
    ("bsdf_spheres", "test_arealight_path", "test_arealight"),
    ("bsdf_spheres", "test_constant_path", "test_constant"),
    ("bsdf_spheres", "test_roughdielectric_path", "test_roughdielectric"),
    ("bsdf_spheres", "test_roughplastic_linear_path", "test_roughplastic_linear"),
    ("bsdf_spheres", "test_textured_diffuse_path", "test_textured_diffuse"),
    ("floating_sphere", "test_directional_direct", "test_directional"),
    ("instancing", "test_instancing_path", "test_instancing"),
    ("mesh_attributes", "test_mesh_attributes_3_vertex_direct", "test_mesh_attributes_3_vertex"),
    ("orthographic_sensor", "test_orthographic_path", "test_orthographic"),
];

const SPP: u32 = 128;
const SIGNIFICANCE: f64 = 0.01;
/// Of the values of an image that may be rejected, as in Mitsuba's test.
const TOLERATED: f64 = 0.0025;

/// R, G and B of a file.
fn channels(path: &Path) -> Vec<Vec<f32>> {
    let all = exr_channels(path);
    let named = |name| all.iter().find(|(own, _)| own == name).expect("R, G and B").1.clone();
    ["R", "G", "B"].into_iter().map(named).collect()
}

/// References are sums of 32,000 samples in `f32`. Of equal samples, whose roundings all go one way, such a sum has a relative error of at most this; the
/// floor of `test_directional`, which is exactly 1 / pi, has 6.1e-4.
const SUM_ROUNDING: f64 = 32_000.0 / 33_554_432.0;

/// From linear sRGB to XYZ as Mitsuba's `Bitmap` does it.
fn to_xyz(rgb: &[Vec<f32>]) -> Vec<Vec<f64>> {
    const ROWS: [[f64; 3]; 3] = [
        [0.412_453, 0.357_580, 0.180_423],
        [0.212_671, 0.715_160, 0.072_169],
        [0.019_334, 0.119_193, 0.950_227],
    ];
    let row = |row: [f64; 3]| {
        let value = |i: usize| (0..3).map(|c| row[c] * f64::from(rgb[c][i])).sum::<f64>();
        (0..rgb[0].len()).map(value).collect::<Vec<_>>()
    };
    ROWS.into_iter().map(row).collect()
}

struct Case<'a> {
    name: &'a str,
    scene: &'a Scene,
    /// X, Y and Z of every pixel.
    reference: &'a [Vec<f64>],
    variance: &'a [Vec<f64>],
}

impl BackendTest for Case<'_> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let world = World::new(self.scene);
        let settings = &self.scene.integrator;
        let name = settings.name.as_deref().expect("the scenes name their integrator");
        let integrator = Integrator::new(name, &settings.parameters).expect("a known integrator");
        let mut film =
            Film::new(&self.scene.film, AovSet::default(), world.lights.radiance_unit()).expect("a film");
        let stop = Stop { passes: 0..SPP, time: None };
        render(&world, query, &Target { integrator, seed: 1 }, &mut film, &stop, |_| Control::Continue)
            .expect("rendered");
        let image = film.develop();
        let mut rejected = 0;
        let mut total = 0;
        let ours = ["R", "G", "B"].map(|channel| image.floats(channel).expect("a colour").to_vec());
        let ours = to_xyz(&ours);
        for (channel, name) in ["X", "Y", "Z"].iter().enumerate() {
            let (ours, reference, variance) =
                (&ours[channel], &self.reference[channel], &self.variance[channel]);
            assert_eq!(ours.len(), reference.len(), "{}", self.name);
            let count = ours.len() as f64;
            let mean = |values: &[f64]| values.iter().sum::<f64>() / count;
            let trifle = 1e-3 * mean(reference);
            let limit = sidak(SIGNIFICANCE, 3 * ours.len());
            for ((&a, &b), &v) in ours.iter().zip(reference).zip(variance) {
                let difference = ((a - b).abs() - b * SUM_ROUNDING).max(0.0);
                let error = (v.max(0.0) / f64::from(SPP)).sqrt();
                let p_value = erfc(difference / error.max(f64::MIN_POSITIVE) / std::f64::consts::SQRT_2);
                rejected += usize::from(difference > trifle && p_value < limit);
            }
            total += ours.len();
            let variance = variance.iter().map(|v| v.max(0.0)).sum::<f64>() / count;
            let error = (variance / f64::from(SPP) / count).sqrt();
            let difference = (mean(ours) - mean(reference)).abs();
            // The reference has an error of the same kind.
            assert!(
                difference < 5.0 * error * std::f64::consts::SQRT_2 + trifle,
                "{} on {backend}: mean {} of {name}, but the reference has {} (error {error})",
                self.name,
                mean(ours),
                mean(reference),
            );
        }
        let share = rejected as f64 / total as f64;
        assert!(share <= TOLERATED, "{} on {backend}: {rejected} of {total} values are rejected", self.name);
    }
}

#[test]
fn mitsubas_suite_is_rendered_as_its_references() {
    let root =
        PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/testdata/mitsuba-suite/tests/scenes"));
    if !root.exists() {
        eprintln!("skipped: {} is absent", root.display());
        return;
    }
    let mut failures = Vec::new();
    for (folder, scene, reference) in SCENES {
        let found = load(&root.join(folder).join(format!("{scene}.xml")), &LoadOptions::default());
        let loaded = found.unwrap_or_else(|error| panic!("{error}")).scene;
        let refs = root.join(folder).join("refs");
        let image = to_xyz(&channels(&refs.join(format!("{reference}_ref_rgb.exr"))));
        let variance = to_xyz(&channels(&refs.join(format!("{reference}_ref_rgb_var.exr"))));
        let case = Case { name: scene, scene: &loaded, reference: &image, variance: &variance };
        let run = std::panic::AssertUnwindSafe(|| on_each_backend(&loaded.shapes, &case));
        if std::panic::catch_unwind(run).is_err() {
            failures.push(*scene);
        }
    }
    assert!(failures.is_empty(), "these differ from their references: {}", failures.join(", "));
}
