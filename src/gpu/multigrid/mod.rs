//! Coarse levels on the GPU: see [`crate::multigrid::hierarchy`] for what they are.
//!
//! The finest is averaged from the vertices in a dispatch of its own. Those that fit into one workgroup together are swept
//! by one, in one dispatch. Larger ones are cut into tiles, as the cloth is, and take two: one to be averaged, one to be
//! swept. On a mesh that cannot be cut each color is a dispatch.

mod level_table;
mod per_color;
mod tiled;

use glam::Vec4;

use crate::device::{Entry, Gpu};
use crate::gpu::forces::Forces;
use crate::gpu::shaders;
use crate::gpu::stage::{Batch, Bind, Stage, batches, slot};
use crate::gpu::state::{PING_PONG, groups};
use crate::model::cloth::Cloth;
use crate::model::csr::Span;
use crate::multigrid::hierarchy::Level;
use crate::step::plan::Plan;
use crate::step::substep_count::Length;
pub(crate) use level_table::LevelTable;
use per_color::LevelsPerColor;
use tiled::TiledLevels;

/// Lanes that average an aggregate of vertices, and one of aggregates: about as many as it has of them.
const EACH: [usize; 2] = [16, 4];

/// An item that an aggregate is made of: `stages/restrict.wgsl`'s `Member`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Member {
    pub item: u32,
    /// Share in the aggregate's mass.
    pub share: f32,
}

/// All levels of a cloth; a step uses as many of the finest as it asks for.
#[derive(Debug)]
pub(crate) struct Multigrid {
    /// What each aggregate of each level is corrected by, the finest level first.
    pub shift: wgpu::Buffer,
    /// How many members the aggregates of each level have, and those of all finer ones.
    items: Vec<usize>,
    /// Where each level's aggregates start among those of all, and the end.
    starts: Vec<usize>,
    /// The substep and the levels that the edges are for.
    sent: Option<(Length, usize)>,
    restrict_vertices: Stage,
    restrict_aggregates: Stage,
    sweep: Sweep,
}

/// How levels are swept.
#[derive(Debug)]
enum Sweep {
    Tiled(TiledLevels),
    PerColor(LevelsPerColor),
}

