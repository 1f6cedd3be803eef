//! Rounds of tasks on the threads of the current rayon pool: a task begins once every task of an earlier round that touches what it
//! touches is done.
//!
//! A rayon loop wakes and settles its threads anew, 1.4 to 6 us; a step has hundreds of rounds. Here threads join once a step and
//! take tasks by a flag each, their own first so that a stripe stays in one core's cache. A task waits for its neighbours, by a count
//! at each place that it touches, not for a whole round, or the slowest of many threads would hold up all of them each time. And
//! whoever is there does the work: a thread that comes late, or never because the caller's pool is busy, is waited for by nobody,
//! only a task that it took.

use std::ops::Range;
use std::sync::atomic::{AtomicU32, AtomicUsize, Ordering};
use std::sync::{Condvar, Mutex, PoisonError};

/// What a step's rounds are: so many tasks in each kind of round, all kinds in turn, again and again.
#[derive(Debug, Default)]
pub(crate) struct Crew {
    kinds: Vec<Kind>,
    /// How often each task has been taken, kind after kind.
    taken: Vec<Apart<AtomicU32>>,
    /// How many tasks that touch a place are done.
    done: Vec<Apart<AtomicUsize>>,
    /// How many of those there are before each kind in the first turn, kind after kind, and how many in every turn.
    before: Vec<usize>,
    each: Vec<usize>,
    /// How many tasks are done anywhere: in a few counts, for threads that are done at once wait for one another at one.
    all_done: [Apart<AtomicUsize>; COUNTS],
    sleepers: AtomicUsize,
    lock: Mutex<()>,
    bell: Condvar,
}

/// When a kind of round comes. What comes first alone is added first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Turns {
    All,
    First,
}

/// Which tasks of other rounds those of a kind cannot run beside.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Meets {
    /// Those that touch what they touch.
    Neighbours,
    All,
}

#[derive(Debug, Clone, Copy)]
struct Kind {
    turns: Turns,
    meets: Meets,
    tasks: usize,
    /// Tasks before it in the first turn, and its first one's flag.
    first: usize,
}

/// In cache lines of its own (two, as they are fetched), so that threads at its neighbours do not wait for it.
#[derive(Debug, Default)]
#[repr(align(128))]
struct Apart<T>(T);

const COUNTS: usize = 4;
/// Looks at what a task waits for before a thread looks for another to do: a microsecond or two at first, then twice as long.
const GRACE: u32 = 50;
/// Looks before it goes to sleep: some 0.2 ms with those before, longer than any task of a cloth worth sharing.
const PATIENCE: u32 = 64 * GRACE;

impl Crew {
    /// No rounds.
    pub(crate) fn clear(&mut self) {
        self.kinds.clear();
    }

    /// One kind of round more, of `tasks` tasks. The first kind after one that meets all must touch every place.
    pub(crate) fn add(&mut self, turns: Turns, meets: Meets, tasks: usize) {
        debug_assert!(
            turns == Turns::All || self.kinds.iter().all(|kind| kind.turns == Turns::First),
            "what is first comes first"
        );
        let first = self.kinds.last().map_or(0, |last| last.first + last.tasks);
        self.kinds.push(Kind { turns, meets, tasks, first });
    }

    /// Calls `work(turn, kind, task)` for every task of `turns` turns, on up to `threads` threads of the current pool, given the
    /// places that each task of a kind `touches`. Allocates only when there is more of something than ever before.
    pub(crate) fn run<'a>(
        &mut self,
        turns: u32,
        threads: usize,
        touches: &(impl Fn(usize, usize) -> &'a [u32] + Sync),
        work: &(impl Fn(u32, usize, usize) + Sync),
    ) {
        let most = self.kinds.iter().map(|kind| kind.tasks).max().unwrap_or(0);
        let threads = threads.min(most).max(1);
        if threads == 1 {
            for turn in 0..turns {
                for (index, kind) in self.kinds.iter().enumerate().filter(|(_, kind)| kind.comes(turn)) {
                    (0..kind.tasks).for_each(|task| work(turn, index, task));
                }
            }
            return;
        }
        self.count(touches);
        let every = self.kinds.iter().filter(|kind| kind.turns == Turns::All).map(|kind| kind.tasks).sum();
        Run { crew: self, threads, turns, every, touches, work }.recruit(0, threads);
    }

