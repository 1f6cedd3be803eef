//! Coarse levels that fit together into one workgroup, in the form that `stages/levels.wgsl` reads.

use crate::device::Gpu;
use crate::gpu::stage::NONE;
use crate::kernels::distance::Edge;
use crate::multigrid::hierarchy::Level;

/// Most edges of a color that there is room for; a color with more is swept in parts.
const WIDEST: usize = 512;

/// The coarsest levels of a cloth, beginning with a certain one.
pub(crate) struct LevelTable {
    /// For each level the start of its aggregates, and the end; for each level its first color, and the end; for each level
    /// [`Level::sweeps`]; for each aggregate the coarser one that contains it; for each level the members of its aggregates with their shares,
    /// padded with the first member and share 0; and the edges, as in the table of a tile. An aggregate is identified by
    /// its place here.
    pub table: Vec<u32>,
    /// Number of levels, and of finer levels that are swept elsewhere.
    levels: usize,
    finer: usize,
    /// Aggregates of the finest level here, and of all levels.
    pub averaged: usize,
    pub aggregates: usize,
    /// Most members of an aggregate of the finest level, 0 if that is averaged elsewhere, and of any other.
    of_finest: usize,
    members: usize,
    /// Room for edges of a color, and for colors.
    pub width: usize,
    colors: usize,
    /// The place in the table where the edges start; for each color its level, and the range of its edges there.
    edges: usize,
    runs: Vec<(usize, std::ops::Range<usize>)>,
}

impl LevelTable {
    /// The table of all levels from number `finest` on. Members of level `finest` are numbered from `below` on; `None`
    /// if it is averaged elsewhere.
    pub(crate) fn new(all: &[Level], finest: usize, below: Option<usize>) -> LevelTable {
        LevelTable::with_width(all, finest, below, WIDEST)
    }

    fn with_width(all: &[Level], finest: usize, below: Option<usize>, most: usize) -> LevelTable {
        let levels = &all[finest..];
        let mut place = vec![0];
        levels.iter().for_each(|level| place.push(place[place.len() - 1] + level.inverse_mass.len()));
        let (averaged, aggregates) = (place[1], place[levels.len()]);
        let widest = levels.iter().flat_map(|level| &level.colors).map(ExactSizeIterator::len).max().unwrap_or(0).max(1);
        // Parts of equal size, in full subgroups.
        let width = widest.div_ceil(widest.div_ceil(most)).next_multiple_of(32);

        let (mut runs, mut first_color) = (Vec::new(), vec![0; levels.len()]);
        for (index, level) in levels.iter().enumerate().rev() {
            first_color[index] = runs.len() as u32;
            for color in &level.colors {
                let parts = color.clone().step_by(width).map(|start| start..(start + width).min(color.end));
                runs.extend(parts.map(|part| (finest + index, part)));
            }
            // Levels begin at multiples of four.
            runs.resize(runs.len().next_multiple_of(4), (finest + index, 0..0));
        }
        let colors = runs.len();

        let mut table: Vec<u32> = place.iter().map(|&place| place as u32).collect();
        table.extend(first_color);
        table.push(colors as u32);
        table.extend(levels.iter().map(|level| level.sweeps));
        let mut labels = vec![0; aggregates];
        for (index, level) in levels.iter().enumerate().skip(1) {
            let above = level.label.iter().map(|&label| place[index] as u32 + label);
            labels[place[index - 1]..place[index]].iter_mut().zip(above).for_each(|(label, above)| *label = above);
        }
        table.extend(labels);
        let members = levels[1..].iter().map(most_members).max().unwrap_or(1);
        let of_finest = below.map_or(0, |_| most_members(&levels[0]));
        below.into_iter().for_each(|below| push_members(&mut table, &levels[0], below as u32, of_finest));
        levels[1..].iter().zip(&place).for_each(|(level, &below)| push_members(&mut table, level, below as u32, members));
        let edges = table.len();
        table.resize(edges + 3 * width * colors, NONE);
        for (color, (level, part)) in runs.iter().enumerate() {
            let links = all[*level].links[part.clone()].iter();
            let moved = links.map(|link| link.ends.map(|end| end + place[level - finest] as u32));
            table[edges + 3 * width * color..].iter_mut().zip(moved).for_each(|(word, [a, b])| *word = a | b << 16);
        }
        LevelTable {
            table,
            levels: levels.len(),
            finer: finest,
            averaged,
            aggregates,
            of_finest,
            members,
            width,
            colors,
            edges,
            runs,
        }
    }

    /// Stores the coefficients of the edges of the levels in use, here and in `buffer`, where the table starts at byte
    /// `start`.
    pub(crate) fn send_edges(&mut self, gpu: &Gpu, buffer: &wgpu::Buffer, start: usize, levels: &[Vec<Edge>]) {
        self.set_edges(levels);
        gpu.write(buffer, start + size_of::<u32>() * self.edges, &self.table[self.edges..]);
    }

    fn set_edges(&mut self, levels: &[Vec<Edge>]) {
        let colors = self.table[self.edges..].chunks_mut(3 * self.width);
        for ((level, part), words) in self.runs.iter().zip(colors) {
            let Some(edges) = levels.get(*level) else { continue };
            let (inverse_rest, inverse_weight) = words[self.width..].split_at_mut(self.width);
            let numbers = inverse_rest.iter_mut().zip(inverse_weight).zip(&edges[part.clone()]);
            numbers.for_each(|((rest, weight), edge)| {
                (*rest, *weight) = (edge.inverse_rest.to_bits(), edge.inverse_weight.to_bits());
            });
        }
    }

    /// The constants of `stages/levels.wgsl` for a table that starts at word `start`, or for none.
    pub(crate) fn constants(levels: Option<&LevelTable>, start: usize) -> [(&'static str, f64); 9] {
        let values = levels.map_or([0, 0, 0, 0, 0, 1, 1, 0, 0], |of| {
            [of.levels, of.finer, of.averaged, of.aggregates, of.of_finest, of.members, of.width, of.colors, start]
        });
        let names =
            ["LEVELS", "FINER", "FINEST", "AGGREGATES", "OF_FINEST", "MEMBERS", "COARSE_WIDTH", "COARSE_COLORS", "COARSE"];
        std::array::from_fn(|k| (names[k], values[k] as f64))
    }
}

/// Most members of an aggregate.
fn most_members(level: &Level) -> usize {
    level.members.spans.iter().map(|span| span.end - span.start).max().unwrap_or(1) as usize
}

/// Adds the members of the aggregates with their shares, as items numbered from `below` on, padded to `room` members: first
/// the first member of each aggregate, then their shares, then the second members, so that neighboring lanes read
/// neighboring words.
fn push_members(table: &mut Vec<u32>, level: &Level, below: u32, room: usize) {
    let lists = || level.members.spans.iter().map(|span| span.start as usize..span.end as usize);
    for member in 0..room {
        table.extend(
            lists().map(|list| below + level.members.items[if member < list.len() { list.start + member } else { list.start }]),
        );
        table.extend(lists().map(|list| if member < list.len() { level.share[list.start + member].to_bits() } else { 0 }));
    }
}

#[cfg(test)]
#[path = "../../../tests/unit/gpu_multigrid_level_table.rs"]
mod tests;
