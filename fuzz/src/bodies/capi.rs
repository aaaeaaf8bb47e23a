//! The C ABI: a file of arbitrary bytes from memory, with the wrong lengths, NULL and unaligned pointers that csbrdf.h says are
//! checked. The head says which; the file follows. No call may end in a caught panic.

use std::ptr;

#[allow(unsafe_code, dead_code, missing_docs)]
#[path = "../../../tools/capi/src/lib.rs"]
mod abi;

use abi::csbrdf_status::*;
use abi::*;

use super::seal::sealed;

/// Bytes before the file.
pub const HEAD: usize = 32;

/// Most values of a table that is decoded as a whole.
const VALUES: usize = 1 << 16;

#[allow(unsafe_code)]
pub fn run(data: &[u8]) {
    let Some((head, file)) = data.split_at_checked(HEAD) else { return };
    let file = sealed(file);
    let byte = |i: usize| head[i];
    let mut brdf: *mut csbrdf_brdf = ptr::null_mut();
    // Blocks as those of small tables, so that a hostile header does not cost a run its time.
    let options = csbrdf_options {
        size: size_of::<csbrdf_options>() + if byte(0) >= 250 { usize::from(byte(0)) } else { 0 },
        cache_bytes: usize::from(byte(1)) << 8,
        max_block_values: 1 << 14,
        lookup: if byte(2) >= 250 { byte(2).into() } else { u32::from(byte(2) & 1) },
        pruned: if byte(3) >= 250 { byte(3).into() } else { u32::from(byte(3) & 1) },
        max_table_values: 0,
        max_operations: 0,
        max_bytes: 0,
    };
    // What a later version's caller would give: fields behind those that are known.
    #[repr(C)]
    struct Newer(csbrdf_options, [u8; 256]);
    let newer = Newer(options, std::array::from_fn(|i| if byte(4) == 255 && i == 9 { 1 } else { 0 }));
    // SAFETY: pointers to what is here, as long as their lengths say, or such as the header says are refused.
    unsafe {
        assert_eq!(csbrdf_open_memory(file.as_ptr(), file.len(), ptr::null_mut()), CSBRDF_INVALID_ARGUMENT);
        if !file.is_empty() {
            assert_eq!(csbrdf_open_memory(ptr::null(), file.len(), &mut brdf), CSBRDF_INVALID_ARGUMENT);
            assert!(brdf.is_null());
        }
        assert_ne!(csbrdf_open_memory(ptr::null(), 0, &mut brdf), CSBRDF_OK);
        let status = csbrdf_open_memory_with(file.as_ptr(), file.len(), (&raw const newer).cast(), &mut brdf);
        seen(status);
        assert_eq!(status == CSBRDF_OK, !brdf.is_null());
        if status != CSBRDF_OK {
            message(usize::from(byte(5)));
            assert_eq!(csbrdf_decode_all(brdf, ptr::null_mut(), 0), CSBRDF_INVALID_ARGUMENT);
            csbrdf_close(brdf);
            return;
        }
        use_handle(brdf, head);
        csbrdf_close(brdf);
    }
}

