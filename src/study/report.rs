//! What a study tells: its conclusions in words, tables for terminal and page, and the files `report.html`, `report.csv`, `report.json` and `plot.svg`.

use std::io::{self, Write as _};
use std::path::Path;

use serde::Serialize;

use super::heat::{LEGEND, heat_map};
use super::html::Page;
use super::metrics::relative_squared_errors;
use super::picture::Picture;
use super::plot;
use super::results::{Configuration, Point, Results, Run};
use super::statistics::LogMean;
use super::summary::{AtBudget, BiasFloor, Conclusion, Summary};
use crate::film::Image;
use crate::film::output::{OutputError, write_atomically};

/// The images of a study.
#[derive(Debug, Clone)]
pub struct Pictures {
    /// What the others are compared with.
    pub reference: Picture,
    /// Of configurations, by their index in the results: the image of the first seed at the greatest budget.
    pub images: Vec<(usize, Picture)>,
}

/// A report was not written.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A file was not.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// Part of it cannot be made, such as a PNG of an image without pixels.
    #[error("the report cannot be made: {0}")]
    Make(#[from] io::Error),
}

/// Writes `report.html`, `report.csv`, `report.json` and `plot.svg` into a folder that exists, each either whole or not at all. Returns what the study concludes.
///
/// # Errors
/// If a file cannot be written, or an image cannot be shown or compared.
pub fn write(folder: &Path, results: &Results, pictures: &Pictures) -> Result<Summary, ReportError> {
    let summary = Summary::of(results);
    let svg = plot::error_over_time(results, &summary)?;
    let files = [
        ("report.html", html(results, &summary, pictures, &svg)?),
        ("report.csv", csv(results)?),
        ("report.json", json(results, &summary)?),
        ("plot.svg", svg),
    ];
    for (name, text) in files {
        write_atomically(&folder.join(name), |file| file.write_all(text.as_bytes()))?;
    }
    Ok(summary)
}

/// Results and conclusions.
fn json(results: &Results, summary: &Summary) -> io::Result<String> {
    #[derive(Serialize)]
    struct Both<'a> {
        results: &'a Results,
        summary: &'a Summary,
    }
    Ok(serde_json::to_string_pretty(&Both { results, summary })? + "\n")
}

/// A row for each configuration, seed and budget, and one for each configuration that failed.
fn csv(results: &Results) -> io::Result<String> {
    #[derive(Serialize)]
    struct Row<'a> {
        configuration: &'a str,
        integrator: &'a str,
        backend: &'a str,
        sampling_columns: Option<u32>,
        bias: Option<&'a str>,
        failure: Option<&'a str>,
        seed: Option<u64>,
        budget: Option<f64>,
        seconds: Option<f64>,
        passes: Option<u32>,
        rays: Option<u64>,
        mse: Option<f64>,
        rel_mse: Option<f64>,
        rel_mse_trimmed: Option<f64>,
        flip: Option<f64>,
        build: Option<f64>,
        first_image: Option<f64>,
        query_bytes: Option<u64>,
    }
    fn row<'a>(c: &'a Configuration, seen: Option<(&Run, f64, &Point)>) -> Row<'a> {
        let point = seen.map(|(.., point)| point);
        let run = seen.map(|(run, ..)| run);
        Row {
            configuration: &c.name,
            integrator: &c.integrator,
            backend: &c.backend,
            sampling_columns: c.sampling_columns,
            bias: c.bias.as_deref(),
            failure: c.failure.as_deref(),
            seed: run.map(|r| r.seed),
            budget: seen.map(|(_, budget, _)| budget),
            seconds: point.map(|p| p.seconds),
            passes: point.map(|p| p.passes),
            rays: point.map(|p| p.rays),
            mse: point.map(|p| p.mse),
            rel_mse: point.map(|p| p.rel_mse),
            rel_mse_trimmed: point.map(|p| p.rel_mse_trimmed),
            flip: point.map(|p| p.flip),
            build: run.map(|r| r.build),
            first_image: run.map(|r| r.first_image),
            query_bytes: run.map(|r| r.query_bytes),
        }
    }
    let mut writer = csv::Writer::from_writer(Vec::new());
    for configuration in &results.configurations {
        if configuration.runs.is_empty() {
            writer.serialize(row(configuration, None))?;
        }
        for run in &configuration.runs {
            for (&budget, point) in results.budgets.iter().zip(&run.points) {
                writer.serialize(row(configuration, Some((run, budget, point))))?;
            }
        }
    }
    let bytes = writer.into_inner().map_err(|error| io::Error::other(error.to_string()))?;
    String::from_utf8(bytes).map_err(io::Error::other)
}

