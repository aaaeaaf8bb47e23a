//! `csbrdf encode`: tables in, files out.

mod batch;
mod job;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

use csbrdf::codec::fourier::Basis;
use csbrdf::codec::sample::Sampling;
use csbrdf::encode::contract::Contract;
use csbrdf::encode::{ChannelCoding, Effort, Encoder, Preset};
use csbrdf::format::metadata::Metadata;
use csbrdf::table::Table;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use sha2::{Digest, Sha256};

use crate::args::{BasisArg, ChannelsArg, EffortArg, EncodeArgs, PresetArg, SamplingArg};
use crate::failure::{Failure, Outcome, note};
use crate::guard::Guard;
use crate::input::read_table;
use crate::output::Target;
use crate::path::{is_dash, label};
use crate::sets::manifest::TOOL;
use crate::text::{clean, error_figure, grouped, hex, percent};
use job::{Input, Job};

/// No progress bar for less work than this.
const PATIENCE: Duration = Duration::from_millis(700);

pub fn run(args: &EncodeArgs, threads: Option<u16>, quiet: bool) -> Outcome {
    let given = args.samples.as_ref().map_or(&args.inputs[..], std::slice::from_ref);
    let (inputs, folders) = batch::expand(given, args)?;
    let targets = targets(args, &inputs)?;
    if args.rmse.is_some() && args.quality.is_some() && args.sampling != Some(SamplingArg::Auto) {
        return Err(Failure::usage("--rmse sets the quality; give one of them"));
    }
    let encoder = encoder(args);
    let metadata = metadata(&args.meta)?;
    if let Some(folder) = &args.out_dir {
        std::fs::create_dir_all(folder).map_err(|e| Failure::io(folder, &e))?;
    }
    let guard = Guard::new(args.force, args.replace_source).inputs(inputs.iter().map(|input| &input.path));
    let manifest = args.out_dir.as_deref().filter(|_| args.manifest || folders);
    let set =
        manifest.map(|folder| batch::set(folder, &targets, &settings(&encoder, &metadata), &guard)).transpose()?;
    let job = Job { args, encoder, metadata, guard, set, quiet };
    let ([input], [target], None) = (&inputs[..], &targets[..], manifest) else {
        return batch::run(job, &inputs, &targets, batch::jobs(args, threads), manifest);
    };
    one(&job, input, target)
}

/// What the bytes of a file depend on but for its table, as a hash: of all settings, also those that a later version may add.
fn settings(encoder: &Encoder, metadata: &Metadata) -> String {
    hex(&Sha256::digest(format!("{TOOL}\n{:?}", encoder.clone().metadata(metadata.clone()))))
}

/// Encodes a single table.
fn one(job: &Job, input: &Input, target: &Target) -> Outcome {
    let quiet = job.quiet;
    let (start, bar) = (Instant::now(), OnceLock::new());
    let progress = |share: f64| {
        if !quiet && start.elapsed() > PATIENCE {
            bar.get_or_init(|| progress_bar(&label(&input.path), 1000)).set_position((share * 1000.0) as u64);
        }
    };
    let done = job.encode(input, target, &progress);
    bar.get().inspect(|bar| bar.finish_and_clear());
    let done = done?;
    let [samples, valid] = done.sampled;
    let sampled = if samples < valid { format!("{} sampled, ", percent(samples, valid)) } else { String::new() };
    if !quiet {
        note(&format!(
            "{} -> {target}: {} bytes, {:.1}:1, log rms {}, max {}, {}{}{:.2} s",
            label(&input.path),
            grouped(done.bytes),
            done.ratio,
            error_figure(done.log_rms),
            error_figure(done.log_max),
            sampled,
            done.contract,
            done.seconds
        ));
    }
    if done.sampled[0] == 0 {
        note(&format!("{target}: nothing was sampled, all values are guesses; raise --sampling"));
    }
    Ok(())
}

