//! What the images of a study are compared with: a file, or a render that takes longer than any of the study's by the best integrator without bias.
//!
//! A reference must not share its random numbers with what is compared with it, or both have the same noise and differ less than either from the truth. So one that is
//! rendered has the seed [`SEED`], which no run may have; and a file that Helmholtz wrote tells its own.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use super::StudyError;
use super::auto::choose_unbiased;
use super::bias::noise;
use super::cells::{Kept, KeptReference, ReferenceIdentity, Store};
use super::converge::{GROUPS, render_to_error};
use super::picture::{Picture, seed_of};
use super::results;
use super::run::{Event, Observer};
use crate::film::output::write_exr;
use crate::film::{AovSet, Channel, Film, Pixels};
use crate::integrators::PathLength;
use crate::query::RayQuery;
use crate::render::{Control, Target};
use crate::transport::World;

/// The seed of references that a study renders ("refr", in ASCII).
pub const SEED: u64 = 0x7265_6672;

/// Where a reference comes from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// A file of floats, of the size of the study's images.
    File(PathBuf),
    /// Rendered for as long.
    Rendered(Duration),
}

/// What images are compared with.
#[derive(Debug, Clone)]
pub struct Reference {
    /// The image, with its variance if that is known.
    pub picture: Picture,
    /// Where it comes from and how good it is.
    pub described: results::Reference,
    /// Checksum of its file.
    pub checksum: String,
    /// The seed of its random numbers, if it is known.
    pub seed: Option<u64>,
}

impl Reference {
    /// Reads a file for images of a size.
    ///
    /// # Errors
    /// If it cannot be read, holds integers, or has another size.
    pub fn read(path: &Path, size: [u32; 2]) -> Result<Self, StudyError> {
        let picture = Picture::read(path)?;
        let refuse = |why: String| StudyError::Reference { path: path.to_owned(), why };
        if picture.is_display {
            return Err(refuse(
                "holds integers, whose rounding would count as error; expected floats (OpenEXR, PFM)"
                    .to_owned(),
            ));
        }
        if picture.size.to_array() != size {
            let ([w, h], found) = (size, picture.size);
            return Err(refuse(format!("is {} x {} pixels, but the images are {w} x {h}", found.x, found.y)));
        }
        let described = results::Reference {
            origin: path.display().to_string(),
            rel_mse: noise(&picture),
            seconds: None,
        };
        Ok(Self { picture, described, checksum: checksum(path)?, seed: seed_of(path) })
    }
}

/// The reference that is kept in a study's folder, if it is that of `identity`.
pub(super) fn kept(
    store: &Store,
    identity: &ReferenceIdentity,
    observe: &mut Observer,
) -> Result<Option<Reference>, StudyError> {
    let broken = |file: &Path, why: &str, observe: &mut Observer| {
        observe(&Event::Broken { file, why });
        Ok(None)
    };
    let kept = match store.reference(identity) {
        Kept::None => return Ok(None),
        Kept::Broken { file, why } => return broken(&file, &why, observe),
        Kept::Whole(kept) => kept,
    };
    let path = store.reference_image();
    match Reference::read(&path, identity.size) {
        Ok(reference) if reference.checksum == kept.checksum => {
            Ok(Some(Reference { described: kept.reference, ..reference }))
        }
        Ok(_) => broken(&path, "is not the image that was kept", observe),
        Err(error) => broken(&path, &error.to_string(), observe),
    }
}

/// Renders a reference in independent groups, whole rounds of them, for the time that `identity` says, and keeps it. `None` if it was interrupted.
pub(super) fn rendered<Q: RayQuery>(
    store: &Store,
    identity: ReferenceIdentity,
    world: &World,
    query: &Q,
    length: PathLength,
    observe: &mut Observer,
) -> Result<Option<Reference>, StudyError> {
    let integrator = choose_unbiased(world.scene, query, length)?.integrator;
    let target = Target { integrator, seed: SEED };
    let empty = Film::new(&world.scene.film, AovSet::default(), world.lights.radiance_unit())?;
    let mut is_interrupted = false;
    // No error is below 0: time alone ends it.
    let outcome = render_to_error(world, query, &target, &empty, (0.0, None), |progress, _| {
        is_interrupted = observe(&Event::Reference { progress, seconds: identity.seconds }) == Control::Stop;
        let is_round = progress.passes.is_multiple_of(GROUPS);
        let is_late = progress.elapsed.as_secs_f64() >= identity.seconds;
        if is_interrupted || (is_round && is_late) { Control::Stop } else { Control::Continue }
    })?;
    if is_interrupted {
        return Ok(None);
    }
    let (variance, passes) = (outcome.groups.variance(), outcome.progress.passes);
    let mut image = outcome.groups.merge()?.develop();
    for (name, plane) in
        ["variance.R", "variance.G", "variance.B"].into_iter().zip(variance.into_iter().flatten())
    {
        image.channels.push(Channel { name: name.into(), pixels: Pixels::Float(plane) });
    }
    let path = store.reference_image();
    let metadata = [("integrator", integrator.describe()), ("seed", SEED.to_string())];
    write_exr(&path, &image, false, &metadata.map(|(name, value)| (name.to_owned(), value)))?;
    let read = Reference::read(&path, identity.size)?;
    let described = results::Reference {
        origin: format!("{}, {passes} passes", integrator.describe()),
        // Relative to the image with its specks, as are the errors that this is subtracted from. The estimate of the groups is relative to their median, which has none: in
        // `scenes/ring.xml` it was 13 times as much, and more than all that was measured of others.
        rel_mse: read.described.rel_mse,
        seconds: Some(outcome.progress.elapsed.as_secs_f64()),
    };
    let kept = KeptReference { checksum: read.checksum.clone(), reference: described.clone(), identity };
    store.keep_reference(&kept)?;
    Ok(Some(Reference { described, ..read }))
}

/// A number that changes with any byte of a file.
fn checksum(path: &Path) -> Result<String, StudyError> {
    let refuse = |why: std::io::Error| StudyError::Reference { path: path.to_owned(), why: why.to_string() };
    let bytes = fs::read(path).map_err(refuse)?;
    Ok(format!("{:08x}-{}", crc32fast::hash(&bytes), bytes.len()))
}
