//! `csbrdf synth`: synthetic tables.

use std::path::PathBuf;

use csbrdf::io::merl::write_merl;
use csbrdf::table::grid::Grid;
use csbrdf::table::synth::Recipe;

use crate::args::SynthArgs;
use crate::failure::{Failure, Outcome};
use crate::guard::Guard;
use crate::output::{Target, print};

pub fn run(args: &SynthArgs, quiet: bool) -> Outcome {
    let Some(name) = args.name.as_deref().filter(|_| !args.list) else {
        return print(&Recipe::NAMES.map(|name| format!("{name}\n")).concat());
    };
    let Some(recipe) = Recipe::named(name) else {
        return Err(Failure::usage(format!("no material {name}; there are {}", Recipe::NAMES.join(", "))));
    };
    let recipe = Recipe { noise: args.noise, holes: args.holes, seed: args.seed, ..recipe };
    let output = args.output.clone().unwrap_or_else(|| PathBuf::from(format!("{name}.binary")));
    let target = Target::of(&output);
    let guard = Guard::new(args.force, false);
    target.check(&guard)?;
    let grid = if args.phi_d == "360" { Grid::merl_360() } else { Grid::merl() };
    let table = recipe.synthesise(&grid).map_err(|e| Failure::in_arguments(&e))?;
    target.write(&guard, |out| write_merl(&table, false, out))?;
    target.announce(None, quiet);
    Ok(())
}
