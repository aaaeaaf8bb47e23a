//! C ABI of the csbrdf decoder. `include/csbrdf.h` is made from this file, and its comments speak to C programs.
#![allow(non_camel_case_types)]
// What callers owe is said once, at the head of csbrdf.h.
#![allow(clippy::missing_safety_doc)]

mod about;
mod boundary;
mod importance;

use std::ffi::{CStr, c_char};
use std::path::Path;
use std::ptr;

use codec::base::map::map_file;
use codec::table::coords::Lookup;
use codec::{Brdf, BrdfOptions, Bytes, Limits, PrunedPolicy, Reader};

// Programs use them, what includes this file as a module (the fuzz targets) may not.
#[allow(unused_imports)]
pub use {about::*, importance::*};

use boundary::{Outcome, array, buffer, check_length, guard, invalid, last_error, shared, string, write};

/// Version of the interface in this header. It changes when a program that was compiled with one header cannot use a
/// library built from the other; compare with csbrdf_abi_version().
pub const CSBRDF_ABI_VERSION: u32 = 1;

/// csbrdf_options.lookup: linear between bin centres on every axis. The default.
pub const CSBRDF_LOOKUP_LINEAR: u32 = 0;

/// csbrdf_options.lookup: the bin that the directions fall into.
pub const CSBRDF_LOOKUP_NEAREST: u32 = 1;

/// csbrdf_options.pruned: a block that was pruned from the file is CSBRDF_PRUNED, one that was lost is CSBRDF_LOST. The default.
pub const CSBRDF_PRUNED_REFUSE: u32 = 0;

/// csbrdf_options.pruned: a block that was pruned or lost gives its mean.
pub const CSBRDF_PRUNED_COARSE: u32 = 1;

/// What came of a call. csbrdf_last_error() has the details. Later versions may add codes.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum csbrdf_status {
    /// It did what was asked.
    CSBRDF_OK = 0,
    /// The operating system refused: the file is missing, or cannot be read or mapped.
    CSBRDF_IO = 1,
    /// The bytes are not a csbrdf file.
    CSBRDF_NOT_CSBRDF = 2,
    /// A csbrdf file of a version that this library does not read.
    CSBRDF_UNSUPPORTED_VERSION = 3,
    /// The file ends before its contents do.
    CSBRDF_TRUNCATED = 4,
    /// The file is damaged, or contradicts itself.
    CSBRDF_CORRUPT = 5,
    /// A size in the file is above the limit in csbrdf_options, or the file takes more time or memory than one may.
    CSBRDF_LIMIT_EXCEEDED = 6,
    /// An argument is NULL or out of its range, an array has the wrong length, or the file cannot answer the question.
    CSBRDF_INVALID_ARGUMENT = 7,
    /// A bug in the library was caught. The handle can still be used and closed.
    CSBRDF_PANIC = 8,
    /// A block that the call needs was pruned from the file, and the options do not allow its mean in its place.
    CSBRDF_PRUNED = 9,
    /// A block that the call needs was lost to damage before the file was repaired, and the options do not allow what is left of it, its
    /// mean at best, in its place.
    CSBRDF_LOST = 10,
}

/// How to open a file. A field that is 0 takes its default: start with `csbrdf_options options = {0};` (C++:
/// `csbrdf_options options{};`) and set `options.size = sizeof options`.
#[repr(C)]
#[derive(Clone, Copy)]
pub struct csbrdf_options {
    /// sizeof(csbrdf_options). It says which fields the program knows; later versions append some.
    pub size: usize,
    /// Most bytes of decoded blocks that the handle keeps for csbrdf_eval(). Default 64 MiB; one block is kept
    /// whatever it takes.
    pub cache_bytes: usize,
    /// Most values (positions times channels) of a block: a file with larger ones is CSBRDF_LIMIT_EXCEEDED. Decoding a
    /// block takes 40 bytes a value at most. Default and upper bound 2^24, the most that the format allows.
    pub max_block_values: usize,
    /// CSBRDF_LOOKUP_LINEAR or CSBRDF_LOOKUP_NEAREST.
    pub lookup: u32,
    /// CSBRDF_PRUNED_REFUSE or CSBRDF_PRUNED_COARSE.
    pub pruned: u32,
    /// Most values (positions times channels) of a table that is decoded as a whole: a larger one is CSBRDF_LIMIT_EXCEEDED.
    /// Default 2^28; the defaults of the next two grow with it.
    pub max_table_values: usize,
    /// Most operations, about a nanosecond of one processor each, that one call may take but for whole tables, and that
    /// csbrdf_eval() may take over the life of a handle, besides 4096 for each byte of the file: beyond it the call is
    /// CSBRDF_LIMIT_EXCEEDED. Default 10^9.
    pub max_operations: u64,
    /// Most bytes of memory that one call may take beside the caller's buffers and the cache, besides 16 for each byte of
    /// the file: beyond it the call is CSBRDF_LIMIT_EXCEEDED. Default 2^28.
    pub max_bytes: u64,
}

