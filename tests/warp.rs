//! A cloth that is moved as a whole continues as if the whole world had been moved: the laws do not depend on place or
//! direction.

#[macro_use]
mod common;

use cloth_deformer::glam::{Affine3A, Mat3, Quat, Vec3};
use cloth_deformer::{
    Attributes, Backend, Collider, Contact, Deformer, Fabric, Levels, Mesh, Options, Quality, Sleep, WarpError,
};
use common::{FRAME, play, rms};

on_every_backend!(
    a_warped_run_is_the_run_warped,
    a_character_is_teleported_without_a_kick,
    motions_that_are_not_rigid_are_refused
);

fn motion() -> Affine3A {
    let turn = Quat::from_axis_angle(Vec3::new(0.3, 1.0, -0.5).normalize(), 2.2);
    Affine3A::from_rotation_translation(turn, Vec3::new(3.0, -1.0, 2.0))
}

/// The attributes of a frame in a world that was moved by a rigid motion.
fn scene(frame: u32, moved: Affine3A) -> Attributes {
    let (point, turn) = (|x: Vec3| moved.transform_point3(x), |v: Vec3| moved.transform_vector3(v));
    let lift = Vec3::new(0.0, 0.3 * FRAME * frame as f32, 0.0);
    let pins = [Vec3::new(-0.5, 0.0, -0.5), Vec3::new(0.5, 0.0, -0.5)];
    Attributes {
        gravity: turn(Vec3::new(0.5, -9.81, 0.0)),
        wind: turn(Vec3::new(2.0, 0.5, 1.0)),
        air_density: 1.2,
        damping: 0.05,
        colliders: vec![
            Collider::sphere(point(Vec3::new(0.0, -0.25, 0.1)), 0.2),
            Collider::plane(point(Vec3::Y * -0.5), turn(Vec3::Y)),
        ],
        pin_targets: Some(pins.map(|pin| point(pin + lift)).to_vec()),
        ..Attributes::default()
    }
}

fn a_warped_run_is_the_run_warped(backend: Backend) {
    let fabric = Fabric { bending: 1e-3, damping: 0.05, ..Fabric::COTTON };
    let contact = Some(Contact { thickness: 0.01, ..Contact::default() });
    let (quality, levels) = (Quality::Substeps(15), Levels::Count(2));
    let options = Options { backend, fabric, quality, levels, contact, pinned: vec![0, 16], ..Options::default() };
    let mesh = Mesh::grid(17, 17, 1.0, 1.0);
    let [mut plain, mut warped] = [0, 1].map(|_| Deformer::new(&mesh, options.clone()).unwrap());
    let play = |cloth: &mut Deformer, frames: std::ops::Range<u32>, moved| {
        frames.for_each(|frame| _ = cloth.step(FRAME, &scene(frame, moved)).unwrap());
    };
    play(&mut plain, 0..12, Affine3A::IDENTITY);
    play(&mut warped, 0..6, Affine3A::IDENTITY);
    let before = warped.velocities().unwrap().to_vec();
    warped.warp(motion()).unwrap();
    for (velocity, before) in warped.velocities().unwrap().iter().zip(&before) {
        assert!(velocity.distance(motion().transform_vector3(*before)) < 1e-5);
    }
    play(&mut warped, 6..12, motion());
    let expected: Vec<Vec3> = plain.positions().unwrap().iter().map(|x| motion().transform_point3(*x)).collect();
    let apart = rms(warped.positions().unwrap(), &expected);
    // Positions are rounded to 2e-7 m out there, which a motion over a ball amplifies a hundred times.
    assert!(apart < 5e-5, "{apart}");
}

