//! Builders of small files that claim much.

use std::f64::consts::{FRAC_PI_2, PI};

use crate::codec::channel::ChannelTransform;
use crate::codec::correct;
use crate::codec::dependent::Quantization;
use crate::codec::entropy::Walk;
use crate::codec::fourier::Basis;
use crate::codec::mask::MaskModel;
use crate::codec::range::Encoder;
use crate::codec::sample::Sampling;
use crate::codec::zeros::code_zeros;
use crate::codec::contexts::{CORRECTIONS, MASKS, ZEROS, contexts};
use crate::format::directory;
use crate::format::file::write_file;
use crate::format::header::{Coding, write_coding, write_grid, write_partition};
use crate::format::index::{Entry, write_index};
use crate::format::probabilities::write_probabilities;
use crate::format::profile::{CodedProfile, write_profile};
use crate::format::record::{Record, ValidityClass};
use crate::table::block::{Block, Partition};
use crate::table::grid::{Axis, AxisName, Channel, Grid, Mapping};

/// A file of one shape of blocks, all with the same coded bytes.
#[derive(Clone)]
pub(super) struct Bomb {
    pub(super) lens: [usize; 3],
    pub(super) channels: usize,
    pub(super) block: [usize; 3],
    pub(super) class: ValidityClass,
    pub(super) coded: Vec<u8>,
    pub(super) profile: Option<CodedProfile>,
    pub(super) metadata: Option<Vec<u8>>,
    pub(super) exact: Option<Vec<u8>>,
    pub(super) basis: Basis,
    pub(super) zeros: bool,
    pub(super) correction: Option<f32>,
    pub(super) sampling: Sampling,
}

pub(super) const QUANTIZATION: Quantization = Quantization::Scalar;

impl Default for Bomb {
    fn default() -> Bomb {
        Bomb {
            lens: [8; 3],
            channels: 1,
            block: [8; 3],
            class: ValidityClass::None,
            coded: vec![],
            profile: None,
            metadata: None,
            exact: None,
            basis: Basis::Dct,
            zeros: false,
            correction: None,
            sampling: Sampling::Every,
        }
    }
}

fn even_odds() -> Vec<u16> {
    vec![1 << 15; contexts(QUANTIZATION)]
}

impl Bomb {
    pub(super) fn grid(&self) -> Grid {
        let axis = |(name, end), len| Axis { name, len, mapping: Mapping::Linear, start: 0.0, end };
        let names = [(AxisName::ThetaH, FRAC_PI_2), (AxisName::ThetaD, FRAC_PI_2), (AxisName::PhiD, PI)];
        let axes = names.into_iter().zip(self.lens).map(|(name, len)| axis(name, len)).collect();
        let channel = |_| Channel { name: String::new(), wavelength: None, scale: 1.0 };
        Grid::new(axes, (0..self.channels).map(channel).collect()).unwrap()
    }

    pub(super) fn partition(&self) -> Partition {
        let [a, b, c] = self.block;
        Partition::uniform(self.grid().shape(), [1, a, b, c]).unwrap()
    }

    pub(super) fn file(&self) -> Vec<u8> {
        let (grid, partition) = (self.grid(), self.partition());
        let coding = Coding {
            basis: self.basis,
            quantization: QUANTIZATION,
            eps: 1e-3,
            sampling: self.sampling,
            seed: 0,
            transform: ChannelTransform::None,
            steps: vec![0.1; self.channels],
            shrink: [0; 2],
            horizon: None,
            zeros: self.zeros,
            correction: self.correction,
        };
        let (mut records, mut entries) = (Vec::new(), Vec::new());
        for block in 0..partition.block_count() {
            let record = Record { class: self.class, doublings: 0, coded: &self.coded }.write(block as u32);
            entries.push(Entry { length: record.len() as u32, errors: [0; 2], means: vec![0; self.channels] });
            records.extend(record);
        }
        let mut sections = vec![
            (directory::GRID, false, write_grid(&grid)),
            (directory::CODING, false, write_coding(&coding)),
            (directory::PARTITION, false, write_partition(&partition, 3)),
            (directory::PROBABILITIES, false, write_probabilities(&vec![None; contexts(QUANTIZATION)])),
        ];
        sections.extend(self.profile.as_ref().map(|profile| (directory::PROFILE, false, write_profile(profile))));
        sections.push((directory::INDEX, false, write_index(&partition, &entries)));
        sections.extend(self.metadata.clone().map(|metadata| (directory::METADATA, true, metadata)));
        sections.push((directory::RECORDS, false, records));
        sections.extend(self.exact.clone().map(|exact| (directory::LOSSLESS, true, exact)));
        write_file((1, 0, 4), &sections)
    }

