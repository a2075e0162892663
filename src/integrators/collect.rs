//! What the light paths of a pass leave behind, photons or virtual lights, traced on all threads and kept in the order of the paths. How much it will be
//! follows from the scene only as it is traced: there is a limit.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

/// A pass would store more than there may be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("more than {limit} {what} ({} MiB) would be stored in a pass; emit fewer in each ({parameter}=) and make more passes", (limit * bytes) >> 20)]
pub struct TooManyStored {
    /// What is stored, in the plural.
    pub what: &'static str,
    /// The parameter that says how many light paths there are.
    pub parameter: &'static str,
    /// Most that may be stored.
    pub limit: usize,
    /// Size of each.
    pub bytes: usize,
}

/// Traces light paths 0 to `count` by `trace`, `per_task` of them in a task, which stores what they leave in an `S`; these come back in the order of the tasks.
///
/// # Errors
/// With `error`, soon after more is stored than its limit, by the count of `len`.
pub(super) fn collect<S: Default + Send>(
    count: u32,
    per_task: u32,
    error: &TooManyStored,
    len: impl Fn(&S) -> usize + Sync,
    trace: impl Fn(u32, &mut S) + Sync,
) -> Result<Vec<S>, TooManyStored> {
    let total = AtomicUsize::new(0);
    let run = |task: u32| {
        let mut stored = S::default();
        let first = task * per_task;
        for slot in first..(first + per_task).min(count) {
            trace(slot, &mut stored);
        }
        let before = total.fetch_add(len(&stored), Ordering::Relaxed);
        if before + len(&stored) > error.limit { Err(error.clone()) } else { Ok(stored) }
    };
    (0..count.div_ceil(per_task)).into_par_iter().map(run).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};

    use super::{TooManyStored, collect};

    /// An error as soon as there are too many, long before all are traced; in order of their slots else.
    #[test]
    fn what_is_stored_is_limited() {
        let traced = AtomicU32::new(0);
        let trace = |slot: u32, stored: &mut Vec<u32>| {
            traced.fetch_add(1, Ordering::Relaxed);
            stored.extend([slot; 3]);
        };
        let error = |limit| TooManyStored { what: "numbers", parameter: "count", limit, bytes: 4 };
        let tasks = collect(20_000, 4096, &error(60_000), Vec::len, trace).expect("as many as there may be");
        assert!(tasks.iter().flatten().eq((0..20_000).flat_map(|slot| [slot; 3]).collect::<Vec<_>>().iter()));
        traced.store(0, Ordering::Relaxed);
        assert_eq!(collect(1 << 28, 4096, &error(59_999), Vec::len, trace), Err(error(59_999)));
        assert!(traced.into_inner() < 1 << 24);
    }
}
