//! Compares published cloth solvers with cloth-deformer, on one thread and in the same run. Frames are timed in turn, so that other
//! load slows all.
//!
//! ```text
//! cd peers && cargo run --release -- [N ..]        # HANG of these sizes, 32 64 128 unless given; about two minutes
//! cd peers && cargo run --release -- contact       # contact of cloth with itself; about four minutes
//! ```

mod contact;
mod hang;

use std::error::Error;
use std::time::Instant;

use cloth_deformer::glam::Vec3;

/// Length of a frame (s).
const FRAME: f32 = 1.0 / 60.0;

type Failure = Box<dyn Error + Send + Sync>;

/// A cloth of one of the solvers.
trait Sheet {
    /// Takes a step of 1/60 s.
    fn step(&mut self) -> Result<(), Failure>;
    fn positions(&mut self) -> Result<Vec<Vec3>, Failure>;
}

/// The processor time (s) of this thread, where the system provides it, or else some time.
fn seconds() -> f64 {
    static START: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);
    let told = || std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse::<f64>().ok();
    told().map_or_else(|| START.elapsed().as_secs_f64(), |nanoseconds| 1e-9 * nanoseconds)
}

fn main() -> Result<(), Failure> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    rayon::ThreadPoolBuilder::new().num_threads(1).build()?.install(|| match &words[..] {
        [word] if word == "contact" => contact::run(),
        [] => hang::run(&[32, 64, 128]),
        sizes => hang::run(&sizes.iter().map(|n| n.parse()).collect::<Result<Vec<u32>, _>>()?),
    })
}
