//! Unit tests of `src/model/coloring.rs`.

use super::*;
use crate::Mesh;

fn check(edges: &[[u32; 2]], positions: &[Vec3]) -> usize {
    let coloring = color(edges, positions);
    assert_eq!(coloring.of.len(), edges.len(), "every edge has one color");
    let mut seen = std::collections::HashSet::new();
    for (edge, &color) in edges.iter().zip(&coloring.of) {
        assert!((color as usize) < coloring.colors);
        edge.iter().for_each(|&vertex| assert!(seen.insert((vertex, color)), "vertex {vertex} has color {color} twice"));
    }
    let again = color(edges, positions);
    assert_eq!(again.of, coloring.of, "the same mesh gives the same colors");
    coloring.colors
}

#[test]
fn a_grid_takes_as_many_colors_as_its_degree() {
    for (columns, rows) in [(2, 2), (3, 5), (33, 33), (64, 17)] {
        let mesh = Mesh::grid(columns, rows, 1.0, 1.0);
        let edges = mesh.edges();
        assert_eq!(check(&edges, &mesh.positions), max_degree(&edges, mesh.positions.len()), "{columns} x {rows}");
    }
}

/// For either direction of the diagonals, all edges of one direction between two rows have the same color.
#[test]
fn rows_of_a_grid_have_one_color() {
    let (columns, rows) = (20, 13);
    let mut mesh = Mesh::grid(columns, rows, 1.0, 1.0);
    for mirrored in [false, true] {
        if mirrored {
            // Mirrors each row.
            let name = |v: u32| v / columns * columns + (columns - 1 - v % columns);
            mesh.triangles.iter_mut().flatten().for_each(|v| *v = name(*v));
            let positions = mesh.positions.clone();
            (0..columns * rows).for_each(|v| mesh.positions[name(v) as usize] = positions[v as usize]);
        }
        let edges = mesh.edges();
        let coloring = color(&edges, &mesh.positions);
        assert_eq!(coloring.colors, 6);
        let mut color_of = std::collections::HashMap::new();
        for (edge, color) in edges.iter().zip(&coloring.of).filter(|(edge, _)| edge[1] - edge[0] > 1) {
            let row = (edge[0] / columns, edge[1] - edge[0]);
            assert_eq!(color_of.entry(row).or_insert(color), &color, "mirrored {mirrored}: {edge:?}");
        }
    }
}

#[test]
fn opposite_edges_of_a_grid_are_visited_one_after_the_other() {
    let mesh = Mesh::grid(9, 9, 1.0, 1.0);
    let edges = mesh.edges();
    let coloring = color(&edges, &mesh.positions);
    // Vertex offsets of 1, 9 and 8 are the grid's three directions; each has two colors of its own, including at the
    // border.
    let mut pairs = [1, 9, 8].map(|step| {
        let along = edges.iter().zip(&coloring.of).filter(|([a, b], _)| b - a == step);
        let colors: std::collections::BTreeSet<u32> = along.map(|(_, &color)| color).collect();
        assert_eq!(colors.len(), 2, "step {step} has the colors {colors:?}");
        colors.into_iter().collect::<Vec<_>>()
    });
    pairs.sort();
    assert_eq!(pairs, [[0, 1], [2, 3], [4, 5]]);
}

/// Scaling by a power of two is exact, down to lengths whose squares underflow in single precision, so no direction may
/// change.
#[test]
fn a_mesh_of_any_size_has_the_same_colors() {
    let mesh = Mesh::grid(20, 13, 1.0, 0.7);
    let mut random = fastrand::Rng::with_seed(5);
    let around = || Vec3::from_array([0; 3].map(|_: i32| (random.f32() - 0.5) * 2_f32.powi(12)).map(f32::round));
    let star: Vec<Vec3> = std::iter::repeat_with(around).take(200).collect();
    let spokes: Vec<[u32; 2]> = (1..200).map(|rim| [0, rim]).collect();
    for (edges, positions) in [(mesh.edges(), mesh.positions), (spokes, star)] {
        let expected = color(&edges, &positions).of;
        for power in -115..=40 {
            let scaled: Vec<Vec3> = positions.iter().map(|&x| x * 2_f32.powi(power)).collect();
            assert!(color(&edges, &scaled).of == expected, "2^{power}");
        }
    }
}

