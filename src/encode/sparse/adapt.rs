//! As many samples a block as it needs: more are drawn until those held out are predicted well enough (encoder only).

use rayon::prelude::*;

use super::estimate::{Estimator, Stiffness};
use crate::codec::sample::Sampling;
use crate::encode::progress::Progress;
use crate::encode::settings::ADAPTIVE_START as START;

/// Rounds until every entry is a sample.
const ROUNDS: usize = 7;

/// Rounds in which the trend is fitted anew: later samples change it little, and only blocks with new ones are solved.
const FITS: usize = 3;

/// Doublings of the ratio of each block, so that its rms error over samples held out is at most `target`.
///
/// A block is judged by the samples that its next doubling would add: measured, but not yet seen by the recovery. They
/// count as taken, so a block ends one doubling above the ratio that was enough.
pub(in crate::encode) fn doublings(estimator: &mut Estimator, target: f64, progress: Progress) -> Vec<u8> {
    let count = estimator.partition().block_count();
    let mut doublings = vec![0u8; count];
    let mut open = vec![true; count];
    for round in 0..ROUNDS {
        let now: Vec<Sampling> = doublings.iter().map(|&d| START.doubled(d)).collect();
        let next: Vec<Sampling> = doublings.iter().map(|&d| START.doubled(d + 1)).collect();
        estimator.draw(&now);
        if round < FITS {
            estimator.fit(Stiffness::Usual);
        }
        let estimate = estimator.solve(Progress::none());
        let errors: Vec<f64> = (0..count)
            .into_par_iter()
            .map(|b| if open[b] { estimator.held_out_rms(&estimate, b, next[b]) } else { 0.0 })
            .collect();
        for (b, error) in errors.into_iter().enumerate() {
            if open[b] {
                doublings[b] += 1;
                open[b] = error > target && next[b] != Sampling::Every;
            }
        }
        progress.reach((round + 1) as f64 / ROUNDS as f64);
        if !open.contains(&true) {
            break;
        }
    }
    doublings
}
