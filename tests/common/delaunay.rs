//! The unit square in the xz-plane, centred and front up like `Mesh::grid`, triangulated in other ways.

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

/// `n` x `n` vertices, those inside moved at random by up to 0.3 of the spacing either way: Delaunay's triangulation.
/// Vertices keep the grid's numbers.
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
    // Counter-clockwise in (x, z) is clockwise seen from +y.
    let triangles = triangulate(&points).into_iter().map(|[a, b, c]| [a as u32, c as u32, b as u32]).collect();
    let positions = points.iter().map(|p| Vec3::new(p.x as f32 - 0.5, 0.0, p.y as f32 - 0.5)).collect();
    Mesh { positions, triangles }
}

/// Delaunay's triangulation of points in the unit square, counter-clockwise: a point at a time (Bowyer 1981, Watson 1981).
fn triangulate(points: &[DVec2]) -> Vec<[usize; 3]> {
    let n = points.len();
    let mut p = points.to_vec();
    // A triangle around all, far enough that its circles are straight lines at the scale of an edge.
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
