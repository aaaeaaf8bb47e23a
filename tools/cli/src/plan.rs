//! `csbrdf plan`: what to measure, and, to rehearse it, the values that a table has there.

use csbrdf::assess::plan::Plan;
use csbrdf::codec::sample::Sampling;
use csbrdf::io::samples::write_plan;
use csbrdf::table::Table;
use csbrdf::table::grid::Grid;

use crate::args::PlanArgs;
use crate::failure::{Failure, Outcome, note};
use crate::guard::Guard;
use crate::input::{self, is_dash};
use crate::output::Target;
use crate::text::{grouped, percent};

pub fn run(args: &PlanArgs, quiet: bool) -> Outcome {
    let dashes = [&args.valid, &args.fill].into_iter().flatten().filter(|path| is_dash(path));
    if dashes.count() > 1 {
        return Err(Failure::usage("only one of the two tables can come from standard input"));
    }
    let target = args.output.as_deref().map_or(Target::Stdout, Target::of);
    let mut guard = Guard::new(args.force, args.replace_source).inputs(&args.valid).inputs(&args.fill);
    if target != Target::Stdout {
        target.check(&guard)?;
    }
    let valid = args.valid.as_deref().map(|path| input::table(path, &mut guard)).transpose()?;
    let fill = args.fill.as_deref().map(|path| input::table(path, &mut guard)).transpose()?;
    let named = args.grid.as_deref().map(merl);
    let grid = named.or_else(|| valid.as_ref().or(fill.as_ref()).map(|t| t.grid().clone())).unwrap_or_else(Grid::merl);
    for (table, path) in [(&valid, &args.valid), (&fill, &args.fill)] {
        if let (Some(table), Some(path)) = (table, path)
            && (table.grid().axes() != grid.axes() || table.grid().channels().len() != 3)
        {
            let what = "is not on the grid of the plan; give --grid 180 or 360 as the table has bins of phi_d";
            return Err(Failure::bad_input(path, what));
        }
    }
    let sampling = Sampling::from_ratio(args.sampling).ok_or_else(|| Failure::usage("the ratio is out of range"))?;
    let [h, d, p] = args.block.0[..] else { return Err(Failure::usage("--block takes three lengths")) };
    let flags = valid.as_ref().map(everywhere);
    let plan =
        Plan::draw(&grid, sampling, args.seed, [h, d, p], flags.as_deref()).map_err(|e| Failure::in_arguments(&e))?;
    target.write(&guard, |out| write_plan(&plan, fill.as_ref(), out))?;
    if !quiet && target != Target::Stdout {
        let (rows, all) = (plan.rows.len(), plan.candidates);
        note(&format!("{target}: {} bins to measure, {} of {}", grouped(rows), percent(rows, all), grouped(all)));
    }
    Ok(())
}

/// MERL's grid with a number of bins of phi_d.
pub fn merl(phi_d: &str) -> Grid {
    if phi_d == "360" { Grid::merl_360() } else { Grid::merl() }
}

/// Where all channels of a table are valid.
fn everywhere(table: &Table) -> Vec<bool> {
    let channels = table.grid().channels().len();
    (0..table.grid().positions()).map(|i| (0..channels).all(|c| table.valid_plane(c)[i])).collect()
}
