//! A scene with what is built over it, in one value: the query and the world borrow from the scene that lies beside them.

use std::ptr::NonNull;

use super::border::{Failure, Outcome};
use super::types::helmholtz_status as Status;
#[cfg(feature = "embree")]
use crate::query::embree::{DetachedEmbree, EmbreeError, EmbreeQuery};
use crate::query::obvhs::{DetachedObvhs, ObvhsQuery};
use crate::query::{AnyQuery, Backend, Update};
use crate::scene::Scene;
use crate::transport::World;

/// What is kept of a query while the scene is changed.
pub(super) enum Detached {
    #[cfg(feature = "embree")]
    Embree(DetachedEmbree),
    Obvhs(DetachedObvhs),
}

/// A query over a scene; of `built`, what still holds is used again.
fn build(scene: &Scene, built: Option<Detached>, backend: Backend, update: Update) -> Outcome<AnyQuery<'_>> {
    match (backend, built) {
        #[cfg(feature = "embree")]
        (Backend::Embree(settings), Some(Detached::Embree(built))) => {
            built.attach(&scene.shapes, settings, update).map(AnyQuery::Embree).map_err(embree_failure)
        }
        #[cfg(feature = "embree")]
        (Backend::Embree(settings), _) => {
            let query = EmbreeQuery::with_update(&scene.shapes, settings, update);
            query.map(AnyQuery::Embree).map_err(embree_failure)
        }
        (Backend::Obvhs(quality), Some(Detached::Obvhs(built))) => {
            Ok(AnyQuery::Obvhs(built.attach(&scene.shapes, quality, update)))
        }
        (Backend::Obvhs(quality), _) => Ok(AnyQuery::Obvhs(ObvhsQuery::new(&scene.shapes, quality))),
        // What it finds would be told to nobody.
        (Backend::Crosscheck, _) => Err(Failure::new(
            Status::HELMHOLTZ_INVALID_ARGUMENT,
            "the backend `crosscheck` is for the command line; take embree or obvhs".to_owned(),
        )),
    }
}

/// What can be used again of a query.
fn detach(query: AnyQuery) -> Option<Detached> {
    match query {
        #[cfg(feature = "embree")]
        AnyQuery::Embree(query) => Some(Detached::Embree(query.detach())),
        AnyQuery::Obvhs(query) => Some(Detached::Obvhs(query.detach())),
        AnyQuery::Crosscheck(_) | AnyQuery::Recorder(_) => None,
    }
}

#[cfg(feature = "embree")]
#[allow(clippy::needless_pass_by_value, reason = "for map_err")]
fn embree_failure(error: EmbreeError) -> Failure {
    Failure::new(Status::HELMHOLTZ_BACKEND_ERROR, error.to_string())
}

/// A scene on the heap that can be borrowed while its owner moves, which a `Box` does not allow.
struct Owned(NonNull<Scene>);

// SAFETY: it owns a `Scene`, which may be sent and shared.
unsafe impl Send for Owned where Scene: Send {}
// SAFETY: as above.
unsafe impl Sync for Owned where Scene: Sync {}

impl Owned {
    fn new(scene: Scene) -> Self {
        Self(NonNull::from(Box::leak(Box::new(scene))))
    }

    fn into_inner(self) -> Scene {
        let this = std::mem::ManuallyDrop::new(self);
        // SAFETY: the pointer came from a box, and `self` is not dropped.
        *unsafe { Box::from_raw(this.0.as_ptr()) }
    }
}

impl Drop for Owned {
    fn drop(&mut self) {
        // SAFETY: the pointer came from a box and is not used again.
        drop(unsafe { Box::from_raw(self.0.as_ptr()) });
    }
}

/// A scene, ready to be rendered.
pub(super) struct Prepared {
    // Both borrow from `scene`, and so are dropped before it. The lifetime is a lie that no method passes on.
    query: AnyQuery<'static>,
    world: World<'static>,
    scene: Owned,
}

impl Prepared {
    /// Builds what is needed, on rayon's current pool; of `built`, what still holds is used again. On failure the scene is given back.
    pub(super) fn new(
        scene: Scene,
        built: Option<Detached>,
        backend: Backend,
        update: Update,
    ) -> Result<Self, Box<(Scene, Failure)>> {
        let owned = Owned::new(scene);
        // SAFETY: the scene is neither moved, changed nor freed as long as this reference is used: it goes into `query` and `world`, which are dropped
        // before `owned` here (where either fails or panics), in `dissolve`, and with `Self`.
        let scene: &'static Scene = unsafe { &*owned.0.as_ptr() };
        match build(scene, built, backend, update) {
            Ok(query) => Ok(Self { query, world: World::new(scene), scene: owned }),
            Err(failure) => Err(Box::new((owned.into_inner(), failure))),
        }
    }

    /// The scene, to be changed, and what can be used again.
    pub(super) fn dissolve(self) -> (Scene, Option<Detached>) {
        let Self { query, world, scene } = self;
        drop(world);
        let built = detach(query);
        (scene.into_inner(), built)
    }

    pub(super) fn query(&self) -> &AnyQuery<'_> {
        &self.query
    }

    /// Primitives over which hierarchies were built to make this.
    pub(super) fn built_primitives(&self) -> u64 {
        match &self.query {
            #[cfg(feature = "embree")]
            AnyQuery::Embree(query) => query.built_primitives(),
            AnyQuery::Obvhs(query) => query.built_primitives(),
            // Neither is built here.
            AnyQuery::Crosscheck(_) | AnyQuery::Recorder(_) => 0,
        }
    }

    pub(super) fn world(&self) -> &World<'_> {
        &self.world
    }

    pub(super) fn scene(&self) -> &Scene {
        self.world().scene
    }
}
