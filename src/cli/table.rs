//! Tables for terminals.

/// Rows of cells under each other, the first column to the left and the others to the right; each line begins with `lead`.
pub(super) fn table(rows: &[Vec<String>], lead: &str) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |c: usize| rows.iter().filter_map(|row| row.get(c)).map(|cell| cell.chars().count()).max();
    let widths: Vec<usize> = (0..columns).map(|c| width(c).unwrap_or(0)).collect();
    rows.iter().fold(String::new(), |mut text, row| {
        text.push_str(lead);
        for (i, (cell, &width)) in row.iter().zip(&widths).enumerate() {
            let cell = if i == 0 { format!("{cell:<width$}") } else { format!("  {cell:>width$}") };
            text.push_str(&cell);
        }
        text.push('\n');
        text
    })
}
