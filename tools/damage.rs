//! What becomes of damaged files: `cargo run --release --example damage -- [--random N] FILE.csbrdf...`.
//!
//! Of each file: every flip of a bit outside RECS and EXCT and N (100,000 if not told) random ones in them, every cut, every pair of swapped
//! pieces of 64 bytes, every zeroed page of 64, 512 and 4,096 bytes; no more than N random ones of a kind where there are more. Each case is
//! opened, the checksums of the sections are checked as `verify` does, and the blocks that the damage touches are decoded. Damage that
//! none of this notices counts as harmless if the whole table comes out the same, else as undetected. Then it is salvaged; in one case
//! of 16 a block of those left is compared bit by bit with that of the intact file, in one of 1,024 all are.
#![allow(unsafe_code)] // an allocator that counts

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::BTreeSet;
use std::ops::Range;
use std::time::{Duration, Instant};

use csbrdf::decode::{Pruned, Reader};
use csbrdf::salvage::salvage;
use csbrdf::sample::SplitMix64;
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

/// One kind of damage in one place.
#[derive(Clone, Copy)]
enum Case {
    Flip(usize),
    Cut(usize),
    Swap(usize, usize, usize),
    Zero(usize, usize),
}

impl Case {
    /// The damaged file and the bytes that changed.
    fn apply(self, good: &[u8]) -> (Vec<u8>, [Range<usize>; 2]) {
        let mut bad = good.to_vec();
        let changed = match self {
            Case::Flip(bit) => {
                bad[bit / 8] ^= 1 << (bit % 8);
                [bit / 8..bit / 8 + 1, 0..0]
            }
            Case::Cut(length) => {
                bad.truncate(length);
                [length..good.len(), 0..0]
            }
            Case::Swap(a, b, size) => {
                let (a, b) = (a..a + size, b..b + size);
                bad[a.clone()].copy_from_slice(&good[b.clone()]);
                bad[b.clone()].copy_from_slice(&good[a.clone()]);
                [a, b]
            }
            Case::Zero(at, size) => {
                let range = at..(at + size).min(good.len());
                bad[range.clone()].fill(0);
                [range, 0..0]
            }
        };
        (bad, changed)
    }
}

/// An intact file and what it decodes to.
struct Good {
    bytes: Vec<u8>,
    reader: Reader<Vec<u8>>,
    blocks: Vec<Vec<f32>>,
    records: Vec<Range<usize>>,
}

impl Good {
    fn open(bytes: Vec<u8>) -> csbrdf::Result<Good> {
        let reader = Reader::open(bytes.clone())?.with_pruned(Pruned::Coarse);
        let blocks = (0..reader.block_count()).map(|block| values(&reader, block)).collect::<csbrdf::Result<_>>()?;
        let records =
            (0..reader.block_count()).map(|b| Ok(reader.block_info(b)?.record)).collect::<csbrdf::Result<_>>()?;
        Ok(Good { bytes, reader, blocks, records })
    }

    fn is_same<D: AsRef<[u8]>>(&self, reader: &Reader<D>, block: usize) -> bool {
        let bits = |v: &Vec<f32>| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        values(reader, block).is_ok_and(|got| bits(&got) == bits(&self.blocks[block]))
            && reader.block_validity(block).ok() == self.reader.block_validity(block).ok()
    }

    /// Opens, checks, decodes and salvages a damaged file.
    fn meet(&self, number: usize, case: Case) -> Met {
        let (bad, changed) = case.apply(&self.bytes);
        let mut met = Met { same: bad == self.bytes, ..Met::default() };
        if met.same {
            return met;
        }
        let held = HELD.get();
        PEAK.set(held);
        let start = Instant::now();
        match Reader::open(&bad[..]) {
            Err(_) => met.at_open = true,
            Ok(reader) => {
                let wrong = |s: &&csbrdf::format::directory::Section| crc32fast::hash(&bad[s.range.clone()]) != s.crc;
                met.at_verify = reader.directory().sections().iter().find(wrong).is_some();
                for range in &changed {
                    let first = self.records.partition_point(|record| record.end <= range.start);
                    let touched = self.records[first..].iter().take_while(|record| record.start < range.end);
                    met.at_decode |= (first..).zip(touched).any(|(block, _)| values(&reader, block).is_err());
                }
                if !met.at_verify && !met.at_decode {
                    let all = 0..reader.block_count();
                    met.harmless = reader.verify().is_empty() && all.into_iter().all(|b| self.is_same(&reader, b));
                }
            }
        }
        let salvaged = salvage(&bad);
        met.seconds = start.elapsed();
        met.peak = (PEAK.get() - held).max(0) as usize;
        match salvaged {
            Err(_) => met.nothing_left = true,
            Ok(salvaged) => {
                assert!(!salvaged.damage().is_empty(), "salvage found nothing");
                met.lost = salvaged.lost().len();
                let lost: BTreeSet<usize> = salvaged.lost().iter().copied().collect();
                let left: Vec<usize> = (0..self.blocks.len()).filter(|block| !lost.contains(block)).collect();
                if !left.is_empty() && number.is_multiple_of(16) {
                    let some = if number.is_multiple_of(1024) { &left[..] } else { &[left[number / 16 % left.len()]] };
                    met.wrong = some.iter().any(|&block| !self.is_same(salvaged.reader(), block));
                }
            }
        }
        met
    }
}

