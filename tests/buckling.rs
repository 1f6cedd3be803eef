//! Cloth that lies flat and is pushed together. It cannot become shorter, so that it has to rise in wrinkles with the area that it has at
//! rest; nothing pushes it out of its plane, though, and the floor and its weight keep it there.

mod common;

use cloth_deformer::glam::{Quat, Vec3};
use cloth_deformer::{Attributes, Backend, Collider, Contact, Deformer, Fabric, Mesh, Options, Quality, StepError, StepReport};
use common::{FRAME, bits, gale};

/// A sheet of 1 m with `side` vertices a side, two of whose edges are held, and what is around it.
struct Rug {
    mesh: Mesh,
    pinned: Vec<u32>,
    side: u32,
    colliders: Vec<Collider>,
    gravity: Vec3,
}

impl Rug {
    fn new(side: u32, collider: Option<Collider>) -> Rug {
        let pinned = (0..side).chain(side * (side - 1)..side * side).collect();
        let gravity = if collider.is_some() { Attributes::default().gravity } else { Vec3::ZERO };
        Rug { mesh: Mesh::grid(side, side, 1.0, 1.0), pinned, side, colliders: collider.into_iter().collect(), gravity }
    }

    fn options(&self, backend: Backend, quality: Quality, contact: Option<Contact>) -> Options {
        let pinned = self.pinned.clone();
        Options { backend, quality, contact, pinned, fabric: Fabric::COTTON, ..Options::default() }
    }

    fn made(&self, backend: Backend, quality: Quality, contact: Option<Contact>) -> Deformer {
        Deformer::new(&self.mesh, self.options(backend, quality, contact)).unwrap()
    }

    /// One of the edges is led by `closed` (m) toward the other.
    fn led(&self, closed: f32) -> Attributes {
        let to = |(index, &pin): (usize, &u32)| {
            let led = if index < self.side as usize { 0.0 } else { closed };
            self.mesh.positions[pin as usize] - led * Vec3::Z
        };
        let pin_targets = Some(self.pinned.iter().enumerate().map(to).collect());
        Attributes { gravity: self.gravity, colliders: self.colliders.clone(), pin_targets, ..Attributes::default() }
    }

    /// Pushes the sheet together by 0.3 m in a second.
    fn push(&self, cloth: &mut Deformer) -> Vec<StepReport> {
        (1..=60).map(|frame| cloth.step(FRAME, &self.led(0.005 * frame as f32)).unwrap()).collect()
    }

    /// The area (m²) of a state in double precision, and the distance (m) of the vertices from the plane of the sheet at rest.
    fn extent(&self, x: &[Vec3]) -> [f64; 2] {
        let area = |triangle: &[u32; 3]| {
            let [a, b, c] = triangle.map(|vertex| x[vertex as usize].as_dvec3());
            0.5 * (b - a).cross(c - a).length()
        };
        let out = x.iter().map(|x| f64::from(x.y.abs())).fold(0.0, f64::max);
        [self.mesh.triangles.iter().map(area).sum(), out]
    }
}

fn floor() -> Collider {
    Collider::plane(Vec3::ZERO, Vec3::Y)
}

fn table() -> Collider {
    Collider::rounded_box(Vec3::new(0.0, -0.5, 0.0), Vec3::new(2.0, 0.5, 2.0), Quat::IDENTITY, 0.0)
}

/// On a floor, on a table and without gravity, with and without contact with itself, at the default quality and at a fixed number of
/// substeps, on a backend.
fn wrinkles(backend: Backend, side: u32, qualities: &[Quality]) {
    for (name, collider) in [("floor", Some(floor())), ("table", Some(table())), ("nothing", None)] {
        for &quality in qualities {
            for contact in [None, Some(Contact::default())] {
                let rug = Rug::new(side, collider.clone());
                let mut cloth = rug.made(backend, quality, contact);
                rug.push(&mut cloth);
                let [area, out] = rug.extent(cloth.positions().unwrap());
                println!("{backend:?}, {name}, {quality:?}, contact {}: {area} m2, {out} m out", contact.is_some());
                assert!((0.985..1.015).contains(&area) && out > 0.03, "{name}, {quality:?}, {contact:?}: {area} m2, {out} m");
            }
        }
    }
}

#[test]
fn what_lies_flat_wrinkles_on_the_cpu() {
    wrinkles(Backend::Cpu, 25, &[Quality::default(), Quality::Substeps(20)]);
}

#[test]
fn what_lies_flat_wrinkles_on_the_hybrid() {
    wrinkles(Backend::Hybrid, 13, &[Quality::default()]);
}

#[test]
fn what_lies_flat_wrinkles_on_the_gpu() {
    wrinkles(Backend::Gpu, 13, &[Quality::default()]);
}

