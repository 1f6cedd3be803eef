//! Random bytes for the fuzz targets, `CLOTH_CASES` of each kind or some thousands. `fuzz/` has the same targets for
//! libFuzzer.

#[path = "common/fuzz.rs"]
mod fuzz;

use rayon::prelude::*;

/// Runs a target on random bytes on all threads, with a seed for each case so that a failure can name it.
fn by_chance(door: fn(&[u8])) {
    let cases = std::env::var("CLOTH_CASES").map_or(20_000, |cases| cases.parse().expect("a number"));
    (0..cases).into_par_iter().for_each(|seed: u64| {
        let mut random = fastrand::Rng::with_seed(seed);
        let bytes: Vec<u8> = (0..random.usize(0..256)).map(|_| random.u8(..)).collect();
        assert!(std::panic::catch_unwind(|| door(&bytes)).is_ok(), "seed {seed}: {bytes:?}");
    });
}

#[test]
fn obj() {
    by_chance(fuzz::obj);
}

#[test]
fn scene() {
    by_chance(fuzz::scene);
}

#[test]
fn calls() {
    by_chance(fuzz::calls);
}
