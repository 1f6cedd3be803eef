//! Automatic substeps: a promise about strain is kept or reported as missed, with the same bits on any number of
//! threads, and can be repeated as a number of substeps. Also the time budget, and sleeping cloth, which takes no
//! substeps.

#[macro_use]
mod common;

use std::sync::Arc;

use cloth_deformer::glam::{Quat, Vec3};
use cloth_deformer::{
    Attributes, Backend, BuildError, Cause, Collider, Contact, Deformer, Fabric, Levels, Mesh, Method, Options, Quality, Sleep,
    StepReport, Warning,
};
use common::energy::{energy, masses};
use common::meshes;
use common::shapes::tube;
use common::{FRAME, bits, rms, top};

on_every_backend!(
    reports_are_of_the_motion,
    reports_with_contact_are_of_the_same_step,
    reports_are_of_the_same_step_once_there_is_contact,
    what_is_unpinned_falls,
    any_step_can_be_asked_for_again,
    a_bound_takes_the_levels_that_pay,
    a_settled_cloth_sleeps_and_wakes,
    what_flies_steadily_does_not_sleep,
);

/// Sheets that hang by two corners and the middle of a side, which come closer in the first second: after eight more they
/// rest, and the number of substeps that keeps the bound does not change. The controller of before went up and down by four
/// numbers for ever, and kicked the cloth each time (speeds of 1 to 3 m/s).
#[test]
fn cloth_at_rest_keeps_its_substeps() {
    for (n, fabric) in [(24, Fabric::DENIM), (32, Fabric::COTTON), (40, Fabric::SILK)] {
        let mut mesh = Mesh::grid(n, n, 1.0, 1.0);
        mesh.positions.iter_mut().for_each(|x| *x = Vec3::new(0.999 * x.x, x.z, 0.05 * x.x));
        let pinned = vec![0, n - 1, n * (n / 2)];
        let start: Vec<Vec3> = pinned.iter().map(|&pin| mesh.positions[pin as usize]).collect();
        let mut cloth = Deformer::new(&mesh, Options { fabric, pinned, ..Options::default() }).unwrap();
        let mut step = |frame: u32| {
            let gathered = Vec3::new(1.0 - 0.2 * (frame as f32 / 60.0).min(1.0), 1.0, 1.0);
            let pin_targets = Some(start.iter().map(|pin| *pin * gathered).collect());
            let report = cloth.step(FRAME, &Attributes { damping: 1.0, pin_targets, ..Attributes::default() }).unwrap();
            (report.substeps, report.levels)
        };
        (1..=540).for_each(|frame| _ = step(frame));
        let chosen: Vec<_> = (541..=660).map(step).collect();
        let speed = cloth.velocities().unwrap().iter().map(|v| v.length()).fold(0.0, f32::max);
        println!("{n}: {:?} substeps and levels, {speed:.3} m/s", chosen[0]);
        assert!(chosen.iter().all(|one| *one == chosen[0]), "{n}: {chosen:?}");
        assert!(speed < 0.1, "{n}: {speed} m/s");
    }
}

/// A sheet on four pins into which a ball is pushed, and stays: tethers of lone pins make the stretch depend on the number of substeps
/// more steeply than the law of the controller, so that one number left too much and the next nothing to correct. The controller of
/// before went from one to the other for ever (26 to 33 changes of substeps or levels in these 80 frames), and kicked the cloth each
/// time (speeds of 1.7 to 3.2 m/s at the end).
#[test]
fn cloth_that_is_held_stretched_keeps_its_substeps() {
    for (n, seed, fabric, depth) in [(20, 1, Fabric::COTTON, 0.2), (24, 3, Fabric::COTTON, 0.27), (32, 7, Fabric::DENIM, 0.27)] {
        let options = Options { fabric, pinned: vec![0, n - 1, n * (n - 1), n * n - 1], ..Options::default() };
        let mut cloth = Deformer::new(&meshes::delaunay(n, seed), options).unwrap();
        let mut step = |frame: u32| {
            let pushed = ((frame as f32 / 60.0 - 0.3) / 0.4).clamp(0.0, 1.0);
            let height = 0.13 - (0.01 + depth) * pushed * pushed * (3.0 - 2.0 * pushed);
            let colliders = vec![Collider::sphere(Vec3::new(0.1, height, 0.05), 0.12)];
            let report = cloth.step(FRAME, &Attributes { damping: 0.5, colliders, ..Attributes::default() }).unwrap();
            (report.substeps, report.levels)
        };
        (1..=120).for_each(|frame| _ = step(frame));
        let chosen: Vec<_> = (121..=200).map(step).collect();
        let speed = cloth.velocities().unwrap().iter().map(|v| v.length()).fold(0.0, f32::max);
        println!("{n}: {:?} substeps and levels, {speed:.3} m/s", chosen[0]);
        assert!(chosen.iter().all(|one| *one == chosen[0]), "{n}: {chosen:?}");
        assert!(speed < 0.5, "{n}: {speed} m/s");
    }
}

/// A sail that wind holds taut, and jersey that hangs from its corners, come to rest and stay so. Their numbers of substeps went up and
/// down for ever: as soon as one was too few, as many as resolve the cloth were taken, and less and less again. The sail moved at
/// 0.8 m/s and the jersey at up to 1.9 m/s.
#[test]
fn what_is_held_taut_comes_to_rest() {
    let corners = |n: u32| vec![0, n - 1, n * (n - 1), n * n - 1];
    let wind = Attributes { gravity: Vec3::ZERO, wind: Vec3::Y * 10.0, air_density: 1.225, ..Attributes::default() };
    let still = Attributes { damping: 1.0, ..Attributes::default() };
    for (n, fabric, attributes, frames) in [(41, Fabric::SILK, wind, 1200), (41, Fabric::JERSEY, still, 1200)] {
        let options = Options { backend: Backend::Cpu, fabric, pinned: corners(n), ..Options::default() };
        let mut cloth = Deformer::new(&Mesh::grid(n, n, 1.0, 1.0), options).unwrap();
        let speed = |frame| {
            cloth.step(FRAME, &attributes).unwrap();
            let speed = cloth.velocities().unwrap().iter().map(|v| v.length()).fold(0.0, f32::max);
            if frame + 150 < frames { 0.0 } else { speed }
        };
        let fastest = (0..frames).map(speed).fold(0.0, f32::max);
        println!("{fastest} m/s in the last 150 of {frames} frames");
        assert!(fastest < 0.1, "{fastest} m/s in the last 150 of {frames} frames");
    }
}

/// Sheets that are held on four sides, and released where they are flat, swing and come to rest in air. If what they need while they are
/// stretched were forgotten while they are slack, they would never: the towel would swing at 1 m/s, the jersey at .35 m/s.
#[test]
fn what_is_held_taut_stops_swinging() {
    let n = 21;
    let sides = |v: &u32| [v % n, v / n].iter().any(|&place| place == 0 || place == n - 1);
    let air = Attributes { air_density: 1.225, ..Attributes::default() };
    for (fabric, size) in [(Fabric::TOWEL, 3.0), (Fabric::TOWEL, 10.0), (Fabric::JERSEY, 0.6)] {
        let pinned = (0..n * n).filter(sides).collect();
        let options = Options { backend: Backend::Cpu, fabric, pinned, ..Options::default() };
        let mut cloth = Deformer::new(&Mesh::grid(n, n, size, size), options).unwrap();
        let mean_speed = |_| {
            cloth.step(FRAME, &air).unwrap();
            let velocities = cloth.velocities().unwrap();
            (velocities.iter().map(|v| v.length_squared()).sum::<f32>() / (n * n) as f32).sqrt()
        };
        let speeds: Vec<f32> = (0..480).map(mean_speed).collect();
        let [early, late] = [0, 420].map(|from| speeds[from..from + 60].iter().copied().fold(0.0, f32::max));
        println!("{size} m: {early} m/s in the first second, {late} m/s in the eighth");
        assert!(early > 0.2 && late < 0.2 * early, "{size} m: {early} and {late} m/s");
    }
}

/// A sheet of jersey that is shaken. Its own stretch is what a step leaves that resolves its stiffness, from the same state. The
/// controller, which estimates it by the largest load that there may be, must not excuse much more. Before it doubted what the motion
/// adds (`DOUBT_IN_MOTION` in `src/step/controller.rs`), 70 of these frames broke the promise without a warning.
#[test]
fn soft_cloth_that_is_shaken_keeps_its_promise() {
    let mut mesh = meshes::delaunay(28, 3);
    mesh.positions.iter_mut().for_each(|x| *x *= 0.8);
    let (pinned, start) = ((0..28).collect(), mesh.positions[..28].to_vec());
    let mut cloth = Deformer::new(&mesh, Options { fabric: Fabric::JERSEY, pinned, ..Options::default() }).unwrap();
    let (mut broken, mut warned) = (0, 0);
    for frame in 1..=240 {
        let t = frame as f32 / 60.0;
        let shaken = Vec3::new(0.1 * (9.0 * t).sin(), 0.5 * (7.0 * t).sin(), 0.0) * t.min(1.0);
        let pin_targets = Some(start.iter().map(|pin| *pin + shaken).collect());
        let attributes = Attributes { pin_targets, ..Attributes::default() };
        let before = cloth.snapshot().unwrap();
        cloth.set_quality(Quality::Substeps(200)).unwrap();
        cloth.step(FRAME, &attributes).unwrap();
        let own = cloth.measure().unwrap().stretch_share;
        cloth.set_quality(Quality::default()).unwrap();
        cloth.restore(&before).unwrap();
        let report = cloth.step(FRAME, &attributes).unwrap();
        let missed = report.warnings.iter().any(|warning| matches!(warning, Warning::StrainMissed { .. }));
        let stretch = report.stretch.unwrap().share;
        warned += u32::from(missed);
        broken += u32::from(stretch > own + 0.03 && !missed);
    }
    println!("{broken} frames beyond without a warning, {warned} with one");
    assert!(broken <= 12, "{broken} frames");
    assert!(warned <= 24, "{warned} frames");
}

