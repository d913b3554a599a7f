//! Time of every kernel on this machine: `cargo bench -p rivet-benches --bench time`.
#![allow(missing_docs, reason = "the macros make public items")]

use criterion::{Criterion, criterion_group, criterion_main};
use rivet_benches::{Kernel, Workload, kernel};

fn kernels(criterion: &mut Criterion) {
    let workload = Workload::new().expect("the robot folder of this project");
    let mut group = criterion.benchmark_group("period");
    for item in Kernel::ALL {
        let mut call = kernel(&workload, item).expect("the defaults are sound");
        group.bench_function(item.name(), |bencher| bencher.iter(&mut call));
    }
    group.finish();
}

criterion_group!(benches, kernels);
criterion_main!(benches);
