//! Analysis and synthesis in double precision for the encoder and its solver.
//!
//! The decoder fixes every rounding; the encoder need not, so it takes the fastest way. DCT axes up to 16 are dense
//! products over side-by-side lines, which vectorise; longer ones and all DFTs go through rustdct and rustfft.
//! Measured, seconds of an encode: 15 x 15 x 15 blocks, dense 9.3, rustdct 10.3; 6 x 10 x 60 blocks, all dense 4.0,
//! all rustdct 2.6, dense up to 16 1.3.

use std::sync::Arc;

use rustdct::{DctPlanner, TransformType2And3};
use rustfft::num_complex::Complex64;
use rustfft::{Fft, FftPlanner};

use super::Basis;
use super::dft::half_spectrum_map;

/// Longest axis transformed by a dense product.
const DENSE_MAX: usize = 16;

/// Analysis and synthesis of blocks of one shape; holds its own scratch, so one a thread.
pub struct Transform {
    shape: [usize; 4],
    kind: Kind,
    scratch: Vec<f64>,
}

enum Kind {
    Dct(Vec<DctAxis>),
    Dft(Box<Dft>),
}

impl Transform {
    /// For blocks of the given shape.
    pub fn new(basis: Basis, shape: [usize; 4]) -> Transform {
        let kind = match basis {
            Basis::Dct => Kind::Dct(shape.iter().map(|&n| DctAxis::new(n)).collect()),
            Basis::Dft => Kind::Dft(Box::new(Dft::new(shape))),
        };
        Transform { shape, kind, scratch: Vec::new() }
    }

    /// Number of values of a block.
    pub fn positions(&self) -> usize {
        self.shape.iter().product()
    }

    /// Block values to coefficients, in place.
    pub fn analyze(&mut self, block: &mut [f64]) {
        match &mut self.kind {
            Kind::Dct(axes) => dct_axes(axes, self.shape, block, &mut self.scratch, true),
            Kind::Dft(dft) => dft.analyze(block),
        }
    }

    /// Coefficients to block values, in place: the inverse and the adjoint of [`Transform::analyze`].
    pub fn synthesize(&mut self, block: &mut [f64]) {
        match &mut self.kind {
            Kind::Dct(axes) => dct_axes(axes, self.shape, block, &mut self.scratch, false),
            Kind::Dft(dft) => dft.synthesize(block),
        }
    }
}

enum DctAxis {
    /// `[k][i]` over the first half of the positions.
    Dense {
        n: usize,
        half: usize,
        cos: Vec<f64>,
    },
    Fast {
        n: usize,
        plan: Arc<dyn TransformType2And3<f64>>,
        scratch: Vec<f64>,
    },
}

impl DctAxis {
    fn new(n: usize) -> DctAxis {
        if n > DENSE_MAX {
            let plan = DctPlanner::new().plan_dct2(n);
            let scratch = vec![0.0; plan.get_scratch_len()];
            return DctAxis::Fast { n, plan, scratch };
        }
        let half = n.div_ceil(2);
        let mut cos = Vec::with_capacity(n * half);
        for k in 0..n {
            let norm = (if k == 0 { 1.0 } else { 2.0 } / n as f64).sqrt();
            let angle = |i: usize| std::f64::consts::PI * (k * (2 * i + 1)) as f64 / (2 * n) as f64;
            cos.extend((0..half).map(|i| angle(i).cos() * norm));
        }
        DctAxis::Dense { n, half, cos }
    }

