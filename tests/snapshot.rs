//! A run continues from a snapshot bit for bit, in the same cloth and in a fresh one, on every backend; bytes that are
//! not a snapshot of this cloth are rejected.

#[macro_use]
mod common;

use cloth_deformer::glam::{Quat, Vec3};
use cloth_deformer::{
    Attributes, Backend, Collider, Contact, Deformer, Fabric, Levels, Mesh, Method, Options, Quality, Sleep, Snapshot,
    StateError, StepReport,
};
use common::FRAME;

on_every_backend!(
    everything_goes_on_bit_for_bit,
    a_small_cloth_goes_on_in_one_workgroup,
    springs_and_relaxation_go_on,
    a_cloth_falls_asleep_on_time,
    a_snapshot_of_rest_is_a_reset,
    a_cloth_on_a_mesh_goes_on,
    a_cloth_on_a_mesh_is_reset
);

/// A cloth and what acts on it in each frame.
struct Scene {
    mesh: Mesh,
    options: Options,
    attributes: fn(u32) -> Attributes,
}

impl Scene {
    fn cloth(&self) -> Deformer {
        Deformer::new(&self.mesh, self.options.clone()).unwrap()
    }

    /// The bits of positions and velocities, and the report, of each of some frames.
    fn play(&self, cloth: &mut Deformer, frames: std::ops::Range<u32>) -> Vec<(StepReport, Vec<u32>)> {
        let step = |frame| {
            let report = cloth.step(dt(frame), &(self.attributes)(frame)).unwrap();
            (report, bits(cloth))
        };
        frames.map(step).collect()
    }

    /// Takes a snapshot in several frames, and asserts that the same steps follow in the same cloth and in a fresh one.
    fn goes_on(&self, at: &[u32], frames: u32) {
        let mut cloth = self.cloth();
        let (mut done, mut taken) = (Vec::new(), Vec::new());
        let mut last = 0;
        for &frame in at {
            done.extend(self.play(&mut cloth, last..frame));
            taken.push((frame, cloth.snapshot().unwrap()));
            last = frame;
        }
        done.extend(self.play(&mut cloth, last..frames));
        for (frame, snapshot) in taken {
            let expected = &done[frame as usize..];
            let read = Snapshot::from_bytes(&snapshot.to_bytes()).unwrap();
            let mut fresh = self.cloth();
            for (name, cloth) in [("the same", &mut cloth), ("a fresh", &mut fresh)] {
                cloth.restore(&read).unwrap();
                let again = self.play(cloth, frame..frames);
                for (number, (again, expected)) in (frame..).zip(again.iter().zip(expected)) {
                    assert_eq!(again.0, expected.0, "{name} cloth from frame {frame}: the report of frame {number}");
                    assert!(again.1 == expected.1, "{name} cloth from frame {frame}: frame {number} differs");
                }
            }
        }
    }
}

/// Steps (s) differ in length.
fn dt(frame: u32) -> f32 {
    if frame % 5 == 3 { 0.6 * FRAME } else { FRAME }
}

fn bits(cloth: &mut Deformer) -> Vec<u32> {
    let mut bits: Vec<u32> = cloth.positions().unwrap().iter().flat_map(Vec3::to_array).map(f32::to_bits).collect();
    bits.extend(cloth.velocities().unwrap().iter().flat_map(Vec3::to_array).map(f32::to_bits));
    bits
}

/// A sheet with two moving corners, in a wind that turns, over two moving colliders, one of them with an id; the list
/// changes.
fn moving(frame: u32) -> Attributes {
    let t = FRAME * frame as f32;
    let ball = Collider::sphere(Vec3::new(0.3 * (9.0 * t).sin(), -0.25, 0.1), 0.18).with_id(7);
    let bar = Collider::capsule(Vec3::new(-0.5, -0.3, 0.2 * t), Vec3::new(0.5, -0.3, 0.3 * t), 0.05);
    let turn = Quat::from_rotation_y(2.0 * t);
    let block = Collider::rounded_box(Vec3::new(0.0, -0.5, 0.3), Vec3::new(0.2, 0.1, 0.1), turn, 0.02).with_id(9);
    let leg = Collider::tapered_capsule(Vec3::new(0.4, -0.6, 0.0), 0.08, Vec3::new(0.4, -0.3, 0.1 * t), 0.05).with_id(8);
    let colliders = if frame % 4 == 1 { vec![bar, block, leg, ball] } else { vec![ball, bar, leg, block] };
    let lift = Vec3::new(0.1 * (5.0 * t).sin(), 0.2 * t, 0.0);
    let pins = [Vec3::new(-0.5, 0.0, -0.5), Vec3::new(0.5, 0.0, -0.5)];
    Attributes {
        wind: Vec3::new(4.0 * (3.0 * t).cos(), 0.5, 4.0 * (3.0 * t).sin()),
        air_density: 1.2,
        damping: 0.1,
        colliders,
        pin_targets: Some(pins.map(|pin| pin + lift).to_vec()),
        ..Attributes::default()
    }
}

