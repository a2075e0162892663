//! Counts allocations during a pass: `cargo bench --bench allocations`. Fails if there is one for every hundredth path or more.
//!
//! Scratch memory grows in the first passes and is kept; what is left belongs to the pass as a whole (rayon, the film), not to its paths.

use std::path::Path;

use glam::UVec2;
use helmholtz::film::{AovSet, Film};
use helmholtz::integrators::Integrator;
use helmholtz::query::BuildQuality;
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::render::{Control, Stop, Target, render};
use helmholtz::scene::PixelRect;
use helmholtz::scene::load::{LoadOptions, load};
use helmholtz::transport::World;

fn main() {
    // The counter is one of the thread's own.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).use_current_thread().build();
    let _pool = pool.expect("a thread pool");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box.xml");
    let mut scene = load(&path, &LoadOptions::default()).unwrap_or_else(|error| panic!("{error}")).scene;
    let size = UVec2::splat(256);
    (scene.film.size, scene.film.crop) = (size, PixelRect { min: UVec2::ZERO, size });
    let world = World::new(&scene);
    let query = ObvhsQuery::new(&scene.shapes, BuildQuality::default());
    let paths = u64::from(size.x * size.y);
    for (name, count) in [("path", None), ("ptracer", None), ("bdpt", None), ("vpl", Some("10"))] {
        let parameters: Vec<_> =
            count.map(|n: &str| ("count".to_owned(), n.to_owned())).into_iter().collect();
        let integrator = Integrator::new(name, &parameters).expect("a known integrator");
        let unit = world.lights.radiance_unit();
        let mut film = Film::new(&scene.film, AovSet::default(), unit).expect("a film");
        let mut last = 0;
        let count = |film: &mut Film, passes| {
            let stop = Stop { passes, time: None };
            let target = Target { integrator, seed: 0 };
            let measured = allocation_counter::measure(|| {
                render(&world, &query, &target, film, &stop, |_| Control::Continue).expect("rendered");
            });
            measured.count_total
        };
        // The same work at the start of a render, then with one pass more: what is between is that pass.
        for passes in [0..4, 4..9] {
            last = count(&mut film, passes).abs_diff(last);
        }
        println!("{name}: {last} allocations in a pass of {paths} paths");
        assert!(last * 100 < paths, "{name} allocates for its paths");
    }
}
