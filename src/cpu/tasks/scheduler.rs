//! A task graph on the threads of the current rayon pool.
//!
//! A step is turns of the same passes, and a pass is tasks. Every task says which places of the cloth it touches, and begins once
//! all tasks of earlier passes that touch one of them are done: a count at each place says how many are. Tasks of one pass are for
//! the caller to keep apart.
//!
//! Why not a parallel loop for each pass (`benches/results/threads.md` has both): it wakes and settles its threads anew, 1.4 to
//! 6 us, and a step has hundreds of passes; and all wait for the slowest each time. Here workers join once a step, and take tasks by
//! a flag each, their own share first so that a tile stays in one core's cache. Whoever is there does the work: a worker that comes
//! late, or never because the caller's pool is busy, is waited for by nobody, only a task that it took.
//!
//! Workers come by `rayon::join`, which waits for those who came by doing whatever else the pool has to do, the caller's tasks among it:
//! `Deformer::step` warns of locks for that. What does not wait so, `rayon::spawn`, wants memory for each worker of each step and closures that
//! outlive the step, and so code that no compiler checks to lend them the cloth; and a step that would not end before a worker that is under way has to wait
//! for it one way or another.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};

use super::shared::Task;

/// Which tasks there are, and what each waits for. Made once for a kind of step.
#[derive(Debug, Default)]
pub(crate) struct Graph {
    passes: Vec<Pass>,
    /// Passes that come in the first turn alone, ahead of all others.
    once: usize,
    /// Where each task waits, and for how many tasks of earlier passes in the first turn.
    waits: Vec<Wait>,
    /// Where each task's begin, and the last one's end.
    wait_starts: Vec<usize>,
    /// Where each task counts as done, likewise.
    counts: Vec<u32>,
    count_starts: Vec<usize>,
    /// The tasks that count at each place, in order, and where each place's begin.
    at_place: Vec<u32>,
    at_place_starts: Vec<usize>,
    /// How many of them there are in every turn.
    each_turn: Vec<usize>,
    taken: Vec<Padded<AtomicU32>>,
    done: Vec<Padded<AtomicUsize>>,
    sleepers: AtomicUsize,
    lock: Mutex<()>,
    bell: Condvar,
}

/// A pass of a graph in the making.
#[derive(Debug, Clone)]
pub(crate) struct PassTasks {
    /// The places that each task touches.
    pub touches: Vec<Vec<u32>>,
    /// More places where a task waits for those before it, but where nobody needs to wait for it, because whoever would waits for
    /// others that do. Empty, or one list a task.
    pub awaits: Vec<Vec<u32>>,
    /// Whether its tasks wait for tasks of the pass before that are near theirs alone, so that a worker may go on to them while what
    /// they touch is in cache.
    pub follows: bool,
}

#[derive(Debug, Clone)]
struct Pass {
    tasks: Range<usize>,
    follows: bool,
}

#[derive(Debug, Clone, Copy)]
struct Wait {
    place: u32,
    before: u32,
}

/// In cache lines of its own (two, as they are fetched), so that threads at its neighbors do not wait for it.
#[derive(Debug, Default)]
#[repr(align(128))]
struct Padded<T>(T);

/// Looks at what a task waits for before a worker looks for another to do: a microsecond or two at first, then twice as long.
const GRACE: u32 = 50;
/// Looks after it did another: there may be more.
const AGAIN: u32 = 50;
/// How far back a worker looks at all that it waits for.
const NEAR: u32 = 2;
/// Looks before it goes to sleep: some 0.2 ms with those before, longer than any task of a cloth worth sharing.
const PATIENCE: u32 = 64 * GRACE;

/// A task in one turn.
#[derive(Debug, Clone, Copy)]
struct Job {
    turn: u32,
    pass: usize,
    task: usize,
}

