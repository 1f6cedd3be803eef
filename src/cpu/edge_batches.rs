//! The edges of tasks, packed for lanes that share no vertex: rows first, which need no gathering.
//!
//! What an edge is corrected by does not depend on the lane that it is in, so that any packing gives the same bits.

use std::ops::Range;

use glam::Vec4;

use crate::cpu::partition::Task;
use crate::cpu::shared::Shared;
#[cfg(test)]
use crate::cpu::sweep;
use crate::cpu::sweep::{Rows, Rule};
use crate::kernels::Edge;
use crate::simd::aligned::Lines;
use crate::simd::{self, Breadth};

/// How the vertices of a row's edges lie in memory; most of a grid's are side by side, which need no gathering.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    /// From vertices `a`, `a + 1` ... to `b`, `b + 1` ...: two ends are stored.
    Rows,
    /// From `a` to `a + 1`, from `a + 2` to `a + 3` ...: one end is stored.
    Pairs,
    /// Anywhere: an end for each lane, and once more.
    Apart,
}

/// Rows of one kind, one after another.
#[derive(Debug, Clone)]
struct Batch {
    kind: Kind,
    rows: Range<usize>,
    /// Where their ends are.
    ends: usize,
}

/// The rows of a list of tasks: as many edges of one colour as the processor takes together. A lane without an edge of its own
/// repeats another, in the same row to the same effect, else with no share.
#[derive(Debug, Default)]
pub(crate) struct Packed {
    breadth: Breadth,
    /// A row's numbers, lane by lane: one over the rest length (1/m), and what share of the correction each end takes, which is
    /// the edge's `inverse_weight` times the end's inverse mass.
    factors: Lines,
    ends: Vec<u32>,
    batches: Vec<Batch>,
    of: Vec<Range<usize>>,
    vertices: usize,
}

/// An edge, and whether it counts.
type Lane = (Edge, bool);

impl Kind {
    /// How many ends a row stores.
    pub(crate) fn ends(self, lanes: usize) -> usize {
        match self {
            Kind::Rows => 2,
            Kind::Pairs => 1,
            Kind::Apart => 2 * lanes,
        }
    }

    /// End 0 or 1 of a lane's edge.
    fn end(self, ends: &[u32], lanes: usize, end: usize, lane: usize) -> u32 {
        let place = simd::place(lane, lanes) as u32;
        match self {
            Kind::Rows => ends[end] + place,
            Kind::Pairs => ends[0] + 2 * place + end as u32,
            Kind::Apart => ends[end * lanes + lane],
        }
    }
}

impl Packed {
    /// Packs the edges of `tasks`, which are places in `edges`, colour by colour, given the vertices' inverse masses.
    ///
    /// # Panics
    /// If an edge's vertex has no inverse mass, or a colour names a vertex twice.
    pub(crate) fn new(tasks: &[Task], edges: &[Edge], colors: &[Range<usize>], inverse_mass: &[f32], breadth: Breadth) -> Packed {
        let vertices = inverse_mass.len();
        let mut packer =
            Packer { lanes: breadth.lanes(), inverse_mass, packed: Packed { breadth, vertices, ..Packed::default() } };
        // The task and colour that last visited a vertex.
        let mut visited = vec![(usize::MAX, usize::MAX); vertices];
        let mut edges_now: Vec<Edge> = Vec::new();
        for (index, task) in tasks.iter().enumerate() {
            let start = packer.packed.batches.len();
            // Springs are forces: no edge is swept.
            let mut rest = if edges.is_empty() { &[] } else { task.edges.as_slice() };
            for (color, range) in colors.iter().enumerate() {
                let (now, later) = rest.split_at(rest.partition_point(|&place| (place as usize) < range.end));
                rest = later;
                edges_now.clear();
                edges_now.extend(now.iter().map(|&place| edges[place as usize]));
                for end in edges_now.iter().flat_map(|edge| [edge.a, edge.b]) {
                    let before = std::mem::replace(&mut visited[end as usize], (index, color));
                    assert!(before != (index, color), "vertex {end} has two edges of a colour");
                }
                packer.color(&mut edges_now, start);
            }
            let end = packer.packed.batches.len();
            packer.packed.of.push(start..end);
        }
        packer.packed.factors.trim();
        packer.packed
    }