/// Where each input's file goes.
fn targets(args: &EncodeArgs, inputs: &[Input]) -> Result<Vec<Target>, Failure> {
    if let Some(output) = &args.output {
        if inputs.len() > 1 {
            return Err(Failure::usage("-o names one output for several inputs; use --out-dir DIR"));
        }
        return Ok(vec![Target::of(output)]);
    }
    let mut taken: HashMap<PathBuf, &Path> = HashMap::new();
    let mut targets = Vec::new();
    for Input { path: input, .. } in inputs {
        if is_dash(input) {
            if inputs.len() > 1 {
                return Err(Failure::usage("standard input cannot be one of several inputs"));
            }
            if args.out_dir.is_some() {
                return Err(Failure::usage("standard input has no name to use in --out-dir; use -o OUT"));
            }
            return Ok(vec![Target::Stdout]);
        }
        let beside = input.with_extension("csbrdf");
        let output = match (&args.out_dir, beside.file_name()) {
            (Some(folder), Some(name)) => folder.join(name),
            _ => beside,
        };
        if let Some(other) = taken.insert(output.clone(), input) {
            return Err(Failure::usage(format!(
                "{} and {} would both become {}; encode them one by one with -o",
                other.display(),
                input.display(),
                output.display()
            )));
        }
        targets.push(Target::File(output));
    }
    Ok(targets)
}

/// The encoder with the settings of a command line.
pub fn encoder(args: &EncodeArgs) -> Encoder {
    let mut encoder = Encoder::new().seed(args.seed).preset(match args.preset() {
        PresetArg::Archive => Preset::Archive,
        PresetArg::Paper => Preset::Paper,
        PresetArg::Sparse => Preset::Sparse,
    });
    if args.samples.is_some() {
        encoder = encoder.sampling(Sampling::Every);
    }
    if let Some(step) = args.quality {
        encoder = encoder.quality(step);
    }
    match (args.sampling, args.rmse) {
        (Some(SamplingArg::Ratio(ratio)), _) => {
            if let Some(sampling) = Sampling::from_ratio(ratio) {
                encoder = encoder.sampling(sampling);
            }
        }
        (Some(SamplingArg::Auto), Some(rmse)) => encoder = encoder.sampling_for(rmse),
        _ => {}
    }
    encoder = encoder.lossless(args.lossless);
    if args.spare {
        encoder = encoder.spare(true);
    }
    if let Some(contract) = contract(args) {
        encoder = encoder.contract(contract);
    }
    if let Some(basis) = args.basis {
        encoder = encoder.basis(match basis {
            BasisArg::Dct => Basis::Dct,
            BasisArg::Dft => Basis::Dft,
        });
    }
    if let Some(block) = &args.block {
        encoder = encoder.block_shape(&block.0);
    }
    if let Some(eps) = args.eps {
        encoder = encoder.eps(eps);
    }
    if let Some(sigma) = args.sigma {
        encoder = encoder.sigma(sigma);
    }
    if let Some(iterations) = args.iterations {
        encoder = encoder.iterations(iterations as usize);
    }
    let effort = if args.fast { Some(EffortArg::Fast) } else { args.effort };
    if let Some(effort) = effort {
        encoder = encoder.effort(match effort {
            EffortArg::Fast => Effort::Fast,
            EffortArg::Standard => Effort::Standard,
            EffortArg::Thorough => Effort::Thorough,
        });
    }
    if let Some(weighting) = args.weighting {
        encoder = encoder.weighting(weighting);
    }
    if let Some(channels) = args.channels {
        encoder = encoder.channels(match channels {
            ChannelsArg::Separate => ChannelCoding::Separate,
            ChannelsArg::Opponent => ChannelCoding::Opponent,
        });
    }
    encoder
}

/// The contract that the options ask for.
fn contract(args: &EncodeArgs) -> Option<Contract> {
    let rmse = args.rmse.filter(|_| args.sampling != Some(SamplingArg::Auto));
    (args.max_error.map(Contract::MaxError))
        .or(rmse.map(Contract::Rmse))
        .or(args.psnr.map(Contract::Psnr))
        .or(args.ratio.map(Contract::Ratio))
        .or(args.size.map(Contract::Size))
}