/// The attributes of a scene as a function of the frame.
type Script = Box<dyn Fn(u32) -> Attributes + Sync>;

/// A sheet hung by two corners; one hung by an edge that is jerked up at 5 m/s after a second; a flag in gusts of 10
/// m/s.
fn scenes(backend: Backend) -> Vec<(&'static str, Mesh, Options, Script)> {
    let base = Options { backend, fabric: Fabric { bending: 0.0, ..Fabric::COTTON }, ..Options::default() };
    let sheet = Mesh::grid(33, 33, 1.0, 1.0);
    let start: Vec<Vec3> = sheet.positions[..33].to_vec();
    let jerk = move |frame: u32| {
        let lift = (5.0 / 60.0 * frame.saturating_sub(60) as f32).min(1.0);
        let pin_targets = Some(start.iter().map(|pin| *pin + Vec3::new(0.0, lift, 0.0)).collect());
        Attributes { pin_targets, ..Attributes::default() }
    };
    let mut flag = Mesh::grid(37, 25, 1.5, 1.0);
    flag.positions.iter_mut().for_each(|x| *x = Vec3::new(x.x, -x.z, 0.0));
    let gusts = |frame: u32| {
        let across = 3.0 * (4.4 * FRAME * frame as f32).sin();
        Attributes { wind: Vec3::new(10.0, 0.0, across), air_density: 1.225, ..Attributes::default() }
    };
    let still: Script = Box::new(|_| Attributes::default());
    vec![
        ("two corners", sheet.clone(), Options { pinned: vec![0, 32], ..base.clone() }, still),
        ("jerk", sheet, Options { pinned: top(33), ..base.clone() }, Box::new(jerk)),
        ("flag", flag, Options { pinned: (0..25).map(|row| 37 * row).collect(), ..base }, Box::new(gusts)),
    ]
}

/// For some frames the step's report and the stretch that 99 % of the area did not exceed after it.
fn played(mesh: &Mesh, options: &Options, script: &Script, frames: u32) -> Vec<(StepReport, f32)> {
    let mut deformer = Deformer::new(mesh, options.clone()).unwrap();
    let step = |frame| {
        let report = deformer.step(FRAME, &script(frame)).unwrap();
        (report, deformer.measure().unwrap().stretch_share)
    };
    (1..=frames).map(step).collect()
}

#[test]
fn a_promise_is_kept_for_few_substeps() {
    let promised = 0.03;
    for (name, mesh, options, script) in scenes(Backend::Cpu) {
        let frames = played(&mesh, &Options { quality: Quality::Strain(promised), ..options.clone() }, &script, 180);
        let missed = |report: &StepReport| report.warnings.iter().any(|warning| matches!(warning, Warning::StrainMissed { .. }));
        let silent = frames.iter().filter(|(report, stretch)| *stretch > promised + 0.01 && !missed(report)).count();
        let said = frames.iter().filter(|(report, _)| missed(report)).count();
        let substeps = frames.iter().map(|(report, _)| report.substeps);
        let (mean, most) = (substeps.clone().sum::<u32>() / 180, substeps.clone().max().unwrap());
        println!("{name}: {mean} substeps on average, {most} at most, {said} frames missed, {silent} in silence");
        assert!(silent == 0 && said <= 3, "{name}: {silent} frames in silence, {said} said to be missed");
        if name == "jerk" {
            // The substeps that sufficed before the jerk do not suffice for it, so adapting them matters.
            let before = frames[58].0.in_a_sixtieth;
            let even = played(&mesh, &Options { quality: Quality::Substeps(before), ..options }, &script, 180);
            let beyond = even.iter().filter(|(_, stretch)| *stretch > promised + 0.01).count();
            println!("{name}: {beyond} frames beyond with {before} substeps in each");
            assert!(beyond > 3, "{name}: an even number would do");
        }
    }
}

/// The reported stretch is the measured one, of the same step or, on the GPU, of three steps before.
fn reports_are_of_the_motion(backend: Backend) {
    are_of_the_motion(backend, None, if backend == Backend::Gpu { 3 } else { 0 });
}

/// A step with contact waits for the GPU anyway.
fn reports_with_contact_are_of_the_same_step(backend: Backend) {
    are_of_the_motion(backend, Some(Contact::default()), 0);
}

/// Also if contact comes after steps without it, whose statistics are still to arrive.
fn reports_are_of_the_same_step_once_there_is_contact(backend: Backend) {
    let mut deformer =
        Deformer::new(&Mesh::grid(9, 9, 0.5, 0.5), Options { backend, pinned: vec![0, 8], ..Options::default() }).unwrap();
    (0..6).for_each(|_| _ = deformer.step(FRAME, &Attributes::default()).unwrap());
    let body = Collider::mesh(Arc::new(Mesh {
        positions: [Vec3::X, Vec3::Y, Vec3::Z].map(|x| x + 5.0).to_vec(),
        triangles: vec![[0, 1, 2]],
    }));
    let attributes = Attributes { colliders: vec![body], ..Attributes::default() };
    for frame in 0..6 {
        let told = deformer.step(FRAME, &attributes).unwrap().stretch.unwrap();
        let now = deformer.measure().unwrap();
        assert!((told.worst - now.max_strain).abs() <= 1e-3 * now.max_strain + 1e-4, "frame {frame}: {told:?}, measured {now:?}");
    }
}

/// Cloth that cannot stretch, and is held stretched: no number of substeps helps, and none is too many. It is then taut, and its substeps
/// take seconds to fall.
#[test]
fn what_is_held_stretched_does_not_run_away() {
    let mesh = Mesh::grid(9, 9, 1.0, 1.0);
    let pinned: Vec<u32> = (0..81).filter(|v| v % 9 == 0 || v % 9 == 8).collect();
    let fabric = Fabric { stretch: f32::INFINITY, ..Fabric::default() };
    let options = Options { backend: Backend::Cpu, fabric, pinned: pinned.clone(), ..Options::default() };
    let mut deformer = Deformer::new(&mesh, options).unwrap();
    let mut step = |frame: u32| {
        // By a tenth in a sixth of a second, and back after half a second.
        let by = 0.01 * if frame < 30 { frame.min(10) } else { 40_u32.saturating_sub(frame).min(10) } as f32;
        let led = |&pin: &u32| mesh.positions[pin as usize] + Vec3::X * if pin % 9 == 8 { by } else { 0.0 };
        let pin_targets = Some(pinned.iter().map(led).collect());
        let report = deformer.step(FRAME, &Attributes { pin_targets, ..Attributes::default() }).unwrap();
        (report.substeps, report.warnings.iter().any(|warning| matches!(warning, Warning::StrainMissed { .. })))
    };
    let played: Vec<(u32, bool)> = (0..240).map(&mut step).collect();
    let (most, last) = (played.iter().map(|(substeps, _)| *substeps).max().unwrap(), played[239].0);
    println!("at most {most} substeps, {last} in the end");
    assert!(played[..40].iter().any(|(_, missed)| *missed), "it is said that it is stretched");
    assert!(most < 500 && 2 * last < most, "at most {most} substeps, {last} in the end");
}

/// A skirt in contact with itself whose waist was turned for a second falls asleep. The substeps with which heaps of cloth come to
/// rest, at least 16, make it tremble for ever.
#[test]
fn a_garment_in_contact_falls_asleep() {
    let (mesh, pinned): (_, Vec<u32>) = (tube(0.235, 0.7, 36, 26), top(36));
    let waist: Vec<Vec3> = pinned.iter().map(|&pin| mesh.positions[pin as usize]).collect();
    let (contact, sleep) = (Some(Contact::default()), Some(Sleep::default()));
    let options = Options { backend: Backend::Cpu, fabric: Fabric::COTTON, pinned, contact, sleep, ..Options::default() };
    let mut skirt = Deformer::new(&mesh, options).unwrap();
    let mut falls_asleep = |frame: u32| {
        let turn = Quat::from_rotation_y(1.2 * (4.0 * frame.min(60) as f32 * FRAME).sin());
        let targets = waist.iter().map(|&x| turn * x).collect();
        let scene = Attributes { damping: 1.0, pin_targets: Some(targets), ..Attributes::default() };
        skirt.step(FRAME, &scene).unwrap().asleep
    };
    assert!((0..720).any(&mut falls_asleep), "awake after twelve seconds");
}

