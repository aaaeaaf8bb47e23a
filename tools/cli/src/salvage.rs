//! `csbrdf decode --salvage`: what is left of a damaged file, and the list of what is not.

use std::fmt::Write as _;
use std::path::Path;

use csbrdf::edit::salvage::{Damage, Options, Outcome as Cost, Salvaged, WANTED, salvage_with};
use csbrdf::io::merl::write_merl_values;

use crate::args::{DecodeArgs, FormatArg};
use crate::decode::whole::{MISSING, write_whole};
use crate::failure::{Failure, Outcome, note};
use crate::formats::Kind;
use crate::guard::Guard;
use crate::input::{self, label};
use crate::output::Target;
use crate::text::grouped;

pub fn decode(args: &DecodeArgs, format: FormatArg, target: &Target, guard: Guard, quiet: bool) -> Outcome {
    let failed = |e: csbrdf::Error| Failure::in_file(&args.input, &e);
    let bytes = input::read(&args.input, &[Kind::Damaged])?;
    let options = Options::default().limits(input::limits()).evidence(args.evidence);
    let salvaged = salvage_with(bytes.as_ref(), &options).map_err(failed)?;
    let guard = guard.source_of(&args.input, salvaged.reader());
    if args.exact {
        let (values, _) = salvaged.source_table(f64::from(MISSING)).map_err(failed)?;
        target.write(&guard, |out| write_merl_values(salvaged.reader().grid(), &values, out))?;
    } else {
        write_whole(salvaged.reader(), args, format, target, &guard)?;
    }
    list(&args.input, &salvaged, quiet);
    verdict(&args.input, &salvaged, target)?;
    target.announce(Some(&args.input), quiet);
    Ok(())
}

/// What decoding and repairing a damaged file end with: a failure if anything is lost or assumed.
pub fn verdict(input: &Path, salvaged: &Salvaged, target: &Target) -> Outcome {
    if salvaged.is_whole() {
        return Ok(());
    }
    let lost = salvaged.damage().iter().any(|damage| damage.outcome == Cost::Lost);
    let what = if lost { "not all could be restored" } else { "what was restored is assumed, not proven" };
    Err(Failure::bad_input(input, format!("{what}; {target} has what is left of it")))
}

/// What is damaged, a line each, and a summary.
pub fn list(file: &Path, salvaged: &Salvaged, quiet: bool) {
    let name = label(file);
    for damage in salvaged.damage() {
        note(&format!("{name}: {}", line(salvaged, damage)));
    }
    if !quiet {
        let (reader, lost) = (salvaged.reader(), salvaged.lost().len());
        let (grid, blocks) = (reader.grid(), reader.block_count());
        let entries = grid.positions() * grid.channels().len();
        let exact = match (reader.is_lossless(), salvaged.lost_source()) {
            (_, n) if n > 0 => format!("; source values of {} blocks lost", grouped(n)),
            (true, _) => "; all source values intact".into(),
            (false, _) => String::new(),
        };
        note(&format!(
            "{name}: {} blocks of {} intact, {} lost with {} entries of {}{exact}",
            grouped(blocks - lost),
            grouped(blocks),
            grouped(lost),
            grouped(salvaged.lost_entries()),
            grouped(entries)
        ));
    }
}

fn line(salvaged: &Salvaged, damage: &Damage) -> String {
    let Damage { section, blocks, bytes, what, outcome, .. } = damage;
    let mut text = String::new();
    match blocks {
        Some(blocks) if blocks.len() > 1 => {
            let _ = write!(text, "blocks {} to {}, ", blocks.start, blocks.end - 1);
        }
        Some(blocks) => {
            let axes = salvaged.reader().grid().axes().len();
            let list = |of: &[usize; 4]| of[4 - axes..].iter().map(usize::to_string).collect::<Vec<_>>().join(",");
            if let Some(place) = salvaged.place(blocks.start) {
                let (from, shape) = (list(&place.origin), list(&place.shape));
                let _ = write!(text, "block {} (from {from}, shape {shape}), ", blocks.start);
            }
        }
        None => {}
    }
    let first = blocks.as_ref().map(|blocks| blocks.start);
    let cost = match (outcome, first) {
        (Cost::Restored, _) => "nothing is lost".to_string(),
        (Cost::Assumed { bits }, _) => format!("assumed, not proven: {bits} bits of evidence of {WANTED}"),
        (Cost::Lost, Some(block)) if section == "RECS" && !salvaged.has_mean(block) => "lost with mean".into(),
        (Cost::Lost, Some(_)) if section == "RECS" => "lost but for the mean".into(),
        (Cost::Lost, _) => "lost".into(),
        (other, _) => format!("{other:?}"),
    };
    let _ = write!(text, "{section} bytes {} to {}: {what}; {cost}", bytes.start, bytes.end);
    text
}
