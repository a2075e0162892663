//! Runs a test on every backend of this build.

use helmholtz::query::BuildQuality;
use helmholtz::query::RayQuery;
use helmholtz::query::obvhs::ObvhsQuery;
use helmholtz::scene::Shape;

/// Something to be done with any backend; a closure cannot be generic.
pub(crate) trait BackendTest {
    fn run<Q: RayQuery>(&self, backend: &str, query: &Q);
}

pub(crate) fn on_each_backend(shapes: &[Shape], test: &impl BackendTest) {
    #[cfg(feature = "embree")]
    {
        use helmholtz::query::embree::{EmbreeQuery, EmbreeSettings};
        let query = EmbreeQuery::new(shapes, EmbreeSettings::default()).expect("Embree");
        test.run("embree", &query);
    }
    test.run("obvhs", &ObvhsQuery::new(shapes, BuildQuality::default()));
}

/// Where a test is about what is above the queries, one backend is enough.
pub(crate) fn on_first_backend(shapes: &[Shape], test: &impl BackendTest) {
    #[cfg(feature = "embree")]
    {
        use helmholtz::query::embree::{EmbreeQuery, EmbreeSettings};
        test.run("embree", &EmbreeQuery::new(shapes, EmbreeSettings::default()).expect("Embree"));
    }
    #[cfg(not(feature = "embree"))]
    test.run("obvhs", &ObvhsQuery::new(shapes, BuildQuality::default()));
}
