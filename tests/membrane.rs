//! The membrane compared with closed forms: catenary, hanging strip, under-resolved strain, vibrations.

mod common;

use std::f64::consts::PI;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Deformer, Fabric, Levels, Mesh, Method, Options, Quality};

use common::chain::{self, amplitude, frequency, resolved};
use common::plain_xpbd::{Baseline, Scheme};
use common::{FRAME, play, reference};

/// Membrane stiffness (N/m), areal density (kg/m²), gravity (m/s²).
const K: f32 = 5000.0;
const RHO: f32 = 0.2;
const G: f32 = 9.81;

on_every_backend!(catenary, hanging_strip, string, membrane);

/// Relative difference.
fn off(measured: f64, expected: f64) -> f64 {
    (measured / expected - 1.0).abs()
}

// Catenary.

/// Sag (m) of a chain of `n - 1` equal links, 1 m in all, hung over `span` (m). The horizontal tension is found for
/// which the links, each inclined by the weight below it, reach across.
fn polygon_sag(n: u32, span: f64) -> f64 {
    let links = f64::from(n - 1);
    let weights: Vec<f64> = (0..n - 1).map(|k| f64::from(k) - 0.5 * (links - 1.0)).collect();
    let reach = |tension: f64| weights.iter().map(|w| tension / tension.hypot(*w) / links).sum::<f64>();
    let (mut low, mut high) = (0.0, 10.0 * links);
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if reach(middle) < span { low = middle } else { high = middle }
    }
    weights.iter().filter(|w| **w > 0.0).map(|w| w / low.hypot(*w) / links).sum()
}

fn sag(n: u32, span: f64, substeps: u32, levels: Levels, backend: Backend) -> f64 {
    let mesh = chain::straight(n, 1.0);
    let options = chain::options(f32::INFINITY, chain::ribbon_masses(n, RHO), vec![0, n - 1], substeps, backend);
    let mut deformer = Deformer::new(&mesh, Options { levels, ..options }).unwrap();
    // Starts as a V of the right length and is settled by drag.
    let along = span as f32;
    let down = (1.0 - along * along).sqrt();
    let v: Vec<Vec3> = mesh.positions.iter().map(|x| Vec3::new(along * x.x, -down * x.x.min(1.0 - x.x), 0.0)).collect();
    deformer.set_state(&v, &vec![Vec3::ZERO; v.len()]).unwrap();
    play(&mut deformer, 150, &Attributes { damping: 8.0, ..Attributes::default() });
    -f64::from(deformer.positions().unwrap()[n as usize / 2].y)
}

/// The oracle is the chain of discrete links; with many links it is the catenary.
fn catenary(backend: Backend) {
    for (span, smooth) in [(0.5, 0.39820), (0.6, 0.36278), (0.8, 0.26544), (0.9, 0.19071)] {
        assert!(off(polygon_sag(1001, span), smooth) < 3e-5, "the oracle");
        for (n, substeps, bound) in [(13, 20, 5e-3), (33, 80, 1.5e-3)] {
            // On other backends S = 80 would be twelve times the work and show nothing new, since they agree with the
            // CPU at S = 20.
            if substeps == 20 || backend == Backend::Cpu {
                let (measured, exact) = (sag(n, span, substeps, Levels::Off, backend), polygon_sag(n, span));
                assert!(off(measured, exact) < bound, "span {span}, S = {substeps}: {measured} for {exact}");
            }
        }
    }
}

/// A chain long enough for levels. With four times the links it takes four times the substeps to be as accurate as a
/// chain of 33 links at 80. There, levels that are asked for change nothing; with fewer substeps they pull only where
/// the chain itself would.
#[test]
fn catenary_with_levels() {
    for span in [0.5, 0.6, 0.8, 0.9] {
        let exact = polygon_sag(129, span);
        let error = |substeps, levels| sag(129, span, substeps, levels, Backend::Cpu) / exact - 1.0;
        let [coarse, resolved] = [80, 320].map(|substeps| (error(substeps, Levels::Count(9)), error(substeps, Levels::Off)));
        println!(
            "span {span}: S = 80 {:+.2e} with levels, {:+.2e} without; S = 320 {:+.2e}, {:+.2e}",
            coarse.0, coarse.1, resolved.0, resolved.1
        );
        assert!(coarse.0.abs() < coarse.1, "span {span}, S = 80: off by {} with levels, {} without", coarse.0, coarse.1);
        assert!(resolved.0.abs() < 1.5e-3, "span {span}, S = 320: off by {}", resolved.0);
    }
}

// Hanging strip: strain rho g (L - y)/K, extension rho g L²/2K.

