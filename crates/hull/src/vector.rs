//! Which vector instructions the probes use. Every path gives the same bits: the operations and their
//! order are the same, and nothing is contracted to fused multiply-add.

/// A set of instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum VectorPath {
    /// What every processor of the architecture has: SSE2 on x86-64, NEON on 64-bit ARM.
    Portable,
    /// AVX2, BMI and their like: x86-64 since about 2013.
    Avx2,
    /// AVX-512 with what came with Ice Lake and Zen 4.
    Avx512,
}

impl VectorPath {
    /// All paths, the plainest first.
    pub const ALL: [VectorPath; 3] = [VectorPath::Portable, VectorPath::Avx2, VectorPath::Avx512];

    /// The best path of this processor.
    pub fn best() -> VectorPath {
        VectorPath::ALL.into_iter().rfind(|path| path.is_available()).unwrap_or(VectorPath::Portable)
    }

    /// True if this processor has the instructions.
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
                    && is_x86_feature_detected!("avx512cd")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512vpopcntdq")
            }
            #[cfg(not(target_arch = "x86_64"))]
            VectorPath::Avx2 | VectorPath::Avx512 => false,
        }
    }
}

/// Defines a method that runs its body, which must be inlined always, with the instructions of
/// `self.path`. A [`VectorPath`] other than the portable one is only kept by code that has
/// asked whether it is available.
macro_rules! on_path {
    ($(#[$doc:meta])* $visibility:vis fn $name:ident(&self, $($argument:ident: $kind:ty),* $(,)?) => $body:ident, $avx2:ident, $avx512:ident) => {
        $(#[$doc])*
        $visibility fn $name(&self, $($argument: $kind),*) {
            match self.path {
                #[cfg(target_arch = "x86_64")]
                #[allow(unsafe_code, reason = "the path was asked whether it is available when it was chosen")]
                VectorPath::Avx512 => unsafe { self.$avx512($($argument),*) },
                #[cfg(target_arch = "x86_64")]
                #[allow(unsafe_code, reason = "the path was asked whether it is available when it was chosen")]
                VectorPath::Avx2 => unsafe { self.$avx2($($argument),*) },
                _ => self.$body($($argument),*),
            }
        }

        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
        fn $avx2(&self, $($argument: $kind),*) {
            self.$body($($argument),*);
        }

        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx512f,avx512bw,avx512cd,avx512dq,avx512vl,avx512vpopcntdq,avx2,bmi1,bmi2,lzcnt,popcnt")]
        fn $avx512(&self, $($argument: $kind),*) {
            self.$body($($argument),*);
        }
    };
}
pub(crate) use on_path;
