//! Fabric, masses and pins change while the cloth moves. It then is the cloth that would have been built so, in the
//! same place and with the same motion.

#[macro_use]
mod common;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, ChangeError, Collider, Deformer, Fabric, Levels, Mesh, Method, Options, Quality};
use common::{FRAME, play, rms};

on_every_backend!(
    a_changed_cloth_is_one_made_so,
    a_changed_shell_is_one_made_so,
    a_change_to_the_same_changes_nothing,
    pins_that_are_let_go_fall_and_pinned_vertices_stay,
    pins_that_were_given_a_velocity_keep_it_when_let_go,
    a_vertex_without_edges_that_is_let_go_stays,
    what_was_changed_outlasts_a_reset,
    edges_between_two_pins_are_not_measured,
    refusals_change_nothing
);

/// A change made to a cloth.
type Change = Box<dyn Fn(&mut Deformer)>;

/// Wind, a ball, and the first pins moved.
fn scene(pins: usize) -> Attributes {
    let pin_targets = (pins > 0).then(|| (0..pins).map(|pin| Vec3::new(pin as f32 * 0.05 - 0.5, 0.02, -0.5)).collect());
    let ball = Collider::sphere(Vec3::new(0.0, -0.3, 0.1), 0.2);
    Attributes { wind: Vec3::new(1.0, 0.0, 3.0), air_density: 1.2, colliders: vec![ball], pin_targets, ..Attributes::default() }
}

fn options(backend: Backend) -> Options {
    let fabric = Fabric { bending: 1e-4, damping: 0.03, ..Fabric::COTTON };
    Options {
        backend,
        fabric,
        quality: Quality::Substeps(12),
        levels: Levels::Count(2),
        pinned: vec![0, 20],
        ..Options::default()
    }
}

/// After each change in the middle of a motion, the cloth moves like one that was built so and put in the same state.
fn a_changed_cloth_is_one_made_so(backend: Backend) {
    let mesh = Mesh::grid(21, 21, 1.0, 1.0);
    let before = options(backend);
    let stiff = Fabric { stretch: 9000.0, bending: 3e-4, damping: 0.0, ..before.fabric };
    let heavy = Fabric { density: 0.5, ..before.fabric };
    let mass: Vec<f32> = (0..441).map(|vertex| 1e-4 * (1.0 + 0.5 * (vertex as f32).sin())).collect();
    let row: Vec<u32> = (0..21).collect();
    let changes: Vec<(&str, Options, Change)> = vec![
        ("stiff", Options { fabric: stiff, ..before.clone() }, Box::new(move |cloth| cloth.set_fabric(stiff).unwrap())),
        (
            "limp",
            Options { fabric: Fabric::default(), ..before.clone() },
            Box::new(|cloth| {
                cloth.set_fabric(Fabric::default()).unwrap();
            }),
        ),
        ("heavy", Options { fabric: heavy, ..before.clone() }, Box::new(move |cloth| cloth.set_fabric(heavy).unwrap())),
        (
            "mass",
            Options { mass: Some(mass.clone()), ..before.clone() },
            Box::new(move |cloth| {
                cloth.set_mass(Some(mass.clone())).unwrap();
            }),
        ),
        ("row", Options { pinned: row.clone(), ..before.clone() }, Box::new(move |cloth| cloth.set_pinned(row.clone()).unwrap())),
        ("one", Options { pinned: vec![220], ..before.clone() }, Box::new(|cloth| cloth.set_pinned(vec![220]).unwrap())),
        (
            "none",
            Options { pinned: vec![], ..before.clone() },
            Box::new(|cloth| {
                // There and back, by way of edges between two pins.
                cloth.set_pinned((0..63).collect()).unwrap();
                cloth.set_pinned(vec![]).unwrap();
            }),
        ),
    ];
    for (name, after, change) in changes {
        let mut changed = Deformer::new(&mesh, before.clone()).unwrap();
        play(&mut changed, 3, &scene(2));
        change(&mut changed);
        let told = changed.options();
        assert_eq!((told.fabric, &told.pinned, &told.mass), (after.fabric, &after.pinned, &after.mass), "{name}");
        let (x, v) = (changed.positions().unwrap().to_vec(), changed.velocities().unwrap().to_vec());
        let mut made = Deformer::new(&mesh, after.clone()).unwrap();
        for cloth in [&mut changed, &mut made] {
            cloth.set_state(&x, &v).unwrap();
            play(cloth, 4, &scene(after.pinned.len().min(21)));
        }
        let (changed, made) = (changed.positions().unwrap().to_vec(), made.positions().unwrap().to_vec());
        let (apart, moved) = (rms(&changed, &made), rms(&made, &x));
        println!("{name}: {apart} of {moved}");
        assert!(moved > 0.01, "{name}: nothing moved");
        // Identical on a CPU; a GPU may add sums in a different order each time.
        assert!(if backend == Backend::Gpu { apart < 1e-5 * moved } else { apart == 0.0 }, "{name}: {apart} of {moved}");
    }
}

