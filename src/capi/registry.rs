//! Handles: numbers that stand for objects, given out once and never again.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError, RwLock};

use super::border::{Failure, Outcome};
use super::types::helmholtz_status as Status;

/// All living objects of a kind.
pub(super) struct Registry<T> {
    kind: &'static str,
    objects: RwLock<BTreeMap<u64, Arc<T>>>,
}

/// A number that no handle had before, of whatever kind, and that does not look like one that a program would have by chance.
fn next_id() -> u64 {
    static COUNT: AtomicU64 = AtomicU64::new(1);
    // A bijection of 64 bits (odd factor), so no number comes twice; 0 comes from 0 only.
    COUNT.fetch_add(1, Ordering::Relaxed).wrapping_mul(0x9e37_79b9_7f4a_7c15)
}

impl<T> Registry<T> {
    pub(super) const fn new(kind: &'static str) -> Self {
        Self { kind, objects: RwLock::new(BTreeMap::new()) }
    }

    /// Keeps an object, and gives it a number.
    pub(super) fn add(&self, object: Arc<T>) -> u64 {
        let id = next_id();
        self.objects.write().unwrap_or_else(PoisonError::into_inner).insert(id, object);
        id
    }

    /// The object of a number.
    pub(super) fn get(&self, id: u64) -> Outcome<Arc<T>> {
        let objects = self.objects.read().unwrap_or_else(PoisonError::into_inner);
        objects.get(&id).map(Arc::clone).ok_or_else(|| self.unknown())
    }

    /// Lets go of an object. Who uses it at the moment still holds it.
    pub(super) fn remove(&self, id: u64) -> Outcome<Arc<T>> {
        let removed = self.objects.write().unwrap_or_else(PoisonError::into_inner).remove(&id);
        removed.ok_or_else(|| self.unknown())
    }

    fn unknown(&self) -> Failure {
        let message = format!("the handle is of no {0}, or of one that was freed", self.kind);
        Failure::new(Status::HELMHOLTZ_INVALID_HANDLE, message)
    }
}
