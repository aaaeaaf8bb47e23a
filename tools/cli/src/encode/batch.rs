//! Several tables: a few at a time, so that the peak of memory stays theirs, reported in the order of the inputs.
//!
//! An encode is parallel inside and leaves processors idle where it reads, hashes and writes; the next one fills them.
//! Six MERL tables on two processors, shared with other work (one was had on average), best of three runs with 1, 2, 3, 4
//! at a time: 29.4, 27.2, 29.4, 31.2 s, peak 220, 361, 521, 653 MB. The seconds differ by less than from run to run.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc;
use std::time::Instant;

use indicatif::ProgressBar;

use super::job::{Done, Input, Job};
use super::{PATIENCE, progress_bar};
use crate::args::EncodeArgs;
use crate::failure::{Failure, Outcome, note};
use crate::guard::Guard;
use crate::output::Target;
use crate::path::{is_dash, label};
use crate::sets::manifest::{self, Manifest, Material};
use crate::sets::unfinished::{Set, note_unfinished};
use crate::text::{error_figure, grouped};

/// Most tables at a time unless more are asked for: with these 653 MB were measured at the default settings.
const MOST_JOBS: usize = 4;

/// Parts of one table's progress.
const FINE: f64 = 1000.0;

/// How many tables to encode at a time.
pub fn jobs(args: &EncodeArgs, threads: Option<u16>) -> usize {
    let threads = threads.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), usize::from);
    args.jobs.map_or(threads.min(MOST_JOBS), usize::from)
}

/// The inputs with the tables of a folder in its place, by name; and whether there was a folder.
pub fn expand(given: &[PathBuf], args: &EncodeArgs) -> Result<(Vec<Input>, bool), Failure> {
    let (mut inputs, mut folders) = (Vec::new(), false);
    for path in given {
        if is_dash(path) || args.samples.is_some() || !path.is_dir() {
            inputs.push(Input { path: path.clone(), in_folder: false });
            continue;
        }
        folders = true;
        let tables = tables(path)?;
        if tables.is_empty() {
            let what = "no .binary file in it; give a folder of MERL tables (csbrdf synth makes some)";
            return Err(Failure::operation(format!("{}: {what}", path.display())));
        }
        inputs.extend(tables.into_iter().map(|path| Input { path, in_folder: true }));
    }
    if folders && args.out_dir.is_none() {
        return Err(Failure::usage("a folder of tables becomes a folder of files; name it with --out-dir DIR"));
    }
    Ok((inputs, folders))
}

/// The .binary files of a folder but hidden ones, by name.
fn tables(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let failed = |e: std::io::Error| Failure::io(folder, &e);
    let mut tables = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(failed)? {
        let entry = entry.map_err(failed)?;
        let (path, hidden) = (entry.path(), entry.file_name().as_encoded_bytes().starts_with(b"."));
        if csbrdf::io::is_named_as_table(&path) && !hidden && !path.is_dir() {
            tables.push(path);
        }
    }
    tables.sort_unstable();
    Ok(tables)
}

/// Begins the set of these files, or goes on with it.
pub fn set(folder: &Path, targets: &[Target], settings: &str, guard: &Guard) -> Result<Set, Failure> {
    let mut names = Vec::new();
    for target in targets {
        let Target::File(path) = target else { continue };
        let Some(name) = path.file_name().and_then(|name| name.to_str()) else {
            let what = "its name is not UTF-8, which a manifest must be; rename its table";
            return Err(Failure::operation(format!("{target}: {what}")));
        };
        names.push(name.to_string());
    }
    Set::open(folder, settings, &names, guard.replaces())
}

/// Encodes all inputs, `jobs` at a time; one that fails does not keep the others from being encoded. With a folder for it,
/// writes the manifest of those that were, last.
pub fn run(job: Job, inputs: &[Input], targets: &[Target], jobs: usize, folder: Option<&Path>) -> Outcome {
    let (start, quiet) = (Instant::now(), job.quiet);
    let progress = Progress::new(inputs.len(), quiet);
    let mut results = Vec::with_capacity(inputs.len());
    let mut first_failure = None;
    let encode = |i: usize| job.encode(&inputs[i], &targets[i], &|share| progress.advance(i, share));
    in_order(inputs.len(), jobs, &encode, &mut |i, result| {
        if let Err(failure) = &result {
            progress.report(failure);
        }
        let result = result.map_err(|failure| first_failure.get_or_insert(failure.reported()).code());
        results.push((label(&inputs[i].path), result));
    });
    progress.finish();
    if !quiet {
        summarise(&results);
    }
    // A file that is there although its table failed now: without it a manifest would have a hole.
    let left = results.iter().zip(targets).any(|((_, result), target)| match target {
        Target::File(path) => result.is_err() && std::fs::symlink_metadata(path).is_ok(),
        Target::Stdout => false,
    });
    let materials: Vec<_> =
        results.into_iter().filter_map(|(_, result)| result.ok()).map(|done| done.material).collect();
    if let (Some(set), Some(folder)) = (job.set, folder) {
        let complete = !left && !materials.is_empty();
        match complete {
            true => finish(set, folder, materials, &job.guard, (!quiet).then_some(start))?,
            // Of nothing there is no manifest, and that of an earlier run still holds.
            false => {
                if left && !quiet {
                    note_unfinished(folder);
                }
                set.leave()?;
            }
        }
    }
    first_failure.map_or(Ok(()), Err)
}

