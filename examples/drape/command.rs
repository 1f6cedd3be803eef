//! What the example programs share: reading a command line, printing lines, and ending with an exit code.

use std::fmt::Display;
use std::io::{self, Write};
use std::process::ExitCode;

use clap::{
    Parser,
    builder::{PossibleValuesParser, TypedValueParser},
    error::{ContextKind, ContextValue, ErrorKind},
};
use cloth_deformer::{BuildError, StepError};

/// Why a program ends early: its exit code, and a message of one line, which is empty if everything has been printed.
#[derive(Debug)]
pub(crate) struct Failure {
    pub(crate) code: u8,
    pub(crate) message: String,
}

impl Failure {
    const INPUT: u8 = 2;
    pub(crate) const UNSTABLE: u8 = 3;
    const GPU: u8 = 4;

    /// The user's input cannot be used.
    pub(crate) fn input(message: impl Display) -> Failure {
        Failure { code: Failure::INPUT, message: message.to_string() }
    }
}

impl From<&BuildError> for Failure {
    fn from(error: &BuildError) -> Failure {
        let code = match error {
            BuildError::NoGpu { .. }
            | BuildError::GpuLost { .. }
            | BuildError::GpuMemory { .. }
            | BuildError::GpuLimit { .. } => Failure::GPU,
            BuildError::Step { error, .. } => code_of(error),
            _ => Failure::INPUT,
        };
        Failure { code, message: error.to_string() }
    }
}

impl From<&StepError> for Failure {
    fn from(error: &StepError) -> Failure {
        Failure { code: code_of(error), message: error.to_string() }
    }
}

fn code_of(error: &StepError) -> u8 {
    match error {
        StepError::Unstable { .. } => Failure::UNSTABLE,
        StepError::Gpu { .. } | StepError::GpuLost { .. } | StepError::GpuMemory { .. } | StepError::GpuLimit { .. } => {
            Failure::GPU
        }
        _ => Failure::INPUT,
    }
}

/// Runs a program with the arguments of this process, or prints the help or the version if the user asked for it. A failure is
/// printed as one line, without the usage that clap adds.
///
/// Programs return here instead of exiting from within, so that files which are half written are dropped and removed.
pub(crate) fn run<Arguments: Parser>(program: impl FnOnce(&Arguments) -> Result<(), Failure>) -> ExitCode {
    let done = match Arguments::try_parse() {
        Ok(arguments) => program(&arguments),
        Err(help) if matches!(help.kind(), ErrorKind::DisplayHelp | ErrorKind::DisplayVersion) => {
            say(help.to_string().trim_end());
            Ok(())
        }
        Err(error) => Err(refusal::<Arguments>(&error)),
    };
    let Err(Failure { code, message }) = done else { return ExitCode::SUCCESS };
    if !message.is_empty() {
        warn("error", &message);
    }
    ExitCode::from(code)
}

/// What is wrong with a command line, without the usage that clap adds.
fn refusal<Arguments: Parser>(error: &clap::Error) -> Failure {
    // What follows a mesh and is no option is a subcommand for clap.
    if let (ErrorKind::ArgumentConflict, Some(ContextValue::String(extra))) =
        (error.kind(), error.get(ContextKind::InvalidSubcommand))
        && Arguments::command().find_subcommand(extra).is_none()
    {
        return Failure::input(format_args!("`{extra}` is one argument too many; give a single MESH.obj; see --help"));
    }
    let text = error.to_string();
    let text = text.split("\n\nUsage:").next().unwrap_or(&text).split("\n\nFor more").next().unwrap_or_default();
    let text = text.trim_start_matches("error: ").replace("\n\n  tip:", "; tip:");
    Failure::input(format_args!("{text}; see --help"))
}

/// Prints a line to stdout. A closed pipe is ignored.
pub(crate) fn say(line: &str) {
    let _ = writeln!(io::stdout(), "{line}");
}

/// Prints one line to stderr; line breaks from a file name or a driver's message are replaced by spaces.
pub(crate) fn warn(kind: &str, message: &str) {
    let line: Vec<&str> = message.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    let _ = writeln!(io::stderr(), "{kind}: {}", line.join(" "));
}

/// Parses one of the names of a table into its value.
pub(crate) fn one_of<T: Clone + Send + Sync + 'static>(table: &'static [(&'static str, T)]) -> impl TypedValueParser<Value = T> {
    let names = table.iter().map(|&(name, _)| name);
    PossibleValuesParser::new(names).try_map(move |given| {
        let named = table.iter().find(|&&(name, _)| name == given);
        named.map(|(_, value)| value.clone()).ok_or("not in the table")
    })
}
