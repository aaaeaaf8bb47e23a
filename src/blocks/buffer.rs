//! Memory for the values of one block after the other.

use std::ops::{Deref, DerefMut};

use crate::base::budget::lengthen;
use crate::base::error::Result;

/// Values of the block at hand. What it shrinks by stays, for the next larger block, which need not be zeroed again.
#[derive(Debug, Default)]
pub(crate) struct Buffer<T> {
    values: Vec<T>,
    len: usize,
}

impl<T: Copy + Default> Buffer<T> {
    /// `len` values, whatever stands in them.
    ///
    /// # Errors
    /// `OutOfMemory`.
    pub(crate) fn resize(&mut self, len: usize) -> Result<()> {
        lengthen(&mut self.values, len, T::default())?;
        self.len = len;
        Ok(())
    }

    /// What it takes in memory.
    pub(crate) fn bytes(&self) -> usize {
        self.values.capacity() * size_of::<T>()
    }
}

impl<T> Deref for Buffer<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.values[..self.len]
    }
}

impl<T> DerefMut for Buffer<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.values[..self.len]
    }
}
