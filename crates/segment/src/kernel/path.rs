//! The same code, compiled once for each set of vector instructions.
//!
//! There is one source of every kernel, so that all paths give the same bits; what differs is what the
//! compiler may use. That takes `unsafe`, because a function compiled for instructions that a machine
//! lacks must not be called there: this file calls one only after asking the machine.
#![allow(
    unsafe_code,
    reason = "functions for one kind of processor are called after detection, nothing else"
)]

use hull::VectorPath;

/// Work that is compiled for every path. `run`, and all it calls, must be `#[inline(always)]`.
pub(crate) trait Work: Sized {
    type Output;
    fn run(self) -> Self::Output;

    /// The same, compiled for a path; on a machine without it, for the portable one.
    #[inline]
    fn run_on(self, path: VectorPath) -> Self::Output {
        #[cfg(target_arch = "x86_64")]
        if path != VectorPath::Portable && path.is_available() {
            // SAFETY: the machine was asked for just these features, and more.
            return unsafe {
                match path {
                    VectorPath::Avx512 => avx512(self),
                    _ => avx2(self),
                }
            };
        }
        self.run()
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn avx2<W: Work>(work: W) -> W::Output {
    work.run()
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt,avx512f,avx512bw,avx512dq,avx512vl")]
fn avx512<W: Work>(work: W) -> W::Output {
    work.run()
}
