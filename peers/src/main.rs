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

/// Length of a frame (s).
const FRAME: f32 = 1.0 / 60.0;

type Failure = Box<dyn Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    rayon::ThreadPoolBuilder::new().num_threads(1).build()?.install(|| match &words[..] {
        [word] if word == "contact" => contact::run(),
        [] => hang::run(&[32, 64, 128]),
        sizes => hang::run(&sizes.iter().map(|n| n.parse()).collect::<Result<Vec<u32>, _>>()?),
    })
}
