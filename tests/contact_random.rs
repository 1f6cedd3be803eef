//! Random scenes of contact: pieces of random shape and fabric fall onto each other and onto bodies, in wind, held by pins
//! that move. Crossings are counted in every frame.
//!
//! `CLOTH_CASES=1000 cargo test --release --test contact_random -- --nocapture` plays so many; `CLOTH_FIRST=17` begins
//! with seed 17, and `CLOTH_BACKEND=gpu` runs them on the GPU.

mod common;

use std::f32::consts::PI;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use cloth_deformer::glam::{Quat, Vec3};
use cloth_deformer::{
    Attributes, Backend, Collider, Contact, Deformer, Fabric, Levels, Mesh, Options, Quality, Shape, Tethers, Warning,
};
use common::crossings::with_itself_and;
use common::shapes::{ball, capsule, jittered, sheets, tube};
use common::{FRAME, backend_by_name};
use rayon::prelude::*;

struct Random(fastrand::Rng);

impl Random {
    fn of(&mut self, low: f32, high: f32) -> f32 {
        low + (high - low) * self.0.f32()
    }

    /// Between two positive numbers, each order of magnitude as often as any other.
    fn scale(&mut self, low: f32, high: f32) -> f32 {
        self.of(low.ln(), high.ln()).exp()
    }

    fn is(&mut self, chance: f32) -> bool {
        self.0.f32() < chance
    }

    fn vector(&mut self, size: f32) -> Vec3 {
        Vec3::from_array(std::array::from_fn(|_| self.of(-size, size)))
    }

    fn turn(&mut self) -> Quat {
        Quat::from_axis_angle(self.vector(1.0).normalize_or(Vec3::Y), self.of(0.0, 2.0 * PI))
    }
}

/// A sheet with irregular triangles, a tube or a closed bag, sometimes with holes, centered at the origin.
fn piece(random: &mut Random, about: &mut String) -> Mesh {
    let size = random.of(0.2, 0.7);
    let (rows, columns) = (random.0.u32(5..18), random.0.u32(5..18));
    let kind = random.0.u32(0..4);
    *about += ["tube ", "ball ", "sheet ", "sheet "][kind as usize];
    let mut mesh = match kind {
        0 => tube(0.3 * size, size, rows.max(6), columns),
        1 => bag(0.4 * size, rows.min(9)),
        _ => {
            let depth = size * random.of(0.3, 1.0);
            let mut mesh = Mesh::grid(columns, rows, size, depth);
            let most = random.of(0.0, 0.35) * (size / columns as f32).min(depth / rows as f32);
            mesh.positions.iter_mut().for_each(|x| *x += random.vector(most) * Vec3::new(1.0, 0.02, 1.0));
            mesh
        }
    };
    if random.is(0.3) {
        *about += "with holes ";
        let count = mesh.triangles.len();
        for _ in 0..=count / 30 {
            mesh.triangles.swap_remove(random.0.usize(0..mesh.triangles.len()));
        }
    }
    mesh
}

/// A ball whose poles are one vertex each.
fn bag(radius: f32, rings: u32) -> Mesh {
    let mut mesh = ball(Vec3::ZERO, radius, rings);
    let (around, last) = (2 * rings, mesh.positions.len() as u32 - 1);
    let weld = |v: u32| {
        if v < around {
            0
        } else if v > last - around {
            last
        } else {
            v
        }
    };
    mesh.triangles.iter_mut().for_each(|triangle| *triangle = triangle.map(weld));
    mesh.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    mesh
}

/// A smooth motion to and fro (m) at no more than a given speed (m/s), or a rotation (rad).
fn sway(random: &mut Random, speed: f32) -> impl Fn(u32) -> Vec3 + Send + Sync + 'static {
    let (along, seconds) = (random.vector(1.0).normalize_or(Vec3::X), random.of(0.4, 2.0));
    let rate = 2.0 * PI / seconds;
    move |frame| along * (speed / rate) * (rate * FRAME * frame as f32).sin()
}

type Motion = Box<dyn Fn(u32) -> Attributes + Send + Sync>;

struct Scene {
    mesh: Mesh,
    options: Options,
    motion: Motion,
    about: String,
}

