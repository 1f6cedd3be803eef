//! Where methods fail: conservation, visiting order, explicit limits, stress tests, single precision, long runs.

mod common;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{
    Attributes, Backend, Collider, Contact, Deformer, Fabric, Levels, Mesh, Method, Options, Quality, StepError,
};

use rayon::prelude::*;

use common::energy::{energy, masses, momenta, resolved_at};
use common::plain_xpbd::{Baseline, Scheme};
use common::reference::{Spring, springs};
use common::shapes::{ball, tube};
use common::{FRAME, hang, meshes, play};

/// Membrane stiffness (N/m), areal density (kg/m²), gravity (m/s²).
const K: f32 = 5000.0;
const RHO: f32 = 0.2;
const G: f64 = 9.81;
/// `m g L/2` of HANG (J), the energy that it releases in hanging down.
const FALL: f64 = RHO as f64 * G / 2.0;

on_every_backend!(conservation, explicit_limit, far_from_the_origin, stress_small);

// Conservation.

/// A strip of 1 m x 0.25 m without forces, and its velocities when it spins at 2 rad/s about its normal.
fn spinning() -> (Mesh, Vec<f32>, Vec<Vec3>) {
    let mesh = Mesh::grid(17, 5, 1.0, 0.25);
    let velocities = mesh.positions.iter().map(|&x| (2.0 * Vec3::Y).cross(x)).collect();
    let masses = masses(&mesh, RHO);
    (mesh, masses, velocities)
}

/// Drift of momentum (kg m/s), and relative drift of angular momentum and energy, in 2 s at S = 80.
fn drift(mesh: &Mesh, masses: &[f32], start: &[Vec3], x: &[Vec3], v: &[Vec3]) -> (f64, f64, f64) {
    let (springs, h) = (springs(mesh, f64::from(K)), 1.0 / 4800.0);
    let (p, l) = momenta(masses, x, v);
    let (_, l0) = momenta(masses, &mesh.positions, start);
    let [e, e0] = [(x, v), (&mesh.positions[..], start)].map(|(x, v)| energy(&springs, masses, 0.0, h, x, v));
    (p.length(), (l - l0).length() / l0.length(), (e / e0 - 1.0).abs())
}

fn conservation(backend: Backend) {
    let (mesh, masses, start) = spinning();
    let options = Options { backend, quality: Quality::Substeps(80), mass: Some(masses.clone()), ..Options::default() };
    let mut deformer = Deformer::new(&mesh, options).unwrap();
    deformer.set_state(&mesh.positions, &start).unwrap();
    play(&mut deformer, 120, &Attributes { gravity: Vec3::ZERO, ..Attributes::default() });
    let v = deformer.velocities().unwrap().to_vec();
    let (p, l, e) = drift(&mesh, &masses, &start, deformer.positions().unwrap(), &v);
    assert!(p <= 1e-6 && l <= 1e-5 && e <= 1e-3, "momentum {p:e}, angular momentum {l:e}, energy {e:e}");
}

#[test]
fn plain_xpbd_loses_angular_momentum() {
    let (mesh, masses, start) = spinning();
    let mut plain = Baseline::new(Scheme::Plain, mesh.positions.clone(), springs(&mesh, f64::from(K)), &masses, &[]);
    plain.gravity = Vec3::ZERO;
    plain.v.clone_from(&start);
    plain.play(120, 80);
    let (_, l, e) = drift(&mesh, &masses, &start, &plain.x, &plain.v);
    assert!(l > 1e-5 && e > 1e-3, "angular momentum {l:e}, energy {e:e}");
}

// Visiting order: HANG with substeps that do not resolve its stiffness (S* = 166). Energy is kinetic and potential in
// gravity; the stretch that one sweep leaves is not backed by the fabric's stiffness.

