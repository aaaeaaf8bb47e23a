//! What a study will do, settled and checked before the work begins.

use std::ffi::OsStr;
use std::path::PathBuf;

use csbrdf::assess::render::environment::Environment;
use csbrdf::assess::render::rays::Quality;
use csbrdf::encode::Preset;

use super::light;
use crate::args::{FigureArg, StudyArgs};
use crate::failure::{Failure, note};
use crate::names;
use crate::path::label;
use crate::quote::shell;

/// The presets that are compared, by name.
pub const PRESETS: &[(&str, Preset)] = &[("paper", Preset::Paper), ("sparse", Preset::Sparse)];

/// The materials of the paper's sphere figure, or what stands for them.
const NAMED: [&str; 6] =
    ["alum-bronze", "dark-red-paint", "chrome-steel", "gold-paint", "green-fabric", "rgl-vch_golden_yellow"];
/// The ratio of all figures but the spheres.
const FOCUS: f64 = 0.05;
const RATIOS: [f64; 6] = [0.01, 0.025, 0.05, 0.1, 0.25, 0.5];
const ALL_FIGURES: [FigureArg; 5] =
    [FigureArg::Gini, FigureArg::Negative, FigureArg::Spheres, FigureArg::Sheet, FigureArg::Scene];

/// One table of the folder.
#[derive(Clone, Debug)]
pub struct Material {
    /// What the study calls it, no other the same; part of names of files.
    pub name: String,
    pub path: PathBuf,
    /// One of those of the spheres.
    pub chosen: bool,
    /// On the contact sheet and in the Gini figure.
    pub on_sheet: bool,
}

/// The settled study.
pub struct Plan {
    /// Those that are looked at, the chosen ones first.
    pub materials: Vec<Material>,
    pub ratios: Vec<f64>,
    /// The ratio nearest to 5 %.
    pub focus: f64,
    pub size: usize,
    pub samples: usize,
    pub seed: u64,
    /// Every how many blocks the figure of negative values takes one.
    pub block_stride: usize,
    pub environment: Environment,
    /// As messages call it.
    pub environment_name: String,
    /// The command line that repeats this.
    pub command: String,
    pub folder: PathBuf,
    figures: Vec<FigureArg>,
}

impl Plan {
    pub fn new(args: &StudyArgs) -> Result<Plan, Failure> {
        let found = tables(args)?;
        let limit = usize::from(args.sheet.unwrap_or(if args.quick { 4 } else { 24 }));
        let chosen = choose(args, &found)?;
        let others = found.iter().filter(|m| !chosen.contains(m));
        let mut materials: Vec<Material> = chosen.iter().chain(others.clone()).cloned().collect();
        for (i, material) in materials.iter_mut().enumerate() {
            material.chosen = i < chosen.len();
            material.on_sheet = i < limit;
        }
        let mut figures: Vec<FigureArg> =
            ALL_FIGURES.into_iter().filter(|f| args.only.is_empty() || args.only.contains(f)).collect();
        if chosen.len() < 2 && figures.contains(&FigureArg::Scene) {
            let what = "the scene takes two materials, there is one; put another table into the folder or name two";
            if args.only.contains(&FigureArg::Scene) {
                return Err(Failure::usage(what));
            }
            note(&format!("csbrdf: {what}"));
            figures.retain(|f| *f != FigureArg::Scene);
        }
        let mut ratios = match (args.ratios.is_empty(), args.quick) {
            (false, _) => args.ratios.clone(),
            (true, true) => vec![FOCUS],
            (true, false) => RATIOS.to_vec(),
        };
        ratios.sort_unstable_by(f64::total_cmp);
        ratios.dedup();
        let away = |r: &f64| (r / FOCUS).ln().abs();
        let focus = ratios.iter().copied().min_by(|a, b| away(a).total_cmp(&away(b))).unwrap_or(FOCUS);
        let (environment, environment_name) = light::environment(args.environment.as_deref())?;
        let mut plan = Plan {
            materials,
            ratios,
            focus,
            size: args.size.unwrap_or(if args.quick { 48 } else { 192 }).into(),
            samples: args.spp.unwrap_or(if args.quick { 16 } else { 64 }).into(),
            seed: args.seed,
            block_stride: if args.quick { 7 } else { 1 },
            environment,
            environment_name,
            command: String::new(),
            folder: args.folder.clone(),
            figures,
        };
        plan.command = command(args, &plan);
        let gini = plan.makes(FigureArg::Gini);
        let used = |m: &Material| plan.steps_of(m) > 0 || gini && m.on_sheet;
        plan.materials = plan.materials.iter().filter(|m| used(m)).cloned().collect();
        for material in plan.materials.iter().filter(|m| m.path.file_stem() != Some(OsStr::new(&m.name))) {
            let (path, name) = (label(&material.path), &material.name);
            note(&format!(
                "{path}: is called {name}: its own name is too long, or has characters that cannot be shown"
            ));
        }
        Ok(plan)
    }

