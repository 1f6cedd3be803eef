use rayon::prelude::*;

use super::*;

/// Runs something on a pool of so many threads.
fn on<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

/// Many short loops, with other loops that are awake inside them: all of it is done, with fewer threads, too, than are
/// asked for.
#[test]
fn loops_within_loops_are_done() {
    let sum = |count: u64| (0..count).into_par_iter().sum::<u64>();
    let nested = || (0..8_u64).into_par_iter().map(|_| awake(3, || sum(100))).sum::<u64>();
    for threads in [1, 2, 4] {
        let total = on(threads, || awake(3, || (0..50).map(|_| sum(1000) + nested()).sum::<u64>()));
        assert_eq!(total, 50 * (499_500 + 8 * 4950), "{threads} threads");
    }
}

/// A panic ends the other threads' search for work, and leaves the thread free for the next step.
#[test]
fn a_panic_passes_through() {
    on(4, || {
        let caught = std::panic::catch_unwind(|| awake(3, || panic!("as expected")));
        assert!(caught.is_err());
        assert!(!IS_BUSY.get(), "the thread can be recruited again");
        assert_eq!(awake(3, || (0..1000_u32).into_par_iter().sum::<u32>()), 499_500);
    });
}
