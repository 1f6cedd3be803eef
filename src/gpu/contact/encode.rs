//! The dispatches of contact in a substep.

use super::GpuContact;
use super::kernel_choice::Response;
use super::stages::Stages;
use super::status::{FIRST_LEVEL, PARTS};
use crate::contact::device::table::ContactParams;
use crate::contact::{ROUNDS, iterations, returns_momentum};
use crate::gpu::stage::{ComputePass, Stage};
use crate::step::plan::Plan;

/// Range of the invocations of dispatches over pairs. With more pairs, each handles several.
const MIN_ITEMS: usize = 4096;
const MAX_ITEMS: usize = 1 << 18;
/// Invocations per workgroup of the kernels that compare boxes, measure candidates, look for near pairs, and bound leaves.
pub(crate) const COMPARERS: usize = 256;
pub(crate) const MEASURERS: usize = 128;
pub(crate) const FINDERS: usize = 256;
pub(crate) const BOUNDERS: usize = 128;
/// Levels below the root of the largest tree that `bound` bounds down to where a descent begins.
const BOUND_AT_ONCE: u32 = FIRST_LEVEL + 1 + (BOUNDERS / PARTS).ilog2();
/// Number of pairs that act from which workgroups collect their sums.
pub(super) const MANY: u32 = 1 << 16;
/// Limit on the invocations that only check that no pair is near, whose workgroups each compute the mean displacement.
const GLANCED: usize = 16_384;

impl GpuContact {
    /// Encodes contact in substep number `index` after its sweep; `group` is an index of
    /// [`crate::gpu::state::PING_PONG`].
    pub(crate) fn encode(&self, pass: &mut ComputePass, plan: &Plan<'_>, index: usize, group: usize) {
        let Some(stages) = &self.stages else { return };
        let (may_detect, response) = (self.choice.may_detect(index), self.choice.response);
        let vertices = self.params.vertices as usize;
        let begin_contact = match response {
            _ if may_detect => &stages.begin_contact,
            Response::None => &stages.begin_alone,
            _ => &stages.begin_between,
        };
        if let (0, Some([bound_cloth, bound_meshes])) = (index, &stages.start) {
            bound_cloth.dispatch(pass, group, &[], vertices);
            bound_meshes.dispatch(pass, group, &[], self.params.mesh_vertices());
        }
        // Mesh colliders that stand still are put in place once.
        let meshes_move = index == 0 || (!self.on_cpu.bodies.are_still && (may_detect || response > Response::None));
        begin_contact.dispatch(pass, group, &[], if meshes_move { self.params.all_vertices as usize } else { vertices });
        if may_detect || response == Response::Full {
            let decide = if may_detect { &stages.decide } else { &stages.decide_between };
            decide.dispatch_workgroups(pass, group, &[], 1);
        }
        if may_detect {
            self.encode_detection(stages, pass, group);
        }
        match response {
            Response::None => {}
            Response::Glance => stages.glance.dispatch(pass, group, &[], self.items(self.status.listed).min(GLANCED)),
            Response::Full => self.encode_response(stages, pass, plan, group),
        }
    }

    /// The number of invocations for the pairs, given their number before the step.
    fn items(&self, before: u32) -> usize {
        (2 * before as usize).clamp(MIN_ITEMS, self.room.clamp(MIN_ITEMS, MAX_ITEMS))
    }

    fn encode_detection(&self, stages: &Stages, pass: &mut ComputePass, group: usize) {
        let ContactParams { all_vertices, depth, mesh_depth, mesh_leaves, features, .. } = self.params;
        stages.begin_paths.dispatch(pass, group, &[], all_vertices as usize);
        stages.prepare.dispatch(pass, group, &[], self.params.boxes().max(self.items(self.status.listed)));
        // Workgroups do not share the leaves of both trees.
        let leaves = (1_usize << depth).next_multiple_of(BOUNDERS / PARTS) + mesh_leaves as usize;
        stages.bound.dispatch_workgroups(pass, group, &[], (PARTS * leaves).div_ceil(BOUNDERS));
        if depth.max(mesh_depth) > BOUND_AT_ONCE {
            stages.refit.dispatch_workgroups(pass, group, &[], 1 + mesh_leaves.min(1) as usize);
        }
        stages.descend.dispatch_workgroups(pass, group, &[], 1 << depth);
        let compared = (self.status.leaf_pairs as usize * features as usize).min(MAX_ITEMS) as u32;
        stages.compare.dispatch_workgroups(pass, group, &[], self.items(compared).div_ceil(COMPARERS));
        let measured = self.items(self.status.candidates + self.status.edge_candidates);
        stages.measure.dispatch_workgroups(pass, group, &[], measured.div_ceil(MEASURERS));
    }

    fn encode_response(&self, stages: &Stages, pass: &mut ComputePass, plan: &Plan<'_>, group: usize) {
        let vertices = self.params.vertices as usize;
        stages.find.dispatch_workgroups(pass, group, &[], self.items(self.status.listed).div_ceil(FINDERS));
        let items = self.items(self.status.near + self.status.acting);
        let many = usize::from(self.status.acting >= self.many);
        stages.warm_start[many].dispatch(pass, group, &[], items);
        stages.apply_impulses_first.dispatch(pass, group, &[], vertices);
        let iterations = iterations(plan.params.h);
        for iteration in 1..=iterations {
            stages.step[usize::from(iteration == iterations)][many].dispatch(pass, group, &[], items);
            let apply_impulses = if iteration < iterations { &stages.apply_impulses } else { &stages.apply_impulses_last };
            apply_impulses.dispatch(pass, group, &[], vertices);
        }
        let truncate = |pass: &mut ComputePass, [first, next, last, finish]: &[Stage; 4]| {
            [first, next, last].into_iter().for_each(|round| round.dispatch(pass, group, &[], items));
            finish.dispatch(pass, group, &[], vertices);
        };
        let is_free = plan.meshes.is_empty() && !plan.cloth.has_pins();
        truncate(pass, &stages.truncate);
        if !is_free {
            truncate(pass, &stages.truncate_again);
        }
        for _ in 0..if self.max_carry > 0.0 { ROUNDS } else { 0 } {
            stages.carry.dispatch_workgroups(pass, group, &[], 1);
            truncate(pass, &stages.truncate_again);
        }
        if returns_momentum(plan, &self.on_cpu.bodies) {
            stages.give_back.dispatch(pass, group, &[], vertices);
        }
        if !is_free {
            stages.find_pinched.dispatch_workgroups(pass, group, &[], 1);
        }
    }
}
