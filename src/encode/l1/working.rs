//! The working set: the few columns of A that matter, as a dense matrix.
//!
//! With few samples, nearly all coefficients are zero at every step and the products with their columns are wasted.
//! The solver then descends over a working set of groups and looks at all the others, by one adjoint transform, only
//! where it is about to decide something: at a step of the root finding, or where sigma is reached. Groups whose dual
//! magnitude exceeds all those inside come in with coefficient zero, which changes neither iterate nor residual; none
//! leaves. Bounds are computed from all columns, so what is proven is proven for the whole problem.
//! (Working sets: Johnson & Guestrin, "Blitz", 2015; Massias, Gramfort, Salmon, "Celer", 2018.)

use super::Operator;
use super::groups::Groups;
use super::vector::LANES;
use crate::base::simd::{Level, Task, multiply_add};

/// A working set pays while rows^2 is at most this times the columns: its width is about three times the rows, and a
/// pair of its products costs six rows^2 multiplications where a pair of separable transforms costs some 50 a column.
const ROWS_SQUARED: usize = 12;

/// Most columns, in units of rows, before the solver goes over to all columns for good.
const WIDEST: usize = 8;

/// See the module's text.
#[derive(Debug, Default)]
pub(super) struct Working {
    /// Groups of the set, packed.
    pub(super) groups: Groups,
    /// By packed entry of the set: a column of A, zero where it only fills up.
    matrix: Vec<f64>,
    /// By packed entry of the set: packed entry in all groups; `u32::MAX` where it only fills up.
    entries: Vec<u32>,
    /// By packed entry of all groups: column of A.
    columns: Vec<u32>,
    /// By group of all: whether it is in the set.
    inside: Vec<bool>,
    /// Groups that may come in, with their dual magnitude.
    candidates: Vec<(f64, u32)>,
    rows: usize,
}

impl Working {
    /// Starts empty. `false` where a working set does not pay or the operator gives no columns.
    pub(super) fn start<O: Operator + ?Sized>(&mut self, op: &mut O, all: &Groups) -> bool {
        let (rows, cols) = (op.rows(), op.cols());
        let pays = rows > 0 && cols > 0 && rows.saturating_mul(rows) <= ROWS_SQUARED.saturating_mul(cols);
        if !pays || !op.column(0, &mut vec![0.0; rows]) {
            return false;
        }
        self.groups.clear();
        self.matrix.clear();
        self.entries.clear();
        self.columns = all.coefficients(cols);
        self.inside.clear();
        self.inside.resize(all.slots(), false);
        self.rows = rows;
        true
    }

    /// Whether the set has grown beyond what pays.
    pub(super) fn too_wide(&self) -> bool {
        self.groups.len() > WIDEST * self.rows.max(64)
    }

    /// Takes in the groups outside whose dual magnitude, by `magnitudes` over all groups, is above `level`: the largest
    /// ones first, up to about `most` columns. Returns how far the largest was above all inside: its magnitude, 0 if
    /// there was none.
    pub(super) fn grow<O: Operator + ?Sized>(
        &mut self,
        op: &mut O,
        all: &Groups,
        magnitudes: &[f64],
        level: f64,
        most: usize,
    ) -> f64 {
        self.candidates.clear();
        for (group, (m, w)) in magnitudes.iter().zip(all.weights()).enumerate() {
            if *m > level * w && !self.inside[group] {
                self.candidates.push((m / w, group as u32));
            }
        }
        self.candidates.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        let largest = self.candidates.first().map_or(0.0, |c| c.0);
        let mut columns = 0;
        let taken = self.candidates.iter().take_while(|c| {
            columns += all.members(c.1 as usize).0;
            columns <= most
        });
        let taken = taken.count().max(1).min(self.candidates.len());
        self.candidates.truncate(taken);
        self.bring_in(op, all);
        largest
    }

    /// Takes in the groups that are not zero in `s`, packed over all groups.
    pub(super) fn cover<O: Operator + ?Sized>(&mut self, op: &mut O, all: &Groups, s: &[f64]) {
        self.candidates.clear();
        for group in 0..all.slots() {
            let (size, entry) = all.members(group);
            if !self.inside[group] && (0..size).any(|m| s[entry + m * LANES] != 0.0) {
                self.candidates.push((0.0, group as u32));
            }
        }
        self.bring_in(op, all);
    }

