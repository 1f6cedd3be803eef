//! What the programs share in reading a command line.

use clap::{
    Parser,
    builder::{PossibleValuesParser, TypedValueParser},
    error::ErrorKind,
};

use crate::Failure;

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