#[test]
fn colors_in_a_fixed_order_gain_no_energy() {
    let n = 64;
    let runs = [
        (Mesh::grid(n, n, 1.0, 1.0), 20, 180),
        (Mesh::grid(n, n, 1.0, 1.0), 40, 120),
        (Mesh::grid(n, n, 1.0, 1.0), 80, 120),
        (meshes::delaunay(n, 1), 20, 120),
        (meshes::delaunay(32, 2), 40, 120),
        (meshes::alternating(n), 20, 120),
    ];
    for (mesh, substeps, frames) in runs {
        let rows = (mesh.positions.len() as f64).sqrt() as u32;
        let (masses, (_, options)) = (masses(&mesh, RHO), hang(rows, substeps, Backend::Cpu));
        let mut deformer = Deformer::new(&mesh, Options { mass: Some(masses.clone()), ..options }).unwrap();
        let mut most = f64::NEG_INFINITY;
        for _ in 0..frames / 4 {
            play(&mut deformer, 4, &Attributes::default());
            let v = deformer.velocities().unwrap().to_vec();
            let h = 1.0 / f64::from(60 * substeps);
            most = most.max(energy(&[], &masses, G, h, deformer.positions().unwrap(), &v));
        }
        assert!(most <= 0.0, "{} triangles, S = {substeps}: the energy rises to {most} J", mesh.triangles.len());
    }
}

#[test]
fn natural_order_explodes() {
    let (mesh, options) = hang(64, 20, Backend::Cpu);
    let masses = options.mass.unwrap();
    let exploded = |e: f64| e.is_nan() || e >= FALL;
    for substeps in [20, 40, 80, 160] {
        let springs: Vec<Spring> = springs(&mesh, f64::from(K));
        let mut natural = Baseline::new(Scheme::FourChanges, mesh.positions.clone(), springs.clone(), &masses, &options.pinned);
        let mut e = 0.0;
        for _ in 0..30 {
            natural.play(4, substeps);
            e = energy(&[], &masses, G, 1.0 / f64::from(60 * substeps), &natural.x, &natural.v);
            if exploded(e) {
                break;
            }
        }
        assert!(exploded(e), "S = {substeps}: the energy stays at {e} J");
    }
}

// Explicit springs at the limit h = 2/omega_max.

fn explicit_limit(backend: Backend) {
    let n = 25;
    let spacing = 1.0 / (n - 1) as f32;
    let mesh = Mesh::grid(n, n, 1.0, 1.0);
    let is_border = |v: &u32| [v / n, v % n].iter().any(|&k| k == 0 || k == n - 1);
    for (diagonals, factor) in [(0.0, 4.0), (1.0, 3.0 + 5.0_f32.sqrt())] {
        let options = Options {
            backend,
            method: Method::Springs,
            quality: Quality::Substeps(1),
            fabric: Fabric { density: RHO, stretch: K, ..Fabric::default() },
            pinned: (0..n * n).filter(is_border).collect(),
            edge_scale: Some(mesh.edges().iter().map(|[i, j]| if j - i == n - 1 { diagonals } else { 1.0 }).collect()),
            ..Options::default()
        };
        let limit = 2.0 / (factor * K / RHO).sqrt() * spacing;
        let mut random = fastrand::Rng::with_seed(1);
        let mut jolt = || Vec3::from_array([0; 3].map(|_: i32| 1e-3 * (2.0 * random.f32() - 1.0)));
        let start: Vec<Vec3> = mesh.positions.iter().map(|_| jolt()).collect();
        let growth = |ratio: f32| {
            let mut deformer = Deformer::new(&mesh, options.clone()).unwrap();
            deformer.set_state(&mesh.positions, &start).unwrap();
            for _ in 0..1000 {
                let still = Attributes { gravity: Vec3::ZERO, ..Attributes::default() };
                match deformer.step(ratio * limit, &still) {
                    // At rest, the directions of the springs leave a margin that a cloth in motion does not have.
                    Ok(report) => assert_eq!(report.warnings.is_empty(), ratio < 0.75, "{:?} at {ratio}", report.warnings),
                    Err(StepError::Unstable { .. }) => return f32::INFINITY,
                    Err(error) => panic!("{error}"),
                }
            }
            match deformer.velocities() {
                Ok(v) => v.iter().map(|v| v.length()).fold(0.0, f32::max) / 1e-3,
                Err(_) => f32::INFINITY,
            }
        };
        let (without_a_word, below, above) = (growth(0.7), growth(0.98), growth(1.02));
        assert!(without_a_word < 10.0, "at 0.7 of {limit} s a jolt grows {without_a_word} times");
        assert!(below < 10.0, "at 0.98 of {limit} s a jolt grows {below} times");
        assert!(above > 1e3, "at 1.02 of {limit} s a jolt grows only {above} times");
    }
}

