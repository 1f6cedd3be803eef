//! A team of threads that stay awake while a step runs many short parallel loops, with serial work between them.
//!
//! A thread of the pool that finds no work goes to sleep within microseconds, and waking it takes longer than most of the
//! loops; so does dividing a loop by stealing. So other threads are recruited once per step and watch a place of their own
//! for a piece of the next loop ([`Fork`]): the same piece each time, whose data is in their core's cache. Nobody waits for a
//! thread that has not come or is busy: others do its piece. A thread that has waited in vain for some time does other work
//! of the pool, and then rests.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use rayon::Yield;

use super::shared::{Fork, MAX_PIECES};
use crate::HAS_THREADS;

/// Polls in vain after which a thread looks for other work in the pool: some tens of microseconds.
const POLLS: u32 = 1024;
/// How often it looks for other work before it rests between looks, for so long: one or two milliseconds in all.
const LOOKS: u32 = 32;
const REST: Duration = Duration::from_micros(50);
/// How long it waits first for all others to come, counted in the same way.
const LOOKS_AT_START: u32 = 8;

thread_local! {
    /// Whether this thread is already busy with a step or recruited for one.
    static IS_BUSY: Cell<bool> = const { Cell::new(false) };
}

/// The threads of a step.
pub(crate) struct Team {
    threads: usize,
    fork: Fork,
    /// Number of other threads that have come, and of those among them that rest or do something else.
    came: AtomicUsize,
    away: AtomicUsize,
    is_over: AtomicBool,
}

impl Team {
    /// Does some work on this thread, with a team of so many threads of the pool, this one among them.
    pub(crate) fn gather<R: Send>(threads: usize, work: impl FnOnce(&Team) -> R + Send) -> R {
        let threads = threads.clamp(1, MAX_PIECES);
        let (came, away, is_over) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicBool::new(false));
        Team { threads, fork: Fork::new(), came, away, is_over }.recruit(threads - 1, work)
    }

    pub(crate) fn threads(&self) -> usize {
        self.threads
    }

    /// Calls `work` with each number below `count`, at most [`MAX_PIECES`], on the threads of the team.
    pub(crate) fn run(&self, count: usize, work: &(dyn Fn(usize) + Sync)) {
        self.fork.lend(count, work);
    }

    /// Recruits by nested joins, which allocate no memory. All jobs are in this thread's queue before the work begins.
    fn recruit<R: Send>(&self, others: usize, work: impl FnOnce(&Team) -> R + Send) -> R {
        if others > 0 && HAS_THREADS {
            return rayon::join(|| self.recruit(others - 1, work), || self.linger()).0;
        }
        // While this thread waits for a loop, it may take one of its own jobs.
        let _busy = Busy::begin();
        let _over = EndGuard(&self.is_over);
        work(self)
    }

    /// Helps with the step's loops until the step is over.
    fn linger(&self) {
        if IS_BUSY.get() || self.is_over.load(Ordering::Relaxed) {
            return;
        }
        let _busy = Busy::begin();
        let place = self.came.fetch_add(1, Ordering::Relaxed) + 1;
        let (mut looks, mut polls) = (0, 0);
        while !self.is_over.load(Ordering::Relaxed) {
            std::hint::spin_loop();
            polls += 1;
            if self.help(place) {
                (looks, polls) = (0, 0);
            } else if polls == POLLS || looks >= LOOKS {
                // Other work of the pool could be the jobs of those who have not come yet.
                if looks >= LOOKS_AT_START || self.came.load(Ordering::Relaxed) + 1 == self.threads {
                    self.look_elsewhere(looks >= LOOKS);
                }
                (looks, polls) = (looks + 1, 0);
            }
        }
    }

    /// Does other work of the pool if there is any; `rests` if there has been none for long.
    fn look_elsewhere(&self, rests: bool) {
        self.away.fetch_add(1, Ordering::Relaxed);
        if rayon::yield_now() != Some(Yield::Executed) && rests {
            std::thread::sleep(REST);
        }
        self.away.fetch_sub(1, Ordering::Relaxed);
    }

    /// Does the piece of a thread's place if it is offered, then those of places where nobody is.
    fn help(&self, place: usize) -> bool {
        let is_offered = self.fork.claim(place);
        if is_offered {
            let are_here = self.away.load(Ordering::Relaxed) == 0;
            self.fork.claim_from(if are_here { self.came.load(Ordering::Relaxed) + 1 } else { 1 });
        }
        is_offered
    }
}

/// Marks the thread as busy until dropped.
struct Busy(bool);

impl Busy {
    fn begin() -> Busy {
        Busy(IS_BUSY.replace(true))
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        IS_BUSY.set(self.0);
    }
}

/// Ends the others' search, after a panic too.
struct EndGuard<'a>(&'a AtomicBool);

impl Drop for EndGuard<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/cpu_team.rs"]
mod tests;