    /// Moves the candidates into the set, in bundles of one size.
    fn bring_in<O: Operator + ?Sized>(&mut self, op: &mut O, all: &Groups) {
        self.candidates.sort_unstable_by_key(|c| (all.members(c.1 as usize).0, c.1));
        let mut rest = self.candidates.as_slice();
        while let Some(first) = rest.first() {
            let size = all.members(first.1 as usize).0;
            let count = rest.iter().take(LANES).take_while(|c| all.members(c.1 as usize).0 == size).count();
            let (bundle, others) = rest.split_at(count);
            rest = others;
            let mut weights = [1.0; LANES];
            for (weight, &(_, group)) in weights.iter_mut().zip(bundle) {
                *weight = all.weights()[group as usize];
                self.inside[group as usize] = true;
            }
            let start = self.groups.push(size, &weights);
            self.entries.resize(self.groups.len(), u32::MAX);
            self.matrix.resize(self.groups.len() * self.rows, 0.0);
            for (lane, &(_, group)) in bundle.iter().enumerate() {
                let entry = all.members(group as usize).1;
                for m in 0..size {
                    let (from, to) = (entry + m * LANES, start + m * LANES + lane);
                    self.entries[to] = from as u32;
                    let column = &mut self.matrix[to * self.rows..][..self.rows];
                    op.column(self.columns[from] as usize, column);
                }
            }
        }
    }

    /// Entries of the set out of a vector over all groups.
    pub(super) fn gather(&self, all: &[f64], set: &mut [f64]) {
        for (v, &entry) in set.iter_mut().zip(&self.entries) {
            *v = if entry == u32::MAX { 0.0 } else { all[entry as usize] };
        }
    }

    /// A vector over all groups that is zero outside the set. `set` may be from before the set has grown.
    pub(super) fn scatter(&self, set: &[f64], all: &mut [f64]) {
        all.fill(0.0);
        for (v, &entry) in set.iter().zip(&self.entries) {
            if entry != u32::MAX {
                all[entry as usize] = *v;
            }
        }
    }

    /// r = y - A s
    pub(super) fn residual(&self, y: &[f64], s: &[f64], r: &mut [f64]) {
        r.copy_from_slice(y);
        Level::detect().run(Residual { matrix: &self.matrix, s, r });
    }

    /// c = A^T r
    pub(super) fn gradient(&self, r: &[f64], c: &mut [f64]) {
        Level::detect().run(Gradient { matrix: &self.matrix, r, c });
    }
}

/// r -= A s, columns of which most have no part in it.
struct Residual<'a> {
    matrix: &'a [f64],
    s: &'a [f64],
    r: &'a mut [f64],
}

impl Task for Residual<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let rows = self.r.len();
        let mut used = self.s.iter().zip(self.matrix.chunks_exact(rows)).filter(|(v, _)| **v != 0.0);
        while let Some((a, first)) = used.next() {
            // Two columns at a time: half the traffic of the residual.
            let (b, second) = used.next().unwrap_or((&0.0, first));
            for ((r, x), y) in self.r.iter_mut().zip(first).zip(second) {
                *r = multiply_add::<f64, FUSED>(-*b, *y, multiply_add::<f64, FUSED>(-*a, *x, *r));
            }
        }
    }
}

/// c = A^T r
struct Gradient<'a> {
    matrix: &'a [f64],
    r: &'a [f64],
    c: &'a mut [f64],
}

impl Task for Gradient<'_> {
    #[inline(always)]
    fn run<const FUSED: bool>(self) {
        let (r_lanes, r_rest) = self.r.as_chunks::<LANES>();
        // Two columns at a time, as many sums as registers.
        let (pairs, _) = self.c.as_chunks_mut::<2>();
        for (c, columns) in pairs.iter_mut().zip(self.matrix.chunks_exact(2 * self.r.len())) {
            let (first, second) = columns.split_at(self.r.len());
            let ((a_lanes, a_rest), (b_lanes, b_rest)) = (first.as_chunks::<LANES>(), second.as_chunks::<LANES>());
            let mut sums = [[0.0; LANES]; 2];
            for ((a, b), r) in a_lanes.iter().zip(b_lanes).zip(r_lanes) {
                for k in 0..LANES {
                    sums[0][k] = multiply_add::<f64, FUSED>(a[k], r[k], sums[0][k]);
                    sums[1][k] = multiply_add::<f64, FUSED>(b[k], r[k], sums[1][k]);
                }
            }
            for (c, (sums, rest)) in c.iter_mut().zip([(sums[0], a_rest), (sums[1], b_rest)]) {
                *c = sums.iter().sum::<f64>() + rest.iter().zip(r_rest).map(|(a, r)| a * r).sum::<f64>();
            }
        }
    }
}
