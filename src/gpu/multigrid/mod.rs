//! Coarse levels on the GPU; [`crate::multigrid::hierarchy`] has the theory.
//!
//! The finest level is averaged from the vertices in a dispatch of its own, unless that of bending does it; where it is the
//! only level, the tiles of a small cloth do all of this ([`super::sweep::Tiled::corrected`]). The levels that fit together into one
//! workgroup are swept in one dispatch. Larger levels are divided into tiles, as the cloth is, and take two dispatches
//! each, one to average and one to sweep. On a mesh that cannot be divided each color takes a dispatch.

mod level_table;
mod per_color;
mod tiled;

use glam::Vec4;

use crate::device::{Entry, Gpu};
use crate::gpu::forces::Forces;
use crate::gpu::shaders;
use crate::gpu::stage::{Batch, Bind, ComputePass, Stage, batches, slot};
use crate::gpu::state::{PING_PONG, groups};
use crate::kernels::params::PROJECT_COARSE;
use crate::model::cloth::Cloth;
use crate::model::csr::Span;
use crate::multigrid::hierarchy::Level;
use crate::step::plan::Plan;
use crate::step::substep_count::Length;
pub(crate) use level_table::LevelTable;
use per_color::LevelsPerColor;
use tiled::TiledLevels;

/// Lanes that average an aggregate of vertices, and lanes that average one of aggregates: about as many as it has
/// members.
const EACH: [usize; 2] = [16, 4];

/// A member of an aggregate: `Member` of `stages/restrict.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Member {
    pub item: u32,
    /// Its share of the aggregate's mass.
    pub share: f32,
}

/// What an aggregate is averaged to: its center and its inverse mass, and its predicted displacement. `Average` of
/// `average.wgsl`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, bytemuck::Pod, bytemuck::Zeroable)]
pub(crate) struct Average {
    pub x: Vec4,
    pub u: Vec4,
}

/// All levels of a cloth. A step uses as many of the finest ones as it asks for.
pub(crate) struct Multigrid {
    /// The [`Average`] of each aggregate of each level, the finest level first.
    pub averages: wgpu::Buffer,
    /// The correction of each of them.
    pub shift: wgpu::Buffer,
    /// The start of each level's aggregates among those of all levels, and the end.
    starts: Vec<usize>,
    /// The substep and the number of levels that the uploaded edges belong to.
    sent: Option<(Length, usize)>,
    restrict_vertices: Stage,
    restrict_aggregates: Stage,
    sweep: LevelSweep,
}

/// How levels are swept.
enum LevelSweep {
    Tiled(TiledLevels),
    PerColor(LevelsPerColor),
}

impl Multigrid {
    /// Creates all levels of the cloth, in workgroups of at most `max_aggregates`; `None`: one dispatch per color.
    pub(crate) fn new(gpu: &Gpu, cloth: &Cloth, levels: &[Level], forces: &Forces, max_aggregates: Option<usize>) -> Multigrid {
        let mut starts = vec![0];
        levels.iter().for_each(|level| starts.push(starts[starts.len() - 1] + level.inverse_mass.len()));
        let rest = at_rest(&cloth.rest, levels);
        let at_start: Vec<Average> = rest.concat().into_iter().map(|x| Average { x, u: Vec4::ZERO }).collect();
        let averages = gpu.filled("averages", &at_start);
        let shift = gpu.buffer("shift", averages.size() / 2);

        let (mut spans, mut members) = (Vec::new(), Vec::new());
        for (index, level) in levels.iter().enumerate() {
            let (below, first) = (if index > 0 { starts[index - 1] } else { 0 }, members.len() as u32);
            spans.extend(level.members.spans.iter().map(|span| Span { start: first + span.start, end: first + span.end }));
            let shares = level.members.items.iter().zip(&level.share);
            members.extend(shares.map(|(&item, &share)| Member { item: below as u32 + item, share }));
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
                Bind::Write(&averages),
            ]
        };
        let mut bound_by_all = groups(&forces.states, |from, _| bound(&from.x, &from.p));
        bound_by_all.extend(groups(&forces.states, |from, _| bound(&from.x, &forces.u)));
        let restrict = |of_vertices: bool, each: usize| {
            let constants = [("OF_VERTICES", f64::from(of_vertices)), ("EACH", each as f64)];
            let entry = Entry { shader: shaders::RESTRICT, name: "restrict_level", constants: &constants };
            Stage::new(gpu, &forces.uniforms, entry, &bound_by_all)
        };
        let (restrict_vertices, restrict_aggregates) = (restrict(true, EACH[0]), restrict(false, EACH[1]));

