//! Which edges are visited twice.

use std::f32::consts::PI;

use super::*;
use crate::model::mesh::{Mesh, edges};

/// How often each edge is visited; empty if all of them once.
fn visits_of(mesh: &Mesh) -> Vec<Visits> {
    let edges = edges(&mesh.triangles);
    visits(&mesh.positions, &mesh.triangles, &edges, &EdgeIndex::new(&edges, mesh.positions.len()))
}

/// A grid whose points are moved, and joined where they coincide.
fn wrapped(columns: u32, rows: u32, to: impl Fn(f32, f32) -> Vec3) -> Mesh {
    let mut mesh = Mesh::grid(columns, rows, 2.0, 2.0);
    mesh.positions.iter_mut().for_each(|x| *x = to(0.5 * PI * (1.0 - x.z), PI * (1.0 + x.x)));
    let first = |&vertex: &u32| {
        let x = mesh.positions[vertex as usize];
        mesh.positions.iter().position(|other| other.distance(x) < 1e-4).unwrap_or(0) as u32
    };
    mesh.triangles = mesh.triangles.iter().map(|triangle| [0, 1, 2].map(|k| first(&triangle[k]))).collect();
    mesh.triangles.retain(|[a, b, c]| a != b && b != c && c != a);
    mesh
}

/// A ball of 16 rings about the y-axis, of which the part up to `open` (radians from the upper pole) is missing.
fn ball(open: f32) -> Mesh {
    wrapped(33, 17, |down, around| {
        let down = down.max(open);
        0.25 * Vec3::new(down.sin() * around.cos(), down.cos(), down.sin() * around.sin())
    })
}

/// Two sheets of `n` by `n` vertices sewn together all around.
pub(crate) fn cushion(n: u32) -> Mesh {
    let mut mesh = Mesh::grid(n, n, 1.0, 1.0);
    let is_inner = |vertex: u32| [vertex % n, vertex / n].into_iter().all(|k| 0 < k && k + 1 < n);
    let mut below: Vec<u32> = (0..n * n).collect();
    for vertex in (0..n * n).filter(|&vertex| is_inner(vertex)) {
        below[vertex as usize] = mesh.positions.len() as u32;
        mesh.positions.push(mesh.positions[vertex as usize] - 0.05 * Vec3::Y);
    }
    mesh.triangles.extend(mesh.triangles.clone().iter().map(|[a, b, c]| [c, b, a].map(|&vertex| below[vertex as usize])));
    mesh
}

#[test]
fn what_bulges_or_is_closed_is_a_shell_and_tubes_have_diagonals() {
    let torus = wrapped(25, 13, |down, around| {
        let (sin, cos) = (2.0 * down).sin_cos();
        Vec3::new((0.3 + 0.1 * cos) * around.cos(), 0.1 * sin, (0.3 + 0.1 * cos) * around.sin())
    });
    let tube = wrapped(25, 9, |down, around| Vec3::new(0.2 * around.cos(), 0.2 * down, 0.2 * around.sin()));
    // Five of the eight rows are sheared by half a cell, which leaves the triangles there with two equal sides.
    let sheared = wrapped(25, 9, |down, around| {
        let around = around - PI / 24.0 * (8.0 * down / PI).min(5.0);
        Vec3::new(0.2 * around.cos(), 0.2 * down, 0.2 * around.sin())
    });
    // A tube that opens like a trumpet at both ends has negative curvature.
    let spool = wrapped(25, 9, |down, around| {
        let radius = 0.2 + 0.1 * (down - 0.5 * PI).powi(2);
        Vec3::new(radius * around.cos(), 0.2 * down, radius * around.sin())
    });
    // Whatever its inside, a sheet with a flat border has no total curvature.
    let quilt = wrapped(49, 49, |u, v| Vec3::new(0.2 * u, 0.05 * ((4.0 * u).sin() * (3.0 * v).sin()).powi(2), 0.1 * v));
    let far = {
        let mut far = cushion(9);
        far.positions.iter_mut().for_each(|x| *x += Vec3::X * 1000.0);
        far
    };
    let mut two_sided = Mesh::grid(9, 9, 1.0, 1.0);
    two_sided.triangles.extend(two_sided.triangles.clone().iter().map(|&[a, b, c]| [c, b, a]));
    let mut ring = Mesh::grid(9, 9, 1.0, 1.0);
    ring.triangles.retain(|triangle| !triangle.contains(&40));
    // The share of edges that are visited there and back, and first and last.
    for (name, mesh, shares) in [
        ("ball", ball(0.0), [1.0, 0.0]),
        ("most of a ball", ball(0.8), [1.0, 0.0]),
        ("half a ball", ball(0.5 * PI), [1.0, 0.0]),
        ("a watch glass", ball(0.8 * PI), [0.0, 0.0]),
        ("torus", torus, [1.0, 0.0]),
        ("cushion", cushion(9), [1.0, 0.0]),
        ("far away", far, [1.0, 0.0]),
        ("sheet", Mesh::grid(9, 9, 1.0, 1.0), [0.0, 0.0]),
        ("two-sided sheet", two_sided, [0.0, 0.0]),
        ("tube", tube, [0.0, 1.0 / 3.0]),
        ("mostly sheared tube", sheared, [0.0, 0.0]),
        ("spool", spool, [0.0, 1.0 / 3.0]),
        ("sheet with a hole", ring, [0.0, 1.0 / 3.0]),
        ("quilt", quilt, [0.0, 0.0]),
        ("thread", Mesh { positions: vec![Vec3::ZERO, Vec3::X], triangles: vec![[0, 1, 1]] }, [0.0, 0.0]),
    ] {
        let found = visits_of(&mesh);
        let share = |of: Visits| found.iter().filter(|&&visits| visits == of).count() as f32 / found.len().max(1) as f32;
        let found = [Visits::ThereAndBack, Visits::FirstAndLast].map(share);
        assert!((found[0] - shares[0]).abs() < 0.01 && (found[1] - shares[1]).abs() < 0.05, "{name}: {found:?}");
    }
}

/// A ball beside a sheet does not make that a shell.
#[test]
fn each_part_counts_by_itself() {
    let (mut mesh, ball) = (Mesh::grid(5, 5, 1.0, 1.0), ball(0.0));
    let first = mesh.positions.len() as u32;
    mesh.positions.extend(&ball.positions);
    mesh.triangles.extend(ball.triangles.iter().map(|triangle| triangle.map(|vertex| vertex + first)));
    for (ends, visits) in edges(&mesh.triangles).iter().zip(visits_of(&mesh)) {
        assert_eq!(visits, if ends[0] < first { Visits::Once } else { Visits::ThereAndBack });
    }
}
