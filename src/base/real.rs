//! The precisions that transforms and vector code run in.

use rustdct::DctNum;

/// Single or double precision.
pub trait Real: DctNum + Default + Into<f64> {
    /// The nearest value.
    fn of(value: f64) -> Self;

    /// `self * b + sum` with one rounding.
    fn fused(self, b: Self, sum: Self) -> Self;
}

impl Real for f32 {
    #[inline(always)]
    fn of(value: f64) -> f32 {
        value as f32
    }

    #[inline(always)]
    fn fused(self, b: f32, sum: f32) -> f32 {
        self.mul_add(b, sum)
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> f64 {
        value
    }

    #[inline(always)]
    fn fused(self, b: f64, sum: f64) -> f64 {
        self.mul_add(b, sum)
    }
}
