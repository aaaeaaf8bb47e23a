//! One long axis by rustdct or realfft, line by line.

use std::f64::consts::FRAC_1_SQRT_2;
use std::sync::Arc;

use realfft::num_complex::Complex64;
use realfft::{ComplexToReal, RealFftPlanner, RealToComplex};
use rustdct::{DctPlanner, TransformType2And3};

use crate::fourier::Basis;

/// An axis of length n with the scratch of its plans.
pub(super) struct Long {
    plan: Plan,
    line: Vec<f64>,
}

enum Plan {
    Dct {
        plan: Arc<dyn TransformType2And3<f64>>,
        scratch: Vec<f64>,
    },
    Dft {
        analysis: Arc<dyn RealToComplex<f64>>,
        synthesis: Arc<dyn ComplexToReal<f64>>,
        spectrum: Vec<Complex64>,
        scratch: Vec<Complex64>,
    },
}

impl Long {
    pub(super) fn new(basis: Basis, n: usize) -> Long {
        let plan = match basis {
            Basis::Dct => {
                let plan = DctPlanner::new().plan_dct2(n);
                let scratch = vec![0.0; plan.get_scratch_len()];
                Plan::Dct { plan, scratch }
            }
            Basis::Dft => {
                let mut planner = RealFftPlanner::new();
                let (analysis, synthesis) = (planner.plan_fft_forward(n), planner.plan_fft_inverse(n));
                let scratch = analysis.get_scratch_len().max(synthesis.get_scratch_len());
                let scratch = vec![Complex64::default(); scratch];
                Plan::Dft { analysis, synthesis, spectrum: vec![Complex64::default(); n / 2 + 1], scratch }
            }
        };
        Long { plan, line: vec![0.0; n] }
    }

    /// Transforms all lines of a block, whose entries are `inner` values apart.
    pub(super) fn along(&mut self, inner: usize, block: &mut [f64], forward: bool) {
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
        let (single, double) = norms(line.len());
        match &mut self.plan {
            Plan::Dct { plan, scratch } => {
                plan.process_dct2_with_scratch(line, scratch);
                line[0] *= single;
                line[1..].iter_mut().for_each(|c| *c *= double);
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
        let (single, double) = norms(line.len());
        match &mut self.plan {
            Plan::Dct { plan, scratch } => {
                // rustdct's DCT-III halves the first coefficient.
                line[0] *= 2.0 * single;
                line[1..].iter_mut().for_each(|c| *c *= double);
                plan.process_dct3_with_scratch(line, scratch);
            }
            Plan::Dft { synthesis, spectrum, scratch, .. } => {
                spectrum[0] = Complex64::new(line[0] * single, 0.0);
                let (pairs, nyquist) = line[1..].as_chunks::<2>();
                // realfft adds the other half of the spectrum.
                let half = single * FRAC_1_SQRT_2;
                for (z, pair) in spectrum[1..].iter_mut().zip(pairs) {
                    *z = Complex64::new(pair[0] * half, pair[1] * half);
                }
                if let ([last], Some(z)) = (nyquist, spectrum.last_mut()) {
                    *z = Complex64::new(last * single, 0.0);
                }
                let done = synthesis.process_with_scratch(spectrum, line, scratch);
                debug_assert!(done.is_ok());
            }
        }
    }
}

/// Norms of the constant and alternating basis functions and of all others.
fn norms(n: usize) -> (f64, f64) {
    ((1.0 / n as f64).sqrt(), (2.0 / n as f64).sqrt())
}
