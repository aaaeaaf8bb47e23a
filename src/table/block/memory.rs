//! Where the values of a block go: rows in the planes of a table, or planes of the block's own.

use std::mem::MaybeUninit;

use super::Block;

/// Places of a share: runs, those of the first plane, then of the next.
pub(crate) struct Memory<'a, T> {
    pub(super) runs: Vec<&'a mut [T]>,
    pub(super) planes: usize,
    pub(super) grid: [usize; 4],
    /// Runs are pieces of this axis, with all of those behind.
    pub(super) depth: usize,
    /// Of the share.
    pub(super) bounds: Block,
}

impl<'a, T> Memory<'a, T> {
    /// Those of one of its blocks. Where the block is as long as the last axis, its rows along the axis before are one.
    pub(crate) fn of_block(&mut self, block: &Block) -> Target<'_, 'a, T> {
        let Memory { grid, depth, bounds, .. } = *self;
        // Of a step along each axis: by how many runs, and by how many places within a run.
        let (mut runs, mut places) = (1, 1);
        let (mut steps, mut here) = ([[0; 2]; 4], [0; 2]);
        for axis in (0..4).rev() {
            let offset = block.origin[axis] - bounds.origin[axis];
            if axis < depth {
                steps[axis] = [runs, 0];
                runs *= bounds.shape[axis];
            } else {
                steps[axis] = [0, places];
                places *= grid[axis];
            }
            here = [here[0] + offset * steps[axis][0], here[1] + offset * steps[axis][1]];
        }
        let [n0, n1, n2, n3] = block.shape;
        let whole = depth < 3 && n3 == grid[3];
        let (counts, length) = if whole { ([n0, n1, 1], n2 * n3) } else { ([n0, n1, n2], n3) };
        let rows =
            Rows { counts, steps: [steps[0], steps[1], steps[2]], at: [0; 3], here, left: counts.iter().product() };
        let per_plane = self.runs.len() / self.planes;
        Target { runs: &mut self.runs, per_plane, rows, length }
    }
}

/// Where the rows of a block are: run and place within it, the same in each plane.
#[derive(Clone)]
struct Rows {
    counts: [usize; 3],
    steps: [[usize; 2]; 3],
    at: [usize; 3],
    here: [usize; 2],
    left: usize,
}

impl Iterator for Rows {
    type Item = [usize; 2];

    #[inline(always)]
    fn next(&mut self) -> Option<[usize; 2]> {
        self.left = self.left.checked_sub(1)?;
        let row = self.here;
        for axis in (0..3).rev() {
            let [runs, places] = self.steps[axis];
            self.at[axis] += 1;
            self.here = [self.here[0] + runs, self.here[1] + places];
            if self.at[axis] < self.counts[axis] {
                break;
            }
            self.here = [self.here[0] - self.counts[axis] * runs, self.here[1] - self.counts[axis] * places];
            self.at[axis] = 0;
        }
        Some(row)
    }
}

/// Memory for the values of a block: rows of one length, the same in each plane.
pub(crate) struct Target<'t, 'a, T> {
    runs: &'t mut [&'a mut [T]],
    per_plane: usize,
    rows: Rows,
    length: usize,
}

/// Memory for a value, be there one already or not.
pub(crate) trait Place<V> {
    fn put(&mut self, value: V);
}

impl<V> Place<V> for V {
    #[inline(always)]
    fn put(&mut self, value: V) {
        *self = value;
    }
}

impl<V> Place<V> for MaybeUninit<V> {
    #[inline(always)]
    fn put(&mut self, value: V) {
        self.write(value);
    }
}

impl<'t, 'a, T> Target<'t, 'a, T> {
    /// Planes that hold nothing but the block.
    pub(crate) fn whole(planes: &'t mut [&'a mut [T]]) -> Target<'t, 'a, T> {
        let rows = Rows { counts: [1; 3], steps: [[0; 2]; 3], at: [0; 3], here: [0; 2], left: 1 };
        let length = planes.first().map_or(0, |plane| plane.len());
        Target { runs: planes, per_plane: 1, rows, length }
    }

    /// Of each row.
    pub(crate) fn length(&self) -> usize {
        self.length
    }

    /// The next row in each of three planes.
    #[inline(always)]
    pub(crate) fn next_row(&mut self) -> Option<[&mut [T]; 3]> {
        let [run, at] = self.rows.next()?;
        let (red, rest) = self.runs.split_at_mut(self.per_plane);
        let (green, blue) = rest.split_at_mut(self.per_plane);
        Some([red, green, blue].map(|runs| &mut runs[run][at..at + self.length]))
    }

    /// Puts each value into `places` places after each other.
    pub(crate) fn fill<V: Copy>(self, values: &[V], places: usize)
    where
        T: Place<V>,
    {
        let (planes, per_row) = (self.runs.len() / self.per_plane, self.length / places);
        // Who hands in memory without values relies on it.
        assert!(
            per_row * places == self.length && values.len() == planes * self.rows.left * per_row,
            "a value for each place"
        );
        let mut values = values.iter();
        for runs in self.runs.chunks_exact_mut(self.per_plane) {
            for [run, at] in self.rows.clone() {
                let row = &mut runs[run][at..at + self.length];
                for (places, value) in row.chunks_exact_mut(places).zip(&mut values) {
                    places.iter_mut().for_each(|place| place.put(*value));
                }
            }
        }
    }

    /// Puts values into all rows, those of each plane after each other.
    pub(crate) fn put_all<V: Copy>(self, values: &[V])
    where
        T: Place<V>,
    {
        let Target { runs, per_plane, rows: Rows { counts, steps, here, .. }, length } = self;
        let positions = counts.iter().product::<usize>() * length;
        // Who hands in memory without values relies on it.
        assert_eq!(values.len(), runs.len() / per_plane * positions, "a value for each place");
        for (runs, values) in runs.chunks_exact_mut(per_plane).zip(values.chunks_exact(positions)) {
            let mut left = values;
            // In loops that need no memory of their own: what they stored would wait behind the values, which wait for memory.
            for i in 0..counts[0] {
                for j in 0..counts[1] {
                    let [run, at] = [0, 1].map(|s| here[s] + i * steps[0][s] + j * steps[1][s]);
                    let [next_run, next_at] = steps[2];
                    for k in 0..counts[2] {
                        let (values, rest) = left.split_at(length);
                        let row = &mut runs[run + k * next_run][at + k * next_at..][..length];
                        row.iter_mut().zip(values).for_each(|(place, value)| place.put(*value));
                        left = rest;
                    }
                }
            }
        }
    }
}