/// A reset forgets for how long the cloth was still, and placed colliders wake it.
#[test]
fn the_clock_of_sleep_is_reset() {
    let sleep = Some(Sleep { after: 0.1, ..Sleep::default() });
    let options = Options { backend: Backend::Cpu, quality: Quality::Substeps(5), sleep, ..Options::default() };
    let mut cloth = Deformer::new(&Mesh::grid(6, 6, 0.3, 0.3), options).unwrap();
    let scene = Attributes { colliders: vec![Collider::plane(Vec3::ZERO, Vec3::Y)], ..Attributes::default() };
    let mut fell_asleep = || {
        let frame = (0..60).find(|_| cloth.step(FRAME, &scene).unwrap().asleep);
        cloth.reset();
        frame
    };
    let first = fell_asleep();
    assert!(first.is_some());
    assert_eq!(fell_asleep(), first);
    let asleep = (0..60).any(|_| cloth.step(FRAME, &scene).unwrap().asleep);
    cloth.place_colliders(&[Collider::plane(Vec3::Y * -0.01, Vec3::Y)]).unwrap();
    assert!(asleep && !cloth.step(FRAME, &scene).unwrap().asleep);
}

/// Statistics of steps before it was woken do not make it sleep again.
fn what_is_unpinned_falls(backend: Backend) {
    let sleep = Some(Sleep { after: 0.02, ..Sleep::default() });
    let pinned = (0..36).collect();
    let options = Options { backend, quality: Quality::Substeps(5), sleep, pinned, ..Options::default() };
    let mut cloth = Deformer::new(&Mesh::grid(6, 6, 0.3, 0.3), options).unwrap();
    let asleep = (0..20).any(|_| cloth.step(FRAME, &Attributes::default()).unwrap().asleep);
    cloth.set_pinned(vec![]).unwrap();
    let slept = (0..20).filter(|_| cloth.step(FRAME, &Attributes::default()).unwrap().asleep).count();
    let height = cloth.positions().unwrap()[0].y;
    assert!(asleep && slept == 0 && height < -0.4, "asleep {asleep}, and then in {slept} steps, at {height} m");
}

fn are_of_the_motion(backend: Backend, contact: Option<Contact>, late: u32) {
    let (_, mesh, options, script) = scenes(backend).swap_remove(1);
    let options = Options { quality: Quality::Hold { stretch: 0.05, share: 0.99 }, contact, ..options };
    let mut deformer = Deformer::new(&mesh, options).unwrap();
    let mut measured = Vec::new();
    for frame in 1..=24 {
        let report = deformer.step(FRAME, &script(frame)).unwrap();
        measured.push(deformer.measure().unwrap());
        assert_eq!(report.stretch.is_some(), frame > late, "frame {frame}");
        let Some(stretch) = report.stretch else { continue };
        let then = measured[(frame - late - 1) as usize];
        let close = |told: f32, plain: f32, within: f32| (told - plain).abs() <= within * plain + 1e-4;
        assert!(close(stretch.share, then.stretch_share, 0.07), "frame {frame}: {stretch:?}, measured {then:?}");
        assert!(close(stretch.worst, then.max_strain, 1e-3), "frame {frame}: {stretch:?}, measured {then:?}");
        assert!(close(stretch.mean, then.mean_strain, 0.3), "frame {frame}: {stretch:?}, measured {then:?}");
    }
    assert!(measured.iter().any(|then| then.max_strain > 0.01), "something was stretched");
}

/// A bound is kept with the finest level alone on a GPU, and with none below 8192 vertices. Only levels that were chosen
/// automatically are left out, and a step is repeated with the levels that it reports.
fn a_bound_takes_the_levels_that_pay(backend: Backend) {
    let made = |side: u32, quality: Quality, levels: Levels| {
        let pinned = (0..side).collect();
        let fabric = Fabric { bending: 0.0, ..Fabric::COTTON };
        let options = Options { backend, quality, levels, pinned, fabric, ..Options::default() };
        Deformer::new(&Mesh::grid(side, side, 1.0, 1.0), options).unwrap()
    };
    let taken = |side: u32, levels: Levels| {
        let mut kept = made(side, Quality::Strain(0.03), levels);
        let report = kept.step(FRAME, &Attributes::default()).unwrap();
        let mut again = made(side, Quality::Substeps(report.in_a_sixtieth), Levels::Count(report.levels));
        assert_eq!(again.step(FRAME, &Attributes::default()).unwrap().levels, report.levels);
        assert_eq!(again.positions().unwrap(), kept.positions().unwrap(), "{side}: repeated");
        report.levels
    };
    for (side, on_gpu) in [(64, 0), (96, 1)] {
        let levels = taken(side, Levels::Auto);
        assert!(if backend == Backend::Gpu { levels == on_gpu } else { levels > 1 }, "{side}: {levels} levels");
    }
    assert_eq!(taken(96, Levels::Count(3)), 3);
}

/// Two identical runs, and a third one with the numbers of substeps that were chosen; also if bending is softened.
fn any_step_can_be_asked_for_again(backend: Backend) {
    [("flag", 0.0), ("two corners", 30.0)].into_iter().for_each(|(name, bending)| can_be_asked_for_again(backend, name, bending));
}

fn can_be_asked_for_again(backend: Backend, name: &str, bending: f32) {
    let (_, mesh, options, script) = scenes(backend).into_iter().find(|scene| scene.0 == name).unwrap();
    let options = Options { levels: Levels::Off, fabric: Fabric { bending, ..options.fabric }, ..options };
    let mut deformer = Deformer::new(&mesh, Options { quality: Quality::Strain(0.05), ..options }).unwrap();
    let mut softened = false;
    let mut run = |told: Option<&[u32]>| {
        deformer.reset();
        let mut counts = Vec::new();
        for frame in 1..=20 {
            if let Some(told) = told {
                deformer.set_quality(Quality::Substeps(told[frame as usize - 1])).unwrap();
            }
            let report = deformer.step(FRAME, &script(frame)).unwrap();
            softened |= report.warnings.iter().any(|warning| matches!(warning, Warning::BendingLimited { .. }));
            counts.push(report.in_a_sixtieth);
        }
        (counts, deformer.positions().unwrap().to_vec())
    };
    let (first, second) = (run(None), run(None));
    assert_eq!(first, second, "reset replays");
    assert!(first.0.iter().any(|count| *count != first.0[0]), "the substeps change: {:?}", first.0);
    assert_eq!(run(Some(&first.0)).1, first.1, "the recorded substeps repeat the motion");
    assert_eq!(softened, bending > 0.0);
}

#[test]
fn any_number_of_threads_chooses_alike() {
    // More gauges than one thread processes at a time.
    let mesh = Mesh::grid(65, 65, 1.0, 1.0);
    let (_, _, options, script) = scenes(Backend::Cpu).swap_remove(0);
    let options = Options { quality: Quality::Strain(0.03), pinned: vec![0, 64], ..options };
    let play = || played(&mesh, &options, &script, 70);
    let on = |threads: usize| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(play);
    let one = on(1);
    assert_eq!(one, on(2));
    assert_eq!(one, on(4));
}

/// A sheet that swings for ten seconds with varying numbers of substeps never exceeds its initial energy.
#[test]
fn a_choice_gives_no_energy() {
    let (_, mesh, options, script) = scenes(Backend::Cpu).swap_remove(0);
    let masses = masses(&mesh, options.fabric.density);
    let total: f64 = masses.iter().map(|&mass| f64::from(mass)).sum();
    let mut deformer = Deformer::new(&mesh, Options { quality: Quality::Strain(0.02), ..options }).unwrap();
    let mut highest = f64::NEG_INFINITY;
    for frame in 1..=600 {
        let h = f64::from(FRAME) / f64::from(deformer.step(FRAME, &script(frame)).unwrap().substeps);
        let velocities = deformer.velocities().unwrap().to_vec();
        highest = highest.max(energy(&[], &masses, 9.81, h, deformer.positions().unwrap(), &velocities) / total);
    }
    println!("{highest} J/kg, at the start 0, half of its height below -4.9");
    assert!(highest <= 0.049, "{highest} J/kg above the start");
}

#[test]
fn qualities_are_checked_and_can_be_changed() {
    let (_, mesh, options, script) = scenes(Backend::Cpu).swap_remove(0);
    let mut deformer = Deformer::new(&mesh, Options { quality: Quality::Substeps(7), ..options }).unwrap();
    let hold = |stretch: f32, share: f32| Quality::Hold { stretch, share };
    let not = f32::NAN;
    for quality in [
        Quality::Substeps(0),
        Quality::Strain(-1.0),
        Quality::Strain(not),
        hold(0.03, 0.4),
        hold(0.03, 1.1),
        hold(0.03, not),
        hold(f32::INFINITY, 0.9),
        Quality::Budget(0.0),
        Quality::Budget(not),
    ] {
        let refused = deformer.set_quality(quality);
        assert!(matches!(refused, Err(BuildError::Value { .. })), "{quality:?}: {refused:?}");
    }
    assert_eq!(deformer.step(FRAME, &script(1)).unwrap().substeps, 7, "the quality is as it was");
    deformer.set_quality(Quality::Substeps(12)).unwrap();
    assert_eq!(deformer.step(FRAME, &script(2)).unwrap().substeps, 12);
    deformer.set_quality(hold(1e-4, 1.0)).unwrap();
    let most = deformer.forecast(FRAME, &script(3)).unwrap();
    assert_eq!(most.substeps, deformer.step(FRAME, &script(3)).unwrap().substeps, "the forecast knows");
    assert!(most.substeps as f32 <= 1.42 * most.resolving + 1.0, "never more than resolve the stiffness: {most:?}");
}

