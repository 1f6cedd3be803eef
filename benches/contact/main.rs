//! The cost of cloth contact: without it, with it where nothing touches, at rest on itself, in a heap, and on a body.
//!
//! ```text
//! cargo bench --bench contact            # one thread; -- 2 for two; -- heap for the scenes of that name
//! cargo bench --bench contact -- gpu     # on the GPU; -- gpu twist for the scenes of that name
//! cargo bench --bench contact -- default # with the default quality instead of the scene's own number of substeps
//! ```
//!
//! Each scene is played with contact and without, a frame of each in turn, so that other load on the machine slows
//! both. One thread is timed by its CPU time where the system provides it (Linux). The motion without contact soon
//! differs from that with it, but the cost of a step hardly depends on the motion, so the two are compared.
//!
//! Each scene is played once more, untimed, for its errors: the largest stretch of 99 % of the area and of any edge in any
//! timed frame, and the crossings that are counted in double precision in every fifth.

#[allow(dead_code, unreachable_pub, reason = "the tests count with all of this")]
#[path = "../../tests/common/crossings.rs"]
mod crossings;
mod scenes;

use std::time::Instant;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Contact, Deformer, Fabric, Options, Quality};

use crossings::with_itself_and;
use scenes::{Scene, large, scenes};

const FRAME: f32 = 1.0 / 60.0;

/// The CPU time (s) of this thread, where the system provides it; otherwise, or if threads share the work, the time
/// since `start`.
fn seconds(start: Instant) -> f64 {
    let told = || std::fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse::<f64>().ok();
    let alone = rayon::current_num_threads() == 1;
    alone.then(told).flatten().map_or_else(|| start.elapsed().as_secs_f64(), |nanoseconds| 1e-9 * nanoseconds)
}

/// How the scenes are played.
#[derive(Clone, Copy)]
struct Play {
    backend: Backend,
    /// With the default quality instead of the scene's own number of substeps.
    by_default: bool,
}

/// The cloth of a scene in its initial state.
fn cloth(scene: &Scene, Play { backend, by_default }: Play, contact: Option<Contact>) -> Deformer {
    let options = Options {
        backend,
        quality: if by_default { Quality::default() } else { Quality::Substeps(scene.substeps) },
        fabric: Fabric { density: 0.2, stretch: 5000.0, bending: 1e-4, damping: 0.03 },
        pinned: scene.pinned.clone(),
        contact,
        ..Options::default()
    };
    let mut cloth = Deformer::new(&scene.mesh, options).expect("the scene is sound");
    let still = vec![Vec3::ZERO; scene.mesh.positions.len()];
    if let Some(start) = &scene.start {
        cloth.set_state(start, &still).expect("the scene is sound");
        cloth.place_colliders(&scene.colliders(0, contact.is_some())).expect("they are sound");
    }
    cloth
}

/// The attributes of a frame.
fn attributes(scene: &Scene, frame: u32, has_contact: bool) -> Attributes {
    let colliders = scene.colliders(frame + 1, has_contact);
    Attributes { colliders, pin_targets: scene.targets(frame + 1), ..Attributes::default() }
}

/// What a scene took.
#[derive(Default)]
struct Cost {
    /// Milliseconds per frame with contact and without, and of the longest frame with contact.
    times: [f64; 2],
    longest: f64,
    /// The counts of contact in the last frame, and detections per frame.
    tally: [u32; 4],
    detections: f64,
}

impl Cost {
    /// Notes a timed frame with contact that took so many milliseconds.
    fn note(&mut self, scene: &Scene, milliseconds: f64, tally: [u32; 4]) {
        self.longest = self.longest.max(milliseconds);
        self.tally = tally;
        self.detections += f64::from(tally[1]) / f64::from(scene.frames[1]);
    }
}

/// How accurate the timed frames with contact are.
#[derive(Default)]
struct Errors {
    /// Mean number of substeps of a frame.
    substeps: f64,
    /// The largest stretch of 99 % of the area, and of any edge.
    stretch: f32,
    worst: f32,
    /// The most crossings of the cloth with itself and with bodies.
    crossings: usize,
}

/// The errors of a scene, which does the same when it is played again.
fn errors(scene: &Scene, play: Play) -> Errors {
    let (mut cloth, mut errors) = (cloth(scene, play, Some(Contact::default())), Errors::default());
    for frame in 0..scene.frames[0] + scene.frames[1] {
        let attributes = attributes(scene, frame, true);
        let report = cloth.step(FRAME, &attributes).expect("the step succeeds");
        if frame >= scene.frames[0] {
            errors.substeps += f64::from(report.substeps) / f64::from(scene.frames[1]);
            let measure = cloth.measure().expect("the device is there");
            errors.stretch = errors.stretch.max(measure.stretch_share);
            errors.worst = errors.worst.max(measure.max_strain);
            if (frame - scene.frames[0]) % 5 == 4 {
                let positions = cloth.positions().expect("the device is there");
                let found = with_itself_and(&attributes.colliders, &scene.mesh, positions);
                errors.crossings = errors.crossings.max(found.iter().sum());
            }
        }
    }
    errors
}

