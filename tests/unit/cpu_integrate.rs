//! Unit tests of `src/cpu/integrate.rs`.

use super::*;
use crate::model::cloth::Cloth;
use crate::simd::aligned::AlignedVec;
use crate::step::coefficients::Coefficients;
use crate::step::motion::Motion;
use crate::step::plan::{PlanBuffers, StepInputs};
use crate::step::substep_count::Length;
use crate::{Attributes, Collider, Mesh, Options};

/// Vertices close to colliders and far from them, slow and fast, end with the same bits in whatever groups they are advanced, and
/// within rounding at any width.
#[test]
fn any_groups_of_vertices_are_advanced_alike() {
    let options = Options { pinned: vec![3, 70], ..Options::default() };
    let cloth = Cloth::new(&Mesh::grid(64, 65, 1.0, 1.0), &options).unwrap();
    let h = 1.0 / 1200.0;
    let coefficients = Coefficients::new(&cloth, &[], &options, Length::of(h));
    let at = |y: f32| glam::Vec3::new(0.2, y, -0.1);
    let bodies = [
        Collider::sphere(at(0.1), 0.3),
        Collider::capsule(at(0.4), at(-0.6), 0.2),
        Collider::plane(at(-0.2), glam::Vec3::new(0.6, 0.8, 0.0)),
    ];
    for (body, far, size) in
        bodies.into_iter().flat_map(|b| [(1.0, 1e-4), (1.0, 0.03), (1.0, 0.5), (20.0, 0.01)].map(|(f, s)| (b.clone(), f, s)))
    {
        // A different start position, so that the collider moves within the step.
        let before = match body.shape {
            _ if size > 0.1 => body.clone(),
            _ => Collider::sphere(at(0.3), 0.25),
        };
        let attributes = Attributes { colliders: vec![body.clone()], ..Attributes::default() };
        let (mut lists, motion) =
            (PlanBuffers::default(), Motion { colliders: vec![before], ..Motion::after(&cloth, &cloth.rest, h) });
        let inputs = StepInputs::of(&cloth, &options, &coefficients, &motion, 2, &attributes);
        let plan = Plan::new(&inputs, &mut lists);
        let mut random = fastrand::Rng::with_seed(8);
        let mut vector = |size: f32| glam::Vec3::from_array([0; 3].map(|_: i32| size * (random.f32() - 0.5)));
        let count = cloth.rest.len();
        let start: Vec<[Vec4; 2]> = cloth
            .rest
            .iter()
            .map(|rest| [(rest.truncate() * far + vector(0.3)).extend(rest.w), vector(size).extend(0.0)])
            .collect();
        let run = |width: Width, ranges: &[Range<u32>]| {
            let [mut x, mut u, mut none] = [count, count, 0].map(AlignedVec::new);
            start.iter().enumerate().for_each(|(v, [at, by])| (x[v], u[v]) = (*at, *by));
            let (shared_x, shared_u, task) = (SharedArray::new(x.room()), SharedArray::new(u.room()), Task::alone());
            let good = [SharedArray::new(none.room()), SharedArray::new(&mut [])];
            let found = VertexWatch::nothing(&plan.params, &cloth.rest);
            let integrator = Integrator { plan: &plan, x: &shared_x, u: &shared_u, good, found, width };
            integrator.advance(&task, ranges, &plan.substeps[0], AfterMove::Fall(&plan.substeps[1]));
            [x, u].map(|values| values.iter().map(|v| v.truncate()).collect::<Vec<_>>())
        };
        let end = count as u32;
        let (whole, cut) = (0..end, [0..37, 37..38, 38..end - 5, end - 5..end]);
        let whole = std::slice::from_ref(&whole);
        let narrow = run(Width::at_most(4), whole);
        for width in Width::all() {
            let one = run(width, whole);
            assert_eq!(one, run(width, &cut), "{:?} {far} {size}, {width:?}", body.shape);
            for (one, narrow) in one.iter().flatten().zip(narrow.iter().flatten()) {
                let apart = one.distance(*narrow);
                assert!(
                    apart <= 1e-5 * (size + 0.1) + 1e-6 * one.length(),
                    "{:?} {far} {size}, {width:?}: {apart} m",
                    body.shape
                );
            }
        }
    }
}
