use std::sync::atomic::AtomicU64;

use super::*;

/// Runs something on a pool of so many threads.
fn on<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(work)
}

/// The sum of the numbers up to a count, each in a piece of its own.
fn sum(team: &Team, count: usize) -> u64 {
    let sum = AtomicU64::new(0);
    team.run(count, &|piece| _ = sum.fetch_add(piece as u64 + 1, Ordering::Relaxed));
    sum.into_inner()
}

/// Many short loops one after another, on fewer threads, too, than are asked for: each piece is done once, before the loop
/// returns.
#[test]
fn each_piece_is_done_once() {
    let rounds = if cfg!(miri) { 20 } else { 2000 };
    for threads in [1, 2, 4] {
        on(threads, || {
            Team::gather(4, |team| {
                for round in 0..rounds {
                    let count = round % (MAX_PIECES + 1);
                    assert_eq!(sum(team, count), (count * (count + 1) / 2) as u64, "{threads} threads");
                }
            });
        });
    }
}

/// A loop within a piece of a loop, and a team within a team: these are done, too.
#[test]
fn loops_within_loops_are_done() {
    for threads in [1, 2, 4] {
        let total = AtomicU64::new(0);
        on(threads, || {
            Team::gather(4, |team| {
                team.run(8, &|_| {
                    let inner = sum(team, 10) + Team::gather(3, |team| sum(team, 20));
                    total.fetch_add(inner, Ordering::Relaxed);
                });
            });
        });
        assert_eq!(total.into_inner(), 8 * (55 + 210), "{threads} threads");
    }
}

/// The other threads do pieces: two pieces that wait for each other end.
#[test]
fn threads_work_at_once() {
    on(4, || {
        Team::gather(2, |team| {
            let come = AtomicUsize::new(0);
            team.run(2, &|_| {
                come.fetch_add(1, Ordering::SeqCst);
                while come.load(Ordering::SeqCst) < 2 {
                    std::thread::yield_now();
                }
            });
        });
    });
}

/// A panic, of the lender or of another thread, reaches the caller after all pieces that were begun are done, and the
/// threads can be recruited again.
#[test]
fn a_panic_passes_through() {
    on(4, || {
        for bad in 0..4 {
            let (begun, done) = (AtomicU64::new(0), AtomicU64::new(0));
            let caught = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                Team::gather(4, |team| {
                    team.run(4, &|piece| {
                        begun.fetch_add(1, Ordering::SeqCst);
                        assert!(piece != bad, "as expected");
                        done.fetch_add(1, Ordering::SeqCst);
                    });
                });
            }));
            assert!(caught.is_err(), "piece {bad}");
            assert_eq!(begun.into_inner(), done.into_inner() + 1, "piece {bad}");
            assert!(!IS_BUSY.get(), "the thread can be recruited again");
        }
        assert_eq!(Team::gather(4, |team| sum(team, 20)), 210);
    });
}
