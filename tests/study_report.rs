//! What studies conclude and show, from made-up results whose conclusions are known.

use std::f64::consts::TAU;
use std::fs;

use glam::{UVec2, Vec3};
use helmholtz::study::picture::Picture;
use helmholtz::study::plot;
use helmholtz::study::report::{self, Pictures, findings, table};
use helmholtz::study::results::{Configuration, Point, Reference, Results, Run};
use helmholtz::study::statistics::LogMean;
use helmholtz::study::summary::{Conclusion, Summary};

use crate::statistics::Random;

fn point(seconds: f64, passes: u32, rel_mse: f64) -> Point {
    Point {
        seconds,
        passes,
        rays: 1_000_000,
        mse: rel_mse,
        rel_mse,
        rel_mse_trimmed: 0.5 * rel_mse,
        flip: 0.125,
    }
}

fn run(seed: u64, points: Vec<Point>) -> Run {
    Run { seed, build: 0.5, first_image: 0.25, query_bytes: 1 << 20, points }
}

fn configuration(name: &str, runs: Vec<Run>) -> Configuration {
    Configuration {
        name: name.to_owned(),
        integrator: format!("{name}:max_depth=8,rr_depth=5"),
        backend: "obvhs".to_owned(),
        sampling_columns: None,
        bias: None,
        runs,
        squared_bias: Vec::new(),
        failure: None,
    }
}

fn results(budgets: &[f64], own: Option<f64>, configurations: Vec<Configuration>) -> Results {
    Results {
        scene: "ring".to_owned(),
        size: [2, 2],
        threads: 2,
        version: "0.1.0".to_owned(),
        load: 0.125,
        budgets: budgets.to_vec(),
        reference: Reference { origin: "bdpt for 64 s".to_owned(), rel_mse: own, seconds: None },
        configurations,
    }
}

/// A configuration at a budget of one second, with one seed for each error.
fn at_a_second(name: &str, errors: &[f64]) -> Configuration {
    let run = |(seed, &error): (usize, &f64)| run(seed as u64, vec![point(1.0, 4, error)]);
    configuration(name, errors.iter().enumerate().map(run).collect())
}

fn close(found: f64, expected: f64) {
    assert!((found / expected - 1.0).abs() < 1e-9, "{found}, not {expected}");
}