impl Graph {
    /// Of so many places; the first `once` passes come in the first turn alone.
    pub(crate) fn new(passes: Vec<PassTasks>, once: usize, places: usize) -> Graph {
        let mut graph = Graph { once, wait_starts: vec![0], count_starts: vec![0], ..Graph::default() };
        let mut tasks_at: Vec<Vec<u32>> = vec![Vec::new(); places];
        for PassTasks { touches, awaits, follows } in passes {
            assert!(awaits.is_empty() || awaits.len() == touches.len(), "one list a task");
            assert!(touches.iter().all(|places| !places.is_empty()), "a task that touches nothing is ordered with nobody");
            let first = graph.count_starts.len() - 1;
            for (index, places) in touches.iter().enumerate() {
                let all = places.iter().chain(awaits.get(index).into_iter().flatten());
                graph.waits.extend(all.map(|&place| Wait { place, before: tasks_at[place as usize].len() as u32 }));
                graph.wait_starts.push(graph.waits.len());
                graph.counts.extend(places);
                graph.count_starts.push(graph.counts.len());
            }
            // Those of one pass do not wait for one another.
            for (task, places) in (first as u32..).zip(&touches) {
                places.iter().for_each(|&place| tasks_at[place as usize].push(task));
            }
            graph.passes.push(Pass { tasks: first..first + touches.len(), follows });
        }
        let first_turn = graph.passes.get(once).map_or(graph.count_starts.len() - 1, |pass| pass.tasks.start) as u32;
        graph.each_turn = tasks_at.iter().map(|tasks| tasks.iter().filter(|&&task| task >= first_turn).count()).collect();
        graph.at_place_starts = vec![0];
        for tasks in &tasks_at {
            graph.at_place.extend(tasks);
            graph.at_place_starts.push(graph.at_place.len());
        }
        graph.taken.resize_with(graph.count_starts.len() - 1, Padded::default);
        graph.done.resize_with(places, Padded::default);
        graph
    }

    /// Calls `work(task, turn, pass, index)` for each task of so many turns, on up to so many workers of the current pool.
    pub(crate) fn run(&mut self, turns: u32, workers: usize, work: &(impl Fn(&Task, u32, usize, usize) + Sync)) {
        let most = self.passes.iter().map(|pass| pass.tasks.len()).max().unwrap_or(0);
        let workers = workers.min(most).max(1);
        if workers == 1 {
            for turn in 0..turns {
                for pass in self.passes_of(turn) {
                    (0..self.passes[pass].tasks.len()).for_each(|index| work(&Task::begin(), turn, pass, index));
                }
            }
            return;
        }
        self.taken.iter_mut().for_each(|taken| *taken.0.get_mut() = 0);
        self.done.iter_mut().for_each(|done| *done.0.get_mut() = 0);
        Run { graph: self, workers, turns, work }.recruit(0, workers);
    }

    /// The same as a parallel loop for each pass, one after another: what [`Graph::run`] is measured against.
    #[cfg(any(test, feature = "bench"))]
    pub(crate) fn run_pass_by_pass(&mut self, turns: u32, work: &(impl Fn(&Task, u32, usize, usize) + Sync)) {
        use rayon::prelude::*;
        for turn in 0..turns {
            for pass in self.passes_of(turn) {
                (0..self.passes[pass].tasks.len()).into_par_iter().for_each(|index| work(&Task::begin(), turn, pass, index));
            }
        }
    }

    /// The passes of a turn.
    fn passes_of(&self, turn: u32) -> Range<usize> {
        if turn == 0 { 0..self.passes.len() } else { self.once..self.passes.len() }
    }

    /// What a task waits for.
    fn waits(&self, task: usize) -> &[Wait] {
        &self.waits[self.wait_starts[task]..self.wait_starts[task + 1]]
    }
}

/// What workers do.
struct Run<'r, W> {
    graph: &'r Graph,
    workers: usize,
    turns: u32,
    work: &'r W,
}

