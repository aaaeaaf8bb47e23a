//! `csbrdf decode --salvage`: what is left of a damaged file, and the list of what is not.

use std::fmt::Write as _;
use std::path::Path;

use csbrdf::salvage::{Damage, Outcome as Cost, Salvaged, salvage};
use csbrdf::table::merl::write_merl_values;

use crate::args::{DecodeArgs, FormatArg};
use crate::decode::{MISSING, write_whole};
use crate::failure::{Failure, Outcome, note};
use crate::formats::Kind;
use crate::guard::Guard;
use crate::input::{self, label};
use crate::output::Target;
use crate::text::grouped;

pub fn decode(args: &DecodeArgs, format: FormatArg, target: &Target, guard: Guard, quiet: bool) -> Outcome {
    let failed = |e: csbrdf::Error| Failure::in_file(&args.input, &e);
    let bytes = input::read(&args.input, &[Kind::Damaged])?;
    let salvaged = salvage(bytes.as_ref()).map_err(failed)?;
    let guard = guard.source_of(&args.input, salvaged.reader());
    if args.exact {
        let (values, gone) = salvaged.exact_table(f64::from(MISSING)).map_err(failed)?;
        target.write(&guard, |out| write_merl_values(salvaged.reader().grid(), &values, out))?;
        if gone > 0 && !quiet {
            note(&format!("{}: exact values of {} blocks are lost", label(&args.input), grouped(gone)));
        }
    } else {
        write_whole(salvaged.reader(), args, format, target, &guard)?;
    }
    list(&args.input, &salvaged, quiet);
    if salvaged.damage().is_empty() {
        target.tell(Some(&args.input), quiet);
        return Ok(());
    }
    Err(Failure::bad_input(&args.input, format!("damaged; {target} has what is left of it")))
}

/// What is damaged, a line each, and a summary.
pub fn list(file: &Path, salvaged: &Salvaged, quiet: bool) {
    let name = label(file);
    for damage in salvaged.damage() {
        note(&format!("{name}: {}", line(salvaged, damage)));
    }
    if !quiet {
        let (lost, blocks) = (salvaged.lost().len(), salvaged.reader().block_count());
        let grid = salvaged.reader().grid();
        let entries = grid.positions() * grid.channels().len();
        note(&format!(
            "{name}: {} blocks of {} intact, {} lost with {} entries of {}",
            grouped(blocks - lost),
            grouped(blocks),
            grouped(lost),
            grouped(salvaged.lost_entries()),
            grouped(entries)
        ));
    }
}

fn line(salvaged: &Salvaged, damage: &Damage) -> String {
    let Damage { section, block, bytes, what, outcome } = damage;
    let mut text = String::new();
    if let Some((block, place)) = block.and_then(|block| salvaged.place(block).map(|place| (block, place))) {
        let axes = salvaged.reader().grid().axes().len();
        let list = |of: &[usize; 4]| of[4 - axes..].iter().map(usize::to_string).collect::<Vec<_>>().join(",");
        let _ = write!(text, "block {block} (from {}, shape {}), ", list(&place.origin), list(&place.shape));
    }
    let cost = match (outcome, block) {
        (Cost::Restored, _) => "nothing is lost",
        (Cost::Lost, Some(block)) if section == "RECS" && !salvaged.has_mean(*block) => "lost with its mean",
        (Cost::Lost, Some(_)) if section == "RECS" => "lost but for its mean",
        (Cost::Lost, _) => "lost",
    };
    let _ = write!(text, "{section} bytes {} to {}: {what}; {cost}", bytes.start, bytes.end);
    text
}
