//! The kernels of contact in the order of a substep, and the buffers that each binds.

use super::Buffers;
use crate::device::{Entry, Gpu, Shader};
use crate::gpu::forces::Forces;
use crate::gpu::shaders;
use crate::gpu::stage::{Bind, Stage};
use crate::gpu::state::{StateBuffers, groups};

/// Bindings of `stages/self_contact/shared.wgsl` that only some kernels use.
const TABLE: usize = 1;
const X: usize = 2;
const VERTICES: usize = 3;
const TRACKS: usize = 4;
const NODES: usize = 5;
const BUCKETS: usize = 6;
const PAIRS: usize = 7;
const NEAR: usize = 8;
const SUMS: usize = 9;
const CONTACT_STATE: usize = 10;
const BODIES: usize = 11;
const IGNORED: usize = 12;
const X_OUT: usize = 13;
const P_OUT: usize = 14;
const BOXES: usize = 15;
const SCRATCH: usize = 16;
const NORMALS: usize = 17;

/// The kernels of a substep.
pub(super) struct Stages {
    /// Used at the start of a step with mesh colliders: `bound_cloth` and `bound_meshes`.
    pub start: Option<[Stage; 2]>,
    pub begin_contact: Stage,
    pub decide: Stage,
    /// Used in substeps without kernels of detection; `begin_alone` in those without any others.
    pub begin_between: Stage,
    pub decide_between: Stage,
    pub begin_alone: Stage,
    pub begin_paths: Stage,
    pub prepare: Stage,
    pub bound: Stage,
    pub refit: Stage,
    pub descend: Stage,
    pub compare: Stage,
    pub measure: Stage,
    pub glance: Stage,
    pub find: Stage,
    /// For few pairs, and for many.
    pub warm_start: [Stage; 2],
    /// For all iterations but the last, and for the last; each for few pairs, and for many.
    pub step: [[Stage; 2]; 2],
    pub apply_impulses_first: Stage,
    pub apply_impulses: Stage,
    pub apply_impulses_last: Stage,
    /// The rounds of `truncate`, and `finish`; and all once more: used with mesh colliders, and as often as more vertices may be
    /// carried.
    pub truncate: [Stage; 4],
    pub truncate_again: [Stage; 4],
    pub carry: Stage,
    pub give_back: Stage,
    /// Used if there are kinematic vertices.
    pub find_pinched: Stage,
}

