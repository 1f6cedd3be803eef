//! The rows of the discrete curvature energy, and bounds for their explicit integration.
//!
//! The energy is `E = B/2 sum_v D_v |y_v|²` with `y_v = sum_j c_vj (x_j - x_v)`. At interior vertices `c` are cotangent
//! weights and `D = 1/A` with mixed Voronoi areas (Meyer et al. 2003). At a vertex on a straight free edge, `y` is the
//! curvature along that edge alone. The tip of a tooth, a triangle that no such row holds, bends about its base as a hinge of two
//! triangles does (Bergou et al. 2006). The rest shape is flat, because cloth is cut from flat fabric. With `B = 0` none of
//! this is built.
//!
//! Limitation: the energy depends on the mean curvature only, so a saddle costs nothing. A sheet is kept from bending
//! into a saddle because it does not stretch, over widths `b` with `b² kappa >> sqrt(B/K)`. That holds for cloth (a
//! millimeter and more), but not for a narrow strip as stiff as a ruler, which bends the opposite way across its width
//! and sags too much.

use glam::Vec4;

use crate::kernels::bending::BendEntry;
use crate::kernels::distance::MIN_LENGTH;
use crate::model::csr::Csr;
use crate::model::mesh::{self, EdgeIndex};

/// The rows for unit bending rigidity; they do not depend on the substep.
#[derive(Debug, Clone)]
pub(crate) struct Bending {
    /// For each vertex, the neighbors in its row and in whose rows it is.
    pub entries: Csr<BendEntry>,
    /// `D_v` for each vertex (1/m²; without a unit on a free edge, where `c` is one over a length), times the factor on its
    /// rigidity; 0 where it has no row.
    pub weight: Vec<f64>,
    /// `-c_vv` for each vertex.
    pub diagonal: Vec<f64>,
    /// The tip of each tooth and the vertex beyond its base. They are in each other's rows, but no edge joins them.
    pub across_bases: Vec<[u32; 2]>,
}

/// A boundary vertex has a row if the cosine of the angle between its two boundary edges is below this, that is, if
/// they are nearly in line.
const IN_LINE: f64 = -0.9;

/// What the triangles at one edge contribute to its coefficient.
#[derive(Debug, Clone, Copy, Default)]
struct Sides {
    /// Number of triangles with this edge, and the opposite vertices of the first two. Triangles with the same three vertices,
    /// as in a double-sided mesh, count as one.
    triangles: usize,
    apexes: [u32; 2],
    /// Half the sum of the cotangents of the opposite angles.
    cotangent: f64,
}

