//! Criterion on the kernels: `cargo bench -p kernels`. A figure is one piece of work: a block of the inside
//! test, or all points inside in all cameras.

use std::hint::black_box;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use hull::VectorPath;
use kernels::{KERNELS, Kernels};

const SIZES: [(u32, u32); 3] = [(640, 480), (1920, 1080), (7680, 4320)];
const POINTS: usize = 8192;

fn kernels(criterion: &mut Criterion) {
    for path in VectorPath::ALL.into_iter().filter(|path| path.is_available()) {
        for size in SIZES {
            let mut kernels = Kernels::new(size, POINTS, path);
            for (name, kernel) in KERNELS {
                let id = BenchmarkId::new(format!("{path:?}"), format!("{}x{}", size.0, size.1));
                criterion.benchmark_group(name).bench_function(id, |bencher| {
                    bencher.iter(|| black_box(kernel(&mut kernels)));
                });
            }
        }
    }
}

criterion_group!(timed, kernels);
criterion_main!(timed);