/// A ball, whose edges are swept there and back, after other masses and pins as if it had been made with them.
fn a_changed_shell_is_one_made_so(backend: Backend) {
    let mesh = common::shapes::ball(Vec3::Y, 0.3, 12);
    let (mass, pinned) = (Some(vec![0.002; mesh.positions.len()]), vec![30, 200]);
    let plain = Options { pinned: Vec::new(), levels: Levels::Off, ..options(backend) };
    let mut made = Deformer::new(&mesh, Options { mass: mass.clone(), pinned: pinned.clone(), ..plain.clone() }).unwrap();
    let mut changed = Deformer::new(&mesh, plain).unwrap();
    // Each takes a step with what the step before was computed for.
    changed.set_pinned(pinned).unwrap();
    play(&mut changed, 1, &scene(2));
    changed.set_mass(mass).unwrap();
    play(&mut changed, 1, &scene(2));
    changed.reset();
    [&mut made, &mut changed].into_iter().for_each(|ball| play(ball, 12, &scene(2)));
    let [made, changed] = [&mut made, &mut changed].map(|ball| ball.positions().unwrap().to_vec());
    let apart = rms(&made, &changed);
    assert!(if backend == Backend::Gpu { apart < 1e-5 } else { apart == 0.0 }, "{apart} m");
    assert!(rms(&made, &mesh.positions) > 0.05);
}

/// What a change does not set stays as it is: the motion continues.
fn a_change_to_the_same_changes_nothing(backend: Backend) {
    let mesh = Mesh::grid(13, 13, 1.0, 1.0);
    let options = Options { levels: Levels::Auto, pinned: vec![0, 12], ..options(backend) };
    let mut plain = Deformer::new(&mesh, options.clone()).unwrap();
    play(&mut plain, 8, &scene(2));
    let mut changed = Deformer::new(&mesh, options.clone()).unwrap();
    play(&mut changed, 3, &scene(2));
    changed.set_fabric(options.fabric).unwrap();
    play(&mut changed, 1, &scene(2));
    // There and back, by way of other masses and another order of the edges.
    changed.set_mass(Some(vec![0.01; 169])).unwrap();
    changed.set_mass(None).unwrap();
    play(&mut changed, 1, &scene(2));
    changed.set_pinned((0..13).collect()).unwrap();
    changed.set_pinned(vec![0, 12]).unwrap();
    play(&mut changed, 3, &scene(2));
    assert_eq!(changed.positions().unwrap(), plain.positions().unwrap());
}

/// Loose points fall by the closed form from the substep in which they are released, starting at the velocity at which
/// they were led.
fn pins_that_are_let_go_fall_and_pinned_vertices_stay(backend: Backend) {
    let mesh = Mesh { positions: (0..4).map(|k| Vec3::X * k as f32).collect(), triangles: vec![] };
    let options = Options { backend, quality: Quality::Substeps(8), pinned: vec![0, 1], ..Options::default() };
    let mut cloth = Deformer::new(&mesh, options).unwrap();
    let speed = Vec3::new(0.6, 0.0, 1.2);
    for frame in 1..=3 {
        let led = speed * (FRAME * frame as f32);
        let pin_targets = Some(vec![mesh.positions[0], mesh.positions[1] + led]);
        cloth.step(FRAME, &Attributes { pin_targets, ..Attributes::default() }).unwrap();
    }
    let start = cloth.positions().unwrap().to_vec();
    cloth.set_pinned(vec![3, 0]).unwrap();
    assert_eq!(cloth.positions().unwrap(), start);
    play(&mut cloth, 12, &Attributes::default());
    let end = cloth.positions().unwrap().to_vec();
    assert_eq!([end[0], end[3]], [start[0], start[3]], "pins stay where they are");
    // Gravity acts from the release on, not from the middle of the last substep on, which would be 2 mm.
    let t = 12.0 * FRAME;
    let expected = start[1] + speed * t - Vec3::Y * (0.5 * 9.81 * t * t);
    assert!(end[1].distance(expected) < 1e-4, "{} is not {expected}", end[1]);
    // Points that were falling all the time go on falling.
    let whole = 15.0 * FRAME;
    assert!((end[2].y + 0.5 * 9.81 * whole * whole).abs() < 2e-3, "{}", end[2]);
    // Targets are in the order of the new list of pins.
    let pin_targets = Some(vec![Vec3::ONE, Vec3::ZERO]);
    cloth.step(FRAME, &Attributes { pin_targets, ..Attributes::default() }).unwrap();
    let end = cloth.positions().unwrap();
    assert!(end[3].distance(Vec3::ONE) < 1e-6 && end[0].length() < 1e-6);
}

