//! Point samples of a block's inverse transform: the operator of the encoder's problems.

use super::Operator;
use crate::fourier::forward::Transform;

/// Coefficients of one channel or several, `[channel][k]`, to the samples of each channel, one channel after the other.
///
/// Its rows are orthonormal: A A^T = 1.
pub struct SampledBasis<'a> {
    transform: &'a mut Transform,
    /// Positions in the block, one list a channel.
    positions: Vec<&'a [u32]>,
    block: Vec<f64>,
}

impl<'a> SampledBasis<'a> {
    /// The samples at `positions`, one list of positions in the block for each channel.
    ///
    /// # Panics
    /// Where a position is not in the block.
    pub fn new(transform: &'a mut Transform, positions: Vec<&'a [u32]>) -> SampledBasis<'a> {
        let n = transform.positions();
        assert!(positions.iter().all(|list| list.iter().all(|&p| (p as usize) < n)), "a position beyond the block");
        SampledBasis { transform, positions, block: vec![0.0; n] }
    }
}

impl Operator for SampledBasis<'_> {
    fn rows(&self) -> usize {
        self.positions.iter().map(|list| list.len()).sum()
    }

    fn cols(&self) -> usize {
        self.positions.len() * self.block.len()
    }

    fn forward(&mut self, coefficients: &[f64], samples: &mut [f64]) {
        let mut samples = samples.iter_mut();
        for (coefficients, positions) in coefficients.chunks(self.block.len()).zip(&self.positions) {
            self.block.copy_from_slice(coefficients);
            self.transform.synthesize(&mut self.block);
            // The positions come first: zip drops what its first iterator gave when the second one ends.
            for (&p, sample) in positions.iter().zip(samples.by_ref()) {
                *sample = self.block[p as usize];
            }
        }
    }

    fn adjoint(&mut self, samples: &[f64], coefficients: &mut [f64]) {
        let mut samples = samples.iter();
        coefficients.fill(0.0);
        for (coefficients, positions) in coefficients.chunks_mut(self.block.len()).zip(&self.positions) {
            for (&p, sample) in positions.iter().zip(samples.by_ref()) {
                coefficients[p as usize] = *sample;
            }
            self.transform.analyze(coefficients);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fourier::Basis;
    use crate::solve::testing::Lcg;

    #[test]
    fn adjoint_of_forward_and_orthonormal_rows() {
        let lists: [&[u32]; 3] = [&[3, 4, 9, 50], &[], &[0, 59]];
        let mut rng = Lcg(7);
        for basis in [Basis::Dct, Basis::Dft] {
            let mut transform = Transform::new(basis, [1, 3, 4, 5]);
            let mut op = SampledBasis::new(&mut transform, lists.to_vec());
            assert_eq!((op.rows(), op.cols()), (6, 180));
            let y: Vec<f64> = (0..6).map(|_| rng.uniform() - 0.5).collect();
            let s: Vec<f64> = (0..180).map(|_| rng.uniform() - 0.5).collect();
            let (mut back, mut image, mut again) = (vec![0.0; 180], vec![0.0; 6], vec![0.0; 6]);
            op.adjoint(&y, &mut back);
            op.forward(&s, &mut image);
            op.forward(&back, &mut again);
            let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
            assert!((product(&back, &s) - product(&y, &image)).abs() < 1e-13);
            assert!(y.iter().zip(&again).all(|(a, b)| (a - b).abs() < 1e-13));
        }
    }
}
