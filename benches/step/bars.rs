//! Figures that single timings cannot give: ratios of two programs timed in turn, and times together with errors.
//!
//! `cargo bench --bench step -- bars [ratio] [levels] [terms] [strain] [threads] [schedule] [limits]` prints all
//! tables, or those named.

use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::Instant;

use cloth_deformer::glam::{Vec3, Vec3A};
use cloth_deformer::{Attributes, Deformer, Fabric, Levels, Mesh, Options, Quality};

use crate::plain::Plain;
use crate::scenes::{self, SUBSTEPS};

/// Prints the tables that the arguments name.
pub(crate) fn print(names: &[String]) {
    let tables: [(&str, fn()); 7] = [
        ("ratio", ratio),
        ("levels", levels),
        ("terms", terms),
        ("strain", strain),
        ("threads", threads),
        ("schedule", schedule),
        ("limits", limits),
    ];
    let named = tables.iter().any(|(name, _)| names.iter().any(|n| n == name));
    for (_, table) in tables.iter().filter(|(name, _)| !named || names.iter().any(|n| n == name)) {
        table();
    }
}

/// The time (s) that `work` takes.
pub(crate) fn seconds(work: &mut dyn FnMut()) -> f64 {
    let start = Instant::now();
    work();
    start.elapsed().as_secs_f64()
}

/// Median times (s) of several works, timed in turn so that a slow moment of the machine affects all of them.
pub(crate) fn in_turn(works: &mut [&mut dyn FnMut()], rounds: usize) -> Vec<f64> {
    let mut times = vec![Vec::new(); works.len()];
    for _ in 0..rounds {
        works.iter_mut().zip(&mut times).for_each(|(work, times)| times.push(seconds(*work)));
    }
    times.into_iter().map(median).collect()
}

pub(crate) fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

fn on_one_thread<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread").install(work)
}

/// A frame of HANG on one thread, compared with the same frame by the plain code: in color order after half a second,
/// and in the mesh's own order without batches. For the latter, the first frame is repeated from rest, because that
/// order is unstable. For the SIMD width of the processor and for narrower ones.
fn ratio() {
    println!("\nHANG, S = {SUBSTEPS}, one thread, ms a frame (medians of 41, in turn)");
    println!(
        "{:>5} {:>6} {:>9} {:>9} {:>7} {:>12} {:>12}  from rest: {:>9} {:>9} {:>7}",
        "N", "lanes", "plain", "step", "ratio", "plain strain", "strain", "unbatched", "step", "ratio"
    );
    for (n, lanes) in [64, 128, 256].into_iter().flat_map(|n| [16, 8, 4].map(|lanes| (n, lanes))) {
        on_one_thread(|| {
            let mut plain = Plain::hang(n, SUBSTEPS, true);
            let mut unbatched = Plain::hang(n, SUBSTEPS, false);
            let (mesh, options) = scenes::hang(n, scenes::bare());
            let rest: Vec<Vec3A> = mesh.positions.iter().map(|&x| x.into()).collect();
            let mut resting = Deformer::new(&mesh, options.clone()).expect("a sheet");
            let mut deformer = scenes::moving(&(mesh, options), &Attributes::default());
            if deformer.at_most_lanes(lanes) != lanes {
                return;
            }
            resting.at_most_lanes(lanes);
            (0..30 * SUBSTEPS).for_each(|_| plain.substep());
            let frame = |deformer: &mut Deformer| scenes::frame(deformer, &Attributes::default());
            frame(&mut deformer);
            frame(&mut resting);
            let (mut first, mut own) = (Vec::new(), Vec::new());
            let (mut a, mut b) = (Vec::new(), Vec::new());
            for _ in 0..41 {
                a.push(seconds(&mut || (0..SUBSTEPS).for_each(|_| plain.substep())));
                b.push(seconds(&mut || frame(&mut deformer)));
                unbatched.reset(&rest);
                own.push(seconds(&mut || (0..SUBSTEPS).for_each(|_| unbatched.substep())));
                resting.reset();
                first.push(seconds(&mut || frame(&mut resting)));
            }
            let strain = deformer.measure().expect("memory").mean_strain;
            let [a, b, own, first] = [a, b, own, first].map(|times| 1e3 * median(times));
            println!(
                "{n:>5} {lanes:>6} {a:>9.3} {b:>9.3} {:>7.3} {:>12.2e} {strain:>12.2e}             {own:>9.3} {first:>9.3} {:>7.3}",
                b / a,
                plain.strain(),
                first / own
            );
        });
    }
}