const STRIP: u32 = 17;

fn substeps_at(ratio: f32) -> u32 {
    (ratio * resolved(STRIP, K)).ceil() as u32
}

/// Heights (m) below the pins of a strip's middle column, hung from its first row and settled. Without its diagonals
/// the lattice has no Poisson effect, so each column carries its own weight.
fn hung_strip(method: Method, substeps: u32, backend: Backend) -> Vec<f64> {
    let mesh = Mesh::grid(3, STRIP, 2.0 / (STRIP - 1) as f32, 1.0);
    let straight = |&[i, j]: &[u32; 2]| if j - i == 2 { 0.0 } else { 1.0 };
    let options = Options {
        backend,
        method,
        quality: Quality::Substeps(substeps),
        fabric: Fabric { density: RHO, stretch: K, ..Fabric::default() },
        pinned: common::top(3),
        edge_scale: Some(mesh.edges().iter().map(straight).collect()),
        ..Options::default()
    };
    let mut deformer = Deformer::new(&mesh, options).unwrap();
    // Its slowest stretching mode has 248/s, of which this drag leaves e^-15.
    play(&mut deformer, 30, &Attributes { gravity: Vec3::Z * G, damping: 60.0, ..Attributes::default() });
    deformer.positions().unwrap().chunks(3).map(|row| f64::from(row[1].z) + 0.5).collect()
}

/// One sweep leaves the edges of the two colors alternately too long and too short, so an edge is averaged with half of
/// each neighbor. The edge at the wall has only one neighbor and is left out.
fn hanging_strip(backend: Backend) {
    let links = f64::from(STRIP - 1);
    let strain = |below: f64| f64::from(RHO * G / K) * (1.0 - below);
    let z = hung_strip(Method::SmallSteps, substeps_at(2.0), backend);
    for (k, x) in z.windows(4).enumerate().skip(1) {
        let measured = links * ((x[3] - x[0]) + (x[2] - x[1])) / 4.0 - 1.0;
        let expected = strain((k as f64 + 1.5) / links);
        assert!(off(measured, expected) < 0.02, "edge {}: strain {measured:e} for {expected:e}", k + 1);
    }
    let extension = z[z.len() - 1] - 1.0;
    assert!(off(extension, 1.962e-4) < 0.02, "extension {extension:e} m");
}

/// Largest over smallest extension, minus one, at 2, 4 and 8 S*.
fn spread(extension: impl Fn(u32) -> f64) -> f64 {
    let extensions = [2.0, 4.0, 8.0].map(|ratio| extension(substeps_at(ratio)));
    extensions.iter().copied().fold(0.0, f64::max) / extensions.iter().copied().fold(f64::INFINITY, f64::min) - 1.0
}

#[test]
fn extension_does_not_depend_on_the_step() {
    let of = |method| move |substeps| hung_strip(method, substeps, Backend::Cpu).last().unwrap() - 1.0;
    let small_steps = spread(of(Method::SmallSteps));
    assert!(small_steps <= 0.02, "{small_steps}");
    for iterations in [1, 4, 20] {
        let relaxation = spread(of(Method::Relaxation { iterations }));
        assert!(relaxation > 0.02, "relaxation at {iterations} sweeps: {relaxation}");
    }
    let plain = spread(|substeps| {
        let mesh = chain::straight(STRIP, 1.0);
        let (springs, masses) = (reference::springs(&mesh, f64::from(K)), chain::ribbon_masses(STRIP, RHO));
        let mut plain = Baseline::new(Scheme::Plain, mesh.positions, springs, &masses, &[0]);
        (plain.gravity, plain.damping) = (Vec3::X * G, 60.0);
        plain.play(30, substeps);
        f64::from(plain.x.last().unwrap().x) - 1.0
    });
    assert!(plain > 0.02, "plain XPBD: {plain}");
}

// Unresolved stiffness: the worst strain is T h² (w_i + w_j)/l.

#[test]
fn under_resolved_sheet() {
    for (n, substeps) in [(32, 20), (64, 40)] {
        let (mesh, options) = common::hang(n, substeps, Backend::Cpu);
        let fabric = Fabric { stretch: f32::INFINITY, ..options.fabric };
        // The law holds for the sweep alone; with levels the strain is a fraction of it.
        let mut deformer = Deformer::new(&mesh, Options { fabric, levels: Levels::Off, ..options }).unwrap();
        play(&mut deformer, 240, &Attributes { damping: 4.0, ..Attributes::default() });
        let expected = f64::from(2.0 * G) * (f64::from(n - 1) / f64::from(60 * substeps)).powi(2);
        let measured = f64::from(deformer.measure().unwrap().max_strain);
        assert!(off(measured, expected) < 0.12, "N = {n}: strain {measured} for {expected}");
    }
}

