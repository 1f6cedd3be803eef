//! Arrays that tasks share, each task writing in places of its own.
//!
//! One of the two places with unsafe code. It rests on these invariants:
//!
//! - **Alive**: a [`SharedArray`] borrows its items, mutably, for as long as it lives, and a [`View`] borrows the array.
//! - **Inside**: every access is compared with the array's length: once for as many items as one after another are wanted
//!   together ([`Row`]), or once for a list of places or rows ([`Places`], [`Rows`]) that were compared with the list's bound when
//!   it was made. Lengths and bounds never change.
//! - **Apart**: while tasks run, no item that one writes is read or written by another. An array can only be seen from within a
//!   [`Task`]; tasks are made by the [`scheduler`](super::scheduler) alone, which runs one only after all earlier ones that touch
//!   a place of the cloth that it touches. That a task's loops stay where it says is for [`Schedule`](crate::cpu::substep::Schedule) to
//!   say; debug builds watch every access for two tasks that meet ([`race`](super::race)), which they find when those overlap in time.

#![expect(unsafe_code, reason = "see the invariants")]

use std::marker::PhantomData;
use std::ops::Range;

use glam::Vec4;

use super::lists::{Places, Rows};
#[cfg(debug_assertions)]
use super::race::{Ticket, Visitors};
use crate::simd::{Registers, Vector};

/// A task that runs.
#[derive(Debug)]
pub(crate) struct Task {
    #[cfg(debug_assertions)]
    ticket: Ticket,
    /// So that nobody else makes one, and that it stays in its thread.
    _made_here: PhantomData<*mut ()>,
}

impl Task {
    /// For the scheduler, when it begins a task.
    pub(super) fn begin() -> Task {
        Task {
            #[cfg(debug_assertions)]
            ticket: Ticket::take(),
            _made_here: PhantomData,
        }
    }

    /// A task of a test, beside which no other runs.
    #[cfg(test)]
    pub(crate) fn alone() -> Task {
        Task::begin()
    }
}

/// An array that tasks share.
#[derive(Debug)]
pub(crate) struct SharedArray<'a, T = Vec4> {
    start: *mut T,
    length: usize,
    borrowed: PhantomData<&'a mut [T]>,
    #[cfg(debug_assertions)]
    visitors: Visitors,
}

// SAFETY: Apart, and items that may be sent and seen from other threads.
unsafe impl<T: Send + Sync> Send for SharedArray<'_, T> {}
// SAFETY: Apart, and items that may be sent and seen from other threads.
unsafe impl<T: Send + Sync> Sync for SharedArray<'_, T> {}

impl<'a, T> SharedArray<'a, T> {
    pub(crate) fn new(items: &'a mut [T]) -> SharedArray<'a, T> {
        SharedArray {
            start: items.as_mut_ptr(),
            length: items.len(),
            borrowed: PhantomData,
            #[cfg(debug_assertions)]
            visitors: Visitors::new(items.len()),
        }
    }

    /// The items, once no task can see them any more.
    #[cfg(feature = "gpu")]
    pub(crate) fn into_inner(self) -> &'a mut [T] {
        // SAFETY: Alive; whoever saw the array borrowed it, and it is given away here.
        unsafe { std::slice::from_raw_parts_mut(self.start, self.length) }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// The array as a task sees it.
    #[inline(always)]
    #[cfg_attr(not(debug_assertions), expect(unused_variables, reason = "debug builds watch what it does"))]
    pub(crate) fn within<'t>(&'t self, task: &'t Task) -> View<'t, T> {
        View {
            start: self.start,
            length: self.length,
            borrowed: PhantomData,
            #[cfg(debug_assertions)]
            visitors: (&self.visitors, task),
        }
    }
}

/// A shared array within a task.
#[derive(Debug)]
pub(crate) struct View<'t, T = Vec4> {
    start: *mut T,
    length: usize,
    borrowed: PhantomData<&'t T>,
    #[cfg(debug_assertions)]
    visitors: (&'t Visitors, &'t Task),
}

impl<T> Clone for View<'_, T> {
    #[inline(always)]
    fn clone(&self) -> Self {
        *self
    }
}

impl<T> Copy for View<'_, T> {}

