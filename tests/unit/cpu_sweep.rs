//! Unit tests of `src/cpu/sweep.rs`.

use glam::{Vec3A, Vec4};

use super::*;
use crate::cpu::edge_batches::EdgeBatches;
use crate::cpu::partition::Partition;
use crate::cpu::tasks::shared::{SharedArray, Task};
use crate::kernels::distance::Edge;
use crate::kernels::integrate::xyz;
use crate::model::cloth::Cloth;
use crate::model::shells::tests::cushion;
use crate::multigrid::hierarchy::OVER_RELAXATION;
use crate::oracle;
use crate::simd::aligned::AlignedVec;
use crate::simd::{self, Width};
use crate::step::coefficients::Coefficients;
use crate::step::substep_count::Length;
use crate::{Fabric, Mesh, Options};

/// `u` after one sweep, edge by edge in color order.
fn swept_plainly(x: &[Vec4], edges: &[Edge], start: &[Vec4], rule: Rule) -> Vec<Vec4> {
    let impulse = |d0: Vec3A, du: Vec3A, predicted: Vec3A, w: f32, Edge { inverse_rest, inverse_weight, .. }| match rule {
        Rule::Project => oracle::project_edge(d0, du, inverse_rest, inverse_weight),
        Rule::PullCoarse => oracle::pull_coarse(d0, du, inverse_rest, inverse_weight),
        Rule::ProjectCoarse { per_slack } => {
            oracle::project_coarse(d0, du, predicted, [inverse_rest, inverse_weight, 1.0 / per_slack, w])
        }
        Rule::HoldCoarse => oracle::hold_coarse(d0, du, inverse_rest, inverse_weight),
        Rule::Relax => oracle::relax_edge(d0, du, inverse_rest, inverse_weight),
    };
    let mut u = start.to_vec();
    for edge in edges {
        let (a, b) = (edge.a as usize, edge.b as usize);
        let by = impulse(xyz(x[a] - x[b]), xyz(u[a] - u[b]), xyz(start[a] - start[b]), x[a].w + x[b].w, *edge).extend(0.0);
        u[a] += by * x[a].w;
        u[b] -= by * x[b].w;
    }
    u
}

/// `u` after one sweep in pieces, there and back.
fn swept(cloth: &Cloth, from: &[Vec4], edges: &[Edge], start: &[Vec4], rule: Rule, width: Width) -> Vec<Vec4> {
    let [mut x, mut u, mut predicted] = [from, start, start].map(|values| {
        let mut copy = AlignedVec::new(values.len());
        copy.copy_from_slice(values);
        copy
    });
    let partition = Partition::new(&cloth.links, cloth.swept().len(), &[], x.len());
    let weights = cloth.inverse_mass();
    let task = Task::alone();
    for pieces in partition.rounds.iter().chain(partition.rounds_back(cloth).iter().rev()) {
        let batches = EdgeBatches::new(pieces, edges, &cloth.colors, &weights, width.lanes());
        let [x, u, predicted] = [&mut x, &mut u, &mut predicted].map(|values| SharedArray::new(values.room()));
        let [x, u, predicted] = [&x, &u, &predicted].map(|values| values.within(&task));
        let batches = (0..pieces.len()).flat_map(|piece| batches.of(piece));
        batches.for_each(|batch| simd::run(width, SweepRows { rule, batch, x, u, predicted }));
    }
    u.to_vec()
}

/// Sweeping in pieces agrees with sweeping edge by edge, to rounding, at every SIMD width: for gentle and wild motion,
/// soft and stiff edges, with and without pins.
#[test]
fn every_width_sweeps_as_the_oracle_does() {
    sweeps_as_the_oracle_does(Mesh::grid(37, 61, 1.0, 1.6));
}

/// The edges of a closed shell are visited once more, color by color in reverse order, except for those of the last color.
#[test]
fn a_shell_is_swept_there_and_back() {
    let cloth = Cloth::new(&cushion(33), &Options::default()).unwrap();
    let [there, back] = [cloth.colors.clone(), cloth.visits().split_off(cloth.colors.len())];
    assert!(back.iter().eq(there.iter().rev().skip(1)));
    sweeps_as_the_oracle_does(cushion(33));
}

fn sweeps_as_the_oracle_does(mut mesh: Mesh) {
    let mut random = fastrand::Rng::with_seed(9);
    let mut vector = |size: f32| glam::Vec3::from_array([0; 3].map(|_: i32| size * (random.f32() - 0.5)));
    mesh.positions.iter_mut().for_each(|x| *x += vector(0.004));
    for (size, stretch) in [(0.05, 1.0), (0.001, 50.0), (0.001, 1e6), (0.05, 5000.0), (2.0, 5000.0)] {
        let fabric = Fabric { stretch, ..Fabric::default() };
        let options = Options { fabric, pinned: vec![0, 36, 500], ..Options::default() };
        let cloth = Cloth::new(&mesh, &options).unwrap();
        let once = Coefficients::new(&cloth, &[], &options, Length::of(1.0 / 1200.0)).edges;
        // Some edges are already stretched by several percent at the substep's start.
        let x: Vec<Vec4> = cloth.rest.iter().map(|x| *x + vector(0.0015).extend(0.0)).collect();
        let start: Vec<Vec4> = cloth.rest.iter().map(|x| vector(if x.w > 0.0 { size } else { 0.0 }).extend(0.0)).collect();
        let project_coarse = Rule::ProjectCoarse { per_slack: 80.0 };
        for (rule, over) in [
            (Rule::Project, 1.0),
            (Rule::PullCoarse, 1.0),
            (project_coarse, 1.0),
            (project_coarse, OVER_RELAXATION as f32),
            (Rule::HoldCoarse, 1.0),
            (Rule::Relax, 1.0),
        ] {
            let edges: Vec<Edge> = once.iter().map(|edge| Edge { inverse_weight: over * edge.inverse_weight, ..*edge }).collect();
            let visits: Vec<Edge> = cloth.visits().into_iter().flat_map(|color| &edges[color]).copied().collect();
            let plain = swept_plainly(&x, &visits, &start, rule);
            let moved = plain.iter().zip(&start).map(|(u, start)| (u - start).truncate().length()).fold(0.0, f32::max);
            // The softest edges, whose pushes are bounded, correct little.
            let least = if stretch < 10.0 { 0.001 } else { 0.01 };
            assert!(moved > least * size, "{size}: something is corrected");
            for width in Width::all() {
                let lanes = swept(&cloth, &x, &edges, &start, rule, width);
                let apart = plain.iter().zip(&lanes).map(|(a, b)| (a - b).truncate().length()).fold(0.0, f32::max);
                // What is corrected by more is rounded by more.
                assert!(apart <= 3e-6 * over * (moved + size), "{rule:?} {over} {size} {stretch} {width:?}: {apart} of {moved}");
            }
        }
    }
}
