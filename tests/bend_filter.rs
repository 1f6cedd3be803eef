//! Bending in several passes: the rigidity that stays stable at few substeps, and that neither noise nor energy is
//! added.

mod common;

use cloth_deformer::glam::{DVec3, Vec3};
use cloth_deformer::{Attributes, Backend, Collider, Deformer, Fabric, Mesh, Options, Quality};
use common::energy::{energy, masses};
use common::{FRAME, meshes, reference};

const DENSITY: f64 = 0.2;

/// The most that a mode is kicked by at fewer than 12 substeps in 1/60 s, and at 20 and more.
const FEW: (u32, f64) = (1, 0.2);
const MANY: (u32, f64) = (20, 2.0);

/// The stability limit of the given number of passes, and what they make of a mode with `z = h² lambda`, which they kick by at most
/// `most`, from Chebyshev polynomials.
fn chebyshev(passes: i32, most: f64) -> (f64, impl Fn(f64) -> f64) {
    let s = f64::from(passes);
    let theta = 3.0_f64.acosh() / s;
    let (w0, w1) = (theta.cosh(), theta.sinh() / (2.0_f64.sqrt() * s));
    let kick = move |z: f64| {
        let t = w0 - w1 * 2.0 * z / most;
        let value = if t > 1.0 { (s * t.acosh()).cosh() } else { (s * t.clamp(-1.0, 1.0).acos()).cos() };
        0.5 * most * 1.5 * (1.0 - value / 3.0)
    };
    (0.5 * most * (w0 + 1.0) / w1, kick)
}

/// A cloth whose edges are all scaled to 0, so that bending is the only force; and its masses (kg).
fn of_rows_alone(backend: Backend, mesh: &Mesh, bending: f64, substeps: u32) -> (Deformer, Vec<f64>) {
    let masses = masses(mesh, DENSITY as f32);
    let options = Options {
        backend,
        fabric: Fabric { density: DENSITY as f32, stretch: 1.0, bending: bending as f32, damping: 0.0 },
        edge_scale: Some(vec![0.0; mesh.edges().len()]),
        mass: Some(masses.clone()),
        quality: Quality::Substeps(substeps),
        ..Options::default()
    };
    (Deformer::new(mesh, options).unwrap(), masses.into_iter().map(f64::from).collect())
}

/// By how much bending lowers given heights (m) above the flat mesh in a substep of `h` (s) from rest, times two because
/// the first kick lasts half a substep.
fn kicked(cloth: &mut Deformer, mesh: &Mesh, heights: &[f64], h: f32) -> Vec<f64> {
    let raised: Vec<Vec3> = mesh.positions.iter().zip(heights).map(|(x, &y)| Vec3::new(x.x, y as f32, x.z)).collect();
    cloth.set_state(&raised, &vec![Vec3::ZERO; raised.len()]).unwrap();
    cloth.step(h, &Attributes { gravity: Vec3::ZERO, ..Attributes::default() }).unwrap();
    cloth.velocities().unwrap().iter().map(|v| -2.0 * f64::from(v.y * h)).collect()
}

/// In the middle of a grid, a wave is kicked by `P(z)` for any number of passes, because they do not reach to the
/// borders.
fn a_wave_is_kicked_by_chebyshevs_polynomial(backend: Backend) {
    let n = 65;
    let mesh = Mesh::grid(n, n, 1.0, 1.0);
    let (cell, middle) = (1.0 / f64::from(n - 1), f64::from(n / 2));
    let all: &[i32] = if backend == Backend::Cpu { &[2, 3, 4, 5, 6, 8, 11, 13, 16] } else { &[2, 5, 16] };
    for ((substeps, largest), &passes) in [FEW, MANY].into_iter().flat_map(|few| all.iter().map(move |passes| (few, passes))) {
        let (most, kick) = chebyshev(passes, largest);
        let h = FRAME / substeps as f32;
        // At 0.95 of the limit of this many passes, fewer would not suffice.
        let stiffest = 0.95 * most;
        let bending = stiffest * DENSITY * cell.powi(4) / (64.0 * f64::from(h).powi(2));
        let (mut cloth, _) = of_rows_alone(backend, &mesh, bending, substeps);
        assert_eq!(cloth.forecast(h, &Attributes::default()).unwrap().warnings, [], "the whole rigidity acts");
        for [along, across] in [[0.1, 0.0], [0.25, 0.1], [0.5, 0.5], [0.0, 1.0], [0.7, 0.8], [1.0, 1.0]] {
            let phase = |v: u32, k: u32| f64::from(if k == 0 { v % n } else { v / n }) - middle;
            let turn = std::f64::consts::PI;
            let wave = |v: u32| 0.01 * (turn * (along * phase(v, 0) + across * phase(v, 1))).cos();
            let heights: Vec<f64> = (0..n * n).map(wave).collect();
            let symbol = 4.0 - 2.0 * (turn * along).cos() - 2.0 * (turn * across).cos();
            let (z, center) = (stiffest * (symbol / 8.0).powi(2), (n * n / 2) as usize);
            let measured = kicked(&mut cloth, &mesh, &heights, h)[center] / heights[center];
            let what = format!("{substeps} substeps, {passes} passes");
            assert!((measured - kick(z)).abs() < 2e-4, "{what}: P({z}) = {measured}, expected {}", kick(z));
        }
    }
}

