//! Lists of indices into shared arrays, checked against a bound when they are built.
//!
//! [`vectors`](super::vectors) checks once that the bound of a list lies inside an array ([`Rows::inside`],
//! [`Indices::inside`]) and then uses the indices without further checks, so a list must never hold an index beyond its
//! bound.

/// The starts of rows, each `length` contiguous items, in arrays of at least `bound` items.
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

    /// The starts of the rows, all of which lie inside an array of `array_length` items.
    ///
    /// # Panics
    /// If the array is shorter than the bound, or the rows have another length.
    #[inline(always)]
    pub(super) fn inside(&self, array_length: usize, length: usize) -> &[u32] {
        assert!(self.bound <= array_length && self.length == length, "inside the array");
        &self.starts
    }
}

/// Indices into arrays of at least `bound` items.
#[derive(Debug, Clone, Default)]
pub(crate) struct Indices {
    items: Vec<u32>,
    bound: usize,
}

impl Indices {
    pub(crate) fn new(bound: usize) -> Indices {
        Indices { items: Vec::new(), bound }
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

    /// The indices, all of which lie inside an array of `array_length` items.
    ///
    /// # Panics
    /// If the array is shorter than the bound.
    #[inline(always)]
    pub(super) fn inside(&self, array_length: usize) -> &[u32] {
        assert!(self.bound <= array_length, "inside the array");
        &self.items
    }
}
