//! Benchmarks, run by hand: `cargo test --release -- --ignored --nocapture benchmark`. Nothing here can fail for being slow.
//! What they gave is in `vendor-notes/measurements.md`.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;
use std::time::Instant;

use glam::{UVec2, UVec3, Vec3};
use helmholtz::film::{AovSet, Film};
use helmholtz::integrators::Integrator;
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::query::recorder::{Recorder, Recording};
use helmholtz::query::{Backend, BuildQuality, Ray, RayQuery};
use helmholtz::render::{Control, Stop, Target, render};
use helmholtz::scene::{Emitter, Geometry, PixelRect, Rgb, Scene};
use helmholtz::transport::World;

use crate::backends::{BackendTest, on_each_backend};
use crate::scene_builder::{Build, diffuse, empty, mesh, quad};

/// A bumpy sphere of about `2 n^2` triangles.
fn bumpy_sphere(n: u32) -> Geometry {
    let vertex = |i: u32, j: u32| {
        let (theta, phi) =
            (i as f32 / n as f32 * std::f32::consts::PI, j as f32 / n as f32 * std::f32::consts::TAU);
        let r = 1.0 + 0.05 * (20.0 * theta).sin() * (20.0 * phi).sin();
        r * Vec3::new(theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin())
    };
    let positions = (0..=n).flat_map(|i| (0..=n).map(move |j| vertex(i, j))).collect();
    let at = |i: u32, j: u32| i * (n + 1) + j;
    let triangles: Vec<UVec3> = (0..n)
        .flat_map(|i| {
            (0..n).flat_map(move |j| {
                [
                    UVec3::new(at(i, j), at(i, j + 1), at(i + 1, j)),
                    UVec3::new(at(i, j + 1), at(i + 1, j + 1), at(i + 1, j)),
                ]
            })
        })
        .collect();
    mesh(positions, &triangles)
}

/// The sphere on a floor under a sky and a lamp, filling most of 512x512 pixels.
fn scene(n: u32) -> Scene {
    let mut scene = empty()
        .shape(bumpy_sphere(n), diffuse(0.7), None)
        .shape(quad(Vec3::new(-20.0, -1.1, -20.0), Vec3::Z * 40.0, Vec3::X * 40.0), diffuse(0.5), None)
        .shape(
            quad(Vec3::new(-1.0, 4.0, -1.0), Vec3::X * 2.0, Vec3::Z * 2.0),
            diffuse(0.0),
            Some(Rgb::splat(10.0)),
        )
        .emitter(Emitter::Constant { radiance: Rgb::splat(0.3) });
    scene.camera.to_world.translation = glam::DVec3::new(0.0, 0.3, -3.4);
    let size = UVec2::splat(512);
    scene.film.size = size;
    scene.film.crop = PixelRect { min: UVec2::ZERO, size };
    scene
}

/// Renders one pass and returns its time in seconds.
fn one_pass<Q: RayQuery>(scene: &Scene, query: &Q) -> f64 {
    let world = World::new(scene);
    let mut film = Film::new(&scene.film, AovSet::default(), world.lights.radiance_unit()).expect("a film");
    let parameters = [("max_depth".to_owned(), "8".to_owned())];
    let target = Target { integrator: Integrator::new("path", &parameters).expect("path"), seed: 0 };
    let stop = Stop { passes: 0..1, time: None };
    let start = Instant::now();
    render(&world, query, &target, &mut film, &stop, |_| Control::Continue).expect("rendered");
    start.elapsed().as_secs_f64()
}

/// Closest-hit queries come before those of occlusion.
fn write_recording(path: &Path, scene: &Scene, rays: &[(Ray, bool)]) -> std::io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    let mut put = |bytes: &[u8]| file.write_all(bytes);
    put(&(scene.shapes.len() as u32).to_le_bytes())?;
    for shape in &scene.shapes {
        let Geometry::Mesh(mesh) = &shape.geometry else { unreachable!("the scene is made of meshes") };
        put(&(mesh.positions().len() as u32).to_le_bytes())?;
        put(&(mesh.triangles().len() as u32).to_le_bytes())?;
        for x in mesh.positions().iter().flat_map(Vec3::to_array) {
            put(&x.to_le_bytes())?;
        }
        for i in mesh.triangles().iter().flatten() {
            put(&i.to_le_bytes())?;
        }
    }
    put(&(rays.len() as u64).to_le_bytes())?;
    for (ray, occlusion) in rays {
        for x in [ray.o.x, ray.o.y, ray.o.z, ray.t_min, ray.d.x, ray.d.y, ray.d.z, ray.t_max] {
            put(&x.to_le_bytes())?;
        }
        put(&u32::from(*occlusion).to_le_bytes())?;
    }
    file.flush()
}

struct Replay<'s>(&'s Scene);

impl BackendTest for Replay<'_> {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q) {
        let mut times: Vec<f64> = (0..9).map(|_| one_pass(self.0, query)).collect();
        times.sort_by(f64::total_cmp);
        let again = Backend::new(backend, &[]).expect("known").build(&self.0.shapes).expect("built");
        let recorder = Recorder::new(again, 1 << 30);
        one_pass(self.0, &recorder);
        let (Recording { closest, occlusion }, _) = recorder.take();
        let mark = |is_occlusion| move |ray| (ray, is_occlusion);
        let rays: Vec<_> =
            closest.into_iter().map(mark(false)).chain(occlusion.into_iter().map(mark(true))).collect();
        println!("{backend}: one pass takes {:.4} s (median of 9), {} rays", times[4], rays.len());
        if backend == "embree" {
            let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("recording.bin");
            write_recording(&path, self.0, &rays).expect("written");
            println!("wrote {}; see tests/bench/replay.c", path.display());
        }
    }
}

#[test]
#[ignore = "a benchmark"]
fn benchmark_replay() {
    let scene = scene(750);
    on_each_backend(&scene.shapes, &Replay(&scene));
}

#[test]
#[ignore = "a benchmark"]
fn benchmark_build() {
    for n in [71, 708, 2237] {
        let shapes = empty().shape(bumpy_sphere(n), diffuse(0.5), None).shapes;
        let triangles = f64::from(2 * n * n);
        let report = |backend: &str, seconds: f64, bytes: usize| {
            println!(
                "{backend}: {triangles} triangles in {seconds:.3} s, {:.1} bytes each",
                bytes as f64 / triangles
            );
        };
        #[cfg(feature = "embree")]
        {
            use helmholtz::query::embree::{EmbreeQuery, EmbreeSettings};
            let start = Instant::now();
            let query = EmbreeQuery::new(&shapes, EmbreeSettings::default()).expect("Embree");
            report("embree", start.elapsed().as_secs_f64(), query.memory());
        }
        let start = Instant::now();
        let query = ObvhsQuery::new(&shapes, BuildQuality::default());
        report("obvhs", start.elapsed().as_secs_f64(), query.memory());
    }
}
