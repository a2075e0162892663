//! Toolkit for tests of random quantities: chi-squared and z-tests with their p-values, and the control of false alarms.
//!
//! How to use it:
//! - Draw numbers from [`Random`] with a fixed seed; a test that passed once then passes always.
//! - Compare a mean with a known value by [`z_test`], two means by [`z_test_two`]; collect samples in [`Moments`].
//! - Compare counts with expected counts by [`chi_squared`]; a sampler of directions with its density by
//!   [`chi_squared_on_sphere`], which also integrates the density and counts rejected samples.
//! - Put all p-values of a test into a [`Family`] and call [`Family::assert_accepted`] once: the chance that a correct
//!   implementation fails *any* of them is then the rate given, [`FALSE_ALARM_RATE`] by custom.
//!
//! Quadrature is in f64 and adaptive; see [`integrate`].

use glam::{DVec3, Vec2, Vec3};
use helmholtz::sampling::sampler::mix;
use std::f64::consts::{PI, SQRT_2, TAU};

/// Probability that a family of tests rejects a correct implementation, for the seed it was written with.
pub(crate) const FALSE_ALARM_RATE: f64 = 1e-3;

/// Pseudo-random numbers (a counter through the finaliser of `SplitMix64`), independent of the sampler under test.
#[derive(Debug, Clone)]
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(mix(seed))
    }

    pub(crate) fn next_u64(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        mix(self.0)
    }

    /// Uniform in [0, 1) with all 24 bits of an f32.
    pub(crate) fn uniform(&mut self) -> f32 {
        (self.next_u64() >> 40) as f32 / 16_777_216.0
    }

    /// Uniform in [0, 1), in steps of 2^-32.
    pub(crate) fn uniform_f64(&mut self) -> f64 {
        (self.next_u64() >> 32) as f64 / 4_294_967_296.0
    }

    /// Uniform in the unit square.
    pub(crate) fn uniform_2d(&mut self) -> Vec2 {
        Vec2::new(self.uniform(), self.uniform())
    }

    /// Uniform in the unit cube.
    pub(crate) fn uniform_3d(&mut self) -> [f32; 3] {
        [self.uniform(), self.uniform(), self.uniform()]
    }

    /// Uniform in logarithm between two positive bounds.
    pub(crate) fn log_uniform(&mut self, low: f32, high: f32) -> f32 {
        (low.ln() + self.uniform() * (high.ln() - low.ln())).exp()
    }

    /// Uniform on the unit sphere.
    pub(crate) fn direction(&mut self) -> Vec3 {
        let z = 2.0 * f64::from(self.uniform()) - 1.0;
        let (sin, cos) = (TAU * f64::from(self.uniform())).sin_cos();
        let r = (1.0 - z * z).sqrt();
        DVec3::new(r * cos, r * sin, z).as_vec3()
    }
}

/// Running mean and variance (Welford 1962).
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Moments {
    count: u64,
    mean: f64,
    sum_of_squares: f64,
}

impl Moments {
    pub(crate) fn push(&mut self, x: f64) {
        self.count += 1;
        let delta = x - self.mean;
        self.mean += delta / self.count as f64;
        self.sum_of_squares += delta * (x - self.mean);
    }

    pub(crate) fn mean(&self) -> f64 {
        self.mean
    }

    /// Standard deviation of the mean.
    pub(crate) fn standard_error(&self) -> f64 {
        let n = self.count as f64;
        (self.sum_of_squares / (n * (n - 1.0))).sqrt()
    }
}

impl FromIterator<f64> for Moments {
    fn from_iter<I: IntoIterator<Item = f64>>(samples: I) -> Self {
        let mut moments = Self::default();
        samples.into_iter().for_each(|x| moments.push(x));
        moments
    }
}

/// p-value of the hypothesis that the samples' expectation is `expected`. Needs enough samples for the mean to be normal.
pub(crate) fn z_test(samples: &Moments, expected: f64) -> f64 {
    two_sided(samples.mean() - expected, samples.standard_error(), expected)
}

/// p-value of the hypothesis that two independent sets of samples have the same expectation.
pub(crate) fn z_test_two(a: &Moments, b: &Moments) -> f64 {
    two_sided(a.mean() - b.mean(), a.standard_error().hypot(b.standard_error()), a.mean())
}

