//! The instability watch: each kind of failure is reported with its cause, and nothing that is merely violent is taken
//! for one.

mod common;

use std::sync::Arc;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{
    Attributes, Backend, Collider, Contact, Deformer, Fabric, Instability, Levels, Mesh, Method, Options, Quality, StepError,
    Warning,
};

use common::{FRAME, top};

on_every_backend!(what_is_not_finite_is_named, springs_that_run_away_are_named, a_cloth_that_is_torn_apart_is_named);

/// Steps until one fails, then reads the state. Returns the number of steps and the error. A GPU may report a failure
/// late, in a later step or in this read.
fn until_it_fails(deformer: &mut Deformer, most: u32, mut step: impl FnMut(u32) -> (f32, Attributes)) -> (u32, StepError) {
    for taken in 0..most {
        let (dt, attributes) = step(taken);
        if let Err(error) = deformer.step(dt, &attributes).and_then(|_| deformer.positions().map(|_| ())) {
            return (taken, error);
        }
    }
    panic!("it lasted for {most} steps");
}

fn what_is_not_finite_is_named(backend: Backend) {
    let mesh = Mesh::grid(5, 4, 1.0, 1.0);
    let options = Options { backend, pinned: vec![0], ..Options::default() };
    let mut deformer = Deformer::new(&mesh, options).unwrap();
    for round in 0..2 {
        (0..3).for_each(|_| drop(deformer.step(FRAME, &Attributes::default()).unwrap()));
        let before = deformer.positions().unwrap().to_vec();
        let thrown = common::gale(&Attributes::default());
        let (_, error) = until_it_fails(&mut deformer, 1, |_| (FRAME, thrown.clone()));
        let StepError::Unstable { vertex, cause, step, remedy } = &error else { panic!("{error}") };
        assert!(matches!(cause, Instability::NotFinite { vertex: v } if v == vertex && *v < 20), "{error}");
        assert_eq!(*step, 4, "round {round}: {error}");
        assert!(remedy.contains("smaller attributes") && error.to_string().contains("in step 4"), "{error}");
        assert_eq!(deformer.positions().unwrap(), before, "the last good step's");
        deformer.reset();
    }
}

/// Substeps 1.5 times as long as is stable, one per step: unstable modes grow fourfold in each.
fn springs_that_run_away_are_named(backend: Backend) {
    let mesh = Mesh::grid(9, 9, 1.0, 1.0);
    let (method, quality) = (Method::Springs, Quality::Substeps(1));
    let options = Options { backend, method, quality, pinned: vec![0, 8], ..Options::default() };
    let mut deformer = Deformer::new(&mesh, options).unwrap();
    let needed = deformer.forecast(FRAME, &Attributes::default()).unwrap().explicit.unwrap();
    let dt = 1.5 * FRAME / needed;
    let mut good = Vec::new();
    let mut failed = None;
    for step in 1..400 {
        good.clear();
        good.extend_from_slice(deformer.positions().unwrap());
        if let Err(error) = deformer.step(dt, &Attributes::default()).and_then(|_| deformer.positions().map(|_| ())) {
            failed = Some((step, error));
            break;
        }
    }
    let (step, error) = failed.expect("it runs away");
    println!("{error}");
    let StepError::Unstable { cause: Instability::Energy { vertex, speed }, step: named, .. } = error else { panic!("{error}") };
    assert_eq!(named, step);
    assert!(vertex < 81 && vertex != 0 && vertex != 8, "a free vertex: {vertex}");
    assert_eq!(deformer.positions().unwrap(), good, "the last good step's");
    // The bound is on the RMS speed of the whole cloth, by mass; the restored state is below it.
    let measure = deformer.measure().unwrap();
    let rms = (2.0 * measure.kinetic_energy / f64::from(Fabric::default().density)).sqrt();
    assert!(rms < f64::from(speed), "{rms} m/s is no more than {speed} m/s");
    assert!(rms > 0.02 * f64::from(speed), "it was stopped as soon as it passed {speed} m/s, from {rms} m/s");
}

