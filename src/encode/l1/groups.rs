//! Groups of coefficients as the solver holds them, and the passes over them.
//!
//! The solver's vectors are packed: groups of equal size form a class, and [`LANES`] groups of a class a bundle, which
//! is stored member after member, the same member of its groups side by side. The last bundle of a class is filled up
//! with zeros. Magnitudes of any group size then are sums over contiguous rows, with no gather but one permutation
//! before and after the operator.
//!
//! Squares of entries must be in range: the solver's vectors are those of a problem with ||y|| = 1.

use super::vector::LANES;
use crate::base::simd::{Level, Task};

/// Groups of one size.
pub(super) struct Class {
    /// `[member][group]`: which coefficient it is.
    members: Vec<Vec<u32>>,
    /// One a group.
    weights: Vec<f64>,
}

impl Class {
    pub(super) fn new(members: Vec<Vec<u32>>, weights: Vec<f64>) -> Class {
        Class { members, weights }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.weights.is_empty()
    }
}

/// Where a class lies in packed vectors, and in those of one entry a group.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Span {
    /// Members of a group.
    size: usize,
    bundles: usize,
    /// First entry of the first bundle.
    start: usize,
    /// First group.
    group: usize,
}

/// What the packed vectors hold.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Groups {
    spans: Vec<Span>,
    /// One a group, 1 for those that only fill up.
    weights: Vec<f64>,
    /// 1 / weights
    inverses: Vec<f64>,
    /// Packed entry of every coefficient; `None` where it is the same.
    slots: Option<Vec<u32>>,
    count: usize,
    len: usize,
}

impl Groups {
    /// The classes, whose members are the coefficients 0 to `cols` - 1, each once.
    pub(super) fn new(classes: impl IntoIterator<Item = Class>, cols: usize) -> Groups {
        let (mut spans, mut weights, mut slots) = (Vec::new(), Vec::new(), vec![0u32; cols]);
        let (mut count, mut len) = (0, 0);
        for class in classes {
            let (size, bundles) = (class.members.len(), class.weights.len().div_ceil(LANES));
            let span = Span { size, bundles, start: len, group: weights.len() };
            for (m, member) in class.members.iter().enumerate() {
                for (g, &coefficient) in member.iter().enumerate() {
                    slots[coefficient as usize] = (span.entry(span.group + g) + m * LANES) as u32;
                }
            }
            count += class.weights.len();
            len += size * bundles * LANES;
            weights.extend(class.weights);
            weights.resize(weights.len().next_multiple_of(LANES), 1.0);
            spans.push(span);
        }
        let identity = slots.iter().enumerate().all(|(i, &slot)| slot as usize == i);
        let inverses = weights.iter().map(|w| 1.0 / w).collect();
        Groups { spans, weights, inverses, slots: (!identity).then_some(slots), count, len }
    }

    /// Number of groups.
    pub(super) fn count(&self) -> usize {
        self.count
    }

    /// Length of vectors of one entry a group, filled up.
    pub(super) fn slots(&self) -> usize {
        self.weights.len()
    }

    /// Length of packed vectors, a multiple of [`LANES`].
    pub(super) fn len(&self) -> usize {
        self.len
    }

    /// Members of a group, and packed entry of the first one; the others follow at distances of [`LANES`].
    pub(super) fn members(&self, group: usize) -> (usize, usize) {
        let at = self.spans.partition_point(|span| span.group <= group) - 1;
        (self.spans[at].size, self.spans[at].entry(group))
    }

    /// The coefficient at every packed entry; `u32::MAX` at those that only fill up.
    pub(super) fn coefficients(&self, cols: usize) -> Vec<u32> {
        let mut of = vec![u32::MAX; self.len];
        for i in 0..cols {
            of[self.slots.as_ref().map_or(i, |slots| slots[i] as usize)] = i as u32;
        }
        of
    }

    /// Adds a bundle of groups of one size, and returns the entry at which it starts.
    pub(super) fn push(&mut self, size: usize, weights: &[f64; LANES]) -> usize {
        let start = self.len;
        match self.spans.last_mut() {
            Some(span) if span.size == size => span.bundles += 1,
            _ => self.spans.push(Span { size, bundles: 1, start, group: self.weights.len() }),
        }
        self.weights.extend(weights);
        self.inverses.extend(weights.map(|w| 1.0 / w));
        self.count += LANES;
        self.len += size * LANES;
        start
    }

    /// Nothing.
    pub(super) fn clear(&mut self) {
        self.spans.clear();
        self.weights.clear();
        self.inverses.clear();
        (self.slots, self.count, self.len) = (None, 0, 0);
    }

    /// Weight of every group, 1 where none is.
    pub(super) fn weights(&self) -> &[f64] {
        &self.weights
    }

