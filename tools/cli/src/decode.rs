//! `csbrdf decode`: the whole table, or one block without touching the others.

pub mod whole;

use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

use csbrdf::decode::Reader;
use csbrdf::io::merl::write_merl_values;
use csbrdf::io::npy::write_npy_f32;
use csbrdf::table::block::Block;

use crate::args::{DecodeArgs, FormatArg};
use crate::failure::{Failure, Outcome};
use crate::guard::Guard;
use crate::input;
use crate::output::Target;
use crate::path::is_dash;
use crate::quote::csv;
use crate::salvage;
use crate::text::nine_digits;
use whole::{array_shape, mark, place, write_whole};

pub fn run(args: &DecodeArgs, quiet: bool) -> Outcome {
    let format = format(args)?;
    let target = target(args, format);
    let guard = Guard::new(args.force, args.replace_source).input(&args.input);
    if args.salvage {
        target.check(&guard)?;
        return salvage::decode(args, format, &target, guard, quiet);
    }
    let reader = input::open(&args.input)?.with_pruned(input::pruned(args.coarse));
    let guard = guard.source_of(&args.input, &reader);
    if !(format == FormatArg::Csv && target == Target::Stdout) {
        target.check(&guard)?;
    }
    write(&reader, args, format, &target, &guard)?;
    target.announce(Some(&args.input), quiet);
    Ok(())
}

/// What is asked for of an intact file.
fn write(reader: &Reader, args: &DecodeArgs, format: FormatArg, target: &Target, guard: &Guard) -> Outcome {
    let failed = |e: csbrdf::Error| Failure::in_file(&args.input, &e);
    if let Some(list) = &args.block {
        let number = block_number(reader, &list.0).map_err(Failure::usage)?;
        let block = one_block(reader, number, args.fill).map_err(failed)?;
        return target.write(guard, |out| match format {
            FormatArg::Csv => write_csv(reader, &block, out),
            _ => write_npy_f32(&block.values, &array_shape(reader, block.place.shape), out),
        });
    }
    if args.exact {
        let values = reader.source_table().map_err(failed)?;
        return target.write(guard, |out| write_merl_values(reader.grid(), &values, out));
    }
    write_whole(reader, args, format, target, guard)
}

/// The format asked for by name, or else by the output's extension.
fn format(args: &DecodeArgs) -> Result<FormatArg, Failure> {
    let of_output = args.output.as_deref().filter(|o| !is_dash(o)).and_then(Path::extension);
    let extension = of_output.map(|e| e.to_string_lossy().to_lowercase());
    let format = match (args.format, extension.as_deref()) {
        (Some(format), _) => format,
        (None, Some(csbrdf::io::merl::EXTENSION)) => FormatArg::Binary,
        (None, Some("npy")) => FormatArg::Npy,
        (None, Some("csv")) => FormatArg::Csv,
        (None, Some(other)) => {
            return Err(Failure::usage(format!("the extension .{other} names no format; give --format binary or npy")));
        }
        (None, None) if args.block.is_some() => FormatArg::Npy,
        (None, None) => FormatArg::Binary,
    };
    match (format, &args.block) {
        (FormatArg::Npy | FormatArg::Csv, _) if args.exact => {
            Err(Failure::usage("--exact gives a MERL table back; use a .binary output"))
        }
        (FormatArg::Binary, Some(_)) => {
            Err(Failure::usage("a .binary file holds a whole table; use npy or csv for a block"))
        }
        (FormatArg::Csv, None) => Err(Failure::usage("csv is for single blocks (--block); use binary or npy")),
        _ => Ok(format),
    }
}

fn target(args: &DecodeArgs, format: FormatArg) -> Target {
    if let Some(output) = &args.output {
        return Target::of(output);
    }
    if is_dash(&args.input) || format == FormatArg::Csv {
        return Target::Stdout;
    }
    // No measurement has such a name, so that none is replaced.
    let extension = if format == FormatArg::Npy { "decoded.npy" } else { "decoded.binary" };
    let Some(block) = &args.block else {
        return Target::File(args.input.with_extension(extension));
    };
    let mut name = args.input.file_stem().unwrap_or_default().to_os_string();
    name.push(".block");
    for index in &block.0 {
        name.push(format!("-{index}"));
    }
    name.push(".npy");
    let path: PathBuf = args.input.with_file_name(name);
    Target::File(path)
}

/// Number of the block that `--block` names: its number, or its place along each axis.
fn block_number<D: AsRef<[u8]>>(reader: &Reader<D>, list: &[usize]) -> Result<usize, String> {
    let count = reader.block_count();
    let axes = reader.grid().axes();
    if let [number] = *list {
        return if number < count {
            Ok(number)
        } else {
            Err(format!("no block {number}, the file has 0 to {}", count - 1))
        };
    }
    let Some(per_axis) = reader.partition().blocks_per_axis() else {
        let number = "give one block number (info --blocks lists them)";
        return Err(format!("the file's blocks form no regular grid; {number}"));
    };
    let per_axis = &per_axis[per_axis.len() - axes.len()..];
    if list.len() != axes.len() {
        return Err(format!("--block has {} indices, the table has {} axes", list.len(), axes.len()));
    }
    let mut number = 0;
    for ((&index, &n), axis) in list.iter().zip(per_axis).zip(axes) {
        if index >= n {
            let name = axis.name.as_str();
            return Err(format!("no block {index} along {name}, the file has 0 to {}", n - 1));
        }
        number = number * n + index;
    }
    Ok(number)
}

/// A decoded block: `[channel][position]`.
struct Decoded {
    place: Block,
    values: Vec<f32>,
}

fn one_block(reader: &Reader, number: usize, fill: bool) -> csbrdf::Result<Decoded> {
    let place = place(reader, number)?;
    let mut values = vec![0.0; reader.block_values(number)?];
    reader.block_into(number, &mut values)?;
    if !fill {
        mark(&mut values, &reader.block_validity(number)?);
    }
    Ok(Decoded { place, values })
}

/// One row a position: its bin along each axis, then the channels.
fn write_csv(reader: &Reader, block: &Decoded, out: &mut dyn Write) -> csbrdf::Result<()> {
    let grid = reader.grid();
    let axes = grid.axes().iter().map(|a| format!("{}_bin", a.name.as_str()));
    let head: Vec<String> = axes.chain(grid.channels().iter().map(|c| csv(&c.name).into_owned())).collect();
    writeln!(out, "{}", head.join(","))?;
    let padding = 4 - grid.axes().len();
    let n = block.place.positions();
    let mut row = String::new();
    for position in 0..n {
        row.clear();
        let mut stride = n;
        for axis in padding..4 {
            stride /= block.place.shape[axis];
            let bin = block.place.origin[axis] + position / stride % block.place.shape[axis];
            let _ = write!(row, "{bin},");
        }
        for channel in 0..grid.channels().len() {
            let separator = if channel == 0 { "" } else { "," };
            let _ = write!(row, "{separator}{}", nine_digits(block.values[channel * n + position]));
        }
        writeln!(out, "{row}")?;
    }
    Ok(())
}