/// Two pins are moved apart slowly, for as long as it takes.
fn a_cloth_that_is_torn_apart_is_named(backend: Backend) {
    let mesh = Mesh::grid(3, 2, 1.0, 1.0);
    let options = Options { backend, pinned: vec![0, 5], quality: Quality::Substeps(10), ..Options::default() };
    let mut deformer = Deformer::new(&mesh, options).unwrap();
    let [a, b] = [mesh.positions[0], mesh.positions[5]];
    let away = (b - a).normalize();
    let led = |step: u32| {
        let targets = vec![a, b + away * (0.2 * (step + 1) as f32)];
        (FRAME, Attributes { gravity: Vec3::ZERO, pin_targets: Some(targets), ..Attributes::default() })
    };
    let (taken, error) = until_it_fails(&mut deformer, 3000, led);
    println!("after {taken} steps: {error}");
    let StepError::Unstable { cause: Instability::Edge { ends, length }, step, remedy, .. } = &error else { panic!("{error}") };
    assert_eq!(*step, taken + 1);
    assert!(mesh.edges().contains(&[ends[0].min(ends[1]), ends[0].max(ends[1])]), "{ends:?} is an edge");
    assert!(remedy.contains("set_state"), "{remedy}");
    let x = deformer.positions().unwrap();
    let now = x[ends[0] as usize].distance(x[ends[1] as usize]);
    assert!((0.95 * length..length + 8.0 * 0.2).contains(&now), "it is {now} m long, and {length} m are allowed");
    let stretched = 1.0 + 0.2 * taken as f32;
    assert!(stretched > 8.0 * 2.0_f32.sqrt(), "many times the cloth: {stretched} m");
}

/// If nobody reads the state, as when it is only drawn, a later step soon reports the failure.
#[cfg(feature = "gpu")]
#[test]
fn a_gpu_that_nobody_reads_says_so_late() {
    for n in [5, 40] {
        let options = Options { backend: Backend::Gpu, quality: Quality::Substeps(4), pinned: vec![0], ..Options::default() };
        let mut deformer = Deformer::new(&Mesh::grid(n, n, 1.0, 1.0), options).unwrap();
        (0..2).for_each(|_| drop(deformer.step(FRAME, &Attributes::default()).unwrap()));
        let before = deformer.positions().unwrap().to_vec();
        deformer.step(FRAME, &common::gale(&Attributes::default())).unwrap();
        let later = (0..24).find_map(|_| {
            deformer.wait().unwrap();
            deformer.step(FRAME, &Attributes::default()).err()
        });
        let Some(StepError::Unstable { cause: Instability::NotFinite { .. }, step, .. }) = later else { panic!("{later:?}") };
        assert_eq!(step, 3);
        assert_eq!(deformer.positions().unwrap(), before, "the last good step's");
        // The cloth continues from the restored state.
        deformer.step(FRAME, &Attributes::default()).unwrap();
        assert_ne!(deformer.positions().unwrap(), before);
    }
}