fn timed(scene: &Scene, play: Play) -> Cost {
    let mut cloths = [Some(Contact::default()), None].map(|contact| cloth(scene, play, contact));
    let (mut cost, start) = (Cost::default(), Instant::now());
    for frame in 0..scene.frames[0] + scene.frames[1] {
        for (index, cloth) in cloths.iter_mut().enumerate() {
            let attributes = attributes(scene, frame, index == 0);
            let begin = seconds(start);
            cloth.step(FRAME, &attributes).expect("the step succeeds");
            if frame >= scene.frames[0] {
                let took = 1e3 * (seconds(start) - begin);
                cost.times[index] += took / f64::from(scene.frames[1]);
                if index == 0 {
                    cost.note(scene, took, cloth.contact_tally());
                }
            }
        }
    }
    cost
}

/// Works the GPU for half a second, because an idle one has a low clock: without this, what was played first took four times
/// as long for the first 0.3 s.
fn warm_up(scene: &Scene, play: Play) {
    let still = Attributes { gravity: Vec3::ZERO, ..Attributes::default() };
    let (mut cloth, start) = (cloth(scene, play, None), Instant::now());
    while start.elapsed().as_secs_f64() < 0.5 {
        cloth.step(FRAME, &still).expect("the step succeeds");
        cloth.positions().expect("the GPU is there");
    }
}

/// The same on the GPU, with contact first and then without, so that steps can be prepared while the GPU works.
fn timed_on_gpu(scene: &Scene, play: Play) -> Cost {
    let mut cost = Cost::default();
    cost.times = [Some(Contact::default()), None].map(|contact| {
        let mut cloth = cloth(scene, play, contact);
        let frames = 0..scene.frames[0] + scene.frames[1];
        let attributes: Vec<Attributes> = frames.clone().map(|frame| attributes(scene, frame, contact.is_some())).collect();
        let mut start = Instant::now();
        for (frame, attributes) in frames.zip(&attributes) {
            if frame == scene.frames[0] {
                cloth.positions().expect("the GPU is there");
                warm_up(scene, play);
                start = Instant::now();
            }
            let begin = Instant::now();
            cloth.step(FRAME, attributes).expect("the step succeeds");
            // A step with contact waits for the GPU.
            if contact.is_some() && frame >= scene.frames[0] {
                cost.note(scene, 1e3 * begin.elapsed().as_secs_f64(), cloth.contact_tally());
            }
        }
        cloth.positions().expect("the GPU is there");
        1e3 * start.elapsed().as_secs_f64() / f64::from(scene.frames[1])
    });
    cost
}

fn main() {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let is_said = |word: &str| words.iter().any(|said| said == word);
    let (on_gpu, by_default) = (is_said("gpu"), is_said("default"));
    let play = Play { backend: if on_gpu { Backend::Gpu } else { Backend::Cpu }, by_default };
    let threads = words.iter().find_map(|word| word.parse().ok()).unwrap_or(1);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    let processor = if on_gpu { "GPU".to_owned() } else { format!("{threads} thread(s)") };
    println!(
        "| {processor}, ms a frame | without | with | ratio | longest | substeps | stretch of 99 %, of the worst edge | crossings \
         | pairs that press, near, listed | detections a frame |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let is_name = |word: &&String| word.starts_with(char::is_alphabetic) && !["gpu", "default"].contains(&word.as_str());
    let named = words.iter().find(is_name).map_or("", String::as_str);
    for scene in if on_gpu { large() } else { scenes() }.iter().filter(|scene| scene.name.contains(named)) {
        let timed = || if on_gpu { timed_on_gpu(scene, play) } else { timed(scene, play) };
        let Cost { times: [with, without], longest, tally: [press, _, listed, near], detections } = pool.install(timed);
        let Errors { substeps, stretch, worst, crossings } = pool.install(|| errors(scene, play));
        print!("| {} | {without:.2} | {with:.2} | {:.2} | {longest:.2} | {substeps:.0} ", scene.name, with / without);
        println!("| {stretch:.4}, {worst:.3} | {crossings} | {press}, {near}, {listed} | {detections:.1} |");
    }
}
