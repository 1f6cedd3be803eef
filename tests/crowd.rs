//! A crowd on the CPU: each cloth moves as it would alone, bit for bit, on any number of threads and beside any other
//! cloths.

mod common;

use cloth_deformer::glam::Vec3;
use cloth_deformer::{Attributes, Backend, Collider, Contact, Deformer, Fabric, Mesh, Options, Quality, StepError, StepReport};
use common::FRAME;

/// Forty small cloths, all different, and a large one among them, with their attributes.
fn crowd() -> Vec<(Deformer, Attributes)> {
    let cloth = |index: u32| {
        let side = if index == 7 { 70 } else { 5 + index % 6 };
        let fabric = Fabric { bending: if index.is_multiple_of(3) { 1e-4 } else { 0.0 }, ..Fabric::COTTON };
        let contact = index.is_multiple_of(5).then(Contact::default);
        let quality = if index.is_multiple_of(2) { Quality::default() } else { Quality::Substeps(6) };
        let options =
            Options { backend: Backend::Cpu, fabric, contact, quality, pinned: vec![0, side - 1], ..Options::default() };
        let attributes = Attributes {
            wind: Vec3::X * index as f32 * 0.2,
            air_density: if index.is_multiple_of(4) { 1.2 } else { 0.0 },
            colliders: vec![Collider::sphere(Vec3::new(0.0, -0.4, 0.0), 0.2)],
            ..Attributes::default()
        };
        (Deformer::new(&Mesh::grid(side, side, 1.0, 1.0), options).unwrap(), attributes)
    };
    (0..41).map(cloth).collect()
}

/// The reports of some frames, and the final positions of the cloths.
fn played(alone: bool, threads: usize) -> (Vec<Result<StepReport, StepError>>, Vec<[u32; 3]>) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    pool.install(|| {
        let (mut crowd, mut reports) = (crowd(), Vec::new());
        for frame in 0..5 {
            // A cloth that is refused does not affect the others, and its error is at its place in the results.
            crowd[11].1.damping = if frame == 2 { -1.0 } else { 0.0 };
            if alone {
                reports.extend(crowd.iter_mut().map(|(cloth, attributes)| cloth.step(FRAME, attributes)));
            } else {
                reports.extend(Deformer::step_all(crowd.iter_mut().map(|(cloth, attributes)| (cloth, &*attributes)), FRAME));
            }
        }
        let x = crowd.iter_mut().flat_map(|(cloth, _)| cloth.positions().unwrap().to_vec());
        (reports, x.map(|x| x.to_array().map(f32::to_bits)).collect())
    })
}

#[test]
fn each_of_a_crowd_goes_as_it_would_alone() {
    let (reports, positions) = played(true, 1);
    let refused: Vec<usize> = (0..reports.len()).filter(|&index| reports[index].is_err()).collect();
    assert_eq!(refused, [2 * 41 + 11]);
    for threads in [1, 2, 5, 64] {
        let crowd = played(false, threads);
        assert_eq!(crowd.0, reports, "{threads} threads");
        assert!(crowd.1 == positions, "{threads} threads: other bits");
    }
}

#[test]
fn an_empty_crowd_is_stepped_and_a_crowd_of_one() {
    assert!(Deformer::step_all([], FRAME).is_empty());
    let mut crowd = crowd();
    let (cloth, attributes) = &mut crowd[0];
    assert!(Deformer::step_all([(cloth, &*attributes)], FRAME)[0].is_ok());
}