fn two_sided(difference: f64, standard_error: f64, scale: f64) -> f64 {
    // What the sums of constants differ by is rounding, not chance.
    let rounding = 1e-6 * scale.abs();
    if difference.abs() <= rounding { 1.0 } else { erfc(difference.abs() / standard_error / SQRT_2) }
}

/// Significance that each of `tests` independent tests may have for the family's false-alarm rate (Sidak 1967).
pub(crate) fn sidak(family_rate: f64, tests: usize) -> f64 {
    -((-family_rate).ln_1p() / tests as f64).exp_m1()
}

/// p-values that are judged together.
#[derive(Debug, Default)]
pub(crate) struct Family(Vec<(String, f64)>);

impl Family {
    pub(crate) fn record(&mut self, label: impl Into<String>, p_value: f64) {
        self.0.push((label.into(), p_value));
    }

    /// Fails, naming each rejected test, if any p-value is below what Sidak's correction allows.
    pub(crate) fn assert_accepted(&self, family_rate: f64) {
        let significance = sidak(family_rate, self.0.len());
        // A NaN p-value is a rejection too.
        let rejected: Vec<_> = self.0.iter().filter(|(_, p)| p.is_nan() || *p < significance).collect();
        assert!(!self.0.is_empty(), "no tests recorded");
        assert!(
            rejected.is_empty(),
            "{} of {} rejected at {significance:.2e}: {rejected:#?}",
            rejected.len(),
            self.0.len()
        );
    }
}

/// p-value of the counts `observed` under the expectation `expected` (Pearson 1900), both over the same cells.
///
/// Cells in which fewer than 5 are expected are pooled, the smallest first, since their counts are not normal. Where nothing is expected
/// nothing may be observed.
pub(crate) fn chi_squared(observed: &[u64], expected: &[f64]) -> f64 {
    const LEAST_EXPECTED: f64 = 5.0;
    assert_eq!(observed.len(), expected.len());
    if observed.iter().zip(expected).any(|(&o, &e)| o > 0 && e <= 0.0) {
        return 0.0;
    }
    let mut cells: Vec<(f64, f64)> =
        observed.iter().zip(expected).filter(|(_, e)| **e > 0.0).map(|(&o, &e)| (e, o as f64)).collect();
    cells.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (mut statistic, mut pooled_cells) = (0.0, 0_u32);
    let mut pool = (0.0, 0.0);
    for (i, (e, o)) in cells.iter().enumerate() {
        pool = (pool.0 + e, pool.1 + o);
        // The remainder must not be left as a small pool; since cells are sorted, only the last can be short.
        if pool.0 >= LEAST_EXPECTED || i + 1 == cells.len() {
            statistic += (pool.1 - pool.0) * (pool.1 - pool.0) / pool.0;
            pooled_cells += 1;
            pool = (0.0, 0.0);
        }
    }
    if pooled_cells < 2 { 1.0 } else { gamma_q(f64::from(pooled_cells - 1) / 2.0, statistic / 2.0) }
}

/// Cells on the sphere: rings around an axis times sectors.
///
/// `width` is the angular width of what is looked at, in radians. The cells shrink towards the axis logarithmically down to that width;
/// from a width of about 1 on they are of nearly the same solid angle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SphereChart {
    axis: DVec3,
    x: DVec3,
    y: DVec3,
    scale: f64,
    /// ln(1 + w / scale) at the far pole, w = 2.
    span: f64,
}

impl SphereChart {
    const RINGS: usize = 24;
    const SECTORS: usize = 40;

    pub(crate) fn new(axis: Vec3, width: f64) -> Self {
        let axis = axis.as_dvec3().normalize();
        let (x, y) = axis.any_orthonormal_pair();
        let scale = width * width;
        Self { axis, x, y, scale, span: (2.0 / scale).ln_1p() }
    }

    /// Cells of equal solid angle; the equator is an edge.
    pub(crate) fn equal_area(axis: Vec3) -> Self {
        Self::new(axis, 1e4)
    }

    /// Coordinates of a direction in the unit square. With w = 1 - cos(theta), the first is proportional to ln(1 + w / scale).
    fn coordinates(&self, d: DVec3) -> (f64, f64) {
        // |d - axis|^2 / 2 is accurate where 1 - cos is not.
        let w = 0.5 * (d - self.axis).length_squared().min(4.0);
        let phi = d.dot(self.y).atan2(d.dot(self.x)) / TAU;
        ((w / self.scale).ln_1p() / self.span, phi.rem_euclid(1.0))
    }

