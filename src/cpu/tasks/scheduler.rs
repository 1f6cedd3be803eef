//! A scheduler that runs a graph of tasks on the threads of the current rayon pool.
//!
//! A step repeats the same passes, turn after turn, and a pass consists of tasks. Each task lists the places of the
//! cloth that it accesses. It may start once all tasks of earlier passes that access one of these places are done; a
//! counter at each place says how many are. Tasks of one pass do not wait for one another: the caller must give them
//! disjoint places.
//!
//! Why not a parallel loop per pass (`benches/results/threads.md` compares the two)? A step has hundreds of passes.
//! Each loop takes 1.4 to 6 us to wake and to join its threads, and all threads wait for the slowest one every time.
//! Here workers are recruited once per step. They claim tasks by an atomic flag each, their own share first, so that a
//! tile stays in one core's cache. No particular worker is needed: if one comes late, or never because the caller's
//! pool is busy, the others do its tasks. They wait only for tasks that it has already claimed.
//!
//! Workers are recruited by `rayon::join`. While it waits for them, it runs other jobs of the pool, the caller's among
//! them, which is why `Deformer::step` warns about holding locks. `rayon::spawn` does not wait like that, but it
//! allocates memory for each worker of each step, and its closures must be `'static`, so the cloth could be lent to
//! them only by code that the compiler cannot check. The step could still not return before every worker that has
//! started is done.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};

use super::shared::Task;
use super::team::Team;
use crate::HAS_THREADS;
use crate::model::csr::Csr;

/// Where a graph runs.
#[derive(Clone, Copy)]
pub(crate) enum On<'a> {
    /// On up to so many threads of the current pool.
    Pool(usize),
    /// On up to so many threads of a team.
    Team(&'a Team, usize),
}

impl On<'_> {
    pub(crate) fn threads(self) -> usize {
        match self {
            On::Pool(threads) => threads,
            On::Team(team, threads) => threads.min(team.threads()),
        }
    }
}

/// The tasks of a kind of step and their dependencies. Built once, run many times.
#[derive(Debug, Default)]
pub(crate) struct Graph {
    passes: Vec<PassRange>,
    /// Number of passes that run in the first turn only, before all others.
    once: usize,
    /// For each task, the places that it waits at, and how many earlier tasks must be done there in the first turn.
    waits: Csr<Wait>,
    /// The places at which each task counts as done.
    counts: Csr<u32>,
    /// The tasks that count at each place, in order of their passes.
    at_place: Csr<u32>,
    /// For each place, how many of its tasks run in every turn.
    each_turn: Vec<usize>,
    /// For each task, how often it has been claimed in this run.
    taken: Vec<Padded<AtomicU32>>,
    /// For each place, how many tasks are done there in this run.
    done: Vec<Padded<AtomicUsize>>,
    /// Number of workers that sleep, or are about to.
    sleepers: AtomicUsize,
    lock: Mutex<()>,
    condvar: Condvar,
}

/// A pass from which a [`Graph`] is built.
#[derive(Debug, Clone)]
pub(crate) struct PassTasks {
    /// The places that each task accesses.
    pub touches: Vec<Vec<u32>>,
    /// More places at which a task waits for earlier tasks, but where later tasks need not wait for it, because those
    /// that would have to already wait for others that imply it. Empty, or one list per task.
    pub awaits: Vec<Vec<u32>>,
    /// Whether the tasks wait only for tasks of the pass before that are close to their own, so that a worker may go on
    /// to them while their data is in cache.
    pub follows: bool,
}

#[derive(Debug, Clone)]
struct PassRange {
    tasks: Range<usize>,
    follows: bool,
}

/// How many tasks must be done at a place before a task may start.
#[derive(Debug, Clone, Copy, Default)]
struct Wait {
    place: u32,
    before: u32,
}

/// Aligned to 128 bytes (two cache lines, because processors prefetch them in pairs) to avoid false sharing between
/// neighboring counters.
#[derive(Debug, Default)]
#[repr(align(128))]
struct Padded<T>(T);

