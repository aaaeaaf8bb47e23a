//! What one call on a file may cost: operations and bytes, counted as they are spent, refused by name before they are.
//!
//! A file of some hundred bytes can describe a table of gigabytes and coefficients that take hours. Every call on a file
//! opens a budget by the caller's [`Limits`] and draws on it: at once where the cost is known from the header, step by
//! step where it is not.

use std::ops::Deref;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::base::error::{Error, Result};
use crate::base::limits::Limits;

/// Operations that a call gets for each byte of the file, beside those that every call gets: large files are large work.
const OPERATIONS_A_BYTE: u64 = 1 << 12;
/// Bytes of memory that a call gets for each byte of the file.
const BYTES_A_BYTE: u64 = 16;

/// What is left for one call. Shared between its threads.
#[derive(Debug)]
pub(crate) struct Budget<'p> {
    operations: AtomicU64,
    most_operations: u64,
    bytes: AtomicU64,
    most_bytes: u64,
    /// Whose memory it takes, if it is a part of another.
    parent: Option<&'p Budget<'p>>,
}

impl Budget<'_> {
    /// The budget of one call on a file of `length` bytes.
    pub(crate) fn new(limits: &Limits, length: usize) -> Budget<'static> {
        let length = length as u64;
        Budget {
            operations: AtomicU64::new(0),
            most_operations: limits.operations.saturating_add(length.saturating_mul(OPERATIONS_A_BYTE)),
            bytes: AtomicU64::new(0),
            most_bytes: limits.bytes.saturating_add(length.saturating_mul(BYTES_A_BYTE)),
            parent: None,
        }
    }

    /// No bounds: for what the program made itself, or what another limit bounds.
    pub(crate) const fn unbounded() -> Budget<'static> {
        Budget {
            operations: AtomicU64::new(0),
            most_operations: u64::MAX,
            bytes: AtomicU64::new(0),
            most_bytes: u64::MAX,
            parent: None,
        }
    }

    /// `work` on a part of what is left, and on `free` operations more, which do not count. The memory is counted here.
    ///
    /// # Errors
    /// That of `work`; `LimitExceeded` if others have spent what was left meanwhile.
    pub(crate) fn with_free<T>(&self, free: u64, work: impl FnOnce(&Budget) -> Result<T>) -> Result<T> {
        let start = self.operations.load(Ordering::Relaxed).saturating_sub(free);
        let part = Budget {
            operations: AtomicU64::new(start),
            most_operations: self.most_operations,
            bytes: AtomicU64::new(0),
            most_bytes: 0,
            parent: Some(self),
        };
        let result = work(&part);
        let spent = part.operations.into_inner() - start;
        let counted = self.spend(spent.saturating_sub(free));
        result.and_then(|result| counted.map(|()| result))
    }

    /// The same without a bound on operations: for whole tables, whose size is limited.
    pub(crate) fn of_bytes(limits: &Limits, length: usize) -> Budget<'static> {
        Budget { most_operations: u64::MAX, ..Budget::new(limits, length) }
    }

    /// Bytes that may still be taken.
    pub(crate) fn bytes_left(&self) -> u64 {
        if let Some(parent) = self.parent {
            return parent.bytes_left();
        }
        self.most_bytes.saturating_sub(self.bytes.load(Ordering::Relaxed))
    }

    /// Counts work that is about to be done, in operations of about a nanosecond.
    ///
    /// # Errors
    /// `LimitExceeded` if the call has no such work left.
    pub(crate) fn spend(&self, operations: u64) -> Result<()> {
        let got = self.operations.fetch_add(operations, Ordering::Relaxed).saturating_add(operations);
        if got <= self.most_operations {
            return Ok(());
        }
        Err(Error::LimitExceeded {
            what: "work of a call on this file, in operations,",
            got,
            limit: self.most_operations,
        })
    }

    /// Half of the operations that are left, for work that may end early: what it took is to be spent of this budget.
    pub(crate) fn half(&self) -> Budget<'static> {
        let left = self.most_operations.saturating_sub(self.spent());
        Budget {
            operations: AtomicU64::new(0),
            most_operations: left / 2,
            bytes: AtomicU64::new(self.bytes.load(Ordering::Relaxed)),
            most_bytes: self.most_bytes,
            parent: None,
        }
    }

    /// Operations that were spent, not more than there were.
    pub(crate) fn spent(&self) -> u64 {
        self.operations.load(Ordering::Relaxed).min(self.most_operations)
    }

    /// Counts memory that is about to be taken, and held until [`Budget::release`].
    ///
    /// # Errors
    /// `LimitExceeded` if the call has no such memory left.
    pub(crate) fn hold(&self, bytes: u64) -> Result<()> {
        if let Some(parent) = self.parent {
            return parent.hold(bytes);
        }
        let got = self.bytes.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
        if got <= self.most_bytes {
            return Ok(());
        }
        self.release(bytes);
        Err(Error::LimitExceeded { what: "memory of a call on this file, in bytes,", got, limit: self.most_bytes })
    }

    /// As [`Budget::hold`], for as long as what it gives lives.
    ///
    /// # Errors
    /// As [`Budget::hold`].
    pub(crate) fn holding(&self, bytes: u64) -> Result<Held<'_>> {
        self.hold(bytes).map(|()| Held { budget: self, bytes })
    }

    /// Gives memory back.
    pub(crate) fn release(&self, bytes: u64) {
        match self.parent {
            Some(parent) => parent.release(bytes),
            None => {
                self.bytes.fetch_sub(bytes, Ordering::Relaxed);
            }
        }
    }
}

