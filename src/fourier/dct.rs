//! DCT-II synthesis by dense products, axis after axis from the last to the first.
//!
//! For each axis, position i and its mirror image share their products: the sum E over the even frequencies and
//! the sum O over the odd ones, both ascending and from zero, give E + O at i and E - O at the mirror. Adding a
//! zero term changes no sum, so frequencies beyond the extents are left out.

use super::{AxisTable, Extents};

pub(super) fn synthesize(axes: [&AxisTable; 4], extents: Extents, values: &mut [f32], scratch: &mut Vec<f32>) {
    let shape = axes.map(|a| a.n);
    let total: usize = shape.iter().product();
    if extents.contains(&0) {
        values[..total].fill(0.0);
        return;
    }
    for axis in (0..4).rev() {
        let table = axes[axis];
        if table.n == 1 {
            // The one coefficient of a single position is its value.
            continue;
        }
        let inner: usize = shape[axis + 1..].iter().product();
        for_each_used(&shape[..axis], &extents[..axis], |outer| {
            let line = &mut values[outer * table.n * inner..][..table.n * inner];
            if inner == 1 {
                row(table, extents[axis], line, scratch);
            } else {
                lanes(table, extents[axis], inner, line, scratch);
            }
        });
    }
}

/// Calls `each` with the linear index of every combination below the extents.
fn for_each_used(shape: &[usize], extents: &[usize], mut each: impl FnMut(usize)) {
    fn descend(shape: &[usize], extents: &[usize], base: usize, each: &mut dyn FnMut(usize)) {
        match shape.split_first() {
            None => each(base),
            Some((n, rest)) => {
                for i in 0..extents[0] {
                    descend(rest, &extents[1..], base * n + i, each);
                }
            }
        }
    }
    descend(shape, extents, 0, &mut each);
}

/// One line along the last axis.
fn row(table: &AxisTable, used: usize, line: &mut [f32], scratch: &mut Vec<f32>) {
    let n = table.n;
    let half = n.div_ceil(2);
    scratch.clear();
    scratch.resize(2 * half, 0.0);
    let (even, odd) = scratch.split_at_mut(half);
    let mut any = false;
    for (k, &s) in line[..used].iter().enumerate() {
        if s == 0.0 {
            continue;
        }
        any = true;
        let sum = if k % 2 == 0 { &mut *even } else { &mut *odd };
        for (sum, c) in sum.iter_mut().zip(&table.cos[k * half..][..half]) {
            *sum += s * c;
        }
    }
    if !any {
        return;
    }
    for i in 0..half {
        line[n - 1 - i] = even[i] - odd[i];
        line[i] = even[i] + odd[i];
    }
}

/// A bundle of lines along an axis that is not the last: `inner` neighbours side by side.
fn lanes(table: &AxisTable, used: usize, inner: usize, bundle: &mut [f32], scratch: &mut Vec<f32>) {
    scratch.clear();
    scratch.extend_from_slice(&bundle[..used * inner]);
    let mut at = 0;
    while inner - at >= 16 {
        lane_group::<16>(table, used, inner, at, scratch, bundle);
        at += 16;
    }
    while inner - at >= 4 {
        lane_group::<4>(table, used, inner, at, scratch, bundle);
        at += 4;
    }
    while inner - at >= 1 {
        lane_group::<1>(table, used, inner, at, scratch, bundle);
        at += 1;
    }
}

#[inline(always)]
fn lane_group<const W: usize>(
    table: &AxisTable,
    used: usize,
    inner: usize,
    at: usize,
    source: &[f32],
    target: &mut [f32],
) {
    let n = table.n;
    let half = n.div_ceil(2);
    for i in 0..half {
        let sum = |first: usize| {
            let mut sum = [0f32; W];
            for k in (first..used).step_by(2) {
                let c = table.cos[k * half + i];
                for (sum, s) in sum.iter_mut().zip(&source[k * inner + at..][..W]) {
                    *sum += s * c;
                }
            }
            sum
        };
        let (even, odd) = (sum(0), sum(1));
        for w in 0..W {
            target[(n - 1 - i) * inner + at + w] = even[w] - odd[w];
            target[i * inner + at + w] = even[w] + odd[w];
        }
    }
}