    /// Counts what there is to wait for at each place.
    fn count<'a>(&mut self, touches: &impl Fn(usize, usize) -> &'a [u32]) {
        let Crew { kinds, taken, done, before, each, all_done, .. } = self;
        let visit = |kind: usize, visitor: &mut dyn FnMut(usize)| {
            let tasks = if kinds[kind].meets == Meets::All { 0 } else { kinds[kind].tasks };
            (0..tasks).flat_map(|task| touches(kind, task)).for_each(|&place| visitor(place as usize));
        };
        let mut places = 0;
        (0..kinds.len()).for_each(|kind| visit(kind, &mut |place| places = places.max(place + 1)));
        before.clear();
        each.clear();
        each.resize(places, 0);
        for kind in 0..kinds.len() {
            before.extend_from_slice(each);
            visit(kind, &mut |place| each[place] += 1);
        }
        (0..kinds.len()).filter(|&kind| !kinds[kind].comes(1)).for_each(|kind| visit(kind, &mut |place| each[place] -= 1));

        let tasks = kinds.last().map_or(0, |last| last.first + last.tasks);
        taken.resize_with(tasks.max(taken.len()), Apart::default);
        done.resize_with(places.max(done.len()), Apart::default);
        taken.iter_mut().for_each(|taken| *taken.0.get_mut() = 0);
        done.iter_mut().chain(all_done).for_each(|done| *done.0.get_mut() = 0);
    }
}

impl Kind {
    fn comes(self, turn: u32) -> bool {
        turn == 0 || self.turns == Turns::All
    }
}

/// What the members of a crew do.
struct Run<'r, T, W> {
    crew: &'r Crew,
    threads: usize,
    turns: u32,
    /// Tasks in every turn.
    every: usize,
    touches: &'r T,
    work: &'r W,
}

/// A task in one turn.
#[derive(Debug, Clone, Copy)]
struct Job {
    turn: u32,
    kind: usize,
    task: usize,
}