/// A cape held by its collar, carried along; then the character is put elsewhere and turned around.
fn a_character_is_teleported_without_a_kick(backend: Backend) {
    let mesh = Mesh::grid(11, 11, 0.8, 0.8);
    let options = Options { backend, pinned: (0..11).collect(), fabric: Fabric::COTTON, ..Options::default() };
    let far = Affine3A::from_rotation_translation(Quat::from_rotation_y(2.5), Vec3::new(40.0, 3.0, -25.0));
    let scene = |frame: u32, place: Affine3A| {
        let collar = |x: &Vec3| place.transform_point3(*x + Vec3::X * (1.5 * FRAME * frame as f32));
        let pin_targets = Some(mesh.positions[..11].iter().map(collar).collect());
        let body = Collider::sphere(place.transform_point3(Vec3::new(0.0, -0.5, -0.3)), 0.2);
        // Without damping, what is rounded in another place grows by a factor of two a frame, to some percent in the end.
        Attributes { pin_targets, colliders: vec![body], damping: 2.0, ..Attributes::default() }
    };
    let energies = |teleports: bool, warps: bool| {
        let mut cloth = Deformer::new(&mesh, options.clone()).unwrap();
        let mut energies = Vec::new();
        for frame in 1..=40 {
            let place = if teleports && frame > 20 { far } else { Affine3A::IDENTITY };
            if frame == 21 && warps {
                cloth.warp(far).unwrap();
            }
            let stepped = cloth.step(FRAME, &scene(frame, place));
            energies.push(if stepped.is_ok() {
                cloth.measure().map_or(f64::INFINITY, |m| m.kinetic_energy)
            } else {
                f64::INFINITY
            });
        }
        energies
    };
    let (plain, warped, thrown) = (energies(false, false), energies(true, true), energies(true, false));
    for (frame, (plain, warped)) in (1..).zip(plain.iter().zip(&warped)) {
        // A kick would show at once.
        let bound = if frame <= 26 { 1.005 } else { 1.05 };
        assert!(*warped < bound * plain + 1e-6, "frame {frame}: {warped} J, undisturbed {plain}");
    }
    assert!(thrown[20] > 100.0 * plain[20], "without a warp it is thrown: {} J", thrown[20]);
}

fn motions_that_are_not_rigid_are_refused(backend: Backend) {
    let mesh = Mesh::grid(4, 4, 1.0, 1.0);
    let mut cloth = Deformer::new(&mesh, Options { backend, pinned: vec![0], ..Options::default() }).unwrap();
    play(&mut cloth, 2, &Attributes::default());
    let before = cloth.positions().unwrap().to_vec();
    for (motion, problem) in [
        (Affine3A::from_scale(Vec3::splat(1.01)), "scales"),
        (Affine3A::from_mat3(Mat3::from_cols(Vec3::X, Vec3::new(0.1, 1.0, 0.0), Vec3::Z)), "shears"),
        (Affine3A::from_scale(Vec3::new(1.0, -1.0, 1.0)), "mirrors"),
        (Affine3A::from_scale(Vec3::ZERO), "scales"),
        (Affine3A::from_translation(Vec3::NAN), "not finite"),
        (Affine3A::from_mat3(Mat3::NAN), "not finite"),
    ] {
        let refusal = cloth.warp(motion).unwrap_err();
        assert!(matches!(refusal, WarpError::NotRigid { .. }) && refusal.to_string().contains(problem), "{refusal}");
    }
    let refusal = cloth.warp(Affine3A::from_translation(Vec3::X * 1e16)).unwrap_err();
    assert!(matches!(refusal, WarpError::TooFar { vertex: 0 }), "{refusal}");
    assert_eq!(cloth.positions().unwrap(), before);
    // A rotation rounded to single precision is accepted, and many of them do not deform the cloth.
    let turn = Affine3A::from_rotation_y(0.7);
    (0..200).for_each(|_| cloth.warp(turn).unwrap());
    let strain = cloth.measure().unwrap().max_strain;
    assert!(strain < 1e-3, "{strain}");
}

#[test]
fn a_warp_wakes_and_keeps_the_rest_shape() {
    let mesh = Mesh::grid(4, 4, 1.0, 1.0);
    let sleep = Some(Sleep { after: 0.05, ..Sleep::default() });
    let options = Options { backend: Backend::Cpu, sleep, pinned: (0..16).collect(), ..Options::default() };
    let mut cloth = Deformer::new(&mesh, options).unwrap();
    play(&mut cloth, 10, &Attributes::default());
    assert!(cloth.step(FRAME, &Attributes::default()).unwrap().asleep);
    cloth.warp(Affine3A::from_translation(Vec3::Y)).unwrap();
    assert!(!cloth.step(FRAME, &Attributes::default()).unwrap().asleep);
    assert_eq!(cloth.positions().unwrap()[5], mesh.positions[5] + Vec3::Y, "pins are where they were put");
    cloth.reset();
    assert_eq!(cloth.positions().unwrap(), mesh.positions);
}