    /// Transforms `inner` lines side by side: `lines[i * inner + lane]`.
    fn apply(&mut self, inner: usize, lines: &mut [f64], copy: &mut Vec<f64>, forward: bool) {
        match self {
            DctAxis::Dense { n: 1, .. } => {}
            DctAxis::Dense { n, half, cos } => {
                copy.clear();
                copy.extend_from_slice(lines);
                let axis = Dense { n: *n, half: *half, cos };
                let mut at = 0;
                while inner - at >= 8 {
                    axis.group::<8>(inner, at, copy, lines, forward);
                    at += 8;
                }
                while inner > at {
                    axis.group::<1>(inner, at, copy, lines, forward);
                    at += 1;
                }
            }
            DctAxis::Fast { n, plan, scratch } => {
                let (first, rest) = ((1.0 / *n as f64).sqrt(), (2.0 / *n as f64).sqrt());
                copy.resize(*n, 0.0);
                for lane in 0..inner {
                    for (i, c) in copy.iter_mut().enumerate() {
                        *c = lines[i * inner + lane];
                    }
                    if forward {
                        plan.process_dct2_with_scratch(copy, scratch);
                        copy[0] *= first;
                        copy[1..].iter_mut().for_each(|c| *c *= rest);
                    } else {
                        // rustdct's DCT-III halves the first coefficient.
                        copy[0] *= 2.0 * first;
                        copy[1..].iter_mut().for_each(|c| *c *= rest);
                        plan.process_dct3_with_scratch(copy, scratch);
                    }
                    for (i, c) in copy.iter().enumerate() {
                        lines[i * inner + lane] = *c;
                    }
                }
            }
        }
    }
}

struct Dense<'a> {
    n: usize,
    half: usize,
    cos: &'a [f64],
}

impl Dense<'_> {
    #[inline(always)]
    fn group<const W: usize>(&self, inner: usize, at: usize, source: &[f64], target: &mut [f64], forward: bool) {
        let (n, half) = (self.n, self.half);
        let lane = |i: usize| -> &[f64; W] { source[i * inner + at..][..W].try_into().expect("W values") };
        if forward {
            for k in 0..n {
                // Even cosines are symmetric about the middle, odd ones antisymmetric.
                let sign = if k % 2 == 0 { 1.0 } else { -1.0 };
                let mut sum = [0.0; W];
                for i in 0..n / 2 {
                    let c = self.cos[k * half + i];
                    let (a, b) = (lane(i), lane(n - 1 - i));
                    for w in 0..W {
                        sum[w] += c * (a[w] + sign * b[w]);
                    }
                }
                if n % 2 == 1 {
                    let (c, a) = (self.cos[k * half + n / 2], lane(n / 2));
                    for w in 0..W {
                        sum[w] += c * a[w];
                    }
                }
                target[k * inner + at..][..W].copy_from_slice(&sum);
            }
        } else {
            for i in 0..half {
                let mut even = [0.0; W];
                let mut odd = [0.0; W];
                for (sum, first) in [(&mut even, 0), (&mut odd, 1)] {
                    for k in (first..n).step_by(2) {
                        let (c, a) = (self.cos[k * half + i], lane(k));
                        for w in 0..W {
                            sum[w] += c * a[w];
                        }
                    }
                }
                for w in 0..W {
                    target[(n - 1 - i) * inner + at + w] = even[w] - odd[w];
                    target[i * inner + at + w] = even[w] + odd[w];
                }
            }
        }
    }
}

fn dct_axes(axes: &mut [DctAxis], shape: [usize; 4], block: &mut [f64], copy: &mut Vec<f64>, forward: bool) {
    for (axis, plan) in axes.iter_mut().enumerate() {
        let inner: usize = shape[axis + 1..].iter().product();
        for lines in block.chunks_exact_mut(shape[axis] * inner) {
            plan.apply(inner, lines, copy, forward);
        }
    }
}

/// The DFT of real blocks over the half of the spectrum that determines the rest.
struct Dft {
    shape: [usize; 4],
    half: usize,
    norm: f64,
    rows: (Arc<dyn realfft::RealToComplex<f64>>, Arc<dyn realfft::ComplexToReal<f64>>),
    /// Forward and inverse plans of the first three axes.
    axes: Vec<[Arc<dyn Fft<f64>>; 2]>,
    map: Vec<(u32, u32, f64)>,
    spectrum: Vec<Complex64>,
    lines: Vec<Complex64>,
    scratch: Vec<Complex64>,
}

