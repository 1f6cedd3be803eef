//! Coarse levels that one workgroup holds together, as `stages/levels.wgsl` reads them.

use crate::device::Gpu;
use crate::gpu::tiles::NO_EDGE;
use crate::kernels::distance::Edge;
use crate::multigrid::hierarchy::Level;

/// Edges of a color that there is room for, at most: a wider one is swept in parts.
const WIDEST: usize = 512;

/// The coarsest levels of a cloth, from one on.
#[derive(Debug)]
pub(crate) struct LevelTable {
    /// For each level where its aggregates start, and the end; for each level its first color, and the end; for each aggregate
    /// the one that it is in; for each its members, each with its share, the first again with none where there are fewer; edges,
    /// as those of a tile. An aggregate is named by its place here.
    pub table: Vec<u32>,
    /// How many levels there are.
    pub levels: usize,
    /// Aggregates of the finest level, and of all.
    pub averaged: usize,
    pub aggregates: usize,
    /// Most members of an aggregate of the finest level, 0 if that is averaged elsewhere, and of another.
    of_finest: usize,
    members: usize,
    /// Room for edges of a color, and for colors.
    pub width: usize,
    colors: usize,
    /// Where in the table the edges start; for each color its level, and which of its edges.
    edges: usize,
    runs: Vec<(usize, std::ops::Range<usize>)>,
}

impl LevelTable {
    /// Of the cloth's levels from number `finest` on. What the members of that are, is numbered from `below` on; `None`: it is
    /// averaged elsewhere.
    pub(crate) fn new(all: &[Level], finest: usize, below: Option<usize>) -> LevelTable {
        LevelTable::with_width(all, finest, below, WIDEST)
    }

    fn with_width(all: &[Level], finest: usize, below: Option<usize>, most: usize) -> LevelTable {
        let levels = &all[finest..];
        let mut place = vec![0];
        levels.iter().for_each(|level| place.push(place[place.len() - 1] + level.inverse_mass.len()));
        let (averaged, aggregates) = (place[1], place[levels.len()]);
        let widest = levels.iter().flat_map(|level| &level.colors).map(ExactSizeIterator::len).max().unwrap_or(0).max(1);
        // Parts alike, of full subgroups.
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
        table.resize(edges + 3 * width * colors, NO_EDGE);
        for (color, (level, part)) in runs.iter().enumerate() {
            let links = all[*level].links[part.clone()].iter();
            let moved = links.map(|link| link.ends.map(|end| end + place[level - finest] as u32));
            table[edges + 3 * width * color..].iter_mut().zip(moved).for_each(|(word, [a, b])| *word = a | b << 16);
        }
        LevelTable { table, levels: levels.len(), averaged, aggregates, of_finest, members, width, colors, edges, runs }
    }

    /// Colors, or parts of them, and edges.
    pub(crate) fn counts(&self) -> [usize; 2] {
        let parts = self.runs.iter().map(|(_, part)| part.len()).filter(|&edges| edges > 0);
        [parts.clone().count(), parts.sum()]
    }

    /// Fills in the edges' numbers, here and in `buffer`, where the table starts at byte `start`.
    pub(crate) fn send_edges(&mut self, gpu: &Gpu, buffer: &wgpu::Buffer, start: usize, levels: &[Vec<Edge>]) {
        self.set_edges(levels);
        gpu.write(buffer, start + size_of::<u32>() * self.edges, &self.table[self.edges..]);
    }

    fn set_edges(&mut self, levels: &[Vec<Edge>]) {
        let colors = self.table[self.edges..].chunks_mut(3 * self.width);
        for ((level, part), words) in self.runs.iter().zip(colors) {
            let (inverse_rest, inverse_weight) = words[self.width..].split_at_mut(self.width);
            let numbers = inverse_rest.iter_mut().zip(inverse_weight).zip(&levels[*level][part.clone()]);
            numbers.for_each(|((rest, weight), edge)| {
                (*rest, *weight) = (edge.inverse_rest.to_bits(), edge.inverse_weight.to_bits());
            });
        }
    }

