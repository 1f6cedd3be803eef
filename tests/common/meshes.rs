//! Meshes that a grid's one diagonal would hide a fault from, on the unit square of the xz-plane, their front up (+y).

use cloth_deformer::Mesh;
use cloth_deformer::glam::{DVec2, Vec3};

/// A square of n x n vertices whose diagonals alternate like a chessboard: vertices have four or eight neighbours.
pub(crate) fn alternating(n: u32) -> Mesh {
    let positions = Mesh::grid(n, n, 1.0, 1.0).positions;
    let cells = (1..n).flat_map(|row| (1..n).map(move |column| (column, row)));
    let split = |(column, row): (u32, u32)| {
        let d = row * n + column;
        let (a, b, c) = (d - n - 1, d - n, d - 1);
        if (row + column) % 2 == 0 { [[a, c, b], [b, c, d]] } else { [[a, c, d], [a, d, b]] }
    };
    Mesh { positions, triangles: cells.flat_map(split).collect() }
}

/// Equilateral triangles of side `1/(n - 1)` m: 1 m along x, along z the whole number of rows nearest to 1 m. Every other
/// row is shifted by half a side, and its ends are closed by half triangles.
pub(crate) fn equilateral(n: u32) -> Mesh {
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
        // The longer row's ends are the half triangles' right angles: its vertex k lies between k - 1 and k of the other.
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

/// The Delaunay triangulation of n x n points: a grid's, moved at random by up to a third of a cell each way, on the border
/// along the border only.
pub(crate) fn delaunay(n: u32, seed: u64) -> Mesh {
    let mut random = fastrand::Rng::with_seed(seed);
    let mut along = |k: u32| {
        let shift = if k == 0 || k == n - 1 { 0.0 } else { (random.f64() * 2.0 - 1.0) / 3.0 };
        (f64::from(k) + shift) / f64::from(n - 1) - 0.5
    };
    let mut points: Vec<DVec2> =
        [(0, 0), (0, n - 1), (n - 1, 0), (n - 1, n - 1)].map(|(x, z)| DVec2::new(along(x), along(z))).into();
    let is_corner = |x: u32, z: u32| (x == 0 || x == n - 1) && (z == 0 || z == n - 1);
    let others = (0..n).flat_map(|z| (0..n).map(move |x| (x, z))).filter(|&(x, z)| !is_corner(x, z));
    points.extend(others.map(|(x, z)| DVec2::new(along(x), along(z))));
    // Bowyer and Watson (1981): each point replaces the triangles whose circumcircle holds it. All points lie in the square
    // of the first four, so no larger triangle has to be added and taken away again.
    let mut triangles = vec![[0, 1, 2], [2, 1, 3]];
    for p in 4..points.len() {
        let mut sides = Vec::new();
        triangles.retain(|&[a, b, c]: &[usize; 3]| {
            let hit = in_circle([a, b, c].map(|v| points[v]), points[p]);
            sides.extend([[a, b], [b, c], [c, a]].into_iter().filter(|_| hit));
            !hit
        });
        for &[a, b] in sides.iter().filter(|[a, b]| !sides.contains(&[*b, *a])) {
            // A point on the border does not make a triangle with the piece of border it lies on.
            if turn(points[a], points[b], points[p]) > 1e-12 {
                triangles.push([a, b, p]);
            }
        }
    }
    Mesh {
        positions: points.iter().map(|p| Vec3::new(p.x as f32, 0.0, p.y as f32)).collect(),
        triangles: triangles.iter().map(|t| t.map(|v| v as u32)).collect(),
    }
}

/// Twice the signed area of a triangle in the xz-plane; above 0 if its front is up.
fn turn(a: DVec2, b: DVec2, c: DVec2) -> f64 {
    -(b - a).perp_dot(c - a)
}

/// Whether `p` is inside the circle through the corners of a triangle whose front is up.
fn in_circle([a, b, c]: [DVec2; 3], p: DVec2) -> bool {
    let [a, b, c] = [a - p, b - p, c - p];
    let lift = |q: DVec2, r: DVec2, s: DVec2| q.length_squared() * r.perp_dot(s);
    -(lift(a, b, c) + lift(b, c, a) + lift(c, a, b)) > 0.0
}
