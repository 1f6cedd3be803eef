//! Traversal: pairs of leaves whose triangles may meet.
//!
//! After [`Tree::refit`] the walk finds all such pairs. After [`Tree::refit_around`] it may leave out what did not change:
//! pairs of leaves that did not move, unless normals of something above them do not rule them out any more.

use super::refit::MOVED;
use super::{DetectionScope, MAX_EXCESS, Tree, in_one_cone};
use crate::contact::workers::Workers;

/// Levels that are traversed before the rest is divided into tasks.
const SHARED_LEVELS: u32 = 5;

/// What a walk finds.
#[derive(Clone, Copy)]
pub(crate) struct Walk<'a> {
    pub scope: DetectionScope,
    /// Whether it finds all pairs, or only those that may be new.
    pub all: bool,
    pub workers: Workers<'a>,
}

/// Two nodes, and whether all pairs below them are to be found.
pub(crate) type Pair = ([u32; 2], bool);

impl Tree {
    /// Finds the pairs of leaves (numbered from 0, the lower first) whose triangles may meet. Their order does not
    /// depend on the number of threads.
    pub(crate) fn walk(&mut self, walk: Walk<'_>, leaves: &mut Vec<[u32; 2]>) {
        let firsts = [1 << self.leaves.depth; 2];
        self.traverse(walk, firsts, leaves, |tree, pair, levels, found| tree.descend(pair, levels, walk.scope, found));
    }

    /// Finds the pairs of a leaf of this tree and a leaf of another (both numbered from 0) whose triangles may meet.
    /// Their order does not depend on the number of threads.
    pub(crate) fn walk_across(&mut self, other: &Tree, walk: Walk<'_>, leaves: &mut Vec<[u32; 2]>) {
        let firsts = [self, other].map(|tree| 1 << tree.leaves.depth);
        self.traverse(walk, firsts, leaves, |tree, pair, levels, found| {
            tree.descend_across(other, pair, levels, walk.scope, found);
        });
    }

    /// Finds pairs of leaves, of which the first ones are the nodes `firsts`: the top levels on this thread, and the rest in
    /// parallel. `descend` finds the pairs that are some levels below a pair, or the leaves if these are closer.
    fn traverse(
        &mut self,
        walk: Walk<'_>,
        [first, other_first]: [u32; 2],
        leaves: &mut Vec<[u32; 2]>,
        descend: impl Fn(&Tree, Pair, u32, &mut Vec<Pair>) + Sync,
    ) {
        let (mut frontier, mut found) = (std::mem::take(&mut self.frontier), std::mem::take(&mut self.found));
        frontier.clear();
        let is_shared = walk.workers.count() > 1;
        descend(self, ([1, 1], walk.all), if is_shared { SHARED_LEVELS } else { u32::MAX }, &mut frontier);
        let part = walk.workers.small_part(frontier.len());
        let tasks = if is_shared { frontier.len().div_ceil(part) } else { 0 };
        found.resize_with(tasks.max(found.len()), Vec::new);
        walk.workers.each(found[..tasks].iter_mut().zip(frontier.chunks(part)), |(found, pairs)| {
            found.clear();
            pairs.iter().for_each(|&pair| descend(self, pair, u32::MAX, found));
        });
        let above = if is_shared { &[] } else { frontier.as_slice() };
        let pairs = found[..tasks].iter().flatten().chain(above);
        leaves.extend(pairs.map(|([a, b], _)| [a - first, b - other_first]));
        (self.frontier, self.found) = (frontier, found);
    }

    /// Pairs of nodes of two trees that may meet, at most `levels` below the given pair.
    fn descend_across(&self, other: &Tree, (pair, all): Pair, levels: u32, scope: DetectionScope, found: &mut Vec<Pair>) {
        let [a, b] = pair;
        let is_new = || (self.marks[a as usize] | other.marks[b as usize]) & MOVED != 0;
        if !all && !is_new() || self.nodes[a as usize].is_apart(&other.nodes[b as usize], scope.thickness, scope.substeps) {
            return;
        }
        let (is_leaf, is_other_leaf) = (a >> self.leaves.depth != 0, b >> other.leaves.depth != 0);
        if levels == 0 || is_leaf && is_other_leaf {
            return found.push((pair, all));
        }
        let children = |node: u32, is_leaf: bool| if is_leaf { node..node + 1 } else { 2 * node..2 * node + 2 };
        for a in children(a, is_leaf) {
            for b in children(b, is_other_leaf) {
                self.descend_across(other, ([a, b], all), levels - 1, scope, found);
            }
        }
    }

    /// Pairs of nodes of one level that may meet, at most `levels` below the given pair.
    fn descend(&self, (pair, mut all): Pair, levels: u32, scope: DetectionScope, found: &mut Vec<Pair>) {
        let [a, b] = pair;
        let marks = || self.marks[a as usize] | self.marks[b as usize];
        let here = a.ilog2();
        if !all && marks() == 0 || self.is_clear(pair, here, scope) {
            return;
        }
        all = all || self.were_in_one_cone(pair, here);
        if here == self.leaves.depth && !all && marks() & MOVED == 0 {
            return;
        }
        if levels == 0 || here == self.leaves.depth {
            return found.push((pair, all));
        }
        let [a0, a1, b0, b1] = [2 * a, 2 * a + 1, 2 * b, 2 * b + 1];
        let pairs: &[[u32; 2]] = if a == b { &[[a0, a0], [a1, a1], [a0, a1]] } else { &[[a0, b0], [a0, b1], [a1, b0], [a1, b1]] };
        pairs.iter().for_each(|&pair| self.descend((pair, all), levels - 1, scope, found));
    }

    /// Whether two nodes, or a node and itself, certainly do not meet. Besides distance, it uses that connected cloth
    /// whose normals are all within a cone, and which is nearly flat, does not meet itself. The normals include those of all
    /// triangles around the nodes' vertices: without one of them a node has a notch, whose sides meet if it turns over.
    fn is_clear(&self, [a, b]: [u32; 2], level: u32, scope: DetectionScope) -> bool {
        let (one, other) = (&self.nodes[a as usize], &self.nodes[b as usize]);
        a != b && one.is_apart(other, scope.thickness, scope.substeps)
            || self.is_flat([a, b], level) && in_one_cone(one.join(other).normal)
    }

    /// Whether normals ruled out two nodes before they were refitted in part.
    fn were_in_one_cone(&self, [a, b]: [u32; 2], level: u32) -> bool {
        let [one, other] = [a, b].map(|node| self.before[node as usize]);
        self.is_flat([a, b], level) && in_one_cone([one[0].min(other[0]), one[1].max(other[1])])
    }

    /// Whether two nodes, or a node and itself, are connected and nearly flat at rest.
    fn is_flat(&self, [a, b]: [u32; 2], level: u32) -> bool {
        let excess = self.excess[a as usize] + if a == b { 0.0 } else { self.excess[b as usize] };
        let is_beside = || self.beside[level as usize].of(a - (1 << level)).binary_search(&(b - (1 << level))).is_ok();
        excess < MAX_EXCESS && (a == b || is_beside())
    }
}