    /// The same with coefficients in every block, as many as there are or the last one alone.
    pub(super) fn with_coefficients(self, all: bool) -> Bomb {
        self.with_record(if all { Content::All } else { Content::Last })
    }

    /// The same with masks, exact zeros and corrections, as the fields say, and coefficients in every block.
    pub(super) fn with_record(self, content: Content) -> Bomb {
        let [a, b, c] = self.block;
        let (n, shape): (usize, _) = (self.block.iter().product(), [1, a, b, c]);
        let class = if self.class == ValidityClass::None { ValidityClass::All } else { self.class };
        let mut planes = vec![0i32; n * self.channels];
        for plane in planes.chunks_exact_mut(n) {
            plane[1..].fill(i32::from(content == Content::All));
            plane[n - 1] = i32::from(content != Content::Nothing);
        }
        planes.chunks_exact_mut(n).for_each(|plane| plane[0] = 0);
        let mut coder = Encoder::new(&even_odds());
        let block = Block { origin: [0; 4], shape };
        let copies = if class == ValidityClass::MaskPerChannel { self.channels } else { 1 };
        let mut masks = vec![true; n * copies];
        if matches!(class, ValidityClass::Mask | ValidityClass::MaskPerChannel) {
            masks[0] = false;
            MaskModel::new(None, None).code(&mut coder, MASKS, &block, &mut masks);
        }
        if self.zeros {
            // All but one of each channel: stored one by one.
            let mut zeros: Vec<bool> =
                (0..n * self.channels).map(|i| masks[i % masks.len()] && i % n + 1 < n).collect();
            code_zeros(&mut coder, ZEROS, shape, self.channels, || &masks, &mut zeros).unwrap();
        }
        Walk::default().code(&mut coder, QUANTIZATION, shape, &planes).unwrap();
        if let Some(step) = self.correction {
            // The contexts depend on values that nobody has rebuilt; whatever comes of that is a correction.
            let (log, mut corrections) = (vec![0.0; n * self.channels], vec![1; n * self.channels]);
            let decoded = correct::Decoded { shape, masks: &masks, log: &log, step };
            correct::Walk::default().code(&mut coder, CORRECTIONS, decoded, &mut corrections).unwrap();
        }
        Bomb { class, coded: coder.finish(), ..self }
    }
}

/// Coefficients of a block.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Content {
    Nothing,
    /// The last one alone, of the highest frequencies.
    Last,
    All,
}

/// A megabyte of as many objects as may be, and of numbers.
pub(super) fn wide() -> String {
    let objects = "{\"other\":[".to_string() + &"{\"\":0},".repeat((1 << 14) - 2);
    objects.clone() + &"0,".repeat(((1 << 20) - objects.len() - 3) / 2) + "0]}"
}

/// Names of files that cost much.
pub(super) const WORST: &[&str] = &[
    "empty",
    "corner",
    "corner-dft",
    "full",
    "rows",
    "blocks",
    "spectral",
    "metadata",
    "one-full",
    "alternating",
    "dft-full",
    "cells",
    "masks",
    "zeros",
    "corrections",
    "channels",
    "points",
    "million",
    "profile",
    "profile-wide",
    "drawn",
    "lossless",
];

