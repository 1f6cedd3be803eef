//! The `chart` example: a tiny chart, and its errors.

use std::path::PathBuf;
use std::process::{Command, Output};
use std::{env, fs};

/// Path of the program. `cargo test` builds the examples but does not tell their path: they are in `examples`, beside
/// `deps`, where test programs are.
fn chart(arguments: &[&str]) -> Output {
    let test = env::current_exe().unwrap();
    let path: PathBuf = test.parent().unwrap().with_file_name("examples").join(format!("chart{}", env::consts::EXE_SUFFIX));
    assert!(path.exists(), "{} is not there; run `cargo build --release --example chart` first", path.display());
    Command::new(path).args(arguments).output().unwrap()
}

#[test]
fn errors_fall_with_substeps_and_the_chart_is_whole() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().to_str().unwrap();
    let done = chart(&["--quick", "--sizes", "8", "--backends", "cpu", "--budget", "0.2", "--out", out, "--date", "2000-01-01"]);
    assert!(done.status.success(), "{done:?}");
    let said = String::from_utf8(done.stdout).unwrap();
    assert!(said.contains("--method small-steps --substeps"), "{said}");

    let svg = fs::read_to_string(folder.path().join("chart_hang8.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.trim_end().ends_with("</svg>"));
    for text in ["milliseconds a frame", "position error at 0.50 s", "small-steps, cpu", "2000-01-01"] {
        assert!(svg.contains(text), "the chart lacks `{text}`");
    }
    assert!(!svg.contains(out), "the chart tells where it was made");

    let csv = fs::read_to_string(folder.path().join("chart_hang8.csv")).unwrap();
    let mut rows = csv.lines().filter(|line| !line.starts_with('#')).map(|line| line.split(',').collect::<Vec<_>>());
    let columns = "scene,method,backend,substeps,iterations,ms_median,error,mean_strain,max_strain,reference_error,note";
    assert_eq!(rows.next().unwrap(), columns.split(',').collect::<Vec<_>>());
    let errors: Vec<f64> = rows.filter(|row| row[1] == "small-steps").map(|row| row[6].parse().unwrap()).collect();
    assert!(errors.len() >= 3 && errors[1] < errors[0] && errors[2] < errors[1], "{errors:?}");
    let names: Vec<_> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 4, "charts and tables alone: {names:?}");
}

#[test]
fn bad_input_is_one_line_and_code_2() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, out) = (folder.path().join("bad.obj"), folder.path().join("charts"));
    let (mesh, out) = (mesh.to_str().unwrap(), out.to_str().unwrap());
    fs::write(mesh, "v 0 0 0\nv 1 0 0\nv 0 0 1\nf 1 2 9\n").unwrap();
    for arguments in [
        &["--backends", "none"][..],
        &["no-such.obj", "--backends", "cpu", "--out", out],
        &[mesh, "--backends", "cpu", "--out", out],
    ] {
        let done = chart(arguments);
        let said = String::from_utf8(done.stderr).unwrap();
        assert_eq!(done.status.code(), Some(2), "{arguments:?}: {said}");
        assert_eq!(said.lines().filter(|line| line.starts_with("error: ")).count(), 1, "{said}");
    }
}
