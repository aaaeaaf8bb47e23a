//! Operators and problems for the tests.

use super::Operator;

/// Any matrix, row after row.
pub(super) struct Dense {
    pub(super) cols: usize,
    pub(super) matrix: Vec<f64>,
}

impl Dense {
    /// The inverse of the orthonormal DCT-II of size n: rows are positions, columns frequencies.
    pub(super) fn dct(n: usize) -> Dense {
        let entry = |i: usize, k: usize| {
            let angle = std::f64::consts::PI * ((2 * i + 1) * k) as f64 / (2 * n) as f64;
            (if k == 0 { 1.0 } else { 2.0 } / n as f64).sqrt() * angle.cos()
        };
        Dense { cols: n, matrix: (0..n * n).map(|p| entry(p / n, p % n)).collect() }
    }

    /// The orthonormal real Fourier matrix of odd size n: rows are positions, columns DC, then cosine and sine of every
    /// frequency; with the partners of the columns.
    pub(super) fn fourier(n: usize) -> (Dense, Vec<u32>) {
        let entry = |position: usize, column: usize| {
            let angle = std::f64::consts::TAU * (position * column.div_ceil(2)) as f64 / n as f64;
            match column {
                0 => (1.0 / n as f64).sqrt(),
                c if c % 2 == 1 => (2.0 / n as f64).sqrt() * angle.cos(),
                _ => (2.0 / n as f64).sqrt() * angle.sin(),
            }
        };
        let matrix = (0..n * n).map(|p| entry(p / n, p % n)).collect();
        let partner = (0..n as u32).map(|c| if c == 0 { 0 } else { ((c - 1) ^ 1) + 1 }).collect();
        (Dense { cols: n, matrix }, partner)
    }

    /// Only these rows.
    pub(super) fn select(&self, rows: &[usize]) -> Dense {
        let row = |&r: &usize| self.matrix[r * self.cols..][..self.cols].to_vec();
        Dense { cols: self.cols, matrix: rows.iter().flat_map(row).collect() }
    }
}

impl Dense {
    /// The same matrix for each of several channels: samples and coefficients are `[channel][..]`.
    pub(super) fn channels(&self, channels: usize) -> Dense {
        let (rows, wide) = (self.matrix.len() / self.cols, self.cols * channels);
        let mut matrix = vec![0.0; rows * channels * wide];
        for c in 0..channels {
            for (i, row) in self.matrix.chunks(self.cols).enumerate() {
                matrix[(c * rows + i) * wide + c * self.cols..][..self.cols].copy_from_slice(row);
            }
        }
        Dense { cols: wide, matrix }
    }
}

impl Operator for Dense {
    fn rows(&self) -> usize {
        self.matrix.len() / self.cols
    }

    fn cols(&self) -> usize {
        self.cols
    }

    fn forward(&mut self, coefficients: &[f64], samples: &mut [f64]) {
        for (y, row) in samples.iter_mut().zip(self.matrix.chunks(self.cols)) {
            *y = row.iter().zip(coefficients).map(|(a, s)| a * s).sum();
        }
    }

    fn adjoint(&mut self, samples: &[f64], coefficients: &mut [f64]) {
        coefficients.fill(0.0);
        for (y, row) in samples.iter().zip(self.matrix.chunks(self.cols)) {
            for (s, a) in coefficients.iter_mut().zip(row) {
                *s += a * y;
            }
        }
    }
}

/// An operator that can give single columns, so that solves from few rows use a working set.
pub(super) struct WithColumns<'a>(pub(super) &'a mut Dense);

impl Operator for WithColumns<'_> {
    fn rows(&self) -> usize {
        self.0.rows()
    }

    fn cols(&self) -> usize {
        self.0.cols()
    }

    fn forward(&mut self, coefficients: &[f64], samples: &mut [f64]) {
        self.0.forward(coefficients, samples);
    }

    fn adjoint(&mut self, samples: &[f64], coefficients: &mut [f64]) {
        self.0.adjoint(samples, coefficients);
    }

    fn column(&mut self, index: usize, samples: &mut [f64]) -> bool {
        for (v, row) in samples.iter_mut().zip(self.0.matrix.chunks(self.0.cols)) {
            *v = row[index];
        }
        true
    }
}

/// Knuth's 64-bit linear congruential generator, uniform in [0, 1) from the upper 53 bits.
pub(super) struct Lcg(pub(super) u64);

impl Lcg {
    pub(super) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// ||v||_2
pub(super) fn length(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// y - A s
pub(super) fn residual<O: Operator>(op: &mut O, y: &[f64], s: &[f64]) -> Vec<f64> {
    let mut r = vec![0.0; y.len()];
    op.forward(s, &mut r);
    r.iter_mut().zip(y).for_each(|(r, y)| *r = y - *r);
    r
}
