//! Weights of strategies, contribution by contribution.

use glam::{DAffine3, DVec3, IVec2, Vec2};

use super::images::{brighter, integrator, moved, room};
use super::{Bench, Effort, Finding, Group, SelftestError, Task};
use crate::film::{AovSet, Film};
use crate::integrators::{Integrator, Pass, PathObserver, Scratch, Strategy};
use crate::query::RayQuery;
use crate::render::{RenderError, light_path_count, sample_pixel, trace_light_path};
use crate::scene::{Rgb, Scene};
use crate::transport::World;
use crate::transport::vertex::SurfaceVertex;
use crate::transport::walk::Walk;

/// What there is to count.
#[derive(Default)]
struct Counted {
    all: u64,
    /// Weight out of [0, 1] or no number, or a value that is no number or negative.
    bad: u64,
    /// Weight 0, of a contribution that is not.
    vanished: u64,
}

impl PathObserver for Counted {
    fn segment(&mut self, _: &Walk, _: u32, _: Option<&SurfaceVertex>) {}

    fn contribution(&mut self, _: Strategy, _: Option<Vec2>, value: Rgb, weight: f32) {
        self.all += 1;
        let is_good = (0.0..=1.0).contains(&weight) && value.is_finite() && value.min_element() >= 0.0;
        self.bad += u64::from(!is_good);
        self.vanished += u64::from(weight == 0.0 && value.max_element() > 0.0);
    }
}

struct Count<'a> {
    scene: &'a Scene,
    integrator: Integrator,
    passes: u32,
}

impl Task for Count<'_> {
    type Output = Result<Counted, RenderError>;

    fn run<Q: RayQuery>(&self, query: &Q) -> Self::Output {
        let world = World::new(self.scene);
        let area = Film::new(&self.scene.film, AovSet::default(), 1.0)?.sampled_area();
        let (mut counted, mut scratch) = (Counted::default(), Scratch::default());
        for index in 0..self.passes {
            let pass = Pass::new(&world, query, self.integrator, 7, index, area)?;
            if self.integrator.only_splats() {
                for slot in 0..light_path_count(&pass, self.integrator) {
                    trace_light_path(&pass, self.integrator, slot, &mut scratch, &mut counted);
                }
                continue;
            }
            for i in 0..area.size.x * area.size.y {
                let pixel = area.min + IVec2::new((i % area.size.x) as i32, (i / area.size.x) as i32);
                sample_pixel(&pass, self.integrator, pixel, &mut scratch, &mut counted);
            }
        }
        Ok(counted)
    }
}

/// The share of contributions whose weight is not in [0, 1] or whose value is no number: none may be. How many weights are 0, because another strategy is more than 1e22 times as likely, is
/// reported. That the weights of all strategies of a path sum to one is a matter of explicit paths, which `tests/integrators/weights` takes
/// to pieces, at scales of 1e-6 and 1e6 too; and that no path is lost, of the images of [`places`](super::places), which are the same to the last bit.
pub(super) fn check(bench: &Bench) -> Result<Vec<Finding>, SelftestError> {
    let unit = room(16)?;
    let scaled = |scale: f64| moved(unit.clone(), &DAffine3::from_scale(DVec3::splat(scale)));
    let far = DVec3::new(1e4, -0.75e4, 0.5e4);
    let cases = [
        ("room", unit.clone()),
        ("room x 1e-6", scaled(1e-6)?),
        ("room x 1e6", scaled(1e6)?),
        ("room 1e4 sizes away", moved(unit.clone(), &DAffine3::from_translation(far))?),
        ("emission x 1e-20", brighter(unit.clone(), 1e-20)),
        ("emission x 1e20", brighter(unit.clone(), 1e20)),
    ];
    let passes = if bench.effort == Effort::Quick { 8 } else { 400 };
    let mut findings = Vec::new();
    for (name, scene) in &cases {
        for label in ["path", "ptracer", "bdpt"] {
            let algorithm = integrator(label, &[("max_depth", "8")])?;
            let counted = bench.on(&scene.shapes, &Count { scene, integrator: algorithm, passes })??;
            let share = |n: u64| n as f64 / counted.all as f64;
            for (what, n, limit) in [
                ("weights out of [0, 1] or values that are no numbers", counted.bad, Some(0.0)),
                ("weights that vanish", counted.vanished, None),
            ] {
                let check = format!("{name}: share of {what}");
                let finding = bench.finding(Group::Densities, check, share(n), limit);
                findings.push(Finding { integrator: label, ..finding });
            }
        }
    }
    Ok(findings)
}