/// Memory that is counted until this is dropped.
#[derive(Debug)]
pub(crate) struct Held<'a> {
    budget: &'a Budget<'a>,
    bytes: u64,
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        self.budget.release(self.bytes);
    }
}

/// What a call draws on: a budget of its own, or one of several calls.
#[derive(Debug)]
pub(crate) enum Call<'a> {
    Own(Budget<'static>),
    Shared(&'a Budget<'static>),
}

impl Deref for Call<'_> {
    type Target = Budget<'static>;

    fn deref(&self) -> &Budget<'static> {
        match self {
            Call::Own(budget) => budget,
            Call::Shared(budget) => budget,
        }
    }
}

/// Why a part of a file does not decode.
#[derive(Debug)]
pub(crate) enum Fault {
    /// Its bytes are wrong.
    Damaged(&'static str),
    /// It would take more than the call may, or than the machine has.
    Refused(Error),
}

impl Fault {
    /// The error of it, given that of damaged bytes.
    pub(crate) fn error(self, damaged: impl FnOnce(&'static str) -> Error) -> Error {
        match self {
            Fault::Damaged(what) => damaged(what),
            Fault::Refused(error) => error,
        }
    }
}

impl From<&'static str> for Fault {
    fn from(what: &'static str) -> Fault {
        Fault::Damaged(what)
    }
}

impl From<Error> for Fault {
    fn from(error: Error) -> Fault {
        Fault::Refused(error)
    }
}

/// A vector with room for `length` values, or an error where the machine has no such memory: a host is not aborted for a
/// length that stands in a file.
///
/// # Errors
/// `OutOfMemory`.
pub(crate) fn with_room<T>(length: usize) -> Result<Vec<T>> {
    let mut values = Vec::new();
    values
        .try_reserve_exact(length)
        .map_err(|_| Error::OutOfMemory { bytes: (length as u64).saturating_mul(size_of::<T>() as u64) })?;
    Ok(values)
}

/// `length` times the same value, likewise.
///
/// # Errors
/// `OutOfMemory`.
pub(crate) fn filled<T: Clone>(value: T, length: usize) -> Result<Vec<T>> {
    let mut values = with_room(length)?;
    values.resize(length, value);
    Ok(values)
}

/// Makes a vector at least so long; what it has stays.
///
/// # Errors
/// `OutOfMemory`.
pub(crate) fn lengthen<T: Clone>(values: &mut Vec<T>, length: usize, value: T) -> Result<()> {
    if values.len() < length {
        make_room(values, length)?;
        values.resize(length, value);
    }
    Ok(())
}

/// Makes room for `length` values in all.
///
/// # Errors
/// `OutOfMemory`.
pub(crate) fn make_room<T>(values: &mut Vec<T>, length: usize) -> Result<()> {
    let more = length.saturating_sub(values.len());
    values
        .try_reserve_exact(more)
        .map_err(|_| Error::OutOfMemory { bytes: (length as u64).saturating_mul(size_of::<T>() as u64) })
}

/// `length` times the same value in place of what a vector has.
///
/// # Errors
/// `OutOfMemory`.
pub(crate) fn refill<T: Clone>(values: &mut Vec<T>, length: usize, value: T) -> Result<()> {
    values.clear();
    lengthen(values, length, value)
}

/// `length` zeros as the system gives them out, which costs less than writing them. That there is room is asked before, in a way that
/// can fail.
///
/// # Errors
/// `OutOfMemory`.
pub(crate) fn zeroed<T: Copy + Default>(length: usize) -> Result<Vec<T>> {
    with_room::<T>(length)?;
    Ok(vec![T::default(); length])
}

/// Copies one after the other.
///
/// # Errors
/// `OutOfMemory`.
pub(crate) fn repeated<T: Copy>(values: &[T], times: usize) -> Result<Vec<T>> {
    let mut all = with_room(values.len().saturating_mul(times))?;
    (0..times).for_each(|_| all.extend_from_slice(values));
    Ok(all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_spent_is_gone_and_what_is_released_is_not() {
        let limits = Limits { operations: 100, bytes: 50, ..Limits::default() };
        let budget = Budget::new(&limits, 0);
        budget.spend(60).unwrap();
        budget.spend(40).unwrap();
        let refused = budget.spend(1).unwrap_err().to_string();
        assert!(refused.contains("operations") && refused.contains("101"), "{refused}");
        budget.hold(50).unwrap();
        assert!(matches!(budget.hold(1), Err(Error::LimitExceeded { got: 51, limit: 50, .. })));
        budget.release(20);
        budget.hold(20).unwrap();
        // A byte of the file buys more of both.
        Budget::new(&limits, 1).spend(100 + OPERATIONS_A_BYTE).unwrap();
        assert!(Budget::new(&limits, 1).spend(101 + OPERATIONS_A_BYTE).is_err());
    }

    #[test]
    fn what_is_free_does_not_count() {
        let budget = Budget::new(&Limits { operations: 100, bytes: 50, ..Limits::default() }, 0);
        for _ in 0..10 {
            budget.with_free(60, |part| part.spend(60).and_then(|()| part.hold(5))).unwrap();
        }
        assert_eq!(budget.bytes_left(), 0);
        budget.release(50);
        assert!(budget.with_free(60, |part| part.hold(51)).is_err());
        budget.with_free(60, |part| part.spend(100)).unwrap();
        budget.spend(60).unwrap();
        let refused = budget.with_free(60, |part| part.spend(61)).unwrap_err();
        assert!(matches!(refused, Error::LimitExceeded { got: 101, limit: 100, .. }), "{refused}");
        // What was refused counts as well, so that nobody tries for ever.
        assert!(budget.spend(1).is_err());
    }

    #[test]
    fn memory_that_is_not_there_is_an_error() {
        assert!(matches!(filled(0u64, usize::MAX / 16), Err(Error::OutOfMemory { .. })));
        assert_eq!(filled(7u8, 3).unwrap(), [7; 3]);
        assert!(matches!(zeroed::<f64>(usize::MAX / 16), Err(Error::OutOfMemory { .. })));
        assert!(matches!(repeated(&[1u64; 4], usize::MAX / 64), Err(Error::OutOfMemory { .. })));
        let mut values = vec![1, 2];
        lengthen(&mut values, 3, 9).unwrap();
        lengthen(&mut values, 1, 9).unwrap();
        assert_eq!((&values[..], repeated(&values, 2).unwrap()), (&[1, 2, 9][..], vec![1, 2, 9, 1, 2, 9]));
        assert!(matches!(lengthen(&mut values, usize::MAX / 4, 0), Err(Error::OutOfMemory { .. })));
        assert_eq!(values, [1, 2, 9]);
    }
}
