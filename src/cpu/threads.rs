//! How many threads a step is done on: as many as pay.
//!
//! What pays depends on the cloth, on the machine, and on what else the machine does at the time: on a core that is busy with
//! something else a task that was begun is waited for until that core comes back to it. So it is measured. Steps are timed, other
//! counts are tried now and then, and the best is kept. What a step computes does not depend on it.

/// Counts that are tried: 1, 2, 4 ... and the pool's.
const COUNTS: usize = 12;
/// Vertices that a thread has at first.
const VERTICES: usize = 512;
/// Steps of a trial; the first of them moves the cloth from cache to cache, and does not count.
const TRIAL: u32 = 4;
/// Steps between trials, at least and at most.
const PAUSE: [u32; 2] = [4, 1024];
/// A count that is not better than the present one by this is not worth a change.
const GAIN: f64 = 0.96;
/// Share of a step in the mean time of its count.
const NEWEST: f64 = 0.125;

/// Chooses the number of threads, step by step.
#[derive(Debug)]
pub(crate) struct ThreadChoice {
    /// Threads of the pool that it is for.
    pool: usize,
    /// Mean time (s) of a substep on each count, recently; 0 if it was not tried.
    time: [f64; COUNTS],
    /// Which count is kept, which was before, and which is being tried for how many steps yet.
    kept: usize,
    before: usize,
    trial: Option<(usize, u32)>,
    /// Steps until the next trial, and between trials.
    left: u32,
    pause: u32,
    /// Whether the next one is of more threads.
    up: bool,
}

impl ThreadChoice {
    /// For a cloth on a pool of so many threads.
    pub(crate) fn new(vertices: usize, pool: usize) -> ThreadChoice {
        let fitting = (0..=last(pool)).take_while(|&count| threads(count, pool) * VERTICES <= vertices);
        let kept = fitting.last().unwrap_or(0);
        // Where every thread has far more than it needs, another count is hardly better.
        let ample = vertices / (2 * VERTICES * threads(kept, pool));
        let pause = PAUSE[0].saturating_mul(ample as u32).clamp(PAUSE[0], 16 * PAUSE[0]);
        let time = [0.0; COUNTS];
        ThreadChoice { pool, time, kept, before: usize::MAX, trial: None, left: pause, pause, up: true }
    }

    /// Threads for the next step.
    pub(crate) fn threads(&self) -> usize {
        threads(self.trial.map_or(self.kept, |(count, _)| count), self.pool)
    }

    /// Notes how long (s) a substep took on them.
    pub(crate) fn note(&mut self, seconds: f64) {
        let count = self.trial.map_or(self.kept, |(count, _)| count);
        let time = &mut self.time[count];
        let newest = match self.trial {
            // A mean of the trial's own steps but the first.
            Some((_, left)) => 1.0 / f64::from((TRIAL - left).max(1)),
            None => NEWEST,
        };
        *time = if *time == 0.0 { seconds } else { *time + newest * (seconds - *time) };
        match self.trial {
            Some((_, left)) if left > 1 => self.trial = Some((count, left - 1)),
            Some(_) => {
                self.trial = None;
                let (better, back) = (self.time[count] < GAIN * self.time[self.kept], count == self.before);
                if better {
                    (self.before, self.kept) = (self.kept, count);
                } else {
                    self.up = !self.up;
                }
                self.wait(better && !back);
            }
            None => self.consider(),
        }
    }

    /// After a step on the count that is kept: tries one that was better of late, or when it is time, another.
    fn consider(&mut self) {
        self.left -= 1;
        let tried = (0..=last(self.pool)).filter(|&count| self.time[count] > 0.0);
        let best = tried.min_by(|&a, &b| self.time[a].total_cmp(&self.time[b])).unwrap_or(self.kept);
        let next = if self.up { self.kept + 1 } else { self.kept.wrapping_sub(1) };
        if self.time[best] < GAIN * self.time[self.kept] && self.pause - self.left >= PAUSE[0] {
            self.trial = Some((best, TRIAL));
        } else if self.left == 0 && next <= last(self.pool) {
            self.trial = Some((next, TRIAL));
        } else if self.left == 0 {
            (self.up, self.left) = (!self.up, 1);
        }
    }

    /// Until the next trial: soon after one that brought something new, ever later after others.
    fn wait(&mut self, gained: bool) {
        self.pause = if gained { PAUSE[0] } else { (2 * self.pause).min(PAUSE[1]) };
        self.left = self.pause;
    }
}

/// Threads of a count.
fn threads(count: usize, pool: usize) -> usize {
    (1 << count).min(pool)
}

/// The count that is the whole pool.
fn last(pool: usize) -> usize {
    (pool.next_power_of_two().trailing_zeros() as usize).min(COUNTS - 1)
}

#[cfg(test)]
#[path = "../../tests/unit/cpu_threads.rs"]
mod tests;
