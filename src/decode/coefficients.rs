//! What a block is synthesised from, plainly: for decoders that do the transform elsewhere, such as a GPU.

use super::{Reader, Scratch};
use crate::base::budget::{lengthen, repeated, with_room};
use crate::base::error::{Error, Result};
use crate::codec::channel::ChannelTransform;
use crate::codec::fourier::Basis;
use crate::table::block::Block;

/// Values of an entry, with one mask, zeros, profile and corrections: 1 + 1 + 4 + 4 bytes.
const BYTES: u64 = 10;

/// A block's coefficients, dequantised, and what makes values of them ([`Reader::coefficients`]).
///
/// Positions are row-major in the block's shape, the last axis fastest. The steps, for each position:
///
/// 1. Synthesise each component: `x[t]` is the sum of its coefficients times the basis. The DCT's function at frequencies
///    k is the product over the axes of `w cos(pi k (2 i + 1) / (2 n))`, with `w = sqrt(1/n)` for k = 0 and `sqrt(2/n)`
///    otherwise, n the axis' length and i the place along it; that of the DFT is defined in section 4.4 of the format's specification.
/// 2. Add the grazing profile: `x[t] += profile[t]`, if there is one.
/// 3. Components become channels: `log[c] = sum over t of x[t] * matrix[t * channels + c]`; without a matrix `log[c] = x[c]`.
/// 4. Corrections, if there are any: `log[c] += correction_step * corrections[c]`.
/// 5. `f[c] = max(exp(log[c]) - eps, 0)` in 1/sr, and 0 where `zeros` says so.
///
/// In exact arithmetic, or nearly so, these are the values of [`Reader::block_into`] to some 1e-4 of `f + eps`. They are the same bits only
/// by the order of sums and the elementary functions of the specification.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Spectrum {
    /// Place in the grid, and shape of each component: four axes, padded in front with ones.
    pub block: Block,
    /// The basis, orthonormal along each axis.
    pub basis: Basis,
    /// For each component, as many as channels, position and coefficient (log domain) of those that are not zero, ascending. The position of a
    /// coefficient in the block's shape holds its frequencies. The first is always that at 0: the component's mean over the block
    /// times the root of the number of positions, be it zero or not.
    pub components: Vec<Vec<(u32, f32)>>,
    /// Quantiser step of each component, log domain: what its coefficients were rounded to.
    pub steps: Vec<f32>,
    /// How far below a multiple of the step coefficients of magnitude 1, and of 2 and above, were put; in steps. The coefficients have
    /// it already.
    pub shrink: [f32; 2],
    /// The grazing profile over the block, `[component][position]`, log domain; empty if the file has none.
    pub profile: Vec<f32>,
    /// Orthonormal matrix, `[component][channel]`; `None` where components are the channels.
    pub matrix: Option<Vec<f32>>,
    /// Corrections, `[channel][position]`, in steps of `correction_step`; empty if the block has none.
    pub corrections: Vec<i32>,
    /// Step of the corrections, log domain; 0 if the file has none.
    pub correction_step: f32,
    /// Constant of the logarithm, 1/sr.
    pub eps: f32,
    /// Exact zeros, `[channel][position]`; empty if the block has none.
    pub zeros: Vec<bool>,
    /// Which entries were measured, `[channel][position]`; the others hold what the recovery filled in.
    pub valid: Vec<bool>,
}

impl<D: AsRef<[u8]>> Reader<D> {
    /// What a block is synthesised from. Reading goes through the checks and the budget of [`Reader::block_into`]; only a file with corrections is
    /// synthesised for it, since these are coded by what the values are without them.
    ///
    /// # Errors
    /// As [`Reader::block_into`].
    pub fn coefficients(&self, block: usize) -> Result<Spectrum> {
        let (budget, scratch) = (self.call(), &mut Scratch::default());
        let place = self.place(block)?;
        self.prepare(&budget)?;
        match self.coding().correction {
            Some(_) => _ = self.decode_log(block, scratch, &budget)?,
            None => self.decode_coefficients(block, &place, scratch, &budget)?,
        }
        let values = self.block_values(block)?;
        budget.spend(self.codec.work_of_profile(&place) + values as u64)?;
        let _held = budget.holding(16 * scratch.coefficients.len() as u64 + BYTES * values as u64)?;
        let coding = self.coding();
        Ok(Spectrum {
            block: place,
            basis: coding.basis,
            components: self.components_of(block, scratch)?,
            steps: repeated(&coding.steps, 1)?,
            shrink: coding.shrink.map(|shrink| f32::from(shrink) / 256.0),
            profile: self.profile_of(&place, values)?,
            matrix: match &coding.transform {
                ChannelTransform::None => None,
                ChannelTransform::Matrix(matrix) => Some(repeated(matrix, 1)?),
            },
            valid: self.codec.masks_of(&place, scratch)?,
            corrections: std::mem::take(&mut scratch.corrections),
            correction_step: coding.correction.unwrap_or(0.0),
            eps: coding.eps as f32,
            zeros: std::mem::take(&mut scratch.zeros),
        })
    }

    /// The coefficients in the scratch, dequantised.
    fn components_of(&self, block: usize, scratch: &mut Scratch) -> Result<Vec<Vec<(u32, f32)>>> {
        let means = self.index.means(block);
        let mut components = with_room(means.len())?;
        for (component, mean) in means.iter().enumerate() {
            let mut terms = Vec::new();
            self.codec.dequantize(component, scratch.coefficients.of_channel(component), *mean, &mut terms)?;
            components.push(terms);
        }
        Ok(components)
    }

    /// The grazing profile over a block of `values` values.
    fn profile_of(&self, place: &Block, values: usize) -> Result<Vec<f32>> {
        let mut profile = Vec::new();
        if let Some(coded) = &self.codec.coded_profile {
            lengthen(&mut profile, values, 0.0)?;
            let added = self.codec.add_profile(place, &mut profile);
            added.map_err(|what| Error::corrupt("GRAZ", coded.offset, what))?;
        }
        Ok(profile)
    }
}
