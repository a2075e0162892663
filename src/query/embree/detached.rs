//! An Embree scene between the shapes that it was built over and those that they become.

use std::ptr;

use super::device::Device;
use super::instances::Instances;
use super::{EmbreeError, EmbreeQuery, EmbreeSettings, Scene, check_range, commit, ffi, geometry};
use crate::query::Update;
use crate::query::stamp::{Change, Stamps};
use crate::scene::{Aabb, Geometry, Shape};

/// What is left of an [`EmbreeQuery`] when the borrow of its shapes ends. It answers nothing, and holds pointers that it does not follow.
pub struct DetachedEmbree {
    // Dropped in this order, as in `EmbreeQuery`.
    scene: Scene,
    instances: Instances,
    device: Device,
    settings: EmbreeSettings,
    update: Update,
    stamps: Stamps,
}

// SAFETY: as for `EmbreeQuery`; nothing here follows a pointer.
unsafe impl Send for DetachedEmbree {}
// SAFETY: as for `EmbreeQuery`; there is nothing that can be done with a shared reference.
unsafe impl Sync for DetachedEmbree {}

impl EmbreeQuery<'_> {
    /// Ends the borrow of the shapes, so that they can be changed.
    pub fn detach(self) -> DetachedEmbree {
        let Self { scene, instances, device, shapes, settings, update, .. } = self;
        DetachedEmbree { scene, instances, device, settings, update, stamps: Stamps::of(shapes) }
    }
}

impl DetachedEmbree {
    /// A query over the shapes as they are now, with as much of what was built before as still holds: all of it if no surface changed, and after
    /// [`Update::Refit`] all but the boxes over meshes of which only positions did, and the hierarchy over the shapes as wholes.
    ///
    /// # Errors
    /// As of [`EmbreeQuery::new`].
    pub fn attach(
        mut self,
        shapes: &[Shape],
        settings: EmbreeSettings,
        update: Update,
    ) -> Result<EmbreeQuery<'_>, EmbreeError> {
        let change = self.stamps.change(shapes);
        let is_kept = (self.settings, self.update) == (settings, update)
            && (change == Change::None || update == Update::Refit && change != Change::Other);
        if !is_kept {
            return EmbreeQuery::with_update(shapes, settings, update);
        }
        // The stamps are equal: the list of shapes and all buffers, but for the positions of deformed meshes, lie where they lay.
        self.instances.look_at(shapes);
        for (id, shape) in (0..).zip(shapes) {
            if let Geometry::Analytic(analytic) = &shape.geometry {
                check_range(shape)?;
                // SAFETY: the scene is live and has this geometry; the callbacks of `geometry::attach` take the user data for an
                // `AnalyticShape`, which outlives the query.
                unsafe {
                    let user_data = ptr::from_ref(analytic).cast_mut().cast();
                    ffi::rtcSetGeometryUserData(ffi::rtcGetGeometry(self.scene.0, id), user_data);
                }
            }
        }
        if let Change::Deformed(meshes) = change {
            for id in meshes {
                self.update_mesh(id, &shapes[id as usize].geometry)?;
            }
            commit(&self.device, &self.scene, settings, update)?;
        }
        let Self { scene, instances, device, .. } = self;
        let bounds = shapes.iter().fold(Aabb::EMPTY, |bounds, shape| bounds.union(shape.geometry.bounds()));
        Ok(EmbreeQuery { scene, instances, device, shapes, bounds, settings, update, built_primitives: 0 })
    }

    /// Tells Embree of a mesh's new positions.
    fn update_mesh(&self, id: u32, now: &Geometry) -> Result<(), EmbreeError> {
        let Geometry::Mesh(mesh) = now else { return Ok(()) };
        if mesh.triangles().is_empty() {
            return Ok(());
        }
        // SAFETY: the scene is live and has this geometry, whose triangles and number of vertices are those of `mesh`; the mesh is borrowed for as
        // long as the query that is being made.
        unsafe {
            let handle = ffi::rtcGetGeometry(self.scene.0, id);
            geometry::set_positions(handle, mesh);
            ffi::rtcUpdateGeometryBuffer(handle, ffi::RTC_BUFFER_TYPE_VERTEX, 0);
            ffi::rtcCommitGeometry(handle);
        }
        self.device.check("rtcCommitGeometry")
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::scene::{MaterialId, TriangleMesh};

    /// A grid of two triangles per cell, in waves.
    fn grid(phase: f32) -> TriangleMesh {
        const N: u32 = 100;
        let vertex = |i: u32| {
            let (x, y) = ((i % (N + 1)) as f32, (i / (N + 1)) as f32);
            Vec3::new(x, y, 3.0 * (0.3 * x + phase).sin())
        };
        let cell = |i: u32| {
            let at = i / N * (N + 1) + i % N;
            [[at, at + 1, at + N + 1], [at + 1, at + N + 2, at + N + 1]]
        };
        let positions = (0..(N + 1) * (N + 1)).map(vertex).collect();
        TriangleMesh::new(positions, (0..N * N).flat_map(cell).collect(), vec![], vec![], false).unwrap()
    }

    /// Embree itself says what it does: a build allocates 100 bytes for each triangle, a refit nothing.
    #[test]
    fn a_refit_builds_nothing_but_the_top() {
        const TRIANGLES: u64 = 20_000;
        let settings = EmbreeSettings::default();
        let shape = |mesh| Shape {
            name: String::new(),
            geometry: Geometry::Mesh(mesh),
            material: MaterialId(0),
            emission: None,
        };
        let mut shapes = vec![shape(grid(0.0)), shape(grid(1.0))];
        let mut query = EmbreeQuery::with_update(&shapes, settings, Update::Refit).unwrap();
        assert_eq!(query.built_primitives(), 2 * TRIANGLES);
        let built = query.device.allocated();
        assert!(built > 2 * TRIANGLES as usize * 32, "{built} bytes");
        for phase in [0.5, 1.5] {
            let detached = query.detach();
            let empty = TriangleMesh::new(vec![], vec![], vec![], vec![], false).unwrap();
            let Geometry::Mesh(old) = &mut shapes[0].geometry else { unreachable!() };
            let old = std::mem::replace(old, empty);
            shapes[0].geometry = Geometry::Mesh(grid(phase).in_place_of(old));
            let before = detached.device.allocated();
            query = detached.attach(&shapes, settings, Update::Refit).unwrap();
            assert_eq!(query.built_primitives(), 0);
            let allocated = query.device.allocated() - before;
            assert!(allocated < built / 100, "{allocated} of {built} bytes");
        }
    }
}
