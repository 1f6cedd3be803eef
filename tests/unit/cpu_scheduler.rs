//! Unit tests of `src/cpu/tasks/scheduler.rs`.

use std::sync::atomic::AtomicU32;

use super::*;
#[cfg(debug_assertions)]
use crate::cpu::tasks::shared::SharedArray;

const PLACES: usize = 14;

/// Random passes. The tasks of a pass touch one place, several or all; in some passes neighboring tasks share a place.
fn scene(random: &mut fastrand::Rng) -> (Vec<PassTasks>, usize) {
    let passes = random.usize(2..7);
    let all: Vec<u32> = (0..PLACES as u32).collect();
    let pass = |random: &mut fastrand::Rng| {
        let touches = match random.u8(0..4) {
            0 => vec![all.clone()],
            1 => all.windows(2).map(<[u32]>::to_vec).collect(),
            2 => all.chunks(random.usize(2..5)).map(<[u32]>::to_vec).collect(),
            _ => all.chunks(1).map(<[u32]>::to_vec).collect(),
        };
        PassTasks { touches, awaits: Vec::new(), follows: random.bool() }
    };
    ((0..passes).map(|_| pass(random)).collect(), random.usize(0..2))
}

/// Every task runs once per turn, and none before those that it must wait for. This holds for any number of threads,
/// also with more threads than cores, and with more workers than threads, so that some never start. The parallel loops
/// do the same.
#[test]
fn tasks_wait_for_all_that_touches_what_they_touch() {
    let mut random = fastrand::Rng::with_seed(4);
    let pools = [1, 2, 3, 16].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap());
    for (pool, workers) in [(0, 1), (1, 2), (1, 7), (2, 3), (3, 16), (0, 3)] {
        for _ in 0..12 {
            let (passes, once) = scene(&mut random);
            let mut graph = Graph::new(passes.clone(), once, PLACES);
            for loops in [false, true] {
                let turns = if workers > 3 { 40 } else { 100 };
                let runs: Vec<Vec<AtomicU32>> =
                    passes.iter().map(|pass| pass.touches.iter().map(|_| AtomicU32::new(0)).collect()).collect();
                let expected = |pass: usize, turns: u32| if pass < once { turns.min(1) } else { turns };
                let look = |turn: u32, pass: usize, task: usize| {
                    for (other, runs) in runs.iter().enumerate().filter(|&(other, _)| other != pass) {
                        let expected = expected(other, turn + u32::from(other < pass));
                        for (beside, run) in runs.iter().enumerate() {
                            let theirs = &passes[other].touches[beside];
                            if passes[pass].touches[task].iter().any(|place| theirs.contains(place)) {
                                let run = run.load(Ordering::SeqCst);
                                assert_eq!(run, expected, "{other}.{beside} while {pass}.{task} in {turn}");
                            }
                        }
                    }
                };
                let work = |_: &Task, turn: u32, pass: usize, task: usize| {
                    look(turn, pass, task);
                    if (task + turn as usize).is_multiple_of(7) {
                        std::thread::yield_now();
                    }
                    look(turn, pass, task);
                    assert_eq!(runs[pass][task].fetch_add(1, Ordering::SeqCst), turn, "its {turn}th turn");
                };
                pools[pool].install(|| {
                    if loops { graph.run_pass_by_pass(turns, &work) } else { graph.run(turns, On::Pool(workers), &work) }
                });
                for (pass, runs) in runs.iter().enumerate() {
                    assert!(runs.iter().all(|runs| runs.load(Ordering::SeqCst) == expected(pass, turns)));
                }
            }
        }
    }
}

#[test]
fn a_panic_in_a_task_reaches_the_caller_and_stops_nobody() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let pass = PassTasks { touches: (0..4).map(|place| vec![place]).collect(), awaits: Vec::new(), follows: true };
    let mut graph = Graph::new(vec![pass.clone(), pass], 0, 4);
    let work = |_: &Task, turn: u32, _: usize, task: usize| assert!((turn, task) != (1, 2), "as planned");
    let mut run = || pool.install(|| graph.run(3, On::Pool(2), &work));
    assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(&mut run)).is_err());
}

/// A task that writes what it did not declare is detected in debug builds.
#[test]
#[cfg(debug_assertions)]
fn a_race_is_found() {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    let mut items = [0_u32; 1];
    let array = SharedArray::new(&mut items);
    let mut graph = Graph::new(vec![PassTasks { touches: vec![vec![0], vec![1]], awaits: Vec::new(), follows: false }], 0, 2);
    let both = std::sync::Barrier::new(2);
    let work = |task: &Task, _: u32, _: usize, index: usize| {
        both.wait();
        let written = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| array.within(task).set(0, index as u32)));
        both.wait();
        written.unwrap();
    };
    let mut run = || pool.install(|| graph.run(1, On::Pool(2), &work));
    assert!(std::panic::catch_unwind(std::panic::AssertUnwindSafe(&mut run)).is_err());
}
