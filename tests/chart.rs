//! The `chart` example: a tiny chart, and its errors; and the chart of the example `tune`.

use std::path::PathBuf;
use std::process::{Command, Output};
use std::{env, fs};

/// Runs an example. `cargo test` builds the examples but does not tell their path: they are in `examples`, beside `deps`,
/// where test programs are.
fn example(name: &str, arguments: &[&str]) -> Output {
    let test = env::current_exe().unwrap();
    let path: PathBuf = test.parent().unwrap().with_file_name("examples").join(format!("{name}{}", env::consts::EXE_SUFFIX));
    assert!(path.exists(), "{} is not there; run `cargo build --release --example {name}` first", path.display());
    Command::new(path).args(arguments).output().unwrap()
}

fn chart(arguments: &[&str]) -> Output {
    example("chart", arguments)
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

/// Each run of the table is in the picture, with its number of substeps.
#[test]
fn a_search_is_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("hang64.svg");
    let done = example("tune", &["hang64", "--frames", "10", "--chart", file.to_str().unwrap()]);
    assert!(done.status.success(), "{done:?}");
    let said = String::from_utf8(done.stdout).unwrap();
    let substeps: Vec<&str> =
        said.lines().filter(|line| line.contains("| method:")).map(|line| line.split(" | ").nth(1).unwrap()).collect();
    let svg = fs::read_to_string(&file).unwrap();
    assert!(substeps.len() >= 5 && svg.trim_end().ends_with("</svg>"), "{said}");
    let texts: Vec<&str> = svg.lines().map(str::trim).collect();
    let drawn = substeps.iter().filter(|count| texts.contains(count)).count();
    // Where runs are close together a number may have no room.
    assert!(drawn + 2 >= substeps.len(), "{drawn} of {substeps:?}");
    for text in ["hang64: ", "mm allowed", "two resolved runs differ by", "milliseconds a frame", "error (mm)"] {
        assert!(svg.contains(text), "the chart lacks `{text}`");
    }

    let nowhere = folder.path().join("none/hang64.svg");
    let done = example("tune", &["hang64", "--frames", "2", "--chart", nowhere.to_str().unwrap()]);
    let said = String::from_utf8(done.stderr).unwrap();
    assert_eq!(done.status.code(), Some(2), "{said}");
    assert!(said.contains("--chart") && said.lines().filter(|line| line.starts_with("error: ")).count() == 1, "{said}");
}