// Stress.

#[derive(Debug, Clone, Copy, PartialEq)]
enum Start {
    /// Every vertex displaced at random by up to this much along each axis (m).
    Scramble(f32),
    /// Scaled about the center.
    Collapse(f32),
    /// Thrown straight away from the pins at this speed (m/s).
    Speed(f32),
}

const STARTS: [Start; 6] = [
    Start::Scramble(0.05),
    Start::Scramble(0.5),
    Start::Collapse(1e-3),
    Start::Collapse(0.0),
    Start::Speed(100.0),
    Start::Speed(1000.0),
];

/// Three seconds of HANG from a bad start: the largest rise of the energy after 1 s (J), and the mean strain at the
/// end.
fn stress(start: Start, seed: u64, options: &Options, mesh: &Mesh, substeps: f64) -> Result<(f64, f32), StepError> {
    let masses = options.mass.as_ref().expect("HANG has masses");
    let springs = resolved_at(1.0 / (60.0 * substeps), &springs(mesh, f64::from(K)), masses, &options.pinned);
    let mut random = fastrand::Rng::with_seed(seed);
    let mut x = mesh.positions.clone();
    let mut v = vec![Vec3::ZERO; x.len()];
    for i in (0..x.len()).filter(|&i| !options.pinned.contains(&(i as u32))) {
        let mut direction = || Vec3::from_array([0; 3].map(|_: i32| 2.0 * random.f32() - 1.0));
        match start {
            Start::Scramble(by) => x[i] += by * direction(),
            Start::Collapse(to) => x[i] *= to,
            Start::Speed(speed) => v[i] = speed * Vec3::Z,
        }
    }
    let mut deformer = Deformer::new(mesh, options.clone()).unwrap();
    deformer.set_state(&x, &v)?;
    // Positions and velocities are half a substep apart, which matters in a cloth that vibrates, so the energy is
    // averaged over half a second. Over a quarter, the mean still varies by 5e-3 of the fall's energy depending on
    // rounding.
    let mut means = Vec::new();
    for half in 0..6 {
        let mut sum = 0.0;
        for _ in 0..30 {
            deformer.step(FRAME, &Attributes::default())?;
            let v = deformer.velocities()?.to_vec();
            sum += energy(&springs, masses, G, 1.0 / (60.0 * substeps), deformer.positions()?, &v);
        }
        if half >= 2 {
            means.push(sum / 30.0);
        }
    }
    let rise = means.windows(2).map(|mean| mean[1] - mean[0]).fold(f64::NEG_INFINITY, f64::max);
    Ok((rise, deformer.measure()?.mean_strain))
}

fn bound(start: Start) -> f32 {
    if start == Start::Collapse(0.0) { 0.06 } else { 0.01 }
}

/// The energy may not rise after 1 s, and the cloth must be intact at the end.
fn survives(n: u32, substeps: u32, backend: Backend) {
    for start in STARTS {
        let (mesh, options) = hang(n, substeps, backend);
        let (rise, strain) = stress(start, 1, &options, &mesh, f64::from(substeps)).unwrap();
        assert!(rise <= 0.0, "{start:?}, S = {substeps}: the energy rises by {rise} J");
        assert!(strain <= bound(start), "{start:?}, S = {substeps}: mean strain {strain}");
    }
}