#[test]
fn a_longer_time_takes_more_substeps() {
    let (_, mesh, options, script) = scenes(Backend::Cpu).swap_remove(0);
    // Microseconds are too short for any substep; seconds suffice for the maximum.
    let counts = [1e-4, 1e4].map(|budget| {
        let frames = played(&mesh, &Options { quality: Quality::Budget(budget), ..options.clone() }, &script, 10);
        frames.last().unwrap().0.substeps
    });
    let mut deformer = Deformer::new(&mesh, options.clone()).unwrap();
    let resolving = deformer.forecast(FRAME, &script(1)).unwrap().resolving;
    assert_eq!(counts[0], 1);
    // With contact, cloth would be stretched so far by one substep that it would take longer than several.
    let with_contact = Options { contact: Some(Contact::default()), quality: Quality::Budget(1e-4), ..options.clone() };
    let least: Vec<u32> = played(&mesh, &with_contact, &script, 5).iter().map(|(report, ..)| report.substeps).collect();
    let light = Options { fabric: Fabric { density: 1e-3, ..options.fabric }, ..with_contact.clone() };
    assert!((6..30).contains(&least[0]) && least.iter().all(|&count| count == least[0]), "{least:?}");
    assert!(
        played(&mesh, &light, &script, 5).iter().all(|(report, ..)| report.substeps == least[0]),
        "K cancels, and the density"
    );
    assert!((1.4 * resolving..1.42 * resolving + 1.0).contains(&(counts[1] as f32)), "{counts:?} of {resolving}");
    // Steps of the length of real frames, each of which takes other coefficients, tell what fits, too.
    let mut in_real_time = Deformer::new(&mesh, Options { quality: Quality::Budget(1e4), ..options.clone() }).unwrap();
    let step = |frame: u32| in_real_time.step(FRAME * (1.0 + 0.01 * (frame % 7) as f32), &script(frame)).unwrap();
    assert!((1..=10).map(step).last().unwrap().in_a_sixtieth as f32 > resolving);
    // So do steps before each of which the fabric is changed.
    let mut changing = Deformer::new(&mesh, Options { quality: Quality::Budget(1e4), ..options.clone() }).unwrap();
    let step = |frame: u32| {
        changing.set_fabric(Fabric { damping: 0.01 * frame as f32, ..options.fabric }).unwrap();
        changing.step(FRAME, &script(frame)).unwrap()
    };
    assert!((1..=10).map(step).last().unwrap().in_a_sixtieth as f32 > resolving);
    assert!(deformer.set_quality(Quality::Budget(1.0)).is_ok());
}

/// A small, damped towel that lies on a ball falls asleep within some seconds, less than .1 mm from one that never
/// does, and wakes in the frame in which anything changes.
fn a_settled_cloth_sleeps_and_wakes(backend: Backend) {
    let mesh = Mesh::grid(12, 12, 0.3, 0.3);
    let options =
        |sleep| Options { backend, fabric: Fabric::COTTON, quality: Quality::Substeps(10), sleep, ..Options::default() };
    let mut attributes = Attributes { damping: 4.0, ..Attributes::default() };
    attributes.colliders = vec![Collider::sphere(Vec3::new(0.0, -0.11, 0.0), 0.1).with_friction(0.8)];
    let mut sleeper = Deformer::new(&mesh, options(Some(Sleep::default()))).unwrap();
    let mut awake = Deformer::new(&mesh, options(None)).unwrap();
    let mut slept = 0;
    let mut fell_asleep = Vec::new();
    for _ in 0..360 {
        let report = sleeper.step(FRAME, &attributes).unwrap();
        assert!(!awake.step(FRAME, &attributes).unwrap().asleep);
        if report.asleep {
            assert_eq!((report.substeps, sleeper.forecast(FRAME, &attributes).unwrap().substeps), (0, 0));
            if slept == 0 {
                fell_asleep = sleeper.positions().unwrap().to_vec();
            }
            slept += 1;
        }
    }
    println!("{backend:?}: asleep in {slept} of 360 frames");
    assert!(slept > 60, "asleep in {slept} frames of 360");
    assert_eq!(sleeper.positions().unwrap(), fell_asleep, "who sleeps does not move");
    let apart = rms(&fell_asleep, awake.positions().unwrap());
    assert!(apart < 1e-4, "{apart} m from one that never sleeps");
    attributes.gravity.x += 1.0;
    let report = sleeper.step(FRAME, &attributes).unwrap();
    assert!(!report.asleep && report.substeps == 10, "{report:?}");
    assert_ne!(sleeper.positions().unwrap(), fell_asleep);
    // Setting the state wakes the cloth.
    sleeper.reset();
    assert!(!sleeper.step(FRAME, &attributes).unwrap().asleep);
}

#[test]
fn when_to_sleep_is_checked() {
    let mesh = Mesh::grid(3, 3, 0.3, 0.3);
    let wrong = [
        Sleep { mean_speed: 0.0, ..Sleep::default() },
        Sleep { mean_speed: 1.0, ..Sleep::default() },
        Sleep { speed: f32::NAN, ..Sleep::default() },
        Sleep { after: -1.0, ..Sleep::default() },
    ];
    for sleep in wrong {
        let options = Options { backend: Backend::Cpu, sleep: Some(sleep), ..Options::default() };
        assert!(matches!(Deformer::new(&mesh, options), Err(BuildError::Value { .. })), "{sleep:?}");
    }
}

/// A cape and the body in it take as many substeps on a train as on the ground: only relative motion counts.
#[test]
fn a_common_motion_takes_no_substeps() {
    let mut mesh = Mesh::grid(16, 20, 0.6, 1.0);
    mesh.positions.iter_mut().for_each(|x| *x = Vec3::new(x.x, 1.4, x.z - 0.75));
    let pinned: Vec<u32> = (304..320).collect();
    let run = |velocity: Vec3| {
        let contact = Some(Contact::default());
        let options = Options { backend: Backend::Cpu, pinned: pinned.clone(), contact, ..Options::default() };
        let mut cape = Deformer::new(&mesh, options).unwrap();
        // The pins sway from the start, which their velocities say.
        cape.set_state(&mesh.positions, &vec![velocity + Vec3::X * 0.5; mesh.positions.len()]).unwrap();
        let at = |frame: u32| velocity * (frame as f32 * FRAME) + Vec3::X * 0.1 * (frame as f32 * 5.0 * FRAME).sin();
        let body = |frame: u32| vec![Collider::capsule(at(frame) + Vec3::Y * 0.9, at(frame) + Vec3::Y * 1.4, 0.18)];
        cape.place_colliders(&body(0)).unwrap();
        let mut step = |frame: u32| {
            let pin_targets = Some(pinned.iter().map(|&pin| mesh.positions[pin as usize] + at(frame)).collect());
            let air = Attributes { wind: velocity, air_density: 1.2, ..Attributes::default() };
            cape.step(FRAME, &Attributes { colliders: body(frame), pin_targets, ..air }).unwrap()
        };
        let reports: Vec<StepReport> = (1..60).map(&mut step).collect();
        let outruns =
            |report: &StepReport| report.warnings.iter().any(|warning| matches!(warning, Warning::ColliderOutruns { .. }));
        (reports.iter().map(|report| report.substeps).sum::<u32>(), reports.iter().filter(|report| outruns(report)).count())
    };
    let [(still, warned), (riding, more)] = [Vec3::ZERO, Vec3::new(16.0, 0.0, 12.0)].map(run);
    println!("{still} substeps and {warned} warnings on the ground, {riding} and {more} at 20 m/s");
    assert!(riding <= still + still / 20 && more <= warned, "{still}, {warned} and {riding}, {more}");
}

