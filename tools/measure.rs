//! Measures the decoder on files: `cargo run --release --example measure -- FILE.csbrdf...`
//!
//! Per file, in one run: the time to map and open it; open and one random block, nothing shared between repetitions
//! but the page cache; one random block warm, into a buffer that is kept, per decoded value; the whole table to float32 on one thread and on all, beside
//! reading a MERL file of that size from the page cache and converting it to float32, in turn, with the medians of each turn's ratios, and what
//! arithmetic that touches no memory gains from all threads in the same turns: processors that share a core, or heat, are not two; `Brdf::eval` for random directions with
//! a cache that holds every block and with one of a tenth of the table, beside the same look-up in the table as float32 in memory.
//! Medians, with 10 % and 90 % quantiles for the cold block; beside two of them the least, on a machine that others slow down.

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use csbrdf::BrdfOptions;
use csbrdf::codec::sample::SplitMix64;
use csbrdf::decode::{Reader, Scratch};

mod raw;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let files: Vec<String> = std::env::args().skip(1).collect();
    if files.is_empty() {
        return Err("usage: measure FILE.csbrdf...".into());
    }
    println!(
        "| file | kB | open, us (least) | open + one block, us (10 %, 90 %) | block warm, ns/value (least) | decode 1 thread, ms | all threads, ms | read and convert raw, ms | 1 thread / raw | 1 thread / all (of arithmetic) | eval, ns | eval_many, ns | eval, cache of 10 %, ns | raw look-up, ns |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |");
    for file in &files {
        measure(Path::new(file))?;
    }
    Ok(())
}

/// Seconds of each of `n` calls, ascending.
fn times(n: usize, mut call: impl FnMut(usize) -> Result<(), Failure>) -> Result<Vec<f64>, Failure> {
    let mut seconds = Vec::with_capacity(n);
    for i in 0..n {
        let start = Instant::now();
        call(i)?;
        seconds.push(start.elapsed().as_secs_f64());
    }
    seconds.sort_by(f64::total_cmp);
    Ok(seconds)
}

fn quantile(sorted: &[f64], q: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * q).round() as usize]
}

/// Medians of a whole table's turns, seconds and ratios.
struct Whole {
    single: f64,
    all: f64,
    raw: f64,
    of_raw: f64,
    gain: f64,
    gain_of_arithmetic: f64,
}

fn whole(reader: &Reader<impl AsRef<[u8]> + Sync>) -> Result<Whole, Failure> {
    let raw_file = tempfile::NamedTempFile::new()?;
    raw::write(raw_file.path(), reader.grid().positions() * reader.grid().channels().len())?;
    let pool = |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).start_handler(stay).build();
    let (one, all) = (pool(1)?, pool(std::thread::available_parallelism()?.get())?);
    let mut turns: [Vec<f64>; 6] = Default::default();
    for _ in 0..21 {
        let decode = |pool: &rayon::ThreadPool| {
            times(1, |_| {
                black_box(pool.install(|| reader.decode_all())?);
                Ok(())
            })
        };
        let calculate = |pool: &rayon::ThreadPool| {
            times(1, |_| {
                pool.install(arithmetic);
                Ok(())
            })
        };
        // Each pool decodes when it is awake: a processor that nobody used for a while comes back milliseconds late on some machines.
        let (slow, single) = (calculate(&one)?[0], decode(&one)?[0]);
        let (fast, parallel) = (calculate(&all)?[0], decode(&all)?[0]);
        let raw = times(1, |_| {
            black_box(raw::read(raw_file.path())?);
            Ok(())
        })?[0];
        let turn = [single, parallel, raw, single / raw, single / parallel, slow / fast];
        turns.iter_mut().zip(turn).for_each(|(all, one)| all.push(one));
    }
    let [single, all, raw, of_raw, gain, gain_of_arithmetic] = turns.map(|mut turns| {
        turns.sort_by(f64::total_cmp);
        quantile(&turns, 0.5)
    });
    Ok(Whole { single, all, raw, of_raw, gain, gain_of_arithmetic })
}

/// Keeps a thread on a processor of its own: for the milliseconds of a decode the system may leave two on the one where they woke up.
#[cfg(target_os = "linux")]
fn stay(thread: usize) {
    use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
    let Ok(allowed) = sched_getaffinity(None) else { return };
    let Some(processor) = (0..CpuSet::MAX_CPU).filter(|cpu| allowed.is_set(*cpu)).nth(thread) else { return };
    let mut one = CpuSet::new();
    one.set(processor);
    // Where it may not, the system goes on to choose.
    let _ = sched_setaffinity(None, &one);
}

