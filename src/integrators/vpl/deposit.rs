//! Phase 1: light paths leave virtual point lights where they land, and what a pass needs to look at them is made.

use glam::Vec3;

use super::block::{Block, LANES};
use super::shadow_map::{NO_MAP, ShadowMaps, Viewpoint};
use super::tree::{LightTree, TreeLight};
use super::{Direct, VirtualLights, Visibility};
use crate::integrators::collect::{TooManyStored, collect};
use crate::integrators::light_path::{self, Landing};
use crate::integrators::pass::Pass;
use crate::query::RayQuery;
use crate::scene::{Rgb, SurfacePoint};
use crate::transport::lights::LeSample;
use crate::transport::vertex::SurfaceVertex;

/// Light paths that one task traces.
const PATHS_PER_TASK: u32 = 256;

/// Virtual lights that a pass may store, 1 GiB of them.
const MAX_STORED: usize = 1 << 24;

/// Number of the vertex of a light that is diffuse: it has none.
pub(super) const DIFFUSE: u32 = u32::MAX;

/// A virtual point light on a surface: one cache line.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vpl {
    p: Vec3,
    p_err: f32,
    /// Geometric normal on the side that light came to.
    pub(super) ng: Vec3,
    /// Shading normal on that side.
    pub(super) ns: Vec3,
    /// Of a diffuse light the radiance that it sends out, times the area that it stands for; of others the power that arrives.
    pub(super) rgb: Rgb,
    /// Segments from the light.
    pub(super) depth: u32,
    /// Which of [`VplSet::vertices`] it is; [`DIFFUSE`] for most.
    pub(super) vertex: u32,
    /// Which map shows the side of its normal; the next is that of the other side, if it is not diffuse.
    pub(super) map: u32,
}

const _: () = assert!(size_of::<Vpl>() == 64);

impl Vpl {
    fn new(point: &SurfacePoint, side: f32, rgb: Rgb, depth: u32, vertex: u32) -> Self {
        let (ng, ns) = (point.ng * side, point.ns * side);
        Self { p: point.p, p_err: point.p_err, ng, ns, rgb, depth, vertex, map: NO_MAP }
    }

    /// World position.
    #[inline]
    pub(super) fn position(&self) -> Vec3 {
        self.p
    }

    /// As much of the surface point as it takes to spawn rays.
    #[inline]
    pub(super) fn point(&self) -> SurfacePoint {
        let Self { p, p_err, ng, ns, .. } = *self;
        SurfacePoint { p, p_err, ng, ns, uv: glam::Vec2::ZERO, shape: 0, primitive: 0 }
    }
}

/// The virtual point lights of a pass.
#[derive(Debug, Default)]
pub struct VplSet<'w> {
    /// All that are diffuse, then the others.
    pub(super) lights: Vec<Vpl>,
    /// The diffuse ones again, if all are looked at.
    pub(super) blocks: Vec<Block>,
    /// Vertices of those that are not diffuse.
    pub(super) vertices: Vec<SurfaceVertex<'w>>,
    /// Starts of the light paths, which are lights too with `direct=vpl`.
    pub(super) starts: Vec<LeSample>,
    pub(super) maps: ShadowMaps,
    /// If only some of the lights are looked at.
    pub(super) tree: Option<LightTree>,
    /// Greatest geometry term that counts in full, one over world area.
    pub(super) clamp: f32,
    /// Rays that were traced to store the lights and to make their maps.
    pub rays: u64,
    /// Lights for which there was no room for a map.
    pub without_map: u64,
}

impl VplSet<'_> {
    /// Number of lights, starts of light paths included if they count as such.
    pub fn len(&self) -> usize {
        self.lights.len() + self.starts.len()
    }

    /// The diffuse lights.
    pub(super) fn diffuse(&self) -> &[Vpl] {
        &self.lights[..self.lights.len() - self.vertices.len()]
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// What a task stores.
#[derive(Default)]
struct Stored<'w> {
    lights: Vec<Vpl>,
    vertices: Vec<SurfaceVertex<'w>>,
    starts: Vec<LeSample>,
    rays: u64,
}