    /// The direction at coordinates, and the solid angle per area of the unit square there.
    fn direction(&self, s: f64, t: f64) -> (DVec3, f64) {
        let w = self.scale * (s * self.span).exp_m1();
        let sin = (w * (2.0 - w)).max(0.0).sqrt();
        let (sin_phi, cos_phi) = (TAU * t).sin_cos();
        let d = self.axis * (1.0 - w) + (self.x * cos_phi + self.y * sin_phi) * sin;
        (d, TAU * self.span * (self.scale + w))
    }

    fn cell(&self, d: DVec3) -> usize {
        let (s, t) = self.coordinates(d);
        let index = |x: f64, n: usize| ((x * n as f64) as usize).min(n - 1);
        index(s, Self::RINGS) * Self::SECTORS + index(t, Self::SECTORS)
    }

    /// Integral of a density over the sphere.
    pub(crate) fn integral(&self, density: impl Fn(Vec3) -> f64) -> f64 {
        self.integrals(&density).iter().sum()
    }

    /// Integral of a density over each cell.
    fn integrals(&self, density: &impl Fn(Vec3) -> f64) -> Vec<f64> {
        let (rings, sectors) = (Self::RINGS as f64, Self::SECTORS as f64);
        let integrand = |s: f64, t: f64| {
            let (d, jacobian) = self.direction(s, t);
            density(d.as_vec3()) * jacobian
        };
        (0..Self::RINGS * Self::SECTORS)
            .map(|i| {
                let (s, t) = ((i / Self::SECTORS) as f64, (i % Self::SECTORS) as f64);
                integrate(&integrand, [s / rings, (s + 1.0) / rings], [t / sectors, (t + 1.0) / sectors])
            })
            .collect()
    }
}

/// Outcome of [`chi_squared_on_sphere`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct SphereTest {
    /// Of the hypothesis that directions follow the density and are rejected with the probability it lacks to 1.
    pub p_value: f64,
    /// Integral of the density over the sphere.
    pub integral: f64,
}

/// Tests `count` directions from `sample` against a density per solid angle. `None` stands for a rejected sample.
pub(crate) fn chi_squared_on_sphere(
    chart: &SphereChart,
    count: u64,
    mut sample: impl FnMut() -> Option<Vec3>,
    density: impl Fn(Vec3) -> f64,
) -> SphereTest {
    let integrals = chart.integrals(&density);
    let integral: f64 = integrals.iter().sum();
    // The rejected have a cell of their own. No cell is quite impossible: rounding carries samples over the edge of a density.
    let probabilities = integrals.iter().copied().chain([1.0 - integral]);
    let expected: Vec<f64> = probabilities.map(|p| p.max(1e-8) * count as f64).collect();
    let mut observed = vec![0; expected.len()];
    for _ in 0..count {
        let cell = sample().map_or(integrals.len(), |d| chart.cell(d.as_dvec3()));
        observed[cell] += 1;
    }
    SphereTest { p_value: chi_squared(&observed, &expected), integral }
}

/// Integral over a rectangle: Lobatto's rule, subdivided until it agrees with its four quarters to 3e-4 relative or 1e-6 absolute,
/// at most [`MAX_DEPTH`] times. That is far below the chance in counts of some 1e5; jumps in the integrand are followed where they matter.
pub(crate) fn integrate(f: &impl Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2]) -> f64 {
    refine(f, x, y, lobatto(f, x, y), MAX_DEPTH)
}

const MAX_DEPTH: u32 = 8;

fn refine(f: &impl Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2], whole: f64, depth: u32) -> f64 {
    let middle = |[a, b]: [f64; 2]| 0.5 * (a + b);
    let (xs, ys) = ([[x[0], middle(x)], [middle(x), x[1]]], [[y[0], middle(y)], [middle(y), y[1]]]);
    let quarters = [(xs[0], ys[0]), (xs[0], ys[1]), (xs[1], ys[0]), (xs[1], ys[1])]
        .map(|(x, y)| (x, y, lobatto(f, x, y)));
    let sum: f64 = quarters.iter().map(|q| q.2).sum();
    if depth == 0 || (sum - whole).abs() < (3e-4 * sum.abs()).max(1e-6) {
        return sum;
    }
    quarters.iter().map(|&(x, y, whole)| refine(f, x, y, whole, depth - 1)).sum()
}

