//! Sets of passes.

use serde::{Deserialize, Serialize};
use std::ops::Range;

/// A set of pass indices, kept as sorted half-open ranges that neither overlap nor touch.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct PassRanges(Vec<Range<u32>>);

impl PassRanges {
    /// Puts one pass in. `false`, and nothing changes, if it was in already or is [`u32::MAX`], which no half-open range can hold.
    #[must_use]
    pub fn insert(&mut self, pass: u32) -> bool {
        let Some(end) = pass.checked_add(1) else { return false };
        let next = self.0.partition_point(|r| r.start <= pass);
        let before = next.checked_sub(1);
        if before.is_some_and(|i| self.0[i].end > pass) {
            return false;
        }
        let joins_before = before.filter(|&i| self.0[i].end == pass);
        let joins_after = self.0.get(next).is_some_and(|r| r.start == end);
        match (joins_before, joins_after) {
            (Some(i), true) => self.0[i].end = self.0.remove(next).end,
            (Some(i), false) => self.0[i].end = end,
            (None, true) => self.0[next].start = pass,
            (None, false) => self.0.insert(next, pass..end),
        }
        true
    }

    /// Whether a pass is in the set.
    pub fn contains(&self, pass: u32) -> bool {
        self.0.iter().any(|r| r.contains(&pass))
    }

    /// Number of passes.
    pub fn len(&self) -> u32 {
        // Disjoint ranges below u32::MAX cannot sum to more.
        self.0.iter().map(|r| r.end - r.start).sum()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The lowest pass.
    pub fn first(&self) -> Option<u32> {
        self.0.first().map(|r| r.start)
    }

    /// The ranges in ascending order.
    pub fn ranges(&self) -> &[Range<u32>] {
        &self.0
    }

    /// A pass that both sets have, if any.
    pub fn common(&self, other: &Self) -> Option<u32> {
        let starts = self.0.iter().chain(&other.0).map(|r| r.start);
        starts.filter(|&pass| self.contains(pass) && other.contains(pass)).min()
    }

    /// The passes of both sets together.
    #[must_use]
    pub fn union(&self, other: &Self) -> Self {
        let mut all: Vec<_> = self.0.iter().chain(&other.0).cloned().collect();
        all.sort_by_key(|r| r.start);
        let mut union: Vec<Range<u32>> = Vec::with_capacity(all.len());
        for range in all {
            match union.last_mut() {
                Some(last) if range.start <= last.end => last.end = last.end.max(range.end),
                _ => union.push(range),
            }
        }
        Self(union)
    }

    /// Whether the ranges are sorted, not empty and apart, as they are unless read from a file.
    pub(super) fn is_valid(&self) -> bool {
        self.0.iter().all(|r| r.start < r.end) && self.0.windows(2).all(|w| w[0].end < w[1].start)
    }
}

impl std::fmt::Display for PassRanges {
    /// As `0-63, 128-191`, bounds inclusive.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (i, range) in self.0.iter().enumerate() {
            let separator = if i == 0 { "" } else { ", " };
            write!(f, "{separator}{}-{}", range.start, range.end - 1)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::collections::BTreeSet;

    fn from_set(set: &BTreeSet<u32>) -> PassRanges {
        let mut ranges = PassRanges::default();
        for &pass in set {
            assert!(ranges.insert(pass));
        }
        ranges
    }

    proptest! {
        #[test]
        fn behaves_like_a_set(passes in prop::collection::vec(0u32..40, 0..60)) {
            let (mut ranges, mut set) = (PassRanges::default(), BTreeSet::new());
            for pass in passes {
                prop_assert_eq!(ranges.insert(pass), set.insert(pass));
                prop_assert!(ranges.is_valid());
            }
            prop_assert_eq!(ranges.len() as usize, set.len());
            prop_assert_eq!(ranges.first(), set.first().copied());
            prop_assert!((0..41).all(|pass| ranges.contains(pass) == set.contains(&pass)));
        }

        #[test]
        fn union_and_common(a in prop::collection::btree_set(0u32..40, 0..30), b in prop::collection::btree_set(0u32..40, 0..30)) {
            let (x, y) = (from_set(&a), from_set(&b));
            prop_assert_eq!(x.union(&y), from_set(&a.union(&b).copied().collect()));
            prop_assert_eq!(x.common(&y), a.intersection(&b).next().copied());
        }
    }

    #[test]
    fn the_last_index_does_not_fit() {
        let mut ranges = PassRanges::default();
        assert!(!ranges.insert(u32::MAX));
        assert!(ranges.insert(u32::MAX - 1));
        assert_eq!(ranges.to_string(), "4294967294-4294967294");
    }
}
