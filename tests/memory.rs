//! What a cloth takes: bytes a vertex, and a million vertices that build and step.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Levels, Mesh, Options, Quality};

struct Weighing;

static HELD: AtomicUsize = AtomicUsize::new(0);

#[global_allocator]
static ALLOCATOR: Weighing = Weighing;

#[expect(unsafe_code, reason = "an allocator is unsafe by its nature; this one hands everything to the system's")]
// SAFETY: every call is handed to the system's allocator as it came, and so is its answer.
unsafe impl GlobalAlloc for Weighing {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        HELD.fetch_add(layout.size(), Ordering::SeqCst);
        // SAFETY: the layout that this was called with, for which `GlobalAlloc::alloc` asks what `System.alloc` does.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::SeqCst);
        // SAFETY: every pointer given out above is the system's, for the layout that comes back with it.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// Bytes that a sheet holds after its first step, a vertex; the caller's mesh and options are the caller's.
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

/// One test, so that no other allocates meanwhile. The figures are those of the module docs of `src/model/cloth.rs`.
#[test]
fn bytes_a_vertex() {
    // The pool's own memory is nobody's vertex.
    bytes(40, 0.0, Levels::Off);
    for n in [256, 1024] {
        for (name, bending, levels, most) in [
            ("edges alone", 0.0, Levels::Off, 375.0),
            ("levels", 0.0, Levels::Auto, 440.0),
            ("bending", 1e-4, Levels::Off, 535.0),
        ] {
            let held = bytes(n, bending, levels);
            println!("{n} x {n}, {name}: {held:.0} bytes a vertex");
            assert!(held <= most, "{n} x {n}, {name}: {held:.0} bytes a vertex");
        }
    }
}