/// A normal deviate, by Box and Muller.
fn normal(random: &mut Random) -> f64 {
    let [u, v] = [0, 1].map(|_| (f64::from(random.uniform()) + 0.5_f64.powi(25)).min(1.0));
    (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
}

/// Logarithms 0, 1 and 2: mean 1, deviation 1, Student's t of 2 degrees of freedom 4.302653.
#[test]
fn intervals_are_of_the_logarithm_less_the_reference() {
    let errors = [0.0, 1.0, 2.0].map(f64::exp);
    let summary = Summary::of(&results(&[1.0], Some(0.2), vec![at_a_second("path", &errors)]));
    let at = summary.configurations[0].at[0].as_ref().expect("measured");
    let reach = 4.302_652_729_9 / 3.0_f64.sqrt();
    let ends = [(1.0 - reach).exp(), (1.0 + reach).exp()];
    let LogMean { mean, interval } = at.measured.expect("positive");
    close(mean, 1.0_f64.exp());
    for (found, expected) in interval.expect("three seeds").into_iter().zip(ends) {
        assert!((found / expected - 1.0).abs() < 1e-8, "{found}, not {expected}");
    }
    let less = at.rel_mse.expect("positive");
    close(less.mean, mean - 0.2);
    // The lower end, 0.23, is little above the reference's error.
    assert!((less.interval.expect("three seeds")[0] - (ends[0] - 0.2)).abs() < 1e-8);
    close(at.trimmed.expect("positive").mean, 0.5 * mean - 0.2);
    assert!(!at.is_mostly_reference && at.seeds == 3);
    close(summary.configurations[0].efficiency.expect("an error"), 1.0 / (mean - 0.2));
    // Half of 0.3 is less than 0.2, and 0.1 less than that.
    for (error, expected) in [(0.3, 0.1), (0.1, 0.0)] {
        let summary = Summary::of(&results(&[1.0], Some(0.2), vec![at_a_second("path", &[error])]));
        let at = summary.configurations[0].at[0].as_ref().expect("measured");
        assert!(at.is_mostly_reference && at.rank.is_none());
        let found = at.rel_mse.expect("positive");
        assert!((found.mean - expected).abs() < 1e-12 && found.interval.is_none());
    }
    // What no logarithm is of.
    for error in [0.0, f64::NAN, f64::INFINITY] {
        let summary = Summary::of(&results(&[1.0], None, vec![at_a_second("path", &[1.0, error])]));
        assert_eq!(summary.configurations[0].at[0].as_ref().expect("a point").measured, None);
    }
}

/// Of 4000 log-normal samples of each size 95 % are to have the true median in their interval: the standard error of that share is 0.34 %, of which four
/// and a half, on either side and for three sizes, are exceeded once in 50,000 choices of seeds.
#[test]
fn intervals_hold_the_truth_as_often_as_they_say() {
    let mut random = Random::new(11);
    for (seeds, deviation) in [(2, 0.3), (3, 1.5), (8, 0.1)] {
        let held = (0..4000).filter(|_| {
            let values: Vec<f64> =
                (0..seeds).map(|_| 0.02 * (deviation * normal(&mut random)).exp()).collect();
            let [low, high] = LogMean::of(&values).expect("positive").interval.expect("two or more");
            (low..=high).contains(&0.02)
        });
        let share = held.count() as f64 / 4000.0;
        assert!((share - 0.95).abs() < 4.5 * 0.003_446, "{seeds} seeds: {share}");
    }
}

/// A configuration whose errors are `own` and a power of time for each seed.
fn power_laws(own: f64, times: &[f64], exponents: &[f64]) -> Configuration {
    let runs = exponents.iter().enumerate().map(|(seed, exponent)| {
        let at = |(i, t): (usize, &f64)| point(*t, 1 << i, 0.3 * t.powf(*exponent) + own);
        run(seed as u64, times.iter().enumerate().map(at).collect())
    });
    configuration("power", runs.collect())
}

#[test]
fn slopes_of_power_laws_are_their_exponents() {
    let times = [1.0, 2.0, 4.0, 9.0];
    let slope = |own: f64, exponents: &[f64], result: &dyn Fn(&mut Results)| {
        let mut results = results(&times, Some(own), vec![power_laws(own, &times, exponents)]);
        result(&mut results);
        Summary::of(&results).configurations[0].slope
    };
    for own in [0.0, 0.01] {
        let one = slope(own, &[-0.83], &|_| ()).expect("a slope");
        close(one.value, -0.83);
        assert_eq!(one.error, None);
        // Deviations of 0.2, 0 and 0.2: variance 0.04, of the mean 0.04 / 3.
        let three = slope(own, &[-0.8, -1.0, -1.2], &|_| ()).expect("a slope");
        close(three.value, -1.0);
        close(three.error.expect("three seeds"), (0.04_f64 / 3.0).sqrt());
    }
    // The first two budgets were within the first pass: one point, or the slope would be another.
    let bent = slope(0.0, &[-1.0], &|results| {
        let points = &mut results.configurations[0].runs[0].points;
        *points = vec![point(2.0, 1, 1.0), point(2.0, 1, 1.0), point(4.0, 2, 0.5), point(8.0, 4, 0.125)];
    });
    // Of the logarithms to base 2 at (1, 0), (2, -1), (3, -3): products of deviations -3, squares 2.
    close(bent.expect("a slope").value, -1.5);
    // Where the reference is most of it, or only one point is left, there is nothing to fit.
    let blunt = slope(0.01, &[-1.0], &|results| {
        let points = &mut results.configurations[0].runs[0].points;
        points[2].rel_mse = 0.011;
        points[3].rel_mse = 0.009;
    });
    close(blunt.expect("of two points").value, -1.0);
    assert_eq!(slope(0.3, &[-1.0], &|results| results.configurations[0].runs[0].points.truncate(1)), None);
}

/// Errors of three seeds a factor e^0.1 apart have intervals a factor e^0.2484 wide on both sides.
fn three_seeds(name: &str, centre: f64) -> Configuration {
    at_a_second(name, &[-0.1_f64, 0.0, 0.1].map(|x| centre * x.exp()))
}

#[test]
fn overlapping_intervals_are_not_ranked() {
    // [0.78, 1.28], [1.17, 1.92], [1.72, 2.82] and [78, 128]: the second overlaps with both neighbours, which do not with each other.
    let all =
        [("d", 100.0), ("b", 1.5), ("a", 1.0), ("c", 2.2)].map(|(name, centre)| three_seeds(name, centre));
    let mut results = results(&[1.0], Some(0.0), all.to_vec());
    let ranks = |results: &Results| {
        let summary = Summary::of(results);
        let ranks: Vec<_> = summary.at(0).map(|(c, at)| (c.name.clone(), at.rank)).collect();
        (ranks, summary)
    };
    let (found, summary) = ranks(&results);
    let expected = [("d", 4), ("b", 1), ("a", 1), ("c", 2)].map(|(name, rank)| (name.to_owned(), Some(rank)));
    assert_eq!(found, expected);
    assert_eq!(summary.best(0).expect("a best").0.name, "a");
    let text = findings(&results, &summary).join("\n");
    assert!(text.contains("After 1 s of rendering a has the least error (relMSE 1.00e0, 7.80e-1 to 1.28e0); b cannot be ranked"), "{text}");
    // The noise of the reference moves all ends alike.
    results.reference.rel_mse = Some(0.9);
    assert_eq!(ranks(&results).0, expected);
    // A single seed has no interval, and neither beats nor is beaten.
    results.configurations[2].runs.truncate(1);
    assert_eq!(ranks(&results).0.iter().map(|r| r.1).collect::<Vec<_>>(), [Some(3), Some(1), None, Some(1)]);
}

#[test]
fn the_front_is_what_nothing_beats_in_its_time() {
    let curve = |name: &str, points: &[(f64, f64)]| {
        let point = |(i, &(t, e)): (usize, &(f64, f64))| point(t, i as u32, e);
        configuration(name, vec![run(1, points.iter().enumerate().map(point).collect())])
    };
    let fast = curve("fast", &[(1.0, 0.5), (2.0, 0.4), (4.0, 0.3)]);
    // In 2 % more time it is better than the first at the second budget, and so is that beaten.
    let good = curve("good", &[(1.2, 0.45), (2.04, 0.1), (4.2, 0.05)]);
    let bad = curve("bad", &[(1.0, 0.6), (2.0, 0.5), (4.0, 0.05)]);
    let summary = Summary::of(&results(&[1.0, 2.0, 4.0], None, vec![fast, good, bad]));
    let front =
        |c: &Conclusion| c.at.iter().map(|at| at.as_ref().expect("reached").is_on_front).collect::<Vec<_>>();
    let fronts: Vec<_> = summary.configurations.iter().map(front).collect();
    assert_eq!(fronts, [[true, false, false], [true, true, false], [false, false, true]]);
}

/// Three seeds of 200 pixels with unit noise around `bias`, against a reference with a hundredth of that variance, as a study measures them.
fn biased(random: &mut Random, bias: f64) -> Configuration {
    const PIXELS: usize = 200;
    let (noise, seeds) = (0.1, 3);
    let reference: Vec<f64> = (0..PIXELS).map(|_| noise * normal(random)).collect();
    let images: Vec<Vec<f64>> =
        (0..seeds).map(|_| (0..PIXELS).map(|_| bias + normal(random)).collect()).collect();
    let mean = |f: &dyn Fn(usize) -> f64| (0..PIXELS).map(f).sum::<f64>() / PIXELS as f64;
    let errors: Vec<f64> = images.iter().map(|image| mean(&|p| (image[p] - reference[p]).powi(2))).collect();
    let squared_bias = mean(&|p| {
        let values: Vec<f64> = images.iter().map(|image| image[p]).collect();
        let m = values.iter().sum::<f64>() / 3.0;
        let variance = values.iter().map(|v| (v - m).powi(2)).sum::<f64>() / 2.0;
        (m - reference[p]).powi(2) - variance / 3.0 - noise * noise
    });
    let mut configuration = at_a_second("photons", &errors);
    configuration.squared_bias = vec![squared_bias];
    configuration
}

/// Without bias, of 1000 studies at most 25 see one if the rate is below the 2.5 % that are promised; 47 and more are that once in 30,000 choices of seeds. With a bias as great
/// as the noise all but some see it, and the noise of a second is less after a second: its mean over 1000 is within 1 % of that.
#[test]
fn bias_is_seen_where_there_is_some() {
    let mut random = Random::new(5);
    let mut floor = |bias: f64, reason: Option<&str>| {
        let mut results = results(&[1.0], Some(0.01), vec![biased(&mut random, bias)]);
        results.configurations[0].bias = reason.map(str::to_owned);
        Summary::of(&results).configurations[0].bias.expect("three seeds")
    };
    let false_alarms = (0..1000).filter(|_| floor(0.0, None).is_seen == Some(true)).count();
    assert!(false_alarms < 47, "{false_alarms}");
    let floors: Vec<_> = (0..1000).map(|_| floor(1.0, Some("blur"))).collect();
    let seen: Vec<f64> = floors.iter().filter_map(|f| f.noise_is_less_after).collect();
    assert!(seen.len() > 900 && floors.iter().filter(|f| f.is_seen == Some(true)).count() == seen.len());
    let mean = seen.iter().sum::<f64>() / seen.len() as f64;
    assert!((mean - 1.0).abs() < 0.03, "{mean}");
    // A bias that the reference is too noisy to show, one of a single seed, and one against a reference of unknown noise.
    let verdict = |own: Option<f64>, errors: &[f64], squared: f64| {
        let mut configuration = at_a_second("photons", errors);
        configuration.squared_bias = vec![squared];
        configuration.bias = Some("blur".to_owned());
        let results = results(&[1.0], own, vec![configuration]);
        let summary = Summary::of(&results);
        (summary.configurations[0].bias.map(|b| b.is_seen), findings(&results, &summary).join("\n"))
    };
    for (own, errors, squared, expected, words) in [
        (Some(0.5), &[1.0; 3] as &[_], 0.4, Some(Some(false)), "none is seen: its square is less than 1.0e0"),
        (
            Some(0.1),
            &[1.0; 3],
            0.4,
            Some(Some(true)),
            "its square is 4.0e-1 after 1 s, where relMSE is 9.00e-1; noise is less than that after about 1.25 s",
        ),
        (Some(0.3), &[1.0], 0.4, None, "only two seeds or more can tell"),
        (None, &[1.0; 3], 0.4, Some(None), "cannot be told from the reference's own error"),
    ] {
        let (found, text) = verdict(own, errors, squared);
        assert_eq!(found, expected, "{text}");
        assert!(text.contains(words), "{text}");
    }
}

/// Names that mean something to HTML, XML and CSV, and one that XML cannot hold.
const ODD: &str = "a, \"b\" <script>&amp; 'c'\u{1}\nd";

/// Two configurations over three budgets, one biased and with an odd name, and one that failed.
fn small_study() -> Results {
    let times = [1.0, 2.0, 4.0];
    let mut fine = power_laws(0.01, &times, &[-1.0, -1.01, -0.99]);
    fine.squared_bias = vec![0.0; 3];
    let mut odd = power_laws(0.1, &times, &[-1.0, -1.01, -0.99]);
    (odd.name, odd.bias) = (ODD.to_owned(), Some("<b>blur</b>".to_owned()));
    odd.squared_bias = vec![0.09; 3];
    let mut failed = configuration("vpl", Vec::new());
    failed.failure = Some("too many <i>photons</i>".to_owned());
    results(&times, Some(0.01), vec![fine, odd, failed])
}

fn pictures() -> Pictures {
    let grey = |v: f32| Picture {
        size: UVec2::splat(2),
        pixels: vec![Vec3::splat(v); 4],
        variance: None,
        is_display: false,
    };
    Pictures { reference: grey(0.5), images: vec![(0, grey(0.4)), (1, grey(f32::NAN))] }
}

#[test]
fn the_report_is_one_page_that_needs_no_network() {
    let folder = tempfile::tempdir().expect("a folder");
    let results = small_study();
    let summary = report::write(folder.path(), &results, &pictures()).expect("written");
    assert_eq!(summary, Summary::of(&results));
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).expect("a file");
    let page = read("report.html");
    assert!(page.contains("<svg") && page.matches("data:image/png;base64,").count() == 5);
    assert_eq!(page.matches("src=").count(), page.matches("src=\"data:").count());
    assert!(!page.contains("href") && !page.contains("url(") && !page.contains("@import"));
    let addresses = page.matches("http").count();
    assert!(addresses > 0 && addresses == page.matches("xmlns=\"http://www.w3.org/2000/svg\"").count());
    for tag in ["<script>", "<b>", "<i>"] {
        assert!(!page.contains(tag), "{tag}");
    }
    assert!(page.contains("vpl was not rendered: too many &lt;i&gt;photons"), "{page}");
    let both: serde_json::Value = serde_json::from_str(&read("report.json")).expect("JSON");
    let part = |name: &str| both[name].clone();
    assert_eq!(serde_json::from_value::<Results>(part("results")).expect("results"), results);
    assert_eq!(serde_json::from_value::<Summary>(part("summary")).expect("a summary"), summary);
    let words = findings(&results, &summary);
    assert!(words[0].starts_with("After 1 to 4 s of rendering power has the least error"), "{words:?}");
    assert!(
        words
            .iter()
            .any(|w| w.contains("<b>blur</b>") && w.contains("9.0e-2 after 4 s, where relMSE is 1.6")),
        "{words:?}"
    );
    let rows = table(&results, &summary);
    assert!(rows.iter().all(|row| row.len() == rows[0].len()) && rows.len() == 4, "{rows:?}");
    assert_eq!(rows[3][1..4], ["-", "-", "-"]);
    assert!(rows[1][1].ends_with("(1)") && rows[2][1].ends_with("(2)"), "{rows:?}");
    // A folder that is none.
    assert!(report::write(&folder.path().join("report.csv"), &results, &pictures()).is_err());
}