/// Product of Lobatto's rules of 5 points. Their nodes reach into the corners (but for a millionth, so that a jump along the edge stays
/// outside): a rule with inner nodes only, and its halves, would agree on missing a sliver along an edge.
fn lobatto(f: &impl Fn(f64, f64) -> f64, x: [f64; 2], y: [f64; 2]) -> f64 {
    const END: f64 = 1.0 - 1e-6;
    const INNER: f64 = 0.654_653_670_707_977_1; // sqrt(3 / 7)
    const RULE: [(f64, f64); 5] =
        [(-END, 0.1), (-INNER, 49.0 / 90.0), (0.0, 32.0 / 45.0), (INNER, 49.0 / 90.0), (END, 0.1)];
    let map = |[a, b]: [f64; 2], t: f64| 0.5 * (a + b) + 0.5 * (b - a) * t;
    let row = |s: f64| -> f64 { RULE.iter().map(|(t, weight)| weight * f(map(x, s), map(y, *t))).sum() };
    let sum: f64 = RULE.iter().map(|(s, weight)| weight * row(*s)).sum();
    sum * 0.25 * (x[1] - x[0]) * (y[1] - y[0])
}

/// Complementary error function.
pub(crate) fn erfc(x: f64) -> f64 {
    if x < 0.0 { 2.0 - erfc(-x) } else { gamma_q(0.5, x * x) }
}

/// Regularised upper incomplete gamma function Q(a, x); the p-value of chi-squared is Q(dof / 2, statistic / 2).
pub(crate) fn gamma_q(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 1.0;
    }
    let prefactor = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 { 1.0 - prefactor * gamma_series(a, x) } else { prefactor * gamma_fraction(a, x) }
}

/// Sum of x^n / (a (a + 1) ... (a + n)) (Abramowitz and Stegun 6.5.29).
fn gamma_series(a: f64, x: f64) -> f64 {
    let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
    while term > sum * f64::EPSILON {
        n += 1.0;
        term *= x / n;
        sum += term;
    }
    sum
}

/// Continued fraction for the upper function (Abramowitz and Stegun 6.5.31), evaluated from the front by Lentz's method.
fn gamma_fraction(a: f64, x: f64) -> f64 {
    let mut b = x + 1.0 - a;
    let (mut c, mut d) = (f64::INFINITY, 1.0 / b);
    let mut value = d;
    for i in 1..10_000 {
        let numerator = f64::from(i) * (a - f64::from(i));
        b += 2.0;
        d = 1.0 / (numerator * d + b);
        c = b + numerator / c;
        value *= c * d;
        if (c * d - 1.0).abs() < 1e-15 {
            break;
        }
    }
    value
}

/// Logarithm of the gamma function for x > 0, by Stirling's series above 10.
fn ln_gamma(x: f64) -> f64 {
    if x < 10.0 {
        return ln_gamma(x + 1.0) - x.ln();
    }
    let y = 1.0 / (x * x);
    let series = (1.0 / 12.0 - y * (1.0 / 360.0 - y * (1.0 / 1260.0 - y * (1.0 / 1680.0 - y / 1188.0)))) / x;
    (x - 0.5) * x.ln() - x + 0.5 * TAU.ln() + series
}

/// Published values: Abramowitz and Stegun, tables 7.1 and 26.8; NIST/SEMATECH e-Handbook 1.3.6.7.4.
#[test]
fn special_functions_match_published_tables() {
    for (x, expected) in
        [(0.5, 0.479_500_122_186_95), (1.0, 0.157_299_207_050_29), (3.0, 2.209_049_699_858_5e-5)]
    {
        assert!((erfc(x) / expected - 1.0).abs() < 1e-11, "erfc({x})");
    }
    assert!((erfc(-1.0) - 1.842_700_792_949_71).abs() < 1e-13);
    assert!((ln_gamma(0.5) - 0.5 * PI.ln()).abs() < 1e-13);
    assert!((ln_gamma(11.0) - 3_628_800.0_f64.ln()).abs() < 1e-12);
    for (dof, critical, p) in [
        (1.0, 3.841, 0.05),
        (10.0, 18.307, 0.05),
        (50.0, 86.661, 0.001),
        (100.0, 135.807, 0.01),
        (100.0, 77.929, 0.95),
    ] {
        let ours = gamma_q(dof / 2.0, critical / 2.0);
        assert!(
            (ours / p - 1.0).abs() < 1e-3,
            "chi-squared of {dof} degrees of freedom at {critical}: {ours}"
        );
    }
}

