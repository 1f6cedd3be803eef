//! Contact of cloth with itself on the GPU, compared with the CPU: no frame has an intersection, and distances and strains
//! agree. Results repeat bit for bit, also with little initial room for pairs and when
//! continuing from snapshots.
#![cfg(feature = "gpu")]

mod common;

use std::f32::consts::PI;
use std::sync::Arc;

use cloth_deformer::glam::{Quat, Vec3};
use cloth_deformer::{Attributes, Backend, Collider, Deformer, Fabric, Levels, Mesh, StepError, Warning};
use common::contact_scene::{R, Scene, floor, fold};
use common::crossings::{closest, crossings};
use common::shapes::{ball, jittered, sheets};
use common::{FRAME, bits, device, play};

impl Scene {
    /// Steps it on the GPU, where no frame may have an intersection, and on the CPU. Returns both at the end, with
    /// their mean strains.
    fn played(&self, frames: u32) -> ([Deformer; 2], [f32; 2]) {
        let (mut both, mut strain) = ([Backend::Gpu, Backend::Cpu].map(|backend| self.on(backend)), [0.0; 2]);
        for frame in 1..=frames {
            for (deformer, strain) in both.iter_mut().zip(&mut strain) {
                deformer.step(FRAME, &self.attributes).unwrap();
                if 2 * frame > frames {
                    *strain += deformer.measure().unwrap().mean_strain / (frames / 2) as f32;
                }
            }
            let found = crossings(&self.mesh, both[0].positions().unwrap());
            assert!(found.is_empty(), "frame {frame}: {found:?}");
        }
        (both, strain)
    }

    /// The smallest distances (m) at the end and the mean strains of the second half, on the GPU and on the CPU.
    fn compared(&self, frames: u32) -> ([f64; 2], [f32; 2], [Deformer; 2]) {
        let (mut both, strain) = self.played(frames);
        let apart = both.each_mut().map(|one| closest(&self.mesh, one.positions().unwrap()));
        println!("closest {apart:?} m, mean strain {strain:?}, tallies {:?}", both.each_ref().map(Deformer::contact_tally));
        (apart, strain, both)
    }
}

fn heap(n: u32) -> Scene {
    let mut mesh = jittered(Mesh::grid(n, n, 1.0, 1.0), 2);
    let turn = Quat::from_rotation_x(1.5);
    mesh.positions.iter_mut().for_each(|x| *x = turn * *x + Vec3::Y * 0.55);
    Scene::new(mesh, 20, vec![floor()])
}

#[test]
fn a_folded_sheet_lies_on_itself() {
    let scene = fold(16);
    let (apart, strain, [mut gpu, _]) = scene.compared(40);
    assert!(apart[0] > 0.98 * f64::from(R), "its halves are {} m apart", apart[0]);
    assert!((strain[0] - strain[1]).abs() < 0.1 * strain[1], "mean strains {strain:?}");
    let measure = gpu.measure().unwrap();
    assert!(measure.kinetic_energy < 1e-7, "it lies still: {} J", measure.kinetic_energy);
}

#[test]
fn a_sheet_dropped_on_its_edge_makes_a_heap() {
    let (apart, strain, _) = heap(14).compared(40);
    assert!(apart[0] > 0.5 * f64::from(R), "{} m apart, {} m on the CPU", apart[0], apart[1]);
    assert!(strain[0] < 1.2 * strain[1], "mean strains {strain:?}");
}

#[test]
fn a_towel_falls_over_a_sphere() {
    let mut mesh = jittered(Mesh::grid(22, 22, 1.2, 1.2), 4);
    mesh.positions.iter_mut().for_each(|x| x.y += 0.62);
    let mut scene = Scene::new(mesh, 30, vec![Collider::sphere(0.3 * Vec3::Y, 0.3), floor()]);
    scene.options.fabric = Fabric::TOWEL;
    let (apart, strain, _) = scene.compared(40);
    assert!(apart[0] > 0.5 * apart[1].min(f64::from(R)), "{apart:?} m apart");
    assert!(strain[0] < 1.2 * strain[1], "mean strains {strain:?}");
}

/// Repeated after a reset, with room for hardly any pair at first, continued from a snapshot by another cloth, and with
/// sums that workgroups collect, as they do for very many pairs.
#[test]
fn the_same_bits_every_time() {
    let scene = heap(12);
    let mut first = scene.on(Backend::Gpu);
    play(&mut first, 10, &scene.attributes);
    let snapshot = first.snapshot().unwrap();
    play(&mut first, 14, &scene.attributes);
    assert!(first.contact_tally()[2] > 100, "many pairs are listed: {:?}", first.contact_tally());
    let bits_of_first = bits(&mut first);

    let mut other = scene.on(Backend::Gpu);
    other.contact_room(3).unwrap();
    play(&mut other, 24, &scene.attributes);
    assert!(bits(&mut other) == bits_of_first, "with little room at first");
    other.restore(&snapshot).unwrap();
    play(&mut other, 14, &scene.attributes);
    assert!(bits(&mut other) == bits_of_first, "from a snapshot");
    assert_eq!(other.snapshot().unwrap(), first.snapshot().unwrap());
    first.reset();
    first.collect_contact_from(1);
    play(&mut first, 24, &scene.attributes);
    assert!(bits(&mut first) == bits_of_first, "after a reset, with collected sums");
}