impl<T> View<'_, T> {
    /// Where an item is.
    #[inline(always)]
    fn pointer(self, item: usize) -> *mut T {
        assert!(item < self.length, "inside the array");
        self.start.wrapping_add(item)
    }

    /// Notes, in debug builds, that the task reads so many items.
    #[inline(always)]
    #[cfg_attr(not(debug_assertions), expect(unused_variables, clippy::unused_self, reason = "nobody watches"))]
    fn reads(self, first: usize, count: usize) {
        #[cfg(debug_assertions)]
        (first..first + count).for_each(|item| self.visitors.0.read(item, self.visitors.1.ticket.number()));
    }

    #[inline(always)]
    #[cfg_attr(not(debug_assertions), expect(unused_variables, clippy::unused_self, reason = "nobody watches"))]
    fn writes(self, first: usize, count: usize) {
        #[cfg(debug_assertions)]
        (first..first + count).for_each(|item| self.visitors.0.write(item, self.visitors.1.ticket.number()));
    }

    /// Shows an item.
    #[cfg(feature = "gpu")]
    pub(crate) fn show<R>(self, item: usize, look: impl FnOnce(&T) -> R) -> R {
        self.reads(item, 1);
        // SAFETY: Alive, Inside (`pointer`), Apart; and what looks on does not put another item there ([`View::replace`]).
        look(unsafe { &*self.pointer(item) })
    }

    /// Puts another item in a place, which nobody is being shown meanwhile.
    #[cfg(feature = "gpu")]
    pub(crate) fn replace(self, item: usize, value: T) {
        self.writes(item, 1);
        // SAFETY: Alive, Inside (`pointer`), Apart; and nobody looks on ([`View::show`]).
        unsafe { *self.pointer(item) = value };
    }

    /// Asks for items that are about to be written: what another thread's cache holds would else be waited for at each store.
    pub(crate) fn claim(self, items: Range<u32>) {
        #[cfg(target_arch = "x86_64")]
        for line in (items.start as usize * size_of::<T>()..items.end as usize * size_of::<T>()).step_by(64) {
            let place = self.start.cast::<u8>().wrapping_add(line);
            // SAFETY: a hint, which may name any address and changes nothing; processors without it do nothing.
            unsafe {
                std::arch::asm!("prefetchw [{}]", in(reg) place, options(nostack, preserves_flags));
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = items;
    }
}

impl<T: Copy> View<'_, T> {
    #[inline(always)]
    pub(crate) fn get(self, item: usize) -> T {
        self.reads(item, 1);
        // SAFETY: Alive, Inside (`pointer`), Apart.
        unsafe { *self.pointer(item) }
    }

    #[inline(always)]
    pub(crate) fn set(self, item: usize, value: T) {
        self.writes(item, 1);
        // SAFETY: Alive, Inside (`pointer`), Apart.
        unsafe { *self.pointer(item) = value };
    }
}

impl<'t> View<'t, Vec4> {
    /// As many vectors as lanes, one after another from `first` on.
    #[inline(always)]
    pub(crate) fn row<L: Registers>(self, first: u32) -> Row<'t, L> {
        let first = first as usize;
        assert!(first + L::LANES <= self.length, "inside the array");
        Row { view: self, first, lanes: PhantomData }
    }

    /// The rows of a list, as many vectors as lanes each.
    #[inline(always)]
    pub(crate) fn rows<'p, L: Registers>(self, rows: &'p Rows) -> RowsOf<'p, L>
    where
        't: 'p,
    {
        assert!(rows.bound <= self.length && rows.length == L::LANES, "inside the array");
        RowsOf { view: self, starts: &rows.starts, lanes: PhantomData }
    }

    /// The rows of a list, twice as many vectors as lanes each.
    #[inline(always)]
    pub(crate) fn pairs<'p, L: Registers>(self, rows: &'p Rows) -> PairsOf<'p, L>
    where
        't: 'p,
    {
        assert!(rows.bound <= self.length && rows.length == 2 * L::LANES, "inside the array");
        PairsOf { view: self, starts: &rows.starts, lanes: PhantomData }
    }

    /// As many vectors as lanes, one after another from `first` on: all x, all y, all z.
    #[inline(always)]
    pub(crate) fn vectors<L: Registers>(self, first: usize) -> Vector<L> {
        let row = self.row::<L>(first as u32);
        L::transpose([row.get(0), row.get(1), row.get(2), row.get(3)])
    }

    /// The inverse of [`View::vectors`], with 0 as fourth.
    #[inline(always)]
    pub(crate) fn set_vectors<L: Registers>(self, first: usize, vectors: Vector<L>) {
        let (row, [a, b, c, d]) = (self.row::<L>(first as u32), L::vectors(vectors));
        row.set(0, a);
        row.set(1, b);
        row.set(2, c);
        row.set(3, d);
    }

    /// The vectors at the places of a list.
    #[inline(always)]
    pub(crate) fn at<'p>(self, places: &'p Places) -> Gathered<'p>
    where
        't: 'p,
    {
        assert!(places.bound <= self.length, "inside the array");
        Gathered { view: self, places: &places.items }
    }

    /// A register of vectors that are known to be inside.
    #[inline(always)]
    fn load<L: Registers>(self, first: usize) -> L {
        self.reads(first, L::VECTORS);
        // SAFETY: Alive, Inside (whoever calls this has compared), Apart.
        L::load(unsafe { std::slice::from_raw_parts(self.start.wrapping_add(first), L::VECTORS) })
    }

    #[inline(always)]
    fn store<L: Registers>(self, first: usize, value: L) {
        self.writes(first, L::VECTORS);
        // SAFETY: Alive, Inside (whoever calls this has compared), Apart.
        value.store(unsafe { std::slice::from_raw_parts_mut(self.start.wrapping_add(first), L::VECTORS) });
    }

    /// A vector at a place of a list that was compared.
    #[inline(always)]
    fn vector(self, place: u32) -> Vec4 {
        self.reads(place as usize, 1);
        // SAFETY: Alive, Inside (the list's bound), Apart.
        unsafe { *self.start.wrapping_add(place as usize) }
    }

    #[inline(always)]
    fn set_vector(self, place: u32, vector: Vec4) {
        self.writes(place as usize, 1);
        // SAFETY: Alive, Inside (the list's bound), Apart.
        unsafe { *self.start.wrapping_add(place as usize) = vector };
    }
}

