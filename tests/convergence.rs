//! Accuracy: the order of convergence, the effect of resolution, accuracy gates, and meshes with different edge
//! directions.

mod common;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Mesh, Options, Quality};

use common::reference::Reference;
use common::{hang, meshes, play, rms};

on_every_backend!(gate_at_32);

/// Positions of HANG after `frames` of 1/60 s.
fn fall(mesh: &Mesh, options: &Options, substeps: u32, frames: u32) -> Vec<Vec3> {
    let options = Options { quality: Quality::Substeps(substeps), ..options.clone() };
    let mut deformer = Deformer::new(mesh, options).unwrap();
    play(&mut deformer, frames, &Attributes::default());
    deformer.positions().unwrap().to_vec()
}

/// The same by leapfrog springs in double precision.
fn reference(mesh: &Mesh, options: &Options, steps: u32, frames: u32) -> Vec<Vec3> {
    let masses = options.mass.as_ref().expect("HANG has masses");
    let reference = Reference::new(mesh, masses, &options.pinned, f64::from(options.fabric.stretch));
    reference.run(f64::from(frames) / 60.0, steps).positions()
}

/// Order of convergence, where the stiffness is resolved (S* = 18) and the error is above the floor of single precision
/// (1e-5).
#[test]
fn second_order() {
    let (mesh, options) = hang(8, 20, Backend::Cpu);
    for frames in [15, 24] {
        let exact = reference(&mesh, &options, 8000, frames);
        let point = |substeps: u32| {
            let error = rms(&fall(&mesh, &options, substeps, frames), &exact);
            (-f64::from(substeps).ln(), error.ln())
        };
        let points = [20, 28, 40, 56].map(point);
        let mean = |f: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / points.len() as f64;
        let (x, y) = (mean(&|p| p.0), mean(&|p| p.1));
        let slope = mean(&|p| (p.0 - x) * (p.1 - y)) / mean(&|p| (p.0 - x).powi(2));
        assert!(slope >= 1.8, "after {frames} frames: {slope}");
    }
}

/// The middle of the free edge of an inextensible sheet falls freely until the pull of the pins arrives. How far it has
/// moved inward by then depends on the resolution: by 2.5e-4 m from N = 32 to 64 at 0.25 s, and by 5e-2 m at 0.5 s.
#[test]
fn resolution_figures() {
    for (n, substeps, early, late) in [(32_u32, 160, 0.87765, -0.1945), (64, 320, 0.87740, -0.2480)] {
        let (mesh, options) = hang(n, substeps, Backend::Cpu);
        let fabric = Fabric { stretch: f32::INFINITY, ..options.fabric };
        let mut deformer = Deformer::new(&mesh, Options { fabric, ..options }).unwrap();
        let mut middle = || {
            play(&mut deformer, 15, &Attributes::default());
            let x = deformer.positions().unwrap();
            let right = (n * (n - 1) + n / 2) as usize;
            0.5 * (x[right] + x[right - 1]) + 0.5 * Vec3::Z
        };
        let (at_quarter, at_half) = (middle(), middle());
        assert!((at_quarter.y + 0.306_562_5).abs() < 1e-5, "N = {n}: {at_quarter} at 0.25 s");
        assert!((at_quarter.z - early).abs() < 1.2e-4, "N = {n}: {at_quarter} at 0.25 s");
        assert!((at_half.z - late).abs() < 1e-3, "N = {n}: {at_half} at 0.5 s");
    }
}

// Bounds on the error at 0.5 s.

fn gate(n: u32, substeps: u32, backend: Backend, steps: u32, bound: f64) {
    let (mesh, options) = hang(n, substeps, backend);
    let error = rms(&fall(&mesh, &options, substeps, 30), &reference(&mesh, &options, steps, 30));
    assert!(error <= bound, "N = {n}, S = {substeps}: {error:e} m");
}

fn gate_at_32(backend: Backend) {
    gate(32, 80, backend, 6000, 0.9e-4);
}

#[test]
fn gate_at_64() {
    gate(64, 160, Backend::Cpu, 10_000, 1.5e-4);
}

/// The reference runs near its own stability limit (11,500 steps), where its own error is about 7e-5.
#[test]
fn gate_at_128() {
    gate(128, 320, Backend::Cpu, 13_000, 2.4e-4);
}

/// In single precision, finer substeps do not increase the error. They would if velocities were differences of
/// positions.
#[test]
fn finer_is_not_worse() {
    let (mesh, options) = hang(32, 80, Backend::Cpu);
    let exact = reference(&mesh, &options, 8000, 30);
    let error = |substeps| rms(&fall(&mesh, &options, substeps, 30), &exact);
    let coarse = error(80);
    for substeps in [160, 320, 640] {
        let fine = error(substeps);
        assert!(fine <= coarse, "S = {substeps}: {fine:e} m, for {coarse:e} m at S = 80");
    }
}

// Meshes.

#[test]
fn orientation_of_the_mesh() {
    let n = 32;
    let (grid, options) = hang(n, 80, Backend::Cpu);
    // The masses of each mesh follow from its own triangles.
    let options = Options { mass: None, ..options };
    let free_edge = |mesh: &Mesh| {
        let x = fall(mesh, &options, 80, 15);
        x[(n * (n - 1)) as usize..].iter().sum::<Vec3>() / n as f32
    };
    let all = [&grid, &meshes::alternating(n), &meshes::delaunay(n, 1), &meshes::delaunay(n, 2)];
    let means = all.map(free_edge);
    for (a, b) in means.iter().flat_map(|a| means.iter().map(move |b| (a, b))) {
        assert!(a.distance(*b) < 2e-3, "{a} and {b}");
    }
}

#[test]
fn delaunay_covers_the_square_front_up() {
    let mesh = meshes::delaunay(32, 1);
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        0.5 * (b - a).cross(c - a).y
    };
    assert!(mesh.triangles.iter().all(|t| area(t) > 0.0));
    assert!((mesh.triangles.iter().map(area).sum::<f32>() - 1.0).abs() < 1e-5);
    assert_eq!(mesh.triangles.len(), 2 * 31 * 31, "Euler: 2 n - 2 - border");
}

/// An unstructured sheet hung by an edge, compared with its own converged run: a real mesh of 1939 vertices, or one
/// generated here.
#[test]
fn unstructured_sheet() {
    let made = || meshes::delaunay(44, 1);
    let mesh = meshes::folder().map_or_else(made, |folder| Mesh::load_obj(folder.join("square2K.obj")).unwrap());
    let pinned = (0..mesh.positions.len() as u32).filter(|&v| mesh.positions[v as usize].z < -0.4999).collect();
    let options = Options { backend: Backend::Cpu, pinned, ..Options::default() };
    let converged = fall(&mesh, &options, 640, 15);
    for (substeps, bound) in [(80, 4e-4), (160, 6e-5)] {
        let error = rms(&fall(&mesh, &options, substeps, 15), &converged);
        println!("{} vertices, S = {substeps}: {error:.1e} m", mesh.positions.len());
        assert!(error <= bound, "S = {substeps}: {error:e} m");
    }
}
