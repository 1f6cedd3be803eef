//! What a frame costs: by size, threads, method and term; against the plainest code; building and files.
//!
//! Error belongs to every figure: each size prints the strain that its frame leaves, and `--example chart` shows both.

mod plain;

use std::hint::black_box;
use std::time::{Duration, Instant};

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Collider, Deformer, Fabric, Levels, Mesh, Method, Options, Quality};
use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use plain::Plain;

const FRAME: f32 = 1.0 / 60.0;
const SUBSTEPS: u32 = 20;

/// HANG: a sheet of 1 m, its first row pinned.
fn hang(n: u32, fabric: Fabric) -> (Mesh, Options) {
    let options = Options {
        backend: Backend::Cpu,
        quality: Quality::Substeps(SUBSTEPS),
        // The yardstick has none; `terms` shows what they cost.
        levels: Levels::Off,
        fabric,
        pinned: (0..n).collect(),
        ..Options::default()
    };
    (Mesh::grid(n, n, 1.0, 1.0), options)
}

fn bare() -> Fabric {
    Fabric { density: 0.2, stretch: 5000.0, bending: 0.0, damping: 0.0 }
}

/// Steps frame after frame of a cloth that is moving: half a second in, no longer flat.
fn frames(bencher: &mut criterion::Bencher<'_>, deformer: &mut Deformer, attributes: &Attributes) {
    for _ in 0..30 {
        deformer.step(FRAME, attributes).expect("the sheet hangs");
    }
    bencher.iter(|| {
        deformer.step(FRAME, attributes).expect("the sheet hangs");
        deformer.wait().expect("the device is there");
    });
}

/// One thread against the yardstick, and more threads against one.
fn threads(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("threads");
    let most = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    for n in [32_u32, 64, 128, 256] {
        group.throughput(Throughput::Elements(u64::from(n * n * SUBSTEPS)));
        let mut yardstick = Plain::hang(n, SUBSTEPS);
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

/// What each term adds: those that a scene lacks cost nothing.
fn terms(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("terms");
    let n = 64;
    let air = Attributes { air_density: 1.2, wind: Vec3::new(1.0, 0.0, 2.0), ..Attributes::default() };
    let ball = Collider::sphere(Vec3::new(0.0, -0.5, 0.2), 0.3);
    let collider = Attributes { colliders: vec![ball], ..Attributes::default() };
    let bending = Fabric { bending: 1e-5, ..bare() };
    let scenes = [
        ("edges alone", bare(), Attributes::default()),
        ("levels", bare(), Attributes::default()),
        ("bending", bending, Attributes::default()),
        ("damped bending", Fabric { damping: 0.03, ..bending }, Attributes::default()),
        ("wind", bare(), air),
        ("sphere", bare(), collider),
    ];
    for (name, fabric, attributes) in scenes {
        let (mesh, options) = hang(n, fabric);
        let levels = if name == "levels" { Levels::Auto } else { Levels::Off };
        let mut deformer = Deformer::new(&mesh, Options { levels, ..options }).expect("a sheet");
        group.bench_function(name, |bencher| frames(bencher, &mut deformer, &attributes));
    }
    group.finish();
}

/// The methods and backends beside each other.
fn methods(criterion: &mut Criterion) {
    let methods = [
        ("small-steps", Method::SmallSteps, SUBSTEPS),
        ("relaxation", Method::Relaxation { iterations: 20 }, 1),
        ("springs", Method::Springs, 200),
    ];
    for (name, method, substeps) in methods {
        let mut group = criterion.benchmark_group(name);
        for n in [32_u32, 64, 128] {
            group.throughput(Throughput::Elements(u64::from(n * n) * u64::from(substeps)));
            for backend in [Backend::Cpu, Backend::Hybrid, Backend::Gpu] {
                let (mesh, options) = hang(n, Fabric::default());
                let options = Options { backend, method, quality: Quality::Substeps(substeps), ..options };
                // A machine without a GPU still has a CPU to time.
                let Ok(mut deformer) = Deformer::new(&mesh, options) else { continue };
                group.bench_function(BenchmarkId::new(format!("{backend:?}"), n), |bencher| {
                    frames(bencher, &mut deformer, &Attributes::default());
                });
            }
        }
        group.finish();
    }
}

/// Building beside what it is for: all that comes before the second frame, in frames, on one thread.
fn built_in_frames() {
    println!("| N | scene | built (ms) | a frame (ms) | frames |\n|---|---|---|---|---|");
    let bending = Fabric { bending: 1e-4, ..bare() };
    let scenes = [("edges alone", bare(), Levels::Off), ("levels", bare(), Levels::Auto), ("bending", bending, Levels::Off)];
    for n in [128, 256, 1024] {
        for (name, fabric, levels) in scenes {
            let (mesh, options) = hang(n, fabric);
            let options = Options { levels, ..options };
            let start = Instant::now();
            let mut deformer = Deformer::new(&mesh, options).expect("a sheet");
            let mut frame = || {
                let start = Instant::now();
                deformer.step(FRAME, &Attributes::default()).expect("the sheet hangs");
                start.elapsed().as_secs_f64()
            };
            frame();
            let first = start.elapsed().as_secs_f64();
            let mut frames = [(); 5].map(|()| frame());
            frames.sort_by(f64::total_cmp);
            let (built, frame) = (1e3 * (first - frames[2]), 1e3 * frames[2]);
            println!("| {n} | {name} | {built:.0} | {frame:.1} | {:.1} |", built / frame);
        }
    }
}

/// Building, and OBJ files read and written.
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
    targets = threads, terms, methods, build
}
criterion_main!(benches);
