//! Untangling: moves a cloth in small steps until no edge passes through a triangle.
//!
//! # Theory
//! Two surfaces cross along a contour, a polyline whose vertices are the crossings of edges with triangles. At each of
//! these vertices the gradient of the contour's length gives the direction in which the two sides have to move relative
//! to each other to make it shorter; a contour of length zero has vanished (Volino and Magnenat-Thalmann 2006,
//! "Resolving Surface Collisions through Intersection Contour Minimization"). See [`contour`]. Where that leads nowhere, as
//! along a straight contour from border to border, one of the two sides goes back through the other surface as a whole
//! ([`regions`]). Analytic colliders are in the way of both ([`outside`]). Cloth that is then still
//! inside a closed body without crossing it is moved to the nearest point of its surface ([`inside`]); in the opposite
//! order a sheet halfway through a body would be torn to both sides of it.
//!
//! # Limits
//! The method is a local descent and may end with crossings. For example, two sheets in the shape of an X stay as they
//! are if their borders are pinned.

mod contour;
mod inside;
mod outside;
mod regions;

use glam::{Vec3A, Vec4};
use outside::Obstacle;
use regions::Region;

use super::crossings::Features;
use crate::kernels::contact::Body;
use crate::kernels::integrate::xyz;
use crate::model::cloth::Cloth;
use crate::model::csr::Csr;
use crate::model::disjoint_sets::DisjointSets;
use crate::model::mesh::{EdgeIndex, Mesh, edges, is_proper, triangles_at};

/// Most rounds, and most rounds in a row without a decrease in the number of crossings.
const ROUNDS: usize = 1500;
const PATIENCE: usize = 60;
/// Lengths of a move, in mean edge lengths of the cloth. Short moves stretch the cloth least, but a descent by them ends where a contour
/// has to grow before it can vanish, in half of a hundred towels that fell without contact. After longer moves none of them had crossings.
const STEPS: [f32; 3] = [0.2, 0.4, 0.8];
/// Passes over the edges in each round, which move them toward their rest lengths.
const PASSES: usize = 4;
/// Most rounds of such passes after the last crossing has vanished.
const SETTLES: usize = 20;
/// The largest share of the crossings that may be left. To remove fewer is not worth the stretch, which the following steps turn
/// into motion.
const MOST_LEFT: f64 = 0.9;

/// Who asks vertices to move.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    Contours,
    Regions,
    Both,
}

/// Tried one after another, each for as long as it helps; if none does, with longer moves.
const WAYS: [Way; 3] = [Way::Contours, Way::Regions, Way::Both];

/// The features of the cloth and the bodies together.
struct Tangle<'a> {
    /// Positions (m) of the cloth's vertices, then of the bodies'; `w` is 1 if the vertex may be moved, otherwise 0.
    x: Vec<Vec4>,
    /// Number of the cloth's vertices, and those of each of its connected parts.
    cloth_vertices: usize,
    parts: Vec<Vec<u32>>,
    triangles: Vec<[u32; 3]>,
    edges: Vec<[u32; 2]>,
    /// The triangles at each edge.
    at_edges: Csr<u32>,
    /// The thickness (m) of the cloth.
    thickness: f32,
    /// The analytic colliders.
    obstacles: Vec<Obstacle<'a>>,
}

