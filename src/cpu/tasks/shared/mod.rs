//! Arrays that tasks share, each task writing in places of its own.
//!
//! One of the two places with unsafe code, which is in this file and in [`vectors`]. It rests on these invariants:
//!
//! - **Alive**: a [`SharedArray`] borrows its items, mutably, for as long as it lives, and a [`View`] borrows the array.
//! - **Inside**: every access is compared with the array's length: once for as many items as one after another are wanted
//!   together ([`vectors::Row`]), or once for a list of places or rows ([`lists`]) that were compared with the list's bound when it
//!   was made. Lengths and bounds never change.
//! - **Apart**: while tasks run, no item that one writes is read or written by another. An array can only be seen from within a
//!   [`Task`]; tasks are made by the [`scheduler`](super::scheduler) alone, which runs one only after all earlier ones that touch
//!   a place of the cloth that it touches. That a task's loops stay where it says is for [`Schedule`](crate::cpu::schedule::Schedule) to
//!   say; debug builds watch every access for two tasks that meet ([`race`]), which they find when those overlap in time.

#![expect(unsafe_code, reason = "see the invariants")]

use std::marker::PhantomData;
use std::ops::Range;

use glam::Vec4;

#[deny(unsafe_code)]
pub(crate) mod lists;
#[cfg(debug_assertions)]
#[deny(unsafe_code)]
mod race;
pub(crate) mod vectors;

#[cfg(debug_assertions)]
use race::{Ticket, Visitors};

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
        // SAFETY: Alive, for they are borrowed.
        unsafe { SharedArray::at(items.as_mut_ptr(), items.len()) }
    }

    /// # Safety
    /// So many items begin there, which nobody else reads or writes as long as the array lives.
    unsafe fn at(start: *mut T, length: usize) -> SharedArray<'a, T> {
        SharedArray {
            start,
            length,
            borrowed: PhantomData,
            #[cfg(debug_assertions)]
            visitors: Visitors::new(length),
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
        start.is_aligned().then(|| {
            // SAFETY: Alive, for the view is kept as long; nobody else has it.
            let array = unsafe { SharedArray::at(start, length) };
            MappedVectors { array, _view: view }
        })
    }

    pub(crate) fn array(&self) -> &SharedArray<'_, glam::Vec3> {
        &self.array
    }
}
