//! One kernel on the portable path, so that the count of its instructions does not depend on the machine:
//! `kernel_counts NAME`. bench/callgrind/check.sh runs it.

use std::hint::black_box;
use std::process::ExitCode;

use hull::VectorPath;
use kernels::{KERNELS, Kernels};

/// The cameras' images.
const SIZE: (u32, u32) = (1920, 1080);
/// Points in the person's box.
const POINTS: usize = 8192;

fn main() -> ExitCode {
    let name = std::env::args().nth(1).unwrap_or_default();
    let Some((_, kernel)) = KERNELS.into_iter().find(|(known, _)| *known == name) else {
        return ExitCode::from(2);
    };
    let mut kernels = Kernels::new(SIZE, POINTS, VectorPath::Portable);
    // Buffers grow once.
    black_box(kernel(&mut kernels));
    if measured(kernel, &mut kernels) > 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

/// Callgrind counts what happens in here.
#[inline(never)]
fn measured(kernel: fn(&mut Kernels) -> u64, kernels: &mut Kernels) -> u64 {
    black_box(black_box(kernel)(kernels))
}