impl<'a, T: Fn(usize, usize) -> &'a [u32] + Sync, W: Fn(u32, usize, usize) + Sync> Run<'_, T, W> {
    /// Members `first..end`, by halves: unlike tasks of a scope, these need no memory of their own.
    fn recruit(&self, first: usize, end: usize) {
        if end - first == 1 {
            return self.serve(first);
        }
        let middle = first.midpoint(end);
        rayon::join(|| self.recruit(first, middle), || self.recruit(middle, end));
    }

    /// One member's part: its own tasks of every round, unless others do them.
    fn serve(&self, member: usize) {
        let alone = |kind: &Kind| kind.meets == Meets::All;
        for turn in 0..self.turns {
            let mut first = 0;
            for kinds in self.crew.kinds.chunk_by(|one, next| !alone(one) && !alone(next)) {
                let own = || self.own(turn, first..first + kinds.len(), member);
                // All that is ready, then the others: their neighbours may wait for this.
                let ready = || own().filter(|&job| self.is_free(job) && self.is_ready(job));
                while ready().filter(|&job| self.take(job)).count() > 0 {}
                own().for_each(|job| self.see_to(job));
                first += kinds.len();
            }
        }
    }

    /// A member's jobs of some kinds: at each place one kind soon after the other, while the place is in cache.
    fn own(&self, turn: u32, kinds: Range<usize>, member: usize) -> impl Iterator<Item = Job> {
        let share = move |kind: usize| {
            let tasks = if self.crew.kinds[kind].comes(turn) { self.crew.kinds[kind].tasks } else { 0 };
            member * tasks / self.threads..(member + 1) * tasks / self.threads
        };
        let steps = kinds.clone().enumerate().map(|(lag, kind)| share(kind).len() + lag).max().unwrap_or(0);
        let jobs = (0..steps).flat_map(move |step| kinds.clone().enumerate().map(move |(lag, kind)| (step, lag, kind)));
        jobs.filter_map(move |(step, lag, kind)| {
            let task = share(kind).start + step.checked_sub(lag)?;
            (task < share(kind).end).then_some(Job { turn, kind, task })
        })
    }

    /// How often a job's task was taken.
    fn taken(&self, job: Job) -> &AtomicU32 {
        &self.crew.taken[self.crew.kinds[job.kind].first + job.task].0
    }

    fn is_free(&self, job: Job) -> bool {
        self.taken(job).load(Ordering::Relaxed) == job.turn
    }

    /// Tasks that are done; counted where some meet all.
    fn all_done(&self) -> usize {
        self.crew.all_done.iter().map(|done| done.0.load(Ordering::SeqCst)).sum()
    }

    /// Whether all that a job waits for is done.
    fn is_ready(&self, job: Job) -> bool {
        let Crew { kinds, done, before, each, .. } = self.crew;
        let (turn, kind) = (job.turn as usize, kinds[job.kind]);
        let previous = kinds[job.kind.checked_sub(1).unwrap_or(kinds.len() - 1)];
        if [kind, previous].iter().any(|kind| kind.meets == Meets::All) {
            return self.all_done() >= kind.first + turn * self.every;
        }
        let mut places = (self.touches)(job.kind, job.task).iter().map(|&place| place as usize);
        places.all(|place| done[place].0.load(Ordering::SeqCst) >= before[job.kind * each.len() + place] + turn * each[place])
    }

    /// Does a job that is ready, unless somebody has.
    fn take(&self, job: Job) -> bool {
        let (Job { turn, kind, task }, taken) = (job, self.taken(job));
        let is_mine = self.is_free(job) && taken.compare_exchange(turn, turn + 1, Ordering::Relaxed, Ordering::Relaxed).is_ok();
        if is_mine {
            let places = if self.crew.kinds[kind].meets == Meets::All { &[] } else { (self.touches)(kind, task) };
            let _done = Done { crew: self.crew, places, task };
            (self.work)(turn, kind, task);
        }
        is_mine
    }

    /// Until somebody takes a job: waits for what it waits for, and does others meanwhile.
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
            grace = match self.others(job).find(|&other| self.take(other)) {
                Some(_) => GRACE,
                None if grace < PATIENCE => 2 * grace,
                None => {
                    self.sleep(job);
                    GRACE
                }
            };
        }
    }

    /// Jobs that anyone can do now, among all that a job may wait for.
    fn others(&self, job: Job) -> impl Iterator<Item = Job> {
        let kinds = self.behind(job).map(|kind| (kind, self.crew.kinds[kind].tasks));
        let tasks = kinds.flat_map(|(kind, tasks)| (0..tasks).map(move |task| Job { turn: 0, kind, task }));
        let next = tasks.map(|job| Job { turn: self.taken(job).load(Ordering::Relaxed), ..job });
        next.filter(|&job| job.turn < self.turns && self.crew.kinds[job.kind].comes(job.turn) && self.is_ready(job))
    }

    /// Kinds of rounds that may hold up a job, in turn: not those before the last that met all and is done. To look at more of others'
    /// tasks is to take their flags from their caches.
    fn behind(&self, job: Job) -> impl Iterator<Item = usize> {
        let kinds = &self.crew.kinds;
        let count = kinds.len();
        let before = |kind: usize| (kind + count - 1) % count;
        let apart = |kind: usize| [kind, before(kind)].iter().any(|&kind| kinds[kind].meets == Meets::All);
        // The first turn has more than every turn.
        let once = kinds.last().map_or(0, |last| last.first + last.tasks) - self.every;
        let done = self.all_done();
        let place = if done < once { done } else { once + (done - once) % self.every.max(1) };
        let mut first = kinds.iter().rposition(|kind| kind.first <= place).unwrap_or(0);
        let mut kinds_behind = (job.kind + count - first) % count + 1;
        // What meets neighbours alone may be done before others of the rounds before.
        while !apart(first) && kinds_behind < count {
            first = before(first);
            kinds_behind += 1;
        }
        (0..kinds_behind).map(move |kind| (first + kind) % count)
    }

    /// Sleeps until there is something to do, so that a busy machine can get on with what is waited for.
    fn sleep(&self, job: Job) {
        let crew = self.crew;
        crew.sleepers.fetch_add(1, Ordering::SeqCst);
        let mut guard = crew.lock.lock().unwrap_or_else(PoisonError::into_inner);
        while !self.is_ready(job) && self.others(job).next().is_none() {
            guard = crew.bell.wait(guard).unwrap_or_else(PoisonError::into_inner);
        }
        drop(guard);
        crew.sleepers.fetch_sub(1, Ordering::SeqCst);
    }
}

/// Counts a task as done when dropped: also if it panics, or the others would wait for ever.
struct Done<'a> {
    crew: &'a Crew,
    places: &'a [u32],
    task: usize,
}

