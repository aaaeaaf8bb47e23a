//! Many look-ups at once, on all cores where there are enough of them.

use codec::eval::Brdf;
use rayon::prelude::*;

use crate::Bytes;
use crate::boundary::on_threads;

/// Pairs that a thread takes at a time, about 200 us; fewer than twice as many are not worth a second thread.
const GRAIN: usize = 256;

/// Values of all pairs, `[pair][channel]`.
pub fn eval_many(brdf: &Brdf<Bytes>, wi: &[[f64; 3]], wo: &[[f64; 3]], values: &mut [f32]) -> codec::Result<()> {
    if wi.len() < 2 * GRAIN {
        return brdf.eval_many(wi, wo, values);
    }
    let channels = brdf.reader().grid().channels().len();
    let parts = wi.par_chunks(GRAIN).zip(wo.par_chunks(GRAIN)).zip(values.par_chunks_mut(GRAIN * channels));
    on_threads(|| parts.try_for_each(|((wi, wo), values)| brdf.eval_many(wi, wo, values)))
}