/// A blanket that lies on a seat, held by nothing, takes as many substeps on the road as in the garage, and keeps its folds.
#[test]
fn cloth_without_pins_rides_along() {
    let mut mesh = Mesh::grid(24, 24, 1.0, 1.0);
    mesh.positions.iter_mut().for_each(|x| x.y = 0.02);
    let ride = |velocity: Vec3, contact: Option<Contact>, hit_at: Option<f32>| {
        let options = Options { backend: Backend::Cpu, fabric: Fabric::COTTON, contact, ..Options::default() };
        let mut blanket = Deformer::new(&mesh, options).unwrap();
        blanket.set_state(&mesh.positions, &vec![velocity; mesh.positions.len()]).unwrap();
        // The time of a frame is a power of two, so that no rounding tells one ride from the other.
        let dt = 1.0 / 64.0;
        let colliders = |frame: u32| {
            let at = velocity * (frame as f32 * dt);
            let seat = Collider::rounded_box(at, Vec3::new(0.2, 0.015, 0.2), Quat::IDENTITY, 0.01);
            // It arrives from the front, after a third of a second.
            let along = 2.4 - 5.0 * frame as f32 * dt;
            let ball = hit_at.map(|height| Collider::sphere(at + Vec3::new(along, height, 0.0), 0.2));
            [Collider::plane(at, Vec3::Y), seat].into_iter().chain(ball).collect::<Vec<_>>()
        };
        blanket.place_colliders(&colliders(0)).unwrap();
        let mut step = |frame: u32| {
            let air = Attributes { wind: velocity, air_density: 1.2, ..Attributes::default() };
            blanket.step(dt, &Attributes { colliders: colliders(frame), ..air }).unwrap()
        };
        let reports: Vec<StepReport> = (1..=64).map(&mut step).collect();
        let warnings: usize = reports.iter().map(|report| report.warnings.len()).sum();
        let substeps: u32 = reports.iter().map(|report| report.substeps).sum();
        let positions: Vec<Vec3> = blanket.positions().unwrap().iter().map(|x| *x - velocity).collect();
        (substeps, warnings, positions)
    };
    for contact in [None, Some(Contact::default())] {
        let (still, _, at_rest) = ride(Vec3::ZERO, contact, None);
        for speed in [8.0, 32.0, 128.0] {
            let (riding, warnings, positions) = ride(Vec3::X * speed, contact, None);
            let apart = rms(&at_rest, &positions);
            println!("{speed} m/s: {riding} substeps of {still}, {warnings} warnings, {apart} m apart");
            assert!(
                riding <= still + still / 20 && warnings == 0 && apart < 1e-3,
                "{speed} m/s: {riding} of {still}, {warnings}"
            );
        }
    }
    // What hits it is near on the road, too. Where that throws it is chance: single hits take 2300 to 3600 substeps, so several count
    // together.
    let hit = |velocity: Vec3| (0..16).map(|k| ride(velocity, None, Some(0.08 + 0.0025 * k as f32)).0).sum::<u32>();
    let still = hit(Vec3::ZERO);
    // Driving the way that the ball flies takes some more (1.06 to 1.11 with any number of lanes): where the cloth may be includes its way.
    let riding = [32.0 * Vec3::X, -32.0 * Vec3::X].map(hit);
    println!("hit by a ball: {still} substeps, and {riding:?} on the road");
    let ratio = f64::from(riding[0] + riding[1]) / f64::from(2 * still);
    assert!((0.97..1.13).contains(&ratio), "{riding:?} of {still}");
}

/// Small sheets that fall on a post in long steps, and are stretched far before it takes more substeps, are not thrown up when it does.
#[test]
fn what_is_caught_is_not_thrown_up() {
    let drops = [
        (Fabric::SILK, 0.15, 15, 24.0, 0.0),
        (Fabric::TOWEL, 0.15, 9, 24.0, 1.2),
        (Fabric::TOWEL, 0.15, 15, 24.0, 1.2),
        (Fabric::COTTON, 0.1, 11, 30.0, 1.2),
    ];
    for (fabric, side, n, rate, air_density) in drops {
        let mut mesh = Mesh::grid(n, n, side, side);
        mesh.positions.iter_mut().for_each(|x| x.y += 0.9 * side);
        let post = Collider::capsule(Vec3::ZERO, Vec3::Y * (0.35 * side), 0.05 * side);
        let colliders = vec![Collider::plane(Vec3::ZERO, Vec3::Y), post];
        let scene = Attributes { air_density, colliders, ..Attributes::default() };
        let mut cloth = Deformer::new(&mesh, Options { backend: Backend::Cpu, fabric, ..Options::default() }).unwrap();
        let (mut lowest, mut rise) = (f32::INFINITY, 0.0_f32);
        for _ in 0..40 {
            cloth.step(1.0 / rate, &scene).unwrap();
            let x = cloth.positions().unwrap();
            let height = x.iter().map(|x| x.y).sum::<f32>() / x.len() as f32;
            lowest = lowest.min(height);
            rise = rise.max(height - lowest);
        }
        println!("{side} m, {n} by {n}: rises by {rise} m after a fall of {} m", 0.9 * side - lowest);
        assert!(rise < 0.06, "{side} m, {n} by {n}: rises by {rise} m after a fall of {} m", 0.9 * side - lowest);
    }
}

/// Cloth that is caught in flight takes the substeps that its speed demands, in that step already.
#[test]
fn what_is_caught_takes_substeps() {
    let mesh = Mesh::grid(24, 24, 1.0, 1.0);
    let mut towel = Deformer::new(&mesh, Options { backend: Backend::Cpu, ..Options::default() }).unwrap();
    towel.set_state(&mesh.positions, &vec![Vec3::X * 24.0; mesh.positions.len()]).unwrap();
    let step = |towel: &mut Deformer| towel.step(FRAME, &Attributes::default()).unwrap().substeps;
    let flying = (0..10).map(|_| step(&mut towel)).last().unwrap();
    towel.set_pinned(vec![0]).unwrap();
    let caught = step(&mut towel);
    println!("{flying} substeps, {caught} when it is caught");
    assert!(caught >= 4 * flying, "{flying} and {caught}");
}

/// What is thrown takes few substeps while it flies, and more before it hits what stands still, because it moves towards that.
#[test]
fn what_is_thrown_takes_substeps_before_it_hits() {
    let mesh = Mesh::grid(32, 32, 1.0, 1.0);
    let mut towel = Deformer::new(&mesh, Options { backend: Backend::Cpu, ..Options::default() }).unwrap();
    towel.set_state(&mesh.positions, &vec![Vec3::X * 16.0; mesh.positions.len()]).unwrap();
    let pole = Collider::capsule(Vec3::new(6.0, -2.0, 0.1), Vec3::new(6.0, 2.0, 0.1), 0.1);
    let scene = Attributes { colliders: vec![pole], gravity: Vec3::ZERO, ..Attributes::default() };
    // It arrives in the 20th frame.
    let taken: Vec<u32> = (0..20).map(|_| towel.step(FRAME, &scene).unwrap().substeps).collect();
    println!("{taken:?}");
    assert!(taken[12] <= 10 && taken[19] >= 2 * taken[12], "{taken:?}");
}

/// A sheet that falls flat on a box has learned in flight that nothing stretches it, which is not so when it lands: without regard to
/// that it was stretched by 7.9, 10.1 and 18.7 %, and by 1 to 2 % with 200 substeps.
#[test]
fn cloth_that_falls_on_something_is_ready_for_it() {
    for height in [0.36, 0.5, 1.5] {
        let mut mesh = Mesh::grid(41, 41, 1.0, 1.0);
        mesh.positions.iter_mut().for_each(|x| x.y = 0.5 + height);
        let mut sheet = Deformer::new(&mesh, Options { backend: Backend::Cpu, ..Options::default() }).unwrap();
        let stool = Collider::rounded_box(Vec3::Y * 0.4, Vec3::new(0.2, 0.1, 0.2), Quat::IDENTITY, 0.02);
        let scene = Attributes { colliders: vec![stool], ..Attributes::default() };
        let stretch = |_| sheet.step(FRAME, &scene).unwrap().stretch.unwrap().share;
        let most = (0..60).map(stretch).fold(0.0, f32::max);
        println!("from {height} m: stretched by {most}");
        assert!(most < 0.055, "from {height} m: stretched by {most}");
    }
}

/// A sheet is swung up by its pins, which stop, until its hem hits its upper part. Nothing told that in advance: without steps that are
/// rejected it was stretched by 12 %, and by the substeps that followed it gained 2 J/kg at once. The substeps that were taken repeat
/// the motion.
fn cloth_that_hits_itself_gains_no_energy(backend: Backend, [columns, rows]: [u32; 2], levels: Levels) {
    let mut mesh = Mesh::grid(columns, rows, 0.8, 1.0);
    mesh.positions.iter_mut().for_each(|x| *x = Vec3::new(x.x, -x.z, 0.0));
    let options = Options {
        backend,
        levels,
        fabric: Fabric::COTTON,
        pinned: (0..columns).collect(),
        contact: Some(Contact::default()),
        ..Options::default()
    };
    let led = |frame: u32| {
        let part = (2.0 * frame as f32 * FRAME - 1.0).clamp(0.0, 1.0);
        let way = Vec3::Z * 1.5 * part * part * (3.0 - 2.0 * part);
        Attributes {
            pin_targets: Some(mesh.positions[..columns as usize].iter().map(|&x| x + way).collect()),
            ..Attributes::default()
        }
    };
    let mut cloth = Deformer::new(&mesh, options.clone()).unwrap();
    let (mut taken, mut lowest, mut gained, mut worst) = (Vec::new(), f32::INFINITY, 0.0_f32, 0.0_f32);
    for frame in 1..=70 {
        let report = cloth.step(FRAME, &led(frame)).unwrap();
        taken.push(report.in_a_sixtieth);
        worst = worst.max(report.stretch.unwrap().share);
        // The impact, in which no energy that the edges had stored comes back. In the next frames half a J/kg does, with 400 substeps, too.
        if (61..=68).contains(&frame) {
            let (x, v) = (cloth.positions().unwrap().to_vec(), cloth.velocities().unwrap());
            let energy = x.iter().zip(v).map(|(x, v)| 0.5 * v.length_squared() + 9.81 * x.y).sum::<f32>() / x.len() as f32;
            (lowest, gained) = (lowest.min(energy), gained.max(energy - lowest));
        }
    }
    println!("stretched by {worst}, gained {gained} J/kg, {taken:?}");
    assert!(worst < 0.032 && gained < 0.1, "stretched by {worst}, gained {gained} J/kg");
    let mut again = Deformer::new(&mesh, options).unwrap();
    for (frame, &count) in (1..).zip(&taken) {
        again.set_quality(Quality::Substeps(count)).unwrap();
        again.step(FRAME, &led(frame)).unwrap();
    }
    assert!(bits(&mut again) == bits(&mut cloth), "the substeps that were taken do not repeat the motion");
}