/// A frame of HANG on one thread with levels, compared with one without.
fn levels() {
    println!("\nHANG, S = {SUBSTEPS}, one thread, ms a frame (medians of 41, in turn), and mean strain");
    println!("{:>5} {:>9} {:>9} {:>7} {:>9} {:>9}", "N", "without", "with", "ratio", "strain", "strain");
    for n in [128, 256] {
        on_one_thread(|| {
            let (mesh, options) = scenes::hang(n, scenes::bare());
            let moving = |levels| scenes::moving(&(mesh.clone(), Options { levels, ..options.clone() }), &Attributes::default());
            let [mut without, mut with] = [Levels::Off, Levels::Auto].map(moving);
            let times = in_turn(
                &mut [&mut || scenes::frame(&mut without, &Attributes::default()), &mut || {
                    scenes::frame(&mut with, &Attributes::default());
                }],
                41,
            );
            let strain = [without, with].map(|mut deformer| deformer.measure().expect("memory").mean_strain);
            let (a, b) = (1e3 * times[0], 1e3 * times[1]);
            println!("{n:>5} {a:>9.3} {b:>9.3} {:>7.3} {:>9.2e} {:>9.2e}", b / a, strain[0], strain[1]);
        });
    }
}

/// How much each term adds to a frame on one thread.
fn terms() {
    println!("\nHANG, N = 64, S = {SUBSTEPS}, one thread, ms a frame (medians of 41, in turn)");
    on_one_thread(|| {
        let scenes = scenes::terms();
        let mut deformers: Vec<Deformer> = scenes.iter().map(|(_, scene, at)| scenes::moving(scene, at)).collect();
        let mut works: Vec<Box<dyn FnMut()>> = Vec::new();
        for (deformer, (_, _, attributes)) in deformers.iter_mut().zip(&scenes) {
            works.push(Box::new(move || scenes::frame(deformer, attributes)));
        }
        let mut works: Vec<&mut dyn FnMut()> = works.iter_mut().map(|work| &mut **work as &mut dyn FnMut()).collect();
        let times = in_turn(&mut works, 41);
        for ((name, ..), time) in scenes.iter().zip(times) {
            println!("{name:>16} {:>9.3}", 1e3 * time);
        }
    });
}

/// Frames on each number of threads up to the machine's, by size, fabric and levels, with the strain at 2 s.
fn threads() {
    let most = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let counts: Vec<usize> = [1, 2, 4, 8, 16, 32].into_iter().filter(|&count| count <= most).collect();
    println!("\nHANG, S = {SUBSTEPS}, ms a frame (medians, thread counts in turn), and mean strain at 2 s");
    println!("{:>5} {:>8} {:>7} {:>9}  threads {counts:?}", "N", "bending", "levels", "strain");
    let bending = Fabric { bending: 1e-5, ..scenes::bare() };
    for n in [64, 128, 256, 512, 1024] {
        for (fabric, levels) in [scenes::bare(), bending].into_iter().flat_map(|f| [(f, Levels::Off), (f, Levels::Auto)]) {
            let (mesh, options) = scenes::hang(n, fabric);
            let mut deformer = Deformer::new(&mesh, Options { levels, ..options }).expect("a sheet");
            let pools = counts.iter().map(|&count| rayon::ThreadPoolBuilder::new().num_threads(count).build().expect("threads"));
            let pools: Vec<rayon::ThreadPool> = pools.collect();
            let pool = pools.last().expect("one thread at least");
            // Two seconds of motion of large sheets take long, so those are timed at half of that.
            let frames = if n < 1024 { 120 } else { 60 };
            pool.install(|| (0..frames).for_each(|_| scenes::frame(&mut deformer, &Attributes::default())));
            let strain = deformer.measure().expect("memory").mean_strain;
            let mut times = vec![Vec::new(); pools.len()];
            let (rounds, before) = if n > 256 { (3, 1) } else { (21, 4) };
            for _ in 0..rounds {
                for (pool, times) in pools.iter().zip(&mut times) {
                    let mut step = || scenes::frame(&mut deformer, &Attributes::default());
                    // Untimed frames, in which threads wake, spread over the processors, and load the cloth into their
                    // caches.
                    (0..before).for_each(|_| pool.install(&mut step));
                    times.push(pool.install(|| seconds(&mut step)));
                }
            }
            let times: Vec<String> = times.into_iter().map(|times| format!("{:8.3}", 1e3 * median(times))).collect();
            let (bends, levels) = (fabric.bending > 0.0, levels == Levels::Auto);
            println!("{n:>5} {bends:>8} {levels:>7} {strain:>9.2e}  {}", times.join(" "));
        }
    }
}

