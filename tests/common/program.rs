//! Runs the `drape` example as a program, where `cargo test` has built it.

use std::env;
use std::path::PathBuf;
use std::process::{Command, Output};

use tempfile::TempDir;

/// Path of the program. `cargo test` builds the examples but does not tell their path: they are in `examples`, beside
/// `deps`, where test programs are.
pub fn path() -> PathBuf {
    let test = env::current_exe().unwrap();
    let profile = test.ancestors().nth(2).unwrap();
    let path = profile.join("examples").join(format!("drape{}", env::consts::EXE_SUFFIX));
    assert!(path.is_file(), "{} is missing: `cargo test` builds it, `cargo build --example drape` too", path.display());
    path
}

/// A command that runs the program in a directory, on the CPU unless the arguments name a backend.
pub fn drape(directory: &TempDir, arguments: &[&str]) -> Command {
    let mut command = Command::new(path());
    command.current_dir(directory).args(arguments);
    if !arguments.contains(&"--backend") {
        command.args(["--backend", "cpu"]);
    }
    command
}

pub fn run(directory: &TempDir, arguments: &[&str]) -> Output {
    drape(directory, arguments).output().unwrap()
}

pub fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

#[track_caller]
pub fn succeeds(output: &Output) {
    assert_eq!(output.status.code(), Some(0), "{}", stderr(output));
}

/// Asserts the exit code, and a single error line on stderr that contains each of `words`.
#[track_caller]
pub fn fails(output: &Output, code: i32, words: &[&str]) {
    let text = stderr(output);
    assert_eq!(output.status.code(), Some(code), "{text}");
    let errors: Vec<&str> = text.lines().filter(|line| !line.starts_with("warning: ")).collect();
    assert_eq!(errors.len(), 1, "not one line: {text}");
    assert!(errors[0].starts_with("error: "), "{text}");
    for word in words {
        assert!(errors[0].contains(word), "no `{word}` in: {text}");
    }
    assert!(output.stdout.is_empty(), "a failure leaves stdout empty");
}