impl Multigrid {
    /// With all levels of the cloth, in workgroups that have room for so many aggregates; `None`: a dispatch a color.
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth, levels: &[Level], forces: &Forces, room: Option<usize>) -> Multigrid {
        let mut starts = vec![0];
        levels.iter().for_each(|level| starts.push(starts[starts.len() - 1] + level.inverse_mass.len()));
        let rest = at_rest(&cloth.rest, levels);
        let centers = gpu.filled("centers", &rest.concat());
        let [predicted, shift] = ["predicted", "shift"].map(|name| gpu.buffer(name, centers.size()));

        let (mut spans, mut members, mut items) = (Vec::new(), Vec::new(), Vec::new());
        for (index, level) in levels.iter().enumerate() {
            let (below, first) = (if index > 0 { starts[index - 1] } else { 0 }, members.len() as u32);
            spans.extend(level.members.spans.iter().map(|span| Span { start: first + span.start, end: first + span.end }));
            let shares = level.members.items.iter().zip(&level.share);
            members.extend(shares.map(|(&item, &share)| Member { item: below as u32 + item, share }));
            items.push(members.len());
        }
        let (spans, members) = (gpu.filled("spans", &spans), gpu.filled("members", &members));
        let aggregates: Vec<Batch> = starts.windows(2).map(|ends| Batch::from(ends[0]..ends[1])).collect();
        let slots = batches(gpu, &aggregates);
        let bound = |x, motion| {
            vec![
                Bind::Dynamic(&slots, size_of::<Batch>()),
                Bind::Read(x),
                Bind::Read(motion),
                Bind::Read(&spans),
                Bind::Read(&members),
                Bind::Write(&centers),
                Bind::Write(&predicted),
            ]
        };
        let mut bound_by_all = groups(&forces.states, |from, _| bound(&from.x, &from.p));
        bound_by_all.extend(groups(&forces.states, |from, _| bound(&from.x, &forces.u)));
        let restrict = |of_vertices: bool, each: usize| {
            let constants = [("OF_VERTICES", f64::from(u8::from(of_vertices))), ("EACH", each as f64)];
            let entry = Entry { shader: shaders::RESTRICT, name: "restrict_level", constants: &constants };
            Stage::new(gpu, &forces.uniforms, entry, &bound_by_all)
        };
        let (restrict_vertices, restrict_aggregates) = (restrict(true, EACH[0]), restrict(false, EACH[1]));

        let buffers = [&centers, &predicted, &shift];
        let tiled = room.and_then(|room| TiledLevels::new(gpu, levels, &rest, &starts, &forces.uniforms, room, buffers));
        let sweep = match tiled {
            Some(tiled) => Sweep::Tiled(tiled),
            None => Sweep::PerColor(LevelsPerColor::new(gpu, levels, &aggregates, forces, buffers)),
        };
        Multigrid { shift, items, starts, sent: None, restrict_vertices, restrict_aggregates, sweep }
    }

    /// How many levels are swept in tiles.
    #[cfg(test)]
    pub(crate) fn in_tiles(&self) -> Option<usize> {
        match &self.sweep {
            Sweep::Tiled(tiled) => Some(tiled.in_tiles()),
            Sweep::PerColor(_) => None,
        }
    }

    pub(crate) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>) {
        let asked = Some((plan.coefficients.length, plan.coefficients.levels.len()));
        if std::mem::replace(&mut self.sent, asked) == asked {
            return;
        }
        match &mut self.sweep {
            Sweep::Tiled(tiled) => tiled.send_edges(gpu, &plan.coefficients.levels),
            Sweep::PerColor(per_color) => per_color.send_edges(gpu, &self.starts, &plan.coefficients.levels),
        }
    }

    /// Bytes of a substep with so many levels, those of coarser ones that are read along with them counted.
    pub(crate) fn bytes(&self, levels: usize) -> usize {
        let swept = match &self.sweep {
            Sweep::Tiled(tiled) => tiled.bytes(),
            Sweep::PerColor(per_color) => per_color.bytes(),
        };
        // Members and what they are averaged from; what is averaged, and what that is corrected by.
        40 * self.items[levels - 1] + 48 * self.starts[levels] + swept
    }

    /// Colors one after another, and edges, of a substep, but for those that are dispatches of their own.
    pub(crate) fn counts(&self, levels: usize) -> [usize; 2] {
        match &self.sweep {
            Sweep::Tiled(tiled) => tiled.counts(levels),
            Sweep::PerColor(_) => [0, 0],
        }
    }

    /// Dispatches of a substep, those of [`Multigrid::encode_correct`] counted.
    pub(crate) fn dispatches(&self, levels: usize) -> usize {
        match &self.sweep {
            Sweep::Tiled(tiled) => 2 * tiled.dispatches(levels),
            Sweep::PerColor(per_color) => levels + per_color.dispatches(levels),
        }
    }

    /// Encodes the correction of what a substep's forces predict: substep number `group` of [`PING_PONG`].
    pub(crate) fn encode(&self, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>, group: usize) {
        let count = |level: usize| self.starts[level + 1] - self.starts[level];
        let predicted = plan.params.predicted as usize * PING_PONG.len();
        self.restrict_vertices.dispatch(pass, group + predicted, &slot(0), EACH[0] * count(0));
        let levels = plan.params.levels as usize;
        let averaged = match &self.sweep {
            Sweep::Tiled(tiled) => tiled.dispatches(levels),
            Sweep::PerColor(_) => levels,
        };
        for level in 1..averaged {
            self.restrict_aggregates.dispatch(pass, 0, &slot(level), EACH[1] * count(level));
        }
        match &self.sweep {
            Sweep::Tiled(tiled) => tiled.encode(pass, levels),
            Sweep::PerColor(per_color) => per_color.encode(pass, levels),
        }
    }

    /// Encodes adding the correction to the vertices, for a sweep that does not do that itself.
    pub(crate) fn encode_correct(&self, pass: &mut wgpu::ComputePass<'_>, plan: &Plan<'_>) {
        if let Sweep::PerColor(per_color) = &self.sweep {
            per_color.encode_correct(pass, plan.cloth.rest.len());
        }
    }
}

/// Centers of the aggregates of each level at rest, w the inverse mass.
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
