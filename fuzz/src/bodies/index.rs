//! The index section read and written anew (spec sections 3.6, 4.7), written from the spec: what changes a record's length has its index
//! say so.

/// What the index says of a block.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    pub length: u32,
    /// Codes of the rms error and of the largest error.
    pub errors: [u8; 2],
    pub means: Vec<i32>,
}

/// Contexts of a number: bits in unary, then the bit after the leading one.
const NUMBER: usize = 65;
const SETS: usize = 15;

/// The entries of blocks of these positions, from the section's coded bytes.
pub fn read(coded: &[u8], positions: &[usize], components: usize) -> Vec<Entry> {
    let blank = Entry { length: 0, errors: [0; 2], means: vec![0; components] };
    let mut entries = vec![blank; positions.len()];
    walk(&mut Coder::reading(coded), positions, &mut entries);
    entries
}

/// The section.
pub fn write(positions: &[usize], entries: &[Entry]) -> Vec<u8> {
    let mut coder = Coder::writing();
    walk(&mut coder, positions, &mut entries.to_vec());
    [&(entries.len() as u32).to_le_bytes()[..], &coder.finish()].concat()
}

/// Codes all entries; a reader overwrites them.
fn walk(coder: &mut Coder, positions: &[usize], entries: &mut [Entry]) {
    let components = entries.first().map_or(0, |entry| entry.means.len());
    let (mut before, mut n) = (Entry { length: 0, errors: [0; 2], means: vec![0; components] }, 1);
    let mut residuals = vec![0; components];
    for (entry, &positions) in entries.iter_mut().zip(positions) {
        let set = (bits(before.length).saturating_sub(3) / 2).min(3) as usize;
        entry.length = coder.number(set, entry.length);
        let [rms, largest] = before.errors;
        entry.errors[0] = rms.wrapping_add(coder.signed(4, i32::from(entry.errors[0].wrapping_sub(rms) as i8)) as u8);
        let over = largest.wrapping_sub(rms);
        let change = entry.errors[1].wrapping_sub(entry.errors[0]).wrapping_sub(over) as i8;
        let change = coder.signed(5, i32::from(change)) as u8;
        entry.errors[1] = entry.errors[0].wrapping_add(over).wrapping_add(change);
        let ratio = (positions as f64 / n as f64).sqrt();
        for (component, mean) in entry.means.iter_mut().enumerate() {
            // To an i32: saturates.
            let predicted = (f64::from(before.means[component]) * ratio).round() as i32;
            let set = 6 + 3 * component.min(2) + (residuals[component] / 4).min(2) as usize;
            let (change, coded) = coder.signed_and_bits(set, mean.wrapping_sub(predicted));
            residuals[component] = coded;
            *mean = predicted.wrapping_add(change);
        }
        (before, n) = (entry.clone(), positions);
    }
}

fn bits(value: u32) -> u32 {
    u32::BITS - value.leading_zeros()
}

/// The range coder in both directions.
struct Coder<'a> {
    states: Vec<[u16; 2]>,
    /// What is read; `None` to write.
    input: Option<&'a [u8]>,
    at: usize,
    range: u32,
    code: u32,
    low: u64,
    out: Vec<u8>,
}

impl<'a> Coder<'a> {
    fn writing() -> Coder<'a> {
        let states = vec![[1 << 15; 2]; SETS * NUMBER];
        Coder { states, input: None, at: 0, range: u32::MAX, code: 0, low: 0, out: Vec::new() }
    }

    fn reading(input: &'a [u8]) -> Coder<'a> {
        let mut coder = Coder { input: Some(input), ..Coder::writing() };
        (0..4).for_each(|_| coder.next());
        coder
    }

    fn next(&mut self) {
        let byte = self.input.and_then(|input| input.get(self.at)).copied().unwrap_or(0);
        (self.code, self.at) = (self.code << 8 | u32::from(byte), self.at + 1);
    }

    /// A decision with the part of the range that a one has.
    fn split(&mut self, bound: u32, bit: bool) -> bool {
        let bit = if self.input.is_some() { self.code < bound } else { bit };
        if bit {
            self.range = bound;
        } else {
            (self.code, self.low) = (self.code.wrapping_sub(bound), self.low + u64::from(bound));
            self.range -= bound;
        }
        while self.range < 1 << 24 {
            self.range <<= 8;
            if self.input.is_some() { self.next() } else { self.shift() }
        }
        bit
    }

    fn bit(&mut self, context: usize, bit: bool) -> bool {
        let [fast, slow] = self.states[context].map(u64::from);
        let p = ((fast + slow) >> 1).max(1);
        let bit = self.split(((u64::from(self.range) * p) >> 16) as u32, bit);
        let moved = |x: u16, by: u32| if bit { x + ((65535 - x) >> by) } else { x - (x >> by) };
        let [fast, slow] = self.states[context];
        self.states[context] = [moved(fast, 4), moved(slow, 7)];
        bit
    }

    /// A decision whose halves are as large.
    fn raw(&mut self, bit: bool) -> bool {
        self.range &= !1;
        self.split(self.range >> 1, bit)
    }

    /// The top byte of what was written, and a carry into those before.
    fn shift(&mut self) {
        if self.low >> 32 != 0 {
            let last = self.out.iter().rposition(|byte| *byte != 0xFF).expect("a number below one");
            self.out[last] += 1;
            self.out[last + 1..].fill(0);
        }
        self.out.push((self.low >> 24) as u8);
        self.low = (self.low & 0x00FF_FFFF) << 8;
    }

    fn finish(mut self) -> Vec<u8> {
        (0..4).for_each(|_| self.shift());
        let used = self.out.iter().rposition(|byte| *byte != 0).map_or(0, |last| last + 1);
        self.out.truncate(used);
        self.out
    }

    fn number(&mut self, set: usize, value: u32) -> u32 {
        let (first, wanted) = (set * NUMBER, bits(value));
        let mut b = 0;
        while b < 32 && self.bit(first + b as usize, b < wanted) {
            b += 1;
        }
        if b < 2 {
            return b;
        }
        let mut found = 1;
        for place in (0..b - 1).rev() {
            let bit = value >> place & 1 == 1;
            let bit = if place == b - 2 { self.bit(first + 32 + b as usize, bit) } else { self.raw(bit) };
            found = found << 1 | u32::from(bit);
        }
        found
    }

    /// A signed number, and the bits of the number that stands for it.
    fn signed_and_bits(&mut self, set: usize, value: i32) -> (i32, u32) {
        let coded = self.number(set, (value << 1 ^ value >> 31) as u32);
        ((coded >> 1) as i32 ^ -((coded & 1) as i32), bits(coded))
    }

    fn signed(&mut self, set: usize, value: i32) -> i32 {
        self.signed_and_bits(set, value).0
    }
}
