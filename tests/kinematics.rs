//! Motion without elasticity: free fall, the pendulum, moving pins.

#[macro_use]
mod common;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Contact, Deformer, Fabric, Mesh, Method, Options, Quality};
use common::{FRAME, play};

on_every_backend!(
    free_fall,
    pendulum,
    pins_reach_their_targets,
    a_change_of_frame_rate_keeps_the_fall,
    a_kick_spans_both_halves,
    gravity_acts_from_the_step_on_that_brings_it,
    a_pin_that_is_let_go_flies_on,
    cloth_that_parts_in_flight_flies_on
);

fn options(backend: Backend, substeps: u32) -> Options {
    Options { backend, quality: Quality::Substeps(substeps), ..Options::default() }
}

/// Free fall is `y = -g t²/2`. The first half kick makes it exact; a full one would be off by `h/t` = 8e-4.
fn free_fall(backend: Backend) {
    for method in [Method::SmallSteps, Method::Relaxation { iterations: 4 }] {
        let mut deformer = Deformer::new(&Mesh::grid(5, 5, 1.0, 1.0), Options { method, ..options(backend, 20) }).unwrap();
        play(&mut deformer, 60, &Attributes::default());
        for x in deformer.positions().unwrap() {
            let error = (f64::from(x.y) / (-9.81 / 2.0) - 1.0).abs();
            assert!(error <= 1e-5, "{method:?}: y(1 s) = {} m, {error:e} off", x.y);
        }
    }
}

/// The period of a pendulum is `T0 (2/pi) K(sin²(theta/2))`, released at 90 degrees, S = 20, for 12 s.
fn pendulum(backend: Backend) {
    // An inextensible thread of two vertices, 1 m long.
    let mesh = Mesh { positions: vec![Vec3::ZERO, Vec3::X], triangles: vec![[0, 1, 1]] };
    let fabric = Fabric { stretch: f32::INFINITY, ..Fabric::default() };
    // Steps of a single substep of 1/1200 s (S = 20), so that the motion between frames can be observed.
    let mut deformer = Deformer::new(&mesh, Options { fabric, pinned: vec![0], ..options(backend, 20) }).unwrap();
    let dt = f64::from(FRAME / 20.0);
    let frames = 12 * 1200;
    let (mut last, mut crossings, mut amplitude) = (90_f64.to_radians(), Vec::new(), 0.0_f64);
    for frame in 1..=frames {
        deformer.step(FRAME / 20.0, &Attributes::default()).unwrap();
        let x = deformer.positions().unwrap()[1];
        let angle = f64::from(x.x).atan2(f64::from(-x.y));
        if last > 0.0 && angle <= 0.0 {
            crossings.push((f64::from(frame) - angle / (angle - last)) * dt);
        }
        if frame > frames - 2500 {
            amplitude = amplitude.max(angle.abs());
        }
        last = angle;
    }
    let cycles = crossings.len() - 1;
    let measured = (crossings[cycles] - crossings[0]) / cycles as f64;
    let expected = 2.0 * std::f64::consts::PI * (1.0_f64 / 9.81).sqrt() * 1.180_340_6;
    println!("{backend:?}: period off by {:e}, amplitude {} degrees", measured / expected - 1.0, amplitude.to_degrees());
    assert!((measured / expected - 1.0).abs() <= 1e-5, "period {measured} s, expected {expected} s");
    assert!((amplitude.to_degrees() - 90.0).abs() <= 0.1, "amplitude {} degrees after 12 s", amplitude.to_degrees());
}

fn pins_reach_their_targets(backend: Backend) {
    let mesh = Mesh::grid(4, 4, 1.0, 1.0);
    let pinned = vec![2, 0, 3];
    let mut deformer = Deformer::new(&mesh, Options { pinned: pinned.clone(), ..options(backend, 7) }).unwrap();
    for frame in 1..=30 {
        let sway = Vec3::new(0.3 * (frame as f32 * 0.2).sin(), 0.01 * frame as f32, 0.0);
        let targets: Vec<Vec3> = pinned.iter().map(|&v| mesh.positions[v as usize] + sway).collect();
        let attributes = Attributes { pin_targets: Some(targets.clone()), ..Attributes::default() };
        deformer.step(FRAME, &attributes).unwrap();
        let positions = deformer.positions().unwrap();
        for (&v, target) in pinned.iter().zip(&targets) {
            assert!(
                positions[v as usize].distance(*target) <= 1e-7,
                "pin {v} lags by {}",
                positions[v as usize].distance(*target)
            );
        }
    }
    let held = deformer.positions().unwrap()[2];
    play(&mut deformer, 5, &Attributes::default());
    assert_eq!(deformer.positions().unwrap()[2], held, "without targets a pin stays where it was led");
    assert_eq!(deformer.velocities().unwrap()[2], Vec3::ZERO);
}

/// The kick between two steps spans half of each, so that a change of dt does not deflect the fall from its parabola.
fn a_change_of_frame_rate_keeps_the_fall(backend: Backend) {
    let mut deformer = Deformer::new(&Mesh::grid(2, 2, 1.0, 1.0), options(backend, 4)).unwrap();
    let mut time = 0.0;
    for frame in 0..40 {
        let dt = [1.0 / 30.0, 1.0 / 60.0, 1.0 / 144.0][frame % 3];
        deformer.step(dt, &Attributes::default()).unwrap();
        time += f64::from(dt);
    }
    let expected = -9.81 / 2.0 * time * time;
    let y = f64::from(deformer.positions().unwrap()[0].y);
    assert!((y / expected - 1.0).abs() <= 1e-4, "y = {y}, expected {expected}");
}

