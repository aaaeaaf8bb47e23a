//! `info --blocks`: a row a block, and a map of their sizes.

use std::fmt::Write;

use super::contents::{Contents, class_of};
use crate::failure::Outcome;
use crate::output::print;
use crate::text::{error_figure, grouped};

/// From few bytes to many.
const SHADES: [char; 9] = ['.', ':', '-', '=', '+', 'o', '*', '#', '@'];

/// Widest map line.
const WIDTH: usize = 100;

/// Bytes of text that are printed at a time.
pub const ENOUGH: usize = 1 << 16;

/// Prints them as they are read.
pub fn print_rows(contents: &Contents) -> Outcome {
    let mut text = String::from("\n");
    let _ = writeln!(
        text,
        "{:>6}  {:<16} {:<13} {:<16} {:>7} {:>8} {:>8} {:>9} {:>9}",
        "block", "origin", "shape", "class", "bytes", "valid", "sampled", "rms <=", "max <="
    );
    let mut map = Map::new(contents);
    contents.for_each_block(|block| {
        let info = &block.info;
        map.add(info.block.origin, info.record.len());
        let _ = writeln!(
            text,
            "{:>6}  {:<16} {:<13} {:<16} {:>7} {:>8} {:>8} {:>9} {:>9}",
            block.number,
            join(contents.unpadded(&info.block.origin), ", "),
            join(contents.unpadded(&info.block.shape), "x"),
            class_of(info),
            grouped(info.record.len()),
            grouped(info.valid.iter().sum()),
            grouped(info.sampled.iter().sum()),
            error_figure(info.rms.into()),
            error_figure(info.max.into())
        );
        if text.len() < ENOUGH { Ok(()) } else { print(&std::mem::take(&mut text)) }
    })?;
    text.push('\n');
    print(&text)?;
    print(&text_of(&map, contents))
}

fn join(list: &[usize], separator: &str) -> String {
    list.iter().map(usize::to_string).collect::<Vec<_>>().join(separator)
}

/// One character a block, or a tile where tiles differ in their blocks; slices over the first axis side by side.
struct Map {
    uniform: bool,
    cell: [usize; 4],
    cells: [usize; 4],
    /// Bytes of each: eight a block at most.
    sizes: Vec<usize>,
}

impl Map {
    fn new(contents: &Contents) -> Map {
        let partition = contents.reader.partition();
        let uniform = partition.blocks_per_axis().is_some();
        let cell = if uniform { partition.shapes()[0] } else { partition.tile() };
        let grid = partition.grid();
        let cells: [usize; 4] = std::array::from_fn(|i| grid[i].div_ceil(cell[i]));
        Map { uniform, cell, cells, sizes: vec![0; cells.iter().product()] }
    }

    fn add(&mut self, origin: [usize; 4], bytes: usize) {
        let (at, cells): ([usize; 4], _) = (std::array::from_fn(|i| origin[i] / self.cell[i]), self.cells);
        self.sizes[((at[0] * cells[1] + at[1]) * cells[2] + at[2]) * cells[3] + at[3]] += bytes;
    }
}

fn text_of(map: &Map, contents: &Contents) -> String {
    let Map { uniform, cells, sizes, .. } = map;
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
    let unit = if *uniform { "block" } else { "tile" };
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
