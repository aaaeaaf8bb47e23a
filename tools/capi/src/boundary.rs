//! What stands between C and the codec: status codes, the message of the last failure, checked pointers, no unwinding.

use std::any::Any;
use std::cell::RefCell;
use std::ffi::{CStr, c_char};
use std::panic::{AssertUnwindSafe, catch_unwind};

use codec::Error;

use super::csbrdf_status::{self, *};

thread_local! {
    static LAST_ERROR: RefCell<String> = const { RefCell::new(String::new()) };
}

/// Why a call failed.
#[derive(Debug)]
pub struct Failure {
    status: csbrdf_status,
    message: String,
}

/// What a call's body gives.
pub type Outcome<T = ()> = Result<T, Failure>;

impl From<Error> for Failure {
    fn from(e: Error) -> Failure {
        let status = match e.kind() {
            Error::Io(_) => CSBRDF_IO,
            Error::NotCsbrdf { .. } => CSBRDF_NOT_CSBRDF,
            Error::UnsupportedVersion { .. } => CSBRDF_UNSUPPORTED_VERSION,
            Error::Truncated { .. } => CSBRDF_TRUNCATED,
            Error::LimitExceeded { .. } | Error::OutOfMemory { .. } => CSBRDF_LIMIT_EXCEEDED,
            Error::InvalidArgument(_) => CSBRDF_INVALID_ARGUMENT,
            Error::Pruned { .. } => CSBRDF_PRUNED,
            Error::Lost { .. } => CSBRDF_LOST,
            // Contracts are the encoder's: to a reader, a file that breaks one contradicts itself.
            _ => CSBRDF_CORRUPT,
        };
        Failure { status, message: e.to_string() }
    }
}

/// A failure that the caller's arguments are to blame for.
pub fn invalid(message: impl Into<String>) -> Failure {
    Failure { status: CSBRDF_INVALID_ARGUMENT, message: message.into() }
}

/// Fails unless the caller's array has the length that the call needs.
pub fn check_length(name: &str, got: usize, expected: Option<usize>) -> Outcome {
    match expected {
        Some(expected) if got == expected => Ok(()),
        Some(expected) => Err(invalid(format!("{name} must hold {expected} values, not {got}"))),
        None => Err(invalid(format!("{name} would need more values than fit in memory"))),
    }
}

/// Runs the body of a call: its failure, or the panic that it ended in, becomes the thread's last error.
pub fn guard(body: impl FnOnce() -> Outcome) -> csbrdf_status {
    // A panic leaves nothing half-done in a handle: blocks enter its cache whole, its buffers are overwritten by the
    // next decode, and its lock is taken over if poisoned.
    let failure = match catch_unwind(AssertUnwindSafe(body)) {
        Ok(Ok(())) => return CSBRDF_OK,
        Ok(Err(failure)) => failure,
        Err(payload) => Failure { status: CSBRDF_PANIC, message: panic_message(&*payload) },
    };
    // A thread that is about to end may have no place for it any more.
    let _ = LAST_ERROR.try_with(|last| last.replace(without_nul(failure.message)));
    failure.status
}

/// What the message quotes from a file or a path must not end it early.
fn without_nul(message: String) -> String {
    if message.contains('\0') { message.replace('\0', "\u{FFFD}") } else { message }
}

fn panic_message(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<String>().map(String::as_str).or(payload.downcast_ref::<&str>().copied());
    format!("a bug in csbrdf, please report it: {}", text.unwrap_or("no message"))
}

/// Copies the thread's last error, cut between characters to `size` bytes with its NUL; gives its whole length.
///
/// # Safety
/// `buffer` is NULL or good for writing `size` bytes.
pub unsafe fn last_error(buffer: *mut c_char, size: usize) -> usize {
    let copy = |message: &RefCell<String>| {
        let message = message.borrow();
        // SAFETY: this function's own condition; no one else has the thread's message.
        unsafe { write_text(&message, buffer, size) };
        message.len()
    };
    catch_unwind(|| LAST_ERROR.try_with(copy).unwrap_or(0)).unwrap_or(0)
}

