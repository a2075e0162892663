//! `helmholtz diff`: how far images are from a reference.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use super::{CliError, EXIT_DIFFERENT, EXIT_DONE};
use crate::film::output::write_png;
use crate::study::flip;
use crate::study::heat::heat_map;
use crate::study::metrics::{Errors, compare, relative_squared_errors};
use crate::study::picture::Picture;

/// Compare images with a reference
///
/// Reads OpenEXR (of any program: half or float, with layers), PFM, PNG, JPEG, Radiance HDR, TGA and BMP. Integer files are decoded from sRGB;
/// errors are of linear values. relMSE is the mean of (I - R)^2 / (R^2 + 0.01), trimmed: without the worst 0.1 % of the
/// pixels. FLIP says how different images look, from 0 to 1. The bias is the mean of I - R, in standard errors if the image has the
/// layer `variance` (render --aov variance).
///
/// Pixels that are not finite are counted and left out; an image that has any is above every limit.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  helmholtz diff reference.exr a.exr b.exr
  helmholtz diff reference.exr a.exr --heat-map where.png
  helmholtz diff reference.exr a.exr --max-relmse 0.01 && echo close enough")]
pub(super) struct DiffArgs {
    /// What images should look like
    reference: PathBuf,
    /// Images of the same size
    #[arg(required = true)]
    images: Vec<PathBuf>,
    /// Write where the image differs: relative squared error from 1e-4 (black) over blue, red and orange to 1 (white); green is not finite. For one image
    #[arg(long, value_name = "FILE.png")]
    heat_map: Option<PathBuf>,
    /// Exit with code 3 if an image's relMSE is greater than this
    #[arg(long, value_name = "LIMIT")]
    max_relmse: Option<f64>,
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

/// An image, compared.
struct Comparison<'a> {
    path: &'a Path,
    errors: Errors,
    flip_ldr: f64,
    /// Of references of floats.
    flip_hdr: Option<f64>,
}

pub(super) fn run(args: &DiffArgs) -> Result<u8, CliError> {
    if args.heat_map.is_some() && args.images.len() > 1 {
        return Err("--heat-map is for one image".into());
    }
    if args.max_relmse.is_some_and(|limit| limit.is_nan() || limit < 0.0) {
        return Err("--max-relmse should be a number of at least 0".into());
    }
    let reference = Picture::read(&args.reference)?;
    let mut comparisons = Vec::new();
    for path in &args.images {
        let image = Picture::read(path)?;
        let refused = |error| format!("{}: {error}", path.display());
        let errors = compare(&reference, &image).map_err(refused)?;
        if let Some(map) = &args.heat_map {
            let relative = relative_squared_errors(&reference, &image).map_err(refused)?;
            write_png(map, &heat_map(image.size, &relative))?;
        }
        let flip_hdr = (!reference.is_display).then(|| flip::hdr(&reference, &image));
        comparisons.push(Comparison { path, errors, flip_ldr: flip::ldr(&reference, &image), flip_hdr });
    }
    if args.json {
        println!("{:#}", json!(comparisons.iter().map(Comparison::json).collect::<Vec<_>>()));
    } else {
        for comparison in &comparisons {
            print!("{}", comparison.text());
        }
    }
    let is_above = |c: &Comparison, limit| c.errors.rel_mse > limit || c.errors.non_finite > 0;
    let is_different = args.max_relmse.is_some_and(|limit| comparisons.iter().any(|c| is_above(c, limit)));
    Ok(if is_different { EXIT_DIFFERENT } else { EXIT_DONE })
}

impl Comparison<'_> {
    fn text(&self) -> String {
        let Errors { mse, rel_mse, rel_mse_trimmed, psnr, bias, bias_z, non_finite, non_finite_reference } =
            self.errors;
        let hdr = self.flip_hdr.map_or_else(String::new, |value| format!(", HDR {value:.4}"));
        let z = bias_z.map_or_else(String::new, |z| format!(" ({z:.1} standard errors)"));
        let bad = if non_finite + non_finite_reference > 0 {
            format!("  not finite  {non_finite} pixels, {non_finite_reference} of the reference; left out\n")
        } else {
            String::new()
        };
        format!(
            "{}\n  relMSE      {rel_mse:.4e}, trimmed {rel_mse_trimmed:.4e}\n  MSE         {mse:.4e}, RMSE {:.4e}, PSNR {psnr:.2} dB\n  FLIP        LDR {:.4}{hdr}\n  bias        {bias:+.4e}{z}\n{bad}",
            self.path.display(),
            self.errors.rmse(),
            self.flip_ldr,
        )
    }

    /// Numbers that JSON has not, the PSNR of equal images, become null.
    fn json(&self) -> serde_json::Value {
        let Errors { mse, rel_mse, rel_mse_trimmed, psnr, bias, bias_z, non_finite, non_finite_reference } =
            self.errors;
        json!({
            "image": self.path,
            "mse": mse,
            "rmse": self.errors.rmse(),
            "relmse": rel_mse,
            "relmse_trimmed": rel_mse_trimmed,
            "psnr": psnr,
            "flip_ldr": self.flip_ldr,
            "flip_hdr": self.flip_hdr,
            "bias": bias,
            "bias_z": bias_z,
            "non_finite": non_finite,
            "non_finite_reference": non_finite_reference,
        })
    }
}