#[test]
fn a_fan_of_a_hundred_edges_needs_a_hundred_colors() {
    let edges: Vec<[u32; 2]> = (1..=100).map(|rim| [0, rim]).collect();
    assert_eq!(check(&edges, &[Vec3::ZERO; 101]), 100);
}

/// Fans with one hub and with two, numbered first and last: the number of colors hardly exceeds the degree, and
/// coloring takes only a moment.
#[test]
fn a_fan_of_very_many_edges_is_colored_at_once() {
    let rim = 200_000;
    let x = |k: u32| Vec3::new((k as f32 * 1e-4).cos(), 0.0, (k as f32 * 1e-4).sin());
    let around: Vec<[u32; 2]> = (1..rim).map(|k| [k, k + 1]).collect();
    for hubs in [&[0][..], &[rim + 1], &[0, rim + 1]] {
        let spokes = hubs.iter().flat_map(|&hub| (1..=rim).map(move |k| [hub.min(k), hub.max(k)]));
        let mut edges: Vec<[u32; 2]> = around.iter().copied().chain(spokes).collect();
        edges.sort_unstable();
        let positions: Vec<Vec3> = (0..rim + 2).map(|k| if (1..=rim).contains(&k) { x(k) } else { Vec3::ZERO }).collect();
        let colors = check(&edges, &positions);
        assert!((rim as usize..=rim as usize + 4).contains(&colors), "{hubs:?}: {colors} colors");
    }
}

#[test]
fn random_graphs_stay_within_first_fits_bound() {
    let mut random = fastrand::Rng::with_seed(7);
    for vertices in [2, 10, 100] {
        let mut edges: Vec<[u32; 2]> =
            (0..5 * vertices).map(|_| [random.u32(0..vertices), random.u32(0..vertices)]).filter(|[a, b]| a < b).collect();
        edges.sort_unstable();
        edges.dedup();
        let positions: Vec<Vec3> = (0..vertices).map(|_| Vec3::from_array([0; 3].map(|_: i32| random.f32()))).collect();
        let degree = max_degree(&edges, vertices as usize);
        assert!(check(&edges, &positions) < 2 * degree.max(1));
    }
}

/// Edges that are to be first are, and a part without such edges is colored as if it were alone.
#[test]
fn some_edges_come_first() {
    let sheet = Mesh::grid(9, 7, 1.0, 1.0);
    let (count, alone) = (sheet.positions.len() as u32, sheet.edges());
    let positions: Vec<Vec3> = sheet.positions.iter().chain(&sheet.positions).copied().collect();
    let edges: Vec<[u32; 2]> = alone.iter().copied().chain(alone.iter().map(|ends| ends.map(|end| end + count))).collect();
    let is_diagonal = |ends: &[u32; 2]| ends[0] >= count && !matches!(ends[1] - ends[0], 1 | 9);
    let are_first: Vec<bool> = edges.iter().map(is_diagonal).collect();
    let found = color_in_turn(&edges, &positions, &are_first);
    let mut seen = std::collections::HashSet::new();
    for (edge, &color) in edges.iter().zip(&found.of) {
        edge.iter().for_each(|&vertex| assert!(seen.insert((vertex, color)), "vertex {vertex} has color {color} twice"));
    }
    assert_eq!(found.of[..alone.len()], color(&alone, &sheet.positions).of);
    let colors = |first: bool| {
        (alone.len()..edges.len()).filter(|&edge| are_first[edge] == first).map(|edge| found.of[edge]).collect::<Vec<_>>()
    };
    assert!(colors(true).iter().max() < colors(false).iter().min());
}
