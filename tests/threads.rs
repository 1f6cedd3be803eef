//! Whole cloths on pools of any number of threads, beside threads that are busy with other work: the same bits as on
//! one thread.
//!
//! The bits depend on which tasks wait for which others (`src/cpu/tasks/scheduler.rs`). A missing dependency shows here
//! as different bits, in builds with debug assertions as a panic of the task that is too early, and under Miri and
//! `ThreadSanitizer` as a data race.

mod common;

use std::sync::atomic::{AtomicBool, Ordering};

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Collider, Deformer, Fabric, Levels, Mesh, Method, Options, Quality};
use common::{FRAME, meshes, top};

/// Number of frames that are compared, and of substeps in each; Miri is some thousand times slower.
const FRAMES: u32 = if cfg!(miri) { 1 } else { 4 };
const SUBSTEPS: u32 = if cfg!(miri) { 1 } else { 10 };
/// Vertices per side: enough for several tiles.
const SIDE: u32 = if cfg!(miri) { 34 } else { 80 };
/// Fewer threads than tiles, as many, and more than there are tasks in most passes.
const POOLS: &[usize] = if cfg!(miri) { &[2] } else { &[1, 2, 3, 5, 16] };

/// A slit skirt of random triangles with its waistband pinned.
fn skirt() -> (Mesh, Vec<u32>) {
    let mut mesh = meshes::delaunay(SIDE, 7);
    for x in &mut mesh.positions {
        let (angle, down) = (6.0 * x.x, x.z + 0.5);
        *x = Vec3::new((0.15 + 0.3 * down) * angle.cos(), -0.8 * down, (0.15 + 0.3 * down) * angle.sin());
    }
    (mesh, top(SIDE))
}

/// A ball held at two vertices.
fn ball() -> (Mesh, Vec<u32>) {
    (common::shapes::ball(Vec3::Y * 1.5, 0.5, 40), vec![0, 1000])
}

/// Each stage of a CPU step occurs in one of these scenes.
fn scenes() -> Vec<(&'static str, Mesh, Options)> {
    let fabric = Fabric { density: 0.2, stretch: 5000.0, bending: 1e-4, damping: 0.03 };
    let soft = Fabric { stretch: 20.0, bending: 0.0, ..fabric };
    let grid = || (Mesh::grid(SIDE, SIDE, 1.0, 1.0), vec![0, SIDE - 1]);
    let scene = |name, (mesh, pinned), method, levels, fabric, substeps| {
        let quality = Quality::Substeps(substeps);
        let options = Options { backend: Backend::Cpu, method, quality, levels, fabric, pinned, ..Options::default() };
        (name, mesh, options)
    };
    let mut scenes = vec![scene("a grid with levels", grid(), Method::SmallSteps, Levels::Count(9), fabric, SUBSTEPS)];
    if !cfg!(miri) {
        scenes.extend([
            scene("a skirt with levels", skirt(), Method::SmallSteps, Levels::Count(9), fabric, SUBSTEPS),
            scene("a skirt without levels", skirt(), Method::SmallSteps, Levels::Off, fabric, SUBSTEPS),
            scene("a relaxed skirt", skirt(), Method::Relaxation { iterations: 3 }, Levels::Off, fabric, SUBSTEPS),
            scene("a ball, which is swept there and back", ball(), Method::SmallSteps, Levels::Count(9), fabric, SUBSTEPS),
            scene("a grid of springs", grid(), Method::Springs, Levels::Off, soft, 10 * SUBSTEPS),
        ]);
    }
    scenes
}

/// Positions and velocities, as bits, after frames in wind, over a moving ball and a floor, with moving pins.
fn played(mesh: &Mesh, options: &Options, loops: bool) -> Vec<[u32; 6]> {
    let mut deformer = Deformer::new(mesh, options.clone()).unwrap();
    deformer.loop_by_loop(loops);
    let lowest = mesh.positions.iter().map(|x| x.y).fold(f32::INFINITY, f32::min);
    for frame in 1..=FRAMES {
        let time = frame as f32 * FRAME;
        let lead = Vec3::new(0.1 * (9.0 * time).sin(), 0.2 * time, 0.4 * time);
        // The last frame is calm and touches nothing, so it has other passes and another graph.
        let calm = FRAMES > 1 && frame == FRAMES;
        let ball = Collider::sphere(Vec3::new(time, lowest - 0.05, 0.1), 0.2);
        let floor = Collider::plane(Vec3::Y * (lowest - 0.01), Vec3::Y);
        let attributes = Attributes {
            wind: if calm { Vec3::ZERO } else { Vec3::new(4.0, 0.0, 6.0) },
            air_density: if calm { 0.0 } else { 1.2 },
            colliders: if calm { Vec::new() } else { vec![ball, floor] },
            pin_targets: Some(options.pinned.iter().map(|&pin| mesh.positions[pin as usize] + lead).collect()),
            ..Attributes::default()
        };
        deformer.step(FRAME, &attributes).unwrap();
    }
    let x = deformer.positions().unwrap().to_vec();
    let v = deformer.velocities().unwrap().to_vec();
    x.iter().zip(&v).map(|(x, v)| [x.x, x.y, x.z, v.x, v.y, v.z].map(f32::to_bits)).collect()
}

