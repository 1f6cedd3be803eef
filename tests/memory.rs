//! Memory of a cloth: bytes per vertex, a million vertices that are built and stepped, and fans as large.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Levels, Mesh, Options, Quality};

struct Weighing;

static HELD: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

#[global_allocator]
static ALLOCATOR: Weighing = Weighing;

#[expect(unsafe_code, reason = "an allocator is unsafe by its nature; this one hands everything to the system's")]
// SAFETY: every call is passed on unchanged to the system's allocator, and so is its result.
unsafe impl GlobalAlloc for Weighing {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let before = HELD.fetch_add(layout.size(), Ordering::SeqCst);
        PEAK.fetch_max(before + layout.size(), Ordering::SeqCst);
        // SAFETY: `layout` satisfies the requirements of `GlobalAlloc::alloc`, which are those of `System.alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::SeqCst);
        // SAFETY: `pointer` was allocated above by the system with the same layout.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Bytes per vertex that a sheet holds after its first step, without the caller's mesh and options.
fn bytes(n: u32, bending: f32, levels: Levels) -> f64 {
    let mesh = Mesh::grid(n, n, 1.0, 1.0);
    let fabric = Fabric { bending, damping: 0.0, ..Fabric::default() };
    let options = Options {
        backend: Backend::Cpu,
        quality: Quality::Substeps(20),
        fabric,
        levels,
        pinned: (0..n).collect(),
        ..Options::default()
    };
    let before = HELD.load(Ordering::SeqCst);
    let mut deformer = Deformer::new(&mesh, options).unwrap();
    deformer.step(1.0 / 60.0, &Attributes::default()).unwrap();
    let held = HELD.load(Ordering::SeqCst) - before;
    let highest = deformer.positions().unwrap().iter().map(|x| x.y).fold(f32::NEG_INFINITY, f32::max);
    assert!(highest < 0.01, "it fell");
    held as f64 / f64::from(n * n)
}

/// Bytes per vertex of a fan with one hub, or with two on a common rim: the peak, and after a step.
///
/// Anything that grows with the square of the degree would take at least twenty times as much.
fn bytes_of_fan(rim: u32, hubs: u32, bending: f32, levels: Levels) -> [f64; 2] {
    let turn = std::f32::consts::TAU / rim as f32;
    let on_rim = |k: u32| Vec3::new((turn * k as f32).cos(), 0.0, (turn * k as f32).sin());
    let next = |k: u32| (k + 1) % rim;
    let fan = |hub: u32| (0..rim).map(move |k| if hub == 0 { [rim, next(k), k] } else { [rim + hub, k, next(k)] });
    let mesh = Mesh {
        positions: (0..rim).map(on_rim).chain((0..hubs).map(|hub| 0.1 * hub as f32 * Vec3::Y)).collect(),
        triangles: (0..hubs).flat_map(fan).collect(),
    };
    let options = Options {
        backend: Backend::Cpu,
        quality: Quality::Substeps(2),
        fabric: Fabric { bending, damping: 0.0, ..Fabric::default() },
        levels,
        pinned: vec![0],
        ..Options::default()
    };
    let before = HELD.load(Ordering::SeqCst);
    PEAK.store(before, Ordering::SeqCst);
    let mut deformer = Deformer::new(&mesh, options).unwrap();
    let report = deformer.step(1.0 / 60.0, &Attributes::default()).unwrap();
    assert_eq!(report.levels > 0, levels != Levels::Off, "{levels:?}");
    assert!(deformer.colors() < rim as usize + 8);
    let held = HELD.load(Ordering::SeqCst);
    assert!(deformer.positions().unwrap().iter().all(|x| x.is_finite()));
    [PEAK.load(Ordering::SeqCst), held].map(|bytes| (bytes - before) as f64 / f64::from(rim))
}

/// A single test, so that no other one allocates meanwhile. The figures are those in the module docs of
/// `src/model/cloth.rs`.
#[test]
fn bytes_a_vertex() {
    // The pool's own memory must not count.
    bytes(40, 0.0, Levels::Off);
    for n in [256, 1024] {
        for (name, bending, levels, most) in [
            ("edges alone", 0.0, Levels::Off, 375.0),
            ("levels", 0.0, Levels::Auto, 440.0),
            ("bending", 1e-9, Levels::Off, 535.0),
            ("bending in passes", 1e-4, Levels::Off, 585.0),
        ] {
            let held = bytes(n, bending, levels);
            println!("{n} x {n}, {name}: {held:.0} bytes a vertex");
            assert!(held <= most, "{n} x {n}, {name}: {held:.0} bytes a vertex");
        }
    }
    // About two hubs the fan is a closed shell, whose edges are stored once more for the way back.
    for (name, bending, levels, most) in [
        ("edges alone", 0.0, Levels::Off, [1100.0, 1650.0]),
        ("levels", 0.0, Levels::Count(9), [1120.0, 1650.0]),
        ("bending", 1e-4, Levels::Off, [1300.0, 1850.0]),
        ("levels and bending", 1e-4, Levels::Count(9), [1400.0, 1900.0]),
    ] {
        for (hubs, most) in (1..).zip(most) {
            let [peak, held] = bytes_of_fan(200_000, hubs, bending, levels);
            println!("a rim of 200000 about {hubs}, {name}: {held:.0} bytes a vertex, {peak:.0} on the way");
            assert!(peak <= most, "a rim of 200000 about {hubs}, {name}: {peak:.0} bytes a vertex");
        }
    }
}
