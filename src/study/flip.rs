//! FLIP: how different two images look when a person flips between them (Andersson et al. 2020, "FLIP: a difference evaluator for alternating
//! images"), and its form for high dynamic range (Andersson et al. 2021, "Visualizing errors in rendered high dynamic range images"), which is the worst
//! over a range of exposures. 0 is no difference, 1 the greatest. Written here because the crate there is wraps C++ and lacks the second form.

use glam::{Mat3, Vec3};
use rayon::prelude::*;

use super::picture::Picture;

/// Pixels per degree of the viewing angle: a screen 0.7 m wide with 3840 pixels seen from 0.7 m, as the authors have it.
const PIXELS_PER_DEGREE: f32 = 0.7 * (3840.0 / 0.7) * (std::f32::consts::PI / 180.0);

/// Linear Rec. 709 to XYZ, by rows, and the white that it makes.
const TO_XYZ: [Vec3; 3] = [
    Vec3::new(10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0),
    Vec3::new(2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0),
    Vec3::new(1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0),
];

/// Mean FLIP of two pictures of one size, low dynamic range: colours are clamped to [0, 1]. What is not finite counts as black.
pub fn ldr(reference: &Picture, image: &Picture) -> f64 {
    let clamped = |p: &Picture| Plane::of(p, p.pixels.iter().map(|&c| sound(c).min(Vec3::ONE)).collect());
    mean(&errors(&clamped(reference), &clamped(image)))
}

/// Mean FLIP of two pictures of one size, high dynamic range: each pixel's worst over exposures from one that shows the
/// reference's brightest to one that shows its median, through a film curve.
pub fn hdr(reference: &Picture, image: &Picture) -> f64 {
    let (first, last) = exposures(reference);
    let count = ((last - first).ceil() as u32).max(2);
    let mut worst = vec![0.0_f32; reference.pixels.len()];
    for i in 0..count {
        let scale = (first + (last - first) * i as f32 / (count - 1) as f32).exp2();
        let exposed =
            |p: &Picture| Plane::of(p, p.pixels.iter().map(|&c| film_curve(sound(c) * scale)).collect());
        for (worst, error) in worst.iter_mut().zip(errors(&exposed(reference), &exposed(image))) {
            *worst = worst.max(error);
        }
    }
    mean(&worst)
}

fn sound(colour: Vec3) -> Vec3 {
    if colour.is_finite() { colour.max(Vec3::ZERO) } else { Vec3::ZERO }
}

fn mean(errors: &[f32]) -> f64 {
    errors.iter().map(|&e| f64::from(e)).sum::<f64>() / errors.len().max(1) as f64
}

/// Coefficients of the film curve `(a x^2 + b x) / (c x^2 + d x + e)` (Narkowicz's fit to ACES, with its exposure of 0.6).
const CURVE: [f32; 5] = [0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14];

fn film_curve(x: Vec3) -> Vec3 {
    let [a, b, c, d, e] = CURVE;
    ((x * x * a + x * b) / (x * x * c + x * d + e)).clamp(Vec3::ZERO, Vec3::ONE)
}

/// Binary logarithms of the exposures that take the greatest and the median luminance to 0.85.
fn exposures(reference: &Picture) -> (f32, f32) {
    const SHOWN: f32 = 0.85;
    let [a, b, c, d, e] = CURVE;
    let (p, q, r) = (a - SHOWN * c, b - SHOWN * d, -SHOWN * e);
    let x = ((q * q - 4.0 * p * r).sqrt() - q) / (2.0 * p);
    let mut luminances: Vec<f32> = reference.pixels.iter().map(|&c| TO_XYZ[1].dot(sound(c))).collect();
    luminances.sort_by(f32::total_cmp);
    let n = luminances.len();
    let at = |i: usize| luminances.get(i).copied().unwrap_or_default().max(1e-10);
    // Of an even number, the authors' program takes the upper of the two in the middle.
    ((x / at(n.max(1) - 1)).log2(), (x / at(n / 2)).log2())
}

/// Vectors over the pixels of an image.
struct Plane {
    width: usize,
    values: Vec<Vec3>,
}

impl Plane {
    fn of(picture: &Picture, values: Vec<Vec3>) -> Self {
        Self { width: picture.size.x as usize, values }
    }