    /// Visits the edges of one task in order.
    ///
    /// # Safety
    /// The processor can do the breadth. No other thread may write `u` at the task's vertices meanwhile, nor `x`, nor read `u`
    /// there; both have as many items as the inverse masses that the edges were packed with.
    #[expect(unsafe_code, reason = "see the safety section; tasks are kept apart by Stripes and Crew")]
    pub(crate) unsafe fn sweep(&self, task: usize, x: Shared<Vec4>, u: Shared<Vec4>, rule: Rule) {
        debug_assert!(x.len() == self.vertices && u.len() == self.vertices, "one item per vertex");
        let lanes = self.breadth.lanes();
        for batch in &self.batches[self.of[task].clone()] {
            let factors = bytemuck::cast_slice(&self.factors[3 * lanes / 4 * batch.rows.start..3 * lanes / 4 * batch.rows.end]);
            let ends = &self.ends[batch.ends..batch.ends + batch.rows.len() * batch.kind.ends(lanes)];
            // SAFETY: the caller's promise; `new` checked that the ends are vertices.
            unsafe {
                #[cfg(test)]
                if self.breadth == Breadth::One {
                    let ends_of = |row: usize| &ends[row * batch.kind.ends(lanes)..];
                    let end = |row: usize, end: usize, lane: usize| batch.kind.end(ends_of(row), lanes, end, lane);
                    lanes::each(factors, lanes, end, x, u, rule);
                    continue;
                }
                simd::run(self.breadth, Rows { rule, kind: batch.kind, factors, ends, x, u });
            }
        }
    }
}

/// Packs for so many lanes.
struct Packer<'a> {
    lanes: usize,
    inverse_mass: &'a [f32],
    packed: Packed,
}

