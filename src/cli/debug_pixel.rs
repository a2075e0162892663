//! `--debug-pixel x,y`: the paths of one pixel, vertex by vertex.

use std::fmt::Write as _;

use glam::{UVec2, Vec2, Vec3};

use crate::film::SampledArea;
use crate::integrators::TooManyStored;
use crate::integrators::{Pass, PathObserver, Scratch, Strategy, Unobserved};
use crate::query::RayQuery;
use crate::render::{Target, light_path_count, sample_pixel, trace_light_path};
use crate::scene::Rgb;
use crate::transport::World;
use crate::transport::bsdf::TransportMode;
use crate::transport::vertex::SurfaceVertex;
use crate::transport::walk::Walk;

/// Text of all paths of a pixel in the given passes, and of all light paths that splat into it.
pub(super) fn describe<Q: RayQuery>(
    world: &World,
    query: &Q,
    target: &Target,
    area: SampledArea,
    pixel: UVec2,
    passes: std::ops::Range<u32>,
) -> Result<String, TooManyStored> {
    let mut text = String::new();
    let pixel = pixel.as_ivec2();
    for index in passes {
        let pass = Pass::new(world, query, target.integrator, target.seed, index, area)?;
        let mut scratch = Scratch::default();
        let mut printer = Printer { world, text: format!("pixel {},{} pass {index}\n", pixel.x, pixel.y) };
        let sample = sample_pixel(&pass, target.integrator, pixel, &mut scratch, &mut printer);
        text += &printer.text;
        let _ =
            writeln!(text, "  = {} at {:?} of the pixel\n", show(sample.radiance), sample.jitter.to_array());
        for slot in 0..light_path_count(&pass, target.integrator) {
            scratch.splats.clear();
            trace_light_path(&pass, target.integrator, slot, &mut scratch, &mut Unobserved);
            if scratch.splats.iter().any(|splat| splat.position.floor().as_ivec2() == pixel) {
                let mut printer = Printer { world, text: format!("light path {slot} pass {index}\n") };
                trace_light_path(&pass, target.integrator, slot, &mut scratch, &mut printer);
                text += &printer.text;
                text.push('\n');
            }
        }
    }
    Ok(text)
}

struct Printer<'w, 's> {
    world: &'w World<'s>,
    text: String,
}

fn show(v: Vec3) -> String {
    format!("({}, {}, {})", v.x, v.y, v.z)
}

impl PathObserver for Printer<'_, '_> {
    fn segment(&mut self, walk: &Walk, depth: u32, vertex: Option<&SurfaceVertex>) {
        let Walk { mode, ray, beta, .. } = *walk;
        let subpath = match mode {
            TransportMode::Radiance => "eye",
            TransportMode::Importance => "light",
        };
        // Writing to a String cannot fail.
        let _ = writeln!(
            self.text,
            "  {subpath} {depth}: from {} to {}  beta {}",
            show(ray.o),
            show(ray.d),
            show(beta)
        );
        let _ = match vertex {
            Some(vertex) => {
                let point = &vertex.point;
                let shape = &self.world.scene.shapes[point.shape as usize];
                let (part, primitive) = shape.part(point.primitive);
                let of_group = if std::ptr::eq(part, shape) {
                    String::new()
                } else {
                    format!(" with `{}` in it", part.name)
                };
                writeln!(
                    self.text,
                    "     hits `{}`{of_group} (shape {}, primitive {primitive}) at {} after t {}\n     ng {} ns {} p_err {:e}\n     {:?}",
                    shape.name,
                    point.shape,
                    show(point.p),
                    point.p.distance(ray.o),
                    show(point.ng),
                    show(point.ns),
                    point.p_err,
                    vertex.bsdf,
                )
            }
            None => writeln!(self.text, "     leaves the scene"),
        };
    }

    fn contribution(&mut self, strategy: Strategy, film: Option<Vec2>, value: Rgb, mis_weight: f32) {
        let place = film.map_or_else(String::new, |p| format!(" at {},{}", p.x, p.y));
        let _ = writeln!(
            self.text,
            "     {strategy}: adds {}{place}, with MIS weight {mis_weight}",
            show(value * mis_weight)
        );
    }
}
