//! The local coordinates that scattering is computed in.

use glam::Vec3;

/// Orthonormal, right-handed basis with `z` = shading normal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// First tangent: along it goes the first roughness of an anisotropic material.
    pub x: Vec3,
    /// Second tangent.
    pub y: Vec3,
    /// The normal.
    pub z: Vec3,
}

impl Frame {
    /// Completes a unit normal to a basis (Duff et al. 2017, "Building an orthonormal basis, revisited").
    #[inline]
    pub fn from_z(n: Vec3) -> Self {
        let sign = 1.0_f32.copysign(n.z);
        let a = -1.0 / (sign + n.z);
        let b = n.x * n.y * a;
        Self {
            x: Vec3::new(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x),
            y: Vec3::new(b, sign + n.y * n.y * a, -n.y),
            z: n,
        }
    }

    /// The basis whose `x` is the part of `tangent` across the unit normal; any, if there is none.
    #[inline]
    pub fn from_z_and_tangent(n: Vec3, tangent: Vec3) -> Self {
        match (tangent - n * n.dot(tangent)).try_normalize() {
            Some(x) => Self { x, y: n.cross(x), z: n },
            None => Self::from_z(n),
        }
    }

    /// World direction to local.
    #[inline]
    pub fn to_local(&self, w: Vec3) -> Vec3 {
        Vec3::new(self.x.dot(w), self.y.dot(w), self.z.dot(w))
    }

    /// Local direction to world.
    #[inline]
    pub fn to_world(&self, w: Vec3) -> Vec3 {
        self.x * w.x + self.y * w.y + self.z * w.z
    }
}