    /// Whether a figure is asked for.
    pub fn makes(&self, figure: FigureArg) -> bool {
        self.figures.contains(&figure)
    }

    /// Preset numbers and ratios to encode a material with, presets first.
    pub fn ratios_of(&self, material: &Material) -> Vec<(usize, f64)> {
        let spheres = self.makes(FigureArg::Spheres) && material.chosen;
        let focus = self.makes(FigureArg::Sheet) && material.on_sheet || self.role(material).is_some();
        let wanted = |r: &f64| spheres || focus && *r == self.focus;
        let ratios = || self.ratios.iter().copied().filter(wanted);
        (0..PRESETS.len()).flat_map(|preset| ratios().map(move |r| (preset, r))).collect()
    }

    /// Whether spheres of a material are rendered.
    pub fn needs_spheres(&self, material: &Material) -> bool {
        self.makes(FigureArg::Spheres) && material.chosen || self.makes(FigureArg::Sheet) && material.on_sheet
    }

    /// The place of a material in the scene, 0 or 1.
    pub fn role(&self, material: &Material) -> Option<usize> {
        let cast = self.materials.iter().take(2).position(|m| m.name == material.name);
        cast.filter(|_| self.makes(FigureArg::Scene))
    }

    /// Units of progress that a material takes.
    pub fn steps_of(&self, material: &Material) -> usize {
        self.ratios_of(material).len() + usize::from(self.makes(FigureArg::Negative) && material.chosen)
    }

    /// The command line for all figures, to which `--only` may be added.
    pub fn command_without_only(&self) -> &str {
        self.command.split(" --only ").next().unwrap_or_default()
    }

    /// Command lines that encode one material as the study does.
    pub fn encode_command(&self, name: &str) -> String {
        let material = self.materials.iter().find(|m| m.name == name);
        let table = quote(material.map_or_else(|| self.folder.join(name), |m| m.path.clone()));
        let encode = |(preset, _): &(&str, Preset)| {
            let (ratio, seed) = (percentage(self.focus).replace(' ', ""), self.seed);
            format!("csbrdf encode --preset {preset} --sampling {ratio} --seed {seed} {table} -o {preset}.csbrdf")
        };
        PRESETS.iter().map(encode).collect::<Vec<_>>().join("\n")
    }

    /// Size and effort of the spheres.
    pub fn sphere_quality(&self) -> Quality {
        Quality { width: self.size, height: self.size, samples: self.samples, seed: self.seed }
    }

    /// Size and effort of the scene.
    pub fn scene_quality(&self) -> Quality {
        Quality { width: self.size * 5 / 2, height: self.size * 3 / 2, samples: self.samples, seed: self.seed }
    }
}

