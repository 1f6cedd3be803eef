//! Keeps threads of the pool awake while a step runs many short parallel loops, with serial work between them.
//!
//! A thread that finds no work goes to sleep within microseconds, and waking it takes longer than most of the loops. So
//! other threads are recruited once per step, which look for work until the step is over. They give up after some time
//! without any, so that a thread that was recruited while it waits for something else goes on.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use rayon::Yield;

/// Polls for which a thread waits for the others to be recruited before it takes other work; it could take their jobs.
const POLLS_AT_START: u32 = 4096;
/// How often a thread looks for work in vain before it gives up: one or two milliseconds.
const LOOKS: u32 = 10_000;

thread_local! {
    /// Whether this thread is already busy with a step or recruited for one.
    static IS_BUSY: Cell<bool> = const { Cell::new(false) };
}

/// Does some work while up to `others` other threads of the pool look for jobs that it leaves to them.
pub(crate) fn awake<R: Send>(others: usize, work: impl FnOnce() -> R + Send) -> R {
    Workers { waited_for: AtomicUsize::new(others), is_over: AtomicBool::new(false) }.recruit(others, work)
}

struct Workers {
    /// Number of threads that have not come yet.
    waited_for: AtomicUsize,
    is_over: AtomicBool,
}

impl Workers {
    /// Recruits by nested joins, which allocate no memory. All jobs are in this thread's queue before the work begins.
    fn recruit<R: Send>(&self, others: usize, work: impl FnOnce() -> R + Send) -> R {
        if others > 0 {
            return rayon::join(|| self.recruit(others - 1, work), || self.linger()).0;
        }
        // While this thread waits for a loop, it may take one of its own jobs.
        let _busy = Busy::begin();
        let _over = Over(&self.is_over);
        work()
    }

    /// Looks for work until the step's is over.
    fn linger(&self) {
        self.waited_for.fetch_sub(1, Ordering::Relaxed);
        if IS_BUSY.get() || self.is_over.load(Ordering::Relaxed) {
            return;
        }
        let _busy = Busy::begin();
        for _ in 0..POLLS_AT_START {
            if self.waited_for.load(Ordering::Relaxed) == 0 {
                break;
            }
            std::hint::spin_loop();
        }
        let mut looks = 0;
        while looks < LOOKS && !self.is_over.load(Ordering::Relaxed) {
            looks = if rayon::yield_now() == Some(Yield::Executed) { 0 } else { looks + 1 };
            std::hint::spin_loop();
        }
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

/// Ends the workers' search, after a panic too.
struct Over<'a>(&'a AtomicBool);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/cpu_awake.rs"]
mod tests;