#[test]
fn stress_at_20_substeps() {
    survives(32, 20, Backend::Cpu);
}

#[test]
fn stress_at_80_substeps() {
    survives(32, 80, Backend::Cpu);
}

/// A scene of [`stress`] whose sheet is not quite plane either.
fn stress_at_random(start: Start, seed: u64) -> Result<(f64, f32), StepError> {
    let (mut mesh, options) = hang(12, 20, Backend::Cpu);
    let mut random = fastrand::Rng::with_seed(seed);
    mesh.positions.iter_mut().for_each(|x| x.y += 1e-5 * (random.f32() - 0.5));
    stress(start, seed, &options, &mesh, 20.0)
}

/// The same from other random starts, each slightly out of plane: `CLOTH_RUNS` of each scene (300 bound the share that
/// fails by 1 % with a confidence of 95 %), or thirty. A failure names its seed.
#[test]
fn stress_from_random_starts() {
    let runs = std::env::var("CLOTH_RUNS").map_or(30, |runs| runs.parse().expect("a number"));
    for start in STARTS {
        let all: Vec<_> = (2..2 + runs).into_par_iter().map(|seed| (seed, stress_at_random(start, seed))).collect();
        let (mut worst, mut failed) = ((f64::NEG_INFINITY, 0.0_f32), Vec::new());
        for (seed, result) in all {
            let (rise, strain) = result.unwrap_or_else(|error| panic!("{start:?}, seed {seed}: {error}"));
            worst = (worst.0.max(rise), worst.1.max(strain));
            // Means over half a second differ by the changes of a cloth that still swings.
            if rise > 0.01 * FALL || strain > bound(start) {
                failed.push((seed, rise, strain));
            }
        }
        println!("{start:?}: {runs} runs, energy rises by {:.1e} J at most, mean strain {:.1e}", worst.0, worst.1);
        assert!(failed.is_empty(), "{start:?}: seeds, rises and strains {failed:?}");
    }
}

fn stress_small(backend: Backend) {
    survives(12, 20, backend);
}

/// Explicit springs, five percent inside the limit of a cloth in motion, fail every one of these: they fly apart or
/// gain many times the energy of the fall.
#[test]
fn springs_fail_under_stress() {
    for start in STARTS {
        let (mesh, options) = hang(32, 1, Backend::Cpu);
        let options = Options { method: Method::Springs, quality: Quality::default(), ..options };
        match stress(start, 1, &options, &mesh, 82.0) {
            Err(StepError::Unstable { .. }) => {}
            Ok((rise, _)) if rise > FALL => {}
            other => panic!("{start:?}: {other:?}"),
        }
    }
}

// Single precision.

/// HANG over a sphere, 10 km away and here: the spacing is 1/32 m, so that the rest positions are exact in both places.
fn far_from_the_origin(backend: Backend) {
    let n = 33;
    let run = |offset: Vec3| {
        let (mut mesh, options) = hang(n, 40, backend);
        mesh.positions.iter_mut().for_each(|x| *x += offset);
        let mut deformer = Deformer::new(&mesh, options).unwrap();
        let sphere = Collider::sphere(offset + Vec3::new(0.125, -0.5, 0.0), 0.25);
        play(&mut deformer, 20, &Attributes { colliders: vec![sphere], ..Attributes::default() });
        (deformer.positions().unwrap().to_vec(), deformer.velocities().unwrap().to_vec(), deformer.measure().unwrap())
    };
    let offset = Vec3::new(1e4, -1e4, 1e4);
    let (here, there) = (run(Vec3::ZERO), run(offset));
    let apart = here.1.iter().zip(&there.1).map(|(a, b)| a.distance(*b)).fold(0.0, f32::max);
    assert!(apart <= 1e-6, "velocities differ by {apart} m/s");
    for (v, (x, far)) in here.0.iter().zip(&there.0).enumerate() {
        assert_eq!(*x + offset, *far, "vertex {v}");
    }
    // The positions there are rounded to a millimeter, so no strain could be computed from them.
    assert_eq!(here.2, there.2);
}

