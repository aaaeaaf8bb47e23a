//! Many look-ups and draws at once, on all cores where there are enough of them.

use codec::brdf::eval::Brdf;
use codec::brdf::importance::Importance;
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

/// Draws of all rows, and their densities; rows without one are left as they are.
pub fn sample_many(
    importance: &Importance,
    wi: &[[f64; 3]],
    u: &[[f64; 2]],
    wo: &mut [[f64; 3]],
    pdf: &mut [f64],
) -> codec::Result<()> {
    let draw = |wi: &[f64; 3], u: &[f64; 2], wo: &mut [f64; 3], pdf: &mut f64| {
        if let Some(sample) = importance.sample(*wi, *u) {
            (*wo, *pdf) = (sample.wo, sample.pdf);
        }
    };
    if wi.len() < 2 * GRAIN {
        wi.iter().zip(u).zip(wo.iter_mut().zip(pdf)).for_each(|((wi, u), (wo, pdf))| draw(wi, u, wo, pdf));
        return Ok(());
    }
    let rows = wi.par_iter().zip(u).zip(wo.par_iter_mut().zip(pdf)).with_min_len(GRAIN);
    on_threads(|| {
        rows.for_each(|((wi, u), (wo, pdf))| draw(wi, u, wo, pdf));
        Ok(())
    })
}

/// Densities of all pairs.
pub fn pdf_many(importance: &Importance, wi: &[[f64; 3]], wo: &[[f64; 3]], pdf: &mut [f64]) -> codec::Result<()> {
    let look_up = |((&wi, &wo), pdf): ((&[f64; 3], &[f64; 3]), &mut f64)| *pdf = importance.pdf(wi, wo);
    if wi.len() < 2 * GRAIN {
        wi.iter().zip(wo).zip(pdf).for_each(look_up);
        return Ok(());
    }
    let rows = wi.par_iter().zip(wo).zip(pdf).with_min_len(GRAIN);
    on_threads(|| {
        rows.for_each(look_up);
        Ok(())
    })
}
