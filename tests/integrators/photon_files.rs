//! Photons in files: what is loaded is what was saved, and what is damaged or of something else is refused.

use std::fs;
use std::path::Path;

use helmholtz::film::state::RenderIdentity;
use helmholtz::film::{AovSet, Film};
use helmholtz::integrators::Integrator;
use helmholtz::integrators::photon_map::store::{
    PhotonFileErrorKind, PhotonReader, PhotonStore, PhotonWriter,
};
use helmholtz::integrators::photon_map::{Photon, PhotonMap};
use helmholtz::query::BuildQuality;
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::render::{Control, RenderError, Stop, Target, render_with_store};
use helmholtz::scene::Rgb;
use helmholtz::transport::World;

use super::agreement::integrator;
use super::photons::caustic;
use crate::statistics::Random;

fn identity(of: Integrator, seed: u64) -> RenderIdentity {
    let Integrator::PhotonMap(mapper) = of else { panic!("no photons") };
    RenderIdentity { scene: "scene".to_owned(), integrator: mapper.describe_photons(), seed }
}

fn image(integrator: Integrator, store: &mut PhotonStore) -> Result<(Vec<f32>, u64), RenderError> {
    let scene = caustic();
    let query = ObvhsQuery::new(&scene.shapes, BuildQuality::Medium);
    let world = World::new(&scene);
    let mut film = Film::new(&scene.film, AovSet::default(), world.lights.radiance_unit()).expect("a film");
    let (target, stop) = (Target { integrator, seed: 7 }, Stop { passes: 3..5, time: None });
    let done = render_with_store(&world, &query, &target, &mut film, &stop, store, |_| Control::Continue)?;
    Ok((film.develop().floats("G").expect("a colour").to_vec(), done.rays))
}

/// The same image to the last bit, with fewer rays; and another look at the same photons by other means.
#[test]
fn loaded_photons_make_the_same_image() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("photons");
    for (name, parameters) in
        [("photonmapper", "lookup=knn,k=20"), ("sppm", "final_gather=1"), ("photonmapper", "mode=caustic")]
    {
        let of = integrator(name, &format!("photons=5000,{parameters}"));
        let traced = image(of, &mut PhotonStore::Traced).expect("rendered");
        let writer = PhotonWriter::create(&path, &identity(of, 7)).expect("a file");
        let mut store = PhotonStore::Saved(Box::new(writer));
        assert_eq!(image(of, &mut store).expect("rendered"), traced);
        let PhotonStore::Saved(writer) = store else { unreachable!() };
        assert_eq!(writer.finish().expect("written"), 2);
        let reader = PhotonReader::open(&path, &identity(of, 7)).expect("it can be read");
        assert_eq!(reader.passes(), 3..5);
        let mut store = PhotonStore::Loaded(Box::new(reader));
        let loaded = image(of, &mut store).expect("rendered");
        assert!(loaded.0 == traced.0 && loaded.1 < traced.1, "{name}:{parameters}");
    }
    // All the photons of the second file serve other ways to look them up.
    let others = [("photonmapper", "lookup=knn"), ("sppm", "direct=photons,filter=cone,radius=0.1")];
    let saved = identity(integrator("photonmapper", "photons=5000"), 7);
    for (name, parameters) in others {
        assert_eq!(identity(integrator(name, &format!("photons=5000,{parameters}")), 7), saved);
    }
    for parameters in
        ["photons=5001", "photons=5000,direct=nee", "photons=5000,mode=caustic", "photons=5000,max_depth=5"]
    {
        assert_ne!(identity(integrator("photonmapper", parameters), 7), saved, "{parameters}");
    }
}

/// Photons in the file of [`small_file`]: enough for a tree with an inner node.
const STORED: u32 = 40;

/// A map of some photons in a file of passes 2 and 9.
fn small_file(path: &Path, expected: &RenderIdentity) {
    let mut random = Random::new(3);
    let mut photon = |_| {
        let (p, power) = (random.direction(), Rgb::splat(random.uniform()));
        Photon::new(p, power, random.direction(), random.direction(), 3, false)
    };
    let mut writer = PhotonWriter::create(path, expected).expect("a file");
    let map = PhotonMap::new((0..STORED).map(&mut photon).collect());
    writer.add(2, &map).expect("written");
    writer.add(9, &PhotonMap::new(Vec::new())).expect("written");
    writer.finish().expect("written");
    let reader = PhotonReader::open(path, expected).expect("whole");
    assert_eq!(reader.read(2).expect("a map").photons(), map.photons());
    assert!(reader.read(9).expect("a map").photons().is_empty());
}

