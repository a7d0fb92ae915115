//! Which vector instructions run: the same code, compiled once for each.
//!
//! There is one source of every kernel, so that all paths give the same bits; what differs is what the
//! compiler may use. That takes `unsafe`, because a function compiled for instructions that a machine
//! lacks must not be called there: this file calls one only after asking the machine.
#![allow(
    unsafe_code,
    reason = "functions for one kind of processor are called after detection, nothing else"
)]

/// What the kernels are compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VectorPath {
    /// What every processor of the architecture has; on 64-bit ARM that is NEON.
    Portable,
    /// x86-64 with AVX2.
    Avx2,
    /// x86-64 with AVX-512 (F, BW, DQ, VL).
    Avx512,
}

impl VectorPath {
    /// Does this machine have it?
    pub fn is_available(self) -> bool {
        match self {
            VectorPath::Portable => true,
            #[cfg(target_arch = "x86_64")]
            VectorPath::Avx2 => {
                is_x86_feature_detected!("avx2")
                    && is_x86_feature_detected!("bmi1")
                    && is_x86_feature_detected!("bmi2")
                    && is_x86_feature_detected!("lzcnt")
                    && is_x86_feature_detected!("popcnt")
            }
            #[cfg(target_arch = "x86_64")]
            VectorPath::Avx512 => {
                VectorPath::Avx2.is_available()
                    && is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
            }
            #[cfg(not(target_arch = "x86_64"))]
            VectorPath::Avx2 | VectorPath::Avx512 => false,
        }
    }

    /// The widest that this machine has.
    pub fn best() -> VectorPath {
        let available = [VectorPath::Avx512, VectorPath::Avx2].into_iter().find(|path| path.is_available());
        available.unwrap_or(VectorPath::Portable)
    }

    /// Does a piece of work, compiled for this path; on a machine without it, for the portable one.
    #[inline]
    pub(crate) fn run<W: Work>(self, work: W) -> W::Output {
        #[cfg(target_arch = "x86_64")]
        if self != VectorPath::Portable && self.is_available() {
            // SAFETY: the machine was asked for just these features.
            return unsafe {
                match self {
                    VectorPath::Avx512 => avx512(work),
                    _ => avx2(work),
                }
            };
        }
        work.run()
    }
}

/// Work that is compiled for every path. `run`, and all it calls, must be `#[inline(always)]`.
pub(crate) trait Work {
    type Output;
    fn run(self) -> Self::Output;
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