#[test]
fn cloth_that_hits_itself_gains_no_energy_on_the_cpu() {
    cloth_that_hits_itself_gains_no_energy(Backend::Cpu, [33, 41], Levels::Auto);
}

#[cfg(feature = "gpu")]
#[test]
fn cloth_that_hits_itself_gains_no_energy_on_the_hybrid() {
    cloth_that_hits_itself_gains_no_energy(Backend::Hybrid, [33, 41], Levels::Auto);
}

/// A GPU waits for the statistics of a step with contact. By default it takes the finest level as long as the bound is kept, but all of
/// them with the same substeps as a number.
#[cfg(feature = "gpu")]
#[test]
fn cloth_that_hits_itself_gains_no_energy_on_the_gpu() {
    cloth_that_hits_itself_gains_no_energy(Backend::Gpu, [21, 26], Levels::Count(1));
}

/// Each sweep of relaxation passes a pull on by one edge.
#[test]
fn sweeps_carry_a_pin() {
    let mesh = Mesh::grid(21, 21, 1.0, 1.0);
    let outruns = |iterations: u32, speed: f32| {
        let method = Method::Relaxation { iterations };
        let options = Options { backend: Backend::Cpu, method, pinned: vec![0], ..Options::default() };
        let pin_targets = Some(vec![mesh.positions[0] + speed * FRAME * Vec3::X]);
        let cloth = Deformer::new(&mesh, options).unwrap();
        let forecast = cloth.forecast(FRAME, &Attributes { pin_targets, ..Attributes::default() }).unwrap();
        forecast.warnings.iter().any(|warning| matches!(warning, Warning::PinOutruns { .. }))
    };
    // Edges of 7 cm, of which diagonals are the longest, and one substep in 1/60 s: 4.2 m/s a sweep.
    assert!(!outruns(1, 4.0) && outruns(1, 4.5));
    assert!(!outruns(10, 40.0) && outruns(10, 45.0));
}

/// Cloth that nothing accelerates is at rest only where it stays.
fn what_flies_steadily_does_not_sleep(backend: Backend) {
    let sleep = Some(Sleep { after: 0.02, ..Sleep::default() });
    let mut cloth = Deformer::new(&Mesh::grid(6, 6, 0.3, 0.3), Options { backend, sleep, ..Options::default() }).unwrap();
    let start = cloth.positions().unwrap().to_vec();
    cloth.set_state(&start, &vec![Vec3::X * 3.0; start.len()]).unwrap();
    let space = Attributes { gravity: Vec3::ZERO, ..Attributes::default() };
    let slept = (0..30).filter(|_| cloth.step(FRAME, &space).unwrap().asleep).count();
    let way = cloth.positions().unwrap()[0].x - start[0].x;
    assert!(slept == 0 && (way - 1.5).abs() < 1e-3, "asleep in {slept} steps, {way} m away");
}