/// A state that was set says how fast the pins were led. Held, they stay; let go, they fly on like the rest.
fn pins_that_were_given_a_velocity_keep_it_when_let_go(backend: Backend) {
    let mesh = Mesh::grid(4, 4, 0.3, 0.3);
    let speed = 5.0 * Vec3::X;
    for is_held in [true, false] {
        let mut cloth = Deformer::new(&mesh, Options { pinned: vec![0, 1], ..options(backend) }).unwrap();
        cloth.set_state(&mesh.positions, &[speed; 16]).unwrap();
        if !is_held {
            cloth.set_pinned(vec![]).unwrap();
        }
        assert_eq!(cloth.velocities().unwrap()[0], speed);
        cloth.step(FRAME, &Attributes { gravity: Vec3::ZERO, ..Attributes::default() }).unwrap();
        let by = cloth.positions().unwrap()[0] - mesh.positions[0];
        let expected = if is_held { Vec3::ZERO } else { speed * FRAME };
        assert!(by.distance(expected) < 1e-5, "held {is_held}: {by}, not {expected}");
    }
}

/// Beside a cloth, a vertex without edges has no motion of its own.
fn a_vertex_without_edges_that_is_let_go_stays(backend: Backend) {
    let mut mesh = Mesh::grid(4, 4, 0.3, 0.3);
    mesh.positions.push(Vec3::X);
    let mut cloth = Deformer::new(&mesh, Options { pinned: vec![16], ..options(backend) }).unwrap();
    let led = Vec3::new(1.0, 0.02, 0.0);
    cloth.step(FRAME, &Attributes { pin_targets: Some(vec![led]), ..Attributes::default() }).unwrap();
    assert!(cloth.velocities().unwrap()[16].y > 0.1);
    cloth.set_pinned(vec![]).unwrap();
    assert_eq!(cloth.velocities().unwrap()[16], Vec3::ZERO);
    play(&mut cloth, 2, &Attributes::default());
    assert_eq!((cloth.positions().unwrap()[16], cloth.velocities().unwrap()[16]), (led, Vec3::ZERO));
}

fn what_was_changed_outlasts_a_reset(backend: Backend) {
    let mesh = Mesh::grid(11, 11, 1.0, 1.0);
    let before = Options { pinned: vec![0, 10], ..options(backend) };
    let (fabric, pinned) = (Fabric { density: 0.3, ..Fabric::SILK }, vec![5, 0, 1]);
    let mut changed = Deformer::new(&mesh, before.clone()).unwrap();
    play(&mut changed, 2, &scene(2));
    changed.set_fabric(fabric).unwrap();
    changed.set_pinned(pinned.clone()).unwrap();
    play(&mut changed, 2, &scene(3));
    changed.reset();
    assert_eq!(changed.positions().unwrap(), mesh.positions);
    let mut made = Deformer::new(&mesh, Options { fabric, pinned, ..before }).unwrap();
    [&mut changed, &mut made].into_iter().for_each(|cloth| play(cloth, 5, &scene(3)));
    assert!(rms(changed.positions().unwrap(), made.positions().unwrap()) < 1e-6);
}

