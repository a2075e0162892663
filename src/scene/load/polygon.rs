//! Polygons to triangles.

use glam::Vec3;

/// Adds the triangles of a polygon given by indices of `positions`: around its first corner if it is convex (as Mitsuba does for all), else by
/// cutting ears off in the plane that fits it best (`earcutr`, after Held 2001, "FIST: fast industrial-strength triangulation of polygons").
/// Polygons of less than three corners have none. Indices out of range are kept, to be found by who checks them.
pub(super) fn triangulate(corners: &[u32], positions: &[Vec3], triangles: &mut Vec<[u32; 3]>) {
    let [first, rest @ ..] = corners else { return };
    if corners.len() > 3
        && let Some(points) = project(corners, positions)
        && !is_convex(&points)
        && cut_ears(corners, &points, triangles)
    {
        return;
    }
    triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
}

/// The corners in the plane across the polygon's normal, which they go around counter-clockwise. `None` if they have no such plane.
fn project(corners: &[u32], positions: &[Vec3]) -> Option<Vec<[f64; 2]>> {
    let points: Option<Vec<_>> =
        corners.iter().map(|&i| positions.get(i as usize).map(|p| p.as_dvec3())).collect();
    let points = points?;
    let origin = points[0];
    let pairs = points.iter().zip(points.iter().cycle().skip(1));
    // Newell's normal; relative to a corner, so that a polygon far from the origin keeps its digits.
    let normal: glam::DVec3 = pairs.map(|(a, b)| (*a - origin).cross(*b - origin)).sum();
    let normal = normal.try_normalize()?;
    let (x, y) = normal.any_orthonormal_pair();
    Some(points.iter().map(|p| [(*p - origin).dot(x), (*p - origin).dot(y)]).collect())
}

/// Whether no corner turns right.
fn is_convex(points: &[[f64; 2]]) -> bool {
    let n = points.len();
    let extent = points.iter().flatten().fold(0.0_f64, |e, x| e.max(x.abs()));
    // Rounding in f32 coordinates makes straight corners turn by this much.
    let tolerance = 1e-6 * extent * extent;
    (0..n).all(|i| {
        let [a, b, c] = [i, i + 1, i + 2].map(|k| points[k % n]);
        (b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]) >= -tolerance
    })
}

/// Whether the polygon was simple enough to be cut completely.
fn cut_ears(corners: &[u32], points: &[[f64; 2]], triangles: &mut Vec<[u32; 3]>) -> bool {
    let Ok(cut) = earcutr::earcut(points.as_flattened(), &[], 2) else { return false };
    if cut.len() != 3 * (corners.len() - 2) {
        return false;
    }
    // Which way round the crate returns them is not documented.
    let area: f64 = cut.chunks_exact(3).map(|t| doubled_area(points, t)).sum();
    let order = if area < 0.0 { [0, 2, 1] } else { [0, 1, 2] };
    triangles.extend(cut.chunks_exact(3).map(|t| order.map(|k| corners[t[k]])));
    true
}

fn doubled_area(points: &[[f64; 2]], t: &[usize]) -> f64 {
    let [a, b, c] = [points[t[0]], points[t[1]], points[t[2]]];
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sum of the triangles' areas with sign against the polygon's normal, and of their magnitudes: equal if none overlap or turn over.
    fn areas(positions: &[Vec3], corners: &[u32]) -> (f32, f32, usize) {
        let mut triangles = Vec::new();
        triangulate(corners, positions, &mut triangles);
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| positions[i as usize]);
            (b - a).cross(c - a).z / 2.0
        };
        let signed: f32 = triangles.iter().map(area).sum();
        (signed, triangles.iter().map(|t| area(t).abs()).sum(), triangles.len())
    }

    #[test]
    fn concave_polygons_are_covered_once() {
        let points = |xy: &[(f32, f32)]| xy.iter().map(|&(x, y)| Vec3::new(x, y, 7.0)).collect::<Vec<_>>();
        for (name, polygon, area) in [
            ("square", points(&[(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]), 4.0),
            ("arrow", points(&[(0.0, 0.0), (2.0, 2.0), (0.0, 1.0), (-2.0, 2.0)]), 2.0),
            ("arrow from its notch", points(&[(0.0, 1.0), (-2.0, 2.0), (0.0, 0.0), (2.0, 2.0)]), 2.0),
            ("L", points(&[(0.0, 0.0), (3.0, 0.0), (3.0, 1.0), (1.0, 1.0), (1.0, 3.0), (0.0, 3.0)]), 5.0),
        ] {
            let corners: Vec<u32> = (0..polygon.len() as u32).collect();
            assert_eq!(areas(&polygon, &corners), (area, area, polygon.len() - 2), "{name}");
            let reversed: Vec<u32> = corners.iter().rev().copied().collect();
            assert_eq!(areas(&polygon, &reversed), (-area, area, polygon.len() - 2), "{name} reversed");
            let far: Vec<Vec3> = polygon.iter().map(|p| *p + Vec3::new(4096.0, -8192.0, 0.0)).collect();
            assert_eq!(areas(&far, &corners), (area, area, polygon.len() - 2), "{name} far away");
        }
    }

    #[test]
    fn degenerate_polygons_keep_their_count() {
        let line: Vec<Vec3> = (0..5).map(|i| Vec3::splat(i as f32)).collect();
        for corners in [&[0, 1, 2, 3, 4][..], &[0, 0, 0, 0], &[0, 1, 99, 3], &[0, 1, 0, 1]] {
            let mut triangles = Vec::new();
            triangulate(corners, &line, &mut triangles);
            assert_eq!(triangles.len(), corners.len() - 2, "{corners:?}");
        }
        for corners in [&[][..], &[0], &[0, 1]] {
            let mut triangles = Vec::new();
            triangulate(corners, &line, &mut triangles);
            assert!(triangles.is_empty());
        }
    }
}
