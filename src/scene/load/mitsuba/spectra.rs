//! Spectra to linear Rec. 709 colours, as Mitsuba's RGB variants see them.
//!
//! A spectrum is integrated against the CIE 1931 matching functions, scaled so that the same value at all wavelengths has that luminance.
//! Emitted light is integrated as it is; what reflects is lit by D65, so that white reflects white.

use glam::{DMat3, DVec3};

/// The colour of emitted light and of reflection with the same spectrum. Neither is clamped: components may be negative, or above the
/// spectrum's greatest value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SpectrumColor {
    pub(super) emission: DVec3,
    pub(super) reflectance: DVec3,
}

/// Steps of the integrals, as many as Mitsuba takes, so that colours agree with its own.
const STEPS: usize = 1000;

/// From pairs of wavelength in nanometres and value, in ascending order; linear between them, 0 outside.
pub(super) fn from_samples(samples: &[(f64, f64)]) -> SpectrumColor {
    let at = |wavelength: f64| {
        let right = samples.partition_point(|(w, _)| *w < wavelength);
        match (right.checked_sub(1).and_then(|left| samples.get(left)), samples.get(right)) {
            (Some(&(w0, v0)), Some(&(w1, v1))) => v0 + (v1 - v0) * (wavelength - w0) / (w1 - w0),
            (None, Some(&(w, v))) if w == wavelength => v,
            _ => 0.0,
        }
    };
    integrate(at)
}

/// Of black bodies, in kelvin: with wavelengths in reach of single precision, so that nothing overflows.
pub(super) const TEMPERATURES: std::ops::RangeInclusive<f64> = 1.0..=1e9;

/// A black body of a temperature in kelvin: its spectral radiance in W / (m^2 sr nm) by Planck's law.
pub(super) fn black_body(temperature: f64) -> SpectrumColor {
    // Exact by definition of the SI: Planck's and Boltzmann's constants, the speed of light.
    const H: f64 = 6.626_070_15e-34;
    const K: f64 = 1.380_649e-23;
    const C: f64 = 299_792_458.0;
    integrate(|nanometres| {
        let wavelength = nanometres * 1e-9;
        let photon = H * C / (wavelength * K * temperature);
        2.0 * H * C * C / (wavelength.powi(5) * photon.exp_m1()) * 1e-9
    })
}

fn integrate(spectrum: impl Fn(f64) -> f64) -> SpectrumColor {
    let (first, last) = (FIRST, FIRST + 5.0 * (CIE.len() - 1) as f64);
    let step = |i: usize| first + (last - first) * i as f64 / (STEPS - 1) as f64;
    let (mut emission, mut reflectance) = (DVec3::ZERO, DVec3::ZERO);
    let (mut luminance, mut white) = (0.0, 0.0);
    for wavelength in (0..STEPS).map(step) {
        let x = (wavelength - first) / 5.0;
        let i = (x as usize).min(CIE.len() - 2);
        let at = |k: usize| CIE[i][k] + (CIE[i + 1][k] - CIE[i][k]) * (x - i as f64);
        let (matching, value) = (DVec3::new(at(0), at(1), at(2)), spectrum(wavelength));
        emission += matching * value;
        reflectance += matching * (value * at(3));
        luminance += matching.y;
        white += matching.y * at(3);
    }
    SpectrumColor {
        emission: FROM_XYZ * (emission / luminance),
        reflectance: FROM_XYZ * (reflectance / white),
    }
}

/// XYZ to linear Rec. 709 (ITU-R BT.709 primaries, D65).
const FROM_XYZ: DMat3 = DMat3::from_cols(
    DVec3::new(3.240_479, -0.969_256, 0.055_648),
    DVec3::new(-1.537_150, 1.875_991, -0.204_043),
    DVec3::new(-0.498_535, 0.041_556, 1.057_311),
);

/// Wavelength of the first row, nanometres.
const FIRST: f64 = 360.0;