/// Writes the manifest of a set unless it is there, and ends the set; says so with the time since `start`, if given.
fn finish(set: Set, folder: &Path, materials: Vec<Material>, guard: &Guard, start: Option<Instant>) -> Outcome {
    let target = Target::File(folder.join(manifest::NAME));
    let manifest = Manifest::new(set.settings(), materials);
    let mut text = Vec::new();
    manifest.write(&mut text).map_err(|e| Failure::in_arguments(&e))?;
    if !set.has_manifest(&text) {
        // The one that is there was found to be of this set, or may be replaced.
        target.write(&guard.clone().forced(), |out| Ok(out.write_all(&text)?))?;
    }
    set.finish()?;
    if let Some(start) = start {
        let (count, bytes, ratio) = (manifest.materials.len(), manifest.bytes(), manifest.ratio());
        let (bytes, seconds) = (grouped(bytes as usize), start.elapsed().as_secs_f64());
        note(&format!("{target}: {count} materials, {bytes} bytes, {ratio:.1}:1, {seconds:.2} s"));
    }
    Ok(())
}

/// Does `count` pieces of work, begun in order, `jobs` at a time; hands over what came of them in order, each as soon as
/// those before it are.
fn in_order<T: Send>(
    count: usize,
    jobs: usize,
    work: &(dyn Fn(usize) -> T + Sync),
    hand_over: &mut dyn FnMut(usize, T),
) {
    let next = AtomicUsize::new(0);
    let (sender, receiver) = mpsc::channel();
    std::thread::scope(|scope| {
        for _ in 0..jobs.clamp(1, count.max(1)) {
            let (next, sender) = (&next, sender.clone());
            scope.spawn(move || {
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    if i >= count || sender.send((i, work(i))).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        let mut waiting: Vec<Option<T>> = (0..count).map(|_| None).collect();
        let mut first = 0;
        for (i, result) in receiver {
            waiting[i] = Some(result);
            while let Some(result) = waiting.get_mut(first).and_then(Option::take) {
                hand_over(first, result);
                first += 1;
            }
        }
    });
}

/// One bar over all tables.
struct Progress {
    start: Instant,
    bar: Option<ProgressBar>,
    shares: Vec<AtomicU64>,
    total: AtomicU64,
}

impl Progress {
    fn new(tables: usize, quiet: bool) -> Progress {
        let length = tables as u64 * FINE as u64;
        Progress {
            start: Instant::now(),
            bar: (!quiet).then(|| progress_bar(&format!("{tables} tables"), length)),
            shares: (0..tables).map(|_| AtomicU64::new(0)).collect(),
            total: AtomicU64::new(0),
        }
    }

    fn advance(&self, i: usize, share: f64) {
        let now = (share * FINE) as u64;
        let gain = now.saturating_sub(self.shares[i].fetch_max(now, Ordering::Relaxed));
        let total = gain + self.total.fetch_add(gain, Ordering::Relaxed);
        if let Some(bar) = self.bar.as_ref().filter(|_| gain > 0 && self.start.elapsed() > PATIENCE) {
            bar.set_position(total);
        }
    }

    /// Reports a failure beside the bar, quiet or not.
    fn report(&self, failure: &Failure) {
        self.bar.as_ref().map_or_else(|| failure.report(), |bar| bar.suspend(|| failure.report()));
    }

    fn finish(&self) {
        self.bar.as_ref().inspect(|bar| bar.finish_and_clear());
    }
}

/// The table after several inputs.
fn summarise(results: &[(String, Result<Done, u8>)]) {
    let width = results.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0).max(4);
    note(&format!("{:width$} {:>11} {:>10} {:>9} {:>9} {:>8}", "file", "bytes", "ratio", "log rms", "max", "seconds"));
    let mut failed = 0;
    for (name, result) in results {
        match result {
            Ok(done) => note(&format!(
                "{name:width$} {:>11} {:>8.1}:1 {:>9} {:>9} {:>8}",
                grouped(done.bytes),
                done.ratio,
                error_figure(done.log_rms),
                error_figure(done.log_max),
                if done.kept { "kept".into() } else { format!("{:.2}", done.seconds) }
            )),
            Err(_) => {
                failed += 1;
                note(&format!("{name:width$} {:>11}", "failed"));
            }
        }
    }
    if failed > 0 {
        note(&format!("{failed} of {} failed", results.len()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_order_from_any_number_of_jobs() {
        for (count, jobs) in [(0, 2), (1, 4), (20, 1), (20, 3), (5, 50)] {
            let mut seen = Vec::new();
            // The first ones take longest.
            let work = |i: usize| {
                std::thread::sleep(std::time::Duration::from_millis(if i < 2 { 20 } else { 0 }));
                i * i
            };
            in_order(count, jobs, &work, &mut |i, square| seen.push((i, square)));
            assert_eq!(seen, (0..count).map(|i| (i, i * i)).collect::<Vec<_>>(), "{count} by {jobs}");
        }
    }
}
