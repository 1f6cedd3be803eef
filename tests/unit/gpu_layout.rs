//! The shaders are valid, their structs have the layout of the Rust structs that are copied into them, and their
//! constants have the same values as in Rust.

use std::collections::BTreeSet;
use std::mem::offset_of;

use naga::Literal;
use naga::valid::{Capabilities, ValidationFlags, Validator};

use crate::contact::constants::literals;
use crate::contact::device::{self, table::ContactParams};
use crate::gpu::contact::encode;
use crate::gpu::contact::status::{self, Listed, Status, Track};
use crate::gpu::multigrid::{Average, Member};
use crate::gpu::stage::{self, Batch, WORKGROUP};
use crate::gpu::sweep::forces_in_workgroup;
use crate::gpu::watch::{self as gpu_watch, Defects};
use crate::gpu::{shaders, slices};
use crate::kernels::bending::{BendEntry, BendPass, BendRow};
use crate::kernels::contact::{self, Body, rounded_box};
use crate::kernels::distance::{self, Edge};
use crate::kernels::follow::BoundVertex;
use crate::kernels::integrate::Pin;
use crate::kernels::params::{self, Params, Substep};
use crate::kernels::spring::Spring;
use crate::kernels::statistics::{self, Statistics, StrainGauge};
use crate::kernels::tether::{self, Tether};
use crate::kernels::wind::Panel;
use crate::kernels::{limits, watch as kernels_watch};
use crate::model::csr::Span;
use crate::step::{bending, watch as step_watch};