/// Polls of a task's dependencies before a worker looks for other tasks: one or two microseconds at first, doubled each
/// time that it finds none.
const POLLS: u32 = 50;
/// How many dependencies back a worker searches exhaustively for a task that is ready.
const SEARCH_DEPTH: u32 = 2;
/// Polls before a worker goes to sleep. With those before, this is about 0.2 ms, longer than any task of a cloth that
/// is worth sharing.
const POLLS_BEFORE_SLEEP: u32 = 64 * POLLS;

/// A task in one turn.
#[derive(Debug, Clone, Copy)]
struct Job {
    turn: u32,
    pass: usize,
    task: usize,
}

impl Graph {
    /// Builds the graph of `passes` over `places` places. The first `once` passes run in the first turn only.
    pub(crate) fn new(passes: Vec<PassTasks>, once: usize, places: usize) -> Graph {
        let mut graph = Graph { once, ..Graph::default() };
        let mut tasks_at: Vec<Vec<u32>> = vec![Vec::new(); places];
        for PassTasks { touches, awaits, follows } in passes {
            assert!(awaits.is_empty() || awaits.len() == touches.len(), "one list a task");
            assert!(touches.iter().all(|places| !places.is_empty()), "a task that touches nothing is ordered with nobody");
            let first = graph.counts.spans.len();
            for (index, places) in touches.iter().enumerate() {
                let all = places.iter().chain(awaits.get(index).into_iter().flatten());
                graph.waits.push(all.map(|&place| Wait { place, before: tasks_at[place as usize].len() as u32 }));
                graph.counts.push(places.iter().copied());
            }
            // Registered after the whole pass, so that tasks of one pass do not wait for one another.
            for (task, places) in (first as u32..).zip(&touches) {
                places.iter().for_each(|&place| tasks_at[place as usize].push(task));
            }
            graph.passes.push(PassRange { tasks: first..first + touches.len(), follows });
        }
        let tasks = graph.counts.spans.len();
        let first_turn = graph.passes.get(once).map_or(tasks, |pass| pass.tasks.start) as u32;
        graph.each_turn = tasks_at.iter().map(|tasks| tasks.iter().filter(|&&task| task >= first_turn).count()).collect();
        tasks_at.into_iter().for_each(|tasks| graph.at_place.push(tasks));
        graph.taken.resize_with(tasks, Padded::default);
        graph.done.resize_with(places, Padded::default);
        graph
    }

    /// Calls `work(task, turn, pass, index)` for every task of `turns` turns.
    pub(crate) fn run(&mut self, turns: u32, on: On<'_>, work: &(impl Fn(&Task, u32, usize, usize) + Sync)) {
        let most = self.passes.iter().map(|pass| pass.tasks.len()).max().unwrap_or(0);
        let workers = on.threads().min(most).max(1);
        if workers == 1 || !HAS_THREADS {
            for turn in 0..turns {
                for pass in self.passes_of(turn) {
                    (0..self.passes[pass].tasks.len()).for_each(|index| work(&Task::begin(), turn, pass, index));
                }
            }
            return;
        }
        self.taken.iter_mut().for_each(|taken| *taken.0.get_mut() = 0);
        self.done.iter_mut().for_each(|done| *done.0.get_mut() = 0);
        let run = Run { graph: self, workers, turns, work };
        match on {
            On::Pool(_) => run.recruit(0, workers),
            On::Team(team, _) => team.run(workers, &|worker| run.serve(worker)),
        }
    }

    /// Runs the same tasks with a parallel loop for each pass: the baseline that [`Graph::run`] is measured against.
    #[cfg(any(test, feature = "bench"))]
    pub(crate) fn run_pass_by_pass(&mut self, turns: u32, work: &(impl Fn(&Task, u32, usize, usize) + Sync)) {
        use rayon::prelude::*;
        for turn in 0..turns {
            for pass in self.passes_of(turn) {
                (0..self.passes[pass].tasks.len()).into_par_iter().for_each(|index| work(&Task::begin(), turn, pass, index));
            }
        }
    }

