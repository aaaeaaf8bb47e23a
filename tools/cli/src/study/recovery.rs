//! The paper's recovery of a block from some of its values, in whichever domain they are.

use std::collections::HashMap;

use csbrdf::codec::fourier::forward::Transform;
use csbrdf::codec::fourier::{Basis, partners};
use csbrdf::encode::l1::norm::Norm;
use csbrdf::encode::l1::sampled::{Columns, SampledBasis};
use csbrdf::encode::l1::spgl1::{self, Options};

/// Most iterations of one solve, as the paper preset has it.
const ITERATIONS: usize = 300;
/// Residual that is left at the samples, of the norm of the samples without their mean: the same in both domains.
pub const RELATIVE_SIGMA: f64 = 1e-3;

/// Plain l1 recovery of DFT coefficients; one a thread.
#[derive(Default)]
pub struct Recovery {
    plans: HashMap<[usize; 4], (Transform, Norm, Columns)>,
}

impl Recovery {
    /// All values of a block from those at `positions`, which must not be none.
    pub fn recover(&mut self, shape: [usize; 4], values: &[f64], positions: &[u32]) -> csbrdf::Result<Vec<f64>> {
        let (transform, norm, columns) = match self.plans.entry(shape) {
            std::collections::hash_map::Entry::Occupied(plan) => plan.into_mut(),
            std::collections::hash_map::Entry::Vacant(place) => {
                let norm = Norm::new(values.len(), None, Some(&partners(shape)))?;
                place.insert((Transform::new(Basis::Dft, shape), norm, Columns::new(Basis::Dft, shape)))
            }
        };
        let mut samples: Vec<f64> = positions.iter().map(|&p| values[p as usize]).collect();
        // As the encoder does: the mean is no sparse feature.
        let mean = samples.iter().sum::<f64>() / samples.len() as f64;
        samples.iter_mut().for_each(|s| *s -= mean);
        let sigma = RELATIVE_SIGMA * samples.iter().map(|s| s * s).sum::<f64>().sqrt();
        let mut options = Options::default();
        options.max_iterations = ITERATIONS;
        options.gap_tolerance = f64::INFINITY;
        let mut operator = SampledBasis::new(transform, vec![positions]).with_columns(columns);
        let mut block = spgl1::bpdn(&mut operator, &samples, sigma, norm, &options)?.coefficients;
        transform.synthesize(&mut block);
        block.iter_mut().for_each(|v| *v += mean);
        Ok(block)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_wave_comes_back_from_a_fifth_of_its_values() {
        let shape = [1, 8, 8, 8];
        let values: Vec<f64> =
            (0..512).map(|i| 3.0 + (std::f64::consts::TAU * ((i % 8) as f64 + (i / 64) as f64) / 8.0).cos()).collect();
        let positions: Vec<u32> =
            (0..512u32).filter(|i| i.wrapping_mul(2_654_435_761) % 5 == 0 || i % 11 == 3).collect();
        let back = Recovery::default().recover(shape, &values, &positions).unwrap();
        let worst = back.iter().zip(&values).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        assert!(positions.len() < 160 && worst < 0.05, "{} {worst}", positions.len());
    }
}
