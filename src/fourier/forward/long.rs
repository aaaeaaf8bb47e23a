//! One long axis by rustdct or realfft, line by line.

use std::f64::consts::FRAC_1_SQRT_2;
use std::sync::Arc;

use realfft::num_complex::Complex;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustdct::{DctPlanner, TransformType2And3};

use super::real::Real;
use crate::fourier::Basis;

/// An axis of length n with the scratch of its plans.
pub(super) struct Long<T: Real> {
    plan: Plan<T>,
    line: Vec<T>,
}

enum Plan<T: Real> {
    Dct {
        plan: Arc<dyn TransformType2And3<T>>,
        scratch: Vec<T>,
    },
    Dft {
        analysis: Arc<dyn RealToComplex<T>>,
        synthesis: Arc<dyn ComplexToReal<T>>,
        spectrum: Vec<Complex<T>>,
        scratch: Vec<Complex<T>>,
    },
}

impl<T: Real> Long<T> {
    pub(super) fn new(basis: Basis, n: usize) -> Long<T> {
        let plan = match basis {
            Basis::Dct => {
                let plan = DctPlanner::new().plan_dct2(n);
                let scratch = vec![T::zero(); plan.get_scratch_len()];
                Plan::Dct { plan, scratch }
            }
            Basis::Dft => {
                let mut planner = RealFftPlanner::new();
                let (analysis, synthesis) = (planner.plan_fft_forward(n), planner.plan_fft_inverse(n));
                let scratch = analysis.get_scratch_len().max(synthesis.get_scratch_len());
                let scratch = vec![Complex::default(); scratch];
                Plan::Dft { analysis, synthesis, spectrum: vec![Complex::default(); n / 2 + 1], scratch }
            }
        };
        Long { plan, line: vec![T::zero(); n] }
    }

    /// Transforms all lines of a block, whose entries are `inner` values apart.
    pub(super) fn along(&mut self, inner: usize, block: &mut [T], forward: bool) {
        for lines in block.chunks_exact_mut(self.line.len() * inner) {
            for lane in 0..inner {
                for (value, v) in self.line.iter_mut().zip(lines[lane..].iter().step_by(inner)) {
                    *value = *v;
                }
                if forward {
                    self.analyze();
                } else {
                    self.synthesize();
                }
                for (value, v) in self.line.iter().zip(lines[lane..].iter_mut().step_by(inner)) {
                    *v = *value;
                }
            }
        }
    }

    fn analyze(&mut self) {
        let line = &mut self.line[..];
        let (single, double) = norms::<T>(line.len());
        match &mut self.plan {
            Plan::Dct { plan, scratch } => {
                plan.process_dct2_with_scratch(line, scratch);
                line[0] = line[0] * single;
                line[1..].iter_mut().for_each(|c| *c = *c * double);
            }
            Plan::Dft { analysis, spectrum, scratch, .. } => {
                let done = analysis.process_with_scratch(line, spectrum, scratch);
                debug_assert!(done.is_ok());
                line[0] = spectrum[0].re * single;
                let (pairs, nyquist) = line[1..].as_chunks_mut::<2>();
                for (pair, z) in pairs.iter_mut().zip(&spectrum[1..]) {
                    *pair = [z.re * double, z.im * double];
                }
                if let [last] = nyquist {
                    *last = spectrum[spectrum.len() - 1].re * single;
                }
            }
        }
    }

    fn synthesize(&mut self) {
        let line = &mut self.line[..];
        let (single, double) = norms::<T>(line.len());
        match &mut self.plan {
            Plan::Dct { plan, scratch } => {
                // rustdct's DCT-III halves the first coefficient.
                line[0] = line[0] * (single + single);
                line[1..].iter_mut().for_each(|c| *c = *c * double);
                plan.process_dct3_with_scratch(line, scratch);
            }
            Plan::Dft { synthesis, spectrum, scratch, .. } => {
                spectrum[0] = Complex::new(line[0] * single, T::zero());
                let (pairs, nyquist) = line[1..].as_chunks::<2>();
                // realfft adds the other half of the spectrum.
                let half = single * T::of(FRAC_1_SQRT_2);
                for (z, pair) in spectrum[1..].iter_mut().zip(pairs) {
                    *z = Complex::new(pair[0] * half, pair[1] * half);
                }
                if let ([last], Some(z)) = (nyquist, spectrum.last_mut()) {
                    *z = Complex::new(*last * single, T::zero());
                }
                let done = synthesis.process_with_scratch(spectrum, line, scratch);
                debug_assert!(done.is_ok());
            }
        }
    }
}

/// Norms of the constant and alternating basis functions and of all others.
fn norms<T: Real>(n: usize) -> (T, T) {
    (T::of((1.0 / n as f64).sqrt()), T::of((2.0 / n as f64).sqrt()))
}
