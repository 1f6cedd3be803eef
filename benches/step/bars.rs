//! Figures that a list of single timings cannot give: ratios of two codes timed in turn, and times with the error beside them.
//!
//! `cargo bench --bench step -- bars [ratio] [terms] [strain] [threads] [limits]`: all of them, or those named.

use std::time::Instant;

use cloth_deformer::{Attributes, Deformer};

use crate::plain::Plain;
use crate::scenes::{self, SUBSTEPS};

/// Prints the tables that the arguments name.
pub(crate) fn print(names: &[String]) {
    let tables: [(&str, fn()); 2] = [("ratio", ratio), ("terms", terms)];
    let named = tables.iter().any(|(name, _)| names.iter().any(|n| n == name));
    for (_, table) in tables.iter().filter(|(name, _)| !named || names.iter().any(|n| n == name)) {
        table();
    }
}

/// Seconds that `work` takes.
pub(crate) fn seconds(work: &mut dyn FnMut()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

/// Median seconds of each of several works, timed in turn so that a slow moment of the machine meets them all.
pub(crate) fn in_turn(works: &mut [&mut dyn FnMut()], rounds: usize) -> Vec<f64> {
    let mut times = vec![Vec::new(); works.len()];
    for _ in 0..rounds {
        works.iter_mut().zip(&mut times).for_each(|(work, times)| times.push(seconds(*work)));
    }
    times.into_iter().map(median).collect()
}

pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn on_one_thread<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread").install(work)
}

/// A frame of HANG on one thread against the same frame by the plainest code.
fn ratio() {
    println!("\nHANG, S = {SUBSTEPS}, one thread, ms a frame (medians of 61, in turn)");
    println!("{:>5} {:>9} {:>9} {:>7} {:>12} {:>12}", "N", "plain", "step", "ratio", "plain strain", "strain");
    for n in [64, 128, 256] {
        on_one_thread(|| {
            let mut plain = Plain::hang(n, SUBSTEPS);
            let mut deformer = scenes::moving(&scenes::hang(n, scenes::bare()), &Attributes::default());
            (0..30 * SUBSTEPS).for_each(|_| plain.substep());
            let times = in_turn(
                &mut [
                    &mut || (0..SUBSTEPS).for_each(|_| plain.substep()),
                    &mut || scenes::frame(&mut deformer, &Attributes::default()),
                ],
                61,
            );
            let strain = deformer.measure().expect("memory").mean_strain;
            let (a, b) = (1e3 * times[0], 1e3 * times[1]);
            println!("{n:>5} {a:>9.3} {b:>9.3} {:>7.3} {:>12.2e} {strain:>12.2e}", b / a, plain.strain());
        });
    }
}

/// What each term adds to a frame on one thread.
fn terms() {
    println!("\nHANG, N = 64, S = {SUBSTEPS}, one thread, ms a frame (medians of 41, in turn)");
    on_one_thread(|| {
        let scenes = scenes::terms();
        let mut deformers: Vec<Deformer> = scenes.iter().map(|(_, scene, at)| scenes::moving(scene, at)).collect();
        let mut works: Vec<Box<dyn FnMut()>> = Vec::new();
        for (deformer, (_, _, attributes)) in deformers.iter_mut().zip(&scenes) {
            works.push(Box::new(move || scenes::frame(deformer, attributes)));
        }
        let mut works: Vec<&mut dyn FnMut()> = works.iter_mut().map(|work| &mut **work as &mut dyn FnMut()).collect();
        let times = in_turn(&mut works, 41);
        for ((name, ..), time) in scenes.iter().zip(times) {
            println!("{name:>16} {:>9.3}", 1e3 * time);
        }
    });
}
