//! What becomes of damaged files: `cargo run --release --example damage -- [--cases N] [--seed S] FILE.csbrdf...`.
//!
//! Of each file N (20,000 if not given) random damages of each kind are made: a flipped bit, some flipped bits within 32, 1 to 64 bytes overwritten at
//! random or with zeros or ones, two places at once, a cut, bytes put in or taken out, two swapped pieces. The place is drawn by section first, so that
//! the small ones that matter most are hit as often as the large ones; the last bytes of INDX are a place of their own. Of the kind *forged*,
//! the damage in a section is made such that its checksum names one flipped bit, or four bytes, that were never there: damage that hits this
//! by chance is one in 2^32 / (8 n), so that each case stands for millions.
//!
//! Each case is salvaged and repaired. It is *restored* if nothing is said to be lost, *lost and said* if something is, *refused* if nothing is left or a
//! guess would have to be accepted; *wrong* if what is restored is not the file, a block that is not lost is not that of the file, or nobody notices
//! damage. There must be none.
#![allow(unsafe_code)] // an allocator that counts

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::ops::Range;
use std::time::{Duration, Instant};

use csbrdf::Limits;
use csbrdf::codec::sample::SplitMix64;
use csbrdf::decode::{PrunedPolicy, Reader};
use csbrdf::edit::salvage::{repair, salvage};
use rayon::prelude::*;

/// Counts what each thread holds.
struct Counting;