#[cfg(not(target_os = "linux"))]
fn stay(_: usize) {}

/// Multiplications and additions in registers, as many at a time as a processor has room for, for some milliseconds.
fn arithmetic() {
    use rayon::prelude::*;
    let chains = |seed: usize| {
        let mut x: [f32; 32] = std::array::from_fn(|i| (seed + i) as f32);
        for _ in 0..20_000 {
            x.iter_mut().for_each(|x| *x = *x * 0.999 + 0.5);
        }
        x.iter().sum::<f32>()
    };
    black_box((0..64usize).into_par_iter().with_max_len(1).map(chains).sum::<f32>());
}

fn measure(path: &Path) -> Result<(), Failure> {
    let mut random = SplitMix64(1);
    let reader = Reader::open_path(path)?;
    let blocks = reader.block_count();
    let open = times(200, |_| {
        black_box(Reader::open_path(path)?);
        Ok(())
    })?;
    let cold = times(200, |_| {
        let reader = Reader::open_path(path)?;
        let block = random.next_u64() as usize % blocks;
        let mut values = vec![0.0; reader.block_values(block)?];
        reader.block_into(block, &mut values)?;
        black_box(values);
        Ok(())
    })?;

    let largest = (0..blocks).map(|block| reader.block_values(block)).try_fold(0, |most, n| n.map(|n| most.max(n)))?;
    let (mut scratch, mut values) = (Scratch::default(), vec![0.0; largest]);
    let mut decoded = 0;
    let warm = times(10, |_| {
        for _ in 0..blocks {
            let block = random.next_u64() as usize % blocks;
            let values = &mut values[..reader.block_values(block)?];
            reader.block_with(block, &mut scratch, black_box(&mut *values))?;
            decoded += values.len();
        }
        Ok(())
    })?;
    let per_value = |seconds: f64| seconds / (decoded as f64 / 10.0) * 1e9;

    let whole = whole(&reader)?;

    let (wi, wo) = raw::directions(100_000, &mut random);
    let table = reader.decode_all()?;
    let bytes = 4 * table.len();
    let grid = reader.grid();
    let channels = grid.channels().len();
    let mut value = vec![0.0; channels];
    let mut eval = |cache: usize, pairs: usize| -> Result<f64, Failure> {
        let brdf = BrdfOptions::new().cache_bytes(cache).open(path)?;
        let seconds = times(5, |_| {
            for (wi, wo) in wi.iter().zip(&wo).take(pairs) {
                brdf.eval_into(*wi, *wo, &mut value)?;
                black_box(&value);
            }
            Ok(())
        })?;
        Ok(quantile(&seconds, 0.5) / pairs as f64)
    };
    // Most of them decode a block.
    let (warm_eval, tight_eval) = (eval(usize::MAX, wi.len())?, eval(bytes / 10, 500)?);
    let many_eval = {
        let brdf = BrdfOptions::new().cache_bytes(usize::MAX).open(path)?;
        let mut values = vec![0.0; wi.len() * channels];
        let seconds = times(5, |_| Ok(brdf.eval_many(&wi, &wo, black_box(&mut values))?))?;
        quantile(&seconds, 0.5) / wi.len() as f64
    };
    let map = csbrdf::Parameterization::of(grid)?;
    let raw_eval = times(5, |_| {
        for (wi, wo) in wi.iter().zip(&wo) {
            raw::look_up((grid, &map), &table, *wi, *wo, &mut value);
            black_box(&value);
        }
        Ok(())
    })?;

    println!(
        "| {} | {:.1} | {:.0} ({:.0}) | {:.0} ({:.0}, {:.0}) | {:.1} ({:.1}) | {:.1} | {:.1} | {:.1} | {:.2} | {:.2} ({:.2}) | {:.0} | {:.0} | {:.0} | {:.0} |",
        path.file_name().unwrap_or_default().to_string_lossy(),
        std::fs::metadata(path)?.len() as f64 / 1e3,
        quantile(&open, 0.5) * 1e6,
        open[0] * 1e6,
        quantile(&cold, 0.5) * 1e6,
        quantile(&cold, 0.1) * 1e6,
        quantile(&cold, 0.9) * 1e6,
        per_value(quantile(&warm, 0.5)),
        per_value(warm[0]),
        whole.single * 1e3,
        whole.all * 1e3,
        whole.raw * 1e3,
        whole.of_raw,
        whole.gain,
        whole.gain_of_arithmetic,
        warm_eval * 1e9,
        many_eval * 1e9,
        tight_eval * 1e9,
        quantile(&raw_eval, 0.5) / wi.len() as f64 * 1e9,
    );
    Ok(())
}
