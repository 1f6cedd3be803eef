//! Vertex orders that keep neighbors close in memory, and vertices without edges out of the way.

use std::collections::VecDeque;

use crate::model::csr::Csr;
use crate::model::mesh::has_edges;

/// An order of the vertices in which neighbors are close: the mesh's own if it consists of rows or is good enough, else
/// breadth-first. Vertices without edges come last. `order[k]` is the mesh's index of the `k`-th vertex. `edges` must be sorted.
pub(crate) fn vertex_order(edges: &[[u32; 2]], vertices: usize) -> Vec<u32> {
    let has_edges = has_edges(edges, vertices);
    let (mut own, without): (Vec<u32>, Vec<u32>) = (0..vertices as u32).partition(|&vertex| has_edges[vertex as usize]);
    own.extend(without);
    // Edges that line up can be processed by contiguous loads, which is worth more than a shorter distance to the next
    // row. On a grid at least two thirds of the edges do, whichever way its diagonals run.
    if 5 * lined_up(edges) >= 3 * edges.len() {
        return own;
    }
    let breadth_first = breadth_first(edges, &own);
    // The breadth-first order must be clearly better, because part of the mesh's own order may line up.
    if spread(edges, &own) <= 1.5 * spread(edges, &breadth_first) { own } else { breadth_first }
}

/// Number of edges for which the edge one vertex further on at both ends exists too.
fn lined_up(edges: &[[u32; 2]]) -> usize {
    let mut others = edges.iter().peekable();
    let beside = |edge: &&[u32; 2]| {
        let next = edge.map(|vertex| vertex + 1);
        while others.next_if(|&&other| other < next).is_some() {}
        others.peek() == Some(&&next)
    };
    edges.iter().filter(beside).count()
}

/// Mean index distance between the ends of an edge.
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

/// Each connected part breadth-first from its first vertex in `own`, which is an order, too.
fn breadth_first(edges: &[[u32; 2]], own: &[u32]) -> Vec<u32> {
    let vertices = own.len();
    let neighbors = Csr::new(vertices, edges.iter().flat_map(|&[a, b]| [(a, b), (b, a)]));
    let mut order = Vec::with_capacity(vertices);
    let mut seen = vec![false; vertices];
    let mut queue = VecDeque::new();
    for &first in own {
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