thread_local! {
    static HELD: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

fn count(bytes: isize) {
    // A thread that ends has no counters any more.
    let _ = HELD.try_with(|held| {
        held.set(held.get() + bytes);
        let _ = PEAK.try_with(|peak| peak.set(peak.get().max(held.get())));
    });
}

// SAFETY: hands everything to the system's allocator as it is; the counters have no destructor and do not allocate.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size() as isize);
        // SAFETY: the caller's duties are those of this call.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count(-(layout.size() as isize));
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Kinds of damage.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Kind {
    Flip,
    Burst,
    Random,
    Zeros,
    Ones,
    Two,
    Cut,
    Insert,
    Delete,
    Swap,
    Forged,
}

const KINDS: [(Kind, &str); 11] = [
    (Kind::Flip, "one bit flipped"),
    (Kind::Burst, "bits within 32 flipped"),
    (Kind::Random, "1 to 64 bytes at random"),
    (Kind::Zeros, "1 to 64 zeros"),
    (Kind::Ones, "1 to 64 bytes FF"),
    (Kind::Two, "two places, 1 to 8 bytes"),
    (Kind::Cut, "cut"),
    (Kind::Insert, "1 to 64 bytes put in"),
    (Kind::Delete, "1 to 64 bytes taken out"),
    (Kind::Swap, "two pieces swapped"),
    (Kind::Forged, "forged: a sum that names another change"),
];

/// Bytes at the end of INDX that are a place of their own.
const TAIL: usize = 16;

/// An intact file and what it decodes to.
struct Good {
    bytes: Vec<u8>,
    blocks: Vec<(Vec<f32>, Vec<bool>)>,
    /// Name and bytes.
    places: Vec<(String, Range<usize>)>,
}

impl Good {
    fn open(bytes: Vec<u8>) -> csbrdf::Result<Good> {
        let reader = Reader::open(bytes.clone())?.with_pruned(PrunedPolicy::Coarse);
        let blocks = (0..reader.block_count()).map(|block| block_of(&reader, block)).collect::<csbrdf::Result<_>>()?;
        let sections = reader.directory().sections();
        let mut places: Vec<(String, Range<usize>)> = sections.iter().map(|s| (s.name(), s.range.clone())).collect();
        places.retain(|(_, range)| !range.is_empty());
        places.push(("table".into(), 0..sections[0].range.start));
        let index = places.iter().find(|(name, _)| name == "INDX").map(|(_, range)| range.clone()).unwrap_or(0..0);
        places.push(("INDX, end".into(), index.end.saturating_sub(TAIL).max(index.start)..index.end));
        Ok(Good { bytes, blocks, places })
    }

    /// The damaged file, and where the damage is.
    fn damaged(&self, kind: Kind, random: &mut SplitMix64) -> (Vec<u8>, &str) {
        let mut bad = self.bytes.clone();
        let mut below = |n: usize| (random.next_u64() >> 11) as usize % n.max(1);
        let (place, range) = &self.places[below(self.places.len())];
        let at = range.start + below(range.len());
        let length = (1 + below(64)).min(bad.len() - at);
        match kind {
            Kind::Flip => bad[at] ^= 1 << below(8),
            Kind::Burst => {
                for byte in bad[at..].iter_mut().take(1 + below(4)) {
                    *byte ^= below(256) as u8;
                }
            }
            Kind::Random => bad[at..at + length].fill_with(|| below(256) as u8),
            Kind::Zeros => bad[at..at + length].fill(0),
            Kind::Ones => bad[at..at + length].fill(0xFF),
            Kind::Two => {
                let other = self.places[below(self.places.len())].1.clone();
                for at in [at, other.start + below(other.len())] {
                    let end = (at + 1 + below(8)).min(bad.len());
                    bad[at..end].fill_with(|| below(256) as u8);
                }
            }
            Kind::Cut => bad.truncate(at),
            Kind::Insert => drop(bad.splice(at..at, (0..length).map(|_| below(256) as u8))),
            Kind::Delete => drop(bad.drain(at..at + length)),
            Kind::Swap => {
                let other = below(bad.len());
                let length = length.min(at.abs_diff(other)).min(bad.len() - other);
                for i in 0..length {
                    bad.swap(at + i, other + i);
                }
            }
            Kind::Forged => forge(&mut bad, range.clone(), at, length.min(range.end - at), random),
        }
        (bad, place)
    }

    /// Salvages and repairs a damaged file.
    fn meet(&self, bad: &[u8]) -> Met {
        let mut met = Met::default();
        let (held, start) = (HELD.get(), Instant::now());
        PEAK.set(held);
        let salvaged = salvage(bad);
        let repaired = repair(bad, Limits::default());
        met.seconds = start.elapsed();
        met.peak = (PEAK.get() - held).max(0) as usize;
        let Ok(salvaged) = salvaged else {
            met.refused = true;
            met.wrong = repaired.is_ok() || Reader::open(bad).is_ok_and(|reader| reader.verify().is_empty());
            return met;
        };
        met.lost = salvaged.lost().len();
        met.restored = salvaged.is_whole();
        met.wrong = salvaged.damage().is_empty();
        let mut lost = vec![false; self.blocks.len()];
        salvaged.lost().iter().for_each(|&block| lost[block] = true);
        let is_right = |reader: &Reader<Vec<u8>>| {
            let mut left = (0..self.blocks.len()).filter(|&block| !lost[block]);
            left.all(|block| block_of(reader, block).is_ok_and(|found| found == self.blocks[block]))
        };
        met.wrong |= !is_right(salvaged.reader());
        // What drafts before 4 have lost cannot be repaired.
        if let Ok(repaired) = repaired {
            met.wrong |= salvaged.is_whole() != (repaired.bytes == self.bytes);
            let reader = Reader::open(repaired.bytes).map(|reader| reader.with_pruned(PrunedPolicy::Coarse));
            met.wrong |= !reader.is_ok_and(|reader| is_right(&reader));
        }
        met
    }
}

/// Damages bytes of a section such that its checksum names one flipped bit, or four bytes, elsewhere in it.
fn forge(bytes: &mut [u8], section: Range<usize>, at: usize, length: usize, random: &mut SplitMix64) {
    let good = bytes[section.clone()].to_vec();
    bytes[at..at + length].fill_with(|| random.next_u64() as u8);
    if section.len() < 8 {
        return;
    }
    // The sum that the section would have with one bit flipped.
    let mut flipped = good.clone();
    flipped[(random.next_u64() >> 11) as usize % good.len()] ^= 1 << (random.next_u64() % 8);
    let wanted = crc32fast::hash(&flipped);
    // Four bytes behind the damage, or before it, give that sum: the sum is linear in each of their bits.
    let near = at - section.start;
    let four = if near + length + 4 <= good.len() { near + length } else { near.saturating_sub(4).min(good.len() - 4) };
    let difference = crc32fast::hash(&bytes[section.clone()]) ^ wanted;
    let of_bit = |bit: usize| {
        let zeros = vec![0; good.len()];
        let mut one = zeros.clone();
        one[four + bit / 8] |= 1 << (bit % 8);
        crc32fast::hash(&zeros) ^ crc32fast::hash(&one)
    };
    let Some(change) = solve(std::array::from_fn(of_bit), difference) else { return };
    let four = section.start + four;
    bytes[four..four + 4].iter_mut().zip(change.to_le_bytes()).for_each(|(byte, change)| *byte ^= change);
}

/// Which of 32 words, combined by exclusive or, give another.
fn solve(words: [u32; 32], wanted: u32) -> Option<u32> {
    // Words with what they are made of, one for each leading bit.
    let mut basis = [(0u32, 0u32); 32];
    for (i, word) in words.into_iter().enumerate() {
        let (mut word, mut of) = (word, 1u32 << i);
        while word != 0 {
            let lead = 31 - word.leading_zeros() as usize;
            if basis[lead].0 == 0 {
                basis[lead] = (word, of);
                break;
            }
            (word, of) = (word ^ basis[lead].0, of ^ basis[lead].1);
        }
    }
    let (mut rest, mut made) = (wanted, 0);
    while rest != 0 {
        let (word, of) = basis[31 - rest.leading_zeros() as usize];
        if word == 0 {
            return None;
        }
        (rest, made) = (rest ^ word, made ^ of);
    }
    Some(made)
}

fn block_of<D: AsRef<[u8]>>(reader: &Reader<D>, block: usize) -> csbrdf::Result<(Vec<f32>, Vec<bool>)> {
    let mut values = vec![0.0; reader.block_values(block)?];
    reader.block_into(block, &mut values)?;
    Ok((values, reader.block_validity(block)?))
}

/// What became of a case.
#[derive(Default)]
struct Met {
    refused: bool,
    restored: bool,
    lost: usize,
    wrong: bool,
    seconds: Duration,
    peak: usize,
}

/// Sums over cases.
#[derive(Default)]
struct Row {
    tried: usize,
    restored: usize,
    lost_and_said: usize,
    refused: usize,
    wrong: usize,
    blocks: usize,
    most: usize,
    slowest: f64,
    peak: usize,
}

impl Row {
    fn add(&mut self, met: &Met) {
        self.tried += 1;
        self.restored += usize::from(met.restored);
        self.refused += usize::from(met.refused);
        self.lost_and_said += usize::from(!met.refused && !met.restored);
        self.wrong += usize::from(met.wrong);
        self.blocks += met.lost;
        self.most = self.most.max(met.lost);
        self.slowest = self.slowest.max(met.seconds.as_secs_f64() * 1e3);
        self.peak = self.peak.max(met.peak);
    }

    fn print(&self, kind: &str, place: &str) {
        let Row { tried, restored, lost_and_said, refused, wrong, blocks, most, slowest, peak } = self;
        let mean = *blocks as f64 / (tried - refused).max(1) as f64;
        println!(
            "| {kind} | {place} | {tried} | {restored} | {lost_and_said} | {refused} | {wrong} | {mean:.2} / {most} | {slowest:.0} | {} |",
            peak / 1000
        );
    }
}

fn sweep(name: &str, good: &Good, cases: usize, seed: u64) -> usize {
    println!("\n{name}: {} bytes, {} blocks, {cases} cases of each kind\n", good.bytes.len(), good.blocks.len());
    println!(
        "| damage | in | tried | restored | lost and said | refused | wrong | blocks lost: mean / max | slowest, ms | peak, kB |"
    );
    println!("|{}", " --- |".repeat(10));
    let mut all = Row::default();
    for (kind, label) in KINDS {
        let met: Vec<(String, Met)> = (0..cases)
            .into_par_iter()
            .filter_map(|case| {
                let mut random = SplitMix64(seed ^ (kind as u64) << 32 ^ case as u64);
                let (bad, place) = good.damaged(kind, &mut random);
                let met = (bad != good.bytes).then(|| good.meet(&bad))?;
                if met.wrong {
                    eprintln!("wrong: {label} in {place}, case {case}");
                }
                Some((place.to_string(), met))
            })
            .collect();
        let mut rows: BTreeMap<&str, Row> = BTreeMap::new();
        for (place, met) in &met {
            rows.entry(place).or_default().add(met);
            all.add(met);
        }
        rows.iter().for_each(|(place, row)| row.print(label, place));
    }
    all.print("all", "");
    all.wrong
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).peekable();
    let (mut cases, mut seed, mut wrong) = (20_000, 7, 0);
    while let Some(option) = arguments.next_if(|a| a.starts_with("--")) {
        let value = arguments.next().ok_or(format!("{option} needs a number"))?;
        match &option[..] {
            "--cases" => cases = value.parse()?,
            "--seed" => seed = value.parse()?,
            other => return Err(format!("{other} is neither --cases nor --seed").into()),
        }
    }
    for path in arguments {
        wrong += sweep(&path, &Good::open(std::fs::read(&path)?)?, cases, seed);
    }
    if wrong > 0 {
        return Err(format!("{wrong} cases came out wrong").into());
    }
    Ok(())
}