/// A scene: its name, mesh and options, and its attributes in each frame.
type Scene = (&'static str, Mesh, Options, Box<dyn Fn(u32) -> Attributes>);

/// Violent scenes, none of which is a failure.
fn wild() -> Vec<Scene> {
    let n = 20;
    let sheet = || Mesh::grid(n, n, 1.0, 1.0);
    let options = |substeps: u32| Options { quality: Quality::Substeps(substeps), ..Options::default() };
    let ball = |frame: u32| {
        // Thrown at 50 m/s from ten meters below.
        let center = Vec3::new(0.0, -10.0 + 50.0 * FRAME * frame as f32, 0.0);
        Attributes { colliders: vec![Collider::sphere(center, 0.3)], ..Attributes::default() }
    };
    let air = |wind: Vec3| Attributes { wind, air_density: 1.225, ..Attributes::default() };
    let gusts = move |frame: u32| air(if (frame / 10).is_multiple_of(2) { Vec3::new(40.0, 0.0, 5.0) } else { Vec3::ZERO });
    let led = |by: f32| {
        move |frame: u32| {
            let at =
                Vec3::new(-0.5, 0.0, -0.5) + by * Vec3::new((frame as f32 * 0.7).sin(), (frame as f32 * 0.5).cos() - 1.0, 0.0);
            Attributes { pin_targets: Some(vec![at]), ..Attributes::default() }
        }
    };
    let stiff = |stretch: f32| Fabric { stretch, ..Fabric::default() };
    let still = |_: u32| Attributes::default();
    let slack = Fabric { density: 0.03, stretch: 50.0, ..Fabric::default() };
    let lone = |substeps: u32| Options { pinned: vec![0], ..options(substeps) };
    let hung = |substeps: u32| Options { pinned: top(n), ..options(substeps) };
    vec![
        ("a ball at 50 m/s, few substeps", sheet(), hung(5), Box::new(ball)),
        (
            "a ball at 50 m/s, four corners",
            sheet(),
            Options { pinned: vec![0, n - 1, n * n - n, n * n - 1], ..options(40) },
            Box::new(ball),
        ),
        ("a ball at 50 m/s, nothing pinned", sheet(), options(20), Box::new(ball)),
        ("a gale in gusts", sheet(), Options { fabric: slack, ..hung(20) }, Box::new(gusts)),
        ("a gale on one pin", sheet(), Options { fabric: slack, ..lone(20) }, Box::new(gusts)),
        ("a pin shaken by a meter", sheet(), lone(20), Box::new(led(1.0))),
        ("a pin that jumps by 20 m", sheet(), lone(20), Box::new(led(20.0))),
        ("a pin that jumps by 20 m, a substep a frame", sheet(), lone(1), Box::new(led(20.0))),
        ("inextensible", sheet(), Options { fabric: stiff(f32::INFINITY), ..lone(20) }, Box::new(still)),
        ("stiff, many substeps", sheet(), Options { fabric: stiff(1e8), ..lone(400) }, Box::new(still)),
        // Its own weight stretches it to a hundred times its length.
        ("soft as a cobweb", sheet(), Options { fabric: stiff(0.02), ..hung(10) }, Box::new(still)),
        (
            "soft, one cell",
            Mesh::grid(2, 2, 1.0, 1.0),
            Options { fabric: stiff(0.02), pinned: vec![0, 1], ..options(10) },
            Box::new(still),
        ),
        ("relaxed once", sheet(), Options { method: Method::Relaxation { iterations: 1 }, ..lone(1) }, Box::new(still)),
        (
            "springs at their limit",
            sheet(),
            Options { method: Method::Springs, quality: Quality::default(), ..lone(1) },
            Box::new(still),
        ),
        (
            "one substep, no levels",
            Mesh::grid(60, 60, 1.0, 1.0),
            Options { levels: Levels::Off, pinned: vec![0], ..options(1) },
            Box::new(still),
        ),
        ("a strip of slivers", Mesh::grid(20, 20, 1e-3, 1.0), Options { pinned: vec![0], ..options(20) }, Box::new(still)),
    ]
}

#[test]
fn what_is_wild_but_stable_raises_no_alarm() {
    for (name, mesh, options, attributes) in wild() {
        let mut deformer = Deformer::new(&mesh, Options { backend: Backend::Cpu, ..options }).unwrap();
        for frame in 0..150 {
            deformer.step(FRAME, &attributes(frame)).unwrap_or_else(|error| panic!("{name}, frame {frame}: {error}"));
        }
    }
}

/// In a long free fall, the speed is as large as the time explains.
#[test]
fn a_long_fall_raises_no_alarm() {
    let mut deformer =
        Deformer::new(&Mesh::grid(3, 3, 1.0, 1.0), Options { quality: Quality::Substeps(1), ..Options::default() }).unwrap();
    for step in 0..6000 {
        deformer.step(0.1, &Attributes::default()).unwrap_or_else(|error| panic!("step {step}: {error}"));
    }
    let v = deformer.velocities().unwrap()[4].y;
    assert!((v / (-9.81 * 600.0) - 1.0).abs() < 1e-3, "ten minutes of fall: {v} m/s");
}

/// The state that was set is part of what explains the motion.
#[test]
fn a_state_that_is_set_raises_no_alarm() {
    let mesh = Mesh::grid(12, 12, 1.0, 1.0);
    let mut random = fastrand::Rng::with_seed(3);
    for (far, fast) in [(30.0_f32, 0.0_f32), (0.0, 5000.0), (300.0, 300.0)] {
        let options = Options { backend: Backend::Cpu, pinned: vec![0], quality: Quality::Substeps(20), ..Options::default() };
        let mut deformer = Deformer::new(&mesh, options).unwrap();
        let mut any = |size: f32| Vec3::from_array([0; 3].map(|_: i32| size * (2.0 * random.f32() - 1.0)));
        let x: Vec<Vec3> = mesh.positions.iter().map(|&x| x + any(far)).collect();
        let v: Vec<Vec3> = mesh.positions.iter().map(|_| any(fast)).collect();
        deformer.set_state(&x, &v).unwrap();
        for frame in 0..120 {
            let stepped = deformer.step(FRAME, &Attributes::default());
            stepped.unwrap_or_else(|error| panic!("{far} m, {fast} m/s, frame {frame}: {error}"));
        }
    }
}

/// A sweep carries an impulse by about one edge per substep: 1/8 m in 1/600 s.
#[test]
fn what_outruns_the_substeps_is_warned_of() {
    let mesh = Mesh::grid(9, 9, 1.0, 1.0);
    let options = Options { backend: Backend::Cpu, quality: Quality::Substeps(10), pinned: vec![3, 0], ..Options::default() };
    let diagonal = 2.0_f32.sqrt() / 8.0;
    for ratio in [0.9, 1.1] {
        let by = ratio * 10.0 * diagonal;
        let mut deformer = Deformer::new(&mesh, options.clone()).unwrap();
        let [a, b] = [mesh.positions[3], mesh.positions[0]];
        let far = |x: f32| Collider::sphere(Vec3::new(x, -2.0, 0.0), 0.5);
        let scene = |a: Vec3, x: f32| Attributes {
            pin_targets: Some(vec![a, b]),
            colliders: vec![Collider::default(), far(x)],
            gravity: Vec3::ZERO,
            ..Attributes::default()
        };
        assert_eq!(deformer.step(FRAME, &scene(a, 0.0)).unwrap().warnings, []);
        let forecast = deformer.forecast(FRAME, &scene(a + by * Vec3::Y, by)).unwrap();
        let warnings = deformer.step(FRAME, &scene(a + by * Vec3::Y, by)).unwrap().warnings;
        assert_eq!(forecast.warnings, warnings);
        if ratio < 1.0 {
            assert_eq!(warnings, []);
            continue;
        }
        let [
            Warning::PinOutruns { pin: 0, speed, carried },
            Warning::ColliderOutruns { collider: 1, speed: of_ball, carried: by_substeps },
        ] = warnings[..]
        else {
            panic!("{warnings:?}")
        };
        assert!((speed / (60.0 * by) - 1.0).abs() < 1e-3 && (of_ball / (60.0 * by) - 1.0).abs() < 1e-3, "{warnings:?}");
        assert!((carried / (600.0 * diagonal) - 1.0).abs() < 1e-3 && carried == by_substeps, "{warnings:?}");
        let mut put = scene(a + by * Vec3::Y, 0.0);
        put.colliders[1] = put.colliders[1].clone().teleported();
        assert_eq!(deformer.step(FRAME, &put).unwrap().warnings, [], "what is put there has no speed");
    }
}

/// Cloth that is thrown at what stands still is no better off than cloth that stands still and is hit as fast: with contact and few
/// substeps both let it sink in and say so, and by default both take the substeps that it needs, from the first step on.
#[test]
fn what_is_thrown_outruns_contact_as_what_is_hit_does() {
    let mesh = Mesh::grid(31, 31, 1.0, 1.0);
    let hit = |quality: Quality, flies: bool| {
        let options = Options { backend: Backend::Cpu, quality, contact: Some(Contact::default()), ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        let by = if flies { (-20.0, 0.0) } else { (0.0, 20.0) };
        cloth.set_state(&mesh.positions, &vec![Vec3::Y * by.0; mesh.positions.len()]).unwrap();
        let ball = |frame: u8| vec![Collider::sphere(Vec3::Y * (by.1 * f32::from(frame) / 60.0 - 0.3), 0.2)];
        cloth.place_colliders(&ball(0)).unwrap();
        let mut told = 0;
        let depths = (1..=6).map(|frame| {
            let scene = Attributes { colliders: ball(frame), gravity: Vec3::ZERO, ..Attributes::default() };
            let warnings = cloth.step(FRAME, &scene).unwrap().warnings;
            told += warnings.iter().filter(|warning| matches!(warning, Warning::ColliderOutruns { collider: 0, .. })).count();
            cloth.measure().unwrap().penetration
        });
        (depths.fold(0.0, f32::max), told)
    };
    for quality in [Quality::Substeps(5), Quality::default()] {
        let [(thrown, told), (hit, told_of_hit)] = [true, false].map(|flies| hit(quality, flies));
        println!("{quality:?}: {thrown} m deep, told {told} times; hit, {hit} m and {told_of_hit}");
        match quality {
            Quality::Substeps(_) => {
                assert!(thrown > 0.02 && hit > 0.02 && told >= 2 && told_of_hit >= 2, "{told}, {told_of_hit}");
            }
            _ => assert!(thrown < 5e-3 && hit < 5e-3, "{thrown} and {hit} m deep"),
        }
    }
}

/// With contact, layers of cloth follow a collider by about the thickness in a substep. One that is faster sinks into them, and the
/// step says so, though a single layer gives way in time.
#[test]
fn what_outruns_contact_is_warned_of() {
    let one = Mesh::grid(61, 61, 1.2, 1.2);
    let mut two = one.clone();
    two.positions.extend(one.positions.iter().map(|x| *x + Vec3::Y * 0.006));
    two.triangles.extend(one.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + 61 * 61)));
    let contact = Some(Contact { thickness: 0.005, friction: 0.3 });
    let fabric = Fabric { bending: 1e-4, damping: 0.03, ..Fabric::COTTON };
    for (mesh, ratio, contact, is_fast, sunk) in [
        (&one, 0.5, contact, false, 0.0..1e-3),
        (&one, 2.5, contact, true, 0.0..1e-3),
        (&two, 0.5, contact, false, 0.0..1e-3),
        (&two, 2.5, contact, true, 0.01..0.2),
        (&two, 2.5, None, false, 0.0..1e-3),
    ] {
        let quality = Quality::Substeps(10);
        let options = Options { backend: Backend::Cpu, quality, contact, fabric, ..Options::default() };
        let mut deformer = Deformer::new(mesh, options).unwrap();
        let (mut deepest, mut is_told) = (0.0_f32, false);
        for step in 0..(32.0 / ratio) as u8 {
            let center = Vec3::Y * (0.05 * ratio * f32::from(step) - 0.25);
            let scene = |collider| Attributes { colliders: vec![collider], gravity: Vec3::ZERO, ..Attributes::default() };
            let report = deformer.step(FRAME, &scene(Collider::sphere(center, 0.2))).unwrap();
            is_told |= report.warnings.iter().any(|warning| matches!(warning, Warning::ColliderOutruns { collider: 0, .. }));
            deepest = deepest.max(deformer.measure().unwrap().penetration);
        }
        println!("{} vertices, {ratio} thicknesses a substep: {deepest} m deep", mesh.positions.len());
        assert_eq!(is_told, is_fast, "{ratio}");
        assert!(sunk.contains(&deepest), "{ratio} thicknesses a substep: {deepest} m deep");
    }
}

