//! A minute of scenes that keep moving, or should not, with levels: the energy stays bounded and there are no sudden
//! jumps.

mod common;

use std::f32::consts::TAU;

use cloth_deformer::glam::{Quat, Vec3};
use cloth_deformer::{Attributes, Backend, Collider, Deformer, Fabric, Levels, Mesh, Options, Quality};

use common::{FRAME, meshes};

/// Frames in a minute, and in its first third.
const FRAMES: usize = 3600;
const EARLY: usize = 1200;

/// Figures of a frame. Velocities are over whole frames, as they are visible.
struct Frame {
    /// Energy (J).
    energy: f64,
    /// Mean strain over the edges.
    strain: f32,
    /// The largest change of a free vertex's velocity since the last frame, and its largest speed (m/s).
    kick: f32,
    speed: f32,
}

/// Plays a minute; `attributes` is a function of the time (s) at a frame's end.
fn minute(mesh: &Mesh, options: Options, attributes: impl Fn(f32) -> Attributes) -> Vec<Frame> {
    let mut free = vec![true; mesh.positions.len()];
    options.pinned.iter().for_each(|&v| free[v as usize] = false);
    let mut deformer = Deformer::new(mesh, options).unwrap();
    let mut before = vec![[Vec3::ZERO; 2]; mesh.positions.len()];
    before.iter_mut().zip(&mesh.positions).for_each(|(before, x)| before[0] = *x);
    let mut frames = Vec::with_capacity(FRAMES);
    for frame in 1..=FRAMES {
        let report = deformer.step(FRAME, &attributes(frame as f32 * FRAME)).unwrap();
        assert!(report.levels > 0, "levels run");
        let measure = deformer.measure().unwrap();
        assert!(measure.penetration <= 1e-6, "frame {frame}: {} m inside", measure.penetration);
        let (mut kick, mut speed) = (0.0_f32, 0.0_f32);
        for ((x, before), _) in deformer.positions().unwrap().iter().zip(&mut before).zip(&free).filter(|(_, free)| **free) {
            let velocity = (*x - before[0]) / FRAME;
            (kick, speed) = (kick.max(velocity.distance(before[1])), speed.max(velocity.length()));
            *before = [*x, velocity];
        }
        frames.push(Frame {
            energy: measure.kinetic_energy + measure.potential_energy,
            strain: measure.mean_strain,
            kick,
            speed,
        });
    }
    frames
}

/// The largest value of a figure over some frames.
fn most(frames: &[Frame], figure: impl Fn(&Frame) -> f64) -> f64 {
    frames.iter().map(figure).fold(f64::NEG_INFINITY, f64::max)
}

fn options(substeps: u32, fabric: Fabric, pinned: Vec<u32>) -> Options {
    Options { backend: Backend::Cpu, quality: Quality::Substeps(substeps), fabric, pinned, ..Options::default() }
}

const FABRIC: Fabric = Fabric { density: 0.2, stretch: 5000.0, bending: 1e-4, damping: 0.06 };

/// Released over a ball on the floor, a sheet comes to rest and stays at rest.
#[test]
fn a_drape_comes_to_rest() {
    let mut mesh = Mesh::grid(49, 49, 1.0, 1.0);
    mesh.positions.iter_mut().for_each(|x| x.y = 0.7);
    let colliders = vec![Collider::plane(Vec3::ZERO, Vec3::Y), Collider::sphere(Vec3::Y * 0.3, 0.3)];
    let frames = minute(&mesh, options(20, FABRIC, Vec::new()), |_| Attributes {
        colliders: colliders.clone(),
        damping: 0.5,
        ..Attributes::default()
    });
    let late = &frames[EARLY..];
    println!(
        "drape: after 20 s speed <= {:.1e} m/s, kick <= {:.1e} m/s, strain <= {:.1e}, energy {:.5} J, {:.5} J at the end",
        most(late, |frame| frame.speed.into()),
        most(late, |frame| frame.kick.into()),
        most(late, |frame| frame.strain.into()),
        late[0].energy,
        frames[FRAMES - 1].energy,
    );
    assert!(most(late, |frame| frame.speed.into()) < 1e-2, "it is at rest");
    assert!(most(late, |frame| frame.energy) <= late[0].energy + 1e-4);
}