/// RFC 4180, by hand: quotes around what has a comma, a quote or a line's end, and quotes within doubled.
#[test]
fn rows_are_quoted() {
    let folder = tempfile::tempdir().expect("a folder");
    report::write(folder.path(), &small_study(), &pictures()).expect("written");
    let text = fs::read_to_string(folder.path().join("report.csv")).expect("a file");
    let first = "power,\"power:max_depth=8,rr_depth=5\",obvhs,,,,0,1.0,1.0,1,1000000,0.31,0.31,0.155,0.125,0.5,0.25,1048576\n";
    assert!(text.starts_with("configuration,integrator,backend,sampling_columns,bias,failure,seed,budget,seconds,passes,rays,mse,rel_mse,rel_mse_trimmed,flip,build,first_image,query_bytes\n"), "{text}");
    assert!(text.contains(first), "{text}");
    assert!(text.contains("\n\"a, \"\"b\"\" <script>&amp; 'c'\u{1}\nd\",\"power:"), "{text}");
    assert!(
        text.ends_with("vpl,\"vpl:max_depth=8,rr_depth=5\",obvhs,,,too many <i>photons</i>,,,,,,,,,,,,\n"),
        "{text}"
    );
    assert_eq!(text.matches(",obvhs,").count(), 3 * 3 + 3 * 3 + 1);
}

