//! What is tried: series of settings, one setting varied along each, and the sections that show them together.

use clap::ValueEnum;

use crate::args::{GridArg, PresetArg};

/// Points of one line in the plots, in the order of the varied setting.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Series {
    pub name: String,
    /// Options of `csbrdf encode`, one text a point.
    pub settings: Vec<String>,
}

/// A row of plots.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Section {
    pub title: &'static str,
    /// Numbers of the series shown.
    pub series: Vec<usize>,
}

/// All that is tried on a table.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    pub series: Vec<Series>,
    pub sections: Vec<Section>,
}

/// The values to vary over.
struct Values {
    ratios: Vec<f64>,
    qualities: &'static [f64],
    sigmas: &'static [f64],
    sampled_shapes: &'static [&'static str],
    archive_shapes: &'static [&'static str],
}

/// The paper's sampling with the basis and the norm that suit the data better.
const WEIGHTED: &str = "--preset paper --basis dct --weighting 1";

/// A preset's name on the command line.
pub fn preset_name(preset: PresetArg) -> String {
    preset.to_possible_value().map(|v| v.get_name().to_string()).unwrap_or_default()
}

/// Presets that recover from a share of the entries; all but the one that keeps every entry.
pub fn sampled_presets() -> impl Iterator<Item = String> {
    PresetArg::value_variants().iter().filter(|p| **p != PresetArg::Archive).map(|p| preset_name(*p))
}

/// Settings whose solves are followed, if they solve blocks at all, with the block shape that all of them share, and options added to each.
pub fn traced(options: &str) -> Vec<String> {
    let presets = sampled_presets().map(|name| format!("--preset {name}")).chain([WEIGHTED.to_string()]);
    presets.map(|base| format!("{base} --block 15,15,15 {options}").trim_end().to_string()).collect()
}

impl Plan {
    /// The plan of `--grid`; `ratios` replace its sampling ratios if there are any.
    pub fn of(grid: GridArg, ratios: &[f64]) -> Plan {
        let values = match grid {
            GridArg::Full => Values {
                ratios: vec![0.01, 0.05, 0.2, 0.5],
                qualities: &[0.4, 0.2, 0.1, 0.05, 0.025],
                sigmas: &[0.3, 0.1, 0.03, 0.01, 0.003, 0.001],
                sampled_shapes: &["9,9,36", "10,15,180"],
                archive_shapes: &["15,15,15", "9,9,36", "9,9,180"],
            },
            GridArg::Quick => Values {
                ratios: vec![0.05, 0.2],
                qualities: &[0.4, 0.1, 0.05],
                sigmas: &[0.1, 0.01],
                sampled_shapes: &[],
                archive_shapes: &["15,15,15"],
            },
        };
        let mut ratios = if ratios.is_empty() { values.ratios.clone() } else { ratios.to_vec() };
        ratios.sort_by(f64::total_cmp);
        ratios.dedup();
        Plan::over(&Values { ratios, ..values })
    }

    fn over(values: &Values) -> Plan {
        let sampling = |base: &str| values.ratios.iter().map(|r| format!("{base} --sampling {r}")).collect();
        let quality = |base: &str| values.qualities.iter().map(|q| format!("{base} --quality {q}")).collect();
        let sigma = |base: &str| values.sigmas.iter().map(|s| format!("{base} --sigma {s}")).collect();
        let mut plan = Plan::default();

        let archive = plan.add("archive, by quality".into(), quality("--preset archive"));
        let sampled: Vec<(String, usize)> = sampled_presets()
            .map(|name| {
                let number = plan.add(format!("{name}, by sampling"), sampling(&format!("--preset {name}")));
                (name, number)
            })
            .collect();
        let presets = sampled.iter().map(|s| s.1);
        plan.sections.push(Section { title: "Presets", series: [archive].into_iter().chain(presets).collect() });

        let paper = sampled.iter().find(|s| s.0 == preset_name(PresetArg::Paper)).map(|s| s.1);
        let archive_dft = plan.add("archive, DFT, by quality".into(), quality("--preset archive --basis dft"));
        let dct = plan.add("paper, DCT, by sampling".into(), sampling("--preset paper --basis dct"));
        let weighted = plan.add("paper, DCT, weighted, by sampling".into(), sampling(WEIGHTED));
        let bases = [archive, archive_dft].into_iter().chain(paper).chain([dct, weighted]).collect();
        plan.sections.push(Section { title: "Basis and sampling ratio", series: bases });

        let mut shapes = vec![archive];
        for shape in values.archive_shapes {
            let settings = quality(&format!("--preset archive --block {shape}"));
            shapes.push(plan.add(format!("archive, {}, by quality", shape.replace(',', "x")), settings));
        }
        shapes.push(weighted);
        for shape in values.sampled_shapes {
            let settings = sampling(&format!("{WEIGHTED} --block {shape}"));
            shapes.push(plan.add(format!("paper, DCT, weighted, {}, by sampling", shape.replace(',', "x")), settings));
        }
        plan.sections.push(Section { title: "Block shape", series: shapes });

        let mut tolerances = Vec::new();
        for (name, number) in sampled {
            tolerances.push(number);
            tolerances.push(plan.add(format!("{name}, by sigma"), sigma(&format!("--preset {name}"))));
        }
        plan.sections.push(Section { title: "Tolerance of the solver", series: tolerances });
        plan
    }

    /// The plan with options added to every setting.
    pub fn with(mut self, options: &str) -> Plan {
        if !options.is_empty() {
            let all = self.series.iter_mut().flat_map(|s| &mut s.settings);
            all.for_each(|setting| *setting = format!("{setting} {options}"));
        }
        self
    }

    fn add(&mut self, name: String, settings: Vec<String>) -> usize {
        self.series.push(Series { name, settings });
        self.series.len() - 1
    }

    /// The settings of all points, each once.
    pub fn settings(&self) -> Vec<&str> {
        let mut all: Vec<&str> = Vec::new();
        for setting in self.series.iter().flat_map(|s| &s.settings) {
            if !all.contains(&setting.as_str()) {
                all.push(setting);
            }
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_and_setting_is_tried() {
        for grid in [GridArg::Full, GridArg::Quick] {
            let plan = Plan::of(grid, &[]);
            let settings = plan.settings().join("\n");
            for preset in PresetArg::value_variants() {
                assert!(settings.contains(&format!("--preset {}", preset_name(*preset))));
            }
            for option in ["--quality", "--sampling", "--sigma", "--basis", "--block", "--weighting"] {
                assert!(settings.contains(option), "{option}");
            }
            assert!(plan.sections.iter().flat_map(|s| &s.series).all(|&s| s < plan.series.len()));
        }
        assert!(Plan::of(GridArg::Quick, &[]).settings().len() < 25);
        let two = Plan::of(GridArg::Quick, &[0.5, 0.01, 0.5]);
        assert!(
            two.series
                .iter()
                .any(|s| s.settings == ["--preset paper --sampling 0.01", "--preset paper --sampling 0.5"])
        );
    }
}