impl Dft {
    fn new(shape: [usize; 4]) -> Dft {
        let mut real = realfft::RealFftPlanner::new();
        let mut complex = FftPlanner::new();
        let half = shape[3] / 2 + 1;
        let rows = (real.plan_fft_forward(shape[3]), real.plan_fft_inverse(shape[3]));
        let axes: Vec<_> =
            shape[..3].iter().map(|&n| [complex.plan_fft_forward(n), complex.plan_fft_inverse(n)]).collect();
        let scratch = axes
            .iter()
            .flat_map(|a| a.iter().map(|plan| plan.get_inplace_scratch_len()))
            .chain([rows.0.get_scratch_len(), rows.1.get_scratch_len()])
            .max()
            .unwrap_or(0);
        let size = shape[0] * shape[1] * shape[2] * half;
        Dft {
            shape,
            half,
            norm: (shape.iter().product::<usize>() as f64).sqrt().recip(),
            rows,
            axes,
            map: half_spectrum_map(shape),
            spectrum: vec![Complex64::default(); size],
            lines: Vec::new(),
            scratch: vec![Complex64::default(); scratch],
        }
    }

    /// Transforms the spectrum along the first three axes.
    fn complex_axes(&mut self, forward: bool) {
        for axis in 0..3 {
            let n = self.shape[axis];
            if n == 1 {
                continue;
            }
            let plan = &self.axes[axis][usize::from(!forward)];
            let inner = self.shape[axis + 1..3].iter().product::<usize>() * self.half;
            self.lines.resize(n * inner, Complex64::default());
            for bundle in self.spectrum.chunks_exact_mut(n * inner) {
                transpose(bundle, &mut self.lines, n, inner);
                plan.process_with_scratch(&mut self.lines, &mut self.scratch);
                transpose(&self.lines, bundle, inner, n);
            }
        }
    }

    fn analyze(&mut self, block: &mut [f64]) {
        for (row, out) in block.chunks_exact_mut(self.shape[3]).zip(self.spectrum.chunks_exact_mut(self.half)) {
            let done = self.rows.0.process_with_scratch(row, out, &mut self.scratch);
            debug_assert!(done.is_ok());
        }
        self.complex_axes(true);
        let root2 = std::f64::consts::SQRT_2 * self.norm;
        for (z, &(re, im, sign)) in self.spectrum.iter().zip(&self.map) {
            if sign == 0.0 {
                block[re as usize] = z.re * self.norm;
            } else {
                block[re as usize] = z.re * root2;
                block[im as usize] = z.im * root2 * sign;
            }
        }
    }

    fn synthesize(&mut self, block: &mut [f64]) {
        let root2 = std::f64::consts::FRAC_1_SQRT_2 * self.norm;
        for (z, &(re, im, sign)) in self.spectrum.iter_mut().zip(&self.map) {
            let (a, b) = (block[re as usize], block[im as usize]);
            *z = if sign == 0.0 {
                Complex64::new(a * self.norm, 0.0)
            } else {
                Complex64::new(a * root2, b * root2 * sign)
            };
        }
        self.complex_axes(false);
        for (row, z) in block.chunks_exact_mut(self.shape[3]).zip(self.spectrum.chunks_exact_mut(self.half)) {
            // Rounding may leave imaginary parts where a real spectrum has none; realfft insists on zeros.
            z[0].im = 0.0;
            if self.shape[3].is_multiple_of(2) {
                z[self.half - 1].im = 0.0;
            }
            let done = self.rows.1.process_with_scratch(z, row, &mut self.scratch);
            debug_assert!(done.is_ok());
        }
    }
}