/// Every 5 nm: the CIE 1931 colour-matching functions of the 2-degree observer (ISO/CIE 11664-1), and the relative power of the illuminant D65
/// (ISO/CIE 11664-2).
const CIE: [[f64; 4]; 95] = [
    [0.000_129_9, 0.000_003_917, 0.000_606_1, 46.638_3],
    [0.000_232_1, 0.000_006_965, 0.001_086, 49.363_7],
    [0.000_414_9, 0.000_012_39, 0.001_946, 52.089_1],
    [0.000_741_6, 0.000_022_02, 0.003_486, 51.032_3],
    [0.001_368, 0.000_039, 0.006_450_001, 49.975_5],
    [0.002_236, 0.000_064, 0.010_549_99, 52.311_8],
    [0.004_243, 0.000_12, 0.020_050_01, 54.648_2],
    [0.007_65, 0.000_217, 0.036_21, 68.701_5],
    [0.014_31, 0.000_396, 0.067_850_01, 82.754_9],
    [0.023_19, 0.000_64, 0.110_2, 87.120_4],
    [0.043_51, 0.001_21, 0.207_4, 91.486],
    [0.077_63, 0.002_18, 0.371_3, 92.458_9],
    [0.134_38, 0.004, 0.645_6, 93.431_8],
    [0.214_77, 0.007_3, 1.039_050_1, 90.057],
    [0.283_9, 0.011_6, 1.385_6, 86.682_3],
    [0.328_5, 0.016_84, 1.622_96, 95.773_6],
    [0.348_28, 0.023, 1.747_06, 104.865],
    [0.348_06, 0.029_8, 1.782_6, 110.936],
    [0.336_2, 0.038, 1.772_11, 117.008],
    [0.318_7, 0.048, 1.744_1, 117.41],
    [0.290_8, 0.06, 1.669_2, 117.812],
    [0.251_1, 0.073_9, 1.528_1, 116.336],
    [0.195_36, 0.090_98, 1.287_64, 114.861],
    [0.142_1, 0.112_6, 1.041_9, 115.392],
    [0.095_64, 0.139_02, 0.812_950_1, 115.923],
    [0.057_950_01, 0.169_3, 0.616_2, 112.367],
    [0.032_01, 0.208_02, 0.465_18, 108.811],
    [0.014_7, 0.258_6, 0.353_3, 109.082],
    [0.004_9, 0.323, 0.272, 109.354],
    [0.002_4, 0.407_3, 0.212_3, 108.578],
    [0.009_3, 0.503, 0.158_2, 107.802],
    [0.029_1, 0.608_2, 0.111_7, 106.296],
    [0.063_27, 0.71, 0.078_249_99, 104.79],
    [0.109_6, 0.793_2, 0.057_250_01, 106.239],
    [0.165_5, 0.862, 0.042_16, 107.689],
    [0.225_749_9, 0.914_850_1, 0.029_84, 106.047],
    [0.290_4, 0.954, 0.020_3, 104.405],
    [0.359_7, 0.980_3, 0.013_4, 104.225],
    [0.433_449_9, 0.994_950_1, 0.008_749_999, 104.046],
    [0.512_050_1, 1.0, 0.005_749_999, 102.023],
    [0.594_5, 0.995, 0.003_9, 100.0],
    [0.678_4, 0.978_6, 0.002_749_999, 98.167_1],
    [0.762_1, 0.952, 0.002_1, 96.334_2],
    [0.842_5, 0.915_4, 0.001_8, 96.061_1],
    [0.916_3, 0.87, 0.001_650_001, 95.788],
    [0.978_6, 0.816_3, 0.001_4, 92.236_8],
    [1.026_3, 0.757, 0.001_1, 88.685_6],
    [1.056_7, 0.694_9, 0.001, 89.345_9],
    [1.062_2, 0.631, 0.000_8, 90.006_2],
    [1.045_6, 0.566_8, 0.000_6, 89.802_6],
    [1.002_6, 0.503, 0.000_34, 89.599_1],
    [0.938_4, 0.441_2, 0.000_24, 88.648_9],
    [0.854_449_9, 0.381, 0.000_19, 87.698_7],
    [0.751_4, 0.321, 0.000_1, 85.493_6],
    [0.642_4, 0.265, 0.000_049_999_99, 83.288_6],
    [0.541_9, 0.217, 0.000_03, 83.493_9],
    [0.447_9, 0.175, 0.000_02, 83.699_2],
    [0.360_8, 0.138_2, 0.000_01, 81.863],
    [0.283_5, 0.107, 0.0, 80.026_8],
    [0.218_7, 0.081_6, 0.0, 80.120_7],
    [0.164_9, 0.061, 0.0, 80.214_6],
    [0.121_2, 0.044_58, 0.0, 81.246_2],
    [0.087_4, 0.032, 0.0, 82.277_8],
    [0.063_6, 0.023_2, 0.0, 80.281],
    [0.046_77, 0.017, 0.0, 78.284_2],
    [0.032_9, 0.011_92, 0.0, 74.002_7],
    [0.022_7, 0.008_21, 0.0, 69.721_3],
    [0.015_84, 0.005_723, 0.0, 70.665_2],
    [0.011_359_16, 0.004_102, 0.0, 71.609_1],
    [0.008_110_916, 0.002_929, 0.0, 72.979],
    [0.005_790_346, 0.002_091, 0.0, 74.349],
    [0.004_109_457, 0.001_484, 0.0, 67.976_5],
    [0.002_899_327, 0.001_047, 0.0, 61.604],
    [0.002_049_19, 0.000_74, 0.0, 65.744_8],
    [0.001_439_971, 0.000_52, 0.0, 69.885_6],
    [0.000_999_949_3, 0.000_361_1, 0.0, 72.486_3],
    [0.000_690_078_6, 0.000_249_2, 0.0, 75.087],
    [0.000_476_021_3, 0.000_171_9, 0.0, 69.339_8],
    [0.000_332_301_1, 0.000_12, 0.0, 63.592_7],
    [0.000_234_826_1, 0.000_084_8, 0.0, 55.005_4],
    [0.000_166_150_5, 0.000_06, 0.0, 46.418_2],
    [0.000_117_413, 0.000_042_4, 0.0, 56.611_8],
    [0.000_083_075_27, 0.000_03, 0.0, 66.805_4],
    [0.000_058_706_52, 0.000_021_2, 0.0, 65.094_1],
    [0.000_041_509_94, 0.000_014_99, 0.0, 63.382_8],
    [0.000_029_353_26, 0.000_010_6, 0.0, 63.843_4],
    [0.000_020_673_83, 0.000_007_465_7, 0.0, 64.304],
    [0.000_014_559_77, 0.000_005_257_8, 0.0, 61.877_9],
    [0.000_010_253_98, 0.000_003_702_9, 0.0, 59.451_9],
    [0.000_007_221_456, 0.000_002_607_8, 0.0, 55.705_4],
    [0.000_005_085_868, 0.000_001_836_6, 0.0, 51.959],
    [0.000_003_581_652, 0.000_001_293_4, 0.0, 54.699_8],
    [0.000_002_522_525, 0.000_000_910_93, 0.0, 57.440_6],
    [0.000_001_776_509, 0.000_000_641_53, 0.0, 58.876_5],
    [0.000_001_251_141, 0.000_000_451_81, 0.0, 60.312_5],
];