    /// Coefficients in the order of the operator into packed ones. What fills up must be zero, and stays it.
    pub(super) fn pack(&self, coefficients: &[f64], packed: &mut [f64]) {
        match &self.slots {
            None => packed[..coefficients.len()].copy_from_slice(coefficients),
            Some(slots) => {
                for (&slot, v) in slots.iter().zip(coefficients) {
                    packed[slot as usize] = *v;
                }
            }
        }
    }

    /// The inverse of [`Groups::pack`].
    pub(super) fn unpack(&self, packed: &[f64], coefficients: &mut [f64]) {
        match &self.slots {
            None => coefficients.copy_from_slice(&packed[..coefficients.len()]),
            Some(slots) => {
                for (&slot, v) in slots.iter().zip(coefficients) {
                    *v = packed[slot as usize];
                }
            }
        }
    }

    /// Magnitude of every group.
    pub(super) fn magnitudes(&self, s: &[f64], magnitudes: &mut [f64]) {
        self.each(|size, rows, groups| {
            *lanes_mut(magnitudes, groups) = magnitude(size, |i| *lanes(s, rows.at(i)));
        });
    }

    /// trial = s + step * c, and its magnitudes.
    pub(super) fn step(&self, s: &[f64], step: f64, c: &[f64], trial: &mut [f64], magnitudes: &mut [f64]) {
        self.each(|size, rows, groups| {
            *lanes_mut(magnitudes, groups) = magnitude(size, |i| {
                let (s, c, t) = (lanes(s, rows.at(i)), lanes(c, rows.at(i)), lanes_mut(trial, rows.at(i)));
                for k in 0..LANES {
                    t[k] = s[k] + step * c[k];
                }
                *t
            });
        });
    }

    /// Every group magnitude m becomes max(m - theta weight, 0).
    pub(super) fn shrink(&self, s: &mut [f64], magnitudes: &[f64], theta: f64) {
        self.each(|size, rows, groups| {
            let factors = self.factors(magnitudes, theta, groups);
            for i in 0..size {
                let s = lanes_mut(s, rows.at(i));
                for k in 0..LANES {
                    s[k] *= factors[k];
                }
            }
        });
    }

    /// Every group of a magnitude not above `cut` becomes zero.
    pub(super) fn keep_above(&self, s: &mut [f64], magnitudes: &[f64], cut: f64) {
        self.each(|size, rows, groups| {
            let factors = lanes(magnitudes, groups).map(|m| if m > cut { 1.0 } else { 0.0 });
            for i in 0..size {
                let s = lanes_mut(s, rows.at(i));
                for k in 0..LANES {
                    s[k] *= factors[k];
                }
            }
        });
    }

    /// [`Groups::shrink`] of `trial` (nothing at theta = 0), then (<c, trial - s>, ||trial - s||^2).
    pub(super) fn shrink_towards(
        &self,
        trial: &mut [f64],
        magnitudes: &[f64],
        theta: f64,
        s: &[f64],
        c: &[f64],
    ) -> (f64, f64) {
        let (mut slope, mut length) = ([0.0; LANES], [0.0; LANES]);
        let sums = (&mut slope, &mut length);
        self.run(ShrinkTowards { groups: self, trial, magnitudes, theta, s, c, sums });
        (slope.iter().sum(), length.iter().sum())
    }

    /// One step of Douglas-Rachford splitting over all groups: see [`Relaxed`].
    pub(super) fn relax(&self, z: &mut [f64], c: &[f64], u: &mut [f64], by: &Relaxation) -> Relaxed {
        let mut sums = [[0.0; LANES]; 3];
        self.run(Relax { groups: self, z, c, u, by: *by, sums: &mut sums });
        let [norm_u, norm_v, dual] = sums;
        let dual = dual.into_iter().fold(0.0, larger).sqrt();
        Relaxed { norm_u: norm_u.iter().sum(), norm_v: norm_v.iter().sum(), dual }
    }

    /// ||W s||_1
    pub(super) fn primal(&self, s: &[f64]) -> f64 {
        let mut sum = [0.0; LANES];
        self.each(|size, rows, groups| {
            let (m, w) = (magnitude(size, |i| *lanes(s, rows.at(i))), lanes(&self.weights, groups));
            for k in 0..LANES {
                sum[k] += w[k] * m[k];
            }
        });
        sum.iter().sum()
    }

    /// The dual norm of c, and ||c||^2. NaN entries are passed over by the first and seen in the second.
    pub(super) fn dual_and_square(&self, c: &[f64]) -> (f64, f64) {
        let (mut dual, mut square) = ([0.0; LANES], [0.0; LANES]);
        self.run(DualAndSquare { groups: self, c, dual: &mut dual, square: &mut square });
        (dual.into_iter().fold(0.0, larger).sqrt(), square.iter().sum())
    }