/// The metadata that `--meta` gives.
pub fn metadata(pairs: &[(String, String)]) -> Result<Metadata, Failure> {
    let mut m = Metadata::default();
    for (key, value) in pairs {
        let single = match key.as_str() {
            "name" => &mut m.name,
            "uuid" => &mut m.uuid,
            "version" => &mut m.version,
            "instrument" => &mut m.instrument,
            "date" => &mut m.date,
            "licence" | "license" => &mut m.licence,
            "source_file" => &mut m.source_file,
            "source_sha256" => &mut m.source_sha256,
            "tool" | "encoder" => {
                return Err(Failure::usage(format!("--meta {key}: is written by the encoder itself; use another key")));
            }
            list @ ("copyright" | "copyrights" | "author" | "authors" | "source" | "sources") => {
                match list.trim_end_matches('s') {
                    "copyright" => &mut m.copyrights,
                    "author" => &mut m.authors,
                    _ => &mut m.sources,
                }
                .push(value.clone());
                continue;
            }
            free => {
                if m.other.insert(free.into(), value.clone().into()).is_some() {
                    return Err(Failure::usage(format!("--meta {key}: is given twice")));
                }
                continue;
            }
        };
        if single.replace(value.clone()).is_some() {
            return Err(Failure::usage(format!("--meta {key}: is given twice")));
        }
    }
    Ok(m)
}

/// An outside table's bytes as a table and the metadata of its file.
pub fn parse(input: &Path, bytes: &[u8], metadata: &Metadata) -> Result<(Table, Metadata), Failure> {
    let (table, hash) = rayon::join(|| read_table(bytes), || hex(&Sha256::digest(bytes)));
    let table = table.map_err(|e| Failure::in_file(input, &e))?;
    let metadata = describe(input, hash, &table, metadata)?;
    Ok((table, metadata))
}

/// The metadata of a table's file: that given, and the input's name and hash. A table without valid entries fails.
fn describe(input: &Path, sha256: String, table: &Table, metadata: &Metadata) -> Result<Metadata, Failure> {
    if table.valid_count() == 0 {
        let what = "no entry is valid: all are negative, NaN or infinite; there is nothing to encode";
        return Err(Failure::bad_input(input, what));
    }
    let mut metadata = metadata.clone();
    metadata.source_sha256.get_or_insert(sha256);
    if !is_dash(input) {
        let text = |part: Option<&std::ffi::OsStr>| part.map(|p| p.to_string_lossy().into_owned());
        metadata.source_file = metadata.source_file.or_else(|| text(input.file_name()));
        metadata.name = metadata.name.or_else(|| text(input.file_stem()));
    }
    Ok(metadata)
}

/// A bar on standard error if that is a terminal.
fn progress_bar(what: &str, length: u64) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(Some(length), ProgressDrawTarget::stderr());
    let style = ProgressStyle::with_template("{msg} [{bar:30}] {percent:>3} %  {elapsed}");
    bar.set_style(style.map(|s| s.progress_chars("=> ")).unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.with_message(clean(what))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pairs(list: &[(&str, &str)]) -> Vec<(String, String)> {
        list.iter().map(|(k, v)| (k.to_string(), v.to_string())).collect()
    }

    #[test]
    fn known_keys_find_their_fields() {
        let m = metadata(&pairs(&[("author", "A"), ("authors", "B"), ("license", "MIT"), ("lab", "x")])).unwrap();
        assert_eq!((m.authors, m.licence.as_deref()), (vec!["A".to_string(), "B".into()], Some("MIT")));
        assert_eq!(m.other["lab"], "x");
        assert!(metadata(&pairs(&[("name", "a"), ("name", "b")])).is_err());
        assert!(metadata(&pairs(&[("tool", "a")])).is_err() && metadata(&pairs(&[("x", "a"), ("x", "a")])).is_err());
    }

    #[test]
    fn hashes_are_hexadecimal() {
        assert!(hex(&Sha256::digest(b"abc")).starts_with("ba7816bf8f01cfea"));
    }
}
