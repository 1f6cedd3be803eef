//! Many small cloths on the CPU: `Deformer::step_all` compared with a parallel loop in the caller, and with one thread.
//!
//! `cargo bench --bench crowd [-- CLOTHS SIDE]`. The three take turns, frame by frame, so that other load on the
//! machine affects all of them alike. The least time of each counts, and the ratios.

use std::time::Instant;

use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Mesh, Options, StepReport};
use rayon::ThreadPool;
use rayon::prelude::*;

const FRAME: f32 = 1.0 / 60.0;
const FRAMES: usize = 60;

fn crowd(count: usize, side: u32) -> Vec<Deformer> {
    let mesh = Mesh::grid(side, side, 0.3, 0.3);
    let options = Options { backend: Backend::Cpu, fabric: Fabric::COTTON, pinned: vec![0, side - 1], ..Options::default() };
    (0..count).map(|_| Deformer::new(&mesh, options.clone()).expect("a cloth")).collect()
}

fn pool(threads: usize) -> ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool")
}

/// Milliseconds per frame.
fn time(pool: &ThreadPool, work: impl FnOnce() -> Vec<StepReport> + Send) -> f64 {
    let start = Instant::now();
    let reports = pool.install(work);
    assert!(!reports.is_empty());
    1e3 * start.elapsed().as_secs_f64()
}

fn main() {
    let numbers: Vec<usize> = std::env::args().filter_map(|word| word.parse().ok()).collect();
    let (count, side) = (numbers.first().copied().unwrap_or(1000), numbers.get(1).copied().unwrap_or(10));
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let (one, all) = (pool(1), pool(threads));
    let [mut by_one, mut by_all, mut by_loop] = [0; 3].map(|_| crowd(count, side as u32));
    let scene = Attributes::default();
    let stepped = |crowd: &mut [Deformer]| -> Vec<StepReport> {
        Deformer::step_all(crowd.iter_mut().map(|cloth| (cloth, &scene)), FRAME)
            .into_iter()
            .map(|step| step.expect("a step"))
            .collect()
    };
    let own_loop = |crowd: &mut [Deformer]| -> Vec<StepReport> {
        crowd.par_iter_mut().map(|cloth| cloth.step(FRAME, &scene).expect("a step")).collect()
    };
    let mut times = [const { Vec::new() }; 3];
    for frame in 0..FRAMES {
        times[0].push(time(&one, || stepped(&mut by_one)));
        // The order rotates, because the first one finds other data in the cache.
        for way in [1 + frame % 2, 2 - frame % 2] {
            let taken = time(&all, || if way == 1 { stepped(&mut by_all) } else { own_loop(&mut by_loop) });
            times[way].push(taken);
        }
    }
    // The first frames build what later ones reuse.
    let [one, all, own] = times.map(|mut times| {
        times.drain(..10);
        times.sort_by(f64::total_cmp);
        [times[0], times[times.len() / 2]]
    });
    println!("{count} cloths of {side} x {side}, ms a frame, least and median of {}", FRAMES - 10);
    println!("step_all on 1 thread           {:8.2} {:8.2}", one[0], one[1]);
    println!("step_all on {threads:2} threads         {:8.2} {:8.2}  {:.2} of one thread's", all[0], all[1], all[0] / one[0]);
    println!("a parallel loop on {threads:2} threads  {:8.2} {:8.2}  {:.2} of step_all's", own[0], own[1], own[0] / all[0]);
}
