//! A file of arbitrary bytes, evaluated and sampled at arbitrary directions: of any length, NaN and infinities among them. The head
//! says how and where; the file follows.

use arbitrary::{Result, Unstructured};
use csbrdf::brdf::eval::Brdf;
use csbrdf::decode::{Pruned, Reader};
use csbrdf::table::coords::Lookup;

use super::seal::sealed;
use super::{LIMITS, is_value, same_bits};

/// Bytes before the file.
pub const HEAD: usize = 64;

const SPECIAL: [f64; 16] = [
    1.0,
    0.0,
    -0.0,
    -1.0,
    0.5,
    f64::NAN,
    f64::INFINITY,
    f64::NEG_INFINITY,
    f64::MAX,
    f64::MIN,
    f64::MIN_POSITIVE,
    5e-324,
    1e-200,
    1e200,
    f64::EPSILON,
    1.0 - f64::EPSILON,
];

fn number(u: &mut Unstructured) -> Result<f64> {
    let [high, low]: [u8; 2] = u.arbitrary()?;
    Ok(SPECIAL.get(usize::from(high)).copied().unwrap_or(f64::from(i16::from_be_bytes([high, low])) / 32768.0))
}

fn direction(u: &mut Unstructured) -> Result<[f64; 3]> {
    Ok([number(u)?, number(u)?, number(u)?])
}

pub fn run(data: &[u8]) {
    let Some((head, file)) = data.split_at_checked(HEAD) else { return };
    let mut u = Unstructured::new(head);
    let [how, cache]: [u8; 2] = u.arbitrary().expect("the head is long enough");
    let mut pairs = Vec::new();
    // Two bytes a number; what is left over is not used.
    while u.len() >= 12
        && let (Ok(wi), Ok(wo)) = (direction(&mut u), direction(&mut u))
    {
        pairs.push((wi, wo));
    }
    let file = sealed(file);
    let pruned = if how & 1 == 0 { Pruned::Coarse } else { Pruned::Refuse };
    let lookup = if how & 2 == 0 { Lookup::Linear } else { Lookup::Nearest };
    let open = || {
        let reader = Reader::open_with_limits(&file[..], LIMITS).ok()?.with_pruned(pruned);
        Some(Brdf::open(reader).ok()?.with_lookup(lookup))
    };
    let Some(brdf) = open() else { return };
    let channels = brdf.reader().grid().channels().len();
    let mut values = vec![f32::NAN; pairs.len() * channels];
    let mut failed = false;
    for (value, &(wi, wo)) in values.chunks_exact_mut(channels).zip(&pairs) {
        match brdf.eval_into(wi, wo, value) {
            Ok(()) => assert!(value.iter().all(is_value), "{wi:?} {wo:?} {value:?}"),
            Err(_) => failed = true,
        }
    }
    // Many at once, with a cache of another size: the same bits, and damage is seen either way.
    let brdf = open().expect("as before").with_cache_bytes(usize::from(cache) << 10);
    let (wi, wo): (Vec<_>, Vec<_>) = pairs.iter().copied().unzip();
    let mut many = vec![f32::NAN; values.len()];
    match brdf.eval_many(&wi, &wo, &mut many) {
        Ok(()) => assert!(!failed && same_bits(&values, &many)),
        Err(_) => assert!(failed),
    }
    assert!(brdf.eval_many(&wi, &wo[1..], &mut many).is_err());
    let touched = brdf.touched();
    assert!(touched.blocks().len() == brdf.reader().block_count() && brdf.bytes_touched() <= file.len());
    // Takes 50 ms: seldom.
    if how >> 2 != 0x11 {
        return;
    }
    let Ok(importance) = brdf.importance() else { return };
    for (wi, wo) in pairs {
        let density = importance.pdf(wi, wo);
        assert!(density.is_finite() && density >= 0.0, "{wi:?} {wo:?} {density}");
        if let Some(sample) = importance.sample(wi, [wo[0], wo[1]]) {
            assert!(sample.pdf.is_finite() && sample.pdf >= 0.0, "{wi:?} {wo:?} {sample:?}");
            let [x, y, z] = sample.wo;
            assert!((x * x + y * y + z * z - 1.0).abs() < 1e-6 && z >= 0.0, "{wi:?} {wo:?} {sample:?}");
        }
    }
}
