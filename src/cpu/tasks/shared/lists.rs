//! Lists of places in shared arrays, compared with a bound when they are made.
//!
//! [`vectors`](super::vectors) asks for those inside an array ([`Rows::inside`], [`Places::inside`]), and then compares no place any
//! more: what is in a list must stay below its bound.

/// A list of rows, so many items one after another each, in arrays of at least `bound` items.
#[derive(Debug, Clone, Default)]
pub(crate) struct Rows {
    starts: Vec<u32>,
    length: usize,
    bound: usize,
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

    /// Where the rows begin, all of them inside an array of so many items.
    ///
    /// # Panics
    /// If the array is shorter than the bound, or the rows are not of this length.
    #[inline(always)]
    pub(super) fn inside(&self, array_length: usize, length: usize) -> &[u32] {
        assert!(self.bound <= array_length && self.length == length, "inside the array");
        &self.starts
    }
}

/// A list of places in arrays of at least `bound` items.
#[derive(Debug, Clone, Default)]
pub(crate) struct Places {
    items: Vec<u32>,
    bound: usize,
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

    /// The places, all of them inside an array of so many items.
    ///
    /// # Panics
    /// If the array is shorter than the bound.
    #[inline(always)]
    pub(super) fn inside(&self, array_length: usize) -> &[u32] {
        assert!(self.bound <= array_length, "inside the array");
        &self.items
    }
}
