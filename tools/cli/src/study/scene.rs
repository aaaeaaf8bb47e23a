//! Two materials in one scene (the paper's figure 1).

use csbrdf::assess::render::rays::{Material, render};
use csbrdf::assess::render::scene::StillLife;
use csbrdf::assess::render::{Image, Texels};

use super::csv::{Csv, figure};
use super::folder::Folder;
use super::page::Section;
use super::plan::{PRESETS, Plan, percentage};
use super::progress::Progress;
use super::shot::Shot;
use crate::failure::Failure;
use crate::picture::Picture;
use crate::text::decibel;

/// The two materials, as they come in.
#[derive(Default)]
pub struct Cast {
    roles: [Role; 2],
}

#[derive(Default)]
struct Role {
    /// Name and reference; `None` for a table that failed.
    reference: Option<(String, Texels)>,
    /// By preset.
    rebuilt: Vec<(usize, Texels)>,
}

impl Cast {
    /// A rebuilt table.
    pub fn enter(&mut self, role: usize, preset: usize, texels: Texels) {
        self.roles[role].rebuilt.push((preset, texels));
    }

    /// The reference, when all of a material has been done.
    pub fn name(&mut self, role: usize, name: &str, reference: Texels) {
        self.roles[role].reference = Some((name.into(), reference));
    }
}

pub fn write(plan: &Plan, cast: &Cast, folder: &Folder, progress: &Progress) -> Result<Section, Failure> {
    let mut csv = Csv::new("material_0,material_1,preset,ratio,psnr_objects_db,psnr_picture_db");
    let mut section = Section::new(&format!("Two materials in one scene at {} (figure 1)", percentage(plan.focus)));
    let [Some((ball, first)), Some((ring, second))] = [0, 1].map(|i| cast.roles[i].reference.as_ref()) else {
        section.text("Left out: the table of one of the two materials failed.");
        folder.write("scene.csv", csv.bytes())?;
        return Ok(section);
    };
    progress.begin("scene");
    let failed = |e: csbrdf::Error| Failure::operation(format!("scene: {}", e.kind()));
    let shot = Shot::new(&StillLife, picture(plan, first, second));
    folder.picture("scene-reference.png", &shot.picture())?;
    section.text(&format!(
        "A ball of {ball} and a ring of {ring} on a floor of grey squares, direct light with shadows, {} samples a \
         pixel. Environment: {}.",
        plan.samples, plan.environment_name
    ));
    section.image("scene-reference.png", "Reference");
    for (preset, (name, _)) in PRESETS.iter().enumerate() {
        let rebuilt = |role: usize| cast.roles[role].rebuilt.iter().find(|r| r.0 == preset).map(|r| &r.1);
        let (Some(first), Some(second)) = (rebuilt(0), rebuilt(1)) else { continue };
        let image = picture(plan, first, second);
        let psnr = shot.psnr(&image).map_err(failed)?;
        csv.row(&[
            ball.clone(),
            ring.clone(),
            name.to_string(),
            plan.focus.to_string(),
            figure(psnr.objects, 2),
            figure(psnr.picture, 2),
        ]);
        let difference = shot.difference(&image).map_err(failed)?;
        let mut pair = Picture::black(2 * image.width, image.height);
        pair.place(0, 0, &shot.expose(&image));
        pair.place(image.width, 0, &difference);
        let file = format!("scene-{name}.png");
        folder.picture(&file, &pair)?;
        let (objects, all) = (decibel(psnr.objects), decibel(psnr.picture));
        section.claim(
            "the two-material scene at 5 %: 51.63 dB",
            &format!("preset {name} at {}: {objects} dB ({all} dB)", percentage(plan.focus)),
        );
        section.image(&file, &format!("Preset {name}: rebuilt, and the difference times 8"));
    }
    folder.write("scene.csv", csv.bytes())?;
    section.files(&["scene.csv"]);
    section.command(&format!("{} --only scene", plan.command_without_only()));
    Ok(section)
}

fn picture(plan: &Plan, first: &Texels, second: &Texels) -> Image {
    let ball: Material = &|wi, wo| first.eval(wi, wo);
    let ring: Material = &|wi, wo| second.eval(wi, wo);
    // Albedo over pi.
    let light: Material = &|_, _| [0.14, 0.14, 0.135];
    let dark: Material = &|_, _| [0.05, 0.052, 0.056];
    render(&StillLife, &[ball, ring, light, dark], &plan.environment, &plan.scene_quality())
}
