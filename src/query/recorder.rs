//! Queries passed on and written down, so that a backend can be asked an integrator's own rays again.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::sync::{Mutex, PoisonError};

use super::{Hit, Ray, RayQuery};
use crate::scene::Aabb;

/// Lists that threads share: with as many as this they hardly ever wait for each other.
const LISTS: usize = 64;

/// Rays written down by one thread or a few.
type List = Mutex<Recording>;

/// Rays in no particular order.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    /// Those of closest-hit queries.
    pub closest: Vec<Ray>,
    /// Those of occlusion queries.
    pub occlusion: Vec<Ray>,
}

/// Writes down the rays that a backend is asked, up to a number.
pub struct Recorder<Q> {
    query: Q,
    lists: Vec<List>,
    room: u64,
    asked: AtomicU64,
}

impl<Q: RayQuery> Recorder<Q> {
    /// Room for `room` rays of 32 bytes; those that come later are passed on only.
    pub fn new(query: Q, room: u64) -> Self {
        let lists = (0..LISTS).map(|_| List::default()).collect();
        Self { query, lists, room, asked: AtomicU64::new(0) }
    }

    /// The backend that answers.
    pub fn query(&self) -> &Q {
        &self.query
    }

    /// Takes what was written down, and makes room again. Also how many rays were not.
    pub fn take(&self) -> (Recording, u64) {
        let mut all = Recording::default();
        for list in &self.lists {
            let mut list = list.lock().unwrap_or_else(PoisonError::into_inner);
            all.closest.append(&mut list.closest);
            all.occlusion.append(&mut list.occlusion);
        }
        (all, self.asked.swap(0, Relaxed).saturating_sub(self.room))
    }

    fn note(&self, add: impl FnOnce(&mut Recording)) {
        if self.asked.fetch_add(1, Relaxed) < self.room {
            let list = &self.lists[rayon::current_thread_index().unwrap_or_default() % LISTS];
            add(&mut list.lock().unwrap_or_else(PoisonError::into_inner));
        }
    }
}

impl<Q: RayQuery> RayQuery for Recorder<Q> {
    fn intersect(&self, ray: &Ray) -> Option<Hit> {
        self.note(|list| list.closest.push(*ray));
        self.query.intersect(ray)
    }

    fn occluded(&self, ray: &Ray) -> bool {
        self.note(|list| list.occlusion.push(*ray));
        self.query.occluded(ray)
    }

    fn bounds(&self) -> Aabb {
        self.query.bounds()
    }

    fn memory(&self) -> usize {
        self.query.memory()
    }

    fn name(&self) -> String {
        self.query.name()
    }
}
