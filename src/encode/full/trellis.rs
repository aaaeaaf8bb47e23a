//! Dependent quantisation of filled blocks (spec section 4.5): row by row the path through the quantiser's states of least
//! squared error and bits, by the Viterbi algorithm.
//!
//! kB at equal log rms .005 / .01 with scalar quantisation, with the same choice by cost but every multiple allowed, and so:
//! alum-bronze 42.9 / 15.3, 40.9 / 14.7, 38.2 / 14.0; golden yellow 79.4 / 37.5, 78.2 / 36.8, 78.5 / 36.8; green-fabric with noise
//! .02 1062 / 587, 1053 / 563, 1001 / 557. A row starts anew, so that the rows before are settled when their magnitudes make its
//! contexts. Filling holes again from what was quantised, then quantising again: .3 to .6 % less, not worth the time.

use rayon::prelude::*;

use crate::codec::dependent::{Quantization, STATES, State};
use crate::codec::entropy::{
    Around, Extents, MAX_MAGNITUDE, Rows, WIDTH, Walk, find_extents,
    price_number,
};
use crate::codec::quantize::quantize_mean;
use crate::codec::range::{Costs, Counter};
use crate::codec::contexts::{CONTEXTS, ODD_CONTEXTS, SIGNIFICANT, SIGNIFICANT_ODD};
use crate::encode::quantised::Quantized;

/// Step of the multiples in steps of the encoder, which are those of a scalar quantiser. Shares of .5 to .8 and exchange rates of .2 to
/// .45 lie within 2 % of one curve; these are best at log rms .01.
pub(in crate::encode) const STEP: f32 = 0.65;

/// Squared error that a bit buys, in squared steps of the multiples.
const EXCHANGE: f32 = 0.3;

/// Every fourth block trains the costs.
const TRAINING: usize = 4;

/// Rows without a coefficient of this many steps stay zero: coding one would cost more than its square.
const LEAST: f32 = 0.8;

/// A block's coefficients `[component][position]`; none where nothing is known of it.
pub(in crate::encode) struct Filled {
    pub(in crate::encode) shape: [usize; 4],
    pub(in crate::encode) coefficients: Vec<f32>,
}

/// Quantises blocks; `step` and `rounding` are those of the scalar quantiser that the path starts from. `None` if a coefficient
/// is beyond what the format holds.
pub(in crate::encode) fn quantize(blocks: &[Filled], components: usize, step: f32, rounding: f64) -> Option<Vec<Quantized>> {
    let scalar = |block: &Filled| -> Option<Quantized> {
        let mut quantized = Quantized::empty(block.shape, components);
        let n: usize = block.shape.iter().product();
        for (component, values) in block.coefficients.chunks_exact(n).enumerate() {
            quantized.quantize_trial(component, step, rounding, values)?;
        }
        Some(quantized)
    };
    // Before the training: what the scalar quantiser holds may be too much for the finer step.
    let largest = blocks.iter().flat_map(|block| &block.coefficients).fold(0f32, |most, c| most.max(c.abs()));
    if largest / (STEP * step) >= MAX_MAGNITUDE as f32 - 2.0 {
        return None;
    }
    let training: Vec<(&Filled, Quantized)> =
        blocks.par_iter().step_by(TRAINING).map(|block| Some((block, scalar(block)?))).collect::<Option<_>>()?;
    // The costs of scalar quantisation find first paths, those give the costs of the paths.
    let mut counts = count(&training, |walk, counter, (_, quantized)| {
        let coded = walk.code(counter, Quantization::Scalar, quantized.shape, &quantized.coefficients);
        debug_assert!(coded.is_ok(), "the quantiser bounds the coefficients");
    });
    counts.copy(SIGNIFICANT..SIGNIFICANT + ODD_CONTEXTS, SIGNIFICANT_ODD);
    let costs = Costs::new(&counts);
    let step = STEP * step;
    let counts = count(&training, |walk, counter, (block, quantized)| {
        choose(walk, counter, block, &mut quantized.coefficients.clone(), &costs, step);
    });
    let costs = Costs::new(&counts);
    blocks
        .par_iter()
        .map_init(Walk::default, |walk, block| {
            let mut quantized = scalar(block)?;
            let n: usize = block.shape.iter().product();
            choose(walk, &mut Counter::new(CONTEXTS), block, &mut quantized.coefficients, &costs, step);
            quantized.shortfall = Default::default();
            for (component, values) in block.coefficients.chunks_exact(n).enumerate() {
                quantized.means[component] = Some(quantize_mean(step, values[0].into())?);
                let chosen = quantized.coefficients[component * n..].iter().zip(values);
                chosen
                    .filter(|(q, _)| **q != 0)
                    .for_each(|(q, value)| quantized.shortfall.add(*q, f64::from(value / step)));
            }
            Some(quantized)
        })
        .collect()
}

