//! The cost of cloth contact: without it, with it where nothing touches, at rest on itself, in a heap, and on a body.
//!
//! ```text
//! cargo bench --bench contact            # one thread; -- 2 for two; -- heap for the scenes of that name
//! cargo bench --bench contact -- gpu     # on the GPU; -- gpu twist for the scenes of that name
//! ```
//!
//! Each scene is played with contact and without, a frame of each in turn, so that other load on the machine slows
//! both. One thread is timed by its CPU time where the system provides it (Linux). The motion without contact soon
//! differs from that with it, but the cost of a step hardly depends on the motion, so the two are compared.

mod scenes;

use std::time::Instant;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Contact, Deformer, Fabric, Options, Quality};

use scenes::{Scene, large, scenes};

const FRAME: f32 = 1.0 / 60.0;

/// The CPU time (s) of this thread, where the system provides it; otherwise, or if threads share the work, the time
/// since `start`.
fn seconds(start: Instant) -> f64 {
    let told = || std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse::<f64>().ok();
    let alone = rayon::current_num_threads() == 1;
    alone.then(told).flatten().map_or_else(|| start.elapsed().as_secs_f64(), |nanoseconds| 1e-9 * nanoseconds)
}

/// The cloth of a scene in its initial state.
fn cloth(scene: &Scene, backend: Backend, contact: Option<Contact>) -> Deformer {
    let options = Options {
        backend,
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
}

/// The attributes of a frame.
fn attributes(scene: &Scene, frame: u32, has_contact: bool) -> Attributes {
    let colliders = scene.colliders(frame + 1, has_contact);
    Attributes { colliders, pin_targets: scene.targets(frame + 1), ..Attributes::default() }
}

/// Milliseconds per frame with contact and without, the counts of contact in the last frame, and detections per frame.
fn timed(scene: &Scene) -> ([f64; 2], [u32; 4], f64) {
    let mut cloths = [Some(Contact::default()), None].map(|contact| cloth(scene, Backend::Cpu, contact));
    let (mut times, mut detections, start) = ([0.0; 2], 0, Instant::now());
    for frame in 0..scene.frames[0] + scene.frames[1] {
        for ((cloth, time), has_contact) in cloths.iter_mut().zip(&mut times).zip([true, false]) {
            let attributes = attributes(scene, frame, has_contact);
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

/// The same on the GPU, with contact first and then without, so that steps can be prepared while the GPU works.
fn timed_on_gpu(scene: &Scene) -> ([f64; 2], [u32; 4], f64) {
    let (mut tally, mut detections) = ([0; 4], 0);
    let times = [Some(Contact::default()), None].map(|contact| {
        let mut cloth = cloth(scene, Backend::Gpu, contact);
        let frames = 0..scene.frames[0] + scene.frames[1];
        let attributes: Vec<Attributes> = frames.clone().map(|frame| attributes(scene, frame, contact.is_some())).collect();
        let mut start = Instant::now();
        for (frame, attributes) in frames.zip(&attributes) {
            if frame == scene.frames[0] {
                cloth.positions().expect("the GPU is there");
                start = Instant::now();
            }
            cloth.step(FRAME, attributes).expect("the step succeeds");
            if contact.is_some() {
                tally = cloth.contact_tally();
                detections += if frame < scene.frames[0] { 0 } else { tally[1] };
            }
        }
        cloth.positions().expect("the GPU is there");
        let time = 1e3 * start.elapsed().as_secs_f64() / f64::from(scene.frames[1]);
        let crossings = cloth.crossings().expect("the GPU is there").len();
        if contact.is_some() && crossings > 0 {
            println!("{}: {crossings} crossings", scene.name);
        }
        time
    });
    (times, tally, f64::from(detections) / f64::from(scene.frames[1]))
}

fn main() {
    let words = || std::env::args().skip(1);
    let on_gpu = words().any(|word| word == "gpu");
    let threads = words().find_map(|word| word.parse().ok()).unwrap_or(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let processor = if on_gpu { "GPU".to_owned() } else { format!("{threads} thread(s)") };
    println!("| {processor}, ms a frame | without | with | ratio | pairs that press, near, listed | detections a frame |");
    println!("|---|---|---|---|---|---|");
    let named = words().find(|word| word.starts_with(char::is_alphabetic) && word != "gpu").unwrap_or_default();
    for scene in if on_gpu { large() } else { scenes() }.iter().filter(|scene| scene.name.contains(&named)) {
        let timed = || if on_gpu { timed_on_gpu(scene) } else { timed(scene) };
        let ([with, without], [press, _, listed, near], detections) = pool.install(timed);
        let ratio = with / without;
        println!("| {} | {without:.2} | {with:.2} | {ratio:.2} | {press}, {near}, {listed} | {detections:.1} |", scene.name);
    }
}
