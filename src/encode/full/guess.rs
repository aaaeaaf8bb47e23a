//! First guesses for holes of a table, from the nearest that is known (encoder only).

use rayon::prelude::*;

/// In which order the holes of planes are reached, front after front; no value counts.
pub(in crate::encode) struct Guesses {
    /// From positions that some channel knows.
    any: Fronts,
    /// From what each channel knows; empty if all know the same.
    own: Vec<Fronts>,
}

impl Guesses {
    /// `known` is `[channel][position]`.
    pub(in crate::encode) fn new(shape: [usize; 4], channels: usize, known: &[bool]) -> Guesses {
        let n = known.len() / channels;
        let planes = || known.par_chunks(n);
        if known.chunks_exact(n).all(|plane| *plane == known[..n]) {
            return Guesses { any: Fronts::new(shape, &known[..n]), own: Vec::new() };
        }
        let any: Vec<bool> = (0..n).map(|i| known[i..].iter().step_by(n).any(|k| *k)).collect();
        let own = || planes().map(|plane| Fronts::new(shape, plane)).collect();
        let (any, own) = rayon::join(|| Fronts::new(shape, &any), own);
        Guesses { any, own }
    }

    /// Fills what is not known: with the mean over the channels known there, or guessed from there, and what each channel is
    /// above it, guessed as well.
    pub(in crate::encode) fn fill(&self, shape: [usize; 4], log: &mut [f32], known: &[bool]) {
        let n: usize = shape.iter().product();
        if self.own.is_empty() {
            // The two guesses add up.
            return log.par_chunks_mut(n).for_each(|plane| self.any.spread(shape, plane));
        }
        let mut mean = vec![0f32; n];
        for (i, mean) in mean.iter_mut().enumerate() {
            let values = || (i..log.len()).step_by(n).filter(|&j| known[j]).map(|j| log[j]);
            *mean = values().sum::<f32>() / values().count().max(1) as f32;
        }
        self.any.spread(shape, &mut mean);
        log.par_chunks_mut(n).zip(known.par_chunks(n)).zip(&self.own).for_each(|((log, known), fronts)| {
            let mut above: Vec<f32> = (0..n).map(|i| if known[i] { log[i] - mean[i] } else { 0.0 }).collect();
            fronts.spread(shape, &mut above);
            for i in (0..n).filter(|&i| !known[i]) {
                log[i] = mean[i] + above[i];
            }
        });
    }
}

/// Holes of a plane in the order of the fronts that start from what is known.
struct Fronts {
    order: Vec<usize>,
    /// Number of the front that reaches an entry; 0 where it is known.
    number: Vec<u32>,
}

impl Fronts {
    fn new(shape: [usize; 4], known: &[bool]) -> Fronts {
        let mut number: Vec<u32> = known.iter().map(|&k| if k { 0 } else { u32::MAX }).collect();
        let mut order: Vec<usize> = Vec::new();
        for i in (0..known.len()).filter(|&i| !known[i]) {
            let mut beside = false;
            neighbours(shape, i, |j| beside |= known[j]);
            if beside {
                number[i] = 1;
                order.push(i);
            }
        }
        let mut at = 0;
        while let Some(&i) = order.get(at) {
            let next = number[i] + 1;
            neighbours(shape, i, |j| {
                if number[j] == u32::MAX {
                    number[j] = next;
                    order.push(j);
                }
            });
            at += 1;
        }
        Fronts { order, number }
    }

    /// Each hole becomes the mean of the neighbours reached before.
    fn spread(&self, shape: [usize; 4], values: &mut [f32]) {
        for &i in &self.order {
            let (mut sum, mut count) = (0.0, 0.0);
            neighbours(shape, i, |j| {
                if self.number[j] < self.number[i] {
                    sum += values[j];
                    count += 1.0;
                }
            });
            values[i] = sum / count;
        }
    }
}

/// Calls `visit` with the entries beside one, along each axis.
#[inline]
fn neighbours(shape: [usize; 4], i: usize, mut visit: impl FnMut(usize)) {
    let (mut stride, mut rest) = (1, i);
    for a in (0..4).rev() {
        let at = rest % shape[a];
        rest /= shape[a];
        if at > 0 {
            visit(i - stride);
        }
        if at + 1 < shape[a] {
            visit(i + stride);
        }
        stride *= shape[a];
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fill(shape: [usize; 4], values: &mut [f32], known: &[bool]) {
        Guesses::new(shape, 1, known).fill(shape, values, known);
    }

    #[test]
    fn guesses_reach_everything_and_leave_what_is_known() {
        let shape = [1, 3, 4, 5];
        let mut values = vec![0f32; 60];
        let mut known = vec![false; 60];
        (values[7], known[7]) = (2.0, true);
        (values[50], known[50]) = (2.0, true);
        fill(shape, &mut values, &known);
        assert!(values.iter().all(|&v| v == 2.0), "{values:?}");
        // Between a 0 and a 1 on a line: each half takes its end, the middle the mean.
        let mut line = [0f32, 9.0, 9.0, 9.0, 1.0];
        fill([1, 1, 1, 5], &mut line, &[true, false, false, false, true]);
        assert_eq!(line, [0.0, 0.0, 0.5, 1.0, 1.0]);
    }

    #[test]
    fn a_channel_follows_the_others_where_it_is_not_known() {
        let shape = [1, 1, 1, 4];
        // The second channel is one above the first where both are known.
        let mut values = [1.0f32, 2.0, 3.0, 9.0, 2.0, 9.0, 9.0, 9.0];
        let known = [true, true, true, false, true, false, false, false];
        Guesses::new(shape, 2, &known).fill(shape, &mut values, &known);
        // Means 1.5, 2, 3, 3; the first is -.5, 0, 0, 0 above them, the second .5 everywhere.
        assert_eq!(values, [1.0, 2.0, 3.0, 3.0, 2.0, 2.5, 3.5, 3.5]);
    }
}