    /// max(1 - theta weight / magnitude, 0), and 0 for a magnitude of 0.
    #[inline(always)]
    fn factors(&self, magnitudes: &[f64], theta: f64, groups: usize) -> [f64; LANES] {
        let (m, w) = (lanes(magnitudes, groups), lanes(&self.weights, groups));
        let mut factors = [0.0; LANES];
        for k in 0..LANES {
            let kept = (m[k] - theta * w[k]) / m[k];
            factors[k] = if kept > 0.0 { kept } else { 0.0 };
        }
        factors
    }

    /// Calls `pass(size, rows, groups)` for every bundle, that of the groups `groups` to `groups` + LANES: members are at
    /// `rows.at(0)` to `rows.at(size - 1)`. The sizes in common use are constants to the compiler.
    #[inline(always)]
    fn each(&self, pass: impl FnMut(usize, Rows, usize)) {
        self.run(pass);
    }

    #[inline(always)]
    fn run(&self, pass: impl Pass) {
        Level::detect().run(Each { spans: &self.spans, pass });
    }
}

/// What is done to every bundle. Long ones are types of their own: a closure may not be inlined, and is compiled for the
/// baseline then.
trait Pass {
    fn bundle(&mut self, size: usize, rows: Rows, groups: usize);
}

impl<F: FnMut(usize, Rows, usize)> Pass for F {
    #[inline(always)]
    fn bundle(&mut self, size: usize, rows: Rows, groups: usize) {
        self(size, rows, groups);
    }
}

/// See [`Groups::shrink_towards`].
struct ShrinkTowards<'a> {
    groups: &'a Groups,
    trial: &'a mut [f64],
    magnitudes: &'a [f64],
    theta: f64,
    s: &'a [f64],
    c: &'a [f64],
    sums: (&'a mut [f64; LANES], &'a mut [f64; LANES]),
}

impl Pass for ShrinkTowards<'_> {
    #[inline(always)]
    fn bundle(&mut self, size: usize, rows: Rows, groups: usize) {
        let factors =
            if self.theta > 0.0 { self.groups.factors(self.magnitudes, self.theta, groups) } else { [1.0; LANES] };
        // Values, not places: what may overlap is not vectorised.
        let (mut slope, mut length) = (*self.sums.0, *self.sums.1);
        for i in 0..size {
            let (t, s, c) = (*lanes(self.trial, rows.at(i)), *lanes(self.s, rows.at(i)), *lanes(self.c, rows.at(i)));
            let t = each_lane(|k| t[k] * factors[k]);
            let d = each_lane(|k| t[k] - s[k]);
            *lanes_mut(self.trial, rows.at(i)) = t;
            slope = each_lane(|k| slope[k] + c[k] * d[k]);
            length = each_lane(|k| length[k] + d[k] * d[k]);
        }
        (*self.sums.0, *self.sums.1) = (slope, length);
    }
}

/// See [`Groups::dual_and_square`].
struct DualAndSquare<'a> {
    groups: &'a Groups,
    c: &'a [f64],
    dual: &'a mut [f64; LANES],
    square: &'a mut [f64; LANES],
}

impl Pass for DualAndSquare<'_> {
    #[inline(always)]
    fn bundle(&mut self, size: usize, rows: Rows, groups: usize) {
        let squares = squares(size, |i| *lanes(self.c, rows.at(i)));
        let inverses = *lanes(&self.groups.inverses, groups);
        let (dual, square) = (*self.dual, *self.square);
        *self.dual = each_lane(|k| larger(dual[k], squares[k] * (inverses[k] * inverses[k])));
        *self.square = each_lane(|k| square[k] + squares[k]);
    }
}

/// Numbers of a step of splitting.
#[derive(Clone, Copy)]
pub(super) struct Relaxation {
    /// u = z + share c
    pub(super) share: f64,
    /// v: the soft threshold of 2 u - z at gamma times the weights.
    pub(super) gamma: f64,
    /// z becomes u + rescale (z - u) + over (v - u).
    pub(super) rescale: f64,
    pub(super) over: f64,
}

/// Norms at such a step.
pub(super) struct Relaxed {
    /// ||W u||_1 and ||W v||_1
    pub(super) norm_u: f64,
    pub(super) norm_v: f64,
    /// The dual norm of c.
    pub(super) dual: f64,
}

struct Relax<'a> {
    groups: &'a Groups,
    z: &'a mut [f64],
    c: &'a [f64],
    u: &'a mut [f64],
    by: Relaxation,
    /// Norm of u, of v, square of the dual norm.
    sums: &'a mut [[f64; LANES]; 3],
}

