//! Unit tests of `src/model/vertex_order.rs`.

use super::*;
use crate::Mesh;

#[test]
fn breadth_first_brings_shuffled_neighbors_together() {
    let mesh = Mesh::grid(30, 30, 1.0, 1.0);
    let mut names: Vec<u32> = (0..900).collect();
    fastrand::Rng::with_seed(3).shuffle(&mut names);
    let edges: Vec<[u32; 2]> = mesh.edges().iter().map(|edge| edge.map(|vertex| names[vertex as usize])).collect();
    let order = vertex_order(&edges, 900);
    let mut sorted = order.clone();
    sorted.sort_unstable();
    assert!(sorted.into_iter().eq(0..900), "a permutation");
    let own: Vec<u32> = (0..900).collect();
    assert!(spread(&edges, &order) < 0.2 * spread(&edges, &own));
    assert_eq!(vertex_order(&mesh.edges(), 900), own, "a grid keeps its rows");
}

/// A mesh made of rows keeps its order, however long the rows are.
#[test]
fn rows_keep_their_order() {
    let mesh = Mesh::grid(90, 4, 1.0, 1.0);
    assert_eq!(vertex_order(&mesh.edges(), 360), (0..360).collect::<Vec<_>>());
    // With every other diagonal reversed.
    let squares = (0..3).flat_map(|row| (0..89).map(move |column| (row * 90 + column, (row + column) % 2 == 0)));
    let crossed = squares.flat_map(|(a, other)| {
        let [b, c, d] = [a + 1, a + 90, a + 91];
        if other { [[a, c, d], [a, d, b]] } else { [[a, c, b], [b, c, d]] }
    });
    let crossed = Mesh { triangles: crossed.collect(), ..mesh.clone() };
    assert_eq!(vertex_order(&crossed.edges(), 360), (0..360).collect::<Vec<_>>());
    // Two grids in one mesh.
    let mut two = mesh.clone();
    two.triangles.extend(two.triangles.clone().iter().map(|corners| corners.map(|vertex| vertex + 361)));
    // The vertex between them has no edges, so it comes last.
    let joined = (0..360).chain(361..721).chain([360]);
    assert_eq!(vertex_order(&two.edges(), 721), joined.collect::<Vec<_>>());
}
