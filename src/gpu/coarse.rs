//! Coarse levels on the GPU: see `levels.rs` for what they are.
//!
//! The finest is averaged from the vertices in a dispatch of its own. Those that fit into one workgroup together are done
//! by one, in one dispatch. Larger ones are cut into patches, as the cloth is, and take two: one to be averaged, one to be
//! swept. On a mesh that cannot be cut each colour is a dispatch.

use glam::Vec4;

use crate::cloth::Cloth;
use crate::kernels::{Edge, Span};
use crate::levels::Level;
use crate::plan::Plan;

use super::SLOT;
use super::device::{Bind, Entry, Gpu, Stage, shader};
use super::forces::Forces;
use super::patches::{Cut, NO_EDGE, Patches};
use super::sweep::{Batch, TURNS, constants, lanes, turns};

/// Aggregates that a patch has of its own, at most.
const OWN: usize = 256;

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
    Patches { fine: Vec<(Patches, wgpu::Buffer, Stage)>, top: Option<Top> },
    /// A dispatch a colour: a run of edges each, the level's own, and the buffer that they are in.
    Colours { runs: Vec<(usize, Batch)>, edges: wgpu::Buffer, hand_down: Stage, sweep: Stage, note: Stage, correct: Stage },
}

/// Levels that one workgroup does.
#[derive(Debug)]
struct Top {
    table: Vec<u32>,
    buffer: wgpu::Buffer,
    stage: Stage,
    /// Where in the table the edges start, and for each run of them its level, its first edge and their number.
    edges: usize,
    runs: Vec<(usize, usize, usize)>,
}

