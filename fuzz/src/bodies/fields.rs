//! The fields of each section (spec section 3), where they are and what they hold, to change one of them.

/// What a field holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A whole number of this many bytes.
    Whole(usize),
    /// Binary32 or binary64: this many bytes.
    Real(usize),
    /// Coded bytes or text.
    Bytes(usize),
}

/// A field: its first byte in the section.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Field {
    pub at: usize,
    pub kind: Kind,
}

impl Field {
    pub fn range(&self) -> std::ops::Range<usize> {
        let (Kind::Whole(n) | Kind::Real(n) | Kind::Bytes(n)) = self.kind;
        self.at..self.at + n
    }
}

/// Fields of a section in order, as far as its bytes reach.
struct Fields {
    length: usize,
    at: usize,
    found: Vec<Field>,
}

impl Fields {
    fn put(&mut self, kind: Kind) {
        let field = Field { at: self.at, kind };
        if field.range().end <= self.length {
            self.at = field.range().end;
            self.found.push(field);
        }
    }

    fn all(&mut self, times: usize, kinds: &[Kind]) {
        (0..times).for_each(|_| kinds.iter().for_each(|kind| self.put(*kind)));
    }

    fn rest(&mut self, but: usize) {
        if self.length > self.at + but {
            self.put(Kind::Bytes(self.length - self.at - but));
        }
    }
}

/// The fields of a section of a file with these numbers of axes, channels and blocks.
pub fn fields(id: &[u8], bytes: &[u8], axes: usize, channels: usize, blocks: usize) -> Vec<Field> {
    use Kind::{Bytes, Real, Whole};
    let mut list = Fields { length: bytes.len(), at: 0, found: Vec::new() };
    let byte = |at: usize| usize::from(bytes.get(at).copied().unwrap_or(0));
    match id {
        b"GRID" => {
            list.put(Whole(1));
            list.all(axes, &[Whole(1), Whole(1), Whole(2), Whole(4), Real(8), Real(8)]);
            list.put(Whole(2));
            for _ in 0..channels {
                list.all(1, &[Real(8), Real(8), Whole(1)]);
                list.put(Bytes(byte(list.at - 1)));
            }
        }
        b"CODE" => {
            list.all(8, &[Whole(1)]);
            list.all(1, &[Real(8), Real(8), Whole(8), Whole(4)]);
            list.all(channels, &[Real(4)]);
            list.all(if byte(3) == 1 { channels * channels } else { 0 }, &[Real(4)]);
            list.put(Real(4));
        }
        b"PART" => {
            list.all(axes, &[Whole(4)]);
            list.put(Whole(1));
            let shapes = 1 + byte(4 * axes);
            list.all(shapes * axes, &[Whole(4)]);
            list.all(bytes.len() - list.at, &[Whole(1)]);
        }
        b"PROB" => list.put(Whole(2)),
        b"GRAZ" => {
            list.all(4, &[Whole(1)]);
            list.all(2, &[Real(4)]);
            list.all(4 * channels, &[Whole(4)]);
        }
        b"INDX" | b"META" => list.put(Whole(4)),
        b"EXCT" => {
            list.put(Whole(4));
            list.all(channels, &[Whole(8)]);
            list.all(blocks, &[Whole(4)]);
            list.put(Whole(4));
        }
        b"SPAR" => {
            list.rest(12);
            list.all(2, &[Whole(4)]);
        }
        _ => (),
    }
    list.rest(0);
    list.found
}