/// What csbrdf_options had in its first version: programs that were compiled with it know no more.
const LEAST_OPTIONS: usize = std::mem::offset_of!(csbrdf_options, max_table_values);

/// The largest csbrdf_options that a later version may have: no more is read on a wrong size field.
const MAX_OPTIONS: usize = 4096;

/// An open file.
pub struct csbrdf_brdf(Brdf);

// The header promises that threads may share a handle.
const _: fn() = || {
    fn shareable<T: Send + Sync>() {}
    shareable::<csbrdf_brdf>();
};

impl csbrdf_brdf {
    fn open(bytes: Bytes, options: &csbrdf_options) -> codec::Result<csbrdf_brdf> {
        let mut limits = match options.max_table_values {
            0 => Limits::default(),
            values => Limits::of_table(values),
        };
        if options.max_operations != 0 {
            limits.operations = options.max_operations;
        }
        if options.max_bytes != 0 {
            limits.bytes = options.max_bytes;
        }
        if options.max_block_values != 0 {
            limits.block_values = options.max_block_values;
        }
        let pruned = if options.pruned == CSBRDF_PRUNED_COARSE { PrunedPolicy::Coarse } else { PrunedPolicy::Refuse };
        let lookup = if options.lookup == CSBRDF_LOOKUP_NEAREST { Lookup::Nearest } else { Lookup::Linear };
        let how = BrdfOptions::new().limits(limits).pruned(pruned).lookup(lookup).any_axes(true);
        let how = match options.cache_bytes {
            0 => how,
            bytes => how.cache_bytes(bytes),
        };
        Ok(csbrdf_brdf(how.from_bytes(bytes)?))
    }

    fn reader(&self) -> &Reader {
        self.0.reader()
    }

    fn channels(&self) -> usize {
        self.reader().grid().channels().len()
    }

    fn table_size(&self) -> Option<usize> {
        self.reader().grid().positions().checked_mul(self.channels())
    }
}

/// The caller's options, checked; the default ones for NULL.
///
/// # Safety
/// Unless it is NULL, `options` points to as many bytes as its `size` says, which are not written to meanwhile.
unsafe fn read_options(options: *const csbrdf_options) -> Outcome<csbrdf_options> {
    let known = size_of::<csbrdf_options>();
    let mut read = csbrdf_options {
        size: known,
        cache_bytes: 0,
        max_block_values: 0,
        lookup: 0,
        pruned: 0,
        max_table_values: 0,
        max_operations: 0,
        max_bytes: 0,
    };
    if options.is_null() {
        return Ok(read);
    }
    // SAFETY: `size` comes first: it is there in every version.
    let size = *unsafe { shared(options.cast::<usize>(), "options") }?;
    if !(LEAST_OPTIONS..=MAX_OPTIONS).contains(&size) {
        return Err(invalid(format!("options.size is {size}; set it to sizeof(csbrdf_options), here {known}")));
    }
    let given = size.min(known);
    // SAFETY: `size` bytes are there: those of the fields that both sides know, which any bits are values of, and those behind.
    let unknown = unsafe {
        ptr::copy_nonoverlapping(options.cast::<u8>(), (&raw mut read).cast::<u8>(), given);
        array(options.cast::<u8>().add(given), size - given, "options")?
    };
    if unknown.iter().any(|byte| *byte != 0) {
        return Err(invalid("options has a field set that this version of the library does not know"));
    }
    if read.lookup > CSBRDF_LOOKUP_NEAREST {
        return Err(invalid(format!("options.lookup is {}, which is no lookup", read.lookup)));
    }
    if read.pruned > CSBRDF_PRUNED_COARSE {
        return Err(invalid(format!("options.pruned is {}, which is no answer for pruned blocks", read.pruned)));
    }
    Ok(read)
}

