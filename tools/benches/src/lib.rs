//! What a period costs, kernel by kernel: one list of kernels for time (criterion), instruction counts (callgrind) and
//! the comparison with a C++ program that does the same work (`rivet-peer`).

pub mod kernels;
pub mod workload;

pub use kernels::{Kernel, kernel};
pub use workload::Workload;
