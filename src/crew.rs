//! Rounds of tasks on the threads of the current rayon pool: all tasks of a round before any of the next.
//!
//! A rayon loop wakes and settles its threads anew, 1.4 to 6 us; a step has hundreds of rounds. Here threads join once a step and
//! take tasks by a flag each, their own first so that a stripe stays in one core's cache. Whoever is there does the work:
//! a thread that comes late, or never because the caller's pool is busy, is waited for by nobody, only a task that it took.

use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};

/// What a step's rounds are: so many tasks in each kind of round, all kinds in turn, again and again.
#[derive(Debug, Default)]
pub(crate) struct Crew {
    kinds: Vec<(Turns, usize)>,
    /// How often each task has been taken, kind after kind.
    taken: Vec<Apart<AtomicU32>>,
    /// How many tasks of each kind are done, over all turns: in a few counts, for threads that are done at once wait for one another at
    /// one.
    done: Vec<[Apart<AtomicUsize>; COUNTS]>,
    sleepers: AtomicUsize,
    lock: Mutex<()>,
    bell: Condvar,
}

/// When a kind of round comes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Turns {
    All,
    First,
}

/// In cache lines of its own (two, as they are fetched), so that threads at its neighbours do not wait for it.
#[derive(Debug, Default)]
#[repr(align(128))]
struct Apart<T>(T);

/// A slice that the tasks of a round share. Who reads and writes where is for the tasks to agree on.
#[derive(Debug)]
pub(crate) struct Shared<T> {
    start: *mut T,
    length: usize,
    /// Items that may be read and written, be they beyond the slice.
    room: usize,
}

impl<T> Shared<T> {
    pub(crate) fn new(items: &mut [T]) -> Shared<T> {
        let length = items.len();
        Shared::with_room(items, length)
    }

    /// The first so many items; the others may be read and written too.
    pub(crate) fn with_room(items: &mut [T], length: usize) -> Shared<T> {
        Shared { start: items.as_mut_ptr(), length, room: items.len() }
    }

    /// Items that are not in a slice of ours.
    #[cfg(feature = "gpu")]
    pub(crate) fn at(start: *mut T, length: usize) -> Shared<T> {
        Shared { start, length, room: length }
    }

    pub(crate) fn len(self) -> usize {
        self.length
    }

    pub(crate) fn pointer(self) -> *mut T {
        self.start
    }
}

#[expect(unsafe_code, reason = "tasks of one round write disjoint items: see Stripes")]
impl<T: Copy> Shared<T> {
    /// # Safety
    /// The slice is alive, `index` is within its room, and nobody writes there meanwhile.
    pub(crate) unsafe fn get(self, index: usize) -> T {
        debug_assert!(index < self.room);
        // SAFETY: the caller's promise.
        unsafe { *self.start.add(index) }
    }

    /// # Safety
    /// As [`Shared::get`], and nobody reads there meanwhile.
    pub(crate) unsafe fn set(self, index: usize, value: T) {
        debug_assert!(index < self.room);
        // SAFETY: the caller's promise.
        unsafe { *self.start.add(index) = value }
    }
}

impl<T> Clone for Shared<T> {
    fn clone(&self) -> Shared<T> {
        *self
    }
}

impl<T> Copy for Shared<T> {}

#[expect(unsafe_code, reason = "see Shared")]
// SAFETY: access is by unsafe functions alone, whose callers keep threads apart.
unsafe impl<T: Send> Sync for Shared<T> {}

#[expect(unsafe_code, reason = "see Shared")]
// SAFETY: as above.
unsafe impl<T: Send> Send for Shared<T> {}

const COUNTS: usize = 4;
/// Looks at the others' progress before a thread looks for tasks of theirs: a microsecond or two.
const GRACE: u32 = 50;
/// Looks at the others' progress before a thread goes to sleep: some 0.2 ms, longer than any task of a cloth worth sharing.
const PATIENCE: u32 = 5_000;

impl Crew {
    /// No rounds.
    pub(crate) fn clear(&mut self) {
        self.kinds.clear();
    }

    /// One kind of round more, of `tasks` tasks.
    pub(crate) fn add(&mut self, turns: Turns, tasks: usize) {
        self.kinds.push((turns, tasks));
    }

    /// Calls `work(turn, kind, task)` for every task of `turns` turns, on up to `threads` threads of the current pool. Allocates
    /// only when there are more tasks than ever before.
    pub(crate) fn run(&mut self, turns: u32, threads: usize, work: &(impl Fn(u32, usize, usize) + Sync)) {
        let tasks: usize = self.kinds.iter().map(|kind| kind.1).sum();
        self.taken.resize_with(tasks.max(self.taken.len()), Apart::default);
        self.done.resize_with(self.kinds.len().max(self.done.len()), Default::default);
        self.taken.iter_mut().for_each(|taken| *taken.0.get_mut() = 0);
        self.done.iter_mut().flatten().for_each(|done| *done.0.get_mut() = 0);
        let most = self.kinds.iter().map(|kind| kind.1).max().unwrap_or(0);
        let threads = threads.min(most).max(1);
        if threads == 1 {
            for turn in 0..turns {
                for (kind, &(when, count)) in self.kinds.iter().enumerate() {
                    let count = if when == Turns::First && turn > 0 { 0 } else { count };
                    (0..count).for_each(|task| work(turn, kind, task));
                }
            }
            return;
        }
        self.recruit(0, threads, threads, turns, work);
    }