/// Centres of the polygons of a colour.
fn centres(svg: &roxmltree::Document, fill: &str) -> Vec<[f64; 2]> {
    let polygons =
        svg.descendants().filter(|n| n.has_tag_name("polygon") && n.attribute("fill") == Some(fill));
    let centre = |node: roxmltree::Node| {
        let points: Vec<[f64; 2]> = node
            .attribute("points")
            .expect("points")
            .split_whitespace()
            .map(|p| {
                p.split_once(',').map(|(x, y)| [x, y].map(|v| v.parse().expect("a number"))).expect("a pair")
            })
            .collect();
        [0, 1].map(|c| points.iter().map(|p| p[c]).sum::<f64>() / points.len() as f64)
    };
    polygons.map(centre).collect()
}

#[test]
fn the_plot_is_logarithmic_and_names_its_lines() {
    let results = small_study();
    let summary = Summary::of(&results);
    let text = plot::error_over_time(&results, &summary).expect("a plot");
    let svg = roxmltree::Document::parse(&text).expect("XML");
    let words: String = svg.descendants().filter_map(|n| n.text()).collect();
    for word in
        ["power", "a, \"b\" <script>&amp; 'c'", "relMSE", "seconds of rendering", "the reference's own"]
    {
        assert!(words.contains(word), "{word} in {words}");
    }
    // Of the first configuration, three points and the legend: each budget is twice the last, each error nearly half.
    let first = centres(&svg, "#0072B2");
    assert_eq!(first.len(), 4);
    let steps = [0, 1].map(|i| [0, 1].map(|c| first[i + 1][c] - first[i][c]));
    for c in [0, 1] {
        assert!(steps[0][c] > 20.0 && (steps[0][c] - steps[1][c]).abs() < 2.0, "{first:?}");
    }
    // The second has the same times and more error: higher, which is a smaller y.
    let second = centres(&svg, "#D55E00");
    for (a, b) in first.iter().zip(&second).take(3) {
        assert!((a[0] - b[0]).abs() < 1.5 && b[1] < a[1] - 1.0, "{first:?} {second:?}");
    }
    // The reference's error, 0.01, is drawn in dashes below all marks and above the axis.
    let polylines =
        svg.descendants().filter(|n| n.has_tag_name("polyline") && n.attribute("stroke") == Some("#5A5A5A"));
    let lowest = first[2][1];
    let heights =
        polylines.filter_map(|n| n.attribute("points")?.split([',', ' ']).nth(1)?.parse::<f64>().ok());
    assert!(heights.filter(|y| *y > lowest + 20.0 && *y < 500.0).count() > 30);
    let bars = plot::time_split(&summary).expect("a plot");
    assert!(
        roxmltree::Document::parse(&bars)
            .expect("XML")
            .descendants()
            .filter(|n| n.has_tag_name("rect"))
            .count()
            >= 4 + 8
    );
}

