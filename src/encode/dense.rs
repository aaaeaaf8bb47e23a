//! A table of which every valid entry counts, ready to be cut into blocks: logarithms with the grazing profile taken
//! out, holes filled roughly.

use rayon::prelude::*;

use super::blocks::gather_log;
use super::{Encoder, grazing};
use crate::block::Block;
use crate::channel::ChannelTransform;
use crate::format::profile::CodedProfile;
use crate::grid::Grid;
use crate::profile::Profile;
use crate::table::BrdfTable;

/// Planes in grid order, one a channel.
pub(super) struct Dense {
    shape: [usize; 4],
    channels: usize,
    /// Logarithms less the profile; where not known, a guess.
    log: Vec<f32>,
    /// Valid and not exactly zero.
    known: Vec<bool>,
    /// Whether entries that are exactly zero are told apart.
    pub(super) zeros: bool,
    pub(super) profile: Option<CodedProfile>,
}

/// A block of it, `[channel][position]`.
pub(super) struct DenseBlock {
    pub(super) log: Vec<f64>,
    pub(super) known: Vec<bool>,
}

impl Dense {
    /// Without a profile, holes not filled yet.
    pub(super) fn new(table: &BrdfTable, eps: f64) -> Dense {
        let grid = table.grid();
        let whole = Block { origin: [0; 4], shape: grid.shape() };
        let (values, valid) = gather_log(table, &whole, eps);
        let log: Vec<f32> = values.iter().map(|&value| value as f32).collect();
        let is_zero = |i: usize| valid[i] && table.values()[i] == 0.0;
        let zeros = (0..valid.len()).any(is_zero);
        let known: Vec<bool> = if zeros { (0..valid.len()).map(|i| valid[i] && !is_zero(i)).collect() } else { valid };
        Dense { shape: grid.shape(), channels: grid.channels().len(), log, known, zeros, profile: None }
    }

    /// The same with the profile that fits best, taken out; `None` if there is none.
    pub(super) fn with_profile(&self, grid: &Grid, transform: &ChannelTransform, encoder: &Encoder) -> Option<Dense> {
        let (coded, profile) = grazing::fit(grid, transform, &self.log, &self.known, encoder.step, encoder.effort)?;
        let mut log = self.log.clone();
        subtract(&profile, transform, self.shape, &mut log);
        Some(Dense { log, known: self.known.clone(), profile: Some(coded), ..*self })
    }

    /// Guesses for what is not known.
    pub(super) fn filled(mut self) -> Dense {
        fill_roughly(self.shape, self.channels, &mut self.log, &self.known);
        self
    }

    pub(super) fn block(&self, block: &Block) -> DenseBlock {
        let n = block.positions();
        let plane = self.log.len() / self.channels;
        let mut log = vec![0f32; n * self.channels];
        let mut known = vec![false; log.len()];
        for c in 0..self.channels {
            block.gather(self.shape, &self.log[c * plane..(c + 1) * plane], &mut log[c * n..(c + 1) * n]);
            block.gather(self.shape, &self.known[c * plane..(c + 1) * plane], &mut known[c * n..(c + 1) * n]);
        }
        DenseBlock { log: log.iter().map(|&value| value.into()).collect(), known }
    }
}

/// Takes the profile, which is of components, out of the channels' logarithms.
fn subtract(profile: &Profile, transform: &ChannelTransform, shape: [usize; 4], log: &mut [f32]) {
    let n: usize = shape.iter().product();
    let channels = log.len() / n;
    let slab = n / shape[1];
    let slabs: Vec<Vec<f32>> = (0..shape[1])
        .into_par_iter()
        .map(|h| {
            let block = Block { origin: [0, h, 0, 0], shape: [1, 1, shape[2], shape[3]] };
            let mut values = vec![0f32; slab * channels];
            profile.add(&block, &mut values);
            transform.inverse(&mut values, channels);
            values
        })
        .collect();
    log.par_chunks_mut(n).enumerate().for_each(|(c, plane)| {
        for (h, rows) in plane.chunks_exact_mut(slab).enumerate() {
            for (log, value) in rows.iter_mut().zip(&slabs[h][c * slab..]) {
                *log -= value;
            }
        }
    });
}

/// Guesses for what is not known, from the nearest that is: the mean over the channels known there first, then what
/// each channel is above it.
fn fill_roughly(shape: [usize; 4], channels: usize, log: &mut [f32], known: &[bool]) {
    let n: usize = shape.iter().product();
    if known.iter().all(|k| *k) {
        return;
    }
    let mut mean = vec![0f32; n];
    let mut any = vec![0u16; n];
    for c in 0..channels {
        for i in 0..n {
            if known[c * n + i] {
                mean[i] += log[c * n + i];
                any[i] += 1;
            }
        }
    }
    mean.iter_mut().zip(&any).for_each(|(mean, &count)| *mean /= f32::from(count.max(1)));
    let seen: Vec<bool> = any.iter().map(|&count| count > 0).collect();
    spread(shape, &mut mean, &seen);
    log.par_chunks_mut(n).zip(known.par_chunks(n)).for_each(|(log, known)| {
        let mut above: Vec<f32> = (0..n).map(|i| if known[i] { log[i] - mean[i] } else { 0.0 }).collect();
        spread(shape, &mut above, known);
        for i in 0..n {
            if !known[i] {
                log[i] = mean[i] + above[i];
            }
        }
    });
}

/// Front after front from what is known, each entry the mean of the neighbours reached before.
fn spread(shape: [usize; 4], values: &mut [f32], known: &[bool]) {
    let strides: [usize; 4] = std::array::from_fn(|a| shape[a + 1..].iter().product());
    let neighbours = |i: usize, visit: &mut dyn FnMut(usize)| {
        for a in 0..4 {
            let at = i / strides[a] % shape[a];
            if at > 0 {
                visit(i - strides[a]);
            }
            if at + 1 < shape[a] {
                visit(i + strides[a]);
            }
        }
    };
    // Number of the front that reached an entry; 0 where it is known.
    let mut front: Vec<u32> = known.iter().map(|&k| if k { 0 } else { u32::MAX }).collect();
    let mut next: Vec<usize> = Vec::new();
    for i in (0..known.len()).filter(|&i| !known[i]) {
        let mut beside = false;
        neighbours(i, &mut |j| beside |= known[j]);
        if beside {
            next.push(i);
        }
    }
    for number in 1.. {
        if next.is_empty() {
            break;
        }
        for &i in &next {
            front[i] = number;
        }
        let mut reached = Vec::new();
        for &i in &next {
            let (mut sum, mut count) = (0.0, 0.0);
            neighbours(i, &mut |j| {
                if front[j] < number {
                    sum += values[j];
                    count += 1.0;
                } else if front[j] == u32::MAX {
                    front[j] = u32::MAX - 1;
                    reached.push(j);
                }
            });
            values[i] = sum / count;
        }
        next = reached;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spreading_reaches_everything_and_leaves_what_is_known() {
        let shape = [1, 3, 4, 5];
        let mut values = vec![0f32; 60];
        let mut known = vec![false; 60];
        (values[7], known[7]) = (2.0, true);
        (values[50], known[50]) = (2.0, true);
        spread(shape, &mut values, &known);
        assert!(values.iter().all(|&v| v == 2.0), "{values:?}");
        // Between a 0 and a 1 on a line: each half takes its end, the middle the mean.
        let mut line = [0f32, 9.0, 9.0, 9.0, 1.0];
        spread([1, 1, 1, 5], &mut line, &[true, false, false, false, true]);
        assert_eq!(line, [0.0, 0.0, 0.5, 1.0, 1.0]);
    }
}
