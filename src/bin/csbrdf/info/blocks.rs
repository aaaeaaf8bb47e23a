//! `info --blocks`: a row a block, and a map of their sizes.

use std::fmt::Write;

use super::contents::Contents;
use crate::text::{error_figure, grouped};

/// From few bytes to many.
const SHADES: [char; 9] = ['.', ':', '-', '=', '+', 'o', '*', '#', '@'];

/// Widest map line.
const WIDTH: usize = 100;

pub fn report(contents: &Contents) -> String {
    let mut text = String::from("\n");
    let _ = writeln!(
        text,
        "{:>6}  {:<16} {:<13} {:<16} {:>7} {:>8} {:>8} {:>9} {:>9}",
        "block", "origin", "shape", "class", "bytes", "valid", "sampled", "rms <=", "max <="
    );
    for block in &contents.blocks {
        let info = &block.info;
        let _ = writeln!(
            text,
            "{:>6}  {:<16} {:<13} {:<16} {:>7} {:>8} {:>8} {:>9} {:>9}",
            block.number,
            join(contents.unpadded(&info.block.origin), ", "),
            join(contents.unpadded(&info.block.shape), "x"),
            info.class.as_str(),
            grouped(info.record.len()),
            grouped(info.valid.iter().sum()),
            grouped(info.sampled.iter().sum()),
            error_figure(info.rms.into()),
            error_figure(info.max.into())
        );
    }
    text.push('\n');
    text.push_str(&map(contents));
    text
}

fn join(list: &[usize], separator: &str) -> String {
    list.iter().map(usize::to_string).collect::<Vec<_>>().join(separator)
}

/// One character a block, or a tile where tiles differ in their blocks; slices over the first axis side by side.
fn map(contents: &Contents) -> String {
    let partition = contents.reader.partition();
    let uniform = partition.blocks_per_axis().is_some();
    let cell = if uniform { partition.shapes()[0] } else { partition.tile() };
    let grid = partition.grid();
    let cells: [usize; 4] = std::array::from_fn(|i| grid[i].div_ceil(cell[i]));
    let index = |at: [usize; 4]| ((at[0] * cells[1] + at[1]) * cells[2] + at[2]) * cells[3] + at[3];
    let mut sizes = vec![0usize; cells.iter().product()];
    for block in &contents.blocks {
        let at = std::array::from_fn(|i| block.info.block.origin[i] / cell[i]);
        sizes[index(at)] += block.info.record.len();
    }
    let (Some(&least), Some(&most)) = (sizes.iter().filter(|s| **s > 0).min(), sizes.iter().max()) else {
        return String::new();
    };
    // Equal factors between shades.
    let span = (most as f64 / least as f64).ln().max(f64::MIN_POSITIVE);
    let shade = |size: usize| match size {
        0 => ' ',
        size => {
            let t = (size as f64 / least as f64).ln() / span;
            SHADES[((t * SHADES.len() as f64) as usize).min(SHADES.len() - 1)]
        }
    };
    let unit = if uniform { "block" } else { "tile" };
    let mut text = format!(
        "bytes of each {unit}: {} is {} up, {} is up to {}\n",
        SHADES[0],
        grouped(least),
        SHADES[SHADES.len() - 1],
        grouped(most)
    );
    let names: Vec<&str> = contents.reader.grid().axes().iter().map(|a| a.name.as_str()).collect();
    if let [first, .., down, across] = names[..] {
        let _ = writeln!(text, "slices over {first}, in each {down} down, {across} across");
    }
    let slices = cells[0] * cells[1];
    let per_line = (WIDTH / (cells[3] + 2)).clamp(1, slices);
    for first in (0..slices).step_by(per_line) {
        text.push('\n');
        for row in 0..cells[2] {
            let mut line = String::from(" ");
            for slice in first..(first + per_line).min(slices) {
                line.push(' ');
                line.extend((0..cells[3]).map(|x| shade(sizes[(slice * cells[2] + row) * cells[3] + x])));
                line.push(' ');
            }
            let _ = writeln!(text, "{}", line.trim_end());
        }
    }
    text
}
