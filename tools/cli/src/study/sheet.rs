//! Many materials at one sampling ratio (the paper's figure 5).

use super::csv::{Csv, figure};
use super::folder::Folder;
use super::page::Section;
use super::plan::{PRESETS, Plan, percentage};
use super::trial::Trial;
use crate::failure::Failure;
use crate::picture::Picture;
use crate::text::decibel;

const COLUMNS: usize = 6;

/// One material: PSNR of the objects, CSV fields and sphere for each preset.
pub struct Row {
    name: String,
    tiles: Vec<(f64, Vec<String>, Picture)>,
}

impl Row {
    pub fn new(plan: &Plan, name: &str, trials: &[Trial]) -> Row {
        let tile = |preset: usize| {
            let trial = trials.iter().find(|t| t.preset == preset && t.ratio == plan.focus)?;
            let (psnr, picture) = trial.sphere.as_ref()?;
            let fields = vec![
                name.to_string(),
                PRESETS[preset].0.to_string(),
                plan.focus.to_string(),
                trial.bytes.to_string(),
                figure(trial.log_rms, 5),
                figure(psnr.objects, 2),
                figure(psnr.picture, 2),
            ];
            Some((psnr.objects, fields, picture.clone()))
        };
        Row { name: name.into(), tiles: (0..PRESETS.len()).filter_map(tile).collect() }
    }
}

pub fn write(plan: &Plan, rows: &[Row], folder: &Folder) -> Result<Section, Failure> {
    let mut csv = Csv::new("material,preset,ratio,bytes,log_rms,psnr_objects_db,psnr_picture_db");
    rows.iter().flat_map(|r| &r.tiles).for_each(|(_, fields, _)| csv.row(fields));
    folder.write("sheet.csv", csv.bytes())?;
    let at = percentage(plan.focus);
    let mut section = Section::new(&format!("{} materials at {at} (figure 5)", rows.len()));
    section.text(&format!(
        "Rebuilt from {at} of the entries; in the corners: difference times 8. Environment: {}.",
        plan.environment_name
    ));
    for (preset, (name, _)) in PRESETS.iter().enumerate() {
        let columns = COLUMNS.min(rows.len().max(1));
        let mut sheet = Picture::black(plan.size * columns, plan.size * rows.len().div_ceil(columns).max(1));
        let mut labels = Vec::new();
        let tiles: Vec<_> = rows.iter().filter_map(|r| Some((r, r.tiles.get(preset)?))).collect();
        for (i, (row, (psnr, _, picture))) in tiles.iter().enumerate() {
            sheet.place(plan.size * (i % columns), plan.size * (i / columns), picture);
            labels.push(format!("{}: {} dB", row.name, decibel(*psnr)));
        }
        let mut values: Vec<f64> = tiles.iter().map(|(_, tile)| tile.0).collect();
        values.sort_unstable_by(f64::total_cmp);
        if let (Some(least), Some(most)) = (values.first(), values.last()) {
            section.text(&format!(
                "Preset {name}: {} to {} dB, median {}; {} of {} above 40 dB.",
                decibel(*least),
                decibel(*most),
                decibel(values[values.len() / 2]),
                values.iter().filter(|v| **v > 40.0).count(),
                values.len()
            ));
        }
        let file = format!("sheet-{name}.png");
        folder.picture(&file, &sheet)?;
        section.sheet(&file, &format!("contact sheet, preset {name}"), columns, &labels);
    }
    section.files(&["sheet.csv"]);
    section.command(&format!("{} --only sheet", plan.command_without_only()));
    Ok(section)
}
