//! Tuning, judged by runs of the test's own: the choice keeps the tolerance, terms without effect are dropped, and
//! chaos is recognized.

use cloth_deformer::glam::Vec3;
use cloth_deformer::{
    Attributes, Backend, BuildError, Collider, Deformer, Fabric, Levels, Mesh, Options, Quality, Sleep, StepError, Tolerance,
    tune,
};

const FRAME: f32 = 1.0 / 60.0;

fn hung(n: u32, fabric: Fabric) -> (Mesh, Options) {
    (Mesh::grid(n, n, 1.0, 1.0), Options { backend: Backend::Cpu, fabric, pinned: (0..n).collect(), ..Options::default() })
}

fn membrane() -> Fabric {
    Fabric { density: 0.2, stretch: 5000.0, bending: 0.0, damping: 0.0 }
}

/// Positions after each frame.
fn play(mesh: &Mesh, options: Options, frames: u32) -> Vec<Vec<Vec3>> {
    let mut cloth = Deformer::new(mesh, options).unwrap();
    let frame = |_| {
        cloth.step(FRAME, &Attributes::default()).unwrap();
        cloth.positions().unwrap().to_vec()
    };
    (0..frames).map(frame).collect()
}

/// The largest RMS distance (mm) over the frames.
fn apart(a: &[Vec<Vec3>], b: &[Vec<Vec3>]) -> f32 {
    let rms = |(a, b): (&Vec<Vec3>, &Vec<Vec3>)| {
        (a.iter().zip(b).map(|(a, b)| a.distance_squared(*b)).sum::<f32>() / a.len() as f32).sqrt()
    };
    1e3 * a.iter().zip(b).map(rms).fold(0.0, f32::max)
}

#[test]
fn what_is_chosen_is_as_far_off_as_it_says() {
    let (mesh, options) = hung(20, membrane());
    let finer = Options { quality: Quality::Substeps(400), levels: Levels::Off, ..options.clone() };
    let truth = play(&mesh, finer, 30);
    let mut substeps = Vec::new();
    for tolerance in [40.0, 10.0, 2.0] {
        let tuned = tune(&mesh, &options, |_| Attributes::default(), 30, Tolerance::Position(tolerance)).unwrap();
        let off = apart(&truth, &play(&mesh, tuned.options.clone(), 30));
        let said = tuned.best.error.max(tuned.best.checked);
        assert!(tuned.kept);
        println!("{tolerance} mm: {} is {off} mm off, {said} as it says", tuned.best.setting);
        assert!(!tuned.chaotic && tuned.trials.len() <= 20);
        assert!(said <= tolerance && off <= 1.05 * tolerance, "{off} mm off");
        assert!((off / said - 1.0).abs() < 0.25 || off < 0.1, "{off} mm off, {said} as it says");
        assert!(tolerance < 10.0 || tuned.best.substeps < tuned.resolved.unwrap().substeps);
        substeps.push(tuned.best.substeps);
    }
    assert!(substeps[0] < substeps[2], "more accuracy for as many substeps: {substeps:?}");
}

/// Cloth that sleeps takes no substeps, but that says nothing of what a setting costs: the first two runs, which do not depend on
/// times, take as many as without sleep.
#[test]
fn what_is_tuned_does_not_sleep() {
    let mesh = Mesh::grid(16, 16, 1.0, 1.0);
    let scene = |_| Attributes { colliders: vec![Collider::plane(Vec3::ZERO, Vec3::Y)], damping: 4.0, ..Attributes::default() };
    let substeps = |sleep| {
        let options = Options { backend: Backend::Cpu, fabric: membrane(), sleep, ..Options::default() };
        let tuned = tune(&mesh, &options, scene, 90, Tolerance::Position(10.0)).unwrap();
        assert_eq!(tuned.options.sleep, sleep, "it sleeps as before once it is tuned");
        [0, 1].map(|run| tuned.trials[run].substeps)
    };
    assert_eq!(substeps(Some(Sleep::default())), substeps(None));
}

#[test]
fn a_term_goes_if_the_scene_is_the_same_without_it() {
    let (mesh, options) = hung(16, Fabric { bending: 1e-9, damping: 0.06, ..membrane() });
    let wind = |_| Attributes { wind: Vec3::new(0.0, 0.0, 5.0), air_density: 1.225, ..Attributes::default() };
    let tuned = tune(&mesh, &options, wind, 30, Tolerance::Position(20.0)).unwrap();
    let dropped: Vec<_> = tuned.terms.iter().map(|term| (term.name, term.dropped)).collect();
    println!("{:?}", tuned.terms);
    assert!(dropped.contains(&("bending", true)) && dropped.contains(&("air", false)), "{dropped:?}");
    assert_eq!(tuned.options.fabric.bending, 0.0);
    assert_eq!(tuned.best.setting.attributes(wind(1)).air_density, 1.225);

    // A strip that stands out like a board needs its bending; the air is so thin that it makes no difference.
    let mesh = Mesh::grid(11, 4, 0.2, 0.06);
    let pinned = (0..4).flat_map(|row| [11 * row, 11 * row + 1]).collect();
    let options = Options { fabric: Fabric { bending: 1e-3, damping: 0.06, ..membrane() }, pinned, ..options };
    let thin = |_| Attributes { air_density: 1e-6, ..Attributes::default() };
    let tuned = tune(&mesh, &options, thin, 30, Tolerance::Position(5.0)).unwrap();
    let dropped: Vec<_> = tuned.terms.iter().map(|term| (term.name, term.dropped)).collect();
    assert!(dropped.contains(&("bending", false)) && dropped.contains(&("air", true)), "{dropped:?}");
    assert_eq!(tuned.best.setting.attributes(thin(1)).air_density, 0.0);
}

