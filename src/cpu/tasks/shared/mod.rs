//! Arrays that tasks share and write to concurrently, each in places of its own.
//!
//! This module and its child [`vectors`] hold one of the crate's two pieces of unsafe code. It rests on these
//! invariants:
//!
//! - **Alive**: a [`SharedArray`] mutably borrows its items for as long as it lives, and a [`View`] borrows the array.
//! - **Inside**: every access is checked against the array's length: once for a contiguous group of items
//!   ([`vectors::Row`]), or once for a list of indices or rows ([`lists`]) whose elements were checked against the
//!   list's bound when it was built. Lengths and bounds never change.
//! - **Apart**: while tasks run, no item that one task writes is read or written by another. An array is accessible
//!   only from within a [`Task`]. Only the [`scheduler`](super::scheduler) makes tasks, and it runs one only after all
//!   earlier tasks that access a common place of the cloth. That a task's loops stay within the places it lists is the
//!   responsibility of [`Schedule`](crate::cpu::schedule::Schedule); debug builds watch every access for conflicting
//!   tasks ([`race`]), which they detect if the tasks overlap in time.
//! - **Returned**: work that is lent to other threads ([`Fork`]) is called only by a thread that has claimed one of its
//!   pieces, and the lender does not go on before all claimed pieces are done, even if it panics.

#![expect(unsafe_code, reason = "see the invariants")]

use std::marker::PhantomData;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicPtr, AtomicU8, AtomicUsize, Ordering};

use glam::Vec4;

#[deny(unsafe_code)]
pub(crate) mod lists;
#[cfg(debug_assertions)]
#[deny(unsafe_code)]
mod race;
pub(crate) mod vectors;

#[cfg(debug_assertions)]
use race::{Ticket, Visitors};

/// Proof that code runs inside a task of the scheduler.
pub(crate) struct Task {
    #[cfg(debug_assertions)]
    ticket: Ticket,
    /// Keeps others from constructing one, and keeps it in its thread.
    _made_here: PhantomData<*mut ()>,
}

impl Task {
    /// For the scheduler only, when it starts a task.
    pub(super) fn begin() -> Task {
        Task {
            #[cfg(debug_assertions)]
            ticket: Ticket::take(),
            _made_here: PhantomData,
        }
    }

    /// A task for tests, in which no other task may run beside it.
    #[cfg(test)]
    pub(crate) fn alone() -> Task {
        Task::begin()
    }
}

/// An array that the tasks of a step share.
pub(crate) struct SharedArray<'a, T = Vec4> {
    start: *mut T,
    length: usize,
    borrowed: PhantomData<&'a mut [T]>,
    #[cfg(debug_assertions)]
    visitors: Visitors,
}

// SAFETY: Apart; and the items may be sent to and shared with other threads.
unsafe impl<T: Send + Sync> Send for SharedArray<'_, T> {}
// SAFETY: Apart; and the items may be sent to and shared with other threads.
unsafe impl<T: Send + Sync> Sync for SharedArray<'_, T> {}

impl<'a, T> SharedArray<'a, T> {
    pub(crate) fn new(items: &'a mut [T]) -> SharedArray<'a, T> {
        // SAFETY: Alive, because the items are mutably borrowed for `'a`.
        unsafe { SharedArray::at(items.as_mut_ptr(), items.len()) }
    }

    /// # Safety
    /// `start` must point to `length` valid items, which nothing else reads or writes as long as the array lives.
    unsafe fn at(start: *mut T, length: usize) -> SharedArray<'a, T> {
        SharedArray {
            start,
            length,
            borrowed: PhantomData,
            #[cfg(debug_assertions)]
            visitors: Visitors::new(length),
        }
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// The array as seen from within a task.
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

/// A shared array within a task. Views are copied freely: a task may hold several of one array.
#[derive(Clone, Copy)]
pub(crate) struct View<'t, T = Vec4> {
    start: *mut T,
    length: usize,
    borrowed: PhantomData<&'t T>,
    #[cfg(debug_assertions)]
    visitors: (&'t Visitors, &'t Task),
}

impl<T: Copy> View<'_, T> {
    /// The address of an item.
    #[inline(always)]
    fn pointer(self, item: usize) -> *mut T {
        assert!(item < self.length, "inside the array");
        self.start.wrapping_add(item)
    }

    /// In debug builds, records that the task reads `count` items.
    #[inline(always)]
    #[cfg_attr(not(debug_assertions), expect(unused_variables, clippy::unused_self, reason = "nobody watches"))]
    fn reads(self, first: usize, count: usize) {
        #[cfg(debug_assertions)]
        (first..first + count).for_each(|item| self.visitors.0.read(item, self.visitors.1.ticket.number()));
    }

    /// In debug builds, records that the task writes `count` items.
    #[inline(always)]
    #[cfg_attr(not(debug_assertions), expect(unused_variables, clippy::unused_self, reason = "nobody watches"))]
    fn writes(self, first: usize, count: usize) {
        #[cfg(debug_assertions)]
        (first..first + count).for_each(|item| self.visitors.0.write(item, self.visitors.1.ticket.number()));
    }

