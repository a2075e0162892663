//! Measures what the C interface costs beside direct calls: a render, a batch of rays, and rays one by one.
//!
//! `cargo bench --bench capi`. Times are of the processor (`/proc`), the least of several rounds in turn, so that other work on the machine weighs on neither.
#![allow(unsafe_code)]

use glam::Vec3;
use helmholtz::capi::{
    helmholtz_hit, helmholtz_intersect, helmholtz_ray, helmholtz_render, helmholtz_render_free,
    helmholtz_render_options, helmholtz_render_start, helmholtz_render_wait, helmholtz_scene,
    helmholtz_scene_commit, helmholtz_scene_free, helmholtz_scene_load, helmholtz_scene_set_backend,
    helmholtz_status,
};
use helmholtz::film::{AovSet, Film};
use helmholtz::integrators::Integrator;
#[cfg(feature = "embree")]
use helmholtz::query::embree::{EmbreeQuery, EmbreeSettings};
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::{BuildQuality, Ray, RayQuery};
use helmholtz::render::{Control, Stop, Target, render};
use helmholtz::sampling::sampler::mix;
use helmholtz::scene::Scene;
use helmholtz::scene::load::{LoadOptions, load};
use helmholtz::transport::World;
use std::path::Path;

const SCENE: &std::ffi::CStr = c"scenes/cornell-box.xml";
const RAYS: u64 = 1_000_000;
const ROUNDS: usize = 7;
const PASSES: u32 = 16;

fn ok(status: helmholtz_status) {
    assert_eq!(status, helmholtz_status::HELMHOLTZ_OK);
}

/// Seconds that this process, or this thread of it, has used the processor.
fn processor_seconds(thread: bool) -> f64 {
    if thread {
        let text = std::fs::read_to_string("/proc/thread-self/schedstat").expect("Linux");
        return text.split(' ').next().and_then(|n| n.parse::<f64>().ok()).expect("a number") * 1e-9;
    }
    let text = std::fs::read_to_string("/proc/self/stat").expect("Linux");
    let fields = text.rsplit(')').next().expect("fields").split_whitespace().skip(11).take(2);
    fields.map(|ticks| ticks.parse::<f64>().expect("a number")).sum::<f64>() * 0.01
}

/// Runs both in turn and prints the least time of each.
fn compare(what: &str, thread: bool, mut direct: impl FnMut(), mut by_c: impl FnMut()) {
    let mut best = [f64::INFINITY; 2];
    for _ in 0..ROUNDS {
        for (i, run) in [&mut direct as &mut dyn FnMut(), &mut by_c].into_iter().enumerate() {
            let start = processor_seconds(thread);
            run();
            best[i] = best[i].min(processor_seconds(thread) - start);
        }
    }
    let [direct, c] = best;
    println!("{what}: direct {direct:.3} s, by C {c:.3} s: {:+.1} %", (c / direct - 1.0) * 100.0);
}

fn rays() -> Vec<Ray> {
    let uniform = |k: u64| (mix(k) >> 11) as f64 * 2f64.powi(-52) - 1.0;
    let vector = |k: u64| Vec3::new(uniform(k) as f32, uniform(k + 1) as f32, uniform(k + 2) as f32);
    (0..RAYS).map(|i| Ray::new(vector(6 * i) * 0.9, vector(6 * i + 3).normalize())).collect()
}

fn compare_rays(scene: helmholtz_scene, query: &impl RayQuery) {
    let rays = rays();
    let none = helmholtz_hit { shape: 0, primitive: 0, u: 0.0, v: 0.0, t: 0.0 };
    let mut hits = vec![none; rays.len()];
    let mut direct = vec![None; rays.len()];
    let c_rays: Vec<_> = rays
        .iter()
        .map(|r| helmholtz_ray {
            origin: r.o.to_array(),
            t_min: r.t_min,
            direction: r.d.to_array(),
            t_max: r.t_max,
        })
        .collect();
    let mut intersect = || {
        for (ray, hit) in rays.iter().zip(&mut direct) {
            *hit = query.intersect(ray);
        }
    };
    let name = query.name();
    compare(&format!("{name}, a batch of {RAYS} rays"), true, &mut intersect, || {
        // SAFETY: both arrays have that many elements.
        ok(unsafe { helmholtz_intersect(scene, c_rays.as_ptr(), hits.as_mut_ptr(), c_rays.len()) });
    });
    compare(&format!("{name}, {RAYS} rays one by one"), true, &mut intersect, || {
        for (ray, hit) in c_rays.iter().zip(&mut hits) {
            // SAFETY: one element each.
            ok(unsafe { helmholtz_intersect(scene, ray, hit, 1) });
        }
    });
    let same = direct.iter().zip(&hits).all(|(a, b)| a.map_or(u32::MAX, |a| a.shape) == b.shape);
    assert!(same, "the two see different things");
}

fn compare_renders(scene: helmholtz_scene, rust: &Scene, query: &impl RayQuery) {
    let world = World::new(rust);
    let target = Target { integrator: Integrator::new("path", &[]).expect("an integrator"), seed: 0 };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a pool");
    let direct = || {
        let mut film =
            Film::new(&rust.film, AovSet::default(), world.lights.radiance_unit()).expect("a film");
        let stop = Stop { passes: 0..PASSES, time: None };
        let go_on = |_: &_| Control::Continue;
        pool.install(|| render(&world, query, &target, &mut film, &stop, go_on)).expect("a render");
    };
    let by_c = || {
        let options = helmholtz_render_options {
            size: size_of::<helmholtz_render_options>(),
            integrator: c"path".as_ptr(),
            aovs: std::ptr::null(),
            seed: 0,
            first_pass: 0,
            pass_count: PASSES,
            seconds: 0.0,
            threads: 1,
            progress: None,
            user: std::ptr::null_mut(),
        };
        let mut render = helmholtz_render { id: 0 };
        // SAFETY: the pointers are valid.
        ok(unsafe { helmholtz_render_start(scene, &raw const options, &raw mut render) });
        ok(helmholtz_render_wait(render));
        ok(helmholtz_render_free(render));
    };
    compare(&format!("{}, a render of {PASSES} passes", query.name()), false, direct, by_c);
}

fn main() {
    let loaded = load(Path::new(SCENE.to_str().expect("UTF-8")), &LoadOptions::default()).expect("the scene");
    let mut scene = helmholtz_scene { id: 0 };
    // SAFETY: the pointers are valid or null.
    ok(unsafe { helmholtz_scene_load(SCENE.as_ptr(), std::ptr::null(), &raw mut scene) });
    #[cfg(feature = "embree")]
    {
        let query = EmbreeQuery::new(&loaded.scene.shapes, EmbreeSettings::default()).expect("Embree");
        compare_rays(scene, &query);
        compare_renders(scene, &loaded.scene, &query);
    }
    // SAFETY: a text.
    ok(unsafe { helmholtz_scene_set_backend(scene, c"obvhs".as_ptr(), 0) });
    ok(helmholtz_scene_commit(scene));
    let query = ObvhsQuery::new(&loaded.scene.shapes, BuildQuality::Medium);
    compare_rays(scene, &query);
    compare_renders(scene, &loaded.scene, &query);
    ok(helmholtz_scene_free(scene));
}