/// A list without room is counted once, and then has room for twice as many pairs, whenever in a step it overflowed.
#[test]
fn room_grows_to_what_is_needed() {
    let mut scene = heap(12);
    // With levels it falls so that all the room is needed at once.
    scene.options.levels = Levels::Off;
    let mut cloth = scene.on(Backend::Gpu);
    cloth.contact_room(3).unwrap();
    let (mut most, mut rooms) = (0, vec![cloth.has_contact_room()]);
    for frame in 0..24 {
        cloth.step(FRAME, &scene.attributes).unwrap();
        let [_, _, listed, _] = cloth.contact_tally();
        most = most.max(listed as usize);
        let room = cloth.has_contact_room();
        if rooms.last() != Some(&room) {
            // More may have been listed within the step than at its end.
            assert!(room <= 2 * (2 * most).next_multiple_of(64), "frame {frame}: room for {room} pairs, {most} listed");
            rooms.push(room);
        }
    }
    println!("room for {rooms:?} pairs, at most {most} listed");
    assert!(rooms.len() > 3, "it grew several times: {rooms:?}");
}

/// The same bits with a ball of triangles that turns, then stands still, below cloth that falls on it.
#[test]
fn the_same_bits_every_time_on_a_mesh() {
    let mut mesh = jittered(Mesh::grid(12, 12, 0.5, 0.5), 7);
    mesh.positions.iter_mut().for_each(|x| x.y += 0.24);
    let scene = Scene::new(mesh, 20, Vec::new());
    let round = ball(Vec3::ZERO, 0.2, 8);
    let play = |cloth: &mut Deformer, frames: std::ops::Range<u32>| {
        for frame in frames {
            let turn = Quat::from_rotation_y(0.03 * frame.min(16) as f32);
            let positions = round.positions.iter().map(|&x| turn * x).collect();
            let body = Mesh { positions, triangles: round.triangles.clone() };
            let colliders = vec![Collider::mesh(body.into()).with_id(1).with_friction(0.5)];
            cloth.step(FRAME, &Attributes { colliders, ..scene.attributes.clone() }).unwrap();
        }
    };
    let mut first = scene.on(Backend::Gpu);
    play(&mut first, 0..12);
    let snapshot = first.snapshot().unwrap();
    play(&mut first, 12..24);
    assert!(first.contact_tally()[2] > 50, "many pairs are listed: {:?}", first.contact_tally());
    let bits_of_first = bits(&mut first);

    let mut other = scene.on(Backend::Gpu);
    play(&mut other, 0..1);
    other.contact_room(3).unwrap();
    play(&mut other, 1..24);
    assert!(bits(&mut other) == bits_of_first, "with little room at first");
    other.restore(&snapshot).unwrap();
    play(&mut other, 12..24);
    assert!(bits(&mut other) == bits_of_first, "from a snapshot");
    // Which pairs are listed that are not near depends on when detection looked, which may depend on what came before the
    // snapshot. That changes no bit later either.
    play(&mut first, 24..36);
    play(&mut other, 24..36);
    assert!(bits(&mut other) == bits(&mut first), "from a snapshot, later");
    first.reset();
    play(&mut first, 0..24);
    assert!(bits(&mut first) == bits_of_first, "after a reset");
}

/// Calm cloth is searched for pairs once in many substeps, which the list must cover from the first one on: here the search is renewed
/// because a plate was teleported to the cloth, and then the plate moves through where it hangs.
#[test]
fn a_list_covers_the_substeps_until_the_next_search() {
    let upright = Quat::from_rotation_x(0.5 * PI);
    let mut mesh = jittered(Mesh::grid(13, 13, 0.6, 0.6), 3);
    mesh.positions.iter_mut().for_each(|x| *x = upright * *x);
    let plate = Mesh::grid(3, 3, 0.1, 0.1);
    let plate_at = |z: f32| {
        let positions = plate.positions.iter().map(|&x| upright * x + z * Vec3::Z).collect();
        Collider::mesh(Arc::new(Mesh { positions, ..plate.clone() }))
    };
    for gap in [3.0, 4.0, 5.0, 5.5, 6.0] {
        let mut scene = Scene::new(mesh.clone(), 20, vec![plate_at(1.0)]);
        scene.options.pinned = (0..13).collect();
        let mut deformer = scene.on(Backend::Gpu);
        for _ in 0..12 {
            deformer.step(FRAME, &scene.attributes).unwrap();
        }
        let end = plate_at((6.0 - gap) * R);
        for collider in [plate_at(-gap * R).teleported(), end.clone(), end] {
            let attributes = Attributes { colliders: vec![collider], ..scene.attributes.clone() };
            let warnings = deformer.step(FRAME, &attributes).unwrap().warnings;
            assert!(warnings.is_empty(), "{gap} thicknesses away: {warnings:?}");
        }
        let center = deformer.positions().unwrap()[6 * 13 + 6];
        let apart = center.z / R - (6.0 - gap);
        assert!(apart > 0.5, "a plate from {gap} thicknesses away has come to {apart} thicknesses");
    }
}

