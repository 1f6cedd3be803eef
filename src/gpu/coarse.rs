//! Coarse levels on the GPU: see `levels.rs` for what they are.
//!
//! The finest is averaged from the vertices in a dispatch of its own. Those that fit into one workgroup together are done
//! by one, in one dispatch. Larger ones are cut into patches, as the cloth is, and take two: one to be averaged, one to be
//! swept. On a mesh that cannot be cut each colour is a dispatch.

use glam::Vec4;

use crate::kernels::Edge;
use crate::model::cloth::Cloth;
use crate::model::csr::Span;
use crate::multigrid::hierarchy::Level;
use crate::step::plan::Plan;

use super::SLOT;
use super::device::{Bind, Entry, Gpu, Stage, shader};
use super::forces::Forces;
use super::patches::{Cut, NO_EDGE, Patches};
use super::sweep::{Batch, TURNS, constants, lanes, turns};
use super::top::Top;

/// Aggregates that a patch has of its own, at most.
const OWN: usize = 256;

/// Lanes that average an aggregate of vertices, and one of aggregates: about as many as it has of them.
const EACH: [usize; 2] = [16, 4];

/// An item that an aggregate is made of: `restrict.wgsl`'s `Member`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Member {
    pub item: u32,
    /// Share in the aggregate's mass.
    pub share: f32,
}

/// The levels in use.
#[derive(Debug)]
pub(super) struct Coarse {
    /// How many.
    pub levels: usize,
    /// What each aggregate of each level is corrected by, the finest level first.
    pub shift: wgpu::Buffer,
    /// Members of all aggregates.
    items: usize,
    /// Where each level's aggregates start among those of all, and the end.
    starts: Vec<usize>,
    h: Option<f32>,
    restrict_vertices: Stage,
    restrict_aggregates: Stage,
    sweep: Sweep,
}

/// How levels are swept.
#[derive(Debug)]
enum Sweep {
    /// In patches, the finest first, and the rest of them together.
    Patches { fine: Vec<(Patches, wgpu::Buffer, Stage)>, top: Option<(Top, wgpu::Buffer, Stage)> },
    /// A dispatch a colour: a run of edges each, the level's own, and the buffer that they are in.
    Colours { runs: Vec<(usize, Batch)>, edges: wgpu::Buffer, hand_down: Stage, sweep: Stage, note: Stage, correct: Stage },
}

impl Coarse {
    /// With these levels of the cloth, in workgroups that have room for so many aggregates; `None`: a dispatch a
    /// colour.
    pub(super) fn new(gpu: &Gpu, cloth: &Cloth, levels: &[Level], forces: &Forces, room: Option<usize>) -> Coarse {
        let count = levels.len();
        let mut starts = vec![0];
        levels.iter().for_each(|level| starts.push(starts[starts.len() - 1] + level.inverse_mass.len()));
        let rest = at_rest(&cloth.rest, levels);
        let all: Vec<Vec4> = rest.concat();
        let centers = gpu.filled("centers", &all);
        let [predicted, shift] = ["predicted", "shift"].map(|name| gpu.buffer(name, centers.size()));

        let (mut spans, mut members) = (Vec::new(), Vec::new());
        for (index, level) in levels.iter().enumerate() {
            let (below, first) = (if index > 0 { starts[index - 1] } else { 0 }, members.len() as u32);
            spans.extend(level.members.spans.iter().map(|span| Span { start: first + span.start, end: first + span.end }));
            let shares = level.members.items.iter().zip(&level.share);
            members.extend(shares.map(|(&item, &share)| Member { item: below as u32 + item, share }));
        }
        let items = members.len();
        let (spans, members) = (gpu.filled("spans", &spans), gpu.filled("members", &members));
        let batches = (0..count).map(|index| run(starts[index]..starts[index + 1]));
        let slots = super::sweep::slots(gpu, batches);
        let bound = |x, motion| {
            vec![
                (0, Bind::Dynamic(&slots, size_of::<Batch>() as u64)),
                (1, Bind::Read(x)),
                (2, Bind::Read(motion)),
                (3, Bind::Read(&spans)),
                (4, Bind::Read(&members)),
                (5, Bind::Write(&centers)),
                (6, Bind::Write(&predicted)),
            ]
        };
        let mut groups = turns(&forces.states, |from, _| bound(&from.x, &from.p));
        groups.extend(turns(&forces.states, |from, _| bound(&from.x, &forces.u)));
        let module = gpu.module("restrict", shader!("predict", "restrict"));
        let restrict = |of_vertices: bool, each: usize| {
            let constants = [("OF_VERTICES", f64::from(u8::from(of_vertices))), ("EACH", each as f64)];
            let entry = Entry { module: &module, name: "restrict_level", constants: &constants };
            Stage::new(gpu, &forces.frame, entry, &groups)
        };
        let (restrict_vertices, restrict_aggregates) = (restrict(true, EACH[0]), restrict(false, EACH[1]));

        let buffers = [&centers, &predicted, &shift];
        let patches = room.and_then(|room| Sweep::patches(gpu, levels, &rest, &starts, forces, room, buffers));
        let sweep = patches.unwrap_or_else(|| Sweep::colours(gpu, levels, &starts, forces, buffers));
        Coarse { levels: count, shift, items, starts, h: None, restrict_vertices, restrict_aggregates, sweep }
    }