/// Levels, bending in passes, tethers, wind, colliders, pins, a bound on strain, and contact.
fn everything(backend: Backend) -> Scene {
    let contact = Some(Contact { thickness: 0.01, ..Contact::default() });
    let fabric = Fabric { bending: 1e-3, damping: 0.05, ..Fabric::TOWEL };
    let (quality, levels) = (Quality::Strain(0.05), Levels::Count(2));
    let options = Options { backend, fabric, quality, levels, contact, pinned: vec![0, 23], ..Options::default() };
    Scene { mesh: Mesh::grid(24, 24, 1.0, 1.0), options, attributes: moving }
}

fn everything_goes_on_bit_for_bit(backend: Backend) {
    everything(backend).goes_on(&[2, 7], 11);
}

fn a_small_cloth_goes_on_in_one_workgroup(backend: Backend) {
    let attributes = |frame| Attributes { air_density: 0.0, wind: Vec3::ZERO, ..moving(frame) };
    let options = Options { backend, pinned: vec![0, 8], ..Options::default() };
    Scene { mesh: Mesh::grid(9, 9, 1.0, 1.0), options, attributes }.goes_on(&[0, 11], 16);
}

fn springs_and_relaxation_go_on(backend: Backend) {
    for method in [Method::Springs, Method::Relaxation { iterations: 4 }] {
        let fabric = Fabric { stretch: 200.0, bending: 1e-4, ..Fabric::default() };
        let options = Options { backend, method, fabric, pinned: vec![0, 8], ..Options::default() };
        Scene { mesh: Mesh::grid(9, 9, 1.0, 1.0), options, attributes: moving }.goes_on(&[4], 8);
    }
}

fn a_cloth_falls_asleep_on_time(backend: Backend) {
    let sleep = Some(Sleep { after: 0.2, ..Sleep::default() });
    let options = Options { backend, sleep, pinned: (0..25).collect(), ..Options::default() };
    let attributes = |_| Attributes { gravity: Vec3::ZERO, ..Attributes::default() };
    let scene = Scene { mesh: Mesh::grid(5, 5, 1.0, 1.0), options, attributes };
    scene.goes_on(&[6, 18], 24);
    let mut cloth = scene.cloth();
    assert!(scene.play(&mut cloth, 0..24).last().unwrap().0.asleep, "it never slept");
}

fn a_snapshot_of_rest_is_a_reset(backend: Backend) {
    let scene = everything(backend);
    let mut cloth = scene.cloth();
    let rest = cloth.snapshot().unwrap();
    let first = scene.play(&mut cloth, 0..4);
    cloth.restore(&rest).unwrap();
    assert!(scene.play(&mut cloth, 0..4) == first);
}

/// What contact knows of pairs determines how it holds them in the next substep: a heap continues as it was.
#[test]
fn a_folded_cloth_in_contact_goes_on() {
    let mut mesh = Mesh::grid(25, 25, 0.6, 0.6);
    mesh.positions.iter_mut().for_each(|x| *x = Vec3::new(x.z, x.x + 0.32, 0.02 * (9.0 * x.x).sin()));
    let contact = Some(Contact { thickness: 0.01, friction: 0.4 });
    let fabric = Fabric { bending: 1e-4, damping: 0.03, ..Fabric::COTTON };
    let options = Options { backend: Backend::Cpu, contact, fabric, quality: Quality::Substeps(10), ..Options::default() };
    let attributes = |_| Attributes { colliders: vec![Collider::plane(Vec3::ZERO, Vec3::Y)], ..Attributes::default() };
    let scene = Scene { mesh, options, attributes };
    let mut cloth = scene.cloth();
    assert!(scene.play(&mut cloth, 0..24).last().unwrap().0.contacts > 50, "nothing touches");
    scene.goes_on(&[21, 24], 28);
}

