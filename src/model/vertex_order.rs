//! A vertex order that keeps neighbors close in memory.

use std::collections::VecDeque;

use crate::model::csr::Csr;

/// An order of the vertices in which neighbors are close: the mesh's own if it has rows or is close, else breadth
/// first. `order[k]` is the mesh's index of the `k`-th vertex. `edges` ascend.
pub(crate) fn vertex_order(edges: &[[u32; 2]], vertices: usize) -> Vec<u32> {
    let own: Vec<u32> = (0..vertices as u32).collect();
    // What lines up can be loaded side by side, which is worth more than a shorter way to the next row. Of a grid that is two thirds
    // at least, whichever way its diagonals run.
    if 5 * lined_up(edges) >= 3 * edges.len() {
        return own;
    }
    let breadth_first = breadth_first(edges, vertices);
    // It must win clearly: some rows may line up.
    if spread(edges, &own) <= 1.5 * spread(edges, &breadth_first) { own } else { breadth_first }
}

/// Edges that have another beside them, one vertex on at both ends.
fn lined_up(edges: &[[u32; 2]]) -> usize {
    let mut others = edges.iter().peekable();
    let beside = |edge: &&[u32; 2]| {
        let next = edge.map(|vertex| vertex + 1);
        while others.next_if(|&&other| other < next).is_some() {}
        others.peek() == Some(&&next)
    };
    edges.iter().filter(beside).count()
}

/// Mean distance in memory between the ends of an edge.
fn spread(edges: &[[u32; 2]], order: &[u32]) -> f64 {
    let rank = inverse(order);
    let total: u64 = edges.iter().map(|&[a, b]| u64::from(rank[a as usize].abs_diff(rank[b as usize]))).sum();
    total as f64 / edges.len().max(1) as f64
}

/// The inverse of a permutation.
pub(crate) fn inverse(order: &[u32]) -> Vec<u32> {
    let mut rank = vec![0; order.len()];
    order.iter().enumerate().for_each(|(place, &vertex)| rank[vertex as usize] = place as u32);
    rank
}

fn breadth_first(edges: &[[u32; 2]], vertices: usize) -> Vec<u32> {
    let neighbors = Csr::new(vertices, edges.iter().flat_map(|&[a, b]| [(a, b), (b, a)]));
    let mut order = Vec::with_capacity(vertices);
    let mut seen = vec![false; vertices];
    let mut queue = VecDeque::new();
    for first in 0..vertices as u32 {
        if !std::mem::replace(&mut seen[first as usize], true) {
            queue.push_back(first);
        }
        while let Some(vertex) = queue.pop_front() {
            order.push(vertex);
            for &next in neighbors.of(vertex) {
                if !std::mem::replace(&mut seen[next as usize], true) {
                    queue.push_back(next);
                }
            }
        }
    }
    order
}

#[cfg(test)]
#[path = "../../tests/unit/model_vertex_order.rs"]
mod tests;