impl Stages {
    pub(super) fn new(gpu: &Gpu, forces: &Forces, buffers: &Buffers, has_meshes: bool) -> Stages {
        let stage_with = |shader: Shader, name: &'static str, uses: &[usize], constants: &[(&'static str, f64)]| {
            let bindings = groups(&forces.states, |from, to| bindings(buffers, uses, from, to));
            Stage::new(gpu, &forces.uniforms, Entry { shader, name, constants }, &bindings)
        };
        let stage = |shader, name, uses: &[usize]| stage_with(shader, name, uses, &[]);
        let of_few_or_many = |name, is_last| {
            let uses = [VERTICES, NEAR, SUMS, CONTACT_STATE];
            let constants = |collects| [("COLLECTS", collects), ("IS_LAST", is_last)];
            [0.0, 1.0].map(|collects| stage_with(shaders::RESPONSE, name, &uses, &constants(collects)))
        };
        let of_vertices = [VERTICES, SUMS, CONTACT_STATE, BODIES];
        let by_begin = [X, VERTICES, TRACKS, CONTACT_STATE, BODIES, X_OUT, P_OUT];
        let truncate = |again| {
            let by_truncate = [VERTICES, PAIRS, NEAR, SUMS, CONTACT_STATE];
            let of_pairs =
                |round| stage_with(shaders::TRUNCATION, "truncate", &by_truncate, &[("AGAIN", again), ("ROUND", round)]);
            let by_finish = [TABLE, VERTICES, TRACKS, SUMS, CONTACT_STATE, X_OUT, P_OUT];
            let finish = stage_with(shaders::FINISH, "finish", &by_finish, &[("AGAIN", again)]);
            [of_pairs(0.0), of_pairs(1.0), of_pairs(2.0), finish]
        };
        Stages {
            start: has_meshes.then(|| {
                let bound_meshes = stage(shaders::BODIES, "bound_meshes", &[TRACKS, CONTACT_STATE]);
                [stage(shaders::BODIES, "bound_cloth", &[X, CONTACT_STATE]), bound_meshes]
            }),
            begin_contact: stage(shaders::BEGIN_CONTACT, "begin_contact", &by_begin),
            begin_between: stage_with(shaders::BEGIN_CONTACT, "begin_contact", &by_begin, &[("MAY_DETECT", 0.0)]),
            begin_alone: stage_with(
                shaders::BEGIN_CONTACT,
                "begin_contact",
                &by_begin,
                &[("MAY_DETECT", 0.0), ("HAS_CONTACT", 0.0)],
            ),
            decide: stage(shaders::BEGIN_CONTACT, "decide", &[CONTACT_STATE]),
            decide_between: stage_with(shaders::BEGIN_CONTACT, "decide", &[CONTACT_STATE], &[("MAY_DETECT", 0.0)]),
            begin_paths: stage(shaders::TREE, "begin_paths", &[TABLE, VERTICES, TRACKS, BUCKETS, CONTACT_STATE]),
            prepare: stage(
                shaders::NARROW_PHASE,
                "prepare",
                &[TABLE, TRACKS, BUCKETS, PAIRS, NEAR, CONTACT_STATE, BOXES, NORMALS],
            ),
            bound: stage(shaders::TREE, "bound", &[TABLE, NODES, CONTACT_STATE, BOXES, NORMALS]),
            refit: stage(shaders::TREE, "refit", &[NODES, CONTACT_STATE]),
            descend: stage(shaders::DESCENT, "descend", &[TABLE, NODES, CONTACT_STATE, SCRATCH]),
            compare: stage(shaders::BROAD_PHASE, "compare", &[TABLE, CONTACT_STATE, BOXES, SCRATCH]),
            measure: stage(shaders::NARROW_PHASE, "measure", &[TABLE, TRACKS, BUCKETS, PAIRS, CONTACT_STATE, IGNORED, SCRATCH]),
            glance: stage(shaders::NEAR, "glance", &[TABLE, VERTICES, PAIRS, CONTACT_STATE]),
            find: stage(shaders::NEAR, "find", &[TABLE, VERTICES, PAIRS, NEAR, SUMS, CONTACT_STATE]),
            warm_start: of_few_or_many("warm_start", 0.0),
            step: [0.0, 1.0].map(|is_last| of_few_or_many("step_pairs", is_last)),
            apply_impulses_first: stage(shaders::RESPONSE, "apply_impulses_first", &of_vertices),
            apply_impulses: stage(shaders::RESPONSE, "apply_impulses", &of_vertices),
            apply_impulses_last: stage(shaders::RESPONSE, "apply_impulses_last", &[VERTICES, SUMS, CONTACT_STATE, BODIES, TABLE]),
            truncate: truncate(0.0),
            truncate_again: truncate(1.0),
            carry: stage(shaders::CARRY, "carry", &[VERTICES, PAIRS, SUMS, CONTACT_STATE, IGNORED]),
            give_back: stage(shaders::FINISH, "give_back", &[VERTICES, CONTACT_STATE, X_OUT, P_OUT]),
            find_pinched: stage(shaders::CARRY, "find_pinched", &[VERTICES, PAIRS, CONTACT_STATE, IGNORED]),
        }
    }
}

/// The bindings of a kernel that `uses` some of the buffers, in a substep from one state to another.
fn bindings<'a>(buffers: &'a Buffers, uses: &[usize], from: &'a StateBuffers, to: &'a StateBuffers) -> Vec<Bind<'a>> {
    let all = [
        Bind::Uniform(&buffers.contact_params.buffer),
        Bind::Read(&buffers.table),
        Bind::Read(&from.x),
        Bind::Write(&buffers.vertices),
        Bind::Write(&buffers.tracks),
        Bind::Write(&buffers.nodes),
        Bind::Write(&buffers.buckets),
        Bind::Write(&buffers.pairs),
        Bind::Write(&buffers.near),
        Bind::Write(&buffers.sums),
        Bind::Write(&buffers.contact_state),
        Bind::Read(&buffers.bodies.buffer),
        Bind::Read(&buffers.ignored.buffer),
        Bind::Write(&to.x),
        Bind::Write(&to.p),
        Bind::Write(&buffers.boxes),
        // Near pairs are not needed while others are listed.
        Bind::Write(&buffers.near),
        Bind::Write(&buffers.normals),
    ];
    all.into_iter()
        .enumerate()
        .map(|(place, bind)| if place == 0 || uses.contains(&place) { bind } else { Bind::Unused })
        .collect()
}
