//! Corrections of decoded log values: what keeps each entry within a largest error (spec section 4.9).
//!
//! Per channel: whether there is any; per row along the last axis, whether it holds any; per valid entry of such a row,
//! whether it has one, its magnitude, its sign. Outliers are few, cluster where the decoded values change fast, and are
//! mostly common to the channels: the contexts are those three things.

use crate::entropy::{OutOfRange, code_number};
use crate::range::Coder;

/// Bits of a magnitude less one, and one.
const EXPONENTS: usize = 25;
const SLOPES: usize = 7;
const LEVELS: usize = 6;
const SISTERS: usize = 4;

const ANY: usize = 0;
const ROW: usize = ANY + 3;
const PRESENT: usize = ROW + 3 * 3 * 3;
const EXPONENT: usize = PRESENT + SISTERS * SLOPES * LEVELS;
const MANTISSA: usize = EXPONENT + 2 * EXPONENTS;
const SIGN: usize = MANTISSA + EXPONENTS;
/// Number of contexts for corrections.
pub(crate) const CONTEXTS: usize = SIGN + 9;

/// Level of a weighted count of corrected neighbours.
const LEVEL: [u8; 13] = [0, 1, 2, 2, 3, 3, 4, 4, 4, 5, 5, 5, 5];

/// Scratch of the walk, padded so that every neighbour exists.
#[derive(Debug, Default)]
pub(crate) struct Walk {
    /// Corrections of the channel and of the one before, held within -2 and 2.
    own: Vec<i8>,
    sister: Vec<i8>,
    rows: Vec<u8>,
    sister_rows: Vec<u8>,
}

/// A block as the walk sees it.
#[derive(Clone, Copy)]
pub(crate) struct Decoded<'a> {
    pub(crate) shape: [usize; 4],
    /// Validity, `[channel][position]` or one for all channels.
    pub(crate) masks: &'a [bool],
    /// Log values before correction, `[channel][position]`.
    pub(crate) log: &'a [f32],
    /// Correction step.
    pub(crate) step: f32,
}

impl Walk {
    /// Codes the corrections of all channels, `[channel][position]`; a decoder finds them zero and leaves them filled.
    pub(crate) fn code<C: Coder>(
        &mut self,
        coder: &mut C,
        contexts: usize,
        block: Decoded,
        corrections: &mut [i32],
    ) -> Result<(), OutOfRange> {
        let [n0, n1, n2, n3] = block.shape;
        let n = n0 * n1 * n2 * n3;
        let padded = (n0 + 1) * (n1 + 1) * (n2 + 2) * (n3 + 3);
        let mut prepared = false;
        let mut before = 0;
        for (channel, plane) in corrections.chunks_exact_mut(n).enumerate() {
            let found = plane.iter().any(|&m| m != 0);
            let any = coder.bit(contexts + ANY + before, found);
            before = 1 + usize::from(any);
            if any && !prepared {
                prepared = true;
                for (values, rows) in [(&mut self.own, &mut self.rows), (&mut self.sister, &mut self.sister_rows)] {
                    values.clear();
                    values.resize(padded, 0);
                    rows.clear();
                    rows.resize(padded / (n3 + 3), 0);
                }
            } else if prepared {
                std::mem::swap(&mut self.own, &mut self.sister);
                std::mem::swap(&mut self.rows, &mut self.sister_rows);
                self.own.fill(0);
                self.rows.fill(0);
            }
            if any {
                let mask =
                    if block.masks.len() == n { block.masks } else { &block.masks[channel * n..(channel + 1) * n] };
                let plane_of = Decoded { masks: mask, log: &block.log[channel * n..(channel + 1) * n], ..block };
                self.channel(coder, contexts, channel, plane_of, plane)?;
            }
        }
        Ok(())
    }