/// Copies a text, cut between characters to `size` bytes with its NUL.
///
/// # Safety
/// `buffer` is NULL or good for writing `size` bytes.
pub unsafe fn write_text(text: &str, buffer: *mut c_char, size: usize) {
    if buffer.is_null() || size == 0 {
        return;
    }
    let cut = (0..size.min(text.len() + 1)).rev().find(|&n| text.is_char_boundary(n)).unwrap_or(0);
    // SAFETY: cut < size, and the caller vouches for that many bytes.
    unsafe {
        buffer.cast::<u8>().copy_from_nonoverlapping(text.as_ptr(), cut);
        buffer.add(cut).write(0);
    }
}

fn check<T>(pointer: *const T, name: &str) -> Outcome {
    match (pointer.is_null(), pointer.is_aligned()) {
        (true, _) => Err(invalid(format!("{name} is NULL"))),
        (false, false) => Err(invalid(format!("{name} is not aligned for its type"))),
        (false, true) => Ok(()),
    }
}

/// What a pointer points to.
///
/// # Safety
/// Unless it is NULL, it points to a `T` that lives and is not written to for `'a`.
pub unsafe fn shared<'a, T>(pointer: *const T, name: &str) -> Outcome<&'a T> {
    check(pointer, name)?;
    // SAFETY: not NULL, aligned; the caller vouches for the rest.
    Ok(unsafe { &*pointer })
}

/// Puts a value where the caller wants it.
///
/// # Safety
/// Unless `to` is NULL, it is good for writing a `T`.
pub unsafe fn write<T>(to: *mut T, value: T, name: &str) -> Outcome {
    check(to, name)?;
    // SAFETY: not NULL, aligned; the caller vouches for the rest.
    unsafe { to.write(value) };
    Ok(())
}

/// An array of the caller's to read from; NULL is an empty one.
///
/// # Safety
/// Unless it is NULL, `from` points to `length` of `T` that live and are not written to for `'a`.
pub unsafe fn array<'a, T>(from: *const T, length: usize, name: &str) -> Outcome<&'a [T]> {
    if length == 0 {
        return Ok(&[]);
    }
    check(from, name)?;
    check_size::<T>(length, name)?;
    // SAFETY: not NULL, aligned, within isize::MAX bytes; the caller vouches for the rest.
    Ok(unsafe { std::slice::from_raw_parts(from, length) })
}

/// An array of the caller's to write to, zeroed since what it held may be nothing at all; NULL is an empty one.
///
/// # Safety
/// Unless it is NULL, `to` points to room for `length` floats that nothing else reads or writes for `'a`.
pub unsafe fn buffer<'a>(to: *mut f32, length: usize, name: &str) -> Outcome<&'a mut [f32]> {
    // SAFETY: this function's own condition; all bits zero is a float.
    unsafe { zeroed(to, length, name) }
}

/// The same for bytes.
///
/// # Safety
/// As [`buffer`].
pub unsafe fn bytes<'a>(to: *mut u8, length: usize, name: &str) -> Outcome<&'a mut [u8]> {
    // SAFETY: this function's own condition; zero is a byte.
    unsafe { zeroed(to, length, name) }
}

/// # Safety
/// As [`buffer`]; all bits zero is a `T`.
unsafe fn zeroed<'a, T>(to: *mut T, length: usize, name: &str) -> Outcome<&'a mut [T]> {
    if length == 0 {
        return Ok(&mut []);
    }
    check(to, name)?;
    check_size::<T>(length, name)?;
    // SAFETY: not NULL, aligned, within isize::MAX bytes, the first line initialises it; the caller vouches for the
    // rest.
    Ok(unsafe {
        to.write_bytes(0, length);
        std::slice::from_raw_parts_mut(to, length)
    })
}

fn check_size<T>(length: usize, name: &str) -> Outcome {
    match length <= isize::MAX as usize / size_of::<T>() {
        true => Ok(()),
        false => Err(invalid(format!("{name} has {length} values: more than fit in memory"))),
    }
}