    fn map(&self, f: impl Fn(Vec3) -> Vec3 + Sync) -> Self {
        Self { width: self.width, values: self.values.par_iter().map(|&v| f(v)).collect() }
    }

    /// Filtered along x, then along y, by weights that are symmetric in number about 0; beyond the border lies the border.
    fn filter(&self, along_x: &[Vec3], along_y: &[Vec3]) -> Self {
        let (width, height) = (self.width as isize, (self.values.len() / self.width) as isize);
        let pass = |source: &[Vec3], weights: &[Vec3], (dx, dy): (isize, isize)| -> Vec<Vec3> {
            let reach = (weights.len() / 2) as isize;
            let at = |i: usize| {
                let (x, y) = (i as isize % width, i as isize / width);
                let term = |(k, weight): (usize, &Vec3)| {
                    let step = k as isize - reach;
                    let (x, y) = ((x + dx * step).clamp(0, width - 1), (y + dy * step).clamp(0, height - 1));
                    *weight * source[(y * width + x) as usize]
                };
                weights.iter().enumerate().map(term).sum()
            };
            (0..source.len()).into_par_iter().map(at).collect()
        };
        let rows = pass(&self.values, along_x, (1, 0));
        Self { width: self.width, values: pass(&rows, along_y, (0, 1)) }
    }
}

/// FLIP of each pixel of two planes of linear colours in [0, 1].
fn errors(reference: &Plane, image: &Plane) -> Vec<f32> {
    let (reference, image) = (reference.map(to_opponent), image.map(to_opponent));
    let to_rgb = Mat3::from_cols_array_2d(&TO_XYZ.map(|row| row.to_array())).transpose().inverse();
    let colours = |plane: &Plane| {
        blur(plane).map(|v| hunt(to_lab(from_opponent(v, &to_rgb).clamp(Vec3::ZERO, Vec3::ONE))))
    };
    let (a, b) = (colours(&reference), colours(&image));
    let features = |plane: &Plane| detect(&plane.map(|v| Vec3::splat((v.x + 16.0) / 116.0)));
    let (f, g) = (features(&reference), features(&image));
    let greatest = hyab(hunt(to_lab(Vec3::Y)), hunt(to_lab(Vec3::Z))).powf(COLOUR_POWER);
    let pixel = |i: usize| {
        let colour = redistribute(hyab(a.values[i], b.values[i]).powf(COLOUR_POWER), greatest);
        let (f, g) = (f[i], g[i]);
        let feature = (f[0] - g[0]).abs().max((f[1] - g[1]).abs());
        let feature = (feature * std::f32::consts::FRAC_1_SQRT_2).sqrt();
        colour.powf(1.0 - feature)
    };
    (0..a.values.len()).into_par_iter().map(pixel).collect()
}

const COLOUR_POWER: f32 = 0.7;

/// Maps colour errors up to `greatest` to [0, 1], small ones more finely.
fn redistribute(error: f32, greatest: f32) -> f32 {
    const SHARE: f32 = 0.4;
    const MAPPED: f32 = 0.95;
    let knee = SHARE * greatest;
    if error < knee {
        MAPPED / knee * error
    } else {
        MAPPED + (error - knee) / (greatest - knee) * (1.0 - MAPPED)
    }
}

fn to_xyz(rgb: Vec3) -> Vec3 {
    Vec3::from_array(TO_XYZ.map(|row| row.dot(rgb)))
}

fn white() -> Vec3 {
    to_xyz(Vec3::ONE)
}

/// The linear opponent space Y Cx Cz.
fn to_opponent(rgb: Vec3) -> Vec3 {
    let v = to_xyz(rgb) / white();
    Vec3::new(116.0 * v.y - 16.0, 500.0 * (v.x - v.y), 200.0 * (v.y - v.z))
}

fn from_opponent(v: Vec3, to_rgb: &Mat3) -> Vec3 {
    let y = (v.x + 16.0) / 116.0;
    to_rgb * (Vec3::new(y + v.y / 500.0, y, y - v.z / 200.0) * white())
}

