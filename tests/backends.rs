//! The three backends agree: stage by stage, on real motion, and in repeated runs.

#[macro_use]
mod common;

use cloth_deformer::glam::{Affine3A, EulerRot, Quat, Vec3};
use cloth_deformer::{
    Attributes, Backend, Collider, Deformer, Fabric, Mesh, Method, Options, Quality, Shape, Snapshot, StepError, Tethers,
};
use common::{FRAME, play};

/// A scene with one feature.
#[derive(Clone)]
struct Scene {
    name: &'static str,
    mesh: Mesh,
    options: Options,
    attributes: Attributes,
    velocities: Vec<Vec3>,
    /// The same scene without the feature that it is named for.
    without: Option<Box<Scene>>,
    /// Number of frames after which the backends must still agree closely.
    frames: u32,
}

/// A crumpled, pinned sheet near the origin, with all quantities of order one, moving in all directions.
fn scene(name: &'static str) -> Scene {
    let mut mesh = Mesh::grid(13, 11, 1.0, 0.9);
    let wave = |k: usize, f: f32| (k as f32 * f).sin();
    let offset = |k| Vec3::new(wave(k, 0.7), wave(k, 1.1), wave(k, 1.7));
    mesh.positions.iter_mut().enumerate().for_each(|(k, x)| *x += 0.01 * offset(k));
    let velocities = (0..mesh.positions.len()).map(|k| offset(3 * k)).collect();
    let fabric = Fabric { density: 0.2, stretch: 500.0, bending: 0.0, damping: 0.0 };
    let options = Options { quality: Quality::Substeps(20), fabric, pinned: vec![0, 6, 12], ..Options::default() };
    let attributes = Attributes { gravity: Vec3::ZERO, ..Attributes::default() };
    Scene { name, mesh, options, attributes, velocities, without: None, frames: 3 }
}

/// One scene for each stage, and one with all of them.
fn scenes() -> Vec<Scene> {
    let all = [
        "gravity", "damping", "bending", "bending damping", "bending passes", "damped passes", "wind", "springs", "project",
        "relax", "sphere", "plane",
    ];
    let all = all.into_iter().chain(["capsule", "tapered", "box", "swept", "swept box", "pins", "tethers", "everything"]);
    all.map(|name| {
        let mut scene = scene(name);
        if name.starts_with("swept") {
            scene.velocities.iter_mut().for_each(|v| v.y -= 200.0);
            scene.frames = 1;
        }
        if name == "bending damping" {
            scene.options.fabric.bending = 1e-3;
        }
        // A cloth whose stiffness is not resolved.
        if name == "tethers" || name == "everything" {
            (scene.options.fabric.stretch, scene.options.tethers) = (1e5, Tethers::Off);
        }
        if name == "damped passes" {
            scene.options.fabric.bending = 5.0;
        }
        scene.without = Some(Box::new(scene.clone()));
        let is = |wanted: &str| name == wanted || name == "everything";
        let attributes = &mut scene.attributes;
        if is("gravity") {
            attributes.gravity = Vec3::new(1.0, -9.81, 2.0);
        }
        if is("tethers") {
            scene.options.tethers = Tethers::Auto;
        }
        if is("damping") {
            (attributes.damping, attributes.wind) = (2.0, Vec3::new(1.0, 2.0, 3.0));
        }
        if name.contains("bending") || name == "damped passes" || name == "everything" {
            // At 20 substeps these take one, two and seven passes.
            scene.options.fabric.bending = match name {
                "bending passes" => 1.0,
                "damped passes" => 5.0,
                _ => 1e-3,
            };
            scene.options.fabric.damping = if name == "bending" || name == "bending passes" { 0.0 } else { 0.03 };
        }
        if is("wind") {
            (attributes.wind, attributes.air_density, attributes.lift) = (Vec3::new(3.0, 5.0, -4.0), 1.2, 0.9);
        }
        match name {
            "springs" => scene.options.method = Method::Springs,
            "relax" => scene.options.method = Method::Relaxation { iterations: 3 },
            _ => {}
        }
        let mut collide = |collider: Collider| attributes.colliders.push(collider.with_friction(0.4));
        if is("sphere") {
            collide(Collider::sphere(Vec3::new(0.1, -0.25, 0.0), 0.25));
        }
        if is("plane") {
            collide(Collider::plane(Vec3::new(0.0, 0.005, 0.0), Vec3::new(0.1, 1.0, 0.2)));
        }
        if is("capsule") {
            collide(Collider::capsule(Vec3::new(-0.3, -0.1, 0.2), Vec3::new(0.3, -0.12, -0.1), 0.1));
        }
        if is("tapered") {
            collide(Collider::tapered_capsule(Vec3::new(-0.3, -0.1, -0.2), 0.04, Vec3::new(0.3, -0.12, -0.1), 0.11));
        }
        if is("box") {
            let turn = Quat::from_euler(EulerRot::YXZ, 0.4, 0.2, -0.1);
            collide(Collider::rounded_box(Vec3::new(0.1, -0.07, 0.2), Vec3::new(0.3, 0.06, 0.2), turn, 0.03));
        }
        if name == "swept box" {
            let turn = Quat::from_euler(EulerRot::YXZ, 0.4, 0.2, -0.1);
            collide(Collider::rounded_box(Vec3::new(0.1, -0.3, 0.0), Vec3::new(0.3, 0.1, 0.2), turn, 0.03));
        }
        if name == "swept" {
            collide(Collider::sphere(Vec3::new(0.1, -0.3, 0.0), 0.25));
        }
        if is("pins") {
            scene.attributes.pin_targets =
                Some(vec![Vec3::new(-0.4, 0.1, -0.5), Vec3::new(0.1, 0.2, -0.4), Vec3::new(0.5, -0.1, -0.3)]);
        }
        scene
    })
    .collect()
}

