//! What one call on a file may cost: operations and bytes, counted as they are spent, refused by name before they are.
//!
//! A file of some hundred bytes can describe a table of gigabytes and coefficients that take hours. Every call on a file
//! opens a budget by the caller's [`Limits`] and draws on it: at once where the cost is known from the header, step by
//! step where it is not.

use std::sync::atomic::{AtomicU64, Ordering};

use crate::error::{Error, Result};
use crate::format::Limits;

/// Operations that a call gets for each byte of the file, beside those that every call gets: large files are large work.
const OPERATIONS_A_BYTE: u64 = 1 << 12;
/// Bytes of memory that a call gets for each byte of the file.
const BYTES_A_BYTE: u64 = 16;

/// What is left for one call. Shared between its threads.
#[derive(Debug)]
pub(crate) struct Budget {
    operations: AtomicU64,
    most_operations: u64,
    bytes: AtomicU64,
    most_bytes: u64,
}

impl Budget {
    /// The budget of one call on a file of `length` bytes.
    pub(crate) fn new(limits: &Limits, length: usize) -> Budget {
        let length = length as u64;
        Budget {
            operations: AtomicU64::new(0),
            most_operations: limits.operations.saturating_add(length.saturating_mul(OPERATIONS_A_BYTE)),
            bytes: AtomicU64::new(0),
            most_bytes: limits.bytes.saturating_add(length.saturating_mul(BYTES_A_BYTE)),
        }
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
        Err(Error::LimitExceeded { what: "operations of a call on this file", got, limit: self.most_operations })
    }

    /// Half of the operations that are left, for work that may end early: what it took is to be spent of this budget.
    pub(crate) fn half(&self) -> Budget {
        let left = self.most_operations.saturating_sub(self.spent());
        Budget {
            operations: AtomicU64::new(0),
            most_operations: left / 2,
            bytes: AtomicU64::new(self.bytes.load(Ordering::Relaxed)),
            most_bytes: self.most_bytes,
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
        let got = self.bytes.fetch_add(bytes, Ordering::Relaxed).saturating_add(bytes);
        if got <= self.most_bytes {
            return Ok(());
        }
        self.release(bytes);
        Err(Error::LimitExceeded { what: "bytes of memory of a call on this file", got, limit: self.most_bytes })
    }

    /// Gives memory back.
    pub(crate) fn release(&self, bytes: u64) {
        self.bytes.fetch_sub(bytes, Ordering::Relaxed);
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
    fn memory_that_is_not_there_is_an_error() {
        assert!(matches!(filled(0u64, usize::MAX / 16), Err(Error::OutOfMemory { .. })));
        assert_eq!(filled(7u8, 3).unwrap(), [7; 3]);
    }
}