/// The same passes over the same tiles as a graph of tasks, as parallel loops of rayon one after another, and as a
/// graph on an adaptive number of threads, timed in turn on pools of 1 thread up to the machine's. `CLOTH_MESHES` adds
/// the meshes of a folder.
fn schedule() {
    let most = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    println!("\nS = {SUBSTEPS}, ms a frame: loops / graph / as many threads as pay (medians of 25, in turn)");
    let mut meshes: Vec<(String, Mesh, Vec<u32>)> =
        [64, 128, 256, 512, 1024].map(|n| (format!("HANG {n}"), Mesh::grid(n, n, 1.0, 1.0), (0..n).collect())).into();
    let folder = std::env::var_os("CLOTH_MESHES").into_iter().flat_map(|folder| std::fs::read_dir(folder).into_iter().flatten());
    let mut files: Vec<_> =
        folder.flatten().map(|file| file.path()).filter(|path| path.extension().is_some_and(|e| e == "obj")).collect();
    files.sort();
    for path in files {
        let mesh = Mesh::load_obj(&path).expect("a mesh");
        let pinned = upper_edge(&mesh);
        meshes.push((path.file_stem().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default(), mesh, pinned));
    }
    let fabric = Fabric { bending: 1e-4, damping: 0.03, ..scenes::bare() };
    for (name, mesh, pinned) in meshes {
        for (terms, fabric, levels) in [("bare", scenes::bare(), Levels::Off), ("levels, bending", fabric, Levels::Auto)] {
            let options = Options { fabric, levels, pinned: pinned.clone(), ..scenes::hang(2, fabric).1 };
            let scene = (mesh.clone(), options);
            // A million vertices with bending take seconds per frame on one thread.
            let large = mesh.positions.len() > 500_000;
            let (rounds, frames, counts) = if large { (5, 6, vec![1, 4, 16]) } else { (25, 40, vec![1, 2, 4, 8, 16, 32]) };
            let mut row = Vec::new();
            for threads in counts.into_iter().filter(|&threads| threads <= most) {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
                let attributes = Attributes::default();
                let mut cloths = [(); 3].map(|()| Deformer::new(&scene.0, scene.1.clone()).expect("a cloth"));
                cloths[0].loop_by_loop(true);
                cloths[1].on_threads(threads);
                // Untimed frames, in which the third adapts its number of threads.
                pool.install(|| {
                    (0..frames).for_each(|_| cloths.iter_mut().for_each(|cloth| scenes::frame(cloth, &attributes)));
                });
                let [loops, graph, pays] = &mut cloths;
                let times = pool.install(|| {
                    let mut works = [loops, graph, pays].map(|cloth| || scenes::frame(cloth, &attributes));
                    let [a, b, c] = &mut works;
                    in_turn(&mut [a, b, c], rounds)
                });
                row.push(format!("{threads}: {:.3} / {:.3} / {:.3}", 1e3 * times[0], 1e3 * times[1], 1e3 * times[2]));
            }
            println!("{name:>12} {terms:>16}  {}", row.join("   "));
        }
    }
}

/// The vertices in the upper three hundredths of a mesh, or on one side of it if it is flat.
fn upper_edge(mesh: &Mesh) -> Vec<u32> {
    let bounds = |of: fn(&Vec3) -> f32| {
        let along = mesh.positions.iter().map(of);
        along.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)))
    };
    let (low, high) = bounds(|x| x.y);
    let along: fn(&Vec3) -> f32 = if high > low { |x| x.y } else { |x| x.z };
    let (low, high) = bounds(along);
    let threshold = high - 0.03 * (high - low);
    (0..mesh.positions.len() as u32).filter(|&v| along(&mesh.positions[v as usize]) >= threshold).collect()
}

/// The limits of the machine: memory bandwidth, and the time of a barrier between threads.
fn limits() {
    let threads = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    println!("\nLimits of this machine");
    let mut bytes = vec![0_u64; 1 << 26];
    for count in [1, threads] {
        let share = bytes.len().div_ceil(count);
        let mut best = f64::MAX;
        for round in 0..5 {
            best = best.min(seconds(&mut || {
                std::thread::scope(|scope| {
                    for part in bytes.chunks_mut(share) {
                        scope.spawn(move || part.iter_mut().for_each(|word| *word = word.wrapping_add(round)));
                    }
                });
            }));
        }
        println!("{count:>3} threads read and write {:6.1} GB/s", 2.0 * 8.0 * bytes.len() as f64 / best * 1e-9);
    }
    println!(
        "Threads meet after each has added one to each word of: nothing, 12 KiB, 24 KiB of its own; its own and the next one's in turn"
    );
    for count in [1, 2, 4, 8, 16, 32].into_iter().filter(|&count| count <= threads) {
        let times =
            [(0, false), (12, false), (24, false), (12, true), (24, true)].map(|(size, next)| meetings(count, size << 7, next));
        println!("{count:>3} threads {} us", times.map(|time| format!("{:7.2}", 1e6 * time)).join(" "));
    }
    shares();
}

