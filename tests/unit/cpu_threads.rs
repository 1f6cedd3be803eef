//! Unit tests of `src/cpu/threads.rs`.

use super::*;

/// Runs `steps` steps whose time (s) depends on the number of threads, and returns the mean time.
fn run(choice: &mut ThreadChoice, steps: u32, time: impl Fn(usize, u32) -> f64) -> f64 {
    let step = |step: u32| {
        let seconds = time(choice.threads(), step);
        choice.note(seconds);
        seconds
    };
    (0..steps).map(step).sum::<f64>() / f64::from(steps)
}

#[test]
fn as_many_threads_as_pay() {
    for pool in [1, 2, 3, 8, 16, 48] {
        for best in [1, 2, 3, 5, 16] {
            // The work is divided among the threads, and each thread adds a cost.
            let time = |threads: usize, _: u32| 1.0 / threads as f64 + threads as f64 / f64::from(best * best);
            let least = (0..=last(pool)).map(|count| time(threads(count, pool), 0)).fold(f64::INFINITY, f64::min);
            for vertices in [10, 4000, 1_000_000] {
                let mut choice = ThreadChoice::new(vertices, pool);
                run(&mut choice, 300, time);
                let mean = run(&mut choice, 2000, time);
                assert!(mean < 1.06 * least, "{pool} threads, best {best}: {mean} of {least}");
            }
        }
    }
}

/// Half of the steps on two threads wait for a busy core: a single thread is chosen, and two again once the core is
/// free.
#[test]
fn a_busy_core_is_left_alone() {
    let mut choice = ThreadChoice::new(100_000, 2);
    let quiet = |threads: usize, _: u32| if threads == 1 { 1.0 } else { 0.55 };
    let mean = run(&mut choice, 1000, quiet);
    assert!(mean < 0.6, "{mean}");
    let busy = |threads: usize, step: u32| match threads {
        1 => 1.0,
        _ if step % 4 == 3 => 4.75,
        _ => 0.55,
    };
    let mean = run(&mut choice, 2000, busy);
    assert!(mean < 1.1, "{mean} of one thread's time");
    run(&mut choice, 3000, quiet);
    let mean = run(&mut choice, 1000, quiet);
    assert!(mean < 0.6, "{mean}: it is back on two");
}
