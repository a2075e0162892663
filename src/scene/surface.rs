//! The surface point behind a hit, rebuilt from the shape by one piece of code for all backends.

use glam::{DMat3, DVec3, Vec2, Vec3};
use std::f64::consts::{PI, TAU};

use super::{AnalyticKind, AnalyticShape, Geometry, Instance, Rgb, Shape, TriangleMesh};

/// A point on a shape, with what scattering and spawning rays need.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// World position.
    pub p: Vec3,
    /// How far along the normal a ray must start so that no backend's rounding makes it hit this primitive again.
    pub p_err: f32,
    /// Geometric normal, unit length, on the side of [`ns`](Self::ns).
    pub ng: Vec3,
    /// Shading normal, unit length; it says which side is outside.
    pub ns: Vec3,
    /// Texture coordinates.
    pub uv: Vec2,
    /// Index of the shape in the scene.
    pub shape: u32,
    /// Index of the primitive in the shape; in an instance, of all its group's primitives counted through.
    pub primitive: u32,
}

/// Error of a point and of a backend's plane test at it, relative to the size of the numbers in them. The point: 5 operations,
/// and one more when it is moved by the error. The test: differences of coordinates, a cross and a dot product (Higham's gamma of 8
/// operations, times 2 for both ends of a segment).
const PLANE_TEST_ERROR: f32 = 22.0 * (f32::EPSILON / 2.0);

/// What a sphere needs besides the rounding of `p`, relative to its radius. Rounding of normal and direction lets a ray
/// dip below the tangent plane by an angle of up to 2^-21; the sphere falls away beneath it if the ray starts half the square
/// of that above. (The test itself is done in f64 and errs by less.)
const SPHERE_TILT_ERROR: f32 = 1.0 / (1u64 << 42) as f32;

/// By how much the errors in a group's space grow because the ray was rounded there: 1 of 22 roundings of the numbers in a plane test
/// for its origin and at most 6 for its direction, which runs over the primitive's extent; both taken with room to spare.
const INSTANCE_ERROR: f32 = 1.5;

impl SurfacePoint {
    /// The point with barycentric coordinates `u` (of the second corner) and `v` (of the third) on a triangle.
    #[inline(always)]
    pub fn on_triangle(mesh: &TriangleMesh, shape: u32, triangle: u32, u: f32, v: f32) -> Self {
        let indices = mesh.triangles()[triangle as usize].map(|i| i as usize);
        let [a, b, c] = indices.map(|i| mesh.positions()[i]);
        let w = 1.0 - u - v;
        let (e1, e2) = (b - a, c - a);
        let along = e1 * u + e2 * v;
        let p = a + along;
        let n = e1.cross(e2);
        let length2 = n.length_squared();
        let mut ng = if length2 > f32::MIN_POSITIVE && length2 < f32::MAX {
            n * (1.0 / length2.sqrt())
        } else {
            normal_of_extreme_edges(e1, e2)
        };
        let mut ns = ng;
        if !mesh.normals().is_empty() {
            let [na, nb, nc] = indices.map(|i| mesh.normals()[i]);
            // Normals that cancel or are zero leave the flat one.
            ns = (na * w + nb * u + nc * v).try_normalize().unwrap_or(ng);
            if ns.dot(ng) < 0.0 {
                ng = -ng;
            }
        }
        if mesh.flip_normals() {
            (ng, ns) = (-ng, -ns);
        }
        let uv = if mesh.uvs().is_empty() {
            Vec2::new(u, v)
        } else {
            let [ta, tb, tc] = indices.map(|i| mesh.uvs()[i]);
            ta * w + tb * u + tc * v
        };
        let reach = along.abs().max((e1 - along).abs()).max((e2 - along).abs());
        // Errors along the plane do no harm, and each axis has its own: a floor may be a million wide, if it lies along the axes. The
        // normal's own rounding is what is added to it.
        let across = ng.abs() + f32::EPSILON;
        let p_err = PLANE_TEST_ERROR * across.dot(reach + p.abs());
        Self { p, p_err, ng, ns, uv, shape, primitive: triangle }
    }

