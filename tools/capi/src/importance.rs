//! Importance sampling.

use std::ptr;

use codec::brdf::importance::Importance;

use super::boundary::{Outcome, guard, invalid, shared, write};
use super::{csbrdf_brdf, csbrdf_status};

/// What draws directions where a material reflects. Needs its file no more once it is made.
pub struct csbrdf_importance(Importance);

// The header promises that threads may share a handle.
const _: fn() = || {
    fn shareable<T: Send + Sync>() {}
    shareable::<csbrdf_importance>();
};

/// Decodes the file once, some 50 ms for a MERL table on one thread, and puts what draws directions for it into `*out`,
/// to be freed by csbrdf_importance_free(), or NULL on failure. It takes some 100 kB and does not refer to `brdf`.
///
/// Files with other axes than half and difference angles draw by the cosine alone. Blocks that were pruned draw few
/// directions, unless the options allow their means.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_importance_new(
    brdf: *const csbrdf_brdf,
    out: *mut *mut csbrdf_importance,
) -> csbrdf_status {
    guard(|| {
        // SAFETY: the header asks for a place to write to and an open handle.
        let reader = unsafe {
            write(out, ptr::null_mut(), "out")?;
            shared(brdf, "brdf")?.reader()
        };
        let made = Box::into_raw(Box::new(csbrdf_importance(Importance::new(reader)?)));
        // SAFETY: as above.
        unsafe { write(out, made, "out") }
    })
}

/// Frees what csbrdf_importance_new() made; NULL is allowed and does nothing. No other call may be using it, nor use
/// it afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_importance_free(importance: *mut csbrdf_importance) {
    guard(|| {
        if !importance.is_null() {
            // SAFETY: the header asks for what csbrdf_importance_new() gave and nobody uses any more.
            drop(unsafe { Box::from_raw(importance) });
        }
        Ok(())
    });
}

/// cbindgen:ptrs-as-arrays=[[wi;3], [u;2], [wo;3]]
/// Draws a direction for `wi` (as in csbrdf_eval()) by two numbers from 0 to below 1: `wo` becomes a unit vector above
/// the horizon, `*pdf` its density in 1/sr, positive. A BRDF is reciprocal: light and view may change places.
///
/// CSBRDF_INVALID_ARGUMENT if `wi` is zero, not finite, or not above the horizon.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_importance_sample(
    importance: *const csbrdf_importance,
    wi: *const f64,
    u: *const f64,
    wo: *mut f64,
    pdf: *mut f64,
) -> csbrdf_status {
    guard(|| {
        // SAFETY: the header asks for a handle, for three and for two numbers.
        let (importance, wi, u) =
            unsafe { (shared(importance, "importance")?, direction(wi, "wi")?, *shared(u.cast::<[f64; 2]>(), "u")?) };
        let Some(sample) = importance.0.sample(wi, u) else {
            return Err(invalid(format!("wi is {wi:?}, not above the horizon")));
        };
        // SAFETY: the header asks for places to write to.
        unsafe {
            write(wo.cast(), sample.wo, "wo")?;
            write(pdf, sample.pdf, "pdf")
        }
    })
}

/// cbindgen:ptrs-as-arrays=[[wi;3], [wo;3]]
/// Density in 1/sr of csbrdf_importance_sample() at `wo` for `wi`; it integrates to 1 over the hemisphere of `wo`. 0 if
/// one of them is zero, not finite, or not above the horizon.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_importance_pdf(
    importance: *const csbrdf_importance,
    wi: *const f64,
    wo: *const f64,
    pdf: *mut f64,
) -> csbrdf_status {
    guard(|| {
        // SAFETY: the header asks for a handle, for three numbers twice, and for a place to write to.
        unsafe {
            let density = shared(importance, "importance")?.0.pdf(direction(wi, "wi")?, direction(wo, "wo")?);
            write(pdf, density, "pdf")
        }
    })
}

/// # Safety
/// Unless it is NULL, `from` points to three numbers that are not written to meanwhile.
unsafe fn direction(from: *const f64, name: &str) -> Outcome<[f64; 3]> {
    // SAFETY: this function's own condition.
    unsafe { shared(from.cast::<[f64; 3]>(), name) }.copied()
}