#[test]
fn under_resolved_chain_with_a_weight_at_its_end() {
    let (n, substeps) = (17, 80);
    for (ratio, bound) in [(1.0, 0.2), (10.0, 0.11), (100.0, 0.03), (1000.0, 0.03)] {
        let mut masses = vec![0.01; n as usize];
        masses[n as usize - 1] *= ratio;
        let h = 1.0 / f64::from(60 * substeps);
        let law = |i: usize| {
            let tension = G * masses[i..].iter().sum::<f32>();
            let weight = 1.0 / masses[i] + if i > 1 { 1.0 / masses[i - 1] } else { 0.0 };
            f64::from(tension * weight) * h * h * f64::from(n - 1)
        };
        let expected = (1..n as usize).map(law).fold(0.0, f64::max);
        let options = chain::options(f32::INFINITY, masses, vec![0], substeps, Backend::Cpu);
        let mut deformer = Deformer::new(&chain::straight(n, 1.0), options).unwrap();
        play(&mut deformer, 240, &Attributes { gravity: Vec3::X * G, damping: 4.0, ..Attributes::default() });
        let measured = f64::from(deformer.measure().unwrap().max_strain);
        assert!(off(measured, expected) < bound, "mass ratio {ratio}: strain {measured} for {expected}");
    }
}

// Small free vibrations.

const N: u32 = 17;
const STILL: Vec3 = Vec3::ZERO;

/// Frequency of a lattice with spacing `1/(n - 1)` relative to the continuum's, for half a wave in 1 m.
fn lattice(n: u32) -> f64 {
    let half = 0.5 * PI / f64::from(n - 1);
    half.sin() / half
}

fn half_wave(x: f32) -> f32 {
    (std::f32::consts::PI * x).sin()
}

/// The points, displaced upward by 0.2 mm times `f`.
fn raised(x: &[Vec3], f: impl Fn(Vec3) -> f32) -> Vec<Vec3> {
    x.iter().map(|&x| x + Vec3::Y * (2e-4 * f(x))).collect()
}

/// Amplitude of the mode `f` of the shape `x` in some heights.
fn share(now: &[Vec3], x: &[Vec3], f: impl Fn(Vec3) -> f32) -> f64 {
    now.iter().zip(x).map(|(now, &x)| f64::from(now.y * f(x))).sum()
}

/// Amplitude of the mode `f` of the taut shape, sampled each frame.
fn vibrate(deformer: &mut Deformer, frames: u32, taut: &[Vec3], f: impl Fn(Vec3) -> f32) -> Vec<f64> {
    deformer.set_state(&raised(taut, &f), &vec![Vec3::ZERO; taut.len()]).unwrap();
    let sample = |_| {
        play(deformer, 1, &Attributes { gravity: STILL, ..Attributes::default() });
        share(deformer.positions().unwrap(), taut, &f)
    };
    (0..frames).map(sample).collect()
}

/// Share of the amplitude lost between the first and the last third of a second.
fn decay(samples: &[f64]) -> f64 {
    1.0 - amplitude(&samples[samples.len() - 20..]) / amplitude(&samples[..20])
}

/// A string at rest that has the given strain when it is 1 m long, and masses that give it rho then.
fn slack_string(strain: f32) -> (Mesh, Vec<f32>) {
    let spacing = 1.0 / (N - 1) as f32;
    (chain::straight(N, 1.0 / (1.0 + strain)), vec![RHO * spacing * spacing / (1.0 + strain); N as usize])
}

fn string(backend: Backend) {
    let substeps = (2.0 * resolved(N, K)).ceil() as u32;
    // At a strain of 2 % it shows whether a stretched edge still follows Hooke's law.
    for tension in [10.0, 100.0] {
        let (slack, masses) = slack_string(tension / K);
        let mut deformer = Deformer::new(&slack, chain::options(K, masses, vec![0, N - 1], substeps, backend)).unwrap();
        let taut = chain::straight(N, 1.0).positions;
        let samples = vibrate(&mut deformer, 180, &taut, |x| half_wave(x.x));
        let f1 = f64::from(tension / RHO).sqrt() / 2.0;
        let (measured, expected) = (frequency(&samples, f64::from(FRAME)), f1 * lattice(N));
        assert!(off(measured, expected) < 5e-3, "T = {tension}: {measured} Hz for {expected}");
        assert!(decay(&samples) < 1e-3, "T = {tension}: decays by {}", decay(&samples));
    }
}