/// Decisions of blocks by context.
fn count<T: Sync>(blocks: &[T], code: impl Fn(&mut Walk, &mut Counter, &T) + Sync) -> Counter {
    let new = || (Walk::default(), Counter::new(CONTEXTS));
    let add = |(mut walk, mut counter): (Walk, Counter), block: &T| {
        code(&mut walk, &mut counter, block);
        (walk, counter)
    };
    let parts = blocks.par_iter().fold(new, add).map(|(_, counter)| counter);
    parts.reduce(
        || Counter::new(CONTEXTS),
        |mut sum, counter| {
            sum.add(&counter);
            sum
        },
    )
}

/// Chooses the integers of a block; those given set the extents.
fn choose(walk: &mut Walk, counter: &mut Counter, block: &Filled, chosen: &mut [i32], costs: &Costs, step: f32) {
    // Long on purpose: one pass of the Viterbi algorithm along a block's rows.
    if block.coefficients.is_empty() {
        return;
    }
    let positions = block.shape.iter().product();
    let planes = block.coefficients.chunks_exact(positions).zip(chosen.chunks_exact_mut(positions));
    let channels = planes.map(|(values, chosen)| Trellis { costs, values, chosen, step, ways: Vec::new() });
    let coded = walk.code_rows(counter, Quantization::Dependent, block.shape, channels);
    debug_assert!(coded.is_ok(), "the largest coefficient was checked");
}

struct Trellis<'a> {
    costs: &'a Costs,
    values: &'a [f32],
    chosen: &'a mut [i32],
    step: f32,
    /// By place on the row and state after it: the state before, and the index.
    ways: Vec<[(State, u32); STATES]>,
}

/// The cheapest path to a state.
#[derive(Clone, Copy)]
struct Path {
    cost: f32,
    /// Magnitudes of the last two as the contexts know them.
    before: [u32; 2],
}

