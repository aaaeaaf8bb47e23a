//! Many look-ups at once: the one place that loops over pairs of directions.

use codec::eval::Brdf;
use rayon::prelude::*;

use crate::Bytes;
use crate::boundary::on_threads;

/// The directions `wi` and `wo`.
pub type Pair = [[f64; 3]; 2];

/// Pairs that a thread takes at a time, about 200 us; fewer than twice as many are not worth a second thread.
const GRAIN: usize = 256;

/// Values of all pairs, `[pair][channel]`.
pub fn eval_many(brdf: &Brdf<Bytes>, pairs: &[Pair], values: &mut [f32]) -> codec::Result<()> {
    let channels = brdf.reader().grid().channels().len();
    let eval = |pairs: &[Pair], values: &mut [f32]| {
        let mut each = pairs.iter().zip(values.chunks_exact_mut(channels));
        each.try_for_each(|(&[wi, wo], value)| brdf.eval_into(wi, wo, value))
    };
    if pairs.len() < 2 * GRAIN {
        return eval(pairs, values);
    }
    let parts = pairs.par_chunks(GRAIN).zip(values.par_chunks_mut(GRAIN * channels));
    on_threads(|| parts.try_for_each(|(pairs, values)| eval(pairs, values)))
}