/// As many vectors as lanes in four registers, wherever they are in memory.
pub(crate) trait Four<L> {
    /// Register `k`, below 4.
    fn get(&self, k: usize) -> L;
    fn set(&self, k: usize, value: L);
}

/// Vectors one after another.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Row<'t, L> {
    view: View<'t>,
    /// There are as many as lanes from here on.
    first: usize,
    lanes: PhantomData<L>,
}

impl<L: Registers> Four<L> for Row<'_, L> {
    #[inline(always)]
    fn get(&self, k: usize) -> L {
        self.view.load(self.first + k % 4 * L::VECTORS)
    }

    #[inline(always)]
    fn set(&self, k: usize, value: L) {
        self.view.store(self.first + k % 4 * L::VECTORS, value);
    }
}

/// The rows of a list.
#[derive(Debug, Clone, Copy)]
pub(crate) struct RowsOf<'p, L> {
    view: View<'p>,
    /// All inside.
    starts: &'p [u32],
    lanes: PhantomData<L>,
}

impl<'p, L: Registers> RowsOf<'p, L> {
    #[inline(always)]
    pub(crate) fn row(self, index: usize) -> Row<'p, L> {
        Row { view: self.view, first: self.starts[index] as usize, lanes: PhantomData }
    }
}

/// The rows of a list, as pairs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PairsOf<'p, L> {
    view: View<'p>,
    /// All inside.
    starts: &'p [u32],
    lanes: PhantomData<L>,
}

impl<'p, L: Registers> PairsOf<'p, L> {
    #[inline(always)]
    pub(crate) fn row(self, index: usize) -> Pairs<'p, L> {
        Pairs { view: self.view, first: self.starts[index] as usize, lanes: PhantomData }
    }
}

/// Vectors anywhere: register `k` holds those of lanes `k`, `k + 4` ...
#[derive(Debug, Clone, Copy)]
pub(crate) struct Listed<'t, L> {
    view: View<'t>,
    /// As many as lanes, all inside.
    places: &'t [u32],
    lanes: PhantomData<L>,
}

impl<L: Registers> Listed<'_, L> {
    #[inline(always)]
    fn of_lane(&self, lane: usize) -> u32 {
        self.places[if lane < L::LANES { lane } else { 0 }]
    }
}

impl<L: Registers> Four<L> for Listed<'_, L> {
    #[inline(always)]
    fn get(&self, k: usize) -> L {
        let vector = |lane: usize| self.view.vector(self.of_lane(lane));
        L::from_vectors([vector(k), vector(k + 4), vector(k + 8), vector(k + 12)])
    }

    /// Of vectors at one place the first is what lasts.
    #[inline(always)]
    fn set(&self, k: usize, value: L) {
        let vectors = value.to_vectors();
        for index in (0..L::VECTORS).rev() {
            self.view.set_vector(self.of_lane(k + 4 * index), vectors[index]);
        }
    }
}

