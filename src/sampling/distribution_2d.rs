//! A distribution over the cells of a grid.

use glam::Vec2;

/// Draws cells of a grid with given probabilities, and hands on what is left of the random numbers. Neighbouring numbers draw
/// neighbouring cells, so that well-spread points stay well spread, which an alias table would destroy.
#[derive(Debug, Clone)]
pub struct Distribution2d {
    columns: usize,
    /// For each row, sums of its weights up to and with each cell. In f64: of a million cells one may hold all but a millionth of the weight.
    cells: Vec<f64>,
    /// Sums of the rows' weights up to and with each row.
    rows: Vec<f64>,
}

/// A cell that was drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cell {
    /// Its column.
    pub column: usize,
    /// Its row.
    pub row: usize,
    /// Numbers in [0, 1), independent of which cell it is.
    pub rest: Vec2,
}

impl Distribution2d {
    /// From weights, row by row. `None` if there are none, they make no whole rows, none is positive, one is negative or not finite, or their
    /// sum is not finite.
    pub fn new(columns: usize, mut weights: Vec<f64>) -> Option<Self> {
        let valid = columns > 0 && weights.len().is_multiple_of(columns) && weights.iter().all(|w| *w >= 0.0);
        if !valid {
            return None;
        }
        let mut rows = Vec::with_capacity(weights.len() / columns);
        let mut total = 0.0;
        for row in weights.chunks_exact_mut(columns) {
            let mut sum = 0.0;
            for weight in row {
                sum += *weight;
                *weight = sum;
            }
            total += sum;
            rows.push(total);
        }
        (total > 0.0 && total.is_finite()).then_some(Self { columns, cells: weights, rows })
    }

    /// Sum of all weights.
    pub fn total(&self) -> f64 {
        self.rows.last().copied().unwrap_or(0.0)
    }

    /// Draws a cell with `u` in [0, 1)^2; `u.x` decides the column, `u.y` the row. Cells of weight 0 are never drawn.
    #[inline]
    pub fn sample(&self, u: Vec2) -> Cell {
        let (row, rest_y) = draw(&self.rows, u.y);
        let (column, rest_x) = draw(&self.cells[row * self.columns..(row + 1) * self.columns], u.x);
        Cell { column, row, rest: Vec2::new(rest_x, rest_y) }
    }
}

/// Index of the part of `sums` that `u` times the last sum falls into, and where in that part, from 0 to 1.
#[inline]
fn draw(sums: &[f64], u: f32) -> (usize, f32) {
    let total = sums[sums.len() - 1];
    let x = f64::from(u) * total;
    // The product may round up to the total, behind which there may be parts of weight 0.
    let index = if x < total {
        sums.partition_point(|&sum| sum <= x)
    } else {
        sums.partition_point(|&sum| sum < total)
    };
    let start = if index == 0 { 0.0 } else { sums[index - 1] };
    let rest = ((x - start) / (sums[index] - start)) as f32;
    (index, rest.clamp(0.0, ONE_BELOW))
}

/// The greatest number below 1.
const ONE_BELOW: f32 = 1.0 - f32::EPSILON / 2.0;
