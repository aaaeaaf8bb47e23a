//! NumPy's broadcasting of two arrays of directions against each other.

/// Walks two arrays of rows, each repeated to a common shape, in the order of that shape.
#[derive(Debug)]
pub struct Broadcast {
    shape: Vec<usize>,
    /// Rows from one index of an axis to the next, 0 where an array repeats its row.
    strides: [Vec<usize>; 2],
    /// Where the walk is.
    at: Vec<usize>,
    rows: [usize; 2],
}

impl Broadcast {
    /// The walk over arrays of these shapes (without the axis of a row's values); `None` if they do not go together or the
    /// common shape has more rows than can be counted.
    pub fn new(shapes: [&[usize]; 2]) -> Option<Broadcast> {
        let axes = shapes[0].len().max(shapes[1].len());
        let padded = shapes.map(|shape| [vec![1; axes - shape.len()], shape.to_vec()].concat());
        let shape: Option<Vec<usize>> = padded[0]
            .iter()
            .zip(&padded[1])
            .map(|(&a, &b)| if a == b || b == 1 { Some(a) } else { Some(b).filter(|_| a == 1) })
            .collect();
        let shape = shape?;
        shape.iter().try_fold(1usize, |n, &length| n.checked_mul(length))?;
        let strides = padded.map(|padded| {
            let mut stride = 1;
            let mut strides: Vec<usize> = padded
                .iter()
                .rev()
                .map(|&length| {
                    let this = if length == 1 { 0 } else { stride };
                    stride *= length;
                    this
                })
                .collect();
            strides.reverse();
            strides
        });
        Some(Broadcast { at: vec![0; axes], shape, strides, rows: [0; 2] })
    }

    /// The common shape.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }
}

impl Iterator for Broadcast {
    type Item = [usize; 2];

    /// The next row of each; it starts anew after the last.
    fn next(&mut self) -> Option<[usize; 2]> {
        let rows = self.rows;
        for axis in (0..self.shape.len()).rev() {
            self.at[axis] += 1;
            let wraps = self.at[axis] >= self.shape[axis];
            for (row, strides) in self.rows.iter_mut().zip(&self.strides) {
                *row = if wraps { *row - (self.at[axis] - 1) * strides[axis] } else { *row + strides[axis] };
            }
            if !wraps {
                break;
            }
            self.at[axis] = 0;
        }
        Some(rows)
    }
}