    /// How many levels are swept in patches.
    #[cfg(test)]
    pub(super) fn in_patches(&self) -> Option<usize> {
        match &self.sweep {
            Sweep::Patches { fine, .. } => Some(fine.len()),
            Sweep::Colours { .. } => None,
        }
    }

    pub(super) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>) {
        let Coarse { starts, h, sweep, .. } = self;
        if *h == Some(plan.coefficients.h) {
            return;
        }
        *h = Some(plan.coefficients.h);
        let levels = &plan.coefficients.levels;
        match sweep {
            Sweep::Patches { fine, top } => {
                for ((patches, table, _), edges) in fine.iter_mut().zip(levels) {
                    let start = patches.set_edges(edges);
                    gpu.queue.write_buffer(table, 4 * start as u64, bytemuck::cast_slice(&patches.table[start..]));
                }
                if let Some((top, table, _)) = top {
                    top.set_edges(levels);
                    gpu.write(table, &top.table);
                }
            }
            Sweep::Colours { edges, .. } => {
                let moved = |(list, &start): (&Vec<Edge>, &usize)| {
                    let base = start as u32;
                    list.iter().map(|edge| Edge { a: edge.a + base, b: edge.b + base, ..*edge }).collect::<Vec<_>>()
                };
                let all: Vec<Edge> = levels.iter().zip(&*starts).flat_map(moved).collect();
                gpu.write(edges, &all);
            }
        }
    }

    /// Bytes of a substep.
    pub(super) fn bytes(&self) -> usize {
        let aggregates = self.starts[self.levels];
        let swept = match &self.sweep {
            Sweep::Patches { fine, top } => {
                let patches: usize = fine.iter().map(|(patches, ..)| patches.bytes()).sum();
                patches + top.as_ref().map_or(0, |(top, ..)| size_of_val(top.table.as_slice()))
            }
            Sweep::Colours { edges, .. } => 7 * edges.size() as usize,
        };
        // Members and what they are averaged from; what is averaged, and what that is corrected by.
        40 * self.items + 48 * aggregates + swept
    }

    /// Colours one after another, and edges, of a substep, but for those that are dispatches of their own.
    pub(super) fn counts(&self) -> [usize; 2] {
        match &self.sweep {
            Sweep::Patches { fine, top } => {
                let [rounds, edges] = top.as_ref().map_or([0, 0], |(top, ..)| top.counts());
                let in_patches: usize = fine.iter().map(|(patches, ..)| patches.colors).sum();
                [rounds + in_patches, edges + fine.iter().map(|(patches, ..)| patches.swept).sum::<usize>()]
            }
            Sweep::Colours { .. } => [0, 0],
        }
    }

    /// Dispatches of a substep.
    pub(super) fn dispatches(&self) -> usize {
        match &self.sweep {
            Sweep::Patches { fine, top } => 2 * (fine.len() + usize::from(top.is_some())),
            Sweep::Colours { runs, .. } => 2 + 2 * self.levels + runs.len(),
        }
    }

    /// Encodes the correction of what a substep's forces predict.
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>, turn: usize) {
        let count = |level: usize| self.starts[level + 1] - self.starts[level];
        let slot = |index: usize| [(index as u64 * SLOT) as u32];
        let predicted = plan.params.predicted as usize * TURNS.len();
        self.restrict_vertices.encode(pass, turn + predicted, &slot(0), EACH[0] * count(0));
        match &self.sweep {
            Sweep::Patches { fine, top } => {
                // The finest of the top is there already; the top averages the others itself.
                let there = fine.len() + usize::from(top.is_some());
                (1..there).for_each(|level| self.restrict_aggregates.encode(pass, 0, &slot(level), EACH[1] * count(level)));
                if let Some((_, _, stage)) = top {
                    stage.encode_groups(pass, 0, &[], 1);
                }
                fine.iter().rev().for_each(|(patches, _, stage)| stage.encode_groups(pass, 0, &[], patches.count));
            }
            Sweep::Colours { runs, hand_down, sweep, note, .. } => {
                (1..self.levels).for_each(|level| self.restrict_aggregates.encode(pass, 0, &slot(level), EACH[1] * count(level)));
                for level in (0..self.levels).rev() {
                    hand_down.encode(pass, 0, &slot(level), count(level));
                    for (index, (_, run)) in runs.iter().enumerate().filter(|(_, (of, _))| *of == level) {
                        sweep.encode(pass, 0, &slot(self.levels + index), run.count as usize);
                    }
                }
                note.encode(pass, 0, &slot(0), count(0));
            }
        }
    }

    /// Encodes adding it to the vertices, for a sweep that does not do that itself.
    pub(super) fn encode_correct(&self, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>) {
        if let Sweep::Colours { correct, .. } = &self.sweep {
            correct.encode(pass, 0, &[0], plan.cloth.rest.len());
        }
    }
}

