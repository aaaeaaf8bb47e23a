//! The decoder under criterion, beside what a renderer does with the raw table: `cargo bench` in this folder.
//!
//! Of a synthetic material on MERL's grid, with noise and holes; of real ones, where given by name:
//! `CSBRDF_FILES="/PATH/a.csbrdf /PATH/b.csbrdf" cargo bench`. The table of `examples/measure` has the same in one line a file.

use std::hint::black_box;

use criterion::{BenchmarkGroup, Criterion, Throughput, measurement::WallTime};
use csbrdf::BrdfOptions;
use csbrdf::codec::sample::SplitMix64;
use csbrdf::decode::{Reader, Scratch};
use csbrdf::encode::Encoder;
use csbrdf::table::grid::Grid;
use csbrdf::table::synth::Recipe;

#[path = "../raw/mod.rs"]
mod raw;

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let mut criterion = Criterion::default().sample_size(20).configure_from_args();
    let files = std::env::var("CSBRDF_FILES").unwrap_or_default();
    if files.trim().is_empty() {
        let recipe = Recipe::named("satin-paint").ok_or("no such recipe")?;
        let recipe = Recipe { noise: 0.02, holes: 0.02, ..recipe };
        let bytes = Encoder::new().encode(&recipe.synthesise(&Grid::merl())?)?.bytes;
        let file = tempfile::Builder::new().prefix("synthetic-").suffix(".csbrdf").tempfile()?;
        std::fs::write(file.path(), bytes)?;
        bench(&mut criterion, "synthetic", file.path())?;
    }
    for file in files.split_whitespace() {
        bench(&mut criterion, file.rsplit('/').next().unwrap_or(file), file.as_ref())?;
    }
    criterion.final_summary();
    Ok(())
}

fn bench(criterion: &mut Criterion, name: &str, path: &std::path::Path) -> Result<(), Failure> {
    let mut group = criterion.benchmark_group(name);
    let reader = Reader::open_path(path)?;
    let mut table = reader.decode_all()?;
    group.bench_function("open", |b| b.iter(|| Reader::open_path(path)));
    blocks(&mut group, &reader)?;
    whole(&mut group, &reader, &mut table)?;
    look_ups(&mut group, path, &table)?;
    group.finish();
    Ok(())
}

/// Blocks at random, the scratch kept; time over values.
fn blocks(group: &mut BenchmarkGroup<WallTime>, reader: &Reader<impl AsRef<[u8]>>) -> Result<(), Failure> {
    let blocks = reader.block_count();
    let sizes = (0..blocks).map(|block| reader.block_values(block)).collect::<Result<Vec<_>, _>>()?;
    let mut values = vec![0.0; sizes.iter().max().copied().unwrap_or(0)];
    let (mut random, mut scratch) = (SplitMix64(1), Scratch::default());
    group.throughput(Throughput::Elements((sizes.iter().sum::<usize>() / blocks) as u64));
    group.bench_function("block, warm", |b| {
        b.iter(|| {
            let block = random.next_u64() as usize % blocks;
            let values = &mut values[..sizes[block]];
            reader.block_with(block, &mut scratch, black_box(values))
        });
    });
    Ok(())
}

/// The whole table into a buffer that is there, on one thread and on two, beside the raw one.
fn whole(
    group: &mut BenchmarkGroup<WallTime>,
    reader: &Reader<impl AsRef<[u8]> + Sync>,
    table: &mut [f32],
) -> Result<(), Failure> {
    group.throughput(Throughput::Elements(table.len() as u64));
    for threads in [1, 2] {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        group.bench_function(format!("table, threads: {threads}"), |b| {
            b.iter(|| pool.install(|| reader.decode_all_into(black_box(table))));
        });
    }
    let raw_file = tempfile::NamedTempFile::new()?;
    raw::write(raw_file.path(), table.len())?;
    group.bench_function("raw table, read and converted", |b| b.iter(|| raw::read(raw_file.path())));
    Ok(())
}

/// Directions at random, with every block in the cache.
fn look_ups(group: &mut BenchmarkGroup<WallTime>, path: &std::path::Path, table: &[f32]) -> Result<(), Failure> {
    const PAIRS: usize = 10_000;
    let brdf = BrdfOptions::new().cache_bytes(usize::MAX).open(path)?;
    let grid = brdf.reader().grid();
    let (wi, wo) = raw::directions(PAIRS, &mut SplitMix64(1));
    let mut value = vec![0.0; grid.channels().len()];
    let mut values = vec![0.0; PAIRS * value.len()];
    brdf.eval_many(&wi, &wo, &mut values)?;
    group.throughput(Throughput::Elements(PAIRS as u64));
    group.bench_function("eval", |b| {
        b.iter(|| wi.iter().zip(&wo).try_for_each(|(wi, wo)| brdf.eval_into(*wi, *wo, black_box(&mut value))));
    });
    group.bench_function("eval_many", |b| b.iter(|| brdf.eval_many(&wi, &wo, black_box(&mut values))));
    let map = csbrdf::Parameterization::of(grid)?;
    group.bench_function("raw look-up", |b| {
        b.iter(|| wi.iter().zip(&wo).for_each(|(wi, wo)| raw::look_up((grid, &map), table, *wi, *wo, black_box(&mut value))));
    });
    Ok(())
}
