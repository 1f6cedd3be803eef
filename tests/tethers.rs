//! Tethers at lone pins: the worst edge is close to that of a resolved run, and what tethers must not change.

mod common;

use cloth_deformer::glam::{DVec3, Vec3};
use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Levels, Mesh, Options, Quality, Tethers};

use common::energy::{energy, masses};
use common::{FRAME, hang, meshes, play, rms};

const RHO: f32 = 0.2;
const G: f64 = 9.81;

/// The worst strain of each frame, and the positions after one of them.
fn fallen(mesh: &Mesh, options: &Options, frames: u32, shown: u32) -> (Vec<f32>, Vec<Vec3>) {
    let mut deformer = Deformer::new(mesh, options.clone()).unwrap();
    let mut at = Vec::new();
    let worst = (0..frames).map(|frame| {
        play(&mut deformer, 1, &Attributes::default());
        if frame + 1 == shown {
            at = deformer.positions().unwrap().to_vec();
        }
        deformer.measure().unwrap().max_strain
    });
    (worst.collect(), at)
}

fn median(values: impl Iterator<Item = f32>) -> f32 {
    let mut sorted: Vec<f32> = values.collect();
    sorted.sort_by(f32::total_cmp);
    sorted[sorted.len() / 2]
}

/// A sheet hung by two corners, S* = 82, for two seconds: the worst edge's excess over that of a resolved run, in the
/// median frame. Positions are compared at .2 s, when the sheet is caught; later it folds, and at .4 s a vertex is off
/// by 4 mm to 7 mm for any S from 40 to 120.
#[test]
fn the_worst_edge_is_the_fabrics_own() {
    let n = 32;
    let (mesh, base) = hang(n, 20, Backend::Cpu);
    let base = Options { pinned: vec![0, n - 1], ..base };
    let run = |substeps, levels, tethers| {
        fallen(&mesh, &Options { quality: Quality::Substeps(substeps), levels, tethers, ..base.clone() }, 120, 12)
    };
    let (own, exact) = run(120, Levels::Off, Tethers::Off);
    for substeps in [10, 20, 40] {
        let [(excess, error), (without, error_without)] = [Tethers::Auto, Tethers::Off].map(|tethers| {
            let (worst, at) = run(substeps, Levels::Auto, tethers);
            (median(worst.iter().zip(&own).map(|(worst, own)| worst - own)), rms(&at, &exact))
        });
        println!("S = {substeps}: excess {excess:.4}, {error:.2e} m; without tethers {without:.4}, {error_without:.2e} m");
        assert!(excess < 0.03, "S = {substeps}: {excess} beyond the fabric's own");
        assert!(excess < 0.5 * without, "S = {substeps}: {excess} beyond the fabric's own, {without} without tethers");
        assert!(error < error_without, "S = {substeps}: {error} m, {error_without} m without tethers");
    }
}

/// Without a load no tether pulls: on flat and rolled sheets and on any mesh.
#[test]
fn cloth_at_rest_stays_where_it_is() {
    let mut rolled = Mesh::grid(40, 30, 1.0, 0.7);
    rolled.positions.iter_mut().for_each(|x| *x = Vec3::new(0.2 * (5.0 * x.x).sin(), 0.2 * (5.0 * x.x).cos(), x.z));
    for (name, mesh) in [("grid", Mesh::grid(40, 30, 1.0, 0.7)), ("delaunay", meshes::delaunay(20, 4)), ("rolled", rolled)] {
        let pinned = vec![0, 17, mesh.positions.len() as u32 / 2];
        let fabric = Fabric { stretch: f32::INFINITY, bending: 0.0, ..Fabric::default() };
        let quality = Quality::Substeps(20);
        let options = Options { backend: Backend::Cpu, quality, fabric, pinned, levels: Levels::Off, ..Options::default() };
        let mut deformer = Deformer::new(&mesh, options).unwrap();
        play(&mut deformer, 60, &Attributes { gravity: Vec3::ZERO, ..Attributes::default() });
        let apart = |(a, b): (&Vec3, &Vec3)| a.distance(*b);
        let moved = deformer.positions().unwrap().iter().zip(&mesh.positions).map(apart).fold(0.0, f32::max);
        println!("{name}: moved by {moved:e} m");
        assert!(moved < 1e-6, "{name}: moved by {moved} m");
    }
}

/// Undamped for half a minute, on one pin and on two: the energy never exceeds the start, and no angular momentum
/// arises about a lone pin's vertical.
#[test]
fn energy_stays_below_its_start() {
    let n = 24;
    let mesh = Mesh::grid(n, n, 1.0, 1.0);
    let masses = masses(&mesh, RHO);
    let total: f64 = masses.iter().map(|&m| f64::from(m)).sum();
    for (pinned, substeps) in [(vec![0], 8), (vec![0, n - 1], 8), (vec![0, n - 1], 20), (vec![300], 20)] {
        let fabric = Fabric { density: RHO, stretch: 5000.0, bending: 0.0, damping: 0.0 };
        let quality = Quality::Substeps(substeps);
        let options = Options { backend: Backend::Cpu, quality, fabric, pinned: pinned.clone(), ..Options::default() };
        let mut deformer = Deformer::new(&mesh, options).unwrap();
        let mut most = f64::NEG_INFINITY;
        for _ in 0..1800 {
            play(&mut deformer, 1, &Attributes::default());
            let v = deformer.velocities().unwrap().to_vec();
            let h = f64::from(FRAME) / f64::from(substeps);
            most = most.max(energy(&[], &masses, G, h, deformer.positions().unwrap(), &v) / total);
        }
        println!("pins {pinned:?}, S = {substeps}: {most:.4} J/kg above its start at most");
        assert!(most <= 0.0, "pins {pinned:?}, S = {substeps}: {most} J/kg above its start");
    }
}

