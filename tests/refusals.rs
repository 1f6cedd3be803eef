//! Every public function refuses invalid input, names the thing, the value and a remedy, and leaves the state alone.

#[macro_use]
mod common;

use std::sync::Arc;

use cloth_deformer::glam::{Affine3A, Quat, Vec3};
use cloth_deformer::{
    Attributes, Backend, BuildError, Collider, Contact, Deformer, Fabric, Mesh, Method, Options, Quality, Shape, StepError,
};
use common::FRAME;

fn build(mesh: &Mesh, options: Options) -> Result<Deformer, BuildError> {
    Deformer::new(mesh, Options { backend: Backend::Cpu, ..options })
}

/// Asserts that a message contains all of these words.
fn names(error: &impl ToString, parts: &[&str]) {
    let message = error.to_string();
    assert!(!message.contains('\n'), "one line: {message}");
    parts.iter().for_each(|part| assert!(message.contains(part), "{message:?} lacks {part:?}"));
}

#[test]
fn meshes_are_checked() {
    let grid = Mesh::grid(3, 3, 1.0, 1.0);
    names(&build(&Mesh::default(), Options::default()).unwrap_err(), &["no vertices", "at least one"]);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e16] {
        let mut mesh = grid.clone();
        mesh.positions[4].y = bad;
        names(&build(&mesh, Options::default()).unwrap_err(), &["vertex 4", &bad.to_string(), "finite"]);
    }
    let mut mesh = grid.clone();
    mesh.triangles[2][1] = 9;
    names(&build(&mesh, Options::default()).unwrap_err(), &["triangle 2", "vertex 9", "9 vertices"]);
}

