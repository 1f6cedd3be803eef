//! A slice that several threads write, each in places of its own.

use std::ops::Range;

/// A slice that tasks share. Who reads and writes where is for them to agree on.
#[derive(Debug)]
pub(crate) struct Shared<T> {
    start: *mut T,
    length: usize,
    /// Items that may be read and written, be they beyond the slice.
    room: usize,
}

impl<T> Shared<T> {
    pub(crate) fn new(items: &mut [T]) -> Shared<T> {
        let length = items.len();
        Shared::with_room(items, length)
    }

    /// The first so many items; the others may be read and written too.
    pub(crate) fn with_room(items: &mut [T], length: usize) -> Shared<T> {
        Shared { start: items.as_mut_ptr(), length, room: items.len() }
    }

    /// Items that are not in a slice of ours.
    #[cfg(feature = "gpu")]
    pub(crate) fn at(start: *mut T, length: usize) -> Shared<T> {
        Shared { start, length, room: length }
    }

    pub(crate) fn len(self) -> usize {
        self.length
    }

    pub(crate) fn pointer(self) -> *mut T {
        self.start
    }
}

#[expect(unsafe_code, reason = "tasks of one round write disjoint items: see Stripes")]
impl<T: Copy> Shared<T> {
    /// # Safety
    /// The slice is alive, `index` is within its room, and nobody writes there meanwhile.
    pub(crate) unsafe fn get(self, index: usize) -> T {
        debug_assert!(index < self.room);
        // SAFETY: the caller's promise.
        unsafe { *self.start.add(index) }
    }

    /// # Safety
    /// As [`Shared::get`], and nobody reads there meanwhile.
    pub(crate) unsafe fn set(self, index: usize, value: T) {
        debug_assert!(index < self.room);
        // SAFETY: the caller's promise.
        unsafe { *self.start.add(index) = value }
    }
}

impl<T> Clone for Shared<T> {
    fn clone(&self) -> Shared<T> {
        *self
    }
}

impl<T> Copy for Shared<T> {}

#[expect(unsafe_code, reason = "see Shared")]
// SAFETY: access is by unsafe functions alone, whose callers keep threads apart.
unsafe impl<T: Send> Sync for Shared<T> {}

#[expect(unsafe_code, reason = "see Shared")]
// SAFETY: as above.
unsafe impl<T: Send> Send for Shared<T> {}

impl<T> Shared<T> {
    /// Asks for items that are about to be written: what another thread's cache holds would else be waited for at each store.
    pub(crate) fn claim(self, items: Range<u32>) {
        #[cfg(target_arch = "x86_64")]
        for line in (items.start as usize * size_of::<T>()..items.end as usize * size_of::<T>()).step_by(LINE) {
            let place = self.start.cast::<u8>().wrapping_add(line);
            #[expect(unsafe_code, reason = "a hint, which may name any address")]
            // SAFETY: it changes nothing; processors without it do nothing.
            unsafe {
                std::arch::asm!("prefetchw [{}]", in(reg) place, options(nostack, preserves_flags));
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = items;
    }
}

/// Bytes that are fetched together.
#[cfg(target_arch = "x86_64")]
const LINE: usize = 64;
