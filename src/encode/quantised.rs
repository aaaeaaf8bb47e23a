//! Blocks after the quantiser: their integers, and what they cost.

use crate::base::simd::{Level, Task};
use crate::codec::entropy::MAX_MAGNITUDE;
use crate::codec::quantize::{Quantizer, quantize_mean};

/// Sums over magnitudes 1, and 2 and above: how far below the integer the coefficient was, in steps; counts.
#[derive(Clone, Copy, Default)]
pub(super) struct Shortfall([(f64, u64); 2]);

impl Shortfall {
    /// A coefficient that is not quantised to zero, in steps.
    pub(super) fn add(&mut self, q: i32, coefficient: f64) {
        let sum = &mut self.0[usize::from(q.unsigned_abs() > 1)];
        sum.0 += f64::from(q.unsigned_abs()) - coefficient.abs();
        sum.1 += 1;
    }
}

/// Cost and outcome of the solves of a block.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Solves {
    pub(super) solves: usize,
    pub(super) iterations: usize,
    /// Solves that ended above their sigma.
    pub(super) missed: usize,
}

impl std::ops::AddAssign for Solves {
    fn add_assign(&mut self, other: Solves) {
        self.solves += other.solves;
        self.iterations += other.iterations;
        self.missed += other.missed;
    }
}

/// A block after quantisation.
pub(super) struct Quantized {
    pub(super) shape: [usize; 4],
    /// `[component][position]`, the first of each plane zero.
    pub(super) coefficients: Vec<i32>,
    /// One a component; `None` where the component has no sample.
    pub(super) means: Vec<Option<i32>>,
    pub(super) shortfall: Shortfall,
    /// Of the quantiser, in the coefficient domain, holes included.
    pub(super) squared_error: f64,
    pub(super) sampled: usize,
    /// Of the file's sampling ratio.
    pub(super) doublings: u8,
    pub(super) cost: Solves,
}

impl Quantized {
    /// All coefficients zero, no means.
    pub(super) fn empty(shape: [usize; 4], components: usize) -> Quantized {
        Quantized {
            shape,
            coefficients: vec![0; components * shape.iter().product::<usize>()],
            means: vec![None; components],
            shortfall: Shortfall::default(),
            squared_error: 0.0,
            sampled: 0,
            doublings: 0,
            cost: Solves::default(),
        }
    }

    /// Quantises the coefficients of a component. `None` if one is beyond what the format holds.
    pub(super) fn quantize(&mut self, component: usize, step: f32, rounding: f64, values: &[f64]) -> Option<()> {
        self.means[component] = Some(quantize_mean(step, values[0])?);
        let coefficients = &mut self.coefficients[component * values.len()..(component + 1) * values.len()];
        for (q, &value) in coefficients.iter_mut().zip(values).skip(1) {
            *q = Quantizer::quantize(step, rounding, value)?;
            self.squared_error += (value - f64::from(*q) * f64::from(step)).powi(2);
            if *q != 0 {
                self.shortfall.add(*q, value / f64::from(step));
            }
        }
        Some(())
    }

    /// The same in single precision and without the shortfall, for trials: a third of the time.
    pub(super) fn quantize_trial(&mut self, component: usize, step: f32, rounding: f64, values: &[f32]) -> Option<()> {
        self.means[component] = Some(quantize_mean(step, values[0].into())?);
        let coefficients = &mut self.coefficients[component * values.len()..(component + 1) * values.len()];
        let (mut largest, mut squared_error) = (0f32, 0f64);
        let rounding = rounding as f32;
        Level::detect().run(RoundAll {
            step,
            rounding,
            values,
            coefficients,
            largest: &mut largest,
            squared_error: &mut squared_error,
        });
        // The mean goes elsewhere.
        let mean = f64::from(values[0]) - f64::from(coefficients[0]) * f64::from(step);
        coefficients[0] = 0;
        self.squared_error += squared_error - mean.powi(2);
        (largest < MAX_MAGNITUDE as f32).then_some(())
    }
}

/// Rounds values to integers of steps; magnitudes up from `rounding`.
struct RoundAll<'a> {
    step: f32,
    rounding: f32,
    values: &'a [f32],
    coefficients: &'a mut [i32],
    /// The largest magnitude, in steps.
    largest: &'a mut f32,
    /// In the units of the values.
    squared_error: &'a mut f64,
}

impl Task for RoundAll<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        const LANES: usize = 8;
        let RoundAll { step, rounding, values, coefficients, largest, squared_error } = self;
        let scale = 1.0 / step;
        let (mut most, mut errors) = ([0f32; LANES], [0f64; LANES]);
        for (values, coefficients) in values.chunks(LANES).zip(coefficients.chunks_mut(LANES)) {
            let lanes = values.iter().zip(coefficients).zip(most.iter_mut().zip(&mut errors));
            for ((value, q), (most, errors)) in lanes {
                let magnitude = value.abs() * scale + rounding;
                // Conversion saturates and rounds down.
                let whole = magnitude as i32;
                *q = if *value < 0.0 { -whole } else { whole };
                let error = value.abs() - whole as f32 * step;
                *most = if magnitude > *most { magnitude } else { *most };
                *errors += f64::from(error * error);
            }
        }
        *largest = most.into_iter().fold(0.0, f32::max);
        *squared_error = errors.into_iter().sum();
    }
}

/// Gives blocks without a sample the mean value of the block before, or of the first that has one: a guess near the
/// blocks around, for lookups that interpolate across the edge of what was measured.
pub(super) fn fill_empty_means(blocks: &mut [Quantized], components: usize) {
    for c in 0..components {
        let root = |block: &Quantized| (block.shape.iter().product::<usize>() as f64).sqrt();
        let first = blocks.iter().find_map(|b| b.means[c].map(|mean| f64::from(mean) / root(b)));
        let mut last = first.unwrap_or(0.0);
        for block in blocks.iter_mut() {
            let root = root(block);
            match block.means[c] {
                Some(mean) => last = f64::from(mean) / root,
                None => block.means[c] = quantize_mean(1.0, last * root),
            }
        }
    }
}

/// Mean shortfall of the coefficients below their integers, in 1/256 of a step: where the decoder rebuilds them.
pub(super) fn shrink(blocks: &[Quantized]) -> [i8; 2] {
    [0, 1].map(|i| {
        let (sum, count) = blocks.iter().fold((0.0, 0), |(s, n), b| (s + b.shortfall.0[i].0, n + b.shortfall.0[i].1));
        if count == 0 { 0 } else { (256.0 * sum / count as f64).round().clamp(-128.0, 127.0) as i8 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_without_samples_take_the_mean_of_a_neighbour() {
        let block = |n: usize, mean| Quantized { means: vec![mean], ..Quantized::empty([1, 1, 1, n], 1) };
        let mut blocks = vec![block(4, None), block(16, Some(40)), block(4, None), block(4, Some(-2)), block(4, None)];
        fill_empty_means(&mut blocks, 1);
        let means: Vec<_> = blocks.iter().map(|b| b.means[0].unwrap()).collect();
        assert_eq!(means, [20, 40, 20, -2, -2]);
    }
}