impl Pass for Relax<'_> {
    #[inline(always)]
    fn bundle(&mut self, size: usize, rows: Rows, groups: usize) {
        let Relaxation { share, gamma, rescale, over } = self.by;
        let (weights, inverses) = (*lanes(&self.groups.weights, groups), *lanes(&self.groups.inverses, groups));
        let along = |z: [f64; LANES], c: [f64; LANES], factor: f64| each_lane(|k| z[k] + factor * c[k]);
        let (mut of_u, mut reflected, mut of_c) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for i in 0..size {
            let (z, c) = (*lanes(self.z, rows.at(i)), *lanes(self.c, rows.at(i)));
            let (u, w) = (along(z, c, share), along(z, c, 2.0 * share));
            of_u = each_lane(|k| of_u[k] + u[k] * u[k]);
            reflected = each_lane(|k| reflected[k] + w[k] * w[k]);
            of_c = each_lane(|k| of_c[k] + c[k] * c[k]);
        }
        let of_u = each_lane(|k| of_u[k].sqrt());
        let reflected = each_lane(|k| reflected[k].sqrt());
        let kept = each_lane(|k| reflected[k] - gamma * weights[k]);
        let kept = each_lane(|k| if kept[k] > 0.0 { kept[k] } else { 0.0 });
        // A magnitude of 0 keeps 0: 0 / tiny.
        let factors = each_lane(|k| kept[k] / larger(reflected[k], f64::MIN_POSITIVE));
        let [norm_u, norm_v, dual] = *self.sums;
        *self.sums = [
            each_lane(|k| norm_u[k] + weights[k] * of_u[k]),
            each_lane(|k| norm_v[k] + weights[k] * kept[k]),
            each_lane(|k| larger(dual[k], of_c[k] * (inverses[k] * inverses[k]))),
        ];
        for i in 0..size {
            let (z, c) = (*lanes(self.z, rows.at(i)), *lanes(self.c, rows.at(i)));
            let u = along(z, c, share);
            let w = along(z, c, 2.0 * share);
            *lanes_mut(self.u, rows.at(i)) = u;
            *lanes_mut(self.z, rows.at(i)) =
                each_lane(|k| u[k] - rescale * (share * c[k]) + over * (factors[k] * w[k] - u[k]));
        }
    }
}

/// A register of what `value` gives for every lane.
#[inline(always)]
fn each_lane(mut value: impl FnMut(usize) -> f64) -> [f64; LANES] {
    let mut all = [0.0; LANES];
    for (k, v) in all.iter_mut().enumerate() {
        *v = value(k);
    }
    all
}

/// A comparison, not f64::max: it compiles to one vector instruction.
#[inline(always)]
fn larger(a: f64, b: f64) -> f64 {
    if b > a { b } else { a }
}

/// A pass over all bundles, on the best instructions of the machine.
struct Each<'a, P> {
    spans: &'a [Span],
    pass: P,
}

impl<P: Pass> Task for Each<'_, P> {
    #[inline(always)]
    fn run<const FUSED: bool>(mut self) {
        for span in self.spans {
            match span.size {
                1 => span.each(1, &mut self.pass),
                2 => span.each(2, &mut self.pass),
                size => span.each(size, &mut self.pass),
            }
        }
    }
}

impl Span {
    #[inline(always)]
    fn each(&self, size: usize, pass: &mut impl Pass) {
        for bundle in 0..self.bundles {
            pass.bundle(size, Rows { first: self.start + bundle * size * LANES }, self.group + bundle * LANES);
        }
    }

    /// Packed entry of the first member of a group.
    fn entry(&self, group: usize) -> usize {
        let (bundle, lane) = ((group - self.group) / LANES, (group - self.group) % LANES);
        self.start + bundle * self.size * LANES + lane
    }
}

/// The members of a bundle.
#[derive(Clone, Copy)]
struct Rows {
    first: usize,
}

impl Rows {
    #[inline(always)]
    fn at(self, member: usize) -> usize {
        self.first + member * LANES
    }
}

#[inline(always)]
fn lanes(v: &[f64], at: usize) -> &[f64; LANES] {
    v[at..at + LANES].try_into().expect("a whole register")
}

#[inline(always)]
fn lanes_mut(v: &mut [f64], at: usize) -> &mut [f64; LANES] {
    (&mut v[at..at + LANES]).try_into().expect("a whole register")
}

/// Squared magnitudes of neighbouring groups.
#[inline(always)]
fn squares(size: usize, mut member: impl FnMut(usize) -> [f64; LANES]) -> [f64; LANES] {
    let mut squares = [0.0; LANES];
    for i in 0..size {
        let v = member(i);
        for k in 0..LANES {
            squares[k] += v[k] * v[k];
        }
    }
    squares
}

/// Magnitudes of neighbouring groups.
#[inline(always)]
fn magnitude(size: usize, mut member: impl FnMut(usize) -> [f64; LANES]) -> [f64; LANES] {
    if size == 1 { member(0).map(f64::abs) } else { squares(size, member).map(f64::sqrt) }
}