    /// The point of an analytic shape nearest to `near`, a point given in its unit space that is on it but for rounding.
    #[inline(never)]
    pub fn on_analytic(analytic: &AnalyticShape, shape: u32, near: DVec3) -> Self {
        let phi = |q: DVec3| (q.y.atan2(q.x) / TAU).rem_euclid(1.0);
        let (q, n, uv) = match analytic.kind() {
            AnalyticKind::Sphere => {
                let q = near.normalize_or(DVec3::Z);
                (q, q, (phi(q), q.z.clamp(-1.0, 1.0).acos() / PI))
            }
            AnalyticKind::Disk => {
                let q = near.with_z(0.0);
                (q, DVec3::Z, (q.x.hypot(q.y), phi(q)))
            }
            AnalyticKind::Cylinder => {
                let n = near.with_z(0.0).normalize_or(DVec3::X);
                let q = n.with_z(near.z.clamp(0.0, 1.0));
                (q, n, (phi(q), q.z))
            }
        };
        let p = analytic.to_world().transform_point3(q).as_vec3();
        // Normals go by the inverse transpose.
        let n = (analytic.to_object().matrix3.transpose() * n).normalize();
        let ng = if analytic.flip_normals() { -n } else { n }.as_vec3();
        let m = analytic.to_world().matrix3;
        let extent = (m.x_axis.abs() + m.y_axis.abs() + m.z_axis.abs()).max_element() as f32;
        let p_err = match analytic.kind() {
            AnalyticKind::Sphere => 4.0 * f32::EPSILON * p.abs().max_element() + SPHERE_TILT_ERROR * extent,
            // Straight lines lie in these: a direction rounded below the surface comes back to it across the whole extent.
            AnalyticKind::Disk | AnalyticKind::Cylinder => {
                PLANE_TEST_ERROR * (extent + p.abs().max_element())
            }
        };
        Self { p, p_err, ng, ns: ng, uv: Vec2::new(uv.0 as f32, uv.1 as f32), shape, primitive: 0 }
    }

    /// The point moved off the surface by its error bound, to the side that `d` points to.
    #[inline(always)]
    pub fn offset_towards(&self, d: Vec3) -> Vec3 {
        self.p + self.ng * self.p_err.copysign(d.dot(self.ng))
    }

    /// Direction in which the first texture coordinate grows, which orients anisotropic materials; not normalised.
    /// `None` where there is no such direction: a mesh without texture coordinates, or a triangle that they degenerate on.
    pub fn dp_du(&self, shapes: &[Shape]) -> Option<Vec3> {
        self.dp_duv(shapes).map(|[by_u, _]| by_u)
    }

    /// Derivatives of the position by both texture coordinates. `None` as for [`dp_du`](Self::dp_du).
    pub fn dp_duv(&self, shapes: &[Shape]) -> Option<[Vec3; 2]> {
        let geometry = &shapes[self.shape as usize].geometry;
        let derivatives = derivatives(geometry, self.primitive, self.p.as_dvec3())?.map(DVec3::as_vec3);
        let sound = |d: &Vec3| d.is_finite() && *d != Vec3::ZERO;
        derivatives.iter().all(sound).then_some(derivatives)
    }

    /// The value here of an attribute of the mesh; `None` on other shapes, and if the mesh has none of that name.
    ///
    /// Barycentric coordinates are not kept but found again from the position, so that points cost no more where nothing asks for this.
    pub fn mesh_attribute(&self, shapes: &[Shape], name: &str) -> Option<Rgb> {
        let shape = &shapes[self.shape as usize];
        let (part, primitive) = shape.part(self.primitive);
        let Geometry::Mesh(mesh) = &part.geometry else { return None };
        let attribute = mesh.attribute(name)?;
        let p = match &shape.geometry {
            Geometry::Instance(instance) => instance.to_group().transform_point3(self.p.as_dvec3()),
            Geometry::Mesh(_) | Geometry::Analytic(_) => self.p.as_dvec3(),
        };
        let [a, b, c] = mesh.corners(primitive).map(Vec3::as_dvec3);
        let (e1, e2, q) = (b - a, c - a, p - a);
        let n = e1.cross(e2);
        let area = n.length_squared();
        // A triangle without area has the value of its first corner. Rounding of `p` may lead outside of others.
        let share = |x: f64| if area > 0.0 { (x / area).clamp(0.0, 1.0) } else { 0.0 };
        let u = share(q.cross(e2).dot(n));
        let v = share(e1.cross(q).dot(n)).min(1.0 - u);
        Some(attribute.at(mesh, primitive, [u as f32, v as f32]))
    }

    /// The surface point of a hit at distance `t` along the ray from `o` in direction `d`.
    #[inline(always)]
    #[allow(clippy::too_many_arguments)]
    pub fn from_hit(
        shapes: &[Shape],
        shape: u32,
        primitive: u32,
        u: f32,
        v: f32,
        o: Vec3,
        d: Vec3,
        t: f32,
    ) -> Self {
        match &shapes[shape as usize].geometry {
            Geometry::Mesh(mesh) => Self::on_triangle(mesh, shape, primitive, u, v),
            Geometry::Analytic(analytic) => {
                let world = o.as_dvec3() + d.as_dvec3() * f64::from(t);
                Self::on_analytic(analytic, shape, analytic.to_object().transform_point3(world))
            }
            Geometry::Instance(instance) => Self::on_instance(instance, shape, primitive, u, v, o, d, t),
        }
    }

