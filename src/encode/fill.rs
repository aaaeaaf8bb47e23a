//! Coefficients of a block with holes: what fills them is free, so it is chosen to be sparse (encoder only).
//!
//! Minimises the sum over coefficients of a weight times ln(1 + |c| / step), about their bits, with what is known
//! kept: accelerated proximal gradient steps (Beck and Teboulle 2009) with reweighted thresholds (Candes, Wakin, Boyd
//! 2008) that fall from the largest coefficient to a third of the step. All channels at once, so that a channel that
//! is known where another is not tells of it through the channel transform.
//!
//! Measured against weighted l1 by SPGL1, 200 iterations, a channel at a time (9 x 9 x 36, step 0.1, kB / log rms):
//! golden yellow 74.9 / .00805 -> 69.9 / .00806, paper white 32.8 / .0045 -> 29.4 / .0043 with 100 steps; equal to it with 20.

use std::collections::HashMap;

use crate::block::positions;
use crate::channel::ChannelTransform;
use crate::fourier::Basis;
use crate::fourier::forward::Transform;

/// Last threshold, in quantiser steps at weight 1.
const LAST_THRESHOLD: f64 = 0.3;

/// Share of the steps in which the threshold falls.
const FALLING: f64 = 0.5;

struct Plan {
    transform: Transform,
    /// 1 + |k| over its geometric mean.
    weights: Vec<f64>,
}

/// Transforms by block shape, and buffers; one a thread.
pub(super) struct Filler {
    basis: Basis,
    plans: HashMap<[usize; 4], Plan>,
    components: Vec<f64>,
    target: Vec<f64>,
    next: Vec<f64>,
    before: Vec<f64>,
}

impl Filler {
    pub(super) fn new(basis: Basis) -> Filler {
        Filler {
            basis,
            plans: HashMap::new(),
            components: Vec::new(),
            target: Vec::new(),
            next: Vec::new(),
            before: Vec::new(),
        }
    }

    fn plan(basis: Basis, plans: &mut HashMap<[usize; 4], Plan>, shape: [usize; 4]) -> &mut Plan {
        plans.entry(shape).or_insert_with(|| {
            let half_periods = |j: usize| if basis == Basis::Dct { j } else { 2 * j.div_ceil(2) };
            let length = |k: [usize; 4]| k.iter().map(|&j| (half_periods(j) as f64).powi(2)).sum::<f64>().sqrt();
            let mut weights: Vec<f64> = positions(shape).map(|k| 1.0 + length(k)).collect();
            let mean = (weights.iter().map(|w| w.ln()).sum::<f64>() / weights.len() as f64).exp();
            weights.iter_mut().for_each(|w| *w /= mean);
            Plan { transform: Transform::new(basis, shape), weights }
        })
    }

    /// Logarithms `[channel][position]` to coefficients `[component][position]`, in place; where not `known` they are a
    /// first guess. Gives the number of steps taken.
    pub(super) fn analyze(
        &mut self,
        shape: [usize; 4],
        transform: &ChannelTransform,
        log: &mut [f64],
        known: &[bool],
        step: f64,
        steps: usize,
    ) -> usize {
        let Filler { basis, plans, components, target, next, before } = self;
        let Plan { transform: fourier, weights } = Filler::plan(*basis, plans, shape);
        let n = weights.len();
        let channels = log.len() / n;
        target.clear();
        target.extend_from_slice(log);
        let mut forward = |log: &mut [f64]| {
            transform.forward(log, channels);
            log.chunks_exact_mut(n).for_each(|component| fourier.analyze(component));
        };
        forward(log);
        if known.iter().all(|k| *k) {
            return 0;
        }
        let last = LAST_THRESHOLD * step;
        let largest = log.chunks_exact(n).flat_map(|c| c.iter().zip(weights.iter()).skip(1)).map(|(c, w)| c.abs() / w);
        let first = (largest.fold(0.0, f64::max) / 8.0).max(last);
        before.clear();
        before.extend_from_slice(log);
        components.clear();
        components.extend_from_slice(log);
        let mut momentum = 1f64;
        for number in 1..=steps {
            let fallen = (number as f64 / (steps as f64 * FALLING)).min(1.0);
            let threshold = first * (last / first).powf(fallen);
            next.clear();
            next.extend_from_slice(log);
            for component in next.chunks_exact_mut(n) {
                for (c, weight) in component.iter_mut().zip(weights.iter()).skip(1) {
                    let least = threshold * weight * 2.0 * step / (c.abs() + step);
                    *c = if c.abs() <= least { 0.0 } else { *c - least.copysign(*c) };
                }
            }
            let grown = (1.0 + (1.0 + 4.0 * momentum * momentum).sqrt()) / 2.0;
            let ahead = (momentum - 1.0) / grown;
            momentum = grown;
            for ((component, next), before) in components.iter_mut().zip(next.iter()).zip(before.iter()) {
                *component = next + ahead * (next - before);
            }
            std::mem::swap(next, before);
            // What is known replaces what came out.
            log.copy_from_slice(components);
            log.chunks_exact_mut(n).for_each(|component| fourier.synthesize(component));
            transform.inverse_f64(log, channels);
            for ((log, known), target) in log.iter_mut().zip(known).zip(target.iter()) {
                if *known {
                    *log = *target;
                }
            }
            transform.forward(log, channels);
            log.chunks_exact_mut(n).for_each(|component| fourier.analyze(component));
        }
        steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What is known comes back, and a channel that is not known in places is told by the others.
    #[test]
    fn known_values_stay_and_holes_become_sparse() {
        let shape = [1, 6, 8, 20];
        let n = 960;
        let opponent = ChannelTransform::opponent();
        // Two cosines, the same in all channels: two coefficients of one component.
        let truth = |p: usize| {
            let (j, k) = ((p / 20 % 8) as f64, (p % 20) as f64);
            3.0 * (std::f64::consts::PI * (j + 0.5) / 8.0).cos() + (std::f64::consts::PI * 2.0 * (k + 0.5) / 20.0).cos()
        };
        let mut random = crate::sample::SplitMix64(5);
        let known: Vec<bool> = (0..3 * n).map(|_| random.next_u64() % 10 < 7).collect();
        let mut log: Vec<f64> = (0..3 * n).map(|i| if known[i] { truth(i % n) } else { 0.0 }).collect();
        let mut filler = Filler::new(Basis::Dct);
        assert_eq!(filler.analyze(shape, &opponent, &mut log, &known, 0.05, 120), 120);
        let large = log.iter().filter(|c| c.abs() > 0.5).count();
        assert_eq!(large, 2, "{large} coefficients");
        let mut fourier = Transform::new(Basis::Dct, shape);
        log.chunks_exact_mut(n).for_each(|component| fourier.synthesize(component));
        opponent.inverse_f64(&mut log, 3);
        for (i, value) in log.iter().enumerate() {
            let bound = if known[i] { 1e-5 } else { 0.05 };
            assert!((value - truth(i % n)).abs() < bound, "{i}: {value} {}", truth(i % n));
        }
    }

    #[test]
    fn full_blocks_are_transformed_alone() {
        let mut log: Vec<f64> = (0..24).map(|i| f64::from(i * i % 7)).collect();
        let mut expected = log.clone();
        Transform::new(Basis::Dct, [1, 2, 3, 4]).analyze(&mut expected);
        let steps =
            Filler::new(Basis::Dct).analyze([1, 2, 3, 4], &ChannelTransform::None, &mut log, &[true; 24], 0.1, 9);
        assert_eq!((steps, log), (0, expected));
    }
}