/// A curtain that hangs exactly in a plane, and is drawn shut within it, folds: its edges keep their length. Without contact too,
/// and with the same bits in each run.
#[test]
fn a_flat_curtain_that_is_drawn_shut_folds() {
    let n = 41;
    let grid = Mesh::grid(n, n, 1.0, 1.0);
    let mut mesh = grid.clone();
    mesh.positions.iter_mut().for_each(|x| *x = Vec3::new(x.x, -x.z, 0.0));
    // Made so, or lying at rest and placed so.
    let run = |contact: Option<Contact>, is_placed: bool| {
        let pinned: Vec<u32> = (0..n).collect();
        let options = Options { backend: Backend::Cpu, pinned, contact, ..Options::default() };
        let mut curtain = Deformer::new(if is_placed { &grid } else { &mesh }, options).unwrap();
        curtain.set_state(&mesh.positions, &vec![Vec3::ZERO; mesh.positions.len()]).unwrap();
        assert_eq!(curtain.positions().unwrap(), mesh.positions);
        for frame in 1..=90 {
            let share = 1.0 - 0.5 * frame as f32 / 90.0;
            let pin_targets = mesh.positions[..n as usize].iter().map(|x| Vec3::new(share * x.x, x.y, x.z)).collect();
            curtain.step(FRAME, &Attributes { pin_targets: Some(pin_targets), ..Attributes::default() }).unwrap();
        }
        let depth = curtain.positions().unwrap().iter().fold(0.0, |depth: f32, x| depth.max(x.z.abs()));
        (depth, curtain.measure().unwrap().stretch_share, curtain.positions().unwrap().to_vec())
    };
    for (contact, is_placed) in [(None, false), (None, true), (Some(Contact::default()), false)] {
        let (depth, stretch, x) = run(contact, is_placed);
        println!(
            "{} contact: folds of {depth:.3} m, stretched by {stretch:.4}",
            if contact.is_some() { "with" } else { "without" }
        );
        assert!(depth > 0.02 && stretch < 0.05, "{depth} m, {stretch}");
        assert_eq!(x, run(contact, is_placed).2);
    }
}

// A long run.

#[test]
fn a_minute_undriven() {
    for substeps in [20, 40, 80] {
        let (mesh, options) = hang(16, substeps, Backend::Cpu);
        let masses = options.mass.clone().unwrap();
        let mut deformer = Deformer::new(&mesh, options).unwrap();
        let mut most = f64::NEG_INFINITY;
        for _ in 0..900 {
            play(&mut deformer, 4, &Attributes::default());
            let v = deformer.velocities().unwrap().to_vec();
            let h = 1.0 / f64::from(60 * substeps);
            most = most.max(energy(&[], &masses, G, h, deformer.positions().unwrap(), &v));
        }
        assert!(most <= 5e-3 * FALL, "S = {substeps}: the energy rises to {most} J");
    }
}

