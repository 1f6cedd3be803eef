//! The cost of a frame: by size, threads, method and term; compared with the plain code; and the cost of building and
//! of files.
//!
//! `cargo bench --bench step` prints all tables, which takes some minutes; `cargo bench --bench step -- NAME..` prints
//! those named: ratio, levels, terms, strain, threads, schedule, limits, methods, build, files.
//!
//! Every time belongs to an error: the tables print the strain that a frame leaves, and `--example chart` shows both.

mod bars;
mod plain;
mod scenes;

use std::process::ExitCode;
use std::time::Instant;

use bars::{median, on_one_thread, seconds};
use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Levels, Mesh, Method, Options, Quality};
use scenes::{FRAME, SUBSTEPS, bare, hang};

/// Every table, by its name on the command line.
const TABLES: [(&str, fn()); 10] = [
    ("ratio", bars::ratio),
    ("levels", bars::levels),
    ("terms", bars::terms),
    ("strain", bars::strain),
    ("threads", bars::threads),
    ("schedule", bars::schedule),
    ("limits", bars::limits),
    ("methods", methods),
    ("build", build),
    ("files", files),
];

/// Median time (ms) of a few runs of `work`.
fn milliseconds(mut work: impl FnMut()) -> f64 {
    1e3 * median((0..11).map(|_| seconds(&mut work)).collect())
}

/// The methods on each backend, and the strain that they leave after half a second.
fn methods() {
    println!("\nHANG with the default fabric, ms a frame (medians of 11), and mean strain");
    println!("{:>12} {:>5} {:>9} {:>8} {:>9} {:>9}", "method", "N", "substeps", "backend", "ms", "strain");
    let methods = [
        ("small steps", Method::SmallSteps, SUBSTEPS),
        ("relaxation", Method::Relaxation { iterations: 20 }, 1),
        ("springs", Method::Springs, 200),
    ];
    for (name, method, substeps) in methods {
        for n in [32_u32, 64, 128] {
            // Springs are stable above a number of substeps that grows with n.
            let substeps = if method == Method::Springs { substeps * n / 32 } else { substeps };
            for backend in [Backend::Cpu, Backend::Hybrid, Backend::Gpu] {
                let (mesh, options) = hang(n, Fabric::default());
                let options = Options { backend, method, quality: Quality::Substeps(substeps), ..options };
                // A machine without a GPU can still time the CPU.
                if Deformer::new(&mesh, options.clone()).is_err() {
                    continue;
                }
                let mut deformer = scenes::moving(&(mesh, options), &Attributes::default());
                let time = milliseconds(|| scenes::frame(&mut deformer, &Attributes::default()));
                let strain = deformer.measure().expect("memory").mean_strain;
                println!("{name:>12} {n:>5} {substeps:>9} {:>8} {time:>9.3} {strain:>9.2e}", format!("{backend:?}"));
            }
        }
    }
}

/// Building, in units of frames on one thread: all that happens before the second frame.
fn build() {
    println!("\nBuilding a cloth, one thread, {SUBSTEPS} substeps, medians of 7 (N = 1024: once)");
    println!("| N | scene | built (ms) | a frame (ms) | frames |\n|---|---|---|---|---|");
    let bending = Fabric { bending: 1e-4, ..bare() };
    let scenes = [("edges alone", bare(), Levels::Off), ("levels", bare(), Levels::Auto), ("bending", bending, Levels::Off)];
    for (n, (name, fabric, levels)) in [128, 256, 1024].into_iter().flat_map(|n| scenes.map(|scene| (n, scene))) {
        let (mesh, options) = hang(n, fabric);
        let options = Options { levels, ..options };
        let run = || {
            let start = Instant::now();
            let mut deformer = Deformer::new(&mesh, options.clone()).expect("a sheet");
            let mut frame = || {
                1e3 * seconds(&mut || {
                    deformer.step(FRAME, &Attributes::default()).expect("the sheet hangs");
                })
            };
            frame();
            let first = 1e3 * start.elapsed().as_secs_f64();
            let frame = median((0..5).map(|_| frame()).collect());
            (first - frame, frame)
        };
        let rounds = if n > 256 { 1 } else { 7 };
        let mut runs: Vec<(f64, f64)> = on_one_thread(|| (0..rounds).map(|_| run()).collect());
        runs.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (built, frame) = runs[runs.len() / 2];
        println!("| {n} | {name} | {built:.0} | {frame:.1} | {:.1} |", built / frame);
    }
}

/// Writing and reading OBJ files.
fn files() {
    println!("\nOBJ files, ms (medians of 11)\n{:>5} {:>9} {:>9}", "N", "save", "load");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("sheet.obj");
    for n in [64, 256] {
        let (mesh, _) = hang(n, Fabric::default());
        let save = milliseconds(|| mesh.save_obj(&path).expect("room"));
        let load = milliseconds(|| drop(Mesh::load_obj(&path).expect("what was saved")));
        println!("{n:>5} {save:>9.3} {load:>9.3}");
    }
}

fn main() -> ExitCode {
    // Cargo adds `--bench`.
    let names: Vec<String> = std::env::args().skip(1).filter(|argument| argument != "--bench").collect();
    if let Some(unknown) = names.iter().find(|name| TABLES.iter().all(|(table, _)| table != name)) {
        eprintln!("error: there is no table {unknown}; there are {}", TABLES.map(|(name, _)| name).join(", "));
        return ExitCode::from(2);
    }
    let wanted = |name: &str| names.is_empty() || names.iter().any(|wanted| wanted == name);
    TABLES.iter().filter(|(name, _)| wanted(name)).for_each(|(_, print)| print());
    ExitCode::SUCCESS
}