/// Asserts that the motion continues as it began: no figure of the last forty seconds is far from that of the first
/// twenty.
fn goes_on(name: &str, frames: &[Frame], fastest: f64, strain: f64) {
    let [early, late] = [&frames[..EARLY], &frames[EARLY..]].map(|frames| {
        let mean = frames.iter().map(|frame| f64::from(frame.strain)).sum::<f64>() / frames.len() as f64;
        [
            most(frames, |frame| frame.energy),
            most(frames, |frame| frame.kick.into()),
            most(frames, |frame| frame.speed.into()),
            mean,
        ]
    });
    println!("{name}: at most energy, kick, speed; mean strain: {early:.3?} in the first 20 s, {late:.3?} after");
    assert!(late[0] <= 1.5 * early[0], "{name}: energy {} J, in the first 20 s {} J", late[0], early[0]);
    assert!(late[1] <= 2.0 * early[1], "{name}: kicks of {} m/s, in the first 20 s {} m/s", late[1], early[1]);
    assert!(early[2].max(late[2]) <= fastest, "{name}: {} m/s", early[2].max(late[2]));
    assert!(late[3] <= strain, "{name}: mean strain {}", late[3]);
}

/// A flag in a gale, with levels because they are asked for. Without them its mean strain is 4.5e-2 and its energy ten
/// times as high. At five times the substeps the mean strain is 2e-3, and kicks are up to 23 m/s as here.
#[test]
fn a_flag_in_a_gale_stays_a_flag() {
    let n = 33;
    let mut mesh = Mesh::grid(n, n, 1.0, 1.0);
    mesh.positions.iter_mut().for_each(|x| *x = Vec3::new(x.x, -x.z, 0.0));
    let pinned = (0..n).map(|row| row * n).collect();
    let frames = minute(&mesh, Options { levels: Levels::Count(9), ..options(20, FABRIC, pinned) }, |time| Attributes {
        wind: Vec3::new(30.0, 0.0, 6.0 * (5.0 * time).sin()),
        air_density: 1.2,
        ..Attributes::default()
    });
    goes_on("flag", &frames, 30.0, 0.036);
}

/// An open cone, used if the skirt's mesh is not available.
fn cone() -> Mesh {
    let (around, down) = (96_u32, 40_u32);
    let at = |v: u32| {
        let (turn, low) = ((v % around) as f32 / around as f32 * TAU, (v / around) as f32 / (down - 1) as f32);
        Vec3::new((0.2 + 0.3 * low) * turn.cos(), 0.1 - 0.2 * low, (0.2 + 0.3 * low) * turn.sin())
    };
    let quad = |v: u32| {
        let next = v / around * around + (v + 1) % around;
        [[v, next, v + around], [next, next + around, v + around]]
    };
    Mesh { positions: (0..around * down).map(at).collect(), triangles: (0..around * (down - 1)).flat_map(quad).collect() }
}

/// A skirt swung and rotated by its ring. Without levels its mean strain is 4.6e-2.
#[test]
fn a_swinging_skirt_stays_a_skirt() {
    let mesh = meshes::folder().map_or_else(cone, |folder| Mesh::load_obj(folder.join("skirt4K.obj")).unwrap());
    let top = mesh.positions.iter().map(|x| x.y).fold(f32::NEG_INFINITY, f32::max);
    let pinned: Vec<u32> = (0..mesh.positions.len() as u32).filter(|&v| mesh.positions[v as usize].y > top - 1e-4).collect();
    let ring: Vec<Vec3> = pinned.iter().map(|&v| mesh.positions[v as usize]).collect();
    let frames = minute(&mesh, options(20, FABRIC, pinned), |time| {
        // The amplitude grows from 0, so that the start is not a jerk.
        let grown = (0.5 * time).min(1.0);
        let turn = Quat::from_rotation_y(0.8 * grown * (TAU * 0.7 * time).sin());
        let lead = Vec3::new(0.15 * (TAU * time).sin(), 0.05 * (TAU * 1.3 * time).sin(), 0.0) * grown;
        Attributes { pin_targets: Some(ring.iter().map(|x| turn * *x + lead).collect()), damping: 0.5, ..Attributes::default() }
    });
    goes_on("skirt", &frames, 20.0, 0.012);
}
