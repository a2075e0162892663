//! The camera as an emitter of importance: rays from it, and its response to light that arrives.
//!
//! Film positions are in pixels, (0, 0) being the upper left corner of the full film, y down. Importance is scaled
//! *per pixel*: for radiance L arriving uniformly, the integral of We L cos over lens and directions, with a reconstruction filter
//! that integrates to 1 over the film, is L. So a light path's contribution times the filter is what one pixel gets from it.

use std::f32::consts::PI;

use glam::{DMat3, DVec2, Mat3, UVec2, Vec2, Vec3};

use crate::query::Ray;
use crate::sampling::warp::square_to_disc;
use crate::scene::{Camera, FovAxis, Lens};

/// A camera ready for use; see [`Camera`] for its meaning.
#[derive(Debug, Clone)]
pub struct CameraModel {
    to_world: Mat3,
    to_camera: Mat3,
    position: Vec3,
    /// Half extents of the film at distance 1; of an orthographic camera in camera space.
    half_extent: Vec2,
    /// Of the film, by which the picture is moved.
    offset: Vec2,
    /// Rays are parallel: the camera is orthographic.
    is_parallel: bool,
    film_size: Vec2,
    /// Area of a pixel at distance 1; of an orthographic camera across its direction.
    pixel_area: f32,
    /// Lens radius in world units, 0 for a pinhole.
    aperture_radius: f32,
    /// In world units.
    focus_distance: f32,
    near_clip: f32,
    far_clip: f32,
}

/// How the camera responds to light from a point.
#[derive(Debug, Clone, Copy)]
pub struct CameraConnection {
    /// Point on the lens.
    pub p: Vec3,
    /// Unit direction from the lens to the point.
    pub d: Vec3,
    /// Where the point is seen on the film, in pixels.
    pub film: Vec2,
    /// Importance We of direction `d` at `p`, per pixel, for a lens point density of 1 (pinhole) or 1 / area (thin lens).
    pub importance: f32,
    /// Cosine between `d` and the viewing direction.
    pub cos: f32,
    /// The camera sees nothing nearer to the lens along `d` than this.
    pub t_min: f32,
}

/// A ray of light that met the lens by chance.
#[derive(Debug, Clone, Copy)]
pub struct LensHit {
    /// Where the light is seen on the film, in pixels.
    pub film: Vec2,
    /// Distance along the ray.
    pub t: f32,
    /// Importance We of the direction that the light came from, as of [`CameraModel::we`].
    pub importance: f32,
    /// Cosine between the ray and the viewing direction, positive.
    pub cos: f32,
}

impl CameraConnection {
    /// A ray towards the lens that ends where the camera begins to see.
    #[inline]
    pub fn shorten(&self, ray: Ray) -> Ray {
        Ray { t_max: ray.t_max - self.t_min, ..ray }
    }
}

impl CameraModel {
    /// Prepares a camera for a film of the given full size.
    pub fn new(camera: &Camera, film_size: UVec2) -> Self {
        if camera.lens == Lens::Orthographic {
            return Self::orthographic(camera, film_size);
        }
        let size = film_size.as_dvec2();
        let half_tan = (camera.fov.to_radians() * 0.5).tan();
        let across = match camera.fov_axis {
            FovAxis::X => size.x,
            FovAxis::Y => size.y,
            FovAxis::Diagonal => size.length(),
            FovAxis::Smaller => size.min_element(),
            FovAxis::Larger => size.max_element(),
        };
        let half_extent: DVec2 = size * (half_tan / across);
        // A similarity: its columns have one length. Dividing by it leaves a rotation, perhaps with a reflection.
        let matrix = camera.to_world.matrix3;
        let scale = matrix.z_axis.length();
        let rotation = (matrix * scale.recip()).as_mat3();
        let (aperture_radius, focus_distance) = match camera.lens {
            Lens::Pinhole | Lens::Orthographic => (0.0, 1.0),
            Lens::Thin { aperture_radius, focus_distance } => {
                (aperture_radius * scale, focus_distance * scale)
            }
        };
        Self {
            to_world: rotation,
            to_camera: rotation.transpose(),
            position: camera.to_world.translation.as_vec3(),
            half_extent: half_extent.as_vec2(),
            offset: camera.principal_point.as_vec2(),
            is_parallel: false,
            film_size: film_size.as_vec2(),
            pixel_area: (4.0 * half_extent.x * half_extent.y / (size.x * size.y)) as f32,
            aperture_radius: aperture_radius as f32,
            focus_distance: focus_distance as f32,
            near_clip: (camera.near_clip * scale) as f32,
            far_clip: (camera.far_clip * scale) as f32,
        }
    }