/// What all functions that open have in common: `*out` is the handle, or NULL.
///
/// # Safety
/// Unless NULL, `options` is as [`read_options`] wants it and `out` good for writing.
unsafe fn open_with(
    options: *const csbrdf_options,
    out: *mut *mut csbrdf_brdf,
    open: impl FnOnce(&csbrdf_options) -> Outcome<csbrdf_brdf>,
) -> csbrdf_status {
    guard(|| {
        // SAFETY: this function's own condition.
        let options = unsafe {
            write(out, ptr::null_mut(), "out")?;
            read_options(options)?
        };
        let brdf = Box::into_raw(Box::new(open(&options)?));
        // SAFETY: as above.
        unsafe { write(out, brdf, "out") }
    })
}

/// A number about an open file.
///
/// # Safety
/// Unless NULL, `brdf` is an open handle and `number` good for writing.
unsafe fn query(
    brdf: *const csbrdf_brdf,
    number: *mut usize,
    name: &str,
    ask: impl FnOnce(&csbrdf_brdf) -> Outcome<usize>,
) -> csbrdf_status {
    // SAFETY: this function's own condition.
    guard(|| unsafe { write(number, ask(shared(brdf, "brdf")?)?, name) })
}

/// CSBRDF_ABI_VERSION of the library.
#[unsafe(no_mangle)]
pub extern "C" fn csbrdf_abi_version() -> u32 {
    CSBRDF_ABI_VERSION
}

/// Version of the library, such as "1.0.0". The string is never freed.
#[unsafe(no_mangle)]
pub extern "C" fn csbrdf_version() -> *const c_char {
    const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
        Ok(version) => version,
        Err(_) => panic!("one NUL, at the end"),
    };
    VERSION.as_ptr()
}

/// Copies the message of the calling thread's last call that failed, in English and UTF-8, into `buffer`: at most
/// `size` bytes with the terminating NUL, cut between characters. Calls that succeed leave the message as it is.
///
/// Returns the length of the whole message in bytes, without the NUL (as snprintf does): it was cut if that is `size`
/// or more. 0 if no call has failed. `buffer` may be NULL to ask for the length alone.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_last_error(buffer: *mut c_char, size: usize) -> usize {
    // SAFETY: the header asks for a buffer of `size` bytes.
    unsafe { last_error(buffer, size) }
}

/// Opens the file at a path in UTF-8 (NUL-terminated) and puts a handle to close into `*out`, or NULL on failure.
/// Reads and checks the header and the index; blocks are read when they are first needed.
///
/// The file is mapped into memory. It may be replaced by renaming another over it, but must not be written to or
/// truncated while the handle is open: the process would end by SIGBUS. Where that can happen, read it and use
/// csbrdf_open_memory().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_open_path(utf8_path: *const c_char, out: *mut *mut csbrdf_brdf) -> csbrdf_status {
    // SAFETY: the same conditions.
    unsafe { csbrdf_open_path_with(utf8_path, ptr::null(), out) }
}

/// As csbrdf_open_path(), with options; NULL for the default ones.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_open_path_with(
    utf8_path: *const c_char,
    options: *const csbrdf_options,
    out: *mut *mut csbrdf_brdf,
) -> csbrdf_status {
    let open = |options: &csbrdf_options| {
        // SAFETY: the header asks for a string.
        let path = Path::new(unsafe { string(utf8_path, "utf8_path") }?);
        let bytes = Bytes::from(map_file(path)?);
        Ok(csbrdf_brdf::open(bytes, options).map_err(|e| e.in_file(path))?)
    };
    // SAFETY: the header asks for options or NULL, and for a place to write to.
    unsafe { open_with(options, out, open) }
}