/// A step that fails because too many pairs are close leaves what contact knows as it was: sheets that lie on one another go on bit for
/// bit as if it had not been tried. Here a plate flies off so fast that each of its features may meet each of theirs.
#[test]
fn a_crowded_step_leaves_no_trace() {
    let plate = Mesh::grid(8, 8, 0.5, 0.5);
    let plate_at = |at: Vec3| {
        let positions = plate.positions.iter().map(|&x| x + at).collect();
        Collider::mesh(Arc::new(Mesh { positions, ..plate.clone() })).with_id(1)
    };
    let mut scene = Scene::new(jittered(sheets(3, 14, 0.5, 0.02), 4), 20, vec![floor(), plate_at(-0.05 * Vec3::Y)]);
    scene.options.gpu = Some(device("a small one", |limits| limits.max_storage_buffer_binding_size = 4 << 20));
    let [mut one, mut other] = [(); 2].map(|()| scene.on(Backend::Gpu));
    let mut contacts = 0;
    for frame in 0..16 {
        contacts = one.step(FRAME, &scene.attributes).unwrap().contacts;
        if frame == 2 || frame == 10 {
            let wild = Attributes { colliders: vec![floor(), plate_at(Vec3::splat(40.0))], ..scene.attributes.clone() };
            let before = other.snapshot().unwrap();
            let error = other.step(FRAME, &wild).unwrap_err();
            assert!(matches!(error, StepError::Crowded { .. }), "{error}");
            assert!(other.snapshot().unwrap() == before, "frame {frame}");
        }
        other.step(FRAME, &scene.attributes).unwrap();
        assert!(bits(&mut one) == bits(&mut other), "frame {frame}");
    }
    assert!(contacts > 0, "the sheets touch");
}

/// A sheet that initially passes through another: a warning says so, nothing explodes, and parts that are pulled out
/// are held after that.
#[test]
fn a_start_that_crosses_is_let_go_until_it_parts() {
    let mut mesh = jittered(Mesh::grid(9, 9, 0.6, 0.6), 8);
    let held = mesh.positions.len() as u32;
    let upright = Quat::from_rotation_y(0.4) * Quat::from_rotation_x(0.5 * PI);
    let other = jittered(Mesh::grid(7, 7, 0.3, 0.3), 9);
    mesh.positions.extend(other.positions.iter().map(|&x| upright * x + 0.05 * Vec3::Y));
    mesh.triangles.extend(other.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + held)));
    let mut scene = Scene::new(mesh, 12, Vec::new());
    let top: Vec<u32> = (held..held + 49).filter(|&v| scene.mesh.positions[v as usize].y > 0.19).collect();
    scene.options.pinned = (0..held).chain(top).collect();
    let mut deformer = scene.on(Backend::Gpu);
    let start = crossings(&scene.mesh, &scene.mesh.positions);
    assert!(start.len() > 5, "{} crossings at the start", start.len());
    let lifted = |v: u32, by: f32| scene.mesh.positions[v as usize] + if v < held { Vec3::ZERO } else { by * Vec3::Y };
    let mut last = start.len();
    for frame in 0..70 {
        // It is pulled up and out, then lowered onto the other sheet.
        let by = if frame < 25 { frame as f32 / 85.0 } else { ((50.0 - frame as f32) / 85.0).max(-0.1) };
        let targets = scene.options.pinned.iter().map(|&v| lifted(v, by)).collect();
        let attributes = Attributes { pin_targets: Some(targets), ..scene.attributes.clone() };
        let report = deformer.step(FRAME, &attributes).unwrap();
        let now = crossings(&scene.mesh, deformer.positions().unwrap()).len();
        assert!(now <= 2 * start.len(), "frame {frame}: {last} crossings became {now}");
        assert!(now == 0 || last > 0, "frame {frame}: nothing crossed, and now {now} do");
        let told = report.warnings.iter().any(|warning| matches!(warning, Warning::Crossings { .. }));
        assert_eq!(told, last > 0, "frame {frame}: what crosses at a step's start is reported");
        last = now;
        let fastest = deformer.velocities().unwrap().iter().map(|v| v.length()).fold(0.0, f32::max);
        assert!(fastest < 5.0, "frame {frame}: {fastest} m/s");
    }
    assert_eq!(last, 0, "it was drawn out, and held when it came back");
}
