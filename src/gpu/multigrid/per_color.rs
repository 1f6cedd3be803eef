//! Sweeping levels with one dispatch per color, for any mesh.

use crate::device::Gpu;
use crate::gpu::forces::Forces;
use crate::gpu::shaders;
use crate::gpu::stage::{Batch, Bind, ComputePass, NONE, Stage, batches, slot};
use crate::kernels::distance::Edge;
use crate::multigrid::hierarchy::Level;

/// Sweeps over the levels with one dispatch per color.
pub(crate) struct LevelsPerColor {
    /// The aggregates of each level, its number of sweeps ([`Level::sweeps`]), and the edges of each color with their level.
    aggregates: Vec<Batch>,
    sweeps: Vec<u32>,
    colors: Vec<(usize, Batch)>,
    edges: wgpu::Buffer,
    begin: Stage,
    prolongate: Stage,
    sweep: Stage,
    note: Stage,
    correct: Stage,
}

impl LevelsPerColor {
    pub(crate) fn new(
        gpu: &Gpu,
        levels: &[Level],
        aggregates: &[Batch],
        forces: &Forces,
        [averages, shift]: [&wgpu::Buffer; 2],
    ) -> LevelsPerColor {
        let (mut colors, mut first) = (Vec::new(), 0);
        for (index, level) in levels.iter().enumerate() {
            colors.extend(level.colors.iter().map(|range| (index, Batch::from(first + range.start..first + range.end))));
            first += level.links.len();
        }
        let edges = gpu.buffer("coarse edges", (first.max(1) * size_of::<Edge>()) as u64);
        let runs: Vec<Batch> = aggregates.iter().copied().chain(colors.iter().map(|(_, color)| *color)).collect();
        let slots = batches(gpu, &runs);
        let mut labels: Vec<u32> = Vec::new();
        for (level, above) in levels[1..].iter().zip(&aggregates[1..]) {
            labels.extend(level.label.iter().map(|label| above.first + label));
        }
        labels.resize(labels.len() + levels[levels.len() - 1].inverse_mass.len(), NONE);
        let labels = gpu.filled("labels", &labels);
        let of_vertices = gpu.filled("labels of vertices", &levels[0].label);
        let corrected = gpu.buffer("corrected", shift.size());
        let stage = |name, labels| {
            let bound = vec![
                Bind::Dynamic(&slots, size_of::<Batch>()),
                Bind::Read(&edges),
                Bind::Read(averages),
                Bind::Read(labels),
                Bind::Write(&corrected),
                Bind::Write(shift),
                Bind::Write(&forces.u),
            ];
            Stage::new(gpu, &forces.uniforms, shaders::LEVELS_PER_COLOR.entry(name), &[bound])
        };
        let [begin, prolongate, sweep, note] =
            ["begin_at", "prolongate", "sweep_coarse", "note_shift"].map(|name| stage(name, &labels));
        let correct = stage("correct_vertices", &of_vertices);
        let sweeps = levels.iter().map(|level| level.sweeps).collect();
        LevelsPerColor { aggregates: aggregates.to_vec(), sweeps, colors, edges, begin, prolongate, sweep, note, correct }
    }

    pub(crate) fn send_edges(&mut self, gpu: &Gpu, starts: &[usize], levels: &[Vec<Edge>]) {
        let numbered = |(list, &start): (&Vec<Edge>, &usize)| {
            let base = start as u32;
            list.iter().map(|edge| Edge { a: edge.a + base, b: edge.b + base, ..*edge }).collect::<Vec<_>>()
        };
        let all: Vec<Edge> = levels.iter().zip(starts).flat_map(numbered).collect();
        gpu.write(&self.edges, 0, &all);
    }

    /// Encodes the sweeps of this many levels, the coarsest first: some of them several times if they are `repeated`.
    pub(crate) fn encode(&self, pass: &mut ComputePass, levels: usize, repeated: bool) {
        let count = |level: usize| self.aggregates[level].count as usize;
        for level in (0..levels).rev() {
            let arrive = if level + 1 == levels { &self.begin } else { &self.prolongate };
            arrive.dispatch(pass, 0, &slot(level), count(level));
            for _ in 0..if repeated { self.sweeps[level] } else { 1 } {
                for (index, (_, color)) in self.colors.iter().enumerate().filter(|(_, (of, _))| *of == level) {
                    self.sweep.dispatch(pass, 0, &slot(self.aggregates.len() + index), color.count as usize);
                }
            }
        }
        self.note.dispatch(pass, 0, &slot(0), count(0));
    }

    /// Encodes adding the finest level's correction to the vertices.
    pub(crate) fn encode_correct(&self, pass: &mut ComputePass, vertices: usize) {
        self.correct.dispatch(pass, 0, &slot(0), vertices);
    }
}