/// Nothing measured, nothing that a logarithm shows, one point, and intervals over hundreds of decades.
#[test]
fn odd_results_make_a_report_too() {
    let folder = tempfile::tempdir().expect("a folder");
    let nothing = Pictures { images: Vec::new(), ..pictures() };
    let short = configuration("short", vec![run(1, Vec::new())]);
    let uneven = at_a_second("uneven", &[1e-300, 1e300]);
    for (budgets, configurations) in [
        (&[] as &[f64], vec![]),
        (&[1.0], vec![]),
        (&[1.0, 2.0], vec![short.clone()]),
        (&[1.0, 2.0], vec![at_a_second("zero", &[0.0; 3]), short]),
        (&[1.0], vec![at_a_second("nan", &[f64::NAN; 2])]),
        (&[1.0], vec![at_a_second("one", &[0.25])]),
        (&[1.0], vec![uneven]),
        (&[1.0], vec![at_a_second(&"long ".repeat(1000), &[1.0, 2.0])]),
    ] {
        for own in [None, Some(0.0), Some(1e-3), Some(1e30)] {
            let results = results(budgets, own, configurations.clone());
            let summary = report::write(folder.path(), &results, &nothing).expect("written");
            let svg = fs::read_to_string(folder.path().join("plot.svg")).expect("a plot");
            assert!(svg.len() < 100_000 && roxmltree::Document::parse(&svg).is_ok(), "{svg}");
            assert_eq!(table(&results, &summary).len(), configurations.len() + 1);
        }
    }
    // An image of no size cannot be shown, and one of another size not compared.
    let mut wrong = pictures();
    wrong.images[0].1 =
        Picture { size: UVec2::new(1, 2), pixels: vec![Vec3::ONE; 2], ..wrong.reference.clone() };
    let error = report::write(folder.path(), &small_study(), &wrong).expect_err("another size");
    assert!(error.to_string().contains("1 x 2"), "{error}");
}