        let buffers = [&averages, &shift];
        let tiled =
            max_aggregates.and_then(|most| TiledLevels::new(gpu, levels, &rest, &starts, &forces.uniforms, most, buffers));
        let sweep = match tiled {
            Some(tiled) => LevelSweep::Tiled(tiled),
            None => LevelSweep::PerColor(LevelsPerColor::new(gpu, levels, &aggregates, forces, buffers)),
        };
        Multigrid { averages, shift, starts, sent: None, restrict_vertices, restrict_aggregates, sweep }
    }

    /// Number of levels that are swept in tiles.
    #[cfg(test)]
    pub(crate) fn in_tiles(&self) -> Option<usize> {
        match &self.sweep {
            LevelSweep::Tiled(tiled) => Some(tiled.in_tiles.len()),
            LevelSweep::PerColor(_) => None,
        }
    }

    pub(crate) fn prepare(&mut self, gpu: &Gpu, plan: &Plan<'_>) {
        let asked = Some((plan.coefficients.length, plan.coefficients.levels.len()));
        if std::mem::replace(&mut self.sent, asked) == asked {
            return;
        }
        match &mut self.sweep {
            LevelSweep::Tiled(tiled) => tiled.send_edges(gpu, &plan.coefficients.levels),
            LevelSweep::PerColor(per_color) => per_color.send_edges(gpu, &self.starts, &plan.coefficients.levels),
        }
    }

    /// Encodes the averages of the finest level over the displacements that the forces of substep number `group` of
    /// [`PING_PONG`] predict.
    pub(crate) fn encode_averages(&self, pass: &mut ComputePass, plan: &Plan<'_>, group: usize) {
        let predicted = plan.params.predicted as usize * PING_PONG.len();
        self.restrict_vertices.dispatch(pass, group + predicted, &slot(0), EACH[0] * self.starts[1]);
    }

    /// Encodes the corrections that follow from the averages of the finest level.
    pub(crate) fn encode(&self, pass: &mut ComputePass, plan: &Plan<'_>) {
        let count = |level: usize| self.starts[level + 1] - self.starts[level];
        let levels = plan.params.levels as usize;
        let averaged = match &self.sweep {
            LevelSweep::Tiled(tiled) => tiled.averaged(levels),
            LevelSweep::PerColor(_) => levels,
        };
        for level in 1..averaged {
            self.restrict_aggregates.dispatch(pass, 0, &slot(level), EACH[1] * count(level));
        }
        match &self.sweep {
            LevelSweep::Tiled(tiled) => tiled.encode(pass, levels),
            LevelSweep::PerColor(per_color) => per_color.encode(pass, levels, plan.params.coarse_rule == PROJECT_COARSE),
        }
    }

    /// Encodes adding the correction to the vertices, if the sweep does not do that itself.
    pub(crate) fn encode_correct(&self, pass: &mut ComputePass, plan: &Plan<'_>) {
        if let LevelSweep::PerColor(per_color) = &self.sweep {
            per_color.encode_correct(pass, plan.cloth.rest.len());
        }
    }
}

/// Centers of the aggregates of each level at rest; w is the inverse mass.
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
