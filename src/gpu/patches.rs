//! Patches: the cloth cut into pieces that a workgroup's memory holds, each with all that its own vertices depend on.
//!
//! A sweep visits the edges colour after colour. Walked backwards from a patch's own vertices, a vertex that is needed
//! after a colour needs, before it, the other end of its edge of that colour. What is gathered so ("halo") is a few rings
//! wide, and computing it in every patch that needs it is cheaper than a dispatch a colour: on a device whose dispatches
//! cost 2 us each, five to eight times.

use std::ops::Range;

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::coloring::Lists;
use crate::kernels::Edge;

/// Words of an edge in the table: `EDGE` of `table.wgsl`.
const EDGE: usize = 3;
/// Words of a header before the ends of the colours.
const HEADER: usize = 4;

/// Patches as `table.wgsl` reads them.
#[derive(Debug, Clone)]
pub(crate) struct Patches {
    /// A header a patch (where its vertices start, how many are its own, how many there are, where its edges start, where
    /// each colour of them ends), its vertices, and behind all those the edges of all.
    pub table: Vec<u32>,
    pub count: usize,
    pub colors: usize,
    /// Most vertices that a patch holds, and all of them together.
    pub largest: usize,
    pub held: usize,
    /// Where in the table the edges start, and which of the cloth's each is.
    edges: usize,
    sources: Vec<u32>,
}

/// A patch as it is found: its vertices, its own first, and its edges of each colour.
#[derive(Debug)]
struct Patch {
    own: usize,
    vertices: Vec<u32>,
    edges: Vec<Vec<u32>>,
}

/// What patches are cut from.
struct Source<'a> {
    rest: &'a [Vec4],
    ends: &'a [[u32; 2]],
    colors: &'a [Range<usize>],
    /// The edges at each vertex.
    around: Lists<u32>,
    /// Vertices that a patch may hold.
    room: usize,
}

impl Patches {
    /// Cuts the cloth into patches of at most `own` vertices that hold at most `room`. `None` if that cannot be done, as for
    /// a fan of many edges, or not be done well.
    pub(crate) fn new(rest: &[Vec4], ends: &[[u32; 2]], colors: &[Range<usize>], own: usize, room: usize) -> Option<Patches> {
        let pairs = ends.iter().enumerate().flat_map(|(edge, &[a, b])| [(a, edge as u32), (b, edge as u32)]);
        let around = Lists::new(rest.len(), pairs);
        let room = room.min(1 << 16);
        let source = Source { rest, ends, colors, around, room };
        let mut pieces = Vec::new();
        halve((0..rest.len() as u32).collect(), rest, own.min(room).max(1), &mut pieces);
        let seen = || vec![false; rest.len()];
        let patches: Option<Vec<Vec<Patch>>> = pieces.into_par_iter().map_init(seen, |seen, own| source.fit(own, seen)).collect();
        let patches: Vec<Patch> = patches?.into_iter().flatten().collect();
        let held: usize = patches.iter().map(|patch| patch.vertices.len()).sum();
        // So much recomputed is no gain any more.
        (held <= 8 * rest.len().max(256)).then(|| Patches::lay_out(&patches, ends, colors.len()))
    }

    fn lay_out(patches: &[Patch], ends: &[[u32; 2]], colors: usize) -> Patches {
        let header = HEADER + colors;
        let held: usize = patches.iter().map(|patch| patch.vertices.len()).sum();
        let edges = patches.len() * header + held;
        let mut table = vec![0; edges];
        let mut sources = Vec::new();
        let mut vertices = patches.len() * header;
        let mut place = vec![0; ends.iter().flatten().max().map_or(0, |&last| last as usize + 1)];
        for (patch, at) in patches.iter().zip((0..).step_by(header)) {
            let all = patch.vertices.len();
            let header = [vertices, patch.own, all, table.len()].map(|word| word as u32);
            table[at..at + HEADER].copy_from_slice(&header);
            table[vertices..vertices + all].copy_from_slice(&patch.vertices);
            vertices += all;
            // A vertex without edges may lie beyond the last that has one.
            let known = patch.vertices.iter().enumerate();
            known.for_each(|(k, &v)| if let Some(place) = place.get_mut(v as usize) { *place = k as u32 });
            for (color, list) in patch.edges.iter().enumerate() {
                for &edge in list {
                    let [a, b] = ends[edge as usize].map(|vertex| place[vertex as usize]);
                    table.extend([a | b << 16, 0, 0]);
                    sources.push(edge);
                }
                table[at + HEADER + color] = table.len() as u32;
            }
        }
        let largest = patches.iter().map(|patch| patch.vertices.len()).max().unwrap_or(0);
        Patches { table, count: patches.len(), colors, largest, held, edges, sources }
    }

