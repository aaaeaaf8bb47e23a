//! One long axis line by line, in double precision, by rustdct and rustfft.
//!
//! By the scalar plans alone: rustfft is generic, so that all of it that a plan may need is compiled into this crate, and its plans with
//! vector instructions, in two precisions, were half of all that there was to compile, for axes that are rare.

use std::sync::Arc;

use rustdct::algorithm::Type2And3ConvertToFft;
use rustdct::{Dct2, Dct3, RequiredScratch};
use rustfft::num_complex::Complex;
use rustfft::{Fft, FftPlannerScalar};

use crate::base::real::Real;
use crate::codec::fourier::Basis;

/// An axis of length n with the scratch of its plans.
pub(super) struct Long {
    plan: Plan,
    line: Vec<f64>,
}

enum Plan {
    Dct {
        plan: Type2And3ConvertToFft<f64>,
        scratch: Vec<f64>,
    },
    Dft {
        forward: Arc<dyn Fft<f64>>,
        inverse: Arc<dyn Fft<f64>>,
        spectrum: Vec<Complex<f64>>,
        scratch: Vec<Complex<f64>>,
    },
}

impl Long {
    pub(super) fn new(basis: Basis, n: usize) -> Long {
        let mut planner = FftPlannerScalar::new();
        let forward = planner.plan_fft_forward(n);
        let plan = match basis {
            Basis::Dct => {
                let plan = Type2And3ConvertToFft::new(forward);
                let scratch = vec![0.0; plan.get_scratch_len()];
                Plan::Dct { plan, scratch }
            }
            Basis::Dft => {
                let inverse = planner.plan_fft_inverse(n);
                let scratch = forward.get_inplace_scratch_len().max(inverse.get_inplace_scratch_len());
                let [spectrum, scratch] = [n, scratch].map(|n| vec![Complex::default(); n]);
                Plan::Dft { forward, inverse, spectrum, scratch }
            }
        };
        Long { plan, line: vec![0.0; n] }
    }

    /// Transforms all lines of a block, whose entries are `inner` values apart.
    pub(super) fn along<T: Real>(&mut self, inner: usize, block: &mut [T], forward: bool) {
        for lines in block.chunks_exact_mut(self.line.len() * inner) {
            for lane in 0..inner {
                for (value, v) in self.line.iter_mut().zip(lines[lane..].iter().step_by(inner)) {
                    *value = (*v).into();
                }
                if forward {
                    self.analyze();
                } else {
                    self.synthesize();
                }
                for (value, v) in self.line.iter().zip(lines[lane..].iter_mut().step_by(inner)) {
                    *v = T::of(*value);
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
            Plan::Dft { forward, spectrum, scratch, .. } => {
                spectrum.iter_mut().zip(&*line).for_each(|(z, v)| *z = Complex::new(*v, 0.0));
                forward.process_with_scratch(spectrum, scratch);
                line[0] = spectrum[0].re * single;
                let (pairs, nyquist) = line[1..].as_chunks_mut::<2>();
                for (pair, z) in pairs.iter_mut().zip(&spectrum[1..]) {
                    *pair = [z.re * double, z.im * double];
                }
                if let [last] = nyquist {
                    *last = spectrum[spectrum.len() / 2].re * single;
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
                line[0] *= single + single;
                line[1..].iter_mut().for_each(|c| *c *= double);
                plan.process_dct3_with_scratch(line, scratch);
            }
            Plan::Dft { inverse, spectrum, scratch, .. } => {
                let n = spectrum.len();
                spectrum[0] = Complex::new(line[0] * single, 0.0);
                let (pairs, nyquist) = line[1..].as_chunks::<2>();
                for (k, [re, im]) in pairs.iter().enumerate() {
                    let z = Complex::new(re * double / 2.0, im * double / 2.0);
                    (spectrum[k + 1], spectrum[n - k - 1]) = (z, z.conj());
                }
                if let [last] = nyquist {
                    spectrum[n / 2] = Complex::new(last * single, 0.0);
                }
                inverse.process_with_scratch(spectrum, scratch);
                line.iter_mut().zip(&*spectrum).for_each(|(v, z)| *v = z.re);
            }
        }
    }
}

/// Norms of the constant and alternating basis functions and of all others.
fn norms(n: usize) -> (f64, f64) {
    ((1.0 / n as f64).sqrt(), (2.0 / n as f64).sqrt())
}
