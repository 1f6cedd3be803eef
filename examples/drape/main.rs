//! Drapes a cloth and writes every frame as an OBJ file: see `--help`.
//!
//! With no arguments it plays the scene of the 2013 plug-in, a towel dropped on a sphere over a floor:
//!
//! ```text
//! cargo run --release --example drape -- --preview towel.png --report towel.json
//! ```

use std::fmt::Display;
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use cloth_deformer::{BuildError, StepError};

use crate::arguments::{Arguments, Task};
use crate::command::say;
use crate::play::play;
use crate::scene::Scene;

mod arguments;
mod command;
mod diff;
mod frames;
mod output;
mod pins;
mod play;
mod preview;
mod receipt;
mod report;
mod save;
mod scene;
mod sweep;
mod warnings;

fn main() -> ExitCode {
    command::run(Arguments::read(), run)
}

/// Why the program ends early: an exit code and one line.
#[derive(Debug)]
pub(crate) struct Failure {
    code: u8,
    message: String,
}

impl Failure {
    /// As `diff` and `cmp` have it.
    const DIFFERENT: u8 = 1;
    const INPUT: u8 = 2;
    const UNSTABLE: u8 = 3;
    const GPU: u8 = 4;
    /// 128 + SIGINT, as a shell reports it; a request to terminate or a hangup is told by the same.
    const INTERRUPTED: u8 = 130;

    fn new(code: u8, message: impl Display) -> Failure {
        Failure { code, message: message.to_string() }
    }

    /// The same failure, of a part of what was asked for.
    pub(crate) fn of(self, part: &str) -> Failure {
        Failure { message: format!("{part}: {}", self.message), ..self }
    }

    /// What it says.
    pub(crate) fn message(&self) -> &str {
        &self.message
    }

    /// Something the user gave cannot be used.
    pub(crate) fn input(message: impl Display) -> Failure {
        Failure::new(Failure::INPUT, message)
    }

    fn build(of: &str, error: &BuildError) -> Failure {
        match error {
            BuildError::NoGpu { .. } => Failure::new(Failure::GPU, error),
            BuildError::Pin { .. } | BuildError::PinTwice { .. } => Failure::input(format_args!("--pin: {error}")),
            _ => Failure::input(format_args!("{of}: {error}")),
        }
    }

    fn step(frame: u32, error: &StepError) -> Failure {
        let code = match error {
            StepError::Unstable { .. } => Failure::UNSTABLE,
            StepError::Gpu { .. } => Failure::GPU,
            _ => Failure::INPUT,
        };
        Failure::new(code, format_args!("frame {frame}: {error}"))
    }
}

/// What the program was asked for.
fn run(arguments: &Arguments) -> Result<(), Failure> {
    if let Some(Task::Diff { a, b }) = &arguments.task {
        return diff::diff(a, b);
    }
    if arguments.list {
        let sweep = sweep::Sweep::read(arguments)?;
        say(&sweep.count().to_string());
        return Ok(());
    }
    // A signal ends the program at once until there are files that it must not leave half written.
    let interrupted = Arc::new(AtomicBool::new(false));
    let listen = || {
        let flag = Arc::clone(&interrupted);
        ctrlc::set_handler(move || flag.store(true, Ordering::Relaxed))
            .map_err(|error| Failure::input(format_args!("cannot listen for signals: {error}")))
    };
    if let Some(variants) = arguments.variant.clone() {
        let sweep = sweep::Sweep::read(arguments)?;
        listen()?;
        return sweep.run(arguments, variants, &interrupted);
    }
    let scene = Scene::new(arguments)?;
    let report = play(&scene, arguments.quiet, listen, &interrupted)?;
    if !arguments.quiet {
        say(&report.summary(&scene.outputs.folder));
    }
    Ok(())
}