impl Bending {
    /// Builds the rows from the rest positions (m).
    pub(crate) fn new(rest: &[Vec4], triangles: &[[u32; 3]]) -> Bending {
        let vertices = rest.len();
        let at = |vertex: u32| rest[vertex as usize].truncate().as_dvec3();
        let edges = mesh::edges(triangles);
        let index_of = EdgeIndex::new(&edges, vertices);
        let mut sides = vec![Sides::default(); edges.len()];
        let mut area = vec![0.0; vertices];
        for &triangle in triangles {
            let x = triangle.map(at);
            let double_area = (x[1] - x[0]).cross(x[2] - x[0]).length();
            let longest = (0..3).map(|k| x[k].distance_squared(x[(k + 1) % 3])).fold(0.0, f64::max);
            // The triangle has no plane and no cotangents, or is too small for its curvature to be finite. It gets no
            // bending stiffness.
            if double_area <= 1e-9 * longest || longest < f64::from(MIN_LENGTH).powi(2) {
                continue;
            }
            let dot = [0, 1, 2].map(|k| (x[(k + 1) % 3] - x[k]).dot(x[(k + 2) % 3] - x[k]));
            let cotangent = dot.map(|dot| dot / double_area);
            for k in 0..3 {
                let (i, j) = (triangle[(k + 1) % 3], triangle[(k + 2) % 3]);
                let side = &mut sides[index_of.of([i.min(j), i.max(j)])];
                let known = side.triangles.min(2);
                if !side.apexes[..known].contains(&triangle[k]) {
                    side.apexes[known.min(1)] = triangle[k];
                    side.triangles += 1;
                }
                side.cotangent += 0.5 * cotangent[k];
                area[triangle[k] as usize] += mixed_area(k, double_area, dot, cotangent, x);
            }
        }

        let mut boundary: Vec<Vec<u32>> = vec![Vec::new(); vertices];
        let mut manifold = vec![true; vertices];
        for (&[i, j], side) in edges.iter().zip(&sides) {
            for (vertex, other) in [(i, j), (j, i)] {
                manifold[vertex as usize] &= side.triangles <= 2;
                if side.triangles == 1 {
                    boundary[vertex as usize].push(other);
                }
            }
        }
        let mut weight = vec![0.0; vertices];
        let mut free_edge = vec![None; vertices];
        for vertex in 0..vertices {
            if !manifold[vertex] || area[vertex] <= 0.0 {
                continue;
            }
            match *boundary[vertex].as_slice() {
                [] => weight[vertex] = 1.0 / area[vertex],
                [a, b] => {
                    let (to_a, to_b) = (at(a) - at(vertex as u32), at(b) - at(vertex as u32));
                    let lengths = [to_a.length(), to_b.length()];
                    if to_a.dot(to_b) < IN_LINE * lengths[0] * lengths[1] {
                        weight[vertex] = area[vertex] * (2.0 / (lengths[0] + lengths[1])).powi(2);
                        free_edge[vertex] = Some([(a, 1.0 / lengths[0]), (b, 1.0 / lengths[1])]);
                    }
                }
                _ => {}
            }
        }

        let entry = |other, forward: f64, backward: f64| BendEntry { other, forward: forward as f32, backward: backward as f32 };
        let held: Vec<bool> = free_edge.iter().zip(&manifold).map(|(row, manifold)| row.is_some() || !manifold).collect();
        let mut beyond = Vec::new();
        for (&[a, b], side) in edges.iter().zip(&sides).filter(|(_, side)| side.triangles == 2) {
            let is_tip = |tip: &u32| {
                let ends = &boundary[*tip as usize];
                ends.len() == 2 && ends.contains(&a) && ends.contains(&b) && ![*tip, a, b].iter().any(|&v| held[v as usize])
            };
            let Some(tip) = side.apexes.into_iter().find(is_tip) else { continue };
            let far = side.apexes[0] ^ side.apexes[1] ^ tip;
            let ([of_a, of_b, of_far], stiffness) = hinge([a, b, tip, far].map(at));
            weight[tip as usize] = stiffness;
            free_edge[tip as usize] = Some([(a, of_a), (b, of_b)]);
            beyond.extend([(tip, entry(far, of_far, 0.0)), (far, entry(tip, 0.0, of_far))]);
        }

        let coefficient = |vertex: u32, other: u32, side: &Sides| -> f64 {
            match free_edge[vertex as usize] {
                _ if weight[vertex as usize] == 0.0 => 0.0,
                Some(ends) => ends.iter().find(|end| end.0 == other).map_or(0.0, |end| end.1),
                None => side.cotangent,
            }
        };
        let pairs = edges.iter().zip(&sides).flat_map(|(&[i, j], side)| {
            let (ij, ji) = (coefficient(i, j, side), coefficient(j, i, side));
            [(i, entry(j, ij, ji)), (j, entry(i, ji, ij))]
        });
        let pairs = pairs.chain(beyond.iter().copied());
        let entries = Csr::new(vertices, pairs.filter(|(_, entry)| entry.forward != 0.0 || entry.backward != 0.0));
        let diagonal =
            (0..vertices as u32).map(|vertex| entries.of(vertex).iter().map(|entry| f64::from(entry.forward)).sum()).collect();
        let across_bases = beyond.iter().step_by(2).map(|(tip, entry)| [*tip, entry.other]).collect();
        Bending { entries, weight, diagonal, across_bases }
    }