impl<W: Fn(&Task, u32, usize, usize) + Sync> Run<'_, W> {
    /// Workers `first..end`, by halves: unlike tasks of a scope, these need no memory of their own.
    fn recruit(&self, first: usize, end: usize) {
        if end - first == 1 {
            return self.serve(first);
        }
        let middle = first.midpoint(end);
        rayon::join(|| self.recruit(first, middle), || self.recruit(middle, end));
    }

    /// One worker's part: its own tasks of every pass, unless others do them.
    fn serve(&self, worker: usize) {
        for turn in 0..self.turns {
            let passes = self.graph.passes_of(turn);
            let mut first = passes.start;
            for chain in self.graph.passes[passes].chunk_by(|_, next| next.follows) {
                let own = || self.own(turn, first..first + chain.len(), worker);
                // All that is ready, then the others: their neighbors may wait for this.
                let ready = || own().filter(|&job| self.is_free(job) && self.is_ready(job));
                while ready().filter(|&job| self.take(job)).count() > 0 {}
                own().for_each(|job| self.see_to(job));
                first += chain.len();
            }
        }
    }

    /// A worker's jobs of some passes: at each place one pass soon after the other, while the place is in cache.
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

    /// How often a job's task was taken before it.
    fn count(&self, job: Job) -> u32 {
        if job.pass < self.graph.once { 0 } else { job.turn }
    }

    /// Whether all tasks before a job's that count at a place are done.
    fn is_over(&self, job: Job, wait: Wait) -> bool {
        let needed = wait.before as usize + job.turn as usize * self.graph.each_turn[wait.place as usize];
        self.graph.done[wait.place as usize].0.load(Ordering::SeqCst) >= needed
    }

    /// Whether all that a job waits for is done.
    fn is_ready(&self, job: Job) -> bool {
        self.graph.waits(job.task).iter().all(|&wait| self.is_over(job, wait))
    }

    /// Does a job that is ready, unless somebody has.
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

    /// Until somebody takes a job: waits for what it waits for, and does that if nobody does.
    fn see_to(&self, job: Job) {
        let mut grace = GRACE;
        while self.is_free(job) {
            let looks = || {
                (0..grace).any(|_| {
                    std::hint::spin_loop();
                    self.is_ready(job)
                })
            };
            if self.is_ready(job) || looks() {
                self.take(job);
                return;
            }
            grace = match self.blocker(job) {
                Some(other) => {
                    self.take(other);
                    AGAIN
                }
                None if grace < PATIENCE => 2 * grace,
                None => {
                    self.sleep(job);
                    GRACE
                }
            };
        }
    }

    /// A job that is ready and that one that is not waits for, by way of others or not; none if those are all under way.
    ///
    /// First what is near, farthest from where another worker is at it; then whatever the first of those that it waits for waits
    /// for, however far back: a worker may never have come.
    fn blocker(&self, job: Job) -> Option<Job> {
        self.ready_before(job, NEAR).or_else(|| {
            let mut job = job;
            while !self.is_ready(job) {
                job = self.free_before(job).next()?;
            }
            Some(job)
        })
    }

    /// A job that is ready: this one, or one that it waits for by way of so many others.
    fn ready_before(&self, job: Job, others: u32) -> Option<Job> {
        if self.is_ready(job) {
            return Some(job);
        }
        if others == 0 { None } else { self.free_before(job).find_map(|other| self.ready_before(other, others - 1)) }
    }

    /// The free jobs that a job waits for, those at the last place first.
    fn free_before(&self, job: Job) -> impl Iterator<Item = Job> {
        let graph = self.graph;
        let waits = graph.waits(job.task).iter().rev().filter(move |&&wait| !self.is_over(job, wait));
        let jobs = waits.flat_map(move |wait| {
            let place = wait.place as usize;
            let tasks = &graph.at_place[graph.at_place_starts[place]..graph.at_place_starts[place + 1]];
            let (before, behind) = tasks.split_at(wait.before as usize);
            // What is behind it was to be done in the turn before.
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

    /// Sleeps until there is something to do, so that a busy machine can get on with what is waited for.
    fn sleep(&self, job: Job) {
        let graph = self.graph;
        graph.sleepers.fetch_add(1, Ordering::SeqCst);
        let mut guard = graph.lock.lock().unwrap_or_else(PoisonError::into_inner);
        while self.is_free(job) && self.blocker(job).is_none() {
            guard = graph.bell.wait(guard).unwrap_or_else(PoisonError::into_inner);
        }
        drop(guard);
        graph.sleepers.fetch_sub(1, Ordering::SeqCst);
    }
}

/// Counts a task as done when dropped: also if it panics, or the others would wait for ever.
struct Done<'a> {
    graph: &'a Graph,
    task: usize,
}

impl Drop for Done<'_> {
    fn drop(&mut self) {
        let Done { graph, task } = *self;
        let counts = &graph.counts[graph.count_starts[task]..graph.count_starts[task + 1]];
        counts.iter().for_each(|&place| _ = graph.done[place as usize].0.fetch_add(1, Ordering::SeqCst));
        if graph.sleepers.load(Ordering::SeqCst) > 0 {
            // Under the lock, so that no one is between looking and sleeping.
            drop(graph.lock.lock().unwrap_or_else(PoisonError::into_inner));
            graph.bell.notify_all();
        }
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/cpu_scheduler.rs"]
mod tests;