/// Two layers that hang close to each other, as a cape and its lining do, and are shaken by their pins: too few substeps press them on
/// each other beside the pins, but that is no lack of room, and no reason to take no more.
#[test]
fn a_shaken_lining_is_not_squeezed() {
    let (columns, rows) = (16, 24);
    let mut mesh = Mesh::default();
    for layer in 0..2 {
        let (one, first) = (Mesh::grid(columns, rows, 0.6, 1.0), mesh.positions.len() as u32);
        mesh.positions.extend(one.positions.iter().map(|x| Vec3::new(x.x, -x.z, 0.009 * layer as f32)));
        mesh.triangles.extend(one.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    }
    let pinned: Vec<u32> = (0..2 * columns).map(|pin| pin % columns + pin / columns * columns * rows).collect();
    let held: Vec<Vec3> = pinned.iter().map(|&pin| mesh.positions[pin as usize]).collect();
    let contact = Some(Contact::default());
    let mut cloth = Deformer::new(&mesh, Options { backend: Backend::Cpu, contact, pinned, ..Options::default() }).unwrap();
    let mut missed = Vec::new();
    for frame in 0..240 {
        let t = frame as f32 * FRAME;
        let by = Vec3::new(0.36 * (6.0 * t).sin(), 0.15 * (12.0 * t).sin(), 0.3 * (3.0 * t).sin());
        let pin_targets = Some(held.iter().map(|x| *x + by).collect());
        let report = cloth.step(FRAME, &Attributes { air_density: 1.225, pin_targets, ..Attributes::default() }).unwrap();
        missed.extend(report.warnings.into_iter().filter(|warning| matches!(warning, Warning::StrainMissed { .. })));
    }
    let blames_room = |warning: &&Warning| matches!(warning, Warning::StrainMissed { cause: Cause::Squeezed, .. });
    assert!(missed.iter().find(blames_room).is_none() && missed.len() <= 4, "{missed:?}");
}

/// Pins that move alike at a constant velocity pull on nothing, however fast; but they do where the cloth is at rest before.
#[test]
fn pins_that_move_alike_outrun_nothing() {
    let mesh = Mesh::grid(24, 24, 1.0, 1.0);
    let velocity = Vec3::X * 60.0;
    let warned = |quality: Quality, before: Vec3| -> Vec<u32> {
        let options = Options { backend: Backend::Cpu, pinned: top(24), quality, ..Options::default() };
        let mut sheet = Deformer::new(&mesh, options).unwrap();
        sheet.set_state(&mesh.positions, &vec![before; mesh.positions.len()]).unwrap();
        let mut outruns = |frame: u32| {
            let at = velocity * (frame as f32 * FRAME);
            let pin_targets = Some(mesh.positions[..24].iter().map(|pin| *pin + at).collect());
            let report = sheet.step(FRAME, &Attributes { pin_targets, ..Attributes::default() }).unwrap();
            report.warnings.iter().any(|warning| matches!(warning, Warning::PinOutruns { .. }))
        };
        (1..60).filter(|&frame| outruns(frame)).collect()
    };
    let few = Quality::Substeps(10);
    assert!([Quality::default(), few].iter().all(|&quality| warned(quality, velocity).is_empty()));
    assert_eq!(warned(few, Vec3::ZERO), [1]);
}

/// Sheets that share a mesh stretch as one does, however far apart they are: what hangs on an edge is a part of the cloth.
#[test]
fn sheets_that_share_a_mesh_keep_the_bound_as_one_does() {
    let n = 24;
    let run = |places: &[f32]| {
        let mut mesh = Mesh::default();
        let mut pinned = Vec::new();
        for place in places {
            let (one, first) = (Mesh::grid(n, n, 1.0, 1.0), mesh.positions.len() as u32);
            pinned.extend([first, first + n - 1]);
            mesh.positions.extend(one.positions.iter().map(|x| *x + Vec3::X * *place));
            mesh.triangles.extend(one.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
        }
        let options = Options { backend: Backend::Cpu, pinned: pinned.clone(), fabric: Fabric::COTTON, ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        let (mut substeps, mut beyond) = (0, 0);
        for frame in 0..180_u32 {
            // The pins are pulled forth and back from one second on.
            let by = Vec3::Z * 0.3 * (4.0 * (frame as f32 * FRAME - 1.0).max(0.0)).sin();
            let pin_targets = Some(pinned.iter().map(|&pin| mesh.positions[pin as usize] + by).collect());
            let report = cloth.step(FRAME, &Attributes { pin_targets, ..Attributes::default() }).unwrap();
            substeps += report.substeps;
            beyond += u32::from(cloth.measure().unwrap().stretch_share > 0.035);
        }
        println!("{} sheets: {substeps} substeps, {beyond} frames beyond", places.len());
        (substeps, beyond)
    };
    let (alone, _) = run(&[0.0]);
    for places in [&[0.0, 100.0][..], &[0.0, 2.0, 4.0, 6.0, 8.0, 10.0]] {
        let (substeps, beyond) = run(places);
        assert!(beyond <= 3, "{beyond} frames beyond the bound");
        assert!(substeps < 2 * alone, "{substeps} substeps, {alone} of one alone");
    }
}

/// A sheet of a stiff and heavy fabric in the same mesh takes about as many substeps as the more demanding of both alone: what substeps
/// leave of a stretch does not depend on the stiffness.
#[test]
fn sheets_of_their_own_fabrics_take_no_more_substeps() {
    let n = 16;
    let (stiffer, heavier) = (16.0, 2.5);
    let run = |sheets: &[(f32, f32)]| {
        let (grid, mut mesh) = (Mesh::grid(n, n, 1.0, 1.0), Mesh::default());
        let (mut pinned, mut mass) = (Vec::new(), Vec::new());
        for (place, (_, heavier)) in sheets.iter().enumerate() {
            let first = mesh.positions.len() as u32;
            pinned.extend(first..first + n);
            mass.extend(vec![heavier * Fabric::COTTON.density / (n * n) as f32; (n * n) as usize]);
            mesh.positions.extend(grid.positions.iter().map(|x| *x + 2.0 * place as f32 * Vec3::X));
            mesh.triangles.extend(grid.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
        }
        let scale = |[a, _]: [u32; 2]| sheets[(a / (n * n)) as usize].0;
        let edge_scale = Some(mesh.edges().into_iter().map(scale).collect());
        let options =
            Options { backend: Backend::Cpu, pinned, fabric: Fabric::COTTON, mass: Some(mass), edge_scale, ..Options::default() };
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        (0..90).map(|_| cloth.step(FRAME, &Attributes::default()).unwrap().substeps).sum::<u32>()
    };
    let alone = [(1.0, 1.0), (stiffer, heavier)].map(|sheet| run(&[sheet]));
    let both = run(&[(1.0, 1.0), (stiffer, heavier)]);
    println!("{alone:?} substeps alone, {both} in one mesh");
    assert!(both < alone[0].max(alone[1]) * 5 / 4, "{both} substeps, alone {alone:?}");
}

/// A sheet held by two opposite sides, which wind of pressure q blows out, stretches by its own stiffness: its tension T
/// (N/m) over the span L is given by `T³ = K q² L²/24`. No substeps help, and none are blamed.
#[test]
fn cloth_that_wind_stretches_by_itself_is_not_blamed() {
    let (n, span, stretch) = (24_u32, 4.0_f32, 5000.0_f32);
    let fabric = Fabric { density: 0.3, stretch, bending: 1e-4, damping: 0.1 };
    let pinned: Vec<u32> = (0..n).chain(n * (n - 1)..n * n).collect();
    let mesh = Mesh::grid(n, n, span, span);
    let mut sail = Deformer::new(&mesh, Options { backend: Backend::Cpu, pinned, fabric, ..Options::default() }).unwrap();
    let air = Attributes { gravity: Vec3::ZERO, wind: Vec3::Y * 10.0, air_density: 1.225, damping: 2.0, ..Attributes::default() };
    let reports: Vec<StepReport> = (0..240).map(|_| sail.step(FRAME, &air).unwrap()).collect();
    let missed = |report: &&StepReport| report.warnings.iter().any(|warning| matches!(warning, Warning::StrainMissed { .. }));
    assert_eq!(reports[120..].iter().filter(missed).count(), 0);
    let x = sail.positions().unwrap();
    let middle: Vec<Vec3> = (0..n).map(|row| x[(row * n + n / 2) as usize]).collect();
    let length: f32 = middle.windows(2).map(|pair| pair[0].distance(pair[1])).sum();
    let pressure = 0.5 * air.air_density * air.drag * 100.0;
    let expected = (stretch * (pressure * span).powi(2) / 24.0).cbrt() / stretch;
    println!("the middle is stretched by {:.4}, expected {expected:.4}", length / span - 1.0);
    assert!((length / span - 1.0 - expected).abs() < 0.1 * expected, "{}", length / span - 1.0);
}

/// Soft cloth that hangs from one or two pins stretches by its own stiffness, as far with many substeps. None are blamed; but pins that
/// go apart are.
#[test]
fn soft_cloth_that_lone_pins_stretch_is_not_blamed() {
    let n = 21;
    let mesh = Mesh::grid(n, n, 1.0, 1.0);
    let fabric = Fabric { stretch: 60.0, ..Fabric::JERSEY };
    let missed = |report: &StepReport| report.warnings.iter().any(|warning| matches!(warning, Warning::StrainMissed { .. }));
    for (pinned, apart) in [(vec![0], 0.0), (vec![0, n - 1], 0.0), (vec![0, n - 1], 0.5)] {
        let run = |quality: Quality| {
            let options = Options { backend: Backend::Cpu, pinned: pinned.clone(), fabric, quality, ..Options::default() };
            let mut cloth = Deformer::new(&mesh, options).unwrap();
            let step = |frame: u32| {
                let by = apart * frame.min(120) as f32 / 120.0;
                let led = |&pin: &u32| mesh.positions[pin as usize] + Vec3::X * if pin > 0 { by } else { 0.0 };
                let pin_targets = Some(pinned.iter().map(led).collect());
                let attributes = Attributes { pin_targets, damping: 0.5, ..Attributes::default() };
                missed(&cloth.step(FRAME, &attributes).unwrap())
            };
            let said = (0..240).map(step).filter(|&missed| missed).count();
            (said, cloth.measure().unwrap().stretch_share)
        };
        let ((said, stretch), (_, resolved)) = (run(Quality::default()), run(Quality::Substeps(60)));
        println!("{} pins, {apart} m apart: {said} frames missed, stretched by {stretch}, resolved by {resolved}", pinned.len());
        assert!((stretch / resolved - 1.0).abs() < 0.3 && resolved > 0.05, "stretched by {stretch}, resolved by {resolved}");
        assert_eq!(said > 0, apart > 0.0, "{said} frames are said to be missed");
    }
}

/// A sheet is held between two edges that are led apart: slowly by as much as a garment may be too narrow, which is its own stretch; by
/// more, which is said in every step; and by the smaller amount within a tenth of a second, which is said as it turns out to be held.
#[test]
fn what_stays_held_far_stretched_is_always_said() {
    let mesh = Mesh::grid(9, 9, 0.5, 0.5);
    let pinned: Vec<u32> = (0..81).filter(|v| v % 9 == 0 || v % 9 == 8).collect();
    for (apart, frames, expected) in [(0.06, 120, 0), (0.3, 120, 60), (0.06, 6, 0)] {
        let options = Options { backend: Backend::Cpu, pinned: pinned.clone(), ..Options::default() };
        let mut sheet = Deformer::new(&mesh, options).unwrap();
        let step = |frame: u32| {
            let by = 0.5 * apart * frame.min(frames) as f32 / frames as f32;
            let led = |&pin: &u32| mesh.positions[pin as usize] + Vec3::X * if pin % 9 == 8 { by } else { 0.0 };
            let pin_targets = Some(pinned.iter().map(led).collect());
            let report = sheet.step(FRAME, &Attributes { pin_targets, damping: 4.0, ..Attributes::default() }).unwrap();
            report.warnings.iter().any(|warning| matches!(warning, Warning::StrainMissed { .. }))
        };
        let missed: Vec<bool> = (0..300).map(step).collect();
        let said = missed[240..].iter().filter(|&&missed| missed).count();
        assert_eq!(missed[..240].contains(&true), apart > 0.1 || frames < 10, "stretched by {apart}");
        assert_eq!(said, expected, "stretched by {apart}");
    }
}

/// A sleeve that is narrower than what it is on is stretched by that whatever substeps it takes. After a few steps that resolve the
/// stiffness, and so tell this stretch from what substeps leave, few are taken, but not so few that friction no longer holds it. With
/// another fabric the stretch is measured anew.
#[test]
fn a_tight_sleeve_stays_where_it_is_with_few_substeps() {
    let (rows, around, radius, length) = (9_u32, 48_u32, 0.055, 0.1);
    let on = |radius: f32| -> Vec<Vec3> {
        let vertex = |v: u32| {
            let turn = std::f32::consts::TAU * (v % around) as f32 / around as f32;
            Vec3::new(radius * turn.cos(), length * ((v / around) as f32 / (rows - 1) as f32 - 0.5), radius * turn.sin())
        };
        (0..rows * around).map(vertex).collect()
    };
    let quad = |v: u32| {
        let next = v - v % around + (v + 1) % around;
        [[v, v + around, next], [next, v + around, next + around]]
    };
    let fabric = Fabric { density: 0.2, stretch: 5000.0, bending: 1.4e-5, damping: 0.06 };
    let post = Collider::capsule(Vec3::Y * -0.3, Vec3::Y * 0.3, radius).with_friction(0.3);
    let attributes = Attributes { colliders: vec![post], ..Attributes::default() };
    let still = vec![Vec3::ZERO; (rows * around) as usize];
    for tight in [0.98, 0.995] {
        let mesh = Mesh { positions: on(tight * radius), triangles: (0..(rows - 1) * around).flat_map(quad).collect() };
        let run = |quality: Quality| {
            let options = Options { backend: Backend::Cpu, fabric, quality, ..Options::default() };
            let mut sleeve = Deformer::new(&mesh, options).unwrap();
            sleeve.set_state(&on(1.002 * radius), &still).unwrap();
            let reports: Vec<StepReport> = (0..240).map(|_| sleeve.step(FRAME, &attributes).unwrap()).collect();
            let height = sleeve.positions().unwrap().iter().map(|x| x.y).sum::<f32>() / still.len() as f32;
            let stretch = sleeve.measure().unwrap().stretch_share;
            (sleeve, reports, height, stretch)
        };
        let (mut sleeve, reports, height, stretch) = run(Quality::default());
        let (_, _, resolved_height, resolved) = run(Quality::Substeps(600));
        let most = reports.iter().map(|report| report.substeps).max().unwrap();
        let last: Vec<u32> = reports[120..].iter().map(|report| report.substeps).collect();
        let mean = last.iter().sum::<u32>() as f32 / last.len() as f32;
        println!(
            "{tight}: {most} substeps, then {mean} a frame; at {height}, resolved {resolved_height}; stretched by {stretch}, {resolved}"
        );
        assert!(10.0 * mean < most as f32, "{mean} substeps a frame, once {most} had resolved the stiffness");
        assert!(height > resolved_height - 0.005 && resolved_height > -1e-3, "from 0 to {height}, resolved {resolved_height}");
        assert!(stretch < resolved + 0.03, "stretched by {stretch}, resolved {resolved}");
        let missed = |report: &&StepReport| report.warnings.iter().any(|warning| matches!(warning, Warning::StrainMissed { .. }));
        assert_eq!(reports[30..].iter().filter(missed).count(), 0);
        sleeve.set_fabric(Fabric { stretch: 4000.0, ..fabric }).unwrap();
        let again = (0..10).map(|_| sleeve.step(FRAME, &attributes).unwrap().substeps).max().unwrap();
        assert!(2 * again > most, "at most {again} substeps with another fabric");
        let (_, _, height, _) = run(Quality::Substeps(8));
        assert!(height < -0.1, "8 substeps hold it, so that nothing is tested");
    }
}

/// A tool that sets the same options in every frame changes nothing, also where substeps are chosen for each step.
#[test]
fn options_set_to_the_same_in_every_frame_change_nothing() {
    let fabric = Fabric { bending: 0.03, stretch: 20000.0, damping: 0.0, ..Fabric::COTTON };
    let mesh = Mesh::grid(25, 25, 0.3, 0.3);
    let options = Options { backend: Backend::Cpu, fabric, pinned: top(25), ..Options::default() };
    let [mut plain, mut set] = [(); 2].map(|()| Deformer::new(&mesh, options.clone()).unwrap());
    for _ in 0..60 {
        set.set_fabric(fabric).unwrap();
        set.set_pinned(top(25)).unwrap();
        set.set_mass(None).unwrap();
        set.set_quality(options.quality).unwrap();
        let reports = [&mut plain, &mut set].map(|card| card.step(FRAME, &Attributes::default()).unwrap().substeps);
        assert_eq!(reports[0], reports[1]);
    }
    assert_eq!(plain.positions().unwrap(), set.positions().unwrap());
}

/// Pins that are dragged at once feel no gale, in which coarse levels would be switched off; those that stay as fast do.
#[test]
fn a_jerk_is_no_gale() {
    let mesh = Mesh::grid(40, 40, 1.0, 1.0);
    let quality = Quality::Substeps(10);
    let mut sheet =
        Deformer::new(&mesh, Options { backend: Backend::Cpu, pinned: top(40), quality, ..Options::default() }).unwrap();
    let mut step = |by: f32| {
        let pin_targets = Some(mesh.positions[..40].iter().map(|pin| *pin + Vec3::Z * by).collect());
        sheet.step(FRAME, &Attributes { pin_targets, air_density: 1.2, ..Attributes::default() }).unwrap().levels
    };
    let levels = [0.0, 0.3, 0.3, 0.6, 0.9].map(&mut step);
    assert!(levels[1] > 0 && levels[3] > 0 && levels[4] == 0, "{levels:?}");
}

/// Pins that are led smoothly accelerate as much in frames of unequal length as in equal ones.
#[test]
fn unequal_frames_take_no_substeps() {
    let mesh = Mesh::grid(24, 24, 1.0, 1.0);
    let run = |frames: &[f32]| {
        let mut cloth = Deformer::new(&mesh, Options { backend: Backend::Cpu, pinned: top(24), ..Options::default() }).unwrap();
        let (mut time, mut substeps) = (0.0_f32, 0);
        for &dt in frames.iter().cycle() {
            if time >= 3.0 {
                break;
            }
            time += dt;
            let by = Vec3::new(0.3 * (3.0 * time).sin(), 0.0, 0.3 * (1.0 - (3.0 * time).cos()));
            let pin_targets = Some(mesh.positions[..24].iter().map(|pin| *pin + by).collect());
            substeps += cloth.step(dt, &Attributes { pin_targets, ..Attributes::default() }).unwrap().substeps;
        }
        f64::from(substeps) / f64::from(time)
    };
    let (equal, unequal) = (run(&[FRAME]), run(&[0.25 * FRAME, 1.75 * FRAME]));
    println!("{equal:.0} substeps a second, {unequal:.0} in unequal frames");
    assert!(unequal < 1.2 * equal, "{equal} and {unequal}");
}

/// Towels that fall in a heap fall asleep, although their strain needs so few substeps that they would tremble on: of these four
/// none did in 15 s when they took no more than that.
#[test]
fn heaps_fall_asleep() {
    let asleep_at = |angle: f32| {
        let mut mesh = Mesh::grid(30, 30, 1.0, 1.0);
        mesh.positions.iter_mut().for_each(|x| *x = Quat::from_rotation_x(angle) * *x + Vec3::Y * 0.57);
        let (contact, sleep) = (Some(Contact::default()), Some(Sleep::default()));
        let options = Options { backend: Backend::Cpu, fabric: Fabric::TOWEL, contact, sleep, ..Options::default() };
        let mut towel = Deformer::new(&mesh, options).unwrap();
        let colliders = vec![Collider::plane(Vec3::ZERO, Vec3::Y)];
        let air = Attributes { colliders, air_density: 1.2, damping: 0.2, ..Attributes::default() };
        (0..900).find(|_| towel.step(FRAME, &air).unwrap().asleep)
    };
    let frames = [1.43, 1.44, 1.45, 1.48].map(asleep_at);
    println!("asleep in the frames {frames:?}");
    assert!(frames.iter().flatten().count() >= 3, "{frames:?}");
    // Relaxation, which is stiffer in more substeps, takes one as ever.
    let method = Method::Relaxation { iterations: 4 };
    let options = Options { backend: Backend::Cpu, contact: Some(Contact::default()), method, ..Options::default() };
    let mut relaxed = Deformer::new(&Mesh::grid(9, 9, 1.0, 1.0), Options { sleep: Some(Sleep::default()), ..options }).unwrap();
    assert_eq!(relaxed.step(FRAME, &Attributes::default()).unwrap().substeps, 1);
}

/// On both sides of the softness from which levels would roll up hung cloth: it keeps its width in a breeze, and hangs flat in still
/// air. With levels the softest sheet would keep 80 % of it, and hang in folds of 26 mm.
#[test]
fn soft_cloth_hangs_by_more_substeps_instead_of_levels() {
    let n = 21;
    let mut mesh = Mesh::grid(n, n, 1.0, 1.0);
    mesh.positions.iter_mut().for_each(|x| *x = Vec3::new(x.x, x.z, 0.0));
    let pinned: Vec<u32> = (n * n - n..n * n).collect();
    let breeze = Attributes { wind: Vec3::new(0.6, 0.0, 0.8), air_density: 1.2, damping: 0.2, ..Attributes::default() };
    let still = Attributes { damping: 1.0, ..Attributes::default() };
    for (stretch, has_levels) in [(300.0, false), (900.0, false), (1200.0, true)] {
        let fabric = Fabric { stretch, ..Fabric::JERSEY };
        let options = Options { backend: Backend::Cpu, fabric, pinned: pinned.clone(), ..Options::default() };
        for (scene, is_still) in [(&breeze, false), (&still, true)] {
            let mut cloth = Deformer::new(&mesh, options.clone()).unwrap();
            let (mut levels, mut warnings) = (0, 0);
            for _ in 0..240 {
                let report = cloth.step(FRAME, scene).unwrap();
                (levels, warnings) = (report.levels, warnings + report.warnings.len());
            }
            let strain = cloth.measure().unwrap().max_strain;
            let x = cloth.positions().unwrap();
            let hem = &x[..n as usize];
            let width = hem.iter().map(|x| x.x).fold(f32::MIN, f32::max) - hem.iter().map(|x| x.x).fold(f32::MAX, f32::min);
            let bow = x.iter().map(|x| x.z.abs()).fold(0.0, f32::max);
            println!(
                "K = {stretch}: {levels} levels, hem {width} m, worst edge {strain}, {bow} m out of its plane, {warnings} warnings"
            );
            assert_eq!(levels > 0, has_levels, "K = {stretch}");
            assert!(width > 0.985 && strain < 0.05, "K = {stretch}: hem {width} m, worst edge {strain}");
            assert!(!is_still || bow < 3e-3, "K = {stretch}: {bow} m out of its plane");
        }
    }
}
