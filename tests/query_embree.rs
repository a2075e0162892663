//! Embree.