#[test]
fn plain_xpbd_is_out_of_tune() {
    let substeps = (2.0 * resolved(N, K)).ceil() as u32;
    let (slack, masses) = slack_string(10.0 / K);
    let springs = reference::springs(&slack, f64::from(K));
    let taut = chain::straight(N, 1.0).positions;
    let start = raised(&taut, |x| half_wave(x.x));
    let mut plain = Baseline::new(Scheme::Plain, start, springs, &masses, &[0, N - 1]);
    plain.gravity = STILL;
    let sample = |_| {
        plain.play(1, substeps);
        share(&plain.x, &taut, |x| half_wave(x.x))
    };
    let samples: Vec<f64> = (0..180).map(sample).collect();
    assert!(off(frequency(&samples, f64::from(FRAME)), 3.5355 * lattice(N)) > 5e-3);
    assert!(decay(&samples) > 1e-3);
}

/// A square of threads in both directions. Its diagonals are scaled to 0, because they all run the same way and would
/// pull it askew.
fn membrane(backend: Backend) {
    let strain = 10.0 / K;
    let side = 1.0 / (1.0 + strain);
    let mesh = Mesh::grid(N, N, side, side);
    let on_border = |v: &u32| [v / N, v % N].iter().any(|&k| k == 0 || k == N - 1);
    let straight = |&[i, j]: &[u32; 2]| if j - i == N - 1 { 0.0 } else { 1.0 };
    let options = Options {
        backend,
        quality: Quality::Substeps((2.0 * resolved(N, K)).ceil() as u32),
        fabric: Fabric { density: RHO, stretch: K, ..Fabric::default() },
        pinned: (0..N * N).filter(on_border).collect(),
        mass: Some(vec![RHO / ((N - 1) * (N - 1)) as f32; (N * N) as usize]),
        edge_scale: Some(mesh.edges().iter().map(straight).collect()),
        ..Options::default()
    };
    let mut deformer = Deformer::new(&mesh, options).unwrap();
    let taut = Mesh::grid(N, N, 1.0, 1.0).positions;
    let samples = vibrate(&mut deformer, 60, &taut, |x| half_wave(x.x + 0.5) * half_wave(x.z + 0.5));
    let (measured, expected) = (frequency(&samples, f64::from(FRAME)), 5.000 * lattice(N));
    assert!(off(measured, expected) < 5e-3, "{measured} Hz for {expected}");
}

/// Bessel function of order 0, from its series.
fn j0(x: f64) -> f64 {
    let next = |term: &mut f64, k: i32| {
        *term *= -x * x / f64::from(4 * k * k);
        Some(*term)
    };
    1.0 + (1..40).scan(1.0, next).sum::<f64>()
}

#[test]
fn hanging_chain() {
    let n = 65;
    let masses = chain::ribbon_masses(n, RHO);
    let options = chain::options(K, masses.clone(), vec![0], (2.0 * resolved(n, K)).ceil() as u32, Backend::Cpu);
    let rest = chain::straight(n, 1.0);
    let mut deformer = Deformer::new(&rest, options).unwrap();
    // Its three slowest modes at once, each J0(j sqrt(1 - x)), on the stretched shape.
    let modes = [(2.404_826, 0.59939), (5.520_078, 1.37585), (8.653_728, 2.15689)];
    let mode = |zero: f64, x: f32| j0(zero * f64::from(1.0 - x).sqrt());
    let swung = |x: &Vec3| {
        let stretched = x.x + RHO * G / K * (x.x - 0.5 * x.x * x.x);
        Vec3::new(stretched, modes.iter().map(|&(zero, _)| 2e-4 * mode(zero, x.x) as f32).sum(), 0.0)
    };
    let start: Vec<Vec3> = rest.positions.iter().map(swung).collect();
    deformer.set_state(&start, &vec![Vec3::ZERO; start.len()]).unwrap();
    let mut heights = Vec::new();
    for _ in 0..45 {
        play(&mut deformer, 4, &Attributes { gravity: Vec3::X * G, ..Attributes::default() });
        heights.push(deformer.positions().unwrap().to_vec());
    }
    for (zero, expected) in modes {
        let part = |((now, rest), &mass): ((&Vec3, &Vec3), &f32)| f64::from(mass * now.y) * mode(zero, rest.x);
        let samples: Vec<f64> =
            heights.iter().map(|now| now.iter().zip(&rest.positions).zip(&masses).map(part).sum::<f64>()).collect();
        let measured = frequency(&samples, 4.0 * f64::from(FRAME));
        assert!(off(measured, expected) < 5e-3, "{measured} Hz for {expected}");
    }
}
