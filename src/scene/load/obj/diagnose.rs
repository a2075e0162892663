//! Which line makes an OBJ file invalid, and what is wrong with it.
//!
//! Only asked once the file was refused: the parser does not keep what a good message needs.

use std::path::Path;

use super::super::error::abridged;
use super::super::{LoadError, Location};
use super::parse::Lines;
use crate::scene::TriangleMesh;

/// What is wrong with a line.
struct Diagnosis {
    line: usize,
    found: String,
    expected: String,
}

/// The error of the first line that makes a file invalid; of the file as a whole if each line by itself is sound.
pub(super) fn diagnose(path: &Path, text: &str, otherwise: impl FnOnce() -> LoadError) -> LoadError {
    find(text).map_or_else(otherwise, |d| LoadError::new(Location::line(path, d.line), d.found, d.expected))
}

fn find(text: &str) -> Option<Diagnosis> {
    // Positive indices may run ahead of what they name.
    let mut totals = [0; 3];
    for line in Lines::new(text) {
        if let Some((kind, _)) = attribute(&line) {
            totals[kind] += 1;
        }
    }
    let mut above = [0; 3];
    let mut lines = Lines::new(text);
    while let Some(line) = lines.next() {
        let wrong = if let Some((kind, count)) = attribute(&line) {
            above[kind] += 1;
            malformed_attribute(lines.count, &line, kind, count)
        } else if line.split_ascii_whitespace().next() == Some("f") {
            let mut corners = line.split_ascii_whitespace().skip(1);
            corners.find_map(|c| malformed_corner(lines.count, c, above, totals))
        } else {
            None
        };
        if wrong.is_some() {
            return wrong;
        }
    }
    None
}

/// What vertex attributes are called, in the order in which a face corner names them.
const ATTRIBUTES: [&str; 3] = ["vertices", "texture coordinates", "normals"];

/// Which of [`ATTRIBUTES`] a line holds, and of how many numbers.
fn attribute(text: &str) -> Option<(usize, usize)> {
    match text.split_ascii_whitespace().next() {
        Some("v") => Some((0, 3)),
        Some("vt") => Some((1, 2)),
        Some("vn") => Some((2, 3)),
        _ => None,
    }
}

fn malformed_attribute(line: usize, text: &str, kind: usize, count: usize) -> Option<Diagnosis> {
    let limit = TriangleMesh::COORDINATE_LIMIT;
    // Attributes other than positions may be anything that is a number.
    let valid = |w: &str| w.parse::<f32>().is_ok_and(|x| kind != 0 || x.abs() < limit);
    let numbers = || text.split_ascii_whitespace().skip(1).take(count);
    // The second texture coordinate may be absent.
    let least = if kind == 1 { 1 } else { count };
    if numbers().count() >= least && numbers().all(valid) {
        return None;
    }
    let finite =
        if kind == 0 { format!("finite numbers below {limit:e} in magnitude") } else { "numbers".to_owned() };
    Some(Diagnosis {
        line,
        found: format!("`{}`", abridged(text.trim())),
        expected: format!("{count} {finite}"),
    })
}

fn malformed_corner(line: usize, corner: &str, above: [usize; 3], totals: [usize; 3]) -> Option<Diagnosis> {
    let refuse = |expected: String| {
        Some(Diagnosis { line, found: format!("face corner `{}`", abridged(corner)), expected })
    };
    for (kind, part) in corner.split('/').enumerate() {
        if part.is_empty() && kind != 0 {
            continue;
        }
        let Some(index) = part.parse::<isize>().ok().filter(|_| kind < 3) else {
            return refuse("`v`, `v/vt`, `v//vn` or `v/vt/vn` with whole numbers".to_owned());
        };
        let reaches =
            if index < 0 { index.unsigned_abs() <= above[kind] } else { index as usize <= totals[kind] };
        // In files without an attribute indices of it mean nothing.
        let matters = kind == 0 || totals[kind] > 0;
        if index == 0 && kind == 0 || matters && !reaches {
            let (count, name) = (if index < 0 { above[kind] } else { totals[kind] }, ATTRIBUTES[kind]);
            return refuse(format!(
                "an index of one of {count} {name}, counted from 1, or backwards from -1"
            ));
        }
    }
    None
}