/// A string of the caller's.
///
/// # Safety
/// Unless it is NULL, `text` points to a string with its NUL that lives and is not written to for `'a`.
pub unsafe fn string<'a>(text: *const c_char, name: &str) -> Outcome<&'a str> {
    check(text, name)?;
    // SAFETY: not NULL; the caller vouches for the rest.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|_| invalid(format!("{name} is not UTF-8: {}", text.to_string_lossy())))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(size: usize) -> (usize, Vec<u8>) {
        let mut bytes = vec![b'#'; size + 1];
        // SAFETY: the buffer holds size bytes and one more.
        let needed = unsafe { last_error(bytes.as_mut_ptr().cast(), size) };
        (needed, bytes)
    }

    #[test]
    fn a_panic_becomes_a_status_and_a_message() {
        assert_eq!(guard(|| panic!("number {}", 7)), CSBRDF_PANIC);
        let (needed, bytes) = message(200);
        assert!(String::from_utf8_lossy(&bytes[..needed]).ends_with("number 7"));
        assert_eq!(bytes[needed], 0);
        assert_eq!(guard(|| panic!("plain")), CSBRDF_PANIC);
        assert_eq!(guard(|| std::panic::panic_any(3)), CSBRDF_PANIC);
    }

    #[test]
    fn messages_are_cut_between_characters_and_end_in_nul() {
        assert_eq!(guard(|| Err(invalid("aé€"))), CSBRDF_INVALID_ARGUMENT);
        for (size, kept) in [(1, 0), (2, 1), (3, 1), (4, 3), (6, 3), (7, 6), (8, 6)] {
            let (needed, bytes) = message(size);
            assert_eq!((needed, &bytes[..kept], bytes[kept]), (6, &"aé€".as_bytes()[..kept], 0), "{size}");
            assert!(bytes[kept + 1..].iter().all(|b| *b == b'#'), "{size}");
        }
        assert_eq!(message(0), (6, vec![b'#']));
        // SAFETY: NULL asks for the length alone.
        assert_eq!(unsafe { last_error(std::ptr::null_mut(), 9) }, 6);
        assert_eq!(guard(|| Ok(())), CSBRDF_OK);
        assert_eq!(message(0).0, 6, "a call that succeeds leaves the message");
    }

    #[test]
    fn no_message_holds_a_nul_within() {
        assert_eq!(guard(|| Err(invalid("channel \0R"))), CSBRDF_INVALID_ARGUMENT);
        let (needed, bytes) = message(200);
        assert_eq!(&bytes[..=needed], "channel \u{FFFD}R\0".as_bytes());
    }

    #[test]
    fn pointers_that_cannot_be_right_are_refused() {
        let floats = [0f32; 4];
        let odd = floats.as_ptr().cast::<u8>().wrapping_add(1).cast::<f32>();
        // SAFETY: none of these is read: NULL, not aligned or too long.
        unsafe {
            assert!(shared(std::ptr::null::<f32>(), "x").is_err());
            assert!(shared(odd, "x").is_err());
            assert!(array(odd, 1, "x").is_err());
            assert!(array(floats.as_ptr(), usize::MAX, "x").is_err());
            assert!(array(std::ptr::null::<f32>(), 1, "x").is_err());
            assert!(array(std::ptr::null::<f32>(), 0, "x").unwrap().is_empty());
            assert!(buffer(std::ptr::null_mut(), 1, "x").is_err());
            assert!(buffer(std::ptr::null_mut(), 0, "x").unwrap().is_empty());
            assert!(write(std::ptr::null_mut(), 1f32, "x").is_err());
            assert!(string(std::ptr::null(), "x").is_err());
        }
    }

    #[test]
    fn every_kind_of_error_has_its_status() {
        let io = || Error::Io(std::io::Error::other("gone"));
        for (error, status) in [
            (io(), CSBRDF_IO),
            (io().in_file("a"), CSBRDF_IO),
            (Error::NotCsbrdf { looks_like: "text" }, CSBRDF_NOT_CSBRDF),
            (Error::UnsupportedVersion { found: (9, 0, 0) }, CSBRDF_UNSUPPORTED_VERSION),
            (Error::Truncated { section: "x", expected: 2, got: 1 }, CSBRDF_TRUNCATED),
            (Error::Corrupt { section: "x", offset: 0, what: String::new() }, CSBRDF_CORRUPT),
            (Error::LimitExceeded { what: "x", got: 2, limit: 1 }, CSBRDF_LIMIT_EXCEEDED),
            (Error::ContractNotMet(String::new()), CSBRDF_CORRUPT),
            (Error::InvalidArgument(String::new()), CSBRDF_INVALID_ARGUMENT),
        ] {
            assert_eq!(Failure::from(error).status, status);
        }
    }
}