fn refusals_change_nothing(backend: Backend) {
    let mesh = Mesh::grid(7, 7, 1.0, 1.0);
    let options = Options { pinned: vec![0, 6], ..options(backend) };
    let (mut plain, mut cloth) = (Deformer::new(&mesh, options.clone()).unwrap(), Deformer::new(&mesh, options).unwrap());
    [&mut plain, &mut cloth].into_iter().for_each(|cloth| play(cloth, 3, &scene(2)));
    let refused = |result: Result<(), ChangeError>, words: &[&str]| {
        let message = result.unwrap_err().to_string();
        words.iter().for_each(|word| assert!(message.contains(word), "no {word} in {message}"));
    };
    for (name, bad) in [("density", 0.0), ("density", f32::NAN), ("stretch", -1.0), ("bending", f32::INFINITY), ("damping", -0.1)]
    {
        let mut fabric = Fabric::COTTON;
        match name {
            "density" => fabric.density = bad,
            "stretch" => fabric.stretch = bad,
            "bending" => fabric.bending = bad,
            _ => fabric.damping = bad,
        }
        refused(cloth.set_fabric(fabric), &[&format!("fabric.{name} = {bad}"), "must be"]);
    }
    refused(cloth.set_mass(Some(vec![1.0; 48])), &["mass has 48 values", "49 vertices"]);
    refused(cloth.set_mass(Some([vec![1.0; 48], vec![0.0]].concat())), &["mass[48] = 0", "pinned"]);
    refused(cloth.set_pinned(vec![1, 49]), &["pinned[1] = 49", "49 vertices"]);
    refused(cloth.set_pinned(vec![1, 2, 1]), &["pinned[2] = 1", "once"]);
    [&mut plain, &mut cloth].into_iter().for_each(|cloth| play(cloth, 3, &scene(2)));
    assert_eq!(cloth.positions().unwrap(), plain.positions().unwrap());
}

/// Other dependences on the fabric: springs, and a promise about strain.
#[test]
fn springs_and_promises_know_the_new_fabric() {
    let mesh = Mesh::grid(9, 9, 1.0, 1.0);
    let soft = Fabric { stretch: 100.0, ..Fabric::default() };
    let stiff = Fabric { stretch: 900.0, ..Fabric::default() };
    let options = Options { backend: Backend::Cpu, method: Method::Springs, fabric: soft, ..Options::default() };
    let mut springs = Deformer::new(&mesh, options.clone()).unwrap();
    let needs = |cloth: &Deformer| cloth.forecast(FRAME, &Attributes::default()).unwrap().explicit.unwrap();
    let before = needs(&springs);
    play(&mut springs, 2, &Attributes::default());
    springs.set_fabric(stiff).unwrap();
    assert!((needs(&springs) / before - 3.0).abs() < 1e-3, "the limit goes with the root of the stiffness");
    play(&mut springs, 2, &Attributes::default());
    let infinite = Fabric { stretch: f32::INFINITY, ..soft };
    assert!(springs.set_fabric(infinite).unwrap_err().to_string().contains("SmallSteps"));

    // A knitted sheet stretches more under its own weight than a woven one, and less after it was changed to woven.
    let knitted =
        Options { method: Method::SmallSteps, quality: Quality::Substeps(60), fabric: soft, pinned: (0..9).collect(), ..options };
    let mut cloth = Deformer::new(&mesh, knitted).unwrap();
    let damped = Attributes { damping: 3.0, ..Attributes::default() };
    play(&mut cloth, 150, &damped);
    let knit = cloth.measure().unwrap().mean_strain;
    cloth.set_fabric(stiff).unwrap();
    play(&mut cloth, 150, &damped);
    let woven = cloth.measure().unwrap().mean_strain;
    assert!((knit / woven - 9.0).abs() < 1.0, "{knit} and {woven}");
}

/// Pins that are led apart stretch the edge between them, which is not the cloth's fault: strain is measured without it, also if they
/// were pinned while the cloth moved.
fn edges_between_two_pins_are_not_measured(backend: Backend) {
    let mesh = Mesh::grid(4, 4, 0.3, 0.3);
    let led = |apart: f32| vec![mesh.positions[0] - apart * Vec3::X, mesh.positions[1]];
    let run = |pinned: Vec<u32>| {
        let options = Options { backend, pinned, quality: Quality::Strain(0.05), ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        cloth.step(FRAME, &Attributes::default()).unwrap();
        cloth.set_pinned(vec![0, 1]).unwrap();
        let mut worst = 0.0_f32;
        for frame in 1..16_u8 {
            let attributes = Attributes { pin_targets: Some(led(0.002 * f32::from(frame))), ..Attributes::default() };
            let stretch = cloth.step(FRAME, &attributes).unwrap().stretch;
            worst = stretch.map_or(worst, |stretch| worst.max(stretch.worst));
        }
        worst
    };
    // The edge between the pins is .1 m long and becomes 30 % longer.
    let [before, after] = [vec![0, 1], vec![0]].map(run);
    assert!([before, after].iter().all(|&worst| worst > 0.0 && worst < 0.12), "{before}, {after}");
}
