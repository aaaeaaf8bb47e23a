//! `csbrdf demo`: the whole way on a synthetic material, with figures and a picture; needs no data.

use std::fmt::Write;
use std::time::Instant;

use csbrdf::assess::metrics::compare;
use csbrdf::assess::render::{psnr, sphere_of_table};
use csbrdf::brdf::eval::Brdf;
use csbrdf::decode::Reader;
use csbrdf::encode::Encoder;
use csbrdf::table::BrdfTable;
use csbrdf::table::synth::Recipe;

use crate::args::DemoArgs;
use crate::failure::{Failure, Outcome};
use crate::guard::Guard;
use crate::output::{Target, print};
use crate::picture::Picture;
use crate::stdout::{self, print_as_is};
use crate::text::{clean, grouped};

const MATERIAL: &str = "pearl";
const PICTURE: &str = "csbrdf-demo.png";

/// Pixels across each sphere: in the file, and in the preview on the terminal.
const SIZE: usize = 128;
const PREVIEW: usize = 26;

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
        "A synthetic material, \"{MATERIAL}\": {shape} bins x RGB, {} MB as a MERL file;\n\
         noise 0.003, {} of {} entries missing or below the horizon.\n\n",
        source / 1_000_000,
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
    let comparison = compare(&table, &decoded).map_err(failed)?;
    let (quality, picture) = pictures(&table, &decoded, SIZE).map_err(failed)?;

    let mut text = String::new();
    let mut row = |name: &str, value: String| {
        let _ = writeln!(text, "  {name:<34} {value:>14}");
    };
    row("MERL table, bytes", grouped(source));
    row("csbrdf file, bytes", grouped(bytes.len()));
    row("ratio", format!("{:.0}:1", source as f64 / bytes.len() as f64));
    row("log error, rms", format!("{:.4}", comparison.overall.log_rms));
    row("log error, largest", format!("{:.4}", comparison.overall.log_max));
    row("render PSNR", format!("{quality:.1} dB"));
    row("encode", format!("{encode:.2} s"));
    row("decode, whole table", format!("{:.0} ms", 1e3 * decode));
    row("open and decode one block", format!("{:.2} ms", 1e3 * first_block));
    let brdf = Brdf::open(reader).map_err(failed)?;
    let _ = writeln!(text, "\n  {:<34} {:>9} {:>9} {:>9}", "BRDF in 1/sr, light at -45 degrees", "R", "G", "B");
    for degrees in [15.0f64, 45.0, 75.0] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let side = std::f64::consts::FRAC_1_SQRT_2;
        let [r, g, b] = brdf.eval([-side, 0.0, side], [sin, 0.0, cos]).map_err(failed)?;
        let name = format!("view at {degrees} degrees");
        let _ = writeln!(text, "  {name:<34} {r:>9.5} {g:>9.5} {b:>9.5}");
    }
    print(&text)?;

    picture.write(&target, &guard)?;
    let mut text = String::from("\nReference, decoded, difference x 8 (black where equal):\n");
    if stdout::is_terminal() {
        text.push_str(&pictures(&table, &decoded, PREVIEW).map_err(failed)?.1.half_blocks());
    }
    let _ = writeln!(text, "{}", clean(&target.to_string()));
    print_as_is(&text)
}

/// Render PSNR and the picture of two tables.
fn pictures(reference: &BrdfTable, decoded: &BrdfTable, size: usize) -> csbrdf::Result<(f64, Picture)> {
    let images = rayon::join(|| sphere_of_table(reference, size), || sphere_of_table(decoded, size));
    Ok((psnr(&images.0, &images.1)?, Picture::comparison(&images.0, &images.1)?))
}
