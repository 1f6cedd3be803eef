//! Adaptive choice of the number of threads for a step.
//!
//! The best number depends on the cloth, on the machine and on the machine's other load: a task that started on a core
//! which is then busy with something else delays all that wait for it. So the number is measured. Steps are timed,
//! other numbers are tried from time to time, and the fastest is kept. The result of a step does not depend on the
//! number.

/// Number of candidates: 1, 2, 4 ... threads, and the whole pool.
const COUNTS: usize = 12;
/// Vertices per thread before anything is measured.
const VERTICES: usize = 512;
/// Steps of a trial. The first one moves the cloth between caches and is not counted.
const TRIAL: u32 = 4;
/// Minimum and maximum number of steps between trials.
const PAUSE: [u32; 2] = [4, 1024];
/// A candidate must take less than this share of the present time to replace it.
const GAIN: f64 = 0.96;
/// Weight of the newest step in the moving average of a candidate's time.
const NEWEST: f64 = 0.125;

/// Chooses the number of threads, step by step. Candidate `i` stands for `2^i` threads, at most the pool's.
pub(crate) struct ThreadChoice {
    /// Threads of the pool.
    pool: usize,
    /// Moving average of the time (s) of a substep with each candidate; 0 if it was never tried.
    time: [f64; COUNTS],
    /// The candidate in use.
    kept: usize,
    /// The candidate that was in use before it.
    before: usize,
    /// The candidate being tried, and for how many more steps.
    trial: Option<(usize, u32)>,
    /// Steps until the next trial.
    left: u32,
    /// Steps between trials.
    pause: u32,
    /// Whether the next trial is of more threads, rather than fewer.
    up: bool,
}

impl ThreadChoice {
    /// For a cloth of `vertices` vertices, on a pool of `pool` threads.
    pub(crate) fn new(vertices: usize, pool: usize) -> ThreadChoice {
        let fitting = (0..=last(pool)).take_while(|&count| threads(count, pool) * VERTICES <= vertices);
        let kept = fitting.last().unwrap_or(0);
        // Where every thread has far more vertices than it needs, other candidates are hardly better and are tried less
        // often.
        let ample = vertices / (2 * VERTICES * threads(kept, pool));
        let pause = PAUSE[0].saturating_mul(ample as u32).clamp(PAUSE[0], 16 * PAUSE[0]);
        let time = [0.0; COUNTS];
        ThreadChoice { pool, time, kept, before: usize::MAX, trial: None, left: pause, pause, up: true }
    }

    /// The number of threads for the next step.
    pub(crate) fn threads(&self) -> usize {
        threads(self.trial.map_or(self.kept, |(count, _)| count), self.pool)
    }

    /// Records the time (s) that a substep of the last step took.
    pub(crate) fn note(&mut self, seconds: f64) {
        let count = self.trial.map_or(self.kept, |(count, _)| count);
        let time = &mut self.time[count];
        let newest = match self.trial {
            // The mean over the trial's steps, without the first.
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

    /// After a step with the candidate in use: starts a trial of one that was faster recently, or, when it is time, of
    /// the next one up or down.
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

    /// Sets the pause before the next trial: short after a trial that found an improvement, else twice as long as the
    /// last.
    fn wait(&mut self, gained: bool) {
        self.pause = if gained { PAUSE[0] } else { (2 * self.pause).min(PAUSE[1]) };
        self.left = self.pause;
    }
}

/// The number of threads that a candidate stands for.
fn threads(count: usize, pool: usize) -> usize {
    (1 << count).min(pool)
}

/// The candidate that stands for the whole pool.
fn last(pool: usize) -> usize {
    (pool.next_power_of_two().trailing_zeros() as usize).min(COUNTS - 1)
}

#[cfg(test)]
#[path = "../../tests/unit/cpu_threads.rs"]
mod tests;