    /// The passes that run in a turn.
    fn passes_of(&self, turn: u32) -> Range<usize> {
        if turn == 0 { 0..self.passes.len() } else { self.once..self.passes.len() }
    }
}

/// One run of a graph.
struct Run<'r, W> {
    graph: &'r Graph,
    workers: usize,
    turns: u32,
    work: &'r W,
}

impl<W: Fn(&Task, u32, usize, usize) + Sync> Run<'_, W> {
    /// Starts workers `first..end` by recursive halving. Unlike the tasks of a rayon scope, this allocates no memory.
    fn recruit(&self, first: usize, end: usize) {
        if end - first == 1 {
            return self.serve(first);
        }
        let middle = first.midpoint(end);
        rayon::join(|| self.recruit(first, middle), || self.recruit(middle, end));
    }

    /// The work of one worker: its own tasks of every pass, except those that others have claimed.
    fn serve(&self, worker: usize) {
        for turn in 0..self.turns {
            let passes = self.graph.passes_of(turn);
            let mut first = passes.start;
            for chain in self.graph.passes[passes].chunk_by(|_, next| next.follows) {
                let own = || self.own(turn, first..first + chain.len(), worker);
                // Do all own tasks that are ready first, because other workers may wait for them; then wait for the
                // rest.
                let ready = || own().filter(|&job| self.is_free(job) && self.is_ready(job));
                while ready().filter(|&job| self.take(job)).count() > 0 {}
                own().for_each(|job| self.complete(job));
                first += chain.len();
            }
        }
    }

    /// A worker's own jobs of several passes, ordered so that passes follow one another closely at each place, while it
    /// is in cache.
    fn own(&self, turn: u32, passes: Range<usize>, worker: usize) -> impl Iterator<Item = Job> {
        let share = move |pass: usize| {
            let Range { start, end } = self.graph.passes[pass].tasks;
            let tasks = end - start;
            start + worker * tasks / self.workers..start + (worker + 1) * tasks / self.workers
        };
        let steps = passes.clone().enumerate().map(|(lag, pass)| share(pass).len() + lag).max().unwrap_or(0);
        let jobs = (0..steps).flat_map(move |step| passes.clone().enumerate().map(move |(lag, pass)| (step, lag, pass)));
        jobs.filter_map(move |(step, lag, pass)| {
            let task = share(pass).start + step.checked_sub(lag)?;
            (task < share(pass).end).then_some(Job { turn, pass, task })
        })
    }

    fn is_free(&self, job: Job) -> bool {
        self.graph.taken[job.task].0.load(Ordering::Relaxed) == self.count(job)
    }

    /// How often the job's task is claimed before this turn.
    fn count(&self, job: Job) -> u32 {
        if job.pass < self.graph.once { 0 } else { job.turn }
    }

    /// Whether all tasks that `job` waits for at this place are done.
    fn is_over(&self, job: Job, wait: Wait) -> bool {
        let needed = wait.before as usize + job.turn as usize * self.graph.each_turn[wait.place as usize];
        self.graph.done[wait.place as usize].0.load(Ordering::SeqCst) >= needed
    }

    /// Whether all that a job waits for is done.
    fn is_ready(&self, job: Job) -> bool {
        self.graph.waits.of(job.task as u32).iter().all(|&wait| self.is_over(job, wait))
    }

    /// Claims a job that is ready and runs it. Returns false if another worker has claimed it.
    fn take(&self, job: Job) -> bool {
        let (count, taken) = (self.count(job), &self.graph.taken[job.task].0);
        let is_mine = self.is_free(job) && taken.compare_exchange(count, count + 1, Ordering::Relaxed, Ordering::Relaxed).is_ok();
        if is_mine {
            let _done = Done { graph: self.graph, task: job.task };
            let index = job.task - self.graph.passes[job.pass].tasks.start;
            (self.work)(&Task::begin(), job.turn, job.pass, index);
        }
        is_mine
    }

    /// Returns once the job has been claimed. Waits for its dependencies, helps with them if they are unclaimed, and
    /// claims the job itself if nobody else does.
    fn complete(&self, job: Job) {
        let mut polls = POLLS;
        while self.is_free(job) {
            let looks = || {
                (0..polls).any(|_| {
                    std::hint::spin_loop();
                    self.is_ready(job)
                })
            };
            if self.is_ready(job) || looks() {
                self.take(job);
                return;
            }
            polls = match self.blocker(job) {
                Some(other) => {
                    self.take(other);
                    POLLS
                }
                None if polls < POLLS_BEFORE_SLEEP => 2 * polls,
                None => {
                    self.sleep(job);
                    POLLS
                }
            };
        }
    }

    /// A job that is ready and on which `job` depends, directly or indirectly; none if all of them are in progress.
    ///
    /// Close dependencies are searched first, starting with those farthest from where another worker is at work. If
    /// there are none, follows the chain of first unclaimed dependencies back as far as it goes, because the worker
    /// whose tasks those are may never have come.
    fn blocker(&self, job: Job) -> Option<Job> {
        self.ready_before(job, SEARCH_DEPTH).or_else(|| {
            let mut job = job;
            while !self.is_ready(job) {
                job = self.free_before(job).next()?;
            }
            Some(job)
        })
    }

    /// A job that is ready: this one, or a dependency at most `others` levels back.
    fn ready_before(&self, job: Job, others: u32) -> Option<Job> {
        if self.is_ready(job) {
            return Some(job);
        }
        if others == 0 { None } else { self.free_before(job).find_map(|other| self.ready_before(other, others - 1)) }
    }

    /// The unclaimed jobs that a job waits for, those of its last place first.
    fn free_before(&self, job: Job) -> impl Iterator<Item = Job> {
        let graph = self.graph;
        let waits = graph.waits.of(job.task as u32).iter().rev().filter(move |&&wait| !self.is_over(job, wait));
        let jobs = waits.flat_map(move |wait| {
            let (before, behind) = graph.at_place.of(wait.place).split_at(wait.before as usize);
            // Of this pass and later ones, the tasks of the turn before must be done.
            let last = job.turn.checked_sub(1);
            let last = behind.iter().filter_map(move |&task| Some((last?, task)));
            last.chain(before.iter().map(move |&task| (job.turn, task)))
        });
        let jobs = jobs.map(|(turn, task)| Job { turn, pass: self.pass_of(task as usize), task: task as usize });
        jobs.filter(|&other| (other.pass >= graph.once || other.turn == 0) && self.is_free(other))
    }

    fn pass_of(&self, task: usize) -> usize {
        self.graph.passes.partition_point(|pass| pass.tasks.end <= task)
    }

    /// Sleeps until there is something to do, so that on a busy machine the threads that are waited for get the core.
    fn sleep(&self, job: Job) {
        let graph = self.graph;
        graph.sleepers.fetch_add(1, Ordering::SeqCst);
        let mut guard = graph.lock.lock().unwrap_or_else(PoisonError::into_inner);
        while self.is_free(job) && self.blocker(job).is_none() {
            guard = graph.condvar.wait(guard).unwrap_or_else(PoisonError::into_inner);
        }
        drop(guard);
        graph.sleepers.fetch_sub(1, Ordering::SeqCst);
    }
}

/// Counts a task as done when dropped, even if the task panics; otherwise the other workers would wait forever.
struct Done<'a> {
    graph: &'a Graph,
    task: usize,
}

impl Drop for Done<'_> {
    fn drop(&mut self) {
        let Done { graph, task } = *self;
        graph.counts.of(task as u32).iter().for_each(|&place| _ = graph.done[place as usize].0.fetch_add(1, Ordering::SeqCst));
        if graph.sleepers.load(Ordering::SeqCst) > 0 {
            // Taking the lock ensures that no worker is between its last check and its sleep, where it would miss the
            // notification.
            drop(graph.lock.lock().unwrap_or_else(PoisonError::into_inner));
            graph.condvar.notify_all();
        }
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/cpu_scheduler.rs"]
mod tests;