impl<'a> Tangle<'a> {
    fn new(cloth: &Cloth, x: &[Vec4], bodies: &[Mesh], analytic: &'a [Body], thickness: f32) -> Tangle<'a> {
        let mut all: Vec<Vec4> = x.iter().map(|x| x.with_w(f32::from(x.w > 0.0))).collect();
        let mut triangles = cloth.triangles.clone();
        for body in bodies {
            let first = all.len() as u32;
            all.extend(body.positions.iter().map(|x| x.extend(0.0)));
            let proper = body.triangles.iter().filter(|triangle| is_proper(triangle));
            triangles.extend(proper.map(|triangle| triangle.map(|vertex| vertex + first)));
        }
        let edges = edges(&triangles);
        let at_edges = triangles_at(&edges, &triangles, &EdgeIndex::new(&edges, all.len()));
        let own_edges = edges.iter().copied().filter(|[a, _]| (*a as usize) < x.len());
        let part_of = DisjointSets::parts(x.len(), own_edges);
        let mut parts = vec![Vec::new(); x.len()];
        (0..).zip(part_of).for_each(|(vertex, part)| parts[part as usize].push(vertex));
        parts.retain(|part| !part.is_empty());
        let obstacles = analytic.iter().map(|body| Obstacle::new(body, x, thickness)).collect();
        Tangle { x: all, cloth_vertices: x.len(), parts, triangles, edges, at_edges, thickness, obstacles }
    }

    /// The crossings: an edge and a triangle each, at least one of which belongs to the cloth. If there are too many pairs to test,
    /// their number.
    fn crossings(&self) -> Result<Vec<[u32; 2]>, usize> {
        let Tangle { edges, triangles, x, cloth_vertices, thickness, .. } = self;
        let (cloth_vertices, thickness) = (*cloth_vertices, *thickness);
        Features { edges, triangles, x, cloth_vertices, thickness, has_self_contact: true, is_shared: true }.crossings()
    }

    fn at(&self, vertex: u32) -> Vec3A {
        xyz(self.x[vertex as usize])
    }

    /// The unit normal of a triangle; zero if it has no area.
    fn normal(&self, triangle: u32) -> Vec3A {
        let [a, b, c] = self.triangles[triangle as usize].map(|vertex| self.at(vertex));
        (b - a).cross(c - a).normalize_or_zero()
    }

    /// Moves vertices by the mean of the directions in which they are asked to go, at most by `step` (m): by the crossings, by the
    /// regions that are to get `back`, or by both.
    fn advance(&mut self, found: &[[u32; 2]], back: &[Region], way: Way, step: f32) {
        let mut moves = vec![Vec4::ZERO; self.x.len()];
        let mut ask = |vertex: u32, by: Vec3A| moves[vertex as usize] += by.extend(1.0);
        if way != Way::Regions {
            for (&[edge, triangle], toward) in found.iter().zip(contour::gradients(self, found)) {
                self.edges[edge as usize].into_iter().for_each(|vertex| ask(vertex, toward));
                self.triangles[triangle as usize].into_iter().for_each(|vertex| ask(vertex, -toward));
            }
        }
        if way != Way::Contours {
            back.iter().for_each(|(vertices, toward)| vertices.iter().for_each(|&vertex| ask(vertex, *toward)));
        }
        for (x, by) in self.x.iter_mut().zip(moves).filter(|(x, by)| x.w * by.w > 0.0) {
            *x += (xyz(by) * (step / by.w)).extend(0.0);
        }
    }

    /// Moves the cloth's edges toward their rest lengths, one after another, in some passes.
    fn relax(&mut self, cloth: &Cloth) {
        for link in (0..PASSES).flat_map(|_| &cloth.links) {
            let [a, b] = link.ends.map(|end| end as usize);
            let (apart, free) = (xyz(self.x[b]) - xyz(self.x[a]), self.x[a].w + self.x[b].w);
            let length = apart.length();
            if free > 0.0 && length > 0.0 {
                let by = (apart * ((length - link.rest) / (length * free))).extend(0.0);
                let (of_a, of_b) = (self.x[a].w, self.x[b].w);
                self.x[a] += by * of_a;
                self.x[b] -= by * of_b;
            }
        }
        self.keep_out();
    }

    /// Moves vertices out of the closed bodies in which they are, and returns their number.
    fn leave(&mut self, solids: &[&Mesh]) -> usize {
        let left = inside::leave(self, solids);
        if left > 0 {
            self.keep_out();
        }
        left
    }

    /// Moves what has entered analytic colliders out of them.
    fn keep_out(&mut self) {
        let Tangle { x, obstacles, .. } = self;
        obstacles.iter().for_each(|obstacle| obstacle.keep_out(x));
    }
}

/// Moves the edges of a cloth at `x` (m) without crossings toward their rest lengths, as long as none arises.
fn settled(mut tangle: Tangle<'_>, x: Vec<Vec4>, cloth: &Cloth, solids: &[&Mesh]) -> Vec<Vec4> {
    tangle.x.clone_from(&x);
    let mut settled = x;
    for _ in 0..SETTLES {
        tangle.relax(cloth);
        if !tangle.crossings().is_ok_and(|found| found.is_empty()) || tangle.leave(solids) > 0 {
            break;
        }
        settled.clone_from(&tangle.x);
    }
    settled
}

/// Moves the cloth's vertices `x` (m; `w` is the inverse mass, 0 where a vertex is fixed) until no edge of the cloth
/// passes through a triangle of the cloth or of a body, or no further progress is made; they do not enter the `analytic` colliders.
/// Leaves them where they are if nearly all crossings remain. Returns the numbers of crossings before and after; if there are too many
/// pairs to test, their number.
pub(crate) fn untangle(
    cloth: &Cloth,
    x: &mut [Vec4],
    bodies: &[Mesh],
    analytic: &[Body],
    thickness: f32,
) -> Result<[usize; 2], usize> {
    let mut tangle = Tangle::new(cloth, x, bodies, analytic, thickness);
    let solids: Vec<&Mesh> = bodies.iter().filter(|body| inside::is_closed(body)).collect();
    let lengths: f32 = cloth.links.iter().map(|link| link.rest).sum();
    let steps = STEPS.map(|step| step * lengths / cloth.links.len().max(1) as f32);
    let mut found = tangle.crossings()?;
    let before = found.len();
    let (mut best, mut since, mut is_moved, mut was_inside) = ((before, tangle.x.clone()), 0, false, false);
    // How many ways were tried, and how many of the last ones did not help.
    let (mut tried, mut idle, mut left_before, mut back) = (0, 0, before, Vec::new());
    for _ in 0..ROUNDS {
        if found.is_empty() {
            let left = tangle.leave(&solids);
            (is_moved, was_inside) = (is_moved || left > 0, was_inside || left > 0);
            found = tangle.crossings()?;
            // Cloth that was inside of a body crossed nothing either, but is not to stay there.
            (best, since) = ((found.len(), tangle.x.clone()), 0);
            if found.is_empty() {
                break;
            }
        }
        tangle.advance(&found, &back, WAYS[tried % WAYS.len()], steps[idle / WAYS.len()]);
        tangle.relax(cloth);
        is_moved = true;
        found = tangle.crossings()?;
        since += 1;
        if found.len() < best.0 {
            (best, since) = ((found.len(), tangle.x.clone()), 0);
        } else if since > PATIENCE {
            tangle.x.clone_from(&best.1);
            found = tangle.crossings()?;
            back = regions::regions(&tangle, &found);
            // Without regions only the contours can move.
            let passed = if back.is_empty() { WAYS.len() - tried % WAYS.len() } else { 1 };
            idle = if best.0 < left_before { 0 } else { idle + passed };
            if idle >= STEPS.len() * WAYS.len() {
                break;
            }
            (tried, left_before, since) = (tried + passed, best.0, 0);
        }
    }
    let (after, mut to) = best;
    if !was_inside && before > 0 && after as f64 > MOST_LEFT * before as f64 {
        return Ok([before; 2]);
    }
    if after == 0 && is_moved {
        to = settled(tangle, to, cloth, &solids);
    }
    x.iter_mut().zip(to).for_each(|(x, to)| *x = to.with_w(x.w));
    Ok([before, after])
}
