//! Simulates a cloth and writes every frame as an OBJ file: see `--help`.
//!
//! Without arguments it runs the scene of the 2013 plug-in, a towel dropped on a sphere over a floor:
//!
//! ```text
//! cargo run --release --example drape -- --preview towel.png --report towel.json
//! ```

use std::fmt::Display;
use std::process::{self, ExitCode};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use cloth_deformer::{BuildError, StepError, Tolerance};

use crate::arguments::{Arguments, Task};
use crate::command::{Failure, say};
use crate::play::play;
use crate::scene::Scene;

mod arguments;
mod command;
mod diff;
mod frames;
mod output;
mod overrides;
mod pins;
mod play;
mod preview;
mod receipt;
mod report;
mod save;
mod scene;
mod sweep;
mod tuned;
mod variant_folder;
mod warnings;

fn main() -> ExitCode {
    command::run(run)
}

impl Failure {
    /// The exit code of `diff` and `cmp` for different files.
    const DIFFERENT: u8 = 1;
    /// 128 + SIGINT, as shells report it; also used for a request to terminate and for a hangup.
    const INTERRUPTED: u8 = 130;

    fn new(code: u8, message: impl Display) -> Failure {
        Failure { code, message: message.to_string() }
    }

    /// The same failure with its message prefixed by the part that it concerns.
    pub(crate) fn of(self, part: &str) -> Failure {
        Failure { message: format!("{part}: {}", self.message), ..self }
    }

    fn build(of: &str, error: &BuildError) -> Failure {
        let part = match error {
            BuildError::NoGpu { .. } => return Failure::from(error),
            // In terms of the command line: pins of a scene were checked when it was read.
            BuildError::Pin { index, vertices, .. } => {
                return Failure::input(format_args!(
                    "--pin: vertex {index} does not exist; the mesh has {vertices} vertices, so give numbers from 0 to {}",
                    vertices.saturating_sub(1)
                ));
            }
            BuildError::PinTwice { .. } => "--pin",
            _ => of,
        };
        Failure::from(error).of(part)
    }

    fn step(frame: i64, error: &StepError) -> Failure {
        let failure = match error {
            // In terms of the command line and of scenes instead of the library's.
            StepError::TooManySubsteps { needed } => Failure::input(format_args!(
                "it needs {needed} substeps (times iterations), more than 65536; give more frames a second (--fps), a larger --strain or fewer --substeps"
            )),
            _ => Failure::from(error),
        };
        failure.of(&named(frame))
    }
}

/// A frame in messages.
fn named(frame: i64) -> String {
    if frame < 1 { format!("frame {frame}, in the preroll") } else { format!("frame {frame}") }
}

/// Does what the arguments ask for.
fn run(arguments: &Arguments) -> Result<(), Failure> {
    if let Some(Task::Diff { a, b }) = &arguments.task {
        return diff::diff(a, b);
    }
    if arguments.list {
        let sweep = sweep::Sweep::read(arguments)?;
        say(&sweep.count().to_string());
        return Ok(());
    }
    // A signal ends the program at once, until there are files that must not be left half written.
    let interrupted = Arc::new(AtomicBool::new(false));
    let listen = || {
        let flag = Arc::clone(&interrupted);
        // The first one is obeyed between two frames or pictures, which may take long; the second one at once.
        let obey = move || {
            if flag.swap(true, Ordering::Relaxed) {
                process::exit(Failure::INTERRUPTED.into());
            }
        };
        ctrlc::set_handler(obey).map_err(|error| Failure::input(format_args!("cannot listen for signals: {error}")))
    };
    if let Some(variants) = arguments.variant.clone() {
        let sweep = sweep::Sweep::read(arguments)?;
        listen()?;
        return sweep.run(arguments, variants, &interrupted);
    }
    let scene = Scene::new(arguments)?;
    if let Some(tolerance) = arguments.tune {
        return tune(&scene, tolerance);
    }
    let report = play(&scene, arguments.quiet, listen, &interrupted)?;
    if !arguments.quiet {
        say(&report.summary(&scene.outputs.folder));
    }
    Ok(())
}

/// Finds the cheapest settings for a scene, and prints them.
fn tune(scene: &Scene, tolerance: Tolerance) -> Result<(), Failure> {
    let steps = (scene.outputs.frames - 1).saturating_add(scene.timeline.preroll);
    if steps < 2 {
        return Err(Failure::input("--tune needs at least 3 frames; give more --frames"));
    }
    if scene.untangle || scene.dt() != 1.0 / 60.0 {
        return Err(Failure::input(
            "--tune needs 60 frames per second and a start without untangling; leave out --fps and --untangle, or `fps` and `untangle` in the scene",
        ));
    }
    // No step leads to the first frame. The preroll is a part of the motion.
    let attributes = |step| scene.attributes(scene.timeline.first() + i64::from(step));
    let tuned = cloth_deformer::tune(&scene.mesh, &scene.options, attributes, steps, tolerance);
    tuned::show(&tuned.map_err(|error| scene.not_built(&error))?, tolerance);
    Ok(())
}
