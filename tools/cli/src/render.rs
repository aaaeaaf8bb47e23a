//! `csbrdf render`: a picture straight from files, block by block as the scene asks for them.

use std::path::Path;
use std::sync::Mutex;
use std::time::Instant;

use csbrdf::assess::render::environment::Environment;
use csbrdf::assess::render::rays::{Material, Quality, Scene, render, subject_mask};
use csbrdf::assess::render::scene::{Ball, StillLife};
use csbrdf::brdf::Brdf;

use crate::args::RenderArgs;
use crate::failure::{Failure, Outcome, note};
use crate::guard::Guard;
use crate::input::{self, label};
use crate::output::Target;
use crate::picture::Picture;
use crate::prune::write_trace;
use crate::text::grouped;

pub fn run(args: &RenderArgs, quiet: bool) -> Outcome {
    if !args.trace.is_empty() && args.trace.len() != args.files.len() {
        return Err(Failure::usage("give --trace once for each file, in their order"));
    }
    let output = args.output.clone().unwrap_or_else(|| args.files[0].with_extension("png"));
    let target = Target::of(&output);
    let brdfs = args.files.iter().map(|file| open(file, args)).collect::<Result<Vec<_>, _>>()?;
    let guard = Guard::new(args.force, args.replace_source).inputs(&args.files);
    let guard = args.files.iter().zip(&brdfs).fold(guard, |guard, (file, brdf)| guard.source_of(file, brdf.reader()));
    target.check(&guard)?;
    args.trace.iter().try_for_each(|trace| Target::File(trace.clone()).check(&guard))?;
    // A renderer has no way to stop at a block that is damaged or pruned: the first error is kept for afterwards.
    let failed: Mutex<Option<(usize, csbrdf::Error)>> = Mutex::new(None);
    let value = |file: usize, wi, wo| {
        brdfs[file].eval(wi, wo).unwrap_or_else(|e| {
            if let Ok(mut failed) = failed.lock() {
                failed.get_or_insert((file, e));
            }
            [0.0; 3]
        })
    };
    let start = Instant::now();
    let first: Material = &|wi, wo| value(0, wi, wo);
    let second: Material = &|wi, wo| value(1, wi, wo);
    // Albedo over pi.
    let light: Material = &|_, _| [0.14, 0.14, 0.135];
    let dark: Material = &|_, _| [0.05, 0.052, 0.056];
    let size = usize::from(args.size);
    let quality = |width, height| Quality { width, height, samples: usize::from(args.samples), seed: args.seed };
    let picture = match brdfs.len() {
        1 => shoot(&Ball, &[first], &quality(size, size)),
        _ => shoot(&StillLife, &[first, second, light, dark], &quality(size * 5 / 3, size)),
    };
    let seconds = start.elapsed().as_secs_f64();
    if let Some((file, error)) = failed.into_inner().unwrap_or_default() {
        return Err(Failure::in_file(&args.files[file], &error));
    }
    picture.write(&target, &guard)?;
    for (trace, brdf) in args.trace.iter().zip(&brdfs) {
        write_trace(trace, &brdf.touched(), &guard, quiet)?;
    }
    if !quiet {
        for (file, brdf) in args.files.iter().zip(&brdfs) {
            note(&format!(
                "{}: {} of {} blocks looked at, {} rebuilt, {} bytes of records read",
                label(file),
                brdf.touched().count(),
                brdf.reader().block_count(),
                brdf.blocks_rebuilt(),
                grouped(brdf.bytes_touched())
            ));
        }
        note(&format!("{}: {seconds:.2} s", label(&output)));
    }
    Ok(())
}

fn open(file: &Path, args: &RenderArgs) -> Result<Brdf, Failure> {
    let reader = input::open(file)?.with_pruned(input::pruned(args.coarse));
    let channels = reader.grid().channels().len();
    if channels != 3 {
        return Err(Failure::unsupported(
            file,
            format!("has {channels} channels; a picture needs red, green and blue"),
        ));
    }
    Brdf::from_reader(reader).map_err(|e| Failure::in_file(file, &e))
}

/// Renders a scene, exposed for what is to be looked at.
fn shoot(scene: &impl Scene, materials: &[Material], quality: &Quality) -> Picture {
    let image = render(scene, materials, &Environment::built_in(), quality);
    let mask = subject_mask(scene, image.width, image.height);
    Picture::of(&image, image.exposure_over(&mask))
}