#[test]
fn options_are_checked() {
    let grid = Mesh::grid(3, 3, 1.0, 1.0);
    let refuse = |options: Options, parts: &[&str]| names(&build(&grid, options).unwrap_err(), parts);
    let fabric = |change: fn(&mut Fabric, f32), value: f32| {
        let mut fabric = Fabric::default();
        change(&mut fabric, value);
        Options { fabric, ..Options::default() }
    };
    for bad in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e-35] {
        refuse(fabric(|f, x| f.density = x, bad), &["fabric.density", &bad.to_string()]);
    }
    for bad in [0.0, -1.0, f32::NAN, f32::NEG_INFINITY] {
        refuse(fabric(|f, x| f.stretch = x, bad), &["fabric.stretch", &bad.to_string()]);
    }
    for bad in [-1.0, f32::NAN, f32::INFINITY] {
        refuse(fabric(|f, x| f.bending = x, bad), &["fabric.bending", &bad.to_string()]);
        refuse(fabric(|f, x| f.damping = x, bad), &["fabric.damping", &bad.to_string()]);
        let mass = Some(vec![1.0, 1.0, 1.0, bad, 1.0, 1.0, 1.0, 1.0, 1.0]);
        refuse(Options { mass, ..Options::default() }, &["mass[3]", &bad.to_string()]);
        let mut scale = vec![1.0; grid.edges().len()];
        scale[5] = bad;
        refuse(Options { edge_scale: Some(scale), ..Options::default() }, &["edge_scale[5]", &bad.to_string()]);
        let mut scale = vec![1.0; 9];
        scale[5] = bad;
        refuse(Options { bending_scale: Some(scale), ..Options::default() }, &["bending_scale[5]", &bad.to_string()]);
    }
    refuse(Options { mass: Some(vec![0.0; 9]), ..Options::default() }, &["mass[0] = 0", "pinned"]);
    refuse(Options { mass: Some(vec![1.0; 8]), ..Options::default() }, &["mass has 8", "9 vertices"]);
    refuse(Options { edge_scale: Some(Vec::new()), ..Options::default() }, &["edge_scale has 0", "16 edges"]);
    refuse(Options { bending_scale: Some(vec![1.0; 8]), ..Options::default() }, &["bending_scale has 8", "9 vertices"]);
    refuse(Options { pinned: vec![0, 9], ..Options::default() }, &["pinned[1] = 9", "9 vertices"]);
    refuse(Options { pinned: vec![4, 0, 4], ..Options::default() }, &["pinned[2] = 4", "once"]);
    for thickness in [0.0, -1.0, f32::NAN, f32::INFINITY, 1e16] {
        let contact = Some(Contact { thickness, ..Contact::default() });
        refuse(Options { contact, ..Options::default() }, &["contact.thickness", &thickness.to_string(), "1e15 m"]);
    }
    // On both sides of the bounds that depend on the cloth: its size is 1 m, with as many as 64 x 64 vertices.
    let contact = |thickness| Options { contact: Some(Contact { thickness, ..Contact::default() }), ..Options::default() };
    refuse(contact(0.9e-4), &["contact.thickness = 0.00009 m on cloth 1 m across", "at least 0.0001", "choose more"]);
    refuse(contact(0.51), &["contact.thickness = 0.51 m on cloth 1 m across", "at most half", "choose less"]);
    refuse(contact(1e6), &["contact.thickness = 1000000 m", "at most half"]);
    let fine = Mesh::grid(64, 64, 1.0, 1.0);
    let error = build(&fine, contact(0.18)).unwrap_err();
    names(&error, &["contact.thickness = 0.18 m, within which a vertex has about", "choose less, or a coarser mesh"]);
    let small = Mesh::grid(64, 64, 0.01, 0.01);
    names(&build(&small, contact(0.005)).unwrap_err(), &["contact.thickness = 0.005 m", "choose less, or a coarser mesh"]);
    for (mesh, thickness) in [(&grid, 1.01e-4), (&grid, 0.5), (&fine, 1.01e-4), (&fine, 0.12)] {
        let mut cloth = build(mesh, contact(thickness)).unwrap();
        cloth.step(FRAME, &Attributes::default()).unwrap();
        assert!(cloth.positions().unwrap().iter().all(|x| x.is_finite()));
    }
    // Whatever is built can be stepped, for any thickness on cloth of any size.
    for (size, thickness) in (-6..=6).flat_map(|size| (-37..=15).map(move |thickness| (size, thickness))) {
        let [size, thickness] = [size, thickness].map(|exponent| 10.0_f32.powi(exponent));
        match build(&Mesh::grid(5, 5, size, size), contact(thickness)) {
            Ok(mut cloth) => assert!(cloth.step(1e-3, &Attributes::default()).is_ok(), "{thickness} m on {size} m"),
            Err(error) => names(&error, &["contact.thickness", "m across"]),
        }
    }
    for quality in [
        Quality::Substeps(0),
        Quality::Substeps(u32::MAX),
        Quality::Strain(0.0),
        Quality::Strain(f32::NAN),
        Quality::Strain(-0.1),
    ] {
        refuse(Options { quality, ..Options::default() }, &["quality", "must be"]);
    }
    for iterations in [0, u32::MAX] {
        refuse(Options { method: Method::Relaxation { iterations }, ..Options::default() }, &["iterations", "must be"]);
    }
    let rigid = Fabric { stretch: f32::INFINITY, ..Fabric::default() };
    refuse(Options { method: Method::Springs, fabric: rigid, ..Options::default() }, &["fabric.stretch", "SmallSteps"]);
}

on_every_backend!(
    steps_are_checked_and_leave_the_state,
    contact_refuses_leads_across_a_hundred_cloths,
    contact_refuses_a_cloth_in_one_place,
);

