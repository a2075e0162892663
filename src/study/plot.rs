//! Plots of a study as SVG: error over time, and where the time went. Axes and text are drawn by `plotters`; the marks of each configuration differ in colour (those of
//! Okabe and Ito, which the colour-blind can tell apart) and in shape, so that a print in grey can be read too.

use std::fmt::Display;
use std::io;

use plotters::coord::Shift;
use plotters::coord::combinators::{BindKeyPoints, IntoLogRange};
use plotters::element::{DashedPathElement, PathElement, Polygon, Rectangle, Text};
use plotters::prelude::{ChartBuilder, DrawingArea, IntoDrawingArea, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{Color, IntoFont, IntoTextStyle, RGBColor, ShapeStyle, WHITE};

use super::results::Results;
use super::statistics::LogMean;
use super::summary::{AtBudget, Summary};

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Okabe and Ito, "Color universal design", 2008, without yellow, which is hard to see on white.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
    RGBColor(0, 0, 0),
];

/// Corners of the marks, in pixels from their centre: disc, square, triangle, diamond, triangle on its tip.
const MARKS: [&[(i32, i32)]; 5] = [
    &[
        (6, 0),
        (5, 3),
        (3, 5),
        (0, 6),
        (-3, 5),
        (-5, 3),
        (-6, 0),
        (-5, -3),
        (-3, -5),
        (0, -6),
        (3, -5),
        (5, -3),
    ],
    &[(-5, -5), (5, -5), (5, 5), (-5, 5)],
    &[(0, -7), (6, 5), (-6, 5)],
    &[(0, -7), (7, 0), (0, 7), (-7, 0)],
    &[(0, 7), (6, -5), (-6, -5)],
];

const GREY: RGBColor = RGBColor(90, 90, 90);
const PALE: RGBColor = RGBColor(225, 225, 225);

/// Pixels of the plot without its legend.
const WIDTH: i32 = 800;
const HEIGHT: i32 = 560;

/// Pixels of a line of text, and about those of a letter.
const LINE: i32 = 26;
const LETTER: i32 = 8;

/// Letters of a name in a legend.
const LONGEST: usize = 48;

/// How far an error bar may widen the range of the plot: two seeds can have intervals over a hundred decades.
const BAR_RANGE: f64 = 10.0;

/// relMSE less the reference's over seconds, both axes logarithmic: a line with 95 % intervals for each configuration, dashed if it is biased, marks on the Pareto front ringed, those of which most
/// was the reference's error hollow; the reference's own error as a dashed line.
///
/// # Errors
/// None in truth: the drawing goes to memory.
pub fn error_over_time(results: &Results, summary: &Summary) -> io::Result<String> {
    let names: Vec<String> = results.configurations.iter().map(|c| printable(&c.name)).collect();
    let legend = 70 + LETTER * names.iter().map(|n| n.chars().count() as i32).max().unwrap_or(0).max(18);
    let height = HEIGHT.max(LINE * (names.len() as i32 + 4));
    draw((WIDTH + legend, height), |root| {
        let own = results.reference.rel_mse.filter(|own| *own > 0.0);
        let [x_range, y_range] = ranges(summary, own);
        let (plot, legend) = root.split_horizontally(WIDTH);
        let (x_ticks, y_ticks) = (ticks(x_range), ticks(y_range));
        let axis = |[low, high]: [f64; 2], ticks| (low..high).log_scale().with_key_points(ticks);
        let mut chart = ChartBuilder::on(&plot)
            .margin(12)
            .x_label_area_size(48)
            .y_label_area_size(78)
            .build_cartesian_2d(axis(x_range, x_ticks), axis(y_range, y_ticks))
            .map_err(io::Error::other)?;
        chart
            .configure_mesh()
            .light_line_style(PALE)
            .bold_line_style(PALE)
            .axis_style(GREY)
            .label_style(("sans-serif", 17))
            .x_label_formatter(&|v| tick_label(*v))
            .y_label_formatter(&|v| tick_label(*v))
            .x_desc("seconds of rendering")
            .y_desc("relMSE")
            .draw()
            .map_err(io::Error::other)?;
        let place = |x: f64, y: f64| {
            let within = |v: f64, [low, high]: [f64; 2]| v.clamp(low, high);
            chart.backend_coord(&(within(x, x_range), within(y, y_range)))
        };
        if let Some(own) = own {
            line(root, &[place(x_range[0], own), place(x_range[1], own)], GREY, 1, true)?;
        }
        for (i, conclusion) in summary.configurations.iter().enumerate() {
            let points: Vec<_> =
                conclusion.at.iter().flatten().filter_map(|at| Some((at, shown(at)?))).collect();
            let path: Vec<_> = points.iter().map(|(_, (x, error))| place(*x, error.mean)).collect();
            line(root, &path, colour(i), 2, is_biased(results, i))?;
            for (_, (x, error)) in &points {
                if let Some([low, high]) = error.interval {
                    line(root, &[place(*x, low), place(*x, high)], colour(i), 1, false)?;
                }
            }
            for ((at, _), centre) in points.iter().zip(&path) {
                mark(root, *centre, i, at)?;
            }
        }
        // The legend is drawn by hand: that of the crate lies within the plot.
        for (i, name) in names.iter().enumerate() {
            let y = LINE * (i as i32 + 1);
            line(&legend, &[(8, y), (44, y)], colour(i), 2, is_biased(results, i))?;
            polygon(&legend, (26, y), i, colour(i))?;
            text(&legend, name, (54, y), HPos::Left)?;
        }
        let y = LINE * (names.len() as i32 + 1);
        line(&legend, &[(8, y), (44, y)], GREY, 1, true)?;
        text(&legend, "the reference's own", (54, y), HPos::Left)?;
        ring(&legend, (26, y + LINE))?;
        text(&legend, "best for its time", (54, y + LINE), HPos::Left)?;
        Ok(())
    })
}