fn values<D: AsRef<[u8]>>(reader: &Reader<D>, block: usize) -> csbrdf::Result<Vec<f32>> {
    let mut values = vec![0.0; reader.block_values(block)?];
    reader.block_into(block, &mut values)?;
    Ok(values)
}

/// What became of a case.
#[derive(Default)]
struct Met {
    same: bool,
    at_open: bool,
    at_verify: bool,
    at_decode: bool,
    harmless: bool,
    nothing_left: bool,
    lost: usize,
    wrong: bool,
    seconds: Duration,
    peak: usize,
}

fn row(name: &str, good: &Good, cases: &[Case]) {
    let all: Vec<Met> =
        cases.par_iter().enumerate().map(|(i, case)| good.meet(i, *case)).filter(|met| !met.same).collect();
    let count = |f: &dyn Fn(&Met) -> bool| all.iter().filter(|met| f(met)).count();
    let salvaged = count(&|m| !m.nothing_left);
    let lost: usize = all.iter().map(|m| m.lost).sum();
    println!(
        "| {name} | {} | {} | {} | {} | {} | {} | {} | {} | {:.2} / {} | {} | {:.0} | {:.0} |",
        all.len(),
        count(&|m| m.at_open),
        count(&|m| !m.at_open && m.at_verify),
        count(&|m| m.at_decode),
        count(&|m| m.harmless),
        count(&|m| !m.at_open && !m.at_verify && !m.at_decode && !m.harmless),
        count(&|m| m.nothing_left),
        count(&|m| !m.nothing_left && m.lost == 0),
        lost as f64 / salvaged.max(1) as f64,
        all.iter().map(|m| m.lost).max().unwrap_or(0),
        count(&|m| m.wrong),
        all.iter().map(|m| m.seconds.as_secs_f64() * 1e3).fold(0.0, f64::max),
        all.iter().map(|m| m.peak as f64 / 1e3).fold(0.0, f64::max),
    );
}

/// All cases, or so many random ones.
fn some(all: usize, most: usize, case: impl Fn(usize) -> Case) -> Vec<Case> {
    let mut random = SplitMix64(7);
    let mut pick = |i: usize| if all > most { random.next_u64() as usize % all } else { i };
    (0..all.min(most)).map(|i| case(pick(i))).collect()
}

fn sweep(name: &str, good: &Good, random: usize) {
    let (length, sections) = (good.bytes.len(), good.reader.directory().sections());
    println!("\n{name}: {length} bytes, {} blocks\n", good.blocks.len());
    println!(
        "| damage | cases | detected at open | by verify | by decode | harmless | undetected | nothing left | all left | blocks lost: mean / max | \
         wrong values | slowest, ms | peak, kB |"
    );
    println!("|{}", " --- |".repeat(13));
    let is_payload =
        |byte: usize| sections.iter().any(|s| ["RECS", "EXCT"].contains(&&s.name()[..]) && s.range.contains(&byte));
    let (payload, head): (Vec<usize>, Vec<usize>) = (0..length).partition(|&byte| is_payload(byte));
    let flips: Vec<Case> = head.iter().flat_map(|&byte| (0..8).map(move |bit| Case::Flip(8 * byte + bit))).collect();
    row("flip, header to index", good, &flips);
    row("flip, payload", good, &some(8 * payload.len(), random, |bit| Case::Flip(8 * payload[bit / 8] + bit % 8)));
    row("cut", good, &some(length, random, Case::Cut));
    let pieces = length / 64;
    let pair = |n: usize| Case::Swap(n / pieces * 64, n % pieces * 64, 64);
    let pairs: Vec<usize> = match pieces * pieces / 2 <= random {
        true => (0..pieces * pieces).filter(|n| n / pieces < n % pieces).collect(),
        false => (0..pieces * pieces).collect(),
    };
    row("swapped 64 bytes", good, &some(pairs.len(), random, |n| pair(pairs[n])));
    for size in [64, 512, 4096] {
        let cases = some(length.div_ceil(size), random, |page| Case::Zero(page * size, size));
        row(&format!("zeroed {size} bytes"), good, &cases);
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1).peekable();
    let mut random = 100_000;
    if arguments.next_if(|a| a == "--random").is_some() {
        random = arguments.next().ok_or("--random N")?.parse()?;
    }
    for path in arguments {
        sweep(&path, &Good::open(std::fs::read(&path)?)?, random);
    }
    Ok(())
}