fn to_lab(rgb: Vec3) -> Vec3 {
    const DELTA: f32 = 6.0 / 29.0;
    let f = |t: f32| {
        if t > DELTA * DELTA * DELTA { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 }
    };
    let v = to_xyz(rgb) / white();
    let (x, y, z) = (f(v.x), f(v.y), f(v.z));
    Vec3::new(116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z))
}

/// Colours seem paler in the dark (the Hunt effect).
fn hunt(lab: Vec3) -> Vec3 {
    lab * Vec3::new(1.0, 0.01 * lab.x, 0.01 * lab.x)
}

/// The distance for large colour differences of Abasi et al. 2020.
fn hyab(a: Vec3, b: Vec3) -> f32 {
    let d = a - b;
    d.x.abs() + d.y.hypot(d.z)
}

/// Blurs by the eye's contrast sensitivity: sums of Gaussians in space, two of them for the last channel.
fn blur(plane: &Plane) -> Plane {
    use std::f32::consts::PI;
    /// Weights and widths of the channels' Gaussians, in the frequency domain.
    const TERMS: [[Vec3; 2]; 2] = [
        [Vec3::new(1.0, 1.0, 34.1), Vec3::new(0.0047, 0.0053, 0.04)],
        [Vec3::new(0.0, 0.0, 13.5), Vec3::new(1e-5, 1e-5, 0.025)],
    ];
    let reach = (3.0 * (0.04 / (2.0 * PI * PI)).sqrt() * PIXELS_PER_DEGREE).ceil() as i32;
    let kernel = |b: Vec3| -> Vec<Vec3> {
        let weight = |k: i32| {
            let d = k as f32 / PIXELS_PER_DEGREE;
            Vec3::from_array((-PI * PI * d * d / b).to_array().map(f32::exp))
        };
        (-reach..=reach).map(weight).collect()
    };
    let mut sum = Plane { width: plane.width, values: vec![Vec3::ZERO; plane.values.len()] };
    let mut total = Vec3::ZERO;
    for [a, b] in TERMS {
        let weights = kernel(b);
        let scale = a * PI / b;
        let whole: Vec3 = weights.iter().sum();
        total += scale * whole * whole;
        for (sum, v) in sum.values.iter_mut().zip(plane.filter(&weights, &weights).values) {
            *sum += scale * v;
        }
    }
    sum.map(|v| v / total)
}

/// How strong an edge and a point there is at each pixel of a grey plane: lengths of the gradient and of the second derivatives.
fn detect(grey: &Plane) -> Vec<[f32; 2]> {
    /// Width of a feature in degrees.
    const WIDTH: f32 = 0.082;
    let deviation = 0.5 * WIDTH * PIXELS_PER_DEGREE;
    let reach = (3.0 * deviation).ceil() as i32;
    let gauss = |x: i32| (-(x * x) as f32 / (2.0 * deviation * deviation)).exp();
    let steps = || (-reach..=reach).map(move |x| (x as f32, gauss(x)));
    let smooth: Vec<f32> = steps().map(|(_, g)| g).collect();
    let edge: Vec<f32> = steps().map(|(x, g)| -x * g).collect();
    let point: Vec<f32> = steps().map(|(x, g)| (x * x / (deviation * deviation) - 1.0) * g).collect();
    // Positive weights add up to 1, negative ones to -1. The smoothing across has a sum of its own.
    let normalised = |weights: &[f32]| -> Vec<f32> {
        let sum = |sign: f32| weights.iter().map(|w| (w * sign).max(0.0)).sum::<f32>();
        let (positive, negative) = (sum(1.0), sum(-1.0));
        weights
            .iter()
            .map(|&w| if w > 0.0 { w / positive } else { w / negative.max(f32::MIN_POSITIVE) })
            .collect()
    };
    let (smooth, edge, point) = (normalised(&smooth), normalised(&edge), normalised(&point));
    // Two derivatives at once, in x and y of a vector.
    let pair = |first: &[f32], second: &[f32]| -> Vec<Vec3> {
        first.iter().zip(second).map(|(&a, &b)| Vec3::new(a, b, 0.0)).collect()
    };
    let derive = |along: &[f32]| grey.filter(&pair(along, &smooth), &pair(&smooth, along)).values;
    let length = |v: &Vec3| v.truncate().length();
    derive(&edge).iter().zip(&derive(&point)).map(|(e, p)| [length(e), length(p)]).collect()
}