impl Drop for Done<'_> {
    fn drop(&mut self) {
        let Done { crew, places, task } = *self;
        places.iter().for_each(|&place| _ = crew.done[place as usize].0.fetch_add(1, Ordering::SeqCst));
        if crew.kinds.iter().any(|kind| kind.meets == Meets::All) {
            crew.all_done[task % COUNTS].0.fetch_add(1, Ordering::SeqCst);
        }
        if crew.sleepers.load(Ordering::SeqCst) > 0 {
            // Under the lock, so that no one is between looking and sleeping.
            drop(crew.lock.lock().unwrap_or_else(PoisonError::into_inner));
            crew.bell.notify_all();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every task once a turn, and none before those that it must wait for, on any number of threads; also with more threads than
    /// cores, and more members than threads, so that some never come.
    #[test]
    fn tasks_wait_for_all_that_they_meet() {
        // Tasks touch what follows from their number; neighbours overlap.
        let all: Vec<u32> = (0..12).collect();
        let touches = |kind: usize, task: usize| match kind % 3 {
            0 => &all[task..=task],
            1 => &all[task..task + 2],
            _ => &all[2 * task..2 * task + 3],
        };
        let (neighbours, everyone) = (Meets::Neighbours, Meets::All);
        let scenes = [
            vec![(neighbours, 12), (neighbours, 11)],
            vec![(neighbours, 12), (neighbours, 3), (neighbours, 4)],
            vec![(everyone, 2), (neighbours, 11), (neighbours, 2)],
            vec![(neighbours, 12), (everyone, 1), (everyone, 5), (neighbours, 12), (neighbours, 7)],
        ];
        let crews = [(1, 1), (2, 2), (3, 3), (16, 16), (2, 7), (1, 3)];
        for ((threads, members), scene) in crews.into_iter().flat_map(|crew| scenes.iter().map(move |scene| (crew, scene))) {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut crew = Crew::default();
            for first in [false, true] {
                crew.clear();
                for (index, &(meets, tasks)) in scene.iter().enumerate() {
                    crew.add(if first && index == 0 { Turns::First } else { Turns::All }, meets, tasks);
                }
                let rounds = |kind: usize, turns: u32| if first && kind == 0 { turns.min(1) } else { turns };
                let runs: Vec<Vec<AtomicU32>> =
                    scene.iter().map(|&(_, tasks)| (0..tasks).map(|_| AtomicU32::new(0)).collect()).collect();
                let meet = |a: (usize, usize), b: (usize, usize)| {
                    let all = [a, b].iter().any(|&(kind, _)| scene[kind].0 == everyone);
                    all || touches(a.0, a.1).iter().any(|place| touches(b.0, b.1).contains(place))
                };
                let look = |turn: u32, kind: usize, task: usize| {
                    for (other, runs) in runs.iter().enumerate().filter(|&(other, _)| other != kind) {
                        let expected = rounds(other, turn + u32::from(other < kind));
                        for (beside, run) in runs.iter().enumerate().filter(|&(beside, _)| meet((kind, task), (other, beside))) {
                            assert_eq!(run.load(Ordering::SeqCst), expected, "{other}.{beside} while {kind}.{task} in {turn}");
                        }
                    }
                };
                let work = |turn: u32, kind: usize, task: usize| {
                    look(turn, kind, task);
                    if (task + turn as usize).is_multiple_of(7) {
                        std::thread::yield_now();
                    }
                    look(turn, kind, task);
                    assert_eq!(runs[kind][task].fetch_add(1, Ordering::SeqCst), turn, "its {turn}th turn");
                };
                pool.install(|| crew.run(100, members, &touches, &work));
                for (kind, runs) in runs.iter().enumerate() {
                    assert!(runs.iter().all(|runs| runs.load(Ordering::SeqCst) == rounds(kind, 100)));
                }
            }
        }
    }

    #[test]
    fn a_panic_in_a_task_reaches_the_caller_and_stops_nobody() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
        let mut crew = Crew::default();
        (0..2).for_each(|_| crew.add(Turns::All, Meets::Neighbours, 4));
        let work = |turn: u32, _: usize, task: usize| assert!((turn, task) != (1, 2), "as planned");
        let mut run = || pool.install(|| crew.run(3, 2, &|_, task| &[0, 1, 2, 3][task..=task], &work));
        assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(&mut run)).is_err());
    }
}
