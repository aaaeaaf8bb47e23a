//! `csbrdf report`: work-precision plots. Many encodes of each table, their error against seconds and bytes, and how
//! the solves of single blocks go.

mod axis;
mod blocks;
mod csv;
mod figures;
mod front;
mod page;
mod plan;
mod plot;
mod point;
mod solver_log;
mod style;

use std::path::Path;
use std::time::Instant;

use csbrdf::assess::render::sphere_of_table;
use csbrdf::table::block::Partition;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::args::ReportArgs;
use crate::encode;
use crate::failure::{Failure, Outcome, note};
use crate::formats::Kind;
use crate::guard::Guard;
use crate::input::{self, is_dash, label};
use crate::names;
use crate::output::Target;
use crate::text::clean;
use plan::Plan;
use point::{Invocation, Point, Subject, measure};
use solver_log::Followed;

/// Steps of the progress bar a point.
const STEPS: u64 = 100;

/// What holds for all tables.
pub struct Run {
    /// Threads asked for.
    asked: Option<u16>,
    threads: usize,
    processors: usize,
    grid: String,
    /// Options of every encode.
    extra: String,
}

/// A table and what came of it.
pub struct Tried {
    name: String,
    source_bytes: usize,
    plan: Plan,
    points: Vec<Point>,
    /// Commands that failed, and why.
    left_out: Vec<String>,
    followed: Vec<Followed>,
}

pub fn run(args: &ReportArgs, threads: Option<u16>, quiet: bool) -> Outcome {
    let start = Instant::now();
    let run = Run {
        asked: threads,
        threads: rayon::current_num_threads(),
        processors: std::thread::available_parallelism().map_or(1, usize::from),
        grid: clap::ValueEnum::to_possible_value(&args.grid).map(|v| v.get_name().to_string()).unwrap_or_default(),
        extra: args.encode.trim().to_string(),
    };
    let plan = Plan::of(args.grid, &args.ratios).with(&run.extra);
    // All that can fail early does: options, tables, places of the results.
    for settings in plan.settings().into_iter().map(String::from).chain(plan::traced(&run.extra)) {
        Invocation::new(Path::new("TABLE"), &settings, "OUT", threads)?;
    }
    for table in &args.tables {
        if is_dash(table) {
            return Err(Failure::usage("the commands of a report name its tables; give a file, not standard input"));
        }
        input::table_format(table, input::read(table, &[Kind::Merl])?.as_ref())?;
    }
    std::fs::create_dir_all(&args.out).map_err(|e| Failure::io(&args.out, &e))?;
    let targets = ["report.html", "report.csv", "traces.csv"].map(|name| Target::File(args.out.join(name)));
    let guard = Guard::new(args.force, args.replace_source).inputs(&args.tables);
    targets.iter().try_for_each(|target| target.check(&guard))?;

    let count = plan.settings().len();
    if !quiet {
        note(&format!("{count} points a table, a few seconds each; {} to do", count * args.tables.len()));
    }
    let bar = progress_bar((count * args.tables.len()) as u64, quiet);
    let mut tables = Vec::new();
    for (number, path) in args.tables.iter().enumerate() {
        bar.set_message(clean(&label(path)));
        tables.push(try_table(args, &run, &plan, path, &bar, (number * count) as u64)?);
    }
    bar.finish_and_clear();

    let [html, points, traces] = [page::page(&run, &tables), csv::points(&tables), csv::traces(&tables)];
    for (target, text) in targets.iter().zip([html, points, traces]) {
        target.write(&guard, |out| Ok(out.write_all(text.as_bytes())?))?;
    }
    let done: usize = tables.iter().map(|t| t.points.len()).sum();
    if !quiet {
        note(&format!("{}: {done} points in {:.0} s", targets[0], start.elapsed().as_secs_f64()));
    }
    match tables.iter().map(|t| t.left_out.len()).sum::<usize>() {
        0 => Ok(()),
        failed => Err(Failure::operation(format!("{failed} of {} points failed, see above", failed + done))),
    }
}

/// Carries out the plan on one table. A setting that fails is left out; a table that cannot be read is a failure.
fn try_table(
    args: &ReportArgs,
    run: &Run,
    plan: &Plan,
    path: &Path,
    bar: &ProgressBar,
    before: u64,
) -> Result<Tried, Failure> {
    let source = input::read(path, &[Kind::Merl])?;
    let bytes = source.as_ref();
    let mut tried = Tried {
        name: names::shown(path),
        source_bytes: bytes.len(),
        plan: plan.clone(),
        points: Vec::new(),
        left_out: Vec::new(),
        followed: Vec::new(),
    };
    let given = Invocation::new(path, &run.extra, "OUT", None)?;
    let (table, metadata) = encode::parse(path, bytes, &encode::metadata(&given.args.meta)?)?;
    let picture = (args.render > 0).then(|| sphere_of_table(&table, args.render.into()));
    let subject = Subject { table, metadata, picture };
    drop(source);

    let stem = path.file_stem().map(names::safe).unwrap_or_default();
    for (number, settings) in plan.settings().into_iter().enumerate() {
        let from = (before + number as u64) * STEPS;
        let progress = |share: f64| bar.set_position(from + (share * STEPS as f64) as u64);
        let invocation = Invocation::new(path, settings, &format!("{stem}-{number}.csbrdf"), run.asked)?;
        match measure(&subject, settings, &invocation, &progress) {
            Ok(point) => tried.points.push(point),
            Err(e) => {
                let what = format!("{}: {}", invocation.command, e.kind());
                bar.suspend(|| note(&format!("csbrdf: left out: {what}")));
                tried.left_out.push(what);
            }
        }
    }

    let grid = subject.table.grid().shape();
    let in_table = |e: csbrdf::Error| Failure::in_file(path, &e);
    let partition = Partition::uniform(grid, [1, 15, 15, 15]).map_err(in_table)?;
    let Some(blocks) = blocks::choose(&subject.table, &partition, &args.trace_blocks) else {
        let count = partition.block_count();
        return Err(Failure::usage(format!("--trace-blocks: {} has blocks 0 to {}", label(path), count - 1)));
    };
    for block in blocks {
        for settings in plan::traced(&run.extra) {
            let encoder = Invocation::new(path, &settings, "OUT", run.asked)?.encoder();
            let iterations = args.trace_iterations as usize;
            let traces = solver_log::follow(&subject.table, &encoder, block.number, iterations).map_err(in_table)?;
            if !traces.is_empty() {
                tried.followed.push(Followed { block: block.clone(), settings, traces });
            }
        }
    }
    Ok(tried)
}

/// A bar on standard error if that is a terminal and not to be quiet.
fn progress_bar(points: u64, quiet: bool) -> ProgressBar {
    let target = if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(points * STEPS), target);
    let style = ProgressStyle::with_template("{msg} [{bar:30}] {percent:>3} %  {elapsed}, {eta} to go");
    bar.set_style(style.map(|s| s.progress_chars("=> ")).unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar
}