fn steps_are_checked_and_leave_the_state(backend: Backend) {
    let mesh = Mesh::grid(3, 3, 1.0, 1.0);
    let options = Options { backend, pinned: vec![0, 2], ..Options::default() };
    let mut deformer = Deformer::new(&mesh, options.clone()).unwrap();
    deformer.step(FRAME, &Attributes::default()).unwrap();
    let before = deformer.snapshot().unwrap();

    for dt in [-1.0, f32::NAN, f32::INFINITY, 1e-45] {
        let error = deformer.step(dt, &Attributes::default()).unwrap_err();
        assert!(matches!(error, StepError::TimeStep { .. }), "dt = {dt}: {error}");
    }
    names(&deformer.step(1e9, &Attributes::default()).unwrap_err(), &["substeps", "65536", "shorter dt"]);
    let bad = [f32::NAN, f32::INFINITY, 1e16, -1.0];
    let mut refuse = |attributes: Attributes, parts: &[&str]| {
        names(&deformer.step(FRAME, &attributes).unwrap_err(), parts);
        assert_eq!(deformer.snapshot().unwrap(), before);
    };
    let base = Attributes::default;
    for x in bad {
        let value = x.to_string();
        if x != -1.0 {
            let nowhere = Vec3::new(0.0, x, 0.0);
            let with =
                |collider: Collider| Attributes { colliders: vec![Collider::sphere(Vec3::NEG_Y, 0.1), collider], ..base() };
            refuse(Attributes { gravity: nowhere, ..base() }, &["gravity", &value, "1e15 m/s2"]);
            refuse(Attributes { wind: nowhere, ..base() }, &["wind", &value, "1e15 m/s"]);
            refuse(with(Collider::sphere(nowhere, 0.1)), &["colliders[1].center", &value, "1e15 m"]);
            refuse(with(Collider::rounded_box(nowhere, Vec3::ONE, Quat::IDENTITY, 0.0)), &["colliders[1].center", &value]);
            refuse(with(Collider::plane(nowhere, Vec3::Y)), &["colliders[1].point", &value]);
            refuse(with(Collider::capsule(nowhere, Vec3::Y, 0.1)), &["colliders[1].a", &value]);
            refuse(with(Collider::capsule(Vec3::ZERO, nowhere, 0.1)), &["colliders[1].b", &value]);
            refuse(Attributes { pin_targets: Some(vec![Vec3::ZERO, nowhere]), ..base() }, &["pin_targets[1]", &value, "1e15 m"]);
        }
        let with = |collider: Collider| Attributes { colliders: vec![Collider::sphere(Vec3::NEG_Y, 0.1), collider], ..base() };
        refuse(with(Collider::sphere(Vec3::ZERO, x)), &["colliders[1].radius", &value]);
        refuse(with(Collider::capsule(Vec3::ZERO, Vec3::X, x)), &["colliders[1].radius", &value]);
        refuse(with(Collider::tapered_capsule(Vec3::ZERO, 0.1, Vec3::X, x)), &["colliders[1].radius_b", &value]);
        refuse(
            with(Collider::rounded_box(Vec3::ZERO, Vec3::new(1.0, x, 1.0), Quat::IDENTITY, 0.0)),
            &["colliders[1].half.y", &value],
        );
        if x == 1e16 {
            continue;
        }
        refuse(Attributes { air_density: x, ..base() }, &["air_density", &value]);
        refuse(Attributes { drag: x, ..base() }, &["drag", &value]);
        refuse(Attributes { lift: x, ..base() }, &["lift", &value]);
        refuse(Attributes { damping: x, ..base() }, &["damping", &value]);
        refuse(with(Collider::rounded_box(Vec3::ZERO, Vec3::ONE, Quat::IDENTITY, x)), &["colliders[1].radius", &value]);
        refuse(with(Collider::sphere(Vec3::ZERO, 0.1).with_friction(x)), &["colliders[1].friction", &value]);
        if x != -1.0 {
            let nowhere = Vec3::new(0.0, x, 0.0);
            refuse(
                with(Collider::rounded_box(Vec3::ZERO, Vec3::ONE, Quat::from_xyzw(0.0, x, 0.0, 1.0), 0.0)),
                &["rotation", &value],
            );
            refuse(with(Collider::plane(Vec3::ZERO, nowhere)), &["colliders[1].normal", &value]);
        }
    }
    let still = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    for (rotation, radius, parts) in
        [(still, 0.1, ["rotation", "IDENTITY"]), (Quat::IDENTITY, 0.3, ["radius = 0.3", "least of half"])]
    {
        let colliders = vec![Collider::rounded_box(Vec3::ZERO, Vec3::new(1.0, 0.2, 1.0), rotation, radius)];
        refuse(Attributes { colliders, ..base() }, &parts);
    }
    refuse(Attributes { lift: 2.0, ..base() }, &["lift = 2", "drag = 1.28"]);
    refuse(Attributes { colliders: vec![Collider::plane(Vec3::ZERO, Vec3::ZERO)], ..base() }, &["normal", "direction"]);
    refuse(Attributes { pin_targets: Some(vec![Vec3::ZERO]), ..base() }, &["pin_targets has 1", "2 vertices"]);

    let (still, nine) = (vec![Vec3::ZERO; 9], mesh.positions.clone());
    let mut hole = nine.clone();
    hole[7].z = f32::NAN;
    names(&deformer.set_state(&nine[..8], &still).unwrap_err(), &["positions", "8 values", "9 vertices"]);
    names(&deformer.set_state(&nine, &still[..1]).unwrap_err(), &["velocities", "1 values"]);
    names(&deformer.set_state(&hole, &still).unwrap_err(), &["positions", "[7]", "NaN"]);
    names(&deformer.set_state(&nine, &[Vec3::splat(1e20); 9]).unwrap_err(), &["velocities", "[0]"]);
    assert_eq!(deformer.snapshot().unwrap(), before);
    // Far from the origin both the position and what is computed with, relative to `Deformer::origin`, have a bound.
    let far: Vec<Vec3> = nine.iter().map(|x| x.with_y(x.y + 9e14)).collect();
    let mut away = Deformer::new(&Mesh { positions: far, ..mesh.clone() }, options.clone()).unwrap();
    names(&away.set_state(&[Vec3::splat(-9e14); 9], &still).unwrap_err(), &["positions", "[0]", "1e15"]);

    // What was refused has no effect: the next step is that of a cloth that was never given it.
    let mut fresh = Deformer::new(&mesh, options).unwrap();
    fresh.step(FRAME, &Attributes::default()).unwrap();
    for deformer in [&mut deformer, &mut fresh] {
        deformer.step(FRAME, &Attributes::default()).unwrap();
    }
    assert_eq!(deformer.positions().unwrap(), fresh.positions().unwrap());
}