/// The layout of a Rust struct.
struct Layout {
    name: &'static str,
    size: usize,
    members: Vec<(&'static str, usize)>,
}

macro_rules! layout {
    ($name:ident { $($member:ident),+ }) => {
        Layout { name: stringify!($name), size: size_of::<$name>(), members: vec![$((stringify!($member), offset_of!($name, $member))),+] }
    };
}

#[rustfmt::skip]
fn structs() -> Vec<Layout> {
    vec![
        layout!(Params { wind, h, half_density, drag, lift, fraction, vertices, bodies, pins, damped, predicted, substeps, sweeps, relaxed, drift, coarse_rule, levels, edges, per_length, per_mass, longest_edge, tethers, load, checks, up, per_slack, padding, used }),
        layout!(Substep { fall, carry, gain, rate, start, end }),
        layout!(Defects { lost, long, fast, energy, hot, stopped, steps }),
        layout!(Span { start, end }),
        layout!(Pin { origin, vertex, goal, padding }),
        layout!(BendRow { stiffness, tau, diagonal }),
        layout!(BendEntry { other, forward, backward }),
        layout!(BendPass { carry, gain, trial, last }),
        layout!(Panel { corners, mass }),
        layout!(Spring { other, rest, stiffness }),
        layout!(Edge { a, b, inverse_rest, inverse_weight }),
        layout!(Tether { anchor, length, slack, share }),
        layout!(Batch { first, count }),
        layout!(StrainGauge { ends, inverse_rest, weight }),
        layout!(Statistics { stretch, speed, mean_stretch, worst_stretch, slow, fastest, low, high, crushed }),
        layout!(Member { item, share }),
        layout!(Average { x, u }),
        layout!(BoundVertex { corners, height, normal_weights, of_b, normal, of_c }),
        layout!(ContactParams { thickness, friction, vertices, mesh_first, all_vertices, rows, depth, mesh_depth, mesh_leaves, triangles, edges, order, leaf_triangles, leaf_edges, leaf_vertices, excess, around, beside, of_vertices, room, bodies, has_kinematic, meshes_rest, has_self_contact, ignored, ignored_edges, groups, mesh_groups, per_mass, box_edges, features, spacing, max_carry, entangled, triangles_at, covers_stops, turn_x, turn_y, turn_z, center, travel }),
        layout!(Listed { corners, lambda, other, thickness, row, next }),
        layout!(Status { half, listed, with_vertices, with_edges, since, ahead, h, stopped, needed, detections, near, acting, pressing, strayed, most_push, pushed, detects, longer, over, scale, mean, counted, vertices_before, edges_before, leaf_pairs, candidates, edge_candidates, space_needed, acted, passed, pinched, again, needed_carry, squeezed, jumped, shortens, cuts_more, drifted, through }),
        layout!(Track { start, by }),
        layout!(Body { a, radius, b, friction, a_travel, radius_travel, b_travel, kind, c, c_travel, slick, margin, padding }),
    ]
}

/// Writes the text of every shader to a folder, for other compilers: `examples/web/test` gives them to a browser's.
#[test]
fn shaders_are_written_where_asked() {
    let Some(folder) = std::env::var_os("CLOTH_SHADERS") else { return };
    for shader in shaders::ALL {
        std::fs::write(std::path::Path::new(&folder).join(format!("{}.wgsl", shader.name)), shader.source.concat()).unwrap();
    }
}

/// Every shader, as parsed by naga.
fn modules() -> impl Iterator<Item = (&'static str, naga::Module)> {
    shaders::ALL.iter().map(|shader| {
        let source = shader.source.concat();
        match naga::front::wgsl::parse_str(&source) {
            Ok(module) => (shader.name, module),
            Err(error) => panic!("{}: {}", shader.name, error.emit_to_string(&source)),
        }
    })
}

/// The constants that exist only in shaders.
const ALONE: [&str; 37] = [
    "MOMENT", "COUPLE", "CURVATURE", "CHANGE", "TRIAL", "RESISTED", "MOST", "SOON", "ROUNDING_MARGIN", "MIN_DISTANCE",
    "MIN_MARGIN_SHARE", "MEAN", "ASIDE", "PLACES", "PROBES", "WEIGHT", "LEADER", "IMPULSE", "PUSHED", "SQUARES", "BEYOND", "CUT",
    "FAR", "UNIT_WEIGHT", "UNIT_LENGTH", "UNIT_BEYOND", "LANES", "MAX_PAIRS", "LEAF_PAIRS", "CANDIDATES", "VERTEX", "TRIANGLE",
    "EDGE", "HELD", "LEVELS", "MET", "MAX_MET",
];

/// The constants that shaders and Rust have in common, by their names in the shaders.
fn constants() -> Vec<(&'static str, Literal)> {
    let mut all = literals! {
        U32 bending: MAX_PASSES;
        F32 contact: DEPENETRATION, EMERGENCE, INSIDE, SWEPT, TOUCHING;
        U32 contact: SWEEP_STEPS, BOX, PLANE;
        U32 device: MARK;
        F32 distance: TURN_GUARD, TAUT_BAND, STRETCH_GUARD, LEAST_PART, MIN_LENGTH;
        U32 encode: COMPARERS, MEASURERS, FINDERS, BOUNDERS;
        U32 forces_in_workgroup: BEND_VECTORS;
        U32 gpu_watch: IN_TABLE, IN_TILES;
        F32 kernels_watch: MAX_SQUARE;
        F32 limits: MAX_POSITION;
        U32 params: PULL_COARSE, HOLD_COARSE, PROJECT_COARSE;
        F32 rounded_box: ROUNDING, PRESSED, WAS_OUTSIDE, SLID, CARRIES;
        U32 slices: SLICE;
        U32 stage: WORKGROUP, NONE;
        F32 statistics: MIN_STRETCH, MIN_SPEED, ONE, MAX_STRETCH, SLOW, SLOW_PARTS, CRUSHED;
        U32 statistics: CLASSES, BITS, WHOLE;
        U32 status: NO_ROOM, CROWDED, EARLY, CLOSE, RUN_OVER, SUMS, PARTS, FIRST_LEVEL, PINCHED, DRIFTED;
        U32 step_watch: FEWEST_CHECKED, TURNS;
        F32 tether: TETHER_TURN_GUARD, TETHER_SHORT_GUARD;
    };
    all.extend([
        ("ALL_ENERGY", Literal::U32(1 << 24)),
        ("NOT_FINITE", Literal::U32(2)),
        ("SHARE", Literal::U32(status::SUMS as u32 - 1)),
    ]);
    all.extend(crate::contact::constants::in_shaders());
    all
}

#[test]
fn shaders_are_valid_and_share_a_workgroup_size() {
    for (name, module) in modules() {
        let mut validator = Validator::new(ValidationFlags::all(), Capabilities::default());
        validator.validate(&module).unwrap_or_else(|error| panic!("{name}: {error:?}"));
        assert!(!module.entry_points.is_empty());
        for entry in &module.entry_points {
            // Or its size is set when the pipeline is made, or it is dispatched by workgroups of its own size.
            let told = entry.workgroup_size_overrides.is_some();
            let has_own = module.constants.iter().any(|(_, constant)| {
                let is_size = [Some("LANES"), Some("COMPARERS"), Some("MEASURERS"), Some("FINDERS"), Some("BOUNDERS")];
                let size = naga::Expression::Literal(Literal::U32(entry.workgroup_size[0]));
                is_size.contains(&constant.name.as_deref()) && module.global_expressions[constant.init] == size
            });
            assert!(told || has_own || entry.workgroup_size == [WORKGROUP as u32, 1, 1], "{name}: {}", entry.name);
        }
    }
}

/// The shaders of programs that no test runs.
#[test]
fn shaders_of_the_bench_and_the_example_are_valid() {
    for text in [include_str!("../../benches/gpu/chain.wgsl"), include_str!("../../examples/flag/flag.wgsl")] {
        let module = naga::front::wgsl::parse_str(text).unwrap_or_else(|error| panic!("{}", error.emit_to_string(text)));
        Validator::new(ValidationFlags::all(), Capabilities::default()).validate(&module).unwrap();
    }
}

#[test]
fn shared_structs_agree_member_for_member() {
    let ours = structs();
    let mut compared = BTreeSet::new();
    for (shader, module) in modules() {
        for (_, shape) in module.types.iter() {
            let (Some(name), naga::TypeInner::Struct { members, span }) = (&shape.name, &shape.inner) else { continue };
            // These structs exist only in shaders.
            let alone = [
                "Invocation", "Workgroup", "Path", "Touch", "Gap", "ContactPoint", "BoxEnd", "Entry", "Moment", "Ring", "Spin",
                "StoredEdge", "ColoredEdges", "Descent", "FourColors", "Aggregates", "Entries", "Fetched", "FourEntries",
                "Share", "Item",
            ];
            let of_contact = [
                "Four", "Plane", "Held", "Multipliers", "Near", "Proximity", "Vertex", "Node", "Tree", "Part", "ContactState",
                "Place", "Box", "StoredBox", "Normals", "Closest", "Features", "Leaf", "Comparison", "Reached", "Passed",
                "RunOver",
            ];
            // naga's own names begin with underscores.
            if name.starts_with("__") || alone.iter().chain(&of_contact).any(|known| known == name) {
                continue;
            }
            let twin = ours.iter().find(|layout| layout.name == name);
            let twin = twin.unwrap_or_else(|| panic!("{shader}: {name} has no twin in Rust"));
            let theirs: Vec<(&str, usize)> =
                members.iter().map(|member| (member.name.as_deref().unwrap_or(""), member.offset as usize)).collect();
            assert_eq!(theirs, twin.members, "{shader}: members of {name}");
            assert_eq!(*span as usize, twin.size, "{shader}: size of {name}");
            compared.insert(twin.name);
        }
    }
    assert_eq!(compared, ours.iter().map(|layout| layout.name).collect(), "every shared struct was met in a shader");
}

#[test]
fn shared_constants_agree() {
    let ours = constants();
    let (mut compared, mut alone) = (BTreeSet::new(), BTreeSet::new());
    for (shader, module) in modules() {
        for (_, constant) in module.constants.iter() {
            let name = constant.name.as_deref().unwrap_or("");
            if let Some(name) = ALONE.iter().find(|alone| **alone == name) {
                alone.insert(*name);
                continue;
            }
            let twin = ours.iter().find(|(ours, _)| *ours == name);
            let (name, value) = twin.unwrap_or_else(|| panic!("{shader}: {name} has no twin in Rust"));
            let naga::Expression::Literal(theirs) = module.global_expressions[constant.init] else {
                panic!("{shader}: {name} is no plain number");
            };
            assert_eq!(theirs, *value, "{shader}: {name}");
            compared.insert(*name);
        }
    }
    assert_eq!(compared, ours.iter().map(|(name, _)| *name).collect(), "every shared constant was met in a shader");
    assert_eq!(alone, ALONE.into_iter().collect(), "each of the others was met in a shader");
}

/// The variables of a workgroup that a function, or one that it calls, uses, and those of them that it sets.
#[derive(Default)]
struct WorkgroupVariables {
    used: BTreeSet<String>,
    set: BTreeSet<String>,
}

impl WorkgroupVariables {
    fn of(module: &naga::Module, function: &naga::Function) -> WorkgroupVariables {
        let mut found = WorkgroupVariables::default();
        let all = function.expressions.iter().filter_map(|(expression, _)| name_behind(module, function, expression));
        found.used.extend(all);
        found.visit(module, function, &function.body);
        found
    }