/// Bars of the time to load, build, get a first image and go on to the last budget, for each configuration.
///
/// # Errors
/// None in truth: the drawing goes to memory.
pub fn time_split(summary: &Summary) -> io::Result<String> {
    const PARTS: [&str; 4] = ["load", "build", "first image", "rest"];
    let rows: Vec<_> = summary
        .configurations
        .iter()
        .filter_map(|c| c.time.map(|t| (printable(&c.name), [t.load, t.build, t.first_image, t.rest])))
        .collect();
    let indent = 20 + LETTER * rows.iter().map(|(n, _)| n.chars().count() as i32).max().unwrap_or(0);
    let longest = rows.iter().map(|(_, t)| t.iter().sum::<f64>()).fold(1e-9, f64::max);
    let size = (indent + WIDTH, LINE * (rows.len() as i32 + 2));
    draw(size, |root| {
        for (i, part) in PARTS.iter().enumerate() {
            let x = indent + 160 * i as i32;
            rectangle(root, [(x, LINE / 2), (x + 14, LINE / 2 + 14)], colour(i))?;
            text(root, part, (x + 22, LINE / 2 + 7), HPos::Left)?;
        }
        for (i, (name, times)) in rows.iter().enumerate() {
            let y = LINE * (i as i32 + 1) + LINE / 2;
            text(root, name, (indent - 10, y + 9), HPos::Right)?;
            let mut before = 0.0;
            let at = |seconds: f64| indent + (f64::from(WIDTH - 120) * seconds / longest) as i32;
            for (part, seconds) in times.iter().enumerate() {
                rectangle(root, [(at(before), y), (at(before + seconds), y + 18)], colour(part))?;
                before += seconds;
            }
            text(root, &format!("{before:.2} s"), (at(before) + 8, y + 9), HPos::Left)?;
        }
        Ok(())
    })
}

/// Time and error, if a logarithm can show them: less the reference's own, or where nothing is left as it was measured, which is an upper bound.
fn shown(at: &AtBudget) -> Option<(f64, LogMean)> {
    let error = at.rel_mse.filter(|error| error.mean > 0.0).or(at.measured)?;
    let is_shown = [at.seconds, error.mean].iter().all(|v| v.is_finite() && *v > 0.0);
    is_shown.then_some((at.seconds, error))
}

fn is_biased(results: &Results, configuration: usize) -> bool {
    results.configurations.get(configuration).is_some_and(|c| c.bias.is_some())
}

/// Of time and of error: all points, error bars and the reference's error as far as they do not make the rest small, and a margin.
fn ranges(summary: &Summary, own: Option<f64>) -> [[f64; 2]; 2] {
    let mut ranges = [[f64::INFINITY, 0.0]; 2];
    let include = |[low, high]: &mut [f64; 2], v: f64| (*low, *high) = (low.min(v), high.max(v));
    let all = || summary.configurations.iter().flat_map(|c| c.at.iter().flatten());
    for (seconds, LogMean { mean, interval }) in all().filter_map(shown) {
        include(&mut ranges[0], seconds);
        include(&mut ranges[1], mean);
        for end in interval.into_iter().flatten() {
            include(&mut ranges[1], end.clamp(mean / BAR_RANGE, mean * BAR_RANGE));
        }
    }
    let [_, [least, greatest]] = ranges;
    if let Some(own) = own
        && least <= greatest
    {
        include(&mut ranges[1], own.clamp(least / BAR_RANGE, greatest * BAR_RANGE));
    }
    ranges.map(|[low, high]| if low <= high { [low / 1.25, high * 1.25] } else { [0.1, 10.0] })
}

