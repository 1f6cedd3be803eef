//! The cost of a frame: by size, threads, method and term; compared with the plain code; and the cost of building and
//! of files.
//!
//! Every time belongs to an error: each size prints the strain that its frame leaves, and `--example chart` shows both.

mod bars;
mod plain;
mod scenes;

use std::hint::black_box;
use std::time::{Duration, Instant};

use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Levels, Mesh, Method, Options, Quality};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group};
use plain::Plain;
use scenes::{FRAME, SUBSTEPS, bare, hang};

/// One thread compared with the plain code, and several threads compared with one.
fn threads(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("threads");
    let most = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    for n in [32_u32, 64, 128, 256] {
        group.throughput(Throughput::Elements(u64::from(n * n * SUBSTEPS)));
        let mut yardstick = Plain::hang(n, SUBSTEPS, true);
        (0..30 * SUBSTEPS).for_each(|_| yardstick.substep());
        group.bench_function(BenchmarkId::new("plain", n), |bencher| {
            bencher.iter(|| (0..SUBSTEPS).for_each(|_| black_box(&mut yardstick).substep()));
        });
        let mut strain = 0.0;
        for count in [1, 2, 4, 8, 16, 32].into_iter().filter(|&count| count <= most) {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().expect("threads");
            let (mesh, options) = hang(n, bare());
            let mut deformer = Deformer::new(&mesh, options).expect("a sheet");
            let mut frames = |count: u64| {
                let start = Instant::now();
                (0..count).for_each(|_| {
                    deformer.step(FRAME, &Attributes::default()).expect("the sheet hangs");
                });
                start.elapsed()
            };
            pool.install(|| frames(30));
            group.bench_function(BenchmarkId::new(format!("{count} threads"), n), |bencher| {
                bencher.iter_custom(|count| pool.install(|| frames(count)));
            });
            strain = deformer.measure().expect("memory").mean_strain;
        }
        println!("N = {n}: mean strain {strain:.2e}, plain {:.2e}", yardstick.strain());
    }
    group.finish();
}

/// The cost of each term; absent terms cost nothing.
fn terms(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("terms");
    for (name, scene, attributes) in scenes::terms() {
        let mut deformer = scenes::moving(&scene, &attributes);
        group.bench_function(name, |bencher| bencher.iter(|| scenes::frame(&mut deformer, &attributes)));
    }
    group.finish();
}

/// The methods and backends compared.
fn methods(criterion: &mut Criterion) {
    let methods = [
        ("small-steps", Method::SmallSteps, SUBSTEPS),
        ("relaxation", Method::Relaxation { iterations: 20 }, 1),
        ("springs", Method::Springs, 200),
    ];
    for (name, method, substeps) in methods {
        let mut group = criterion.benchmark_group(name);
        for n in [32_u32, 64, 128] {
            // Springs are stable above a number of substeps that grows with n.
            let substeps = if method == Method::Springs { substeps * n / 32 } else { substeps };
            group.throughput(Throughput::Elements(u64::from(n * n) * u64::from(substeps)));
            for backend in [Backend::Cpu, Backend::Hybrid, Backend::Gpu] {
                let (mesh, options) = hang(n, Fabric::default());
                let options = Options { backend, method, quality: Quality::Substeps(substeps), ..options };
                // A machine without a GPU can still time the CPU.
                if Deformer::new(&mesh, options.clone()).is_err() {
                    continue;
                }
                let mut deformer = scenes::moving(&(mesh, options), &Attributes::default());
                group.bench_function(BenchmarkId::new(format!("{backend:?}"), n), |bencher| {
                    bencher.iter(|| scenes::frame(&mut deformer, &Attributes::default()));
                });
            }
        }
        group.finish();
    }
}

/// Building, in units of frames on one thread: all that happens before the second frame.
fn built_in_frames() {
    println!("| N | scene | built (ms) | a frame (ms) | frames |\n|---|---|---|---|---|");
    let bending = Fabric { bending: 1e-4, ..bare() };
    let scenes = [("edges alone", bare(), Levels::Off), ("levels", bare(), Levels::Auto), ("bending", bending, Levels::Off)];
    for n in [128, 256, 1024] {
        for (name, fabric, levels) in scenes {
            let (mesh, options) = hang(n, fabric);
            let options = Options { levels, ..options };
            let run = || {
                let start = Instant::now();
                let mut deformer = Deformer::new(&mesh, options.clone()).expect("a sheet");
                let mut frame = || {
                    let start = Instant::now();
                    deformer.step(FRAME, &Attributes::default()).expect("the sheet hangs");
                    1e3 * start.elapsed().as_secs_f64()
                };
                frame();
                let first = 1e3 * start.elapsed().as_secs_f64();
                let mut frames = [(); 5].map(|()| frame());
                frames.sort_by(f64::total_cmp);
                (first - frames[2], frames[2])
            };
            let mut runs: Vec<(f64, f64)> = (0..if n > 256 { 1 } else { 7 }).map(|_| run()).collect();
            runs.sort_by(|a, b| a.0.total_cmp(&b.0));
            let (built, frame) = runs[runs.len() / 2];
            println!("| {n} | {name} | {built:.0} | {frame:.1} | {:.1} |", built / frame);
        }
    }
}

/// Building, and reading and writing OBJ files.
fn build(criterion: &mut Criterion) {
    let wanted = std::env::args().skip(1).find(|argument| !argument.starts_with("--"));
    if wanted.is_none_or(|name| "build".contains(&name)) {
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        one.install(built_in_frames);
    }
    let mut group = criterion.benchmark_group("build");
    for n in [64, 256] {
        let (mesh, options) = hang(n, Fabric::default());
        group.bench_function(BenchmarkId::new("deformer and first frame", n), |bencher| {
            bencher.iter(|| {
                let mut deformer = Deformer::new(&mesh, options.clone()).expect("a sheet");
                deformer.step(FRAME, &Attributes::default()).expect("the sheet hangs");
            });
        });
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("sheet.obj");
        group.bench_function(BenchmarkId::new("save_obj", n), |bencher| {
            bencher.iter(|| mesh.save_obj(&path).expect("room"));
        });
        group.bench_function(BenchmarkId::new("load_obj", n), |bencher| {
            bencher.iter(|| Mesh::load_obj(&path).expect("what was saved"));
        });
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(1));
    targets = build, threads, terms, methods
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    if arguments.iter().any(|argument| argument == "bars") {
        return bars::print(&arguments);
    }
    benches();
    Criterion::default().configure_from_args().final_summary();
}
