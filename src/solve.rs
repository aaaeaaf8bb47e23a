//! l1 recovery of coefficients from samples (spec section 4.5; encoder only).
//!
//! The problems, for samples y = A s with A = (point sampling) x (inverse transform):
//! basis pursuit denoise  min ||W s||_1  subject to  ||A s - y||_2 <= sigma,
//! LASSO                  min ||A s - y||_2  subject to  ||W s||_1 <= tau.
//!
//! `spgl1` is what callers use; below it, `pareto` finds tau, `descent` solves for one tau, `ball` projects, `norm` says
//! what is projected onto. Only linearity of A is assumed; orthonormal rows make it fast.

pub mod ball;
mod descent;
pub mod norm;
mod pareto;
pub mod spgl1;
mod vector;

#[cfg(test)]
mod agreement;
#[cfg(test)]
mod extremes;
#[cfg(test)]
mod optimality;
#[cfg(test)]
mod testing;

/// A linear map between coefficients (columns) and samples (rows), with its adjoint.
pub trait Operator {
    /// Number of samples.
    fn rows(&self) -> usize;
    /// Number of coefficients.
    fn cols(&self) -> usize;
    /// samples = A coefficients.
    fn forward(&mut self, coefficients: &[f64], samples: &mut [f64]);
    /// coefficients = A^T samples.
    fn adjoint(&mut self, samples: &[f64], coefficients: &mut [f64]);
    /// Is shown every iterate of a BPDN solve, the start included. Nothing depends on it.
    fn watch(&mut self, _: &Iterate) {}
}

/// An iterate, of the problem with the samples scaled to ||y|| = 1.
#[derive(Clone, Copy, Debug)]
pub struct Iterate<'a> {
    /// Steps so far.
    pub iterations: usize,
    /// Forward and adjoint transforms so far.
    pub transforms: usize,
    /// Coefficients s.
    pub coefficients: &'a [f64],
    /// y - A s
    pub residual: &'a [f64],
    /// A^T (y - A s)
    pub correlation: &'a [f64],
}
