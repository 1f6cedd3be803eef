//! A step allocates nothing once the scene has been run before, while its number of substeps stays the same. What wgpu and drivers allocate in their calls is not
//! counted.

#[macro_use]
mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::backtrace::Backtrace;
use std::cell::Cell;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Collider, Contact, Deformer, Fabric, Mesh, Method, Options, Quality};
use common::FRAME;

struct Counting;

static COUNT: AtomicUsize = AtomicUsize::new(0);
/// Whether to record the callers of the allocator, and the callers recorded: the innermost function that is not from
/// the standard library or a container.
static ASKED: AtomicBool = AtomicBool::new(false);
static OWNERS: Mutex<Vec<String>> = Mutex::new(Vec::new());
thread_local! {
    /// Set while recording, because that allocates too.
    static NOTING: Cell<bool> = const { Cell::new(false) };
}

fn note_owner() {
    if !ASKED.load(Ordering::SeqCst) || NOTING.replace(true) {
        return;
    }
    let trace = Backtrace::force_capture().to_string();
    let mut functions = trace.lines().filter_map(|line| Some(line.trim().split_once(": ")?.1));
    let library = ["std::", "core::", "alloc::", "__rust", "allocation::", "hashbrown::", "smallvec::", "arrayvec::"];
    let owner = functions.find(|name| !library.iter().any(|prefix| name.trim_start_matches('<').starts_with(prefix)));
    OWNERS.lock().unwrap().push(owner.unwrap_or("unknown").to_owned());
    NOTING.set(false);
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

#[expect(unsafe_code, reason = "an allocator is unsafe by its nature; this one hands everything to the system's")]
// SAFETY: every call is passed on unchanged to the system's allocator, and so is its result.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        COUNT.fetch_add(1, Ordering::SeqCst);
        note_owner();
        // SAFETY: `layout` satisfies the requirements of `GlobalAlloc::alloc`, which are those of `System.alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: `pointer` was allocated above by the system with the same layout.
        unsafe { System.dealloc(pointer, layout) }
    }
}

/// A sheet with bending, wind, two colliders and a pin, of which one collider and the pin move.
fn scene(method: Method, backend: Backend) -> (Deformer, impl FnMut(&mut Deformer)) {
    let n = 60;
    let fabric = Fabric { bending: 1e-5, damping: 0.03, ..Fabric::default() };
    let substeps = if method == Method::Springs { 400 } else { 10 };
    let options =
        Options { backend, method, quality: Quality::Substeps(substeps), fabric, pinned: vec![0, n - 1], ..Options::default() };
    let mesh = Mesh::grid(n, n, 1.0, 1.0);
    let mut targets = vec![mesh.positions[0], mesh.positions[n as usize - 1]];
    let mut attributes = Attributes {
        wind: Vec3::new(1.0, 0.0, 2.0),
        air_density: 1.2,
        colliders: vec![Collider::sphere(Vec3::new(0.0, -0.4, 0.0), 0.3), Collider::plane(Vec3::new(0.0, -1.0, 0.0), Vec3::Y)],
        ..Attributes::default()
    };
    let advance = move |deformer: &mut Deformer| {
        targets[0].y += 1e-3;
        match &mut attributes.pin_targets {
            Some(held) => held.copy_from_slice(&targets),
            empty => *empty = Some(targets.clone()),
        }
        attributes.wind.x += 0.01;
        attributes.colliders[0] = Collider::sphere(Vec3::new(0.0, -0.4, targets[0].y), 0.3);
        deformer.step(FRAME, &attributes).unwrap();
    };
    (Deformer::new(&mesh, options).unwrap(), advance)
}

/// Number of allocations in each of some steps after the first.
fn counted(method: Method, backend: Backend) -> Vec<usize> {
    let (mut deformer, mut advance) = scene(method, backend);
    advance(&mut deformer);
    let step = |_| {
        deformer.wait().unwrap();
        let before = COUNT.load(Ordering::SeqCst);
        advance(&mut deformer);
        COUNT.load(Ordering::SeqCst) - before
    };
    (0..20).map(step).collect()
}

