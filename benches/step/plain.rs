//! The baseline: the default method in its simplest form, one edge after another, on one thread.
//!
//! In color order it is as stable as the crate. In the mesh's own order, as in code without batches, it gains energy
//! after a while (`tests/stability.rs`), and each edge has to wait for its neighbor's result.

use cloth_deformer::Mesh;
use cloth_deformer::glam::{Vec3A, Vec4};

/// An N x N sheet of 1 m with its first row pinned, as `scenes::hang`.
#[derive(Debug)]
pub(crate) struct Plain {
    x: Vec<Vec4>,
    p: Vec<Vec3A>,
    u: Vec<Vec3A>,
    edges: Vec<Edge>,
    h: f32,
    /// Length of the last substep (s).
    last: f32,
}

#[derive(Debug, Clone, Copy)]
struct Edge {
    a: usize,
    b: usize,
    inverse_rest: f32,
    inverse_weight: f32,
}

impl Plain {
    /// Density 0.2 kg/m², K = 5000 N/m. With `colors`, edges are in color order, else in the order of their vertices.
    pub(crate) fn hang(n: u32, substeps: u32, colors: bool) -> Plain {
        let mesh = Mesh::grid(n, n, 1.0, 1.0);
        let h = 1.0 / (60.0 * substeps as f32);
        let side = 1.0 / (n - 1) as f32;
        let mut area = vec![0.0; mesh.positions.len()];
        for triangle in &mesh.triangles {
            triangle.iter().for_each(|&v| area[v as usize] += side * side / 6.0);
        }
        let x: Vec<Vec4> =
            mesh.positions.iter().enumerate().map(|(v, x)| x.extend(if v < n as usize { 0.0 } else { 5.0 / area[v] })).collect();
        let mut taken = vec![0_u32; x.len()];
        let mut edges: Vec<(u32, Edge)> = Vec::new();
        // For each direction in turn the first free color, which gives the same order as the crate's coloring.
        let mut links = mesh.edges();
        links.sort_by_key(|[a, b]| (b - a == n - 1, b - a == n, *a));
        for [a, b] in links {
            let (a, b) = (a as usize, b as usize);
            if x[a].w + x[b].w == 0.0 {
                continue;
            }
            let first = if b - a == 1 {
                0
            } else if b - a == n as usize {
                2
            } else {
                4
            };
            let color = (first..32).find(|color| (taken[a] | taken[b]) & (1 << color) == 0).expect("a free color");
            taken[a] |= 1 << color;
            taken[b] |= 1 << color;
            let rest = (x[a] - x[b]).truncate().length();
            let border =
                mesh.triangles.iter().skip(2 * (a / n as usize).saturating_sub(1) * (n as usize - 1)).take(4 * n as usize);
            let triangles = border.filter(|t| t.contains(&(a as u32)) && t.contains(&(b as u32))).count();
            let compliance = rest * rest / (5000.0 * triangles as f32 * side * side / 2.0 * h * h);
            let weight = x[a].w + x[b].w;
            let inverse_weight = 1.0 / (weight + (compliance - 0.5 * weight).max(0.0));
            edges.push((color, Edge { a, b, inverse_rest: 1.0 / rest, inverse_weight }));
        }
        if colors {
            edges.sort_by_key(|&(color, _)| color);
        } else {
            edges.sort_by_key(|(_, edge)| (edge.a, edge.b));
        }
        let zero = vec![Vec3A::ZERO; x.len()];
        Plain { x, p: zero.clone(), u: zero, edges: edges.into_iter().map(|(_, edge)| edge).collect(), h, last: 0.0 }
    }

    /// Returns to rest at the given positions.
    pub(crate) fn reset(&mut self, rest: &[Vec3A]) {
        self.x.iter_mut().zip(rest).for_each(|(x, rest)| *x = rest.extend(x.w));
        self.p.fill(Vec3A::ZERO);
        self.last = 0.0;
    }

    /// One substep.
    pub(crate) fn substep(&mut self) {
        let gain = 0.5 * (self.last + self.h) * self.h;
        for ((u, p), x) in self.u.iter_mut().zip(&self.p).zip(&self.x) {
            *u = if x.w == 0.0 { Vec3A::ZERO } else { *p + Vec3A::new(0.0, -9.81 * gain, 0.0) };
        }
        for edge in &self.edges {
            let (x_a, x_b) = (self.x[edge.a], self.x[edge.b]);
            let impulse = project(Vec3A::from_vec4(x_a - x_b), self.u[edge.a] - self.u[edge.b], edge);
            self.u[edge.a] += impulse * x_a.w;
            self.u[edge.b] -= impulse * x_b.w;
        }
        for ((x, p), u) in self.x.iter_mut().zip(&mut self.p).zip(&self.u) {
            *x += u.extend(0.0);
            *p = *u;
        }
        self.last = self.h;
    }

    /// Mean of `max(0, l/l0 - 1)` over the edges.
    pub(crate) fn strain(&self) -> f32 {
        let strain = |edge: &Edge| ((self.x[edge.a] - self.x[edge.b]).truncate().length() * edge.inverse_rest - 1.0).max(0.0);
        self.edges.iter().map(strain).sum::<f32>() / self.edges.len() as f32
    }
}

fn project(d0: Vec3A, du: Vec3A, edge: &Edge) -> Vec3A {
    let d = d0 + du;
    let inverse_square = edge.inverse_rest * edge.inverse_rest;
    let r = d.length_squared() * inverse_square - 1.0;
    let r0 = d0.length_squared() * inverse_square - 1.0;
    if d0.dot(d) * inverse_square > 0.9 && r.abs() < 0.1 && r0.abs() < 0.1 {
        let unit = 1.0 - r0 * (0.5 - r0 * 0.375);
        d0 * (-edge.inverse_weight * unit * r * (0.5 - r * (0.125 - r * 0.0625)))
    } else {
        d * (edge.inverse_weight * (1.0 / (edge.inverse_rest * d.length().max(1e-12)) - 1.0))
    }
}
