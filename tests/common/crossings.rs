//! Counts edges that pass through triangles, in double precision and independently: nothing here is shared with the
//! solver, not even the list of edges.

use std::collections::{BTreeMap, BTreeSet};

use cloth_deformer::glam::{DVec3, Vec3};
use cloth_deformer::{Collider, Mesh, Shape};

/// Pairs of an edge and a triangle that intersect and share no vertex. `x` are the vertices' positions (m).
pub fn crossings(mesh: &Mesh, x: &[Vec3]) -> Vec<([u32; 2], [u32; 3])> {
    let x: Vec<DVec3> = x.iter().map(|x| x.as_dvec3()).collect();
    let at = |v: u32| x[v as usize];
    let mut edges = BTreeSet::new();
    for &[a, b, c] in &mesh.triangles {
        edges.extend([[a, b], [b, c], [c, a]].map(|[i, j]| [i.min(j), i.max(j)]));
    }
    let lengths = || edges.iter().map(|&[i, j]| at(i).distance(at(j)));
    let (mean, longest) = (lengths().sum::<f64>() / edges.len() as f64, lengths().fold(0.0, f64::max));
    // Few long edges, as those of a capsule, do not make all cells large.
    let width = mean.max(0.01 * longest).max(1e-9);
    let cell = |p: DVec3| (p / width).floor().to_array().map(|c| c as i32);
    // For each cell of a grid, the triangles whose bounding boxes meet it.
    let mut cells: BTreeMap<[i32; 3], Vec<usize>> = BTreeMap::new();
    for (index, t) in mesh.triangles.iter().enumerate() {
        let [a, b, c] = t.map(at);
        for_cells(cell(a.min(b).min(c)), cell(a.max(b).max(c)), |cell| cells.entry(cell).or_default().push(index));
    }
    let mut found = Vec::new();
    for &[i, j] in &edges {
        let mut near: BTreeSet<usize> = BTreeSet::new();
        for_cells(cell(at(i).min(at(j))), cell(at(i).max(at(j))), |cell| near.extend(cells.get(&cell).into_iter().flatten()));
        for index in near {
            let t = mesh.triangles[index];
            if !t.contains(&i) && !t.contains(&j) && goes_through([at(i), at(j)], t.map(at)) {
                found.push(([i, j], t));
            }
        }
    }
    found
}

/// The number of edges of the mesh, with vertices at `x` (m), that pass through triangles of a body, plus that of the
/// body's edges through the mesh's triangles.
pub fn crossings_with(mesh: &Mesh, x: &[Vec3], body: &Mesh) -> usize {
    let first = x.len() as u32;
    let mut both = Mesh { positions: Vec::new(), triangles: mesh.triangles.clone() };
    both.triangles.extend(body.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    let all: Vec<Vec3> = x.iter().chain(&body.positions).copied().collect();
    crossings(&both, &all).iter().filter(|(edge, triangle)| (edge[0] < first) != (triangle[0] < first)).count()
}

/// The numbers of crossings of a mesh, with vertices at `x` (m), with itself and with the colliders that are meshes.
pub fn with_itself_and(colliders: &[Collider], mesh: &Mesh, x: &[Vec3]) -> [usize; 2] {
    let with = colliders.iter().map(|collider| match &collider.shape {
        Shape::Mesh { mesh: body } => crossings_with(mesh, x, body),
        _ => 0,
    });
    [crossings(mesh, x).len(), with.sum()]
}

fn for_cells(low: [i32; 3], high: [i32; 3], mut then: impl FnMut([i32; 3])) {
    for x in low[0]..=high[0] {
        for y in low[1]..=high[1] {
            (low[2]..=high[2]).for_each(|z| then([x, y, z]));
        }
    }
}

/// Six times the signed volume of a tetrahedron.
fn volume(a: DVec3, b: DVec3, c: DVec3, d: DVec3) -> f64 {
    (b - a).cross(c - a).dot(d - a)
}

/// Whether a segment passes through a triangle: its ends lie on different sides, and its line passes all sides of the
/// triangle with the same orientation.
fn goes_through([p, q]: [DVec3; 2], [a, b, c]: [DVec3; 3]) -> bool {
    if (volume(a, b, c, p) > 0.0) == (volume(a, b, c, q) > 0.0) {
        return false;
    }
    let hands = [volume(p, q, a, b), volume(p, q, b, c), volume(p, q, c, a)];
    hands.iter().all(|&hand| hand > 0.0) || hands.iter().all(|&hand| hand < 0.0)
}

/// The least distance (m) between a vertex and a triangle of which it is not a corner.
pub fn closest(mesh: &Mesh, x: &[Vec3]) -> f64 {
    let x: Vec<DVec3> = x.iter().map(|x| x.as_dvec3()).collect();
    let mut least = f64::INFINITY;
    for &t in &mesh.triangles {
        let corners = t.map(|v| x[v as usize]);
        let (low, high) = (corners[0].min(corners[1]).min(corners[2]), corners[0].max(corners[1]).max(corners[2]));
        for (_, &p) in (0..).zip(&x).filter(|(v, _)| !t.contains(v)) {
            if (low - p).max(p - high).max_element() < least {
                least = least.min(p.distance(nearest(p, corners)));
            }
        }
    }
    least
}

/// The point of a triangle that is nearest to `p`: inside, or on the nearest of its sides.
fn nearest(p: DVec3, [a, b, c]: [DVec3; 3]) -> DVec3 {
    let n = (b - a).cross(c - a);
    let inside = |a: DVec3, b: DVec3| (b - a).cross(p - a).dot(n) >= 0.0;
    if n.length_squared() > 0.0 && inside(a, b) && inside(b, c) && inside(c, a) {
        return p - n * ((p - a).dot(n) / n.length_squared());
    }
    let on = |a: DVec3, b: DVec3| a + (b - a) * ((p - a).dot(b - a) / (b - a).length_squared().max(1e-300)).clamp(0.0, 1.0);
    let sides = [on(a, b), on(b, c), on(c, a)];
    sides.into_iter().min_by(|s, t| s.distance(p).total_cmp(&t.distance(p))).unwrap_or(a)
}