impl Coarse {
    /// With the first `count` levels of the cloth, in workgroups that have room for so many aggregates; `None`: a dispatch a
    /// colour.
    pub(super) fn new(gpu: &Gpu, cloth: &Cloth, count: usize, forces: &Forces, room: Option<usize>) -> Coarse {
        let levels = &cloth.hierarchy().levels[..count];
        let mut starts = vec![0];
        levels.iter().for_each(|level| starts.push(starts[starts.len() - 1] + level.inverse_mass.len()));
        let rest = at_rest(cloth, levels);
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
        let averaged = [
            (0, Bind::Dynamic(&slots, size_of::<Batch>() as u64)),
            (3, Bind::Read(&spans)),
            (4, Bind::Read(&members)),
            (5, Bind::Write(&centers)),
            (6, Bind::Write(&predicted)),
        ];
        let moving = |x, motion| [&[(1, Bind::Read(x)), (2, Bind::Read(motion))][..], &averaged].concat();
        let mut groups = turns(&forces.states, |from, _| moving(&from.x, &from.p));
        groups.extend(turns(&forces.states, |from, _| moving(&from.x, &forces.u)));
        let module = gpu.module("restrict", shader!("predict", "restrict"));
        let restrict_vertices = Stage::new(gpu, &forces.frame, Entry::new(&module, "restrict_vertices"), &groups);
        let entry = Entry::new(&module, "restrict_aggregates");
        let restrict_aggregates = Stage::new(gpu, &forces.frame, entry, &[averaged.to_vec()]);

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
                if let Some(top) = top {
                    let mut at = top.edges;
                    for &(level, first, count) in &top.runs {
                        for (k, edge) in levels[level][first..first + count].iter().enumerate() {
                            top.table[at + count + k] = edge.inverse_rest.to_bits();
                            top.table[at + 2 * count + k] = edge.inverse_weight.to_bits();
                        }
                        at += 3 * count;
                    }
                    gpu.write(&top.buffer, &top.table);
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
                patches + top.as_ref().map_or(0, |top| size_of_val(top.table.as_slice()))
            }
            Sweep::Colours { edges, .. } => 7 * edges.size() as usize,
        };
        // Members and what they are averaged from; what is averaged, and what that is corrected by.
        40 * self.items + 48 * aggregates + swept
    }

    /// Dispatches of a substep.
    pub(super) fn dispatches(&self) -> usize {
        match &self.sweep {
            Sweep::Patches { fine, top } => 2 * fine.len() + usize::from(top.is_some()),
            Sweep::Colours { runs, .. } => 2 + 2 * self.levels + runs.len(),
        }
    }

    /// Encodes the correction of what a substep's forces predict.
    pub(super) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>, turn: usize) {
        let count = |level: usize| self.starts[level + 1] - self.starts[level];
        let slot = |index: usize| [(index as u64 * SLOT) as u32];
        let predicted = plan.params.predicted as usize * TURNS.len();
        self.restrict_vertices.encode(pass, turn + predicted, &slot(0), count(0));
        match &self.sweep {
            Sweep::Patches { fine, top } => {
                // The finest that the top takes is there already; the top averages the others itself.
                let there = if top.is_some() { fine.len() + 1 } else { fine.len() };
                (1..there).for_each(|level| self.restrict_aggregates.encode(pass, 0, &slot(level), count(level)));
                if let Some(top) = top {
                    top.stage.encode_groups(pass, 0, &[], 1);
                }
                fine.iter().rev().for_each(|(patches, _, stage)| stage.encode_groups(pass, 0, &[], patches.count));
            }
            Sweep::Colours { runs, hand_down, sweep, note, .. } => {
                (1..self.levels).for_each(|level| self.restrict_aggregates.encode(pass, 0, &slot(level), count(level)));
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
        let module = gpu.module("level", shader!("edge", "table", "level"));
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
        let top = (first_of_top < levels.len())
            .then(|| Top::new(gpu, &levels[first_of_top..], first_of_top, starts, forces, [centers, predicted, shift]));
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

impl Top {
    /// Of `levels`, the finest of which is number `first`.
    fn new(
        gpu: &Gpu,
        levels: &[Level],
        first: usize,
        starts: &[usize],
        forces: &Forces,
        [centers, predicted, shift]: [&wgpu::Buffer; 3],
    ) -> Top {
        let base = starts[first];
        let place: Vec<usize> = starts[first..].iter().map(|start| start - base).collect();
        let room = place[levels.len()];
        let coarsest_first =
            || (0..levels.len()).rev().flat_map(|level| levels[level].colors.iter().map(move |run| (level, run)));
        let runs: Vec<(usize, usize, usize)> =
            coarsest_first().map(|(level, run)| (first + level, run.start, run.len())).collect();
        let rounds_of = |level: usize| levels[level..].iter().map(|level| level.colors.len()).sum::<usize>();

        let (mut labels, mut spans, mut members) = (vec![0; room], vec![0_u32], Vec::new());
        for (index, level) in levels.iter().enumerate() {
            for (aggregate, span) in level.members.spans.iter().enumerate() {
                // The finest is averaged elsewhere.
                if index > 0 {
                    for member in span.start as usize..span.end as usize {
                        let item = place[index - 1] as u32 + level.members.items[member];
                        labels[item as usize] = (place[index] + aggregate) as u32;
                        members.extend([item, level.share[member].to_bits()]);
                    }
                }
                spans.push(members.len() as u32 / 2);
            }
        }
        let mut table: Vec<u32> = vec![0; runs.len() + 1];
        table.extend(place.iter().map(|&place| place as u32));
        table.extend((0..=levels.len()).map(|level| rounds_of(level) as u32));
        table.extend(labels);
        table.extend(spans);
        table.extend(members);
        let edges = table.len();
        for (round, (level, run)) in coarsest_first().enumerate() {
            table[round] = table.len() as u32;
            let moved = levels[level].links[run.clone()].iter();
            table.extend(moved.map(|link| {
                let [a, b] = link.ends.map(|end| end + place[level] as u32);
                a | b << 16
            }));
            table.extend(vec![0; 2 * run.len()]);
        }
        table[runs.len()] = table.len() as u32;
        let buffer = gpu.filled("levels", &table);
        let lanes = lanes(gpu, runs.iter().map(|run| run.2).max().unwrap_or(1));
        let constants = [
            ("LANES", lanes as f64),
            ("ROOM", room as f64),
            ("LEVELS", levels.len() as f64),
            ("ROUNDS", runs.len() as f64),
            ("BASE", base as f64),
        ];
        let module = gpu.module("levels", shader!("edge", "levels"));
        let entry = Entry { module: &module, name: "sweep_of_levels", constants: &constants };
        let bound =
            vec![(0, Bind::Read(&buffer)), (1, Bind::Read(centers)), (2, Bind::Write(predicted)), (3, Bind::Write(shift))];
        let stage = Stage::new(gpu, &forces.frame, entry, &[bound]);
        Top { table, buffer, stage, edges, runs }
    }
}

/// Centres of the aggregates of each level at rest, w the inverse mass.
fn at_rest(cloth: &Cloth, levels: &[Level]) -> Vec<Vec<Vec4>> {
    let mut found: Vec<Vec<Vec4>> = Vec::with_capacity(levels.len());
    for level in levels {
        let below = found.last().unwrap_or(&cloth.rest);
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
