//! What belongs to all active pairs, besides the groups that they are in.

use glam::Vec4;

use super::vertex_pairs::VertexPairs;
use crate::contact::contacts::near::group::{Group, Weights};
use crate::contact::contacts::near::portions::Portion;
use crate::contact::input::Vertex;
use crate::contact::ranges::Ranges;
use crate::contact::workers::Workers;
use crate::kernels::pair::Kind;
use crate::simd::MAX_LANES;

/// What belongs to the active pairs. These are in groups, in the portions of the lists.
#[derive(Debug, Default)]
pub(crate) struct Acting {
    /// For each group the impulses (kg m) of its pairs from the last iteration of the multipliers, the corrections of
    /// positions, and the weights of each corner, 0 for pairs that do not act in this substep. Weights have one more
    /// group, of zeros.
    pub impulses: Vec<[Vec4; MAX_LANES]>,
    pub pushes: Vec<[Vec4; MAX_LANES]>,
    pub weights: Vec<Weights>,
    /// The pairs of each vertex, in ranges of vertices.
    pub vertex_pairs: Vec<VertexPairs>,
    pub ranges: Ranges,
    /// For each vertex its inverse mass (1/kg) times the sum of its weights.
    pub mobility: Vec<f32>,
}

impl Acting {
    /// Numbers the groups of portions.
    pub(crate) fn number(&mut self, portions: &mut [Portion]) {
        let mut count = 0;
        for portion in portions {
            portion.before = count;
            count += portion.groups.len();
        }
        self.impulses.resize(count, [Vec4::ZERO; MAX_LANES]);
        self.pushes.resize(count, [Vec4::ZERO; MAX_LANES]);
        self.weights.clear();
        self.weights.resize(count + 1, Weights::default());
    }

    /// Takes over the weights of vertices in their pairs; first collects these pairs if they have changed.
    pub(crate) fn weigh(&mut self, portions: &[Portion], have_changed: bool, vertices: &mut [Vertex], workers: Workers<'_>) {
        let Acting { weights, ranges, vertex_pairs, mobility, .. } = self;
        let (ranges, weights) = (*ranges, &**weights);
        vertex_pairs.resize_with(vertex_pairs.len().max(ranges.count), VertexPairs::default);
        mobility.resize(vertices.len(), 0.0);
        let parts = vertices.chunks_mut(ranges.len()).zip(mobility.chunks_mut(ranges.len())).zip(vertex_pairs).enumerate();
        workers.each(parts, |(range, ((vertices, mobility), vertex_pairs))| {
            if have_changed {
                vertex_pairs.collect(portions, ranges, range, vertices.len());
            }
            vertex_pairs.weigh(weights, |vertex, weight| {
                // The last slice may have places left.
                if let (Some(vertex), Some(mobility)) = (vertices.get_mut(vertex), mobility.get_mut(vertex)) {
                    (vertex.weight, *mobility) = (weight, vertex.x.w * weight);
                }
            });
        });
    }
}

/// Consecutive groups of a kind, in portions, with what belongs to each group.
struct Groups<'a, A, B> {
    kind: Kind,
    /// The number of groups before them.
    before: usize,
    /// Groups of the first portion whose other groups are elsewhere, whole portions, and groups of the next portion.
    head: &'a mut [Group],
    portions: &'a mut [Portion],
    tail: &'a mut [Group],
    a: &'a mut [A],
    b: &'a mut [B],
}

impl<'a, A, B> Groups<'a, A, B> {
    fn count(&self) -> usize {
        self.head.len() + self.portions.iter().map(|portion| portion.groups.len()).sum::<usize>()
    }

    /// Takes at most so many groups off the front; there must be no tail.
    fn take(&mut self, most: usize) -> Groups<'a, A, B> {
        let mut left = most;
        let head = self.head.split_off_mut(..left.min(self.head.len())).unwrap_or_default();
        left -= head.len();
        let within = |portion: &&Portion| {
            let rest = left.checked_sub(portion.groups.len());
            left = rest.unwrap_or(left);
            rest.is_some()
        };
        let whole = self.portions.iter().take_while(within).count();
        let portions = self.portions.split_off_mut(..whole).unwrap_or_default();
        let mut tail = &mut [][..];
        if left > 0
            && let Some(portion) = self.portions.split_off_first_mut()
        {
            (tail, self.head) = portion.groups.split_at_mut(left);
            left = 0;
        }
        let (kind, before, count) = (self.kind, self.before, most - left);
        self.before += count;
        let a = self.a.split_off_mut(..count.min(self.a.len())).unwrap_or_default();
        let b = self.b.split_off_mut(..count.min(self.b.len())).unwrap_or_default();
        Groups { kind, before, head, portions, tail, a, b }
    }

    /// Calls `work` with groups that are one after another in memory, and what belongs to them.
    fn each(self, work: impl Fn(Kind, usize, &mut [Group], &mut [A], &mut [B])) {
        let Groups { kind, mut before, head, portions, tail, mut a, mut b } = self;
        let middle = portions.iter_mut().map(|portion| &mut portion.groups[..]);
        for groups in std::iter::once(head).chain(middle).chain([tail]).filter(|groups| !groups.is_empty()) {
            let count = groups.len();
            let of_a = a.split_off_mut(..count.min(a.len())).unwrap_or_default();
            work(kind, before, groups, of_a, b.split_off_mut(..count.min(b.len())).unwrap_or_default());
            before += count;
        }
    }
}

/// Calls `work(kind, before, groups, a, b)` for the groups of portions and their parts of two arrays that have an item for each
/// group (or none). Each thread has the same share of the groups of either kind, whose first features are about those of its
/// range of vertices.
pub(crate) fn for_groups<A: Send, B: Send>(
    portions: &mut [Portion],
    (a, b): (&mut [A], &mut [B]),
    workers: Workers<'_>,
    work: &(impl Fn(Kind, usize, &mut [Group], &mut [A], &mut [B]) + Sync),
) {
    let first = portions.partition_point(|portion| portion.kind == Kind::VertexTriangle);
    let (portions, others) = portions.split_at_mut(first);
    // Portions that were added since the groups were numbered have none.
    let before = portions.iter().map(|portion| portion.groups.len()).sum::<usize>();
    let all = |kind, portions, a, b, before| Groups { kind, before, head: &mut [], portions, tail: &mut [], a, b };
    let (a, other_a) = a.split_at_mut(before.min(a.len()));
    let (b, other_b) = b.split_at_mut(before.min(b.len()));
    let mut left = [all(Kind::VertexTriangle, portions, a, b, 0), all(Kind::EdgeEdge, others, other_a, other_b, before)];
    let counts = left.each_ref().map(Groups::count);
    let parts = (0..workers.count()).map(|part| {
        let mut counts = counts.iter().map(|count| workers.share(part, *count));
        left.each_mut().map(|left| left.take(counts.next().unwrap_or(0)))
    });
    workers.each(parts, |parts| parts.into_iter().for_each(|groups| groups.each(work)));
}

#[cfg(test)]
#[path = "../../../tests/unit/contact_acting.rs"]
mod tests;