    /// Edges of all patches together.
    pub(crate) fn edges_held(&self) -> usize {
        self.sources.len()
    }

    /// Fills in the edges' numbers; returns where in the table (in words) they start.
    pub(crate) fn set_edges(&mut self, edges: &[Edge]) -> usize {
        for (words, &source) in self.table[self.edges..].chunks_exact_mut(EDGE).zip(&self.sources) {
            let edge = edges[source as usize];
            (words[1], words[2]) = (edge.inverse_rest.to_bits(), edge.inverse_weight.to_bits());
        }
        self.edges
    }
}

/// Cuts a set of vertices across its longest extent until each piece has at most `most`.
fn halve(mut set: Vec<u32>, rest: &[Vec4], most: usize, pieces: &mut Vec<Vec<u32>>) {
    if set.len() <= most {
        set.sort_unstable();
        pieces.push(set);
        return;
    }
    let [low, high] = cut(set, rest);
    halve(low, rest, most, pieces);
    halve(high, rest, most, pieces);
}

/// The two halves of a set of vertices, across its longest extent.
fn cut(mut set: Vec<u32>, rest: &[Vec4]) -> [Vec<u32>; 2] {
    let at = |vertex: u32| rest[vertex as usize].truncate();
    let (low, high) =
        set.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &v| (low.min(at(v)), high.max(at(v))));
    let axis = (high - low).max_position();
    let middle = set.len() / 2;
    set.select_nth_unstable_by(middle, |&a, &b| at(a)[axis].total_cmp(&at(b)[axis]).then(a.cmp(&b)));
    let half = set.split_off(middle);
    [set, half]
}

impl Source<'_> {
    /// The patch of these vertices, or patches of their halves where it would not fit.
    fn fit(&self, own: Vec<u32>, seen: &mut [bool]) -> Option<Vec<Patch>> {
        if let Some(patch) = self.patch(&own, seen) {
            return Some(vec![patch]);
        }
        if own.len() < 2 {
            return None;
        }
        let mut found = Vec::new();
        for mut half in cut(own, self.rest) {
            half.sort_unstable();
            found.extend(self.fit(half, seen)?);
        }
        Some(found)
    }

    /// A patch with all that its own vertices depend on, if there is room. `seen` is all false before and after.
    fn patch(&self, own: &[u32], seen: &mut [bool]) -> Option<Patch> {
        let mut vertices = own.to_vec();
        vertices.iter().for_each(|&v| seen[v as usize] = true);
        let mut edges = vec![Vec::new(); self.colors.len()];
        for (color, list) in self.colors.iter().zip(&mut edges).rev() {
            for k in 0..vertices.len() {
                let mut around = self.around.of(vertices[k]).iter();
                let Some(&edge) = around.find(|&&edge| color.contains(&(edge as usize))) else { continue };
                list.push(edge);
                for end in self.ends[edge as usize] {
                    if !std::mem::replace(&mut seen[end as usize], true) {
                        vertices.push(end);
                    }
                }
            }
            list.sort_unstable();
            list.dedup();
            if vertices.len() > self.room {
                break;
            }
        }
        vertices.iter().for_each(|&v| seen[v as usize] = false);
        vertices[own.len()..].sort_unstable();
        (vertices.len() <= self.room).then_some(Patch { own: own.len(), vertices, edges })
    }
}