/// Round numbers in a range: in each decade 1, 2 and 5, or powers of ten only, ten or so at most.
fn ticks([low, high]: [f64; 2]) -> Vec<f64> {
    let decades = (high / low).log10();
    let steps: &[f64] = if decades > 2.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
    let every = (decades / 10.0).ceil().max(1.0) as usize;
    let exponents = (low.log10().floor() as i32..=high.log10().ceil() as i32).step_by(every);
    let all = exponents.flat_map(|e| steps.iter().map(move |s| s * 10_f64.powi(e)));
    all.filter(|v| (low..=high).contains(v)).collect()
}

/// A number of one digit; the crate's own labels of logarithmic axes show the last bits of small ones.
fn tick_label(value: f64) -> String {
    let digit = format!("{value:.0e}");
    match digit.parse::<f64>() {
        Ok(value) if (1e-3..1e5).contains(&value) => value.to_string(),
        _ => digit,
    }
}

/// A name as XML can hold it, in not too many letters.
fn printable(name: &str) -> String {
    let mut letters = name.chars().map(|c| if c.is_control() { char::REPLACEMENT_CHARACTER } else { c });
    let mut short: String = letters.by_ref().take(LONGEST).collect();
    if letters.next().is_some() {
        short.push('…');
    }
    short
}

fn draw(size: (i32, i32), content: impl FnOnce(&Area) -> io::Result<()>) -> io::Result<String> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (size.0 as u32, size.1 as u32)).into_drawing_area();
        root.fill(&WHITE).map_err(io::Error::other)?;
        content(&root)?;
        root.present().map_err(io::Error::other)?;
    }
    Ok(svg)
}

fn colour(i: usize) -> RGBColor {
    COLOURS[i % COLOURS.len()]
}

fn line(area: &Area, points: &[(i32, i32)], colour: RGBColor, width: u32, is_dashed: bool) -> io::Result<()> {
    let style: ShapeStyle = colour.stroke_width(width);
    if is_dashed {
        area.draw(&DashedPathElement::new(points.to_vec(), 7, 5, style)).map_err(io::Error::other)
    } else {
        area.draw(&PathElement::new(points.to_vec(), style)).map_err(io::Error::other)
    }
}

/// The mark of a configuration at a point.
fn mark(area: &Area, centre: (i32, i32), configuration: usize, at: &AtBudget) -> io::Result<()> {
    if at.is_on_front {
        ring(area, centre)?;
    }
    polygon(area, centre, configuration, if at.is_mostly_reference { WHITE } else { colour(configuration) })?;
    let corners = corners(configuration, centre);
    let closed: Vec<_> = corners.iter().chain(corners.first()).copied().collect();
    line(area, &closed, colour(configuration), 1, false)
}

fn ring(area: &Area, (x, y): (i32, i32)) -> io::Result<()> {
    let corner = |i: i32| {
        let angle = std::f64::consts::TAU * f64::from(i) / 24.0;
        (x + (11.0 * angle.cos()).round() as i32, y + (11.0 * angle.sin()).round() as i32)
    };
    line(area, &(0..=24).map(corner).collect::<Vec<_>>(), GREY, 1, false)
}

fn corners(configuration: usize, (x, y): (i32, i32)) -> Vec<(i32, i32)> {
    MARKS[configuration % MARKS.len()].iter().map(|(dx, dy)| (x + dx, y + dy)).collect()
}

fn polygon(area: &Area, centre: (i32, i32), configuration: usize, fill: RGBColor) -> io::Result<()> {
    area.draw(&Polygon::new(corners(configuration, centre), fill.filled())).map_err(io::Error::other)
}

fn rectangle(area: &Area, corners: [(i32, i32); 2], fill: RGBColor) -> io::Result<()> {
    area.draw(&Rectangle::new(corners, fill.filled())).map_err(io::Error::other)
}

fn text(area: &Area, text: &(impl Display + ?Sized), at: (i32, i32), anchor: HPos) -> io::Result<()> {
    let style = ("sans-serif", 17).into_font().into_text_style(area).pos(Pos::new(anchor, VPos::Center));
    area.draw(&Text::new(text.to_string(), at, style)).map_err(io::Error::other)
}