/// Moving colliders: center, radius, axis and plane all change from frame to frame.
fn moved(attributes: &Attributes, frame: u32) -> Attributes {
    let t = frame as f32;
    let by = Vec3::new(0.01, 0.004, -0.006) * t;
    let shift = |collider: &Collider| {
        let shape = match collider.shape.clone() {
            Shape::Sphere { center, radius } => Shape::Sphere { center: center + by, radius: radius + 0.003 * t },
            Shape::Plane { point, normal } => Shape::Plane { point: point + 0.3 * by, normal },
            Shape::Capsule { a, b, radius } => Shape::Capsule { a: a + by, b: b - 0.5 * by, radius: radius + 0.002 * t },
            Shape::TaperedCapsule { a, radius_a, b, radius_b } => Shape::TaperedCapsule {
                a: a + by,
                radius_a: radius_a + 0.002 * t,
                b: b - 0.5 * by,
                radius_b: radius_b - 0.001 * t,
            },
            Shape::RoundedBox { center, half, rotation, radius } => {
                let rotation = Quat::from_axis_angle(Vec3::new(0.0, 0.6, 0.8), 0.02 * t) * rotation;
                Shape::RoundedBox { center: center + by, half: half + 0.3 * by, rotation, radius: radius + 0.001 * t }
            }
            other => panic!("{other:?} is not moved here"),
        };
        Collider { shape, ..*collider }
    };
    Attributes { colliders: attributes.colliders.iter().map(shift).collect(), ..attributes.clone() }
}

fn advance(deformer: &mut Deformer, scene: &Scene) {
    for frame in 0..scene.frames {
        deformer.step(FRAME, &moved(&scene.attributes, frame)).unwrap();
    }
}

/// Positions and velocities after the scene's frames.
fn run(scene: &Scene, backend: Backend) -> (Vec<Vec3>, Vec<Vec3>) {
    let mut deformer = Deformer::new(&scene.mesh, Options { backend, ..scene.options.clone() }).unwrap();
    assert_eq!(deformer.backend(), backend);
    deformer.set_state(&scene.mesh.positions, &scene.velocities).unwrap();
    advance(&mut deformer, scene);
    (deformer.positions().unwrap().to_vec(), deformer.velocities().unwrap().to_vec())
}

/// Each shader stage computes what its CPU counterpart does. Both visit the edges in the same order, so the results
/// differ only by rounding.
#[cfg(feature = "gpu")]
#[test]
fn every_stage_agrees_with_its_twin() {
    for scene in scenes() {
        let (x, v) = run(&scene, Backend::Cpu);
        let moved = common::rms(&x, &scene.mesh.positions);
        assert!(moved > 0.005, "{}: the cloth moved by {moved} m", scene.name);
        for backend in [Backend::Hybrid, Backend::Gpu] {
            let (x_gpu, v_gpu) = run(&scene, backend);
            let (apart, apart_v) = (common::rms(&x, &x_gpu), common::rms(&v, &v_gpu));
            println!("{} on {backend:?}: {apart:e} m and {apart_v:e} m/s apart, moved {moved} m", scene.name);
            // Rounding over sixty substeps: at most 1e-5 where multiply-adds are not fused, 4e-5 where they are (H200).
            assert!(apart <= 1e-4 * moved, "{} on {backend:?}: {apart} m apart", scene.name);
            assert!(
                apart_v <= 1e-3 * common::rms(&v, &vec![Vec3::ZERO; v.len()]),
                "{} on {backend:?}: {apart_v} m/s",
                scene.name
            );
        }
    }
}