/// Closed shells, which have hardly a motion without stretch: a ball that collapses on a floor without friction, in damping air,
/// can give that air no more energy than gravity gave it. It does so at any number of substeps, and comes to rest. A sweep that
/// visits each edge once gives the air 1.4 and 4 J/kg at 40 and 80 (watched by declaring no part of a cloth a shell). Where the number of
/// substeps is chosen for each step, raising it stiffens edges under load, which gives the ball some energy.
#[test]
fn closed_shells_gain_no_energy() {
    let mesh = ball(Vec3::Y * 0.251, 0.25, 16);
    let vertices = mesh.positions.len();
    let mean = |values: &[Vec3], of: fn(&Vec3) -> f32| values.iter().map(|x| f64::from(of(x))).sum::<f64>() / vertices as f64;
    let (drag, floor) = (3.0, Collider::plane(Vec3::ZERO, Vec3::Y));
    let air = Attributes { damping: drag, colliders: vec![floor.with_friction(0.0)], ..Attributes::default() };
    // The energy that damping takes, the energy that gravity gives (J/kg), and the speed at the end (rms, m/s).
    let fallen = |quality: Quality, method: Method| {
        let mass = Some(vec![0.1 / vertices as f32; vertices]);
        let options = Options { backend: Backend::Cpu, quality, method, mass, ..Options::default() };
        let mut ball = Deformer::new(&mesh, options).unwrap();
        let mut taken = 0.0;
        for _ in 0..360 {
            play(&mut ball, 1, &air);
            taken += f64::from(drag * FRAME) * mean(ball.velocities().unwrap(), |v| v.length_squared());
        }
        let given = G * (mean(&mesh.positions, |x| x.y) - mean(ball.positions().unwrap(), |x| x.y));
        (taken, given, mean(ball.velocities().unwrap(), |v| v.length_squared()).sqrt())
    };
    for (name, quality, method, [most, fastest]) in [
        ("20 substeps", Quality::Substeps(20), Method::SmallSteps, [1.0, 0.01]),
        ("40 substeps", Quality::Substeps(40), Method::SmallSteps, [1.0, 0.01]),
        ("80 substeps", Quality::Substeps(80), Method::SmallSteps, [1.0, 0.01]),
        ("400 substeps", Quality::Substeps(400), Method::SmallSteps, [1.0, 0.01]),
        ("chosen substeps", Quality::Strain(0.03), Method::SmallSteps, [1.5, 0.1]),
        ("springs", Quality::Strain(0.03), Method::Springs, [1.0, 0.01]),
    ] {
        let (taken, given, speed) = fallen(quality, method);
        println!("{name}: the air took {taken:.3} J/kg, gravity gave {given:.3}; at the end {speed:.4} m/s");
        assert!(taken <= most * given, "{name}: {taken} J/kg taken, {given} given");
        assert!(speed < fastest, "{name}: {speed} m/s after six seconds");
    }
}

/// A tube of quads that are all cut along the same diagonal hangs by its upper ring and comes to rest, however it starts. A sweep that
/// visits each edge once keeps it moving for ever (watched by declaring that no part of a cloth is a tube).
#[test]
fn a_tube_that_hangs_comes_to_rest() {
    let mesh = tube(0.235, 0.7, 36, 26);
    let mut random = fastrand::Rng::with_seed(7);
    let mut component = || random.f32() - 0.5;
    let velocities: Vec<Vec3> = mesh.positions.iter().map(|_| Vec3::new(component(), component(), component())).collect();
    let air = Attributes { damping: 1.0, ..Attributes::default() };
    for (substeps, levels) in [(20, Levels::Off), (60, Levels::Off), (60, Levels::Auto)] {
        let options = Options {
            backend: Backend::Cpu,
            quality: Quality::Substeps(substeps),
            fabric: Fabric::COTTON,
            pinned: (0..36).collect(),
            levels,
            ..Options::default()
        };
        let mut tube = Deformer::new(&mesh, options).unwrap();
        tube.set_state(&mesh.positions, &velocities).unwrap();
        play(&mut tube, 720, &air);
        let fastest = tube.velocities().unwrap().iter().map(|v| v.length()).fold(0.0, f32::max);
        println!("{substeps} substeps, levels {levels:?}: {fastest:.5} m/s");
        assert!(fastest < 1e-3, "{substeps} substeps, levels {levels:?}: {fastest} m/s after twelve seconds");
    }
}
