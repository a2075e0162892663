//! The checks of `helmholtz selftest`, group by group, and what shows that they would notice.

mod far;
mod teeth;

use helmholtz::selftest::{Bench, Effort, Group, run};

/// Every check of a group is within its limit, on every backend.
fn check(group: Group, effort: Effort) {
    let findings: Vec<_> = Bench::all(effort)
        .iter()
        .flat_map(|bench| run(group, bench).expect("the checks can be made"))
        .collect();
    assert!(!findings.is_empty());
    let failed: Vec<_> = findings.iter().filter(|finding| !finding.is_passed()).collect();
    assert!(failed.is_empty(), "{} of {} checks failed: {failed:#?}", failed.len(), findings.len());
}

macro_rules! groups {
    ($($test:ident: $group:ident;)*) => {
        $(#[test] fn $test() { check(Group::$group, Effort::Quick); })*

        /// The long forms: `cargo test --release -- --ignored --nocapture extremes::full`.
        mod full {
            use super::*;
            $(#[test] #[ignore = "takes up to an hour"] fn $test() { check(Group::$group, Effort::Full); })*
        }
    };
}

groups! {
    watertightness: Watertightness;
    self_intersection: SelfIntersection;
    scale: Scale;
    place: Place;
    orientation: Orientation;
    materials: Materials;
    lights: Lights;
    densities: Densities;
    sums: Sums;
    malformed: Malformed;
}