/// The feature that a scene is named for changes its motion, so that a term missing on both sides would be detected.
#[test]
fn every_stage_matters() {
    for scene in scenes().iter().filter(|scene| scene.name != "project") {
        let without = run(scene.without.as_ref().unwrap(), Backend::Cpu).0;
        let apart = common::rms(&run(scene, Backend::Cpu).0, &without);
        assert!(apart > 1e-5, "{} changes the motion by {apart} m only", scene.name);
    }
}

fn replay(backend: Backend) {
    for scene in scenes() {
        let first = run(&scene, backend);
        let mut deformer = Deformer::new(&scene.mesh, Options { backend, ..scene.options.clone() }).unwrap();
        // Run another scene first, then come back to this one.
        advance(&mut deformer, &scene);
        deformer.reset();
        assert_eq!(deformer.positions().unwrap(), scene.mesh.positions, "reset is the mesh, bit for bit");
        assert!(deformer.velocities().unwrap().iter().all(|&v| v == Vec3::ZERO));
        deformer.set_state(&scene.mesh.positions, &scene.velocities).unwrap();
        advance(&mut deformer, &scene);
        assert!(first.0 == deformer.positions().unwrap() && first.1 == deformer.velocities().unwrap(), "{} replays", scene.name);
    }
}

fn reset_replays(backend: Backend) {
    let (mesh, options) = common::hang(12, 20, backend);
    let mut deformer = Deformer::new(&mesh, options).unwrap();
    play(&mut deformer, 10, &Attributes::default());
    let first = deformer.positions().unwrap().to_vec();
    deformer.reset();
    play(&mut deformer, 10, &Attributes::default());
    assert_eq!(deformer.positions().unwrap(), first);
}

on_every_backend!(
    replay,
    reset_replays,
    a_failed_step_leaves_the_state,
    measure_is_right,
    a_crowd_moves_as_each_alone,
    a_flat_start_is_kept_until_a_step_succeeds,
    positions_arrive_later
);

/// Cloths of several sizes: some with bending in one pass or in several, some in wind, one with both, one with moving pins, others with none
/// of these, and one whose step is refused, which must not affect the others.
fn a_crowd_moves_as_each_alone(backend: Backend) {
    let sheet = |n: u32, k: f32, bending: f32| {
        let (mesh, mut options) = common::hang(n, 10 + n % 4, backend);
        (options.fabric.bending, options.fabric.damping) = (bending, if n == 34 { 0.03 } else { 0.0 });
        let attributes = Attributes { gravity: Vec3::new(k, -9.81, 0.0), ..Attributes::default() };
        (mesh, options, attributes)
    };
    let mut scenes = [
        sheet(9, 0.0, 0.0),
        sheet(14, 1.0, 1e-4),
        // At 12 substeps four passes.
        sheet(34, 2.0, 0.01),
        sheet(9, 3.0, 0.0),
        sheet(12, 4.0, 0.0),
        sheet(12, 5.0, 0.0),
    ];
    for windy in [1, 2, 5] {
        (scenes[windy].2.air_density, scenes[windy].2.wind) = (1.2, Vec3::new(1.0, 0.0, 2.0));
    }
    scenes[3].2.pin_targets = Some((0..9).map(|k| scenes[3].0.positions[k] + 0.01 * Vec3::Y).collect());
    let new = |(mesh, options, _): &(Mesh, Options, Attributes)| Deformer::new(mesh, options.clone()).unwrap();
    let mut alone: Vec<Deformer> = scenes.iter().map(new).collect();
    let mut crowd: Vec<Deformer> = scenes.iter().map(new).collect();
    let absurd = Attributes { gravity: Vec3::NAN, ..Attributes::default() };
    for frame in 0..4 {
        let attributes = |k: usize| if (frame, k) == (2, 4) { &absurd } else { &scenes[k].2 };
        let crowd = crowd.iter_mut().enumerate().map(|(k, one)| (one, attributes(k)));
        let stepped = Deformer::step_all(crowd, FRAME);
        for (k, (one, stepped)) in alone.iter_mut().zip(stepped).enumerate() {
            let expected = one.step(FRAME, attributes(k));
            assert_eq!(stepped.is_ok(), (frame, k) != (2, 4));
            assert_eq!(stepped.map_err(|error| error.to_string()), expected.map_err(|error| error.to_string()));
        }
    }
    for (k, (one, other)) in alone.iter_mut().zip(&mut crowd).enumerate() {
        let apart = common::rms(one.positions().unwrap(), other.positions().unwrap());
        let moved = common::rms(one.positions().unwrap(), &scenes[k].0.positions);
        println!("{k} on {backend:?}: {apart:e} m apart, moved {moved} m");
        assert!(moved > 1e-3 && apart <= 1e-5 * moved, "{k}: {apart} m apart of {moved}");
        assert!(backend != Backend::Cpu || apart == 0.0);
    }
}

