//! The cost of cloth contact: without it, with it where nothing touches, at rest on itself, and in a heap.
//!
//! ```text
//! cargo bench --bench contact            # one thread; -- 2 for two; -- heap for the scenes of that name
//! ```
//!
//! Each scene is played with contact and without, a frame of each in turn, so that other load on the machine slows
//! both. One thread is timed by its CPU time where the system provides it (Linux). The motion without contact soon
//! differs from that with it, but the cost of a step hardly depends on the motion, so the two are compared.

use std::f32::consts::PI;
use std::time::Instant;

use cloth_deformer::glam::{Quat, Vec3};
use cloth_deformer::{Attributes, Backend, Collider, Contact, Deformer, Fabric, Mesh, Options, Quality};

const FRAME: f32 = 1.0 / 60.0;

struct Scene {
    name: &'static str,
    mesh: Mesh,
    substeps: u32,
    pinned: Vec<u32>,
    colliders: Vec<Collider>,
    /// Initial positions, if they are not those of the rest shape.
    start: Option<Vec<Vec3>>,
    /// Number of frames before timing, and of frames that are timed.
    frames: [u32; 2],
}

fn scenes() -> Vec<Scene> {
    let floor = Collider::plane(Vec3::ZERO, Vec3::Y);
    let grid = |n: u32| Mesh::grid(n, n, 1.0, 1.0);
    let on_edge = |n: u32| {
        let mut mesh = grid(n);
        let turn = Quat::from_rotation_x(1.5);
        // A grid that is exactly flat would fall without folding.
        for (index, x) in (0_u16..).zip(&mut mesh.positions) {
            *x = turn * *x + Vec3::new(0.0, 0.6, 1e-4 * f32::from(index % 7));
        }
        mesh
    };
    let lying = |n: u32| {
        let (mut mesh, other) = (grid(n), grid(n));
        mesh.positions.iter_mut().for_each(|x| x.y += 0.005);
        let above = |&x: &Vec3| Quat::from_rotation_y(0.1) * x + 0.011 * Vec3::Y;
        mesh.positions.extend(other.positions.iter().map(above));
        mesh.triangles.extend(other.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + n * n)));
        mesh
    };
    // Folded over so that one half lies above the other.
    let (radius, quarter) = (0.05_f32, 0.5 * PI * 0.05);
    let bent = |x: &Vec3| {
        let (z, y) = match x.z {
            along if along < -quarter => (along + quarter, 0.0),
            along if along > quarter => (quarter - along, 2.0 * radius),
            along => {
                let (sin, cos) = ((along + quarter) / radius).sin_cos();
                (radius * sin, radius * (1.0 - cos))
            }
        };
        Vec3::new(x.x, 0.02 + y, z)
    };
    let fold = Some(grid(40).positions.iter().map(bent).collect());
    let row = |n: u32| (0..n).collect();
    vec![
        Scene {
            name: "hangs, 64",
            mesh: grid(64),
            substeps: 40,
            pinned: row(64),
            colliders: vec![],
            start: None,
            frames: [120, 60],
        },
        Scene {
            name: "swings, 64",
            mesh: grid(64),
            substeps: 40,
            pinned: row(64),
            colliders: vec![],
            start: None,
            frames: [1, 24],
        },
        Scene {
            name: "two lie, 32",
            mesh: lying(32),
            substeps: 20,
            pinned: vec![],
            colliders: vec![floor.clone()],
            start: None,
            frames: [60, 30],
        },
        Scene {
            name: "fold, 40",
            mesh: grid(40),
            substeps: 20,
            pinned: vec![],
            colliders: vec![floor.clone()],
            start: fold,
            frames: [1, 60],
        },
        Scene {
            name: "heap, 32",
            mesh: on_edge(32),
            substeps: 20,
            pinned: vec![],
            colliders: vec![floor.clone()],
            start: None,
            frames: [20, 70],
        },
        Scene {
            name: "heap, 64",
            mesh: on_edge(64),
            substeps: 40,
            pinned: vec![],
            colliders: vec![floor.clone()],
            start: None,
            frames: [20, 30],
        },
    ]
}

/// The CPU time (s) of this thread, where the system provides it; otherwise, or if threads share the work, the time
/// since `start`.
fn seconds(start: Instant) -> f64 {
    let told = || std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse::<f64>().ok();
    let alone = rayon::current_num_threads() == 1;
    alone.then(told).flatten().map_or_else(|| start.elapsed().as_secs_f64(), |nanoseconds| 1e-9 * nanoseconds)
}

/// Milliseconds per frame with contact and without, and what contact did in the last frame.
fn timed(scene: &Scene) -> ([f64; 2], [u32; 4], f64) {
    let attributes = Attributes { colliders: scene.colliders.clone(), ..Attributes::default() };
    let mut cloths = [Some(Contact::default()), None].map(|contact| {
        let options = Options {
            backend: Backend::Cpu,
            quality: Quality::Substeps(scene.substeps),
            fabric: Fabric { density: 0.2, stretch: 5000.0, bending: 1e-4, damping: 0.03 },
            pinned: scene.pinned.clone(),
            contact,
            ..Options::default()
        };
        let mut cloth = Deformer::new(&scene.mesh, options).expect("the scene is sound");
        let still = vec![Vec3::ZERO; scene.mesh.positions.len()];
        scene.start.iter().for_each(|start| cloth.set_state(start, &still).expect("the scene is sound"));
        cloth
    });
    let (mut times, mut detections, start) = ([0.0; 2], 0, Instant::now());
    for frame in 0..scene.frames[0] + scene.frames[1] {
        for (cloth, time) in cloths.iter_mut().zip(&mut times) {
            let begin = seconds(start);
            cloth.step(FRAME, &attributes).expect("the step succeeds");
            if frame >= scene.frames[0] {
                *time += 1e3 * (seconds(start) - begin) / f64::from(scene.frames[1]);
            }
        }
        detections += if frame < scene.frames[0] { 0 } else { cloths[0].contact_tally()[1] };
    }
    (times, cloths[0].contact_tally(), f64::from(detections) / f64::from(scene.frames[1]))
}

fn main() {
    let threads = std::env::args().skip(1).find_map(|word| word.parse().ok()).unwrap_or(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    println!(
        "| {threads} thread(s), ms a frame | without | with | ratio | pairs that press, near, listed | detections a frame |"
    );
    println!("|---|---|---|---|---|---|");
    let named = std::env::args().skip(1).find(|word| word.starts_with(char::is_alphabetic)).unwrap_or_default();
    for scene in scenes().iter().filter(|scene| scene.name.contains(&named)) {
        let ([with, without], [press, _, listed, near], detections) = pool.install(|| timed(scene));
        let ratio = with / without;
        println!("| {} | {without:.2} | {with:.2} | {ratio:.2} | {press}, {near}, {listed} | {detections:.1} |", scene.name);
    }
}
