//! Measures what `vendor-notes/measurements.md` reports of photon maps: tracing photons in the Cornell box, building the map, and looking for
//! photons in it, beside the k-d tree of the crate `kiddo` and a hash grid.
//!
//! `cargo bench --bench photons -- [most photons in thousands, 10000]`
//!
//! Distances are Euclidean here, so that all do the same work: our map is asked about sites without a normal.

use std::num::NonZero;
use std::path::Path;
use std::time::Instant;

use glam::{IVec3, Vec3};
use helmholtz::film::{AovSet, Film};
use helmholtz::integrators::photon_map::{NearestHeap, Photon, PhotonMap, PhotonMapper, Site};
use helmholtz::integrators::{Integrator, Pass};
use helmholtz::query::{Backend, RayQuery};
use helmholtz::sampling::sampler::mix;
use helmholtz::scene::Scene;
use helmholtz::scene::load::{LoadOptions, load};
use helmholtz::transport::World;
use kiddo::SquaredEuclidean;
use kiddo::immutable::float::kdtree::ImmutableKdTree;

const K: usize = 100;
const QUERIES: usize = 20_000;
const ROUNDS: usize = 5;

/// Photons sorted by the cell that they are in, for discs of one radius.
struct Grid {
    cell: f32,
    /// Where the photons of each bucket begin.
    starts: Vec<u32>,
    photons: Vec<Photon>,
}

impl Grid {
    /// Cells are as wide as a disc, so that at most eight have a part of it.
    fn new(photons: &[Photon], radius: f32) -> Self {
        let buckets = photons.len().next_power_of_two();
        let mut this = Self { cell: 2.0 * radius, starts: vec![0; buckets + 1], photons: photons.to_vec() };
        let bucket: Vec<usize> =
            photons.iter().map(|p| this.bucket(this.place(p.position).floor().as_ivec3())).collect();
        for &b in &bucket {
            this.starts[b] += 1;
        }
        let mut sum = 0;
        for start in &mut this.starts {
            sum += *start;
            *start = sum;
        }
        for (photon, &b) in photons.iter().zip(&bucket) {
            this.starts[b] -= 1;
            this.photons[this.starts[b] as usize] = *photon;
        }
        this
    }

    fn place(&self, p: Vec3) -> Vec3 {
        p / self.cell
    }

    fn bucket(&self, cell: IVec3) -> usize {
        let [x, y, z] = cell.to_array().map(|c| u64::from(c as u32));
        mix(x ^ (y << 21) ^ (z << 42)) as usize & (self.starts.len() - 2)
    }

    fn count_within(&self, p: Vec3, radius: f32) -> usize {
        let first = (self.place(p) - 0.5).floor().as_ivec3();
        let mut seen = [usize::MAX; 8];
        let mut found = 0;
        for i in 0..8 {
            let bucket = self.bucket(first + IVec3::new(i & 1, i >> 1 & 1, i >> 2));
            if seen.contains(&bucket) {
                continue;
            }
            seen[i as usize] = bucket;
            let range = self.starts[bucket] as usize..self.starts[bucket + 1] as usize;
            found += self.photons[range]
                .iter()
                .filter(|q| q.position.distance_squared(p) < radius * radius)
                .count();
        }
        found
    }
}

fn seconds<T>(run: impl FnOnce() -> T) -> (T, f64) {
    let start = Instant::now();
    let result = run();
    (result, start.elapsed().as_secs_f64())
}

/// The least time of some rounds, in microseconds per query, and the sum of what they return.
fn per_query(sites: &[Vec3], mut query: impl FnMut(Vec3) -> f64) -> (f64, f64) {
    let round = || seconds(|| sites.iter().map(|&p| query(p)).sum::<f64>());
    let rounds: Vec<(f64, f64)> = std::iter::repeat_with(round).take(ROUNDS).collect();
    let least = rounds.iter().map(|r| r.1).fold(f64::INFINITY, f64::min);
    (1e6 * least / sites.len() as f64, rounds[0].0)
}

fn mapper(photons: usize) -> PhotonMapper {
    let parameters = [("photons", photons.to_string()), ("max_depth", "8".to_owned())];
    PhotonMapper::from_parameters(false, &parameters.map(|(name, value)| (name.to_owned(), value)))
        .expect("known parameters")
}