/// On any mesh including its borders, no shape is kicked by more than a fifth of itself, or twice itself if the cloth is too stiff to
/// crumple.
#[test]
fn no_shape_is_kicked_too_far() {
    let n = 17;
    let meshes = [Mesh::grid(n, n, 1.0, 1.0), meshes::alternating(n), meshes::equilateral(n), meshes::delaunay(n, 1)];
    for (index, mesh) in meshes.iter().enumerate() {
        for (bending, kick) in [(1e-4, FEW.1), (1e-3, FEW.1), (1e-2, MANY.1), (5e-2, MANY.1)] {
            let (mut cloth, masses) = of_rows_alone(Backend::Cpu, mesh, bending, FEW.0);
            let mut random = fastrand::Rng::with_seed(7);
            let mut heights: Vec<f64> = masses.iter().map(|_| random.f64() - 0.5).collect();
            let mut largest = 0.0;
            for _ in 0..60 {
                let size = heights.iter().map(|y| y * y).sum::<f64>().sqrt();
                heights.iter_mut().for_each(|y| *y *= 0.1 / size);
                let next = kicked(&mut cloth, mesh, &heights, FRAME);
                let weigh = |other: &[f64]| heights.iter().zip(other).zip(&masses).map(|((a, b), m)| a * b * m).sum::<f64>();
                largest = weigh(&next) / weigh(&heights);
                heights = next;
            }
            println!("mesh {index}, B = {bending}: kicked by {largest:.4} of itself");
            assert!(
                (0.45 * kick..=1.005 * kick).contains(&largest),
                "mesh {index}, B = {bending}: kicked by {largest} of itself"
            );
        }
    }
}

/// A sheet of cotton with cells of 5 mm, which takes two passes at 20 substeps, hung by two corners.
fn cotton(n: u32, stretch: f32, damping: f32) -> (Mesh, Options, Deformer) {
    let side = 0.0052 * (n - 1) as f32;
    let mesh = Mesh::grid(n, n, side, side);
    let fabric = Fabric { stretch, damping, ..Fabric::COTTON };
    let (backend, quality) = (Backend::Cpu, Quality::Substeps(20));
    let options = Options { backend, quality, fabric, pinned: vec![0, n - 1], ..Options::default() };
    let cloth = Deformer::new(&mesh, options.clone()).unwrap();
    (mesh, options, cloth)
}