/// Pairs of vectors one after another: the even ones and the odd ones.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pairs<'t, L> {
    view: View<'t>,
    /// There are twice as many as lanes from here on.
    first: usize,
    lanes: PhantomData<L>,
}

impl<L: Registers> Pairs<'_, L> {
    /// Registers `k` of the even and of the odd ones.
    #[inline(always)]
    pub(crate) fn get(&self, k: usize) -> [L; 2] {
        let (first, count) = (self.first + k % 4 * 2 * L::VECTORS, 2 * L::VECTORS);
        self.view.reads(first, count);
        // SAFETY: Alive, Inside (`View::pairs`), Apart.
        L::load_pairs(unsafe { std::slice::from_raw_parts(self.view.start.wrapping_add(first), count) })
    }

    #[inline(always)]
    pub(crate) fn set(&self, k: usize, pairs: [L; 2]) {
        let (first, count) = (self.first + k % 4 * 2 * L::VECTORS, 2 * L::VECTORS);
        self.view.writes(first, count);
        // SAFETY: Alive, Inside (`View::pairs`), Apart.
        L::store_pairs(pairs, unsafe { std::slice::from_raw_parts_mut(self.view.start.wrapping_add(first), count) });
    }
}

/// Vectors at the places of a list.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Gathered<'p> {
    view: View<'p>,
    /// All inside.
    places: &'p [u32],
}

impl<'p> Gathered<'p> {
    #[inline(always)]
    pub(crate) fn get(self, index: usize) -> Vec4 {
        self.view.vector(self.places[index])
    }

    /// As many vectors as lanes, from an index of the list on.
    #[inline(always)]
    pub(crate) fn row<L: Registers>(self, first: usize) -> Listed<'p, L> {
        Listed { view: self.view, places: &self.places[first..first + L::LANES], lanes: PhantomData }
    }

    /// The same: all x, all y, all z.
    #[inline(always)]
    pub(crate) fn vectors<L: Registers>(self, first: usize) -> Vector<L> {
        let listed = self.row::<L>(first);
        L::transpose([listed.get(0), listed.get(1), listed.get(2), listed.get(3)])
    }

    /// As many vectors as a register holds, from an index of the list on.
    #[inline(always)]
    pub(crate) fn register<L: Registers>(self, first: usize) -> L {
        let places = &self.places[first..first + L::VECTORS];
        let vector = |k: usize| self.view.vector(places[if k < L::VECTORS { k } else { 0 }]);
        L::from_vectors([vector(0), vector(1), vector(2), vector(3)])
    }

    /// The same of a list that ascends, or ascends and then repeats its first: often they are one after another.
    #[inline(always)]
    pub(crate) fn ascending<L: Registers>(self, first: usize) -> L {
        let places = &self.places[first..first + L::VECTORS];
        if places[L::VECTORS - 1] == places[0].wrapping_add(L::VECTORS as u32 - 1) {
            self.view.load(places[0] as usize)
        } else {
            self.register(first)
        }
    }
}

/// Memory of a GPU's that is mapped to be written, as vectors of three one after another.
///
/// The pointer is good as long as this lives, for it keeps the view: wgpu does not unmap a buffer that has one.
#[cfg(feature = "gpu")]
#[derive(Debug)]
pub(crate) struct MappedVectors {
    array: SharedArray<'static, glam::Vec3>,
    /// Dropped after the array.
    _view: wgpu::BufferViewMut,
}

#[cfg(feature = "gpu")]
impl MappedVectors {
    /// None if the memory is at an odd address.
    #[expect(clippy::cast_ptr_alignment, reason = "looked at below")]
    pub(crate) fn new(mut view: wgpu::BufferViewMut) -> Option<MappedVectors> {
        let length = view.len() / size_of::<glam::Vec3>();
        let start = view.slice(..).as_raw_element_ptr().as_ptr().cast::<glam::Vec3>();
        let array = SharedArray {
            start,
            length,
            borrowed: PhantomData,
            #[cfg(debug_assertions)]
            visitors: Visitors::new(length),
        };
        start.is_aligned().then_some(MappedVectors { array, _view: view })
    }

    pub(crate) fn array(&self) -> &SharedArray<'_, glam::Vec3> {
        &self.array
    }
}