    fn channel<C: Coder>(
        &mut self,
        coder: &mut C,
        contexts: usize,
        channel: usize,
        block: Decoded,
        plane: &mut [i32],
    ) -> Result<(), OutOfRange> {
        let [n0, n1, n2, n3] = block.shape;
        let rows = [(n1 + 1) * (n2 + 2), n2 + 2];
        for (number, line) in plane.chunks_exact_mut(n3).enumerate() {
            let (i, j, k) = (number / n2 / n1, number / n2 % n1, number % n2);
            debug_assert!(i < n0);
            let mask = &block.masks[number * n3..(number + 1) * n3];
            if !mask.contains(&true) {
                continue;
            }
            let row = (i + 1) * rows[0] + (j + 1) * rows[1] + k + 1;
            let near = self.rows[row - 1] + self.rows[row - rows[1]];
            let around = self.rows[row - rows[1] + 1] + self.rows[row - rows[0]];
            let sister = if channel == 0 { 2 } else { self.sister_rows[row] };
            let context = ROW + usize::from((near * 3 + around) * 3 + sister);
            if !coder.bit(contexts + context, line.iter().any(|&m| m != 0)) {
                continue;
            }
            self.rows[row] = 1;
            let log = |k: usize, l: usize| block.log[(number - number % n2 + k) * n3 + l];
            for l in 0..n3 {
                if !mask[l] {
                    continue;
                }
                let here = log(k, l);
                let mut slope = 0f32;
                if l > 0 {
                    slope = slope.max((here - log(k, l - 1)).abs());
                }
                if l + 1 < n3 {
                    slope = slope.max((here - log(k, l + 1)).abs());
                }
                if k > 0 {
                    slope = slope.max((here - log(k - 1, l)).abs());
                }
                if k + 1 < n2 {
                    slope = slope.max((here - log(k + 1, l)).abs());
                }
                let slope = [0.125, 0.25, 0.5, 1.0, 2.0, 4.0].iter().filter(|&t| slope >= t * block.step).count();
                self.entry(
                    coder,
                    contexts,
                    channel,
                    slope,
                    row * (n3 + 3) + l + 2,
                    [n3 + 3, rows[1] * (n3 + 3), rows[0] * (n3 + 3)],
                    &mut line[l],
                )?;
            }
        }
        Ok(())
    }

    #[allow(clippy::too_many_arguments)]
    #[inline(always)]
    fn entry<C: Coder>(
        &mut self,
        coder: &mut C,
        contexts: usize,
        channel: usize,
        slope: usize,
        at: usize,
        [above, before, outer]: [usize; 3],
        place: &mut i32,
    ) -> Result<(), OutOfRange> {
        let has = |at: usize| usize::from(self.own[at] != 0);
        let near = 2 * (has(at - 1) + has(at - above) + has(at - before))
            + has(at - 2)
            + has(at - above + 1)
            + has(at - above - 1)
            + has(at - before + above)
            + has(at - outer);
        let level = usize::from(LEVEL[near.min(12)]);
        let sister = self.sister[at];
        let kind = if channel == 0 { 3 } else { usize::from(sister.unsigned_abs()).min(2) };
        let m = *place;
        let context = PRESENT + (kind * SLOPES + slope) * LEVELS + level;
        if !coder.bit(contexts + context, m != 0) {
            return Ok(());
        }
        let left = self.own[at - 1];
        let large =
            self.own[at - 1].unsigned_abs() > 1 || self.own[at - above].unsigned_abs() > 1 || sister.unsigned_abs() > 1;
        let exponent = contexts + EXPONENT + usize::from(large) * EXPONENTS;
        let magnitude = 1 + code_number(coder, exponent, contexts + MANTISSA, m.unsigned_abs().wrapping_sub(1))?;
        let sign = |m: i8| (m.signum() + 1) as usize;
        let near_sign = if left != 0 { left } else { self.own[at - above] };
        let negative = coder.bit(contexts + SIGN + sign(sister) * 3 + sign(near_sign), m < 0);
        *place = if negative { -(magnitude as i32) } else { magnitude as i32 };
        self.own[at] = (*place).clamp(-2, 2) as i8;
        Ok(())
    }
}

/// Adds the corrections to the log values.
pub(crate) fn correct(log: &mut [f32], corrections: &[i32], step: f32) {
    for (value, &m) in log.iter_mut().zip(corrections).filter(|(_, m)| **m != 0) {
        *value += m as f32 * step;
    }
}
