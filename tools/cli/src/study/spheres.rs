//! Spheres of a material at several sampling ratios (the paper's figure 4).

use super::csv::{Csv, figure};
use super::folder::Folder;
use super::page::Section;
use super::plan::{PRESETS, Plan, percentage};
use super::plot::{Line, lines};
use super::shot::Shot;
use super::trial::Trial;
use crate::failure::Failure;
use crate::picture::Picture;
use crate::text::decibel;

/// One material.
pub struct Row {
    name: String,
    /// For each preset the reference and the spheres by ratio.
    strips: Vec<Picture>,
    cells: Vec<Cell>,
}

/// The figures of one trial.
struct Cell {
    preset: usize,
    ratio: f64,
    objects: f64,
    fields: Vec<String>,
}

impl Row {
    pub fn new(plan: &Plan, name: &str, shot: &Shot, trials: &[Trial]) -> Row {
        let strip = |preset: usize| {
            let mut strip = Picture::black(plan.size * (1 + plan.ratios.len()), plan.size);
            strip.place(0, 0, &shot.picture());
            let own = trials.iter().filter(|t| t.preset == preset).filter_map(|t| t.sphere.as_ref());
            for (i, (_, picture)) in own.enumerate() {
                strip.place(plan.size * (i + 1), 0, picture);
            }
            strip
        };
        let cell = |t: &Trial| {
            let psnr = t.sphere.as_ref().map(|s| s.0)?;
            let fields = vec![
                name.to_string(),
                PRESETS[t.preset].0.to_string(),
                t.ratio.to_string(),
                t.sampled.to_string(),
                t.valid.to_string(),
                t.bytes.to_string(),
                figure(t.log_rms, 5),
                figure(t.log_max, 4),
                figure(psnr.objects, 2),
                figure(psnr.picture, 2),
                figure(t.seconds, 2),
            ];
            Some(Cell { preset: t.preset, ratio: t.ratio, objects: psnr.objects, fields })
        };
        Row {
            name: name.into(),
            strips: (0..PRESETS.len()).map(strip).collect(),
            cells: trials.iter().filter_map(cell).collect(),
        }
    }

    fn of(&self, preset: usize) -> impl Iterator<Item = &Cell> {
        self.cells.iter().filter(move |c| c.preset == preset)
    }
}

pub fn write(plan: &Plan, rows: &[Row], folder: &Folder) -> Result<Section, Failure> {
    let mut csv = Csv::new(
        "material,preset,ratio,sampled_entries,valid_entries,bytes,log_rms,log_max,psnr_objects_db,psnr_picture_db,\
         encode_seconds",
    );
    rows.iter().flat_map(|r| &r.cells).for_each(|cell| csv.row(&cell.fields));
    folder.write("spheres.csv", csv.bytes())?;
    let mut section = Section::new("Spheres by sampling ratio (figure 4)");
    section.text(&format!(
        "Spheres of unit radius without perspective, direct light, {} samples a pixel. Environment: {}. In the corners: \
         difference times 8.",
        plan.samples, plan.environment_name
    ));
    for (preset, (name, _)) in PRESETS.iter().enumerate() {
        let count = rows.iter().map(|r| r.of(preset).count()).sum::<usize>();
        let below: Vec<String> = rows
            .iter()
            .flat_map(|r| r.of(preset).map(move |c| (r, c)))
            .filter(|(_, c)| c.objects <= 40.0)
            .map(|(r, c)| format!("{} at {} ({})", r.name, percentage(c.ratio), decibel(c.objects)))
            .collect();
        section.claim(
            "all above 40 dB but chrome-steel at 1 and 2.5 %",
            &match below.len() {
                0 => format!("preset {name}: all {count} above 40 dB"),
                n => format!("preset {name}: {} of {count} above 40 dB; not {}", count - n, below.join(", ")),
            },
        );
        let plot: Vec<Line> = rows
            .iter()
            .map(|r| Line {
                name: r.name.clone(),
                points: r.of(preset).map(|c| (100.0 * c.ratio, c.objects)).collect(),
            })
            .collect();
        let file = format!("spheres-{name}.svg");
        let svg =
            lines(&format!("Preset {name}"), ["sampled entries, percent", "PSNR of the objects, dB"], 40.0, &plot)?;
        folder.write(&file, svg.as_bytes())?;
        section.small_image(&file, &format!("PSNR by ratio, preset {name}; the dashed line is 40 dB"));
    }
    for (preset, (name, _)) in PRESETS.iter().enumerate() {
        let mut sheet = Picture::black(plan.size * (1 + plan.ratios.len()), plan.size * rows.len().max(1));
        let mut labels = Vec::new();
        for (i, row) in rows.iter().enumerate() {
            sheet.place(0, plan.size * i, &row.strips[preset]);
            labels.push(row.name.clone());
            labels.extend(row.of(preset).map(|c| format!("{}: {} dB", percentage(c.ratio), decibel(c.objects))));
        }
        let file = format!("spheres-{name}.png");
        folder.picture(&file, &sheet)?;
        section.text(&format!("Preset {name}: reference, then by ratio."));
        section.sheet(&file, &format!("spheres, preset {name}"), 1 + plan.ratios.len(), &labels);
    }
    section.files(&["spheres.csv"]);
    section.command(&format!("{} --only spheres", plan.command_without_only()));
    if let Some(row) = rows.first() {
        section.command(&plan.encode_command(&row.name));
    }
    Ok(section)
}