    /// What `stages/levels.wgsl` is told of a table that starts at word `start`, or of none.
    pub(crate) fn constants(levels: Option<&LevelTable>, start: usize) -> [(&'static str, f64); 8] {
        let values = levels.map_or([0, 0, 0, 0, 1, 1, 0, 0], |of| {
            [of.levels, of.averaged, of.aggregates, of.of_finest, of.members, of.width, of.colors, start]
        });
        let names = ["LEVELS", "FINEST", "AGGREGATES", "OF_FINEST", "MEMBERS", "COARSE_WIDTH", "COARSE_COLORS", "COARSE"];
        std::array::from_fn(|k| (names[k], values[k] as f64))
    }
}

/// Most members of an aggregate.
fn most_members(level: &Level) -> usize {
    level.members.spans.iter().map(|span| span.end - span.start).max().unwrap_or(1) as usize
}

/// Adds each aggregate's members, items from number `below` on, with their shares, in room for `room` of them.
fn push_members(table: &mut Vec<u32>, level: &Level, below: u32, room: usize) {
    for span in &level.members.spans {
        let range = span.start as usize..span.end as usize;
        let (items, shares) = (&level.members.items[range.clone()], &level.share[range]);
        let listed = items.iter().zip(shares).map(|(&item, share)| [below + item, share.to_bits()]);
        let filled = std::iter::repeat([below + items[0], 0]);
        table.extend(listed.chain(filled).take(room).flatten());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::cloth::Cloth;
    use crate::multigrid::hierarchy::Hierarchy;
    use crate::{Mesh, Options};

    /// The table, read as `stages/levels.wgsl` reads it, says what the levels are: whole colors or parts of them.
    #[test]
    fn a_table_says_what_the_levels_are() {
        let options = Options { pinned: (0..70).collect(), ..Options::default() };
        let cloth = Cloth::new(&Mesh::grid(70, 50, 1.0, 1.0), &options).unwrap();
        let all = &Hierarchy::new(&cloth).levels;
        assert!(all.len() > 2);
        for (finest, below, most) in [(0, None, 512), (0, Some(0), 32), (1, Some(5), 512)] {
            let mut table = LevelTable::with_width(all, finest, below, most);
            let numbers = |level: &Level| level.links.iter().enumerate().map(|(k, _)| k as f32 + 0.5).collect::<Vec<_>>();
            let edge = |k: f32| Edge { inverse_rest: k, inverse_weight: -k, ..Edge::default() };
            let edges: Vec<Vec<Edge>> = all.iter().map(|level| numbers(level).into_iter().map(edge).collect()).collect();
            table.set_edges(&edges);
            let levels = &all[finest..];
            let word = |k: usize| table.table[k] as usize;
            let (labels, width) = (2 * (levels.len() + 1), table.width);
            let lists = labels + table.aggregates;
            let members = lists + 2 * table.of_finest * table.averaged;
            assert_eq!(members + 2 * table.members * (table.aggregates - table.averaged), table.edges);
            assert_eq!(table.of_finest > 0, below.is_some());
            assert!(width <= most && (most > 32 || table.runs.len() > levels.iter().map(|level| level.colors.len() + 4).sum()));
            for (index, level) in levels.iter().enumerate() {
                let place = word(index);
                assert_eq!(word(index + 1) - place, level.inverse_mass.len());
                for (k, &item) in level.members.items.iter().enumerate().filter(|_| index > 0 || below.is_some()) {
                    let aggregate = place + level.label[item as usize] as usize;
                    let (list, room, base) = match index {
                        0 => (lists + 2 * table.of_finest * aggregate, table.of_finest, below.unwrap()),
                        _ => (members + 2 * table.members * (aggregate - table.averaged), table.members, word(index - 1)),
                    };
                    assert!(index == 0 || word(labels + base + item as usize) == aggregate);
                    let of_item =
                        table.table[list..][..2 * room].chunks(2).filter(|pair| pair[0] as usize == base + item as usize);
                    assert!(of_item.map(|pair| f32::from_bits(pair[1])).sum::<f32>() == level.share[k]);
                }
                let first = word(levels.len() + 1 + index);
                let last = if index > 0 { word(levels.len() + index) } else { word(2 * levels.len() + 1) };
                assert!(first % 4 == 0 && first <= last && last <= table.colors);
                let mut met = Vec::new();
                for color in first..last {
                    let block = &table.table[table.edges + 3 * width * color..][..3 * width];
                    for (k, &ends) in block[..width].iter().enumerate().filter(|(_, ends)| **ends != NO_EDGE) {
                        let number = f32::from_bits(block[width + k]);
                        assert_eq!(f32::from_bits(block[2 * width + k]), -number);
                        let link = &level.links[number as usize];
                        assert_eq!([ends & 0xffff, ends >> 16], link.ends.map(|end| end + place as u32));
                        met.push(number as usize);
                    }
                }
                assert_eq!(met, (0..level.links.len()).collect::<Vec<_>>(), "each edge once, color after color");
            }
        }
    }
}
