//! Lists of places in shared arrays, compared with a bound when they are made.
//!
//! [`shared`](super::shared) compares the bound with an array's length, and then no place any more: what is in a list must stay below
//! its bound.

/// A list of rows, so many items one after another each, in arrays of at least `bound` items.
#[derive(Debug, Clone, Default)]
pub(crate) struct Rows {
    pub(super) starts: Vec<u32>,
    pub(super) length: usize,
    pub(super) bound: usize,
}

impl Rows {
    pub(crate) fn new(length: usize, bound: usize) -> Rows {
        Rows { starts: Vec::new(), length, bound }
    }

    /// # Panics
    /// If the row is not within the bound.
    pub(crate) fn push(&mut self, start: u32) {
        assert!(start as usize + self.length <= self.bound, "a row from {start} on, of {}", self.bound);
        self.starts.push(start);
    }

    pub(crate) fn trim(&mut self) {
        self.starts.shrink_to_fit();
    }

    pub(crate) fn len(&self) -> usize {
        self.starts.len()
    }

    pub(crate) fn of(&self, index: usize) -> u32 {
        self.starts[index]
    }
}

/// A list of places in arrays of at least `bound` items.
#[derive(Debug, Clone, Default)]
pub(crate) struct Places {
    pub(super) items: Vec<u32>,
    pub(super) bound: usize,
}

impl Places {
    pub(crate) fn new(bound: usize) -> Places {
        Places { items: Vec::new(), bound }
    }

    /// # Panics
    /// If a place is beyond the bound.
    pub(crate) fn extend(&mut self, places: impl IntoIterator<Item = u32>) {
        let bound = self.bound;
        self.items.extend(places.into_iter().inspect(|&place| assert!((place as usize) < bound, "{place} of {bound}")));
    }

    pub(crate) fn trim(&mut self) {
        self.items.shrink_to_fit();
    }

    pub(crate) fn len(&self) -> usize {
        self.items.len()
    }

    #[inline(always)]
    pub(crate) fn of(&self, index: usize) -> u32 {
        self.items[index]
    }
}