    /// Bending energy (J) of positions `x` (m) for unit rigidity.
    pub(crate) fn energy(&self, x: &[glam::DVec3]) -> f64 {
        let row = |(v, weight): (usize, &f64)| {
            let entries = self.entries.of(v as u32).iter();
            let y: glam::DVec3 = entries.map(|e| (x[e.other as usize] - x[v]) * f64::from(e.forward)).sum();
            0.5 * weight * y.length_squared()
        };
        self.weight.iter().enumerate().map(row).sum()
    }

    /// Adds the forces (N) of unit rigidity on displacements `q` (m) along one coordinate; the energy is the same for
    /// each coordinate.
    pub(crate) fn add_forces(&self, q: &[f64], forces: &mut [f64]) {
        for (v, weight) in self.weight.iter().enumerate() {
            let entries = self.entries.of(v as u32);
            let moment = weight * entries.iter().map(|e| (q[e.other as usize] - q[v]) * f64::from(e.forward)).sum::<f64>();
            for entry in entries {
                forces[entry.other as usize] += moment * f64::from(entry.forward);
            }
            forces[v] -= moment * self.diagonal[v];
        }
    }

    /// Gershgorin bounds (1/s²) on the largest eigenvalue with the given row stiffnesses, one for each vertex:
    /// `g_i = w_i sum_v |c_vi| r_v S_v`, `r_v = sum_j |c_vj|`. `rest` holds the inverse masses (1/kg) in its w
    /// components.
    pub(crate) fn bounds(&self, rest: &[Vec4], stiffness: &[f64]) -> Vec<f64> {
        let reach =
            |v: usize| self.diagonal[v].abs() + self.entries.of(v as u32).iter().map(|e| f64::from(e.forward.abs())).sum::<f64>();
        let reach: Vec<f64> = (0..rest.len()).map(reach).collect();
        let bound = |i: usize| {
            let own = self.diagonal[i].abs() * reach[i] * stiffness[i];
            let others = self.entries.of(i as u32).iter();
            let others = others.map(|e| f64::from(e.backward.abs()) * reach[e.other as usize] * stiffness[e.other as usize]);
            f64::from(rest[i].w) * (own + others.sum::<f64>())
        };
        (0..rest.len()).map(bound).collect()
    }

    /// The least of the values at the vertices of a row.
    pub(crate) fn least_of_row(&self, per_vertex: &[f64], v: usize) -> f64 {
        let row = self.entries.of(v as u32).iter().filter(|e| e.forward != 0.0);
        row.map(|e| per_vertex[e.other as usize]).fold(per_vertex[v], f64::min)
    }
}

/// The row of a hinge at the edge from `a` to `b` (m) between the triangles of `tip` and `far`: the coefficients of `a`, `b` and `far`, and
/// its stiffness (1/m²). With the heights `h` of the triangles over the edge, and the feet `p` of the heights, it is
/// `l ((x_tip - p_tip)/h_tip + (x_far - p_far)/h_far)`, which is 0 if they lie in a plane and `l` times the angle at the edge if
/// that is small; the stiffness is 3 over both areas.
fn hinge([a, b, tip, far]: [glam::DVec3; 4]) -> ([f64; 3], f64) {
    let edge = b - a;
    let square = edge.length_squared();
    let side = |x: glam::DVec3| {
        let double_area = edge.cross(x - a).length();
        (double_area, square / double_area, edge.dot(x - a) / square)
    };
    let [(area_tip, by_tip, foot_tip), (area_far, by_far, foot_far)] = [side(tip), side(far)];
    let of_b = by_tip * foot_tip + by_far * foot_far;
    ([of_b - by_tip - by_far, -of_b, by_far], 6.0 / (area_tip + area_far))
}

/// The mixed Voronoi area of a triangle's corner `k`; obtuse triangles are split by halves (Meyer et al. 2003).
fn mixed_area(k: usize, double_area: f64, dot: [f64; 3], cotangent: [f64; 3], x: [glam::DVec3; 3]) -> f64 {
    match dot.iter().position(|&dot| dot < 0.0) {
        Some(obtuse) if obtuse == k => 0.25 * double_area,
        Some(_) => 0.125 * double_area,
        None => {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            (x[i].distance_squared(x[k]) * cotangent[j] + x[j].distance_squared(x[k]) * cotangent[i]) / 8.0
        }
    }
}
