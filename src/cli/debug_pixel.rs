//! `--debug-pixel x,y`: the paths of one pixel, vertex by vertex.

use std::fmt::Write as _;

use glam::{UVec2, Vec3};

use crate::integrators::{PathObserver, Technique};
use crate::query::{Ray, RayQuery};
use crate::render::{Target, sample_pixel};
use crate::scene::Rgb;
use crate::transport::World;
use crate::transport::vertex::SurfaceVertex;

/// Text of all paths of a pixel in the given passes.
pub(super) fn describe<Q: RayQuery>(
    world: &World,
    query: &Q,
    target: &Target,
    pixel: UVec2,
    passes: std::ops::Range<u32>,
) -> String {
    let mut text = String::new();
    for pass in passes {
        let mut printer = Printer { world, text: format!("pixel {},{} pass {pass}\n", pixel.x, pixel.y) };
        let sample = sample_pixel(world, query, target, pixel.as_ivec2(), pass, &mut printer);
        text += &printer.text;
        let _ = writeln!(
            text,
            "  = {} at {:?} of the pixel\n",
            show(sample.sample.radiance),
            sample.sample.jitter.to_array()
        );
    }
    text
}

struct Printer<'w, 's> {
    world: &'w World<'s>,
    text: String,
}

fn show(v: Vec3) -> String {
    format!("({}, {}, {})", v.x, v.y, v.z)
}

impl PathObserver for Printer<'_, '_> {
    fn segment(&mut self, depth: u32, ray: &Ray, vertex: Option<&SurfaceVertex>, beta: Rgb) {
        // Writing to a String cannot fail.
        let _ =
            writeln!(self.text, "  {depth}: from {} to {}  beta {}", show(ray.o), show(ray.d), show(beta));
        let _ = match vertex {
            Some(vertex) => {
                let point = &vertex.point;
                let shape = &self.world.scene.shapes[point.shape as usize];
                writeln!(
                    self.text,
                    "     hits `{}` (shape {}, primitive {}) at {} after t {}\n     ng {} ns {} p_err {:e}\n     {:?}",
                    shape.name,
                    point.shape,
                    point.primitive,
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

    fn contribution(&mut self, technique: Technique, value: Rgb, mis_weight: f32) {
        let how = match technique {
            Technique::HitLight => "hits a light",
            Technique::HitEnvironment => "hits the environment",
            Technique::SampledLight => "samples a light",
        };
        let _ = writeln!(self.text, "     {how}: adds {} with MIS weight {mis_weight}", show(value));
    }
}