/// A cloth on a mesh collider that moves and turns.
fn on_a_mesh(backend: Backend) -> Scene {
    let mut mesh = Mesh::grid(13, 13, 0.5, 0.5);
    mesh.positions.iter_mut().for_each(|x| x.y += 0.02 + 0.001 * (50.0 * x.x).sin());
    let options = Options { backend, quality: Quality::Substeps(10), ..Options::default() };
    let attributes = |frame| {
        let mut body = Mesh::grid(4, 4, 0.7, 0.7);
        let (turn, by) = (Quat::from_rotation_y(0.3 * frame as f32), Vec3::new(0.01, 0.003, 0.0) * u32::min(frame, 9) as f32);
        body.positions.iter_mut().for_each(|x| *x = turn * *x + by);
        Attributes { colliders: vec![Collider::mesh(body.into()).with_id(3)], ..Attributes::default() }
    };
    Scene { mesh, options, attributes }
}

/// Mesh colliders are part of the state as well: their last positions, and what they hold. A snapshot of cloth on one
/// that stands still was once refused as altered. Their triangles are numbered by where they were at first, which
/// follows neither from the last positions nor from those that another cloth began with.
fn a_cloth_on_a_mesh_goes_on(backend: Backend) {
    let scene = on_a_mesh(backend);
    let mut cloth = scene.cloth();
    assert!(scene.play(&mut cloth, 0..12).last().unwrap().0.contacts > 20, "nothing touches");
    scene.goes_on(&[9, 13], 17);
    let snapshot = cloth.snapshot().unwrap();
    let expected = scene.play(&mut cloth, 12..15);
    let mut other = scene.cloth();
    scene.play(&mut other, 5..7);
    other.restore(&snapshot).unwrap();
    assert!(scene.play(&mut other, 12..15) == expected, "a cloth that met the mesh elsewhere");
}

/// A reset cloth does not remember where it met a mesh collider.
fn a_cloth_on_a_mesh_is_reset(backend: Backend) {
    let scene = on_a_mesh(backend);
    let expected = scene.play(&mut scene.cloth(), 0..12);
    let mut cloth = scene.cloth();
    scene.play(&mut cloth, 5..7);
    cloth.reset();
    assert!(scene.play(&mut cloth, 0..12) == expected);
}

/// The speed that a cloth was given is part of its state; otherwise the stability check could not explain such a speed.
#[test]
fn a_thrown_cloth_flies_on() {
    let fabric = Fabric { stretch: 1e-3, ..Fabric::default() };
    let options = Options { backend: Backend::Cpu, fabric, ..Options::default() };
    let scene = Scene { mesh: Mesh::grid(5, 5, 1.0, 1.0), options, attributes: |_| Attributes::default() };
    let mut cloth = scene.cloth();
    cloth.set_state(&scene.mesh.positions, &[Vec3::X * 50.0; 25]).unwrap();
    let snapshot = cloth.snapshot().unwrap();
    let mut fresh = scene.cloth();
    fresh.restore(&snapshot).unwrap();
    assert!(scene.play(&mut fresh, 0..3) == scene.play(&mut cloth, 0..3));
}

/// A small snapshot in the middle of a motion, and its cloth.
fn small() -> (Scene, Deformer, Snapshot) {
    let contact = Some(Contact::default());
    let options = Options { backend: Backend::Cpu, contact, pinned: vec![0, 4], ..Options::default() };
    let scene = Scene { mesh: Mesh::grid(5, 5, 1.0, 1.0), options, attributes: moving };
    let mut cloth = scene.cloth();
    scene.play(&mut cloth, 0..3);
    let snapshot = cloth.snapshot().unwrap();
    (scene, cloth, snapshot)
}

#[test]
fn altered_and_cut_bytes_are_refused() {
    let (_, _, snapshot) = small();
    let bytes = snapshot.to_bytes();
    for place in 0..bytes.len() {
        let mut altered = bytes.clone();
        altered[place] ^= 1 << (place % 8);
        let refusal = Snapshot::from_bytes(&altered).unwrap_err();
        let expected = match place {
            0..8 => matches!(refusal, StateError::Foreign),
            8..12 => matches!(refusal, StateError::Version { known: 16, .. }),
            _ => refusal == StateError::Altered,
        };
        assert!(expected, "byte {place}: {refusal:?}");
        assert!(Snapshot::from_bytes(&bytes[..place]).is_err(), "cut to {place} bytes");
    }
    assert!(Snapshot::from_bytes(&[&bytes[..], &[0]].concat()).is_err(), "a byte more");
    assert!(Snapshot::from_bytes(b"v 0 0 0\n").unwrap_err().to_string().contains("not a snapshot"));
}

/// FNV-1a, to make altered bytes with a valid hash.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let hash = bytes.iter().fold(0xcbf2_9ce4_8422_2325_u64, |h, &b| (h ^ u64::from(b)).wrapping_mul(0x0000_0100_0000_01b3));
    bytes.extend(hash.to_le_bytes());
    bytes
}