/// What the study found, in sentences: the best at each budget and what cannot be told from it, bias, failures, and how good the reference is.
pub fn findings(results: &Results, summary: &Summary) -> Vec<String> {
    let rankings = (0..results.budgets.len()).filter_map(|b| Some((b, Ranking::at(summary, b)?)));
    let rankings: Vec<_> = rankings.collect();
    // Budgets of which the same is to be said are told together.
    let groups = rankings.chunk_by(|a, b| a.1 == b.1 && a.0 + 1 == b.0);
    let words = |group: &[(usize, Ranking)]| {
        let [(first, ranking), ..] = group else { return String::new() };
        ranking.words(results, summary, *first, first + group.len() - 1)
    };
    let mut found: Vec<String> = groups.map(words).collect();
    let both = || results.configurations.iter().zip(&summary.configurations);
    found.extend(
        both().filter_map(|(configuration, conclusion)| bias_words(configuration, conclusion, results)),
    );
    for configuration in &results.configurations {
        if let Some(failure) = &configuration.failure {
            found.push(format!("{} was not rendered: {failure}.", configuration.name));
        }
    }
    let reference = &results.reference;
    let own = match reference.rel_mse {
        Some(own) => format!("its own relMSE is about {own:.1e}, which is subtracted from what was measured"),
        None => {
            "how large its own error is nothing tells, so that it is a part of all errors here".to_owned()
        }
    };
    found.push(format!("The reference is {}; {own}.", reference.origin));
    found
}

/// Who is best at a budget, to be put into words.
#[derive(PartialEq)]
struct Ranking {
    best: String,
    /// Others that nothing beats.
    ties: Vec<String>,
    is_ranked: bool,
}

impl Ranking {
    fn at(summary: &Summary, budget: usize) -> Option<Self> {
        let (best, error) = summary.best(budget)?;
        let ties = summary.at(budget).filter(|(c, at)| at.rank == Some(1) && c.name != best.name);
        Some(Self {
            best: best.name.clone(),
            ties: ties.map(|(c, _)| c.name.clone()).collect(),
            is_ranked: error.interval.is_some(),
        })
    }

    fn words(&self, results: &Results, summary: &Summary, first: usize, last: usize) -> String {
        let time = |i: usize| format!("{} s", results.budgets[i]);
        let when =
            if first == last { time(first) } else { format!("{} to {}", results.budgets[first], time(last)) };
        let at = summary.at(last).find(|(c, _)| c.name == self.best).map(|(_, at)| at);
        let error =
            at.map_or_else(String::new, |at| format!(" (relMSE {})", with_interval(at.rel_mse.as_ref())));
        let rest = match (self.is_ranked, self.ties.as_slice()) {
            (false, _) => ", as far as a single seed can tell".to_owned(),
            (true, []) if summary.at(last).count() == 1 => String::new(),
            (true, []) => "; the 95 % intervals of all others lie above its own".to_owned(),
            (true, ties) => format!("; {} cannot be ranked below it", ties.join(", ")),
        };
        let limit = if at.is_some_and(|at| at.is_mostly_reference) {
            "; more than half of what is measured is the reference's own error"
        } else {
            ""
        };
        format!("After {when} of rendering {} has the least error{error}{rest}{limit}.", self.best)
    }
}

/// What is to be said of a configuration's bias, if anything.
fn bias_words(configuration: &Configuration, conclusion: &Conclusion, results: &Results) -> Option<String> {
    let name = &configuration.name;
    let (budget, last) = conclusion.last()?;
    let after = results.budgets[budget];
    let Some(reason) = &configuration.bias else {
        let BiasFloor { squared, .. } = conclusion.bias.filter(|bias| bias.is_seen == Some(true))?;
        return Some(format!(
            "{name} has no bias by design, yet {squared:.1e} of squared bias are seen after {after} s: light that it misses, or has not found yet."
        ));
    };
    let what = match conclusion.bias {
        None => "how much, only two seeds or more can tell".to_owned(),
        Some(BiasFloor { is_seen: None, .. }) => {
            "how much cannot be told from the reference's own error".to_owned()
        }
        Some(BiasFloor { is_seen: Some(false), uncertainty, .. }) => {
            format!("but after {after} s none is seen: its square is less than {uncertainty:.1e}")
        }
        Some(BiasFloor { squared, noise_is_less_after, .. }) => {
            let since = noise_is_less_after.map_or_else(String::new, |t| {
                format!("; noise is less than that after about {} s", seconds(t))
            });
            let error = last.rel_mse.map_or_else(nothing, |e| number(e.mean));
            format!("its square is {squared:.1e} after {after} s, where relMSE is {error}{since}")
        }
    };
    Some(format!("{name} is biased ({reason}); {what}."))
}

