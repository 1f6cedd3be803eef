//! Stages 2 and 3 on the GPU, in three ways with one result: visiting the edges colour after colour, then contact.

use glam::Vec4;

use crate::kernels::{Body, Edge};
use crate::model::cloth::Cloth;
use crate::multigrid::hierarchy::Level;
use crate::step::plan::Plan;

use super::SLOT;
use super::device::{Bind, Entry, Gpu, Sent, Stage, shader};
use super::forces::{Forces, State};
use super::patches::Patches;
use super::top::Top;

/// The edges of one colour: `project.wgsl`'s `Batch`.
#[repr(C)]
#[derive(Debug, Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Batch {
    pub first: u32,
    pub count: u32,
}

/// From which state to which a substep goes: the first from the cloth's own, then to and fro between the two in work.
pub(super) const TURNS: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 1]];

/// Which of [`TURNS`] a substep is.
pub(super) fn turn(substep: usize) -> usize {
    if substep == 0 { 0 } else { 2 - substep % 2 }
}

/// A group for each of [`TURNS`].
pub(super) fn turns<'a>(
    states: &'a [State],
    bound: impl Fn(&'a State, &'a State) -> Vec<(u32, Bind<'a>)>,
) -> Vec<Vec<(u32, Bind<'a>)>> {
    TURNS.iter().map(|&[from, to]| bound(&states[from], &states[to])).collect()
}

/// Runs of items, one for a dispatch each.
pub(super) fn slots(gpu: &Gpu, batches: impl Iterator<Item = Batch>) -> wgpu::Buffer {
    let mut bytes = Vec::new();
    for batch in batches {
        bytes.extend_from_slice(bytemuck::bytes_of(&batch));
        bytes.resize(bytes.len().next_multiple_of(SLOT as usize), 0);
    }
    bytes.resize(bytes.len().max(SLOT as usize), 0);
    gpu.uniform("batches", &bytes)
}

/// A dispatch a colour, and one for contact: for any mesh and any number of sweeps, and what the others are compared with.
#[derive(Debug)]
pub(super) struct Colours {
    batches: Vec<Batch>,
    edges: wgpu::Buffer,
    /// The substep that `edges` are for.
    h: Option<f32>,
    sweep: Stage,
    contact: Stage,
}

impl Colours {
    pub(super) fn new(gpu: &Gpu, cloth: &Cloth, forces: &Forces, bodies: &Sent) -> Colours {
        let batches: Vec<Batch> =
            cloth.colors.iter().map(|range| Batch { first: range.start as u32, count: range.len() as u32 }).collect();
        let edges = gpu.buffer("edges", (cloth.swept().len().max(1) * size_of::<Edge>()) as u64);
        let slots = slots(gpu, batches.iter().copied());
        let swept = turns(&forces.states, |from, _| {
            vec![
                (0, Bind::Dynamic(&slots, size_of::<Batch>() as u64)),
                (1, Bind::Read(&edges)),
                (2, Bind::Read(&from.x)),
                (3, Bind::Write(&forces.u)),
            ]
        });
        let module = gpu.module("project", shader!("edge", "project"));
        let sweep = Stage::new(gpu, &forces.frame, Entry::new(&module, "project"), &swept);
        let module = gpu.module("contact", shader!("body", "contact"));
        let contact = Stage::new(gpu, &forces.frame, Entry::new(&module, "contact"), &Colours::moved(forces, bodies));
        Colours { batches, edges, h: None, sweep, contact }
    }

    fn moved<'a>(forces: &'a Forces, bodies: &'a Sent) -> Vec<Vec<(u32, Bind<'a>)>> {
        turns(&forces.states, |from, to| {
            vec![
                (0, Bind::Read(&from.x)),
                (1, Bind::Read(&forces.u)),
                (2, Bind::Read(&bodies.buffer)),
                (3, Bind::Write(&to.x)),
                (4, Bind::Write(&to.p)),
            ]
        })
    }

    pub(super) fn rebind(&mut self, gpu: &Gpu, forces: &Forces, bodies: &Sent) {
        self.contact.rebind(gpu, &Colours::moved(forces, bodies));
    }

    pub(super) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>) {
        if self.h != Some(plan.coefficients.h) && plan.sweeps > 0 {
            gpu.write(&self.edges, &plan.coefficients.edges);
            self.h = Some(plan.coefficients.h);
        }
    }

    /// Dispatches of a substep.
    pub(super) fn dispatches(&self, plan: &Plan<'_>) -> usize {
        plan.sweeps as usize * self.batches.len() + 1
    }

    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>, turn: usize) {
        for _ in 0..plan.sweeps {
            for (color, batch) in self.batches.iter().enumerate() {
                self.sweep.encode(pass, turn, &[(color as u64 * SLOT) as u32], batch.count as usize);
            }
        }
        self.contact.encode(pass, turn, &[], plan.cloth.rest.len());
    }
}

