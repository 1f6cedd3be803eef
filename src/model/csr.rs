//! Compressed sparse rows: a list of items for each vertex, or whatever else is numbered, all in one array.

use std::ops::Range;

use bytemuck::{Pod, Zeroable};

/// Items in ascending order, each once.
pub(crate) fn distinct<T: Ord>(mut items: Vec<T>) -> Vec<T> {
    items.sort_unstable();
    items.dedup();
    items
}

/// The place of one row in the array: items `start..end`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Pod, Zeroable)]
pub(crate) struct Span {
    pub start: u32,
    pub end: u32,
}

impl Span {
    pub(crate) fn range(self) -> Range<usize> {
        self.start as usize..self.end as usize
    }
}

/// A list of items for each vertex, all in one array.
#[derive(Debug, Clone, Default)]
pub(crate) struct Csr<T> {
    pub spans: Vec<Span>,
    pub items: Vec<T>,
}

impl<T: Copy + Default> Csr<T> {
    /// Groups `(vertex, item)` pairs by vertex; the items of a vertex keep their order.
    pub(crate) fn new(vertices: usize, pairs: impl Iterator<Item = (u32, T)> + Clone) -> Csr<T> {
        let mut spans = vec![Span::default(); vertices];
        pairs.clone().for_each(|(vertex, _)| spans[vertex as usize].end += 1);
        let mut total = 0;
        for span in &mut spans {
            let count = span.end;
            (span.start, span.end) = (total, total);
            total += count;
        }
        let mut items = vec![T::default(); total as usize];
        for (vertex, item) in pairs {
            let end = &mut spans[vertex as usize].end;
            items[*end as usize] = item;
            *end += 1;
        }
        Csr { spans, items }
    }
}

impl<T> Csr<T> {
    /// Appends another list.
    pub(crate) fn push(&mut self, items: impl IntoIterator<Item = T>) {
        let start = self.items.len() as u32;
        self.items.extend(items);
        self.spans.push(Span { start, end: self.items.len() as u32 });
    }

    /// Where the items of each vertex start, and where those of the last one end.
    pub(crate) fn starts(&self) -> Vec<u32> {
        std::iter::once(0).chain(self.spans.iter().map(|span| span.end)).collect()
    }

    /// The items of a vertex.
    pub(crate) fn of(&self, vertex: u32) -> &[T] {
        &self.items[self.spans[vertex as usize].range()]
    }

    /// The items of one vertex after another.
    pub(crate) fn lists(&self) -> impl Iterator<Item = &[T]> {
        self.spans.iter().map(|span| &self.items[span.range()])
    }
}
