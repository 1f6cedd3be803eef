//! The response: each near pair is held apart by a multiplier. All step at once (Jacobi) and are gathered vertex by vertex, in the order of
//! the pairs, so that nothing depends on who computes what.

use glam::Vec3A;

use super::for_chunks;
use super::near::{Contacts, Near, Vertex};
use crate::kernels::contact::{DEPENETRATION, contact_body};
use crate::kernels::integrate::xyz;
use crate::kernels::pair::{RELAXATION, impulse, step_of_lambda};
use crate::kernels::params::Substep;
use crate::step::plan::Plan;

/// Steps of the multipliers in a substep.
const ITERATIONS: usize = 4;
/// Pairs, and vertices, that a task steps.
pub(super) const GRAIN: usize = 512;

impl Contacts {
    /// Moves the vertices of near pairs so that pairs stay apart by their thickness, with friction, and out of the colliders.
    pub(super) fn respond(&mut self, plan: &Plan<'_>, substep: &Substep, friction: f32, is_shared: bool) {
        // What held them apart in the last substep most likely does.
        self.give(plan, substep, is_shared);
        for _ in 0..ITERATIONS {
            self.step(friction, is_shared);
            self.give(plan, substep, is_shared);
        }
        self.push(DEPENETRATION * plan.params.h, is_shared);
    }

    /// Steps the multipliers.
    fn step(&mut self, friction: f32, is_shared: bool) {
        let Contacts { pairs, holds, vertices, .. } = self;
        for_chunks(is_shared, holds, GRAIN, |first, holds| {
            for (hold, pair) in holds.iter_mut().zip(&pairs[first..]).filter(|(_, pair)| pair.acts) {
                let relative: Vec3A = (0..4).map(|k| vertices[pair.corners[k] as usize].u * pair.weights[k]).sum();
                let gap = (pair.distance - pair.thickness).max(0.0);
                let lambda = step_of_lambda(hold.lambda, pair.normal, gap, relative, pair.rate, friction);
                hold.impulse = impulse(lambda - hold.lambda, pair.normal);
                hold.lambda = lambda;
            }
        });
    }

    /// Gives vertices the impulses of their pairs, and meets the colliders with them.
    fn give(&mut self, plan: &Plan<'_>, substep: &Substep, is_shared: bool) {
        let Contacts { pairs, holds, vertices, corners, corner_starts, .. } = self;
        for_chunks(is_shared, vertices, GRAIN, |first, vertices| {
            for (vertex, range) in vertices.iter_mut().zip(corner_starts[first..].windows(2)) {
                if vertex.x.w == 0.0 || vertex.weight == 0.0 {
                    continue;
                }
                let corners = &corners[range[0] as usize..range[1] as usize];
                vertex.u += sum(corners, |index| holds[index].impulse, pairs) * vertex.x.w;
                for body in plan.bodies {
                    vertex.u = contact_body(xyz(vertex.x), vertex.u, body, substep, &plan.params).1;
                }
            }
        });
    }

    /// Moves vertices of pairs that are nearer than their thickness apart, by at most so far (m), without giving them a velocity.
    fn push(&mut self, most: f32, is_shared: bool) {
        let Contacts { pairs, vertices, corners, corner_starts, .. } = self;
        let apart = |index: usize| {
            let pair = &pairs[index];
            let depth = (pair.thickness - pair.distance).clamp(0.0, most);
            pair.normal * (depth * pair.rate / RELAXATION)
        };
        for_chunks(is_shared, vertices, GRAIN, |first, vertices: &mut [Vertex]| {
            for (vertex, range) in vertices.iter_mut().zip(corner_starts[first..].windows(2)) {
                if vertex.weight > 0.0 {
                    let corners = &corners[range[0] as usize..range[1] as usize];
                    vertex.push += sum(corners, apart, pairs) * vertex.x.w;
                }
            }
        });
    }
}

/// What the pairs of some corners give, times the corners' weights.
fn sum(corners: &[u32], of: impl Fn(usize) -> Vec3A, pairs: &[Near]) -> Vec3A {
    corners
        .iter()
        .map(|&corner| (corner as usize / 4, corner as usize % 4))
        .map(|(pair, k)| of(pair) * pairs[pair].weights[k])
        .sum()
}
