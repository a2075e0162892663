//! Ray tests for spheres, disks and cylinders in f64, shared by all backends.
