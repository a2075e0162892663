//! Cameras as the scene file states them; [`crate::transport::camera`] evaluates their importance.

use glam::{DAffine3, DVec2};

/// What stands in front of the film.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Lens {
    /// A point: everything is in focus.
    Pinhole,
    /// A disc (Mitsuba's `thinlens`).
    Thin {
        /// Radius of the disc in camera units.
        aperture_radius: f64,
        /// Distance along the viewing direction at which things are in focus, camera units.
        focus_distance: f64,
    },
    /// None: parallel rays (Mitsuba's `orthographic`). The width of the film spans -1 to 1 in camera space, the height as much as its pixels.
    Orthographic,
}

/// Which extent of the film the field of view is measured across (Mitsuba's `fov_axis`).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FovAxis {
    /// The width.
    X,
    /// The height.
    Y,
    /// The diagonal.
    Diagonal,
    /// The shorter of width and height.
    Smaller,
    /// The longer of width and height.
    Larger,
}

/// A camera. It looks along +z of its own space with +y up and, as in Mitsuba, +x to the *left* of the image.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Camera space to world space: a similarity (rotation, translation, uniform scale, perhaps a reflection); of an orthographic camera
    /// any invertible map.
    pub to_world: DAffine3,
    /// Field of view, degrees, in (0, 180); without effect on an orthographic camera.
    pub fov: f64,
    /// What [`fov`](Self::fov) is measured across.
    pub fov_axis: FovAxis,
    /// Pinhole, thin lens or none.
    pub lens: Lens,
    /// By how much of the full film's width and height its picture is moved, to the left and up (Mitsuba's `principal_point_offset`).
    pub principal_point: DVec2,
    /// Nothing nearer than this distance along the viewing direction is seen, camera units.
    pub near_clip: f64,
    /// Nothing farther than this is seen. As in Mitsuba, an orthographic camera scales the one distance but not the depth between the two.
    pub far_clip: f64,
}