/// The table for terminal and page, a header first: relMSE and rank at each budget, slope, efficiency, bias and memory.
pub fn table(results: &Results, summary: &Summary) -> Vec<Vec<String>> {
    let mut rows = by_budget(results, summary, error_cell);
    let more = |c: &Conclusion| {
        [
            c.slope.map_or_else(nothing, |s| format!("{:.2}", s.value)),
            c.efficiency.map_or_else(nothing, number),
            c.bias.as_ref().map_or_else(nothing, bias_cell),
            c.time.map_or_else(nothing, |t| format!("{:.3}", t.first_image)),
            format!("{:.1}", mebibytes(c)),
        ]
    };
    let header = ["slope", "1/(error s)", "bias^2", "first image, s", "MiB"].map(str::to_owned);
    let columns = [header].into_iter().chain(summary.configurations.iter().map(more));
    rows.iter_mut().zip(columns).for_each(|(row, more)| row.extend(more));
    rows
}

/// What the signs in [`table`] mean.
pub const KEY: &str = "Numbers are relMSE, less the reference's own, and in brackets the rank: those whose 95 % intervals overlap are not ranked. * marks errors that are mostly the reference's. \
    Slope is the power of time by which the error falls.";

fn nothing() -> String {
    "-".to_owned()
}

fn mebibytes(conclusion: &Conclusion) -> f64 {
    conclusion.query_bytes as f64 / f64::from(1 << 20)
}

fn error_cell(at: &AtBudget) -> String {
    let rank = at.rank.map_or_else(String::new, |rank| format!(" ({rank})"));
    let mark = if at.is_mostly_reference { "*" } else { "" };
    at.rel_mse.map_or_else(nothing, |e| format!("{}{mark}{rank}", number(e.mean)))
}

fn bias_cell(bias: &BiasFloor) -> String {
    match bias.is_seen {
        None => "?".to_owned(),
        Some(false) => format!("< {:.1e}", bias.uncertainty),
        Some(true) => format!("{:.1e}", bias.squared),
    }
}

fn number(value: f64) -> String {
    if value == 0.0 { "0".to_owned() } else { format!("{value:.2e}") }
}

/// Seconds that are known roughly.
fn seconds(value: f64) -> String {
    if value < 10.0 { format!("{value:.2}") } else { format!("{value:.0}") }
}

fn with_interval(error: Option<&LogMean>) -> String {
    let Some(LogMean { mean, interval }) = error else { return nothing() };
    if *mean == 0.0 {
        return "less than the reference's own".to_owned();
    }
    let interval =
        interval.map_or_else(String::new, |[low, high]| format!(", {} to {}", number(low), number(high)));
    format!("{}{interval}", number(*mean))
}

/// A table with a column for each budget.
fn by_budget(results: &Results, summary: &Summary, cell: impl Fn(&AtBudget) -> String) -> Vec<Vec<String>> {
    let mut header = vec!["configuration".to_owned()];
    header.extend(results.budgets.iter().map(|budget| format!("{budget} s")));
    let row = |c: &Conclusion| {
        let cells = c.at.iter().map(|at| at.as_ref().map_or_else(nothing, &cell));
        [c.name.clone()].into_iter().chain(cells).collect()
    };
    [header].into_iter().chain(summary.configurations.iter().map(row)).collect()
}

/// What each configuration is and costs, a header first.
fn costs(results: &Results, summary: &Summary) -> Vec<Vec<String>> {
    let header = [
        "configuration",
        "integrator",
        "backend",
        "load, s",
        "build, s",
        "first image, s",
        "rest, s",
        "passes",
        "Mrays/s",
        "backend, MiB",
    ];
    let row = |(configuration, conclusion): (&Configuration, &Conclusion)| {
        let mut row =
            vec![configuration.name.clone(), configuration.integrator.clone(), configuration.backend.clone()];
        let times = conclusion.time.map(|t| [t.load, t.build, t.first_image, t.rest]);
        row.extend(times.map_or_else(|| [(); 4].map(|()| nothing()), |t| t.map(|t| format!("{t:.3}"))));
        let last = configuration.runs.first().and_then(|run| run.points.last());
        row.push(last.map_or_else(nothing, |p| p.passes.to_string()));
        row.push(last.map_or_else(nothing, |p| format!("{:.2}", p.rays as f64 * 1e-6 / p.seconds.max(1e-9))));
        row.push(format!("{:.1}", mebibytes(conclusion)));
        row
    };
    let rows = results.configurations.iter().zip(&summary.configurations).map(row);
    [header.map(str::to_owned).to_vec()].into_iter().chain(rows).collect()
}