/// A cloth of 8 x 8 vertices whose size is 1 m from corner to corner, with contact.
fn napkin(backend: Backend, pinned: Vec<u32>) -> Deformer {
    let mesh = Mesh::grid(8, 8, 0.8, 0.6);
    let contact = Some(Contact::default());
    Deformer::new(&mesh, Options { backend, contact, pinned, quality: Quality::Substeps(4), ..Options::default() }).unwrap()
}

fn contact_refuses_leads_across_a_hundred_cloths(backend: Backend) {
    let mut cloth = napkin(backend, vec![0, 7]);
    let pins = [0, 7].map(|vertex| Mesh::grid(8, 8, 0.8, 0.6).positions[vertex]);
    let led = |far: f32| Attributes { pin_targets: Some(vec![pins[0], pins[1] + Vec3::X * far]), ..Attributes::default() };
    cloth.step(FRAME, &led(0.0)).unwrap();
    let before = cloth.snapshot().unwrap();
    for far in [101.0, 1e7, 1e14] {
        let error = cloth.step(FRAME, &led(far)).unwrap_err();
        names(&error, &["pin_targets[1]", "m from where", "100 times", "size of 1 m", "Deformer::warp"]);
        assert_eq!(cloth.snapshot().unwrap(), before);
    }
    cloth.step(FRAME, &led(99.0)).unwrap();
    // A teleport is no motion.
    cloth.reset();
    let away = 1e4 * Vec3::X;
    cloth.warp(Affine3A::from_translation(away)).unwrap();
    cloth.step(FRAME, &Attributes { pin_targets: Some(pins.map(|pin| pin + away).to_vec()), ..Attributes::default() }).unwrap();

    let mut cloth = napkin(backend, Vec::new());
    let body = |far: f32, teleported: bool| {
        let mut mesh = Mesh::grid(4, 4, 1.0, 1.0);
        mesh.positions.iter_mut().for_each(|x| x.y += far - 2.0);
        let colliders = vec![Collider::sphere(5.0 * Vec3::X, 0.1), Collider { teleported, ..Collider::mesh(Arc::new(mesh)) }];
        Attributes { colliders, ..Attributes::default() }
    };
    cloth.step(FRAME, &body(0.0, false)).unwrap();
    let before = cloth.snapshot().unwrap();
    for far in [101.0, 1e7, 1e14] {
        let error = cloth.step(FRAME, &body(far, false)).unwrap_err();
        names(&error, &["colliders[1].mesh", "100 times the cloth's size of 1 m", "say that it was teleported"]);
        assert_eq!(cloth.snapshot().unwrap(), before);
    }
    cloth.step(FRAME, &body(-99.0, false)).unwrap();
    cloth.step(FRAME, &body(1e6, true)).unwrap();
}