/// One dispatch a substep, each workgroup with a patch of the cloth.
#[derive(Debug)]
pub(super) struct Halo {
    pub patches: Patches,
    table: wgpu::Buffer,
    h: Option<f32>,
    /// The groups of [`TURNS`] that predict, then those that take what forces predicted.
    stage: Stage,
}

impl Halo {
    pub(super) fn new(gpu: &Gpu, patches: Patches, forces: &Forces, bodies: &Sent) -> Halo {
        let table = gpu.filled("patches", &patches.table);
        let module = gpu.module("patch", shader!("predict", "edge", "body", "runs", "table", "patch"));
        let lanes = lanes(gpu, patches.widest);
        let constants = constants(&patches, lanes);
        let entry = Entry { module: &module, name: "substep_of_patch", constants: &constants };
        let stage = Stage::new(gpu, &forces.frame, entry, &Halo::bound(&table, forces, bodies, None));
        Halo { patches, table, h: None, stage }
    }

    fn bound<'a>(
        table: &'a wgpu::Buffer,
        forces: &'a Forces,
        bodies: &'a Sent,
        shift: Option<&'a wgpu::Buffer>,
    ) -> Vec<Vec<(u32, Bind<'a>)>> {
        // Without levels it is bound, not read.
        let shift = shift.unwrap_or(&forces.u);
        let bound = |from: &'a State, to: &'a State, motion: &'a wgpu::Buffer| {
            vec![
                (0, Bind::Read(table)),
                (1, Bind::Read(&from.x)),
                (2, Bind::Read(motion)),
                (3, Bind::Read(&bodies.buffer)),
                (4, Bind::Write(&to.x)),
                (5, Bind::Write(&to.p)),
                (6, Bind::Read(shift)),
            ]
        };
        let mut groups = turns(&forces.states, |from, to| bound(from, to, &from.p));
        groups.extend(turns(&forces.states, |from, to| bound(from, to, &forces.u)));
        groups
    }

    pub(super) fn rebind(&mut self, gpu: &Gpu, forces: &Forces, bodies: &Sent, shift: Option<&wgpu::Buffer>) {
        self.stage.rebind(gpu, &Halo::bound(&self.table, forces, bodies, shift));
    }

    /// Notes which aggregate each vertex is in.
    pub(super) fn set_labels(&mut self, gpu: &Gpu, labels: &[u32]) {
        self.patches.set_labels(|vertex| labels[vertex as usize], 0);
        gpu.write(&self.table, &self.patches.table);
    }

    pub(super) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>) {
        set_edges(gpu, plan, &mut self.patches, &self.table, &mut self.h);
    }

    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>, turn: usize) {
        let predicted = plan.params.predicted as usize * TURNS.len();
        self.stage.encode_groups(pass, turn + predicted, &[], self.patches.count);
    }
}

/// One dispatch a step: the whole cloth in one workgroup.
#[derive(Debug)]
pub(super) struct Whole {
    pub patches: Patches,
    /// Its levels, if any are in use.
    top: Option<Top>,
    /// The patch, then the levels, then their aggregates' inverse masses.
    table: wgpu::Buffer,
    work: wgpu::Buffer,
    h: Option<f32>,
    stage: Stage,
}

impl Whole {
    pub(super) fn new(
        gpu: &Gpu,
        mut patches: Patches,
        levels: &[Level],
        rest: &[Vec4],
        forces: &Forces,
        bodies: &Sent,
        first_bad: &wgpu::Buffer,
    ) -> Whole {
        if let Some(finest) = levels.first() {
            patches.set_labels(|vertex| finest.label[vertex as usize], 0);
        }
        let top = (!levels.is_empty()).then(|| Top::new(levels, 0, Some(0)));
        let behind: Vec<u32> = levels.iter().flat_map(|level| &level.inverse_mass).map(|w| w.to_bits()).collect();
        let words = patches.table.len() + top.as_ref().map_or(0, |top| top.table.len()) + behind.len();
        let table = gpu.buffer("whole", 4 * words as u64);
        gpu.queue.write_buffer(&table, 4 * (words - behind.len()) as u64, bytemuck::cast_slice(&behind));
        let work = gpu.buffer("work", 2 * size_of_val(rest) as u64);
        let module = gpu.module("whole", shader!("predict", "edge", "body", "bounds", "runs", "table", "levels", "whole"));
        let lanes = lanes(gpu, patches.widest);
        let coarse = match &top {
            Some(top) => top.constants(patches.table.len()),
            None => Top::NO_CONSTANTS,
        };
        let own = [("NUMBERS", (3 * patches.largest).max(10 * top.as_ref().map_or(0, |top| top.aggregates)) as f64)];
        let constants = [&constants(&patches, lanes)[..], &coarse, &own].concat();
        let entry = Entry { module: &module, name: "step_of_whole", constants: &constants };
        let stage = Stage::new(gpu, &forces.frame, entry, &Whole::bound(&table, &work, forces, bodies, first_bad));
        Whole { stage, patches, top, table, work, h: None }
    }

