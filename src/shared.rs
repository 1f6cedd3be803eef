//! A slice that several threads write, each in places of its own.

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