/// `to[column][row] = from[row][column]`.
fn transpose(from: &[Complex64], to: &mut [Complex64], rows: usize, columns: usize) {
    for (r, line) in from.chunks_exact(columns).enumerate() {
        for (c, z) in line.iter().enumerate() {
            to[c * rows + r] = *z;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fourier::{Synthesis, partners};
    use crate::sample::SplitMix64;

    const SHAPES: [[usize; 4]; 7] =
        [[1, 15, 15, 15], [1, 6, 10, 20], [1, 1, 1, 1], [2, 3, 4, 5], [1, 4, 3, 72], [1, 1, 1, 7], [3, 1, 2, 8]];

    fn noise(n: usize, seed: u64) -> Vec<f64> {
        let mut random = SplitMix64(seed);
        (0..n).map(|_| (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64 - 0.5).collect()
    }

    /// The coefficient of index `at` by its definition.
    fn by_definition(basis: Basis, shape: [usize; 4], values: &[f64], at: usize) -> f64 {
        use std::f64::consts::PI;
        let unravel = |mut i: usize| {
            let mut at = [0; 4];
            for a in (0..4).rev() {
                at[a] = i % shape[a];
                i /= shape[a];
            }
            at
        };
        let k = unravel(at);
        match basis {
            Basis::Dct => values.iter().enumerate().fold(0.0, |sum, (i, v)| {
                let x = unravel(i);
                sum + (0..4).fold(*v, |product, a| {
                    let n = shape[a] as f64;
                    let norm = (if k[a] == 0 { 1.0 } else { 2.0 } / n).sqrt();
                    product * norm * (PI * k[a] as f64 * (2 * x[a] + 1) as f64 / (2.0 * n)).cos()
                })
            }),
            Basis::Dft => {
                let partner = partners(shape)[at] as usize;
                let low = unravel(at.min(partner));
                let signed = |a: usize| {
                    let j = low[a] as f64;
                    if low[a] % 2 == 1 { (j + 1.0) / 2.0 } else { -j / 2.0 }
                };
                let (mut re, mut im) = (0.0, 0.0);
                for (i, v) in values.iter().enumerate() {
                    let x = unravel(i);
                    let turns: f64 = (0..4).map(|a| signed(a) * x[a] as f64 / shape[a] as f64).sum();
                    re += v * (2.0 * PI * turns).cos();
                    im -= v * (2.0 * PI * turns).sin();
                }
                let norm = (values.len() as f64).sqrt().recip();
                match at.cmp(&partner) {
                    std::cmp::Ordering::Equal => re * norm,
                    std::cmp::Ordering::Less => re * norm * 2f64.sqrt(),
                    std::cmp::Ordering::Greater => im * norm * 2f64.sqrt(),
                }
            }
        }
    }

    #[test]
    fn analysis_agrees_with_the_definition() {
        for basis in [Basis::Dct, Basis::Dft] {
            for shape in SHAPES {
                let n = shape.iter().product();
                let values = noise(n, 3);
                let mut coefficients = values.clone();
                Transform::new(basis, shape).analyze(&mut coefficients);
                for at in (0..n).step_by(1 + n / 50) {
                    let expected = by_definition(basis, shape, &values, at);
                    assert!((coefficients[at] - expected).abs() < 1e-12, "{basis:?} {shape:?} {at}");
                }
            }
        }
    }

    #[test]
    fn synthesis_undoes_analysis_and_keeps_norms() {
        for basis in [Basis::Dct, Basis::Dft] {
            for shape in SHAPES {
                let values = noise(shape.iter().product(), 5);
                let mut transform = Transform::new(basis, shape);
                let mut work = values.clone();
                transform.analyze(&mut work);
                let energy = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
                assert!((energy(&work) - energy(&values)).abs() < 1e-12 * energy(&values).max(1.0));
                transform.synthesize(&mut work);
                for (a, b) in work.iter().zip(&values) {
                    assert!((a - b).abs() < 1e-13, "{basis:?} {shape:?}");
                }
            }
        }
    }

    #[test]
    fn decoder_synthesis_agrees_to_single_precision() {
        for basis in [Basis::Dct, Basis::Dft] {
            for shape in SHAPES {
                let n: usize = shape.iter().product();
                let mut double = noise(n, 8);
                // Leave out the high frequencies, so that extents matter.
                let extents = shape.map(|n| n.div_ceil(2));
                let mut single = vec![0f32; n];
                for (i, (d, s)) in double.iter_mut().zip(&mut single).enumerate() {
                    let at = [
                        i / (shape[1] * shape[2] * shape[3]),
                        i / (shape[2] * shape[3]) % shape[1],
                        i / shape[3] % shape[2],
                        i % shape[3],
                    ];
                    if (0..4).any(|a| at[a] >= extents[a]) {
                        *d = 0.0;
                    }
                    *s = *d as f32;
                }
                Synthesis::new(basis, &shape).synthesize(shape, extents, &mut single, &mut Vec::new());
                Transform::new(basis, shape).synthesize(&mut double);
                for (s, d) in single.iter().zip(&double) {
                    assert!((f64::from(*s) - d).abs() < 2e-6, "{basis:?} {shape:?}: {s} {d}");
                }
            }
        }
    }
}