/// Root mean square of the curvature (1/m) at the inner vertices of a grid with `columns` columns, from the five-point
/// Laplacian.
fn curvature(columns: usize, cell: f64, x: &[Vec3]) -> f64 {
    let inner = |&v: &usize| v >= columns && v < x.len() - columns && v % columns > 0 && v % columns < columns - 1;
    let square = |v: usize| {
        let around = [v - 1, v + 1, v - columns, v + columns];
        let y: DVec3 = around.iter().map(|&other| (x[other] - x[v]).as_dvec3()).sum();
        (y / (cell * cell)).length_squared()
    };
    let squares: Vec<f64> = (0..x.len()).filter(inner).map(square).collect();
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// A sheet that hangs from two corners is smooth and comes to rest. The sweep must not find a short wave that it can
/// amplify.
#[test]
fn cotton_hung_by_two_corners_is_smooth_and_still() {
    for damping in [0.06, 0.0] {
        let n = 65;
        let (_, _, mut cloth) = cotton(n, Fabric::COTTON.stretch, damping);
        let air = Attributes { damping: 2.0, ..Attributes::default() };
        for _ in 0..300 {
            assert_eq!(cloth.step(FRAME, &air).unwrap().warnings, [], "the whole rigidity acts");
        }
        let velocities = cloth.velocities().unwrap();
        let speed = (velocities.iter().map(|v| v.as_dvec3().length_squared()).sum::<f64>() / velocities.len() as f64).sqrt();
        let bent = curvature(n as usize, 0.0052, cloth.positions().unwrap());
        println!("tau = {damping}: curvature {bent:.3} 1/m, {speed:.5} m/s (RMS)");
        assert!(bent <= 4.0 && speed <= 0.01, "tau = {damping}: curvature {bent} 1/m, {speed} m/s");
    }
}

/// Sheets that have fallen on the floor on an edge and crumpled come to rest, however few the substeps. Folds that are kicked across a
/// part of an edge in a substep would drive the edges, and these the folds: at up to 1.2 m/s (RMS) here.
#[test]
fn crumpled_cloth_comes_to_rest_at_few_substeps() {
    let side = 0.3;
    let on_edge = |mesh: Mesh| {
        let wavy = |x: &Vec3| side * Vec3::new(x.x, 0.1 - x.z, 0.02 * x.x + 0.05 * (9.0 * x.z).sin());
        Mesh { positions: mesh.positions.iter().map(wavy).collect(), triangles: mesh.triangles }
    };
    let scene = Attributes { colliders: vec![Collider::plane(Vec3::Y * -0.35, Vec3::Y)], ..Attributes::default() };
    for (name, mesh) in [("grid", on_edge(Mesh::grid(40, 40, 1.0, 1.0))), ("delaunay", on_edge(meshes::delaunay(40, 1)))] {
        for fabric in [Fabric::TOWEL, Fabric::COTTON] {
            for substeps in [5, 10, 14] {
                let options =
                    Options { backend: Backend::Cpu, quality: Quality::Substeps(substeps), fabric, ..Options::default() };
                let mut cloth = Deformer::new(&mesh, options).unwrap();
                (0..600).for_each(|_| drop(cloth.step(FRAME, &scene).unwrap()));
                let velocities = cloth.velocities().unwrap();
                let speed = velocities.iter().map(|v| v.as_dvec3().length_squared()).sum::<f64>() / velocities.len() as f64;
                println!("{name}, rigidity {}, {substeps} substeps: {:.5} m/s (RMS)", fabric.bending, speed.sqrt());
                assert!(speed.sqrt() < 0.03, "{name}, rigidity {}, {substeps} substeps: {} m/s", fabric.bending, speed.sqrt());
            }
        }
    }
}

/// A sheet swinging for a minute in a vacuum never has more energy than at its release. At 2 N/m its stretch is
/// resolved; otherwise its elastic energy would be unknown.
#[test]
fn a_minute_gives_no_energy() {
    for damping in [0.06, 0.0] {
        let n = 25;
        let (mesh, options, mut cloth) = cotton(n, 2.0, damping);
        let masses = masses(&mesh, options.fabric.density);
        let h = f64::from(FRAME) / 20.0;
        let springs = reference::springs(&mesh, f64::from(options.fabric.stretch));
        let fall = 9.81 * masses.iter().map(|&m| f64::from(m)).sum::<f64>() * 0.0052 * f64::from(n - 1);
        let mut highest = f64::NEG_INFINITY;
        for _ in 0..3600 {
            cloth.step(FRAME, &Attributes::default()).unwrap();
            let x = cloth.positions().unwrap().to_vec();
            highest = highest.max(energy(&springs, &masses, 9.81, h, &x, cloth.velocities().unwrap()) / fall);
        }
        println!("tau = {damping}: energy up to {highest:.2e} of the fall");
        assert!(highest <= 5e-3, "tau = {damping}: energy up to {highest} of the fall");
    }
}

on_every_backend!(a_wave_is_kicked_by_chebyshevs_polynomial);