/// Slopes, efficiencies and bias with what is known of their errors, a header first.
fn limits(summary: &Summary) -> Vec<Vec<String>> {
    let header = [
        "configuration",
        "slope",
        "standard error",
        "1/(error s)",
        "squared bias",
        "of which is uncertain",
        "noise below bias after, s",
    ];
    let row = |c: &Conclusion| {
        vec![
            c.name.clone(),
            c.slope.map_or_else(nothing, |s| format!("{:.3}", s.value)),
            c.slope.and_then(|s| s.error).map_or_else(nothing, |e| format!("{e:.3}")),
            c.efficiency.map_or_else(nothing, number),
            c.bias.map_or_else(nothing, |b| format!("{:.2e}", b.squared)),
            c.bias.map_or_else(nothing, |b| format!("{:.2e}", b.uncertainty)),
            c.bias.and_then(|b| b.noise_is_less_after).map_or_else(nothing, seconds),
        ]
    };
    [header.map(str::to_owned).to_vec()].into_iter().chain(summary.configurations.iter().map(row)).collect()
}

/// The whole report as one page that needs nothing else.
fn html(results: &Results, summary: &Summary, pictures: &Pictures, svg: &str) -> io::Result<String> {
    let mut page = Page::new(&format!("Which integrator for {}?", results.scene));
    let [width, height] = results.size;
    page.paragraph(&format!(
        "{width} x {height} pixels, {} threads, Helmholtz {}.",
        results.threads, results.version
    ));
    page.list(&findings(results, summary));
    page.heading("Error over time");
    page.svg(svg);
    page.list(&[
        "Lower is better and so is further left; both axes are logarithmic. A line that falls by a decade per decade of time is noise that averages out (slope -1); one that levels out has come to its bias, or to the grey line, the reference's own error.",
        "Bars are 95 % intervals over the seeds: marks whose bars overlap are not to be ranked. Dashed lines are biased integrators; hollow marks were mostly the reference's error before that was subtracted.",
        "Marks with a ring are the trade: nothing in the study has less error in the time they take. All else is a waste of time or of accuracy.",
    ]);
    page.table(&table(results, summary));
    page.paragraph(KEY);
    page.heading("Where the time goes");
    page.svg(&plot::time_split(summary)?);
    page.table(&costs(results, summary));
    page.heading("Slope, efficiency, bias");
    page.table(&limits(summary));
    page.paragraph("Efficiency is 1 / (relMSE x seconds) at the greatest budget: twice of it is the same error in half the time. Squared bias is what the mean image of all seeds is off by at the greatest budget; less than its uncertainty is none that is seen.");
    page.heading("Errors with their 95 % intervals");
    page.table(&by_budget(results, summary, |at| with_interval(at.rel_mse.as_ref())));
    page.paragraph("Without the worst 0.1 % of the pixels. Where this is much less, a few bright specks make most of the error.");
    page.table(&by_budget(results, summary, |at| with_interval(at.trimmed.as_ref())));
    page.heading("Images");
    page.paragraph(&format!(
        "Of the first seed at the greatest budget, beside their relative squared errors: {LEGEND}."
    ));
    let image = |picture: &Picture| Image::of_colours(picture.size, &picture.pixels);
    page.images(&[("the reference", &image(&pictures.reference))])?;
    for (index, picture) in &pictures.images {
        let Some(configuration) = results.configurations.get(*index) else { continue };
        let errors = relative_squared_errors(&pictures.reference, picture).map_err(io::Error::other)?;
        let flip = configuration.runs.first().and_then(|run| run.points.last()).map(|p| p.flip);
        let flip = flip.map_or_else(String::new, |flip| format!(", FLIP {flip:.4}"));
        let caption = format!("{}{flip}", configuration.name);
        page.images(&[(&caption, &image(picture)), ("its error", &heat_map(picture.size, &errors))])?;
    }
    Ok(page.finish())
}