/// A file by its name.
pub(super) fn worst(name: &str) -> Vec<u8> {
    let base = Bomb::default;
    let cube = || Bomb { lens: [16, 16, 16], channels: 4096, block: [16; 3], ..base() };
    match name {
        "empty" => Bomb { lens: [512, 256, 256], channels: 8, block: [64, 128, 64], ..base() },
        "corner" => Bomb { lens: [512, 1024, 512], block: [1, 1024, 512], ..base() }.with_coefficients(false),
        "corner-dft" => {
            Bomb { lens: [512, 1024, 512], block: [1, 1024, 512], basis: Basis::Dft, ..base() }.with_coefficients(false)
        }
        "full" => Bomb { lens: [64, 512, 1024], block: [1, 512, 1024], ..base() }.with_coefficients(true),
        "rows" => Bomb { lens: [16384, 16384, 1], block: [512, 1024, 1], ..base() },
        "blocks" => Bomb { lens: [256, 256, 64], block: [1, 1, 1], ..base() },
        "spectral" => Bomb { lens: [64, 64, 1], channels: 4096, block: [1, 1, 1], ..base() },
        "metadata" => {
            let mut metadata = (wide().len() as u32).to_le_bytes().to_vec();
            metadata.extend(zstd::bulk::compress(wide().as_bytes(), 3).unwrap());
            Bomb { metadata: Some(metadata), ..base() }
        }
        // Millions of coefficients in one block; in two, which look-ups need in turn; three channels for pictures.
        "one-full" => Bomb { lens: [128; 3], block: [128; 3], ..base() }.with_coefficients(true),
        "alternating" => {
            Bomb { lens: [128, 128, 64], channels: 3, block: [64, 128, 64], ..base() }.with_coefficients(true)
        }
        "dft-full" => Bomb { lens: [128, 128, 64], channels: 3, block: [64, 128, 64], basis: Basis::Dft, ..base() }
            .with_coefficients(true),
        // Many blocks of middling size with all coefficients: the cache holds few of them.
        "cells" => Bomb { lens: [512, 512, 128], channels: 3, block: [64; 3], ..base() }.with_coefficients(true),
        "masks" => Bomb { class: ValidityClass::MaskPerChannel, ..cube() }.with_coefficients(true),
        "zeros" => Bomb { zeros: true, ..cube() }.with_coefficients(true),
        "corrections" => Bomb { correction: Some(0.1), ..cube() }.with_record(Content::Nothing),
        "channels" => Bomb { lens: [64, 64, 64], ..cube() }.with_coefficients(true),
        "points" => Bomb { lens: [128, 128, 1], channels: 3, block: [1; 3], ..base() }.with_record(Content::Nothing),
        "million" => Bomb { lens: [1024, 1024, 1], block: [1; 3], ..base() },
        "profile" | "profile-wide" => {
            let (channels, bins) = if name == "profile" { (15, 1024) } else { (2048, 64) };
            let first = vec![0; 4 * channels];
            let profile = CodedProfile { knots: 64, zone: 1.0, step: 0.1, first, coded: vec![0; 20], offset: 0 };
            Bomb { lens: [bins, bins.min(64), 1], channels, block: [1; 3], profile: Some(profile), ..base() }
        }
        // Sampled positions are drawn anew for every channel of every block.
        "drawn" => {
            let sampling = Sampling::from_ratio(0.5).unwrap();
            Bomb {
                lens: [512, 256, 256],
                channels: 8,
                block: [64, 128, 64],
                sampling,
                class: ValidityClass::All,
                ..base()
            }
        }
        .with_record(Content::Nothing),
        "lossless" => return lossless(),
        _ => panic!("no bomb {name}"),
    }
    .file()
}

/// A table of one value, encoded with what restores it.
fn lossless() -> Vec<u8> {
    let grid = Bomb { lens: [128, 128, 64], ..Bomb::default() }.grid();
    let values = vec![0.5; grid.positions()];
    let table = crate::table::Table::from_values(grid, values).unwrap();
    let encoder = crate::encode::Encoder::new().block_shape(&[128, 128, 64]).lossless(true).profile(false);
    encoder.encode(&table).unwrap().bytes
}