#[test]
fn sidak_multiplies_up_to_the_family_rate() {
    let each = sidak(1e-3, 70);
    assert!((1.0 - (1.0 - each).powi(70) - 1e-3).abs() < 1e-12);
}

/// Under the hypothesis p-values are uniform: 2000 of each kind, themselves tested by chi-squared.
#[test]
fn p_values_of_true_hypotheses_are_uniform() {
    const RUNS: usize = 2000;
    let mut random = Random::new(11);
    let weights: Vec<f64> = (1..=30).map(|i| f64::from(i * i)).collect();
    let total: f64 = weights.iter().sum();
    let mut histograms = [[0_u64; 10]; 2];
    for _ in 0..RUNS {
        let mut counts = vec![0_u64; weights.len()];
        for _ in 0..2000 {
            let mut u = f64::from(random.uniform()) * total;
            let index = weights.iter().position(|w| {
                u -= w;
                u < 0.0
            });
            counts[index.unwrap_or(weights.len() - 1)] += 1;
        }
        let expected: Vec<f64> = weights.iter().map(|w| w / total * 2000.0).collect();
        let samples: Moments = (0..200).map(|_| f64::from(random.uniform())).collect();
        for (histogram, p) in
            histograms.iter_mut().zip([chi_squared(&counts, &expected), z_test(&samples, 0.5)])
        {
            histogram[((p * 10.0) as usize).min(9)] += 1;
        }
    }
    let mut family = Family::default();
    for (histogram, name) in histograms.iter().zip(["chi-squared", "z-test"]) {
        family.record(name, chi_squared(histogram, &[RUNS as f64 / 10.0; 10]));
    }
    family.assert_accepted(FALSE_ALARM_RATE);
}

/// What is wrong must be seen: a coin off by 2 %, a mean off by 1 %, a density off by 3 % on half the sphere.
#[test]
fn false_hypotheses_are_rejected() {
    assert!(chi_squared(&[51_000, 49_000], &[50_000.0, 50_000.0]) < 1e-6);
    assert_eq!(chi_squared(&[10, 1], &[11.0, 0.0]), 0.0);
    let mut random = Random::new(12);
    let samples: Moments = (0..100_000).map(|_| f64::from(random.uniform())).collect();
    assert!(z_test(&samples, 0.505) < 1e-4);
    let others: Moments = (0..100_000).map(|_| f64::from(random.uniform()) * 1.01).collect();
    assert!(z_test_two(&samples, &others) < 1e-2 && z_test_two(&samples, &samples) == 1.0);
    let skewed = |d: Vec3| if d.x > 0.0 { 1.03 / (4.0 * PI) } else { 0.97 / (4.0 * PI) };
    let test = chi_squared_on_sphere(
        &SphereChart::equal_area(Vec3::Z),
        1 << 19,
        || Some(random.direction()),
        skewed,
    );
    assert!(test.p_value < 1e-4, "{test:?}");
}

/// The uniform density integrates to 1 and passes in either kind of chart; a narrow Gaussian lobe is resolved.
#[test]
fn sphere_charts_agree_with_known_densities() {
    let mut random = Random::new(13);
    let mut family = Family::default();
    let axis = Vec3::new(0.48, -0.6, 0.64);
    for chart in [SphereChart::equal_area(axis), SphereChart::new(axis, 1e-3)] {
        let test = chi_squared_on_sphere(&chart, 1 << 17, || Some(random.direction()), |_| 1.0 / (4.0 * PI));
        assert!((test.integral - 1.0).abs() < 1e-4, "{test:?}");
        family.record(format!("{chart:?}"), test.p_value);
    }
    family.assert_accepted(FALSE_ALARM_RATE);
    // A von Mises-Fisher lobe of concentration 1e6 normalised for the whole sphere.
    let concentration = 1e6;
    let lobe = |d: Vec3| {
        let w = 0.5 * (d.as_dvec3() - axis.as_dvec3()).length_squared();
        concentration / TAU * (-concentration * w).exp()
    };
    let integral = SphereChart::new(axis, 1e-3).integral(lobe);
    assert!((integral - 1.0).abs() < 1e-3, "{integral}");
}