impl VirtualLights {
    /// The lights of a pass: a function of the pass alone, however many threads trace them.
    pub(in crate::integrators) fn lights<'w, Q: RayQuery>(
        &self,
        pass: &Pass<'w, '_, Q>,
    ) -> Result<VplSet<'w>, TooManyStored> {
        let bytes = size_of::<Vpl>();
        let error = TooManyStored { what: "virtual lights", parameter: "count", limit: MAX_STORED, bytes };
        let len = |stored: &Stored| stored.lights.len() + stored.starts.len();
        let trace = |slot, stored: &mut Stored<'w>| self.trace(pass, slot, stored);
        let tasks = collect(self.count, PATHS_PER_TASK, &error, len, trace)?;
        let mut set = VplSet { clamp: self.clamp / pass.world.bounds.radius.powi(2), ..VplSet::default() };
        set.lights.reserve_exact(tasks.iter().map(|task| task.lights.len()).sum());
        for task in tasks {
            let first = set.vertices.len() as u32;
            set.lights.extend(task.lights.into_iter().map(|light| match light.vertex {
                DIFFUSE => light,
                vertex => Vpl { vertex: first + vertex, ..light },
            }));
            set.vertices.extend(task.vertices);
            set.starts.extend(task.starts);
            set.rays += task.rays;
        }
        // Diffuse ones first, as blocks are of them alone.
        set.lights.sort_by_key(|light| light.vertex != DIFFUSE);
        if let Visibility::ShadowMap { resolution, bias } = self.visibility {
            set.make_maps(pass.query, resolution, bias);
        }
        if self.samples.is_some() {
            set.tree = set.make_tree(pass.world.bounds.radius);
        } else {
            set.blocks = set.diffuse().chunks(LANES).map(Block::new).collect();
        }
        Ok(set)
    }

    /// Traces the light path of a slot and stores lights where it goes.
    fn trace<'w, Q: RayQuery>(&self, pass: &Pass<'w, '_, Q>, slot: u32, stored: &mut Stored<'w>) {
        let Some((start, sampler)) = light_path::start(pass, u64::from(slot), u64::from(self.count)) else {
            return;
        };
        let power = start.power() / self.count as f32;
        if self.direct == Direct::Vpl {
            stored.starts.push(start);
        }
        // The last two segments of a path are the connection and the eye's.
        let last = self.length.limit().saturating_sub(2);
        let Stored { lights, vertices, rays, .. } = stored;
        *rays += light_path::deposit(
            pass,
            &start,
            &sampler,
            last,
            |_| true,
            |landing| {
                let Landing { vertex, beta, depth, .. } = *landing;
                let power = power * beta;
                let (ng_side, ns_side) = (vertex.wo.dot(vertex.point.ng), vertex.wo.dot(vertex.point.ns));
                // Light that comes from between both surfaces is not scattered.
                if power == Rgb::ZERO || ng_side * ns_side <= 0.0 || vertex.bsdf.is_narrow(self.roughness) {
                    return;
                }
                let side = 1.0_f32.copysign(ns_side);
                if let Some(reflectance) = vertex.bsdf.diffuse_reflectance() {
                    let rgb =
                        power * reflectance * (vertex.incidence_correction() * std::f32::consts::FRAC_1_PI);
                    if rgb != Rgb::ZERO {
                        lights.push(Vpl::new(&vertex.point, side, rgb, depth, DIFFUSE));
                    }
                } else {
                    lights.push(Vpl::new(&vertex.point, side, power, depth, vertices.len() as u32));
                    vertices.push(*vertex);
                }
            },
        );
    }
}

impl VplSet<'_> {
    fn make_maps<Q: RayQuery>(&mut self, query: &Q, resolution: u32, bias: f32) {
        let capacity = ShadowMaps::capacity(resolution);
        let mut viewpoints = Vec::new();
        for light in &mut self.lights {
            let is_opaque = light.vertex == DIFFUSE || self.vertices[light.vertex as usize].bsdf.is_opaque();
            if viewpoints.len() + 2 > capacity {
                self.without_map += 1;
                continue;
            }
            light.map = viewpoints.len() as u32;
            let (point, axis) = (light.point(), light.ng);
            viewpoints.push(Viewpoint { point, axis });
            if !is_opaque {
                viewpoints.push(Viewpoint { point, axis: -axis });
            }
        }
        let (maps, rays) = ShadowMaps::new(query, &viewpoints, resolution, bias);
        self.maps = maps;
        self.rays += rays;
    }

    fn make_tree(&self, scene_radius: f32) -> Option<LightTree> {
        /// Least distance that the tree tells from 0, in radii of the scene.
        const LEAST_DISTANCE: f32 = 1e-5;
        let of = |light: &Vpl| {
            let power = match light.vertex {
                DIFFUSE => light.rgb,
                vertex => light.rgb * self.vertices[vertex as usize].albedo() * std::f32::consts::FRAC_1_PI,
            };
            TreeLight { position: light.p, normal: light.ng, power: power.max_element() }
        };
        let lights: Vec<TreeLight> = self.lights.iter().map(of).collect();
        let least = (LEAST_DISTANCE * scene_radius).powi(2);
        LightTree::new(&lights, (1.0 / self.clamp).clamp(least, f32::MAX))
    }
}
