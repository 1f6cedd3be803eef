//! What the programs share: reading a command line, and what they say.

use std::io::{self, Write};
use std::process::ExitCode;

use clap::{
    Parser,
    builder::{PossibleValuesParser, TypedValueParser},
    error::ErrorKind,
};

use crate::Failure;

/// Runs a program with the arguments that were read, or says what help was asked for. Why it ended early is said in one line.
///
/// Returning, rather than leaving from within, drops what is half written: it takes its temporary files along.
pub(crate) fn run<Arguments>(
    read: Result<Result<Arguments, clap::Error>, Failure>,
    program: impl FnOnce(&Arguments) -> Result<(), Failure>,
) -> ExitCode {
    let failure = match read {
        Ok(Ok(arguments)) => program(&arguments).err(),
        Ok(Err(help)) => {
            say(help.to_string().trim_end());
            None
        }
        Err(failure) => Some(failure),
    };
    let Some(Failure { code, message }) = failure else { return ExitCode::SUCCESS };
    // What was said already has no message.
    if !message.is_empty() {
        warn("error", &message);
    }
    ExitCode::from(code)
}

/// A line on stdout. A reader that went away is no reason to stop.
pub(crate) fn say(line: &str) {
    let _ = writeln!(io::stdout(), "{line}");
}

/// One line on stderr, whatever line breaks a file name or a driver's message brought along.
pub(crate) fn warn(kind: &str, message: &str) {
    let line: Vec<&str> = message.lines().map(str::trim).filter(|line| !line.is_empty()).collect();
    let _ = writeln!(io::stderr(), "{kind}: {}", line.join(" "));
}

/// The arguments this process was given, or the help that was asked for. What is wrong with them is said in one line,
/// without the usage that clap adds.
pub(crate) fn read<Arguments: Parser>() -> Result<Result<Arguments, clap::Error>, Failure> {
    match Arguments::try_parse() {
        Ok(arguments) => Ok(Ok(arguments)),
        Err(help) if help.kind() == ErrorKind::DisplayHelp => Ok(Err(help)),
        Err(error) => {
            let text = error.to_string();
            let text = text.split("\n\nUsage:").next().unwrap_or(&text).split("\n\nFor more").next().unwrap_or_default();
            Err(Failure::input(format_args!("{}; see --help", text.trim_start_matches("error: "))))
        }
    }
}

/// One of a table's names, for its value.
pub(crate) fn one_of<T: Clone + Send + Sync + 'static>(table: &'static [(&'static str, T)]) -> impl TypedValueParser<Value = T> {
    let names = table.iter().map(|&(name, _)| name);
    PossibleValuesParser::new(names).try_map(move |given| {
        let named = table.iter().find(|&&(name, _)| name == given);
        named.map(|(_, value)| value.clone()).ok_or("not in the table")
    })
}
