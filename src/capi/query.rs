//! Bare ray queries, for callers who want nothing but the backends.

use super::arguments::check_array;
use super::border::{Outcome, call};
use super::scene::SCENES;
use super::types::{helmholtz_hit, helmholtz_ray, helmholtz_scene, helmholtz_status};
use crate::query::{AnyQuery, Hit, Ray, RayQuery, with_query};

impl From<&helmholtz_ray> for Ray {
    #[inline(always)]
    fn from(ray: &helmholtz_ray) -> Self {
        Self { o: ray.origin.into(), d: ray.direction.into(), t_min: ray.t_min, t_max: ray.t_max }
    }
}

impl From<Option<Hit>> for helmholtz_hit {
    #[inline(always)]
    fn from(hit: Option<Hit>) -> Self {
        match hit {
            Some(Hit { shape, primitive, u, v, t }) => Self { shape, primitive, u, v, t },
            None => Self { shape: u32::MAX, primitive: u32::MAX, u: 0.0, v: 0.0, t: f32::INFINITY },
        }
    }
}

/// Answers each ray on the calling thread.
///
/// # Safety
/// Both arrays have `count` elements and do not overlap.
unsafe fn answer<T>(
    scene: helmholtz_scene,
    rays: *const helmholtz_ray,
    answers: *mut T,
    count: usize,
    batch: impl FnOnce(&AnyQuery, *const helmholtz_ray, *mut T),
) -> Outcome {
    check_array(rays, count, "rays")?;
    check_array(answers.cast_const(), count, "answers")?;
    SCENES.get(scene.id)?.with_prepared(|prepared| batch(prepared.query(), rays, answers))
}

/// The nearest hit of each of `count` rays, on the calling thread. A ray with a NaN or infinite origin or direction hits nothing.
///
/// Any thread, any number of them at a time. Builds what is needed if the scene has changed.
///
/// # Safety
/// `rays` and `hits` have `count` elements and do not overlap.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_intersect(
    scene: helmholtz_scene,
    rays: *const helmholtz_ray,
    hits: *mut helmholtz_hit,
    count: usize,
) -> helmholtz_status {
    // SAFETY: this function's own contract.
    call(|| unsafe {
        answer(scene, rays, hits, count, |query, rays, hits| {
            with_query!(query, query => {
                for i in 0..count {
                    let ray = Ray::from(&*rays.add(i));
                    hits.add(i).write(query.intersect(&ray).into());
                }
            });
        })
    })
}

/// Whether each of `count` rays hits anything, 1 or 0, on the calling thread.
///
/// Any thread, any number of them at a time. Builds what is needed if the scene has changed.
///
/// # Safety
/// `rays` and `occluded` have `count` elements and do not overlap.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn helmholtz_occluded(
    scene: helmholtz_scene,
    rays: *const helmholtz_ray,
    occluded: *mut u8,
    count: usize,
) -> helmholtz_status {
    // SAFETY: this function's own contract.
    call(|| unsafe {
        answer(scene, rays, occluded, count, |query, rays, occluded| {
            with_query!(query, query => {
                for i in 0..count {
                    let ray = Ray::from(&*rays.add(i));
                    occluded.add(i).write(u8::from(query.occluded(&ray)));
                }
            });
        })
    })
}
