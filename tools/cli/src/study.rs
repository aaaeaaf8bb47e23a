//! `csbrdf study`: the source paper's figures on a folder of tables, as pictures, plots, CSV and a page.
//!
//! One material after the other: each table is read once, and encoded once for every preset and ratio that any figure
//! needs. A table that cannot be read is reported and left out.

mod csv;
mod folder;
mod gini;
mod light;
mod negative;
mod page;
mod plan;
mod plot;
mod progress;
mod recovery;
mod scene;
mod sheet;
mod shot;
mod spheres;
mod trial;

use std::path::Path;
use std::time::Instant;

use csbrdf::assess::render::Texels;
use csbrdf::table::Table;

use crate::args::{FigureArg, StudyArgs};
use crate::failure::{Failure, Outcome, note};
use crate::formats::Kind;
use crate::guard::Guard;
use crate::input;
use folder::Folder;
use plan::{Material, Plan};
use progress::Progress;
use shot::Shot;
use trial::Trial;

/// What the figures collect.
#[derive(Default)]
struct Figures {
    gini: Vec<gini::Row>,
    negative: Vec<negative::Row>,
    spheres: Vec<spheres::Row>,
    sheet: Vec<sheet::Row>,
    scene: scene::Cast,
}

pub fn run(args: &StudyArgs, quiet: bool) -> Outcome {
    let start = Instant::now();
    let plan = Plan::new(args)?;
    let guard = Guard::new(args.force, args.replace_source).inputs(plan.materials.iter().map(|m| &m.path));
    let guard = guard.inputs(&args.environment);
    let folder = Folder::open(&args.out, args.force || args.replace_source, guard)?;
    let progress = Progress::new(&plan, quiet);
    let mut figures = Figures::default();
    let mut left_out = Vec::new();
    let mut first_failure = None;
    for material in &plan.materials {
        if let Err(failure) = examine(&plan, material, &progress, &mut figures) {
            progress.skip(plan.steps_of(material));
            progress.report(&failure);
            first_failure.get_or_insert(failure.reported());
            left_out.push(material.name.clone());
        }
    }
    let mut page = page::Page::new(&plan, &left_out);
    if plan.makes(FigureArg::Gini) {
        page.add(gini::write(&plan, &figures.gini, &folder)?);
    }
    if plan.makes(FigureArg::Negative) {
        page.add(negative::write(&plan, &figures.negative, &folder)?);
    }
    if plan.makes(FigureArg::Spheres) {
        page.add(spheres::write(&plan, &figures.spheres, &folder)?);
    }
    if plan.makes(FigureArg::Sheet) {
        page.add(sheet::write(&plan, &figures.sheet, &folder)?);
    }
    if plan.makes(FigureArg::Scene) {
        page.add(scene::write(&plan, &figures.scene, &folder, &progress)?);
    }
    folder.write("index.html", page.finish(start.elapsed().as_secs_f64()).as_bytes())?;
    progress.finish();
    if !quiet {
        let done = plan.materials.len() - left_out.len();
        let seconds = start.elapsed().as_secs_f64();
        note(&format!("{done} materials, {seconds:.0} s: {}", args.out.join("index.html").display()));
        if !left_out.is_empty() {
            note(&format!("{} of {} failed", left_out.len(), plan.materials.len()));
        }
    }
    first_failure.map_or(Ok(()), Err)
}

/// All that the figures need of one material. The figures get nothing of a material that fails.
fn examine(plan: &Plan, material: &Material, progress: &Progress, figures: &mut Figures) -> Outcome {
    progress.begin(&material.name);
    let table = load(&material.path)?;
    let failed = |e: csbrdf::Error| Failure::in_file(&material.path, &e);
    let gini = (plan.makes(FigureArg::Gini) && material.on_sheet).then(|| gini::measure(&material.name, &table));
    let negative = match plan.makes(FigureArg::Negative) && material.chosen {
        true => Some(negative::measure(plan, &material.name, &table, progress).map_err(failed)?),
        false => None,
    };
    let ratios = plan.ratios_of(material);
    if !ratios.is_empty() {
        let reference = Texels::new(&table);
        let shot = plan.needs_spheres(material).then(|| Shot::sphere(plan, &reference));
        let mut trials = Vec::new();
        for &(preset, ratio) in &ratios {
            let (trial, texels) = Trial::run(plan, preset, ratio, &table, shot.as_ref(), progress).map_err(failed)?;
            if let (Some(role), true) = (plan.role(material), ratio == plan.focus) {
                figures.scene.enter(role, preset, texels);
            }
            progress.line(&format!("{}: {trial}", material.name));
            trials.push(trial);
        }
        if let Some(shot) = shot {
            if plan.makes(FigureArg::Spheres) && material.chosen {
                figures.spheres.push(spheres::Row::new(plan, &material.name, &shot, &trials));
            }
            if plan.makes(FigureArg::Sheet) && material.on_sheet {
                figures.sheet.push(sheet::Row::new(plan, &material.name, &trials));
            }
        }
        if let Some(role) = plan.role(material) {
            figures.scene.name(role, &material.name, reference);
        }
    }
    figures.gini.extend(gini);
    figures.negative.extend(negative);
    Ok(())
}

fn load(path: &Path) -> Result<Table, Failure> {
    let bytes = input::read_within(path, &[Kind::Merl])?;
    let table = input::read_table(bytes.as_ref()).map_err(|e| Failure::in_file(path, &e))?;
    if table.valid_count() == 0 {
        return Err(Failure::bad_input(path, "no entry is valid: all are negative, NaN or infinite; nothing to study"));
    }
    Ok(table)
}
