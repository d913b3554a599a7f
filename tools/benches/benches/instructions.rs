//! Instructions of every kernel, counted by callgrind: the same on every run, whatever else the machine does.
//!
//! `cargo bench -p rivet-benches --bench instructions`, with valgrind and `cargo install gungraun-runner`.
#![allow(missing_docs, reason = "the macros make public items")]

use gungraun::{library_benchmark, library_benchmark_group, main};
use rivet_benches::{Kernel, Workload, kernel};

/// Calls that are counted: enough for a whole cycle of the supervision.
const CALLS: usize = 100;

fn ready(item: Kernel) -> Box<dyn FnMut()> {
    // Never freed: the call borrows it for as long as the process runs.
    let workload = Box::leak(Box::new(Workload::new().expect("the robot folder of this project")));
    kernel(workload, item).expect("the defaults are sound")
}

#[library_benchmark(setup = ready)]
#[bench::inverse_dynamics(Kernel::InverseDynamics)]
#[bench::regressor(Kernel::Regressor)]
#[bench::filter(Kernel::Filter)]
#[bench::front(Kernel::Front)]
#[bench::plain(Kernel::Plain)]
#[bench::least_squares(Kernel::LeastSquares)]
#[bench::columns(Kernel::Columns)]
#[bench::eigen(Kernel::Eigen)]
#[bench::tracked(Kernel::Tracked)]
#[bench::supervised(Kernel::Supervised)]
#[bench::default(Kernel::Default)]
fn hundred_calls(mut call: Box<dyn FnMut()>) {
    for _ in 0..CALLS {
        call();
    }
}

library_benchmark_group!(name = period, benchmarks = hundred_calls);
main!(library_benchmark_groups = period);