fn measure<Q: RayQuery>(scene: &Scene, query: &Q, count: usize) {
    let world = World::new(scene);
    let area = Film::new(&scene.film, AovSet::default(), 1.0).expect("a film").sampled_area();
    let pass = Pass::new(&world, query, Integrator::PhotonMap(mapper(1)), 1, 0, area).expect("a pass");
    let (trial, _) = mapper(10_000).trace(&pass).expect("few photons");
    let emitted = count * 10_000 / trial.len();
    let ((photons, rays), tracing) = seconds(|| mapper(emitted).trace(&pass).expect("not too many"));
    println!("{} photons of {emitted} emitted, {rays} rays", photons.len());
    println!("  tracing                {tracing:8.3} s, {:.2} M emitted/s", 1e-6 * emitted as f64 / tracing);

    let sites: Vec<Vec3> =
        (0..QUERIES).map(|i| photons[mix(i as u64) as usize % photons.len()].position).collect();
    let points: Vec<[f32; 3]> = photons.iter().map(|p| p.position.to_array()).collect();
    let (map, time) = seconds(|| PhotonMap::new(photons.clone()));
    println!("  our map      built in  {time:8.3} s");
    let mut heap = NearestHeap::new();
    let site = |p| Site { p, ng: Vec3::ZERO };
    let mut nearest = |p| {
        map.nearest(&site(p), K, f32::INFINITY, |_| true, &mut heap);
        f64::from(f32::from_bits(heap.peek().expect("photons").0).sqrt())
    };
    let (ours, distance) = per_query(&sites, &mut nearest);
    let radius = (distance / sites.len() as f64) as f32;
    println!("  our map      k = {K}   {ours:8.2} us, {radius:.5} to the farthest");
    let (time, found) = per_query(&sites, |p| {
        let mut found = 0.0;
        map.within(&site(p), radius * radius, |_| true, |_, _| found += 1.0);
        found
    });
    println!("  our map      radius    {time:8.2} us, {:.1} found", found / sites.len() as f64);

    let (tree, time) = seconds(|| ImmutableKdTree::<f32, u32, 3, 32>::new_from_slice(&points));
    println!("  kiddo        built in  {time:8.3} s");
    let most = NonZero::new(K).expect("not zero");
    let (theirs, distance) = per_query(&sites, |p| {
        let found = tree.nearest_n::<SquaredEuclidean>(&p.to_array(), most);
        f64::from(found.iter().map(|n| n.distance).fold(0.0, f32::max).sqrt())
    });
    println!(
        "  kiddo        k = {K}   {theirs:8.2} us, {:.5} to the farthest",
        distance / sites.len() as f64
    );
    let (time, found) = per_query(&sites, |p| {
        tree.within_unsorted::<SquaredEuclidean>(&p.to_array(), radius * radius).len() as f64
    });
    println!("  kiddo        radius    {time:8.2} us, {:.1} found", found / sites.len() as f64);
    drop(tree);

    let (grid, time) = seconds(|| Grid::new(&photons, radius));
    println!("  hash grid    built in  {time:8.3} s");
    let (time, found) = per_query(&sites, |p| grid.count_within(p, radius) as f64);
    println!("  hash grid    radius    {time:8.2} us, {:.1} found", found / sites.len() as f64);
}

fn main() {
    let most = std::env::args().find_map(|a| a.parse::<f64>().ok()).unwrap_or(10_000.0) * 1000.0;
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell-box.xml");
    let scene = load(&path, &LoadOptions::default()).expect("a scene").scene;
    for count in [1e4, 1e5, 1e6, 1e7].into_iter().filter(|c| *c <= most) {
        match Backend::default() {
            #[cfg(feature = "embree")]
            Backend::Embree(settings) => {
                let query =
                    helmholtz::query::embree::EmbreeQuery::new(&scene.shapes, settings).expect("a scene");
                measure(&scene, &query, count as usize);
            }
            Backend::Obvhs(quality) => {
                measure(
                    &scene,
                    &helmholtz::query::obvhs::ObvhsQuery::new(&scene.shapes, quality),
                    count as usize,
                );
            }
            Backend::Crosscheck => unreachable!("it is not the default"),
        }
    }
}