    fn bound<'a>(
        table: &'a wgpu::Buffer,
        work: &'a wgpu::Buffer,
        forces: &'a Forces,
        bodies: &'a Sent,
        first_bad: &'a wgpu::Buffer,
    ) -> Vec<Vec<(u32, Bind<'a>)>> {
        vec![vec![
            (0, Bind::Read(table)),
            (1, Bind::Read(&forces.all_substeps.buffer)),
            (2, Bind::Read(&forces.pins.buffer)),
            (3, Bind::Read(&bodies.buffer)),
            (4, Bind::Write(&forces.states[0].x)),
            (5, Bind::Write(&forces.states[0].p)),
            (6, Bind::Write(work)),
            (7, Bind::Write(first_bad)),
        ]]
    }

    pub(super) fn rebind(&mut self, gpu: &Gpu, forces: &Forces, bodies: &Sent, first_bad: &wgpu::Buffer) {
        self.stage.rebind(gpu, &Whole::bound(&self.table, &self.work, forces, bodies, first_bad));
    }

    /// How many levels it sweeps.
    pub(super) fn levels(&self) -> usize {
        self.top.as_ref().map_or(0, |top| top.levels)
    }

    pub(super) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>) {
        let Whole { patches, top, table, h, .. } = self;
        if *h == Some(plan.coefficients.h) {
            return;
        }
        *h = Some(plan.coefficients.h);
        patches.set_edges(&plan.coefficients.edges);
        gpu.write(table, &patches.table);
        if let Some(top) = top {
            top.set_edges(&plan.coefficients.levels);
            gpu.queue.write_buffer(table, size_of_val(patches.table.as_slice()) as u64, bytemuck::cast_slice(&top.table));
        }
    }

    /// Colours one after another, and edges, of a substep.
    pub(super) fn counts(&self, plan: &Plan<'_>) -> [usize; 2] {
        let [rounds, edges] = self.top.as_ref().map_or([0, 0], Top::counts);
        let sweeps = plan.sweeps as usize;
        [rounds + sweeps * self.patches.colors, edges + sweeps * self.patches.swept]
    }

    /// Bytes of a step, those that stay on the chip counted once.
    pub(super) fn bytes(&self) -> usize {
        self.table.size() as usize + 2 * self.work.size() as usize
    }

    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>) {
        self.stage.encode_groups(pass, 0, &[], 1);
    }
}

/// Invocations that run in step, on most devices.
const SUBGROUP: usize = 32;

/// Invocations of a workgroup: no more than a colour has edges, and than the device allows.
pub(super) fn lanes(gpu: &Gpu, edges: usize) -> usize {
    let limits = gpu.device.limits();
    let allowed = limits.max_compute_invocations_per_workgroup.min(limits.max_compute_workgroup_size_x) as usize;
    edges.next_multiple_of(SUBGROUP).clamp(64, 1024).min(allowed)
}

pub(super) fn constants(patches: &Patches, lanes: usize) -> [(&'static str, f64); 5] {
    [
        ("LANES", lanes as f64),
        ("ROOM", patches.largest as f64),
        ("WIDTH", patches.widest as f64),
        ("COLORS", patches.colors as f64),
        ("PATCHES", patches.count as f64),
    ]
}

fn set_edges(gpu: &Gpu, plan: &Plan<'_>, patches: &mut Patches, table: &wgpu::Buffer, h: &mut Option<f32>) {
    if *h != Some(plan.coefficients.h) && plan.sweeps > 0 {
        let start = patches.set_edges(&plan.coefficients.edges);
        gpu.queue.write_buffer(table, 4 * start as u64, bytemuck::cast_slice(&patches.table[start..]));
        *h = Some(plan.coefficients.h);
    }
}

/// Colliders, and room for them.
pub(super) fn bodies(gpu: &Gpu) -> Sent {
    Sent::storage(gpu, "bodies", size_of::<Body>())
}