/// A state that is set has positions and velocities at the same time: thrown upward, it returns to where it was.
fn a_kick_spans_both_halves(backend: Backend) {
    let mesh = Mesh::grid(3, 3, 1.0, 1.0);
    let mut deformer = Deformer::new(&mesh, options(backend, 10)).unwrap();
    let up = vec![Vec3::new(0.0, 9.81 / 2.0, 0.0); 9];
    deformer.set_state(&mesh.positions, &up).unwrap();
    assert_eq!(deformer.velocities().unwrap(), up);
    play(&mut deformer, 60, &Attributes::default());
    let fallen = deformer.positions().unwrap()[4];
    assert!(fallen.length() <= 2e-5, "came back to {fallen}");
}

/// The way (m) and the velocity (m/s) after a time (s) under a constant acceleration (m/s²) and linear drag (1/s).
fn flight(v: f64, acceleration: f64, drag: f64, time: f64) -> [f64; 2] {
    let decay = (-drag * time).exp();
    let [gain, way] = if drag > 0.0 {
        let gain = -(-drag * time).exp_m1() / drag;
        [gain, (time - gain) / drag]
    } else {
        [time, 0.5 * time * time]
    };
    [v * gain + acceleration * way, v * decay + acceleration * gain]
}

/// Gravity, wind and drag that change between steps: the closed form of the fall. A kick by the new gravity from the middle of the last
/// substep on would miss it by 20 mm without drag, and by 13 mm with a constant one.
fn gravity_acts_from_the_step_on_that_brings_it(backend: Backend) {
    for drags in [[0.0, 0.0], [1.5, 1.5], [0.0, 6.0], [20.0, 0.5]] {
        let mut deformer = Deformer::new(&Mesh::grid(3, 3, 1.0, 1.0), options(backend, 2)).unwrap();
        let (mut y, mut v) = (0.0, 0.0);
        for frame in 0..60 {
            let gravity = [-9.81, 9.81, 0.0, -20.0][frame / 5 % 4];
            let (wind, damping) = (Vec3::Y * [0.0, 4.0][frame / 20 % 2], drags[frame / 7 % 2]);
            let scene = Attributes { gravity: Vec3::Y * gravity, wind, damping, ..Attributes::default() };
            deformer.step(FRAME, &scene).unwrap();
            let [by, after] = flight(v, f64::from(gravity + damping * wind.y), f64::from(damping), f64::from(FRAME));
            (y, v) = (y + by, after);
        }
        let error = f64::from(deformer.positions().unwrap()[4].y) - y;
        println!("{backend:?}, drag {drags:?}: {y} m, {error:e} m off");
        // A substep's displacement follows from its velocity halfway, which is as exact as the drag in it is small.
        let largest = f64::from(drags[0].max(drags[1]));
        assert!(error.abs() < 1e-5 + 2e-5 * largest, "drag {drags:?}: {error:e} m off");
    }
}

/// A pin that is let go flies on from its velocity, with drag, too.
fn a_pin_that_is_let_go_flies_on(backend: Backend) {
    let mesh = Mesh { positions: vec![Vec3::ZERO, Vec3::X], triangles: vec![] };
    let mut deformer = Deformer::new(&mesh, Options { pinned: vec![0], ..options(backend, 4) }).unwrap();
    let scene = |pin_targets| Attributes { damping: 4.0, pin_targets, ..Attributes::default() };
    for frame in 1..=3 {
        deformer.step(FRAME, &scene(Some(vec![Vec3::Z * (3.0 * FRAME * frame as f32)]))).unwrap();
    }
    deformer.set_pinned(vec![]).unwrap();
    play(&mut deformer, 12, &scene(None));
    let time = f64::from(12.0 * FRAME);
    let expected = Vec3::new(0.0, flight(0.0, -9.81, 4.0, time)[0] as f32, 0.15 + flight(3.0, 0.0, 4.0, time)[0] as f32);
    let x = deformer.positions().unwrap()[0];
    assert!(x.distance(expected) < 1e-4, "{x} instead of {expected}");
}

/// Separating two sheets that cross leaves their fall as it was.
fn cloth_that_parts_in_flight_flies_on(backend: Backend) {
    let mut mesh = Mesh::grid(8, 8, 0.5, 0.5);
    let tilted: Vec<Vec3> = mesh.positions.iter().map(|x| *x + Vec3::Y * (0.05 + 0.4 * x.x)).collect();
    mesh.triangles.extend(mesh.triangles.clone().iter().map(|corners| corners.map(|corner| corner + 64)));
    mesh.positions.extend(tilted);
    let contact = Some(Contact { thickness: 0.004, friction: 0.3 });
    let mut deformer = Deformer::new(&mesh, Options { contact, ..options(backend, 4) }).unwrap();
    let mean = |x: &[Vec3]| x.iter().map(|x| x.y).sum::<f32>() / x.len() as f32;
    let scene = Attributes::default();
    play(&mut deformer, 10, &scene);
    let before = mean(deformer.positions().unwrap());
    let parted = deformer.untangle(&scene).unwrap();
    assert!(parted.before > 5 && parted.after == 0, "{parted:?}");
    let shifted = mean(deformer.positions().unwrap()) - before;
    play(&mut deformer, 10, &scene);
    let fallen = mean(deformer.positions().unwrap()) - mean(&mesh.positions) - shifted;
    let error = fallen + 0.5 * 9.81 * (20.0 * FRAME).powi(2);
    assert!(error.abs() < 2e-4, "{error} m off");
}
