//! Where every valid entry is a sample: the full table, filled, cut into tiles and blocks, and quantised.

mod fill;
mod grazing;
mod guess;
mod quantise;
mod table;
pub(super) mod tiles;
pub(super) mod trellis;

use super::settings::Encoder;
use crate::base::error::Result;
use crate::codec::channel::ChannelTransform;
use crate::codec::fourier::Basis;
use crate::table::Table;
pub(super) use table::FullTable;

/// A table made ready: with a grazing profile where that costs less.
pub(super) fn prepare(table: &Table, transform: &ChannelTransform, settings: &Encoder) -> Result<FullTable> {
    let grid = table.grid();
    let plain = FullTable::new(table, transform, settings.eps, settings.basis);
    let fitted = settings.profile && settings.basis == Basis::Dct;
    let guesses = plain.guesses();
    let steep = fitted.then(|| plain.with_profile(grid, settings)).flatten();
    let (plain, steep) = rayon::join(|| plain.filled(&guesses), || steep.map(|steep| steep.filled(&guesses)));
    let Some(steep) = steep else { return Ok(plain) };
    drop(guesses);
    Ok(if tiles::profile_pays(settings, &plain, &steep, grid)? { steep } else { plain })
}