    fn visit(&mut self, module: &naga::Module, function: &naga::Function, block: &naga::Block) {
        use naga::Statement;
        for statement in block {
            match statement {
                Statement::Store { pointer, .. } => self.set.extend(name_behind(module, function, *pointer)),
                Statement::Block(block) => self.visit(module, function, block),
                Statement::If { accept, reject, .. } => {
                    [accept, reject].into_iter().for_each(|block| self.visit(module, function, block));
                }
                Statement::Switch { cases, .. } => cases.iter().for_each(|case| self.visit(module, function, &case.body)),
                Statement::Loop { body, continuing, .. } => {
                    [body, continuing].into_iter().for_each(|block| self.visit(module, function, block));
                }
                Statement::Call { function: called, arguments, .. } => {
                    // What gets a pointer may set what is behind it.
                    self.set.extend(arguments.iter().filter_map(|&argument| name_behind(module, function, argument)));
                    let WorkgroupVariables { used, set } = WorkgroupVariables::of(module, &module.functions[*called]);
                    self.used.extend(used);
                    self.set.extend(set);
                }
                _ => {}
            }
        }
    }
}

/// The variable of a workgroup that a pointer points to, or into.
fn name_behind(module: &naga::Module, function: &naga::Function, pointer: naga::Handle<naga::Expression>) -> Option<String> {
    match function.expressions[pointer] {
        naga::Expression::GlobalVariable(variable) => {
            let variable = &module.global_variables[variable];
            (variable.space == naga::AddressSpace::WorkGroup).then(|| variable.name.clone().unwrap_or_default())
        }
        naga::Expression::Access { base, .. } | naga::Expression::AccessIndex { base, .. } => name_behind(module, function, base),
        _ => None,
    }
}

/// Pipelines do not clear workgroup memory, so each kernel sets all that it uses of it.
#[test]
fn kernels_set_the_workgroup_memory_that_they_use() {
    let mut count = 0;
    for (shader, module) in modules() {
        for entry in &module.entry_points {
            let WorkgroupVariables { used, set } = WorkgroupVariables::of(&module, &entry.function);
            count += used.len();
            let unset: Vec<_> = used.difference(&set).collect();
            assert!(unset.is_empty(), "{shader}: {} uses {unset:?}", entry.name);
        }
    }
    assert!(count > 0);
}