impl Packer<'_> {
    /// The edges of one colour, which may come in any order: rows first, then what is left over. Batches from `open` on may grow.
    fn color(&mut self, edges: &mut [Edge], open: usize) {
        let lanes = self.lanes;
        // Edges of one row have one offset, and come one after another.
        let offset = |edge: &Edge| edge.b.wrapping_sub(edge.a);
        edges.sort_unstable_by_key(|edge| (offset(edge), edge.a));
        let step = |edge: &Edge| if offset(edge) == 1 { 2 } else { 1 };
        let follows = |one: &Edge, next: &Edge| offset(one) == offset(next) && next.a - one.a == step(one);
        let mut apart: Vec<Edge> = Vec::new();
        for run in edges.chunk_by(follows) {
            if run.len() < lanes {
                apart.extend(run);
                continue;
            }
            let kind = if step(&run[0]) == 1 { Kind::Rows } else { Kind::Pairs };
            for start in (0..run.len()).step_by(lanes) {
                // The last row of a run begins earlier, and leaves alone what the rows before have done.
                let first = start.min(run.len() - lanes);
                self.push(kind, open, |lane| {
                    let place = first + simd::place(lane, lanes);
                    (run[place], place >= start)
                });
            }
        }
        apart.sort_unstable_by_key(|edge| (edge.a, edge.b));
        for edges in apart.chunks(lanes) {
            self.push(Kind::Apart, open, |lane| (edges[lane.min(edges.len() - 1)], true));
        }
    }

    /// Adds a row, given by its lanes, to the last batch of those from `open` on, or a new one.
    fn push(&mut self, kind: Kind, open: usize, lane: impl Fn(usize) -> Lane) {
        let (lanes, packed) = (self.lanes, &mut self.packed);
        let row = 4 * packed.factors.len() / (3 * lanes);
        match packed.batches[open..].last_mut() {
            Some(batch) if batch.kind == kind => batch.rows.end += 1,
            _ => packed.batches.push(Batch { kind, rows: row..row + 1, ends: packed.ends.len() }),
        }
        let start = packed.ends.len();
        match kind {
            Kind::Rows => packed.ends.extend([lane(0).0.a, lane(0).0.b]),
            Kind::Pairs => packed.ends.push(lane(0).0.a),
            Kind::Apart => {
                packed.ends.extend((0..lanes).map(|k| lane(k).0.a));
                packed.ends.extend((0..lanes).map(|k| lane(k).0.b));
            }
        }
        let spelled = |k: usize| [0, 1].map(|end| kind.end(&packed.ends[start..], lanes, end, k));
        debug_assert!((0..lanes).all(|k| spelled(k) == [lane(k).0.a, lane(k).0.b]), "{kind:?}");
        let inverse_mass = self.inverse_mass;
        let share = |(edge, counts): Lane, end: u32| if counts { edge.inverse_weight * inverse_mass[end as usize] } else { 0.0 };
        packed.factors.push(lanes, |k| lane(k).0.inverse_rest);
        packed.factors.push(lanes, |k| share(lane(k), lane(k).0.a));
        packed.factors.push(lanes, |k| share(lane(k), lane(k).0.b));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cpu::partition::Stripes;
    use crate::kernels::xyz;
    use crate::model::cloth::Cloth;
    use crate::step::coefficients::Coefficients;
    use crate::{Fabric, Mesh, Options};

    /// `u` after one sweep, in tasks, or edge by edge in the plain colour order.
    fn swept(cloth: &Cloth, edges: &[Edge], start: &[Vec4], rule: Rule, breadth: Option<Breadth>) -> Vec<Vec4> {
        let kernel = rule.kernel();
        let (mut x, mut u) = (cloth.rest.clone(), start.to_vec());
        let Some(breadth) = breadth else {
            for edge in edges {
                let (a, b) = (edge.a as usize, edge.b as usize);
                let impulse = kernel(xyz(x[a] - x[b]), xyz(u[a] - u[b]), edge).extend(0.0);
                u[a] += impulse * x[a].w;
                u[b] -= impulse * x[b].w;
            }
            return u;
        };
        let stripes = Stripes::new(&cloth.links, cloth.swept().len(), x.len());
        let weights: Vec<f32> = x.iter().map(|x| x.w).collect();
        for tasks in &stripes.rounds {
            let packed = Packed::new(tasks, edges, &cloth.colors, &weights, breadth);
            for task in 0..tasks.len() {
                #[expect(unsafe_code, reason = "one thread, both slices alive")]
                // SAFETY: nobody else is here.
                unsafe {
                    packed.sweep(task, Shared::new(&mut x), Shared::new(&mut u), rule);
                }
            }
        }
        u
    }

    /// The same work in the same order: to rounding with every processor, gentle or wild, soft or stiff, pinned or not.
    #[test]
    fn lanes_do_what_the_plain_kernel_does() {
        let mut mesh = Mesh::grid(37, 61, 1.0, 1.6);
        let mut random = fastrand::Rng::with_seed(9);
        let mut vector = |size: f32| glam::Vec3::from_array([0; 3].map(|_: i32| size * (random.f32() - 0.5)));
        mesh.positions.iter_mut().for_each(|x| *x += vector(0.004));
        for (size, stretch) in [(0.001, 50.0), (0.001, 1e6), (0.05, 5000.0), (2.0, 5000.0)] {
            let fabric = Fabric { stretch, ..Fabric::default() };
            let options = Options { fabric, pinned: vec![0, 36, 500], ..Options::default() };
            let cloth = Cloth::new(&mesh, &options).unwrap();
            let edges = Coefficients::new(&cloth, &[], &options, 1.0 / 1200.0).edges;
            let start: Vec<Vec4> = cloth.rest.iter().map(|x| vector(if x.w > 0.0 { size } else { 0.0 }).extend(0.0)).collect();
            for rule in [Rule::Project, Rule::Pull, Rule::Relax] {
                let plain = swept(&cloth, &edges, &start, rule, None);
                let moved = plain.iter().zip(&start).map(|(u, start)| (u - start).truncate().length()).fold(0.0, f32::max);
                assert!(moved > 0.01 * size, "{size}: something is corrected");
                for breadth in [Breadth::One].into_iter().chain(Breadth::all()) {
                    let lanes = swept(&cloth, &edges, &start, rule, Some(breadth));
                    let apart = plain.iter().zip(&lanes).map(|(a, b)| (a - b).truncate().length()).fold(0.0, f32::max);
                    assert!(apart <= 3e-6 * (moved + size), "{rule:?} {size} {stretch} {breadth:?}: {apart} of {moved}");
                }
            }
        }
    }
}
