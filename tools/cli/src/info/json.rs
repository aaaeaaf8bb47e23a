//! `info --json`.

use std::fmt::Write;

use csbrdf::table::grid::Mapping;
use serde_json::{Map, Value, json};

use super::blocks::ENOUGH;
use super::contents::{Block, Contents, ORIGINS, class_of, classes_of_blocks};
use super::transform_name;
use crate::failure::Outcome;
use crate::output::print;
use crate::quote;

/// Prints the object of one file. Keys stay; new ones may be added. Blocks are printed as they are read.
pub fn print_object(contents: &Contents, with_blocks: bool) -> Outcome {
    let text = object(contents).to_string();
    let Some(open) = text.strip_suffix('}').filter(|_| with_blocks) else {
        return print(&quote::json(&format!("{text}\n")));
    };
    print(&quote::json(&format!("{open},\"blocks\":[")))?;
    let mut separator = "";
    let mut rows = String::new();
    contents.for_each_block(|found| {
        let _ = write!(rows, "{separator}{}", block(contents, found));
        separator = ",";
        if rows.len() < ENOUGH { Ok(()) } else { print(&std::mem::take(&mut rows)) }
    })?;
    print(&format!("{rows}]}}\n"))
}

fn object(contents: &Contents) -> Value {
    let reader = &contents.reader;
    let grid = reader.grid();
    let axis = |a: &csbrdf::table::grid::Axis| {
        let mapping = if a.mapping == Mapping::Square { "square" } else { "linear" };
        json!({"name": a.name.as_str(), "bins": a.len, "mapping": mapping, "start": a.start, "end": a.end})
    };
    let channel =
        |c: &csbrdf::table::grid::Channel| json!({"name": c.name, "wavelength_nm": c.wavelength, "scale": c.scale});
    let section = |(name, bytes): &(String, usize)| json!({"name": name, "bytes": bytes});
    let coding = reader.coding();
    let partition = reader.partition();
    let shapes: Vec<&[usize]> = partition.shapes().iter().map(|s| contents.unpadded(s)).collect();
    let per_axis = partition.blocks_per_axis();
    let mut classes = Map::new();
    for (class, count) in classes_of_blocks().zip(contents.summary.classes) {
        classes.insert(class.replace(' ', "_"), count.into());
    }
    let (rms_bound, max_bound) = contents.error_bounds();
    let measured = contents.measured_errors();
    json!({
        "file": contents.name,
        "bytes": contents.bytes,
        "version": {"major": contents.version.0, "minor": contents.version.1, "draft": contents.version.2},
        "axes": grid.axes().iter().map(axis).collect::<Vec<_>>(),
        "channels": grid.channels().iter().map(channel).collect::<Vec<_>>(),
        "coding": {
            "tone_map": "ln(f + eps)",
            "eps": coding.eps,
            "basis": coding.basis.as_str(),
            "channels": transform_name(&coding.transform),
            "quantization": coding.quantization.as_str(),
            "steps": coding.steps,
            "shrink": coding.shrink.map(|s| f64::from(s) / 256.0),
            "sampling": coding.sampling.ratio(),
            "seed": coding.seed,
            "horizon": coding.horizon,
        },
        "partition": {
            "blocks": reader.block_count(),
            "blocks_per_axis": per_axis.as_ref().map(|n| contents.unpadded(n)),
            "shapes": shapes,
            "tile": contents.unpadded(&partition.tile()),
            "tile_shapes": partition.tile_shapes(),
        },
        "sections": contents.sections.iter().map(section).collect::<Vec<_>>(),
        "side_bytes_per_block": contents.side_per_block(),
        "validity_classes": classes,
        "origins": origins(contents.summary.origins),
        "errors": {
            "log_rms": measured.map(|m| m.0),
            "log_max": measured.map(|m| m.1),
            "log_rms_bound": rms_bound,
            "log_max_bound": max_bound,
        },
        "metadata": contents.metadata,
        "damage": contents.damage,
    })
}

fn origins(counts: [usize; 4]) -> Value {
    ORIGINS.iter().zip(counts).map(|((name, _), count)| (name.to_string(), Value::from(count))).collect()
}

fn block(contents: &Contents, block: &Block) -> Value {
    let info = &block.info;
    json!({
        "number": block.number,
        "origin": contents.unpadded(&info.block.origin),
        "shape": contents.unpadded(&info.block.shape),
        "class": class_of(info).replace(' ', "_"),
        "offset": info.record.start,
        "bytes": info.record.len(),
        "valid": info.valid,
        "sampled": info.sampled,
        "origins": origins(block.origins),
        "seed": info.seed,
        "sampling": info.ratio,
        "rms_bound": info.rms,
        "max_bound": info.max,
    })
}
