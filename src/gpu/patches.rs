//! Patches: the cloth cut into pieces that a workgroup's memory holds, each with all that its own vertices depend on.
//!
//! A sweep visits the edges colour after colour. Walked backwards from a patch's own vertices, a vertex that is needed
//! after a colour needs, before it, the other end of its edge of that colour. What is gathered so ("halo") is a few rings
//! wide, and computing it in every patch that needs it is cheaper than a dispatch a colour: on a device whose dispatches
//! cost 2 us each, five to eight times.

use std::ops::Range;

use glam::{Vec3, Vec4};
use rayon::prelude::*;

use crate::kernels::Edge;
use crate::model::csr::Csr;

/// What `table.wgsl` calls none, of edges and of labels.
pub(super) const NO_EDGE: u32 = u32::MAX;

/// Patches as `table.wgsl` reads them.
#[derive(Debug, Clone)]
pub(crate) struct Patches {
    /// For each patch how many vertices are its own; then for each its vertices, its own first, in [`Patches::largest`]
    /// words, filled up with its first; then for each the aggregates of those; then for each and each colour its edges, in [`Patches::widest`] words each all ends
    /// as a pair of places among the patch's vertices, all inverse lengths, all inverse weights.
    pub table: Vec<u32>,
    pub count: usize,
    pub colors: usize,
    /// Most vertices that a patch holds, and most edges of a colour.
    pub largest: usize,
    pub widest: usize,
    /// Edges of all patches, those of halos in each that has them.
    pub swept: usize,
    /// Where in the table the edges start; the cloth's edge that each word stands for.
    edges: usize,
    sources: Vec<u32>,
}

/// How large patches may be.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cut {
    /// Vertices of its own that a patch has at most, and that it may hold.
    pub own: usize,
    pub room: usize,
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
    around: Csr<u32>,
    /// Vertices that a patch may hold.
    room: usize,
}

impl Patches {
    /// Cuts the cloth into patches. `None` if that cannot be done, as for a fan of many edges, or not be done well.
    pub(crate) fn new(rest: &[Vec4], ends: &[[u32; 2]], colors: &[Range<usize>], most: Cut) -> Option<Patches> {
        let pairs = ends.iter().enumerate().flat_map(|(edge, &[a, b])| [(a, edge as u32), (b, edge as u32)]);
        let around = Csr::new(rest.len(), pairs);
        let room = most.room.min(1 << 16);
        let source = Source { rest, ends, colors, around, room };
        let mut pieces = Vec::new();
        halve((0..rest.len() as u32).collect(), rest, most.own.min(room).max(1), &mut pieces);
        let seen = || vec![false; rest.len()];
        let patches: Option<Vec<Vec<Patch>>> = pieces.into_par_iter().map_init(seen, |seen, own| source.fit(own, seen)).collect();
        let patches: Vec<Patch> = patches?.into_iter().flatten().collect();
        let held: usize = patches.iter().map(|patch| patch.vertices.len()).sum();
        // So much recomputed is no gain any more.
        (held <= 16 * rest.len().max(256)).then(|| Patches::lay_out(&patches, ends, colors.len()))
    }

    fn lay_out(patches: &[Patch], ends: &[[u32; 2]], colors: usize) -> Patches {
        let count = patches.len();
        let largest = patches.iter().map(|patch| patch.vertices.len()).max().unwrap_or(0);
        let widest = patches.iter().flat_map(|patch| &patch.edges).map(Vec::len).max().unwrap_or(0);
        let edges = count * (1 + 2 * largest);
        let words = count * colors * 3 * widest;
        let mut table = vec![NO_EDGE; edges + words];
        let mut sources = vec![NO_EDGE; words];
        let mut place = vec![0; ends.iter().flatten().max().map_or(0, |&last| last as usize + 1)];
        for (index, patch) in patches.iter().enumerate() {
            table[index] = patch.own as u32;
            let list = &mut table[count + index * largest..][..largest];
            list.fill(patch.vertices[0]);
            list[..patch.vertices.len()].copy_from_slice(&patch.vertices);
            for (k, &vertex) in patch.vertices.iter().enumerate() {
                // A vertex without edges may lie beyond the last that has one.
                place.get_mut(vertex as usize).into_iter().for_each(|place| *place = k as u32);
            }
            for (color, list) in patch.edges.iter().enumerate() {
                let start = 3 * widest * (index * colors + color);
                for (k, &edge) in list.iter().enumerate() {
                    let [a, b] = ends[edge as usize].map(|vertex| place[vertex as usize]);
                    table[edges + start + k] = a | b << 16;
                    sources[start + widest + k] = edge;
                    sources[start + 2 * widest + k] = edge;
                }
            }
        }
        let swept = patches.iter().flat_map(|patch| &patch.edges).map(Vec::len).sum();
        Patches { table, count, colors, largest, widest, swept, edges, sources }
    }

    /// Bytes that a sweep reads: the table, and two vectors for each vertex held.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.table.as_slice()) + 32 * self.count * self.largest
    }

    /// Fills in the aggregates that the vertices are in, and names the vertices anew, as numbers from `base` on.
    pub(crate) fn set_labels(&mut self, labels: impl Fn(u32) -> u32, base: u32) {
        let (_, lists) = self.table[..self.edges].split_at_mut(self.count);
        let (vertices, named) = lists.split_at_mut(self.count * self.largest);
        for (vertex, label) in vertices.iter_mut().zip(named) {
            *label = labels(*vertex);
            *vertex += base;
        }
    }

    /// Fills in the edges' numbers; returns where in the table (in words) they start.
    pub(crate) fn set_edges(&mut self, edges: &[Edge]) -> usize {
        let width = self.widest.max(1);
        let lists = self.table[self.edges..].chunks_mut(width).zip(self.sources.chunks(width)).enumerate();
        for (list, (words, sources)) in lists.filter(|(list, _)| list % 3 > 0) {
            for (word, &source) in words.iter_mut().zip(sources) {
                let Some(edge) = edges.get(source as usize) else { continue };
                *word = if list % 3 == 1 { edge.inverse_rest } else { edge.inverse_weight }.to_bits();
            }
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
    let (low, high) = set.iter().fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), &v| (low.min(at(v)), high.max(at(v))));
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
