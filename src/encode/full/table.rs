//! The full table, ready to be cut into blocks: logarithms with the grazing profile taken out, holes filled roughly.


use std::sync::Arc;

use rayon::prelude::*;

use super::fill::Fillers;
use super::grazing;
use super::guess::Guesses;
use crate::base::simd::Level;
use crate::codec::channel::ChannelTransform;
use crate::codec::fourier::Basis;
use crate::codec::profile::Profile;
use crate::encode::gather::entry_log;
use crate::encode::settings::Encoder;
use crate::format::profile::CodedProfile;
use crate::table::Table;
use crate::table::block::Block;
use crate::table::grid::Grid;

/// Planes in grid order, one a channel.
pub(in crate::encode) struct FullTable {
    shape: [usize; 4],
    pub(in crate::encode) channels: usize,
    /// Logarithms less the profile; where not known, a guess.
    log: Vec<f32>,
    /// Valid and not exactly zero.
    known: Vec<bool>,
    /// Whether some entries are exactly zero, which the file then stores by themselves.
    pub(in crate::encode) zeros: bool,
    pub(in crate::encode) profile: Option<CodedProfile>,
    pub(in crate::encode) transform: ChannelTransform,
    pub(super) fillers: Arc<Fillers>,
}

/// A block of it, `[channel][position]`.
pub(super) struct FullBlock {
    pub(super) log: Vec<f32>,
    pub(super) known: Vec<bool>,
}

impl FullTable {
    /// Without a profile, holes not filled yet.
    pub(super) fn new(table: &Table, transform: &ChannelTransform, eps: f64, basis: Basis) -> FullTable {
        let grid = table.grid();
        let n = grid.positions();
        let entries = || table.values().iter().zip(table.valid());
        let zeros = entries().any(|(value, valid)| *valid && *value == 0.0);
        let known: Vec<bool> = entries().map(|(value, valid)| *valid && *value != 0.0).collect();
        let mut log = vec![0f32; known.len()];
        for (c, channel) in grid.channels().iter().enumerate() {
            let entries = table.plane(c).par_iter().zip(table.valid_plane(c));
            log[c * n..(c + 1) * n].par_iter_mut().zip(entries).for_each(|(log, (value, valid))| {
                if *valid {
                    *log = entry_log(*value, channel.scale, eps) as f32;
                }
            });
        }
        FullTable {
            shape: grid.shape(),
            channels: grid.channels().len(),
            log,
            known,
            zeros,
            profile: None,
            transform: transform.clone(),
            fillers: Arc::new(Fillers::new(basis)),
        }
    }

    /// The same with the profile that fits best, taken out; `None` if there is none.
    pub(super) fn with_profile(&self, grid: &Grid, settings: &Encoder) -> Option<FullTable> {
        let (coded, profile) =
            grazing::fit(grid, &self.transform, &self.log, &self.known, settings.step, settings.effort)?;
        let mut log = self.log.clone();
        subtract(&profile, &self.transform, self.shape, &mut log);
        let (known, fillers) = (self.known.clone(), Arc::clone(&self.fillers));
        Some(FullTable { log, known, profile: Some(coded), transform: self.transform.clone(), fillers, ..*self })
    }

    /// Whether known entries of a block differ from those of a table with the same ones known.
    pub(super) fn differs(&self, other: &FullTable, block: &Block) -> bool {
        let (a, b) = (self.block(block), other.block(block));
        a.log.iter().zip(&b.log).zip(&a.known).any(|((a, b), known)| *known && a != b)
    }

    /// With guesses for what is not known.
    pub(super) fn filled(mut self, guesses: &Guesses) -> FullTable {
        guesses.fill(self.shape, &mut self.log, &self.known);
        self
    }

    /// For the holes of this table.
    pub(super) fn guesses(&self) -> Guesses {
        Guesses::new(self.shape, self.channels, &self.known)
    }

    pub(super) fn block(&self, block: &Block) -> FullBlock {
        let n = block.positions();
        let plane = self.log.len() / self.channels;
        let mut log = vec![0f32; n * self.channels];
        let mut known = vec![false; log.len()];
        for c in 0..self.channels {
            block.gather(self.shape, &self.log[c * plane..(c + 1) * plane], &mut log[c * n..(c + 1) * n]);
            block.gather(self.shape, &self.known[c * plane..(c + 1) * plane], &mut known[c * n..(c + 1) * n]);
        }
        FullBlock { log, known }
    }
}

/// Takes the profile, which is of components, out of the channels' logarithms.
fn subtract(profile: &Profile, transform: &ChannelTransform, shape: [usize; 4], log: &mut [f32]) {
    let n: usize = shape.iter().product();
    let channels = log.len() / n;
    let slab = n / shape[1];
    let level = Level::detect();
    let mut slabs: Vec<Vec<&mut [f32]>> = (0..shape[1]).map(|_| Vec::new()).collect();
    for plane in log.chunks_exact_mut(n) {
        slabs.iter_mut().zip(plane.chunks_exact_mut(slab)).for_each(|(slab, rows)| slab.push(rows));
    }
    slabs.into_par_iter().enumerate().for_each(|(h, mut planes)| {
        let block = Block { origin: [0, h, 0, 0], shape: [1, 1, shape[2], shape[3]] };
        let mut values = vec![0f32; slab * channels];
        profile.add(level, &block, &mut values);
        transform.inverse(&mut values, channels);
        for (rows, values) in planes.iter_mut().zip(values.chunks_exact(slab)) {
            rows.iter_mut().zip(values).for_each(|(log, value)| *log -= value);
        }
    });
}
