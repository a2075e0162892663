//! Forward and bidirectional path tracing: against the backward path tracer, against closed forms, and against themselves.
//!
//! What bit the users of other renderers, by numbers that tests refer to:
//!
//! | | trouble | tests |
//! |---|---|---|
//! | 1 | the adjoint of shading normals is missing (pbrt-v4 385, 526, 13) | `leaning`; `kinds`: all named `smooth`, `bumpmap`, `normalmap`, and the long runs |
//! | 2 | light leaves a mirrored shape by another side for each strategy (pbrt-v3 229) | `kinds`: `mirrored_mesh_thin_smooth`, `cylinder_crop_mask` |
//! | 3 | crops count too few splats (pbrt-v4 347), borders are dark (`LuxCore` 237, 239) | `forward::crops_and_sizes_do_not_change_brightness`, `film::splats` |
//! | 4 | blocked lens points (pbrt-v4 458); one lens point for all vertices (`LuxCore` 667) | `forward::a_lens_half_covered`, `kinds`: all named `orthographic` |
//! | 5 | spikes between vertices that nearly coincide (pbrt-v3 73) | `forward::vertices_that_nearly_coincide_are_no_fireflies` |
//! | 6 | photons hit their own lamp (Mitsuba 42, 43) | `forward::light_paths_do_not_hit_their_own_lamp` |
//! | 7 | the environment changes as shapes go; the empty scene is black (Mitsuba 80) | `forward::the_environment_stays_as_shapes_come_and_go` |
//! | 8 | photons from behind (Mitsuba 145) | `photons::light_does_not_leak` |
//! | 9 | brightness depends on distance (`LuxCore` 678) | `forward::brightness_does_not_depend_on_distance` |
//! | 10 | scale (`LuxCore` 79, Mitsuba 1871) | `forward::images_survive_scale`, `weights::weights_survive_scale` |
//! | 11 to 13 | backends | `query`, `query_embree`, `query_obvhs` |
//! | 14 | Russian roulette within recursive weights | `kinds::roulette_is_no_part_of_the_weights` |
//! | 15 | a splat that is no number ends the render (pbrt-v4 134) | `film::splats::splats_that_are_no_numbers_are_dropped_and_counted` |

pub(crate) mod agreement;
mod forward;
mod kinds;
mod leaning;
mod photon_bias;
mod photon_files;
mod photons;
mod strategies;
mod vpl;
mod weights;

use helmholtz::film::{AovSet, Film};
use helmholtz::integrators::Integrator;
use helmholtz::query::BuildQuality;
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::render::{Control, Stop, Target, render};
use helmholtz::scene::Scene;
use helmholtz::transport::World;

/// Image of two passes, and the number of photons or virtual lights stored.
fn image_by_threads(scene: &Scene, integrator: Integrator, threads: usize) -> (Vec<f32>, u64) {
    let query = ObvhsQuery::new(&scene.shapes, BuildQuality::Medium);
    let world = World::new(scene);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| {
        let mut film =
            Film::new(&scene.film, AovSet::default(), world.lights.radiance_unit()).expect("a film");
        let stop = Stop { passes: 3..5, time: None };
        let target = Target { integrator, seed: 7 };
        let done =
            render(&world, &query, &target, &mut film, &stop, |_| Control::Continue).expect("rendered");
        assert!(film.dropped().is_none(), "{:?}", film.dropped());
        (film.develop().floats("G").expect("a colour").to_vec(), done.photons)
    })
}
