//! A list that is filled anew in each substep, in the same memory.

use std::ops::Deref;

/// A list whose items stay in memory when it is cleared. A new item may be any that was there before.
#[derive(Debug, Default)]
pub(crate) struct Reused<T> {
    items: Vec<T>,
    used: usize,
}

impl<T: Default> Reused<T> {
    pub(crate) fn clear(&mut self) {
        self.used = 0;
    }

    /// Adds an item.
    #[inline(always)]
    pub(crate) fn add(&mut self) -> &mut T {
        if self.used == self.items.len() {
            self.items.push(T::default());
        }
        self.used += 1;
        &mut self.items[self.used - 1]
    }

    /// The item that was added last, of which there must be one.
    #[inline(always)]
    pub(crate) fn newest(&mut self) -> &mut T {
        &mut self.items[self.used - 1]
    }
}

impl<T> Deref for Reused<T> {
    type Target = [T];

    #[inline(always)]
    fn deref(&self) -> &[T] {
        &self.items[..self.used]
    }
}