/// Inverse of the sRGB transfer function (IEC 61966-2-1).
pub(super) fn srgb_to_linear(c: f64) -> f64 {
    if c <= 0.04045 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// Computed by `mitsuba.spectrum_list_to_srgb` of Mitsuba 3.9.1, which clamps at 0.
    #[test]
    fn colours_are_those_of_mitsuba() {
        let three = [(400.0, 0.1), (500.0, 0.9), (700.0, 0.3)];
        for (samples, reflectance, emission) in [
            (&three[..], [0.439_400, 0.813_293, 0.504_598], [0.559_423, 0.773_073, 0.444_754]),
            (
                &[(360.0, 1.0), (830.0, 1.0)],
                [0.998_983, 0.998_872, 0.998_802],
                [1.204_883, 0.948_229, 0.909_267],
            ),
        ] {
            let color = from_samples(samples);
            // Mitsuba's D65 is normalised 0.1 % below white.
            assert!(color.reflectance.abs_diff_eq(DVec3::from(reflectance), 2e-3), "{color:?}");
            assert!(color.emission.abs_diff_eq(DVec3::from(emission), 5e-4), "{color:?}");
        }
    }

    /// At 6504 K a black body is nearly D65, the white of Rec. 709; colder ones are red, hotter ones blue. By Stefan and Boltzmann all the
    /// radiance together is 5.670374e-8 T^4 / pi.
    #[test]
    fn black_bodies_follow_planck() {
        let white = black_body(6504.0).emission;
        let white = white / white.y;
        assert!(white.abs_diff_eq(DVec3::ONE, 0.08), "{white}");
        let (red, blue) = (black_body(2000.0).emission, black_body(15000.0).emission);
        assert!(red.x > 2.0 * red.y && blue.z > 1.3 * blue.x);
        // Wien: at 5796 K the peak is at 500 nm; its height is 2 h c^2 / L^5 / (exp(4.965114) - 1).
        let samples: Vec<_> = (1..4000).map(|i| f64::from(i) * 5.0).collect();
        let planck = |nm: f64| {
            let x = 0.014_387_769 / (nm * 1e-9 * 5796.0);
            1.191_042_972e-16 / (nm * 1e-9_f64).powi(5) / x.exp_m1() * 1e-9
        };
        let total: f64 = samples.iter().map(|&nm| planck(nm) * 5.0).sum();
        assert!((total / (5.670_374e-8 * 5796.0_f64.powi(4) / PI) - 1.0).abs() < 2e-2);
        let tabulated: Vec<_> = samples.iter().map(|&nm| (nm, planck(nm))).collect();
        let (a, b) = (from_samples(&tabulated).emission, black_body(5796.0).emission);
        assert!(a.abs_diff_eq(b, 1e-4 * b.length()), "{a} {b}");
    }
}