fn some_identity() -> RenderIdentity {
    RenderIdentity { scene: "s".to_owned(), integrator: "i".to_owned(), seed: 1 }
}

#[test]
fn files_of_something_else_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("photons");
    let right = some_identity();
    small_file(&path, &right);
    for (part, other) in [
        ("scene", RenderIdentity { scene: "t".to_owned(), ..right.clone() }),
        ("integrator", RenderIdentity { integrator: "j".to_owned(), ..right.clone() }),
        ("seed", RenderIdentity { seed: 2, ..right.clone() }),
    ] {
        let error = PhotonReader::open(&path, &other).err().expect("refused");
        assert!(matches!(error.kind, PhotonFileErrorKind::Identity(_)), "{error}");
        assert!(error.to_string().contains(part) && error.to_string().contains("photons"), "{error}");
    }
    let reader = PhotonReader::open(&path, &right).expect("whole");
    assert!(reader.check(2..3).is_ok() && reader.check(9..10).is_ok());
    for passes in [0..3, 2..10, 10..11] {
        let error = reader.check(passes).expect_err("a pass is missing");
        assert!(error.to_string().contains("2..10"), "{error}");
    }
    assert!(
        matches!(reader.read(4), Err(error) if matches!(error.kind, PhotonFileErrorKind::Missing { pass: 4, .. }))
    );
}

/// Cut off anywhere, with any byte changed, or with something behind: an error. Claims that a right checksum covers too.
#[test]
fn damaged_files_are_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("photons");
    small_file(&path, &some_identity());
    let whole = fs::read(&path).expect("a file");
    let refused = |bytes: &[u8], what: &str| {
        fs::write(&path, bytes).expect("written");
        // What is wrong with a tree shows when it is read.
        match PhotonReader::open(&path, &some_identity()) {
            Err(error) => error.to_string(),
            Ok(reader) => reader.read(2).expect_err(what).to_string(),
        }
    };
    for length in 0..whole.len() {
        refused(&whole[..length], "cut off");
    }
    for i in 0..whole.len() {
        let mut bytes = whole.clone();
        bytes[i] ^= 0x41;
        refused(&bytes, "changed");
    }
    refused(&[&whole[..], b"more"].concat(), "longer");
    let header = u32::from_le_bytes(whole[12..16].try_into().expect("four bytes")) as usize;
    let first = 16 + header;
    // Pass and count of the first map, its first photon, its first node, and the number of passes at the end.
    let (count, photon, node) = (first + 4, first + 8, first + 8 + STORED as usize * 32);
    let passes = whole.len() - 8;
    for (at, bytes, told) in [
        (12, u32::MAX.to_le_bytes(), "end is missing"),
        (count, u32::MAX.to_le_bytes(), "ends before"),
        (count, (STORED - 1).to_le_bytes(), "damaged"),
        (first, 9_u32.to_le_bytes(), "order"),
        (first, u32::MAX.to_le_bytes(), "missing"),
        (passes, 3_u32.to_le_bytes(), "missing"),
        (photon, f32::NAN.to_le_bytes(), "finite"),
        (photon + 12, f32::INFINITY.to_le_bytes(), "finite"),
        (node + 4, 3_u32.to_le_bytes(), "tree"),
    ] {
        let mut changed = whole.clone();
        changed[at..at + 4].copy_from_slice(&bytes);
        let end = changed.len() - 4;
        let checksum = crc32fast::hash(&changed[..end]);
        changed[end..].copy_from_slice(&checksum.to_le_bytes());
        let error = refused(&changed, told);
        assert!(error.contains(told), "{at}: {error}");
    }
}

/// A file that is not finished leaves what was there, and nothing else.
#[test]
fn unfinished_files_do_not_appear() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("photons");
    small_file(&path, &some_identity());
    let before = fs::read(&path).expect("a file");
    let mut writer = PhotonWriter::create(&path, &some_identity()).expect("a file");
    writer.add(0, &PhotonMap::new(Vec::new())).expect("written");
    drop(writer);
    assert_eq!(fs::read(&path).expect("a file"), before);
    assert_eq!(fs::read_dir(folder.path()).expect("a folder").count(), 1);
    assert!(PhotonWriter::create(&folder.path().join("no/such/folder"), &some_identity()).is_err());
}
