//! l1 recovery of coefficients from samples (spec section 4.5; encoder only).
//!
//! The problems, for samples y = A s with A = (point sampling) x (inverse transform):
//! basis pursuit denoise  min ||W s||_1  subject to  ||A s - y||_2 <= sigma,
//! LASSO                  min ||A s - y||_2  subject to  ||W s||_1 <= tau.
//!
//! `spgl1` is what callers use. Below it, `pareto` finds tau, `descent` solves for one tau, `ball` projects, `norm` says
//! what is projected onto and `groups` how it is held, `working` keeps to the columns that matter where samples are few.
//! They assume only that A is linear; where A A^T = 1 and no proof is asked for, `splitting` takes a shorter way.

mod ball;
pub mod debias;
mod descent;
mod groups;
pub mod norm;
mod options;
mod pareto;
pub mod sampled;
pub mod spgl1;
mod splitting;
mod vector;
mod working;

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
    /// samples = column `index` of A, if that costs but a few operations a sample: solves from few samples then work on
    /// the columns that matter. `false` (the default) leaves the samples alone.
    fn column(&mut self, index: usize, samples: &mut [f64]) -> bool {
        let _ = (index, samples);
        false
    }
    /// Whether A A^T = 1 for certain: there is a faster way to a good point then. `false` is always right.
    fn orthonormal_rows(&self) -> bool {
        false
    }
    /// Is shown every iterate of a BPDN solve, the start included. Nothing depends on it.
    fn watch(&mut self, iterate: &Iterate) {
        let _ = iterate;
    }
}

/// An iterate, of the problem with the samples scaled to ||y|| = 1. Costs nothing until it is looked at.
#[derive(Clone, Copy)]
pub struct Iterate<'a> {
    /// Steps so far.
    pub iterations: usize,
    /// Forward and adjoint transforms so far; steps over a working set take none.
    pub transforms: usize,
    /// y - A s
    pub residual: &'a [f64],
    state: &'a descent::State,
    groups: &'a groups::Groups,
}

impl Iterate<'_> {
    /// Writes the coefficients s, as many as the operator's columns.
    ///
    /// # Panics
    /// Where `coefficients` has another length.
    pub fn coefficients(&self, coefficients: &mut [f64]) {
        self.state.unpack(self.groups, coefficients);
    }
}
