//! Light transport algorithms, one file each.

pub mod backward;