#[test]
fn a_motion_that_no_two_runs_repeat_is_compared_by_its_statistics() {
    let (mesh, options) = hung(20, membrane());
    let tuned = tune(&mesh, &options, |_| Attributes::default(), 120, Tolerance::Position(0.05)).unwrap();
    assert!(tuned.chaotic);
    // Vertex by vertex, no choice could be closer than two resolved runs are to each other.
    assert!(tuned.resolved.unwrap().error > 0.025);
    assert!(tuned.kept && tuned.best.error.max(tuned.best.checked) <= tuned.allowed, "{tuned:?}");
}

#[test]
fn a_strain_is_kept_with_the_fewest_substeps() {
    let (mesh, options) = hung(20, membrane());
    let tuned = tune(&mesh, &options, |_| Attributes::default(), 60, Tolerance::Strain(0.03)).unwrap();
    let beyond = |options: Options| {
        let mut cloth = Deformer::new(&mesh, options).unwrap();
        let is_beyond = |_: &u32| {
            cloth.step(FRAME, &Attributes::default()).unwrap();
            cloth.measure().unwrap().stretch_share > 0.03
        };
        (0..60).filter(is_beyond).count()
    };
    println!("{}", tuned.best.setting);
    assert!(tuned.resolved.is_none() && tuned.best.error <= 0.03 && tuned.kept);
    assert_eq!(beyond(tuned.options.clone()), 0);
    // Half as many substeps miss it.
    let half = Quality::Substeps((tuned.best.substeps / 2.0) as u32);
    assert!(beyond(Options { quality: half, ..tuned.options }) > 0);
}

/// What moves before the first step has its velocity in it, as in a run of which the colliders were placed.
#[test]
fn colliders_are_in_motion_from_the_first_step_on() {
    let (mesh, options) = hung(9, membrane());
    // A plane that drags the cloth along.
    let scene = |frame: u32| {
        let plane = Collider::plane(Vec3::Z * 0.02 * frame as f32, Vec3::Y).with_friction(10.0);
        Attributes { colliders: vec![plane], ..Attributes::default() }
    };
    let tuned = tune(&mesh, &options, scene, 2, Tolerance::Strain(1e-7)).unwrap();
    let trial = tuned.trials[0];
    let mut cloth = Deformer::new(&mesh, Options { sleep: None, ..trial.setting.options(&options) }).unwrap();
    cloth.place_colliders(&scene(0).colliders).unwrap();
    let stretch = |frame| {
        cloth.step(FRAME, &scene(frame)).unwrap();
        cloth.measure().unwrap().stretch_share
    };
    let most = (1..3).map(stretch).fold(0.0, f32::max);
    assert!(most > 1e-3, "{most}");
    assert_eq!(trial.error, most);
}

/// A tolerance that no run keeps: the one with the least error is returned, and is said to miss it.
#[test]
fn a_strain_that_nothing_keeps_is_said_to_be_missed() {
    let (mesh, options) = hung(9, membrane());
    let tuned = tune(&mesh, &options, |_| Attributes::default(), 10, Tolerance::Strain(1e-7)).unwrap();
    assert!(!tuned.kept && tuned.best.error > tuned.allowed, "{} is more than {}", tuned.best.error, tuned.allowed);
    assert!(tuned.trials.iter().all(|trial| trial.error.max(trial.checked) >= tuned.best.error.max(tuned.best.checked)));
}

#[test]
fn what_cannot_be_tuned_is_refused() {
    let (mesh, options) = hung(5, membrane());
    let still = |_| Attributes::default();
    for most in [0.0, -1.0, f32::NAN, f32::INFINITY] {
        for tolerance in [Tolerance::Position(most), Tolerance::Strain(most)] {
            let refused = tune(&mesh, &options, still, 5, tolerance).unwrap_err();
            assert!(matches!(&refused, BuildError::Value { name, .. } if name == "tolerance"), "{refused}");
        }
    }
    let refused = tune(&mesh, &options, still, 0, Tolerance::Position(1.0)).unwrap_err();
    assert!(matches!(&refused, BuildError::Value { name, .. } if name == "frames"), "{refused}");
    let broken = |frame| Attributes { gravity: Vec3::Y * if frame == 3 { f32::NAN } else { -9.81 }, ..Attributes::default() };
    let refused = tune(&mesh, &options, broken, 5, Tolerance::Position(1.0)).unwrap_err();
    assert!(matches!(refused, BuildError::Step { frame: 3, error: StepError::Attribute { .. } }), "{refused}");
    let nowhere = Mesh { triangles: vec![[0, 1, 99]], ..mesh.clone() };
    let refused = tune(&nowhere, &options, still, 5, Tolerance::Position(1.0)).unwrap_err();
    assert!(matches!(refused, BuildError::Index { .. }), "{refused}");
    let refused = tune(&mesh, &Options { pinned: vec![99], ..options }, still, 5, Tolerance::Position(1.0)).unwrap_err();
    assert!(matches!(refused, BuildError::Pin { .. }), "{refused}");
}

/// Cloth of which nothing moves has no stability limit, and any setting will do.
#[test]
fn cloth_that_is_pinned_everywhere_can_be_tuned() {
    let (mesh, options) = hung(5, membrane());
    let options = Options { pinned: (0..25).collect(), ..options };
    for tolerance in [Tolerance::Position(0.01), Tolerance::Strain(0.01)] {
        let tuned = tune(&mesh, &options, |_| Attributes::default(), 4, tolerance).unwrap();
        assert!(tuned.kept && tuned.best.error == 0.0, "{}", tuned.best.error);
    }
}
