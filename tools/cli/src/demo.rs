//! `csbrdf demo`: the whole way on a synthetic material, with figures and a picture; needs no data.

mod board;

use std::fmt::Write;
use std::time::Instant;

use csbrdf::assess::metrics::compare;
use csbrdf::assess::render::{psnr, spheres_of_tables};
use csbrdf::decode::Reader;
use csbrdf::encode::Encoder;
use csbrdf::table::synth::Recipe;

use crate::args::DemoArgs;
use crate::failure::{Failure, Outcome};
use crate::guard::Guard;
use crate::output::{Target, print};
use crate::stdout::{self, print_as_is};
use crate::text::{clean, grouped};
use board::Board;

const MATERIAL: &str = "pearl";
const PICTURE: &str = "csbrdf-demo.png";

/// Pixels across each ball, and of the picture for one in the preview on the terminal.
const SIZE: usize = 256;
const SHRINK: usize = 10;

pub fn run(args: &DemoArgs) -> Outcome {
    let folder = args.out.clone().unwrap_or_else(std::env::temp_dir);
    std::fs::create_dir_all(&folder).map_err(|e| Failure::io(&folder, &e))?;
    let target = Target::File(folder.join(PICTURE));
    // What an earlier demo left among the temporary files may be replaced.
    let guard = Guard::new(args.force || args.out.is_none(), false);
    target.check(&guard)?;
    let failed = |e: csbrdf::Error| Failure::operation(format!("demo: {}", e.kind()));

    let recipe = Recipe::named(MATERIAL).ok_or_else(|| Failure::operation(format!("no material {MATERIAL}")))?;
    let recipe = Recipe { noise: 0.003, holes: 0.002, ..recipe };
    let table = recipe.merl().map_err(failed)?;
    let shape = table.grid().axes().iter().map(|a| a.len.to_string()).collect::<Vec<_>>().join(" x ");
    let source = 8 * table.values().len() + 12;
    print(&format!(
        "A synthetic material, \"{MATERIAL}\": {shape} bins x RGB, {} of {} entries missing or below the horizon.\n\n",
        grouped(table.values().len() - table.valid_count()),
        grouped(table.values().len())
    ))?;

    let start = Instant::now();
    let encoded = Encoder::new().encode(&table).map_err(failed)?;
    let encode = start.elapsed().as_secs_f64();
    let bytes = encoded.bytes;

    // Before anything else has read the file: what a renderer waits for.
    let start = Instant::now();
    let reader = Reader::open(&bytes[..]).map_err(failed)?;
    let block = reader.block_count() / 2;
    let mut values = vec![0.0; reader.block_values(block).map_err(failed)?];
    reader.block_into(block, &mut values).map_err(failed)?;
    let first_block = start.elapsed().as_secs_f64();

    let start = Instant::now();
    let all = reader.decode_all().map_err(failed)?;
    let decode = start.elapsed().as_secs_f64();
    drop(all);
    let decoded = reader.decode_table().map_err(failed)?;
    let (comparison, [original, seen]) =
        rayon::join(|| compare(&table, &decoded), || spheres_of_tables(&table, &decoded, SIZE));
    let comparison = comparison.map_err(failed)?;
    let quality = psnr(&original, &seen).map_err(failed)?;
    let ratio = format!("{:.0}:1", source as f64 / bytes.len() as f64);
    let sizes = [source, bytes.len()].map(|n| format!("{} bytes", grouped(n)));
    let captions = [[&*sizes[0], &*format!("{shape} x rgb")], [&*sizes[1], &*ratio]];
    let board = Board::new(&original, &seen, captions);

    let mut text = String::new();
    let mut row = |name: &str, value: String| {
        let _ = writeln!(text, "  {name:<34} {value:>14}");
    };
    row("MERL table, bytes", grouped(source));
    row("csbrdf file, bytes", grouped(bytes.len()));
    row("ratio", ratio);
    row("log error, rms", format!("{:.4}", comparison.overall.log_rms));
    row("log error, largest", format!("{:.4}", comparison.overall.log_max));
    row("render PSNR", format!("{quality:.1} dB"));
    row("encode", format!("{encode:.2} s"));
    row("decode, whole table", format!("{:.0} ms", 1e3 * decode));
    row("open and decode one block", format!("{:.2} ms", 1e3 * first_block));
    print(&text)?;

    board.whole.write(&target, &guard)?;
    let mut text = String::from("\nOriginal, decoded, and their difference in false colours:\n");
    if stdout::is_terminal() {
        text.push_str(&board.balls.shrunk(SHRINK).half_blocks());
    }
    let _ = write!(text, "  {}\n\n{}", clean(&target.to_string()), next_steps());
    print_as_is(&text)
}

/// What to try next, as it is called from where the demo was.
fn next_steps() -> String {
    // Cargo says so to what it runs.
    let tool = if std::env::var_os("CARGO").is_some() { "cargo run --release --" } else { "csbrdf" };
    let table = format!("{MATERIAL}.binary");
    let file = format!("{MATERIAL}.csbrdf");
    let steps = [
        (format!("synth {MATERIAL} -o {table}"), "a table; or take one of MERL's"),
        (format!("encode {table}"), &format!("-> {file}")),
        (format!("info {file}"), "what is in it"),
        (format!("eval {file} --angles 30,0,35,180"), "the BRDF of two directions, 1/sr"),
    ];
    let line = |(step, what): &(String, &str)| format!("  {tool} {step:<40} # {what}\n");
    format!("Next:\n{}", steps.iter().map(line).collect::<String>())
}