/// The tables of the folder, by name.
fn tables(args: &StudyArgs) -> Result<Vec<Material>, Failure> {
    let folder = &args.folder;
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| Failure::io(folder, &e))? {
        let path = entry.map_err(|e| Failure::io(folder, &e))?.path();
        if csbrdf::io::is_named_as_table(&path) {
            let name = path.file_stem().map(names::safe).unwrap_or_default();
            found.push(Material { name, path, chosen: false, on_sheet: false });
        }
    }
    found.sort_unstable_by(|a, b| a.name.cmp(&b.name));
    if found.is_empty() {
        let what = "no .binary file in it; give a folder of MERL tables (csbrdf synth makes some)";
        return Err(Failure::operation(format!("{}: {what}", folder.display())));
    }
    // One that is named as another's hash makes it.
    if let Some(pair) = found.windows(2).find(|pair| pair[0].name == pair[1].name) {
        let (one, other, name) = (label(&pair[0].path), label(&pair[1].path), &pair[0].name);
        return Err(Failure::operation(format!("{one} and {other} would both be called {name}; rename one")));
    }
    Ok(found)
}

impl PartialEq for Material {
    fn eq(&self, other: &Material) -> bool {
        self.path == other.path
    }
}

/// The materials of the spheres.
fn choose(args: &StudyArgs, found: &[Material]) -> Result<Vec<Material>, Failure> {
    let is_named = |m: &Material, name: &str| m.name == name || m.path.file_stem() == Some(OsStr::new(name));
    let by_name = |name: &str| found.iter().find(|m| is_named(m, name)).cloned();
    if !args.materials.is_empty() {
        let mut chosen = Vec::new();
        for name in &args.materials {
            let Some(material) = by_name(name) else {
                let folder = args.folder.display();
                return Err(Failure::usage(format!("--materials: no {name}.binary in {folder}; check the names")));
            };
            if !chosen.contains(&material) {
                chosen.push(material);
            }
        }
        return Ok(chosen);
    }
    let count = if args.quick { 2 } else { NAMED.len() };
    let mut chosen: Vec<Material> = NAMED.iter().filter_map(|name| by_name(name)).take(count).collect();
    if chosen.is_empty() {
        chosen = found.iter().take(count).cloned().collect();
    }
    Ok(chosen)
}

/// The command line with every setting spelt out.
fn command(args: &StudyArgs, plan: &Plan) -> String {
    let chosen: Vec<&str> = plan.materials.iter().filter(|m| m.chosen).map(|m| m.name.as_str()).collect();
    let ratios: Vec<String> = plan.ratios.iter().map(|r| percentage(*r).replace(' ', "")).collect();
    let sheet = plan.materials.iter().filter(|m| m.on_sheet).count();
    let mut line = format!("csbrdf study {} --out {}", quote(&args.folder), quote(&args.out));
    line += &format!(" --materials {} --ratios {} --sheet {sheet}", quote(chosen.join(",")), ratios.join(","));
    line += &format!(" --size {} --spp {} --seed {}", plan.size, plan.samples, plan.seed);
    if let Some(file) = &args.environment {
        line += &format!(" --environment {}", quote(file));
    }
    if args.quick {
        line += " --quick";
    }
    if !args.only.is_empty() {
        let names: Vec<String> = plan.figures.iter().map(|f| format!("{f:?}").to_lowercase()).collect();
        line += &format!(" --only {}", names.join(","));
    }
    line
}

/// A word for a shell.
pub fn quote(word: impl AsRef<std::ffi::OsStr>) -> String {
    shell(&word.as_ref().to_string_lossy()).into_owned()
}

/// A share as people write it.
pub fn percentage(ratio: f64) -> String {
    let text = format!("{:.4}", 100.0 * ratio);
    format!("{} %", text.trim_end_matches('0').trim_end_matches('.'))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_survive_the_shell_and_shares_are_short() {
        assert_eq!(quote("a/b-c_1,d"), "a/b-c_1,d");
        assert_eq!(quote("it's here"), "'it'\\''s here'");
        assert_eq!([0.05, 0.025, 1.0, 0.000_1].map(percentage), ["5 %", "2.5 %", "100 %", "0.01 %"]);
    }
}