    fn orthographic(camera: &Camera, film_size: UVec2) -> Self {
        let size = film_size.as_dvec2();
        let half_extent = DVec2::new(1.0, size.y / size.x);
        let map = camera.to_world.matrix3;
        let scale = map.z_axis.length();
        let to_world = DMat3::from_cols(map.x_axis, map.y_axis, map.z_axis / scale);
        // The volume over a unit of depth along the rays is the area across them, even if they are not at right angles to the film.
        let area = to_world.determinant().abs() * 4.0 * half_extent.x * half_extent.y;
        let near_clip = camera.near_clip * scale;
        Self {
            to_world: to_world.as_mat3(),
            to_camera: to_world.inverse().as_mat3(),
            position: camera.to_world.translation.as_vec3(),
            half_extent: half_extent.as_vec2(),
            offset: camera.principal_point.as_vec2(),
            is_parallel: true,
            film_size: film_size.as_vec2(),
            pixel_area: (area / (size.x * size.y)) as f32,
            aperture_radius: 0.0,
            focus_distance: 1.0,
            near_clip: near_clip as f32,
            far_clip: (near_clip + camera.far_clip - camera.near_clip) as f32,
        }
    }

    /// Where the pinhole or the middle of the lens is.
    pub fn position(&self) -> Vec3 {
        self.position
    }

    /// Whether all rays are parallel. Their density then does not spread with distance: what says per solid angle is per area across them.
    pub fn is_parallel(&self) -> bool {
        self.is_parallel
    }

    /// Whether the camera is a pinhole or orthographic, which no light path can hit.
    pub fn is_delta(&self) -> bool {
        self.aperture_radius == 0.0
    }

    /// Area of the lens; 1 stands for the point of a pinhole and the direction of an orthographic camera, whose densities are deltas.
    pub fn lens_area(&self) -> f32 {
        if self.is_delta() { 1.0 } else { PI * self.aperture_radius * self.aperture_radius }
    }

    /// Viewing direction, unit length.
    pub fn forward(&self) -> Vec3 {
        self.to_world.z_axis
    }

    fn lens_point(&self, u: Vec2) -> Vec2 {
        if self.is_delta() { Vec2::ZERO } else { square_to_disc(u) * self.aperture_radius }
    }

    /// The ray through a film position, from a lens point chosen by `u`. Its weight is 1: the density of film position and lens
    /// point is the camera's importance times cosine.
    #[inline(always)]
    pub fn spawn_ray(&self, film: Vec2, u: Vec2) -> Ray {
        let plane = (Vec2::ONE - 2.0 * (film / self.film_size + self.offset)) * self.half_extent;
        if self.is_parallel {
            let o = self.position + self.to_world * plane.extend(0.0);
            return Ray { o, d: self.forward(), t_min: self.near_clip, t_max: self.far_clip };
        }
        let lens = self.lens_point(u);
        let focus = plane.extend(1.0) * self.focus_distance;
        let d = if self.is_delta() { plane.extend(1.0) } else { focus - lens.extend(0.0) }.normalize();
        Ray {
            o: self.position + self.to_world * lens.extend(0.0),
            d: (self.to_world * d).normalize(),
            t_min: self.near_clip / d.z,
            t_max: self.far_clip / d.z,
        }
    }

    /// Film position and cosine of the ray that leaves lens point `p` (world) in direction `d`; `None` if it misses the film, as all but one
    /// direction do with an orthographic camera.
    #[inline]
    fn project(&self, p: Vec3, d: Vec3) -> Option<(Vec2, f32)> {
        let local = self.to_camera * d;
        if local.z <= 0.0 || self.is_parallel {
            return None;
        }
        let mut plane = local.truncate() / local.z;
        if !self.is_delta() {
            let lens = (self.to_camera * (p - self.position)).truncate();
            plane += lens / self.focus_distance;
        }
        Some((self.film_at(plane), local.z))
    }

    /// The film position that a point of the plane at distance 1 stands for.
    #[inline]
    fn film_at(&self, plane: Vec2) -> Vec2 {
        ((Vec2::ONE - plane / self.half_extent) * 0.5 - self.offset) * self.film_size
    }