/// Opens a file of `size` bytes in memory, which are copied, and puts a handle to close into `*out`, or NULL on
/// failure.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_open_memory(data: *const u8, size: usize, out: *mut *mut csbrdf_brdf) -> csbrdf_status {
    // SAFETY: the same conditions.
    unsafe { csbrdf_open_memory_with(data, size, ptr::null(), out) }
}

/// As csbrdf_open_memory(), with options; NULL for the default ones.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_open_memory_with(
    data: *const u8,
    size: usize,
    options: *const csbrdf_options,
    out: *mut *mut csbrdf_brdf,
) -> csbrdf_status {
    let open = |options: &csbrdf_options| {
        // SAFETY: the header asks for `size` bytes.
        let bytes = unsafe { array(data, size, "data") }?.to_vec();
        Ok(csbrdf_brdf::open(Bytes::from(bytes), options)?)
    };
    // SAFETY: the header asks for options or NULL, and for a place to write to.
    unsafe { open_with(options, out, open) }
}

/// Closes a handle; NULL is allowed and does nothing. No other call may be using the handle, nor use it afterwards.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_close(brdf: *mut csbrdf_brdf) {
    guard(|| {
        if !brdf.is_null() {
            // SAFETY: the header asks for a handle that csbrdf_open_...() gave and that nobody uses any more.
            drop(unsafe { Box::from_raw(brdf) });
        }
        Ok(())
    });
}

/// Number of axes of the grid, 1 to 4.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_axis_count(brdf: *const csbrdf_brdf, count: *mut usize) -> csbrdf_status {
    // SAFETY: the header asks for an open handle and a place to write to.
    unsafe { query(brdf, count, "count", |brdf| Ok(brdf.reader().grid().axes().len())) }
}

/// Number of channels, 1 to 4096: 3 for R, G, B.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_channel_count(brdf: *const csbrdf_brdf, count: *mut usize) -> csbrdf_status {
    // SAFETY: the header asks for an open handle and a place to write to.
    unsafe { query(brdf, count, "count", |brdf| Ok(brdf.channels())) }
}

/// Number of blocks, at least 1.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_block_count(brdf: *const csbrdf_brdf, count: *mut usize) -> csbrdf_status {
    // SAFETY: the header asks for an open handle and a place to write to.
    unsafe { query(brdf, count, "count", |brdf| Ok(brdf.reader().block_count())) }
}

/// cbindgen:ptrs-as-arrays=[[shape;4]]
/// Number of bins along each axis, slowest axis first, with ones in front where there are fewer than four axes: 1, 90,
/// 90, 180 for MERL's theta_h, theta_d, phi_d.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_grid_shape(brdf: *const csbrdf_brdf, shape: *mut usize) -> csbrdf_status {
    // SAFETY: the header asks for an open handle and four places to write to.
    guard(|| unsafe { write(shape.cast::<[usize; 4]>(), shared(brdf, "brdf")?.reader().grid().shape(), "shape") })
}

/// Number of values of the whole table: positions of the grid times channels. The length that csbrdf_decode_all()
/// needs.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_table_size(brdf: *const csbrdf_brdf, values: *mut usize) -> csbrdf_status {
    let size = |brdf: &csbrdf_brdf| brdf.table_size().ok_or_else(|| invalid("the table does not fit in memory"));
    // SAFETY: the header asks for an open handle and a place to write to.
    unsafe { query(brdf, values, "values", size) }
}

/// Number of values of a block: its positions times channels. The length that csbrdf_decode_block() needs.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_block_size(
    brdf: *const csbrdf_brdf,
    block: usize,
    values: *mut usize,
) -> csbrdf_status {
    // SAFETY: the header asks for an open handle and a place to write to.
    unsafe { query(brdf, values, "values", |brdf| Ok(brdf.reader().block_values(block)?)) }
}

