//! Runs the `drape` example as a program, where `cargo test` has built it.

use std::env;
use std::fs;
use std::io::BufReader;
use std::path::{Path, PathBuf};
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

/// Runs a scene's text on the CPU in a directory of its own.
pub fn scene(text: &str, arguments: &[&str]) -> (TempDir, Output) {
    let directory = TempDir::new().unwrap();
    fs::write(directory.path().join("s.toml"), text).unwrap();
    let output = run(&directory, &[&["--scene", "s.toml", "--quiet"], arguments].concat());
    (directory, output)
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

/// Width, height and pixels of the picture.
pub fn read_png(path: &Path) -> (u32, u32, Vec<u8>) {
    let mut reader = png::Decoder::new(BufReader::new(fs::File::open(path).unwrap())).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!(info.color_type, png::ColorType::Rgb);
    (info.width, info.height, pixels)
}