/// All pairs of a cloth of 32 x 32 vertices are six million, and more than contact lists. Those of 16 x 16 are not.
fn contact_refuses_a_cloth_in_one_place(backend: Backend) {
    let mut random = fastrand::Rng::with_seed(3);
    let mut vectors = |count: usize, size: f32| -> Vec<Vec3> {
        (0..count).map(|_| size * (Vec3::new(random.f32(), random.f32(), random.f32()) - 0.5)).collect()
    };
    for side in [32_u32, 16] {
        let mesh = Mesh::grid(side, side, 1.0, 1.0);
        let count = mesh.positions.len();
        let options = Options { backend, contact: Some(Contact::default()), quality: Quality::Substeps(2), ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        let still = vec![Vec3::ZERO; count];
        let starts = [
            ("in one point", still.clone(), still.clone()),
            ("in 1 mm", vectors(count, 1e-3), still.clone()),
            ("bursting", mesh.positions.clone(), vectors(count, 1e7)),
        ];
        for (name, x, v) in starts {
            cloth.set_state(&x, &v).unwrap();
            match cloth.step(FRAME, &Attributes::default()) {
                Err(error) if side == 32 => {
                    names(&error, &["contact", "as if the whole cloth were in one place", "spread it out"]);
                    assert!(cloth.positions().unwrap() == x && cloth.velocities().unwrap() == v, "{name}: another state");
                }
                stepped => assert!(side == 16 && stepped.is_ok(), "{side} x {side} vertices {name}: {stepped:?}"),
            }
        }
        // Faster than single precision resolves, all of it the same way.
        cloth.set_state(&mesh.positions, &vec![-1e14 * Vec3::Y; count]).unwrap();
        let _either = cloth.step(FRAME, &Attributes::default());
        cloth.reset();
        cloth.step(FRAME, &Attributes::default()).unwrap();
    }
}

/// The thickness that mesh colliders have without `Options::contact` is compared with the cloth, too.
#[test]
fn mesh_colliders_too_thick_for_the_cloth_are_refused() {
    let attributes = Attributes {
        colliders: vec![Collider::sphere(5.0 * Vec3::X, 0.1), Collider::mesh(Arc::new(Mesh::grid(4, 4, 0.01, 0.01)))],
        ..Attributes::default()
    };
    for (size, contact) in [(0.0099, None), (0.0101, None), (0.003, Some(Contact { thickness: 1e-3, ..Contact::default() }))] {
        let mut mesh = Mesh::grid(8, 8, size, size);
        mesh.positions.iter_mut().for_each(|x| x.y += 0.02);
        let mut cloth = build(&mesh, Options { contact, ..Options::default() }).unwrap();
        let before = cloth.snapshot().unwrap();
        match cloth.step(FRAME, &attributes) {
            Err(error) if size == 0.0099 => {
                names(&error, &["colliders[1].mesh", "0.005 m", "half of the cloth's 0.0099 m", "Options::contact"]);
                assert_eq!(cloth.snapshot().unwrap(), before);
            }
            stepped => assert!(size != 0.0099 && stepped.is_ok(), "{size} m: {stepped:?}"),
        }
    }
    // A mesh of which every vertex is near every other of the cloth.
    let mesh = Mesh::grid(32, 32, 0.011, 0.011);
    let mut cloth = build(&mesh, Options::default()).unwrap();
    let mut below = mesh.clone();
    below.positions.iter_mut().for_each(|x| *x = 0.3 * *x - 0.001 * Vec3::Y);
    let error = cloth.step(FRAME, &Attributes { colliders: vec![Collider::mesh(Arc::new(below))], ..Attributes::default() });
    names(&error.unwrap_err(), &["contact", "spread it out"]);
}

/// A hostile number.
fn number(random: &mut fastrand::Rng) -> f32 {
    match random.u32(0..12) {
        0 => f32::NAN,
        1 => f32::INFINITY,
        2 => -f32::INFINITY,
        3 => 0.0,
        4 => f32::MIN_POSITIVE,
        5 => 1e-45,
        6 => 1e30,
        7 => -1e10,
        _ => 4.0 * random.f32() - 2.0,
    }
}

fn vector(random: &mut fastrand::Rng) -> Vec3 {
    match random.u32(0..3) {
        0 => Vec3::new(number(random), number(random), number(random)),
        _ => Vec3::new(random.f32() - 0.5, random.f32() - 0.5, random.f32() - 0.5),
    }
}

/// Arbitrary input results in a clear error or a finite state, never in a panic.
#[test]
fn random_scenes_never_panic_nor_leave_the_numbers() {
    let mut random = fastrand::Rng::with_seed(21);
    let (mut built, mut stepped) = (0, 0);
    for _ in 0..3000 {
        let vertices = random.usize(1..9);
        let positions: Vec<Vec3> =
            (0..vertices)
                .map(|_| {
                    if random.u32(0..20) == 0 { vector(&mut random) } else { Vec3::new(random.f32(), random.f32(), random.f32()) }
                })
                .collect();
        let corner = |random: &mut fastrand::Rng| {
            let past_the_end = u32::from(random.u32(0..40) == 0);
            random.u32(0..vertices as u32 + past_the_end)
        };
        let triangles =
            (0..random.usize(0..9)).map(|_| [corner(&mut random), corner(&mut random), corner(&mut random)]).collect();
        let mesh = Mesh { positions, triangles };
        let sane = |random: &mut fastrand::Rng, value: f32| if random.u32(0..12) == 0 { number(random) } else { value };
        let fabric = Fabric {
            density: sane(&mut random, 0.2),
            stretch: sane(&mut random, 1000.0),
            bending: sane(&mut random, 1e-4),
            damping: sane(&mut random, 0.03),
        };
        let method =
            [Method::SmallSteps, Method::Relaxation { iterations: random.u32(0..4) }, Method::Springs][random.usize(0..3)];
        let quality = [Quality::Substeps(random.u32(0..9)), Quality::Strain(sane(&mut random, 0.1))][random.usize(0..2)];
        let pinned = (0..random.u32(0..3)).map(|_| corner(&mut random)).collect();
        let mass = (random.u32(0..4) == 0).then(|| (0..vertices).map(|_| sane(&mut random, 0.1)).collect());
        let options = Options { method, quality, fabric, pinned, mass, ..Options::default() };
        let pins = options.pinned.len();
        let Ok(mut deformer) = build(&mesh, options) else { continue };
        built += 1;
        for _ in 0..3 {
            let mut collider = match random.u32(0..5) {
                0 => Collider::sphere(vector(&mut random), sane(&mut random, 0.5)),
                1 => Collider::plane(vector(&mut random), vector(&mut random)),
                2 => {
                    let (a, b) = (vector(&mut random), vector(&mut random));
                    Collider::tapered_capsule(a, sane(&mut random, 0.3), b, sane(&mut random, 0.1))
                }
                3 => {
                    let (half, turn) = (vector(&mut random).abs(), vector(&mut random).extend(sane(&mut random, 0.5)));
                    Collider::rounded_box(vector(&mut random), half, Quat::from_vec4(turn), sane(&mut random, 0.0))
                }
                _ => Collider::capsule(vector(&mut random), vector(&mut random), sane(&mut random, 0.3)),
            };
            if random.bool() {
                collider.shape = Shape::Sphere { center: Vec3::ZERO, radius: 0.5 };
            }
            let attributes = Attributes {
                gravity: vector(&mut random) * 9.81,
                wind: vector(&mut random),
                air_density: sane(&mut random, 1.2),
                damping: sane(&mut random, 0.0),
                colliders: vec![collider],
                pin_targets: random.bool().then(|| (0..pins).map(|_| vector(&mut random)).collect()),
                ..Attributes::default()
            };
            let dt = sane(&mut random, FRAME);
            let before = deformer.positions().unwrap().to_vec();
            match deformer.step(dt.min(1.0), &attributes) {
                Ok(report) => {
                    stepped += 1;
                    assert!(report.substeps > 0 || dt == 0.0);
                }
                Err(error) => {
                    names(&error, &[]);
                    assert_eq!(deformer.positions().unwrap(), before, "{error}");
                }
            }
            assert!(deformer.positions().unwrap().iter().all(|x| x.is_finite()));
            assert!(deformer.velocities().unwrap().iter().all(|v| v.is_finite()));
            let measure = deformer.measure().unwrap();
            assert!(measure.mean_strain >= 0.0 && !measure.potential_energy.is_nan(), "{measure:?}");
        }
    }
    assert!(built > 500 && stepped > 500, "{built} built, {stepped} steps: the generator still makes good scenes");
}
