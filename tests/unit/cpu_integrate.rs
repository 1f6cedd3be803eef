//! Unit tests of `src/cpu/integrate.rs`.

use super::*;
use crate::model::cloth::Cloth;
use crate::simd::aligned::AlignedVec;
use crate::step::coefficients::Coefficients;
use crate::step::motion::Motion;
use crate::step::plan::{PlanBuffers, StepInputs};
use crate::step::substep_count::Length;
use crate::{Attributes, Collider, Mesh, Options};

/// The SIMD and the scalar path give the same bits for vertices close to colliders and far from them, slow and fast.
#[test]
fn what_is_told_to_be_clear_is_clear() {
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
        let inputs = StepInputs {
            cloth: &cloth,
            levels: &[],
            options: &options,
            coefficients: &coefficients,
            motion: &motion,
            substeps: 2,
            attributes: &attributes,
        };
        let plan = Plan::new(&inputs, &mut lists);
        let mut random = fastrand::Rng::with_seed(8);
        let mut vector = |size: f32| glam::Vec3::from_array([0; 3].map(|_: i32| size * (random.f32() - 0.5)));
        let count = cloth.rest.len();
        let start: Vec<[Vec4; 2]> = cloth
            .rest
            .iter()
            .map(|rest| [(rest.truncate() * far + vector(0.3)).extend(rest.w), vector(size).extend(0.0)])
            .collect();
        let run = |width: Option<Width>| {
            let [mut x, mut u, mut none] = [count, count, 0].map(AlignedVec::new);
            start.iter().enumerate().for_each(|(v, [at, by])| (x[v], u[v]) = (*at, *by));
            let (shared_x, shared_u, task) = (SharedArray::new(x.room()), SharedArray::new(u.room()), Task::alone());
            let good = [SharedArray::new(none.room()), SharedArray::new(&mut [])];
            let found = VertexWatch::nothing(&plan.params, &cloth.rest);
            let (x_view, u_view) = (&shared_x, &shared_u);
            let integrator =
                Integrator { plan: &plan, x: x_view, u: u_view, good, found, width: width.unwrap_or(Width::detected()) };
            let (substep, after) = (&plan.substeps[0], AfterMove::Fall(&plan.substeps[1]));
            match width {
                Some(_) => integrator.advance(&task, &[0..37, 37..count as u32], substep, after),
                None => integrator.advance_each(x_view.within(&task), u_view.within(&task), 0..count, substep, after),
            }
            [x, u].map(|values| values.iter().map(Vec4::to_array).collect::<Vec<_>>())
        };
        let one = run(None);
        for (one, many) in Width::all().into_iter().map(|w| run(Some(w))).flat_map(|many| one.clone().into_iter().zip(many)) {
            let same = |a: &[f32; 4], b: &[f32; 4]| a[..3].iter().zip(&b[..3]).all(|(a, b)| a == b);
            let first = one.iter().zip(&many).position(|(a, b)| !same(a, b));
            assert!(first.is_none(), "{:?} {far} {size}: vertex {first:?}", body.shape);
        }
    }
}