/// A tether exerts no torque about its pin, however it is stretched: a sheet on one lone pin keeps its angular momentum
/// about the pin if nothing else acts.
#[test]
fn tethers_have_no_torque_about_their_pin() {
    let n = 16;
    let mesh = Mesh::grid(n, n, 1.0, 1.0);
    let fabric = Fabric { density: RHO, stretch: 5e4, bending: 0.0, damping: 0.0 };
    let masses = masses(&mesh, RHO);
    let pin = 0;
    let x0 = mesh.positions[pin];
    let spinning: Vec<Vec3> = mesh.positions.iter().map(|&x| Vec3::new(0.0, 3.0, 0.0).cross(x - x0)).collect();
    let momentum = |x: &[Vec3], v: &[Vec3]| -> DVec3 {
        let of = |((x, v), &m): ((&Vec3, &Vec3), &f32)| f64::from(m) * (*x - x0).as_dvec3().cross(v.as_dvec3());
        x.iter().zip(v).zip(&masses).map(of).sum()
    };
    let lost = |tethers| {
        let quality = Quality::Substeps(20);
        let options = Options { backend: Backend::Cpu, quality, fabric, tethers, pinned: vec![pin as u32], ..Options::default() };
        let mut deformer = Deformer::new(&mesh, options).unwrap();
        deformer.set_state(&mesh.positions, &spinning).unwrap();
        let before = momentum(&mesh.positions, &spinning);
        play(&mut deformer, 60, &Attributes { gravity: Vec3::ZERO, ..Attributes::default() });
        let v = deformer.velocities().unwrap().to_vec();
        (momentum(deformer.positions().unwrap(), &v) - before).length() / before.length()
    };
    let (with, without) = (lost(Tethers::Auto), lost(Tethers::Off));
    println!("of the angular momentum {with:.1e} is lost, {without:.1e} without tethers");
    assert!(with < 1e-4 + 1.5 * without, "of the angular momentum {with} is lost, {without} without tethers");
}

/// Where no pin is lone, or the stiffness is resolved, a step is the same bit for bit.
#[test]
fn where_they_are_not_wanted_there_are_none() {
    let n = 20;
    let border = |v: &u32| v.is_multiple_of(n) || v % n == n - 1 || *v < n || v / n == n - 1;
    let run = |pinned: &[u32], substeps, tethers| {
        let (mesh, options) = hang(n, substeps, Backend::Cpu);
        let mut deformer = Deformer::new(&mesh, Options { pinned: pinned.to_vec(), tethers, ..options }).unwrap();
        play(&mut deformer, 20, &Attributes::default());
        deformer.positions().unwrap().to_vec()
    };
    let none: Vec<u32> = (0..n * n).filter(border).collect();
    for (pinned, substeps) in [(none.as_slice(), 10), (&[], 10), (&[0, 19], 100)] {
        assert!(run(pinned, substeps, Tethers::Auto) == run(pinned, substeps, Tethers::Off));
    }
    assert!(run(&[0, 19], 10, Tethers::Auto) != run(&[0, 19], 10, Tethers::Off), "elsewhere there are some");
}

/// Cloth that is soft along its diagonals stretches along its bias as far as its threads allow.
#[test]
fn tethers_let_cloth_shear() {
    let n = 25;
    let mesh = Mesh::grid(n, n, 1.0, 1.0);
    let edges = mesh.edges();
    let soft = edges.iter().map(|[a, b]| if b - a == 1 || b - a == n { 1.0 } else { 0.002 }).collect();
    let options = Options { backend: Backend::Cpu, edge_scale: Some(soft), pinned: vec![0], ..Options::default() };
    let length = |substeps, tethers| {
        let options = Options { quality: Quality::Substeps(substeps), levels: Levels::Off, tethers, ..options.clone() };
        let mut deformer = Deformer::new(&mesh, options).unwrap();
        play(&mut deformer, 300, &Attributes { damping: 3.0, ..Attributes::default() });
        deformer.positions().unwrap()[(n * n - 1) as usize].distance(mesh.positions[0])
    };
    let (resolved, held) = (length(120, Tethers::Off), length(30, Tethers::Auto));
    println!("{held} m along the bias, {resolved} m resolved, {} m at rest", 2.0_f32.sqrt());
    assert!(resolved > 1.05 * 2.0_f32.sqrt(), "it gives way");
    assert!((held - resolved).abs() < 0.01, "{held} m along the bias, {resolved} m resolved");
}