/// Altered bytes with a valid hash give some state or an error, but no panic.
#[test]
fn content_by_chance_breaks_nothing() {
    let (scene, mut cloth, snapshot) = small();
    let before = scene.play(&mut cloth, 3..5);
    let whole = snapshot.to_bytes();
    let content = &whole[..whole.len() - 8];
    let mut random = fastrand::Rng::with_seed(5);
    let mut refused = 0;
    for _ in 0..1500 {
        let mut bytes = content.to_vec();
        for _ in 0..random.usize(1..4) {
            let place = random.usize(12..bytes.len());
            bytes[place] = random.u8(..);
        }
        if random.u8(..) < 20 {
            bytes.truncate(random.usize(12..bytes.len()));
        }
        let Ok(read) = Snapshot::from_bytes(&sealed(bytes)) else {
            refused += 1;
            continue;
        };
        if cloth.restore(&read).is_ok() {
            // Such a motion may be violent; it is reported as unstable or stays finite.
            let stepped = cloth.step(FRAME, &moving(3));
            assert!(stepped.is_err() || cloth.positions().is_ok_and(|x| x.iter().all(|x| x.is_finite())));
        } else {
            refused += 1;
        }
    }
    assert!(refused > 300, "{refused} of 1500 refused");
    cloth.restore(&snapshot).unwrap();
    assert!(scene.play(&mut cloth, 3..5) == before);
}

#[test]
fn a_snapshot_of_another_cloth_is_refused() {
    let (scene, _, snapshot) = small();
    let other = |what: &'static str, change: fn(&mut Scene)| {
        let mut scene = Scene { mesh: scene.mesh.clone(), options: scene.options.clone(), attributes: moving };
        change(&mut scene);
        let mut cloth = scene.cloth();
        let before = scene.play(&mut cloth, 0..2);
        let refusal = cloth.restore(&snapshot).unwrap_err();
        assert_eq!(refusal, StateError::Other { what });
        assert!(refusal.to_string().contains(what) && refusal.to_string().contains("make the Deformer"), "{refusal}");
        cloth.reset();
        assert!(scene.play(&mut cloth, 0..2) == before, "{what}: the refusal changed the cloth");
    };
    other("mesh", |scene| scene.mesh.positions[3].y += 1e-6);
    other("mesh", |scene| scene.mesh.triangles.truncate(30));
    other("method", |scene| scene.options.method = Method::Relaxation { iterations: 2 });
    other("quality", |scene| scene.options.quality = Quality::Substeps(7));
    other("levels", |scene| scene.options.levels = Levels::Off);
    other("sleep", |scene| scene.options.sleep = Some(Sleep::default()));
    other("fabric", |scene| scene.options.fabric.damping = 0.1);
    other("pinned", |scene| scene.options.pinned = vec![4, 0]);
    other("mass", |scene| scene.options.mass = Some(vec![0.01; 25]));
    other("edge_scale", |scene| scene.options.edge_scale = Some(vec![0.9; scene.mesh.edges().len()]));
    other("bending_scale", |scene| scene.options.bending_scale = Some(vec![0.9; 25]));
    other("contact", |scene| scene.options.contact = None);
    #[cfg(feature = "gpu")]
    other("backend", |scene| scene.options.backend = Backend::Hybrid);
}

/// Another SIMD width rounds differently: it is detected and rejected.
#[test]
fn other_lanes_are_refused() {
    let scene = everything(Backend::Cpu);
    let mut cloth = scene.cloth();
    let lanes = cloth.at_most_lanes(16) as u32;
    if lanes == 4 {
        eprintln!("not tested: this processor has four lanes");
    }
    let wide = scene.play(&mut cloth, 0..3);
    let snapshot = cloth.snapshot().unwrap();
    for fewer in [8, 4].into_iter().filter(|&fewer| fewer < lanes) {
        let mut narrow = scene.cloth();
        let here = narrow.at_most_lanes(fewer as usize) as u32;
        assert!(scene.play(&mut narrow, 0..3) != wide, "{here} lanes give the bits of {lanes}: there is nothing to refuse");
        assert_eq!(narrow.restore(&snapshot).unwrap_err(), StateError::Lanes { taken: lanes, here });
    }
}

#[test]
fn serde_takes_the_bytes() {
    let (_, _, snapshot) = small();
    let text = serde_json::to_string(&snapshot).unwrap();
    assert_eq!(serde_json::from_str::<Snapshot>(&text).unwrap(), snapshot);
    let refusal = serde_json::from_str::<Snapshot>(&text.replacen("67", "68", 1)).unwrap_err();
    assert!(refusal.to_string().contains("not a snapshot"), "{refusal}");
}