    /// Importance per pixel of the ray that leaves lens point `p` in direction `d`, and where it crosses the film.
    /// The film is unbounded here: reconstruction filters reach over its border, and the film cuts what it does not hold.
    #[inline]
    pub fn we(&self, p: Vec3, d: Vec3) -> Option<(f32, Vec2)> {
        let (film, cos) = self.project(p, d)?;
        let cos2 = cos * cos;
        Some((1.0 / (self.pixel_area * self.lens_area() * cos2 * cos2), film))
    }

    /// Density per solid angle of direction `d` for one sample of one pixel, given lens point `p`. Of an orthographic camera, for its own rays
    /// only, the density per area across them.
    #[inline]
    pub fn pdf_we_w(&self, p: Vec3, d: Vec3) -> f32 {
        if self.is_parallel {
            return 1.0 / self.pixel_area;
        }
        self.project(p, d).map_or(0.0, |(_, cos)| 1.0 / (self.pixel_area * cos * cos * cos))
    }

    /// Connects a world point to a lens point chosen by `u`. `None` if the point is behind the lens or clipped.
    /// The lens point has density 1 / [`lens_area`](Self::lens_area) (the delta of a pinhole counts as 1). An orthographic camera has one lens point
    /// for each point; its importance is scaled so that divided by the squared distance it is the density of camera rays per area.
    #[inline]
    pub fn sample_wi(&self, reference: Vec3, u: Vec2) -> Option<CameraConnection> {
        if self.is_parallel {
            return self.connect_parallel(reference);
        }
        let p = self.position + self.to_world * self.lens_point(u).extend(0.0);
        let to = reference - p;
        let depth = to.dot(self.forward());
        if !(depth > self.near_clip && depth < self.far_clip) {
            return None;
        }
        let d = to.normalize();
        let (importance, film) = self.we(p, d)?;
        let cos = d.dot(self.forward());
        Some(CameraConnection { p, d, film, importance, cos, t_min: self.near_clip / cos })
    }

    /// The camera's ray from the lens point chosen by `u` in a direction, for what is infinitely far away; with its importance.
    /// `None` if the camera looks the other way.
    #[inline]
    pub fn sample_distant(&self, d: Vec3, u: Vec2) -> Option<(CameraConnection, Ray)> {
        let p = self.position + self.to_world * self.lens_point(u).extend(0.0);
        let (importance, film) = self.we(p, d)?;
        let cos = d.dot(self.forward());
        let t_min = self.near_clip / cos;
        let ray = Ray { o: p, d, t_min, t_max: self.far_clip / cos };
        Some((CameraConnection { p, d, film, importance, cos, t_min }, ray))
    }

    /// Where light that travels along `ray` and meets a surface at distance `t_surface` (or none: infinity) hits the lens. Light from a surface
    /// (`is_near`) must lie between the clipping planes to be seen, light from infinity need not.
    #[inline]
    pub fn hit(&self, ray: &Ray, t_surface: f32, is_near: bool) -> Option<LensHit> {
        let cos = -ray.d.dot(self.forward());
        if self.is_delta() || cos <= 0.0 {
            return None;
        }
        let depth = (ray.o - self.position).dot(self.forward());
        let t = depth / cos;
        let unseen = depth <= self.near_clip || (is_near && depth >= self.far_clip);
        if unseen || t_surface < t - self.near_clip / cos {
            return None;
        }
        let p = ray.o + t * ray.d;
        if p.distance_squared(self.position) > self.aperture_radius * self.aperture_radius {
            return None;
        }
        let (importance, film) = self.we(p, -ray.d)?;
        Some(LensHit { film, t, importance, cos })
    }

    #[inline]
    fn connect_parallel(&self, reference: Vec3) -> Option<CameraConnection> {
        let local = self.to_camera * (reference - self.position);
        if !(local.z > self.near_clip && local.z < self.far_clip) {
            return None;
        }
        let p = self.position + self.to_world * local.with_z(0.0);
        let importance = reference.distance_squared(p) / self.pixel_area;
        Some(CameraConnection {
            p,
            d: self.forward(),
            film: self.film_at(local.truncate()),
            importance,
            cos: 1.0,
            t_min: self.near_clip,
        })
    }
}
