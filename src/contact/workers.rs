//! The threads that share a loop of contact, each a part of it.

use std::sync::{Mutex, PoisonError};

use crate::HAS_THREADS;

/// Most parts of a loop.
pub(super) const MAX_PARTS: usize = 64;

/// Calls work with each number below a count, of at most [`MAX_PARTS`], on several threads at once.
pub(crate) type Run<'a> = dyn Fn(usize, &(dyn Fn(usize) + Sync)) + Sync + 'a;

/// A part of a loop until a thread takes it, in cache lines of its own.
#[repr(align(128))]
struct Place<T>(Mutex<Option<T>>);

/// The threads that share contact's loops.
#[derive(Clone, Copy)]
pub(crate) struct Workers<'a> {
    count: usize,
    run: Option<&'a Run<'a>>,
}

impl<'a> Workers<'a> {
    /// This thread alone.
    pub(crate) const ALONE: Workers<'static> = Workers { count: 1, run: None };

    /// So many threads, on which `run` runs what is shared.
    pub(crate) fn new(count: usize, run: &'a Run<'a>) -> Workers<'a> {
        Workers { count: count.clamp(1, MAX_PARTS), run: (count > 1).then_some(run) }
    }

    /// As many of these threads as pay off for so many items of which `each` are worth a thread.
    pub(super) fn for_items(self, items: usize, each: usize) -> Workers<'a> {
        let count = (items / each).clamp(1, self.count);
        Workers { count, run: self.run.filter(|_| count > 1) }
    }

    pub(super) fn count(self) -> usize {
        self.count
    }

    /// How many of `items` items a thread has.
    pub(super) fn share(self, thread: usize, items: usize) -> usize {
        (thread + 1) * items / self.count - thread * items / self.count
    }

    /// How many of `items` items a part has, at least and in multiples of `grain`, so that each thread has one part.
    pub(super) fn part(self, items: usize, grain: usize) -> usize {
        items.div_ceil(self.count).max(1).next_multiple_of(grain)
    }

    /// The same for parts that take different times, so that each thread has several.
    pub(super) fn small_part(self, items: usize) -> usize {
        let parts = if self.run.is_some() { (4 * self.count).min(MAX_PARTS) } else { 1 };
        items.div_ceil(parts).max(1)
    }

    /// Calls `work` with each of at most [`MAX_PARTS`] parts.
    pub(super) fn each<T: Send>(self, parts: impl Iterator<Item = T>, work: impl Fn(T) + Sync) {
        let Some(run) = self.run.filter(|_| HAS_THREADS) else { return parts.for_each(work) };
        let mut places = [const { Place(Mutex::new(None)) }; MAX_PARTS];
        let mut count = 0;
        for part in parts {
            places[count] = Place(Mutex::new(Some(part)));
            count += 1;
        }
        if count < 2 {
            return places.into_iter().filter_map(|Place(part)| part.into_inner().ok()?).for_each(work);
        }
        run(count, &|part| {
            let part = places[part].0.lock().unwrap_or_else(PoisonError::into_inner).take();
            part.into_iter().for_each(&work);
        });
    }

    /// Calls `work(first, chunk)` for the parts of a list.
    pub(super) fn chunks<T: Send>(self, items: &mut [T], grain: usize, work: impl Fn(usize, &mut [T]) + Sync) {
        let part = self.part(items.len(), grain);
        self.each(items.chunks_mut(part).enumerate(), |(index, items)| work(index * part, items));
    }
}
