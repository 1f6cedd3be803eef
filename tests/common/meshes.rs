//! Meshes that expose faults which a regular grid with one diagonal direction would hide. They cover the unit square of
//! the xz-plane, centered and facing up like `Mesh::grid`. Also the folder of real meshes.

use std::path::{Path, PathBuf};

use cloth_deformer::Mesh;
use cloth_deformer::glam::{DVec2, Vec3};

/// `n` x `n` vertices whose cells are cut along alternating diagonals.
pub fn alternating(n: u32) -> Mesh {
    let mut mesh = Mesh::grid(n, n, 1.0, 1.0);
    for (cell, pair) in mesh.triangles.chunks_exact_mut(2).enumerate() {
        let (row, column) = (cell as u32 / (n - 1), cell as u32 % (n - 1));
        if (row + column) % 2 == 1 {
            let [[a, c, b], [_, _, d]] = [pair[0], pair[1]];
            pair.copy_from_slice(&[[a, c, d], [a, d, b]]);
        }
    }
    mesh
}

/// Equilateral triangles of side `1/(n - 1)` m. The mesh is 1 m long in x, and in z has the number of rows that comes
/// nearest to 1 m. Every other row is shifted by half a side and closed at its ends by half triangles.
pub fn equilateral(n: u32) -> Mesh {
    let side = 1.0 / f64::from(n - 1);
    let height = side * 0.75_f64.sqrt();
    let rows = (1.0 / height).round() as u32;
    let mut mesh = Mesh::default();
    let mut last: Vec<u32> = Vec::new();
    for row in 0..=rows {
        let shifted = row % 2 == 1;
        let z = height * (f64::from(row) - 0.5 * f64::from(rows));
        let x = |k: u32| side * (f64::from(k) - if shifted { 0.5 } else { 0.0 }).clamp(0.0, f64::from(n - 1)) - 0.5;
        let first = mesh.positions.len() as u32;
        let count = if shifted { n + 1 } else { n };
        mesh.positions.extend((0..count).map(|k| Vec3::new(x(k) as f32, 0.0, z as f32)));
        let here: Vec<u32> = (first..first + count).collect();
        // The ends of the longer row are the right angles of the half triangles: its vertex k lies between vertices k -
        // 1 and k of the other row.
        for (k, pair) in last.windows(2).enumerate() {
            mesh.triangles.push([pair[0], here[if shifted { k + 1 } else { k.min(here.len() - 1) }], pair[1]]);
        }
        for (k, pair) in here.windows(2).enumerate().filter(|_| row > 0) {
            let above = if shifted { k.min(last.len() - 1) } else { k + 1 };
            mesh.triangles.push([pair[0], pair[1], last[above]]);
        }
        last = here;
    }
    mesh
}

/// `n` x `n` vertices of a grid, of which the inner ones are moved at random by up to 0.3 of the spacing in each
/// direction, with their Delaunay triangulation. Vertices keep the grid's numbering.
pub fn delaunay(n: u32, seed: u64) -> Mesh {
    let mut random = fastrand::Rng::with_seed(seed);
    let spacing = 1.0 / f64::from(n - 1);
    let inside = |k: u32| k > 0 && k < n - 1;
    let points: Vec<DVec2> = (0..n * n)
        .map(|v| {
            let (column, row) = (v % n, v / n);
            let mut jitter = || 0.6 * spacing * (random.f64() - 0.5);
            let moved = if inside(column) && inside(row) { DVec2::new(jitter(), jitter()) } else { DVec2::ZERO };
            DVec2::new(f64::from(column), f64::from(row)) * spacing + moved
        })
        .collect();
    // Counter-clockwise in (x, z) is clockwise as seen from +y.
    let triangles = triangulate(&points).into_iter().map(|[a, b, c]| [a as u32, c as u32, b as u32]).collect();
    let positions = points.iter().map(|p| Vec3::new(p.x as f32 - 0.5, 0.0, p.y as f32 - 0.5)).collect();
    Mesh { positions, triangles }
}

/// The Delaunay triangulation of points in the unit square, counter-clockwise, by incremental insertion (Bowyer 1981,
/// Watson 1981).
fn triangulate(points: &[DVec2]) -> Vec<[usize; 3]> {
    let n = points.len();
    let mut p = points.to_vec();
    // A triangle around all points, large enough that circles through its corners are nearly straight lines at the
    // scale of an edge.
    p.extend([DVec2::new(-100.0, -100.0), DVec2::new(200.0, -100.0), DVec2::new(0.0, 200.0)]);
    let mut triangles = vec![[n, n + 1, n + 2]];
    for i in 0..n {
        let (cavity, rest): (Vec<[usize; 3]>, Vec<_>) = triangles.into_iter().partition(|&t| in_circle(t.map(|v| p[v] - p[i])));
        let sides: Vec<[usize; 2]> = cavity.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]).collect();
        triangles = rest;
        triangles.extend(sides.iter().filter(|[a, b]| !sides.contains(&[*b, *a])).map(|&[a, b]| [a, b, i]));
    }
    triangles.retain(|t| t.iter().all(|&v| v < n));
    triangles
}

/// Whether the origin is inside the circle through three points in counter-clockwise order.
fn in_circle([a, b, c]: [DVec2; 3]) -> bool {
    a.length_squared() * b.perp_dot(c) + b.length_squared() * c.perp_dot(a) + c.length_squared() * a.perp_dot(b) > 0.0
}

/// The folder of real meshes: the one that `CLOTH_MESHES` names, else `../shared/meshes` beside the crate's directory
/// if it exists. Without either, as in a fresh clone, tests make the same assertions about generated meshes, and this
/// function prints a note.
pub fn folder() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os("CLOTH_MESHES") {
        return Some(named.into());
    }
    let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/meshes");
    if !beside.is_dir() {
        eprintln!("CLOTH_MESHES names no folder of OBJ files and there is no ../shared/meshes: testing generated meshes instead");
        return None;
    }
    Some(beside)
}
