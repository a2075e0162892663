//! OpenEXR images through the crate `exr`: the largest level of the first part that has colours.

use std::io::Cursor;
use std::path::Path;

use exr::prelude as lib;
use glam::{DMat3, DVec2, DVec3, UVec2, Vec3};
use half::f16;
use lib::{FlatSamples, ReadChannels, ReadLayers};

use super::image::{Content, check_claim, finish, refuse};
use super::{LoadError, Location, Log};
use crate::scene::{Image, Texels};

/// Whether a file starts as `OpenEXR` does.
pub(crate) fn is_exr(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0x76, 0x2f, 0x31, 0x01])
}

/// All parts of a file at full resolution, after a check that the file is long enough for what its header claims.
pub(crate) fn read_parts(path: &Path, bytes: &[u8]) -> Result<exr::image::FlatImage, LoadError> {
    let broken = |e: exr::error::Error| refuse(path, format!("a broken OpenEXR image ({e})"));
    let meta = exr::meta::MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(broken)?;
    let claim = meta.headers.iter().map(|h| {
        let pixels = h.layer_size.0 as u64 * h.layer_size.1 as u64;
        pixels.saturating_mul(h.channels.bytes_per_pixel as u64)
    });
    check_claim(path, bytes.len(), claim.fold(0, u64::saturating_add))?;
    lib::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .all_layers()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(broken)
}

pub(super) fn decode(path: &Path, bytes: &[u8], content: Content, log: &mut Log) -> Result<Image, LoadError> {
    let image = read_parts(path, bytes)?;
    for layer in &image.layer_data {
        let Some(channels) = choose(&layer.channel_data.list, content) else { continue };
        if layer.channel_data.list.iter().any(|c| c.name.eq("RY")) {
            log.warn(Location::file(path), "chroma (RY, BY) is not read: the image becomes grey");
        }
        let size = UVec2::new(layer.size.0 as u32, layer.size.1 as u32);
        let mut texels = interleave(&channels);
        let primaries = image.attributes.chromaticities.filter(|_| channels.len() == 3);
        if let Some(matrix) = primaries.and_then(|c| to_rec_709(&c)) {
            texels = converted(&texels, matrix);
        }
        return finish(path, size, channels.len() as u32, texels, log);
    }
    Err(refuse(path, "an OpenEXR image without channels R, G, B or Y"))
}

/// The channels R, G and B, or Y, or the only one there is; alpha if that is wanted and there.
fn choose(channels: &[lib::AnyChannel<FlatSamples>], content: Content) -> Option<Vec<&FlatSamples>> {
    let named = |name: &str| {
        // "layer.R" is a channel of a layer in files of one part.
        let found = channels.iter().find(|c| c.name.eq(name)).or_else(|| {
            channels.iter().find(|c| c.name.to_string().rsplit('.').next().is_some_and(|n| n == name))
        });
        found.map(|c| &c.sample_data)
    };
    let alpha = if content == Content::Alpha { named("A").map(|a| vec![a]) } else { None };
    let color = || ["R", "G", "B"].into_iter().map(named).collect::<Option<Vec<_>>>();
    let only = || if let [one] = channels { Some(vec![&one.sample_data]) } else { None };
    alpha.or_else(color).or_else(|| named("Y").map(|y| vec![y])).or_else(only)
}

/// Texels from planes, as halves if all planes are.
fn interleave(planes: &[&FlatSamples]) -> Texels {
    let count = planes.iter().map(|p| p.len()).min().unwrap_or(0);
    let halves: Option<Vec<&Vec<f16>>> =
        planes.iter().map(|p| if let FlatSamples::F16(v) = p { Some(v) } else { None }).collect();
    match halves {
        Some(planes) => {
            Texels::F16((0..count).flat_map(|i| planes.iter().map(move |plane| plane[i])).collect())
        }
        None => Texels::F32(
            (0..count)
                .flat_map(|i| planes.iter().map(move |plane| plane.value_by_flat_index(i).to_f32()))
                .collect(),
        ),
    }
}

/// The matrix from the file's primaries to those of Rec. 709, which share the white of D65; `None` if they are the same
/// or make no sense. White goes to white, without adaptation for the eye, as in Mitsuba.
fn to_rec_709(c: &exr::meta::attribute::Chromaticities) -> Option<DMat3> {
    let point = |v: exr::math::Vec2<f32>| DVec2::new(f64::from(v.0), f64::from(v.1));
    let file = [c.red, c.green, c.blue, c.white].map(point);
    let rec_709 = [(0.64, 0.33), (0.30, 0.60), (0.15, 0.06), (0.3127, 0.3290)].map(DVec2::from);
    if file.iter().zip(rec_709).all(|(a, b)| a.abs_diff_eq(b, 1e-3)) {
        return None;
    }
    let matrix = to_xyz(&rec_709)?.inverse() * to_xyz(&file)?;
    matrix.is_finite().then_some(matrix)
}

/// RGB to XYZ for primaries and white given as (x, y).
fn to_xyz(c: &[DVec2; 4]) -> Option<DMat3> {
    let [r, g, b, white] = c.map(|p| DVec3::new(p.x, p.y, 1.0 - p.x - p.y));
    let primaries = DMat3::from_cols(r, g, b);
    if primaries.determinant().abs() < 1e-6 || white.y <= 0.0 {
        return None;
    }
    let scale = primaries.inverse() * (white / white.y);
    Some(primaries * DMat3::from_diagonal(scale))
}

fn converted(texels: &Texels, matrix: DMat3) -> Texels {
    let floats: Vec<f32> = match texels {
        Texels::F16(v) => v.iter().map(|x| x.to_f32()).collect(),
        Texels::F32(v) => v.clone(),
        Texels::U8(_) | Texels::U16(_) => return texels.clone(),
    };
    let convert = |c: &[f32]| (matrix * Vec3::from_slice(c).as_dvec3()).as_vec3().to_array();
    Texels::F32(floats.chunks_exact(3).flat_map(convert).collect())
}
