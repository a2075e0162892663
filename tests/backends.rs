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