/// # Safety
/// An open handle.
#[allow(unsafe_code)]
unsafe fn use_handle(brdf: *const csbrdf_brdf, head: &[u8]) {
    let byte = |i: usize| head[i];
    let [mut axes, mut channels, mut blocks, mut values] = [0usize; 4];
    let (mut shape, mut origin) = ([0usize; 4], [0usize; 4]);
    // SAFETY: an open handle, places to write to, and buffers as long as their lengths say.
    unsafe {
        assert_eq!(csbrdf_axis_count(brdf, &mut axes), CSBRDF_OK);
        assert_eq!(csbrdf_channel_count(brdf, &mut channels), CSBRDF_OK);
        assert_eq!(csbrdf_block_count(brdf, &mut blocks), CSBRDF_OK);
        assert_eq!(csbrdf_grid_shape(brdf, shape.as_mut_ptr()), CSBRDF_OK);
        assert_eq!(csbrdf_axis_count(brdf, ptr::null_mut()), CSBRDF_INVALID_ARGUMENT);
        assert_eq!(csbrdf_grid_shape(brdf, ptr::null_mut()), CSBRDF_INVALID_ARGUMENT);
        seen(csbrdf_table_size(brdf, &mut values));
        assert!((1..=4).contains(&axes) && channels > 0 && blocks > 0);
        if values <= VALUES {
            let mut table = vec![f32::NAN; values];
            let wrong = values.saturating_sub(usize::from(byte(6)));
            if wrong != values {
                assert_eq!(csbrdf_decode_all(brdf, table.as_mut_ptr(), wrong), CSBRDF_INVALID_ARGUMENT);
            }
            assert_eq!(csbrdf_decode_all(brdf, ptr::null_mut(), values), CSBRDF_INVALID_ARGUMENT);
            let unaligned = table.as_mut_ptr().cast::<u8>().wrapping_add(1).cast::<f32>();
            assert_eq!(csbrdf_decode_all(brdf, unaligned, values), CSBRDF_INVALID_ARGUMENT);
            let status = csbrdf_decode_all(brdf, table.as_mut_ptr(), values);
            seen(status);
            assert!(status != CSBRDF_OK || table.iter().all(super::is_value));
        }
        // Also blocks that do not exist.
        for block in [0, usize::from(byte(7)), blocks - 1, blocks, usize::MAX] {
            let mut size = 0;
            let exists = csbrdf_block_size(brdf, block, &mut size) == CSBRDF_OK;
            assert_eq!(exists, block < blocks);
            let at = csbrdf_block_box(brdf, block, origin.as_mut_ptr(), shape.as_mut_ptr());
            assert_eq!(at == CSBRDF_OK, exists);
            let mut out = vec![f32::NAN; size];
            if exists {
                assert_eq!(shape.iter().product::<usize>() * channels, size);
                assert_eq!(csbrdf_decode_block(brdf, block, out.as_mut_ptr(), size - 1), CSBRDF_INVALID_ARGUMENT);
            }
            let status = csbrdf_decode_block(brdf, block, out.as_mut_ptr(), size);
            seen(status);
            assert!(exists || status == CSBRDF_INVALID_ARGUMENT);
            assert!(status != CSBRDF_OK || out.iter().all(super::is_value));
        }
        let number = |i: usize| f64::from(i16::from_le_bytes([byte(8 + 2 * i), byte(9 + 2 * i)])) / 1024.0;
        let (mut wi, wo): ([f64; 6], [f64; 6]) = (std::array::from_fn(number), std::array::from_fn(|i| number(i + 6)));
        if byte(5) & 1 == 1 {
            wi[usize::from(byte(5) % 6)] = [f64::NAN, f64::INFINITY, f64::MAX, 5e-324][usize::from(byte(5) % 4)];
        }
        let mut out = vec![f32::NAN; 2 * channels];
        let single = csbrdf_eval(brdf, wi.as_ptr(), wo.as_ptr(), out.as_mut_ptr(), channels);
        seen(single);
        assert!(single != CSBRDF_OK || out[..channels].iter().all(super::is_value));
        let mut many = vec![f32::NAN; 2 * channels];
        let status = csbrdf_eval_many(brdf, 2, wi.as_ptr(), wo.as_ptr(), many.as_mut_ptr(), many.len());
        seen(status);
        if (single, status) == (CSBRDF_OK, CSBRDF_OK) {
            assert!(super::same_bits(&out[..channels], &many[..channels]));
        }
        // Lengths that do not fit, and one whose product overflows.
        for (count, length) in [(2, many.len() - 1), (1, many.len()), (usize::MAX, many.len()), (1 << 62, 0)] {
            let status = csbrdf_eval_many(brdf, count, wi.as_ptr(), wo.as_ptr(), many.as_mut_ptr(), length);
            assert_eq!(status, CSBRDF_INVALID_ARGUMENT, "{count} {length}");
        }
        let out = out.as_mut_ptr();
        assert_eq!(csbrdf_eval(brdf, ptr::null(), wo.as_ptr(), out, channels), CSBRDF_INVALID_ARGUMENT);
        assert_eq!(csbrdf_eval(ptr::null(), wi.as_ptr(), wo.as_ptr(), out, channels), CSBRDF_INVALID_ARGUMENT);
        seen(csbrdf_eval_many(brdf, 0, ptr::null(), ptr::null(), ptr::null_mut(), 0));
    }
}

fn seen(status: csbrdf_status) {
    assert_ne!(status, CSBRDF_PANIC);
}

/// The last message, cut to a size: ends in NUL, and is as long as was said where it fits.
#[allow(unsafe_code)]
fn message(size: usize) {
    let mut buffer = vec![0x7Fu8; size];
    // SAFETY: a buffer of that size.
    let length = unsafe { csbrdf_last_error(buffer.as_mut_ptr().cast(), size) };
    assert!(length > 0);
    if size > 0 {
        let end = buffer.iter().position(|b| *b == 0).expect("a NUL");
        assert!(std::str::from_utf8(&buffer[..end]).is_ok() && (length >= size || end == length));
    }
}