    /// [`from_hit`](Self::from_hit) on an instance. Not inlined, so that scenes without instances do not pay for it.
    #[inline(never)]
    #[allow(clippy::too_many_arguments)]
    fn on_instance(
        instance: &Instance,
        shape: u32,
        primitive: u32,
        u: f32,
        v: f32,
        o: Vec3,
        d: Vec3,
        t: f32,
    ) -> Self {
        let parts = instance.group().shapes();
        let (part, within) = instance.group().part(primitive);
        let (o, d) = instance.ray_to_group(o, d);
        let local = Self::from_hit(parts, part, within, u, v, o, d, t);
        Self { shape, primitive, ..local.placed(instance, &parts[part as usize].geometry) }
    }

    /// A point of `part` in the group's space, moved to the world.
    ///
    /// A plane that a ray must be `e` away from in the group's space lies `e |M^T n|` away in the world, where M is the instance's map and n
    /// the world normal. To that come the errors that the world adds: rounding of `p`, of its offset, and of normal and direction, by which a
    /// ray may dip towards the surface over the extent of the primitive.
    fn placed(&self, instance: &Instance, part: &Geometry) -> Self {
        let (map, inverse) = (&instance.to_world().matrix3, &instance.to_group().matrix3);
        // Normals go by the inverse transpose, and so keep their side under reflections.
        let turn = |n: Vec3| (inverse.transpose() * n.as_dvec3()).normalize_or_zero().as_vec3();
        let (mut ng, ns) = (turn(self.ng), turn(self.ns));
        if ns.dot(ng) < 0.0 {
            ng = -ng;
        }
        let p = instance.to_world().transform_point3(self.p.as_dvec3()).as_vec3();
        let stretch = (map.transpose() * ng.as_dvec3()).length() as f32;
        let reach = reach(part, self.primitive, map);
        let p_err =
            INSTANCE_ERROR * self.p_err * stretch + PLANE_TEST_ERROR * (reach + p.abs().max_element());
        Self { p, p_err, ng, ns, ..*self }
    }
}

/// How far a primitive extends along any axis when its space is mapped by `map`, or more.
fn reach(geometry: &Geometry, primitive: u32, map: &DMat3) -> f32 {
    let sides = match geometry {
        Geometry::Mesh(mesh) => {
            let [a, b, c] = mesh.corners(primitive).map(Vec3::as_dvec3);
            [*map * (b - a), *map * (c - a), DVec3::ZERO]
        }
        Geometry::Analytic(analytic) => {
            let m = *map * analytic.to_world().matrix3;
            [m.x_axis, m.y_axis, m.z_axis]
        }
        // Groups hold none.
        Geometry::Instance(_) => [DVec3::ZERO; 3],
    };
    sides.into_iter().map(DVec3::abs).sum::<DVec3>().max_element() as f32
}

/// Derivatives by texture coordinates at the point `p` of a primitive; perhaps not finite or 0. `None` for meshes without texture coordinates.
fn derivatives(geometry: &Geometry, primitive: u32, p: DVec3) -> Option<[DVec3; 2]> {
    Some(match geometry {
        Geometry::Mesh(mesh) if mesh.uvs().is_empty() => return None,
        Geometry::Mesh(mesh) => {
            let [a, b, c] = mesh.corners(primitive);
            let [ta, tb, tc] = mesh.triangles()[primitive as usize].map(|i| mesh.uvs()[i as usize]);
            let (d1, d2) = ((tb - ta).as_dvec2(), (tc - ta).as_dvec2());
            let (e1, e2) = ((b - a).as_dvec3(), (c - a).as_dvec3());
            // The inverse of a 2x2 matrix.
            let determinant = d1.perp_dot(d2);
            [(e1 * d2.y - e2 * d1.y) / determinant, (e2 * d1.x - e1 * d2.x) / determinant]
        }
        Geometry::Analytic(analytic) => {
            let q = analytic.to_object().transform_point3(p);
            let round = DVec3::new(-q.y, q.x, 0.0) * TAU;
            let r = q.x.hypot(q.y);
            let local = match analytic.kind() {
                AnalyticKind::Disk => [q.with_z(0.0) / r, round],
                AnalyticKind::Sphere => [round, DVec3::new(q.x * q.z / r, q.y * q.z / r, -r) * PI],
                AnalyticKind::Cylinder => [round, DVec3::Z],
            };
            local.map(|d| analytic.to_world().transform_vector3(d))
        }
        Geometry::Instance(instance) => {
            let (part, within) = instance.group().part(primitive);
            let part = &instance.group().shapes()[part as usize].geometry;
            let local = derivatives(part, within, instance.to_group().transform_point3(p))?;
            local.map(|d| instance.to_world().transform_vector3(d))
        }
    })
}

/// Of edges below 1e-19 and above 1e19 the squares leave the range of f32.
#[cold]
fn normal_of_extreme_edges(e1: Vec3, e2: Vec3) -> Vec3 {
    e1.as_dvec3().cross(e2.as_dvec3()).normalize_or_zero().as_vec3()
}