impl Rows for Trellis<'_> {
    fn extents(&self, shape: [usize; 4]) -> Extents {
        find_extents(shape, self.chosen)
    }

    fn get(&self, position: usize) -> i32 {
        self.chosen[position]
    }

    fn choose(&mut self, around: &Around, length: usize) {
        let row = around.row;
        let values = &self.values[row.position..][..length];
        let line = &mut self.chosen[row.position..][..length];
        let scale = 1.0 / self.step;
        line[row.first..].fill(0);
        if values[row.first..].iter().all(|v| v.abs() * scale < LEAST) {
            return;
        }
        let price = |bits: f32| EXCHANGE * bits;
        const NONE: Path = Path { cost: f32::INFINITY, before: [0; 2] };
        let mut paths = [NONE; STATES];
        paths[State::default().number()].cost = price(self.costs.of(row.any, true));
        // Of a row of zeros.
        let mut nothing = price(self.costs.of(row.any, false));
        self.ways.clear();
        self.ways.resize(line.len(), [(State::default(), 0); STATES]);
        let mut step = around.step(0);
        for (l, value) in values.iter().enumerate().skip(row.first) {
            let magnitude = value.abs() * scale;
            nothing += magnitude * magnitude;
            if l > 0 && l % WIDTH == 0 {
                step = around.step(l);
            }
            let i = l % WIDTH;
            let mut next = [NONE; STATES];
            for (state, path) in State::all().into_iter().zip(&paths).filter(|(_, path)| path.cost < f32::INFINITY) {
                let mut offer = |index: u32, error: f32, bits: f32| {
                    let to = state.after(index);
                    let cost = path.cost + error * error + price(bits);
                    if cost < next[to.number()].cost {
                        next[to.number()] = Path { cost, before: [index.min(255), path.before[0]] };
                        self.ways[l][to.number()] = (state, index);
                    }
                };
                let significant = step.significant(i, path.before, state);
                offer(0, magnitude, self.costs.of(significant, false));
                // The multiples on both sides of the value.
                let below = state.index(magnitude as u32);
                for index in below.max(1)..=below + 1 {
                    let error = magnitude - state.magnitude(index) as f32;
                    let sign = 1.0;
                    let bits = self.costs.of(significant, true)
                        + sign
                        + price_number(self.costs, step.exponents(i, path.before), index - 1);
                    offer(index, error, bits);
                }
            }
            paths = next;
        }
        let ends = State::all().into_iter().zip(&paths);
        let Some((mut state, path)) = ends.min_by(|a, b| a.1.cost.total_cmp(&b.1.cost)) else { return };
        if path.cost >= nothing {
            return;
        }
        for l in (row.first..line.len()).rev() {
            let (before, index) = self.ways[l][state.number()];
            state = before;
            let magnitude = if index == 0 { 0 } else { state.magnitude(index) as i32 };
            line[l] = if values[l] < 0.0 { -magnitude } else { magnitude };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// White noise at a high rate: dependent quantisation is within the granular gain that is known for four states,
    /// some .97 dB for .99 (Marcellin and Fischer 1990) of scalar quantisation at equal bits, less what rows lose at their start.
    #[test]
    fn noise_takes_fewer_bits_at_equal_error() {
        let shape = [1, 8, 8, 60];
        let n: usize = shape.iter().product();
        let mut random = crate::codec::sample::SplitMix64(7);
        let mut uniform = || (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        let mut normal = || ((-2.0 * (1.0 - uniform()).ln()).sqrt() * (std::f64::consts::TAU * uniform()).cos()) as f32;
        let blocks: Vec<Filled> =
            (0..8).map(|_| Filled { shape, coefficients: (0..n).map(|_| normal()).collect() }).collect();
        let step = 0.25f32;
        // Bits a coefficient, and rms error.
        let measure = |quantized: &[Quantized], quantization: Quantization, step: f32| {
            let mut counter = Counter::new(CONTEXTS);
            let mut squares = 0.0;
            for (block, quantized) in blocks.iter().zip(quantized) {
                Walk::default().code(&mut counter, quantization, shape, &quantized.coefficients).unwrap();
                let errors = quantized.coefficients.iter().zip(&block.coefficients).skip(1);
                squares += errors.map(|(q, c)| f64::from(*q as f32 * step - c).powi(2)).sum::<f64>();
            }
            let count = (blocks.len() * (n - 1)) as f64;
            (counter.bits() / count, (squares / count).sqrt())
        };
        let scalar: Vec<Quantized> = blocks
            .iter()
            .map(|block| {
                let mut quantized = Quantized::empty(shape, 1);
                quantized.quantize_trial(0, step, 0.5, &block.coefficients).unwrap();
                quantized
            })
            .collect();
        let (scalar_bits, scalar_rms) = measure(&scalar, Quantization::Scalar, step);
        let dependent = quantize(&blocks, 1, step, 0.5).unwrap();
        let (bits, rms) = measure(&dependent, Quantization::Dependent, STEP * step);
        let gain = scalar_bits - bits - (rms / scalar_rms).log2();
        // 0.97 dB are .161 bits.
        assert!((0.12..0.2).contains(&gain), "{scalar_bits} bits at {scalar_rms}, {bits} at {rms}: gain {gain}");
    }

    #[test]
    fn what_the_format_cannot_hold_is_refused() {
        let block = |c: f32| vec![Filled { shape: [1, 1, 1, 3], coefficients: vec![0.0, c, 0.0] }];
        assert!(quantize(&block(1e6), 1, 0.1, 0.4).is_some());
        // Within the scalar quantiser's range, beyond that of the finer step.
        assert!(quantize(&block(1.5e6), 1, 0.1, 0.4).is_none());
        assert!(quantize(&block(1e7), 1, 0.1, 0.4).is_none());
        assert!(quantize(&block(f32::INFINITY), 1, 0.1, 0.4).is_none());
        let nothing = [Filled { shape: [1, 1, 1, 3], coefficients: Vec::new() }];
        assert_eq!(quantize(&nothing, 1, 0.1, 0.4).unwrap()[0].coefficients, [0; 3]);
    }
}