/// Cloth that fell on a floor lies there as flat as if it had been placed.
#[test]
fn what_has_fallen_wrinkles() {
    let mut rug = Rug::new(25, Some(floor()));
    let pinned = std::mem::take(&mut rug.pinned);
    let mut cloth = rug.made(Backend::Cpu, Quality::default(), None);
    let fallen: Vec<Vec3> = rug.mesh.positions.iter().map(|x| *x + Vec3::Y * (0.3 + 0.1 * x.x)).collect();
    cloth.set_state(&fallen, &vec![Vec3::ZERO; fallen.len()]).unwrap();
    let lies = Attributes { colliders: rug.colliders.clone(), ..Attributes::default() };
    (0..90).for_each(|_| drop(cloth.step(FRAME, &lies).unwrap()));
    let x = cloth.positions().unwrap();
    assert!(rug.extent(x)[1] < 1e-6, "it lies flat");
    rug.mesh.positions = x.to_vec();
    rug.pinned = pinned;
    cloth.set_pinned(rug.pinned.clone()).unwrap();
    rug.push(&mut cloth);
    let [area, out] = rug.extent(cloth.positions().unwrap());
    assert!((0.985..1.015).contains(&area) && out > 0.03, "{area} m2, {out} m");
}

/// What is only pulled stays in its plane: a kick would be ten thousand times as high as this bound.
#[test]
fn what_is_pulled_stays_flat() {
    let rug = Rug::new(25, Some(floor()));
    let mut cloth = rug.made(Backend::Cpu, Quality::default(), None);
    (1..=60).for_each(|frame| drop(cloth.step(FRAME, &rug.led(-1e-4 * frame as f32)).unwrap()));
    let out = rug.extent(cloth.positions().unwrap())[1];
    assert!(out < 1e-8, "{out} m out");
}

/// The numbers of substeps of a run repeat it, levels, kicks and all.
#[test]
fn a_schedule_repeats_the_wrinkles() {
    let rug = Rug::new(17, Some(floor()));
    let mut cloth = rug.made(Backend::Cpu, Quality::default(), None);
    let reports = rug.push(&mut cloth);
    let mut again = rug.made(Backend::Cpu, Quality::Substeps(20), None);
    for (frame, report) in (1..).zip(reports) {
        again.set_quality(Quality::Substeps(report.in_a_sixtieth)).unwrap();
        assert_eq!(again.step(FRAME, &rug.led(0.005 * frame as f32)).unwrap().levels, report.levels);
    }
    assert_eq!(bits(&mut again), bits(&mut cloth));
}

/// A step that fails leaves no kick behind.
#[test]
fn a_failed_step_undoes_its_kick() {
    let rug = Rug::new(17, Some(floor()));
    let mut cloth = rug.made(Backend::Cpu, Quality::Substeps(20), None);
    for frame in 1..=8 {
        let before = bits(&mut cloth);
        let failed = cloth.step(FRAME, &gale(&rug.led(0.005 * frame as f32)));
        assert!(matches!(failed, Err(StepError::Unstable { .. })), "{failed:?}");
        assert_eq!(bits(&mut cloth), before, "frame {frame}");
        cloth.step(FRAME, &rug.led(0.005 * frame as f32)).unwrap();
    }
}

/// A straight thread along gravity folds like a sheet: one that falls on its end, and one whose ends are brought together.
#[test]
fn a_straight_thread_folds() {
    let count = 21;
    let positions: Vec<Vec3> = (0..count).map(|k| Vec3::Y * (0.1 + k as f32 / (count - 1) as f32)).collect();
    let mesh = Mesh { positions, triangles: (1..count).map(|k| [k - 1, k, k]).collect() };
    let ends = vec![0, count - 1];
    for quality in [Quality::Strain(0.03), Quality::Substeps(15)] {
        for (pinned, colliders) in [(Vec::new(), vec![floor()]), (ends.clone(), Vec::new())] {
            let is_led = !pinned.is_empty();
            let options = Options { backend: Backend::Cpu, quality, pinned, fabric: Fabric::COTTON, ..Options::default() };
            let mut thread = Deformer::new(&mesh, options).unwrap();
            for frame in 1..=120 {
                let by = Vec3::Y * (0.5 * (frame as f32 / 60.0).min(1.0));
                let pin_targets = is_led.then(|| vec![mesh.positions[0], mesh.positions[count as usize - 1] - by]);
                thread.step(FRAME, &Attributes { colliders: colliders.clone(), pin_targets, ..Attributes::default() }).unwrap();
            }
            let x = thread.positions().unwrap();
            let length: f64 = x.windows(2).map(|ends| f64::from(ends[0].distance(ends[1]))).sum();
            let aside = x.iter().map(|x| x.with_y(0.0).length()).fold(0.0, f32::max);
            println!(
                "{quality:?}, led {is_led}: {length} m long, {aside} m aside, the highest vertex at {}",
                x[count as usize - 1].y
            );
            assert!((length - 1.0).abs() < 0.03 && aside > 0.02, "{quality:?}: {length} m long, {aside} m aside");
        }
    }
}