/// Large enough to be divided among threads: the same bits on one thread as on two.
#[test]
fn threads_do_not_change_a_bit() {
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let (mesh, mut options) = common::hang(90, 20, Backend::Cpu);
            (options.fabric.bending, options.fabric.damping) = (1e-4, 0.03);
            let mut deformer = Deformer::new(&mesh, options).unwrap();
            let colliders = vec![Collider::sphere(Vec3::new(0.0, -0.3, 0.0), 0.28)];
            let attributes = Attributes { wind: Vec3::new(1.0, 0.0, 2.0), air_density: 1.2, colliders, ..Attributes::default() };
            play(&mut deformer, 12, &attributes);
            deformer.positions().unwrap().to_vec()
        })
    };
    let one = run(1);
    assert!(one == run(2) && one == run(3));
}

/// With moving pins, a moving collider and a step of another length: all state must be restored.
fn a_failed_step_leaves_the_state(backend: Backend) {
    // In air the hybrid engine exchanges data with the GPU, in a vacuum it need not.
    [0.0, 1.2].into_iter().for_each(|air_density| fails(backend, air_density));
}

fn fails(backend: Backend, air_density: f32) {
    let (mesh, options) = common::hang(9, 20, backend);
    let led = |by: Vec3| Some((0..9).map(|k| mesh.positions[k] + by).collect());
    let ball = |y: f32| vec![Collider::sphere(Vec3::new(0.0, y, 0.0), 0.2)];
    let good = Attributes { pin_targets: led(0.01 * Vec3::Y), colliders: ball(-0.4), air_density, ..Attributes::default() };
    let mut deformer = Deformer::new(&mesh, options.clone()).unwrap();
    let mut spared = Deformer::new(&mesh, options).unwrap();
    play(&mut deformer, 3, &good);
    play(&mut spared, 3, &good);
    let before = deformer.snapshot().unwrap();
    let seen = (deformer.positions().unwrap().to_vec(), deformer.velocities().unwrap().to_vec());
    // The air takes the cloth along at once, farther than 1e15 m.
    let wind = Vec3::splat(1e15);
    let endless = Attributes {
        wind,
        damping: 1e30,
        pin_targets: led(Vec3::ONE),
        colliders: ball(0.5),
        air_density,
        ..Attributes::default()
    };
    // On the GPU, the failure shows when the state is next read.
    let failed = deformer.step(1.2, &endless).map(|_| ()).and_then(|()| deformer.positions().map(|_| ()));
    let message = failed.unwrap_err().to_string();
    assert!(message.contains("unstable: vertex") && message.contains("use"), "{message}");
    assert!(seen.0 == deformer.positions().unwrap() && seen.1 == deformer.velocities().unwrap());
    // To the last byte where the failure shows at once.
    assert!(backend == Backend::Gpu || deformer.snapshot().unwrap() == before);
    // What the next step starts from is restored too: the pins, and the length of the last substep.
    let still = Attributes { colliders: Vec::new(), ..good };
    for deformer in [&mut deformer, &mut spared] {
        play(deformer, 3, &still);
    }
    assert_eq!(deformer.positions().unwrap(), spared.positions().unwrap());
}

/// Waits for requested positions, however long it takes.
fn taken(deformer: &mut Deformer) -> Result<Vec<Vec3>, StepError> {
    loop {
        if let Some(positions) = deformer.requested_positions()? {
            return Ok(positions.to_vec());
        }
        std::thread::yield_now();
    }
}