    /// Prefetches items for writing. If another core's cache holds them, every store would otherwise wait for the
    /// transfer.
    pub(crate) fn claim(self, items: Range<u32>) {
        #[cfg(target_arch = "x86_64")]
        for line in (items.start as usize * size_of::<T>()..items.end as usize * size_of::<T>()).step_by(64) {
            let place = self.start.cast::<u8>().wrapping_add(line);
            // SAFETY: a prefetch is a hint: it may name any address and has no effect on memory. Processors without it
            // do nothing.
            unsafe {
                std::arch::asm!("prefetchw [{}]", in(reg) place, options(nostack, preserves_flags));
            }
        }
        #[cfg(not(target_arch = "x86_64"))]
        let _ = items;
    }

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

/// Mapped memory of the GPU that is open for writing, as a contiguous array of 3-vectors.
///
/// The pointer is valid as long as this lives and the device is not destroyed: it keeps the mapped view, and wgpu does not
/// unmap a buffer that has one. The engine that writes here has always just had an answer from the device.
#[cfg(feature = "gpu")]
pub(crate) struct MappedVectors {
    array: SharedArray<'static, glam::Vec3>,
    /// Declared after `array`, so that it is dropped later.
    _view: wgpu::BufferViewMut,
}

#[cfg(feature = "gpu")]
impl MappedVectors {
    /// None if the memory is not aligned for `f32`.
    #[expect(clippy::cast_ptr_alignment, reason = "looked at below")]
    pub(crate) fn new(mut view: wgpu::BufferViewMut) -> Option<MappedVectors> {
        let length = view.len() / size_of::<glam::Vec3>();
        let start = view.slice(..).as_raw_element_ptr().as_ptr().cast::<glam::Vec3>();
        start.is_aligned().then(|| {
            // SAFETY: Alive, because the view is kept for as long as the array; nothing else has access to it.
            let array = unsafe { SharedArray::at(start, length) };
            MappedVectors { array, _view: view }
        })
    }

    pub(crate) fn array(&self) -> &SharedArray<'_, glam::Vec3> {
        &self.array
    }
}

/// Most pieces of work that can be lent at once.
pub(crate) const MAX_PIECES: usize = 64;
/// States of a piece: it is nobody's, offered to everybody, or being done.
const FREE: u8 = 0;
const OFFERED: u8 = 1;
const CLAIMED: u8 = 2;
/// Polls for a piece that another thread does, before the lender lets other threads have its core.
const POLLS: u32 = 4096;

type Work<'a> = dyn Fn(usize) + Sync + 'a;

/// Work in pieces that a thread lends to others, which are awake and look for it; each piece is done once. Nothing is
/// allocated, and nobody is woken.
pub(crate) struct Fork {
    /// Where the lender keeps its reference to the work.
    work: AtomicPtr<&'static Work<'static>>,
    is_lent: AtomicBool,
    count: AtomicUsize,
    /// The state of each piece, in cache lines of its own.
    pieces: [PieceState; MAX_PIECES],
}

#[repr(align(128))]
struct PieceState(AtomicU8);

impl Fork {
    pub(crate) fn new() -> Fork {
        let pieces = [const { PieceState(AtomicU8::new(FREE)) }; MAX_PIECES];
        Fork { work: AtomicPtr::default(), is_lent: AtomicBool::new(false), count: AtomicUsize::new(0), pieces }
    }

    /// Calls `work` with each number below `count`, at most [`MAX_PIECES`], together with the threads that
    /// [`claim`](Fork::claim) pieces. Within work that is lent already, this thread does it alone.
    pub(crate) fn lend(&self, count: usize, work: &Work<'_>) {
        assert!(count <= MAX_PIECES, "there is a place for each piece");
        if self.is_lent.swap(true, Ordering::Acquire) {
            return (0..count).for_each(work);
        }
        self.work.store(std::ptr::from_ref(&work).cast_mut().cast(), Ordering::Relaxed);
        self.count.store(count, Ordering::Relaxed);
        let _returned = Returned(self);
        // Releases what is written above to whoever claims a piece.
        self.pieces[..count].iter().for_each(|piece| piece.0.store(OFFERED, Ordering::Release));
        self.claim_from(0);
    }

    /// Does all pieces from this one on that are offered. (To look at a piece takes its cache line from the thread that does it.)
    pub(crate) fn claim_from(&self, first: usize) {
        (first..self.count.load(Ordering::Relaxed)).for_each(|piece| _ = self.claim(piece));
    }

    /// Does a piece if it is offered. Returns whether it was.
    pub(crate) fn claim(&self, piece: usize) -> bool {
        let state = &self.pieces[piece].0;
        let is_mine = state.load(Ordering::Relaxed) == OFFERED
            && state.compare_exchange(OFFERED, CLAIMED, Ordering::Acquire, Ordering::Relaxed).is_ok();
        if is_mine {
            let _done = Done(state);
            // SAFETY: Returned: the lender, whose reference this is, waits until the piece is done.
            let work = unsafe { *self.work.load(Ordering::Relaxed) };
            work(piece);
        }
        is_mine
    }
}

/// Marks a piece as done when dropped, even after a panic.
struct Done<'a>(&'a AtomicU8);

impl Drop for Done<'_> {
    fn drop(&mut self) {
        self.0.store(FREE, Ordering::Release);
    }
}

/// When dropped, withdraws the pieces that nobody has claimed, and waits for the others.
struct Returned<'a>(&'a Fork);

impl Drop for Returned<'_> {
    fn drop(&mut self) {
        let count = self.0.count.load(Ordering::Relaxed);
        for PieceState(state) in &self.0.pieces[..count] {
            // An exchange takes long even if it fails.
            if state.load(Ordering::Relaxed) == OFFERED {
                _ = state.compare_exchange(OFFERED, FREE, Ordering::Relaxed, Ordering::Relaxed);
            }
            let mut polls = 0;
            while state.load(Ordering::Acquire) != FREE {
                std::hint::spin_loop();
                polls += 1;
                if polls > POLLS {
                    std::thread::yield_now();
                }
            }
        }
        self.0.is_lent.store(false, Ordering::Release);
    }
}
