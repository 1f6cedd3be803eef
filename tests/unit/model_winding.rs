//! A mesh with turned triangles is wound as it was before they were turned.

use super::wind_alike;
use crate::model::mesh::{Mesh, edges};

fn wound(mut triangles: Vec<[u32; 3]>, vertices: usize) -> Vec<[u32; 3]> {
    let edges = edges(&triangles);
    wind_alike(&mut triangles, &edges, vertices);
    triangles
}

fn with_turned(mesh: &Mesh, is_turned: impl Fn(usize) -> bool) -> Vec<[u32; 3]> {
    let turn = |(k, &[a, b, c]): (usize, &[u32; 3])| if is_turned(k) { [a, c, b] } else { [a, b, c] };
    mesh.triangles.iter().enumerate().map(turn).collect()
}

#[test]
fn turned_triangles_are_turned_back() {
    let grid = Mesh::grid(9, 7, 1.0, 1.0);
    let vertices = grid.positions.len();
    for is_turned in [|_| false, |k| k % 3 == 0, |k| k < 40, |k| k == 0] {
        assert_eq!(wound(with_turned(&grid, is_turned), vertices), grid.triangles);
    }
    // Where most are turned, the others are turned, too.
    let all = with_turned(&grid, |_| true);
    assert_eq!(wound(with_turned(&grid, |k| k > 10), vertices), all);
}

#[test]
fn parts_are_wound_by_themselves_and_three_triangles_at_an_edge_are_left() {
    let two = vec![[0, 1, 2], [3, 5, 4], [3, 5, 6]];
    assert_eq!(wound(two, 7), [[0, 1, 2], [3, 5, 4], [3, 6, 5]]);
    let book = vec![[0, 1, 2], [0, 1, 3], [1, 0, 4]];
    assert_eq!(wound(book.clone(), 5), book);
    let twice = vec![[0, 1, 2], [0, 1, 2]];
    assert_eq!(wound(twice.clone(), 3), twice);
}