/// Requested positions are those at the time of the request, whatever is queued after it. They are delivered once, and
/// a failure is reported.
fn positions_arrive_later(backend: Backend) {
    let (mesh, options) = common::hang(9, 20, backend);
    let attributes = Attributes::default();
    let mut deformer = Deformer::new(&mesh, options.clone()).unwrap();
    assert!(deformer.requested_positions().unwrap().is_none(), "none were asked for");
    play(&mut deformer, 3, &attributes);
    let then = deformer.positions().unwrap().to_vec();
    deformer.request_positions().unwrap();
    play(&mut deformer, 3, &attributes);
    assert_eq!(taken(&mut deformer).unwrap(), then);
    assert!(deformer.requested_positions().unwrap().is_none(), "they were taken");
    let now = deformer.positions().unwrap().to_vec();
    assert_ne!(now, then);
    // The second request replaces the first.
    deformer.request_positions().unwrap();
    play(&mut deformer, 1, &attributes);
    deformer.request_positions().unwrap();
    let later = taken(&mut deformer).unwrap();
    assert_eq!(later, deformer.positions().unwrap());
    // What was requested before the state was replaced is dropped.
    let snapshot = deformer.snapshot().unwrap();
    for replace in [Deformer::restore, |cloth: &mut Deformer, _: &Snapshot| {
        cloth.warp(Affine3A::IDENTITY).unwrap();
        Ok(())
    }] {
        deformer.request_positions().unwrap();
        replace(&mut deformer, &snapshot).unwrap();
        assert!(deformer.wait().is_ok() && deformer.requested_positions().unwrap().is_none());
    }
    let endless = common::gale(&Attributes::default());
    let failed = deformer
        .step(FRAME, &endless)
        .map(|_| ())
        .and_then(|()| deformer.request_positions())
        .and_then(|()| taken(&mut deformer).map(|_| ()));
    assert!(matches!(failed, Err(StepError::Unstable { .. })), "{failed:?}");
    assert_eq!(deformer.positions().unwrap(), later, "the state is as it was");
}

/// The imperfection that a flat cloth gets before its first step drops no request, and is undone where that step fails.
fn a_flat_start_is_kept_until_a_step_succeeds(backend: Backend) {
    let (mut mesh, options) = common::hang(9, 20, backend);
    mesh.positions.iter_mut().for_each(|x| *x = Vec3::new(x.x, -x.z, 0.0));
    let mut curtain = Deformer::new(&mesh, options).unwrap();
    curtain.request_positions().unwrap();
    let start = curtain.snapshot().unwrap();
    play(&mut curtain, 3, &Attributes::default());
    assert_eq!(taken(&mut curtain).unwrap(), mesh.positions);
    let then = curtain.positions().unwrap().to_vec();
    assert!(then.iter().any(|x| x.z != 0.0), "it has an imperfection");
    // From the start again, and again after a failure.
    curtain.restore(&start).unwrap();
    assert_eq!(curtain.positions().unwrap(), mesh.positions);
    let failed =
        curtain.step(FRAME, &common::gale(&Attributes::default())).map(|_| ()).and_then(|()| curtain.positions().map(|_| ()));
    assert!(failed.is_err());
    if backend != Backend::Gpu {
        assert_eq!(curtain.positions().unwrap(), mesh.positions);
    }
    curtain.restore(&start).unwrap();
    play(&mut curtain, 3, &Attributes::default());
    assert_eq!(curtain.positions().unwrap(), then);
}

/// A stretched, moving pair of triangles, compared with a calculation by hand.
fn measure_is_right(backend: Backend) {
    let mesh = Mesh::grid(2, 2, 1.0, 1.0);
    let fabric = Fabric { density: 0.5, stretch: 100.0, bending: 0.0, damping: 0.0 };
    let mut deformer = Deformer::new(&mesh, Options { backend, fabric, ..Options::default() }).unwrap();
    let wide: Vec<Vec3> = mesh.positions.iter().map(|x| *x * Vec3::new(1.1, 1.0, 1.0) + Vec3::Y).collect();
    deformer.set_state(&wide, &[Vec3::new(0.0, 0.0, 2.0); 4]).unwrap();
    let measure = deformer.measure().unwrap();
    let diagonal = f64::hypot(1.1, 1.0) / f64::sqrt(2.0) - 1.0;
    let (near, within) = (|a: f64, b: f64| (a - b).abs() <= 1e-5 * b.abs(), &measure);
    assert!(near(f64::from(measure.mean_strain), (2.0 * 0.1 + diagonal) / 5.0), "{within:?}");
    assert!(near(f64::from(measure.max_strain), 0.1), "{within:?}");
    assert!(near(measure.kinetic_energy, 0.5 * 0.5 * 4.0), "{within:?}");
    // k = K (A1 + A2) / l²: 50 N/m for the two sides along x, 100 * 1 / 2 for the diagonal.
    let elastic = 0.5 * 2.0 * 50.0 * 0.01 + 0.5 * 50.0 * 2.0 * diagonal * diagonal;
    assert!(near(measure.potential_energy, elastic), "no step yet, no gravity: {within:?}, expected {elastic}");
    assert!(measure.penetration == 0.0);
}