fn scene(seed: u64) -> Scene {
    let mut random = Random(fastrand::Rng::with_seed(seed));
    let mut mesh = Mesh::default();
    let (mut height, mut pieces) = (0.35_f32, String::new());
    for _ in 0..random.0.u32(1..4) {
        // Without noise, features that lie in one plane would seem to cross by rounding.
        let mut one = jittered(piece(&mut random, &mut pieces), seed);
        let (turn, aside) = (random.turn(), random.vector(0.15) * Vec3::new(1.0, 0.0, 1.0));
        one.positions.iter_mut().for_each(|x| *x = turn * *x);
        let low = one.positions.iter().map(|x| x.y).fold(f32::INFINITY, f32::min);
        one.positions.iter_mut().for_each(|x| *x += aside + (height + 0.02 - low) * Vec3::Y);
        height = one.positions.iter().map(|x| x.y).fold(height, f32::max);
        let first = mesh.positions.len() as u32;
        mesh.positions.extend(one.positions);
        mesh.triangles.extend(one.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    }
    let has_pins = random.is(0.4);
    let pinned: Vec<u32> = if has_pins {
        let (at, radius) = (mesh.positions[random.0.usize(0..mesh.positions.len())], random.of(0.01, 0.15));
        (0..mesh.positions.len() as u32).filter(|&v| mesh.positions[v as usize].distance(at) < radius).collect()
    } else {
        Vec::new()
    };
    let held: Vec<Vec3> = pinned.iter().map(|&v| mesh.positions[v as usize]).collect();
    let speed = if random.is(0.5) { 0.0 } else { random.of(0.1, 3.0) };
    let (led, moved) = (sway(&mut random, speed), sway(&mut random, speed));
    // Pins move as one rigid body, since others could be led through each other.
    let spin = if random.is(0.5) { 0.0 } else { 3.0 };
    let (spun, center) = (sway(&mut random, spin), held.iter().sum::<Vec3>() / held.len().max(1) as f32);
    // Pins that are led through the triangles of a body cannot but cross them.
    let body = (!has_pins && random.is(0.5)).then(|| match random.0.u32(0..3) {
        0 => ball(Vec3::ZERO, random.of(0.08, 0.15), random.0.u32(4..16)),
        1 => capsule(Vec3::X * -0.15, Vec3::X * 0.15, random.of(0.04, 0.12), random.0.u32(4..12)),
        _ => Mesh::grid(random.0.u32(2..9), random.0.u32(2..9), 0.4, 0.3),
    });
    let (turn, friction) = (random.turn(), random.of(0.0, 1.0));
    let analytic = match random.0.u32(0..5) {
        0 => Some(Collider::sphere(Vec3::Y * 0.12, 0.15)),
        1 => Some(Collider::capsule(Vec3::new(-0.2, 0.1, 0.0), Vec3::new(0.2, 0.15, 0.1), 0.08)),
        2 => Some(Collider::rounded_box(Vec3::Y * 0.1, Vec3::new(0.1, 0.1, 0.15), Quat::from_rotation_y(0.4), 0.01)),
        _ => None,
    };
    let has_floor = random.is(0.8);
    let wind = if random.is(0.3) { random.vector(10.0) } else { Vec3::ZERO };
    let quality = match random.0.u32(0..4) {
        0 => Quality::Strain(0.03),
        1 => Quality::default(),
        _ => Quality::Substeps(random.0.u32(8..40)),
    };
    let contact = Some(Contact { thickness: random.scale(0.001, 0.01), friction: random.of(0.0, 1.2) });
    let fabric = Fabric {
        density: random.scale(0.05, 1.0),
        stretch: random.scale(200.0, 30_000.0),
        bending: random.scale(1e-7, 1e-2),
        damping: random.of(0.0, 0.2),
    };
    let levels = if random.is(0.5) { Levels::Auto } else { Levels::Off };
    let tethers = if random.is(0.5) { Tethers::Auto } else { Tethers::Off };
    let body_spin = if random.is(0.5) { 0.0 } else { random.of(0.0, 6.0) };
    let body_spun = sway(&mut random, body_spin);
    let about = format!(
        "{pieces}: {} vertices, {} pins, {speed:.1} m/s, body {}, {body_spin:.1} rad/s, {quality:?}, {contact:?}, {fabric:?}, wind {:.0}",
        mesh.positions.len(),
        pinned.len(),
        body.as_ref().map_or(0, |body| body.triangles.len()),
        wind.length()
    );
    let options = Options { backend: backend_by_name(), quality, fabric, contact, levels, tethers, pinned, ..Options::default() };
    let motion = move |frame: u32| {
        let mut colliders: Vec<Collider> = Vec::new();
        if has_floor {
            colliders.push(Collider::plane(Vec3::ZERO, Vec3::Y).with_friction(friction));
        }
        if let Some(body) = &body {
            let at = Vec3::Y * 0.18 + moved(frame) * Vec3::new(1.0, 0.2, 1.0);
            let spun = Quat::from_scaled_axis(body_spun(frame)) * turn;
            let positions = body.positions.iter().map(|&x| spun * x + at).collect();
            let body = Mesh { positions, triangles: body.triangles.clone() };
            colliders.push(Collider::mesh(Arc::new(body)).with_friction(friction));
        } else {
            colliders.extend(analytic.clone());
        }
        let pin_targets = has_pins
            .then(|| held.iter().map(|&x| center + Quat::from_scaled_axis(spun(frame)) * (x - center) + led(frame)).collect());
        Attributes { colliders, wind, pin_targets, ..Attributes::default() }
    };
    Scene { mesh, options, motion: Box::new(motion), about }
}

/// A collider that presses sheets, which lie on the floor or stand on an edge, to less room than they need, and slides over it.
fn pressed(seed: u64) -> Scene {
    let mut random = Random(fastrand::Rng::with_seed(seed));
    let (thickness, layers, n) = (random.scale(0.003, 0.01), random.0.u32(1..5), random.0.u32(10..18));
    let mut mesh = jittered(sheets(layers, n, 0.5, 1.3 * thickness), seed);
    let turn = if random.is(0.5) { Quat::from_rotation_x(1.4) } else { Quat::IDENTITY };
    mesh.positions.iter_mut().for_each(|x| *x = turn * *x);
    let low = mesh.positions.iter().map(|x| x.y).fold(f32::INFINITY, f32::min);
    mesh.positions.iter_mut().for_each(|x| x.y += 0.01 - low);
    let top = mesh.positions.iter().map(|x| x.y).fold(0.0, f32::max) + 0.25;
    let (radius, room) = (random.of(0.05, 0.15), random.of(-0.02, thickness * layers as f32));
    let (down, aside, friction, kind) = (random.of(0.2, 6.0), random.of(0.0, 1.5), random.of(0.0, 0.8), random.0.u32(0..3));
    let quality = if random.is(0.3) { Quality::default() } else { Quality::Substeps(random.0.u32(8..40)) };
    let about =
        format!("{layers} x {n} x {n}, {thickness} m thick, {room} m of room, {down} and {aside} m/s, {kind}, {quality:?}");
    let contact = Some(Contact { thickness, friction });
    let fabric = Fabric { bending: 1e-5, damping: 0.03, ..Fabric::COTTON };
    let options = Options { backend: backend_by_name(), quality, fabric, contact, ..Options::default() };
    let motion = move |frame: u32| {
        let seconds = FRAME * frame.saturating_sub(20) as f32;
        let at = Vec3::new(aside * seconds - 0.1, radius + (top - down * seconds).max(room), 0.02);
        let collider = match kind {
            0 => Collider::sphere(at, radius),
            1 => Collider::capsule(at - 0.1 * Vec3::Z, at + 0.1 * Vec3::Z, radius),
            _ => Collider::rounded_box(at, Vec3::new(0.1, radius, 0.1) - 0.01, Quat::from_rotation_y(0.3), 0.01),
        };
        let colliders = vec![collider, Collider::plane(Vec3::ZERO, Vec3::Y)];
        let colliders = colliders.into_iter().map(|collider| collider.with_friction(friction)).collect();
        Attributes { colliders, ..Attributes::default() }
    };
    Scene { mesh, options, motion: Box::new(motion), about }
}

/// How a scene ended.
#[derive(Debug, PartialEq)]
enum End {
    /// Without a crossing.
    Apart,
    /// A body left the cloth no room above the floor, so that they crossed, with a warning.
    Pinched,
}

/// Whether a body of triangles reaches into another collider, or into cloth of this thickness (m) that lies on it.
fn leave_no_room(colliders: &[Collider], thickness: f32) -> bool {
    let vertices = colliders.iter().flat_map(|collider| match &collider.shape {
        Shape::Mesh { mesh } => &mesh.positions[..],
        _ => &[],
    });
    let others = || colliders.iter().filter(|collider| !matches!(collider.shape, Shape::Mesh { .. }));
    vertices.into_iter().any(|&x| others().any(|other| other.distance(x) < thickness))
}

/// Plays a scene to the end, or to the first frame with a crossing.
fn play(scene: &Scene, frames: u32) -> Result<End, String> {
    let mut cloth = Deformer::new(&scene.mesh, scene.options.clone()).map_err(|error| error.to_string())?;
    let thickness = scene.options.contact.map_or(0.0, |contact| contact.thickness);
    for frame in 1..=frames {
        let attributes = (scene.motion)(frame);
        let report = cloth.step(FRAME, &attributes).map_err(|error| format!("frame {frame}: {error}"))?;
        let is_pinched = report.warnings.iter().any(|warning| matches!(warning, Warning::BodyCrossings { .. }));
        let x = cloth.positions().map_err(|error| error.to_string())?;
        let [own, with] = with_itself_and(&attributes.colliders, &scene.mesh, x);
        match [own, with] {
            [0, 0] if !is_pinched => {}
            [0, with] if is_pinched && with > 0 && leave_no_room(&attributes.colliders, thickness) => return Ok(End::Pinched),
            _ => return Err(format!("frame {frame}: {own} crossings, {with} with the body; {:?}", report.warnings)),
        }
    }
    Ok(End::Apart)
}

/// Scenes whose pins or body turn. They crossed before contact measured motion relative to what turns, instead of only to its
/// translation.
fn take_along(backend: Backend, seeds: &[u64]) {
    for &seed in seeds {
        let scene = scene(seed);
        let failed = play(&Scene { options: Options { backend, ..scene.options }, ..scene }, 60);
        assert_eq!(failed, Ok(End::Apart), "seed {seed}");
    }
}

#[test]
fn what_turns_takes_along_what_touches_it() {
    take_along(Backend::Cpu, &[20122, 30305, 30498, 30691, 32316, 34856, 35476, 45941]);
    take_along(Backend::Cpu, &[50132, 50350, 50380, 50399]);
}

#[cfg(feature = "gpu")]
#[test]
fn what_turns_takes_along_what_touches_it_on_the_gpu() {
    take_along(Backend::Gpu, &[20122, 50132]);
}

/// Bodies that move through the floor, with cloth between them, which crossed before cloth went along with what runs over it. Where
/// the number of substeps jumps while the body presses, as the bound on strain of the first scene makes it (from 16 to 215), cloth
/// may be pinched; then it is reported. Of 200 bounds from 1.5 to 5.5 % this happened with 49, before the last iteration of contact was
/// no longer over-relaxed. It may also happen with few substeps: of 80 scenes with 5 to 44, in two, but not the same two since contact
/// was changed.
#[test]
fn what_a_body_presses_on_the_floor_goes_along() {
    let end = |seed, substeps| {
        let scene = scene(seed);
        let options = Options { backend: Backend::Cpu, quality: Quality::Substeps(substeps), ..scene.options };
        play(&Scene { options, ..scene }, 60).unwrap_or_else(|problem| panic!("seed {seed}, {substeps} substeps: {problem:?}"))
    };
    let seeds = [52335, 64821];
    let of_few = seeds.into_iter().flat_map(|seed| (5..=44).map(move |substeps| (seed, substeps)));
    let pinched: Vec<_> = of_few.filter(|&(seed, substeps)| end(seed, substeps) == End::Pinched).collect();
    assert!(pinched.len() <= 2, "pinched: {pinched:?}");
    for (seed, substeps) in seeds.into_iter().flat_map(|seed| [20, 60, 215].map(|substeps| (seed, substeps))) {
        assert_eq!(end(seed, substeps), End::Apart, "seed {seed}, {substeps} substeps");
    }
    let bounded = scene(52335);
    let played = play(&Scene { options: Options { backend: Backend::Cpu, ..bounded.options }, ..bounded }, 60);
    assert!(matches!(played, Ok(End::Apart | End::Pinched)), "{played:?}");
}

/// Cloth that gets no room sinks into colliders. If they carried it as mesh bodies do, 89 of the first 200 scenes would cross, and 2 if
/// they did so only where nothing is run over.
#[test]
fn what_a_collider_presses_on_the_floor_does_not_cross() {
    let (first, cases) = (number("CLOTH_FIRST", 1), number("CLOTH_CASES", 16));
    let fails = |seed: u64| {
        let scene = pressed(seed);
        play(&scene, 70).err().map(|failure| format!("seed {seed}: {failure}\n    {}", scene.about))
    };
    let failed: Vec<String> = (first..first + cases).into_par_iter().filter_map(fails).collect();
    assert!(failed.is_empty(), "{} of {cases}:\n{}", failed.len(), failed.join("\n"));
}

fn number(name: &str, default: u64) -> u64 {
    std::env::var(name).map_or(default, |value| value.parse().expect("a number"))
}

#[test]
fn nothing_crosses() {
    let (first, cases) = (number("CLOTH_FIRST", 1), number("CLOTH_CASES", 12));
    let [played, pinched] = [const { AtomicU64::new(0) }; 2];
    let failed: Vec<String> = (first..first + cases)
        .into_par_iter()
        .filter_map(|seed| {
            let scene = scene(seed);
            if with_itself_and(&(scene.motion)(1).colliders, &scene.mesh, &scene.mesh.positions) != [0, 0] {
                return None;
            }
            played.fetch_add(1, Ordering::Relaxed);
            let ended = play(&scene, 60);
            pinched.fetch_add((ended == Ok(End::Pinched)).into(), Ordering::Relaxed);
            let failed = ended.err().map(|failure| format!("seed {seed}: {failure}\n    {}", scene.about));
            failed.iter().for_each(|failure| println!("{failure}"));
            failed
        })
        .collect();
    assert!(4 * played.into_inner() >= 3 * cases, "too many scenes cross at the start");
    assert!(100 * pinched.into_inner() <= cases, "too many scenes are pinched");
    assert!(failed.is_empty(), "{} of {cases}:\n{}", failed.len(), failed.join("\n"));
}