/// Where the cloth is measured, what is too far away to touch it is not warned of, and hides nothing that may.
#[test]
fn far_colliders_are_not_warned_of_and_hide_no_near_one() {
    let plate = |x: f32| {
        let mesh = Mesh::grid(2, 2, 1.0, 1.0);
        Mesh { positions: mesh.positions.iter().map(|at| *at + Vec3::new(x, 50.0, 0.0)).collect(), ..mesh }
    };
    let quality = Quality::Substeps(20);
    let contact = Some(Contact { thickness: 0.005, friction: 0.3 });
    let options = Options { backend: Backend::Cpu, quality, contact, pinned: (0..21).collect(), ..Options::default() };
    let mut deformer = Deformer::new(&Mesh::grid(21, 21, 0.4, 0.4), options).unwrap();
    let scene = |far: f32, near: f32| Attributes {
        colliders: vec![
            Collider::sphere(Vec3::new(far, 50.0, 0.0), 0.5),
            Collider::mesh(Arc::new(plate(far))),
            Collider::sphere(Vec3::Y * (near - 1.5), 0.5),
        ],
        ..Attributes::default()
    };
    let mut outran = Vec::new();
    for step in 0..20 {
        let [far, near] = [0.5 * step as f32, 0.13 * (step as f32 - 9.0).max(0.0)];
        let warnings = deformer.step(FRAME, &scene(far, near)).unwrap().warnings;
        outran.extend(warnings.into_iter().filter_map(|warning| match warning {
            Warning::ColliderOutruns { collider, .. } => Some((step, collider)),
            Warning::ContactOutruns { .. } => Some((step, usize::MAX)),
            _ => None,
        }));
    }
    // In the first step nothing is known of the cloth.
    assert!(outran.iter().all(|&(step, collider)| step <= 1 || collider == 2), "{outran:?}");
    assert!(outran.iter().any(|&(_, collider)| collider == 2), "the ball comes at 8 m/s, and carries at 6: {outran:?}");
}

/// Contact follows half the range of the pins' velocities up to a third of the thickness per substep, and a step that is faster
/// is forecast.
#[test]
fn what_outruns_contact_is_forecast() {
    let mesh = Mesh::grid(9, 9, 1.0, 1.0);
    let contact = Contact::default();
    let options = Options { quality: Quality::Substeps(10), pinned: vec![8, 0], contact: Some(contact), ..Options::default() };
    for ratio in [0.9, 1.1] {
        let mut deformer = Deformer::new(&mesh, options.clone()).unwrap();
        let by = 2.0 * ratio * 10.0 * contact.thickness / 3.0;
        let targets = vec![mesh.positions[8] + by * Vec3::Y, mesh.positions[0]];
        let scene = Attributes { pin_targets: Some(targets), ..Attributes::default() };
        let forecast = deformer.forecast(FRAME, &scene).unwrap();
        let warnings = deformer.step(FRAME, &scene).unwrap().warnings;
        assert_eq!(forecast.warnings, warnings);
        let outruns = warnings.iter().any(|warning| matches!(warning, Warning::ContactOutruns { .. }));
        assert_eq!(outruns, ratio > 1.0, "{warnings:?}");
    }
}
