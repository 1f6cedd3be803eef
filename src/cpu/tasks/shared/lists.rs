//! Lists of indices into shared arrays, checked against a bound when they are built.
//!
//! [`vectors`](super::vectors) checks once that the bound of a list lies inside an array ([`Indices::inside`]) and then uses
//! the indices without further checks, so a list must never hold an index beyond its bound.

/// Indices into arrays of at least `bound` items: of single items, or of the first of `length` contiguous ones.
#[derive(Debug, Clone, Default)]
pub(crate) struct Indices {
    items: Vec<u32>,
    length: usize,
    bound: usize,
}

impl Indices {
    pub(crate) fn new(bound: usize) -> Indices {
        Indices::of_rows(1, bound)
    }

    pub(crate) fn of_rows(length: usize, bound: usize) -> Indices {
        Indices { items: Vec::new(), length, bound }
    }

    /// # Panics
    /// If a row is not within the bound.
    pub(crate) fn extend(&mut self, indices: impl IntoIterator<Item = u32>) {
        let (length, bound) = (self.length, self.bound);
        // Without a sum, which might overflow where addresses have 32 bits.
        let is_inside = |first: u32| bound.checked_sub(length).is_some_and(|last| first as usize <= last);
        let check = |&first: &u32| assert!(is_inside(first), "{length} from {first} on, of {bound}");
        self.items.extend(indices.into_iter().inspect(check));
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

    /// The indices of rows, all of which lie inside an array of `array_length` items.
    ///
    /// # Panics
    /// If the array is shorter than the bound, or the rows have another length.
    #[inline(always)]
    pub(super) fn inside(&self, array_length: usize, length: usize) -> &[u32] {
        assert!(self.bound <= array_length && self.length == length, "inside the array");
        &self.items
    }
}