impl Sweep {
    fn patches(
        gpu: &Gpu,
        levels: &[Level],
        rest: &[Vec<Vec4>],
        starts: &[usize],
        forces: &Forces,
        room: usize,
        [centers, predicted, shift]: [&wgpu::Buffer; 3],
    ) -> Option<Sweep> {
        let end = starts[levels.len()];
        let first_of_top = (0..levels.len()).find(|&level| end - starts[level] <= room).unwrap_or(levels.len());
        let module = gpu.module("level", shader!("edge", "runs", "table", "level"));
        let mut fine = Vec::new();
        for index in 0..first_of_top {
            let level = &levels[index];
            let ends: Vec<[u32; 2]> = level.links.iter().map(|link| link.ends).collect();
            let mut patches = Patches::new(&rest[index], &ends, &level.colors, Cut { own: OWN, room })?;
            let above = levels.get(index + 1);
            let label = |item: u32| above.map_or(NO_EDGE, |above| starts[index + 1] as u32 + above.label[item as usize]);
            patches.set_labels(label, starts[index] as u32);
            let table = gpu.filled("patches of a level", &patches.table);
            let constants = constants(&patches, lanes(gpu, patches.widest));
            let bound =
                vec![(0, Bind::Read(&table)), (1, Bind::Read(centers)), (2, Bind::Read(predicted)), (3, Bind::Write(shift))];
            let entry = Entry { module: &module, name: "sweep_of_level", constants: &constants };
            let stage = Stage::new(gpu, &forces.frame, entry, &[bound]);
            fine.push((patches, table, stage));
        }
        let top = (first_of_top < levels.len()).then(|| {
            let top = Top::new(levels, first_of_top, None);
            let table = gpu.filled("levels", &top.table);
            let lanes = lanes(gpu, top.width);
            let constants = [&top.constants(0)[..], &[("LANES", lanes as f64), ("BASE", starts[first_of_top] as f64)]].concat();
            let module = gpu.module("top", shader!("edge", "runs", "levels", "top"));
            let entry = Entry { module: &module, name: "sweep_of_levels", constants: &constants };
            let bound =
                vec![(0, Bind::Read(&table)), (1, Bind::Read(centers)), (2, Bind::Write(predicted)), (3, Bind::Write(shift))];
            let stage = Stage::new(gpu, &forces.frame, entry, &[bound]);
            (top, table, stage)
        });
        Some(Sweep::Patches { fine, top })
    }