/// Sets a flag when dropped, even if a comparison panics.
struct End<'a>(&'a AtomicBool);

impl Drop for End<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Threads that compute from time to time, at random, until they are stopped, so that the machine has fewer free cores
/// than workers.
fn beside_busy_threads<T>(count: u64, then: impl FnOnce() -> T) -> T {
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        for seed in 0..count {
            let done = &done;
            scope.spawn(move || {
                let mut random = fastrand::Rng::with_seed(seed);
                while !done.load(Ordering::Relaxed) {
                    (0..random.u32(0..20_000)).for_each(|_| std::hint::spin_loop());
                    std::thread::sleep(std::time::Duration::from_micros(random.u64(0..300)));
                }
            });
        }
        let _end = End(&done);
        then()
    })
}

#[test]
fn any_number_of_threads_makes_the_same_bits() {
    let busy = if cfg!(miri) { 0 } else { 2 };
    beside_busy_threads(busy, || {
        for (name, mesh, options) in scenes() {
            let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
            let expected = alone.install(|| played(&mesh, &options, false));
            assert!(expected.iter().zip(&mesh.positions).any(|(now, before)| now[1] != before.y.to_bits()), "{name}: it moved");
            for &threads in POOLS {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
                for loops in [false, true] {
                    let same = pool.install(|| played(&mesh, &options, loops)) == expected;
                    assert!(same, "{name} on {threads} threads, loop by loop: {loops}");
                }
            }
        }
    });
}

/// A pool that the caller keeps busy with other work, so that workers come late.
#[test]
#[cfg(not(miri))]
fn a_busy_pool_makes_the_same_bits() {
    use std::sync::Arc;
    use std::sync::atomic::AtomicUsize;
    for (name, mesh, options) in scenes() {
        let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let expected = alone.install(|| played(&mesh, &options, false));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
        let (done, waiting) = (AtomicBool::new(false), Arc::new(AtomicUsize::new(0)));
        let same = std::thread::scope(|scope| {
            scope.spawn(|| {
                let mut random = fastrand::Rng::with_seed(1);
                while !done.load(Ordering::Relaxed) {
                    if waiting.fetch_add(1, Ordering::Relaxed) < 4 {
                        let (waiting, spins) = (Arc::clone(&waiting), random.u32(0..50_000));
                        pool.spawn(move || {
                            (0..spins).for_each(|_| std::hint::spin_loop());
                            waiting.fetch_sub(1, Ordering::Relaxed);
                        });
                    } else {
                        waiting.fetch_sub(1, Ordering::Relaxed);
                        std::thread::sleep(std::time::Duration::from_micros(50));
                    }
                }
            });
            let _end = End(&done);
            pool.install(|| played(&mesh, &options, false)) == expected
        });
        assert!(same, "{name}");
    }
}

/// Several cloths that step at once in one pool: a thread that waits for one may step another one meanwhile.
#[test]
#[cfg(not(miri))]
fn cloths_that_share_a_pool_make_the_same_bits() {
    use rayon::prelude::*;
    let scenes = scenes();
    let alone = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(3).build().unwrap();
    let play = |(_, mesh, options): &(&str, Mesh, Options)| played(mesh, options, false);
    let expected: Vec<_> = alone.install(|| scenes.iter().map(play).collect());
    let together: Vec<_> = pool.install(|| scenes.par_iter().map(play).collect());
    for ((name, ..), same) in scenes.iter().zip(expected.iter().zip(&together).map(|(a, b)| a == b)) {
        assert!(same, "{name}");
    }
}

/// What `Deformer::step` documents about locks: on a pool of its own, a step does not run other code that waits for a
/// lock held by the caller.
#[test]
#[cfg(not(miri))]
fn a_lock_may_be_held_across_a_step_on_a_pool_of_its_own() {
    use std::sync::{Arc, Mutex, mpsc};
    use std::time::Duration;
    let (stepped, done) = mpsc::channel();
    // The threads are not scoped: if they deadlock, they are left behind.
    std::thread::spawn(move || {
        let [own, other] = [3, 2].map(|threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap());
        let lock = Arc::new(Mutex::new(()));
        let held = lock.lock().unwrap();
        for _ in 0..100 {
            let lock = Arc::clone(&lock);
            other.spawn(move || drop(lock.lock()));
        }
        let (_, mesh, options) = &scenes()[0];
        let moved = own.install(|| played(mesh, options, false)).len();
        drop(held);
        stepped.send(moved).unwrap();
    });
    assert_eq!(done.recv_timeout(Duration::from_secs(120)), Ok((SIDE * SIDE) as usize), "the step waits for the lock");
}