/// Time (s) from one barrier of `count` threads to the next. In between, each thread adds to some words, of its own or
/// alternately of its neighbor's, as tiles exchange their borders.
fn meetings(count: usize, words: usize, next: bool) -> f64 {
    let rounds = 4000;
    let arrived = AtomicUsize::new(0);
    let blocks: Vec<Vec<AtomicU64>> = (0..count).map(|_| (0..words).map(|_| AtomicU64::new(0)).collect()).collect();
    let member = |member: usize| {
        for round in 1..=rounds {
            let add = |word: &AtomicU64| word.store(word.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
            blocks[(member + usize::from(next) * (round % 2)) % count].iter().for_each(add);
            arrived.fetch_add(1, Ordering::SeqCst);
            while arrived.load(Ordering::SeqCst) < round * count {
                std::hint::spin_loop();
            }
        }
    };
    let time = seconds(&mut || {
        std::thread::scope(|scope| (0..count).for_each(|index| drop(scope.spawn(move || member(index)))));
    });
    time / rounds as f64
}

/// The time of a frame if threads were independent: each steps a strip of its own, of its share of the sheet's size. If
/// this exceeds one thread's time over the number of threads, processors share something: pipelines, caches, memory.
fn shares() {
    let most = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
    let counts: Vec<u32> = [1, 2, 4, 8, 16, 32].into_iter().filter(|&count| count as usize <= most).collect();
    println!("\nStrips of N x N over threads, a strip each, S = {SUBSTEPS}, ms a frame (medians), threads {counts:?}");
    println!("{:>5} {:>8}", "N", "bending");
    for (n, bending) in [128, 256, 512, 1024].into_iter().flat_map(|n| [(n, 0.0), (n, 1e-5)]) {
        let times = counts.iter().map(|&count| {
            let meet = std::sync::Barrier::new(count as usize);
            let strip = || {
                let (_, options) = scenes::hang(n, Fabric { bending, ..scenes::bare() });
                let options = Options { levels: Levels::Off, ..options };
                let mut deformer = Deformer::new(&Mesh::grid(n, n / count, 1.0, 1.0 / count as f32), options).expect("a strip");
                let mut times = Vec::new();
                for _ in 0..if n > 256 { 6 } else { 21 } {
                    meet.wait();
                    times.push(seconds(&mut || scenes::frame(&mut deformer, &Attributes::default())));
                }
                median(times)
            };
            std::thread::scope(|scope| {
                let strips: Vec<_> = (0..count).map(|_| scope.spawn(|| on_one_thread(strip))).collect();
                strips.into_iter().map(|strip| strip.join().expect("it steps")).fold(0.0, f64::max)
            })
        });
        let times: Vec<String> = times.map(|time| format!("{:8.3}", 1e3 * time)).collect();
        println!("{n:>5} {:>8} {}", bending > 0.0, times.join(" "));
    }
}

/// The time on one thread for a given strain, with levels, and the error relative to the true motion.
fn strain() {
    let n = 128;
    let run = |substeps: u32, levels: Levels, frames: u32| {
        let (mesh, options) = scenes::hang(n, scenes::bare());
        let options = Options { quality: Quality::Substeps(substeps), levels, ..options };
        let mut deformer = Deformer::new(&mesh, options).expect("a sheet");
        (0..frames).for_each(|_| scenes::frame(&mut deformer, &Attributes::default()));
        deformer
    };
    on_one_thread(|| {
        // Four times the substeps that resolve the stiffness.
        let truth = run(1340, Levels::Off, 30).positions().expect("memory").to_vec();
        println!("\nHANG, N = {n}, one thread: mean strain at 2 s, position error at 0.5 s (rms over 1 m, against S = 1340)");
        println!("{:>9} {:>4} {:>9} {:>9} {:>9}", "bound", "S", "ms", "strain", "error");
        let mut substeps = 2;
        for bound in [1.2e-2, 1.4e-3] {
            let (mut deformer, strain) = loop {
                let mut deformer = run(substeps, Levels::Auto, 120);
                let strain = deformer.measure().expect("memory").mean_strain;
                if strain <= bound {
                    break (deformer, strain);
                }
                substeps += 1;
            };
            let time = in_turn(&mut [&mut || scenes::frame(&mut deformer, &Attributes::default())], 61)[0];
            let mut swung = run(substeps, Levels::Auto, 30);
            let apart = swung.positions().expect("memory").iter().zip(&truth).map(|(a, b)| f64::from(a.distance_squared(*b)));
            let error = (apart.sum::<f64>() / truth.len() as f64).sqrt();
            println!("{bound:>9.1e} {substeps:>4} {:>9.3} {strain:>9.2e} {error:>9.1e}", 1e3 * time);
        }
    });
}