/// cbindgen:ptrs-as-arrays=[[origin;4], [shape;4]]
/// Where a block stands: position of its first bin and its bins along each axis, both in the axes of
/// csbrdf_grid_shape().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_block_box(
    brdf: *const csbrdf_brdf,
    block: usize,
    origin: *mut usize,
    shape: *mut usize,
) -> csbrdf_status {
    guard(|| {
        // SAFETY: the header asks for an open handle.
        let reader = unsafe { shared(brdf, "brdf") }?.reader();
        // Says what is wrong with a block that does not exist.
        reader.block_values(block)?;
        let place = reader.partition().block(block).ok_or_else(|| invalid("no such block"))?;
        // SAFETY: the header asks for four places to write to, twice.
        unsafe {
            write(origin.cast(), place.origin, "origin")?;
            write(shape.cast(), place.shape, "shape")
        }
    })
}

/// Decodes one block into `out`, BRDF in 1/sr: one channel after the other, each the block's box with the last axis
/// fastest. Bins that were not measured hold what the encoder filled in.
///
/// `length` must be what csbrdf_block_size() gives.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_decode_block(
    brdf: *const csbrdf_brdf,
    block: usize,
    out: *mut f32,
    length: usize,
) -> csbrdf_status {
    guard(|| {
        // SAFETY: the header asks for an open handle.
        let reader = unsafe { shared(brdf, "brdf") }?.reader();
        check_length("out", length, Some(reader.block_values(block)?))?;
        // SAFETY: the header asks for `length` values that nobody else uses.
        let out = unsafe { buffer(out, length, "out") }?;
        Ok(reader.block_into(block, out)?)
    })
}

/// Decodes the whole table into `out`, BRDF in 1/sr: one channel after the other, each of the shape of the grid with
/// the last axis fastest. Bins that were not measured hold what the encoder filled in. Needs no more memory than one
/// block's besides `out`.
///
/// `length` must be what csbrdf_table_size() gives.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_decode_all(brdf: *const csbrdf_brdf, out: *mut f32, length: usize) -> csbrdf_status {
    guard(|| {
        // SAFETY: the header asks for an open handle.
        let brdf = unsafe { shared(brdf, "brdf") }?;
        check_length("out", length, brdf.table_size())?;
        // SAFETY: the header asks for `length` values that nobody else uses.
        let out = unsafe { buffer(out, length, "out") }?;
        Ok(brdf.reader().decode_all_into(out)?)
    })
}

/// cbindgen:ptrs-as-arrays=[[wi;3], [wo;3]]
/// BRDF in 1/sr of each channel, for light from `wi` and view to `wo`: vectors x, y, z away from the surface in its
/// frame, z along the normal, of any length. 0 if one points below the horizon, is zero or not finite.
///
/// `channels` is the length of `out` and must be what csbrdf_channel_count() gives. CSBRDF_INVALID_ARGUMENT if the
/// axes of the file are not angles of directions.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_eval(
    brdf: *const csbrdf_brdf,
    wi: *const f64,
    wo: *const f64,
    out: *mut f32,
    channels: usize,
) -> csbrdf_status {
    // SAFETY: the same conditions.
    unsafe { csbrdf_eval_many(brdf, 1, wi, wo, out, channels) }
}

/// csbrdf_eval() of `count` pairs of directions: `wi` and `wo` hold x, y, z of one after the other (3 * count values),
/// `out` receives all channels of the first pair, then those of the second, and so on.
///
/// `length` is that of `out`, count times what csbrdf_channel_count() gives.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn csbrdf_eval_many(
    brdf: *const csbrdf_brdf,
    count: usize,
    wi: *const f64,
    wo: *const f64,
    out: *mut f32,
    length: usize,
) -> csbrdf_status {
    guard(|| {
        // SAFETY: the header asks for an open handle.
        let brdf = unsafe { shared(brdf, "brdf") }?;
        let channels = brdf.channels();
        check_length("out", length, count.checked_mul(channels))?;
        // SAFETY: the header asks for `count` vectors in each of two arrays, and for `length` values that nobody else
        // uses.
        let (wi, wo, out) = unsafe {
            let wi = array(wi.cast::<[f64; 3]>(), count, "wi")?;
            let wo = array(wo.cast::<[f64; 3]>(), count, "wo")?;
            (wi, wo, buffer(out, length, "out")?)
        };
        Ok(brdf.0.eval_many(wi, wo, out)?)
    })
}