    fn colours(
        gpu: &Gpu,
        levels: &[Level],
        starts: &[usize],
        forces: &Forces,
        [centers, predicted, shift]: [&wgpu::Buffer; 3],
    ) -> Sweep {
        let (mut runs, mut first) = (Vec::new(), 0);
        for (index, level) in levels.iter().enumerate() {
            runs.extend(level.colors.iter().map(|range| (index, run(first + range.start..first + range.end))));
            first += level.links.len();
        }
        let edges = gpu.buffer("coarse edges", (first.max(1) * size_of::<Edge>()) as u64);
        let batches = (0..levels.len()).map(|index| run(starts[index]..starts[index + 1]));
        let slots = super::sweep::slots(gpu, batches.chain(runs.iter().map(|(_, run)| *run)));
        let above = |index: usize, &item: &u32| {
            levels.get(index + 1).map_or(NO_EDGE, |above| starts[index + 1] as u32 + above.label[item as usize])
        };
        let labels: Vec<u32> = (0..levels.len())
            .flat_map(|index| (0..levels[index].inverse_mass.len() as u32).map(move |item| (index, item)))
            .map(|(index, item)| above(index, &item))
            .collect();
        let labels = gpu.filled("labels", &labels);
        let by = gpu.buffer("by", shift.size());
        let of_vertices = gpu.filled("labels of vertices", &levels[0].label);
        let bound = |labels| {
            vec![
                (0, Bind::Dynamic(&slots, size_of::<Batch>() as u64)),
                (1, Bind::Read(&edges)),
                (2, Bind::Read(centers)),
                (3, Bind::Read(predicted)),
                (4, Bind::Read(labels)),
                (5, Bind::Write(&by)),
                (6, Bind::Write(shift)),
                (7, Bind::Write(&forces.u)),
            ]
        };
        let module = gpu.module("coarse", shader!("edge", "coarse"));
        let stage = |name, labels| Stage::new(gpu, &forces.frame, Entry::new(&module, name), &[bound(labels)]);
        let [hand_down, sweep, note] = ["hand_down", "sweep_coarse", "note_shift"].map(|name| stage(name, &labels));
        let correct = stage("correct_vertices", &of_vertices);
        Sweep::Colours { runs, edges, hand_down, sweep, note, correct }
    }
}

/// Centres of the aggregates of each level at rest, w the inverse mass.
fn at_rest(rest: &[Vec4], levels: &[Level]) -> Vec<Vec<Vec4>> {
    let mut found: Vec<Vec<Vec4>> = Vec::with_capacity(levels.len());
    for level in levels {
        let below = found.last().map_or(rest, Vec::as_slice);
        let mut centers: Vec<Vec4> = level.inverse_mass.iter().map(|&w| Vec4::new(0.0, 0.0, 0.0, w)).collect();
        for (center, span) in centers.iter_mut().zip(&level.members.spans) {
            for member in span.start as usize..span.end as usize {
                let x = below[level.members.items[member] as usize].truncate();
                *center += (x * level.share[member]).extend(0.0);
            }
        }
        found.push(centers);
    }
    found
}

fn run(range: std::ops::Range<usize>) -> Batch {
    Batch { first: range.start as u32, count: range.len() as u32 }
}
