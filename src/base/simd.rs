//! The vector instructions that loops run on.
//!
//! Loops over slices and `[T; W]` vectorise by themselves; what the compiler needs is leave to use more than the baseline of the
//! target. x86-64's has half the lanes of AVX2 and no fused multiply-add. AVX-512 takes 5 to 13 % off a block's time on Zen 4, which has
//! no wider units but fewer operations to keep track of. NEON is aarch64's baseline.
//!
//! The decoder's tasks use no fused multiply-add: the same operations in the same order on every lane, so the same bits at every
//! level. The encoder's may, and then differ by rounding between levels, never between threads or runs.

#[cfg(feature = "encode")]
use crate::base::real::Real;

/// What can run at any level. `FUSED`: multiply-adds are one instruction, with one rounding.
pub(crate) trait Task {
    /// Must be `#[inline(always)]` with all it calls, or it is compiled for the baseline.
    fn run<const FUSED: bool>(self);
}

/// Instructions of this machine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Level(Kind);

#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Baseline,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

/// Whether the target's baseline has fused multiply-adds; elsewhere `mul_add` is a slow function.
const BASELINE_FUSED: bool = cfg!(any(target_arch = "aarch64", target_feature = "fma"));

impl Level {
    /// The best one that the processor has.
    pub(crate) fn detect() -> Level {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // VBMI2 came with processors that the others no longer slow down.
            let wide = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl")
                && is_x86_feature_detected!("avx512vbmi2");
            return Level(if wide { Kind::Avx512 } else { Kind::Avx2 });
        }
        Level::baseline()
    }

    /// All that the processor has.
    #[cfg(test)]
    pub(crate) fn all() -> Vec<Level> {
        let best = Level::detect();
        #[cfg(target_arch = "x86_64")]
        if best.0 == Kind::Avx512 {
            return vec![Level::baseline(), Level(Kind::Avx2), best];
        }
        vec![Level::baseline(), best]
    }

    /// That of every processor of the target.
    pub(crate) fn baseline() -> Level {
        Level(Kind::Baseline)
    }

    #[inline]
    #[allow(unsafe_code)]
    pub(crate) fn run(self, task: impl Task) {
        match self.0 {
            Kind::Baseline => task.run::<BASELINE_FUSED>(),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: a level of these kinds comes of what `detect` found, which are all of the features.
            Kind::Avx2 => unsafe { avx2(task) },
            #[cfg(target_arch = "x86_64")]
            // SAFETY: likewise.
            Kind::Avx512 => unsafe { avx512(task) },
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma")]
fn avx2(task: impl Task) {
    task.run::<true>();
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,fma,avx512f,avx512bw,avx512dq,avx512vl,avx512vbmi2")]
fn avx512(task: impl Task) {
    task.run::<true>();
}

/// `a * b + sum`
#[cfg(feature = "encode")]
#[inline(always)]
pub(crate) fn multiply_add<T: Real, const FUSED: bool>(a: T, b: T, sum: T) -> T {
    if FUSED { a.fused(b, sum) } else { a * b + sum }
}
