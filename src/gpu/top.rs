//! Coarse levels that one workgroup holds together, as `levels.wgsl` reads them.

use crate::kernels::Edge;
use crate::levels::Level;

use super::patches::NO_EDGE;

/// Edges of a colour that there is room for, at most: a wider one is swept in parts.
const WIDEST: usize = 512;

/// The coarsest levels of a cloth.
#[derive(Debug)]
pub(super) struct Top {
    /// For each level where its aggregates start, and the end; for each level its first colour, and the end; for each aggregate
    /// the one that it is in; for each not of the finest level here its members, each with its share, the first again with none
    /// where there are fewer; edges, as those of a patch. What is an aggregate is its place here.
    pub table: Vec<u32>,
    /// How many levels there are.
    pub levels: usize,
    /// Aggregates of the finest level, and of all.
    pub averaged: usize,
    pub aggregates: usize,
    /// Most members of an aggregate that is not of the finest level.
    members: usize,
    /// Room for edges of a colour, and for colours.
    pub width: usize,
    colors: usize,
    /// Where in the table the edges start; for each colour its level, and which of its edges.
    edges: usize,
    runs: Vec<(usize, std::ops::Range<usize>)>,
}

impl Top {
    /// Of the cloth's levels from number `finest` on.
    pub(super) fn new(all: &[Level], finest: usize) -> Top {
        let levels = &all[finest..];
        let mut place = vec![0];
        levels.iter().for_each(|level| place.push(place[place.len() - 1] + level.inverse_mass.len()));
        let (averaged, aggregates) = (place[1], place[levels.len()]);
        let widest = levels.iter().flat_map(|level| &level.colors).map(ExactSizeIterator::len).max().unwrap_or(1);
        let width = widest.next_power_of_two().clamp(32, WIDEST);

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
        levels[1..].iter().zip(&place).for_each(|(level, &below)| push_members(&mut table, level, below as u32, members));
        let edges = table.len();
        table.resize(edges + 3 * width * colors, NO_EDGE);
        for (color, (level, part)) in runs.iter().enumerate() {
            let links = all[*level].links[part.clone()].iter();
            let moved = links.map(|link| link.ends.map(|end| end + place[level - finest] as u32));
            table[edges + 3 * width * color..].iter_mut().zip(moved).for_each(|(word, [a, b])| *word = a | b << 16);
        }
        Top { table, levels: levels.len(), averaged, aggregates, members, width, colors, edges, runs }
    }

    /// Fills in the edges' numbers.
    pub(super) fn set_edges(&mut self, levels: &[Vec<Edge>]) {
        let colors = self.table[self.edges..].chunks_mut(3 * self.width);
        for ((level, part), words) in self.runs.iter().zip(colors) {
            let (inverse_rest, inverse_weight) = words[self.width..].split_at_mut(self.width);
            let numbers = inverse_rest.iter_mut().zip(inverse_weight).zip(&levels[*level][part.clone()]);
            numbers.for_each(|((rest, weight), edge)| {
                (*rest, *weight) = (edge.inverse_rest.to_bits(), edge.inverse_weight.to_bits());
            });
        }
    }

    /// What it is told if there are no levels.
    pub(super) const NO_CONSTANTS: [(&'static str, f64); 7] = [
        ("LEVELS", 0.0),
        ("FINEST", 0.0),
        ("AGGREGATES", 0.0),
        ("MEMBERS", 1.0),
        ("COARSE_WIDTH", 1.0),
        ("COARSE_COLORS", 0.0),
        ("COARSE", 0.0),
    ];

    /// What `levels.wgsl` is told, if its table starts at word `start`.
    pub(super) fn constants(&self, start: usize) -> [(&'static str, f64); 7] {
        [
            ("LEVELS", self.levels),
            ("FINEST", self.averaged),
            ("AGGREGATES", self.aggregates),
            ("MEMBERS", self.members),
            ("COARSE_WIDTH", self.width),
            ("COARSE_COLORS", self.colors),
            ("COARSE", start),
        ]
        .map(|(name, value)| (name, value as f64))
    }
}

/// Most members of an aggregate.
pub(super) fn most_members(level: &Level) -> usize {
    level.members.spans.iter().map(|span| span.end - span.start).max().unwrap_or(1) as usize
}

/// Adds each aggregate's members, items from number `below` on, with their shares, in room for `room` of them.
pub(super) fn push_members(table: &mut Vec<u32>, level: &Level, below: u32, room: usize) {
    for span in &level.members.spans {
        let range = span.start as usize..span.end as usize;
        let (items, shares) = (&level.members.items[range.clone()], &level.share[range]);
        let listed = items.iter().zip(shares).map(|(&item, share)| [below + item, share.to_bits()]);
        let filled = std::iter::repeat([below + items[0], 0]);
        table.extend(listed.chain(filled).take(room).flatten());
    }
}