/// Number of allocations in each of some steps of sheets lying on one another, once the lists of contact have stopped
/// growing.
fn counted_at_rest() -> Vec<usize> {
    let mut mesh = Mesh::grid(24, 24, 0.5, 0.5);
    let other = mesh.clone();
    mesh.positions.extend(other.positions.iter().map(|&x| x + Vec3::new(0.013, 0.006, 0.007)));
    mesh.triangles.extend(other.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + 24 * 24)));
    let contact = Some(Contact { thickness: 0.005, friction: 0.3 });
    let options = Options { backend: Backend::Cpu, quality: Quality::Substeps(10), contact, ..Options::default() };
    let mut deformer = Deformer::new(&mesh, options).unwrap();
    let colliders = vec![Collider::plane(Vec3::Y * -0.01, Vec3::Y)];
    let attributes = Attributes { colliders, ..Attributes::default() };
    let mut step = || {
        let before = COUNT.load(Ordering::SeqCst);
        let contacts = deformer.step(FRAME, &attributes).unwrap().contacts;
        (COUNT.load(Ordering::SeqCst) - before, contacts)
    };
    (0..40).for_each(|_| _ = step());
    let counts: Vec<(usize, u32)> = (0..10).map(|_| step()).collect();
    assert!(counts.iter().all(|&(_, contacts)| contacts > 100), "they touch: {counts:?}");
    counts.into_iter().map(|(count, _)| count).collect()
}

/// The functions that allocate in the fourth step.
#[cfg(feature = "gpu")]
fn owners(backend: Backend) -> Vec<String> {
    let (mut deformer, mut advance) = scene(Method::SmallSteps, backend);
    (0..3).for_each(|_| advance(&mut deformer));
    deformer.wait().unwrap();
    ASKED.store(true, Ordering::SeqCst);
    advance(&mut deformer);
    ASKED.store(false, Ordering::SeqCst);
    std::mem::take(&mut OWNERS.lock().unwrap())
}

/// A single test, so that no other one allocates meanwhile.
#[test]
fn a_step_allocates_nothing() {
    if cfg!(debug_assertions) {
        eprintln!("not counted: builds with debug assertions watch every access to a shared array, and that takes memory");
        return;
    }
    // In a pool of its own: entering a pool from outside makes rayon allocate a block of its queue now and then.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    for method in [Method::SmallSteps, Method::Relaxation { iterations: 3 }, Method::Springs] {
        let counts = pool.install(|| counted(method, Backend::Cpu));
        assert!(counts.iter().all(|&count| count == 0), "{method:?}: {counts:?}");
    }
    let counts = pool.install(counted_at_rest);
    assert!(counts.iter().all(|&count| count == 0), "contact: {counts:?}");
    #[cfg(feature = "gpu")]
    for backend in [Backend::Hybrid, Backend::Gpu] {
        // wgpu and the driver allocate for every encoder and submission; the number must not grow with time.
        let counts = pool.install(|| counted(Method::SmallSteps, backend));
        let (early, late) = (counts[..10].iter().max(), counts[10..].iter().max());
        println!("{backend:?}: {counts:?} allocations a step");
        assert!(late <= early, "{backend:?}: {counts:?}");
        let owners = pool.install(|| owners(backend));
        let (ours, theirs): (Vec<&String>, Vec<&String>) = owners.iter().partition(|owner| owner.contains("cloth_deformer"));
        println!("{backend:?}: {} of wgpu's, {} of ours", theirs.len(), ours.len());
        assert!(theirs.iter().any(|owner| owner.contains("wgpu")), "who allocates can be told: {theirs:?}");
        assert!(ours.is_empty(), "{backend:?}: {ours:?}");
    }
}
