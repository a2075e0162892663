//! Rectangular lights: pairs of triangles that are sampled as one.

use glam::{Vec2, Vec3};

use super::area::FAR;
use crate::sampling::spherical::{PlacedRectangle, SphericalRectangle};
use crate::scene::{SurfacePoint, TriangleMesh};

/// Two triangles of a mesh that together are a rectangle.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rectangle {
    placed: PlacedRectangle,
    pub(super) ex: Vec3,
    pub(super) ey: Vec3,
    /// One of the corners where only one of the triangles is, and where error bounds are greatest.
    pub(super) corner: SurfacePoint,
    center: Vec3,
    /// Squared distance from `center` beyond which it is sampled by area.
    far_squared: f32,
    /// Position and texture coordinates of that corner and of the one opposite, on the other triangle: the two are planes of
    /// their own, to within rounding.
    ends: [(Vec3, Vec2); 2],
    /// For each triangle, how texture coordinates change along `ex` and `ey`.
    uv_edges: [[Vec2; 2]; 2],
}

impl Rectangle {
    /// Whether `triangle` and the next one share a diagonal of a rectangle and face the same way.
    pub(super) fn find(mesh: &TriangleMesh, shape: u32, triangle: u32) -> Option<Self> {
        // Relative error that f32 vertices have after a transform.
        const TOLERANCE: f32 = 1e-5;
        if triangle as usize + 1 >= mesh.triangles().len() {
            return None;
        }
        let (a, b) = (mesh.corners(triangle), mesh.corners(triangle + 1));
        let apex = (0..3).find(|&i| !b.contains(&a[i]))?;
        let (at_ex, at_ey) = ((apex + 1) % 3, (apex + 2) % 3);
        let opposite = (0..3).find(|&i| !a.contains(&b[i]))?;
        let slots_b =
            [opposite, b.iter().position(|&p| p == a[at_ex])?, b.iter().position(|&p| p == a[at_ey])?];
        let (corner, ex, ey) = (a[apex], a[at_ex] - a[apex], a[at_ey] - a[apex]);
        let size = ex.length() + ey.length();
        let perpendicular = ex.dot(ey).abs() <= TOLERANCE * ex.length() * ey.length();
        let closes = (corner + ex + ey).distance(b[opposite]) <= TOLERANCE * size;
        // In the second triangle the diagonal is passed the other way round.
        let same_side = (slots_b[0] + 1) % 3 == slots_b[2];
        let proper = ex.length_squared() > 0.0 && ey.length_squared() > 0.0;
        if !(perpendicular && closes && same_side && proper) {
            return None;
        }
        let at_corner = |triangle, slot| {
            let (u, v) = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)][slot];
            SurfacePoint::on_triangle(mesh, shape, triangle, u, v)
        };
        let [first, second] = [at_corner(triangle, apex), at_corner(triangle + 1, opposite)];
        let uv_edges = [
            [at_ex, at_ey].map(|slot| at_corner(triangle, slot).uv - first.uv),
            [slots_b[2], slots_b[1]].map(|slot| second.uv - at_corner(triangle + 1, slot).uv),
        ];
        Some(Self {
            placed: PlacedRectangle::new(corner, ex, ey),
            ex,
            ey,
            corner: SurfacePoint { p_err: first.p_err.max(second.p_err), ..first },
            center: corner + 0.5 * (ex + ey),
            far_squared: (FAR * (ex + ey).length()).powi(2),
            ends: [(first.p, first.uv), (second.p, second.uv)],
            uv_edges,
        })
    }

    /// The rectangle as a part of the sphere of directions; `None` where it is to be sampled by area.
    #[inline]
    pub(super) fn seen_from(&self, p: Vec3) -> Option<SphericalRectangle> {
        self.is_near(p).then(|| SphericalRectangle::new(&self.placed, p)).flatten()
    }

    #[inline]
    pub(super) fn is_near(&self, p: Vec3) -> bool {
        self.center.distance_squared(p) < self.far_squared
    }

    /// The point at `corner + st.x ex + st.y ey`. Its error bound is the greatest of the rectangle; its shading normal
    /// is the corner's, which light does not depend on.
    #[inline]
    pub(super) fn point(&self, st: Vec2) -> SurfacePoint {
        let is_second = st.x + st.y > 1.0;
        let (p, uv) = self.ends[usize::from(is_second)];
        let [du, dv] = self.uv_edges[usize::from(is_second)];
        let st = if is_second { st - 1.0 } else { st };
        SurfacePoint {
            p: p + self.ex * st.x + self.ey * st.y,
            uv: uv + du * st.x + dv * st.y,
            primitive: self.corner.primitive + u32::from(is_second),
            ..self.corner
        }
    }
}