    /// Members `first..end`, by halves: unlike tasks of a scope, these need no memory of their own.
    fn recruit(&self, first: usize, end: usize, threads: usize, turns: u32, work: &(impl Fn(u32, usize, usize) + Sync)) {
        if end - first == 1 {
            return self.serve(first, threads, turns, work);
        }
        let middle = first.midpoint(end);
        let half = |first, end| move || self.recruit(first, end, threads, turns, work);
        rayon::join(half(first, middle), half(middle, end));
    }

    /// One member's part: in every round its own tasks, then any that nobody took, unless the others are done soon.
    fn serve(&self, member: usize, threads: usize, turns: u32, work: &(impl Fn(u32, usize, usize) + Sync)) {
        for turn in 0..turns {
            let mut base = 0;
            for (kind, &(when, count)) in self.kinds.iter().enumerate() {
                let round = Round { turn, kind, base, target: count * (turn as usize + 1) };
                base += count;
                if when == Turns::First && turn > 0 {
                    continue;
                }
                let own = member * count / threads..(member + 1) * count / threads;
                own.clone().for_each(|task| self.take(round, task, work));
                // To look at another's task is to fetch its cache line: a round of well cut tasks ends without.
                if !self.looks(GRACE, round) {
                    (own.end..count).chain(0..own.start).for_each(|task| self.take(round, task, work));
                    self.wait(round);
                }
            }
        }
    }

    /// Does a task unless somebody has.
    fn take(&self, round: Round, task: usize, work: &(impl Fn(u32, usize, usize) + Sync)) {
        let (turn, flag) = (round.turn, &self.taken[round.base + task].0);
        let free = flag.load(Ordering::Relaxed) == turn;
        if free && flag.compare_exchange(turn, turn + 1, Ordering::Relaxed, Ordering::Relaxed).is_ok() {
            let _done = Done { crew: self, round, task };
            work(turn, round.kind, task);
        }
    }

    fn is_done(&self, round: Round) -> bool {
        let done = |count: &Apart<AtomicUsize>| count.0.load(Ordering::SeqCst);
        self.done[round.kind].iter().map(done).sum::<usize>() >= round.target
    }

    /// Whether the round is done before so many looks at it.
    fn looks(&self, looks: u32, round: Round) -> bool {
        for _ in 0..looks {
            if self.is_done(round) {
                return true;
            }
            std::hint::spin_loop();
        }
        false
    }

    /// Until the round is done: looks for a while, then sleeps, so that a busy machine can get on with what is waited for.
    fn wait(&self, round: Round) {
        if self.looks(PATIENCE, round) {
            return;
        }
        self.sleepers.fetch_add(1, Ordering::SeqCst);
        let mut guard = self.lock.lock().unwrap_or_else(PoisonError::into_inner);
        while !self.is_done(round) {
            guard = self.bell.wait(guard).unwrap_or_else(PoisonError::into_inner);
        }
        drop(guard);
        self.sleepers.fetch_sub(1, Ordering::SeqCst);
    }
}

/// One round of one turn: its tasks' flags begin at `base`, and it is done when `target` tasks of its kind are, over all turns.
#[derive(Debug, Clone, Copy)]
struct Round {
    turn: u32,
    kind: usize,
    base: usize,
    target: usize,
}

/// Counts a task as done when dropped: also if it panics, or the others would wait for ever.
struct Done<'a> {
    crew: &'a Crew,
    round: Round,
    task: usize,
}

impl Drop for Done<'_> {
    fn drop(&mut self) {
        let crew = self.crew;
        crew.done[self.round.kind][self.task % COUNTS].0.fetch_add(1, Ordering::SeqCst);
        if crew.sleepers.load(Ordering::SeqCst) > 0 && crew.is_done(self.round) {
            // Under the lock, so that no one is between looking and sleeping.
            drop(crew.lock.lock().unwrap_or_else(PoisonError::into_inner));
            crew.bell.notify_all();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every task once a turn, no round before the last is done, on any number of threads; also with more threads than cores.
    #[test]
    fn rounds_follow_one_another() {
        for threads in [1, 2, 3, 16] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut crew = Crew::default();
            for counts in [vec![5, 3], vec![1], vec![7, 0, 2]] {
                crew.clear();
                counts.iter().for_each(|&count| crew.add(Turns::All, count));
                crew.add(Turns::First, 3);
                let early = AtomicU32::new(0);
                let runs: Vec<Vec<AtomicU32>> =
                    counts.iter().map(|&count| (0..count).map(|_| AtomicU32::new(0)).collect()).collect();
                pool.install(|| {
                    crew.run(100, threads, &|turn, kind, task| {
                        if kind == runs.len() {
                            early.fetch_add(1 + turn, Ordering::SeqCst);
                            return;
                        }
                        assert!(turn == 0 || early.load(Ordering::SeqCst) == 3, "what comes once is done");
                        assert_eq!(runs[kind][task].fetch_add(1, Ordering::SeqCst), turn, "its {turn}th turn");
                        for (other, runs) in runs.iter().enumerate() {
                            let expected = turn + u32::from(other < kind);
                            if other != kind {
                                assert!(runs.iter().all(|runs| runs.load(Ordering::SeqCst) == expected), "{kind} while {other}");
                            }
                        }
                    });
                });
                assert!(runs.iter().flatten().all(|runs| runs.load(Ordering::SeqCst) == 100));
            }
        }
    }

    #[test]
    fn a_panic_in_a_task_reaches_the_caller_and_stops_nobody() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        let mut crew = Crew::default();
        (0..2).for_each(|_| crew.add(Turns::All, 4));
        let mut run = || pool.install(|| crew.run(3, 2, &|turn, _, task| assert!((turn, task) != (1, 2), "as planned")));
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(&mut run)).is_err());
    }
}
