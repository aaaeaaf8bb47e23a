//! One material through one preset at one ratio: encode, decode, look.

use csbrdf::assess::render::Texels;
use csbrdf::codec::sample::Sampling;
use csbrdf::decode::Reader;
use csbrdf::encode::Encoder;
use csbrdf::table::BrdfTable;

use super::plan::{PRESETS, Plan, percentage};
use super::progress::Progress;
use super::shot::{self, Psnr, Shot};
use crate::picture::Picture;
use crate::text::{decibel, error_figure, grouped};

/// What became of a material.
pub struct Trial {
    pub preset: usize,
    pub ratio: f64,
    pub bytes: usize,
    pub sampled: usize,
    pub valid: usize,
    pub log_rms: f64,
    pub log_max: f64,
    pub seconds: f64,
    /// Where a sphere was asked for.
    pub sphere: Option<(Psnr, Picture)>,
}

impl Trial {
    /// The trial and the decoded table; its sphere is compared with `reference`.
    pub fn run(
        plan: &Plan,
        preset: usize,
        ratio: f64,
        table: &BrdfTable,
        reference: Option<&Shot>,
        progress: &Progress,
    ) -> csbrdf::Result<(Trial, Texels)> {
        let mut encoder = Encoder::new().seed(plan.seed).preset(PRESETS[preset].1);
        if let Some(sampling) = Sampling::from_ratio(ratio) {
            encoder = encoder.sampling(sampling);
        }
        let encoded = progress.step(|tick| encoder.encode_with(table, tick))?;
        let texels = Texels::new(&Reader::open(&encoded.bytes[..])?.decode_table()?);
        let sphere = match reference {
            Some(shot) => {
                let image = shot::sphere(plan, &texels);
                Some((shot.psnr(&image)?, shot.with_inset(&image)?))
            }
            None => None,
        };
        let report = encoded.report;
        let trial = Trial {
            preset,
            ratio,
            bytes: encoded.bytes.len(),
            sampled: report.sampled,
            valid: report.valid,
            log_rms: report.log_rms,
            log_max: report.log_max,
            seconds: report.seconds,
            sphere,
        };
        Ok((trial, texels))
    }
}

impl std::fmt::Display for Trial {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (preset, ratio) = (PRESETS[self.preset].0, percentage(self.ratio));
        write!(f, "{preset}, {ratio}, {} bytes, log rms {}", grouped(self.bytes), error_figure(self.log_rms))?;
        if let Some((psnr, _)) = &self.sphere {
            write!(f, ", {} dB", decibel(psnr.objects))?;
        }
        write!(f, ", {:.1} s", self.seconds)
    }
}
